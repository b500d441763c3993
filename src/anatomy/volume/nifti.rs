//! NIfTI-1 and NIfTI-2: `.nii` and `.hdr` with `.img`, plain or gzipped. World coordinates are RAS in the file and
//! converted to LPS.

mod fields;
mod grid;
mod write;

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Seek};
use std::path::{Path, PathBuf};

use flate2::bufread::GzDecoder;

use super::data;
use super::element::{ByteOrder, Element, Sample, Scale};
use super::error::{At, VolumeError, quoted};
use super::foreign;
use super::format::Format;
use super::header::{DataPlace, Encoding, Header, Skip};
use fields::{Fields, LAYOUTS, Layout};
use insonify_base::border::Guarded;
use insonify_base::output::place::Written;
use insonify_base::read;

/// Size of the header proper of NIfTI-1, bytes (`nifti1.h`: `sizeof_hdr`).
const HEADER_BYTES: usize = 348;
/// Bytes before the first extension of NIfTI-1: the header and four flags.
const EXTENSIONS_START: usize = HEADER_BYTES + FLAGS;
/// Flags behind a header: whether there are extensions.
const FLAGS: usize = 4;
/// Maximum total size of header extensions, bytes.
const MAX_EXTENSION_BYTES: u64 = 64 << 20;

/// First bytes of gzipped data.
const GZIP: &[u8] = &[0x1f, 0x8b];

/// The format. Of the files that are gzipped as a whole, all count as its own.
pub(super) const FORMAT: Format = Format {
    name: "NIfTI",
    endings: &[".nii", ".nii.gz", ".hdr", ".img", ".hdr.gz", ".img.gz"],
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
    layout(start).is_some()
}

/// Layout and byte order of a header, by its size at the start.
fn layout(start: &[u8]) -> Option<(&'static Layout, ByteOrder)> {
    LAYOUTS.iter().find_map(|layout| {
        let size = layout.bytes as i32;
        if start.starts_with(&size.to_le_bytes()) {
            Some((layout, ByteOrder::Little))
        } else {
            start
                .starts_with(&size.to_be_bytes())
                .then_some((layout, ByteOrder::Big))
        }
    })
}

/// Reads the header of a NIfTI file, plain or gzipped.
fn read_header(path: &Path) -> Result<Header, VolumeError> {
    let mut file = BufReader::new(read::open(path).map_err(|cause| VolumeError::read(path, cause))?);
    let start = file.fill_buf().map_err(|cause| VolumeError::read(path, cause))?;
    if start.starts_with(GZIP) {
        let mut unpacked = Guarded(GzDecoder::new(file));
        parse(path, &mut unpacked, Encoding::Gzip).map_err(|error| blame_gzip(path, unpacked, error))
    } else {
        parse(path, file, Encoding::Raw)
    }
}

/// Attributes a header error to broken compression, if the checksum at its end fails.
fn blame_gzip(path: &Path, mut unpacked: Guarded<GzDecoder<BufReader<File>>>, error: VolumeError) -> VolumeError {
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
    let offset = unpacked.0.get_mut().stream_position().unwrap_or(0);
    let found = format!("broken compressed data ({cause})");
    VolumeError::malformed(path, At::Byte(offset), found, "gzip data that unpack to a NIfTI file")
}

/// Parses the header at the start of `reader`, which yields decompressed bytes.
pub(super) fn parse(path: &Path, mut reader: impl Read, encoding: Encoding) -> Result<Header, VolumeError> {
    let mut start = Vec::with_capacity(LAYOUTS[1].bytes + FLAGS);
    take(path, &mut reader, EXTENSIONS_START as u64, &mut start)?;
    let (layout, order) = layout(&start).ok_or_else(|| foreign::unpacked(path, &start))?;
    let more = layout.bytes + FLAGS - EXTENSIONS_START;
    take(path, &mut reader, more as u64, &mut start)?;
    let attached = is_attached(path, layout, &start)?;
    let raw = Fields::read(layout, order, &start);
    let extensions_start = layout.bytes + FLAGS;
    let mut warnings = Vec::new();
    let (data_path, encoding, least) = if attached {
        (path.to_owned(), encoding, extensions_start as u64)
    } else {
        let (path, encoding) = image_file(path);
        (path, encoding, 0)
    };
    let offset = vox_offset(path, &raw, least)?;
    let data = DataPlace {
        path: data_path,
        more: Vec::new(),
        named: (!attached).then_some(At::Header),
        start: 0,
        skip_lines: 0,
        skip: Skip::Bytes(offset),
        encoding,
    };
    let mut names = BTreeMap::new();
    let extended = start.get(layout.bytes).is_some_and(|&flag| flag != 0);
    if attached && extended {
        // The reader stands behind the four flags: extensions fill the room up to the data.
        let length = offset.saturating_sub(extensions_start as u64).min(MAX_EXTENSION_BYTES);
        let mut extensions = Vec::new();
        take(path, &mut reader, length, &mut extensions)?;
        names = label_names(&extensions, order, &mut warnings);
    }
    let (axes, origin) = grid::axes(path, &raw, &mut warnings)?;
    // A slope of 0 means that there is none (`nifti1.h`), not that all values are equal.
    let slope_given = raw.slope.is_finite() && raw.slope != 0.0 && raw.intercept.is_finite();
    Ok(Header {
        path: path.to_owned(),
        axes,
        origin,
        unit: grid::unit(&raw).map(str::to_owned),
        element: Some(element(path, &raw)?),
        order,
        scale: slope_given
            .then(|| Scale::new("scl_slope", raw.slope, raw.intercept))
            .flatten(),
        data,
        key_values: Vec::new(),
        names,
        warnings,
    })
}

/// Whether the data follow the header in the same file; an error if the header is cut short or has no mark of NIfTI.
fn is_attached(path: &Path, layout: &Layout, start: &[u8]) -> Result<bool, VolumeError> {
    if start.len() < layout.bytes {
        let found = format!("the end of the file after {} bytes", start.len());
        let expected = format!("a {} header of {} bytes", layout.name, layout.bytes);
        return Err(VolumeError::malformed(
            path,
            At::Byte(start.len() as u64),
            found,
            expected,
        ));
    }
    let [attached, detached] = layout.magics;
    let magic = &start[layout.magic..][..attached.len()];
    if magic == attached || magic == detached {
        return Ok(magic == attached);
    }
    let byte = At::Byte(layout.magic as u64);
    // Analyze has no mark at all, and `nifti1.h` gives it those of its files that have none.
    if layout.bytes == HEADER_BYTES && magic.iter().all(|&byte| byte == 0) {
        let instead = "it says neither where its axes point nor where it lies: save it as NIfTI (nib-convert of nibabel, or 3D Slicer)";
        return Err(VolumeError::unsupported(path, byte, "an Analyze 7.5 header", instead));
    }
    let text = String::from_utf8_lossy(magic);
    let found = format!("magic {}", quoted(text.trim_end_matches('\0')));
    let expected = layout.magics.map(|magic| {
        let letters = &magic[..3];
        format!("{:?}", String::from_utf8_lossy(letters))
    });
    Err(VolumeError::malformed(path, byte, found, expected.join(" or ")))
}

fn take(path: &Path, reader: &mut impl Read, length: u64, out: &mut Vec<u8>) -> Result<(), VolumeError> {
    reader
        .take(length)
        .read_to_end(out)
        .map(drop)
        .map_err(|cause| VolumeError::read(path, cause))
}

/// Offset of the data; files that state 0 mean the smallest possible one.
fn vox_offset(path: &Path, raw: &Fields, least: u64) -> Result<u64, VolumeError> {
    let offset = raw.vox_offset;
    if offset == 0.0 {
        Ok(least)
    } else if offset >= least as f64 && offset.fract() == 0.0 && offset < 1e12 {
        Ok(offset as u64)
    } else {
        let found = format!("vox_offset {offset}");
        let expected = format!("a whole number of bytes, {least} or more");
        let byte = At::Byte(raw.layout.vox_offset as u64);
        Err(VolumeError::malformed(path, byte, found, expected))
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
fn element(path: &Path, raw: &Fields) -> Result<Element, VolumeError> {
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
            let instead = "labels are integers of 8 to 64 bits, float32 or float64: save the segmentation so";
            let byte = At::Byte(raw.layout.datatype as u64);
            return Err(VolumeError::unsupported(path, byte, found, instead));
        }
    })
}

/// Label names from the header extensions: each is its length, a code and the content of length minus eight bytes.
fn label_names(mut bytes: &[u8], order: ByteOrder, warnings: &mut Vec<String>) -> BTreeMap<i64, String> {
    let mut names = BTreeMap::new();
    while bytes.len() >= 8 {
        let length = usize::try_from(i32::decode(&bytes[..4], order)).unwrap_or(0);
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
