//! A needle goes 82 mm into a block of about 3,300 nodes at 10 mm/s, a step each millisecond: what steps cost, and above all those
//! that remesh. With and without a probe of 22 candidates that presses meanwhile; a rigid needle and one of springs.
//!
//! Single steps count at haptic rate, so this prints their distribution rather than means.

use std::time::Instant;

use insonify::mechanics::insertion::finite::{Finite, Options, Setup};
use insonify::mechanics::insertion::{Instruments, Interaction, Model, ProbeContact};
use insonify::mechanics::mesh::TetMesh;
use insonify::mechanics::needle::{Bevel, Flexible, Needle, Rigid, Shaft, Stiffness};
use insonify::mechanics::tissue::material::Material;
use insonify::mechanics::tissue::remesh::{Level, Precision};
use nalgebra::{Isometry3, Matrix4, Point3, Translation3, UnitQuaternion, Vector3};

/// Extent of the block, mm; the needle goes along z from z = 0, the floor at the far end is fixed.
const EXTENT: [f64; 3] = [60.0, 60.0, 90.0];
/// Cells of the lattice: 13 x 13 x 20 nodes.
const CELLS: [usize; 3] = [12, 12, 19];
/// Candidates of the probe.
const CANDIDATES: usize = 22;
/// The hole of a template before the skin, mm.
const GUIDE: Option<Point3<f64>> = Some(Point3::new(31.3, 28.9, -5.0));
/// How far the tip goes, mm.
const DEPTH: f64 = 82.0;
/// How far it goes in a step, mm.
const ADVANCE: f64 = 0.01;

fn mesh() -> TetMesh {
    let to_world = Matrix4::new_nonuniform_scaling(&Vector3::from(EXTENT));
    TetMesh::lattice(CELLS, &to_world).expect("a lattice")
}

/// A probe along z under the block, beside the needle's path.
fn probe(mesh: &TetMesh) -> ProbeContact {
    let nominal = Isometry3::from_parts(Translation3::new(30.0, -10.0, 80.0), UnitQuaternion::identity());
    let distance = |node: u32| {
        let p = Point3::from(mesh.nodes()[node as usize]);
        (p.x - 30.0).abs()
            + if p.y == 0.0 && (10.0..75.0).contains(&p.z) {
                0.0
            } else {
                1e9
            }
            + 1e-6 * p.z
    };
    let mut nodes: Vec<u32> = (0..mesh.nodes().len() as u32).collect();
    nodes.sort_by(|a, b| distance(*a).total_cmp(&distance(*b)));
    ProbeContact {
        nominal,
        length_mm: 100.0,
        candidates: nodes[..CANDIDATES].to_vec(),
        driven_at_mm: None,
    }
}

fn finite(needle: Box<dyn Needle>, with_probe: bool) -> Finite {
    let mesh = mesh();
    let floor = (0..mesh.nodes().len() as u32).filter(|node| mesh.nodes()[*node as usize][2] == EXTENT[2]);
    let interaction = Interaction {
        friction_n_per_mm: 0.02,
        cutting_n: 0.5,
        ..Interaction::default()
    };
    let setup = Setup {
        materials: vec![Material::new(20.0, 0.45).expect("a material"); mesh.elements().len()],
        fixed: floor.flat_map(|node| [0, 1, 2].map(|axis| (node, axis))).collect(),
        interactions: vec![(mesh.regions()[0], interaction)],
        anatomy: None,
        needle,
        probe: with_probe.then(|| probe(&mesh)),
        level: Level::Exact,
        precision: Precision::Double,
        options: Options::default(),
        mesh,
    };
    let mut finite = Finite::new(setup, |_, _| {}).expect("a setup");
    finite.prefetch(&Point3::new(31.3, 28.9, 0.0), &Vector3::z(), EXTENT[2], 5.0);
    finite
}

/// A share of sorted values.
fn quantile(sorted: &[f64], share: f64) -> f64 {
    sorted[((sorted.len() - 1) as f64 * share).round() as usize]
}

fn run(name: &str, needle: Box<dyn Needle>, with_probe: bool) {
    let length = needle.length_mm();
    let mut finite = finite(needle, with_probe);
    let (mut all, mut remeshing) = (Vec::new(), Vec::new());
    let mut iterations = 0;
    let mut converged = true;
    let steps = ((DEPTH + 1.0) / ADVANCE) as usize;
    for step in 0..steps {
        let z = step as f64 * ADVANCE - 1.0;
        let aside = (step as f64 * 2e-3).min(3.0);
        let instruments = Instruments {
            base: Isometry3::from_parts(Translation3::new(31.3, 28.9, z - length), UnitQuaternion::identity()),
            probe: with_probe.then(|| {
                Isometry3::from_parts(Translation3::new(30.0, aside - 10.0, 80.0), UnitQuaternion::identity())
            }),
            guide: GUIDE,
            deposit: false,
        };
        let start = Instant::now();
        let outcome = finite.step(&instruments, 1e-3).expect("a step");
        let ms = start.elapsed().as_secs_f64() * 1e3;
        iterations += outcome.iterations;
        converged &= outcome.converged;
        if outcome.remeshes > 0 {
            remeshing.push(ms)
        } else {
            all.push(ms)
        }
    }
    let (held, contacts) = (finite.held(), finite.outcome().contacts);
    let bent = finite.outcome().tip_deflection_mm;
    let remeshes = remeshing.len();
    let worst = remeshing.iter().copied().fold(0.0, f64::max);
    remeshing.sort_by(f64::total_cmp);
    let middle = quantile(&remeshing, 0.5);
    all.extend(remeshing);
    all.sort_by(f64::total_cmp);
    let [median, p95, p99, most] = [0.5, 0.95, 0.99, 1.0].map(|share| quantile(&all, share));
    println!(
        "{name:<24} median {median:.3} p95 {p95:.3} p99 {p99:.3} max {most:.3} ms; {remeshes} remeshes median {middle:.3} max \
         {worst:.3} ms; {contacts} contacts, |S| {held}, {:.2} iterations a step, converged {converged}, bent {bent:.2} mm",
        iterations as f64 / steps as f64
    );
}

fn main() {
    let rigid = || Box::new(Rigid::new(Shaft::default(), None).expect("a needle"));
    let bevel = Bevel {
        r_mm: 0.6,
        length_mm: 10.0,
    };
    let springs =
        || Box::new(Flexible::springs(Shaft::default(), Stiffness::default(), 10.0, Some(bevel)).expect("a needle"));
    run("rigid", rigid(), false);
    run("rigid, probe", rigid(), true);
    run("springs, bevel", springs(), false);
    run("springs, bevel, probe", springs(), true);
}
