//! Writing of NIfTI-1.

use std::io::Write;
use std::path::Path;

use flate2::Compression;
use flate2::write::GzEncoder;

use super::{EXTENSIONS_START, HEADER_BYTES};
use crate::volume::element::Element;
use crate::volume::error::At;
use crate::volume::save::{element, named, write_voxels};
use crate::volume::{LabelVolume, VolumeError, names};
use insonify_base::output::atomic;

/// Writes `.nii`, or `.nii.gz`.
pub(super) fn write(volume: &LabelVolume, path: &Path) -> Result<(), VolumeError> {
    let gzipped = path.to_string_lossy().to_ascii_lowercase().ends_with(".gz");
    let element = element(volume);
    let mut start = header(volume, element)
        .ok_or_else(|| {
            let found = format!("a volume of {:?} voxels in NIfTI-1", volume.size());
            VolumeError::unsupported(path, At::Header, found, "its axes hold at most 32767 voxels")
        })?
        .to_vec();
    if named(volume).next().is_some() {
        let xml = names::table(named(volume));
        let length = (xml.len() + 8).next_multiple_of(16);
        start[HEADER_BYTES] = 1;
        start.extend_from_slice(&(length as i32).to_le_bytes());
        start.extend_from_slice(&names::EXTENSION_CODE.to_le_bytes());
        start.extend_from_slice(xml.as_bytes());
        start.resize(EXTENSIONS_START + length, 0);
    }
    let offset = start.len() as f32;
    start[108..112].copy_from_slice(&offset.to_le_bytes());
    atomic::write(path, |file| {
        if gzipped {
            let mut packed = GzEncoder::new(file, Compression::default());
            packed.write_all(&start)?;
            write_voxels(volume, element, &mut packed)?;
            packed.finish().map(drop)
        } else {
            file.write_all(&start)?;
            write_voxels(volume, element, file)
        }
    })?;
    Ok(())
}

/// Little-endian header after `nifti1.h`; `None` if an axis is too long for it.
fn header(volume: &LabelVolume, element: Element) -> Option<[u8; EXTENSIONS_START]> {
    let mut header = [0; EXTENSIONS_START];
    let mut put = |offset: usize, bytes: &[u8]| header[offset..offset + bytes.len()].copy_from_slice(bytes);
    put(0, &(HEADER_BYTES as i32).to_le_bytes());
    put(38, b"r");
    let mut dim = [3i16, 1, 1, 1, 1, 1, 1, 1];
    for (extent, size) in dim[1..].iter_mut().zip(volume.size()) {
        *extent = i16::try_from(size).ok()?;
    }
    for (n, size) in dim.iter().enumerate() {
        put(40 + 2 * n, &size.to_le_bytes());
    }
    put(70, &type_code(element).to_le_bytes());
    put(72, &(8 * element.bytes() as i16).to_le_bytes());
    put(76, &1f32.to_le_bytes());
    for (n, spacing) in volume.spacing_mm().iter().enumerate() {
        put(80 + 4 * n, &(*spacing as f32).to_le_bytes());
    }
    put(112, &1f32.to_le_bytes());
    // Millimetres; aligned to the scanner; labels (`NIFTI_INTENT_LABEL`).
    put(123, &[2]);
    put(254, &1i16.to_le_bytes());
    put(68, &1002i16.to_le_bytes());
    for row in 0..3 {
        let to_ras = if row < 2 { -1.0 } else { 1.0 };
        for column in 0..4 {
            let value = (to_ras * volume.index_to_world()[(row, column)]) as f32;
            put(280 + 16 * row + 4 * column, &value.to_le_bytes());
        }
    }
    put(344, b"n+1\0");
    Some(header)
}

/// Type of labels in a header (`nifti1.h`: the `DT_` codes).
fn type_code(element: Element) -> i16 {
    match element {
        Element::U8 => 2,
        Element::I8 => 256,
        Element::U16 => 512,
        Element::I16 => 4,
        Element::U32 => 768,
        Element::I32 => 8,
        _ => 1024,
    }
}
