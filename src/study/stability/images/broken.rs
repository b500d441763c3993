//! Cases of invalid meshes that the mechanics should never produce.

use super::super::record::{Record, Unexpected};
use crate::stability::fixtures::{everywhere, gpus, name, settings, straight};
use insonify_base::real::Real;
use insonify_imaging::anatomies::{self, Acoustics, Frame, PLAIN, SILENT};
use insonify_imaging::effects::{Effects, slice::Boundary};
use insonify_imaging::synth::FrameState;
use insonify_imaging::synth::layers::Beam;
use insonify_imaging::synth::tables::Anatomy;
use insonify_mesh::locator::{Locator, LocatorReport};
use insonify_mesh::{NO_ELEMENT, TetMesh};
use insonify_tracking::probe::{Linear, ProbeShape};

/// Mesh with a defective state.
struct Broken {
    what: &'static str,
    nodes: Vec<[f64; 3]>,
    /// Defects that a locator update must report, in elements.
    report: LocatorReport,
}

fn anatomy(seed: u64) -> Result<Anatomy, Unexpected> {
    let tissue = |echo_db| Acoustics { echo_db, ..PLAIN };
    let mut anatomy = anatomies::random(
        Frame::around([0.0, 20.0, 0.0], [48; 3], 1.0),
        &[SILENT, tissue(0.0), tissue(6.0), tissue(-6.0)],
        seed as u32,
    );
    // Two separate blocks, 1 mm apart.
    let blocks = [
        [[-14.0, 6.0, -8.0], [-0.5, 34.0, 8.0]],
        [[0.5, 6.0, -8.0], [14.0, 34.0, 8.0]],
    ];
    let (mut nodes, mut elements): (Vec<[f64; 3]>, Vec<[u32; 4]>) = (Vec::new(), Vec::new());
    for [low, high] in blocks {
        let block = TetMesh::over_box(low, high, 150)?;
        let first_node = nodes.len() as u32;
        nodes.extend_from_slice(block.nodes());
        elements.extend(
            block
                .elements()
                .iter()
                .map(|corners| corners.map(|corner| corner + first_node)),
        );
    }
    let regions = vec![0; elements.len()];
    anatomy.mesh = Some(std::sync::Arc::new(TetMesh::new(nodes, elements, regions)?));
    Ok(anatomy)
}

/// Returns the node nearest to a point.
fn nearest(mesh: &TetMesh, p: [f64; 3]) -> usize {
    let square = |node: &[f64; 3]| (0..3).map(|axis| (node[axis] - p[axis]).powi(2)).sum::<f64>();
    let nodes = mesh.nodes().iter().enumerate();
    nodes
        .min_by(|a, b| square(a.1).total_cmp(&square(b.1)))
        .map_or(0, |(node, _)| node)
}

/// Returns the defective states: a node pushed through its neighbours, a node moved into the opposite face, one block
/// inside the other, nodes that are not finite.
fn states(mesh: &TetMesh) -> Vec<Broken> {
    let inner_node = nearest(mesh, [-7.0, 20.0, 0.0]);
    let broken_by = |what, change: &dyn Fn(&mut Vec<[f64; 3]>)| {
        let mut nodes = mesh.nodes().to_vec();
        change(&mut nodes);
        let mut report = LocatorReport::default();
        // Counted from volumes alone, so that the locator is not held against its own way of counting.
        for (corners, volume) in mesh.elements().iter().zip(mesh.volumes(&nodes)) {
            let finite = corners
                .iter()
                .all(|&corner| nodes[corner as usize].iter().all(|x| x.is_finite()));
            report.not_finite += usize::from(!finite);
            report.inverted += usize::from(finite && volume < -1e-9);
            report.flat += usize::from(finite && volume.abs() <= 1e-9);
        }
        Broken { what, nodes, report }
    };
    let flattened = |nodes: &mut Vec<[f64; 3]>| {
        let corners = mesh
            .elements()
            .iter()
            .find(|corners| corners.contains(&(inner_node as u32)));
        let Some(corners) = corners else { return };
        let others: Vec<[f64; 3]> = corners
            .iter()
            .filter(|&&corner| corner as usize != inner_node)
            .map(|&corner| mesh.nodes()[corner as usize])
            .collect();
        nodes[inner_node] = std::array::from_fn(|axis| others.iter().map(|node| node[axis]).sum::<f64>() / 3.0);
    };
    let half = mesh.nodes().len() / 2;
    vec![
        broken_by("inverted", &|nodes| nodes[inner_node][1] += 12.0),
        broken_by("flat", &flattened),
        broken_by("overlapping", &|nodes| {
            nodes[half..].iter_mut().for_each(|node| node[0] -= 4.0)
        }),
        broken_by("no numbers", &|nodes| {
            nodes[inner_node] = [f64::NAN; 3];
            nodes[nearest(mesh, [7.0, 20.0, 0.0])][2] = f64::INFINITY;
        }),
    ]
}

/// Returns a predicate for samples unaffected in either state: outside every box around an element with a moved node.
fn untouched(mesh: &TetMesh, broken: &Broken) -> impl Fn([f64; 4]) -> bool {
    let is_moved: Vec<bool> = mesh.nodes().iter().zip(&broken.nodes).map(|(a, b)| a != b).collect();
    let mut boxes = Vec::new();
    for corners in mesh
        .elements()
        .iter()
        .filter(|corners| corners.iter().any(|&corner| is_moved[corner as usize]))
    {
        for nodes in [mesh.nodes(), &broken.nodes] {
            let mut bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
            for &corner in corners {
                for axis in 0..3 {
                    bounds[0][axis] = bounds[0][axis].min(nodes[corner as usize][axis]);
                    bounds[1][axis] = bounds[1][axis].max(nodes[corner as usize][axis]);
                }
            }
            // Elements without a finite position contain nothing.
            if bounds.iter().flatten().all(|x| x.is_finite()) {
                boxes.push(bounds);
            }
        }
    }
    move |p| {
        let inside = |[low, high]: &[[f64; 3]; 2]| {
            (0..3).all(|axis| p[axis] >= low[axis] - 1e-3 && p[axis] <= high[axis] + 1e-3)
        };
        !boxes.iter().any(inside)
    }
}

/// Counts updates in one precision that miscount the defects, also when repeated.
fn miscounted<T: Real>(mesh: &TetMesh, broken: &Broken) -> Result<f64, Unexpected> {
    let mut locator = Locator::<T>::new(mesh);
    let reports = [locator.update(&broken.nodes)?, locator.update(&broken.nodes)?];
    let healed = locator.update(mesh.nodes())?;
    let miscounts = reports.iter().filter(|report| **report != broken.report).count();
    Ok((miscounts + usize::from(healed != LocatorReport::default())) as f64)
}

/// Counts undefined values: invalid positions, flags and elements, and echoes that are not finite.
fn undefined(mesh: &TetMesh, beam: &Beam) -> usize {
    let places = beam
        .position
        .iter()
        .filter(|p| !p.iter().all(|x| x.is_finite()) || ![0.0, 1.0, 2.0, 3.0].contains(&p[3]));
    let elements = beam
        .element
        .iter()
        .filter(|&&element| element != NO_ELEMENT && element as usize >= mesh.elements().len());
    let echoes = beam.amplitude.iter().filter(|echo| !echo.is_finite());
    places.count() + elements.count() + echoes.count()
}

pub(super) fn meshes(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let gpus = gpus(record);
    let anatomy = anatomy(record.seed())?;
    let Some(mesh) = anatomy.mesh.clone() else {
        return Err(Unexpected::new("an anatomy without a mesh"));
    };
    let mut effects = Effects::usual();
    effects.texture = None;
    effects.slice.boundary = Boundary::Nearest;
    let settings = settings(ProbeShape::Linear(Linear { width_mm: 32.0 }), 40.0, [48, 160], effects);
    let states = states(&mesh);
    let state_of = |nodes: &[[f64; 3]]| FrameState {
        nodes: Some(nodes.to_vec()),
        ..straight()
    };
    for (state_index, broken) in states.iter().enumerate() {
        let miscounts = miscounted::<f64>(&mesh, broken)? + miscounted::<f32>(&mesh, broken)?;
        record.zero(
            format!("{}: updates that miscount what is wrong", broken.what),
            miscounts,
        );
        let is_untouched = untouched(&mesh, broken);
        for mut synth in everywhere(&anatomy, &settings, &gpus)? {
            let case = format!("{}, {}", broken.what, name(&synth));
            let world = synth.render_until("contact", &straight())?;
            let intact = synth.render_until("slice", &state_of(mesh.nodes()))?;
            let picture = synth.render(&state_of(mesh.nodes()))?.pixels.clone();
            let beam = synth.render_until("slice", &state_of(&broken.nodes))?;
            let received = synth.render_until("receiver", &state_of(&broken.nodes))?;
            record.zero(
                format!("{case}: undefined values"),
                (undefined(&mesh, &beam) + undefined(&mesh, &received)) as f64,
            );
            let (mut changed, mut compared) = (0usize, 0usize);
            for index in 0..beam.position.len() {
                if is_untouched(world.position[index]) {
                    compared += 1;
                    let is_same =
                        beam.position[index] == intact.position[index] && beam.label[index] == intact.label[index];
                    changed += usize::from(!is_same);
                }
            }
            record.zero(format!("{case}: samples of the rest that changed"), changed as f64);
            // At least a quarter of the samples must belong to the rest: of
            // fewer, being unchanged would say little.
            record.under(
                format!("{case}: samples over those of the rest"),
                beam.position.len() as f64 / compared.max(1) as f64,
                4.0,
            );
            // The sound mesh again, on the same synthesizer: no buffer may keep anything of the broken state.
            let repaired = synth.render(&state_of(mesh.nodes()))?;
            let wrong_pixels = repaired.pixels.iter().zip(&picture).filter(|(a, b)| a != b).count();
            record.zero(
                format!("{case}: pixels that stay wrong afterwards"),
                wrong_pixels as f64,
            );
        }
        record.done((state_index + 1) as f64 / states.len() as f64);
    }
    Ok(())
}
