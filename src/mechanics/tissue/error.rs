//! Errors of linear tissue: its assembly, supports, factor, compliance and static problems.

use std::collections::BTreeMap;

use super::element::DegenerateElement;
use super::material::Material;
use super::rigid::{self, FreePart};
use insonify_base::blame::Blame;

/// Error of linear tissue.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LinearError {
    /// A list does not match the mesh.
    #[error("{found} {what}; expected {expected}, as the mesh has")]
    Count {
        /// What is counted, in the plural.
        what: &'static str,
        /// Number found.
        found: usize,
        /// Number that the mesh requires.
        expected: usize,
    },
    /// The first tetrahedron without a usable volume, and at most ten more of them.
    #[error("tetrahedron {element} (nodes {corners:?}): {cause}{}", also_unusable(.others))]
    Element {
        /// Index of the tetrahedron, from 0.
        element: usize,
        /// Its nodes, from 0.
        corners: [u32; 4],
        /// Why its volume is unusable.
        cause: DegenerateElement,
        /// Indices of up to ten further tetrahedra without a usable volume, ascending.
        others: Vec<usize>,
    },
    /// The matrix has more entries than 32-bit indices can address.
    #[error("the stiffness matrix has more than {limit} entries")]
    TooLarge {
        /// Largest number of entries.
        limit: usize,
    },
    /// Two materials for one region.
    #[error("region {region} has two materials: {} kPa, {} and {} kPa, {}", .materials[0].young_kpa(), .materials[0].poisson(),
        .materials[1].young_kpa(), .materials[1].poisson())]
    TwoMaterials {
        /// Number of the region.
        region: i32,
        /// Its two materials, in the order given.
        materials: [Material; 2],
    },
    /// Regions without a material, ascending, with the number of tetrahedra in each.
    #[error("no material for {}; give each its own, or one without a region for all others", regions_of(.regions))]
    NoMaterial {
        /// Each region with the number of its tetrahedra, ascending.
        regions: Vec<(i32, usize)>,
    },
    /// Free nodes of no element, ascending.
    #[error("{} to no tetrahedron: {}; leave them out or fix them along x, y and z",
        if .nodes.len() == 1 { "a free node that belongs" } else { "free nodes that belong" }, rigid::numbers(.nodes))]
    LooseNodes {
        /// Their numbers, from 0.
        nodes: Vec<u32>,
    },
    /// Parts that can move rigidly, in the order of their lowest elements, and names of regions, where given.
    #[error("{}; fix nodes of {}", rigid::sentences(.parts, .names), if .parts.len() == 1 { "it" } else { "each" })]
    FreeParts {
        /// The parts, each with its free motions.
        parts: Vec<FreePart>,
        /// Names of regions by number; empty if none are given.
        names: BTreeMap<i32, String>,
    },
    /// A pivot of the Cholesky factor is zero, negative or NaN.
    #[error(
        "the stiffness matrix is not positive definite to working precision: no usable pivot at node {node}, axis {}; look for \
         parts that can move freely, for nearly flat tetrahedra and for extreme contrasts of stiffness near that node",
        ["x", "y", "z"][*.axis as usize % 3]
    )]
    NotPositiveDefinite {
        /// Node of the pivot, from 0.
        node: u32,
        /// Axis of the pivot, 0 to 2.
        axis: u8,
    },
    /// Memory does not suffice for the factor, or 32-bit indices do not; with the bytes required, where known.
    #[error("the Cholesky factor of {size} degrees of freedom does not fit into memory{}", needed(.bytes))]
    FactorMemory {
        /// Number of degrees of freedom.
        size: usize,
        /// Bytes needed, where known.
        bytes: Option<usize>,
    },
    /// The matrix to refactor has another sparsity pattern.
    #[error(
        "a matrix of {found} degrees of freedom and {found_entries} entries has another pattern than the one factored \
        before ({expected} and {expected_entries})"
    )]
    Pattern {
        /// Degrees of freedom of the new matrix.
        found: usize,
        /// Stored entries of the new matrix, in its lower triangle.
        found_entries: usize,
        /// Degrees of freedom of the matrix factored before.
        expected: usize,
        /// Stored entries of that matrix, in its lower triangle.
        expected_entries: usize,
    },
    /// The dense inverse exceeds the available memory, bytes.
    #[error(
        "the dense inverse of {size} degrees of freedom needs {:.1} GiB, and {:.1} GiB of memory are available; use columns on \
         demand, which need none of it, single precision, or a coarser mesh",
        gib(*needed), gib(*available)
    )]
    InverseMemory {
        /// Number of degrees of freedom.
        size: usize,
        /// Bytes needed.
        needed: usize,
        /// Bytes available.
        available: usize,
    },
    /// A degree of freedom that does not exist.
    #[error("degree of freedom {dof}, but there are {size}: valid are 0 to {size} - 1")]
    OutOfRange {
        /// Degree of freedom named.
        dof: usize,
        /// Number of degrees of freedom.
        size: usize,
    },
    /// A degree of freedom that is named more than once.
    #[error("degree of freedom {dof} is named twice; name each once")]
    Repeated {
        /// Degree of freedom, from 0.
        dof: usize,
    },
    /// An operand has the wrong length.
    #[error("{what}: {found} given, {expected} expected")]
    Shape {
        /// What is counted, such as the rows of a block.
        what: &'static str,
        /// Number found.
        found: usize,
        /// Number expected.
        expected: usize,
    },
    /// A column of the inverse that is not finite.
    #[error("column {dof} of K^-1 holds a value that is not finite: the stiffness is singular to working precision")]
    Column {
        /// Column, from 0.
        dof: usize,
    },
    /// A fix or a load (`what`) names a node that the mesh does not have.
    #[error("{what} names node {node}, but there are only {nodes} nodes (numbered from 0)")]
    Node {
        /// What names the node.
        what: &'static str,
        /// Node named.
        node: u32,
        /// Number of nodes of the mesh.
        nodes: usize,
    },
    /// A fix along an axis that does not exist.
    #[error("a fix of node {node} names axis {axis}; axes are 0, 1 and 2")]
    Axis {
        /// Node of the fix, from 0.
        node: u32,
        /// Axis named; valid are 0 to 2.
        axis: u8,
    },
    /// A displacement or a force (`what`) is NaN or infinite.
    #[error("{what} of node {node} is {value}; expected a finite number")]
    NotFinite {
        /// What is not finite.
        what: &'static str,
        /// Node, from 0.
        node: u32,
        /// Value found, mm or N.
        value: f64,
    },
    /// Two different displacements are prescribed at one node and axis.
    #[error("node {node} is fixed at both {} mm and {} mm along {}", .displacements_mm[0], .displacements_mm[1],
        ["x", "y", "z"][*.axis as usize % 3])]
    Contradiction {
        /// Node, from 0.
        node: u32,
        /// Axis, 0 to 2.
        axis: u8,
        /// The two displacements, mm, in the order of the fixes.
        displacements_mm: [f64; 2],
    },
    /// Displacements or reactions that are not finite.
    #[error("the displacements are no finite numbers: stiffness, forces or displacements are too large or too small")]
    Overflow,
}

impl LinearError {
    /// Returns the error with names for regions.
    pub fn named(mut self, called: &BTreeMap<i32, String>) -> Self {
        if let LinearError::FreeParts { names, .. } = &mut self {
            names.clone_from(called);
        }
        self
    }
}

impl Blame for LinearError {
    fn is_machine(&self) -> bool {
        matches!(
            self,
            LinearError::FactorMemory { .. } | LinearError::InverseMemory { .. }
        )
    }
}

fn also_unusable(elements: &[usize]) -> String {
    match elements {
        [] => String::new(),
        others => format!("; unusable as well: {others:?}"),
    }
}

fn regions_of(regions: &[(i32, usize)]) -> String {
    let items = regions
        .iter()
        .map(|(region, elements)| format!("region {region} ({elements} tetrahedra)"));
    items.collect::<Vec<_>>().join(", ")
}

fn needed(bytes: &Option<usize>) -> String {
    bytes.map_or(String::new(), |bytes| {
        format!(": it needs {} MiB", bytes.div_ceil(1 << 20))
    })
}

fn gib(bytes: usize) -> f64 {
    bytes as f64 / (1u64 << 30) as f64
}
