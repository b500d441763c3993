//! B-lines: bright stripes that ring down from the surface of lung or gas to the end of the image.
//!
//! Where fluid is caught between bubbles of gas, sound rings in it for long and returns all the while: a stripe from the
//! surface on, as bright at every depth, in which no repeats are seen (D. Lichtenstein et al., Am. J. Respir. Crit. Care
//! Med. 156 (1997) 1640). Where they rise is a property of the tissue: with `n` a complex number of unit mean power,
//! smooth over [`STRIPE_MM`] and anchored in the tissue at the surface, the strength is `w = (|n|^2 + ln b) / RISE`,
//! at least 0 and at most 1. As `|n|^2` is distributed exponentially, it is above 0 on the share `b` of the surface. The
//! stripe has the amplitude `w RING m`, less the loss down to the surface and that of average soft tissue from there, with
//! `m` a ripple along the beam of unit mean power; echoes below the surface are left the share `1 - w`.

use super::{exponent_per_unit, mirror::is_gas};
use crate::effects::common::scatterers;
use crate::effects::pass::View;
use crate::synth::store::Store;
use crate::synth::tables::Tables;
use insonify_base::parallel::{chunks_mut, for_each};
use insonify_base::random::seed_words;
use insonify_base::real::Real;

/// Length over which the strength changes along the surface, mm: stripes are 1 to 3 mm wide. By eye.
pub(crate) const STRIPE_MM: f64 = 3.0;
/// Rise of `|n|^2` over which a stripe becomes full. By eye.
const RISE: f64 = 1.5;
/// Amplitude of a stripe relative to liver: 10 dB. By eye.
const RING: f64 = 3.162;
/// Length of the ripple along the beam, mm. By eye.
const RIPPLE_MM: f64 = 0.5;
/// Separates the lattice from that of other effects with the same seed.
const STREAM: u64 = 0xb11e_0b11 << 32;

/// Share of the surface from which stripes rise.
pub(crate) fn share(tables: &Tables) -> f64 {
    let shadow = tables.settings.effects.shadow.as_ref();
    shadow.map_or(0.0, |shadow| shadow.b_lines)
}

/// Whether there are B-lines: the scene asks for them and holds gas or lung.
pub(crate) fn ring(tables: &Tables) -> bool {
    share(tables) > 0.0 && super::mirror::holds_gas(tables)
}

/// Numbers of B-lines.
pub(crate) struct BLines<T> {
    /// Seed of the lattice.
    pub(crate) seed: [u32; 2],
    /// Points of the lattice per mm.
    pub(crate) per_mm: T,
    /// Points of the lattice of the ripple per sample.
    pub(crate) per_sample: T,
    /// `|n|^2` from which stripes rise.
    pub(crate) threshold: T,
    /// Strength per `|n|^2` above it.
    pub(crate) steepness: T,
    /// Amplitude relative to liver.
    pub(crate) ring: T,
}

impl<T: Real> BLines<T> {
    /// Numbers of a scene.
    pub(crate) fn of(tables: &Tables) -> Self {
        Self {
            seed: seed_words(tables.settings.seed ^ STREAM),
            per_mm: T::of(1.0 / STRIPE_MM),
            per_sample: T::of(tables.sample_mm() / RIPPLE_MM),
            threshold: T::of(-share(tables).max(f64::MIN_POSITIVE).ln()),
            steepness: T::of(1.0 / RISE),
            ring: T::of(RING),
        }
    }

    /// Place on the lattice of a reference position, mm.
    #[inline(always)]
    pub(crate) fn place(&self, [x, y, z, _]: [T; 4]) -> [T; 3] {
        [x * self.per_mm, y * self.per_mm, z * self.per_mm]
    }

    /// Strength of the stripe from a place of the surface, 0 to 1.
    #[inline(always)]
    pub(crate) fn strength(&self, place: [T; 3]) -> T {
        let ([re], [im]) = scatterers(&place.map(|x| [x]), self.seed);
        let above = (re * re + im * im - self.threshold) * self.steepness;
        above.max(T::zero()).min(T::one())
    }

    /// Ripple of the stripe at a number of samples below the surface.
    #[inline(always)]
    pub(crate) fn ripple(&self, [x, y, z]: [T; 3], below: usize) -> T {
        let along = x + T::from_signed(below as i32) * self.per_sample;
        let ([re], [im]) = scatterers(&[[along], [y], [z]], self.seed);
        (re * re + im * im).sqrt()
    }
}

/// Draws the stripes.
pub(super) fn run<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let (lines, samples) = (tables.lines(), tables.samples());
    let b_lines = BLines::<T>::of(tables);
    let left = tables.effects.shadow.left_of_average.of::<T>();
    let exponent = T::of(exponent_per_unit());
    let (tops, labels, losses) = (&store.effects.shadow.reflectors, &store.label, &store.loss);
    let positions = &store.position;
    let scanlines = chunks_mut(&mut store.amplitude[..lines * samples], samples);
    for_each((0.., scanlines), &|(line, amplitudes)| {
        let top = tops[line] as usize;
        let index = line * samples + top;
        if top >= samples || !is_gas(tables, labels[index]) {
            return;
        }
        let place = b_lines.place(positions[index]);
        let strength = b_lines.strength(place);
        if strength == T::zero() {
            return;
        }
        let above = (T::of(f64::from(losses[index - 1])) * exponent).exp2();
        let size = b_lines.ring * strength * above / left[top];
        for sample in top..samples {
            let stripe = size * left[sample] * b_lines.ripple(place, sample - top);
            let echo = amplitudes[sample] * (T::one() - strength);
            amplitudes[sample] = (echo * echo + stripe * stripe).sqrt();
        }
    });
}
