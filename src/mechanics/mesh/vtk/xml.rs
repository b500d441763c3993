//! The XML format of VTK for unstructured grids (`.vtu`).
//!
//! Raw appended data is no XML, so the few tags that matter are read by hand, each with its byte offset.

use std::io::Read;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;

use super::Fault;
use super::grid::{Array, Grid, integers, quote};

/// Zlib shrinks by 1032 to 1 at best: a block that claims more is a broken or hostile header.
const ZLIB_RATIO: usize = 1032;

/// Reads the file into a grid.
pub(super) fn parse(bytes: &[u8]) -> Result<Grid, Fault> {
    let mut scanner = Scanner { bytes, at: 0 };
    let mut file = None;
    let mut arrays = Vec::new();
    let mut sections: Vec<String> = Vec::new();
    let mut counts = None;
    let mut appended = None;
    while let Some(tag) = scanner.tag()? {
        if tag.closing {
            sections.pop();
            continue;
        }
        match tag.name.as_str() {
            "VTKFile" => file = Some(Encoding::of(&tag)?),
            "Piece" if counts.is_some() => return Err(Fault::at(tag.at, "a second Piece", "a single Piece")),
            "Piece" => counts = Some((tag.count("NumberOfPoints")?, tag.count("NumberOfCells")?)),
            "DataArray" => {
                let section = sections.last().cloned().unwrap_or_default();
                let text = if tag.empty {
                    (scanner.at, &bytes[..0])
                } else {
                    scanner.text()
                };
                arrays.push((section, tag.clone(), text));
            }
            "AppendedData" => {
                appended = Some(Appended::of(&tag, &scanner)?);
                break;
            }
            _ => {}
        }
        if !tag.empty {
            sections.push(tag.name);
        }
    }
    let (Some(file), Some((points, cells))) = (file, counts) else {
        return Err(Fault::at(
            scanner.at,
            quote(&[]),
            "a VTKFile with an UnstructuredGrid and one Piece",
        ));
    };
    let mut grid = Grid::default();
    for (section, tag, text) in arrays {
        let attribute = match section.as_str() {
            "Points" | "Cells" => false,
            "PointData" | "CellData" => true,
            _ => continue,
        };
        if attribute && tag.get("type") == Some("String") {
            continue;
        }
        let components = tag
            .get("NumberOfComponents")
            .map_or(Ok(1), |_| tag.count("NumberOfComponents"))?;
        let values = values(&tag, text, &file, appended.as_ref())?;
        let name = tag.get("Name").unwrap_or_default().to_owned();
        match (section.as_str(), name.as_str()) {
            ("Points", _) => grid.points = expect(&tag, values, points.checked_mul(3))?,
            ("Cells", "connectivity") => grid.connectivity = integers(values),
            ("Cells", "offsets") => {
                grid.offsets = integers(expect(&tag, values, Some(cells))?);
                grid.offsets.insert(0, 0);
            }
            ("Cells", "types") => grid.types = integers(expect(&tag, values, Some(cells))?),
            ("PointData", _) => grid.point_arrays.push(Array {
                name,
                components,
                values,
            }),
            ("CellData", _) => grid.cell_arrays.push(Array {
                name,
                components,
                values,
            }),
            _ => {}
        }
    }
    if grid.offsets.is_empty() {
        grid.offsets.push(0);
    }
    Ok(grid)
}

fn expect(tag: &Tag, values: Vec<f64>, count: Option<usize>) -> Result<Vec<f64>, Fault> {
    match count == Some(values.len()) {
        true => Ok(values),
        false => Err(Fault::at(
            tag.at,
            format!("{} values in `{}`", values.len(), tag.get("Name").unwrap_or_default()),
            count.map_or("a count that fits in memory".to_owned(), |count| format!("{count}")),
        )),
    }
}

/// What holds for all arrays of a file.
struct Encoding {
    big_endian: bool,
    wide_header: bool,
    zlib: bool,
}

impl Encoding {
    fn of(tag: &Tag) -> Result<Encoding, Fault> {
        let choose = |key: &str, default: &str, choices: [&str; 2]| {
            let found = tag.get(key).unwrap_or(default);
            match choices.iter().position(|choice| *choice == found) {
                Some(place) => Ok(place == 1),
                None => Err(Fault::at(tag.at, format!("{key}=`{found}`"), choices.join(" or "))),
            }
        };
        choose("type", "", ["UnstructuredGrid", "UnstructuredGrid"])?;
        Ok(Encoding {
            big_endian: choose("byte_order", "LittleEndian", ["LittleEndian", "BigEndian"])?,
            wide_header: choose("header_type", "UInt32", ["UInt32", "UInt64"])?,
            zlib: choose("compressor", "", ["", "vtkZLibDataCompressor"])?,
        })
    }

    fn header_size(&self) -> usize {
        if self.wide_header { 8 } else { 4 }
    }

    fn word(&self, bytes: &[u8]) -> u64 {
        let shift = |word: u64, byte: &u8| word << 8 | u64::from(*byte);
        if self.big_endian {
            bytes.iter().fold(0, shift)
        } else {
            bytes.iter().rev().fold(0, shift)
        }
    }
}

struct Appended<'a> {
    base64: bool,
    /// Offset of the first byte after the underscore.
    at: usize,
    data: &'a [u8],
}

impl<'a> Appended<'a> {
    fn of(tag: &Tag, scanner: &Scanner<'a>) -> Result<Appended<'a>, Fault> {
        let base64 = match tag.get("encoding") {
            Some("raw") => false,
            Some("base64") => true,
            other => return Err(Fault::at(tag.at, format!("encoding {other:?}"), "raw or base64")),
        };
        let rest = &scanner.bytes[scanner.at..];
        let underscore = rest
            .iter()
            .position(|b| !b.is_ascii_whitespace())
            .filter(|at| rest[*at] == b'_');
        let start =
            underscore.ok_or_else(|| Fault::at(scanner.at, quote(&rest[..rest.len().min(16)]), "an underscore"))?;
        Ok(Appended {
            base64,
            at: scanner.at + start + 1,
            data: &rest[start + 1..],
        })
    }
}

/// The numbers of one array.
fn values(tag: &Tag, text: (usize, &[u8]), file: &Encoding, appended: Option<&Appended>) -> Result<Vec<f64>, Fault> {
    let (at, source) = match tag.get("format").unwrap_or("ascii") {
        "ascii" => return ascii(text),
        "binary" => (text.0, Source::Base64(text.1.trim_ascii())),
        "appended" => {
            let offset = tag.count("offset")?;
            let data = appended.ok_or_else(|| Fault::at(tag.at, "an appended array", "AppendedData"))?;
            let rest = data.data.get(offset..).ok_or_else(|| {
                Fault::at(
                    tag.at,
                    format!("offset {offset}"),
                    format!("at most {}", data.data.len()),
                )
            })?;
            (
                data.at + offset,
                if data.base64 {
                    Source::Base64(rest)
                } else {
                    Source::Raw(rest)
                },
            )
        }
        other => {
            return Err(Fault::at(
                tag.at,
                format!("format `{other}`"),
                "ascii, binary or appended",
            ));
        }
    };
    let bytes = if file.zlib {
        inflate(at, source, file)?
    } else {
        plain(at, source, file)?
    };
    numbers(tag, &bytes, file)
}

fn ascii((at, text): (usize, &[u8])) -> Result<Vec<f64>, Fault> {
    let words = text.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
    words
        .map(|word| {
            let value = std::str::from_utf8(word).ok().and_then(|word| word.parse().ok());
            let offset = at + (word.as_ptr() as usize - text.as_ptr() as usize);
            value.ok_or_else(|| Fault::at(offset, quote(word), "a number"))
        })
        .collect()
}

#[derive(Clone, Copy)]
enum Source<'a> {
    Base64(&'a [u8]),
    Raw(&'a [u8]),
}

impl Source<'_> {
    /// The first `count` bytes, and how far into the source they and any base64 padding reach.
    fn take(&self, at: usize, skip: usize, count: usize) -> Result<(Vec<u8>, usize), Fault> {
        let short = |held: usize| {
            Fault::at(
                at + skip,
                format!("{} encoded bytes to the end", held.saturating_sub(skip)),
                format!("{count} bytes of data"),
            )
        };
        match self {
            Source::Raw(bytes) => {
                let end = skip.checked_add(count).ok_or_else(|| short(bytes.len()))?;
                let data = bytes.get(skip..end).ok_or_else(|| short(bytes.len()))?;
                Ok((data.to_vec(), end))
            }
            Source::Base64(bytes) => {
                let end = count.div_ceil(3).checked_mul(4).and_then(|size| size.checked_add(skip));
                let text = end
                    .and_then(|end| bytes.get(skip..end))
                    .ok_or_else(|| short(bytes.len()))?;
                let mut data = STANDARD
                    .decode(text)
                    .map_err(|error| Fault::at(at + skip, format!("broken base64 ({error})"), "base64 data"))?;
                if data.len() < count {
                    return Err(short(bytes.len()));
                }
                data.truncate(count);
                Ok((data, skip + text.len()))
            }
        }
    }
}

/// Uncompressed: the byte count, then the bytes, encoded as one.
fn plain(at: usize, source: Source, file: &Encoding) -> Result<Vec<u8>, Fault> {
    let header = file.header_size();
    let (count, _) = source.take(at, 0, header)?;
    let count = usize::try_from(file.word(&count))
        .ok()
        .and_then(|count| count.checked_add(header));
    let count = count.ok_or_else(|| Fault::at(at, "a byte count beyond memory", "the size of the array"))?;
    let (mut bytes, _) = source.take(at, 0, count)?;
    bytes.drain(..header);
    Ok(bytes)
}

/// Compressed: the number of blocks, their size, the size of the last partial block (0: none), the compressed sizes; then,
/// encoded apart, the blocks.
fn inflate(at: usize, source: Source, file: &Encoding) -> Result<Vec<u8>, Fault> {
    let width = file.header_size();
    let words = |bytes: &[u8]| -> Option<Vec<usize>> {
        bytes
            .chunks_exact(width)
            .map(|word| usize::try_from(file.word(word)).ok())
            .collect()
    };
    let beyond = || Fault::at(at, "block sizes beyond memory", "the sizes of compressed blocks");
    let blocks = words(&source.take(at, 0, width)?.0).ok_or_else(beyond)?[0];
    if blocks == 0 {
        return Ok(Vec::new());
    }
    let size = blocks
        .checked_add(3)
        .and_then(|words| words.checked_mul(width))
        .ok_or_else(beyond)?;
    let (header, mut skip) = source.take(at, 0, size)?;
    let header = words(&header).ok_or_else(beyond)?;
    let (full, partial, sizes) = (header[1], header[2], &header[3..]);
    let packed = sizes
        .iter()
        .try_fold(0usize, |sum, size| sum.checked_add(*size))
        .ok_or_else(beyond)?;
    let (packed, _) = source.take(at, skip, packed)?;
    let mut rest = packed.as_slice();
    let mut out = Vec::new();
    for (block, &size) in sizes.iter().enumerate() {
        let (data, tail) = rest.split_at(size);
        let expected = if block + 1 == blocks && partial > 0 {
            partial
        } else {
            full
        };
        if expected > size.saturating_mul(ZLIB_RATIO) {
            return Err(Fault::at(
                at + skip,
                format!("block {block} of {size} bytes claiming {expected}"),
                "a zlib block",
            ));
        }
        let before = out.len();
        flate2::read::ZlibDecoder::new(data)
            .take(expected as u64 + 1)
            .read_to_end(&mut out)
            .map_err(|error| {
                Fault::at(
                    at + skip,
                    format!("broken zlib data in block {block} ({error})"),
                    "a zlib block",
                )
            })?;
        if out.len() - before != expected {
            let found = format!("{} bytes in block {block}", out.len() - before);
            return Err(Fault::at(at + skip, found, format!("{expected}")));
        }
        skip += if matches!(source, Source::Raw(_)) { size } else { 0 };
        rest = tail;
    }
    Ok(out)
}

fn numbers(tag: &Tag, bytes: &[u8], file: &Encoding) -> Result<Vec<f64>, Fault> {
    let kind = tag.get("type").unwrap_or_default();
    type Convert = fn(u64) -> f64;
    let (size, convert): (usize, Convert) = match kind {
        "Float32" => (4, |w| f64::from(f32::from_bits(w as u32))),
        "Float64" => (8, f64::from_bits),
        "Int8" => (1, |w| f64::from(w as i8)),
        "Int16" => (2, |w| f64::from(w as i16)),
        "Int32" => (4, |w| f64::from(w as i32)),
        "Int64" => (8, |w| w as i64 as f64),
        "UInt8" => (1, |w| w as f64),
        "UInt16" => (2, |w| w as f64),
        "UInt32" => (4, |w| w as f64),
        "UInt64" => (8, |w| w as f64),
        _ => {
            return Err(Fault::at(
                tag.at,
                format!("type `{kind}`"),
                "Float32, Float64 or an integer type",
            ));
        }
    };
    if !bytes.len().is_multiple_of(size) {
        return Err(Fault::at(
            tag.at,
            format!("{} bytes", bytes.len()),
            format!("a multiple of {size} for {kind}"),
        ));
    }
    Ok(bytes.chunks_exact(size).map(|word| convert(file.word(word))).collect())
}

#[derive(Clone, Debug)]
struct Tag {
    at: usize,
    name: String,
    attributes: Vec<(String, String)>,
    closing: bool,
    empty: bool,
}

impl Tag {
    fn get(&self, key: &str) -> Option<&str> {
        self.attributes
            .iter()
            .find(|(name, _)| name == key)
            .map(|(_, value)| value.as_str())
    }

    fn count(&self, key: &str) -> Result<usize, Fault> {
        let text = self.get(key);
        text.and_then(|text| text.trim().parse().ok()).ok_or_else(|| {
            let found = text.map_or("nothing".to_owned(), |text| format!("`{text}`"));
            Fault::at(self.at, format!("{found} for {key} in <{}>", self.name), "a count")
        })
    }
}

struct Scanner<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Scanner<'a> {
    /// Text up to the next tag.
    fn text(&mut self) -> (usize, &'a [u8]) {
        let (at, rest) = (self.at, &self.bytes[self.at..]);
        let end = rest.iter().position(|b| *b == b'<').unwrap_or(rest.len());
        self.at += end;
        (at, &rest[..end])
    }

    /// The next opening, closing or empty tag; comments and declarations are passed over.
    fn tag(&mut self) -> Result<Option<Tag>, Fault> {
        loop {
            let (before, text) = self.text();
            let at = before + text.len();
            let rest = &self.bytes[at..];
            if rest.is_empty() {
                return Ok(None);
            }
            let (skip, end): (bool, &[u8]) = match rest {
                [b'<', b'!', b'-', b'-', ..] => (true, b"-->"),
                [b'<', b'?' | b'!', ..] => (true, b">"),
                _ => (false, b">"),
            };
            let length = rest.windows(end.len()).position(|window| window == end);
            let length = length.ok_or_else(|| Fault::at(at, "a tag that does not end", "`>`"))?;
            self.at = at + length + end.len();
            if !skip {
                return parse_tag(at, &rest[1..length]).map(Some);
            }
        }
    }
}

fn parse_tag(at: usize, inside: &[u8]) -> Result<Tag, Fault> {
    let broken = || {
        Fault::at(
            at,
            quote(&inside[..inside.len().min(60)]),
            "a tag with quoted attributes",
        )
    };
    let text = std::str::from_utf8(inside).map_err(|_| broken())?.trim();
    let (closing, text) = text.strip_prefix('/').map_or((false, text), |text| (true, text));
    let (empty, text) = text.strip_suffix('/').map_or((false, text), |text| (true, text));
    let end = text.find(char::is_whitespace).unwrap_or(text.len());
    let (name, mut rest) = (text[..end].to_owned(), text[end..].trim());
    let mut attributes = Vec::new();
    while !rest.is_empty() {
        let (key, after) = rest.split_once('=').ok_or_else(broken)?;
        let after = after.trim_start();
        let quote = after
            .chars()
            .next()
            .filter(|c| matches!(c, '"' | '\''))
            .ok_or_else(broken)?;
        let (value, tail) = after[1..].split_once(quote).ok_or_else(broken)?;
        attributes.push((key.trim().to_owned(), unescape(value)));
        rest = tail.trim_start();
    }
    Ok(Tag {
        at,
        name,
        attributes,
        closing,
        empty,
    })
}

fn unescape(value: &str) -> String {
    value
        .replace("&lt;", "<")
        .replace("&gt;", ">")
        .replace("&quot;", "\"")
        .replace("&apos;", "'")
        .replace("&amp;", "&")
}
