//! Quantise: to the nearest byte. A grey level known to within a bound may come out as any byte between those of its ends.

use super::rounding::ULP;

/// Lowest and highest byte of a grey level known to within a bound.
pub fn carry([grey, off]: [f64; 2]) -> [u8; 2] {
    let off = off + 256.0 * ULP;
    [grey - off, grey + off].map(|grey| (grey + 0.5).clamp(0.0, 255.0) as u8)
}
