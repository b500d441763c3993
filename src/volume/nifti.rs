//! NIfTI-1: `.nii`, `.nii.gz` and `.hdr` with `.img`. World coordinates are RAS in the file and LPS from here on.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

use flate2::bufread::GzDecoder;
use nalgebra::{Matrix3x4, Quaternion, UnitQuaternion, Vector3};
use nifti::{Endianness, NiftiHeader};

use super::caret;
use super::element::{ByteOrder, Element, Scale};
use super::error::{At, VolumeError};
use super::header::{Axis, DataPlace, Encoding, Header, Skip};

/// Bytes of the header proper (`nifti1.h`: `sizeof_hdr`).
pub(crate) const HEADER_BYTES: usize = 348;
/// Bytes before the first extension: the header and four flags.
pub(crate) const EXTENSIONS_START: usize = HEADER_BYTES + 4;
/// Longest stretch of header extensions read, bytes.
const MAX_EXTENSION_BYTES: u64 = 64 << 20;

// Byte positions in the header (`nifti1.h`), for messages.
const AT_DIM: At = At::Byte(40);
const AT_DATATYPE: At = At::Byte(70);
const AT_PIXDIM: At = At::Byte(76);
const AT_VOX_OFFSET: At = At::Byte(108);
const AT_MAGIC: At = At::Byte(344);

/// Whether these first bytes of a file (unpacked) are those of a NIfTI or Analyze header.
pub(crate) fn is_header(start: &[u8]) -> bool {
    [348i32, 540]
        .iter()
        .any(|size| start.starts_with(&size.to_le_bytes()) || start.starts_with(&size.to_be_bytes()))
}

/// Reads the header of a NIfTI-1 file, plain or gzipped.
pub(crate) fn read_header(path: &Path) -> Result<Header, VolumeError> {
    let mut file = BufReader::new(File::open(path).map_err(|cause| VolumeError::read(path, cause))?);
    let start = file.fill_buf().map_err(|cause| VolumeError::read(path, cause))?;
    if start.starts_with(&[0x1f, 0x8b]) {
        parse(path, GzDecoder::new(file), Encoding::Gzip)
    } else {
        parse(path, file, Encoding::Raw)
    }
}

/// Parses the header at the start of `reader`, which yields unpacked bytes.
pub(crate) fn parse(path: &Path, mut reader: impl Read, encoding: Encoding) -> Result<Header, VolumeError> {
    let mut start = Vec::with_capacity(EXTENSIONS_START);
    take(path, &mut reader, EXTENSIONS_START as u64, &mut start)?;
    if [540i32.to_le_bytes(), 540i32.to_be_bytes()]
        .iter()
        .any(|size| start.starts_with(size))
    {
        let instead = "NIfTI-1, NRRD and MetaImage are read";
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
    let raw = NiftiHeader::from_reader(&start[..HEADER_BYTES])
        .map_err(|cause| VolumeError::malformed(path, At::Byte(0), cause.to_string(), "a NIfTI-1 header"))?;
    if raw.sizeof_hdr != HEADER_BYTES as i32 {
        let found = format!("header size {}", raw.sizeof_hdr);
        return Err(VolumeError::malformed(path, At::Byte(0), found, "348, as NIfTI-1 has"));
    }
    let mut warnings = Vec::new();
    let data = match &raw.magic {
        b"n+1\0" => DataPlace {
            path: path.to_owned(),
            start: 0,
            skip_lines: 0,
            skip: Skip::Bytes(vox_offset(path, &raw, EXTENSIONS_START as u64)?),
            encoding,
        },
        b"ni1\0" => {
            let (path, encoding) = image_file(path);
            let skip = Skip::Bytes(vox_offset(&path, &raw, 0)?);
            DataPlace {
                path,
                start: 0,
                skip_lines: 0,
                skip,
                encoding,
            }
        }
        other => {
            let found = format!("magic {:?}", String::from_utf8_lossy(other).trim_end_matches('\0'));
            let expected = "\"n+1\" or \"ni1\" (an Analyze 7.5 header has none)";
            return Err(VolumeError::malformed(path, AT_MAGIC, found, expected));
        }
    };
    let names = match (start.get(HEADER_BYTES), data.skip) {
        (Some(1..), Skip::Bytes(end)) if data.path == path && end > EXTENSIONS_START as u64 => {
            let mut extensions = Vec::new();
            let length = (end - EXTENSIONS_START as u64).min(MAX_EXTENSION_BYTES);
            take(path, &mut reader, length, &mut extensions)?;
            label_names(&extensions, raw.endianness, &mut warnings)
        }
        _ => BTreeMap::new(),
    };
    let (axes, origin) = axes(path, &raw, &mut warnings)?;
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

fn take(path: &Path, reader: &mut impl Read, length: u64, out: &mut Vec<u8>) -> Result<(), VolumeError> {
    reader
        .take(length)
        .read_to_end(out)
        .map(drop)
        .map_err(|cause| match cause.kind() {
            std::io::ErrorKind::UnexpectedEof | std::io::ErrorKind::InvalidInput | std::io::ErrorKind::InvalidData => {
                let found = format!("broken compressed data ({cause}) in the header");
                VolumeError::malformed(path, At::Byte(0), found, "gzip data that unpack to a NIfTI-1 header")
            }
            _ => VolumeError::read(path, cause),
        })
}

/// Where the data begin; files that say 0 mean the first byte they can.
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

/// The `.img` beside a `.hdr`: plain if it is there, else gzipped.
fn image_file(header: &Path) -> (PathBuf, Encoding) {
    let name = header.to_string_lossy();
    let stem = name.strip_suffix(".gz").unwrap_or(&name);
    let upper = stem.ends_with(".HDR");
    let image = Path::new(stem).with_extension(if upper { "IMG" } else { "img" });
    let packed = PathBuf::from(format!("{}.gz", image.display()));
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
        if !unused && !(found > 0.0 && found.is_finite()) {
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

/// Label names from the header extensions: each is its length, a code and so many bytes less eight.
fn label_names(mut bytes: &[u8], endianness: Endianness, warnings: &mut Vec<String>) -> BTreeMap<i64, String> {
    let word = |bytes: &[u8]| {
        let own = [bytes[0], bytes[1], bytes[2], bytes[3]];
        match endianness {
            Endianness::Little => i32::from_le_bytes(own),
            Endianness::Big => i32::from_be_bytes(own),
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
        // Some writers give their XML the code of a plain comment, so the content decides.
        names.append(&mut caret::label_names(&String::from_utf8_lossy(&bytes[8..length])));
        bytes = &bytes[length..];
    }
    names
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> Vec<u8> {
        let mut bytes = vec![0u8; EXTENSIONS_START];
        let mut put = |at: usize, data: &[u8]| bytes[at..at + data.len()].copy_from_slice(data);
        put(0, &348i32.to_le_bytes());
        for (n, size) in [3i16, 2, 3, 4].iter().enumerate() {
            put(40 + 2 * n, &size.to_le_bytes());
        }
        put(70, &2i16.to_le_bytes());
        for (n, size) in [1f32, 1.5, 2.0, 2.5].iter().enumerate() {
            put(76 + 4 * n, &size.to_le_bytes());
        }
        put(344, b"n+1\0");
        bytes
    }

    fn read(bytes: &[u8]) -> Result<Header, String> {
        parse(Path::new("test.nii"), bytes, Encoding::Raw).map_err(|error| error.to_string())
    }

    fn with(at: usize, data: &[u8]) -> Vec<u8> {
        let mut bytes = sample();
        bytes[at..at + data.len()].copy_from_slice(data);
        bytes
    }

    #[test]
    fn voxel_sizes_alone_give_ras_axes_turned_to_lps() {
        let grid = read(&sample()).unwrap().grid().unwrap();
        assert_eq!(grid.size, [2, 3, 4]);
        assert_eq!(grid.index_to_world.diagonal().as_slice(), [-1.5, -2.0, 2.5, 1.0]);
    }

    #[test]
    fn qform_turns_and_mirrors() {
        let mut bytes = with(252, &1i16.to_le_bytes());
        // Half a turn about z: the quaternion (0, 0, 0, 1); qfac -1 mirrors the third axis.
        bytes[264..268].copy_from_slice(&1f32.to_le_bytes());
        bytes[268..272].copy_from_slice(&10f32.to_le_bytes());
        bytes[76..80].copy_from_slice(&(-1f32).to_le_bytes());
        let world = read(&bytes).unwrap().grid().unwrap().index_to_world;
        assert!(
            (world.diagonal() - nalgebra::Vector4::new(1.5, 2.0, -2.5, 1.0)).norm() < 1e-12,
            "{world}"
        );
        assert_eq!(world[(0, 3)], -10.0);
    }

    #[test]
    fn broken_fields_name_their_byte() {
        for (bytes, expected) in [
            (
                with(80, &(-1f32).to_le_bytes()),
                "byte 76: found pixdim [-1.0, 2.0, 2.5]",
            ),
            (with(80, &0f32.to_le_bytes()), "byte 76: found pixdim"),
            (with(80, &f32::NAN.to_le_bytes()), "byte 76: found pixdim [NaN"),
            (with(42, &(-2i16).to_le_bytes()), "byte 40: found dim [3, -2, 3, 4"),
            (with(42, &0i16.to_le_bytes()), "byte 40: found dim [3, 0, 3, 4"),
            (with(40, &0i16.to_le_bytes()), "byte 40: found dim [0,"),
            (with(70, &128i16.to_le_bytes()), "byte 70: datatype 128 (RGB colours)"),
            (with(108, &100f32.to_le_bytes()), "byte 108: found vox_offset 100"),
            (with(108, &f32::NAN.to_le_bytes()), "byte 108: found vox_offset NaN"),
            (with(344, b"xxxx"), "byte 344: found magic \"xxxx\""),
            (with(0, &540i32.to_le_bytes()), "byte 0: NIfTI-2 is not supported"),
            (
                sample()[..200].to_vec(),
                "byte 200: found the end of the file after 200 bytes",
            ),
        ] {
            let message = read(&bytes).map(|_| "loaded").unwrap_err();
            assert!(message.contains(expected), "{message} should hold {expected}");
        }
    }

    #[test]
    fn slope_of_nan_or_zero_means_none() {
        assert_eq!(read(&with(112, &f32::NAN.to_le_bytes())).unwrap().scale, None);
        assert_eq!(read(&with(112, &0f32.to_le_bytes())).unwrap().scale, None);
        assert_eq!(read(&with(112, &1f32.to_le_bytes())).unwrap().scale, None);
        let scale = read(&with(112, &2f32.to_le_bytes())).unwrap().scale.unwrap();
        assert_eq!(scale.apply(3.0), 6.0);
    }

    #[test]
    fn big_endian_headers_are_read() {
        let mut bytes = sample();
        let mut swap = |at: usize, length: usize| bytes[at..at + length].reverse();
        swap(0, 4);
        (0..4).for_each(|n| swap(40 + 2 * n, 2));
        swap(70, 2);
        (0..4).for_each(|n| swap(76 + 4 * n, 4));
        let header = read(&bytes).unwrap();
        assert_eq!(header.order, ByteOrder::Big);
        assert_eq!(header.sizes(), "2 x 3 x 4");
    }
}
