//! User-written TOML files: parsing, errors that point at a line, and suggestions for misspelt words.

mod fault;
mod lists;
mod region;
mod renamed;
mod setting;
mod source;
mod suggest;
mod typed;

pub use fault::{Excerpt, InputError};
pub use lists::Table;
pub use region::{Names, NoRegion, RegionName, plain};
pub use setting::Setting;
pub use source::Source;
pub use suggest::{nearest, paths};

use std::borrow::Cow;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{DeserializeOwned, Deserializer, Error};
use serde::{Deserialize, Serialize, Serializer};

use crate::blame::Blame;
use crate::foreign::Foreign;
use crate::read;
use typed::Mismatch;

/// Error in the text of a file, its keys or its numbers.
#[derive(Debug, thiserror::Error)]
pub enum InvalidFile {
    /// The file cannot be read.
    #[error("{}: cannot be read: {cause}", path.display())]
    Read {
        /// Path of the file.
        path: PathBuf,
        /// Error of the operating system.
        cause: io::Error,
    },
    /// The text is not TOML, or a value has the wrong type.
    #[error("{0}")]
    Syntax(String),
    /// A key that is unknown in its table.
    #[error("unknown key `{key}`")]
    UnknownKey {
        /// The unknown key.
        key: String,
        /// Keys known in its table.
        known: Vec<String>,
    },
    /// Keys that contradict each other or are incomplete, or a number outside its range.
    #[error("found {found}; expected {expected}")]
    Keys {
        /// Keys or number found.
        found: String,
        /// Keys or range expected.
        expected: String,
    },
    /// A name, transform, pose, node or frame that the input lacks, with those that it has.
    #[error("{0}")]
    Unknown(String),
}

impl InvalidFile {
    /// Keys that contradict each other or are incomplete.
    pub fn keys(found: impl Into<String>, expected: impl Into<String>) -> Self {
        let (found, expected) = (found.into(), expected.into());
        Self::Keys { found, expected }
    }

    /// A number outside its range.
    pub fn number(found: f64, expected: impl Into<String>) -> Self {
        Self::keys(found.to_string(), expected)
    }

    /// A name that is unknown in the file.
    pub fn name(found: &str, expected: &str) -> Self {
        Self::Unknown(format!("unknown name \"{found}\"; expected {expected}"))
    }

    /// A node number outside the mesh.
    pub fn node(found: i64, nodes: usize) -> Self {
        Self::Unknown(format!(
            "found node {found}; the mesh has {nodes} nodes, numbered from 0"
        ))
    }
}

/// The machine is at fault where the file exists but cannot be read.
impl Blame for InvalidFile {
    fn is_machine(&self) -> bool {
        match self {
            Self::Read { cause, .. } => read::is_machine(cause),
            _ => false,
        }
    }
}

/// Implements reading, parsing and errors at keys for the type of an input file, which keeps its text in `source`; with
/// the name `in_ranges`, also that check.
#[macro_export]
macro_rules! input_file {
    ($file:ty $(, $in_ranges:ident)?) => {
        impl $file {
            /// Reads a file.
            ///
            /// # Errors
            /// An unreadable file, and those of [`parse`](Self::parse).
            pub fn read(path: &std::path::Path) -> Result<Self, $crate::document::InputError> {
                Self::parse(&$crate::document::read(path)?, &path.display().to_string())
            }

            /// Parses the text of a file; `name` is the file name shown in errors.
            ///
            /// # Errors
            /// A syntax error, an unknown key or a value of the wrong type, with its line.
            pub fn parse(text: &str, name: &str) -> Result<Self, $crate::document::InputError> {
                Self::parse_with(text, name, &[])
            }

            /// Parses the text of a file in which these keys are set. With an empty name there is no file: the
            /// settings are all.
            ///
            /// # Errors
            /// Those of [`parse`](Self::parse); one of a setting names its option in place of a line.
            pub fn parse_with(
                text: &str,
                name: &str,
                settings: &[$crate::document::Setting],
            ) -> Result<Self, $crate::document::InputError> {
                let (mut file, source): (Self, _) = $crate::document::parse(text, name, settings)?;
                file.source = Some(source);
                Ok(file)
            }

            /// Error at a key of this file.
            pub fn fault(
                &self,
                key: impl Into<String>,
                wrong: impl $crate::blame::Blame,
            ) -> $crate::document::InputError {
                $crate::document::InputError::new(wrong).at_key(key, self.source.as_ref())
            }

            /// Error of keys that contradict each other or are incomplete.
            pub fn wrong_keys(
                &self,
                key: impl Into<String>,
                found: impl Into<String>,
                expected: impl Into<String>,
            ) -> $crate::document::InputError {
                self.fault(key, $crate::document::InvalidFile::keys(found, expected))
            }

            $(
                /// Checks the numbers of a table of this file, if it is there, against their ranges.
                pub fn $in_ranges<'a, T: $crate::range::Ranges>(
                    &self,
                    table: &str,
                    of: impl Into<Option<&'a T>>,
                ) -> Result<(), $crate::document::InputError> {
                    match of.into().and_then(T::out_of_range) {
                        None => Ok(()),
                        Some((key, found, expected)) => {
                            let wrong = $crate::document::InvalidFile::number(found, expected);
                            Err(self.fault(format!("{table}.{key}"), wrong))
                        }
                    }
                }

                /// Refuses a key of a table of this file that does not belong to its kind.
                pub fn of_kind<T: $crate::range::ByKind>(
                    &self,
                    table: &str,
                    of: &T,
                    kind: T::Kind,
                ) -> Result<(), $crate::document::InputError> {
                    match of.misplaced(kind) {
                        None => Ok(()),
                        Some((key, expected)) => {
                            let found = format!("`{key}` with {}", $crate::range::Kind::stated_as(kind));
                            Err(self.wrong_keys(format!("{table}.{key}"), found, expected))
                        }
                    }
                }
            )?
        }
    };
}
pub use input_file;

/// Name and text of the built-in file that a path names, unless there is such a file.
pub fn bundled(files: &[(&'static str, &'static str)], path: &Path) -> Option<(&'static str, &'static str)> {
    let named = |(name, _): &&(&str, &str)| path.as_os_str() == *name && !path.is_file();
    files.iter().find(named).copied()
}

/// Reads the text of a file.
pub fn read(path: &Path) -> Result<String, InputError> {
    let other = |text: &str| {
        // No table of TOML begins so.
        let kind = match text.trim_start().as_bytes().first()? {
            b'<' => Foreign::of(text.as_bytes()).map_or("an XML file", |kind| kind.name),
            b'{' => "a JSON file",
            _ => return None,
        };
        let found = format!("found {kind}; expected a TOML file");
        Some(io::Error::new(io::ErrorKind::InvalidInput, found))
    };
    read::text(path, read::TOML)
        .and_then(|text| other(&text).map_or(Ok(text), Err))
        .map_err(|cause| {
            let path = path.to_owned();
            InputError::new(InvalidFile::Read { path, cause })
        })
}

/// Parses a text in which some keys are set, and keeps both for errors that point into them; `name` is the file name
/// shown in errors.
pub fn parse<T: DeserializeOwned + JsonSchema + 'static>(
    text: &str,
    name: &str,
    settings: &[Setting],
) -> Result<(T, Arc<Source>), InputError> {
    let source = Arc::new(Source::new(name, text, settings));
    match typed::read(&source) {
        Ok(parsed) => Ok((parsed, source)),
        Err(mut error) => {
            error.span = source.culprit::<T>(settings).or(error.span);
            Err(unreadable::<T>(&source, error))
        }
    }
}

/// Maximum number of parts of a dotted key (`toml`).
const MAX_PARTS: usize = 79;

/// Finds the first key with more than [`MAX_PARTS`] parts.
fn long_key(text: &str) -> Option<std::ops::Range<usize>> {
    let mut start = 0;
    for line in text.split_inclusive('\n') {
        let key = line.split(['=', '#', '\n']).next().unwrap_or_default();
        if key.matches('.').count() >= MAX_PARTS {
            return Some(start..start + key.trim_end().len());
        }
        start += line.len();
    }
    None
}

fn unreadable<T: JsonSchema + 'static>(source: &Arc<Source>, Mismatch { message, span }: Mismatch) -> InputError {
    // An empty span at the start is no place: the whole file lacks something.
    let span = span.filter(|span| !span.is_empty() || span.start > 0);
    if message == "recursion limit" {
        let problem = InvalidFile::Syntax(format!("a key of more than {MAX_PARTS} parts"));
        return InputError::new(problem).in_text(source, long_key(&source.text));
    }
    let Some((key, known)) = suggest::unknown_field(&message) else {
        let is_escape = message.contains("escape") || message.contains("unicode value");
        let escape = "a backslash begins an escape in \"...\": write `/`, or the string in single quotes";
        let help = suggest::unknown_variant(&message).or(is_escape.then(|| escape.to_owned()));
        return InputError::new(InvalidFile::Syntax(
            without_rust(message.trim_end()).replace('\n', "; "),
        ))
        .in_text(source, span)
        .with_help(help);
    };
    let known: Vec<String> = known
        .iter()
        .filter(|name| !renamed::is_old(name, &known))
        .cloned()
        .collect();
    let key_span = span.as_ref().and_then(|span| source.find_key(span, &key)).or(span);
    let help = suggest::for_key(&key, &known, || suggest::home_of::<T>(&key));
    InputError::new(InvalidFile::UnknownKey { key, known })
        .in_text(source, key_span)
        .with_help(help)
}

/// A table as TOML. A trait object: each type that files have is compiled for one serialiser, not for the four that
/// TOML has.
///
/// # Errors
/// Whatever TOML has no form for.
pub fn to_toml(table: &dyn erased_serde::Serialize) -> Result<String, toml::ser::Error> {
    toml::to_string(table)
}

/// The first of some keys that a table of a file states. The keys are optional ones or lists; an empty list counts as
/// not stated.
pub fn stated<'a>(table: &dyn erased_serde::Serialize, keys: &[&'a str]) -> Option<&'a str> {
    let table = toml::Table::try_from(table).ok()?;
    let is_empty = |value: &toml::Value| value.as_array().is_some_and(Vec::is_empty);
    let mut keys = keys.iter().copied();
    keys.find(|key| table.get(*key).is_some_and(|value| !is_empty(value)))
}

/// A value as a file states it, such as `"springs"` for a variant.
pub fn word(value: &dyn erased_serde::Serialize) -> String {
    serde_json::to_string(value).unwrap_or_default()
}

/// A message of serde without the terms of Rust. Only its first and last words are replaced, never text quoted from the
/// file.
fn without_rust(message: &str) -> String {
    let mut text = message.to_owned();
    for (rust, plain) in [
        ("unknown variant", "unknown value"),
        ("missing field", "missing key"),
        ("invalid type: map", "found a table"),
        ("invalid type: sequence", "found a list"),
        ("invalid type:", "found"),
        ("invalid value:", "found"),
        ("wanted string or table", "expected a string or a table"),
    ] {
        if message.starts_with(rust) {
            text.replace_range(..rust.len(), plain);
            break;
        }
    }
    let Some((start, expected)) = text.rsplit_once("expected ") else {
        return text;
    };
    let plain = match expected {
        "a sequence" => "a list",
        "a map" => "a table",
        "f32" | "f64" => "a number",
        "i32" | "i64" => "an integer",
        "u8" => "an integer from 0 to 255",
        "u32" | "u64" | "usize" => "an integer of 0 or more",
        _ if expected.starts_with("struct ") => "a table",
        _ if expected.starts_with("internally tagged enum ") => "a table with `kind`",
        _ => return text,
    };
    format!("{start}expected {plain}")
}

/// Format version of a file: 1 to `NEWEST`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Version<const NEWEST: i64 = 1>(i64);

impl<const NEWEST: i64> Version<NEWEST> {
    /// The newest version, which is the default of every file.
    pub const NEWEST: Self = Self(NEWEST);

    /// Number of the version.
    pub fn number(self) -> i64 {
        self.0
    }
}

impl<const NEWEST: i64> Serialize for Version<NEWEST> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_i64(self.0)
    }
}

impl<'de, const NEWEST: i64> Deserialize<'de> for Version<NEWEST> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let version = i64::deserialize(deserializer)?;
        if (1..=NEWEST).contains(&version) {
            return Ok(Self(version));
        }
        let older: String = (1..NEWEST).map(|older| format!("{older} or ")).collect();
        Err(D::Error::custom(format_args!(
            "found version {version} of the format; expected {older}{NEWEST}, which is the default"
        )))
    }
}

impl<const NEWEST: i64> JsonSchema for Version<NEWEST> {
    fn schema_name() -> Cow<'static, str> {
        format!("Version{NEWEST}").into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "enum": Vec::from_iter(1..=NEWEST) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn backslashes_of_paths_get_help() {
        for path in [r"C:\Users\me", r"C:\seg.nrrd", r"D:\data\x41"] {
            let wrong =
                parse::<std::collections::BTreeMap<String, String>>(&format!("file = \"{path}\""), "a.toml", &[])
                    .expect_err(path);
            assert!(
                wrong.help().is_some_and(|help| help.contains("single quotes")),
                "{wrong}"
            );
        }
    }

    #[test]
    fn messages_name_what_a_file_may_contain() {
        for (serde, plain) in [
            (
                "invalid type: map, expected a sequence",
                "found a table, expected a list",
            ),
            (
                "invalid type: sequence, expected a map",
                "found a list, expected a table",
            ),
            (
                "invalid type: integer `3`, expected struct VolumeSpec",
                "found integer `3`, expected a table",
            ),
            ("wanted string or table", "expected a string or a table"),
            ("missing field `name`", "missing key `name`"),
            (
                "invalid value: integer `300`, expected u8",
                "found integer `300`, expected an integer from 0 to 255",
            ),
            (
                "unknown variant `motor tables, found map`, expected `edge`",
                "unknown value `motor tables, found map`, expected `edge`",
            ),
            (
                "invalid type: string \"expected struct X\", expected f64",
                "found string \"expected struct X\", expected a number",
            ),
        ] {
            assert_eq!(without_rust(serde), plain);
        }
    }
}
