//! Working memory of the CPU backend: one vector per buffer that passes write, empty for those that a plan does not
//! use.

use super::slab::Slab;
use super::tables::Tables;
use crate::effects::EffectColumns;
use crate::effects::buffers::{
    AMPLITUDE, AMPLITUDE_NEXT, Buffer, ELEMENT, IMAGE, LABEL, LOSS, NEEDLE_MASK, PIXELS, POSITION, SPECULAR, beam,
};
use crate::plan::Plan;
use insonify_base::real::Real;

/// Vectors that passes read and write, scanline by scanline. See their [`Buffer`] for the contents of each.
#[derive(Debug, Default)]
pub struct Store<T> {
    /// Data of [`POSITION`].
    pub position: Vec<[T; 4]>,
    /// Data of [`ELEMENT`].
    pub element: Vec<u32>,
    /// Elements of the mesh in the slab of the frame.
    pub slab: Option<Slab<T>>,
    /// Data of `LABEL`, one byte each.
    pub label: Vec<u8>,
    /// Data of [`AMPLITUDE`].
    pub amplitude: Vec<T>,
    /// Data of `AMPLITUDE_NEXT`.
    pub amplitude_next: Vec<T>,
    /// Data of `SPECULAR`.
    pub specular: Vec<[T; 2]>,
    /// Data of `NEEDLE_MASK`.
    pub needle_mask: Vec<[T; 2]>,
    /// Data of [`LOSS`].
    pub loss: Vec<u32>,
    /// Data of [`IMAGE`].
    pub image: Vec<T>,
    /// Data of [`PIXELS`], one byte each.
    pub pixels: Vec<u8>,
    /// Vectors of one effect alone.
    pub effects: EffectColumns<T>,
}

impl<T: Real> Store<T> {
    /// Allocates memory for every buffer of the plan and frees that of the others. Vectors of the right size are
    /// kept.
    pub fn fit(&mut self, plan: &Plan, tables: &Tables) {
        let beam = beam(tables);
        let pixels = tables.width() * tables.height();
        let count = |buffer: &Buffer, n: usize| if plan.uses(buffer) { n } else { 0 };
        resize(&mut self.position, count(&POSITION, beam), [T::zero(); 4]);
        resize(&mut self.element, count(&ELEMENT, beam), u32::MAX);
        resize(&mut self.label, count(&LABEL, beam), 0);
        resize(&mut self.amplitude, count(&AMPLITUDE, beam), T::zero());
        resize(&mut self.amplitude_next, count(&AMPLITUDE_NEXT, beam), T::zero());
        resize(&mut self.specular, count(&SPECULAR, beam), [T::zero(); 2]);
        resize(&mut self.needle_mask, count(&NEEDLE_MASK, beam), [T::zero(); 2]);
        resize(&mut self.loss, count(&LOSS, beam), 0);
        resize(&mut self.image, count(&IMAGE, pixels), T::zero());
        resize(&mut self.pixels, count(&PIXELS, pixels), 0);
        self.effects.fit(plan, tables);
        match &tables.mesh {
            Some(mesh) if plan.uses(&ELEMENT) => self.slab.get_or_insert_with(|| Slab::new(mesh)).invalidate(),
            _ => self.slab = None,
        }
    }

    /// Swaps the buffers of the amplitude after a pass that flips them.
    pub fn flip(&mut self) {
        std::mem::swap(&mut self.amplitude, &mut self.amplitude_next);
    }

    /// Memory in use, bytes.
    pub fn bytes(&self) -> usize {
        let scalars = self.amplitude.capacity()
            + self.amplitude_next.capacity()
            + 2 * (self.needle_mask.capacity() + self.specular.capacity())
            + 4 * self.position.capacity()
            + self.image.capacity();
        scalars * size_of::<T>()
            + (self.element.capacity() + self.loss.capacity()) * size_of::<u32>()
            + self.label.capacity()
            + self.pixels.capacity()
            + self.effects.bytes()
    }
}

/// Makes a vector of a length, unless it has it.
pub fn resize<V: Clone>(vector: &mut Vec<V>, len: usize, fill: V) {
    if vector.len() != len {
        *vector = vec![fill; len];
    }
}
