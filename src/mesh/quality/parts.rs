//! Connected parts of a mesh, and duplicated elements.

use super::Shape;
use crate::{NO_ELEMENT, TetMesh};

pub(super) const ML_PER_MM3: f64 = 1e-3;

/// A connected part of a mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Part {
    /// First element of the part.
    pub first: u32,
    /// Number of its elements.
    pub elements: usize,
    /// Sum of their signed volumes, ml.
    pub volume_ml: f64,
}

/// Returns the parts connected through common nodes, by first element.
pub(super) fn by_nodes(mesh: &TetMesh, shapes: &[Shape]) -> Vec<Part> {
    let mut sets = Sets::new(mesh.nodes().len());
    for corners in mesh.elements() {
        corners[1..].iter().for_each(|corner| sets.join(corners[0], *corner));
    }
    // The part of a root node.
    let mut part_of = vec![None; mesh.nodes().len()];
    let mut parts: Vec<Part> = Vec::new();
    for (element, (corners, shape)) in (0..).zip(mesh.elements().iter().zip(shapes)) {
        let number = *part_of[sets.root(corners[0]) as usize].get_or_insert_with(|| {
            parts.push(Part {
                first: element,
                elements: 0,
                volume_ml: 0.0,
            });
            parts.len() - 1
        });
        let part = &mut parts[number];
        part.elements += 1;
        part.volume_ml += shape.volume_mm3 * ML_PER_MM3;
    }
    parts
}

/// Returns the number of parts connected through common faces.
pub(super) fn by_faces(mesh: &TetMesh) -> usize {
    let mut sets = Sets::new(mesh.elements().len());
    for (element, neighbours) in (0..).zip(mesh.neighbours()) {
        let inside = neighbours.iter().filter(|other| **other != NO_ELEMENT);
        inside.for_each(|other| sets.join(element, *other));
    }
    (0..mesh.elements().len() as u32)
        .filter(|element| sets.root(*element) == *element)
        .count()
}

/// Returns the elements with the corners of an earlier one, in any order, preceded by that one.
pub(super) fn duplicates(elements: &[[u32; 4]]) -> Vec<[u32; 2]> {
    let mut sorted: Vec<([u32; 4], u32)> = elements
        .iter()
        .zip(0..)
        .map(|(corners, element)| {
            let mut corners = *corners;
            corners.sort_unstable();
            (corners, element)
        })
        .collect();
    sorted.sort_unstable();
    let same = sorted.chunk_by(|a, b| a.0 == b.0);
    let mut pairs: Vec<[u32; 2]> = same
        .flat_map(|all| all[1..].iter().map(|(_, element)| [all[0].1, *element]))
        .collect();
    pairs.sort_unstable_by_key(|pair| pair[1]);
    pairs
}

/// Disjoint sets of numbers, each represented by its least member.
struct Sets(Vec<u32>);

impl Sets {
    fn new(members: usize) -> Sets {
        Sets((0..members as u32).collect())
    }

    fn root(&mut self, member: u32) -> u32 {
        let parents = &mut self.0;
        let mut current = member;
        while parents[current as usize] != current {
            // Each step halves the path for the next time.
            parents[current as usize] = parents[parents[current as usize] as usize];
            current = parents[current as usize];
        }
        current
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.0[a.max(b) as usize] = a.min(b);
    }
}
