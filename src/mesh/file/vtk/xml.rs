//! XML format of VTK for unstructured grids (`.vtu`).

mod data;
mod packed;

use std::collections::BTreeMap;

use super::grid::{Array, Grid, integers};
use super::write::REGION_NAMES;
use super::{Fault, quote};
use data::{Appended, Encoding, values};
use insonify_base::text::unescape;

/// Reads the file into a grid, with the values of those arrays of points (true) or cells (false) that are wanted.
pub(super) fn parse(bytes: &[u8], wanted: impl Fn(bool, &str) -> bool) -> Result<Grid, Fault> {
    let mut scanner = Scanner { bytes, at: 0 };
    let mut file = None;
    let mut piece = Piece::default();
    let mut sections: Vec<String> = Vec::new();
    let mut counts = None;
    let mut appended = None;
    let mut names = BTreeMap::new();
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
                let text = if tag.empty {
                    (scanner.at, &bytes[..0])
                } else {
                    scanner.text()
                };
                piece.add(sections.last().map_or("", String::as_str), tag.clone(), text, &wanted)?;
            }
            "Array" if tag.get("Name") == Some(REGION_NAMES) && tag.get("format") == Some("ascii") && !tag.empty => {
                names = region_names(scanner.text())?;
            }
            "AppendedData" => {
                appended = Some(Appended::of(&tag, &scanner)?);
                // What follows may be raw bytes, in which no tag can be told.
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
    let grid = piece.grid(points, cells, |raw, count| {
        values(&raw.tag, raw.text, &file, appended.as_ref(), count)
    })?;
    Ok(Grid {
        region_names: names,
        ..grid
    })
}

/// Parses names of regions from strings such as `5 liver`, given as character codes that end in 0; strings without a number
/// are skipped.
fn region_names((at, text): (usize, &[u8])) -> Result<BTreeMap<i32, String>, Fault> {
    let mut codes = Vec::new();
    for word in text.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty()) {
        let code: Option<u8> = std::str::from_utf8(word).ok().and_then(|word| word.parse().ok());
        let offset = at + (word.as_ptr() as usize - text.as_ptr() as usize);
        codes.push(code.ok_or_else(|| Fault::at(offset, quote(word), "the code of a character, 0 to 255"))?);
    }
    let named = codes.split(|code| *code == 0).filter_map(|name| {
        let name = String::from_utf8_lossy(name);
        let (number, name) = name.split_once(' ')?;
        Some((number.parse().ok()?, name.to_owned()))
    });
    Ok(named.collect())
}

/// An array as text.
struct Raw<'a> {
    tag: Tag,
    text: (usize, &'a [u8]),
}

/// Arrays of a piece, not yet decoded.
#[derive(Default)]
struct Piece<'a> {
    points: Option<Raw<'a>>,
    connectivity: Option<Raw<'a>>,
    offsets: Option<Raw<'a>>,
    types: Option<Raw<'a>>,
    /// Names and components of the arrays of points and of cells, with those that are wanted.
    point_arrays: Vec<(Array, Option<Raw<'a>>)>,
    cell_arrays: Vec<(Array, Option<Raw<'a>>)>,
}

impl<'a> Piece<'a> {
    fn add(
        &mut self,
        section: &str,
        tag: Tag,
        text: (usize, &'a [u8]),
        wanted: impl Fn(bool, &str) -> bool,
    ) -> Result<(), Fault> {
        let name = tag.get("Name").unwrap_or_default();
        let section_data = match (section, name) {
            ("Points", _) => &mut self.points,
            ("Cells", "connectivity") => &mut self.connectivity,
            ("Cells", "offsets") => &mut self.offsets,
            ("Cells", "types") => &mut self.types,
            ("PointData" | "CellData", name) if tag.get("type") != Some("String") => {
                let of_points = section == "PointData";
                let array = Array {
                    name: name.to_owned(),
                    components: tag
                        .get("NumberOfComponents")
                        .map_or(Ok(1), |_| tag.count("NumberOfComponents"))?,
                    values: Vec::new(),
                };
                let arrays = if of_points {
                    &mut self.point_arrays
                } else {
                    &mut self.cell_arrays
                };
                // Of several arrays with one name the first counts.
                let new = wanted(of_points, name) && arrays.iter().all(|(other, _)| other.name != name);
                arrays.push((array, new.then_some(Raw { tag, text })));
                return Ok(());
            }
            _ => return Ok(()),
        };
        if section_data.is_some() {
            return Err(Fault::at(
                tag.at,
                format!("a second array `{name}` in {section}"),
                "one",
            ));
        }
        *section_data = Some(Raw { tag, text });
        Ok(())
    }

    /// Returns the grid, with each array decoded by `decode` to its number of values.
    fn grid(
        self,
        points: usize,
        cells: usize,
        decode: impl Fn(&Raw, Option<usize>) -> Result<Vec<f64>, Fault>,
    ) -> Result<Grid, Fault> {
        let decode_or_none = |raw: Option<Raw>, count| raw.map_or(Ok(Vec::new()), |raw| decode(&raw, count));
        let all = |arrays: Vec<(Array, Option<Raw>)>, tuples: usize| -> Result<Vec<Array>, Fault> {
            let decoded = arrays.into_iter().map(|(array, raw)| {
                let values = decode_or_none(raw, tuples.checked_mul(array.components))?;
                Ok(Array { values, ..array })
            });
            decoded.collect()
        };
        let mut offsets = integers(decode_or_none(self.offsets, Some(cells))?);
        let corners = offsets.last().map_or(Some(0), |last| usize::try_from(*last).ok());
        offsets.insert(0, 0);
        Ok(Grid {
            points: decode_or_none(self.points, points.checked_mul(3))?,
            connectivity: integers(decode_or_none(self.connectivity, corners)?),
            types: integers(decode_or_none(self.types, Some(cells))?),
            offsets,
            point_arrays: all(self.point_arrays, points)?,
            cell_arrays: all(self.cell_arrays, cells)?,
            region_names: BTreeMap::new(),
        })
    }
}

/// A tag with its attributes.
#[derive(Clone, Debug)]
struct Tag {
    pub at: usize,
    pub name: String,
    attributes: Vec<(String, String)>,
    pub closing: bool,
    pub empty: bool,
}

impl Tag {
    pub(crate) fn get(&self, key: &str) -> Option<&str> {
        self.attributes
            .iter()
            .find(|(name, _)| name == key)
            .map(|(_, value)| value.as_str())
    }

    pub(crate) fn count(&self, key: &str) -> Result<usize, Fault> {
        let text = self.get(key);
        text.and_then(|text| text.trim().parse().ok()).ok_or_else(|| {
            let found = text.map_or("nothing".to_owned(), |text| format!("`{text}`"));
            Fault::at(self.at, format!("{found} for {key} in <{}>", self.name), "a count")
        })
    }
}

/// Scanner from tag to tag.
struct Scanner<'a> {
    pub bytes: &'a [u8],
    pub at: usize,
}

impl<'a> Scanner<'a> {
    /// Reads the text up to the next tag.
    pub(crate) fn text(&mut self) -> (usize, &'a [u8]) {
        let (start, rest) = (self.at, &self.bytes[self.at..]);
        let end = rest.iter().position(|b| *b == b'<').unwrap_or(rest.len());
        self.at += end;
        (start, &rest[..end])
    }

    /// Reads the next opening, closing or empty tag; comments and declarations are skipped.
    pub(crate) fn tag(&mut self) -> Result<Option<Tag>, Fault> {
        loop {
            let (before, text) = self.text();
            let start = before + text.len();
            let rest = &self.bytes[start..];
            if rest.is_empty() {
                return Ok(None);
            }
            let (skip, end): (bool, &[u8]) = match rest {
                [b'<', b'!', b'-', b'-', ..] => (true, b"-->"),
                [b'<', b'?' | b'!', ..] => (true, b">"),
                _ => (false, b">"),
            };
            let length = rest.windows(end.len()).position(|window| window == end);
            let length = length.ok_or_else(|| Fault::at(start, "a tag that does not end", "`>`"))?;
            self.at = start + length + end.len();
            if !skip {
                return parse_tag(start, &rest[1..length]).map(Some);
            }
        }
    }
}

fn parse_tag(start: usize, inside: &[u8]) -> Result<Tag, Fault> {
    let broken = || {
        Fault::at(
            start,
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
        at: start,
        name,
        attributes,
        closing,
        empty,
    })
}

#[cfg(test)]
mod tests;
