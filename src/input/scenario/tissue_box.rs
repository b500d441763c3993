//! Surface faces of a mesh at which its box cuts through tissue.

use nalgebra::{Point3, Vector3};

use insonify_anatomy::volume::LabelVolume;
use insonify_mesh::{NO_ELEMENT, TetMesh};

/// Step of the outward search, as a fraction of a voxel's shortest edge.
const STEP: f64 = 0.5;

/// Nodes of the faces beyond which tissue continues: outside the box, or beyond the end of the volume. Ascending.
pub(super) fn cut_nodes(
    mesh: &TetMesh,
    [low, high]: &[[f64; 3]; 2],
    volume: &LabelVolume,
    is_tissue: impl Fn(u8) -> bool,
) -> Vec<u32> {
    let step = STEP * volume.spacing_mm().into_iter().fold(f64::INFINITY, f64::min);
    let in_box = |point: &Point3<f64>| (0..3).all(|axis| (low[axis]..=high[axis]).contains(&point[axis]));
    let goes_on = |face: &Face| {
        // Half an edge: the farthest that a coarse mesh may lie from the box.
        let steps = (0.5 * face.edge_mm / step).ceil().max(3.0) as usize;
        let mut looks = (1..=steps).map(|index| face.middle + face.outwards * (index as f64 * step));
        let is_tissue_beyond = looks.find_map(|point| match volume.label_index_at(&point) {
            None => Some(true),
            Some(label) if !is_tissue(label) => Some(false),
            Some(_) => (!in_box(&point)).then_some(true),
        });
        is_tissue_beyond == Some(true)
    };
    let mut nodes = Vec::new();
    for (corners, neighbours) in mesh.elements().iter().zip(mesh.neighbours()) {
        for (opposite, _) in neighbours
            .iter()
            .enumerate()
            .filter(|(_, neighbour)| **neighbour == NO_ELEMENT)
        {
            let face = Face::new(mesh, corners, opposite);
            if goes_on(&face) {
                nodes.extend(
                    (0..4)
                        .filter(|corner| *corner != opposite)
                        .map(|corner| corners[corner]),
                );
            }
        }
    }
    nodes.sort_unstable();
    nodes.dedup();
    nodes
}

/// A surface face.
struct Face {
    middle: Point3<f64>,
    outwards: Vector3<f64>,
    edge_mm: f64,
}

impl Face {
    fn new(mesh: &TetMesh, corners: &[u32; 4], opposite: usize) -> Self {
        let position = |corner: usize| Point3::from(mesh.nodes()[corners[corner] as usize]);
        let [a, b, c] = [1, 2, 3].map(|turn| position((opposite + turn) % 4));
        let middle = Point3::from((a.coords + b.coords + c.coords) / 3.0);
        let normal = (b - a).cross(&(c - a)).normalize();
        let away = normal.dot(&(middle - position(opposite))).signum();
        Self {
            middle,
            outwards: normal * away,
            edge_mm: [(b - a), (c - b), (a - c)]
                .map(|edge| edge.norm())
                .into_iter()
                .fold(0.0, f64::max),
        }
    }
}
