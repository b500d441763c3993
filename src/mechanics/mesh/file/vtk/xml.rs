//! The XML format of VTK for unstructured grids (`.vtu`).

mod data;
mod packed;
mod tags;

use super::grid::{Array, Grid, integers};
use super::{Fault, quote};
use data::{Appended, Encoding, values};
use tags::{Scanner, Tag};

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

#[cfg(test)]
mod tests;
