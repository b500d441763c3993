//! Unstructured grid of a VTK file, and the tetrahedral mesh in it.

use std::collections::{BTreeMap, BTreeSet};

use super::{Fault, Parts, ReadOptions, SurfaceFile};
use crate::file::DISPLACEMENT;
use insonify_base::text::some_of;

/// VTK cell type of the linear tetrahedron.
pub(super) const TETRA: i64 = 10;
/// VTK cell types of the tetrahedra of higher order, whose first points are their corners.
const CURVED: [i64; 4] = [24, 64, 71, 78];
/// VTK cell types of the triangle strip and of the polygon.
pub(super) const STRIP: i64 = 6;
pub(super) const POLYGON: i64 = 7;
/// VTK cell types of triangles and of quadrangles of any order, whose first points are their corners.
const TRIANGLES: [i64; 5] = [5, 22, 34, 69, 76];
const QUADRANGLES: [i64; 7] = [9, 23, 28, 30, 36, 70, 77];
/// VTK cell type of a rectangle whose corners come row by row.
const PIXEL: i64 = 8;
/// VTK cell types of dimension 0 to 2 of any order: they have no volume.
const FLAT_TYPES: [i64; 24] = [
    0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 21, 22, 23, 28, 30, 34, 35, 36, 68, 69, 70, 75, 76, 77,
];
/// Names of VTK cell types with a volume.
const NAMES: [(i64, &str); 19] = [
    (11, "voxel"),
    (12, "hexahedron"),
    (13, "wedge"),
    (14, "pyramid"),
    (15, "pentagonal prism"),
    (16, "hexagonal prism"),
    (25, "second-order hexahedron"),
    (26, "second-order wedge"),
    (27, "second-order pyramid"),
    (29, "second-order hexahedron"),
    (31, "second-order wedge"),
    (32, "second-order wedge"),
    (33, "second-order hexahedron"),
    (37, "second-order pyramid"),
    (41, "convex point set"),
    (42, "polyhedron"),
    (72, "hexahedron of higher order"),
    (73, "wedge of higher order"),
    (74, "pyramid of higher order"),
];
/// Largest number of regions of an array that nobody named: more are numbers of cells.
const MAX_REGIONS: usize = 256;
/// Names of cell arrays that are accepted as region numbers, in this order.
const REGION_NAMES: [&str; 6] = [
    "region",
    "label",
    "material",
    "medit:ref",
    "gmsh:physical",
    "CellEntityIds",
];

/// An attribute array.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Array {
    pub name: String,
    pub components: usize,
    /// Whether its type is one of whole numbers.
    pub is_whole: bool,
    /// Values; empty if the array is not wanted.
    pub values: Vec<f64>,
}

impl Array {
    /// Whether its type is that of labels: one whole number a point or cell. VTK's own are ghosts and original numbers.
    fn is_of_labels(&self) -> bool {
        self.is_whole && self.components == 1 && !self.name.starts_with("vtk")
    }
}

/// An unstructured grid, not yet checked.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Grid {
    pub points: Vec<f64>,
    /// One more than there are cells, from 0.
    pub offsets: Vec<i64>,
    pub connectivity: Vec<i64>,
    pub types: Vec<i64>,
    pub point_arrays: Vec<Array>,
    pub cell_arrays: Vec<Array>,
    pub region_names: BTreeMap<i32, String>,
    /// Axes stated by the title: RAS (true) or LPS (false).
    pub is_ras: Option<bool>,
}

/// Indices of the arrays of points or cells of which [`Grid::select`] uses the values: the first of the name; where
/// nobody names the regions, all that may be them.
pub(super) fn wanted(of_points: bool, arrays: &[Array], options: &ReadOptions) -> Vec<usize> {
    let named = |name: &str| arrays.iter().position(|array| array.name == name);
    let first = match (of_points, options.region) {
        (true, _) => named(options.displacement.unwrap_or(DISPLACEMENT)),
        (false, Some(name)) => named(name),
        (false, None) => REGION_NAMES.iter().find_map(|name| named(name)),
    };
    match first {
        None if !of_points && options.region.is_none() => (0..arrays.len())
            .filter(|index| arrays[*index].is_of_labels())
            .collect(),
        first => first.into_iter().collect(),
    }
}

impl Grid {
    /// Adds cells of one type, or of the given ones.
    pub(super) fn append(&mut self, offsets: &[i64], connectivity: Vec<i64>, types: Vec<i64>) {
        let start = self.connectivity.len() as i64;
        if self.offsets.is_empty() {
            self.offsets.push(0);
        }
        self.offsets
            .extend(offsets.iter().skip(1).map(|offset| start.saturating_add(*offset)));
        self.connectivity.extend(connectivity);
        self.types.extend(types);
    }

    /// Triangles of the surfaces, or of the outside of the tetrahedra where there are any.
    pub(super) fn triangles(&self) -> Result<SurfaceFile, Fault> {
        let points = self.points.as_chunks::<3>().0.to_vec();
        let mut surface = SurfaceFile {
            is_ras: self.is_ras,
            ..SurfaceFile::default()
        };
        if self.offsets.len() != self.types.len() + 1 && !self.types.is_empty() {
            return Err(Fault::of_file(
                "cells and cell types in different numbers",
                "as many types as cells",
            ));
        }
        // Faces by their sorted corners: those of two tetrahedra lie within.
        let mut faces: BTreeMap<[u32; 3], ([u32; 3], usize)> = BTreeMap::new();
        for (cell, &kind) in self.types.iter().enumerate() {
            let corners = self.cell(cell).unwrap_or_default();
            let corners: Option<Vec<u32>> = corners.iter().map(|corner| u32::try_from(*corner).ok()).collect();
            let corners = corners.filter(|corners| !corners.is_empty()).ok_or_else(|| {
                Fault::of_file(
                    format!("cell {cell} without corners"),
                    "points of the file for each cell",
                )
            })?;
            let first = |count: usize| &corners[..count.min(corners.len())];
            match kind {
                POLYGON => surface.push_polygon(&corners),
                STRIP => {
                    for (start, next) in corners.windows(3).enumerate() {
                        let [a, b, c] = [next[0], next[1], next[2]];
                        surface
                            .triangles
                            .push(if start % 2 == 0 { [a, b, c] } else { [b, a, c] });
                    }
                }
                PIXEL if corners.len() == 4 => {
                    surface.push_polygon(&[corners[0], corners[1], corners[3], corners[2]]);
                }
                _ if TRIANGLES.contains(&kind) => surface.push_polygon(first(3)),
                _ if QUADRANGLES.contains(&kind) => surface.push_polygon(first(4)),
                _ if (kind == TETRA || CURVED.contains(&kind)) && corners.len() >= 4 => {
                    let [a, b, c, d] = [corners[0], corners[1], corners[2], corners[3]];
                    for face in [[a, c, b], [a, b, d], [b, c, d], [a, d, c]] {
                        let mut key = face;
                        key.sort_unstable();
                        faces.entry(key).or_insert((face, 0)).1 += 1;
                    }
                }
                _ if FLAT_TYPES.contains(&kind) => {}
                _ => {
                    let found = format!("cell {cell} is of VTK type {kind}");
                    return Err(Fault::of_file(found, "triangles, polygons or tetrahedra"));
                }
            }
        }
        if !faces.is_empty() {
            // Beside tetrahedra, surfaces are those of their regions.
            let outside = faces.into_values().filter(|(_, count)| *count == 1);
            surface.triangles = outside.map(|(face, _)| face).collect();
            surface.is_outside = true;
        }
        surface.points = points;
        Ok(surface)
    }

    /// Connectivity of a cell.
    fn cell(&self, cell: usize) -> Option<&[i64]> {
        let [start, end] = [cell, cell + 1].map(|cell| self.offsets.get(cell).copied());
        let (start, end) = (usize::try_from(start?).ok()?, usize::try_from(end?).ok()?);
        self.connectivity.get(start..end)
    }

    pub(super) fn select(&self, options: &ReadOptions) -> Result<Parts, Fault> {
        let nodes = self.points.as_chunks::<3>().0.to_vec();
        let cells = self.types.len();
        if self.offsets.len() != cells + 1 {
            return Err(Fault::of_file(
                format!("{} cells and {cells} cell types", self.offsets.len().saturating_sub(1)),
                "as many types as cells",
            ));
        }
        let mut warnings = Vec::new();
        let region = self.region_array(options, &mut warnings)?;
        let mut curved = 0;
        let mut elements = Vec::new();
        let mut regions = Vec::new();
        for (cell, &kind) in self.types.iter().enumerate() {
            // Meshers write faces, edges and points of the boundary beside the volume.
            if FLAT_TYPES.contains(&kind) {
                continue;
            }
            let is_curved = CURVED.contains(&kind);
            if kind != TETRA && !is_curved {
                let name = NAMES.iter().find(|(known, _)| *known == kind);
                let name = name.map_or_else(String::new, |(_, name)| format!("a {name}, "));
                return Err(Fault::of_file(
                    format!("cell {cell} is {name}VTK type {kind}"),
                    "tetrahedra as the only cells with a volume (ParaView's filter Tetrahedralize cuts others)",
                ));
            }
            curved += usize::from(is_curved);
            elements.push(self.corners(cell, nodes.len(), is_curved)?);
            regions.push(region.map_or(Ok(0), |array| region_number(array, cell))?);
        }
        let names = |arrays: &[Array], is_shown: fn(&Array) -> bool| {
            let shown = arrays.iter().filter(|array| is_shown(array));
            let shown: Vec<String> = shown.map(|array| format!("`{}`", array.name)).collect();
            (!shown.is_empty()).then(|| some_of(&shown))
        };
        let of_cells = names(&self.cell_arrays, |array| array.components == 1).map(|names| {
            format!("cell arrays: {names}; all regions are 0: choose with `region_array` or --region-array")
        });
        let of_points = names(&self.point_arrays, Array::is_of_labels).map(|names| {
            format!(
                "point arrays of whole numbers: {names}; all regions are 0: ParaView's filter Point Data to Cell Data (with \
                 Categorical Data) makes cell arrays of them"
            )
        });
        let hints: Vec<String> = of_cells.into_iter().chain(of_points).collect();
        let region_hint = (region.is_none() && !hints.is_empty()).then(|| hints.join("; "));
        let displacements = self.displacements(options, nodes.len())?;
        let skipped_cells = cells - elements.len();
        Ok(Parts {
            nodes,
            elements,
            regions,
            displacements,
            skipped_cells,
            region_names: self.region_names.clone(),
            region_hint,
            is_ras: self.is_ras,
            curved,
            warnings,
        })
    }

    fn corners(&self, cell: usize, nodes: usize, is_curved: bool) -> Result<[u32; 4], Fault> {
        let (start, end) = (self.offsets[cell], self.offsets[cell + 1]);
        let corners = self.cell(cell).filter(|corners| corners.len() == 4 || is_curved);
        let Some(&[a, b, c, d, ..]) = corners else {
            let found = format!("tetrahedron in cell {cell} with connectivity {start}..{end}");
            return Err(Fault::of_file(
                found,
                format!("four entries within 0..{}", self.connectivity.len()),
            ));
        };
        let mut named = [0; 4];
        for (name, corner) in named.iter_mut().zip([a, b, c, d]) {
            *name = u32::try_from(corner)
                .ok()
                .filter(|n| (*n as usize) < nodes)
                .ok_or_else(|| {
                    let found = format!("tetrahedron in cell {cell} names point {corner}");
                    Fault::of_file(found, format!("a point from 0 to {}", nodes.saturating_sub(1)))
                })?;
        }
        Ok(named)
    }

    fn region_array(&self, options: &ReadOptions, warnings: &mut Vec<String>) -> Result<Option<&Array>, Fault> {
        let cells = self.types.len();
        let is_guess = |array: &Array| options.region.is_none() && !REGION_NAMES.contains(&array.name.as_str());
        // A guess that does not serve is left out: it never refuses a file.
        let mut arrays = wanted(false, &self.cell_arrays, options)
            .into_iter()
            .map(|index| &self.cell_arrays[index])
            .filter(|array| !is_guess(array) || may_be_regions(array, cells));
        let array = arrays.next().filter(|_| arrays.next().is_none());
        if let (Some(name), None) = (options.region, array) {
            return Err(missing("cell", name, &self.cell_arrays));
        }
        if let Some(array) = array.filter(|array| is_guess(array)) {
            warnings.push(format!(
                "the regions are the cell array `{}`, the only one of a few whole numbers; `region_array` or --region-array chooses \
                 another",
                array.name
            ));
        }
        match array {
            Some(array) if array.components != 1 || array.values.len() != cells => Err(Fault::of_file(
                shape("cell", array),
                format!("one component for each of {cells} cells"),
            )),
            array => Ok(array),
        }
    }

    fn displacements(&self, options: &ReadOptions, nodes: usize) -> Result<Option<Vec<[f64; 3]>>, Fault> {
        let array = match options.displacement {
            Some(name) => {
                Some(named(&self.point_arrays, name).ok_or_else(|| missing("point", name, &self.point_arrays))?)
            }
            None => named(&self.point_arrays, DISPLACEMENT),
        };
        match array {
            Some(array) if array.components != 3 || array.values.len() != 3 * nodes => Err(Fault::of_file(
                shape("point", array),
                format!("three components for each of {nodes} points"),
            )),
            array => Ok(array.map(|array| array.values.as_chunks::<3>().0.to_vec())),
        }
    }
}

/// Converts counts and indices that were read as floats into integers.
pub(super) fn integers(values: Vec<f64>) -> Vec<i64> {
    values.into_iter().map(|value| value as i64).collect()
}

fn named<'a>(arrays: &'a [Array], name: &str) -> Option<&'a Array> {
    arrays.iter().find(|array| array.name == name)
}

fn missing(owner: &str, name: &str, arrays: &[Array]) -> Fault {
    let names: Vec<String> = arrays.iter().map(|array| format!("`{}`", array.name)).collect();
    let found = if names.is_empty() {
        format!("no {owner} arrays")
    } else {
        format!("{owner} arrays {}", names.join(", "))
    };
    Fault::of_file(found, format!("a {owner} array `{name}`"))
}

fn shape(owner: &str, array: &Array) -> String {
    format!(
        "{owner} array `{}` with {} components and {} values",
        array.name,
        array.components,
        array.values.len()
    )
}

/// Whether an array that nobody named can be the regions: a number of 32 bits for each cell, most of them shared, as
/// numbers of elements are not.
fn may_be_regions(array: &Array, cells: usize) -> bool {
    let is_number = |value: &f64| value.fract() == 0.0 && (f64::from(i32::MIN)..=f64::from(i32::MAX)).contains(value);
    let numbers: BTreeSet<i64> = array.values.iter().map(|value| *value as i64).collect();
    array.values.len() == cells && array.values.iter().all(is_number) && numbers.len() <= MAX_REGIONS.min(cells / 2 + 1)
}

fn region_number(array: &Array, cell: usize) -> Result<i32, Fault> {
    let value = array.values[cell];
    if value.fract() != 0.0 || value < f64::from(i32::MIN) || value > f64::from(i32::MAX) {
        let found = format!("region {value} of cell {cell} in `{}`", array.name);
        return Err(Fault::of_file(found, "a whole number of 32 bits"));
    }
    Ok(value as i32)
}
