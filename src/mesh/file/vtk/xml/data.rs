//! Decoder of the arrays of a `.vtu` file, in each of its encodings.

use super::super::{Kind, word};
use super::packed::{Packed, Source};
use super::{Fault, Scanner, Tag, quote};
use insonify_base::read;

/// Encoding common to all arrays of a file.
pub(super) struct Encoding {
    big_endian: bool,
    wide_header: bool,
    zlib: bool,
}

impl Encoding {
    pub(super) fn of(tag: &Tag, kind: &str) -> Result<Encoding, Fault> {
        let choose = |key: &str, default: &str, choices: [&str; 2], remedy: &str| {
            let found = tag.get(key).unwrap_or(default);
            match choices.iter().position(|choice| *choice == found) {
                Some(index) => Ok(index == 1),
                None => {
                    let choices = choices.map(|choice| if choice.is_empty() { "none" } else { choice });
                    let expected = format!("{}{remedy}", choices.join(" or "));
                    Err(Fault::at(tag.at, format!("{key}=`{found}`"), expected))
                }
            }
        };
        if tag.get("type") != Some(kind) {
            let found = format!("type=`{}`", tag.get("type").unwrap_or_default());
            return Err(Fault::at(tag.at, found, kind));
        }
        Ok(Encoding {
            big_endian: choose("byte_order", "LittleEndian", ["LittleEndian", "BigEndian"], "")?,
            wide_header: choose("header_type", "UInt32", ["UInt32", "UInt64"], "")?,
            zlib: choose(
                "compressor",
                "",
                ["", "vtkZLibDataCompressor"],
                " (a choice of Save Data in ParaView)",
            )?,
        })
    }

    /// Returns the size of a word of an array's header, bytes.
    pub(super) fn header_size(&self) -> usize {
        if self.wide_header { 8 } else { 4 }
    }

    pub(super) fn word(&self, bytes: &[u8]) -> u64 {
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
    pub(super) fn of(tag: &Tag, scanner: &Scanner<'a>) -> Result<Appended<'a>, Fault> {
        let base64 = match tag.get("encoding") {
            Some("raw") => false,
            Some("base64") => true,
            other => return Err(Fault::at(tag.at, format!("encoding {other:?}"), "raw or base64")),
        };
        let rest = &scanner.bytes[scanner.at..];
        let underscore = rest
            .iter()
            .position(|b| !b.is_ascii_whitespace())
            .filter(|index| rest[*index] == b'_');
        let start =
            underscore.ok_or_else(|| Fault::at(scanner.at, quote(&rest[..rest.len().min(16)]), "an underscore"))?;
        Ok(Appended {
            base64,
            at: scanner.at + start + 1,
            data: &rest[start + 1..],
        })
    }
}

/// Decodes one array, which must have `count` numbers (`None`: more than memory can hold).
pub(super) fn values(
    tag: &Tag,
    text: (usize, &[u8]),
    file: &Encoding,
    appended: Option<&Appended>,
    count: Option<usize>,
) -> Result<Vec<f64>, Fault> {
    let name = tag.get("Name").unwrap_or_default();
    let fault = |found: String| {
        let expected = count.map_or("a count that fits in memory".to_owned(), |count| {
            format!("{count} values")
        });
        Fault::at(tag.at, format!("{found} in `{name}`"), expected)
    };
    let count = count.ok_or_else(|| fault("too many values".to_owned()))?;
    let (start, source) = match tag.get("format").unwrap_or("ascii") {
        "ascii" => return ascii(text, count, fault),
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
    let kind = kind(tag)?;
    let packed = if file.zlib {
        Packed::zlib(start, source, file)?
    } else {
        Packed::plain(start, source, file)?
    };
    // Before any memory is taken: both sizes are only claims of the file.
    if count.checked_mul(kind.size()) != Some(packed.size) {
        let found = format!("{} bytes ({} a value)", packed.size, kind.size());
        return Err(fault(found));
    }
    let mut values = read::room(count, "an array of a mesh")?;
    let bytes = packed.bytes()?;
    let numbers = bytes.chunks_exact(kind.size());
    values.extend(numbers.map(|bytes| kind.value(file.word(bytes))));
    Ok(values)
}

fn ascii((at, text): (usize, &[u8]), count: usize, fault: impl Fn(String) -> Fault) -> Result<Vec<f64>, Fault> {
    let words = text.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
    // Each takes at least a digit and a blank.
    let mut values = read::room(count.min(text.len() / 2 + 1), "an array of a mesh")?;
    for word in words {
        if values.len() == count {
            return Err(fault(format!("more than {count} values")));
        }
        let value = std::str::from_utf8(word).ok().and_then(|word| word.parse().ok());
        let offset = at + (word.as_ptr() as usize - text.as_ptr() as usize);
        values.push(value.ok_or_else(|| Fault::at(offset, quote(word), "a number"))?);
    }
    if values.len() == count {
        Ok(values)
    } else {
        Err(fault(format!("{} values", values.len())))
    }
}

fn kind(tag: &Tag) -> Result<Kind, Fault> {
    let name = tag.get("type").unwrap_or_default();
    Ok(match name {
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
    })
}
