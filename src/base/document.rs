//! User-written TOML files: parsing, errors that point at a line, and suggestions for misspelt words.

mod fault;
mod home;
mod region;
mod renamed;
mod source;
mod suggest;
mod version;

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use schemars::JsonSchema;
use serde::de::DeserializeOwned;

pub use fault::Fault;
pub(crate) use region::{Names, plain};
pub use region::{NoRegion, RegionName};
pub use source::Source;
pub(crate) use suggest::nearest;
pub use version::Version;

use crate::base::read;

/// Why the text of a file cannot be parsed.
#[derive(Debug, thiserror::Error)]
pub enum Unreadable {
    /// The file cannot be read.
    #[error("{}: cannot be read: {cause}", path.display())]
    Read {
        /// Path of the file.
        path: PathBuf,
        /// Error of the operating system.
        cause: io::Error,
    },
    /// The file is not UTF-8 text.
    #[error("{}: byte {byte} is not UTF-8 text", path.display())]
    NotText {
        /// Path of the file.
        path: PathBuf,
        /// Offset of the first byte that is not UTF-8, from 0.
        byte: usize,
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
}

impl Unreadable {
    /// Whether the machine is at fault rather than the file: the file exists but cannot be read.
    pub fn is_machine(&self) -> bool {
        match self {
            Self::Read { cause, .. } => read::is_machine(cause),
            _ => false,
        }
    }
}

/// Reads the text of a file.
pub(crate) fn read<P: From<Unreadable>>(path: &Path) -> Result<String, Fault<P>> {
    let bytes = read::whole(path, read::TOML);
    let path = || path.to_owned();
    let bytes = bytes.map_err(|cause| Fault::new(Unreadable::Read { path: path(), cause }))?;
    String::from_utf8(bytes).map_err(|error| {
        let byte = error.utf8_error().valid_up_to();
        Fault::new(Unreadable::NotText { path: path(), byte })
    })
}

/// Parses a text and keeps it for errors that point into it; `name` is the file name shown in them.
pub(crate) fn parse<T: DeserializeOwned + JsonSchema, P: From<Unreadable>>(
    text: &str,
    name: &str,
) -> Result<(T, Arc<Source>), Fault<P>> {
    let source = Arc::new(Source::new(name, text));
    match toml::Deserializer::parse(text).and_then(T::deserialize) {
        Ok(parsed) => Ok((parsed, source)),
        Err(error) => Err(unreadable::<T, P>(&source, &error)),
    }
}

/// Maximum number of parts of a dotted key (`toml`).
const MOST_PARTS: usize = 79;

/// Finds the first key with more than [`MOST_PARTS`] parts.
fn long_key(text: &str) -> Option<std::ops::Range<usize>> {
    let mut start = 0;
    for line in text.split_inclusive('\n') {
        let key = line.split(['=', '#', '\n']).next().unwrap_or_default();
        if key.matches('.').count() >= MOST_PARTS {
            return Some(start..start + key.trim_end().len());
        }
        start += line.len();
    }
    None
}

fn unreadable<T: JsonSchema, P: From<Unreadable>>(source: &Arc<Source>, error: &toml::de::Error) -> Fault<P> {
    let message = error.message();
    let span = error.span().filter(|span| !span.is_empty() || span.start > 0);
    if message == "recursion limit" {
        let problem = Unreadable::Syntax(format!("a key of more than {MOST_PARTS} parts"));
        return Fault::new(problem).in_text(source, long_key(source.text()));
    }
    let Some((key, known)) = suggest::unknown_field(message) else {
        let help = suggest::unknown_variant(message);
        return Fault::new(Unreadable::Syntax(message.trim_end().replace('\n', "; ")))
            .in_text(source, span)
            .with_help(help);
    };
    let known: Vec<String> = known
        .iter()
        .filter(|name| !renamed::is_old(name, &known))
        .cloned()
        .collect();
    let place = span.as_ref().and_then(|span| source.find_key(span, &key)).or(span);
    let help = suggest::for_key(&key, &known, || home::home_of::<T>(&key));
    Fault::new(Unreadable::UnknownKey { key, known })
        .in_text(source, place)
        .with_help(help)
}
