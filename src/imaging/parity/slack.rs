//! Error bounds of a twin against the reference, propagated from pass to pass.

use super::Case;
use super::{
    blur, geometry, interface, needle, receiver, refraction, shadow, slice, speckle, texture, thickness, tone, warp,
};
use crate::synth::layers::Beam;
use crate::synth::tables::Tables;
use crate::synth::{FrameState, SynthError};

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
    /// Bound of the share of the plane filled by the needle.
    pub mask: Vec<f64>,
    /// Bound of the share of the beam in the shadow of the needle.
    pub shade: Vec<f64>,
    /// Bound of the loss, fixed-point units.
    pub loss: Vec<f64>,
    /// Number of samples whose label differs in the twin.
    pub labels_apart: usize,
    /// Largest deviation so far as a fraction of its bound.
    pub share: f64,
    /// Deviations that rounding cannot explain.
    pub faults: Vec<String>,
}

impl Slack {
    /// Records a deviation that rounding cannot explain.
    pub(super) fn fault(&mut self, what: impl Into<String>) {
        self.faults.push(what.into());
    }
}

/// One pass of a case: the reference before and after it, and the twin after it. State and beams are relative to the local origin.
pub(super) struct Step<'a> {
    pub case: &'a Case,
    pub tables: &'a Tables,
    pub state: &'a FrameState,
    pub before: &'a Beam,
    pub after: &'a Beam,
    pub twin: &'a Beam,
}

impl Step<'_> {
    pub(super) fn lines(&self) -> usize {
        self.tables.lines()
    }

    pub(super) fn samples(&self) -> usize {
        self.tables.samples()
    }

    /// Returns the scanline and sample of an index in beam space.
    pub(super) fn place(&self, index: usize) -> (usize, usize) {
        (index / self.samples(), index % self.samples())
    }

    /// Describes the scanline and sample of an index in words.
    fn at(&self, index: usize) -> String {
        let (line, sample) = self.place(index);
        format!("line {line}, sample {sample}")
    }
}

/// Propagates the bounds through one pass.
pub(super) fn carry(pass: &str, step: &Step, slack: &mut Slack) -> Result<(), SynthError> {
    match pass {
        // The bound of `geometry` covers both passes.
        "geometry" => geometry::carry(step, slack),
        "contact" => {}
        // Leaves nothing in the beam.
        "warp_raster" => {}
        "warp" => warp::carry(step, slack),
        "slice" => slice::carry(step, slack),
        "texture" => texture::carry(step, slack),
        "thickness" => thickness::carry(step, slack)?,
        // The first speckle passes leave nothing in the beam; the last carries their errors.
        "speckle_scatter" | "speckle_specular" | "speckle_axial" => {}
        "speckle_lateral" => speckle::carry(step, slack),
        "interface" => interface::carry(step, slack),
        "needle" => needle::carry(step, slack),
        "shadow_loss" => shadow::carry_loss(step, slack),
        // The transmittance of the rays is not in the beam; the last pass carries it.
        "shadow_rays" | "shadow_aperture" => {}
        "shadow" => shadow::carry(step, slack),
        "shadow_reflectors" => {}
        "shadow_mirror" => shadow::carry_mirror(step, slack),
        "shadow_reverberation" => shadow::carry_reverberation(step, slack),
        // Leaves nothing in the beam; the next pass carries its error.
        "refraction_phase" => {}
        "refraction" => refraction::carry(step, slack),
        "blur" => blur::carry(step, slack),
        "receiver" => receiver::carry(step, slack),
        // Leaves nothing in the beam; `tone` carries its error.
        "tone_auto_gain" => {}
        "tone" => tone::carry(step, slack),
        // Pixels are compared by `pixels`.
        "scan_conversion" | "noise" | "quantise" => {}
        // They leave nothing in the beam.
        pass if pass.starts_with("truth_") => {}
        other => slack.fault(format!("no error analysis for the pass {other}")),
    }
    Ok(())
}

/// Records deviations of a twin beyond the bounds.
pub(super) fn compare(step: &Step, slack: &mut Slack) {
    let mut found = Departures::default();
    let (exact, twin) = (step.after, step.twin);
    found.same_count("positions", exact.position.len(), twin.position.len());
    for (index, (a, b)) in exact.position.iter().zip(&twin.position).enumerate() {
        if slack.torn.get(index).copied().unwrap_or(false) {
            continue;
        }
        if a[3] != b[3] {
            found
                .faults
                .push(format!("{}: flag {} instead of {}", step.at(index), b[3], a[3]));
        }
        for axis in 0..3 {
            let bound = slack.position.get(index).map_or(0.0, |bounds| bounds[axis]);
            found.within(step, index, "position", [a[axis], b[axis], bound]);
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
        found.same_count(what, exact.len(), twin.len());
        for (index, (&a, &b)) in exact.iter().zip(twin).enumerate() {
            // Values not yet written by any pass are zero on all backends.
            let bound = bounds.get(index).copied().unwrap_or(0.0);
            found.within(step, index, what, [a, b, bound]);
        }
    }
    slack.share = slack.share.max(found.share);
    slack.faults.append(&mut found.faults);
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
        let off = (twin - exact).abs();
        if off <= bound && bound.is_finite() {
            if off > 0.0 {
                self.share = self.share.max(off / bound);
            }
            return;
        }
        let at = step.at(index);
        self.faults.push(format!(
            "{at}: {what} {twin} instead of {exact}: off by {off:e}, at most {bound:e} by rounding"
        ));
    }
}
