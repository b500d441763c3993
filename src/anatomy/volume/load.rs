//! Loading of image files, with their format detected by content.

use std::path::Path;

use nalgebra::Matrix4;

#[cfg(feature = "dicom")]
use super::dicom;
use super::element::{Sample, with_sample};
use super::error::{At, VolumeError};
use super::header::Header;
use super::{FORMATS, LabelVolume, channels, data, extent, foreign, format, labels};

/// A label volume with the warnings of the reader.
#[derive(Clone, Debug)]
pub struct Loaded {
    /// Loaded volume.
    pub volume: LabelVolume,
    /// What was read otherwise than as it stands, one sentence each.
    pub notes: Vec<String>,
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
/// of another format or broken, or hold no labels (fractions, more than 256 distinct values, recordings), or span what no body
/// does.
pub fn load(path: &Path) -> Result<Loaded, VolumeError> {
    #[cfg(feature = "dicom")]
    if dicom::recognises(&foreign::start_of(path)?) {
        return dicom::load(path);
    }
    let header = read_header(path)?;
    refuse_sequence(&header)?;
    let loaded = match channels::axis(&header) {
        Some(axis) => channels::volume(header, axis)?,
        None => labels::volume(header).map_err(|error| grey(path, error))?,
    };
    extent::check(&loaded.volume).map_err(|error| error.in_file(path))?;
    Ok(loaded)
}

/// An error if an image is a sequence: a recording of frames, or volumes of 3D Slicer over time.
fn refuse_sequence(header: &Header) -> Result<(), VolumeError> {
    let frames = header.key_values.iter().any(|(key, _)| key.starts_with("Seq_Frame"));
    if frames {
        let instead = "`insonify info` tells what is in it, `[motion.sequence]` of a scene moves the probe by it; labels are a volume";
        return Err(header.unsupported("a recording of tracked frames", instead));
    }
    let name = header.path.to_string_lossy().to_ascii_lowercase();
    let stem = name.rsplit_once('.').map_or("", |(stem, _)| stem);
    if stem.ends_with(".seq") && header.axes.len() > 3 {
        let found = format!("a sequence of volumes ({})", header.sizes());
        return Err(header.unsupported(found, "save one of them, in 3D Slicer as .seg.nrrd or .nrrd"));
    }
    Ok(())
}

/// Least and largest values of CTs, in Hounsfield units: padding or air, and bone or metal.
const CT_HU: [std::ops::RangeInclusive<f32>; 2] = [-4096.0..=-900.0, 150.0..=40_000.0];

/// The error about an image that is no label volume, which says so if it is a CT.
fn grey(path: &Path, error: VolumeError) -> VolumeError {
    let is_grey = match &error {
        VolumeError::Fractional { .. } => true,
        VolumeError::Volume { cause, .. } => matches!(**cause, VolumeError::TooManyLabels(_)),
        _ => false,
    };
    let Some(image) = is_grey.then(|| load_scalar(path).ok()).flatten() else {
        return error;
    };
    let ends = |(low, high): (f32, f32), &value: &f32| (low.min(value), high.max(value));
    let (low, high) = image.data.iter().fold((f32::MAX, f32::MIN), ends);
    if !(CT_HU[0].contains(&low) && CT_HU[1].contains(&high)) {
        return error;
    }
    let found = format!("a CT ({low} to {high} HU)");
    let expected = "labels: give its segmentation; `volume.ct` of a scene takes the CT";
    VolumeError::malformed(path, At::Voxels, found, expected)
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
    if let Some((format, header)) = format::header_beside(path).filter(|(_, header)| header.is_file()) {
        return (format.read_header)(&header);
    }
    let start = foreign::start_of(path)?;
    match FORMATS.iter().find(|format| (format.recognises)(&start)) {
        Some(format) => (format.read_header)(path),
        None => Err(foreign::refusal(path, &start)),
    }
}
