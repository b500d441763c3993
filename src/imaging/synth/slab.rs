//! Elements of a deforming mesh in the slab of a frame: those in which a sample of any scanline can lie.
//!
//! Only these are prepared. Nothing is carried over from one frame to the next but the positions of nodes that a frame
//! leaves out.

mod view;

use std::sync::Arc;

use nalgebra::Matrix4;
use view::{Projection, SlabView};

use super::FrameState;
use super::tables::Tables;
use insonify_base::parallel::{chunks, chunks_mut, for_each};
use insonify_base::real::Real;
use insonify_base::simd::{Kernel, Pack, map, vectorised};
use insonify_mesh::element::{self, Carry, Frame};
use insonify_mesh::lists::Lists;
use insonify_mesh::{InvalidMesh, TetMesh, check_positions};

/// Number of elements that one task tests against the slab: fewer are not worth waking a thread.
const TESTED: usize = 65_536;

/// Number of elements that one task prepares.
const PREPARED: usize = 2048;

/// Number of consecutive elements whose common bounding box is tested first: most meshes number neighbours in sequence.
const BLOCK: usize = 32;

/// Number of lanes: elements prepared at once.
const LANES: usize = 8;

/// Elements of one state of the mesh that cross the slab, ascending; an element's place in these lists is its slot.
#[derive(Debug)]
pub struct Crossing<T> {
    /// Number of each in the mesh.
    pub elements: Vec<u32>,
    /// Elements that each task keeps, at the start of its [`TESTED`] places.
    kept: Vec<u32>,
    /// Number of elements that each task keeps.
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
            kept: vec![0; capacity],
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

    /// Finds and prepares the elements of a state whose nodes are at `nodes` (mm) and, in the probe frame, at
    /// `in_probe`.
    fn cut(
        &mut self,
        view: &SlabView,
        mesh: &TetMesh,
        blocks: &Lists,
        in_probe: &[Vec<f64>; 3],
        nodes: &[[T; 3]],
        reference: &[[f64; 3]],
    ) {
        let elements = mesh.elements();
        let test = |(task, kept, count): (usize, &mut [u32], &mut usize)| {
            *count = 0;
            let first = task * TESTED;
            let of_task = &elements[first..first + kept.len()];
            for (block, corners) in (first / BLOCK..).zip(of_task.chunks(BLOCK)) {
                if !view.meets(in_probe, blocks.get(block as u32)) {
                    continue;
                }
                for (element, corners) in (block * BLOCK..).zip(corners) {
                    if view.meets(in_probe, corners) {
                        kept[*count] = element as u32;
                        *count += 1;
                    }
                }
            }
        };
        match &mut self.counts[..] {
            [count] => test((0, &mut self.kept, count)),
            counts => for_each((0.., chunks_mut(&mut self.kept, TESTED), counts), &test),
        }
        // Joined in the order of the tasks, the elements ascend whichever task ends first.
        self.elements.clear();
        for (kept, &count) in self.kept.chunks(TESTED).zip(&self.counts) {
            self.elements.extend_from_slice(&kept[..count]);
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
            T::vectorised(Preparation {
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
        let rows = (
            chunks(elements, PREPARED),
            chunks_mut(frames, PREPARED),
            chunks_mut(carries, PREPARED),
            chunks_mut(lines, PREPARED),
        );
        for_each(rows, &prepare);
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

/// None, one or both of the states of a mesh.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct States {
    /// The deformed state.
    pub deformed: bool,
    /// The reference state.
    pub reference: bool,
}

impl States {
    /// Both states.
    pub(crate) const BOTH: Self = Self {
        deformed: true,
        reference: true,
    };
}

/// Nodes of the reference state, mm, in double precision and in that of a backend.
#[derive(Clone, Debug)]
struct AtRest<T> {
    nodes: Vec<[f64; 3]>,
    rounded: Vec<[T; 3]>,
}

/// Elements of a mesh in the slab of a frame, in its deformed and in its reference state.
#[derive(Debug)]
pub struct Slab<T> {
    mesh: Arc<TetMesh>,
    /// Nodes of each block of [`BLOCK`] elements, each once.
    blocks: Arc<Lists>,
    /// Nodes of the deformed state, mm.
    current: Vec<[T; 3]>,
    /// Nodes of the reference state, shared with the slabs that have taken them over.
    at_rest: Arc<AtRest<T>>,
    /// States whose nodes have moved since they were cut.
    moved: States,
    /// Positions in the frame of the probe, by axis.
    in_probe: [Vec<f64>; 3],
    /// Probe pose of the last frame; `None` before the first and after a change of settings.
    pose: Option<Matrix4<f64>>,
    /// Elements of the deformed state.
    pub deformed: Crossing<T>,
    /// Elements of the reference state; their maps to the reference state are the identity.
    pub reference: Crossing<T>,
    /// Starts of the maps in the buffer of element maps on a GPU, in vec4: of the reference elements, and of the
    /// deformed ones, to barycentric coordinates and to the reference state.
    pub maps_at: [u32; 3],
}

impl<T: Real> Slab<T> {
    /// Memory for the elements of a mesh at rest; nothing is cut yet.
    pub fn new(mesh: &Arc<TetMesh>) -> Self {
        let count = mesh.elements().len();
        let nodes: Vec<_> = mesh.nodes().iter().map(|node| node.map(T::of)).collect();
        Self {
            current: nodes.clone(),
            at_rest: Arc::new(AtRest {
                nodes: mesh.nodes().to_vec(),
                rounded: nodes,
            }),
            moved: States::default(),
            in_probe: std::array::from_fn(|_| vec![0.0; mesh.nodes().len()]),
            pose: None,
            deformed: Crossing::new(count),
            reference: Crossing::new(count),
            maps_at: [0; 3],
            blocks: Arc::new(blocks(mesh.elements())),
            mesh: Arc::clone(mesh),
        }
    }

    /// Memory for another slab of the same mesh, whose nodes lie as in this one; nothing is cut yet.
    pub fn new_for_same_mesh(&self) -> Self {
        let count = self.mesh.elements().len();
        Self {
            mesh: Arc::clone(&self.mesh),
            blocks: Arc::clone(&self.blocks),
            current: self.current.clone(),
            at_rest: Arc::clone(&self.at_rest),
            moved: States::default(),
            in_probe: self.in_probe.clone(),
            pose: None,
            deformed: Crossing::new(count),
            reference: Crossing::new(count),
            maps_at: [0; 3],
        }
    }

    /// Cuts again at the next frame: the probe has changed.
    pub fn invalidate(&mut self) {
        self.pose = None;
    }

    /// Moves the nodes to the state of a frame and cuts what has changed: [`Self::move_nodes`] and [`Self::cut`].
    pub fn update(&mut self, tables: &Tables, state: &FrameState) -> Result<States, InvalidMesh> {
        self.move_nodes(state)?;
        Ok(self.cut(tables, &state.probe_to_world))
    }

    /// Moves the nodes to the state of a frame. Nodes that are NaN or infinite are permitted: their elements hold no
    /// sample.
    ///
    /// # Errors
    /// [`InvalidMesh`] if the number of positions is not that of the mesh; nothing is changed then.
    pub fn move_nodes(&mut self, state: &FrameState) -> Result<(), InvalidMesh> {
        let (current, reference) = (state.nodes.as_deref(), state.reference.as_deref());
        check_positions(current, reference, self.current.len())?;
        if let Some(nodes) = current {
            T::vectorised(Rounding(nodes, &mut self.current));
            self.moved.deformed = true;
        }
        if let Some(nodes) = reference.filter(|nodes| *nodes != self.at_rest.nodes) {
            let at_rest = Arc::make_mut(&mut self.at_rest);
            at_rest.nodes.copy_from_slice(nodes);
            T::vectorised(Rounding(nodes, &mut at_rest.rounded));
            self.moved.reference = true;
        }
        Ok(())
    }

    /// Takes over the nodes of another slab of the same mesh, of the states named.
    pub fn copy_states_from(&mut self, other: &Self, states: States) {
        if states.deformed && self.current != other.current {
            self.current.copy_from_slice(&other.current);
            self.moved.deformed = true;
        }
        if states.reference && !Arc::ptr_eq(&self.at_rest, &other.at_rest) {
            self.at_rest = Arc::clone(&other.at_rest);
            self.moved.reference = true;
        }
    }

    /// Whether the elements of the reference state are those of another slab of the same mesh.
    #[cfg(feature = "gpu")]
    pub(crate) fn has_reference_of(&self, other: &Self) -> bool {
        self.pose == other.pose && Arc::ptr_eq(&self.at_rest, &other.at_rest)
    }

    /// Cuts the states that have changed since the last frame, and returns which.
    pub fn cut(&mut self, tables: &Tables, probe_to_world: &Matrix4<f64>) -> States {
        let posed = self.pose.replace(*probe_to_world) != Some(*probe_to_world);
        let nodes = std::mem::take(&mut self.moved);
        let moved = States {
            deformed: posed || nodes.deformed || nodes.reference,
            reference: posed || nodes.reference,
        };
        let view = SlabView::new::<T>(tables, probe_to_world);
        let states = [
            (moved.deformed, &self.current, &mut self.deformed),
            (moved.reference, &self.at_rest.rounded, &mut self.reference),
        ];
        for (_, nodes, crossing) in states.into_iter().filter(|(moved, ..)| *moved) {
            vectorised(Projection(&view, nodes, &mut self.in_probe));
            crossing.cut(
                &view,
                &self.mesh,
                &self.blocks,
                &self.in_probe,
                nodes,
                &self.at_rest.nodes,
            );
        }
        moved
    }

    /// Sorts the elements by scanline, as the CPU reads them.
    pub(crate) fn sort_by_line(&mut self, lines: usize) {
        self.deformed.sort_by_line(lines);
        self.reference.sort_by_line(lines);
    }
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
