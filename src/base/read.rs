//! Opening and reading of files: regular files only, each within the limit of its kind and the memory.

use std::collections::BTreeSet;
use std::fs::{self, File, FileType};
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use crate::foreign::Foreign;
use crate::memory::{self, TooLarge};

/// A kind of file that is read into memory at once.
#[derive(Clone, Copy, Debug)]
pub struct Kind {
    /// Name of the kind, with an article.
    name: &'static str,
    /// Maximum size, bytes.
    most: u64,
}

/// Limit for pictures: 16-bit RGBA of 4096 x 4096 pixels fits.
pub const PICTURE: Kind = Kind {
    name: "a PNG or JPEG file",
    most: 128 << 20,
};
/// Limit for DICOM files: some minutes of compressed frames.
pub const DICOM: Kind = Kind {
    name: "a DICOM file",
    most: 512 << 20,
};
/// Limit for recordings: half an hour of steps of a millisecond.
pub const RECORDING: Kind = Kind {
    name: "a recording",
    most: 512 << 20,
};
/// Limit for scenes, scenarios and problems: a list of a million numbers fits.
pub const TOML: Kind = Kind {
    name: "a TOML file",
    most: 16 << 20,
};
/// Limit for paths, curves and points: a million poses fit.
pub const CSV: Kind = Kind {
    name: "a CSV file",
    most: 128 << 20,
};
/// Limit for configurations of PLUS, which have some kilobytes.
pub const XML: Kind = Kind {
    name: "an XML file",
    most: 16 << 20,
};
/// Limit for meshes: ten million nodes in text fit.
pub const MESH: Kind = Kind {
    name: "a mesh file",
    most: 4 << 30,
};

/// Allocations up to this size are not checked against the available memory, bytes.
const UNCHECKED: u64 = 1 << 20;

/// Why an existing file is not read.
#[derive(Debug, thiserror::Error)]
enum Refused {
    #[error("found {0}; expected a regular file")]
    Irregular(&'static str),
    #[error("found {found} bytes or more; expected {} of at most {} bytes", kind.name, kind.most)]
    TooLong { found: u64, kind: Kind },
    #[error("found a loop of symbolic links; expected a file")]
    Loop,
    #[error("found {0}; expected text in UTF-8")]
    NoText(String),
}

impl From<Refused> for io::Error {
    fn from(refused: Refused) -> Self {
        io::Error::new(io::ErrorKind::InvalidInput, refused)
    }
}

/// Files opened since [`record`].
static OPENED: Mutex<Option<BTreeSet<PathBuf>>> = Mutex::new(None);

fn opened() -> MutexGuard<'static, Option<BTreeSet<PathBuf>>> {
    OPENED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Notes from here on which files this process opens.
pub fn record() {
    opened().get_or_insert_default();
}

/// The regular files opened since [`record`], in the order of their paths.
pub fn recorded() -> Vec<PathBuf> {
    opened().iter().flatten().cloned().collect()
}

/// Opens a regular file, following symbolic links. Anything else is refused at once: a pipe or a device may never
/// end.
pub fn open(path: &Path) -> io::Result<File> {
    let kind = metadata(path)?.file_type();
    if kind.is_file() {
        if let Some(opened) = &mut *opened() {
            opened.insert(path.to_owned());
        }
        File::open(path)
    } else {
        Err(Refused::Irregular(name_of(kind)).into())
    }
}

/// Reads a regular file, or a pipe that this program was started with (`<(…)` of a shell, `/dev/stdin`).
pub fn bytes(path: &Path, kind: Kind) -> io::Result<Vec<u8>> {
    let metadata = metadata(path)?;
    let handed_over = ["/dev/fd", "/dev/stdin", "/proc/self/fd"]
        .iter()
        .any(|folder| path.starts_with(folder));
    let file = if handed_over && name_of(metadata.file_type()) == PIPE {
        File::open(path)?
    } else {
        open(path)?
    };
    let within = |found: u64| {
        if found > kind.most {
            Err(Refused::TooLong { found, kind })
        } else {
            Ok(())
        }
    };
    within(metadata.len())?;
    let mut bytes = room(metadata.len() as usize, kind.name)?;
    // One byte more than allowed: the length of a pipe is not known, and that of a file may grow while it is read.
    file.take(kind.most + 1).read_to_end(&mut bytes)?;
    within(bytes.len() as u64)?;
    Ok(bytes)
}

/// Reads a file as [`bytes`] does, as UTF-8 text without zeros.
pub fn text(path: &Path, kind: Kind) -> io::Result<String> {
    let mut bytes = bytes(path, kind)?;
    // Windows marks UTF-8 by U+FEFF at the start, which is no part of the text.
    bytes.drain(..if bytes.starts_with(b"\xef\xbb\xbf") { 3 } else { 0 });
    match String::from_utf8(bytes) {
        Ok(text) if !text.contains('\0') => Ok(text),
        Ok(text) => Err(no_text(text.as_bytes(), text.len())),
        Err(error) => Err(no_text(error.as_bytes(), error.utf8_error().valid_up_to())),
    }
}

/// Refusal of a file that is not UTF-8 from a byte on, or has zeros, by what it is.
fn no_text(bytes: &[u8], valid: usize) -> io::Error {
    let is_control = |byte: &u8| byte.is_ascii_control() && !byte.is_ascii_whitespace();
    let found = if matches!(bytes, [0xff, 0xfe, ..] | [0xfe, 0xff, ..]) {
        "text in UTF-16".to_owned()
    } else if let Some(kind) = Foreign::of(bytes) {
        kind.name.to_owned()
    } else if bytes.iter().any(is_control) {
        "binary data".to_owned()
    } else {
        let line = 1 + bytes[..valid].iter().filter(|byte| **byte == b'\n').count();
        format!("a character of another encoding in line {line}")
    };
    Refused::NoText(found).into()
}

/// Allocates capacity for exactly `count` values, which are part of `what`, after checking the available memory.
pub fn room<T>(count: usize, what: &str) -> Result<Vec<T>, TooLarge> {
    let needed = (count as u64).saturating_mul(size_of::<T>() as u64);
    if needed > UNCHECKED {
        memory::check(needed, what)?;
    }
    let mut values = Vec::new();
    values.try_reserve_exact(count).map_err(|_| TooLarge {
        what: what.to_owned(),
        needed,
        available: memory::available().unwrap_or(0) as u64,
    })?;
    Ok(values)
}

/// Whether an error is a failure of the machine, in contrast to files that are missing, forbidden, too long or not
/// regular.
pub fn is_machine(cause: &io::Error) -> bool {
    use io::ErrorKind as Kind;
    !matches!(
        cause.kind(),
        Kind::NotFound
            | Kind::PermissionDenied
            | Kind::IsADirectory
            | Kind::NotADirectory
            | Kind::InvalidInput
            | Kind::InvalidData
            | Kind::InvalidFilename
            | Kind::UnexpectedEof
    )
}

const PIPE: &str = "a pipe";

fn name_of(kind: FileType) -> &'static str {
    #[cfg(unix)]
    {
        use std::os::unix::fs::FileTypeExt;
        if kind.is_fifo() {
            return PIPE;
        } else if kind.is_block_device() || kind.is_char_device() {
            return "a device";
        } else if kind.is_socket() {
            return "a socket";
        }
    }
    if kind.is_dir() { "a folder" } else { "something else" }
}

fn metadata(path: &Path) -> io::Result<fs::Metadata> {
    fs::metadata(path).map_err(|cause| match format!("{:?}", cause.kind()).as_str() {
        // This kind has no stable name yet.
        "FilesystemLoop" => Refused::Loop.into(),
        _ => cause,
    })
}

#[cfg(all(test, unix))]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    const SMALL: Kind = Kind {
        name: "a small file",
        most: 4,
    };

    #[test]
    fn only_regular_files_are_read_and_links_to_them() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("file"), "abcd").unwrap();
        symlink(at("file"), at("link")).unwrap();
        symlink(at("loop"), at("loop")).unwrap();
        symlink(at("nowhere"), at("dangling")).unwrap();
        let pipe = std::process::Command::new("mkfifo").arg(at("pipe")).status().unwrap();
        assert!(pipe.success());
        assert_eq!(bytes(&at("link"), SMALL).unwrap(), b"abcd");
        for (name, says) in [
            ("/dev/zero", "found a device; expected a regular file"),
            ("pipe", "found a pipe"),
            (".", "found a folder"),
            ("loop", "a loop of symbolic links"),
            ("loop/deeper", "a loop of symbolic links"),
            ("dangling", "No such file"),
            ("file/deeper", "Not a directory"),
        ] {
            for error in [open(&at(name)).unwrap_err(), bytes(&at(name), SMALL).unwrap_err()] {
                assert!(error.to_string().contains(says), "{name}: {error}");
                assert!(!is_machine(&error), "{name}: {error}");
            }
        }
    }

    #[test]
    fn what_is_no_text_is_named_and_not_shown() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        for (bytes, found) in [
            (&b"a,b\n1,M\xfcller\n"[..], "a character of another encoding in line 2"),
            (b"\xff\xfea\0", "text in UTF-16"),
            (b"\x89PNG\r\n\x1a\n\xff", "a picture (PNG)"),
            (b"PK\x03\x04\0", "a zip archive"),
            (b"\x01\xff\xfe", "binary data"),
            (b"a,b\n\0\0", "binary data"),
        ] {
            fs::write(&path, bytes).unwrap();
            let error = text(&path, CSV).unwrap_err();
            assert_eq!(error.to_string(), format!("found {found}; expected text in UTF-8"));
            assert!(!is_machine(&error));
        }
        fs::write(&path, "a,b\r\n1,Müller\t\x0c\n").unwrap();
        assert!(text(&path, CSV).is_ok());
        fs::write(&path, "\u{feff}{}").unwrap();
        assert_eq!(text(&path, CSV).unwrap(), "{}");
    }

    #[test]
    fn what_is_too_long_or_beyond_the_memory_is_refused_with_its_size() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        fs::write(&path, "abcde").unwrap();
        let error = bytes(&path, SMALL).unwrap_err();
        let says = "found 5 bytes or more; expected a small file of at most 4 bytes";
        assert_eq!((error.to_string().as_str(), is_machine(&error)), (says, false));
        // Files of `/proc` report a size of 0 bytes.
        let error = bytes(Path::new("/proc/self/status"), SMALL).unwrap_err();
        assert_eq!(error.to_string(), says);
        let error = io::Error::from(room::<u64>(usize::MAX / 8, "a mesh").unwrap_err());
        assert!(
            is_machine(&error) && error.to_string().contains("18446744073709551608 bytes"),
            "{error}"
        );
    }
}
