//! The legacy VTK format, ASCII and binary (big-endian).

use super::Fault;
use super::grid::{Array, Grid, integers, quote};

/// Reads the file into a grid.
pub(super) fn parse(bytes: &[u8]) -> Result<Grid, Fault> {
    let mut reader = Reader {
        bytes,
        at: 0,
        binary: false,
    };
    reader.line();
    reader.line();
    let (at, format) = reader.word();
    reader.binary = match format.to_ascii_uppercase().as_slice() {
        b"ASCII" => false,
        b"BINARY" => true,
        _ => return Err(Fault::at(at, quote(format), "ASCII or BINARY")),
    };
    reader.keyword("DATASET")?;
    reader.keyword("UNSTRUCTURED_GRID")?;
    let mut grid = Grid::default();
    let mut tuples = None;
    loop {
        let (at, word) = reader.word();
        if word.is_empty() {
            return Ok(grid);
        }
        match word.to_ascii_uppercase().as_slice() {
            b"POINTS" => {
                let count = reader.count()?;
                let kind = reader.kind()?;
                grid.points = reader.numbers(product(at, count, 3)?, kind)?;
            }
            b"CELLS" => cells(&mut reader, &mut grid)?,
            b"CELL_TYPES" => {
                let count = reader.count()?;
                grid.types = integers(reader.numbers(count, Kind::I32)?);
            }
            b"POINT_DATA" => tuples = Some((true, reader.count()?)),
            b"CELL_DATA" => tuples = Some((false, reader.count()?)),
            b"METADATA" => reader.skip_metadata(),
            name => {
                if !attribute(&mut reader, name, tuples, &mut grid)? {
                    return Err(Fault::at(at, quote(word), "a keyword of a legacy unstructured grid"));
                }
            }
        }
    }
}

/// `CELLS n size` with a count before each cell, or (version 5) `CELLS n+1 size` with OFFSETS and CONNECTIVITY.
fn cells(reader: &mut Reader, grid: &mut Grid) -> Result<(), Fault> {
    let (first, size) = (reader.count()?, reader.count()?);
    let (at, word) = reader.peek();
    if word.eq_ignore_ascii_case(b"OFFSETS") {
        reader.keyword("OFFSETS")?;
        let kind = reader.kind()?;
        grid.offsets = integers(reader.numbers(first, kind)?);
        reader.keyword("CONNECTIVITY")?;
        let kind = reader.kind()?;
        grid.connectivity = integers(reader.numbers(size, kind)?);
        return Ok(());
    }
    let flat = integers(reader.numbers(size, Kind::I32)?);
    grid.offsets = vec![0];
    let mut rest = flat.as_slice();
    for cell in 0..first {
        let corners = rest
            .split_first()
            .and_then(|(n, tail)| tail.split_at_checked(usize::try_from(*n).ok()?));
        let Some((corners, tail)) = corners else {
            return Err(Fault::at(
                at,
                format!("cell {cell} of {first} running past its {size} numbers"),
                "a matching size",
            ));
        };
        grid.connectivity.extend_from_slice(corners);
        grid.offsets.push(grid.connectivity.len() as i64);
        rest = tail;
    }
    Ok(())
}

/// One attribute of the current section; false where the keyword is none.
fn attribute(
    reader: &mut Reader,
    keyword: &[u8],
    section: Option<(bool, usize)>,
    grid: &mut Grid,
) -> Result<bool, Fault> {
    let at = reader.at;
    // A FIELD may stand before any section and then belongs to the file.
    let (of_points, tuples) = section.unwrap_or((true, 0));
    let mut arrays = Vec::new();
    match keyword {
        b"FIELD" => {
            reader.name()?;
            for _ in 0..reader.count()? {
                let name = reader.name()?;
                let (components, tuples) = (reader.count()?, reader.count()?);
                let kind = reader.kind()?;
                let values = reader.numbers(product(at, components, tuples)?, kind)?;
                arrays.push(Array {
                    name,
                    components,
                    values,
                });
                if reader.peek().1.eq_ignore_ascii_case(b"METADATA") {
                    reader.word();
                    reader.skip_metadata();
                }
            }
        }
        b"SCALARS" => {
            let name = reader.name()?;
            let kind = reader.kind()?;
            let components = match reader.peek().1.first().is_some_and(u8::is_ascii_digit) {
                true => reader.count()?,
                false => 1,
            };
            reader.keyword("LOOKUP_TABLE")?;
            reader.name()?;
            let values = reader.numbers(product(at, components, tuples)?, kind)?;
            arrays.push(Array {
                name,
                components,
                values,
            });
        }
        b"LOOKUP_TABLE" => {
            reader.name()?;
            let entries = product(at, reader.count()?, 4)?;
            reader.numbers(entries, if reader.binary { Kind::U8 } else { Kind::F64 })?;
        }
        b"VECTORS" | b"NORMALS" | b"TENSORS" | b"GLOBAL_IDS" | b"PEDIGREE_IDS" => {
            let name = reader.name()?;
            let kind = reader.kind()?;
            let components = match keyword {
                b"VECTORS" | b"NORMALS" => 3,
                b"TENSORS" => 9,
                _ => 1,
            };
            let values = reader.numbers(product(at, components, tuples)?, kind)?;
            arrays.push(Array {
                name,
                components,
                values,
            });
        }
        b"TEXTURE_COORDINATES" => {
            let name = reader.name()?;
            let components = reader.count()?;
            let kind = reader.kind()?;
            let values = reader.numbers(product(at, components, tuples)?, kind)?;
            arrays.push(Array {
                name,
                components,
                values,
            });
        }
        b"COLOR_SCALARS" => {
            let name = reader.name()?;
            let components = reader.count()?;
            let kind = if reader.binary { Kind::U8 } else { Kind::F64 };
            let values = reader.numbers(product(at, components, tuples)?, kind)?;
            arrays.push(Array {
                name,
                components,
                values,
            });
        }
        _ => return Ok(false),
    }
    match section {
        None if keyword != b"FIELD" => {
            return Err(Fault::at(at, quote(keyword), "POINT_DATA or CELL_DATA before it"));
        }
        None => {}
        Some(_) if of_points => grid.point_arrays.extend(arrays),
        Some(_) => grid.cell_arrays.extend(arrays),
    }
    Ok(true)
}

fn product(at: usize, a: usize, b: usize) -> Result<usize, Fault> {
    a.checked_mul(b)
        .ok_or_else(|| Fault::at(at, format!("{a} times {b} values"), "a count that fits in memory"))
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    F32,
    F64,
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
}

impl Kind {
    fn size(self) -> usize {
        match self {
            Kind::I8 | Kind::U8 => 1,
            Kind::I16 | Kind::U16 => 2,
            Kind::F32 | Kind::I32 | Kind::U32 => 4,
            Kind::F64 | Kind::I64 | Kind::U64 => 8,
        }
    }

    /// One big-endian value; `b` has as many bytes as the type.
    fn value(self, b: &[u8]) -> f64 {
        let word = b.iter().fold(0u64, |word, byte| word << 8 | u64::from(*byte));
        match self {
            Kind::F32 => f64::from(f32::from_bits(word as u32)),
            Kind::F64 => f64::from_bits(word),
            Kind::I8 => f64::from(word as i8),
            Kind::I16 => f64::from(word as i16),
            Kind::I32 => f64::from(word as i32),
            Kind::I64 => word as i64 as f64,
            Kind::U8 | Kind::U16 | Kind::U32 | Kind::U64 => word as f64,
        }
    }
}

struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
    binary: bool,
}

impl<'a> Reader<'a> {
    fn line(&mut self) -> &'a [u8] {
        let rest = &self.bytes[self.at..];
        let end = rest.iter().position(|b| *b == b'\n').unwrap_or(rest.len());
        self.at += (end + 1).min(rest.len());
        &rest[..end]
    }

    fn peek(&self) -> (usize, &'a [u8]) {
        let rest = &self.bytes[self.at..];
        let start = rest.iter().position(|b| !b.is_ascii_whitespace()).unwrap_or(rest.len());
        let end = rest[start..]
            .iter()
            .position(u8::is_ascii_whitespace)
            .map_or(rest.len(), |n| start + n);
        (self.at + start, &rest[start..end])
    }

    /// The next word and its offset; empty at the end.
    fn word(&mut self) -> (usize, &'a [u8]) {
        let (at, word) = self.peek();
        self.at = at + word.len();
        (at, word)
    }

    fn keyword(&mut self, expected: &str) -> Result<(), Fault> {
        let (at, word) = self.word();
        match word.eq_ignore_ascii_case(expected.as_bytes()) {
            true => Ok(()),
            false => Err(Fault::at(at, quote(word), expected)),
        }
    }

    /// A name, with the `%20` escapes of the format resolved.
    fn name(&mut self) -> Result<String, Fault> {
        let (at, word) = self.word();
        if word.is_empty() {
            return Err(Fault::at(at, quote(word), "a name"));
        }
        let mut name = Vec::with_capacity(word.len());
        let mut rest = word;
        while let Some((&first, tail)) = rest.split_first() {
            let code = tail.get(..2).and_then(|hex| std::str::from_utf8(hex).ok());
            let code = code
                .filter(|_| first == b'%')
                .and_then(|hex| u8::from_str_radix(hex, 16).ok());
            name.push(code.unwrap_or(first));
            rest = if code.is_some() { &tail[2..] } else { tail };
        }
        Ok(String::from_utf8_lossy(&name).into_owned())
    }

    fn count(&mut self) -> Result<usize, Fault> {
        let (at, word) = self.word();
        let count = std::str::from_utf8(word).ok().and_then(|word| word.parse().ok());
        count.ok_or_else(|| Fault::at(at, quote(word), "a count"))
    }

    fn kind(&mut self) -> Result<Kind, Fault> {
        let (at, word) = self.word();
        Ok(match word.to_ascii_lowercase().as_slice() {
            b"float" => Kind::F32,
            b"double" => Kind::F64,
            b"char" | b"vtktypeint8" => Kind::I8,
            b"unsigned_char" | b"vtktypeuint8" => Kind::U8,
            b"short" | b"vtktypeint16" => Kind::I16,
            b"unsigned_short" | b"vtktypeuint16" => Kind::U16,
            b"int" | b"vtktypeint32" | b"vtkidtype" => Kind::I32,
            b"unsigned_int" | b"vtktypeuint32" => Kind::U32,
            b"long" | b"vtktypeint64" => Kind::I64,
            b"unsigned_long" | b"vtktypeuint64" => Kind::U64,
            _ => {
                return Err(Fault::at(
                    at,
                    quote(word),
                    "a VTK data type such as float, double or vtktypeint64",
                ));
            }
        })
    }

    fn numbers(&mut self, count: usize, kind: Kind) -> Result<Vec<f64>, Fault> {
        if self.binary {
            self.binary_numbers(count, kind)
        } else {
            self.ascii_numbers(count)
        }
    }

    fn ascii_numbers(&mut self, count: usize) -> Result<Vec<f64>, Fault> {
        // Every number takes at least two bytes, so the file bounds what is set aside.
        let mut values = Vec::with_capacity(count.min(self.bytes.len() / 2 + 1));
        for index in 0..count {
            let (at, word) = self.word();
            let value = std::str::from_utf8(word).ok().and_then(|word| word.parse().ok());
            let value = value.ok_or_else(|| Fault::at(at, quote(word), format!("number {index} of {count}")))?;
            values.push(value);
        }
        Ok(values)
    }

    fn binary_numbers(&mut self, count: usize, kind: Kind) -> Result<Vec<f64>, Fault> {
        self.line();
        let rest = &self.bytes[self.at..];
        let data = count
            .checked_mul(kind.size())
            .and_then(|size| rest.get(..size))
            .ok_or_else(|| {
                let found = format!("{} bytes to the end of the file", rest.len());
                Fault::at(
                    self.at,
                    found,
                    format!("{count} binary values of {} bytes", kind.size()),
                )
            })?;
        self.at += data.len();
        Ok(data.chunks_exact(kind.size()).map(|bytes| kind.value(bytes)).collect())
    }

    /// Metadata run to the next blank line.
    fn skip_metadata(&mut self) {
        self.line();
        while self.at < self.bytes.len() && !self.line().trim_ascii().is_empty() {}
    }
}
