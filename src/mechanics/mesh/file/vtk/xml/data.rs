//! The numbers of the arrays of a `.vtu` file, in each of its encodings.

use super::super::kind::{Kind, word};
use super::packed::{Source, inflate, plain};
use super::tags::{Scanner, Tag};
use super::{Fault, quote};

/// What holds for all arrays of a file.
pub(super) struct Encoding {
    big_endian: bool,
    wide_header: bool,
    zlib: bool,
}

impl Encoding {
    pub fn of(tag: &Tag) -> Result<Encoding, Fault> {
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

    /// Bytes of a word of an array's header.
    pub fn header_size(&self) -> usize {
        if self.wide_header { 8 } else { 4 }
    }

    pub fn word(&self, bytes: &[u8]) -> u64 {
        word(bytes, self.big_endian)
    }
}

pub(super) struct Appended<'a> {
    base64: bool,
    /// Offset of the first byte after the underscore.
    at: usize,
    data: &'a [u8],
}

impl<'a> Appended<'a> {
    pub fn of(tag: &Tag, scanner: &Scanner<'a>) -> Result<Appended<'a>, Fault> {
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
pub(super) fn values(
    tag: &Tag,
    text: (usize, &[u8]),
    file: &Encoding,
    appended: Option<&Appended>,
) -> Result<Vec<f64>, Fault> {
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

fn numbers(tag: &Tag, bytes: &[u8], file: &Encoding) -> Result<Vec<f64>, Fault> {
    let name = tag.get("type").unwrap_or_default();
    let kind = match name {
        "Float32" => Kind::F32,
        "Float64" => Kind::F64,
        "Int8" => Kind::I8,
        "Int16" => Kind::I16,
        "Int32" => Kind::I32,
        "Int64" => Kind::I64,
        "UInt8" => Kind::U8,
        "UInt16" => Kind::U16,
        "UInt32" => Kind::U32,
        "UInt64" => Kind::U64,
        _ => {
            return Err(Fault::at(
                tag.at,
                format!("type `{name}`"),
                "Float32, Float64 or an integer type",
            ));
        }
    };
    let size = kind.size();
    if !bytes.len().is_multiple_of(size) {
        return Err(Fault::at(
            tag.at,
            format!("{} bytes", bytes.len()),
            format!("a multiple of {size} for {name}"),
        ));
    }
    Ok(bytes
        .chunks_exact(size)
        .map(|bytes| kind.value(file.word(bytes)))
        .collect())
}
