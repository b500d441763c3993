//! Checks that outputs can be written, made before the computation.

use std::fs;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use super::OutputError;
use super::atomic::folder_of;
use super::staged::{self, StagedFile};

/// Mark of the pages of this program.
pub const GENERATOR: &str = "<meta name=\"generator\" content=\"insonify\">";

/// Files that are written under an ending.
#[derive(Clone, Copy, Debug)]
pub struct Written {
    /// Ending of their names, in lower case, with its dot.
    pub ending: &'static str,
    /// Bytes of which some are among the first of each of them.
    pub marks: &'static [&'static [u8]],
}

/// Number of leading bytes compared to identify the kind of an existing file.
const START: u64 = 512;

/// Checks that files can be written under these names: their folders exist and are writable, they are not folders and,
/// without `force`, none replaces one of the `inputs` or a file of another kind, where `formats` are kinds beside
/// pages, pictures and tables. Removes temporary files that killed runs left beside them.
///
/// # Errors
/// [`OutputError`] if a file cannot be written.
pub fn check(files: &[&Path], inputs: &[PathBuf], force: bool, formats: &[Written]) -> Result<(), OutputError> {
    for (index, path) in files.iter().enumerate() {
        if files[..index].iter().any(|other| same(other, path)) {
            return Err(OutputError::Twice {
                path: path.to_path_buf(),
            });
        }
        check_one(path, inputs, force, formats)?;
    }
    Ok(())
}

fn check_one(path: &Path, inputs: &[PathBuf], force: bool, formats: &[Written]) -> Result<(), OutputError> {
    let wrong = |expected| OutputError::Kind {
        path: path.to_owned(),
        expected,
    };
    let failed = |cause| OutputError::write(path, cause);
    match fs::metadata(path) {
        Ok(metadata) if !metadata.is_file() => return Err(wrong("a regular file")),
        Ok(_) if force => {}
        Ok(_) if inputs.iter().any(|input| same(input, path)) => {
            return Err(OutputError::Input { path: path.to_owned() });
        }
        Ok(metadata) if metadata.len() > 0 && !is_same_kind(path, formats).map_err(failed)? => {
            return Err(OutputError::Taken { path: path.to_owned() });
        }
        Err(error) if error.kind() == io::ErrorKind::NotADirectory => {
            return Err(wrong("a file in a folder; the path leads through a file"));
        }
        _ => {}
    }
    let folder = folder_of(path);
    if !folder.exists() {
        return Err(OutputError::NoFolder { path: path.to_owned() });
    }
    staged::clear_leftovers(folder);
    StagedFile::within(folder).map(drop).map_err(failed)?;
    Ok(())
}

/// Whether two paths refer to the same file: by identity if it exists, otherwise by name.
fn same(a: &Path, b: &Path) -> bool {
    let whole = |path: &Path| {
        let folder = fs::canonicalize(folder_of(path)).ok()?;
        Some(fs::canonicalize(path).unwrap_or(folder.join(path.file_name()?)))
    };
    whole(a).is_some_and(|a| whole(b) == Some(a))
}

/// Whether an existing file starts like those that are written under such names.
fn is_same_kind(path: &Path, formats: &[Written]) -> io::Result<bool> {
    let ending = path.extension().map(|ending| ending.to_ascii_lowercase());
    let name = path.to_string_lossy().to_ascii_lowercase();
    let format = formats.iter().find(|format| name.ends_with(format.ending));
    let marks: &[&[u8]] = match ending.as_ref().and_then(|ending| ending.to_str()) {
        _ if let Some(format) = format => format.marks,
        Some("npy") => &[b"\x93NUMPY"],
        Some("svg") => &[b"<svg"],
        Some("html") => &[GENERATOR.as_bytes()],
        Some("csv") => &[b"time_s", b"frame,line,window", b"frame,node"],
        Some("json") => &[b"\"frame\":"],
        _ => &[b"\x89PNG"],
    };
    let mut start = Vec::new();
    fs::File::open(path)?.take(START).read_to_end(&mut start)?;
    Ok(marks
        .iter()
        .any(|mark| start.windows(mark.len()).any(|part| part == *mark)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::blame::Blame;

    #[test]
    fn files_of_another_kind_and_inputs_stay() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for (name, text) in [
            ("a.vtu", "<?xml version=\"1.0\"?>\n<VTKFile>"),
            ("notes.vtu", "my notes"),
            ("notes", "my notes"),
            ("empty.png", ""),
            ("a.png", "\x7fPNG"),
        ] {
            fs::write(at(name), text).unwrap();
        }
        fs::create_dir(at("folder.vtu")).unwrap();
        let input = [at("a.vtu")];
        let formats = [Written {
            ending: ".vtu",
            marks: &[b"<VTKFile"],
        }];
        let checked = |name: &str, inputs: &[PathBuf], force| check(&[&at(name)], inputs, force, &formats);
        checked("a.vtu", &[], false).unwrap();
        checked("empty.png", &input, false).unwrap();
        checked("new.vtu", &input, false).unwrap();
        assert!(matches!(
            checked("a.vtu", &input, false),
            Err(OutputError::Input { .. })
        ));
        for name in ["notes.vtu", "notes", "a.png"] {
            assert!(
                matches!(checked(name, &[], false), Err(OutputError::Taken { .. })),
                "{name}"
            );
            checked(name, &input, true).unwrap();
        }
        checked("a.vtu", &input, true).unwrap();
        for name in ["folder.vtu", "notes/a.vtu"] {
            let refused = checked(name, &[], true).unwrap_err();
            assert!(
                matches!(refused, OutputError::Kind { .. }) && !refused.is_machine(),
                "{refused}"
            );
        }
        assert!(!checked("none/a.vtu", &[], true).unwrap_err().is_machine());
        let twice = check(&[&at("b.csv"), &at("./b.csv")], &[], false, &formats);
        assert!(matches!(twice, Err(OutputError::Twice { .. })), "{twice:?}");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 6);
    }
}
