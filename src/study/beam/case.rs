//! Studies of a user's own needle: compression of the tissue, remote centres of motion (RCM) for wanted corrections of
//! the tip, and what uncertain tissue does.

use crate::beam_case::BeamCase;
use crate::tradeoff::{Axis, Choice, Column, Factor, Figure, Study, Table};
use insonify_base::document::InputError;
use insonify_base::machine::Machine;
use insonify_base::number::decimal;
use insonify_mechanics::needle::beam::inverse::Wanted;
use insonify_mechanics::needle::beam::shape::Point;
use insonify_mechanics::needle::beam::{BeamError, FoundationBeam, LayerLoad, Problem, Shape};

fn study(name: &'static str, title: &'static str, case: &BeamCase, tables: Vec<Table>, figures: Vec<Figure>) -> Study {
    let problem = &case.problem;
    let lengths = [problem.inserted_mm, problem.control_distance_mm].map(|mm| decimal(mm, 1));
    let turning = match case.base.slope {
        Some(slope) => format!("slope {slope}"),
        None => format!("turning freely, {} mm before its axis", problem.pivot_mm),
    };
    Study {
        name,
        title,
        about: vec![
            (
                "needle",
                format!(
                    "{:.1} N mm^2, {} mm in, base {} mm before the entry",
                    problem.bending_nmm2, lengths[0], lengths[1]
                ),
            ),
            ("base", format!("{} mm aside, {turning}", case.base.displacement_mm)),
        ],
        machine: Machine::here(),
        tables,
        figures,
        notes: Vec::new(),
    }
}

fn line(file: &'static str, title: &str, table: &'static str, axes: [&'static str; 2], colour: &'static str) -> Figure {
    Figure {
        marked: false,
        ..Figure::new(file, title, table, axes, colour)
    }
}

/// Largest compression in percent of the uncompressed length.
const PERCENT: Axis = Axis::linear("compression_percent", "compr. %", "compression, %");

fn percent(ratio: f64) -> f64 {
    100.0 * (1.0 - ratio)
}

/// The most compressed layer.
fn weakest(shape: &Shape) -> Option<&LayerLoad> {
    shape
        .layers
        .iter()
        .min_by(|a, b| a.least_ratio.total_cmp(&b.least_ratio))
}

/// A layer of tissue along the needle.
struct LayerRow {
    load: LayerLoad,
    /// Limit of the compression ratio; 0 without one.
    limit_ratio: f64,
}

const LAYER: Factor = Factor::new("layer", "layer");

const LAYERS: [Column<LayerRow>; 7] = [
    Axis::linear("from_mm", "from mm", "depth, mm").of(|row| Some(row.load.depths_mm[0])),
    Axis::linear("to_mm", "to mm", "depth, mm").of(|row| Some(row.load.depths_mm[1])),
    Axis::linear("least_ratio", "least ratio", "least compression ratio").of(|row| Some(row.load.least_ratio)),
    Axis::linear("least_at_mm", "at mm", "depth of the least ratio, mm").of(|row| Some(row.load.least_at_mm)),
    Axis::linear("limit_ratio", "limit", "limit of the compression ratio")
        .of(|row| Some(row.limit_ratio).filter(|limit| *limit > 0.0)),
    Axis::linear("most_n_per_mm", "most N/mm", "largest force per length, N/mm").of(|row| Some(row.load.most_n_per_mm)),
    Axis::linear("force_n", "force N", "force on the layer, N").of(|row| Some(row.load.force_n)),
];

/// A point of the needle in a layer of tissue.
struct DepthRow {
    layer: usize,
    point: Point,
}

const DEPTH: [Column<DepthRow>; 5] = [
    Axis::linear("x_mm", "x mm", "depth, mm").of(|row| Some(row.point.x_mm)),
    Axis::linear("u_mm", "u mm", "deflection, mm").of(|row| Some(row.point.u_mm)),
    Axis::linear("ratio", "ratio", "compression ratio").of(|row| Some(row.point.ratio)),
    PERCENT.of(|row| Some(percent(row.point.ratio))),
    Axis::linear("reaction_n_per_mm", "N/mm", "force of the needle on the tissue, N/mm")
        .of(|row| Some(row.point.reaction_n_per_mm)),
];

/// Layers count from 1 for users.
fn layer_name(layer: usize) -> String {
    (layer + 1).to_string()
}

fn compression_tables(case: &BeamCase, shape: &Shape) -> Vec<Table> {
    let (mut layers, mut depths) = (Vec::new(), Vec::new());
    for load in &shape.layers {
        // A point between two layers belongs to the deeper one, the tip to the last.
        let [from, to] = load.depths_mm;
        let last = load.layer + 1 == shape.layers.len();
        let inside = |x: f64| x >= from && (x < to || last);
        let points = shape.points.iter().filter(|point| inside(point.x_mm));
        depths.extend(points.map(|&point| DepthRow {
            layer: load.layer,
            point,
        }));
        layers.push(LayerRow {
            load: *load,
            limit_ratio: case.problem.layers[load.layer].least_ratio,
        });
    }
    let title = "Layers of tissue: compression ratio (length over uncompressed length) and force of the needle";
    let of_layer = LAYER.of(|row: &LayerRow| layer_name(row.load.layer));
    let of_point = LAYER.of(|row: &DepthRow| layer_name(row.layer));
    vec![
        Table::of("layers", title, &[of_layer], &LAYERS, &layers).flagged(&layers, |row| {
            (row.load.least_ratio < row.limit_ratio).then(|| "beyond its limit".to_owned())
        }),
        Table::of("depth", "Compression over depth", &[of_point], &DEPTH, &depths).unlisted(),
    ]
}

/// Computes the compression of the tissue and the forces on it, by layer and over depth.
///
/// # Errors
/// [`InputError`] if the needle has no shape.
pub fn compression(case: &BeamCase) -> Result<Study, InputError> {
    let shape = case.solve()?;
    let tables = compression_tables(case, &shape);
    let figures = vec![
        line(
            "beam-compression",
            "Compression over depth",
            "depth",
            ["x_mm", "compression_percent"],
            "layer",
        ),
        line(
            "beam-reaction",
            "Force over depth",
            "depth",
            ["x_mm", "reaction_n_per_mm"],
            "layer",
        ),
    ];
    let mut study = study("beam-compression", "Compression of the tissue", case, tables, figures);
    if let Some(load) = weakest(&shape) {
        study.notes.push(format!(
            "largest compression: layer {}, to {:.4} of its length, {} mm below the entry",
            load.layer + 1,
            load.least_ratio,
            decimal(load.least_at_mm, 2)
        ));
    }
    let [force, moment] = [shape.base_force_n, shape.base_moment_nmm].map(|value| decimal(value, 4));
    study
        .notes
        .push(format!("force and moment at the base: {force} N, {moment} N mm"));
    Ok(study)
}

/// A motion of the base that brings the tip to its wanted place.
struct MotionRow {
    tip_mm: f64,
    base: &'static str,
    /// RCM asked for, mm below the entry.
    wanted_rcm_mm: Option<f64>,
    /// Limits in words and shape of the needle, or why it has none.
    reached: Result<(String, Shape), String>,
}

impl MotionRow {
    fn of_shape(&self, value: impl Fn(&Shape) -> Option<f64>) -> Option<f64> {
        value(&self.reached.as_ref().ok()?.1)
    }
}

const MAP_CHOICES: [Choice<MotionRow>; 3] = [
    Factor::new("tip", "wanted tip, mm").of(|row| row.tip_mm.to_string()),
    Factor::new("base", "base").of(|row| row.base.to_owned()),
    Factor::new("limits", "limits").of(|row| match &row.reached {
        Ok((limits, _)) => limits.clone(),
        Err(_) => "-".to_owned(),
    }),
];

// A motion that does not exist keeps its row with what was asked for, so that the edge of the reach is seen.
const MAP: [Column<MotionRow>; 10] = [
    Axis::linear("tip_mm", "tip mm", "deflection of the tip, mm").of(|row| Some(row.tip_mm)),
    Axis::linear("rcm_mm", "RCM mm", "RCM, mm below the entry").of(|row| match &row.reached {
        Ok((_, shape)) => shape.rcm_mm(),
        Err(_) => row.wanted_rcm_mm,
    }),
    Axis::linear("displacement_mm", "base mm", "displacement of the base, mm")
        .of(|row| row.of_shape(|shape| Some(shape.points[0].u_mm))),
    Axis::linear("slope", "slope", "slope of the base").of(|row| row.of_shape(|shape| Some(shape.points[0].slope))),
    Axis::linear("com_mm", "COM mm", "COM, mm below the entry").of(|row| row.of_shape(Shape::com_mm)),
    Axis::linear("least_ratio", "least ratio", "least compression ratio")
        .of(|row| row.of_shape(|shape| Some(shape.least_ratio))),
    PERCENT.of(|row| row.of_shape(|shape| Some(percent(shape.least_ratio)))),
    Axis::linear("least_at_mm", "at mm", "depth of the largest compression, mm")
        .of(|row| row.of_shape(|shape| weakest(shape).map(|load| load.least_at_mm))),
    Axis::linear("base_force_n", "force N", "force at the base, N")
        .of(|row| row.of_shape(|shape| Some(shape.base_force_n))),
    Axis::linear("base_moment_nmm", "moment N mm", "moment at the base, N mm")
        .of(|row| row.of_shape(|shape| Some(shape.base_moment_nmm))),
];

/// Which layers a shape compresses beyond their limits, in words.
fn limits(case: &BeamCase, shape: &Shape) -> String {
    let layers = &case.problem.layers;
    let over = shape.layers.iter();
    let over = over.filter(|load| load.least_ratio < layers[load.layer].least_ratio);
    let over: Vec<_> = over.map(|load| format!("beyond in layer {}", load.layer + 1)).collect();
    if over.is_empty() {
        "kept".to_owned()
    } else {
        over.join(", ")
    }
}

/// Computes the motion of the base that brings the tip to each wanted place, about each RCM (mm below the entry), of a
/// base that turns freely, and with the least compression.
///
/// # Errors
/// [`InputError`] if the needle cannot be computed at all; motions that do not exist are flagged rows.
pub fn map(case: &BeamCase, tips_mm: &[f64], rcms_mm: &[f64]) -> Result<Study, InputError> {
    let mut rows = Vec::new();
    for &tip_mm in tips_mm {
        let about = rcms_mm
            .iter()
            .map(|&rcm_mm| ("about", Some(rcm_mm), Wanted::TipAbout { tip_mm, rcm_mm }));
        let others = [
            ("turns freely", None, Wanted::TipFree { tip_mm }),
            ("least compression", None, Wanted::TipLeast { tip_mm }),
        ];
        for (base, wanted_rcm_mm, wanted) in about.chain(others) {
            let reached = case.reach(&wanted);
            rows.push(MotionRow {
                tip_mm,
                base,
                wanted_rcm_mm,
                reached: reached
                    .map(|(_, shape)| (limits(case, &shape), shape))
                    .map_err(|error| error.cause().to_string()),
            });
        }
    }
    let title = "Motions of the base that bring the tip to its wanted place";
    let table =
        Table::of("map", title, &MAP_CHOICES, &MAP, &rows).flagged(&rows, |row| row.reached.as_ref().err().cloned());
    let about = |file: &'static str, title: &str, y: &'static str| Figure {
        only: vec![("base", "about".to_owned())],
        ..Figure::new(file, title, "map", ["rcm_mm", y], "tip")
    };
    let figures = vec![
        about(
            "beam-map-displacement",
            "Displacement of the base by RCM",
            "displacement_mm",
        ),
        about(
            "beam-map-compression",
            "Largest compression by RCM",
            "compression_percent",
        ),
        about("beam-map-force", "Force at the base by RCM", "base_force_n"),
    ];
    Ok(study(
        "beam-map",
        "Remote centres of motion for corrections of the tip",
        case,
        vec![table],
        figures,
    ))
}

/// Relative uncertainty of the tissue, percent.
#[derive(Clone, Copy, Debug)]
pub struct Uncertainty {
    /// Uncertainty of moduli.
    pub mu_percent: f64,
    /// Uncertainty of exponents.
    pub alpha_percent: f64,
    /// Uncertainty of the uncompressed length t0.
    pub t0_percent: f64,
}

/// Changes one layer, or all, by factors of stiffness, exponent and uncompressed length.
fn changed(problem: &Problem, layer: Option<usize>, [stiffness, exponent, length]: [f64; 3]) -> Problem {
    let mut changed = problem.clone();
    let layers = changed.layers.iter_mut().enumerate();
    for (_, layer) in layers.filter(|(index, _)| layer.is_none_or(|chosen| chosen == *index)) {
        layer.initial_length_mm *= length;
        layer.material = layer.material.scaled(stiffness, exponent);
    }
    changed
}

/// Tip, COM and RCM (mm) and least compression ratio of a shape.
type Outcomes = [Option<f64>; 4];

fn outcomes(shape: &Shape) -> Outcomes {
    [
        Some(shape.tip_mm()),
        shape.com_mm(),
        shape.rcm_mm(),
        Some(shape.least_ratio),
    ]
}

/// Tissue with one parameter changed.
struct ChangedRow {
    parameter: &'static str,
    /// Index of the changed layer; `None` for all.
    layer: Option<usize>,
    /// Change of the parameter, percent.
    percent: f64,
    given: Outcomes,
    /// Outcomes with the change, or why the needle has no shape.
    changed: Result<Outcomes, String>,
}

impl ChangedRow {
    fn outcome(&self, quantity: usize) -> Option<f64> {
        self.changed.as_ref().ok()?[quantity]
    }

    fn change(&self, quantity: usize) -> Option<f64> {
        Some(self.outcome(quantity)? - self.given[quantity]?)
    }
}

const CHANGED_CHOICES: [Choice<ChangedRow>; 2] = [
    Factor::new("parameter", "parameter").of(|row| row.parameter.to_owned()),
    LAYER.of(|row| row.layer.map_or("all".to_owned(), layer_name)),
];

const CHANGED: [Column<ChangedRow>; 8] = [
    Axis::linear("percent", "change %", "change, %").of(|row| Some(row.percent)),
    Axis::linear("tip_mm", "tip mm", "deflection of the tip, mm").of(|row| row.outcome(0)),
    Axis::linear("tip_change_mm", "change mm", "change of the tip, mm").of(|row| row.change(0)),
    Axis::linear("com_mm", "COM mm", "COM, mm below the entry").of(|row| row.outcome(1)),
    Axis::linear("com_change_mm", "change mm", "change of the COM, mm").of(|row| row.change(1)),
    Axis::linear("rcm_mm", "RCM mm", "RCM, mm below the entry").of(|row| row.outcome(2)),
    Axis::linear("rcm_change_mm", "change mm", "change of the RCM, mm").of(|row| row.change(2)),
    Axis::linear("least_ratio", "least ratio", "least compression ratio").of(|row| row.outcome(3)),
];

/// Computes what uncertain tissue does to tip, COM and RCM for the motion of the base in the case: each parameter of
/// all layers and of each alone, and the range over all combinations of the parameters at their low, given and high
/// values.
///
/// # Errors
/// [`InputError`] if the case itself has no shape; changed tissue without one gives flagged rows.
pub fn sensitivity(case: &BeamCase, by: &Uncertainty) -> Result<Study, InputError> {
    let nominal = case.solve()?;
    let solve = |problem: &Problem| -> Result<Shape, BeamError> { FoundationBeam::new(problem)?.solve(&case.base) };
    let given = outcomes(&nominal);
    let mut rows = Vec::new();
    let percents = [by.mu_percent, by.alpha_percent, by.t0_percent];
    let count = case.problem.layers.len();
    let alone = (0..count).map(Some).filter(|_| count > 1);
    for layer in std::iter::once(None).chain(alone) {
        for (parameter, name) in ["mu", "alpha", "t0"].into_iter().enumerate() {
            // The case itself once, for the plots.
            let unchanged = layer.is_none().then_some(0.0);
            let shares = [Some(-1.0), Some(-0.5), unchanged, Some(0.5), Some(1.0)];
            for share in shares.into_iter().flatten() {
                let percent = share * percents[parameter];
                let mut scale = [1.0; 3];
                scale[parameter] += percent / 100.0;
                let changed = solve(&changed(&case.problem, layer, scale));
                rows.push(ChangedRow {
                    parameter: name,
                    layer,
                    percent,
                    given,
                    changed: changed.map(|shape| outcomes(&shape)).map_err(|error| error.to_string()),
                });
            }
        }
    }
    let title = "One parameter changed at a time";
    let table = Table::of("sensitivity", title, &CHANGED_CHOICES, &CHANGED, &rows)
        .flagged(&rows, |row| row.changed.as_ref().err().cloned());
    let figure = |file: &'static str, title: &str, y: &'static str| Figure {
        only: vec![("layer", "all".to_owned())],
        ..Figure::new(file, title, "sensitivity", ["percent", y], "parameter")
    };
    let figures = vec![
        figure("beam-sensitivity-tip", "Uncertain tissue: the tip", "tip_change_mm"),
        figure("beam-sensitivity-com", "Uncertain tissue: the COM", "com_change_mm"),
    ];
    let (ranges, failed) = ranges(given, percents, |scale| {
        let shape = solve(&changed(&case.problem, None, scale)).ok()?;
        Some(outcomes(&shape))
    });
    let mut study = study(
        "beam-sensitivity",
        "Uncertain tissue",
        case,
        vec![table, ranges],
        figures,
    );
    let [mu, alpha, t0] = percents;
    study.about.push((
        "uncertain",
        format!("mu +-{mu} %, alpha +-{alpha} %, t0 +-{t0} %, for all layers alike"),
    ));
    if failed > 0 {
        study.notes.push(format!(
            "{failed} of 27 combinations have no shape: tissue compressed to nothing"
        ));
    }
    Ok(study)
}

/// Range of an outcome.
struct RangeRow {
    quantity: &'static str,
    given: Option<f64>,
    least: Option<f64>,
    most: Option<f64>,
}

const RANGES: [Column<RangeRow>; 4] = [
    Axis::linear("given", "as given", "as given").of(|row| row.given),
    Axis::linear("least", "least", "least").of(|row| row.least),
    Axis::linear("most", "most", "most").of(|row| row.most),
    Axis::linear("width", "range", "range").of(|row| Some(row.most? - row.least?)),
];

/// Ranges over all combinations of low, given and high values, and the number of combinations without a shape.
fn ranges(given: Outcomes, percents: [f64; 3], solve: impl Fn([f64; 3]) -> Option<Outcomes>) -> (Table, usize) {
    // Outcomes need not be monotonic: the given values are combined too, not the extremes alone.
    let combinations: Vec<Option<Outcomes>> = (0..27)
        .map(|combination| {
            let level = |parameter: u32| f64::from(combination / 3i32.pow(parameter) % 3 - 1);
            solve([0, 1, 2].map(|parameter| 1.0 + level(parameter) * percents[parameter as usize] / 100.0))
        })
        .collect();
    let names = ["tip, mm", "COM, mm", "RCM, mm", "least compression ratio"];
    let rows: Vec<RangeRow> = std::iter::zip(names, given)
        .enumerate()
        .map(|(index, (quantity, given))| {
            let values = || combinations.iter().flatten().filter_map(|outcomes| outcomes[index]);
            RangeRow {
                quantity,
                given,
                least: values().reduce(f64::min),
                most: values().reduce(f64::max),
            }
        })
        .collect();
    let title = "All parameters together: ranges over low, given and high values of each";
    let choices = [Factor::new("quantity", "quantity").of(|row: &RangeRow| row.quantity.to_owned())];
    let failed = combinations.iter().filter(|outcomes| outcomes.is_none()).count();
    (Table::of("ranges", title, &choices, &RANGES, &rows), failed)
}
