//! Pixel comparison, from the beam of the reference and its error bounds.

use super::slack::Slack;
use super::{Case, noise, quantise, scan_conversion};
use crate::synth::layers::Beam;
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

/// Compares frames pixel by pixel, given the `beam` of the reference after its last pass and the frame of the twin.
pub(super) fn compare(
    case: &Case,
    exact: &mut Synthesizer,
    beam: &Beam,
    slack: &mut Slack,
    found: Vec<u8>,
) -> Result<Pixels, SynthError> {
    let tables = exact.tables();
    let size = [tables.width(), tables.height()];
    let mut image = scan_conversion::carry(tables, beam, &slack.amplitude);
    noise::carry(tables, case.state.frame, &mut image);
    let by_itself: Vec<u8> = image
        .iter()
        .map(|&[grey, _]| (grey + 0.5).clamp(0.0, 255.0) as u8)
        .collect();
    let expected = exact.render(&case.state)?.pixels.clone();
    let apart = expected.iter().zip(&by_itself).filter(|(a, b)| a != b).count();
    if apart > 0 {
        slack.fault(format!(
            "{apart} pixels of the reference do not follow from its own beam"
        ));
    }
    let pixels = Pixels {
        size,
        expected,
        found,
        allowed: image.iter().map(|&pixel| quantise::carry(pixel)).collect(),
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
