//! Files of other kinds than the one expected, told by how they start or how their names end: messages name the kind
//! and what to do, not its bytes. A kind is a line of `KINDS`.

use std::path::Path;

/// A kind of file.
#[derive(Clone, Copy, Debug)]
pub struct Foreign {
    /// Name, with its article.
    pub name: &'static str,
    /// Bytes of such files; all of one row are there.
    marks: &'static [&'static [Mark]],
    /// Endings of file names in lower case.
    endings: &'static [&'static str],
    /// Remedy where a volume of labels is expected; `None` if the readers of volumes know the kind.
    pub labels: Option<&'static str>,
    /// Remedy where a mesh is expected; `None` if the readers of meshes know the kind.
    pub mesh: Option<&'static str>,
}

/// Bytes by which a file is recognised.
#[derive(Clone, Copy, Debug)]
enum Mark {
    /// At an offset.
    At(usize, &'static [u8]),
    /// Anywhere in the first bytes.
    Within(&'static [u8]),
    /// Recognised by a function.
    Is(fn(&[u8]) -> bool),
}
use Mark::{At, Is, Within};

/// Number of bytes at the start of a file by which it is recognised.
pub const START: usize = 4096;

const DICM: Mark = At(128, b"DICM");
const ARCHIVE: &str = "unpack it, and give the volume in it";
const NO_PLACE: &str =
    "it has neither spacing nor directions: save it as NIfTI or NRRD (with nibabel, pynrrd or SimpleITK)";
const NO_LABELS: &str = "it holds grey levels: labels come from a segmentation of it, as NIfTI, NRRD or MetaImage";
const SURFACE: &str = "where labels are expected, a closed surface is read by its ending (.stl, .ply, .obj, .vtk or .vtp); \
                       `insonify register --surface` fits a body to a surface";
const OTHER_SURFACE: &str = "save it as STL, PLY or OBJ: closed surfaces in these are read as labels";
const MESH: &str = "give a volume of labels; `insonify mesh info` looks into a mesh, and `mesh = \"FILE\"` in a file for `solve` or \
                    `insert` calculates on it as it is";
const OTHER_MESH: &str = "give a volume of labels; `insonify mesh info` looks into the mesh once it is .vtu";
const CONVERT: &str = "save it as NIfTI, NRRD or MetaImage, with the program that wrote it";
const UNKNOWN_KIND: &str = "save what it holds as NIfTI, NRRD or MetaImage";
const SEGMENTATION: &str = "where labels are expected, a build with the feature `dicom` reads it; segimage2itkimage of dcmqi and 3D Slicer \
                            make NIfTI or NRRD of it";

const TETRAHEDRA: Option<&str> = Some("a mesh of tetrahedra");
const FILLED: Option<&str> = Some("tetrahedra fill a closed surface by `insonify mesh make`, Gmsh or TetGen");
const OF_LABELS: Option<&str> = Some("`insonify mesh make` makes a mesh of labels");
const EXPORT: Option<&str> = Some("export it as VTK or Gmsh from the program that wrote it");
const PIECES: Option<&str> =
    Some("give the .vtu that it names, a time and a piece of it, or save it by ParaView's Save Data");
const MESHIO: Option<&str> = Some("`meshio convert a.xdmf a.vtu` (Python: meshio) converts such files");
const TETGEN: Option<&str> = Some("run `tetgen` with -k, which writes .vtk");
const MEDIT: Option<&str> = Some("`gmsh a.mesh -save -format msh41 -o a.msh` converts it");

/// All kinds; the first that recognises a file counts.
#[rustfmt::skip]
const KINDS: &[Foreign] = &[
    Foreign { name: "a pointer of Git LFS", marks: &[&[At(0, b"version https://git-lfs")]], endings: &[], labels: Some("fetch the file itself: git lfs pull"), mesh: Some("fetch the file itself: git lfs pull") },
    Foreign { name: "a web page", marks: &[&[At(0, b"<!DOCTYPE html")], &[At(0, b"<!doctype html")], &[At(0, b"<html")]], endings: &[], labels: Some("download the file itself"), mesh: Some("download the file itself") },
    Foreign { name: "a DICOM segmentation (SEG)", marks: &[&[DICM, Within(b"1.2.840.10008.5.1.4.1.1.66.4")], &[DICM, Within(b"1.2.840.10008.5.1.4.1.1.66.7")]], endings: &[], labels: Some(SEGMENTATION), mesh: OF_LABELS },
    Foreign { name: "a DICOM structure set (RTSTRUCT)", marks: &[&[DICM, Within(b"1.2.840.10008.5.1.4.1.1.481.3")]], endings: &[], labels: Some("its contours become labels with plastimatch convert, or in 3D Slicer"), mesh: OF_LABELS },
    Foreign { name: "a CT slice in DICOM", marks: &[&[DICM, Within(b"1.2.840.10008.5.1.4.1.1.2\0")], &[DICM, Within(b"1.2.840.10008.5.1.4.1.1.2.1")]], endings: &[], labels: Some("labels come from a segmentation of the series (dcm2niix makes a volume of it, which TotalSegmentator segments); `volume.ct` takes the volume"), mesh: OF_LABELS },
    Foreign { name: "an MR slice in DICOM", marks: &[&[DICM, Within(b"1.2.840.10008.5.1.4.1.1.4\0")], &[DICM, Within(b"1.2.840.10008.5.1.4.1.1.4.1")]], endings: &[], labels: Some("labels come from a segmentation of the series (dcm2niix makes a volume of it, which TotalSegmentator segments)"), mesh: OF_LABELS },
    Foreign { name: "an ultrasound image in DICOM", marks: &[&[DICM, Within(b"1.2.840.10008.5.1.4.1.1.6.")], &[DICM, Within(b"1.2.840.10008.5.1.4.1.1.3.")]], endings: &[], labels: Some("it has no labels; `insonify match` and `insonify realism` compare frames with it"), mesh: OF_LABELS },
    Foreign { name: "a DICOM file", marks: &[&[DICM], &[At(0, b"\x08\0\x05\0")], &[At(0, b"\x08\0\x08\0")], &[At(0, b"\x02\0\0\0\x55\x4c")]], endings: &[], labels: Some("convert labels in it to NIfTI, NRRD or MetaImage"), mesh: OF_LABELS },
    Foreign { name: "an STL surface", marks: &[&[Is(is_stl)]], endings: &[".stl"], labels: Some(SURFACE), mesh: FILLED },
    Foreign { name: "a PLY surface", marks: &[&[At(0, b"ply\n")], &[At(0, b"ply\r")]], endings: &[".ply"], labels: Some(SURFACE), mesh: FILLED },
    Foreign { name: "an OBJ surface", marks: &[&[Is(is_obj)]], endings: &[".obj"], labels: Some(SURFACE), mesh: FILLED },
    Foreign { name: "a VTK surface", marks: &[&[At(0, b"# vtk DataFile"), Within(b"POLYDATA")], &[Within(b"<VTKFile"), Within(b"\"PolyData\"")]], endings: &[".vtp"], labels: Some(SURFACE), mesh: None },
    Foreign { name: "an image of VTK", marks: &[&[At(0, b"# vtk DataFile"), Within(b"STRUCTURED_POINTS")], &[At(0, b"# vtk DataFile"), Within(b"RECTILINEAR_GRID")], &[Within(b"<VTKFile"), Within(b"\"ImageData\"")]], endings: &[".vti"], labels: Some("it has no anatomical directions: save it as NRRD or MetaImage, in 3D Slicer or ParaView"), mesh: Some("saved as NRRD or MetaImage (3D Slicer, ParaView), it is for `insonify mesh make`") },
    Foreign { name: "a list of VTK files", marks: &[&[Within(b"<VTKFile"), Within(b"\"Collection\"")], &[Within(b"<VTKFile"), Within(b"\"PUnstructuredGrid\"")], &[Within(b"<VTKFile"), Within(b"\"vtkMultiBlockDataSet\"")]], endings: &[".pvd", ".pvtu", ".vtm"], labels: Some(MESH), mesh: PIECES },
    Foreign { name: "an XDMF file", marks: &[&[Within(b"<Xdmf")]], endings: &[".xdmf"], labels: Some(OTHER_MESH), mesh: MESHIO },
    Foreign { name: "a FEBio file", marks: &[&[Within(b"<febio_spec")]], endings: &[".feb"], labels: Some(OTHER_MESH), mesh: EXPORT },
    Foreign { name: "an LS-DYNA file", marks: &[&[At(0, b"*KEYWORD")], &[Within(b"\n*KEYWORD")]], endings: &[], labels: Some(OTHER_MESH), mesh: EXPORT },
    Foreign { name: "a Nastran file", marks: &[&[Within(b"BEGIN BULK")], &[At(0, b"GRID")], &[Within(b"\nGRID")]], endings: &[".bdf", ".nas"], labels: Some(OTHER_MESH), mesh: MESHIO },
    Foreign { name: "an Abaqus file", marks: &[&[Is(is_abaqus)]], endings: &[".inp"], labels: Some(OTHER_MESH), mesh: MESHIO },
    Foreign { name: "a Medit file", marks: &[&[Is(is_medit)]], endings: &[], labels: Some(OTHER_MESH), mesh: MEDIT },
    Foreign { name: "a TetGen file", marks: &[&[Is(is_tetgen)]], endings: &[], labels: Some(OTHER_MESH), mesh: TETGEN },
    Foreign { name: "a mesh", marks: &[&[At(0, b"# vtk DataFile")], &[Within(b"<VTKFile")], &[At(0, b"$MeshFormat")]], endings: &[".msh", ".vtu"], labels: Some(MESH), mesh: None },
    Foreign { name: "a scene of 3D Slicer", marks: &[&[Within(b"<MRML")]], endings: &[".mrml", ".mrb"], labels: Some("save its segmentation as .seg.nrrd"), mesh: TETRAHEDRA },
    Foreign { name: "a configuration of PLUS", marks: &[&[Within(b"<PlusConfiguration")]], endings: &[], labels: Some("it places frames (`plus_config` in a scene), and has no labels"), mesh: TETRAHEDRA },
    Foreign { name: "a scene of glTF", marks: &[&[At(0, b"glTF")]], endings: &[".glb", ".gltf"], labels: Some(OTHER_SURFACE), mesh: FILLED },
    Foreign { name: "a GIfTI surface", marks: &[&[Within(b"<GIFTI")]], endings: &[".gii"], labels: Some(OTHER_SURFACE), mesh: FILLED },
    Foreign { name: "an XML file", marks: &[&[At(0, b"<?xml")]], endings: &[], labels: Some("give a volume of labels"), mesh: None },
    Foreign { name: "a NumPy array", marks: &[&[At(0, b"\x93NUMPY")]], endings: &[".npy", ".npz"], labels: Some(NO_PLACE), mesh: TETRAHEDRA },
    Foreign { name: "a MATLAB file", marks: &[&[At(0, b"MATLAB ")]], endings: &[".mat"], labels: Some(NO_PLACE), mesh: TETRAHEDRA },
    Foreign { name: "an HDF5 file", marks: &[&[At(0, b"\x89HDF")], &[At(512, b"\x89HDF")]], endings: &[".h5", ".hdf5"], labels: Some("convert it to NIfTI (MINC: mnc2nii), or save the volume in it as NIfTI or NRRD"), mesh: MESHIO },
    Foreign { name: "a NetCDF or Exodus file", marks: &[&[At(0, b"CDF\x01")], &[At(0, b"CDF\x02")]], endings: &[".mnc"], labels: Some("convert it to NIfTI (MINC: mnc2nii)"), mesh: MESHIO },
    Foreign { name: "a volume of FreeSurfer", marks: &[], endings: &[".mgh", ".mgz"], labels: Some("convert it to NIfTI: mri_convert IN.mgz OUT.nii.gz"), mesh: OF_LABELS },
    Foreign { name: "a volume of MRtrix", marks: &[&[At(0, b"mrtrix image")]], endings: &[".mif"], labels: Some("convert it to NIfTI: mrconvert IN.mif OUT.nii.gz"), mesh: OF_LABELS },
    Foreign { name: "a volume of Amira", marks: &[&[At(0, b"# AmiraMesh")], &[At(0, b"# Avizo")]], endings: &[".am"], labels: Some(CONVERT), mesh: OF_LABELS },
    Foreign { name: "a volume of AFNI", marks: &[], endings: &[".head", ".brik", ".brik.gz"], labels: Some("convert it to NIfTI: 3dAFNItoNIFTI IN+orig"), mesh: OF_LABELS },
    Foreign { name: "a volume of Philips (PAR/REC)", marks: &[], endings: &[".par", ".rec"], labels: Some("convert it to NIfTI: parrec2nii of nibabel, or dcm2niix"), mesh: OF_LABELS },
    Foreign { name: "a picture (PNG)", marks: &[&[At(0, b"\x89PNG")]], endings: &[".png"], labels: Some(NO_PLACE), mesh: TETRAHEDRA },
    Foreign { name: "a picture (JPEG)", marks: &[&[At(0, b"\xff\xd8\xff")]], endings: &[".jpg", ".jpeg"], labels: Some(NO_LABELS), mesh: TETRAHEDRA },
    Foreign { name: "a picture (GIF)", marks: &[&[At(0, b"GIF8")]], endings: &[".gif"], labels: Some(NO_LABELS), mesh: TETRAHEDRA },
    Foreign { name: "a picture (TIFF)", marks: &[&[At(0, b"II*\0")], &[At(0, b"MM\0*")], &[At(0, b"II+\0")]], endings: &[".tif", ".tiff"], labels: Some(NO_PLACE), mesh: TETRAHEDRA },
    Foreign { name: "a picture (BMP)", marks: &[], endings: &[".bmp"], labels: Some(NO_PLACE), mesh: TETRAHEDRA },
    Foreign { name: "a video", marks: &[&[At(4, b"ftyp")], &[At(0, b"RIFF")], &[At(0, b"\x1a\x45\xdf\xa3")]], endings: &[".mp4", ".avi"], labels: Some(NO_LABELS), mesh: TETRAHEDRA },
    Foreign { name: "a zip archive", marks: &[&[At(0, b"PK\x03\x04")]], endings: &[".zip"], labels: Some(ARCHIVE), mesh: Some("unpack it") },
    Foreign { name: "a tar archive", marks: &[&[At(257, b"ustar")]], endings: &[".tar"], labels: Some(ARCHIVE), mesh: Some("unpack it") },
    Foreign { name: "a packed file (bzip2, xz, zstd, 7z or rar)", marks: &[&[At(0, b"BZh")], &[At(0, b"\xfd7zXZ")], &[At(0, b"\x28\xb5\x2f\xfd")], &[At(0, b"7z\xbc\xaf")], &[At(0, b"Rar!")]], endings: &[], labels: Some(ARCHIVE), mesh: Some("unpack it") },
    Foreign { name: "a list of points", marks: &[&[At(0, b"# Markups")], &[Within(b"markups-schema")]], endings: &[".fcsv", ".mrk.json"], labels: Some("give a volume of labels; points touched on a body fit it with `insonify register`"), mesh: TETRAHEDRA },
    Foreign { name: "a PDF file", marks: &[&[At(0, b"%PDF")]], endings: &[], labels: Some(UNKNOWN_KIND), mesh: TETRAHEDRA },
    Foreign { name: "a file of numbers without a header", marks: &[], endings: &[".raw", ".zraw", ".raw.gz", ".bin", ".dat", ".img"], labels: Some("give its header: the .mhd, .nhdr or .hdr beside it"), mesh: TETRAHEDRA },
    Foreign { name: "NIfTI labels", marks: &[&[At(344, b"n+1")], &[At(0, b"\x5c\x01\0\0")]], endings: &[], labels: None, mesh: OF_LABELS },
    Foreign { name: "NRRD labels", marks: &[&[At(0, b"NRRD000")]], endings: &[], labels: None, mesh: OF_LABELS },
    Foreign { name: "MetaImage labels", marks: &[&[At(0, b"ObjectType")], &[At(0, b"NDims")]], endings: &[], labels: None, mesh: OF_LABELS },
    Foreign { name: "a compressed file (gzip)", marks: &[&[At(0, b"\x1f\x8b")]], endings: &[], labels: None, mesh: Some("unpack it; `insonify mesh make` makes a mesh of labels") },
];

impl Foreign {
    /// Kind of a file by its first bytes, [`START`] of them or all.
    pub fn of(start: &[u8]) -> Option<&'static Foreign> {
        let start = &start[..start.len().min(START)];
        KINDS.iter().find(|kind| kind.is_marked(start))
    }

    /// Kind of a file by its first bytes or, where those of no earlier kind are there, by its ending.
    pub fn of_file(path: &Path, start: &[u8]) -> Option<&'static Foreign> {
        let start = &start[..start.len().min(START)];
        let name = path.to_string_lossy().to_ascii_lowercase();
        KINDS
            .iter()
            .find(|kind| kind.is_marked(start) || kind.endings.iter().any(|ending| name.ends_with(ending)))
    }

    fn is_marked(&self, start: &[u8]) -> bool {
        let is_there = |mark: &Mark| match mark {
            At(offset, bytes) => start.get(*offset..).is_some_and(|rest| rest.starts_with(bytes)),
            Within(bytes) => has(start, bytes),
            Is(is_such) => is_such(start),
        };
        self.marks.iter().any(|all| all.iter().all(is_there))
    }
}

fn has(start: &[u8], words: &[u8]) -> bool {
    start.windows(words.len()).any(|window| window == words)
}

/// Lines of a text that are neither empty nor comments; none where the file is no text.
fn lines(start: &[u8]) -> impl Iterator<Item = &str> {
    let text = std::str::from_utf8(start).unwrap_or_else(|error| {
        // A character may be cut at the end.
        let whole = if error.error_len().is_none() {
            error.valid_up_to()
        } else {
            0
        };
        std::str::from_utf8(&start[..whole]).unwrap_or_default()
    });
    text.lines()
        .map(str::trim)
        .filter(|line| !line.is_empty() && !line.starts_with('#'))
}

/// A keyword or a comment: one asterisk before a letter, or two.
fn is_abaqus(start: &[u8]) -> bool {
    let next = start.get(1).copied().unwrap_or_default();
    start.starts_with(b"*") && (next.is_ascii_alphabetic() || next == b'*')
}

fn is_medit(start: &[u8]) -> bool {
    start.trim_ascii_start().starts_with(b"MeshVersionFormatted")
}

/// Two to four counts in the first line, numbers in the second.
fn is_tetgen(start: &[u8]) -> bool {
    let mut lines = lines(start);
    let counts = lines
        .next()
        .unwrap_or_default()
        .split_whitespace()
        .map(str::parse::<u32>);
    let counts: Vec<bool> = counts.map(|count| count.is_ok()).collect();
    let row = lines
        .next()
        .unwrap_or_default()
        .split_whitespace()
        .map(str::parse::<f64>);
    let row: Vec<bool> = row.map(|number| number.is_ok()).collect();
    (2..=4).contains(&counts.len()) && row.len() >= 4 && counts.iter().chain(&row).all(|is_number| *is_number)
}

/// A vertex after comments and names of groups and materials.
fn is_obj(start: &[u8]) -> bool {
    let word = |line: &str| line.split_whitespace().next().unwrap_or_default().to_owned();
    let named = ["mtllib", "o", "g", "usemtl", "s", "vn", "vt"];
    lines(start)
        .map(word)
        .find(|word| !named.contains(&word.as_str()))
        .is_some_and(|word| word == "v")
}

/// `solid` with a facet, or 80 bytes of title and a count of triangles in the bytes of such a file.
fn is_stl(start: &[u8]) -> bool {
    if start.trim_ascii_start().starts_with(b"solid") && has(start, b"facet") {
        return true;
    }
    // The count and the attributes of the first triangle have few values: zeros follow fixed distances.
    let count = start
        .get(80..84)
        .map(|bytes| u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]));
    let coordinates = start.get(84..132).unwrap_or_default().as_chunks::<4>().0;
    let plausible = |word: &[u8; 4]| {
        let x = f32::from_le_bytes(*word).abs();
        x == 0.0 || (1e-30..=1e7).contains(&x)
    };
    count.is_some_and(|count| (1..100_000_000).contains(&count))
        && coordinates.len() == 12
        && coordinates.iter().all(plausible)
        && coordinates.iter().any(|word| f32::from_le_bytes(*word) != 0.0)
        && start.get(132..134) == Some(&[0, 0])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_are_told_apart() {
        let mut stl = vec![b'x'; 80];
        stl.extend(2u32.to_le_bytes());
        stl.extend(
            [0.0f32, 0.0, 1.0, 5.0, -3.0, 2.0, 8.0, 1.0, 0.5, 3.0, 2.0, 1.0]
                .iter()
                .flat_map(|x| x.to_le_bytes()),
        );
        stl.extend([0, 0, 7, 7]);
        for (start, name) in [
            (&b"\x89HDF\r\n\x1a\nrest"[..], "an HDF5 file"),
            (b"<?xml version=\"1.0\"?>\n<Xdmf Version=\"3.0\">", "an XDMF file"),
            (b"*HEADING\nAbaqus", "an Abaqus file"),
            (b"** by hand\n*NODE", "an Abaqus file"),
            (b"$ title\n*KEYWORD\n", "an LS-DYNA file"),
            (b"$ title\nBEGIN BULK\nGRID*   1", "a Nastran file"),
            (b"<VTKFile type=\"PUnstructuredGrid\">", "a list of VTK files"),
            (b"<VTKFile type=\"Collection\">", "a list of VTK files"),
            (b"<VTKFile type=\"ImageData\">", "an image of VTK"),
            (b"glTF\x02\0", "a scene of glTF"),
            (b"MeshVersionFormatted 2\n", "a Medit file"),
            (b"# by meshio\n480 4 0\n0 90 76 58 151\n", "a TetGen file"),
            (b"159 3 0 0\n1 0.0 0.5 1e-3\n", "a TetGen file"),
            (b"ply\nformat ascii 1.0\n", "a PLY surface"),
            (b"# made by hand\nmtllib a.mtl\no liver\nv 1 2 3\n", "an OBJ surface"),
            (b" solid skin\n facet normal 0 0 1\n", "an STL surface"),
            (&stl, "an STL surface"),
            (b"NRRD0004\n", "NRRD labels"),
            (b"\x1f\x8b\x08", "a compressed file (gzip)"),
        ] {
            assert_eq!(Foreign::of(start).map(|kind| kind.name), Some(name));
        }
        for start in [
            &b"$MeshFormat\n"[..],
            b"# vtk DataFile Version 4.2\n",
            b"# vtk DataFile Version 4.2\nx\nASCII\nDATASET POLYDATA",
            b"<?xml version=\"1.0\"?>\n<VTKFile type=",
            b"<?xml version=\"1.0\"?>\n",
        ] {
            assert_eq!(Foreign::of(start).map(|kind| kind.mesh), Some(None), "{start:?}");
        }
        for start in [&b"solid x"[..], b"", b"1 2\nv", b"x_mm,y_mm,z_mm\n1,2,3", &[0; 200]] {
            assert_eq!(Foreign::of(start).map(|kind| kind.name), None, "{start:?}");
        }
    }

    #[test]
    fn every_kind_is_told_by_something_and_has_a_remedy() {
        for kind in KINDS {
            let is_told = !kind.marks.is_empty() || !kind.endings.is_empty();
            assert!(is_told && kind.labels.or(kind.mesh).is_some(), "{}", kind.name);
            for ending in kind.endings {
                assert!(
                    ending.starts_with('.') && *ending == ending.to_ascii_lowercase(),
                    "{ending}"
                );
            }
        }
    }
}
