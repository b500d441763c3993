//! Studies of a user's own needle: compression of the tissue, remote centres of motion (RCM) for wanted corrections of the tip, and what
//! uncertain tissue does.

use crate::beam_case::BeamCase;
use crate::tradeoff::{Axis, Factor, Figure, Study, Table};
use insonify_base::document::InputError;
use insonify_base::machine::Machine;
use insonify_base::number::decimal;
use insonify_mechanics::needle::beam::inverse::Wanted;
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

/// Axes of the layers of [`compression`].
const LAYERS: [Axis; 7] = [
    Axis::linear("from_mm", "from mm", "depth, mm"),
    Axis::linear("to_mm", "to mm", "depth, mm"),
    Axis::linear("least_ratio", "least ratio", "least compression ratio"),
    Axis::linear("least_at_mm", "at mm", "depth of the least ratio, mm"),
    Axis::linear("limit_ratio", "limit", "limit of the compression ratio"),
    Axis::linear("most_n_per_mm", "most N/mm", "largest force per length, N/mm"),
    Axis::linear("force_n", "force N", "force on the layer, N"),
];

/// Axes over depth of [`compression`].
const DEPTH: [Axis; 5] = [
    Axis::linear("x_mm", "x mm", "depth, mm"),
    Axis::linear("u_mm", "u mm", "deflection, mm"),
    Axis::linear("ratio", "ratio", "compression ratio"),
    PERCENT,
    Axis::linear("reaction_n_per_mm", "N/mm", "force of the needle on the tissue, N/mm"),
];

fn compression_tables(case: &BeamCase, shape: &Shape) -> Vec<Table> {
    let title = "Layers of tissue: compression ratio (length over uncompressed length) and force of the needle";
    let mut layers = Table::new("layers", title, &[Factor::new("layer", "layer")], &LAYERS);
    let mut depth = Table::trace(
        "depth",
        "Compression over depth",
        &[Factor::new("layer", "layer")],
        &DEPTH,
    );
    for load in &shape.layers {
        let (name, [from, to]) = ((load.layer + 1).to_string(), load.depths_mm);
        let limit = case.problem.layers[load.layer].least_ratio;
        let values = [from, to, load.least_ratio, load.least_at_mm].map(Some);
        let rest = [
            (limit > 0.0).then_some(limit),
            Some(load.most_n_per_mm),
            Some(load.force_n),
        ];
        let over = (load.least_ratio < limit).then(|| "beyond its limit".to_owned());
        layers.push(vec![name.clone()], [&values[..], &rest[..]].concat(), over);
        // A point between two layers belongs to the deeper one, the tip to the last.
        let last = load.layer + 1 == shape.layers.len();
        let inside = |x: f64| x >= from && (x < to || last);
        for point in shape.points.iter().filter(|point| inside(point.x_mm)) {
            let values = [
                point.x_mm,
                point.u_mm,
                point.ratio,
                percent(point.ratio),
                point.reaction_n_per_mm,
            ];
            depth.push(vec![name.clone()], values.map(Some).to_vec(), None);
        }
    }
    vec![layers, depth]
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

/// Axes of [`map`].
const MAP: [Axis; 10] = [
    Axis::linear("tip_mm", "tip mm", "deflection of the tip, mm"),
    Axis::linear("rcm_mm", "RCM mm", "RCM, mm below the entry"),
    Axis::linear("displacement_mm", "base mm", "displacement of the base, mm"),
    Axis::linear("slope", "slope", "slope of the base"),
    Axis::linear("com_mm", "COM mm", "COM, mm below the entry"),
    Axis::linear("least_ratio", "least ratio", "least compression ratio"),
    PERCENT,
    Axis::linear("least_at_mm", "at mm", "depth of the largest compression, mm"),
    Axis::linear("base_force_n", "force N", "force at the base, N"),
    Axis::linear("base_moment_nmm", "moment N mm", "moment at the base, N mm"),
];

/// Values of [`MAP`] for a shape.
fn motion(tip_mm: f64, shape: &Shape) -> Vec<Option<f64>> {
    let base = &shape.points[0];
    vec![
        Some(tip_mm),
        shape.rcm_mm(),
        Some(base.u_mm),
        Some(base.slope),
        shape.com_mm(),
        Some(shape.least_ratio),
        Some(percent(shape.least_ratio)),
        weakest(shape).map(|load| load.least_at_mm),
        Some(shape.base_force_n),
        Some(shape.base_moment_nmm),
    ]
}

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

/// Computes the motion of the base that brings the tip to each wanted place, about each RCM (mm below the entry), of a base that turns
/// freely, and with the least compression.
///
/// # Errors
/// [`InputError`] if the needle cannot be computed at all; motions that do not exist are flagged rows.
pub fn map(case: &BeamCase, tips_mm: &[f64], rcms_mm: &[f64]) -> Result<Study, InputError> {
    let factors = [
        Factor::new("tip", "wanted tip, mm"),
        Factor::new("base", "base"),
        Factor::new("limits", "limits"),
    ];
    let title = "Motions of the base that bring the tip to its wanted place";
    let mut table = Table::new("map", title, &factors, &MAP);
    for &tip_mm in tips_mm {
        let about = rcms_mm
            .iter()
            .map(|&rcm_mm| ("about", Wanted::TipAbout { tip_mm, rcm_mm }));
        let others = [
            ("turns freely", Wanted::TipFree { tip_mm }),
            ("least compression", Wanted::TipLeast { tip_mm }),
        ];
        for (base, wanted) in about.chain(others) {
            let (limits, values, flag) = match case.reach(&wanted) {
                Ok((_, shape)) => (limits(case, &shape), motion(tip_mm, &shape), None),
                Err(error) => {
                    // A motion that does not exist keeps its row with what was asked for,
                    // so that the edge of the reach is seen.
                    let mut values = vec![None; MAP.len()];
                    values[0] = Some(tip_mm);
                    if let Wanted::TipAbout { rcm_mm, .. } = wanted {
                        values[1] = Some(rcm_mm);
                    }
                    ("-".to_owned(), values, Some(error.cause().to_string()))
                }
            };
            table.push(vec![tip_mm.to_string(), base.to_owned(), limits], values, flag);
        }
    }
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

/// Quantities of [`sensitivity`], with their changes.
const OUTCOMES: [Axis; 8] = [
    Axis::linear("percent", "change %", "change, %"),
    Axis::linear("tip_mm", "tip mm", "deflection of the tip, mm"),
    Axis::linear("tip_change_mm", "change mm", "change of the tip, mm"),
    Axis::linear("com_mm", "COM mm", "COM, mm below the entry"),
    Axis::linear("com_change_mm", "change mm", "change of the COM, mm"),
    Axis::linear("rcm_mm", "RCM mm", "RCM, mm below the entry"),
    Axis::linear("rcm_change_mm", "change mm", "change of the RCM, mm"),
    Axis::linear("least_ratio", "least ratio", "least compression ratio"),
];

/// Tip, COM and RCM of a shape, mm.
fn outcomes(shape: &Shape) -> [Option<f64>; 3] {
    [Some(shape.tip_mm()), shape.com_mm(), shape.rcm_mm()]
}

/// Computes what uncertain tissue does to tip, COM and RCM for the motion of the base in the case: each parameter of all layers and of
/// each alone, and the range over all combinations of the parameters at their low, given and high values.
///
/// # Errors
/// [`InputError`] if the case itself has no shape; changed tissue without one gives flagged rows.
pub fn sensitivity(case: &BeamCase, by: &Uncertainty) -> Result<Study, InputError> {
    let nominal = case.solve()?;
    let solve = |problem: &Problem| -> Result<Shape, BeamError> { FoundationBeam::new(problem)?.solve(&case.base) };
    let factors = [Factor::new("parameter", "parameter"), Factor::new("layer", "layer")];
    let title = "One parameter changed at a time";
    let mut table = Table::new("sensitivity", title, &factors, &OUTCOMES);
    let percents = [by.mu_percent, by.alpha_percent, by.t0_percent];
    let count = case.problem.layers.len();
    let alone = (0..count).map(Some).filter(|_| count > 1);
    for layer in std::iter::once(None).chain(alone) {
        for (parameter, name) in ["mu", "alpha", "t0"].into_iter().enumerate() {
            // The case itself once, for the plots.
            let given = layer.is_none().then_some(0.0);
            for share in [Some(-1.0), Some(-0.5), given, Some(0.5), Some(1.0)]
                .into_iter()
                .flatten()
            {
                let percent = share * percents[parameter];
                let mut scale = [1.0; 3];
                scale[parameter] += percent / 100.0;
                let label = layer.map_or("all".to_owned(), |layer| (layer + 1).to_string());
                let (values, flag) = match solve(&changed(&case.problem, layer, scale)) {
                    Ok(shape) => (row(percent, &shape, &nominal), None),
                    Err(error) => ([&[Some(percent)][..], &[None; 7]].concat(), Some(error.to_string())),
                };
                table.push(vec![name.to_owned(), label], values, flag);
            }
        }
    }
    let figure = |file: &'static str, title: &str, y: &'static str| Figure {
        only: vec![("layer", "all".to_owned())],
        ..Figure::new(file, title, "sensitivity", ["percent", y], "parameter")
    };
    let figures = vec![
        figure("beam-sensitivity-tip", "Uncertain tissue: the tip", "tip_change_mm"),
        figure("beam-sensitivity-com", "Uncertain tissue: the COM", "com_change_mm"),
    ];
    let (ranges, failed) = ranges(&nominal, percents, |scale| {
        solve(&changed(&case.problem, None, scale)).ok()
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

fn row(percent: f64, shape: &Shape, nominal: &Shape) -> Vec<Option<f64>> {
    let mut values = vec![Some(percent)];
    for (value, given) in outcomes(shape).into_iter().zip(outcomes(nominal)) {
        values.extend([value, value.zip(given).map(|(value, given)| value - given)]);
    }
    values.push(Some(shape.least_ratio));
    values
}

/// Ranges over all combinations of low, given and high values, and the number of combinations without a shape.
fn ranges(nominal: &Shape, percents: [f64; 3], solve: impl Fn([f64; 3]) -> Option<Shape>) -> (Table, usize) {
    let axes = [
        Axis::linear("given", "as given", "as given"),
        Axis::linear("least", "least", "least"),
        Axis::linear("most", "most", "most"),
        Axis::linear("width", "range", "range"),
    ];
    let title = "All parameters together: ranges over low, given and high values of each";
    let mut table = Table::new("ranges", title, &[Factor::new("quantity", "quantity")], &axes);
    // Outcomes need not be monotonic: the given values are combined too, not the extremes alone.
    let shapes: Vec<Option<Shape>> = (0..27)
        .map(|combination| {
            let level = |parameter: u32| f64::from(combination / 3i32.pow(parameter) % 3 - 1);
            solve([0, 1, 2].map(|parameter| 1.0 + level(parameter) * percents[parameter as usize] / 100.0))
        })
        .collect();
    let with_ratio = |shape: &Shape| [outcomes(shape).as_slice(), &[Some(shape.least_ratio)]].concat();
    let names = ["tip, mm", "COM, mm", "RCM, mm", "least compression ratio"];
    for (quantity, name) in names.into_iter().enumerate() {
        let values: Vec<f64> = shapes
            .iter()
            .flatten()
            .filter_map(|shape| with_ratio(shape)[quantity])
            .collect();
        let least = values.iter().copied().reduce(f64::min);
        let most = values.iter().copied().reduce(f64::max);
        let width = least.zip(most).map(|(least, most)| most - least);
        table.push(
            vec![name.to_owned()],
            vec![with_ratio(nominal)[quantity], least, most, width],
            None,
        );
    }
    (table, shapes.iter().filter(|shape| shape.is_none()).count())
}
