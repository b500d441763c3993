//! Mesh quality for computation: the shape of the elements, and their connectivity.

mod nodes;
mod parts;
mod shape;
mod spread;
mod verdict;

use std::collections::BTreeMap;

use super::TetMesh;
use super::element::{self, Kind};
use crate::mechanics::mesh::InvalidMesh;
pub use parts::Part;
pub use shape::{Shape, jacobian_condition};
pub use spread::{Bin, Spread};
pub use verdict::UnusableMesh;

/// Limit of the [`jacobian_condition`] of a usable element, `1 / sqrt(f64::EPSILON)`: beyond it an element is so thin that
/// rounding its corners leaves less than half the digits of its height, and of its stiffness.
pub const CONDITION_LIMIT: f64 = 67_108_864.0;

/// Quality of a mesh with its nodes at given positions. Lists contain indices from 0, ascending.
#[derive(Clone, Debug, PartialEq)]
pub struct Quality {
    /// Shape of each element.
    pub shapes: Vec<Shape>,
    /// Signed volumes, mm^3, in orders of magnitude.
    pub volume_mm3: Spread,
    /// Least dihedral angle of each element, degrees (70.53 in a regular one).
    pub min_dihedral_deg: Spread,
    /// Greatest dihedral angle of each element, degrees (70.53 in a regular one).
    pub max_dihedral_deg: Spread,
    /// [`jacobian_condition`] of each element.
    pub condition: Spread,
    /// Elements of negative volume.
    pub inverted: Vec<u32>,
    /// Elements whose volume is within rounding of 0.
    pub flat: Vec<u32>,
    /// Elements with a corner that is NaN or infinite.
    pub not_finite: Vec<u32>,
    /// Elements with a volume whose condition exceeds [`CONDITION_LIMIT`].
    pub slivers: Vec<u32>,
    /// Duplicated elements: the earlier element with the same corners, and the duplicate.
    pub duplicates: Vec<[u32; 2]>,
    /// Nodes without an element.
    pub isolated_nodes: Vec<u32>,
    /// Coincident nodes (within 1e-9 of the mesh's diagonal): the earlier node, and the coincident one.
    pub coincident_nodes: Vec<[u32; 2]>,
    /// Parts connected through common nodes, by first element.
    pub parts: Vec<Part>,
    /// Number of parts connected through common faces. More than [`Quality::parts`] means that some are attached by a node
    /// or an edge, as by a hinge.
    pub face_parts: usize,
    /// Regions by number.
    pub regions: Vec<Region>,
}

/// The elements of a region.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Region {
    /// Region number.
    pub value: i32,
    /// Number of its elements.
    pub elements: usize,
    /// Sum of their signed volumes, ml.
    pub volume_ml: f64,
}

impl Quality {
    /// Measures a mesh with its nodes at `nodes` (reference or current positions, mm; one for each node of the mesh).
    ///
    /// # Panics
    /// If `nodes` has fewer entries than the mesh has nodes.
    pub fn of(mesh: &TetMesh, nodes: &[[f64; 3]]) -> Quality {
        let nodes = &nodes[..mesh.nodes().len()];
        let mut shapes = Vec::with_capacity(mesh.elements().len());
        let mut of_kind: [Vec<u32>; 3] = Default::default();
        let [inverted, flat, not_finite] = &mut of_kind;
        let mut slivers = Vec::new();
        for (element, corners) in (0..).zip(mesh.elements()) {
            let corners = corners.map(|node| nodes[node as usize]);
            let shape = Shape::of(&corners);
            match element::prepare(corners, &corners).2.kind {
                Kind::Sound if shape.condition > CONDITION_LIMIT => slivers.push(element),
                Kind::Sound => {}
                Kind::Inverted => inverted.push(element),
                Kind::Flat => flat.push(element),
                Kind::NotFinite => not_finite.push(element),
            }
            shapes.push(shape);
        }
        let [inverted, flat, not_finite] = of_kind;
        let spread = |value: fn(&Shape) -> f64, edges: &[f64]| Spread::of(shapes.iter().map(value), edges);
        Quality {
            volume_mm3: spread(|shape| shape.volume_mm3, &spread::DECADES),
            min_dihedral_deg: spread(|shape| shape.min_dihedral_deg, &spread::ANGLES),
            max_dihedral_deg: spread(|shape| shape.max_dihedral_deg, &spread::ANGLES),
            condition: spread(|shape| shape.condition, &spread::CONDITIONS),
            inverted,
            flat,
            not_finite,
            slivers,
            duplicates: parts::duplicates(mesh.elements()),
            isolated_nodes: nodes::isolated(mesh),
            coincident_nodes: nodes::coincident(nodes),
            parts: parts::by_nodes(mesh, &shapes),
            face_parts: parts::by_faces(mesh),
            regions: regions(mesh, &shapes),
            shapes,
        }
    }

    /// Returns the volume of all elements, ml.
    pub fn volume_ml(&self) -> f64 {
        self.regions.iter().map(|region| region.volume_ml).sum()
    }

    /// Checks that the mesh is usable for computation: no element is inverted, flat, a sliver, not finite or duplicated.
    ///
    /// # Errors
    /// [`UnusableMesh`], which names the elements.
    pub fn usable(&self) -> Result<(), InvalidMesh> {
        UnusableMesh::of(self).map_or(Ok(()), |unusable| Err(InvalidMesh::Unusable(Box::new(unusable))))
    }
}

fn regions(mesh: &TetMesh, shapes: &[Shape]) -> Vec<Region> {
    let mut regions: BTreeMap<i32, Region> = BTreeMap::new();
    for (&value, shape) in mesh.regions().iter().zip(shapes) {
        let region = regions.entry(value).or_insert(Region {
            value,
            elements: 0,
            volume_ml: 0.0,
        });
        region.elements += 1;
        region.volume_ml += shape.volume_mm3 * parts::ML_PER_MM3;
    }
    regions.into_values().collect()
}

#[cfg(test)]
mod tests;
