//! Aperture: bone, gas and needles shade a point from only part of the aperture, so that the edges of their shadows
//! widen with depth.
//!
//! A scanner receives from a point at depth `z` with elements up to `z / (2 F)` to either side, of f-number `F`. Rays
//! from [`RAYS`] of them run straight to each point; the wave is the mean of their transmittances (O. Mattausch and O.
//! Goksel, Eurographics Workshop on Visual Computing for Biology and Medicine, 2016, cast such rays at random). A ray
//! from an element has the same angle for all points on it, so that the losses down one ray serve all of them: they are
//! accumulated in one scan per element and angle. Elements beyond the ends of the array are ignored. The attenuation of
//! soft tissue is that of the scanline.

use std::ops::Range;

use super::{MAX_UNITS, Shadow, exponent_per_unit, needle_units, penumbra};
use crate::effects::pass::View;
use crate::synth::store::Store;
use crate::synth::tables::Tables;
use insonify_base::parallel::{chunks_mut, for_each};
use insonify_base::real::Real;
use insonify_tracking::probe::BeamGrid;

/// Number of rays to a point, the middle one down its scanline.
pub const RAYS: usize = 5;
/// Number of rays to either side.
const SIDE: usize = RAYS / 2;

impl Shadow {
    /// For each off-centre ray, from the inside outwards, a row over the samples: scanlines between the point and the
    /// element. Empty if shadows do not widen.
    pub fn shifts(&self, grid: &BeamGrid) -> Vec<u32> {
        if self.f_number > 0.0 {
            shifts(self.f_number, grid)
        } else {
            Vec::new()
        }
    }
}

fn shifts(f_number: f64, grid: &BeamGrid) -> Vec<u32> {
    let mut shifts = Vec::with_capacity(SIDE * grid.samples());
    for ray in 1..=SIDE {
        // Rays represent equal parts of the aperture.
        let slope = ray as f64 / RAYS as f64 / f_number;
        let mut lines = 0.0;
        for sample in 0..grid.samples() {
            let spacing = grid.lateral_spacing_mm(grid.sample_depth_mm(sample)).max(1e-6);
            let step = slope * grid.sample_spacing_mm() / spacing;
            shifts.push((lines + 0.5 * step).round() as u32);
            lines += step;
        }
    }
    shifts
}

/// Ranges of samples on which rays stay on their scanlines.
pub fn runs(shifts: &[u32], samples: usize) -> Vec<Range<usize>> {
    let mut runs: Vec<Range<usize>> = Vec::new();
    if shifts.is_empty() {
        return runs;
    }
    for sample in 0..samples {
        let same = |first: usize| shifts.chunks(samples).all(|row| row[first] == row[sample]);
        match runs.last_mut() {
            Some(run) if same(run.start) => run.end += 1,
            _ => runs.push(sample..sample + 1),
        }
    }
    runs
}

/// Scanline of an element's ray at a sample; `None` outside the image.
pub(crate) fn line_at(
    shifts: &[u32],
    samples: usize,
    [ray, element, sample]: [usize; 3],
    lines: usize,
) -> Option<usize> {
    let shift = |row: usize| shifts[row * samples + sample] as usize;
    match ray {
        _ if ray < SIDE => element.checked_sub(shift(SIDE - 1 - ray)),
        _ if ray > SIDE => Some(element + shift(ray - SIDE - 1)).filter(|line| *line < lines),
        _ => Some(element),
    }
}

/// Element whose ray crosses a scanline at a sample; `None` outside the array.
pub(crate) fn element_at(
    shifts: &[u32],
    samples: usize,
    [ray, line, sample]: [usize; 3],
    lines: usize,
) -> Option<usize> {
    line_at(shifts, samples, [RAYS - 1 - ray, line, sample], lines)
}

/// Loss of each occluding label; 0 for others.
fn occluding(tables: &Tables) -> [u32; 256] {
    let opaque = penumbra::opaque_units(tables.sample_mm());
    std::array::from_fn(|label| {
        let loss = tables.label_rows.get(label).map_or(0, |row| row.loss);
        if loss >= opaque { loss } else { 0 }
    })
}

/// One-way transmittance of each ray of each element, down to each sample.
pub(super) fn rays<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let (lines, samples) = (tables.lines(), tables.samples());
    let loss = occluding(tables);
    let needle = crate::effects::needle::present(tables).then_some(T::of(f64::from(needle_units(tables))));
    let exponent = T::of(0.5 * exponent_per_unit());
    let (labels, mask) = (&store.label, &store.needle_mask);
    for_each((0.., chunks_mut(&mut store.effects.shadow.through, samples)), &|(
        row,
        through,
    )| {
        let (ray, element) = (row / lines, row % lines);
        let (mut above, mut left) = (0u32, T::one());
        for run in &tables.effects.shadow.aperture_runs {
            let out = &mut through[run.clone()];
            // A ray stays on one scanline for a run; outside the array nothing occludes it.
            let Some(line) = line_at(
                &tables.effects.shadow.aperture,
                samples,
                [ray, element, run.start],
                lines,
            ) else {
                out.fill(left);
                continue;
            };
            let first = line * samples + run.start;
            for (offset, (label, out)) in labels[first..].iter().zip(out).enumerate() {
                let shade = |units: T| (mask[first + offset][1] * units).to_u32().unwrap_or(0);
                let sample_loss = loss[usize::from(*label)] + needle.map_or(0, shade);
                if sample_loss == 0 {
                    *out = left;
                    continue;
                }
                let to = |units: u32| (T::of(f64::from(units.min(MAX_UNITS))) * exponent).exp2();
                *out = to(above + sample_loss / 2);
                above = (above + sample_loss).min(MAX_UNITS);
                left = to(above);
            }
        }
    });
}

/// Multiplies the one-way transmittance of each sample by the mean transmittance of its rays.
pub(super) fn mean<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let (lines, samples) = (tables.lines(), tables.samples());
    let through = &store.effects.shadow.through;
    for_each(
        (0.., chunks_mut(&mut store.amplitude_next[..lines * samples], samples)),
        &|(line, left)| {
            for run in &tables.effects.shadow.aperture_runs {
                let mut rays: [&[T]; RAYS] = [&[]; RAYS];
                let mut count = 0;
                for ray in 0..RAYS {
                    if let Some(element) =
                        element_at(&tables.effects.shadow.aperture, samples, [ray, line, run.start], lines)
                    {
                        rays[count] = &through[(ray * lines + element) * samples..][run.clone()];
                        count += 1;
                    }
                }
                let left = &mut left[run.clone()];
                let share = T::one() / T::of(count as f64);
                // Almost everywhere all rays end on the array: a sum of five slices, which runs in vector registers.
                match rays {
                    [a, b, c, d, e] if count == RAYS => {
                        for (sample, left) in left.iter_mut().enumerate() {
                            *left *= (a[sample] + b[sample] + c[sample] + d[sample] + e[sample]) * share;
                        }
                    }
                    _ => {
                        for (sample, left) in left.iter_mut().enumerate() {
                            let sum = rays[..count].iter().fold(T::zero(), |sum, ray| sum + ray[sample]);
                            *left *= sum * share;
                        }
                    }
                }
            }
        },
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use insonify_tracking::probe::{BeamGrid, Linear, Probe};

    #[test]
    fn rays_lean_by_the_aperture_and_find_their_elements_again() {
        let mut probe = Probe::new(Linear { width_mm: 50.0 }, 60.0).expect("a probe");
        (probe.lines, probe.samples) = (101, 300);
        let grid = BeamGrid::new(&probe).expect("a grid");
        let (samples, lines) = (grid.samples(), grid.lines());
        let shifts = shifts(2.0, &grid);
        // At 40 mm the outer rays come from 2 / 5 of 20 mm to either side; scanlines are half a millimetre apart.
        let sample = 200;
        assert!(
            (f64::from(shifts[samples + sample]) - 16.0).abs() <= 1.0,
            "{}",
            shifts[samples + sample]
        );
        for ray in 0..RAYS {
            let element = element_at(&shifts, samples, [ray, 50, sample], lines).expect("an element");
            assert_eq!(line_at(&shifts, samples, [ray, element, sample], lines), Some(50));
            assert_eq!(line_at(&shifts, samples, [ray, element, 0], lines), Some(element));
        }
        assert_eq!(element_at(&shifts, samples, [0, 95, sample], lines), None);
        assert_eq!(element_at(&shifts, samples, [RAYS - 1, 5, sample], lines), None);
    }
}
