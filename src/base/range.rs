//! Ranges of numbers: declared once with their parameters, and checked.

use std::fmt;

/// A parameter outside its range.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("`{key}` is {found}; expected {expected}")]
pub struct OutOfRange {
    /// Name of the parameter, such as `radius_mm`, or its path in a file.
    pub key: String,
    /// Value found.
    pub found: String,
    /// Permitted values.
    pub expected: String,
}

impl OutOfRange {
    pub(crate) fn new(key: impl Into<String>, found: impl fmt::Display, expected: impl Into<String>) -> Self {
        Self {
            key: key.into(),
            found: found.to_string(),
            expected: expected.into(),
        }
    }
}

/// Parses finite numbers separated by commas.
pub(crate) fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let found: Option<Vec<f64>> = text
        .split(',')
        .map(|part| part.trim().parse().ok().filter(|number: &f64| number.is_finite()))
        .collect();
    let found = found.and_then(|found| found.try_into().ok());
    found.ok_or_else(|| format!("expected {N} finite numbers separated by commas"))
}

/// Checks that a number is finite and `holds`.
pub(crate) fn check(key: &str, found: f64, holds: bool, expected: impl Into<String>) -> Result<(), OutOfRange> {
    match found.is_finite() && holds {
        true => Ok(()),
        false => Err(OutOfRange::new(key, found, expected)),
    }
}

/// Checks that a number is in a range.
pub(crate) fn within(key: &str, found: f64, range: std::ops::RangeInclusive<f64>) -> Result<(), OutOfRange> {
    let expected = || format!("a number from {} to {}", range.start(), range.end());
    match range.contains(&found) {
        true => Ok(()),
        false => Err(OutOfRange::new(key, found, expected())),
    }
}

/// A table of parameters whose numbers have ranges; [`parameters!`] implements it.
pub trait Ranges {
    /// The first number out of its range, with its key and the range.
    fn out_of_range(&self) -> Option<(&'static str, f64, &'static str)>;

    /// Checks every number against its range.
    ///
    /// # Errors
    /// [`OutOfRange`] for the first that is outside.
    fn check_ranges(&self) -> Result<(), OutOfRange> {
        match self.out_of_range() {
            Some((key, found, expected)) => Err(OutOfRange::new(key, found, expected)),
            None => Ok(()),
        }
    }
}

/// A number that may be left out.
pub trait Number {
    /// The number, if it is stated.
    fn stated(&self) -> Option<f64>;
}

impl Number for f64 {
    fn stated(&self) -> Option<f64> {
        Some(*self)
    }
}

impl Number for u32 {
    fn stated(&self) -> Option<f64> {
        Some(f64::from(*self))
    }
}

impl<N: Number> Number for Option<N> {
    fn stated(&self) -> Option<f64> {
        self.as_ref().and_then(N::stated)
    }
}

/// Declares a table of parameters: each with its description, its type, its default after `=` if that is not the default of the type, and its range,
/// ends included, after `in`, with the unit for errors. Range and default thus stand once and reach `Default`, [`Ranges`], the documentation and the
/// JSON schema.
macro_rules! parameters {
    ($(#[$meta:meta])* pub struct $name:ident {
        $($(#[$doc:meta])* $key:ident: $type:ty $(= $default:expr)? $(, in $low:literal..=$high:literal $($unit:literal)?)?;)+
    }) => {
        $(#[$meta])*
        #[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
        #[serde(deny_unknown_fields, default)]
        pub struct $name {
            $(
                $(#[$doc])*
                $(#[doc = concat!("From ", $low, " to ", $high, ".")] #[schemars(range(min = $low, max = $high))])?
                $(#[doc = concat!("Default ", stringify!($default), ".")])?
                pub $key: $type,
            )+
        }

        impl Default for $name {
            fn default() -> Self {
                Self { $($key: $crate::base::range::parameters!(@ $($default)?),)+ }
            }
        }

        impl $crate::base::range::Ranges for $name {
            fn out_of_range(&self) -> Option<(&'static str, f64, &'static str)> {
                $($(
                    let found = $crate::base::range::Number::stated(&self.$key);
                    if let Some(found) = found.filter(|found| !(f64::from($low)..=f64::from($high)).contains(found)) {
                        return Some((stringify!($key), found, concat!($low, " to ", $high $(, " ", $unit)?)));
                    }
                )?)+
                None
            }
        }
    };
    (@ $default:expr) => { $default };
    (@) => { Default::default() };
}
pub(crate) use parameters;
