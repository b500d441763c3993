//! How far a twin may lie from the reference, carried from pass to pass.

use super::Case;
use super::{
    blur, geometry, interface, needle, receiver, refraction, shadow, slice, speckle, texture, thickness, tone, warp,
};
use crate::synth::layers::Beam;
use crate::synth::tables::Tables;
use crate::synth::{FrameState, SynthError};

/// Bounds on the departure of a twin from the reference, sample by sample of the central plane.
#[derive(Clone, Default)]
pub struct Slack {
    /// Of each coordinate of the position, mm.
    pub position: Vec<[f64; 3]>,
    /// Samples within rounding of the surface of a mesh, which the twin took for the other side of it.
    pub torn: Vec<bool>,
    /// Of the echo amplitude, or of the grey level after `tone`.
    pub amplitude: Vec<f64>,
    /// Of the complex echo of surfaces and needles, with its size.
    pub specular: Vec<[f64; 2]>,
    /// Of the share of the plane that the needle fills.
    pub mask: Vec<f64>,
    /// Of the share of the beam that is in the shadow of the needle.
    pub shade: Vec<f64>,
    /// Of the loss, fixed-point units.
    pub loss: Vec<f64>,
    /// Samples whose label the twin reads otherwise.
    pub labels_apart: usize,
    /// The largest departure so far as a share of its bound.
    pub share: f64,
    /// Departures that rounding cannot explain.
    pub faults: Vec<String>,
}

impl Slack {
    /// Notes what rounding cannot explain.
    pub fn fault(&mut self, what: impl Into<String>) {
        self.faults.push(what.into());
    }
}

/// One pass of a case: the reference before and after it, and the twin after it. State and beams are seen from the local origin.
pub struct Step<'a> {
    pub case: &'a Case,
    pub tables: &'a Tables,
    pub state: &'a FrameState,
    pub before: &'a Beam,
    pub after: &'a Beam,
    pub twin: &'a Beam,
}

impl Step<'_> {
    pub fn lines(&self) -> usize {
        self.tables.lines()
    }

    pub fn samples(&self) -> usize {
        self.tables.samples()
    }

    /// Scanline and sample of an index in beam space.
    pub fn place(&self, index: usize) -> (usize, usize) {
        (index / self.samples(), index % self.samples())
    }

    /// The same in words.
    fn at(&self, index: usize) -> String {
        let (line, sample) = self.place(index);
        format!("line {line}, sample {sample}")
    }
}

/// Takes the bounds past one pass.
pub fn carry(pass: &str, step: &Step, slack: &mut Slack) -> Result<(), SynthError> {
    match pass {
        // The bound of the geometry covers both.
        "geometry" => geometry::carry(step, slack),
        "contact" => {}
        "warp" => warp::carry(step, slack),
        "slice" => slice::carry(step, slack),
        "texture" => texture::carry(step, slack),
        "thickness" => thickness::carry(step, slack)?,
        // The first passes of the speckle leave nothing in the beam; the last carries them all.
        "speckle_scatter" | "speckle_specular" | "speckle_axial" => {}
        "speckle_lateral" => speckle::carry(step, slack),
        "interface" => interface::carry(step, slack),
        "needle" => needle::carry(step, slack),
        "shadow_loss" => shadow::carry_loss(step, slack),
        // What the rays let through is not in the beam; the last pass carries it.
        "shadow_rays" | "shadow_aperture" => {}
        "shadow" => shadow::carry(step, slack),
        "shadow_reflectors" => {}
        "shadow_mirror" => shadow::carry_mirror(step, slack),
        "shadow_reverberation" => shadow::carry_reverberation(step, slack),
        // It leaves nothing in the beam; the next pass carries it.
        "refraction_phase" => {}
        "refraction" => refraction::carry(step, slack),
        "blur" => blur::carry(step, slack),
        "receiver" => receiver::carry(step, slack),
        // It leaves nothing in the beam; the tone carries it.
        "tone_auto_gain" => {}
        "tone" => tone::carry(step, slack),
        // Pixels are compared by `pixels`.
        "scan_conversion" | "noise" | "quantise" => {}
        other => slack.fault(format!("no error analysis for the pass {other}")),
    }
    Ok(())
}

/// Notes where a twin lies further from the reference than the bounds allow.
pub fn compare(step: &Step, slack: &mut Slack) {
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
            // What no pass has written yet is zero on all backends.
            let bound = bounds.get(index).copied().unwrap_or(0.0);
            found.within(step, index, what, [a, b, bound]);
        }
    }
    slack.share = slack.share.max(found.share);
    slack.faults.append(&mut found.faults);
}

/// What one comparison finds.
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
