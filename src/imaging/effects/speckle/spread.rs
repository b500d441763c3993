//! Point spread in the beam frame: axial and lateral convolution, and the modulus.

use super::tables::SpeckleTables;
use crate::effects::lateral::{BLOCK, LateralKernel};
use crate::effects::pass::View;
use crate::synth::store::Store;
use insonify_base::parallel::{chunks_mut, for_each};
use insonify_base::real::Real;
use insonify_base::simd::Kernel;

pub(super) fn axial<T: Real>(view: &View, store: &mut Store<T>) {
    let columns = &mut store.effects.speckle;
    along(view, &columns.scatter, &mut columns.scatter_axial);
}

pub(super) fn axial_of_looks<T: Real>(view: &View, store: &mut Store<T>) {
    let columns = &mut store.effects.compound;
    along(view, &columns.looks, &mut columns.axial);
}

fn along<T: Real>(view: &View, input: &[T], output: &mut [T]) {
    let Some(speckle) = &view.tables.effects.speckle else {
        return;
    };
    let samples = view.tables.samples();
    let ends = speckle.ends.of::<T>();
    for_each((0.., chunks_mut(output, samples)), &|(part, output)| {
        T::vectorised(Along {
            input: &input[part * samples..][..samples],
            speckle,
            ends,
            output,
        });
    });
}

/// Convolution along a scanline, truncated at its ends and rescaled there to preserve its power.
struct Along<'a, T> {
    input: &'a [T],
    speckle: &'a SpeckleTables,
    ends: &'a [T],
    output: &'a mut [T],
}

impl<T: Real> Kernel for Along<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self {
            input,
            speckle,
            ends,
            output,
        } = self;
        let samples = input.len();
        let reach = speckle.axial_reach();
        for band in 0..speckle.bands {
            let [start, end] = [band, band + 1].map(|band| (band * samples).div_ceil(speckle.bands));
            let weights = speckle.axial_at::<T>(start, samples);
            for from in (start..end).step_by(BLOCK) {
                let output = &mut output[from..end.min(from + BLOCK)];
                let mut sums = [T::zero(); BLOCK];
                // output[i] = sum of weights[tap] * input[i + tap - reach]
                if from >= reach && output.len() == BLOCK && from + BLOCK + reach <= samples {
                    // With a fixed length the sums stay in registers.
                    for (tap, weight) in weights.iter().enumerate() {
                        let source: &[T; BLOCK] = input[from + tap - reach..].first_chunk().expect("a full block");
                        (0..BLOCK).for_each(|i| sums[i] += *weight * source[i]);
                    }
                } else {
                    for (tap, weight) in weights.iter().enumerate() {
                        let skipped = reach.saturating_sub(from + tap).min(output.len());
                        let source = &input[(from + tap).saturating_sub(reach).min(samples)..];
                        for (sum, value) in sums[skipped..output.len()].iter_mut().zip(source) {
                            *sum += *weight * *value;
                        }
                    }
                }
                output.copy_from_slice(&sums[..output.len()]);
            }
        }
        for (out, &factor) in output.iter_mut().zip(ends) {
            *out *= factor;
        }
    }
}

pub(super) fn lateral<T: Real>(view: &View, store: &mut Store<T>) {
    let beam = view.tables.lines() * view.tables.samples();
    envelopes(view, &store.effects.speckle.scatter_axial, &mut store.amplitude[..beam]);
}

pub(super) fn lateral_of_looks<T: Real>(view: &View, store: &mut Store<T>) {
    let columns = &mut store.effects.compound;
    envelopes(view, &columns.axial, &mut columns.envelopes);
}

/// Envelopes of one look or several.
fn envelopes<T: Real>(view: &View, input: &[T], output: &mut [T]) {
    let tables = view.tables;
    let Some(speckle) = &tables.effects.speckle else { return };
    let (lines, samples) = (tables.lines(), tables.samples());
    let fine_lines = speckle.fine_lines(lines);
    for_each((0.., chunks_mut(output, samples)), &|(row, output)| {
        let (look, line) = (row / lines, row % lines);
        T::vectorised(Envelope {
            input: &input[look * 2 * fine_lines * samples..],
            line_and_count: [line * speckle.oversampling, fine_lines],
            kernel: &speckle.lateral,
            edge: speckle
                .edge(line, lines)
                .map(|row| &speckle.edges.of()[row * samples..][..samples]),
            output,
        });
    });
}

/// Modulus of the lateral convolution at one fine scanline. Where the kernel extends past the array, the remainder is
/// rescaled to preserve its power.
struct Envelope<'a, T> {
    input: &'a [T],
    /// Index of the scanline, and number of scanlines.
    line_and_count: [usize; 2],
    kernel: &'a LateralKernel,
    edge: Option<&'a [T]>,
    output: &'a mut [T],
}

impl<T: Real> Kernel for Envelope<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let samples = self.output.len();
        let part = |line: usize| &self.input[line * samples..][..samples];
        for (block, output) in self.output.chunks_mut(BLOCK).enumerate() {
            let parts = |fine: usize| [part(2 * fine), part(2 * fine + 1)];
            let [re, im] = self.kernel.sums(self.line_and_count, block * BLOCK, parts);
            for (out, (re, im)) in output.iter_mut().zip(re.iter().zip(&im)) {
                *out = (*re * *re + *im * *im).sqrt();
            }
        }
        if let Some(factors) = self.edge {
            for (out, &factor) in self.output.iter_mut().zip(factors) {
                *out *= factor;
            }
        }
    }
}
