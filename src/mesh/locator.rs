//! Point location in a tetrahedral mesh, in its reference or its deformed state.
//!
//! A query walks from a starting element towards the point, each time through the face that the point lies farthest
//! beyond, as the search of Goksel and Salcudean 2009 does from the element of the last frame. Where the walk cannot
//! decide (no start, the surface in the way, an element that is never hit, a point within rounding of a face, a fold
//! nearby), the list of the point's grid cell decides: the lowest element that contains the point.
//!
//! # Independence of the start
//! In an unfolded mesh the answer is a function of the point alone. The walk answers only where the point lies so deep
//! in an element that no other can contain it, allowing for the rounding of both; everything else is left to the list.
//! In a mesh with inverted elements, queries in the cells that they touch are always answered from the list. A mesh
//! that overlaps itself without any inverted element (two separate parts pushed into each other) is not detected: each
//! of the overlapping elements is a valid answer there.

use crate::{InvalidMesh, check_positions};

use super::TetMesh;
use super::element::{self, Carry, Frame, Kind, Outline};
use super::grid::CellGrid;
use insonify_base::parallel::{chunks, chunks_mut, for_each};
use insonify_base::real::Real;

/// Index that denotes no element.
pub const NO_ELEMENT: u32 = u32::MAX;

/// Maximum number of elements that a walk visits before the grid takes over. Samples move by a few elements from frame
/// to frame, and a grid look-up costs about as much as this many steps.
const MAX_WALK: u32 = 16;

/// Number of elements that one task of the update prepares.
const UPDATE_CHUNK: usize = 2048;

/// Result of a query.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit<T> {
    /// Element that contains the point, or [`NO_ELEMENT`].
    pub element: u32,
    /// Barycentric coordinates in the element, one per corner; 0 where there is no element.
    pub bary: [T; 4],
}

/// Counts of unsound elements in an update.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LocatorReport {
    /// Elements of negative volume. They are hit.
    pub inverted: usize,
    /// Elements without volume, or thinner than four roundings of their coordinates. Never hit.
    pub flat: usize,
    /// Elements with a corner that is NaN or infinite in either state. Never hit.
    pub not_finite: usize,
}

/// Point locator for the elements of a mesh whose nodes move.
///
/// `T` is `f32` (twin of the shader) or `f64` (gold standard). Updates allocate nothing after construction.
#[derive(Clone, Debug)]
pub struct Locator<T> {
    pub(super) elements: Vec<[u32; 4]>,
    pub(super) neighbours: Vec<[u32; 4]>,
    pub(super) frames: Vec<Frame<T>>,
    pub(super) carries: Vec<Carry<T>>,
    pub(super) grid: CellGrid<T>,
    reference: Vec<[f64; 3]>,
    nodes: Vec<[T; 3]>,
    outlines: Vec<Outline<T>>,
    node_reaches: Vec<T>,
}

impl<T: Real> Locator<T> {
    /// Builds a locator for `mesh` in its reference state.
    pub fn new(mesh: &TetMesh) -> Locator<T> {
        let count = mesh.elements().len();
        let mut locator = Locator {
            elements: mesh.elements().to_vec(),
            neighbours: mesh.neighbours().to_vec(),
            frames: vec![[[T::zero(); 4]; 4]; count],
            carries: vec![[[T::zero(); 4]; 3]; count],
            grid: CellGrid::new(count),
            reference: mesh.nodes().to_vec(),
            nodes: mesh.nodes().iter().map(|node| node.map(T::of)).collect(),
            outlines: vec![Outline::default(); count],
            node_reaches: vec![T::zero(); mesh.nodes().len()],
        };
        locator.prepare();
        locator
    }

    /// Moves the nodes to `current` (mm, in the order of the mesh) and prepares the elements again. NaN and infinite
    /// positions are permitted: their elements are excluded and counted.
    ///
    /// # Errors
    /// [`InvalidMesh`] where the number of positions is not that of the mesh; the locator is then unchanged.
    pub fn update(&mut self, current: &[[f64; 3]]) -> Result<LocatorReport, InvalidMesh> {
        self.update_states(Some(current), None)
    }

    /// Moves the nodes of the current state as [`Locator::update`] does, and those of the reference state, as remeshing
    /// requires: points are then carried to `reference`. `None` leaves the nodes of a state unchanged.
    ///
    /// # Errors
    /// As [`Locator::update`], for either state.
    pub fn update_states(
        &mut self,
        current: Option<&[[f64; 3]]>,
        reference: Option<&[[f64; 3]]>,
    ) -> Result<LocatorReport, InvalidMesh> {
        check_positions(current, reference, self.nodes.len())?;
        if let Some(current) = current {
            for (node, position) in self.nodes.iter_mut().zip(current) {
                *node = position.map(T::of);
            }
        }
        if let Some(reference) = reference {
            self.reference.copy_from_slice(reference);
        }
        Ok(self.prepare())
    }

    /// Returns the element that contains `p` (mm), walking from `start` (any element, or [`NO_ELEMENT`] to use the grid
    /// at once). A `p` that is NaN or infinite lies in no element.
    pub fn locate(&self, p: [T; 3], start: u32) -> Hit<T> {
        let nowhere = Hit {
            element: NO_ELEMENT,
            bary: [T::zero(); 4],
        };
        if !p.iter().all(|x| x.is_finite()) {
            return nowhere;
        }
        self.walk(p, start).or_else(|| self.scan(p)).unwrap_or(nowhere)
    }

    /// Returns the reference position (mm) of `p` as a point of `element`, by the element's affine map.
    ///
    /// # Panics
    /// If there is no such element.
    #[inline(always)]
    pub fn to_reference(&self, element: u32, p: [T; 3]) -> [T; 3] {
        let index = element as usize;
        element::carry_to_reference(&self.frames[index], &self.carries[index], p)
    }

    /// Returns the reference position (mm) of `p`; a point outside the mesh stays. The search starts from `element`,
    /// which receives the element that contains the point.
    pub fn carry(&self, p: [T; 3], element: &mut u32) -> [T; 3] {
        *element = self.locate(p, *element).element;
        if *element == NO_ELEMENT {
            p
        } else {
            self.to_reference(*element, p)
        }
    }

    /// Returns an answer that does not depend on the start, or `None`.
    #[inline]
    fn walk(&self, p: [T; 3], start: u32) -> Option<Hit<T>> {
        let mut element = start;
        for _ in 0..MAX_WALK {
            let frame = self.frames.get(element as usize)?;
            let bary = element::barycentric(frame, p);
            let (corner, least) = element::least(&bary);
            let slack = element::slack(frame);
            if least >= -slack.abs() {
                let alone = least > element::clear(frame) && slack > T::zero();
                let tangled = alone && self.grid.any_tangled && self.grid.around(p).1;
                return (alone && !tangled).then_some(Hit { element, bary });
            }
            element = self.neighbours[element as usize][corner];
        }
        None
    }

    /// Returns the lowest element that contains `p`, from the list of its cell.
    fn scan(&self, p: [T; 3]) -> Option<Hit<T>> {
        self.grid.around(p).0.iter().find_map(|&element| {
            let frame = &self.frames[element as usize];
            let bary = element::barycentric(frame, p);
            (element::least(&bary).1 >= -element::slack(frame)).then_some(Hit { element, bary })
        })
    }

    /// Prepares all elements, and counts the unsound ones.
    fn prepare(&mut self) -> LocatorReport {
        let (nodes, reference) = (&self.nodes, &self.reference);
        let rows = (
            chunks(&self.elements, UPDATE_CHUNK),
            chunks_mut(&mut self.frames, UPDATE_CHUNK),
            chunks_mut(&mut self.carries, UPDATE_CHUNK),
            chunks_mut(&mut self.outlines, UPDATE_CHUNK),
        );
        for_each(rows, &|(elements, frames, carries, outlines)| {
            for (index, corners) in elements.iter().enumerate() {
                let corners = corners.map(|node| node as usize);
                (frames[index], carries[index], outlines[index]) =
                    element::prepare(corners.map(|node| nodes[node]), &corners.map(|node| reference[node]));
            }
        });
        self.set_margins();
        self.grid.rebuild(&self.nodes, &self.outlines);
        let mut report = LocatorReport::default();
        for outline in &self.outlines {
            match outline.kind {
                Kind::Sound => {}
                Kind::Inverted => report.inverted += 1,
                Kind::Flat => report.flat += 1,
                Kind::NotFinite => report.not_finite += 1,
            }
        }
        report
    }

    /// Sets the margins of all elements: a point is clear of all others where it is farther from the faces of its own
    /// than any element that shares a node with it can reach.
    fn set_margins(&mut self) {
        self.node_reaches.fill(T::zero());
        for (corners, outline) in self.elements.iter().zip(&self.outlines) {
            for &node in corners {
                let node_reach = &mut self.node_reaches[node as usize];
                *node_reach = node_reach.max(outline.reach);
            }
        }
        let node_reaches = &self.node_reaches;
        let rows = (
            chunks(&self.elements, UPDATE_CHUNK),
            chunks_mut(&mut self.frames, UPDATE_CHUNK),
        );
        for_each(rows, &|(elements, frames)| {
            for (corners, frame) in elements.iter().zip(frames) {
                let reach = corners
                    .iter()
                    .fold(T::zero(), |reach, &node| reach.max(node_reaches[node as usize]));
                element::set_clear(frame, reach);
            }
        });
    }
}

#[cfg(test)]
mod tests;
