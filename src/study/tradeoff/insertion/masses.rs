//! Masses and springs against finite elements: the same cylinder of tissue, supports, nodes and insertion of a rigid
//! needle.
//!
//! Springs have no Poisson's ratio: a network without preferred directions behaves as a material of ratio 1/4. Finite
//! elements are therefore included with that ratio too, which separates the error of the model from that of the
//! material.

use nalgebra::{Point3, Vector3};

use super::{
    InsertionOptions, Progress, Step, StepTimes, Timed, largest, mean_square, points, timed, times, unsettled,
};
use crate::tradeoff::{Axis, Choice, Column, FORCE_N, Factor, Goal, Study, Table};
use insonify::Error;
use insonify_mechanics::block;
use insonify_mechanics::insertion::finite::{Finite, FiniteOptions, Setup};
use insonify_mechanics::insertion::spring::{MassSpring, MassSpringParameters};
use insonify_mechanics::insertion::{Anatomy, Interaction, Model, NodeSolver, Snapshot, Tissue};
use insonify_mechanics::tissue::material::Material;
use insonify_mechanics::tissue::remesh::{Level, Precision};
use insonify_mesh::TetMesh;
use insonify_mesh::locator::{Locator, NO_ELEMENT};

/// Rings and layers of the cylinder: nodes every 5 mm and every 8.3 mm.
const GRIDS: [[usize; 2]; 2] = [[5, 20], [3, 12]];
/// Advance of the tip per step, mm.
const ADVANCE_MM: f64 = 0.02;
/// Points at which tissue is compared: distances from the needle, mm, and number of points around it.
const AROUND: ([f64; 4], usize) = ([2.0, 4.0, 6.0, 10.0], 8);
/// Spacing of the comparison points along the needle, mm.
const ALONG_MM: f64 = 2.5;
const FINITE: &str = "finite elements";
const SPRINGS: &str = "masses and springs";

/// Choices of a contender, as named in the table.
#[derive(Clone)]
struct Named {
    model: &'static str,
    poisson: String,
    spacing_mm: String,
}

/// Differences from the gold standard: displacements with the needle inserted (root mean square, % and largest, mm) and
/// half-way back, %, and forces at the base, N.
struct Differences {
    tissue_percent: f64,
    tissue_mm: f64,
    back_percent: f64,
    force_rms_n: f64,
    force_n: f64,
}

/// An insertion; `None` for the gold standard.
struct MassRow {
    named: Named,
    differences: Option<Differences>,
    times: StepTimes,
}

impl Timed for MassRow {
    fn times(&self) -> &StepTimes {
        &self.times
    }
}

const CHOICES: [Choice<MassRow>; 3] = [
    Factor::new("model", "model").of(|row| row.named.model.to_owned()),
    Factor::new("poisson", "Poisson's ratio").of(|row| row.named.poisson.clone()),
    Factor::new("spacing_mm", "spacing, mm").of(|row| row.named.spacing_mm.clone()),
];

const COLUMNS: [Column<MassRow>; 5] = [
    Axis::linear(
        "tissue_percent",
        "tissue off, %",
        "difference of displacements (root mean square), %",
    )
    .of(|row| Some(row.differences.as_ref()?.tissue_percent)),
    Axis::log(
        "tissue_mm",
        "tissue off, mm",
        "largest difference of displacements there, mm",
    )
    .of(|row| Some(row.differences.as_ref()?.tissue_mm)),
    Axis::log(
        "back_percent",
        "tissue off back, %",
        "the same with the needle drawn half way back (root mean square), %",
    )
    .of(|row| Some(row.differences.as_ref()?.back_percent)),
    Axis::log(
        "force_rms_n",
        "force off, N",
        "difference of the force at the base (root mean square), N",
    )
    .of(|row| Some(row.differences.as_ref()?.force_rms_n)),
    Axis::log(
        "force_n",
        "force off at most, N",
        "largest difference of the force at the base, N",
    )
    .of(|row| Some(row.differences.as_ref()?.force_n)),
];

/// Region 0 from z = 0 on.
#[derive(Debug)]
struct HalfSpace;

impl Anatomy for HalfSpace {
    fn region(&self, point_mm: &Point3<f64>) -> Option<i32> {
        (point_mm.z > 0.0).then_some(0)
    }

    fn interaction(&self, _: i32) -> Interaction {
        block::USUAL
    }
}

/// Model of the insertion.
struct Contender {
    named: Named,
    model: Box<dyn Model>,
    imager: Box<dyn NodeSolver>,
    /// Locator of the reference nodes.
    locator: Locator<f64>,
}

/// Insertion of one contender.
#[derive(Default)]
struct Insertion {
    steps: Vec<Step>,
    /// Displacements with the needle inserted, and half-way through withdrawal.
    fields: [Vec<Vector3<f64>>; 2],
}

pub(super) fn run(options: &InsertionOptions, study: &mut Study, progress: Progress<'_>) -> Result<(), Error> {
    let mut contenders = Vec::new();
    for grid in GRIDS {
        for poisson in [0.45, 0.25] {
            contenders.push(finite(grid, poisson)?);
        }
        contenders.push(springs(grid)?);
    }
    let mut insertions: Vec<Insertion> = contenders.iter().map(|_| Insertion::default()).collect();
    let count = contenders.len();
    let runs = (options.passes * count) as f64;
    // Each step counts with its shortest time over all passes; passes lie apart in time, so that other load
    // on the machine spoils at most some of them.
    for pass in 0..options.passes {
        for (index, (contender, insertion)) in contenders.iter_mut().zip(&mut insertions).enumerate() {
            let share = (pass * count + index) as f64 / runs;
            progress("masses and springs against finite elements", share);
            contender.insert(options.depth_mm, insertion)?;
        }
    }
    let compared = contenders.iter().zip(&insertions).enumerate();
    let rows = compared.map(|(index, (contender, insertion))| MassRow {
        named: contender.named.clone(),
        differences: (index > 0).then(|| differences(&insertions[0], insertion)),
        times: StepTimes::of(&insertion.steps),
    });
    let rows: Vec<MassRow> = rows.collect();
    let goal = Goal::new("median_ms", "force_n", FORCE_N)
        .choosing("finite elements or masses and springs")
        .beside(&["p99_ms", "force_rms_n", "tissue_mm", "tissue_percent"]);
    let title = "Masses and springs against finite elements: differences from the first row";
    let columns: Vec<_> = COLUMNS.into_iter().chain(times()).chain([unsettled()]).collect();
    let table = Table::of("masses", title, &CHOICES, &columns, &rows)
        .gold_where(&rows, |row| row.differences.is_none())
        .against("finite elements, nu = 0.45, on the finer nodes: the first row")
        .seeking(goal);
    let title = "Masses and springs, finite elements: tissue within 10 mm of the needle";
    let mut figure = points(
        "insertion-masses",
        title,
        "masses",
        ["median_ms", "tissue_percent"],
        "model",
    );
    figure.marker = vec!["poisson", "spacing_mm"];
    study.notes.extend(recommendation(&rows));
    study.tables.push(table);
    study.figures.push(figure);
    Ok(())
}

/// Returns a recommendation in words.
fn recommendation(rows: &[MassRow]) -> Option<String> {
    let row = |model: &str, poisson: &str| {
        let named = |row: &&MassRow| row.named.model == model && (poisson.is_empty() || row.named.poisson == poisson);
        rows.iter().find(named)
    };
    let (finite, same_poisson, springs) = (row(FINITE, "0.45")?, row(FINITE, "0.25")?, row(SPRINGS, "")?);
    let slower = springs.times.median_ms? / finite.times.median_ms?;
    let percent = |row: &MassRow| Some(row.differences.as_ref()?.tissue_percent);
    let (off_percent, material) = (percent(springs)?, percent(same_poisson)?);
    let advice = if slower > 1.0 {
        "take finite elements wherever the tissue has a mesh, and masses and springs where there is none: they need only to know \
             what lies where"
    } else {
        "take finite elements where displacements matter, masses and springs where time alone does, or where there is no mesh"
    };
    Some(format!(
        "masses and springs: a step takes {slower:.2} times the median time of finite elements, and tissue is displaced {off_percent:.0} % \
         otherwise (finite elements with nu = 0.25 in place of 0.45: {material:.0} %); {advice}"
    ))
}

fn parameters([rings, layers]: [usize; 2]) -> MassSpringParameters {
    MassSpringParameters {
        rings,
        layers: Some(layers),
        ..MassSpringParameters::default()
    }
}

fn mass_spring(parameters: MassSpringParameters) -> Result<MassSpring, Error> {
    Ok(MassSpring::new(parameters, Box::new(HalfSpace), block::rigid()?)?)
}

/// Returns the cylinder of the mass-spring model as placed when the needle reaches the skin, without the cap before it.
fn cylinder(parameters: MassSpringParameters) -> Result<TetMesh, Error> {
    let capped = capped(parameters)?;
    let count = parameters.nodes();
    let elements = capped.elements().iter().copied();
    let elements: Vec<[u32; 4]> = elements
        .filter(|corners| corners.iter().all(|node| (*node as usize) < count))
        .collect();
    let regions = vec![0; elements.len()];
    Ok(TetMesh::new(capped.nodes()[..count].to_vec(), elements, regions)?)
}

/// Returns the cylinder with its cap, as it is imaged.
fn capped(parameters: MassSpringParameters) -> Result<TetMesh, Error> {
    let mut model = mass_spring(parameters)?;
    model.step(&block::tip_at([0.0; 3]), super::STEP_S)?;
    let (mut snapshot, mut tissue) = (Snapshot::default(), Tissue::default());
    model.snapshot(&mut snapshot);
    let mut imager = model.imager();
    imager.tissue(&snapshot, &mut tissue);
    let elements = imager.elements().to_vec();
    let regions = vec![0; elements.len()];
    Ok(TetMesh::new(tissue.reference, elements, regions)?)
}

fn named(model: &'static str, poisson: impl ToString, parameters: &MassSpringParameters) -> Named {
    let spacing = parameters.length_mm() / parameters.layers() as f64;
    Named {
        model,
        poisson: poisson.to_string(),
        spacing_mm: format!("{spacing:.1}"),
    }
}

fn springs(grid: [usize; 2]) -> Result<Contender, Error> {
    let parameters = parameters(grid);
    let named = named(SPRINGS, "no ratio to choose", &parameters);
    let model = Box::new(mass_spring(parameters)?);
    Ok(Contender::new(named, &capped(parameters)?, model))
}

fn finite(grid: [usize; 2], poisson: f64) -> Result<Contender, Error> {
    let parameters = parameters(grid);
    let mesh = cylinder(parameters)?;
    // Supported like the mass-spring cylinder: at its side and its far end.
    let [radius, length] = [parameters.radius_mm, parameters.length_mm()].map(|length| length * (1.0 - 1e-9));
    let nodes = (0..).zip(mesh.nodes());
    let fixed_nodes = nodes.filter(|(_, p)| p[0].hypot(p[1]) >= radius || p[2] >= length);
    let setup = Setup {
        materials: vec![Material::new(parameters.young_kpa, poisson)?; mesh.elements().len()],
        fixed: fixed_nodes
            .flat_map(|(node, _)| [0, 1, 2].map(|axis| (node, axis)))
            .collect(),
        interactions: vec![(0, block::USUAL)],
        anatomy: None,
        needle: block::rigid()?,
        probe: None,
        level: Level::Exact,
        precision: Precision::Double,
        options: FiniteOptions::default(),
        mesh: mesh.clone(),
    };
    let mut finite = Finite::new(setup, |_, _| {})?;
    finite.prefetch(&Point3::origin(), &Vector3::z(), parameters.length_mm(), 0.0);
    let named = named(FINITE, poisson, &parameters);
    Ok(Contender::new(named, &mesh, Box::new(finite)))
}

impl Contender {
    fn new(named: Named, mesh: &TetMesh, model: Box<dyn Model>) -> Contender {
        Contender {
            named,
            imager: model.imager(),
            locator: Locator::new(mesh),
            model,
        }
    }

    /// Inserts and withdraws the needle.
    fn insert(&mut self, depth_mm: f64, insertion: &mut Insertion) -> Result<(), Error> {
        let steps_in = (depth_mm / ADVANCE_MM).round() as usize;
        let is_first = insertion.steps.is_empty();
        for step in 0..=2 * steps_in {
            let depth = depth_mm * (steps_in - step.abs_diff(steps_in)) as f64 / steps_in as f64;
            let timed_step = timed(&mut *self.model, &block::tip_at([0.0, 0.0, depth]))?;
            if !is_first {
                insertion.steps[step].ms = insertion.steps[step].ms.min(timed_step.ms);
                continue;
            }
            insertion.steps.push(timed_step);
            for (step_kept, field) in [steps_in, steps_in + steps_in / 2]
                .into_iter()
                .zip(&mut insertion.fields)
            {
                if step == step_kept {
                    *field = self.field(depth_mm)?;
                }
            }
        }
        self.model.step(&block::tip_at([0.0, 0.0, -1.0]), 1.0)?;
        Ok(())
    }

    /// Returns the current displacements of the tissue around the needle, mm.
    fn field(&mut self, depth_mm: f64) -> Result<Vec<Vector3<f64>>, Error> {
        let (mut snapshot, mut tissue) = (Snapshot::default(), Tissue::default());
        self.model.snapshot(&mut snapshot);
        self.imager.tissue(&snapshot, &mut tissue);
        self.locator.update(&tissue.reference)?;
        let elements = self.imager.elements();
        let displacement = |point: [f64; 3]| {
            let hit = self.locator.locate(point, NO_ELEMENT);
            let corners = elements.get(hit.element as usize).into_iter().flatten();
            let pairs = corners.zip(hit.bary).map(|(node, share)| {
                let [current, reference] =
                    [&tissue.current, &tissue.reference].map(|nodes| Vector3::from(nodes[*node as usize]));
                (current - reference) * share
            });
            pairs.sum()
        };
        Ok(points_compared(depth_mm).map(displacement).collect())
    }
}

/// Returns the points at which tissue is compared.
fn points_compared(depth_mm: f64) -> impl Iterator<Item = [f64; 3]> {
    let (radii, around) = AROUND;
    let layers = (depth_mm / ALONG_MM) as usize;
    (0..layers).flat_map(move |layer| {
        let z = (layer as f64 + 0.5) * ALONG_MM;
        radii.into_iter().flat_map(move |radius| {
            (0..around).map(move |n| {
                let (sine, cosine) = (std::f64::consts::TAU * (n as f64 + 0.3) / around as f64).sin_cos();
                [radius * cosine, radius * sine, z]
            })
        })
    })
}

fn differences(gold: &Insertion, compared: &Insertion) -> Differences {
    let pairs = |field: usize| gold.fields[field].iter().zip(&compared.fields[field]);
    let percent = |field: usize| {
        let difference = mean_square(pairs(field).map(|(a, b)| (a - b).norm()));
        100.0 * difference / mean_square(pairs(field).map(|(a, _)| a.norm()))
    };
    let force = || {
        let steps = gold.steps.iter().zip(&compared.steps);
        steps.map(|(a, b)| (a.force_n - b.force_n).norm())
    };
    Differences {
        tissue_percent: percent(0),
        tissue_mm: largest(pairs(0).map(|(a, b)| (a - b).norm())),
        back_percent: percent(1),
        force_rms_n: mean_square(force()),
        force_n: largest(force()),
    }
}
