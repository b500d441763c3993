//! Legacy VTK format, ASCII and binary (big-endian).

use super::grid::{Array, Grid, POLYGON, STRIP, integers};
use super::{Cursor, Fault, Kind, quote, stated_axes, word};
use insonify_base::read;

/// Reads the file into a grid; poly-data, too, if surfaces are allowed.
pub(super) fn parse(bytes: &[u8], with_surfaces: bool) -> Result<Grid, Fault> {
    let mut reader = Reader {
        cursor: Cursor::new(bytes),
        binary: false,
    };
    // The first two lines are the version and a title of any text.
    reader.cursor.line();
    let is_ras = stated_axes(reader.cursor.line());
    let (start, format) = reader.cursor.word();
    reader.binary = match format.to_ascii_uppercase().as_slice() {
        b"ASCII" => false,
        b"BINARY" => true,
        _ => return Err(Fault::at(start, quote(format), "ASCII or BINARY")),
    };
    reader.keyword("DATASET")?;
    let is_poly = with_surfaces && reader.is_next("POLYDATA");
    reader.keyword(if is_poly { "POLYDATA" } else { "UNSTRUCTURED_GRID" })?;
    let mut grid = Grid {
        is_ras,
        ..Grid::default()
    };
    let mut tuples = None;
    loop {
        let (start, word) = reader.cursor.word();
        if word.is_empty() {
            return Ok(grid);
        }
        match word.to_ascii_uppercase().as_slice() {
            b"POINTS" => {
                let count = reader.cursor.count()?;
                let kind = reader.kind()?;
                grid.points = reader.numbers(product(start, count, 3)?, kind)?;
            }
            b"CELLS" => cells(&mut reader, &mut grid)?,
            kind @ (b"VERTICES" | b"LINES" | b"POLYGONS" | b"TRIANGLE_STRIPS") if is_poly => {
                let mut part = Grid::default();
                cells(&mut reader, &mut part)?;
                let code = match kind {
                    b"POLYGONS" => POLYGON,
                    b"TRIANGLE_STRIPS" => STRIP,
                    _ => continue,
                };
                let count = part.offsets.len().saturating_sub(1);
                grid.append(&part.offsets, part.connectivity, vec![code; count]);
            }
            b"CELL_TYPES" => {
                let count = reader.cursor.count()?;
                grid.types = integers(reader.numbers(count, Kind::I32)?);
            }
            b"POINT_DATA" => tuples = Some((true, reader.cursor.count()?)),
            b"CELL_DATA" => tuples = Some((false, reader.cursor.count()?)),
            b"METADATA" => reader.skip_metadata(),
            name => {
                if !attribute(&mut reader, name, tuples, &mut grid)? {
                    return Err(Fault::at(start, quote(word), "a keyword of a legacy unstructured grid"));
                }
            }
        }
    }
}

/// Reads `CELLS n size` with a count before each cell, or (version 5) `CELLS n+1 size` with OFFSETS and CONNECTIVITY.
fn cells(reader: &mut Reader, grid: &mut Grid) -> Result<(), Fault> {
    let (first, size) = (reader.cursor.count()?, reader.cursor.count()?);
    let start = reader.cursor.peek().0;
    if reader.is_next("OFFSETS") {
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
                start,
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

/// Reads an array with `tuples` values of some components, without its keyword.
fn array(reader: &mut Reader, keyword: &[u8], start: usize, tuples: usize) -> Result<Array, Fault> {
    let name = reader.name()?;
    let (components, kind) = match keyword {
        b"SCALARS" => {
            let kind = reader.kind()?;
            let components = if reader.cursor.peek().1.first().is_some_and(u8::is_ascii_digit) {
                reader.cursor.count()?
            } else {
                1
            };
            reader.keyword("LOOKUP_TABLE")?;
            reader.name()?;
            (components, kind)
        }
        b"TEXTURE_COORDINATES" => (reader.cursor.count()?, reader.kind()?),
        b"COLOR_SCALARS" => (reader.cursor.count()?, if reader.binary { Kind::U8 } else { Kind::F64 }),
        b"VECTORS" | b"NORMALS" => (3, reader.kind()?),
        b"TENSORS" => (9, reader.kind()?),
        _ => (1, reader.kind()?),
    };
    let values = reader.numbers(product(start, components, tuples)?, kind)?;
    Ok(Array {
        name,
        components,
        is_whole: kind.is_whole(),
        values,
    })
}

/// Reads one attribute of the current section; returns false for other keywords.
fn attribute(
    reader: &mut Reader,
    keyword: &[u8],
    section: Option<(bool, usize)>,
    grid: &mut Grid,
) -> Result<bool, Fault> {
    let start = reader.cursor.at;
    // A FIELD may precede any section and then belongs to the file.
    let (of_points, tuples) = section.unwrap_or((true, 0));
    let mut arrays = Vec::new();
    match keyword {
        b"FIELD" => {
            reader.name()?;
            for _ in 0..reader.cursor.count()? {
                let name = reader.name()?;
                let (components, tuples) = (reader.cursor.count()?, reader.cursor.count()?);
                let kind = reader.kind()?;
                let values = reader.numbers(product(start, components, tuples)?, kind)?;
                arrays.push(Array {
                    name,
                    components,
                    is_whole: kind.is_whole(),
                    values,
                });
                if reader.is_next("METADATA") {
                    reader.cursor.word();
                    reader.skip_metadata();
                }
            }
        }
        b"LOOKUP_TABLE" => {
            reader.name()?;
            let entries = product(start, reader.cursor.count()?, 4)?;
            reader.numbers(entries, if reader.binary { Kind::U8 } else { Kind::F64 })?;
        }
        b"SCALARS"
        | b"VECTORS"
        | b"NORMALS"
        | b"TENSORS"
        | b"GLOBAL_IDS"
        | b"PEDIGREE_IDS"
        | b"TEXTURE_COORDINATES"
        | b"COLOR_SCALARS" => arrays.push(array(reader, keyword, start, tuples)?),
        _ => return Ok(false),
    }
    match section {
        None if keyword != b"FIELD" => {
            return Err(Fault::at(start, quote(keyword), "POINT_DATA or CELL_DATA before it"));
        }
        None => {}
        Some(_) if of_points => grid.point_arrays.extend(arrays),
        Some(_) => grid.cell_arrays.extend(arrays),
    }
    Ok(true)
}

fn product(offset: usize, a: usize, b: usize) -> Result<usize, Fault> {
    a.checked_mul(b)
        .ok_or_else(|| Fault::at(offset, format!("{a} times {b} values"), "a count that fits in memory"))
}

struct Reader<'a> {
    pub cursor: Cursor<'a>,
    pub binary: bool,
}

impl Reader<'_> {
    pub(crate) fn keyword(&mut self, expected: &str) -> Result<(), Fault> {
        let (start, word) = self.cursor.word();
        if word.eq_ignore_ascii_case(expected.as_bytes()) {
            Ok(())
        } else {
            Err(Fault::at(start, quote(word), expected))
        }
    }

    /// Returns whether the next word is this one.
    pub(crate) fn is_next(&self, keyword: &str) -> bool {
        self.cursor.peek().1.eq_ignore_ascii_case(keyword.as_bytes())
    }

    /// Reads a name, resolving the `%20` escapes of the format.
    pub(crate) fn name(&mut self) -> Result<String, Fault> {
        let (start, word) = self.cursor.word();
        if word.is_empty() {
            return Err(Fault::at(start, quote(word), "a name"));
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

    pub(crate) fn kind(&mut self) -> Result<Kind, Fault> {
        let (start, word) = self.cursor.word();
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
                    start,
                    quote(word),
                    "a VTK data type such as float, double or vtktypeint64",
                ));
            }
        })
    }

    pub(crate) fn numbers(&mut self, count: usize, kind: Kind) -> Result<Vec<f64>, Fault> {
        if self.binary {
            self.binary_numbers(count, kind)
        } else {
            self.ascii_numbers(count)
        }
    }

    fn ascii_numbers(&mut self, count: usize) -> Result<Vec<f64>, Fault> {
        // Every number takes at least two bytes, so the file bounds the allocation.
        let mut values = read::room(count.min(self.cursor.rest().len() / 2 + 1), "an array of a mesh")?;
        for index in 0..count {
            values.push(self.cursor.number(|| format!("number {index} of {count}"))?);
        }
        Ok(values)
    }

    fn binary_numbers(&mut self, count: usize, kind: Kind) -> Result<Vec<f64>, Fault> {
        self.cursor.line();
        let size = kind.size();
        let data = count.checked_mul(size).and_then(|bytes| self.cursor.take(bytes));
        let data = data.ok_or_else(|| {
            let found = format!("{} bytes to the end of the file", self.cursor.rest().len());
            Fault::at(self.cursor.at, found, format!("{count} binary values of {size} bytes"))
        })?;
        let mut values = read::room(count, "an array of a mesh")?;
        values.extend(data.chunks_exact(size).map(|bytes| kind.value(word(bytes, true))));
        Ok(values)
    }

    /// Skips metadata, which end at the next blank line.
    pub(crate) fn skip_metadata(&mut self) {
        self.cursor.line();
        while !self.cursor.rest().is_empty() && !self.cursor.line().trim_ascii().is_empty() {}
    }
}

#[cfg(test)]
mod tests;
