//! Files that are no volumes: their kinds, by the first bytes or the ending of the name, and what to do with them.

use std::io::Read;
use std::path::{Path, PathBuf};

use super::error::{At, VolumeError, is_text, quoted};
use super::{FORMATS, format};
use insonify_base::read;

/// Number of bytes at the start of a file by which it is recognised.
const START: u64 = 4096;

/// Number of files of a folder that are looked at.
const FILES: usize = 100;

/// A kind of file.
struct Kind {
    name: &'static str,
    /// Bytes of such files; all of one row are there.
    marks: &'static [&'static [Mark]],
    /// Endings of file names in lower case; they count only where no marks are stated.
    endings: &'static [&'static str],
    /// What to do.
    instead: &'static str,
}

/// Bytes at an offset, or anywhere in the first bytes.
enum Mark {
    At(usize, &'static [u8]),
    Within(&'static [u8]),
}
use Mark::{At as Offset, Within};

const DICM: Mark = Offset(128, b"DICM");
const ARCHIVE: &str = "unpack it, and give the volume in it";
const NO_PLACE: &str =
    "it has neither spacing nor directions: save it as NIfTI or NRRD (with nibabel, pynrrd or SimpleITK)";
const NO_LABELS: &str = "it holds grey levels: labels come from a segmentation of it, as NIfTI, NRRD or MetaImage";
const SURFACE: &str = "labels are volumes: make one of it first (in 3D Slicer: import it as a segmentation, save that as .seg.nrrd); \
                       `insonify register --surface` fits a body to a surface";
const MESH: &str = "give a volume of labels; `insonify mesh info` looks into a mesh, and `mesh = \"FILE\"` in a file for `solve` or \
                    `insert` calculates on it as it is";
const CONVERT: &str = "save it as NIfTI, NRRD or MetaImage, with the program that wrote it";
const UNKNOWN_KIND: &str = "save what it holds as NIfTI, NRRD or MetaImage";

const SEGMENTATION: &str = if cfg!(feature = "dicom") {
    "give the file itself where labels are meant"
} else {
    "this program was built without the feature `dicom`; segimage2itkimage of dcmqi and 3D Slicer make NIfTI or NRRD of it"
};

/// Kinds in the order in which they are tried.
#[rustfmt::skip]
const KINDS: &[Kind] = &[
    Kind { name: "a pointer of Git LFS", marks: &[&[Offset(0, b"version https://git-lfs")]], endings: &[], instead: "fetch the file itself: git lfs pull" },
    Kind { name: "a web page", marks: &[&[Offset(0, b"<!DOCTYPE html")], &[Offset(0, b"<!doctype html")], &[Offset(0, b"<html")]], endings: &[], instead: "download the file itself" },
    Kind { name: "a DICOM segmentation (SEG)", marks: &[&[DICM, Within(b"1.2.840.10008.5.1.4.1.1.66.4")]], endings: &[], instead: SEGMENTATION },
    Kind { name: "a DICOM structure set (RTSTRUCT)", marks: &[&[DICM, Within(b"1.2.840.10008.5.1.4.1.1.481.3")]], endings: &[], instead: "its contours become labels with plastimatch convert, or in 3D Slicer" },
    Kind { name: "a CT slice in DICOM", marks: &[&[DICM, Within(b"1.2.840.10008.5.1.4.1.1.2\0")], &[DICM, Within(b"1.2.840.10008.5.1.4.1.1.2.1")]], endings: &[], instead: "labels come from a segmentation of the series (dcm2niix makes a volume of it, which TotalSegmentator segments); `volume.ct` takes the volume" },
    Kind { name: "an MR slice in DICOM", marks: &[&[DICM, Within(b"1.2.840.10008.5.1.4.1.1.4\0")], &[DICM, Within(b"1.2.840.10008.5.1.4.1.1.4.1")]], endings: &[], instead: "labels come from a segmentation of the series (dcm2niix makes a volume of it, which TotalSegmentator segments)" },
    Kind { name: "an ultrasound image in DICOM", marks: &[&[DICM, Within(b"1.2.840.10008.5.1.4.1.1.6.")], &[DICM, Within(b"1.2.840.10008.5.1.4.1.1.3.")]], endings: &[], instead: "it has no labels; `insonify match` and `insonify realism` compare frames with it" },
    Kind { name: "a DICOM file", marks: &[&[DICM], &[Offset(0, b"\x08\0\x05\0")], &[Offset(0, b"\x08\0\x08\0")], &[Offset(0, b"\x02\0\0\0\x55\x4c")]], endings: &[], instead: "convert labels in it to NIfTI, NRRD or MetaImage" },
    Kind { name: "a surface (STL)", marks: &[&[Offset(0, b"solid ")], &[Offset(0, b"solid\n")], &[Offset(0, b"solid\r")]], endings: &[".stl"], instead: SURFACE },
    Kind { name: "a surface (PLY)", marks: &[&[Offset(0, b"ply\n")], &[Offset(0, b"ply\r")]], endings: &[".ply"], instead: SURFACE },
    Kind { name: "a surface (OBJ)", marks: &[&[Offset(0, b"mtllib ")], &[Within(b"\nmtllib ")], &[Within(b"\nv "), Within(b"\nf ")]], endings: &[".obj"], instead: SURFACE },
    Kind { name: "a surface (VTK)", marks: &[&[Offset(0, b"# vtk DataFile"), Within(b"POLYDATA")], &[Within(b"<VTKFile"), Within(b"\"PolyData\"")]], endings: &[".vtp"], instead: SURFACE },
    Kind { name: "an image of VTK", marks: &[&[Offset(0, b"# vtk DataFile"), Within(b"STRUCTURED_POINTS")], &[Within(b"<VTKFile"), Within(b"\"ImageData\"")]], endings: &[".vti"], instead: "it has no anatomical directions: save it as NRRD or MetaImage, in 3D Slicer or ParaView" },
    Kind { name: "a mesh", marks: &[&[Offset(0, b"# vtk DataFile")], &[Within(b"<VTKFile")], &[Within(b"<Xdmf")], &[Offset(0, b"$MeshFormat")], &[Offset(0, b"MeshVersionFormatted")]], endings: &[".msh", ".vtu", ".xdmf", ".inp"], instead: MESH },
    Kind { name: "a scene of 3D Slicer", marks: &[&[Within(b"<MRML")]], endings: &[".mrml", ".mrb"], instead: "save its segmentation as .seg.nrrd" },
    Kind { name: "a configuration of PLUS", marks: &[&[Within(b"<PlusConfiguration")]], endings: &[], instead: "it places frames (`plus` in a scene), and has no labels" },
    Kind { name: "a surface (GIfTI)", marks: &[&[Within(b"<GIFTI")]], endings: &[".gii"], instead: SURFACE },
    Kind { name: "an XML file", marks: &[&[Offset(0, b"<?xml")]], endings: &[], instead: "give a volume of labels" },
    Kind { name: "a NumPy array", marks: &[&[Offset(0, b"\x93NUMPY")]], endings: &[".npy", ".npz"], instead: NO_PLACE },
    Kind { name: "a MATLAB file", marks: &[&[Offset(0, b"MATLAB ")]], endings: &[".mat"], instead: NO_PLACE },
    Kind { name: "an HDF5 file", marks: &[&[Offset(0, b"\x89HDF")], &[Offset(512, b"\x89HDF")]], endings: &[".h5", ".hdf5"], instead: "convert it to NIfTI (MINC: mnc2nii), or save the volume in it as NIfTI or NRRD" },
    Kind { name: "a NetCDF file", marks: &[&[Offset(0, b"CDF\x01")], &[Offset(0, b"CDF\x02")]], endings: &[".mnc"], instead: "convert it to NIfTI (MINC: mnc2nii)" },
    Kind { name: "a volume of FreeSurfer", marks: &[], endings: &[".mgh", ".mgz"], instead: "convert it to NIfTI: mri_convert IN.mgz OUT.nii.gz" },
    Kind { name: "a volume of MRtrix", marks: &[&[Offset(0, b"mrtrix image")]], endings: &[".mif"], instead: "convert it to NIfTI: mrconvert IN.mif OUT.nii.gz" },
    Kind { name: "a volume of Amira", marks: &[&[Offset(0, b"# AmiraMesh")], &[Offset(0, b"# Avizo")]], endings: &[".am"], instead: CONVERT },
    Kind { name: "a volume of AFNI", marks: &[], endings: &[".head", ".brik", ".brik.gz"], instead: "convert it to NIfTI: 3dAFNItoNIFTI IN+orig" },
    Kind { name: "a volume of Philips (PAR/REC)", marks: &[], endings: &[".par", ".rec"], instead: "convert it to NIfTI: parrec2nii of nibabel, or dcm2niix" },
    Kind { name: "a picture (PNG)", marks: &[&[Offset(0, b"\x89PNG")]], endings: &[".png"], instead: NO_PLACE },
    Kind { name: "a picture (JPEG)", marks: &[&[Offset(0, b"\xff\xd8\xff")]], endings: &[".jpg", ".jpeg"], instead: NO_LABELS },
    Kind { name: "a picture (GIF)", marks: &[&[Offset(0, b"GIF8")]], endings: &[".gif"], instead: NO_LABELS },
    Kind { name: "a picture (TIFF)", marks: &[&[Offset(0, b"II*\0")], &[Offset(0, b"MM\0*")], &[Offset(0, b"II+\0")]], endings: &[".tif", ".tiff"], instead: NO_PLACE },
    Kind { name: "a picture (BMP)", marks: &[], endings: &[".bmp"], instead: NO_PLACE },
    Kind { name: "a video", marks: &[&[Offset(4, b"ftyp")], &[Offset(0, b"RIFF")], &[Offset(0, b"\x1a\x45\xdf\xa3")]], endings: &[".mp4", ".avi"], instead: NO_LABELS },
    Kind { name: "a zip archive", marks: &[&[Offset(0, b"PK\x03\x04")]], endings: &[".zip"], instead: ARCHIVE },
    Kind { name: "a tar archive", marks: &[&[Offset(257, b"ustar")]], endings: &[".tar"], instead: ARCHIVE },
    Kind { name: "a packed file (bzip2, xz, zstd, 7z or rar)", marks: &[&[Offset(0, b"BZh")], &[Offset(0, b"\xfd7zXZ")], &[Offset(0, b"\x28\xb5\x2f\xfd")], &[Offset(0, b"7z\xbc\xaf")], &[Offset(0, b"Rar!")]], endings: &[], instead: ARCHIVE },
    Kind { name: "a list of points", marks: &[&[Offset(0, b"# Markups")], &[Within(b"markups-schema")]], endings: &[".fcsv", ".mrk.json"], instead: "give a volume of labels; points touched on a body fit it with `insonify register`" },
    Kind { name: "a PDF file", marks: &[&[Offset(0, b"%PDF")]], endings: &[], instead: UNKNOWN_KIND },
    Kind { name: "a file of numbers without a header", marks: &[], endings: &[".raw", ".zraw", ".raw.gz", ".bin", ".dat", ".img"], instead: "give its header: the .mhd, .nhdr or .hdr beside it" },
];

impl Kind {
    fn is(&self, start: &[u8], name: &str) -> bool {
        let marked = |mark: &Mark| match mark {
            Offset(offset, bytes) => start.get(*offset..).is_some_and(|rest| rest.starts_with(bytes)),
            Within(bytes) => start.windows(bytes.len()).any(|part| part == *bytes),
        };
        self.marks.iter().any(|all| all.iter().all(marked)) || self.endings.iter().any(|ending| name.ends_with(ending))
    }
}

/// Why a file with these first bytes is no volume.
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

/// Why a gzipped file with these first bytes, unpacked, is no volume.
pub(super) fn unpacked(path: &Path, start: &[u8]) -> VolumeError {
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
    let kind = kind_of(path, start)?;
    Some(VolumeError::unsupported(path, At::Byte(0), kind.name, kind.instead))
}

fn kind_of(path: &Path, start: &[u8]) -> Option<&'static Kind> {
    let name = path.to_string_lossy().to_ascii_lowercase();
    KINDS.iter().find(|kind| kind.is(start, &name))
}

/// Refusal of a folder without masks, by the first of its files that is of a known kind.
pub(crate) fn in_folder(folder: &Path) -> Option<VolumeError> {
    let entries = std::fs::read_dir(folder).ok()?;
    let mut paths: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    paths.sort();
    paths.iter().filter(|path| path.is_file()).take(FILES).find_map(|path| {
        let kind = kind_of(path, &start_of(path).ok()?)?;
        let name = path.file_name().unwrap_or_default().display();
        let found = format!("a folder with {} ({name}) and no mask", kind.name);
        Some(VolumeError::unsupported(folder, At::Folder, found, kind.instead))
    })
}

/// First bytes of a file.
pub(super) fn start_of(path: &Path) -> Result<Vec<u8>, VolumeError> {
    let mut start = Vec::new();
    read::open(path)
        .and_then(|file| file.take(START).read_to_end(&mut start))
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
                SEGMENTATION,
            ),
            ("a", dicom("1.2.840.10008.5.1.4.1.1.481.3"), "(RTSTRUCT)", "plastimatch"),
            (
                "a",
                dicom("1.2.840.10008.5.1.4.1.1.2"),
                "a CT slice in DICOM",
                "volume.ct",
            ),
            ("a", dicom("1.2.840.10008.5.1.4.1.1.20"), "a DICOM file", "convert"),
            ("a.stl", vec![0; 100], "a surface (STL)", "3D Slicer"),
            ("a", b"solid skin\nfacet".to_vec(), "a surface (STL)", "register"),
            (
                "a.obj",
                b"# by hand\nv 1 2 3\n".to_vec(),
                "a surface (OBJ)",
                "3D Slicer",
            ),
            (
                "a",
                b"# vtk DataFile Version 4.2\nx\nASCII\nDATASET POLYDATA".to_vec(),
                "a surface (VTK)",
                "3D Slicer",
            ),
            (
                "a",
                b"# vtk DataFile Version 4.2\nx\nASCII\nDATASET UNSTRUCTURED_GRID".to_vec(),
                "a mesh",
                "mesh info",
            ),
            ("a", b"<?xml version=\"1.0\"?>\n<Xdmf>".to_vec(), "a mesh", "mesh info"),
            ("a.npy", b"\x93NUMPY\x01\0".to_vec(), "a NumPy array", "nibabel"),
            ("a.npz", b"PK\x03\x04".to_vec(), "a NumPy array", "spacing"),
            ("a.zip", b"PK\x03\x04".to_vec(), "a zip archive", "unpack"),
            (
                "a",
                b"<?xml version=\"1.0\"?>\n<GIFTI>".to_vec(),
                "a surface (GIfTI)",
                "3D Slicer",
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
    }

    #[test]
    fn marks_are_those_of_one_kind() {
        for kind in KINDS {
            assert!(
                !kind.instead.is_empty() && (!kind.marks.is_empty() || !kind.endings.is_empty()),
                "{}",
                kind.name
            );
            for ending in kind.endings {
                assert!(
                    ending.starts_with('.') && *ending == ending.to_ascii_lowercase(),
                    "{ending}"
                );
            }
        }
    }
}
