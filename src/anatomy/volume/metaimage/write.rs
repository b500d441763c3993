//! Writing of MetaImage.

use std::fmt::Write as _;
use std::io::Write;
use std::path::Path;

use flate2::Compression;
use flate2::write::ZlibEncoder;

use crate::volume::element::Element;
use crate::volume::save::{element, line, named, write_voxels};
use crate::volume::{LabelVolume, VolumeError, names};
use insonify_base::output::{OutputError, atomic};

/// Writes `.mha`.
pub(super) fn write(volume: &LabelVolume, path: &Path) -> Result<(), VolumeError> {
    let element = element(volume);
    let mut packed = ZlibEncoder::new(Vec::new(), Compression::default());
    let packed = write_voxels(volume, element, &mut packed)
        .and_then(|()| packed.finish())
        .map_err(|cause| OutputError::write(path, cause))?;
    let world = volume.index_to_world();
    let spacing = volume.spacing_mm();
    let cosines: Vec<String> = (0..9)
        .map(|n| (world[(n % 3, n / 3)] / spacing[n / 3]).to_string())
        .collect();
    let [x, y, z] = volume.size();
    let mut header = String::from("ObjectType = Image\nNDims = 3\nBinaryData = True\n");
    line!(header, "BinaryDataByteOrderMSB = False");
    line!(header, "CompressedData = True");
    line!(header, "CompressedDataSize = {}", packed.len());
    line!(header, "TransformMatrix = {}", cosines.join(" "));
    line!(header, "Offset = {} {} {}", world[(0, 3)], world[(1, 3)], world[(2, 3)]);
    line!(header, "CenterOfRotation = 0 0 0");
    line!(header, "ElementSpacing = {} {} {}", spacing[0], spacing[1], spacing[2]);
    line!(header, "DimSize = {x} {y} {z}");
    for (value, name) in named(volume) {
        line!(header, "{} = {}", names::key(value), name.replace(['\n', '\r'], " "));
    }
    line!(header, "ElementType = {}", type_name(element));
    line!(header, "ElementDataFile = LOCAL");
    atomic::write(path, |file| {
        file.write_all(header.as_bytes())?;
        file.write_all(&packed)
    })?;
    Ok(())
}

/// Type of labels in a header.
fn type_name(element: Element) -> &'static str {
    match element {
        Element::U8 => "MET_UCHAR",
        Element::I8 => "MET_CHAR",
        Element::U16 => "MET_USHORT",
        Element::I16 => "MET_SHORT",
        Element::U32 => "MET_UINT",
        Element::I32 => "MET_INT",
        _ => "MET_LONG_LONG",
    }
}
