//! Pixel comparison.

use super::Case;
use super::slack::Slack;
use crate::synth::{SynthError, Synthesizer};

/// Frame of a twin beside the grey levels that rounding allows.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Pixels {
    /// Columns and rows.
    pub size: [usize; 2],
    /// Grey levels of the reference.
    pub expected: Vec<u8>,
    /// Grey levels of the twin.
    pub found: Vec<u8>,
    /// Lowest and highest grey level that rounding allows, for each pixel.
    pub allowed: Vec<[u8; 2]>,
}

impl Pixels {
    /// Returns the number of pixels of the twin that rounding cannot explain.
    pub fn outside(&self) -> usize {
        let pairs = self.found.iter().zip(&self.allowed);
        pairs
            .filter(|(found, [low, high])| !(low..=high).contains(found))
            .count()
    }
}

/// Compares the frame of a twin with the reference, pixel by pixel.
pub(super) fn compare(
    case: &Case,
    exact: &mut Synthesizer,
    slack: &mut Slack,
    found: Vec<u8>,
) -> Result<Pixels, SynthError> {
    let size = [exact.tables().width(), exact.tables().height()];
    let by_itself: Vec<u8> = slack
        .image
        .iter()
        .map(|&[grey, _]| (grey + 0.5).clamp(0.0, 255.0) as u8)
        .collect();
    let expected = exact.render(&case.state)?.pixels.clone();
    let differing = expected.iter().zip(&by_itself).filter(|(a, b)| a != b).count();
    if differing > 0 || expected.len() != by_itself.len() {
        slack.fault(format!(
            "{differing} pixels of the reference do not follow from its own beam"
        ));
    }
    let pixels = Pixels {
        size,
        expected,
        found,
        allowed: std::mem::take(&mut slack.bytes),
    };
    if pixels.outside() > 0 {
        slack.fault(format!(
            "{} of {} pixels are further from the reference than rounding allows",
            pixels.outside(),
            pixels.found.len()
        ));
    }
    Ok(pixels)
}
