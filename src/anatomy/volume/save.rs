//! Writing of label volumes: each voxel as its original value, in the smallest integer type that holds them all.

use std::borrow::Cow;
use std::fmt::Write as _;
use std::io::{self, Write};
use std::path::Path;

use flate2::Compression;
use flate2::write::{GzEncoder, ZlibEncoder};

use super::element::Element;
use super::error::{At, VolumeError};
use super::{Label, LabelVolume, names, nifti};
use insonify_base::output::{OutputError, atomic};

/// Number of voxels encoded at a time.
const CHUNK: usize = 64 << 10;

/// Saves a label volume in the format given by the extension: `.nrrd`, `.seg.nrrd` (with the segments of 3D Slicer),
/// `.nii`, `.nii.gz` or `.mha`. The write is atomic. NIfTI holds the transform in single precision.
///
/// # Errors
/// [`VolumeError::Unsupported`] for another extension or a volume that the format cannot hold, [`VolumeError::Write`] if
/// the file cannot be written.
pub fn save(volume: &LabelVolume, path: &Path) -> Result<(), VolumeError> {
    let name = path.to_string_lossy().to_ascii_lowercase();
    if name.ends_with(".nrrd") {
        save_nrrd(volume, path, name.ends_with(".seg.nrrd"))
    } else if name.ends_with(".nii") || name.ends_with(".nii.gz") {
        save_nifti(volume, path, name.ends_with(".gz"))
    } else if name.ends_with(".mha") {
        save_metaimage(volume, path)
    } else {
        let instead = "names end in .nrrd, .seg.nrrd, .nii, .nii.gz or .mha";
        Err(VolumeError::unsupported(
            path,
            At::Header,
            "writing this kind of file",
            instead,
        ))
    }
}

fn element(volume: &LabelVolume) -> Element {
    let values = || volume.labels().iter().map(|label| label.value);
    Element::smallest(values().min().unwrap_or(0), values().max().unwrap_or(0))
}

/// Types of labels in headers of NRRD, of MetaImage and of NIfTI.
fn kinds(element: Element) -> (&'static str, &'static str, i16) {
    match element {
        Element::U8 => ("unsigned char", "MET_UCHAR", 2),
        Element::I8 => ("signed char", "MET_CHAR", 256),
        Element::U16 => ("unsigned short", "MET_USHORT", 512),
        Element::I16 => ("short", "MET_SHORT", 4),
        Element::U32 => ("unsigned int", "MET_UINT", 768),
        Element::I32 => ("int", "MET_INT", 8),
        _ => ("int64", "MET_LONG_LONG", 1024),
    }
}

fn write_voxels(volume: &LabelVolume, element: Element, writer: &mut impl Write) -> io::Result<()> {
    let size = element.bytes();
    let values: Vec<[u8; 8]> = volume.labels().iter().map(|label| label.value.to_le_bytes()).collect();
    let mut bytes = Vec::with_capacity(CHUNK * size);
    for voxels in volume.voxels().chunks(CHUNK) {
        bytes.clear();
        for &voxel in voxels {
            bytes.extend_from_slice(&values[usize::from(voxel)][..size]);
        }
        writer.write_all(&bytes)?;
    }
    Ok(())
}

fn named(volume: &LabelVolume) -> impl Iterator<Item = (i64, &str)> {
    volume
        .labels()
        .iter()
        .filter_map(|label| Some((label.value, label.name.as_deref()?)))
}

/// Appends to a header; writing to a string cannot fail.
macro_rules! line {
    ($text:expr, $($argument:tt)*) => {{
        let _ = writeln!($text, $($argument)*);
    }};
}

fn save_nrrd(volume: &LabelVolume, path: &Path, segmented: bool) -> Result<(), VolumeError> {
    let element = element(volume);
    let (kind, ..) = kinds(element);
    let world = volume.index_to_world();
    let column = |axis: usize| format!("({},{},{})", world[(0, axis)], world[(1, axis)], world[(2, axis)]);
    let [x, y, z] = volume.size();
    let mut header = String::from("NRRD0005\n");
    line!(header, "type: {kind}");
    line!(header, "dimension: 3");
    line!(header, "space: left-posterior-superior");
    line!(header, "sizes: {x} {y} {z}");
    line!(header, "space directions: {} {} {}", column(0), column(1), column(2));
    line!(header, "kinds: domain domain domain");
    line!(header, "endian: little");
    line!(header, "encoding: gzip");
    line!(header, "space origin: {}", column(3));
    if segmented {
        push_segments(volume, &mut header);
    } else {
        for (value, name) in named(volume) {
            line!(header, "{}:={}", names::key(value), escaped(name));
        }
    }
    header.push('\n');
    atomic::write(path, |file| {
        file.write_all(header.as_bytes())?;
        let mut packed = GzEncoder::new(file, Compression::default());
        write_voxels(volume, element, &mut packed)?;
        packed.finish().map(drop)
    })?;
    Ok(())
}

/// Applies the key escapes of NRRD ("Key/value pairs").
fn escaped(text: &str) -> String {
    text.replace('\\', "\\\\").replace('\n', "\\n").replace('\r', " ")
}

/// Appends the segment keys of 3D Slicer (`vtkMRMLSegmentationStorageNode`).
fn push_segments(volume: &LabelVolume, header: &mut String) {
    line!(header, "Segmentation_MasterRepresentation:=Binary labelmap");
    line!(header, "Segmentation_ContainedRepresentationNames:=Binary labelmap|");
    line!(header, "Segmentation_ReferenceImageExtentOffset:=0 0 0");
    let extents = extents(volume);
    let foreground = volume.labels().iter().zip(&extents).skip(1).enumerate();
    for (number, (Label { value, name, .. }, extent)) in foreground {
        let name = name
            .as_deref()
            .map_or_else(|| Cow::from(format!("label {value}")), Cow::from);
        let [red, green, blue] = colour(number);
        let [low, high] = extent.map(|bound| bound.map(|n| n.to_string()));
        line!(header, "Segment{number}_ID:=Segment_{value}");
        line!(header, "Segment{number}_Name:={}", escaped(&name));
        line!(header, "Segment{number}_Color:={red:.6} {green:.6} {blue:.6}");
        line!(header, "Segment{number}_LabelValue:={value}");
        line!(header, "Segment{number}_Layer:=0");
        line!(
            header,
            "Segment{number}_Extent:={} {} {} {} {} {}",
            low[0],
            high[0],
            low[1],
            high[1],
            low[2],
            high[2]
        );
        line!(header, "Segment{number}_Tags:=");
    }
}

/// First and last voxel of each label along each axis; the first is above the last for an empty label, as VTK
/// writes it.
fn extents(volume: &LabelVolume) -> Vec<[[i64; 3]; 2]> {
    let [x, y, _] = volume.size();
    let mut extents = vec![[[0; 3], [-1; 3]]; volume.labels().len()];
    for (at, &voxel) in volume.voxels().iter().enumerate() {
        let [low, high] = &mut extents[usize::from(voxel)];
        let place = [at % x, at / x % y, at / x / y].map(|n| n as i64);
        let first = high[0] < 0;
        for axis in 0..3 {
            low[axis] = if first { place[axis] } else { low[axis].min(place[axis]) };
            high[axis] = high[axis].max(place[axis]);
        }
    }
    extents
}

/// Colour of the n-th segment, each channel 0 to 1: hues a golden section apart, so that neighbours differ.
fn colour(number: usize) -> [f64; 3] {
    const GOLDEN_SECTION: f64 = 0.618_033_988_749_894_9;
    let hue = (number as f64 * GOLDEN_SECTION).fract() * 6.0;
    [5.0, 3.0, 1.0].map(|shift: f64| {
        let at = (shift + hue) % 6.0;
        0.9 - 0.6 * at.min(4.0 - at).clamp(0.0, 1.0)
    })
}

fn save_metaimage(volume: &LabelVolume, path: &Path) -> Result<(), VolumeError> {
    let element = element(volume);
    let (_, kind, _) = kinds(element);
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
    line!(header, "ElementType = {kind}");
    line!(header, "ElementDataFile = LOCAL");
    atomic::write(path, |file| {
        file.write_all(header.as_bytes())?;
        file.write_all(&packed)
    })?;
    Ok(())
}

fn save_nifti(volume: &LabelVolume, path: &Path, gzipped: bool) -> Result<(), VolumeError> {
    let element = element(volume);
    let mut start = nifti_header(volume, element)
        .ok_or_else(|| {
            let found = format!("a volume of {:?} voxels in NIfTI-1", volume.size());
            VolumeError::unsupported(path, At::Header, found, "its axes hold at most 32767 voxels")
        })?
        .to_vec();
    if named(volume).next().is_some() {
        let xml = names::table(named(volume));
        let length = (xml.len() + 8).next_multiple_of(16);
        start[nifti::HEADER_BYTES] = 1;
        start.extend_from_slice(&(length as i32).to_le_bytes());
        start.extend_from_slice(&names::EXTENSION_CODE.to_le_bytes());
        start.extend_from_slice(xml.as_bytes());
        start.resize(nifti::EXTENSIONS_START + length, 0);
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
fn nifti_header(volume: &LabelVolume, element: Element) -> Option<[u8; nifti::EXTENSIONS_START]> {
    let mut header = [0; nifti::EXTENSIONS_START];
    let mut put = |at: usize, bytes: &[u8]| header[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, &(nifti::HEADER_BYTES as i32).to_le_bytes());
    put(38, b"r");
    let mut dim = [3i16, 1, 1, 1, 1, 1, 1, 1];
    for (own, size) in dim[1..].iter_mut().zip(volume.size()) {
        *own = i16::try_from(size).ok()?;
    }
    for (n, size) in dim.iter().enumerate() {
        put(40 + 2 * n, &size.to_le_bytes());
    }
    let (.., code) = kinds(element);
    put(70, &code.to_le_bytes());
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

#[cfg(test)]
mod tests;
