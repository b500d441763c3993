//! Elements of a deforming mesh in the slab of a frame: those in which a sample of any scanline of any sub-plane can lie.
//!
//! Only these are prepared. Nothing is carried over from one frame to the next but the
//! positions of nodes that a frame leaves out.

use std::sync::Arc;

use nalgebra::Matrix4;
use rayon::prelude::*;

use super::FrameState;
use super::tables::Tables;
use crate::base::real::Real;
use crate::imaging::effects::common::plane_step;
use crate::mechanics::mesh::element::{self, Carry, Frame, MAX_REACH};
use crate::mechanics::mesh::{InvalidMesh, TetMesh, check_positions};
use crate::tracking::probe::BeamGrid;

/// Number of elements that one task prepares.
const CHUNK: usize = 512;

/// Number of elements that one task tests against the slab.
const TESTED: usize = 4096;

/// Bound on the rounding error of the position of a sample, in epsilons of the largest coordinate.
const POINT_EPSILONS: f64 = 16.0;

/// Elements of one state of the mesh that cross the slab, ascending; an element's place in these lists is its slot.
#[derive(Clone, Debug)]
pub struct Crossing<T> {
    /// Number of each in the mesh.
    pub elements: Vec<u32>,
    /// Elements found by each task, at the start of its [`TESTED`] places.
    found: Vec<u32>,
    /// Number of elements found by each task.
    counts: Vec<usize>,
    /// Maps to barycentric coordinates, with the first scanline and the one behind the last in spare places.
    pub frames: Vec<Frame<T>>,
    /// Maps to the reference state.
    pub carries: Vec<Carry<T>>,
    /// Scanlines that can meet each.
    lines: Vec<[u32; 2]>,
    /// Start of the slots of each scanline in `slots`.
    starts: Vec<u32>,
    slots: Vec<u32>,
}

impl<T: Real> Crossing<T> {
    fn new(capacity: usize) -> Self {
        Self {
            elements: Vec::with_capacity(capacity),
            found: vec![0; capacity],
            counts: vec![0; capacity.div_ceil(TESTED)],
            frames: Vec::with_capacity(capacity),
            carries: Vec::with_capacity(capacity),
            lines: Vec::with_capacity(capacity),
            starts: Vec::new(),
            slots: Vec::new(),
        }
    }

    /// Slots of the elements that can hold samples of a scanline, ascending.
    pub fn on_line(&self, line: usize) -> &[u32] {
        &self.slots[self.starts[line] as usize..self.starts[line + 1] as usize]
    }

    /// Sorts the slots by scanline.
    fn sort_by_line(&mut self, lines: usize) {
        self.starts.clear();
        self.starts.resize(lines + 1, 0);
        for &[first, end] in &self.lines {
            self.starts[first as usize..end as usize]
                .iter_mut()
                .for_each(|n| *n += 1);
        }
        let mut sum = 0;
        for start in &mut self.starts {
            sum += std::mem::replace(start, sum);
        }
        self.slots.clear();
        self.slots.resize(sum as usize, 0);
        for (slot, &[first, end]) in self.lines.iter().enumerate() {
            for next in &mut self.starts[first as usize..end as usize] {
                self.slots[*next as usize] = slot as u32;
                *next += 1;
            }
        }
        // Each start is now that of the next scanline.
        self.starts.rotate_right(1);
        self.starts[0] = 0;
    }

    /// Finds and prepares the elements of a state whose nodes are at `at` (mm) and, in the probe frame, at `in_probe`.
    fn cut(
        &mut self,
        view: &SlabView,
        mesh: &TetMesh,
        in_probe: &[[f64; 3]],
        at: impl Fn(usize) -> [T; 3] + Sync,
        reference: &[[f64; 3]],
    ) {
        let corners_of = |element: u32| mesh.elements()[element as usize].map(|node| node as usize);
        let tasks = (self.found.par_chunks_mut(TESTED), &mut self.counts[..]);
        tasks.into_par_iter().enumerate().for_each(|(task, (found, count))| {
            *count = 0;
            for element in (task * TESTED) as u32..(task * TESTED + found.len()) as u32 {
                if view.meets(&corners_of(element).map(|node| in_probe[node])) {
                    found[*count] = element;
                    *count += 1;
                }
            }
        });
        self.elements.clear();
        for (found, &count) in self.found.chunks(TESTED).zip(&self.counts) {
            self.elements.extend_from_slice(&found[..count]);
        }
        self.frames.resize(self.elements.len(), Default::default());
        self.carries.resize(self.elements.len(), Default::default());
        self.lines.resize(self.elements.len(), Default::default());
        let chunks = (
            self.elements.par_chunks(CHUNK),
            self.frames.par_chunks_mut(CHUNK),
            self.carries.par_chunks_mut(CHUNK),
            self.lines.par_chunks_mut(CHUNK),
        );
        chunks.into_par_iter().for_each(|(elements, frames, carries, lines)| {
            for (index, &element) in elements.iter().enumerate() {
                let corners = corners_of(element);
                let (mut frame, carry, outline) =
                    element::prepare(corners.map(&at), &corners.map(|node| reference[node]));
                lines[index] = match element::slack(&frame) < T::zero() {
                    true => [0; 2],
                    false => view.lines(&corners.map(|node| in_probe[node]), outline.reach.wide()),
                };
                [frame[1][3], frame[3][3]] = lines[index].map(|line| T::of(f64::from(line)));
                (frames[index], carries[index]) = (frame, carry);
            }
        });
    }
}

/// Lists that changed with a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Moved {
    /// Whether the elements of the deformed state changed.
    pub deformed: bool,
    /// Whether the elements of the reference state changed.
    pub reference: bool,
}

/// Elements of a mesh in the slab of a frame, in its deformed and in its reference state.
#[derive(Clone, Debug)]
pub struct Slab<T> {
    mesh: Arc<TetMesh>,
    current: Vec<[T; 3]>,
    reference_nodes: Vec<[f64; 3]>,
    in_probe: Vec<[f64; 3]>,
    /// Probe pose of the last frame; `None` before the first and after a change of settings.
    pose: Option<Matrix4<f64>>,
    /// Elements of the deformed state.
    pub deformed: Crossing<T>,
    /// Elements of the reference state; their maps to the reference state are the identity.
    pub reference: Crossing<T>,
    /// Starts of the maps in the buffer of element maps on a GPU, in vec4: of the reference elements, and of the deformed ones, to barycentric
    /// coordinates and to the reference state.
    pub maps_at: [u32; 3],
}

impl<T: Real> Slab<T> {
    /// Memory for the elements of a mesh at rest; nothing is cut yet.
    pub fn new(mesh: &Arc<TetMesh>) -> Self {
        let count = mesh.elements().len();
        Self {
            current: mesh.nodes().iter().map(|node| node.map(T::of)).collect(),
            reference_nodes: mesh.nodes().to_vec(),
            in_probe: vec![[0.0; 3]; mesh.nodes().len()],
            pose: None,
            deformed: Crossing::new(count),
            reference: Crossing::new(count),
            maps_at: [0; 3],
            mesh: Arc::clone(mesh),
        }
    }

    /// Cuts again at the next frame: the probe or the sub-planes have changed.
    pub fn forget(&mut self) {
        self.pose = None;
    }

    /// Moves the nodes to the state of a frame and cuts what has changed. Nodes that are NaN or infinite are permitted: their elements hold no
    /// sample.
    ///
    /// # Errors
    /// [`InvalidMesh`] if the number of positions is not that of the mesh; nothing is changed then.
    pub fn update(&mut self, tables: &Tables, state: &FrameState) -> Result<Moved, InvalidMesh> {
        let (current, reference) = (state.nodes.as_deref(), state.reference.as_deref());
        check_positions(current, reference, self.current.len())?;
        let reference = reference.filter(|nodes| *nodes != self.reference_nodes);
        if let Some(nodes) = current {
            for (node, position) in self.current.iter_mut().zip(nodes) {
                *node = position.map(T::of);
            }
        }
        if let Some(nodes) = reference {
            self.reference_nodes.copy_from_slice(nodes);
        }
        let posed = self.pose.replace(state.probe_to_world) != Some(state.probe_to_world);
        let moved = Moved {
            deformed: posed || current.is_some() || reference.is_some(),
            reference: posed || reference.is_some(),
        };
        let view = SlabView::new::<T>(tables, &state.probe_to_world);
        let nodes = &self.reference_nodes;
        if moved.deformed {
            let current = &self.current;
            view.project(current.iter().map(|node| node.map(T::wide)), &mut self.in_probe);
            self.deformed
                .cut(&view, &self.mesh, &self.in_probe, |node| current[node], nodes);
        }
        if moved.reference {
            view.project(nodes.iter().copied(), &mut self.in_probe);
            let at = |node: usize| nodes[node].map(T::of);
            self.reference.cut(&view, &self.mesh, &self.in_probe, at, nodes);
        }
        Ok(moved)
    }

    /// Sorts the elements by scanline, as the CPU reads them.
    pub fn sort_by_line(&mut self, lines: usize) {
        self.deformed.sort_by_line(lines);
        self.reference.sort_by_line(lines);
    }
}

/// The slab in the frame of the probe, mm.
struct SlabView<'a> {
    grid: &'a BeamGrid,
    to_probe: [[f64; 4]; 3],
    /// Largest factor by which lengths grow in the probe frame.
    scale: f64,
    /// Box around all samples.
    bounds: [[f64; 3]; 2],
    /// Rounding of a position.
    margin: f64,
}

impl<'a> SlabView<'a> {
    fn new<T: Real>(tables: &'a Tables, probe_to_world: &Matrix4<f64>) -> Self {
        // Frames are refused whose pose has no inverse.
        let inverse = probe_to_world.try_inverse().unwrap_or(Matrix4::repeat(f64::NAN));
        let scale = inverse.fixed_view::<3, 3>(0, 0).norm();
        let sector = tables.grid.bounds_mm();
        let planes = (0..tables.planes()).map(|plane| f64::from(plane_step(plane)) * tables.plane_mm());
        let half = planes.fold(0.0f64, |half, z| half.max(z.abs()));
        let bounds = [
            [sector.min[0], sector.min[1], -half],
            [sector.max[0], sector.max[1], half],
        ];
        let farthest = bounds.iter().flatten().fold(0.0f64, |far, x| far.max(x.abs()));
        let rows = probe_to_world.fixed_view::<3, 4>(0, 0);
        let largest = rows.iter().fold(0.0f64, |sum, x| sum.max(x.abs())) * (1.0 + 3.0 * farthest);
        Self {
            grid: &tables.grid,
            to_probe: std::array::from_fn(|row| std::array::from_fn(|column| inverse[(row, column)])),
            scale,
            bounds,
            margin: scale * POINT_EPSILONS * T::epsilon().wide() * largest,
        }
    }

    /// Positions of nodes in the frame of the probe.
    fn project(&self, nodes: impl Iterator<Item = [f64; 3]>, in_probe: &mut [[f64; 3]]) {
        for (node, [x, y, z]) in in_probe.iter_mut().zip(nodes) {
            *node = self.to_probe.map(|row| row[0] * x + row[1] * y + row[2] * z + row[3]);
        }
    }

    /// Whether the box of an element, grown by what may test as inside, meets that of the samples.
    #[inline(always)]
    fn meets(&self, corners: &[[f64; 3]; 4]) -> bool {
        [2, 0, 1].into_iter().all(|axis| {
            let [a, b, c, d] = corners.map(|corner| corner[axis]);
            let (low, high) = (a.min(b).min(c.min(d)), a.max(b).max(c.max(d)));
            let reach = MAX_REACH * (high - low) + self.margin;
            // False for NaN.
            low - reach <= self.bounds[1][axis] && high + reach >= self.bounds[0][axis]
        })
    }

    /// First scanline that can meet an element with these corners, grown by `reach` (mm in the world), and the one past the last.
    fn lines(&self, corners: &[[f64; 3]; 4], reach: f64) -> [u32; 2] {
        let all = self.grid.lines() as u32;
        if all == 1 {
            return [0, 1];
        }
        let margin = reach * self.scale + self.margin;
        let planes = [self.bounds[0][2] - margin, self.bounds[1][2] + margin];
        // Scanlines meet in an apex at (0, -behind), if they are not parallel.
        let behind = self.grid.virtual_apex_mm();
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        let mut clear = true;
        // A point at x and y lies in the direction x / (y + behind).
        let mut take = |x: f64, y: f64| {
            let (toward, margin) = match behind {
                None => (x, margin),
                Some(behind) => {
                    let ahead = y + behind;
                    clear &= ahead > 10.0 * margin;
                    let toward = x / ahead;
                    (toward, margin * (1.0 + toward.abs()) / (ahead - margin))
                }
            };
            low = low.min(toward - margin);
            high = high.max(toward + margin);
        };
        for (index, a) in corners.iter().enumerate() {
            if (planes[0]..=planes[1]).contains(&a[2]) {
                take(a[0], a[1]);
            }
            for b in &corners[index + 1..] {
                for z in planes {
                    if (a[2] < z) != (b[2] < z) {
                        let share = ((z - a[2]) / (b[2] - a[2])).clamp(0.0, 1.0);
                        take(a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]));
                    }
                }
            }
        }
        if !clear {
            return [0, all];
        }
        // Exact for both kinds of probe: the direction, at unit distance ahead of the apex.
        let line = |toward: f64| self.grid.to_line_and_depth(toward, 1.0 - behind.unwrap_or(0.0)).0;
        const NEAR: f64 = 1e-6;
        let first = (line(low) - NEAR).ceil().clamp(0.0, f64::from(all)) as u32;
        let end = ((line(high) + NEAR).floor() + 1.0).clamp(f64::from(first), f64::from(all)) as u32;
        [first, end]
    }
}
