//! Error bounds of quantisation to the nearest byte: a bounded grey level may become any byte between those of its ends.

use super::rounding::ULP;

/// Returns the lowest and highest byte of a grey level known to within a bound.
pub(super) fn carry([grey, off]: [f64; 2]) -> [u8; 2] {
    let off = off + 256.0 * ULP;
    [grey - off, grey + off].map(|grey| (grey + 0.5).clamp(0.0, 255.0) as u8)
}
