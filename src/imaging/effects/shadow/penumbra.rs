//! Penumbra: shadow edges as soft as the beam is wide.
//!
//! With `t` the one-way transmittance of each scanline, the echo is multiplied by `(sum w t)^2`, where `w` are Gaussian
//! weights across scanlines of the width of the beam: at the edge of a half plane a quarter of the amplitude. If that
//! width is not stated, it is the lateral length of the point spread, or where that is more the distance between the
//! rays of the [`aperture`](super::aperture) past an obstacle, so that they do not show one by one. A sample inside an
//! opaque tissue is seen only by the part of the beam that its own scanline represents, otherwise bone would appear
//! bright where the beam passes it.

use super::aperture::Aperture;
use super::{Shadow, units};
use crate::effects::lateral::{BLOCK, FWHM_PER_SIGMA, LateralKernel};
use crate::effects::pass::View;
use crate::effects::point_spread::PointSpread;
use crate::synth::store::Store;
use crate::synth::tables::Tables;
use insonify_base::parallel::{chunks, chunks_mut, for_each};
use insonify_base::real::Real;
use insonify_base::simd::Kernel;
use insonify_tracking::probe::BeamGrid;

/// Loss above which a tissue is opaque, dB per mm: above that of soft tissue and below that of bone, gas and lung.
const OPAQUE_DB_MM: f64 = 6.0;

/// Loss per sample above which a tissue is opaque, units.
pub(crate) fn opaque_units(sample_mm: f64) -> u32 {
    units(OPAQUE_DB_MM * sample_mm)
}

/// Which labels are opaque.
pub(crate) fn are_opaque(tables: &Tables) -> [bool; 256] {
    let opaque = opaque_units(tables.sample_mm());
    std::array::from_fn(|label| tables.label_rows.get(label).is_some_and(|row| row.loss >= opaque))
}

/// Leaves to samples inside opaque tissues at most the transmittance of their own scanline.
#[inline(always)]
pub(crate) fn cap_opaque<T: Real>(is_opaque: &[bool; 256], labels: &[u8], on_line: &[T], left: &mut [T]) {
    for (left, (through, label)) in left.iter_mut().zip(on_line.iter().zip(labels)) {
        if is_opaque[usize::from(*label)] {
            *left = left.min(*through);
        }
    }
}

impl Shadow {
    /// Weights of the beam across scanlines at each sample depth.
    pub fn kernel(&self, spread: Option<&PointSpread>, aperture: &Aperture, grid: &BeamGrid) -> LateralKernel {
        let sigma_lines = |sample: usize| {
            let depth_mm = grid.sample_depth_mm(sample);
            let lines = |mm: f64| mm / grid.lateral_spacing_mm(depth_mm).max(1e-6);
            let width = match spread {
                None => lines(self.beam_mm.unwrap_or(0.0)),
                Some(spread) => {
                    let apart = aperture.apart.get(sample).copied().unwrap_or(0.0);
                    lines(spread.lateral_at(depth_mm)).max(apart)
                }
            };
            width / FWHM_PER_SIGMA
        };
        LateralKernel::gaussian(grid.samples(), sigma_lines, |_, _| 1.0)
    }
}

/// Attenuates each echo by the transmittance of the beam, from the one-way transmittance of each sample in
/// `amplitude_next`.
pub(super) fn run<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let (lines, samples) = (tables.lines(), tables.samples());
    let Some(kernel) = &tables.effects.shadow.penumbra else {
        return;
    };
    let is_opaque = are_opaque(tables);
    let through = &store.amplitude_next[..lines * samples];
    for_each(
        (
            0..,
            chunks_mut(&mut store.amplitude[..lines * samples], samples),
            chunks(&store.label, samples),
        ),
        &|(line, amplitudes, labels)| {
            T::vectorised(Scanline {
                kernel,
                through,
                line_and_count: [line, lines],
                is_opaque: &is_opaque,
                labels,
                amplitudes,
            });
        },
    );
}

/// A shaded scanline.
struct Scanline<'a, T> {
    kernel: &'a LateralKernel,
    through: &'a [T],
    /// Index of the scanline, and number of scanlines.
    line_and_count: [usize; 2],
    is_opaque: &'a [bool; 256],
    labels: &'a [u8],
    amplitudes: &'a mut [T],
}

impl<T: Real> Kernel for Scanline<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let on_line = &self.through[self.line_and_count[0] * self.amplitudes.len()..];
        let rows = self.labels.chunks(BLOCK).zip(on_line.chunks(BLOCK));
        for (block, (amplitudes, (labels, through))) in self.amplitudes.chunks_mut(BLOCK).zip(rows).enumerate() {
            let mut mean = [T::zero(); BLOCK];
            let mean = &mut mean[..amplitudes.len()];
            self.kernel.mean(self.through, self.line_and_count, block * BLOCK, mean);
            cap_opaque(self.is_opaque, labels, through, mean);
            for (amplitude, left) in amplitudes.iter_mut().zip(mean) {
                *amplitude *= *left * *left;
            }
        }
    }
}
