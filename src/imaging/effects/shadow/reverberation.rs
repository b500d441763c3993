//! Reverberation: repeated echoes between the first bone, gas or lung of a scanline and the face of the array.
//!
//! An echo from depth z appears again at z + d, z + 2 d, ..., where d is the depth of the reflector: the A-lines of
//! lung, and the haze of tissue above it in the shadow of gas. Each repeat is attenuated over the path to the reflector
//! and back, multiplied by [`Shadow::reverberation`], by the reflection coefficient of the reflector (0.99 for gas,
//! 0.65 for bone) and, for a reflector tilted by theta, by cos^4 theta (the law of
//! [`interface`](crate::effects::interface)) and cos^4 2 theta (the angle at which it returns to the array). Powers are
//! added, as the phases over such long paths are random. A lung's A-lines: D. Lichtenstein et al., Intensive Care Med.
//! 24 (1998) 1331.

use super::{Shadow, exponent_per_unit, penumbra};
use crate::effects::common::spacing;
use crate::effects::pass::View;
use crate::synth::store::Store;
use crate::synth::tables::Tables;
use insonify_base::parallel::{chunks_mut, for_each};
use insonify_base::real::Real;

/// Number of scanlines to either side from which the tilt of a reflector is estimated.
pub const SIDE: usize = 6;

/// Whether echoes are repeated: the volume contains an opaque tissue.
pub fn repeats(tables: &Tables) -> bool {
    let shadow = tables.settings.effects.shadow.as_ref();
    let opaque = penumbra::opaque_units(tables.sample_mm());
    let mut rows = tables.label_rows.iter().enumerate();
    shadow.is_some_and(|shadow| shadow.reverberation > 0.0)
        && rows.any(|(index, row)| row.loss >= opaque && tables.volume.holds(index))
}

/// First opaque sample of a scanline below non-opaque ones; the number of samples if there is none.
pub fn top(labels: &[u8], is_opaque: impl Fn(u8) -> bool) -> u32 {
    let first = labels
        .iter()
        .position(|label| is_opaque(*label))
        .filter(|first| *first > 0);
    first.unwrap_or(labels.len()) as u32
}

/// Directivity of a repeat: factor on the amplitude for the tilt of the reflector, from its depths in samples.
pub(crate) fn directivity<T: Real>(tops: &[u32], line: usize, samples: usize, spacing: [T; 2]) -> T {
    let slope = slope(tops, line, samples, spacing);
    let square = slope * slope;
    let cos2 = T::one() / (T::one() + square);
    let twice = ((T::one() - square) * cos2).max(T::zero());
    cos2 * cos2 * twice * twice * twice * twice
}

/// Tangent of the tilt of a reflector, positive where it lies deeper on later scanlines; 0 where no neighbour has one.
#[inline(always)]
pub fn slope<T: Real>(tops: &[u32], line: usize, samples: usize, spacing: [T; 2]) -> T {
    let first = line.saturating_sub(SIDE);
    let last = (line + SIDE).min(tops.len() - 1);
    let known = |other: usize| if (tops[other] as usize) < samples { other } else { line };
    let (first, last) = (known(first), known(last));
    if first == last {
        return T::zero();
    }
    let number = |n: u32| T::of(f64::from(n));
    let across = number((last - first) as u32) * (spacing[0] + spacing[1] * number(tops[line]));
    (number(tops[last]) - number(tops[first])) / across
}

/// Finds the reflector of each scanline.
pub(super) fn reflectors<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let opaque = penumbra::opaque_units(tables.sample_mm());
    let is_opaque = |label: u8| {
        tables
            .label_rows
            .get(usize::from(label))
            .is_some_and(|row| row.loss >= opaque)
    };
    let lines = store.label.chunks(tables.samples());
    for (reflector, labels) in store.effects.shadow.reflectors.iter_mut().zip(lines) {
        *reflector = top(labels, is_opaque);
    }
}

/// Adds the repeats of each scanline.
pub(super) fn run<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let (lines, samples) = (tables.lines(), tables.samples());
    let share = T::of(share(tables));
    let spacing = spacing(tables).map(T::of);
    let exponent = T::of(exponent_per_unit());
    let (tops, losses, labels) = (&store.effects.shadow.reflectors, &store.loss, &store.label);
    let scanlines = chunks_mut(&mut store.amplitude[..lines * samples], samples);
    for_each((0.., scanlines), &|(line, amplitudes)| {
        let top = tops[line] as usize;
        if top >= samples {
            return;
        }
        let above = T::of(f64::from(losses[line * samples + top - 1]));
        let index = line * samples + top;
        let reflected = T::of(reflection(tables, [labels[index - 1], labels[index]]));
        let gain = share * reflected * (above * exponent).exp2() * directivity(tops, line, samples, spacing);
        for sample in top..samples {
            let (echo, repeat) = (amplitudes[sample], gain * amplitudes[sample - top]);
            amplitudes[sample] = (echo * echo + repeat * repeat).sqrt();
        }
    });
}

/// Reflection coefficient of the surface between two labels.
pub(crate) fn reflection(tables: &Tables, labels: [u8; 2]) -> f64 {
    let [above, below] = labels.map(|label| &tables.label_rows[usize::from(label)]);
    above.reflection(below)
}

/// Amplitude of a repeat relative to the echo, before attenuation and reflection; 0 without a shadow.
pub fn share(tables: &Tables) -> f64 {
    tables
        .settings
        .effects
        .shadow
        .as_ref()
        .map_or(0.0, |shadow: &Shadow| shadow.reverberation)
}
