//! Tables of parameters: ranges of their numbers and the kinds that keys belong to, declared once and checked.

use std::fmt;

use crate::blame::Blame;
use crate::document::stated;
use crate::number;

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

impl Blame for OutOfRange {}

impl OutOfRange {
    /// Creates the error from the name of the parameter, the value found and the permitted values.
    pub fn new(key: impl Into<String>, found: impl fmt::Display, expected: impl Into<String>) -> Self {
        Self {
            key: key.into(),
            found: found.to_string(),
            expected: expected.into(),
        }
    }
}

/// Parses finite numbers separated by commas.
pub fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let listed: Option<Vec<f64>> = text.split(',').map(|part| number::parsed(part.trim())).collect();
    let numbers = listed.and_then(|listed| listed.try_into().ok());
    numbers.ok_or_else(|| format!("expected {N} finite numbers separated by commas"))
}

/// Checks that a number is finite and `holds`.
pub fn check(key: &str, number: f64, holds: bool, expected: impl Into<String>) -> Result<(), OutOfRange> {
    if number.is_finite() && holds {
        Ok(())
    } else {
        Err(OutOfRange::new(key, number, expected))
    }
}

/// Checks that a number is in a range.
pub fn within(key: &str, number: f64, range: std::ops::RangeInclusive<f64>) -> Result<(), OutOfRange> {
    let expected = || format!("a number from {} to {}", range.start(), range.end());
    if range.contains(&number) {
        Ok(())
    } else {
        Err(OutOfRange::new(key, number, expected()))
    }
}

/// Range of a number in a table.
pub struct Range<T> {
    /// Key of the number.
    pub key: &'static str,
    /// The number, if a table states it.
    pub stated: fn(&T) -> Option<f64>,
    /// Whether a finite number is in the range.
    pub holds: fn(f64) -> bool,
    /// The range in words.
    pub expected: &'static str,
}

/// Ends of keys, and units in which their numbers are found instead, with the factor to that of the key.
const OTHER_UNITS: [(&str, &[(&str, f64)]); 5] = [
    ("_mhz", &[("Hz", 1e-6), ("kHz", 1e-3)]),
    ("_mm", &[("m", 1e3), ("um", 1e-3)]),
    ("_ms", &[("s", 1e3)]),
    ("_kpa", &[("Pa", 1e-3), ("MPa", 1e3)]),
    ("_deg", &[("rad", 180.0 / std::f64::consts::PI)]),
];

impl<T> Range<T> {
    fn excludes(&self, number: f64) -> bool {
        !(number.is_finite() && (self.holds)(number))
    }

    /// The range in words, and the unit in which an excluded number would be in it.
    fn expected_for(&self, number: f64) -> String {
        let is_of = |(end, _): &&(&str, _)| self.key.ends_with(end) && !self.key.ends_with("_per_mm");
        let units = OTHER_UNITS.iter().find(is_of).map_or(&[][..], |(_, units)| *units);
        let fits = units.iter().find(|(_, factor)| !self.excludes(number * factor));
        match fits {
            Some((unit, factor)) => {
                let rounded = format!("{:.4e}", number * factor)
                    .parse::<f64>()
                    .unwrap_or(number * factor);
                format!("{} (if it is in {unit}, state {rounded})", self.expected)
            }
            None => self.expected.to_owned(),
        }
    }
}

/// A table of parameters whose numbers have ranges; [`parameters!`] implements it.
pub trait Ranges: Sized + 'static {
    /// Keys of the table.
    const KEYS: &'static [&'static str];
    /// Ranges of the numbers that have one.
    const RANGES: &'static [Range<Self>];

    /// The first number out of its range, with its key and what is expected.
    fn out_of_range(&self) -> Option<(&'static str, f64, String)> {
        Self::RANGES.iter().find_map(|range| {
            let number = (range.stated)(self).filter(|number| range.excludes(*number))?;
            Some((range.key, number, range.expected_for(number)))
        })
    }

    /// Checks every number against its range.
    ///
    /// # Errors
    /// [`OutOfRange`] for the first that is outside.
    fn check_ranges(&self) -> Result<(), OutOfRange> {
        match self.out_of_range() {
            Some((key, number, expected)) => Err(OutOfRange::new(key, number, expected)),
            None => Ok(()),
        }
    }

    /// Checks a number against the range of a key.
    ///
    /// # Errors
    /// [`OutOfRange`] if it is outside.
    fn check_number(key: &str, number: f64) -> Result<(), OutOfRange> {
        match Self::RANGES
            .iter()
            .find(|range| range.key == key && range.excludes(number))
        {
            Some(range) => Err(OutOfRange::new(key, number, range.expected_for(number))),
            None => Ok(()),
        }
    }
}

/// A kind that decides which keys a table may have, such as a model.
pub trait Kind: Copy + PartialEq + 'static {
    /// The kind as a file states it, such as "`model = \"springs\"`".
    fn stated_as(self) -> String;
}

/// A table with keys that belong to some kinds only; [`parameters!`] implements it. For kinds that are few and fixed:
/// the fields of the struct are the keys of all of them. Where each kind of a registry declares its own keys, the table
/// is a [`KindTable`](crate::kinds::KindTable).
pub trait ByKind: erased_serde::Serialize {
    /// Kinds of the table.
    type Kind: Kind;
    /// Keys that belong to some kinds only, with those.
    const KINDS: &'static [(&'static str, &'static [Self::Kind])];
    /// Key of the kind itself, if the table states it.
    const FIELD: Option<&'static str>;

    /// The first stated key that does not belong to a kind, and the kinds to which it does, as files state them.
    fn misplaced(&self, kind: Self::Kind) -> Option<(&'static str, String)>
    where
        Self: Sized,
    {
        let others = Self::KINDS.iter().filter(|(_, kinds)| !kinds.contains(&kind));
        // All at once: the table is serialised to see which of its keys are stated.
        let (keys, kinds): (Vec<_>, Vec<_>) = others.copied().unzip();
        let key = stated(self, &keys)?;
        let index = keys.iter().position(|other| *other == key)?;
        Some((key, either(kinds[index])))
    }
}

/// Kinds as files state them, such as "`model = \"springs\"` or `model = \"beam\"`".
pub fn either<K: Kind>(kinds: &[K]) -> String {
    kinds
        .iter()
        .map(|kind| kind.stated_as())
        .collect::<Vec<_>>()
        .join(" or ")
}

#[doc(hidden)]
pub fn describe_kinds<T: ByKind<Kind = K>, K: Kind + serde::Serialize>(schema: &mut schemars::Schema) {
    describe_keys(schema, T::KINDS, T::FIELD);
}

/// Says in the schema of a table to which kinds its keys belong, and refuses them with the other kinds where the table
/// states its kind at `field`.
pub(crate) fn describe_keys<K: Kind + serde::Serialize>(
    schema: &mut schemars::Schema,
    keys: &[(&str, &[K])],
    field: Option<&str>,
) {
    use serde_json::{Map, Value, json};
    for (key, kinds) in keys {
        let description = &mut schema.ensure_object()["properties"][*key]["description"];
        *description = format!(
            "{}\n\nOnly with {}.",
            description.as_str().unwrap_or_default(),
            either(kinds)
        )
        .into();
    }
    let Some(field) = field else { return };
    let mut all: Vec<K> = Vec::new();
    for kind in keys.iter().flat_map(|(_, kinds)| *kinds) {
        if !all.contains(kind) {
            all.push(*kind);
        }
    }
    // A key with `false` as its schema may not be there: editors refuse it as the program does.
    let refused = |kind: &K| -> Map<String, Value> {
        let others = keys.iter().filter(|(_, kinds)| !kinds.contains(kind));
        others.map(|(key, _)| ((*key).to_owned(), Value::Bool(false))).collect()
    };
    let cases = all.iter().map(|kind| {
        json!({
            "if": { "properties": { field: { "const": kind } }, "required": [field] },
            "then": { "properties": refused(kind) },
        })
    });
    let cases: Vec<Value> = cases.collect();
    schema.insert("allOf".into(), cases.into());
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

impl Number for usize {
    fn stated(&self) -> Option<f64> {
        Some(*self as f64)
    }
}

impl<N: Number> Number for Option<N> {
    fn stated(&self) -> Option<f64> {
        self.as_ref().and_then(N::stated)
    }
}

/// Declares a table of parameters: each with its description, its type, its default after `=` if that is not the
/// default of the type, and its range with the unit for errors. Range and default thus stand once and reach `Default`,
/// [`Ranges`], the documentation and the JSON schema.
///
/// A range begins with `in LOW` or, without that number itself, `above LOW`; it ends with `..=HIGH`, with `..HIGH`,
/// which is not in it, or nowhere. In a table `with required keys`, all keys are required but those that are an
/// `Option` or `#[serde(default)]`, and there is no `Default`.
///
/// In a table `by KIND`, a [`Kind`], a key with `for A | B` before its range belongs to those variants of it only; with
/// `by KIND in FIELD` the table states its kind itself.
///
/// ```
/// use insonify_base::range::{Ranges, parameters};
///
/// parameters! {
///     /// A grid of the image.
///     pub struct Grid {
///         /// Depth of the image.
///         depth_mm: f64 = 80.0, in 5..=300 "mm";
///         /// Side of a pixel; that of the scanlines if it is left out.
///         pixel_mm: Option<f64>, above 0..=5 "mm";
///     }
/// }
///
/// let grid = Grid { pixel_mm: Some(0.0), ..Grid::default() };
/// assert_eq!(grid.out_of_range(), Some(("pixel_mm", 0.0, "above 0, at most 5 mm".to_owned())));
/// let grid = Grid { depth_mm: 0.15, ..Grid::default() };
/// assert_eq!(grid.out_of_range().unwrap().2, "5 to 300 mm (if it is in m, state 150)");
/// ```
#[macro_export]
macro_rules! parameters {
    ($(#[$meta:meta])* pub struct $name:ident $(with $required:ident keys)? $(by $Kind:ident $(in $field:ident)?)? {
        $(
            $(#[$doc:meta])* $key:ident: $type:ty $(= $default:expr)?
            $(, for $($kind:ident)|+)?
            $(, in $low:literal $(..=$high:literal)? $(..$below:literal)? $($unit:literal)?)?
            $(, above $over:literal $(..=$most:literal)? $(..$under:literal)? $($of:literal)?)?;
        )+
    }) => {
        // What depends on the options of the table is left to the arms below: a macro cannot choose within one
        // expansion.
        $crate::range::parameters! {
            @table [$($required)?]
            $(#[$meta])*
            $(#[schemars(transform = $crate::range::describe_kinds::<$name, $Kind>)])?
            pub struct $name {
                $(
                    $(#[$doc])*
                    $(
                        #[doc = concat!("Range: ", $crate::range::parameters!(@in $low $(..=$high)? $(..$below)? $(, $unit)?), ".")]
                        #[schemars(extend("minimum" = $low))]
                        $(#[schemars(extend("maximum" = $high))])?
                        $(#[schemars(extend("exclusiveMaximum" = $below))])?
                    )?
                    $(
                        #[doc = concat!("Range: ", $crate::range::parameters!(@above $over $(..=$most)? $(..$under)? $(, $of)?), ".")]
                        #[schemars(extend("exclusiveMinimum" = $over))]
                        $(#[schemars(extend("maximum" = $most))])?
                        $(#[schemars(extend("exclusiveMaximum" = $under))])?
                    )?
                    $(#[doc = concat!("Default ", stringify!($default), ".")])?
                    pub $key: $type,
                )+
            }
        }
        $crate::range::parameters! { @default [$($required)?] $name $($key [$($default)?])+ }
        $crate::range::parameters! { @kinds [$($Kind $($field)?)?] $name $($key [$([$($kind)+])?])+ }

        impl $crate::range::Ranges for $name {
            const KEYS: &'static [&'static str] = &[$(stringify!($key)),+];
            const RANGES: &'static [$crate::range::Range<Self>] = &[$(
                $($crate::range::Range {
                    key: stringify!($key),
                    stated: |table| $crate::range::Number::stated(&table.$key),
                    holds: |x| x >= f64::from($low) $(&& x <= f64::from($high))? $(&& x < f64::from($below))?,
                    expected: $crate::range::parameters!(@in $low $(..=$high)? $(..$below)? $(, $unit)?),
                },)?
                $($crate::range::Range {
                    key: stringify!($key),
                    stated: |table| $crate::range::Number::stated(&table.$key),
                    holds: |x| x > f64::from($over) $(&& x <= f64::from($most))? $(&& x < f64::from($under))?,
                    expected: $crate::range::parameters!(@above $over $(..=$most)? $(..$under)? $(, $of)?),
                },)?
            )+];
        }
    };
    (@table [] $($table:tt)+) => {
        #[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
        #[serde(deny_unknown_fields, default)]
        $($table)+
    };
    (@table [required] $($table:tt)+) => {
        #[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
        #[serde(deny_unknown_fields)]
        $($table)+
    };
    (@default [] $name:ident $($key:ident [$($default:expr)?])+) => {
        impl Default for $name {
            fn default() -> Self {
                Self { $($key: $crate::range::parameters!(@value $($default)?),)+ }
            }
        }
    };
    (@default [required] $name:ident $($key:ident [])+) => {};
    (@kinds [] $name:ident $($key:ident [])+) => {};
    (@kinds [$Kind:ident $($field:ident)?] $name:ident $($key:ident [$([$($kind:ident)+])?])+) => {
        impl $crate::range::ByKind for $name {
            type Kind = $Kind;
            const KINDS: &'static [(&'static str, &'static [$Kind])] = &[$($((stringify!($key), &[$($Kind::$kind),+]),)?)+];
            const FIELD: Option<&'static str> = $crate::range::parameters!(@field $($field)?);
        }
    };
    (@field) => { None };
    (@field $field:ident) => { Some(stringify!($field)) };
    (@value $default:expr) => { $default };
    (@value) => { Default::default() };
    (@in $low:literal..=$high:literal $(, $unit:literal)?) => { concat!($low, " to ", $high $(, " ", $unit)?) };
    (@in $low:literal..$below:literal $(, $unit:literal)?) => { concat!($low, " to below ", $below $(, " ", $unit)?) };
    (@in $low:literal $(, $unit:literal)?) => { concat!($low $(, " ", $unit)?, " or more") };
    (@above $low:literal..=$high:literal $(, $unit:literal)?) => { concat!("above ", $low, ", at most ", $high $(, " ", $unit)?) };
    (@above $low:literal..$below:literal $(, $unit:literal)?) => { concat!("above ", $low, ", below ", $below $(, " ", $unit)?) };
    (@above $low:literal $(, $unit:literal)?) => { concat!("above ", $low $(, " ", $unit)?) };
}
pub use parameters;
