//! How far a twin may lie from the reference, carried from pass to pass.

use insonify::synth::layers::Beam;
use insonify::synth::tables::Tables;
use insonify::synth::{FrameState, Synthesizer};

use crate::case::{Case, Trail};
use crate::{
    blur, frame, geometry, interface, needle, receiver, shadow, slice, speckle, texture, thickness, tone, warp,
};

/// Bounds on the departure of a twin from the reference, sample by sample of the central plane.
#[derive(Clone, Default)]
pub struct Slack {
    /// Of each coordinate of the position, mm.
    pub position: Vec<[f64; 3]>,
    /// Samples within rounding of the surface of a mesh, which the twin took for the other side of it.
    pub torn: Vec<bool>,
    /// Of the echo amplitude, or of the grey level after `tone`.
    pub amplitude: Vec<f64>,
    /// Of the share of the plane that the needle fills.
    pub mask: Vec<f64>,
    /// Of the share of the beam that is in the shadow of the needle.
    pub shade: Vec<f64>,
    /// Of the loss, fixed-point units.
    pub loss: Vec<f64>,
}

/// One pass of a case: the reference before and after it, and the twin after it.
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
}

/// Compares a twin with the reference after every pass, and at the pixels.
pub fn check(case: &Case, exact: &Synthesizer, trail: &Trail, twin: &mut Synthesizer) {
    let name = format!("{} on {}", case.name, twin.backend());
    let own = Trail::of(twin, &case.state);
    assert_eq!(own.passes, trail.passes, "{name}: both backends run the same passes");
    let empty = Beam::default();
    let mut slack = Slack::default();
    for (at, pass) in trail.passes.iter().enumerate() {
        let step = Step {
            case,
            tables: exact.tables(),
            state: &case.state,
            before: at.checked_sub(1).map_or(&empty, |before| &trail.beams[before]),
            after: &trail.beams[at],
            twin: &own.beams[at],
        };
        carry(pass, &step, &mut slack);
        compare(&format!("{name} after {pass}"), &step, &slack);
        if *pass == "speckle_lateral" {
            speckle::check_typical(&name, &step, &slack);
        }
    }
    frame::check_pixels(
        case,
        &name,
        exact.tables(),
        &trail.beams[trail.beams.len() - 1],
        &slack,
        twin,
    );
}

/// Takes the bounds past one pass.
pub fn carry(pass: &str, step: &Step, slack: &mut Slack) {
    match pass {
        "geometry" => geometry::carry(step, slack),
        "warp" => warp::carry(step, slack),
        "slice" => slice::carry(step, slack),
        "texture" => texture::carry(step, slack),
        "thickness" => thickness::carry(step, slack),
        // The first two passes of the speckle leave nothing in the beam; the third carries all three.
        "speckle_scatter" | "speckle_axial" => {}
        "speckle_lateral" => speckle::carry(step, slack),
        "interface" => interface::carry(step, slack),
        "needle" => needle::carry(step, slack),
        "shadow_loss" => shadow::carry_loss(step, slack),
        "shadow" => shadow::carry(step, slack),
        "blur" => blur::carry(step, slack),
        "receiver" => receiver::carry(step, slack),
        "tone" => tone::carry(step, slack),
        // Pixels are compared by `frame`.
        "scan_conversion" | "noise" | "quantise" => {}
        other => panic!("no error analysis for the pass {other}"),
    }
}

fn compare(name: &str, step: &Step, slack: &Slack) {
    let (exact, twin) = (step.after, step.twin);
    let at = |index: usize| {
        let (line, sample) = step.place(index);
        format!("{name}, line {line}, sample {sample}")
    };
    assert_eq!(exact.position.len(), twin.position.len(), "{name}");
    for (index, (a, b)) in exact.position.iter().zip(&twin.position).enumerate() {
        if slack.torn.get(index).copied().unwrap_or(false) {
            continue;
        }
        assert_eq!(a[3], b[3], "{}: flag", at(index));
        for axis in 0..3 {
            within(
                || format!("{}: axis {axis}", at(index)),
                a[axis],
                b[axis],
                slack.position[index][axis],
            );
        }
    }
    let fields: [(&str, &[f64], &[f64], &[f64]); 3] = [
        ("amplitude", &exact.amplitude, &twin.amplitude, &slack.amplitude),
        ("needle", &exact.needle, &twin.needle, &slack.mask),
        ("shade", &exact.shade, &twin.shade, &slack.shade),
    ];
    for (what, exact, twin, slack) in fields {
        assert_eq!(exact.len(), twin.len(), "{name}: {what}");
        for (index, (&a, &b)) in exact.iter().zip(twin).enumerate() {
            // What no pass has written yet is zero on all backends.
            within(
                || format!("{}: {what}", at(index)),
                a,
                b,
                slack.get(index).copied().unwrap_or(0.0),
            );
        }
    }
    assert_eq!(exact.loss.len(), twin.loss.len(), "{name}: loss");
    for (index, (&a, &b)) in exact.loss.iter().zip(&twin.loss).enumerate() {
        let slack = slack.loss.get(index).copied().unwrap_or(0.0);
        within(|| format!("{}: loss", at(index)), f64::from(a), f64::from(b), slack);
    }
}

fn within(place: impl Fn() -> String, exact: f64, twin: f64, slack: f64) {
    assert!(slack.is_finite(), "{}: the bound is {slack}", place());
    let off = (twin - exact).abs();
    assert!(
        off <= slack,
        "{}: {twin} instead of {exact}: off by {off:e}, at most {slack:e} by rounding",
        place()
    );
}
