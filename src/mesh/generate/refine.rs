//! Refinement to a node budget: repeated bisection of the element with the largest impurity.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::bisection::Bisection;
use super::contents::{Contents, Sampler};
use super::path::Path;
use super::tissue::{OUTSIDE, Tissue};
use crate::vector::{minus, norm};

/// Share of the tissue in an element that counts as impure in any case: pure elements are bisected too once they are
/// some thirty times as large as those of interfaces, so the bulk is graded and can bend.
const BULK: f64 = 0.01;
/// Share of tissue that counts as impure on the path: there pure elements are almost as fine as those of interfaces.
const PATH_BULK: f64 = 0.3;
/// Maximum number of nodes of all elements per wanted node: where tissue is so thin that hardly an element is mostly
/// tissue, refinement must end for lack of room.
const SURROUNDINGS: usize = 8;
/// Additional nodes that refinement may always make.
const LATTICE_ROOM: usize = 64;
/// Score of an element that is too long, mm^3: above that of any other.
const OVERLONG: f64 = 1e30;

/// Entry of the queue: highest score first, of ties the lowest number. Scores are ordered by their bits, which for
/// non-negative numbers is their order.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Entry {
    score: u64,
    before: Reverse<u32>,
    version: u32,
}

/// Reason why refinement ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum End {
    /// The wanted number of nodes is reached.
    Target,
    /// Nothing is left to bisect.
    Pure,
}

#[derive(Clone, Copy, Default)]
struct State {
    /// Number of times that the element has been sampled.
    version: u32,
    /// Corners when it was last sampled, if it was then mostly tissue.
    kept: Option<[u32; 4]>,
}

/// A bisection, the contents of its elements, and the queue of elements to be bisected.
#[derive(Clone)]
pub(super) struct Refinement<'a> {
    pub mesh: Bisection,
    path: &'a Path,
    states: Vec<State>,
    queue: BinaryHeap<Entry>,
    /// Number of elements around each node that are mostly tissue.
    kept: Vec<u32>,
    /// Number of nodes of elements that are mostly tissue.
    kept_nodes: usize,
    max_edge: f64,
}

impl<'a> Refinement<'a> {
    /// Starts from a mesh. `max_edge_mm` is the longest edge of an element with tissue in it.
    pub(super) fn new(mesh: Bisection, tissue: &Tissue, sampler: &Sampler, path: &'a Path, max_edge_mm: f64) -> Self {
        let mut refinement = Refinement {
            path,
            kept: vec![0; mesh.nodes.len()],
            states: Vec::new(),
            queue: BinaryHeap::new(),
            kept_nodes: 0,
            max_edge: max_edge_mm,
            mesh,
        };
        for element in 0..refinement.mesh.elements.len() as u32 {
            refinement.admit(element, tissue, sampler);
        }
        refinement
    }

    /// Returns the number of nodes of elements that are mostly tissue.
    pub(super) fn nodes(&self) -> usize {
        self.kept_nodes
    }

    /// Bisects elements until `target` nodes belong to tissue or the sampler's work is spent.
    pub(super) fn refine(
        &mut self,
        target: usize,
        tissue: &Tissue,
        sampler: &Sampler,
        progress: &mut dyn FnMut(usize),
    ) -> End {
        let mut changed = Vec::new();
        let room = SURROUNDINGS * target + LATTICE_ROOM;
        while self.kept_nodes < target && self.mesh.nodes.len() < room && !sampler.is_spent() {
            let Some(entry) = self.queue.pop() else {
                return End::Pure;
            };
            let element = entry.before.0;
            if entry.version != self.states[element as usize].version {
                continue;
            }
            changed.clear();
            self.mesh.bisect(element, &mut changed);
            changed.sort_unstable();
            changed.dedup();
            self.kept.resize(self.mesh.nodes.len(), 0);
            for &element in &changed {
                self.admit(element, tissue, sampler);
            }
            progress(self.kept_nodes);
        }
        End::Target
    }

    /// Returns whether an element is still too long.
    pub(crate) fn is_overlong(&self) -> bool {
        self.queue.iter().any(|entry| {
            entry.score >= OVERLONG.to_bits() && entry.version == self.states[entry.before.0 as usize].version
        })
    }

    /// Adds an element with its current corners to the queue and the count.
    fn admit(&mut self, element: u32, tissue: &Tissue, sampler: &Sampler) {
        let index = element as usize;
        if self.states.len() <= index {
            self.states.resize(index + 1, State::default());
        }
        let corners = self.mesh.corners(element);
        let contents = sampler.contents(tissue, &corners);
        for node in self.states[index].kept.take().into_iter().flatten() {
            self.kept[node as usize] -= 1;
            self.kept_nodes -= usize::from(self.kept[node as usize] == 0);
        }
        self.states[index].version += 1;
        if contents.majority() != OUTSIDE {
            let corners = self.mesh.elements[index];
            for node in corners {
                self.kept_nodes += usize::from(self.kept[node as usize] == 0);
                self.kept[node as usize] += 1;
            }
            self.states[index].kept = Some(corners);
        }
        let score = self.score(&contents, &corners, tissue.voxel_mm3);
        if score > 0.0 {
            self.queue.push(Entry {
                score: score.to_bits(),
                before: Reverse(element),
                version: self.states[index].version,
            });
        }
    }

    /// Returns the priority for bisecting an element; 0 if it needs none.
    fn score(&self, contents: &Contents, corners: &[[f64; 3]; 4], voxel_mm3: f64) -> f64 {
        let tissue = contents.tissue();
        if tissue <= 0.0 {
            return 0.0;
        }
        let longest = (0..4)
            .flat_map(|a| (0..a).map(move |b| norm(minus(corners[a], corners[b]))))
            .fold(0.0, f64::max);
        if longest > self.max_edge {
            return OVERLONG + longest;
        }
        // An element smaller than a voxel cannot become purer by bisection.
        let impurity = if contents.volume < voxel_mm3 {
            0.0
        } else {
            contents.impurity()
        };
        let (bulk, grade) = match self.path.grade(corners) {
            None => (BULK, 1.0),
            Some(grade) if grade < 2.0 && longest <= self.path.edge_mm => return 0.0,
            Some(grade) => (BULK + (PATH_BULK - BULK) / grade, grade),
        };
        (impurity + bulk * tissue) / grade.powi(3)
    }
}
