//! Mesh quality for computation: the shape of the elements, and their connectivity.

mod parts;
mod shape;

pub use parts::Part;
pub use shape::{Shape, jacobian_condition};

use std::collections::{BTreeMap, HashMap};
use std::fmt;

use serde::Serialize;

use super::TetMesh;
use super::element::{self, Kind};
use crate::InvalidMesh;

/// Limit of the [`jacobian_condition`] of a usable element, `1 / sqrt(f64::EPSILON)`: beyond it an element is so thin
/// that rounding its corners leaves less than half the digits of its height, and of its stiffness.
pub const CONDITION_LIMIT: f64 = 67_108_864.0;

/// Quality of a mesh with its nodes at given positions. Lists contain indices from 0, ascending.
#[derive(Clone, Debug, PartialEq)]
pub struct Quality {
    /// Shape of each element.
    pub shapes: Vec<Shape>,
    /// Signed volumes, mm^3, in orders of magnitude.
    pub volume_mm3: Spread,
    /// Least dihedral angle of each element, degrees (70.53 in a regular one).
    pub min_dihedral_deg: Spread,
    /// Greatest dihedral angle of each element, degrees (70.53 in a regular one).
    pub max_dihedral_deg: Spread,
    /// [`jacobian_condition`] of each element.
    pub condition: Spread,
    /// Elements of negative volume.
    pub inverted: Vec<u32>,
    /// Elements whose volume is within rounding of 0.
    pub flat: Vec<u32>,
    /// Elements with a corner that is NaN or infinite.
    pub not_finite: Vec<u32>,
    /// Elements with a volume whose condition exceeds [`CONDITION_LIMIT`].
    pub slivers: Vec<u32>,
    /// Duplicated elements: the earlier element with the same corners, and the duplicate.
    pub duplicates: Vec<[u32; 2]>,
    /// Nodes without an element.
    pub isolated_nodes: Vec<u32>,
    /// Coincident nodes (within 1e-9 of the mesh's diagonal): the earlier node, and the coincident one.
    pub coincident_nodes: Vec<[u32; 2]>,
    /// Parts connected through common nodes, by first element.
    pub parts: Vec<Part>,
    /// Number of parts connected through common faces. More than [`Quality::parts`] means that some are attached by a
    /// node or an edge, as by a hinge.
    pub face_parts: usize,
    /// Regions by number.
    pub regions: Vec<Region>,
}

/// The elements of a region.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Region {
    /// Region number.
    pub value: i32,
    /// Number of its elements.
    pub elements: usize,
    /// Sum of their signed volumes, ml.
    pub volume_ml: f64,
}

impl Quality {
    /// Measures a mesh with its nodes at `nodes` (reference or current positions, mm; one for each node of the mesh).
    ///
    /// # Panics
    /// If `nodes` has fewer entries than the mesh has nodes.
    pub fn measure(mesh: &TetMesh, nodes: &[[f64; 3]]) -> Quality {
        let nodes = &nodes[..mesh.nodes().len()];
        let mut shapes = Vec::with_capacity(mesh.elements().len());
        let mut of_kind: [Vec<u32>; 3] = Default::default();
        let [inverted, flat, not_finite] = &mut of_kind;
        let mut slivers = Vec::new();
        for (element, corners) in (0..).zip(mesh.elements()) {
            let corners = corners.map(|node| nodes[node as usize]);
            let shape = Shape::of(&corners);
            // Judged by the same numbers as where points are located, so that report and rendering agree.
            match element::prepare(corners, &corners).2.kind {
                Kind::Sound if shape.condition > CONDITION_LIMIT => slivers.push(element),
                Kind::Sound => {}
                Kind::Inverted => inverted.push(element),
                Kind::Flat => flat.push(element),
                Kind::NotFinite => not_finite.push(element),
            }
            shapes.push(shape);
        }
        let [inverted, flat, not_finite] = of_kind;
        let spread = |value: fn(&Shape) -> f64, edges: &[f64]| Spread::of(shapes.iter().map(value), edges);
        Quality {
            volume_mm3: spread(|shape| shape.volume_mm3, &DECADES),
            min_dihedral_deg: spread(|shape| shape.min_dihedral_deg, &ANGLES),
            max_dihedral_deg: spread(|shape| shape.max_dihedral_deg, &ANGLES),
            condition: spread(|shape| shape.condition, &CONDITIONS),
            inverted,
            flat,
            not_finite,
            slivers,
            duplicates: parts::duplicates(mesh.elements()),
            isolated_nodes: isolated(mesh),
            coincident_nodes: coincident(nodes),
            parts: parts::by_nodes(mesh, &shapes),
            face_parts: parts::by_faces(mesh),
            regions: regions(mesh, &shapes),
            shapes,
        }
    }

    /// Returns the volume of all elements, ml.
    pub fn volume_ml(&self) -> f64 {
        self.regions.iter().map(|region| region.volume_ml).sum()
    }

    /// Checks that the mesh is usable for computation: no element is inverted, flat, a sliver, not finite or
    /// duplicated.
    ///
    /// # Errors
    /// [`UnusableMesh`], which names the elements.
    pub fn usable(&self) -> Result<(), InvalidMesh> {
        UnusableMesh::of(self).map_or(Ok(()), |unusable| Err(InvalidMesh::Unusable(Box::new(unusable))))
    }
}

fn regions(mesh: &TetMesh, shapes: &[Shape]) -> Vec<Region> {
    let mut regions: BTreeMap<i32, Region> = BTreeMap::new();
    for (&value, shape) in mesh.regions().iter().zip(shapes) {
        let region = regions.entry(value).or_insert(Region {
            value,
            elements: 0,
            volume_ml: 0.0,
        });
        region.elements += 1;
        region.volume_ml += shape.volume_mm3 * parts::ML_PER_MM3;
    }
    regions.into_values().collect()
}

/// Distance below which nodes coincide, as a share of the diagonal of their box: far above the rounding of coordinates,
/// even of those printed with ten digits, and far below any usable element.
const COINCIDENT: f64 = 1e-9;

/// Returns the nodes without an element.
fn isolated(mesh: &TetMesh) -> Vec<u32> {
    let mut used = vec![false; mesh.nodes().len()];
    for node in mesh.elements().as_flattened() {
        used[*node as usize] = true;
    }
    (0..)
        .zip(used)
        .filter(|(_, used)| !used)
        .map(|(node, _)| node)
        .collect()
}

/// Returns coincident nodes, each preceded by the earlier one. Nodes that are not finite are skipped.
fn coincident(nodes: &[[f64; 3]]) -> Vec<[u32; 2]> {
    let finite = |node: &[f64; 3]| node.iter().all(|x| x.is_finite());
    let mut bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
    for node in nodes.iter().filter(|node| finite(node)) {
        for axis in 0..3 {
            bounds[0][axis] = bounds[0][axis].min(node[axis]);
            bounds[1][axis] = bounds[1][axis].max(node[axis]);
        }
    }
    let diagonal = distance(bounds[0], bounds[1]);
    if !(diagonal > 0.0 && diagonal.is_finite()) {
        // All in one point, or so far apart that their distances overflow.
        let all: Vec<u32> = (0..)
            .zip(nodes)
            .filter(|(_, node)| finite(node))
            .map(|(n, _)| n)
            .collect();
        return match (diagonal == 0.0, all.split_first()) {
            (true, Some((first, rest))) => rest.iter().map(|node| [*first, *node]).collect(),
            _ => Vec::new(),
        };
    }
    let reach = COINCIDENT * diagonal;
    // In cells twice the reach wide, the neighbours of a point lie in its cell or in the adjacent ones on the nearer
    // sides.
    let side = 2.0 * reach;
    let mut cells: HashMap<[i64; 3], Vec<u32>> = HashMap::new();
    let mut pairs = Vec::new();
    for (index, node) in (0..).zip(nodes).filter(|(_, node)| finite(node)) {
        let scaled: [f64; 3] = std::array::from_fn(|axis| (node[axis] - bounds[0][axis]) / side);
        let cell = scaled.map(|x| x.floor() as i64);
        let nearer: [i64; 3] = std::array::from_fn(|axis| if scaled[axis].fract() < 0.5 { -1 } else { 1 });
        let earlier = (0..8)
            .filter_map(|corner| {
                let near = std::array::from_fn(|axis| cell[axis] + (corner >> axis & 1) * nearer[axis]);
                cells.get(&near)
            })
            .flatten()
            .filter(|other| distance(nodes[**other as usize], *node) <= reach)
            .min();
        match earlier {
            Some(earlier) => pairs.push([*earlier, index]),
            None => cells.entry(cell).or_default().push(index),
        }
    }
    pairs
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1]).hypot(a[2] - b[2])
}

/// Bin edges in steps of ten degrees.
const ANGLES: [f64; 19] = [
    0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0, 90.0, 100.0, 110.0, 120.0, 130.0, 140.0, 150.0, 160.0, 170.0,
    180.0,
];
/// Bin edges from regular to hardly usable.
const CONDITIONS: [f64; 9] = [1.0, 1.25, 1.5, 2.0, 3.0, 5.0, 10.0, 100.0, f64::INFINITY];
/// Bin edges in orders of magnitude; negative values lie in the first bin.
const DECADES: [f64; 9] = [
    f64::NEG_INFINITY,
    0.0,
    1e-3,
    1e-2,
    1e-1,
    1.0,
    10.0,
    100.0,
    f64::INFINITY,
];

/// Minimum, median, maximum and histogram of a set of values. NaN are excluded.
#[derive(Clone, Debug, PartialEq)]
pub struct Spread {
    /// Minimum; NaN where there is no value.
    pub min: f64,
    /// Median: the middle value, or the mean of the two in the middle; NaN where there is none.
    pub median: f64,
    /// Maximum; NaN where there is no value.
    pub max: f64,
    /// Number of values from `low` to below `high`; the last bin includes `high`.
    pub histogram: Vec<Bin>,
}

/// A range of values.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Bin {
    /// Lower edge.
    pub low: f64,
    /// Upper edge, which is the lower edge of the next bin.
    pub high: f64,
    /// Number of values in the bin.
    #[serde(rename = "elements")]
    pub count: usize,
}

impl Spread {
    /// Computes the distribution of these values over bins with ascending edges; values beyond the edges count in the
    /// outermost bins.
    fn of(values: impl Iterator<Item = f64>, edges: &[f64]) -> Spread {
        let mut values: Vec<f64> = values.filter(|value| !value.is_nan()).collect();
        values.sort_by(f64::total_cmp);
        let (first, last) = (values.first().copied(), values.last().copied());
        let middle = [values.len().saturating_sub(1) / 2, values.len() / 2];
        let [low, high] = middle.map(|index| values.get(index).copied().unwrap_or(f64::NAN));
        // Equal infinities have no mean.
        let median = if low == high { low } else { low + (high - low) / 2.0 };
        let below = |edge: f64| values.partition_point(|value| *value < edge);
        let bins = edges.len().saturating_sub(1);
        let histogram = edges.windows(2).enumerate().map(|(bin, edge)| {
            let start = if bin == 0 { 0 } else { below(edge[0]) };
            let end = if bin + 1 == bins { values.len() } else { below(edge[1]) };
            Bin {
                low: edge[0],
                high: edge[1],
                count: end - start,
            }
        });
        Spread {
            min: first.unwrap_or(f64::NAN),
            median,
            max: last.unwrap_or(f64::NAN),
            histogram: histogram.collect(),
        }
    }
}

/// Elements that make a mesh unusable for computation.
#[derive(Clone, Debug, PartialEq)]
pub struct UnusableMesh {
    /// Elements of negative volume.
    pub inverted: Vec<u32>,
    /// Elements whose volume is within rounding of 0.
    pub flat: Vec<u32>,
    /// Elements with a corner that is NaN or infinite.
    pub not_finite: Vec<u32>,
    /// Elements whose condition exceeds [`CONDITION_LIMIT`].
    pub slivers: Vec<u32>,
    /// Elements with the corners of an earlier one.
    pub duplicates: Vec<u32>,
}

impl UnusableMesh {
    fn of(quality: &Quality) -> Option<UnusableMesh> {
        let unusable = UnusableMesh {
            inverted: quality.inverted.clone(),
            flat: quality.flat.clone(),
            not_finite: quality.not_finite.clone(),
            slivers: quality.slivers.clone(),
            duplicates: quality.duplicates.iter().map(|[_, element]| *element).collect(),
        };
        let faults = unusable.faults();
        faults
            .iter()
            .any(|(elements, _)| !elements.is_empty())
            .then_some(unusable)
    }

    fn faults(&self) -> [(&[u32], &'static str); 5] {
        [
            (&self.inverted, "inverted"),
            (&self.flat, "flat"),
            (&self.not_finite, "not finite at a corner"),
            (&self.slivers, "too thin"),
            (&self.duplicates, "there a second time"),
        ]
    }
}

impl fmt::Display for UnusableMesh {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const NAMED: usize = 10;
        write!(f, "the mesh cannot be calculated on:")?;
        let faults = self.faults().into_iter().filter(|(elements, _)| !elements.is_empty());
        for (number, (elements, what)) in faults.enumerate() {
            let named: Vec<String> = elements.iter().take(NAMED).map(u32::to_string).collect();
            let (noun, verb) = if elements.len() == 1 {
                ("tetrahedron", "is")
            } else {
                ("tetrahedra", "are")
            };
            write!(f, "{} {noun} {}", if number == 0 { "" } else { ";" }, named.join(", "))?;
            if elements.len() > NAMED {
                write!(f, " and {} more", elements.len() - NAMED)?;
            }
            write!(f, " {verb} {what}")?;
        }
        if !self.slivers.is_empty() {
            write!(f, " (a Jacobian condition beyond {CONDITION_LIMIT:.1e})")?;
        }
        write!(f, "; tetrahedra are numbered from 0")
    }
}

#[cfg(test)]
mod tests;
