//! Error bounds of a twin against the reference, propagated from pass to pass.

use crate::synth::FrameState;
use crate::synth::layers::Beam;
use crate::synth::tables::Tables;

/// Bounds on the deviation of a twin from the reference, for each sample of the central plane.
#[derive(Clone, Default)]
pub(crate) struct Slack {
    /// Bound of each coordinate of the position, mm.
    pub position: Vec<[f64; 3]>,
    /// Samples within rounding of a mesh surface that the twin assigned to its other side.
    pub torn: Vec<bool>,
    /// Bound of the echo amplitude, or of the grey level after `tone`.
    pub amplitude: Vec<f64>,
    /// Bound and size of the complex echo of surfaces and needles.
    pub specular: Vec<[f64; 2]>,
    /// Bound and size of what the complex echo of surfaces in a steered look has more, over the looks.
    pub look_specular: Vec<[f64; 2]>,
    /// Bound and size of the envelopes of the steered looks.
    pub looks: Vec<[f64; 2]>,
    /// Bound of the share of the plane filled by the needle.
    pub mask: Vec<f64>,
    /// Bound of the share of the beam in the shadow of the needle.
    pub shade: Vec<f64>,
    /// Bound of the loss, fixed-point units.
    pub loss: Vec<f64>,
    /// Grey level of each pixel in the reference, and its bound.
    pub image: Vec<[f64; 2]>,
    /// Lowest and highest byte of each pixel.
    pub bytes: Vec<[u8; 2]>,
    /// Number of samples whose label differs in the twin.
    pub labels_apart: usize,
    /// Largest deviation so far as a fraction of its bound.
    pub share: f64,
    /// Deviations that rounding cannot explain.
    pub faults: Vec<String>,
}

impl Slack {
    /// Records a deviation that rounding cannot explain.
    pub(crate) fn fault(&mut self, what: impl Into<String>) {
        self.faults.push(what.into());
    }
}

/// One pass of a case: the reference before and after it, and the twin after it. State and beams are relative to the
/// local origin.
pub(crate) struct Step<'a> {
    pub tables: &'a Tables,
    pub state: &'a FrameState,
    pub before: &'a Beam,
    pub after: &'a Beam,
    pub twin: &'a Beam,
    /// Whether sums and products of the twin are rounded to nearest.
    pub to_nearest: bool,
}

impl Step<'_> {
    pub(crate) fn lines(&self) -> usize {
        self.tables.lines()
    }

    pub(crate) fn samples(&self) -> usize {
        self.tables.samples()
    }

    /// Returns the scanline and sample of an index in beam space.
    pub(crate) fn place(&self, index: usize) -> (usize, usize) {
        (index / self.samples(), index % self.samples())
    }

    /// Describes the scanline and sample of an index in words.
    fn at(&self, index: usize) -> String {
        let (line, sample) = self.place(index);
        format!("line {line}, sample {sample}")
    }
}

/// Records deviations of a twin beyond the bounds.
pub(crate) fn compare(step: &Step, slack: &mut Slack) {
    let mut departures = Departures::default();
    let (exact, twin) = (step.after, step.twin);
    departures.same_count("positions", exact.position.len(), twin.position.len());
    for (index, (a, b)) in exact.position.iter().zip(&twin.position).enumerate() {
        if slack.torn.get(index).copied().unwrap_or(false) {
            continue;
        }
        if a[3] != b[3] {
            departures
                .faults
                .push(format!("{}: flag {} instead of {}", step.at(index), b[3], a[3]));
        }
        for axis in 0..3 {
            let bound = slack.position.get(index).map_or(0.0, |bounds| bounds[axis]);
            departures.within(step, index, "position", [a[axis], b[axis], bound]);
        }
    }
    let losses = [&exact.loss, &twin.loss].map(|loss| loss.iter().map(|&units| f64::from(units)).collect::<Vec<f64>>());
    let fields: [(&str, &[f64], &[f64], &[f64]); 4] = [
        ("amplitude", &exact.amplitude, &twin.amplitude, &slack.amplitude),
        ("needle", &exact.needle, &twin.needle, &slack.mask),
        ("shade", &exact.shade, &twin.shade, &slack.shade),
        ("loss", &losses[0], &losses[1], &slack.loss),
    ];
    for (what, exact, twin, bounds) in fields {
        departures.same_count(what, exact.len(), twin.len());
        for (index, (&a, &b)) in exact.iter().zip(twin).enumerate() {
            // Values not yet written by any pass are zero on all backends.
            let bound = bounds.get(index).copied().unwrap_or(0.0);
            departures.within(step, index, what, [a, b, bound]);
        }
    }
    slack.share = slack.share.max(departures.share);
    slack.faults.append(&mut departures.faults);
}

/// Result of one comparison.
#[derive(Default)]
struct Departures {
    share: f64,
    faults: Vec<String>,
}

impl Departures {
    fn same_count(&mut self, what: &str, exact: usize, twin: usize) {
        if exact != twin {
            self.faults.push(format!("{what}: {twin} instead of {exact}"));
        }
    }

    fn within(&mut self, step: &Step, index: usize, what: &str, [exact, twin, bound]: [f64; 3]) {
        let error = (twin - exact).abs();
        if error <= bound && bound.is_finite() {
            if error > 0.0 {
                self.share = self.share.max(error / bound);
            }
            return;
        }
        let label = step.at(index);
        self.faults.push(format!(
            "{label}: {what} {twin} instead of {exact}: off by {error:e}, at most {bound:e} by rounding"
        ));
    }
}
