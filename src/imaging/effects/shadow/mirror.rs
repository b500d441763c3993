//! Mirror image: gas and lung reflect the beam into the tissue above them; its echoes return along the same path and
//! appear beyond the surface.
//!
//! The beam of a scanline is reflected at the first gas or lung by the law of reflection, within the scan plane and at
//! the tilt estimated by [`reverberation`](super::reverberation). A sample beyond the surface receives the echo at the
//! same path length along the reflected beam, multiplied by [`Shadow::mirror`](super::Shadow::mirror) and by the
//! attenuation of the extra path, at the mean rate down to the surface. The artefact: M. K. Feldman et al., RadioGraphics 29 (2009) 1179.

use super::reverberation::Surface;
use super::{exponent_per_unit, penumbra};
use crate::effects::common::spacing;
use crate::effects::pass::View;
use crate::synth::store::Store;
use crate::synth::tables::{LabelRow, Tables};
use insonify_base::parallel::{chunks_mut, for_each};
use insonify_base::real::Real;

/// Impedance below which an opaque tissue is gas or lung rather than bone, MRayl.
pub(crate) const GAS_MRAYL: f32 = 1.0;

/// Whether there are mirror images: the volume holds gas or lung.
pub(crate) fn mirrors(tables: &Tables) -> bool {
    share(tables) > 0.0 && holds_gas(tables)
}

/// Whether the volume holds gas or lung.
pub(crate) fn holds_gas(tables: &Tables) -> bool {
    let opaque = penumbra::opaque_units(tables.sample_mm());
    let mut rows = tables.label_rows.iter().enumerate();
    let is_gas = |row: &LabelRow| row.loss >= opaque && row.impedance < GAS_MRAYL;
    rows.any(|(index, row)| is_gas(row) && tables.volume.holds(index))
}

/// Whether an opaque label is gas or lung.
pub(crate) fn is_gas(tables: &Tables, label: u8) -> bool {
    let row = tables.label_rows.get(usize::from(label));
    row.is_some_and(|row| row.impedance < GAS_MRAYL)
}

/// Amplitude of a mirror image relative to the echo, before attenuation; 0 without a shadow.
pub fn share(tables: &Tables) -> f64 {
    tables
        .settings
        .effects
        .shadow
        .as_ref()
        .map_or(0.0, |shadow| shadow.mirror)
}

/// Mirror images of a frame.
pub struct Mirror<'a, T> {
    /// First opaque sample of each scanline, or the number of samples.
    pub tops: &'a [u32],
    /// Samples along a scanline.
    pub samples: usize,
    /// Distance between scanlines at the array and its growth per sample, in sample distances.
    pub spacing: [T; 2],
}

impl<T: Real> Mirror<'_, T> {
    /// Source of a sample beyond the surface: fractional scanline and sample, and the extra path length in sample
    /// distances.
    #[inline(always)]
    pub fn place(&self, line: usize, slope: T, sample: usize) -> [T; 3] {
        let number = |n: usize| T::of(n as f64);
        let (one, two, half) = (T::one(), T::of(2.0), T::of(0.5));
        let top = number(self.tops[line] as usize);
        let beyond = number(sample) + half - top;
        let cos2 = one / (one + slope * slope);
        let across = beyond * two * slope * cos2;
        let down = top + beyond * (one - two * cos2);
        let [spacing, spreading] = self.spacing;
        let [lines, depth] = if spreading > T::zero() {
            let apex = spacing / spreading;
            let ahead = apex + down;
            let radius = (across * across + ahead * ahead).sqrt();
            // Twice the arctangent of half the angle, by its Pade approximant: to 1e-5 up to 45 degrees, where images
            // end.
            let tangent = across / (radius + ahead).max(T::of(1e-6));
            let square = tangent * tangent;
            let angle = two * tangent * (T::of(15.0) + T::of(4.0) * square) / (T::of(15.0) + T::of(9.0) * square);
            [angle / spreading, radius - apex]
        } else {
            [across / spacing, down]
        };
        let longer = (number(sample) + half - depth).max(T::zero());
        [number(line) + lines, depth - half, longer]
    }

    /// Bilinear echo at a fractional scanline and sample; samples outside the image or below a surface count as 0.
    #[inline(always)]
    pub fn echo(&self, amplitudes: &[T], [line, sample]: [T; 2]) -> T {
        let (one, lines) = (T::one(), self.tops.len());
        if !(line > -one && sample > -one && line < T::of(lines as f64) && sample < T::of(self.samples as f64)) {
            return T::zero();
        }
        // Shifting by one keeps the truncation a floor.
        let [first_line, first] = [line, sample].map(|x| (x + one).truncate() - 1);
        let (across, along) = (line - T::from_signed(first_line), sample - T::from_signed(first));
        let amplitude = |line: i32, sample: i32| {
            let known =
                line >= 0 && (line as usize) < lines && sample >= 0 && (sample as u32) < self.tops[line as usize];
            if known {
                amplitudes[line as usize * self.samples + sample as usize]
            } else {
                T::zero()
            }
        };
        let along_line = |line: i32| (one - along) * amplitude(line, first) + along * amplitude(line, first + 1);
        (one - across) * along_line(first_line) + across * along_line(first_line + 1)
    }
}

/// Adds the mirror images, into the second buffer.
pub(super) fn run<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let (lines, samples) = (tables.lines(), tables.samples());
    let mirror = Mirror {
        tops: &store.effects.shadow.reflectors,
        samples,
        spacing: spacing(tables).map(T::of),
    };
    let share = T::of(share(tables));
    let surface = Surface::new(tables, &store.effects.shadow.reflectors);
    let exponent = T::of(exponent_per_unit());
    let (labels, losses) = (&store.label, &store.loss);
    let above = &store.amplitude[..lines * samples];
    let scanlines = chunks_mut(&mut store.amplitude_next[..lines * samples], samples);
    for_each((0.., scanlines), &|(line, amplitudes)| {
        amplitudes.copy_from_slice(&above[line * samples..][..samples]);
        let top = mirror.tops[line] as usize;
        // The first opaque sample may be bone, too, which is no mirror here.
        if top >= samples || !is_gas(tables, labels[line * samples + top]) {
            return;
        }
        let slope = surface.slope(line, mirror.spacing);
        let rate = T::of(f64::from(losses[line * samples + top - 1])) * exponent / T::of(top as f64);
        for (sample, amplitude) in amplitudes.iter_mut().enumerate().skip(top) {
            let [from_line, from, longer] = mirror.place(line, slope, sample);
            let image = share * (rate * longer).exp2() * mirror.echo(above, [from_line, from]);
            // Powers add: the phases of echo and mirror image are unrelated.
            *amplitude = (*amplitude * *amplitude + image * image).sqrt();
        }
    });
}
