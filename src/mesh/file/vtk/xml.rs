//! XML format of VTK for unstructured grids (`.vtu`) and poly-data (`.vtp`).

mod data;
mod packed;

use std::collections::BTreeMap;

use super::grid::{Array, Grid, POLYGON, STRIP, integers};
use super::write::REGION_NAMES;
use super::{Fault, quote, stated_axes};
use data::{Appended, Encoding, values};
use insonify_base::text::unescape;

/// Reads the file into a grid, with the values of those arrays of points (true) or cells (false) that are wanted;
/// poly-data, too, if surfaces are allowed.
pub(super) fn parse(
    bytes: &[u8],
    with_surfaces: bool,
    wanted: impl Fn(bool, &[Array]) -> Vec<usize>,
) -> Result<Grid, Fault> {
    let mut scanner = Scanner { bytes, at: 0 };
    let mut file = None;
    let mut piece = Piece::default();
    let mut sections: Vec<String> = Vec::new();
    let mut counts = None;
    let mut appended = None;
    let mut names = BTreeMap::new();
    let (mut is_poly, mut space) = (false, None);
    while let Some(tag) = scanner.tag()? {
        if tag.closing {
            sections.pop();
            continue;
        }
        match tag.name.as_str() {
            "VTKFile" => {
                is_poly = with_surfaces && tag.get("type") == Some("PolyData");
                file = Some(Encoding::of(
                    &tag,
                    if is_poly { "PolyData" } else { "UnstructuredGrid" },
                )?);
            }
            "Piece" if counts.is_some() => {
                return Err(Fault::at(
                    tag.at,
                    "a second Piece",
                    "a single Piece, as ParaView's Save Data writes it",
                ));
            }
            "Piece" if is_poly => {
                let strips = tag
                    .get("NumberOfStrips")
                    .map_or(Ok(0), |_| tag.count("NumberOfStrips"))?;
                counts = Some((tag.count("NumberOfPoints")?, [tag.count("NumberOfPolys")?, strips]));
            }
            "Piece" => counts = Some((tag.count("NumberOfPoints")?, [tag.count("NumberOfCells")?, 0])),
            "DataArray" => {
                let text = if tag.empty {
                    (scanner.at, &bytes[..0])
                } else {
                    scanner.text()
                };
                piece.add(sections.last().map_or("", String::as_str), tag.clone(), text)?;
            }
            "Array" if tag.get("Name") == Some(REGION_NAMES) && tag.get("format") == Some("ascii") && !tag.empty => {
                names = region_names(scanner.text())?;
            }
            "Array" if tag.get("Name") == Some("SPACE") => {
                let text = if tag.empty {
                    (scanner.at, &bytes[..0])
                } else {
                    scanner.text()
                };
                space = Some(Raw { tag: tag.clone(), text });
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
    let is_vtk = file.is_some();
    let (Some(file), Some((points, cells))) = (file, counts) else {
        let found = if is_vtk {
            "a VTKFile without a Piece"
        } else {
            "XML that is no VTKFile"
        };
        return Err(Fault::of_file(
            found,
            "a VTKFile with an UnstructuredGrid and one Piece",
        ));
    };
    let decode = |raw: &Raw, count| values(&raw.tag, raw.text, &file, appended.as_ref(), count);
    // Three letters and the zero that ends them.
    let letters = space.and_then(|raw: Raw| {
        let tag = raw.tag.with("type", "Int8");
        decode(&Raw { tag, ..raw }, Some(4)).ok()
    });
    let letters: Vec<u8> = letters.into_iter().flatten().map(|letter| letter as u8).collect();
    let grid = piece.grid(points, cells, is_poly, decode, wanted)?;
    Ok(Grid {
        is_ras: stated_axes(&[b"SPACE=", &letters[..]].concat()),
        region_names: names,
        ..grid
    })
}

/// Parses names of regions from strings such as `5 liver`, given as character codes that end in 0; strings without a
/// number are skipped.
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
    /// Corners of cells or polygons, and of strips.
    connectivity: [Option<Raw<'a>>; 2],
    offsets: [Option<Raw<'a>>; 2],
    types: Option<Raw<'a>>,
    /// Arrays of points and of cells, without their values.
    point_arrays: Vec<(Array, Raw<'a>)>,
    cell_arrays: Vec<(Array, Raw<'a>)>,
}

impl<'a> Piece<'a> {
    fn add(&mut self, section: &str, tag: Tag, text: (usize, &'a [u8])) -> Result<(), Fault> {
        let name = tag.get("Name").unwrap_or_default();
        let section_data = match (section, name) {
            ("Points", _) => &mut self.points,
            ("Cells" | "Polys", "connectivity") => &mut self.connectivity[0],
            ("Cells" | "Polys", "offsets") => &mut self.offsets[0],
            ("Strips", "connectivity") => &mut self.connectivity[1],
            ("Strips", "offsets") => &mut self.offsets[1],
            ("Cells", "types") => &mut self.types,
            ("PointData" | "CellData", name) if tag.get("type") != Some("String") => {
                let kind = tag.get("type").unwrap_or_default();
                let array = Array {
                    name: name.to_owned(),
                    components: tag
                        .get("NumberOfComponents")
                        .map_or(Ok(1), |_| tag.count("NumberOfComponents"))?,
                    is_whole: kind.starts_with("Int") || kind.starts_with("UInt"),
                    values: Vec::new(),
                };
                let arrays = if section == "PointData" {
                    &mut self.point_arrays
                } else {
                    &mut self.cell_arrays
                };
                arrays.push((array, Raw { tag, text }));
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
        counts: [usize; 2],
        is_poly: bool,
        decode: impl Fn(&Raw, Option<usize>) -> Result<Vec<f64>, Fault>,
        wanted: impl Fn(bool, &[Array]) -> Vec<usize>,
    ) -> Result<Grid, Fault> {
        let decode_or_none = |raw: Option<Raw>, count| raw.map_or(Ok(Vec::new()), |raw| decode(&raw, count));
        let all = |of_points, arrays: Vec<(Array, Raw)>, tuples: usize| -> Result<Vec<Array>, Fault> {
            let (mut arrays, raws): (Vec<Array>, Vec<Raw>) = arrays.into_iter().unzip();
            for index in wanted(of_points, &arrays) {
                let count = tuples.checked_mul(arrays[index].components);
                arrays[index].values = decode(&raws[index], count)?;
            }
            Ok(arrays)
        };
        let types = (!is_poly).then(|| decode_or_none(self.types, Some(counts[0])).map(integers));
        let mut grid = Grid::default();
        let parts = self.offsets.into_iter().zip(self.connectivity).zip(counts);
        for (((offsets, connectivity), count), (types, kind)) in
            parts.zip([(types.transpose()?, POLYGON), (None, STRIP)])
        {
            let mut offsets = integers(decode_or_none(offsets, Some(count))?);
            let corners = offsets.last().map_or(Some(0), |last| usize::try_from(*last).ok());
            offsets.insert(0, 0);
            let types = types.unwrap_or_else(|| vec![kind; offsets.len() - 1]);
            grid.append(&offsets, integers(decode_or_none(connectivity, corners)?), types);
        }
        Ok(Grid {
            points: decode_or_none(self.points, points.checked_mul(3))?,
            point_arrays: all(true, self.point_arrays, points)?,
            cell_arrays: all(false, self.cell_arrays, counts[0].saturating_add(counts[1]))?,
            ..grid
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

    /// The tag with another value of an attribute.
    fn with(mut self, key: &str, value: &str) -> Tag {
        self.attributes.retain(|(name, _)| name != key);
        self.attributes.push((key.to_owned(), value.to_owned()));
        self
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
