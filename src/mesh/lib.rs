//! Linear tetrahedral meshes: the reference state, its topology, and the location of points in it.
//!
//! | module | contents |
//! |---|---|
//! | [`lattice`] | meshes over a box |
//! | [`displacement`] | analytic displacement fields |
//! | [`mod@file`] | mesh files: VTK, legacy and XML, and Gmsh |
//! | [`generate`] | meshes made from labelled volumes |
//! | [`element`] | barycentric coordinates of one element |
//! | [`locator`] | point location in the reference or the deformed state |
//! | [`outline`] | triangles of a labelled plane |
//! | [`quality`] | element shapes, and whether a mesh is usable for computation |
//! | [`vector`] | arithmetic of vectors |
//! | [`Face`] | surface faces, with their outward normals |

use insonify_base::blame::Blame;

pub mod displacement;
pub mod element;
pub mod file;
pub mod generate;
mod grid;
pub mod lattice;
pub mod lists;
pub mod locator;
pub mod outline;
pub mod quality;
mod surface;
pub mod vector;

pub use displacement::Displacement;
pub use locator::{Locator, NO_ELEMENT};
pub use surface::Face;

use quality::UnusableMesh;

/// A tetrahedral mesh in its reference (undeformed) state, valid by construction.
///
/// Node order of an element: its signed volume is `(n1 - n0) . ((n2 - n0) x (n3 - n0)) / 6`. A mesh in which every
/// element with a volume is negative was written with the other convention and is reoriented on construction.
///
/// ```
/// use insonify_mesh::{Displacement, TetMesh};
///
/// let mesh = TetMesh::over_box([0.0; 3], [40.0; 3], 125)?;
/// assert_eq!((mesh.nodes().len(), mesh.bounds()), (125, [[0.0; 3], [40.0; 3]]));
///
/// // Pressed as by a probe; no element is inverted.
/// let press = Displacement::Indentation {
///     centre_mm: [20.0, 20.0, 0.0],
///     direction: [0.0, 0.0, 1.0],
///     depth_mm: 5.0,
///     radius_mm: 10.0,
/// };
/// let mut current = Vec::new();
/// press.displace(mesh.nodes(), &mut current);
/// assert!(mesh.volumes(&current).all(|mm3| mm3 > 0.0));
/// # Ok::<(), insonify_mesh::InvalidMesh>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct TetMesh {
    nodes: Vec<[f64; 3]>,
    elements: Vec<[u32; 4]>,
    regions: Vec<i32>,
    neighbours: Vec<[u32; 4]>,
}

/// Reason why a mesh cannot be constructed or updated.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum InvalidMesh {
    /// There is no element.
    #[error("the mesh has no tetrahedra")]
    Empty,
    /// Elements that no computation can use.
    #[error("{0}")]
    Unusable(Box<UnusableMesh>),
    /// More nodes or elements than 32-bit indices can address.
    #[error("{found} {what}; at most {limit} are supported")]
    TooMany {
        /// "nodes" or "tetrahedra".
        what: &'static str,
        /// Number of nodes or tetrahedra.
        found: usize,
        /// Maximum number that indices can address.
        limit: usize,
    },
    /// The region list does not match the elements.
    #[error("{found} region numbers for {expected} tetrahedra")]
    Regions {
        /// Number of regions.
        found: usize,
        /// Number of elements.
        expected: usize,
    },
    /// A coordinate is NaN or infinite.
    #[error("node {node} is at {position:?}; coordinates must be finite")]
    Coordinate {
        /// Index of the node, from 0.
        node: usize,
        /// Coordinates of the node, mm.
        position: [f64; 3],
    },
    /// An element refers to a node that does not exist.
    #[error("tetrahedron {element} names node {node}, but there are only {nodes} nodes (numbered from 0)")]
    Node {
        /// Index of the element, from 0.
        element: usize,
        /// The node that does not exist.
        node: u32,
        /// Number of nodes.
        nodes: usize,
    },
    /// An element contains the same node twice.
    #[error("tetrahedron {element} names node {node} twice: {corners:?}")]
    RepeatedNode {
        /// Index of the element, from 0.
        element: usize,
        /// The repeated node.
        node: u32,
        /// Nodes of all four corners.
        corners: [u32; 4],
    },
    /// More than two elements share a face.
    #[error("face {face:?} belongs to tetrahedra {elements:?}; a face can join at most two")]
    SharedFace {
        /// Node indices of the face, ascending.
        face: [u32; 3],
        /// The first three elements that share it.
        elements: [u32; 3],
    },
    /// More than two elements share a face because one of them is duplicated.
    #[error("tetrahedra {} and {} have the same corners {corners:?}", elements[0], elements[1])]
    Repeated {
        /// Node indices of the corners, ascending.
        corners: [u32; 4],
        /// The two elements.
        elements: [u32; 2],
    },
    /// A box to be meshed has no volume, or its corners are not finite.
    #[error("a mesh over a box needs a finite box with a volume; got the edges {edges_mm:?} mm")]
    Box {
        /// Edge vectors of the box, mm.
        edges_mm: [[f64; 3]; 3],
    },
    /// A lattice has an axis without cells.
    #[error("a lattice of {0:?} cells; every axis needs at least one")]
    Cells([usize; 3]),
    /// The number of node positions is not that of the mesh.
    #[error("{found} {state} node positions for a mesh of {expected} nodes")]
    Positions {
        /// `current` or `reference`.
        state: &'static str,
        /// Number of positions.
        found: usize,
        /// Number of nodes of the mesh.
        expected: usize,
    },
}

impl Blame for InvalidMesh {}

impl TetMesh {
    /// Builds a mesh from reference nodes (mm), elements (four node indices each) and one region number per element.
    ///
    /// Inverted and flat elements are accepted (see [`TetMesh::volumes`]): point location gives a defined result for
    /// each.
    ///
    /// # Errors
    /// [`InvalidMesh`], with the first offending node, element or face.
    pub fn new(nodes: Vec<[f64; 3]>, mut elements: Vec<[u32; 4]>, regions: Vec<i32>) -> Result<TetMesh, InvalidMesh> {
        validate(&nodes, &elements, &regions)?;
        let mut signs = elements
            .iter()
            .map(|corners| signed_volume(&nodes, corners))
            .filter(|volume| *volume != 0.0);
        if signs.next().is_some_and(|first| first < 0.0) && signs.all(|volume| volume < 0.0) {
            elements.iter_mut().for_each(|corners| corners.swap(2, 3));
        }
        let neighbours = neighbours(&elements)?;
        Ok(TetMesh {
            nodes,
            elements,
            regions,
            neighbours,
        })
    }

    /// Returns the reference positions of the nodes, mm.
    pub fn nodes(&self) -> &[[f64; 3]] {
        &self.nodes
    }

    /// Returns the node indices of the elements.
    pub fn elements(&self) -> &[[u32; 4]] {
        &self.elements
    }

    /// Returns the region number of each element (0 where the source had none).
    pub fn regions(&self) -> &[i32] {
        &self.regions
    }

    /// Returns, for each element and each of its corners, the element across the opposite face, or [`NO_ELEMENT`] at
    /// the surface.
    pub fn neighbours(&self) -> &[[u32; 4]] {
        &self.neighbours
    }

    /// Returns the signed volumes of the elements with the nodes at `nodes` (reference or current), mm^3. Negative
    /// means inverted.
    ///
    /// # Panics
    /// If `nodes` has fewer entries than the mesh has nodes.
    pub fn volumes<'a>(&'a self, nodes: &'a [[f64; 3]]) -> impl ExactSizeIterator<Item = f64> + 'a {
        self.elements.iter().map(move |corners| signed_volume(nodes, corners))
    }

    /// Returns the mesh translated by a vector, mm.
    pub fn moved(&self, by_mm: [f64; 3]) -> TetMesh {
        let node = |node: &[f64; 3]| [0, 1, 2].map(|axis| node[axis] + by_mm[axis]);
        TetMesh {
            nodes: self.nodes.iter().map(node).collect(),
            ..self.clone()
        }
    }

    /// Returns the corners of the axis-aligned box around the reference nodes, mm.
    pub fn bounds(&self) -> [[f64; 3]; 2] {
        let mut bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
        for node in &self.nodes {
            for axis in 0..3 {
                bounds[0][axis] = bounds[0][axis].min(node[axis]);
                bounds[1][axis] = bounds[1][axis].max(node[axis]);
            }
        }
        bounds
    }
}

fn validate(nodes: &[[f64; 3]], elements: &[[u32; 4]], regions: &[i32]) -> Result<(), InvalidMesh> {
    // The highest word is `NO_ELEMENT`, and the cell lists reserve one bit.
    let limit = (u32::MAX >> 1) as usize;
    for (what, found) in [("nodes", nodes.len()), ("tetrahedra", elements.len())] {
        if found > limit {
            return Err(InvalidMesh::TooMany { what, found, limit });
        }
    }
    if elements.is_empty() {
        return Err(InvalidMesh::Empty);
    }
    if regions.len() != elements.len() {
        return Err(InvalidMesh::Regions {
            found: regions.len(),
            expected: elements.len(),
        });
    }
    if let Some(node) = nodes.iter().position(|node| node.iter().any(|x| !x.is_finite())) {
        return Err(InvalidMesh::Coordinate {
            node,
            position: nodes[node],
        });
    }
    for (element, corners) in elements.iter().enumerate() {
        for (corner, &node) in corners.iter().enumerate() {
            if node as usize >= nodes.len() {
                return Err(InvalidMesh::Node {
                    element,
                    node,
                    nodes: nodes.len(),
                });
            }
            if corners[..corner].contains(&node) {
                return Err(InvalidMesh::RepeatedNode {
                    element,
                    node,
                    corners: *corners,
                });
            }
        }
    }
    Ok(())
}

/// Checks the numbers of positions, where there are any, for a mesh of `expected` nodes.
///
/// # Errors
/// [`InvalidMesh::Positions`] of the first that does not match.
pub fn check_positions(
    current: Option<&[[f64; 3]]>,
    reference: Option<&[[f64; 3]]>,
    expected: usize,
) -> Result<(), InvalidMesh> {
    for (state, positions) in [("current", current), ("reference", reference)] {
        if let Some(found) = positions.map(<[_]>::len).filter(|&found| found != expected) {
            return Err(InvalidMesh::Positions { state, found, expected });
        }
    }
    Ok(())
}

fn signed_volume(nodes: &[[f64; 3]], corners: &[u32; 4]) -> f64 {
    element::edges(&corners.map(|node| nodes[node as usize])).determinant() / 6.0
}

/// Local corners of the face opposite each corner.
const OPPOSITE: [[usize; 3]; 4] = [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]];

/// Returns, for each element and corner, the element across the opposite face, or [`NO_ELEMENT`].
fn neighbours(elements: &[[u32; 4]]) -> Result<Vec<[u32; 4]>, InvalidMesh> {
    let mut faces: Vec<([u32; 3], u32, u8)> = Vec::with_capacity(4 * elements.len());
    for (element, corners) in elements.iter().enumerate() {
        for (corner, opposite) in OPPOSITE.iter().enumerate() {
            let mut face = opposite.map(|corner| corners[corner]);
            face.sort_unstable();
            faces.push((face, element as u32, corner as u8));
        }
    }
    faces.sort_unstable();
    let mut neighbours = vec![[NO_ELEMENT; 4]; elements.len()];
    for shared in faces.chunk_by(|a, b| a.0 == b.0) {
        match shared {
            [_] => {}
            [a, b] => {
                neighbours[a.1 as usize][a.2 as usize] = b.1;
                neighbours[b.1 as usize][b.2 as usize] = a.1;
            }
            [a, b, c, ..] => {
                let sharing = [a.1, b.1, c.1];
                return Err(repeated(elements, sharing).unwrap_or(InvalidMesh::SharedFace {
                    face: a.0,
                    elements: sharing,
                }));
            }
            [] => {}
        }
    }
    Ok(neighbours)
}

/// Returns the error for two of these elements having the same corners, if any.
fn repeated(elements: &[[u32; 4]], among: [u32; 3]) -> Option<InvalidMesh> {
    let corners = among.map(|element| {
        let mut corners = elements[element as usize];
        corners.sort_unstable();
        corners
    });
    let (first, second) = [(0, 1), (0, 2), (1, 2)]
        .into_iter()
        .find(|(first, second)| corners[*first] == corners[*second])?;
    Some(InvalidMesh::Repeated {
        corners: corners[first],
        elements: [among[first], among[second]],
    })
}

#[cfg(test)]
mod tests;
