//! Loading of image files, with their format detected by content.

use std::io::Read;
use std::path::Path;

use nalgebra::Matrix4;

use super::element::{Sample, with_sample};
use super::error::{At, VolumeError, quoted};
use super::header::Header;
use super::{FORMATS, LabelVolume, data, format, labels};
use insonify_base::read;

/// A label volume with the warnings of the reader.
#[derive(Clone, Debug)]
pub struct Loaded {
    /// Loaded volume.
    pub volume: LabelVolume,
    /// Assumptions and warnings, one sentence each.
    pub warnings: Vec<String>,
}

/// A grey volume, used for solid textures.
#[derive(Clone, Debug)]
pub struct ScalarImage {
    /// Number of voxels along each index axis.
    pub size: [usize; 3],
    /// Distance between voxel centres along each index axis, mm.
    pub spacing_mm: [f64; 3],
    /// Transform from voxel index to LPS millimetres.
    pub index_to_world: Matrix4<f64>,
    /// Finite values, x fastest, with the file's own scale applied.
    pub data: Vec<f32>,
}

/// Loads a label volume of any format: see `volume/format.rs`. A two-dimensional image is a volume of one slice, 1 mm thick.
///
/// # Errors
/// [`VolumeError`] with the file, the place in it, what was found and what was expected: for files that are unreadable,
/// of another format or broken, or hold no labels (fractions, or more than 256 distinct values).
pub fn load(path: &Path) -> Result<Loaded, VolumeError> {
    labels::volume(read_header(path)?)
}

/// Loads a grey volume from the formats of [`load`], any element type.
///
/// # Errors
/// The errors of [`load`], and for values that are not finite; fractions and any number of distinct values are accepted.
pub fn load_scalar(path: &Path) -> Result<ScalarImage, VolumeError> {
    let mut header = read_header(path)?;
    let grid = header.grid()?;
    let values = numbers(&mut header)?;
    Ok(ScalarImage {
        size: grid.size,
        spacing_mm: [0, 1, 2].map(|axis| grid.index_to_world.fixed_view::<3, 1>(0, axis).norm()),
        index_to_world: grid.index_to_world,
        data: values,
    })
}

/// Reads the numbers of an image, with the file's own scale applied.
pub fn numbers(header: &mut Header) -> Result<Vec<f32>, VolumeError> {
    let (order, scale) = (header.data_order(), header.scale);
    let values = with_sample!(header.element()?, T => {
        let value = |number: &[u8]| {
            let stored = T::decode(number, order).as_f64();
            scale.map_or(stored, |scale| scale.apply(stored)) as f32
        };
        data::read_into(header, T::BYTES, &mut |bytes, values| {
            values.extend(bytes.chunks_exact(T::BYTES).map(value));
            Ok(())
        })
    })?;
    if let Some(voxel) = values.iter().position(|value| !value.is_finite()) {
        let side = |axis: usize| header.axes.get(axis).map_or(1, |axis| axis.size);
        let (x, y) = (side(0), side(1));
        let found = format!(
            "{} at voxel ({}, {}, {})",
            values[voxel],
            voxel % x,
            voxel / x % y,
            voxel / x / y
        );
        return Err(header.malformed(found, "finite grey values"));
    }
    Ok(values)
}

/// Parses the header of an image of any known format.
pub fn read_header(path: &Path) -> Result<Header, VolumeError> {
    let fail = |cause| VolumeError::read(path, cause);
    if let Some((format, header)) = format::header_beside(path).filter(|(_, header)| header.is_file()) {
        return (format.read_header)(&header);
    }
    let mut start = Vec::new();
    read::open(path)
        .and_then(|file| file.take(4096).read_to_end(&mut start))
        .map_err(fail)?;
    if let Some(format) = FORMATS.iter().find(|format| (format.recognises)(&start)) {
        return (format.read_header)(path);
    }
    if start.get(128..132) == Some(b"DICM") {
        let instead = format!("convert it to {}", format::names("or"));
        return Err(VolumeError::unsupported(path, At::Byte(128), "DICOM", instead));
    }
    const MESHES: [&[u8]; 4] = [b"$MeshFormat", b"# vtk DataFile", b"<VTKFile", b"<?xml"];
    if MESHES.iter().any(|first| start.starts_with(first)) {
        let instead = "give a volume of labels; `insonify mesh info` looks into a mesh, and `mesh = \"FILE\"` in a file for `solve` or \
                       `insert` calculates on it as it is";
        return Err(VolumeError::unsupported(path, At::Byte(0), "a mesh", instead));
    }
    let found = if start.is_empty() {
        "an empty file".to_owned()
    } else {
        quoted(&String::from_utf8_lossy(&start[..start.len().min(16)]))
    };
    let expected = format!("the start of a {} file", format::names("or"));
    Err(VolumeError::malformed(path, At::Byte(0), found, expected))
}
