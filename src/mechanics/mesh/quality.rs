//! How good a mesh is to calculate on: the shape of its elements, and whether it hangs together.

mod nodes;
mod parts;
mod shape;
mod spread;
mod verdict;

use std::collections::BTreeMap;

use super::TetMesh;
use super::element::{self, Kind};
pub use parts::Part;
pub use shape::{Shape, jacobian_condition};
pub use spread::Spread;
pub use verdict::UnusableMesh;

/// The greatest [`jacobian_condition`] of an element to calculate on, `1 / sqrt(f64::EPSILON)`: beyond it an element is so
/// thin that rounding its corners leaves less than half the digits of its height, and of the stiffness it gives.
pub const CONDITION_LIMIT: f64 = 67_108_864.0;

/// What a mesh is like with its nodes at given positions. Lists are of indices from 0, ascending.
#[derive(Clone, Debug, PartialEq)]
pub struct Quality {
    /// The shape of each element.
    pub shapes: Vec<Shape>,
    /// Signed volumes, mm^3, in orders of magnitude.
    pub volume_mm3: Spread,
    /// The least dihedral angle of each element, degrees (70.53 in a regular one).
    pub min_dihedral_deg: Spread,
    /// The greatest dihedral angle of each element, degrees (70.53 in a regular one).
    pub max_dihedral_deg: Spread,
    /// The [`jacobian_condition`] of each element.
    pub condition: Spread,
    /// Elements of negative volume.
    pub inverted: Vec<u32>,
    /// Elements whose volume is nothing but rounding.
    pub flat: Vec<u32>,
    /// Elements with a corner that is NaN or infinite.
    pub not_finite: Vec<u32>,
    /// Elements with a volume whose condition exceeds [`CONDITION_LIMIT`].
    pub slivers: Vec<u32>,
    /// Elements with the corners of an earlier one: that one, and the element.
    pub duplicates: Vec<[u32; 2]>,
    /// Nodes of no element.
    pub isolated_nodes: Vec<u32>,
    /// Nodes in the place of an earlier one (within 1e-9 of the mesh's diagonal): that one, and the node.
    pub coincident_nodes: Vec<[u32; 2]>,
    /// What is connected through common nodes, by first element.
    pub parts: Vec<Part>,
    /// How many parts there would be if only common faces held them together. More than [`Quality::parts`] means that some
    /// hang on a node or an edge, as on a hinge.
    pub face_parts: usize,
    /// Regions by number.
    pub regions: Vec<Region>,
}

/// The elements of a region.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Region {
    /// Its number.
    pub value: i32,
    /// Its elements.
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

    /// Volume of all elements, ml.
    pub fn volume_ml(&self) -> f64 {
        self.regions.iter().map(|region| region.volume_ml).sum()
    }

    /// Whether the mesh can be calculated on: no element is inverted, flat, a sliver, not finite or there twice.
    ///
    /// # Errors
    /// [`UnusableMesh`], which names the elements.
    pub fn usable(&self) -> Result<(), UnusableMesh> {
        UnusableMesh::of(self).map_or(Ok(()), Err)
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
