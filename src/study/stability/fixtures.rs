//! Fixtures of the hard cases: tissue blocks, needles, anatomies, synthesisers, and run monitors.

use std::sync::Arc;

use nalgebra::{Matrix4, Point3, Vector3};

use super::record::{Record, Unexpected, largest, noise};
use insonify_gpu::{AdapterChoice, Gpu, Needs, adapter};
use insonify_imaging::effects::Effects;
use insonify_imaging::parity::{Case, Comparison};
use insonify_imaging::synth::tables::{self, Settings};
use insonify_imaging::synth::{Backend, FrameState, SynthError, Synthesizer};
use insonify_mechanics::block;
use insonify_mechanics::insertion::finite::{Finite, Setup};
use insonify_mechanics::insertion::spring::{MassSpring, MassSpringParameters};
use insonify_mechanics::insertion::{Anatomy, EventKind, Interaction, Model, Outcome, Snapshot, Tissue};
use insonify_mechanics::tissue::assembly::Stiffness;
use insonify_mechanics::tissue::dofs::{Dofs, NO_DOF};
use insonify_mechanics::tissue::error::LinearError;
use insonify_mechanics::tissue::factor::Factor;
use insonify_mechanics::tissue::inverse::invert;
use insonify_mechanics::tissue::material::{Material, Materials};
use insonify_mechanics::tissue::problem::{Fix, Load, Solution, StaticProblem};
use insonify_mechanics::tissue::remesh::{
    Adaptation, AdaptedMesh, Level, Precision, RemeshError, RemeshReport, RemesherOptions, Source,
};
use insonify_mechanics::tissue::symmetric::Symmetric;
use insonify_mesh::{self, TetMesh};
use insonify_tracking::probe::{Probe, ProbeShape};

/// Extent of the tissue block, mm.
pub const EXTENT: [f64; 3] = [60.0, 60.0, 80.0];
/// Edge length of the block's cells, mm.
pub(crate) const CELL_MM: f64 = 10.0;
/// Entry point of the needle, mm: off all planes between cells.
pub const ASIDE: [f64; 2] = [31.3, 28.9];
/// Simulated time of a step where it does not matter, s.
pub(crate) const STEP_S: f64 = 1e-3;

/// Returns a setup with a block of 60 x 60 x 80 mm at 10 kPa and a rigid needle.
pub fn tissue(interaction: Interaction) -> Result<Setup, Unexpected> {
    let mesh = block::plain(EXTENT, CELL_MM)?;
    Ok(block::on_table(
        mesh,
        Material::new(10.0, 0.45)?,
        interaction,
        block::rigid()?,
    ))
}

/// Creates the finite-element model of a setup.
pub fn build(setup: Setup) -> Result<Finite, Unexpected> {
    Ok(Finite::new(setup, |_, _| {})?)
}

/// Region 0 from z = 0 on and region 1 from `border` on.
#[derive(Debug)]
pub struct Layers {
    /// Coordinate z at which region 1 begins, mm.
    pub border: f64,
    /// Interaction in region 0, then in region 1.
    pub interactions: [Interaction; 2],
}

impl Anatomy for Layers {
    fn region(&self, point_mm: &Point3<f64>) -> Option<i32> {
        (point_mm.z >= 0.0).then_some(i32::from(point_mm.z >= self.border))
    }

    fn interaction(&self, region: i32) -> Interaction {
        self.interactions[usize::from(region == 1)]
    }
}

/// Returns parameters for a cylinder of 20 mm about a path of 100 mm, with nodes every 6.7 mm and a rigid needle.
pub fn coarse() -> MassSpringParameters {
    MassSpringParameters {
        radius_mm: 20.0,
        rings: 3,
        layers: Some(15),
        ..MassSpringParameters::default()
    }
}

/// Creates the mass-spring model of a uniform tissue.
pub fn springs(parameters: MassSpringParameters, interaction: Interaction) -> Result<MassSpring, Unexpected> {
    let layers = Layers {
        border: f64::INFINITY,
        interactions: [interaction; 2],
    };
    Ok(MassSpring::new(parameters, Box::new(layers), block::rigid()?)?)
}

/// Steps a rigid needle to a depth.
pub fn go(model: &mut dyn Model, z: f64) -> Result<&Outcome, Unexpected> {
    Ok(model.step(&block::tip_at([ASIDE[0], ASIDE[1], z]), STEP_S)?)
}

/// Steps the needle from one depth to another, ending exactly there.
pub fn travel(
    model: &mut dyn Model,
    [from, to]: [f64; 2],
    step_mm: f64,
    mut tell: impl FnMut(&Outcome),
) -> Result<(), Unexpected> {
    let steps = ((to - from).abs() / step_mm).ceil() as usize;
    for step in 1..=steps {
        tell(go(model, from + (to - from) * step as f64 / steps as f64)?);
    }
    Ok(())
}

/// Returns the force that pushes the needle back out, N.
pub fn resistance(outcome: &Outcome) -> f64 {
    -outcome.on_hand.force_n.z
}

/// Counts of steps with errors in a run.
#[derive(Clone, Copy, Debug, Default)]
pub struct Watch {
    /// Number of steps with a value that is not finite.
    pub broken: usize,
    /// Number of steps that did not converge.
    pub unsettled: usize,
    /// Number of steps that did not converge without reporting an event.
    pub unreported: usize,
}

impl Watch {
    /// Checks a step.
    pub fn see(&mut self, outcome: &Outcome) {
        let wrenches = std::iter::once(&outcome.on_hand).chain(&outcome.on_probe);
        let numbers = wrenches.flat_map(|wrench| wrench.force_n.iter().chain(wrench.torque_nmm.iter()));
        let lengths = [outcome.tip_deflection_mm, outcome.inserted_mm];
        let finite = numbers
            .chain(outcome.tip_mm.iter())
            .chain(&lengths)
            .all(|x| x.is_finite());
        let reported = outcome.events.iter().any(|event| event.kind == EventKind::NotConverged);
        self.broken += usize::from(!finite);
        self.unsettled += usize::from(!outcome.converged);
        self.unreported += usize::from(!outcome.converged && !reported);
    }

    /// Records the counts.
    pub fn write(&self, record: &mut Record<'_>, subject: &str) {
        record.zero(format!("steps with non-finite values, {subject}"), self.broken as f64);
        record.zero(
            format!("steps not converged and not reported, {subject}"),
            self.unreported as f64,
        );
        record.report(format!("steps not converged, {subject}"), self.unsettled as f64);
    }
}

/// Returns the tissue as used for image synthesis.
pub fn image(model: &mut dyn Model) -> Tissue {
    let (mut snapshot, mut tissue) = (Snapshot::default(), Tissue::default());
    model.snapshot(&mut snapshot);
    model.imager().tissue(&snapshot, &mut tissue);
    tissue
}

/// Returns the largest displacement, mm; NaN if any is NaN.
pub fn displaced(tissue: &Tissue) -> f64 {
    let pairs = tissue.current.iter().zip(&tissue.reference);
    largest(pairs.map(|(to, from)| (Vector3::from(*to) - Vector3::from(*from)).norm()))
}

/// Edge length of the lattice cells, mm.
const CELL: f64 = 5.0;

/// Relative error of K^-1 allowed in f64 at Poisson's ratio 0.45.
const PROMISED: f64 = 1e-11;

/// Remesher backends. A backend added here runs in every case of levels.
pub(crate) const BACKENDS: &[Inverses] = &[
    Inverses {
        name: "cpu f64",
        precision: Precision::Double,
        follow: |start, level, options| {
            let source = Source::Double(Arc::clone(&start.double));
            Adaptation::new(start.mesh.clone(), source, level, Precision::Double, options)
        },
    },
    Inverses {
        name: "cpu f32",
        precision: Precision::Single,
        follow: |start, level, options| {
            let source = Source::Single(Arc::clone(&start.single));
            Adaptation::new(start.mesh.clone(), source, level, Precision::Single, options)
        },
    },
];

/// Remesher backend in one precision.
pub struct Inverses {
    /// Name in reports, such as `cpu f64`.
    pub name: &'static str,
    /// Precision of the inverse.
    pub precision: Precision,
    follow: fn(&Start, Level, RemesherOptions) -> Result<Adaptation, RemeshError>,
}

impl Inverses {
    /// Creates a remesher for a mesh at its base, with its contacts set.
    pub fn follow(&self, start: &Start, level: Level, options: RemesherOptions) -> Result<Adaptation, RemeshError> {
        let mut adaptation = (self.follow)(start, level, options)?;
        adaptation.parts().1.set_contacts(&start.contacts)?;
        Ok(adaptation)
    }

    /// Returns the rounding unit of its entries relative to f64.
    fn coarseness(&self) -> f64 {
        match self.precision {
            Precision::Single => f64::from(f32::EPSILON) / f64::EPSILON,
            Precision::Double => 1.0,
        }
    }
}

/// Randomly perturbed block of 6 x 5 x 5 nodes on a fixed floor, with its inverse stiffness.
pub struct Start {
    /// Mesh before any move.
    pub mesh: AdaptedMesh,
    /// Inverse of its stiffness in f64, mm/N.
    pub double: Arc<Symmetric<f64>>,
    /// The same inverse, rounded to f32.
    pub single: Arc<Symmetric<f32>>,
    /// Nodes without prescribed displacements.
    pub free: Vec<u32>,
    /// Degrees of freedom of ten of the free nodes.
    pub contacts: Vec<usize>,
    /// Condition number of the stiffness at Poisson's ratio 0.45.
    usual_condition: f64,
    seed: u64,
}

impl Start {
    /// Creates a block of 10 kPa at a Poisson's ratio, its nodes shifted at random by a seed.
    pub fn new(seed: u64, poisson: f64) -> Result<Start, Unexpected> {
        let cells = [5, 4, 4];
        let mesh = shaken(cells, cells.map(|n| n as f64 * CELL), 0.12, seed)?;
        let problem = |poisson: f64| -> Result<Problem, Unexpected> {
            let mut problem = Problem::new(mesh.clone(), Material::new(10.0, poisson)?);
            problem.fix(&[0, 1, 2], |p| p[2] == 0.0, |_| [0.0; 3]);
            Ok(problem)
        };
        let (reference, of_poisson) = (problem(0.45)?, problem(poisson)?);
        let mesh = AdaptedMesh::new(&mesh, &of_poisson.materials.check(&mesh)?, &of_poisson.dofs())?;
        let double: Symmetric<f64> = invert(&Factor::new(mesh.stiffness())?, &mut |_, _| {})?;
        let free: Vec<u32> = (0..mesh.nodes().len() as u32)
            .filter(|node| !mesh.dofs().of(*node).contains(&NO_DOF))
            .collect();
        let contact_nodes = free.iter().step_by(free.len() / 10).take(10);
        let contacts = contact_nodes
            .flat_map(|node| mesh.dofs().of(*node))
            .map(|dof| dof as usize)
            .collect();
        Ok(Start {
            single: Arc::new(double.cast()),
            double: Arc::new(double),
            free,
            contacts,
            usual_condition: reference.condition()?,
            mesh,
            seed,
        })
    }

    /// Returns the allowed error of K^-1 for the current mesh: `PROMISED` at the usual condition number, growing in
    /// proportion to it.
    pub fn allowed(&self, state: &Now, backend: &Inverses) -> f64 {
        PROMISED * (state.condition / self.usual_condition).max(1.0) * backend.coarseness()
    }

    /// Returns the `n`th move of a sequence: a node of `nodes` and its target, up to a quarter of a cell from its base
    /// along each axis.
    pub fn nth_move(&self, nodes: &[u32], n: u64) -> (u32, [f64; 3]) {
        let drawn = |index: u64| noise(self.seed, 8 * n + index);
        let position = (0.5 * (drawn(3) + 1.0) * nodes.len() as f64) as usize;
        let node = nodes[position.min(nodes.len() - 1)];
        let base = self.mesh.base()[node as usize];
        (
            node,
            std::array::from_fn(|axis| base[axis] + 0.25 * CELL * drawn(axis as u64)),
        )
    }

    /// Makes the moves `span` of the sequence, skipping those that would spoil an element.
    pub fn go(
        &self,
        adaptation: &mut Adaptation,
        nodes: &[u32],
        span: std::ops::Range<u64>,
        mut after: impl FnMut(&mut Adaptation, RemeshReport) -> Result<(), Unexpected>,
    ) -> Result<(), Unexpected> {
        for n in span {
            let (node, position) = self.nth_move(nodes, n);
            if adaptation.mesh().assess(node, position).is_ok() {
                let report = adaptation.move_node(node, position)?;
                after(adaptation, report)?;
            }
        }
        Ok(())
    }
}

/// Inverse of the current stiffness, computed from scratch in f64.
pub struct Now {
    /// Inverse of the stiffness, mm/N.
    pub inverse: Symmetric<f64>,
    /// Condition number of the stiffness.
    pub condition: f64,
}

impl Now {
    /// Assembles and inverts the stiffness of a mesh with its nodes in their current positions.
    pub fn of(mesh: &AdaptedMesh) -> Result<Now, Unexpected> {
        let stiffness = mesh.stiffness().at_nodes(mesh.nodes())?;
        let factor = Factor::new(&stiffness)?;
        Ok(Now {
            inverse: invert(&factor, &mut |_, _| {})?,
            condition: condition(&stiffness, &factor),
        })
    }

    /// Returns the largest error of K^c relative to its largest entry.
    pub(crate) fn error_of_contacts(&self, adaptation: &Adaptation) -> f64 {
        let contacts = adaptation.remesher().contacts();
        let condensed = adaptation.remesher().condensed();
        let pairs = (0..contacts.len()).flat_map(|i| (0..contacts.len()).map(move |j| (i, j)));
        let gold = |(i, j): (usize, usize)| self.inverse.get(contacts[i], contacts[j]);
        let difference = largest(pairs.clone().map(|index| condensed[index] - gold(index)));
        difference / largest(pairs.map(gold))
    }

    /// Returns the largest error of K^-1 relative to its largest entry.
    pub(crate) fn error_of_all(&self, adaptation: &mut Adaptation) -> Result<f64, Unexpected> {
        let dofs: Vec<usize> = (0..self.inverse.size()).collect();
        let compliance = adaptation.parts().1.compliance(&dofs, &dofs)?;
        let pairs = dofs.iter().flat_map(|i| dofs.iter().map(move |j| (*i, *j)));
        let difference = largest(pairs.clone().map(|(i, j)| compliance[(i, j)] - self.inverse.get(i, j)));
        Ok(difference / largest(pairs.map(|(i, j)| self.inverse.get(i, j))))
    }
}

/// Returns the state that a refused move must leave unchanged, bit for bit.
pub fn state(adaptation: &Adaptation) -> (Vec<u64>, u64, Vec<u64>) {
    let mesh = adaptation.mesh();
    let nodes = mesh.nodes().as_flattened().iter().map(|x| x.to_bits());
    (nodes.collect(), mesh.step(), bits(adaptation))
}

/// Returns the bits of K^c.
pub fn bits(adaptation: &Adaptation) -> Vec<u64> {
    let condensed = adaptation.remesher().condensed();
    let entries = condensed
        .col_iter()
        .flat_map(|column| column.iter().map(|x| x.to_bits()).collect::<Vec<_>>());
    entries.collect()
}

/// Creates a lattice of cells over the box from the origin to `extent`, mm.
pub fn lattice(cells: [usize; 3], extent: [f64; 3]) -> Result<TetMesh, Unexpected> {
    let [x, y, z] = extent;
    let to_world = Matrix4::from_diagonal(&[x, y, z, 1.0].into());
    Ok(TetMesh::lattice(cells, &to_world)?)
}

/// Creates a lattice whose inner nodes are randomly moved by up to `share` of a cell along each axis; up to 0.15 no
/// element is inverted.
pub fn shaken(cells: [usize; 3], extent: [f64; 3], share: f64, seed: u64) -> Result<TetMesh, Unexpected> {
    let regular = lattice(cells, extent)?;
    let on_surface = surface(&regular);
    moved(&regular, |node, position| {
        let step = |axis: usize| share * extent[axis] / cells[axis] as f64 * noise(seed, (3 * node + axis) as u64);
        std::array::from_fn(|axis| position[axis] + if on_surface[node] { 0.0 } else { step(axis) })
    })
}

/// Returns the mesh with its nodes moved.
pub fn moved(mesh: &TetMesh, position_of: impl Fn(usize, &[f64; 3]) -> [f64; 3]) -> Result<TetMesh, Unexpected> {
    let nodes = mesh
        .nodes()
        .iter()
        .enumerate()
        .map(|(node, position)| position_of(node, position));
    Ok(TetMesh::new(
        nodes.collect(),
        mesh.elements().to_vec(),
        mesh.regions().to_vec(),
    )?)
}

/// Returns the mesh with the region of each element chosen by its number and centroid.
pub fn with_regions(mesh: &TetMesh, region: impl Fn(usize, [f64; 3]) -> i32) -> Result<TetMesh, Unexpected> {
    let middle = |corners: &[u32; 4]| {
        std::array::from_fn(|axis| {
            corners
                .iter()
                .map(|node| mesh.nodes()[*node as usize][axis])
                .sum::<f64>()
                / 4.0
        })
    };
    let regions = mesh.elements().iter().enumerate();
    let regions = regions.map(|(element, corners)| region(element, middle(corners)));
    Ok(TetMesh::new(
        mesh.nodes().to_vec(),
        mesh.elements().to_vec(),
        regions.collect(),
    )?)
}

/// Creates two adjacent blocks that share no node; the second has the nodes from the returned number on.
pub(crate) fn two_parts() -> Result<(TetMesh, u32), Unexpected> {
    let cube = lattice([2, 2, 2], [10.0; 3])?;
    let count = cube.nodes().len() as u32;
    let mut nodes = cube.nodes().to_vec();
    nodes.extend(cube.nodes().iter().map(|[x, y, z]| [x + 12.0, *y, *z]));
    let mut elements = cube.elements().to_vec();
    elements.extend(cube.elements().iter().map(|corners| corners.map(|node| node + count)));
    let regions = [vec![1; cube.elements().len()], vec![2; cube.elements().len()]].concat();
    Ok((TetMesh::new(nodes, elements, regions)?, count))
}

/// Returns whether each node lies on the surface.
pub fn surface(mesh: &TetMesh) -> Vec<bool> {
    let mut is_on_surface = vec![false; mesh.nodes().len()];
    for (corners, neighbours) in mesh.elements().iter().zip(mesh.neighbours()) {
        for opposite in (0..4).filter(|corner| neighbours[*corner] == insonify_mesh::NO_ELEMENT) {
            for corner in (0..4).filter(|corner| *corner != opposite) {
                is_on_surface[corners[corner] as usize] = true;
            }
        }
    }
    is_on_surface
}

/// Static problem that owns its data.
#[derive(Clone)]
pub struct Problem {
    /// Mesh at rest.
    pub mesh: TetMesh,
    /// Material of each region.
    pub materials: Materials,
    /// Prescribed displacements, each of one node along one axis.
    pub fixes: Vec<Fix>,
    /// Forces on nodes.
    pub loads: Vec<Load>,
}

impl Problem {
    /// Creates a problem of one material, unsupported and unloaded.
    pub fn new(mesh: TetMesh, material: Material) -> Problem {
        Problem {
            mesh,
            materials: Materials::uniform(material),
            fixes: Vec::new(),
            loads: Vec::new(),
        }
    }

    /// Creates the default problem: a perturbed block of soft tissue on a fixed floor, loaded at all nodes.
    pub fn block(record: &Record<'_>, poisson: f64) -> Result<Problem, Unexpected> {
        let mesh = shaken([4, 4, 5], [20.0, 20.0, 25.0], 0.15, record.seed())?;
        let mut problem = Problem::new(mesh, Material::new(10.0, poisson)?);
        problem.fix(&[0, 1, 2], |p| p[2] == 0.0, |_| [0.0; 3]);
        problem.load_all(record.seed());
        Ok(problem)
    }

    /// Prescribes displacements along some axes of the nodes selected by position.
    pub fn fix(&mut self, axes: &[u8], chosen: impl Fn(&[f64; 3]) -> bool, field: impl Fn(&[f64; 3]) -> [f64; 3]) {
        for (node, position) in (0..).zip(self.mesh.nodes()).filter(|(_, position)| chosen(position)) {
            let displacement = field(position);
            self.fixes.extend(axes.iter().map(|&axis| Fix {
                node,
                axis,
                displacement_mm: displacement[usize::from(axis)],
            }));
        }
    }

    /// Prescribes a displacement field on the entire surface.
    pub fn fix_surface(&mut self, field: impl Fn(&[f64; 3]) -> [f64; 3]) {
        let on_surface = surface(&self.mesh);
        for (node, position) in (0..)
            .zip(self.mesh.nodes())
            .filter(|(node, _)| on_surface[*node as usize])
        {
            let displacement = field(position);
            self.fixes.extend([0, 1, 2].map(|axis| Fix {
                node,
                axis,
                displacement_mm: displacement[usize::from(axis)],
            }));
        }
    }

    /// Applies a random force of up to 1 mN along each axis to every node.
    pub(crate) fn load_all(&mut self, seed: u64) {
        let load = |node: u32| Load {
            node,
            force_n: [0, 1, 2].map(|axis| 1e-3 * noise(seed, 1_000_000 + 3 * u64::from(node) + axis)),
        };
        self.loads = (0..self.mesh.nodes().len() as u32).map(load).collect();
    }

    /// Solves for displacements and reactions.
    pub fn solve(&self) -> Result<Solution, LinearError> {
        let problem = StaticProblem {
            mesh: &self.mesh,
            materials: self.materials.clone(),
            fixes: self.fixes.clone(),
            loads: self.loads.clone(),
        };
        problem.solve()
    }

    /// Returns the numbering of the degrees of freedom that are not fixed.
    pub fn dofs(&self) -> Dofs {
        let fixed_dofs = self.fixes.iter().map(|fix| (fix.node, fix.axis));
        Dofs::new(self.mesh.nodes().len(), fixed_dofs)
    }

    /// Assembles the stiffness over the degrees of freedom that are not fixed.
    pub fn stiffness(&self) -> Result<Stiffness, Unexpected> {
        let materials = self.materials.check(&self.mesh)?;
        Ok(Stiffness::assemble(&self.mesh, &materials, &self.dofs())?)
    }

    /// Returns the condition number of the stiffness, see [`condition`].
    pub fn condition(&self) -> Result<f64, Unexpected> {
        let stiffness = self.stiffness()?;
        Ok(condition(&stiffness, &Factor::new(&stiffness)?))
    }
}

/// Returns the 2-norm condition number of a stiffness, from power iterations, which approach it from below.
pub fn condition(stiffness: &Stiffness, factor: &Factor) -> f64 {
    let largest = dominant(factor.size(), |x, y| stiffness.multiply(x, y));
    let inverse_of_least = dominant(factor.size(), |x, y| {
        y.copy_from_slice(x);
        factor.solve_in_place(y);
    });
    largest * inverse_of_least
}

/// Returns the largest eigenvalue of a symmetric positive definite operator.
fn dominant(size: usize, apply: impl Fn(&[f64], &mut [f64])) -> f64 {
    let mut x: Vec<f64> = (0..size as u64).map(|i| noise(7, i)).collect();
    let mut y = vec![0.0; size];
    let mut value = 0.0;
    for _ in 0..40 {
        let norm = x.iter().map(|x| x * x).sum::<f64>().sqrt();
        x.iter_mut().for_each(|x| *x /= norm);
        apply(&x, &mut y);
        value = x.iter().zip(&y).map(|(x, y)| x * y).sum();
        std::mem::swap(&mut x, &mut y);
    }
    value
}

/// Opens every adapter of the machine and records how many there are. An adapter that cannot be opened is reported but
/// is no failure, as it renders nothing.
pub fn gpus(record: &mut Record<'_>) -> Vec<Gpu> {
    let mut opened = Vec::new();
    for adapter in adapter::list() {
        let choice = AdapterChoice::named(format!("{} ({})", adapter.name, adapter.backend));
        match Gpu::open(&choice, &Needs::default()) {
            Ok(gpu) => opened.push(gpu),
            Err(error) => record.report(format!("adapter that does not open ({error})"), 1.0),
        }
    }
    let summary = match opened.len() {
        0 => "GPU adapters: none, so this holds of the CPU alone",
        _ => "GPU adapters",
    };
    record.report(summary, opened.len() as f64);
    opened
}

/// Returns the backend name of a synthesizer: `cpu`, `cpu-f64` or the adapter's name.
pub fn name(synth: &Synthesizer) -> String {
    let adapter = synth.gpu().map(|gpu| gpu.report().name.clone());
    adapter.unwrap_or_else(|| synth.backend().to_owned())
}

/// Creates synthesizers of a scene in both precisions of the CPU, the reference first, and on each GPU.
pub fn everywhere(
    anatomy: &tables::Anatomy,
    settings: &Settings,
    gpus: &[Gpu],
) -> Result<Vec<Synthesizer>, SynthError> {
    let on_gpus = gpus.iter().map(|gpu| Backend::Gpu(Box::new(gpu.clone())));
    let backends = [Backend::CpuF64, Backend::Cpu].into_iter().chain(on_gpus);
    backends
        .map(|backend| Synthesizer::new(anatomy.clone(), settings.clone(), backend))
        .collect()
}

/// Returns settings for images of 64 x 48 pixels.
pub fn settings(shape: ProbeShape, depth_mm: f64, [lines, samples]: [u32; 2], effects: Effects) -> Settings {
    let probe = Probe {
        shape,
        depth_mm,
        frequency_mhz: 5.0,
        lines,
        samples,
        aperture: Default::default(),
    };
    let mut settings = Settings::new(probe, [64, 48], effects);
    settings.seed = 0x5eed_0000_0001;
    (settings.image.margin, settings.image.fill) = (0.03, 7);
    settings
}

/// Returns a frame state with the probe at the origin, looking along +y.
pub fn straight() -> FrameState {
    FrameState::at(Matrix4::identity())
}

/// Totals of the comparisons on one backend.
#[derive(Default)]
struct Sum {
    backend: String,
    samples: usize,
    labels_apart: usize,
    share: f64,
    faults: usize,
    first_fault: Option<String>,
}

/// Comparisons totalled by backend.
#[derive(Default)]
pub struct Tally(Vec<Sum>);

impl Tally {
    /// Adds the comparisons of a scene.
    pub fn add(&mut self, case: &Case, comparisons: Vec<Comparison>) {
        for (index, comparison) in comparisons.into_iter().enumerate() {
            if self.0.len() <= index {
                self.0.push(Sum {
                    backend: comparison.backend.clone(),
                    ..Sum::default()
                });
            }
            let sum = &mut self.0[index];
            sum.samples += comparison.samples;
            sum.labels_apart += comparison.labels_apart;
            sum.share = sum.share.max(comparison.share);
            sum.faults += comparison.faults.len();
            if let (None, Some(fault)) = (&sum.first_fault, comparison.faults.first()) {
                sum.first_fault = Some(format!("{}: {fault}", case.name));
            }
        }
    }

    /// Records the totals.
    pub fn note(self, record: &mut Record<'_>) -> Result<(), Unexpected> {
        if self.0.is_empty() {
            return Err(Unexpected::new("nothing was compared"));
        }
        for sum in self.0 {
            let Sum { backend, .. } = &sum;
            record.report(
                format!("{backend}: samples compared after every pass"),
                sum.samples as f64,
            );
            record.report(
                format!("{backend}: labels apart, each within rounding of a face"),
                sum.labels_apart as f64,
            );
            record.under(
                format!("{backend}: largest departure over what rounding allows"),
                sum.share,
                1.0,
            );
            let first_fault = sum
                .first_fault
                .as_ref()
                .map_or(String::new(), |fault| format!(" ({fault})"));
            record.zero(
                format!("{backend}: departures that rounding cannot explain{first_fault}"),
                sum.faults as f64,
            );
        }
        Ok(())
    }
}
