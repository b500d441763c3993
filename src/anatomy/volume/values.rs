//! Label values of image numbers.

use super::element::{Sample, Scale};
use insonify_base::note::Notes;

/// Deviation from a whole number up to which a value is rounded: resampling and scaling in single precision stay below,
/// and grey levels do not.
const NEAR: f64 = 1e-3;

/// Magnitude beyond which doubles skip whole numbers.
const LIMIT: f64 = 9_007_199_254_740_992.0;

/// Conversion of numbers to label values.
#[derive(Debug, Default)]
pub(super) struct Values {
    scale: Option<Scale>,
    /// Largest deviation from a whole number, and the value that has it.
    rounding: (f64, f64),
    /// Numbers that are NaN.
    pub(super) missing: u64,
}

/// A number that is no label.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Fraction {
    /// Value of the number.
    pub(super) value: f64,
    /// The number as stored.
    pub(super) stored: f64,
}

impl Values {
    pub(super) fn new(scale: Option<Scale>) -> Self {
        Self {
            scale,
            ..Self::default()
        }
    }

    /// Label value of a number: that of the nearest whole number, 0 for NaN.
    pub(super) fn label<T: Sample>(&mut self, number: T) -> Result<i64, Fraction> {
        if let (None, Some(label)) = (self.scale, number.as_label()) {
            return Ok(label);
        }
        let stored = number.as_f64();
        let value = self.scale.map_or(stored, |scale| scale.apply(stored));
        if value.is_nan() {
            self.missing += 1;
            return Ok(0);
        }
        let nearest = value.round();
        let rounding = (value - nearest).abs();
        if rounding > NEAR || nearest.abs() > LIMIT || value.is_infinite() {
            return Err(Fraction { value, stored });
        }
        if rounding > self.rounding.0 {
            self.rounding = (rounding, value);
        }
        Ok(nearest as i64)
    }

    /// Notes on numbers that are no whole ones, one sentence each.
    pub(super) fn notes(&self) -> Notes {
        let mut notes = Notes::default();
        let (rounding, value) = self.rounding;
        if rounding > 0.0 {
            notes.push(format!(
                "values are rounded to whole numbers, by at most {rounding:.1e} ({value} to {})",
                value.round()
            ));
        }
        if self.missing > 0 {
            notes.push(format!("{} voxels are NaN: taken as unlabelled", self.missing));
        }
        notes
    }
}

impl Fraction {
    /// The scale that made the value of the stored number, in words.
    pub(super) fn origin(self, scale: Option<Scale>) -> String {
        scale.map_or_else(String::new, |scale| {
            let (stored, Scale { key, slope, intercept }) = (self.stored, scale);
            let added = if intercept == 0.0 {
                String::new()
            } else {
                format!(", intercept {intercept:.6}")
            };
            format!(" (stored {stored}, {key} {slope:.6}{added})")
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn label(value: f64) -> Result<i64, Fraction> {
        Values::default().label(value)
    }

    #[test]
    fn what_is_near_a_whole_number_is_that_number() {
        for (value, expected) in [(30.000_9, 30), (29.999_1, 30), (-7.000_5, -7), (-0.000_4, 0), (5.0, 5)] {
            assert_eq!(label(value), Ok(expected), "{value}");
        }
        for value in [30.002, 0.5, f64::INFINITY, f64::NEG_INFINITY, 1e16] {
            assert_eq!(label(value), Err(Fraction { value, stored: value }), "{value}");
        }
        assert_eq!(Values::default().label(16_777_216.0f32), Ok(1 << 24));
        assert_eq!(Values::default().label(u64::MAX).ok(), None);
        assert_eq!(Values::default().label(i64::MAX), Ok(i64::MAX));
    }

    #[test]
    fn the_largest_rounding_and_the_missing_are_told() {
        let mut values = Values::default();
        for value in [1.0, 1.999_99, 3.000_5, f64::NAN, f64::NAN] {
            values.label(value).unwrap();
        }
        let notes = values.notes().join("; ");
        assert_eq!(
            notes,
            "values are rounded to whole numbers, by at most 5.0e-4 (3.0005 to 3); 2 voxels are NaN: taken as unlabelled"
        );
        let mut whole = Values::default();
        whole.label(2.0).unwrap();
        assert!(whole.notes().is_empty());
    }

    #[test]
    fn a_scale_is_applied_and_named() {
        let scale = Scale::new("scl_slope", 63.0 / 255.0, 0.0);
        let mut values = Values::new(scale);
        assert_eq!(values.label(255u8), Ok(63));
        let fraction = values.label(121u8).unwrap_err();
        assert_eq!(fraction.origin(scale), " (stored 121, scl_slope 0.247059)");
        assert_eq!(fraction.origin(None), "");
    }
}
