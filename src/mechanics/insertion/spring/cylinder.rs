//! Cylinder of tetrahedra around the path of the needle.

use super::parameters::{InvalidParameters, LEAST_DIHEDRAL_DEG, Parameters};
use crate::mechanics::mesh::TetMesh;
use crate::mechanics::mesh::quality::Quality;

/// Mesh in its own frame: origin at the entry of the needle, z along the path. Node 0 is the origin.
#[derive(Clone, Debug)]
pub(super) struct Cylinder {
    pub mesh: TetMesh,
    /// Whether each node is fixed: those of the side and of the far end.
    pub fixed: Vec<bool>,
    /// Number of nodes in the skin, which come first.
    pub skin_nodes: usize,
    pub least_dihedral_deg: f64,
}

impl Cylinder {
    pub fn new(parameters: &Parameters) -> Result<Cylinder, InvalidParameters> {
        parameters.check()?;
        let disc = parameters.nodes_of_layer();
        let triangles = triangles(parameters.rings, parameters.sectors);
        let mut nodes = Vec::with_capacity(parameters.nodes());
        let mut fixed = Vec::with_capacity(parameters.nodes());
        for layer in 0..=parameters.layers {
            let z = parameters.length_mm * layer as f64 / parameters.layers as f64;
            for (ring, angle) in polar(parameters.rings, parameters.sectors) {
                let r = parameters.radius_mm * ring as f64 / parameters.rings as f64;
                nodes.push([r * angle.cos(), r * angle.sin(), z]);
                fixed.push(ring == parameters.rings || layer == parameters.layers);
            }
        }
        let mut elements = Vec::with_capacity(3 * triangles.len() * parameters.layers);
        for layer in 0..parameters.layers {
            for triangle in &triangles {
                // Each side of a prism is cut from the lower corner with the lower number, as in its neighbour.
                let mut bottom = triangle.map(|corner| (layer * disc + corner) as u32);
                bottom.sort_unstable();
                let [a, b, c] = bottom;
                let [d, e, f] = bottom.map(|corner| corner + disc as u32);
                elements.extend([[a, b, c, f], [a, b, e, f], [a, d, e, f]].map(|corners| upright(corners, &nodes)));
            }
        }
        let thin = InvalidParameters::Thin { found_deg: 0.0 };
        let regions = vec![0; elements.len()];
        let mesh = TetMesh::new(nodes, elements, regions).map_err(|_| thin)?;
        let quality = Quality::of(&mesh, mesh.nodes());
        let found_deg = quality
            .shapes
            .iter()
            .fold(180.0, |least: f64, shape| least.min(shape.min_dihedral_deg));
        if found_deg >= LEAST_DIHEDRAL_DEG && quality.inverted.is_empty() {
            Ok(Cylinder {
                mesh,
                fixed,
                skin_nodes: disc,
                least_dihedral_deg: found_deg,
            })
        } else {
            Err(InvalidParameters::Thin { found_deg })
        }
    }
}

/// Returns ring and angle of each node of a layer.
fn polar(rings: usize, sectors: usize) -> impl Iterator<Item = (usize, f64)> {
    let on_ring = move |ring: usize| {
        let count = (sectors * ring).max(1);
        (0..count).map(move |place| (ring, std::f64::consts::TAU * place as f64 / count as f64))
    };
    (0..=rings).flat_map(on_ring)
}

/// Returns the triangles of a layer: in each sector, between ring i and i + 1, i + 1 based on the outer ring and i on the
/// inner.
fn triangles(rings: usize, sectors: usize) -> Vec<[usize; 3]> {
    let node = |ring: usize, place: usize| match ring {
        0 => 0,
        _ => 1 + sectors * ring * (ring - 1) / 2 + place % (sectors * ring),
    };
    let mut triangles = Vec::with_capacity(sectors * rings * rings);
    for ring in 0..rings {
        for sector in 0..sectors {
            let inner = |place: usize| node(ring, sector * ring + place);
            let outer = |place: usize| node(ring + 1, sector * (ring + 1) + place);
            triangles.extend((0..=ring).map(|place| [outer(place), outer(place + 1), inner(place)]));
            triangles.extend((0..ring).map(|place| [inner(place), outer(place + 1), inner(place + 1)]));
        }
    }
    triangles
}

/// Returns the same corners in the order that gives a positive volume.
fn upright(corners: [u32; 4], nodes: &[[f64; 3]]) -> [u32; 4] {
    let [a, b, c, d] = corners.map(|corner| nalgebra::Vector3::from(nodes[corner as usize]));
    match (b - a).dot(&(c - a).cross(&(d - a))) < 0.0 {
        true => [corners[0], corners[1], corners[3], corners[2]],
        false => corners,
    }
}
