//! Working memory of the CPU backend: one vector per resource of the plan, empty for unused resources.

use super::tables::Tables;
use crate::effects::needle::{MAX_SEGMENTS, Segment};
use crate::effects::pass::Resource;
use crate::effects::shadow::aperture::RAYS;
use crate::mechanics::mesh::map::States;
use crate::plan::Plan;
use crate::real::Real;

/// Vectors that passes read and write, scanline by scanline. See [`Resource`] for the contents of each.
#[derive(Debug, Default)]
pub struct Store<T> {
    /// Data of [`Resource::Position`].
    pub position: Vec<[T; 4]>,
    /// Data of [`Resource::Gaps`].
    pub gaps: Vec<f64>,
    /// Data of [`Resource::Element`].
    pub element: Vec<u32>,
    /// Deformed and reference state of the mesh.
    pub states: Option<States<T>>,
    /// Data of [`Resource::Label`], one byte each.
    pub label: Vec<u8>,
    /// Data of [`Resource::Amplitude`].
    pub amplitude: Vec<T>,
    /// Data of [`Resource::AmplitudeNext`].
    pub amplitude_next: Vec<T>,
    /// Data of [`Resource::Specular`].
    pub specular: Vec<[T; 2]>,
    /// Data of [`Resource::Scatter`]: for each fine scanline its real parts, then its imaginary parts.
    pub scatter: Vec<T>,
    /// Data of [`Resource::ScatterAxial`]: for each fine scanline its real parts, then its imaginary parts.
    pub scatter_axial: Vec<T>,
    /// Data of [`Resource::Needle`].
    pub segments: Vec<Segment<f64>>,
    /// Data of [`Resource::NeedleMask`].
    pub needle_mask: Vec<[T; 2]>,
    /// Data of [`Resource::Loss`].
    pub loss: Vec<u32>,
    /// Data of [`Resource::Through`].
    pub through: Vec<T>,
    /// Data of [`Resource::Reflectors`].
    pub reflectors: Vec<u32>,
    /// Data of [`Resource::AutoGain`], interpolated from the bands to each sample depth.
    pub auto_gain: Vec<T>,
    /// Data of [`Resource::Image`].
    pub image: Vec<T>,
    /// Data of [`Resource::Pixels`], one byte each.
    pub pixels: Vec<u8>,
}

impl<T: Real> Store<T> {
    /// Allocates memory for every resource of the plan and frees that of the others. Vectors of the right size are
    /// kept.
    pub fn fit(&mut self, plan: &Plan, tables: &Tables) {
        let beam = tables.lines() * tables.samples();
        let pixels = tables.width() * tables.height();
        let fine = tables
            .speckle
            .as_ref()
            .map_or(0, |speckle| 2 * speckle.fine_lines(tables.lines()) * tables.samples());
        let count = |resource: Resource, n: usize| if plan.uses(resource) { n } else { 0 };
        let all = beam * tables.planes();
        resize(&mut self.position, count(Resource::Position, all), [T::zero(); 4]);
        resize(&mut self.element, count(Resource::Element, all), u32::MAX);
        resize(&mut self.label, count(Resource::Label, all), 0);
        resize(&mut self.amplitude, count(Resource::Amplitude, all), T::zero());
        resize(&mut self.amplitude_next, count(Resource::AmplitudeNext, all), T::zero());
        resize(&mut self.specular, count(Resource::Specular, beam), [T::zero(); 2]);
        resize(&mut self.scatter, count(Resource::Scatter, fine), T::zero());
        resize(&mut self.scatter_axial, count(Resource::ScatterAxial, fine), T::zero());
        resize(&mut self.needle_mask, count(Resource::NeedleMask, beam), [T::zero(); 2]);
        resize(&mut self.loss, count(Resource::Loss, beam), 0);
        resize(&mut self.through, count(Resource::Through, RAYS * beam), T::zero());
        resize(&mut self.reflectors, count(Resource::Reflectors, tables.lines()), 0);
        resize(
            &mut self.auto_gain,
            count(Resource::AutoGain, tables.samples()),
            T::zero(),
        );
        resize(&mut self.image, count(Resource::Image, pixels), T::zero());
        resize(&mut self.pixels, count(Resource::Pixels, pixels), 0);
        if self.segments.capacity() != count(Resource::Needle, MAX_SEGMENTS) {
            self.segments = Vec::with_capacity(count(Resource::Needle, MAX_SEGMENTS));
        }
        match (&tables.mesh, plan.uses(Resource::Element)) {
            (Some(mesh), true) if self.states.is_none() => self.states = Some(States::new(mesh)),
            (Some(_), true) => {}
            _ => self.states = None,
        }
    }

    /// Memory in use, bytes.
    pub fn bytes(&self) -> usize {
        let scalars = self.amplitude.capacity()
            + self.amplitude_next.capacity()
            + self.scatter.capacity()
            + self.scatter_axial.capacity()
            + self.through.capacity()
            + 2 * (self.needle_mask.capacity() + self.specular.capacity())
            + self.auto_gain.capacity()
            + self.image.capacity();
        scalars * size_of::<T>()
            + self.position.capacity() * size_of::<[T; 4]>()
            + (self.element.capacity() + self.loss.capacity() + self.reflectors.capacity()) * size_of::<u32>()
            + self.label.capacity()
            + self.pixels.capacity()
            + self.segments.capacity() * size_of::<Segment<f64>>()
    }
}

fn resize<V: Clone>(vector: &mut Vec<V>, len: usize, fill: V) {
    if vector.len() != len {
        *vector = vec![fill; len];
    }
}
