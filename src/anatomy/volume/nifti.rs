//! NIfTI-1: `.nii`, `.nii.gz` and `.hdr` with `.img`. World coordinates are RAS in the file and converted to LPS.

mod write;

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Seek};
use std::path::{Path, PathBuf};

use flate2::bufread::GzDecoder;
use nalgebra::{Matrix3x4, Quaternion, UnitQuaternion, Vector3};
use nifti::{Endianness, NiftiHeader};

use super::data;
use super::element::{ByteOrder, Element, Scale};
use super::error::{At, VolumeError, quoted};
use super::format::{self, Format};
use super::header::{Axis, DataPlace, Encoding, Header, Skip};
use insonify_base::output::place::Written;
use insonify_base::read;

/// Size of the header proper, bytes (`nifti1.h`: `sizeof_hdr`).
const HEADER_BYTES: usize = 348;
/// Bytes before the first extension: the header and four flags.
const EXTENSIONS_START: usize = HEADER_BYTES + 4;
/// Maximum total size of header extensions, bytes.
const MAX_EXTENSION_BYTES: u64 = 64 << 20;

// Byte positions in the header (`nifti1.h`), for messages.
const AT_DIM: At = At::Byte(40);
const AT_DATATYPE: At = At::Byte(70);
const AT_PIXDIM: At = At::Byte(76);
const AT_VOX_OFFSET: At = At::Byte(108);
const AT_MAGIC: At = At::Byte(344);

/// First bytes of gzipped data.
const GZIP: &[u8] = &[0x1f, 0x8b];

/// The format. Of the files that are gzipped as a whole, all count as its own.
pub(super) const FORMAT: Format = Format {
    name: "NIfTI-1",
    endings: &[".nii", ".nii.gz", ".hdr", ".img"],
    data_extensions: &[("img", "hdr")],
    recognises: |start| start.starts_with(GZIP) || is_header(start),
    read_header,
    written: &[
        Written {
            ending: ".nii",
            marks: &[b"n+1\0"],
        },
        Written {
            ending: ".nii.gz",
            marks: &[GZIP],
        },
    ],
    write: write::write,
};

/// Whether these first bytes of a file (decompressed) are those of a NIfTI or Analyze header.
fn is_header(start: &[u8]) -> bool {
    [348i32, 540]
        .iter()
        .any(|size| start.starts_with(&size.to_le_bytes()) || start.starts_with(&size.to_be_bytes()))
}

/// Reads the header of a NIfTI-1 file, plain or gzipped.
fn read_header(path: &Path) -> Result<Header, VolumeError> {
    let mut file = BufReader::new(read::open(path).map_err(|cause| VolumeError::read(path, cause))?);
    let start = file.fill_buf().map_err(|cause| VolumeError::read(path, cause))?;
    if start.starts_with(GZIP) {
        let mut unpacked = GzDecoder::new(file);
        parse(path, &mut unpacked, Encoding::Gzip).map_err(|error| blame_gzip(path, unpacked, error))
    } else {
        parse(path, file, Encoding::Raw)
    }
}

/// Attributes a header error to broken compression, if the checksum at its end fails.
fn blame_gzip(path: &Path, mut unpacked: GzDecoder<BufReader<File>>, error: VolumeError) -> VolumeError {
    let broken = match &error {
        VolumeError::Read { cause, .. } if data::is_corrupt_data(cause) => Some(cause.to_string()),
        _ => io::copy(&mut (&mut unpacked).take(data::MAX_EXCESS), &mut io::sink())
            .err()
            .filter(data::is_corrupt_data)
            .map(|cause| cause.to_string()),
    };
    let Some(cause) = broken else {
        return error;
    };
    let offset = unpacked.get_mut().stream_position().unwrap_or(0);
    let found = format!("broken compressed data ({cause})");
    VolumeError::malformed(path, At::Byte(offset), found, "gzip data that unpack to a NIfTI-1 file")
}

/// Parses the header at the start of `reader`, which yields decompressed bytes.
pub(super) fn parse(path: &Path, mut reader: impl Read, encoding: Encoding) -> Result<Header, VolumeError> {
    let mut start = Vec::with_capacity(EXTENSIONS_START);
    take(path, &mut reader, EXTENSIONS_START as u64, &mut start)?;
    let attached = is_attached(path, &start)?;
    let raw = NiftiHeader::from_reader(&start[..HEADER_BYTES])
        .map_err(|cause| VolumeError::malformed(path, At::Byte(0), cause.to_string(), "a NIfTI-1 header"))?;
    if raw.sizeof_hdr != HEADER_BYTES as i32 {
        let found = format!("header size {}", raw.sizeof_hdr);
        return Err(VolumeError::malformed(path, At::Byte(0), found, "348, as NIfTI-1 has"));
    }
    let mut warnings = Vec::new();
    let (data_path, encoding, least) = if attached {
        (path.to_owned(), encoding, EXTENSIONS_START as u64)
    } else {
        let (path, encoding) = image_file(path);
        (path, encoding, 0)
    };
    let offset = vox_offset(path, &raw, least)?;
    let data = DataPlace {
        path: data_path,
        named: (!attached).then_some(At::Header),
        start: 0,
        skip_lines: 0,
        skip: Skip::Bytes(offset),
        encoding,
    };
    let mut names = BTreeMap::new();
    let extended = start.get(HEADER_BYTES).is_some_and(|&flag| flag != 0);
    if attached && extended {
        // The reader stands behind the four flags: extensions fill the room up to the data.
        let length = offset.saturating_sub(EXTENSIONS_START as u64).min(MAX_EXTENSION_BYTES);
        let mut extensions = Vec::new();
        take(path, &mut reader, length, &mut extensions)?;
        names = label_names(&extensions, raw.endianness, &mut warnings);
    }
    let (axes, origin) = axes(path, &raw, &mut warnings)?;
    // A slope of 0 means that there is none (`nifti1.h`), not that all values are equal.
    let slope_given = raw.scl_slope.is_finite() && raw.scl_slope != 0.0 && raw.scl_inter.is_finite();
    Ok(Header {
        path: path.to_owned(),
        axes,
        origin,
        element: Some(element(path, &raw)?),
        order: match raw.endianness {
            Endianness::Little => ByteOrder::Little,
            Endianness::Big => ByteOrder::Big,
        },
        scale: slope_given
            .then(|| Scale::new(raw.scl_slope.into(), raw.scl_inter.into()))
            .flatten(),
        data,
        key_values: Vec::new(),
        names,
        warnings,
    })
}

/// Whether the data follow the header in the same file; an error if it is no header of NIfTI-1.
fn is_attached(path: &Path, start: &[u8]) -> Result<bool, VolumeError> {
    if [540i32.to_le_bytes(), 540i32.to_be_bytes()]
        .iter()
        .any(|size| start.starts_with(size))
    {
        let instead = format!("{} are read", format::names("and"));
        return Err(VolumeError::unsupported(path, At::Byte(0), "NIfTI-2", instead));
    }
    if start.len() < HEADER_BYTES {
        let found = format!("the end of the file after {} bytes", start.len());
        let expected = format!("a NIfTI-1 header of {HEADER_BYTES} bytes");
        return Err(VolumeError::malformed(
            path,
            At::Byte(start.len() as u64),
            found,
            expected,
        ));
    }
    if !is_header(start) {
        let found = quoted(&String::from_utf8_lossy(&start[..16]));
        let expected = "a NIfTI-1 header (of files gzipped as a whole, only NIfTI-1 is read)";
        return Err(VolumeError::malformed(path, At::Byte(0), found, expected));
    }
    let magic = &start[344..HEADER_BYTES];
    let attached = magic == b"n+1\0";
    if !attached && magic != b"ni1\0" {
        let found = format!("magic {:?}", String::from_utf8_lossy(magic).trim_end_matches('\0'));
        let expected = "\"n+1\" or \"ni1\" (an Analyze 7.5 header has none)";
        return Err(VolumeError::malformed(path, AT_MAGIC, found, expected));
    }
    Ok(attached)
}

fn take(path: &Path, reader: &mut impl Read, length: u64, out: &mut Vec<u8>) -> Result<(), VolumeError> {
    reader
        .take(length)
        .read_to_end(out)
        .map(drop)
        .map_err(|cause| VolumeError::read(path, cause))
}

/// Offset of the data; files that state 0 mean the smallest possible one.
fn vox_offset(path: &Path, raw: &NiftiHeader, least: u64) -> Result<u64, VolumeError> {
    let offset = f64::from(raw.vox_offset);
    if offset == 0.0 {
        Ok(least)
    } else if offset >= least as f64 && offset.fract() == 0.0 && offset < 1e12 {
        Ok(offset as u64)
    } else {
        let found = format!("vox_offset {}", raw.vox_offset);
        let expected = format!("a whole number of bytes, {least} or more");
        Err(VolumeError::malformed(path, AT_VOX_OFFSET, found, expected))
    }
}

/// Path of the `.img` beside a `.hdr`: uncompressed if it exists, else gzipped.
fn image_file(header: &Path) -> (PathBuf, Encoding) {
    let ends = |path: &Path, end: &str| path.extension().is_some_and(|extension| extension == end);
    let plain = if ends(header, "gz") {
        header.with_extension("")
    } else {
        header.to_owned()
    };
    let image = plain.with_extension(if ends(&plain, "HDR") { "IMG" } else { "img" });
    let packed = image.with_added_extension("gz");
    if !image.exists() && packed.exists() {
        (packed, Encoding::Gzip)
    } else {
        (image, Encoding::Raw)
    }
}

/// `nifti1.h`: the `DT_` codes.
fn element(path: &Path, raw: &NiftiHeader) -> Result<Element, VolumeError> {
    Ok(match raw.datatype {
        2 => Element::U8,
        4 => Element::I16,
        8 => Element::I32,
        16 => Element::F32,
        64 => Element::F64,
        256 => Element::I8,
        512 => Element::U16,
        768 => Element::U32,
        1024 => Element::I64,
        1280 => Element::U64,
        code => {
            let known = match code {
                1 => "one bit",
                32 | 1792 | 2048 => "complex numbers",
                128 => "RGB colours",
                2304 => "RGBA colours",
                1536 => "float128",
                _ => "unknown",
            };
            let found = format!("datatype {code} ({known})");
            let instead = "integers of 8 to 64 bits, float32 and float64 are read";
            return Err(VolumeError::unsupported(path, AT_DATATYPE, found, instead));
        }
    })
}

/// Index axes and origin in LPS mm, from sform, else qform, else the voxel sizes alone (`nifti1.h`, methods 3, 2, 1).
fn axes(path: &Path, raw: &NiftiHeader, warnings: &mut Vec<String>) -> Result<(Vec<Axis>, Vector3<f64>), VolumeError> {
    let dimensions = usize::from(raw.dim[0]);
    let sizes = match raw.dim.get(1..=dimensions) {
        Some(sizes) if (1..=7).contains(&dimensions) && sizes.iter().all(|&n| n > 0 && n <= i16::MAX as u16) => sizes,
        _ => {
            let found = format!("dim {:?}", raw.dim.map(|n| n as i16));
            let expected = "1 to 7 dimensions, each of 1 to 32767 voxels";
            return Err(VolumeError::malformed(path, AT_DIM, found, expected));
        }
    };
    let affine = if raw.sform_code > 0 {
        let rows = [raw.srow_x, raw.srow_y, raw.srow_z];
        Matrix3x4::from_fn(|row, column| f64::from(rows[row][column]))
    } else {
        let spacing = spacing(path, raw, dimensions)?;
        if raw.qform_code > 0 {
            qform(raw, spacing)
        } else {
            warnings.push("no sform and no qform: placed by its voxel sizes alone, taken as RAS".to_owned());
            let [x, y, z] = spacing;
            #[rustfmt::skip]
            let base = Matrix3x4::new(
                x, 0.0, 0.0, 0.0,
                0.0, y, 0.0, 0.0,
                0.0, 0.0, z, 0.0,
            );
            base
        }
    };
    // `nifti1.h`: the low three bits of xyzt_units; unknown is taken as mm.
    let mm = match raw.xyzt_units & 7 {
        1 => 1000.0,
        3 => 0.001,
        _ => 1.0,
    };
    let lps = |column: usize| {
        let ras = affine.column(column) * mm;
        Vector3::new(-ras.x, -ras.y, ras.z)
    };
    let axes = sizes
        .iter()
        .enumerate()
        .map(|(number, &size)| {
            let direction = (number < 3).then(|| lps(number));
            // A single slice may leave its own direction empty; it then gets the normal of the other two.
            let empty = size == 1 && number == 2 && direction.is_some_and(|d| d.norm() == 0.0);
            Axis {
                size: usize::from(size),
                direction: direction.filter(|_| !empty),
            }
        })
        .collect();
    Ok((axes, lps(3)))
}

fn spacing(path: &Path, raw: &NiftiHeader, dimensions: usize) -> Result<[f64; 3], VolumeError> {
    let mut spacing = [1.0; 3];
    for (axis, value) in spacing.iter_mut().enumerate().take(dimensions) {
        let found = f64::from(raw.pixdim[axis + 1]);
        let unused = found == 0.0 && raw.dim[axis + 1] == 1;
        if !(unused || found > 0.0 && found.is_finite()) {
            let text = format!("pixdim {:?}", &raw.pixdim[1..4]);
            return Err(VolumeError::malformed(
                path,
                AT_PIXDIM,
                text,
                "voxel sizes above 0 and finite",
            ));
        }
        if !unused {
            *value = found;
        }
    }
    Ok(spacing)
}

/// `nifti1.h`, method 2: a unit quaternion whose real part is implied, and a handedness in `pixdim[0]`.
fn qform(raw: &NiftiHeader, spacing: [f64; 3]) -> Matrix3x4<f64> {
    let [b, c, d] = [raw.quatern_b, raw.quatern_c, raw.quatern_d].map(f64::from);
    let real = (1.0 - (b * b + c * c + d * d)).max(0.0).sqrt();
    let rotation = UnitQuaternion::from_quaternion(Quaternion::new(real, b, c, d)).to_rotation_matrix();
    let handedness = if raw.pixdim[0] < 0.0 { -1.0 } else { 1.0 };
    let scale = [spacing[0], spacing[1], spacing[2] * handedness];
    let offset = [raw.quatern_x, raw.quatern_y, raw.quatern_z].map(f64::from);
    Matrix3x4::from_fn(|row, column| {
        if column < 3 {
            rotation[(row, column)] * scale[column]
        } else {
            offset[row]
        }
    })
}

/// Label names from the header extensions: each is its length, a code and the content of length minus eight bytes.
fn label_names(mut bytes: &[u8], endianness: Endianness, warnings: &mut Vec<String>) -> BTreeMap<i64, String> {
    let word = |bytes: &[u8]| {
        let first = [bytes[0], bytes[1], bytes[2], bytes[3]];
        match endianness {
            Endianness::Little => i32::from_le_bytes(first),
            Endianness::Big => i32::from_be_bytes(first),
        }
    };
    let mut names = BTreeMap::new();
    while bytes.len() >= 8 {
        let length = usize::try_from(word(bytes)).unwrap_or(0);
        if length < 8 || length > bytes.len() {
            warnings.push(format!(
                "header extension of {length} bytes where {} are left: ignored",
                bytes.len()
            ));
            break;
        }
        // Some writers give their XML the code of a plain comment, so it is identified by its content.
        names.append(&mut super::names::label_names(&String::from_utf8_lossy(
            &bytes[8..length],
        )));
        bytes = &bytes[length..];
    }
    names
}

#[cfg(test)]
mod tests;
