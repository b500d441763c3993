//! Files that are no volumes: refusals with their kind and what to do with them.

use std::io::Read;
use std::path::{Path, PathBuf};

use super::error::{At, VolumeError, is_text, quoted};
use super::{FORMATS, format};
use insonify_base::foreign::{Foreign, START};
use insonify_base::read;

/// Number of files of a folder that are looked at.
const FILES: usize = 100;

/// Refusal of a file with these first bytes.
pub(super) fn refusal(path: &Path, start: &[u8]) -> VolumeError {
    kind(path, start).unwrap_or_else(|| {
        let text = String::from_utf8_lossy(start);
        let found = if start.is_empty() {
            "an empty file".to_owned()
        } else if is_text(&text) {
            format!(
                "the text {}",
                quoted(text.lines().find(|line| !line.trim().is_empty()).unwrap_or_default())
            )
        } else {
            "a file of no known kind".to_owned()
        };
        let expected = format!("the start of a {} file", format::names("or"));
        VolumeError::malformed(path, At::Byte(0), found, expected)
    })
}

/// Refusal of a gzipped file with these first bytes, unpacked.
pub(super) fn unpacked(path: &Path, start: &[u8]) -> VolumeError {
    if start.starts_with(b"\x1f\x8b") {
        return VolumeError::unsupported(
            path,
            At::Byte(0),
            "a file that is gzipped twice",
            "unpack it once with gunzip",
        );
    }
    if let Some(format) = FORMATS.iter().find(|format| (format.recognises)(start)) {
        let found = format!("a gzipped {} file", format.name);
        let instead = "unpack it with gunzip: of files that are gzipped as a whole, NIfTI is read";
        return VolumeError::unsupported(path, At::Byte(0), found, instead);
    }
    kind(path, start).unwrap_or_else(|| {
        let found = "gzip data of no known kind";
        let expected = "a NIfTI header (of files gzipped as a whole, only NIfTI is read)";
        VolumeError::malformed(path, At::Byte(0), found, expected)
    })
}

/// Refusal of a file of a known kind.
fn kind(path: &Path, start: &[u8]) -> Option<VolumeError> {
    let kind = Foreign::of_file(path, start)?;
    Some(VolumeError::unsupported(path, At::Byte(0), kind.name, kind.labels?))
}

/// Refusal of a file that is an image of VTK.
pub(crate) fn image(path: &Path) -> Option<VolumeError> {
    let start = start_of(path).ok()?;
    Foreign::of_file(path, &start)
        .filter(|kind| kind.name == "an image of VTK")
        .and_then(|_| kind(path, &start))
}

/// Refusal of a folder without masks, by the first of its files that is of a known kind.
pub(crate) fn in_folder(folder: &Path) -> Option<VolumeError> {
    let entries = std::fs::read_dir(folder).ok()?;
    let mut paths: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    paths.sort();
    paths.iter().filter(|path| path.is_file()).take(FILES).find_map(|path| {
        let start = start_of(path).ok()?;
        let kind = Foreign::of_file(path, &start)?;
        let name = path.file_name().unwrap_or_default().display();
        let found = format!("a folder with {} ({name}) and no mask", kind.name);
        if is_read(&start) {
            let instead = format!("give the file itself: {}", path.display());
            return Some(VolumeError::unsupported(folder, At::Folder, found, instead));
        }
        Some(VolumeError::unsupported(folder, At::Folder, found, kind.labels?))
    })
}

/// Returns whether files with these first bytes are read as labels.
fn is_read(start: &[u8]) -> bool {
    #[cfg(feature = "dicom")]
    if super::dicom::recognises(start) {
        return true;
    }
    FORMATS.iter().any(|format| (format.recognises)(start))
}

/// First bytes of a file.
pub(super) fn start_of(path: &Path) -> Result<Vec<u8>, VolumeError> {
    let mut start = Vec::new();
    read::open(path)
        .and_then(|file| file.take(START as u64).read_to_end(&mut start))
        .map_err(|cause| VolumeError::read(path, cause))?;
    Ok(start)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_are_named_with_the_way_on_and_no_bytes() {
        let dicom = |class: &str| {
            let mut bytes = vec![0; 128];
            bytes.extend_from_slice(b"DICM\x02\0\x02\0UI\x1c\0");
            bytes.extend_from_slice(class.as_bytes());
            bytes.push(0);
            bytes
        };
        let mut late = vec![0; 512];
        late.extend_from_slice(b"\x89HDF\r\n");
        for (name, start, kind, instead) in [
            (
                "a",
                dicom("1.2.840.10008.5.1.4.1.1.66.4"),
                "a DICOM segmentation (SEG)",
                "the feature `dicom`",
            ),
            ("a", dicom("1.2.840.10008.5.1.4.1.1.481.3"), "(RTSTRUCT)", "plastimatch"),
            (
                "a",
                dicom("1.2.840.10008.5.1.4.1.1.2"),
                "a CT slice in DICOM",
                "volume.ct",
            ),
            ("a", dicom("1.2.840.10008.5.1.4.1.1.20"), "a DICOM file", "convert"),
            ("a.stl", vec![0; 100], "an STL surface", "closed surface"),
            ("a", b"solid skin\nfacet".to_vec(), "an STL surface", "register"),
            (
                "a.obj",
                b"# by hand\nv 1 2 3\n".to_vec(),
                "an OBJ surface",
                "closed surface",
            ),
            (
                "a",
                b"# vtk DataFile Version 4.2\nx\nASCII\nDATASET POLYDATA".to_vec(),
                "a VTK surface",
                "closed surface",
            ),
            (
                "a",
                b"# vtk DataFile Version 4.2\nx\nASCII\nDATASET UNSTRUCTURED_GRID".to_vec(),
                "a mesh",
                "mesh info",
            ),
            (
                "a",
                b"<?xml version=\"1.0\"?>\n<Xdmf>".to_vec(),
                "an XDMF file",
                "mesh info",
            ),
            ("a.npy", b"\x93NUMPY\x01\0".to_vec(), "a NumPy array", "nibabel"),
            ("a.npz", b"PK\x03\x04".to_vec(), "a NumPy array", "spacing"),
            ("a.zip", b"PK\x03\x04".to_vec(), "a zip archive", "unpack"),
            (
                "a",
                b"<?xml version=\"1.0\"?>\n<GIFTI>".to_vec(),
                "a GIfTI surface",
                "save it as STL",
            ),
            (
                "a+orig.HEAD",
                b"\n\ntype = x".to_vec(),
                "a volume of AFNI",
                "3dAFNItoNIFTI",
            ),
            ("a.mat", b"MATLAB 5.0 MAT-file".to_vec(), "a MATLAB file", "spacing"),
            ("a", late, "an HDF5 file", "convert"),
            ("a.png", b"\x89PNG\r\n\x1a\n".to_vec(), "a picture (PNG)", "spacing"),
            (
                "a.nii",
                b"version https://git-lfs.github.com/spec/v1\n".to_vec(),
                "a pointer of Git LFS",
                "git lfs pull",
            ),
            ("a.nii.gz", b"<!DOCTYPE html><html>".to_vec(), "a web page", "download"),
            ("a.raw", vec![7; 64], "numbers without a header", ".mhd"),
        ] {
            let message = refusal(Path::new(name), &start).to_string();
            assert!(message.contains(kind) && message.contains(instead), "{name}: {message}");
        }
        for (start, expected) in [
            (
                &b"version = 1\n[volume]\n"[..],
                "found the text \"version = 1\", expected the start of a NIfTI, NRRD or MetaImage file",
            ),
            (b"\n \nvalue\n", "found the text \"value\""),
            (b"", "found an empty file"),
            (b"\x01\x02\0\0\xff", "found a file of no known kind"),
        ] {
            let message = refusal(Path::new("a"), start).to_string();
            assert!(message.contains(expected), "{message}");
        }
        let message = unpacked(Path::new("a.nrrd.gz"), b"NRRD0004\n").to_string();
        assert!(
            message.contains("a gzipped NRRD file is not supported; unpack it"),
            "{message}"
        );
        let message = unpacked(Path::new("a.nii.gz"), b"\x1f\x8b\x08\0").to_string();
        assert!(
            message.contains("a file that is gzipped twice is not supported; unpack it once"),
            "{message}"
        );
        assert!(
            unpacked(Path::new("a.raw.gz"), &[0; 40])
                .to_string()
                .contains("numbers without a header")
        );
        assert!(
            unpacked(Path::new("a.gz"), &[0; 40])
                .to_string()
                .contains("of no known kind")
        );
    }

    #[test]
    fn a_folder_without_masks_is_told_by_its_files() {
        let folder = tempfile::tempdir().unwrap();
        assert!(in_folder(folder.path()).is_none());
        let mut slice = vec![0; 128];
        slice.extend_from_slice(b"DICM\x02\0\x02\0UI\x1a\x001.2.840.10008.5.1.4.1.1.2\0");
        for (name, bytes) in [("notes.txt", b"a note".to_vec()), ("slice_1", slice)] {
            std::fs::write(folder.path().join(name), bytes).unwrap();
        }
        let message = in_folder(folder.path()).unwrap().to_string();
        assert!(
            message.contains("a folder with a CT slice in DICOM (slice_1) and no mask") && message.contains("series"),
            "{message}"
        );
        let mut segmentation = vec![0; 128];
        segmentation.extend_from_slice(b"DICM\x02\0\x02\0UI\x1c\x001.2.840.10008.5.1.4.1.1.66.4\0");
        std::fs::write(folder.path().join("1.dcm"), segmentation).unwrap();
        let message = in_folder(folder.path()).unwrap().to_string();
        let way = if cfg!(feature = "dicom") {
            "give the file itself: "
        } else {
            "a build with the feature `dicom` reads it"
        };
        assert!(
            message.contains("a folder with a DICOM segmentation (SEG) (1.dcm) and no mask") && message.contains(way),
            "{message}"
        );
    }
}
