//! Draft mesh, whose nodes move and whose elements change region.

use insonify_base::parallel;

use super::bisection::Bisection;
use super::contents::{Contents, Sampler};
use super::tissue::{OUTSIDE, Tissue};
use super::{FACES, sharpest_cosine, six_volumes};
use crate::vector::{cross, minus, norm};
use crate::{InvalidMesh, NO_ELEMENT, neighbours};

/// Elements that fill a lattice around the tissue, including those outside.
pub(super) struct Draft {
    pub nodes: Vec<[f64; 3]>,
    /// Axes along which a node is fixed, because it lies on a face of the lattice.
    pub fixed: Vec<[bool; 3]>,
    /// Corners; all elements have positive volume.
    pub elements: Vec<[u32; 4]>,
    pub neighbours: Vec<[u32; 4]>,
    pub classes: Vec<u8>,
    pub contents: Vec<Contents>,
    /// Cosine of the smallest dihedral angle after refinement.
    pub sharpest_refined: f64,
    star_starts: Vec<u32>,
    star_elements: Vec<u32>,
}

impl Draft {
    /// Builds a draft from a bisection, with each element in its majority class.
    pub(super) fn new(mesh: &Bisection, tissue: &Tissue, sampler: &Sampler) -> Result<Self, InvalidMesh> {
        let mut elements = mesh.elements.clone();
        for corners in &mut elements {
            if six_volumes(&corners.map(|node| mesh.nodes[node as usize])) < 0.0 {
                corners.swap(2, 3);
            }
        }
        let mut star_starts = vec![0u32; mesh.nodes.len() + 1];
        let mut star_elements = Vec::with_capacity(4 * elements.len());
        for node in 0..mesh.nodes.len() {
            let from = star_elements.len();
            star_elements.extend_from_slice(mesh.star(node as u32));
            star_elements[from..].sort_unstable();
            star_starts[node + 1] = star_elements.len() as u32;
        }
        let mut draft = Draft {
            nodes: mesh.nodes.clone(),
            fixed: (0..mesh.nodes.len()).map(|node| mesh.on_faces(node as u32)).collect(),
            neighbours: neighbours(&elements)?,
            classes: Vec::new(),
            contents: Vec::new(),
            sharpest_refined: 0.0,
            elements,
            star_starts,
            star_elements,
        };
        // Bisection produces shapes that differ by rounding: a margin keeps them all sound.
        let sharpest = parallel::map(0..draft.elements.len(), &|e| sharpest_cosine(&draft.corners(e as u32)));
        draft.sharpest_refined = sharpest.into_iter().fold(-1.0, f64::max) + 1e-9;
        draft.sample(tissue, sampler);
        draft.classes = draft.contents.iter().map(Contents::majority).collect();
        Ok(draft)
    }

    /// Samples the contents of the elements again.
    pub(super) fn sample(&mut self, tissue: &Tissue, sampler: &Sampler) {
        let (nodes, elements) = (&self.nodes, &self.elements);
        self.contents = parallel::map(&elements[..], &|corners| {
            let corners = corners.map(|node| nodes[node as usize]);
            sampler.contents(tissue, &corners)
        });
    }

    /// Returns the elements around a node, ascending.
    pub(super) fn star(&self, node: u32) -> &[u32] {
        let node = node as usize;
        &self.star_elements[self.star_starts[node] as usize..self.star_starts[node + 1] as usize]
    }

    pub(super) fn corners(&self, element: u32) -> [[f64; 3]; 4] {
        self.elements[element as usize].map(|node| self.nodes[node as usize])
    }

    /// Returns the class across a face; beyond the lattice it is the outside.
    pub(super) fn across(&self, element: u32, face: usize) -> u8 {
        match self.neighbours[element as usize][face] {
            NO_ELEMENT => OUTSIDE,
            other => self.classes[other as usize],
        }
    }

    /// Returns the nodes of the face opposite a corner.
    pub(super) fn face(&self, element: u32, opposite: usize) -> [u32; 3] {
        FACES[opposite].map(|corner| self.elements[element as usize][corner])
    }

    /// Returns the area of the face opposite a corner, mm^2.
    pub(super) fn area(&self, element: u32, opposite: usize) -> f64 {
        let [a, b, c] = self.face(element, opposite).map(|node| self.nodes[node as usize]);
        0.5 * norm(cross(minus(b, a), minus(c, a)))
    }

    /// Returns the kept elements around a node, in groups connected through faces at that node.
    pub(crate) fn fans(&self, node: u32) -> Vec<Vec<u32>> {
        let star = self.star(node);
        let mut open: Vec<u32> = star
            .iter()
            .copied()
            .filter(|e| self.classes[*e as usize] != OUTSIDE)
            .collect();
        let mut fans = Vec::new();
        while let Some(seed) = open.pop() {
            let mut fan = vec![seed];
            let mut next = 0;
            while next < fan.len() {
                let element = fan[next] as usize;
                next += 1;
                for corner in 0..4 {
                    if self.elements[element][corner] == node {
                        continue;
                    }
                    let neighbour = self.neighbours[element][corner];
                    if let Some(index) = open.iter().position(|e| *e == neighbour) {
                        fan.push(open.swap_remove(index));
                    }
                }
            }
            fans.push(fan);
        }
        fans
    }

    /// Returns the volumes of the classes, mm^3.
    pub(super) fn volumes(&self, classes: usize) -> Vec<f64> {
        let mut volumes = vec![0.0; classes];
        for (contents, &class) in self.contents.iter().zip(&self.classes) {
            volumes[usize::from(class)] += contents.volume;
        }
        volumes
    }

    /// Returns the elements that are kept.
    pub(super) fn kept(&self) -> impl Iterator<Item = u32> + '_ {
        (0..self.elements.len() as u32).filter(|element| self.classes[*element as usize] != OUTSIDE)
    }

    /// Returns the number of nodes of elements that are kept.
    pub(crate) fn kept_nodes(&self) -> usize {
        let mut used = vec![false; self.nodes.len()];
        for element in self.kept() {
            for node in self.elements[element as usize] {
                used[node as usize] = true;
            }
        }
        used.iter().filter(|used| **used).count()
    }
}
