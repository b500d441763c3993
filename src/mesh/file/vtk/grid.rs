//! Unstructured grid of a VTK file, and the tetrahedral mesh in it.

use std::collections::BTreeMap;

use super::{Fault, Parts, ReadOptions};
use crate::file::DISPLACEMENT;

/// VTK cell type of the linear tetrahedron.
pub(super) const TETRA: i64 = 10;
/// VTK cell types of dimension 0 to 2, linear and quadratic: they have no volume.
const FLAT_TYPES: [i64; 17] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 21, 22, 23, 28, 30, 34, 35];
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
    /// Values; empty if the array is not wanted.
    pub values: Vec<f64>,
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
}

/// Returns whether [`Grid::select`] uses the values of an array of points or cells.
pub(super) fn is_wanted(of_points: bool, name: &str, options: &ReadOptions) -> bool {
    if of_points {
        name == options.displacement.unwrap_or(DISPLACEMENT)
    } else {
        options
            .region
            .map_or(REGION_NAMES.contains(&name), |region| region == name)
    }
}

impl Grid {
    pub(super) fn select(&self, options: &ReadOptions) -> Result<Parts, Fault> {
        let nodes = self.points.as_chunks::<3>().0.to_vec();
        let cells = self.types.len();
        if self.offsets.len() != cells + 1 {
            return Err(Fault::of_file(
                format!("{} cells and {cells} cell types", self.offsets.len().saturating_sub(1)),
                "as many types as cells",
            ));
        }
        let region = self.region_array(options)?;
        let mut elements = Vec::new();
        let mut regions = Vec::new();
        for (cell, &kind) in self.types.iter().enumerate() {
            // Meshers write faces, edges and points of the boundary beside the volume.
            if FLAT_TYPES.contains(&kind) {
                continue;
            }
            if kind != TETRA {
                return Err(Fault::of_file(
                    format!("cell {cell} is of VTK type {kind}"),
                    "linear tetrahedra (type 10) only",
                ));
            }
            elements.push(self.corners(cell, nodes.len())?);
            regions.push(region.map_or(Ok(0), |array| region_number(array, cell))?);
        }
        let displacements = self.displacements(options, nodes.len())?;
        let skipped_cells = cells - elements.len();
        Ok(Parts {
            nodes,
            elements,
            regions,
            displacements,
            skipped_cells,
            region_names: self.region_names.clone(),
            warnings: Vec::new(),
        })
    }

    fn corners(&self, cell: usize, nodes: usize) -> Result<[u32; 4], Fault> {
        let (start, end) = (self.offsets[cell], self.offsets[cell + 1]);
        let corners = usize::try_from(start).ok().zip(usize::try_from(end).ok());
        let corners = corners.and_then(|(start, end)| self.connectivity.get(start..end));
        let Some(&[a, b, c, d]) = corners else {
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

    fn region_array(&self, options: &ReadOptions) -> Result<Option<&Array>, Fault> {
        let cells = self.types.len();
        let array = match options.region {
            Some(name) => Some(named(&self.cell_arrays, name).ok_or_else(|| missing("cell", name, &self.cell_arrays))?),
            None => REGION_NAMES.iter().find_map(|name| named(&self.cell_arrays, name)),
        };
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

fn region_number(array: &Array, cell: usize) -> Result<i32, Fault> {
    let value = array.values[cell];
    if value.fract() != 0.0 || value < f64::from(i32::MIN) || value > f64::from(i32::MAX) {
        let found = format!("region {value} of cell {cell} in `{}`", array.name);
        return Err(Fault::of_file(found, "a whole number of 32 bits"));
    }
    Ok(value as i32)
}
