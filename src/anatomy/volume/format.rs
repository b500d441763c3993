//! File formats of volumes. A format is a file of this folder with its [`Format`], and a line of [`formats!`].

use std::path::{Path, PathBuf};

use super::header::Header;
use super::{LabelVolume, VolumeError};
use insonify_base::output::place::Written;

/// A file format.
pub(crate) struct Format {
    /// Name in messages.
    pub(super) name: &'static str,
    /// Endings of file names, in lower case.
    pub(super) endings: &'static [&'static str],
    /// Extensions of files that hold the data alone, each with that of the header beside it.
    pub(super) data_extensions: &'static [(&'static str, &'static str)],
    /// Whether these are the first bytes of a header.
    pub(super) recognises: fn(&[u8]) -> bool,
    /// Reads a header.
    pub(super) read_header: fn(&Path) -> Result<Header, VolumeError>,
    /// Files that are written.
    pub(super) written: &'static [Written],
    /// Writes a volume under one of these endings.
    pub(super) write: fn(&LabelVolume, &Path) -> Result<(), VolumeError>,
}

/// Declares the formats by their modules.
macro_rules! formats {
    ($($module:ident;)+) => {
        $(mod $module;)+

        /// All formats. At most one recognises a file.
        const FORMATS: &[&format::Format] = &[$(&$module::FORMAT),+];
    };
}
pub(super) use formats;

/// Names of all formats, the last one behind a conjunction.
pub fn names(conjunction: &str) -> String {
    list(super::FORMATS.iter().map(|format| format.name), conjunction)
}

/// Files that [`save`](super::save) writes.
pub fn written() -> impl Iterator<Item = Written> {
    super::FORMATS.iter().flat_map(|format| format.written).copied()
}

/// Ending of the name of a volume's file, in lower case.
pub(crate) fn ending(name: &str) -> Option<&'static str> {
    let name = name.to_ascii_lowercase();
    let endings = super::FORMATS.iter().flat_map(|format| format.endings).copied();
    endings
        .filter(|ending| name.ends_with(ending))
        .max_by_key(|ending| ending.len())
}

/// The format of a file that holds data alone, by its extension, and the path of the header beside it; either may be
/// gzipped.
pub(crate) fn header_beside(path: &Path) -> Option<(&'static Format, PathBuf)> {
    let is_gzipped = path
        .extension()
        .is_some_and(|extension| extension.eq_ignore_ascii_case("gz"));
    let plain = if is_gzipped {
        path.with_extension("")
    } else {
        path.to_owned()
    };
    let extension = plain.extension()?;
    super::FORMATS.iter().find_map(|format| {
        let mut extensions = format.data_extensions.iter();
        let (_, header) = extensions.find(|(data, _)| extension.eq_ignore_ascii_case(data))?;
        let header = plain.with_extension(header);
        let packed = header.with_added_extension("gz");
        let beside = if packed.is_file() && !header.is_file() {
            packed
        } else {
            header
        };
        Some((*format, beside))
    })
}

/// A list in words.
pub(super) fn list(names: impl Iterator<Item = &'static str>, conjunction: &str) -> String {
    let names: Vec<&str> = names.collect();
    match names.split_last() {
        Some((last, others)) if !others.is_empty() => format!("{} {conjunction} {last}", others.join(", ")),
        _ => names.concat(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_written_file_is_one_of_its_format_and_starts_with_its_mark() {
        let folder = tempfile::tempdir().unwrap();
        let labels = vec![super::super::Label {
            value: 0,
            name: None,
            voxels: 8,
        }];
        let volume = LabelVolume::new([2; 3], vec![0; 8], labels, nalgebra::Matrix4::identity()).unwrap();
        for format in super::super::FORMATS {
            for written in format.written {
                let path = folder.path().join(format!("a{}", written.ending));
                (format.write)(&volume, &path).unwrap();
                let start = std::fs::read(&path).unwrap();
                let recognising: Vec<&str> = super::super::FORMATS
                    .iter()
                    .filter(|other| (other.recognises)(&start))
                    .map(|other| other.name)
                    .collect();
                assert_eq!(recognising, [format.name], "{}", written.ending);
                assert_eq!(ending(&path.to_string_lossy()), Some(written.ending));
                let marked = |mark: &&[u8]| start.windows(mark.len()).take(512).any(|part| part == *mark);
                assert!(written.marks.iter().any(marked), "{}", written.ending);
            }
            for ending in format.endings {
                assert!(ending.starts_with('.') && *ending == ending.to_ascii_lowercase());
            }
        }
    }

    #[test]
    fn lists_end_with_the_conjunction() {
        for (names, words) in [
            (&["a"][..], "a"),
            (&["a", "b"], "a or b"),
            (&["a", "b", "c"], "a, b or c"),
        ] {
            assert_eq!(list(names.iter().copied(), "or"), words);
        }
    }
}
