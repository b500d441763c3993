//! Elements of a deforming mesh in the slab of a frame: those in which a sample of any scanline of any sub-plane can lie.
//!
//! Only these are prepared. Nothing is carried over from one frame to the next but the
//! positions of nodes that a frame leaves out.

use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;

use nalgebra::Matrix4;
use rayon::prelude::*;

use super::FrameState;
use super::tables::Tables;
use crate::base::real::Real;
use crate::base::simd::{Kernel, Pack, array, map, vectorised};
use crate::imaging::effects::common::plane_step;
use crate::mechanics::lists::Lists;
use crate::mechanics::mesh::element::{self, Carry, Frame, MAX_REACH};
use crate::mechanics::mesh::{InvalidMesh, TetMesh, check_positions};
use crate::tracking::probe::BeamGrid;

/// Number of elements that one task tests against the slab: fewer are not worth waking a thread.
const TESTED: usize = 65_536;

/// Number of elements that one task prepares.
const PREPARED: usize = 2048;

/// Number of consecutive elements whose common bounding box is tested first: most meshes number neighbours in sequence.
const BLOCK: usize = 32;

/// Number of lanes: elements prepared at once.
const LANES: usize = 8;

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

    /// Finds and prepares the elements of a state whose nodes are at `nodes` (mm) and, in the probe frame, at `in_probe`.
    fn cut(
        &mut self,
        view: &SlabView,
        mesh: &TetMesh,
        blocks: &Lists,
        in_probe: &[Vec<f64>; 3],
        nodes: &[[T; 3]],
        reference: &[[f64; 3]],
    ) {
        let all = mesh.elements();
        let test = |(task, (found, count)): (usize, (&mut [u32], &mut usize))| {
            *count = 0;
            let first = task * TESTED;
            let of_task = &all[first..first + found.len()];
            for (block, corners) in (first / BLOCK..).zip(of_task.chunks(BLOCK)) {
                if !view.meets(in_probe, blocks.of(block as u32)) {
                    continue;
                }
                for (element, corners) in (block * BLOCK..).zip(corners) {
                    if view.meets(in_probe, corners) {
                        found[*count] = element as u32;
                        *count += 1;
                    }
                }
            }
        };
        match &mut self.counts[..] {
            [count] => test((0, (&mut self.found, count))),
            counts => (self.found.par_chunks_mut(TESTED), counts)
                .into_par_iter()
                .enumerate()
                .for_each(test),
        }
        self.elements.clear();
        for (found, &count) in self.found.chunks(TESTED).zip(&self.counts) {
            self.elements.extend_from_slice(&found[..count]);
        }
        self.frames.resize(self.elements.len(), Default::default());
        self.carries.resize(self.elements.len(), Default::default());
        self.lines.resize(self.elements.len(), Default::default());
        let parts = (
            &self.elements[..],
            &mut self.frames[..],
            &mut self.carries[..],
            &mut self.lines[..],
        );
        let prepare = |(elements, frames, carries, lines)| {
            vectorised(Preparation {
                view,
                mesh,
                in_probe,
                nodes,
                reference,
                elements,
                frames,
                carries,
                lines,
            });
        };
        if self.elements.len() <= PREPARED {
            return prepare(parts);
        }
        let (elements, frames, carries, lines) = parts;
        let chunks = (
            elements.par_chunks(PREPARED),
            frames.par_chunks_mut(PREPARED),
            carries.par_chunks_mut(PREPARED),
            lines.par_chunks_mut(PREPARED),
        );
        chunks.into_par_iter().for_each(prepare);
    }
}

/// Nodes of each block of elements, each once.
fn blocks(elements: &[[u32; 4]]) -> Lists {
    let pairs = elements.chunks(BLOCK).zip(0..).flat_map(|(elements, block)| {
        let mut nodes = elements.as_flattened().to_vec();
        nodes.sort_unstable();
        nodes.dedup();
        nodes.into_iter().map(move |node| (block, node))
    });
    Lists::new(elements.len().div_ceil(BLOCK), pairs)
}

/// Preparation of some elements.
struct Preparation<'a, T> {
    view: &'a SlabView<'a>,
    mesh: &'a TetMesh,
    in_probe: &'a [Vec<f64>; 3],
    nodes: &'a [[T; 3]],
    reference: &'a [[f64; 3]],
    elements: &'a [u32],
    frames: &'a mut [Frame<T>],
    carries: &'a mut [Carry<T>],
    lines: &'a mut [[u32; 2]],
}

impl<T: Real> Kernel for Preparation<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for (group, elements) in self.elements.chunks(LANES).enumerate() {
            let mut current = [[[T::zero(); LANES]; 3]; 4];
            let mut reference = [[Pack::splat(0.0); 3]; 4];
            let mut in_probe = reference;
            for (lane, &element) in elements.iter().enumerate() {
                for (corner, &node) in self.mesh.elements()[element as usize].iter().enumerate() {
                    let node = node as usize;
                    for axis in 0..3 {
                        current[corner][axis][lane] = self.nodes[node][axis];
                        reference[corner][axis].0[lane] = self.reference[node][axis];
                        in_probe[corner][axis].0[lane] = self.in_probe[axis][node];
                    }
                }
            }
            let prepared = element::prepare_lanes(&current, &reference);
            let lines = self.view.lines(&in_probe, Pack(map(prepared.reach, T::wide)));
            for lane in 0..elements.len() {
                let index = group * LANES + lane;
                let lines = if element::is_hit(prepared.kind[lane]) {
                    lines[lane]
                } else {
                    [0; 2]
                };
                let (mut frame, carry) = prepared.of_lane(lane);
                frame[1][3] = T::of(f64::from(lines[0]));
                frame[3][3] = T::of(f64::from(lines[1]));
                (self.frames[index], self.carries[index], self.lines[index]) = (frame, carry, lines);
            }
        }
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
    /// Nodes of each block of [`BLOCK`] elements, each once.
    blocks: Lists,
    /// Nodes of the deformed and of the reference state, mm.
    current: Vec<[T; 3]>,
    at_rest: Vec<[T; 3]>,
    reference_nodes: Vec<[f64; 3]>,
    /// Positions in the frame of the probe, by axis.
    in_probe: [Vec<f64>; 3],
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
        let nodes: Vec<_> = mesh.nodes().iter().map(|node| node.map(T::of)).collect();
        Self {
            current: nodes.clone(),
            at_rest: nodes,
            reference_nodes: mesh.nodes().to_vec(),
            in_probe: std::array::from_fn(|_| vec![0.0; mesh.nodes().len()]),
            pose: None,
            deformed: Crossing::new(count),
            reference: Crossing::new(count),
            maps_at: [0; 3],
            blocks: blocks(mesh.elements()),
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
            vectorised(Rounding(nodes, &mut self.current));
        }
        if let Some(nodes) = reference {
            self.reference_nodes.copy_from_slice(nodes);
            vectorised(Rounding(nodes, &mut self.at_rest));
        }
        let posed = self.pose.replace(state.probe_to_world) != Some(state.probe_to_world);
        let moved = Moved {
            deformed: posed || current.is_some() || reference.is_some(),
            reference: posed || reference.is_some(),
        };
        let view = SlabView::new::<T>(tables, &state.probe_to_world);
        let states = [
            (moved.deformed, &self.current, &mut self.deformed),
            (moved.reference, &self.at_rest, &mut self.reference),
        ];
        for (_, nodes, crossing) in states.into_iter().filter(|(moved, ..)| *moved) {
            vectorised(Projection(&view, nodes, &mut self.in_probe));
            crossing.cut(
                &view,
                &self.mesh,
                &self.blocks,
                &self.in_probe,
                nodes,
                &self.reference_nodes,
            );
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

    /// Whether the box of the nodes of an element, grown by what may test as inside, meets that of the samples. If the box of several elements
    /// does not, none of theirs does. Nodes that are NaN do not count.
    #[inline(always)]
    fn meets(&self, in_probe: &[Vec<f64>; 3], nodes: &[u32]) -> bool {
        // Most elements lie beside the plane.
        [2, 0, 1].into_iter().all(|axis| {
            let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
            for &node in nodes {
                let at = in_probe[axis][node as usize];
                low = if at < low { at } else { low };
                high = if at > high { at } else { high };
            }
            let reach = MAX_REACH * (high - low) + self.margin;
            low - reach <= self.bounds[1][axis] && high + reach >= self.bounds[0][axis]
        })
    }

    /// First scanline that can meet each of several elements with these corners, grown by `reach` (mm in the world), and the one past the
    /// last.
    #[inline(always)]
    fn lines(&self, corners: &[[Pack<LANES>; 3]; 4], reach: Pack<LANES>) -> [[u32; 2]; LANES] {
        let all = self.grid.lines() as u32;
        if all == 1 {
            return [[0, 1]; LANES];
        }
        let margin = reach * self.scale + self.margin;
        let planes = [margin * -1.0 + self.bounds[0][2], margin + self.bounds[1][2]];
        let mut directions = Directions::new(self.grid.virtual_apex_mm(), margin);
        for (index, a) in corners.iter().enumerate() {
            directions.take((planes[0] - a[2]).max(a[2] - planes[1]), a[0], a[1]);
            for b in &corners[index + 1..] {
                let per_mm = Pack::splat(1.0) / (a[2] - b[2]);
                for z in planes {
                    let (from, to) = (a[2] - z, b[2] - z);
                    let share = (from * per_mm).max(Pack::splat(0.0)).min(Pack::splat(1.0));
                    // Edges with both ends on one side of the plane are left out.
                    directions.take(from * to, a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]));
                }
            }
        }
        let Directions {
            behind,
            low,
            high,
            clear,
            ..
        } = directions;
        let middle = f64::from(all - 1) / 2.0;
        let (low, high, per, near) = match behind {
            None => (low, high, self.grid.to_line_and_depth(1.0, 0.0).0 - middle, NEAR),
            Some(_) => {
                let per = 1.0 / self.grid.angular_spacing();
                (arctangent(low), arctangent(high), per, NEAR + ARCTANGENT_ERROR * per)
            }
        };
        let first = (low * per + (middle - near)).map(f64::ceil);
        let end = (high * per + (middle + near + 1.0)).map(f64::floor);
        array(|lane| {
            if behind.is_some() && clear.0[lane] <= 0.0 {
                return [0, all];
            }
            let first = first.0[lane].clamp(0.0, f64::from(all)) as u32;
            [first, end.0[lane].clamp(f64::from(first), f64::from(all)) as u32]
        })
    }
}

/// Interval of the directions of points, each widened by a margin.
struct Directions {
    /// Distance of the apex in which scanlines meet, at (0, -behind), if they are not parallel.
    behind: Option<f64>,
    margin: Pack<LANES>,
    low: Pack<LANES>,
    high: Pack<LANES>,
    /// Least distance of the points in front of the apex less ten margins, mm: not above 0, directions are undefined.
    clear: Pack<LANES>,
}

impl Directions {
    #[inline(always)]
    fn new(behind: Option<f64>, margin: Pack<LANES>) -> Self {
        let none = Pack::splat(f64::INFINITY);
        Self {
            behind,
            margin,
            low: none,
            high: none * -1.0,
            clear: none,
        }
    }

    /// Takes points at x and y, in the direction x / (y + behind), except where `left_out` is above 0.
    #[inline(always)]
    fn take(&mut self, left_out: Pack<LANES>, x: Pack<LANES>, y: Pack<LANES>) {
        let (zero, none) = (Pack::splat(0.0), Pack::splat(f64::INFINITY));
        let (toward, margin) = match self.behind {
            None => (x, self.margin),
            Some(behind) => {
                let ahead = y + behind;
                let clear = ahead - self.margin * 10.0;
                self.clear = self.clear.min(zero.if_below(left_out, none, clear));
                let per_mm = Pack::splat(1.0) / ahead;
                let toward = x * per_mm;
                // Over `ahead - margin`, which is at least 0.9 of `ahead`.
                (toward, self.margin * (toward.abs() + 1.0) * per_mm * (1.0 / 0.9))
            }
        };
        self.low = self.low.min(zero.if_below(left_out, none, toward - margin));
        self.high = self.high.max(zero.if_below(left_out, none * -1.0, toward + margin));
    }
}

/// Rounding of a scanline, in scanlines.
const NEAR: f64 = 1e-6;

/// Error of [`arctangent`], radians.
const ARCTANGENT_ERROR: f64 = 1.2e-5;

/// Arctangents within [`ARCTANGENT_ERROR`] (Abramowitz and Stegun 1964, 4.4.49).
#[inline(always)]
fn arctangent(of: Pack<LANES>) -> Pack<LANES> {
    let one = Pack::splat(1.0);
    let size = of.abs();
    let x = size.min(one) / size.max(one);
    let square = x * x;
    let polynomial =
        (((square * 0.020_835_1 - 0.085_133) * square + 0.180_141) * square - 0.330_299_5) * square + 0.999_866;
    let angle = polynomial * x;
    let angle = one.if_below(size, Pack::splat(FRAC_PI_2) - angle, angle);
    Pack(array(|lane| angle.0[lane].copysign(of.0[lane])))
}

/// Positions of nodes in the precision of a backend.
struct Rounding<'a, T>(&'a [[f64; 3]], &'a mut [[T; 3]]);

impl<T: Real> Kernel for Rounding<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for (rounded, &value) in self.1.as_flattened_mut().iter_mut().zip(self.0.as_flattened()) {
            *rounded = T::of(value);
        }
    }
}

/// Positions of nodes in the frame of the probe.
struct Projection<'a, T>(&'a SlabView<'a>, &'a [[T; 3]], &'a mut [Vec<f64>; 3]);

impl<T: Real> Kernel for Projection<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self(view, nodes, in_probe) = self;
        for (row, along) in view.to_probe.iter().zip(in_probe) {
            for (along, &node) in along.iter_mut().zip(nodes) {
                let [x, y, z] = map(node, T::wide);
                *along = row[0] * x + row[1] * y + row[2] * z + row[3];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arctangents_are_within_their_error() {
        let numbers = (-400..=400i32).map(|k| f64::from(k).powi(3) * 1e-5);
        for number in numbers.chain([f64::INFINITY, f64::NEG_INFINITY]) {
            let found = arctangent(Pack::splat(number)).0;
            let error = (found[LANES - 1] - number.atan()).abs();
            assert!(error < ARCTANGENT_ERROR, "{number}: {error}");
        }
    }
}
