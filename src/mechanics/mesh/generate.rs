//! Tetrahedral meshes made from labelled volumes: conforming, one region a tissue, graded to a node budget.
//!
//! 1. A lattice of near-cubic cells over the box of the tissue, each of six tetrahedra, is refined by bisection
//!    (`bisection`): always the element with the largest volume that is not its majority tissue, until the nodes of tissue
//!    number what was asked for (`refine`). What an element holds is sampled at regular points inside it (`contents`).
//! 2. Each element gets the region that most of it is, but for a price on faces between unlike elements and for the volumes
//!    of the regions, which must come out right (`assign`).
//! 3. Nodes of interfaces move onto the interfaces of the voxels and the nodes around follow, as far as every element stays
//!    sound (`fit`); what the elements hold is looked at again. This is repeated [`ROUNDS`] times.
//! 4. Elements outside the tissue are left out.
//!
//! Refinement alone leaves three shapes of element, in cubic cells with no dihedral angle below 45 degrees, so the least
//! angle of the result is the one that the fit keeps to: [`GenerateOptions::min_dihedral_deg`], or that of the refinement
//! where the cells are far from cubes. No element is inverted, and parts of the mesh that touch do so in faces.
//!
//! Along a path elements are finer ([`GenerateOptions::along_path`]): what refinement goes by is divided by the volume that an
//! element may have at its distance from it.
//!
//! The same input gives the same mesh, whatever the number of threads.

mod assign;
mod bisection;
mod budget;
mod contents;
mod draft;
mod finish;
mod fit;
mod path;
mod refine;
mod shape;
mod smooth;
mod tissue;

use nalgebra::Matrix4;

use super::{InvalidMesh, TetMesh};
use crate::memory::{self, TooLarge};
use contents::Sampler;
use tissue::Tissue;

/// Most nodes of a mesh: about 10 GB are needed to make it.
pub const MOST_NODES: usize = 5_000_000;

/// Memory at the peak, bytes a node: measured at 40,000 nodes.
const BYTES_A_NODE: usize = 2048;
/// Largest of the least dihedral angles that can be asked for, degrees: refinement alone leaves 45 in cubic cells, about 35
/// in the flattest, and the fit needs room.
pub const MOST_DIHEDRAL_DEG: f64 = 30.0;
/// How often nodes are fitted to the interfaces; the gain of a sixth round is below 1 % of what is mislabelled.
pub const ROUNDS: usize = 5;

/// Distance from the path within which a report has figures of its own, mm.
pub const NEAR_MM: f64 = 20.0;
/// Distance from the path at which elements along it are twice as long as on it, mm.
pub const GRADING_MM: f64 = 10.0;

/// Longest edge of the elements within [`GRADING_MM`] of the path, as far as the nodes suffice, mm; shorter only where all elements
/// are. It is the length over which tissue takes the force of a needle's tip: a force at a point of linear tissue dents it without
/// a limit as elements shrink.
pub const PATH_EDGE_MM: f64 = 5.0;

/// A labelled volume, as far as it matters here.
#[derive(Clone, Copy, Debug)]
pub struct LabelGrid<'a> {
    /// One label a voxel, x fastest.
    pub labels: &'a [u8],
    /// Voxels along each axis.
    pub size: [usize; 3],
    /// Voxel index to world (mm); voxel centres lie at whole indices. Rotations, reflections, shears and any spacing are
    /// welcome: elements are shaped in the world.
    pub index_to_world: Matrix4<f64>,
    /// The labels to mesh, each with the region number that its elements get; labels may share one. Every other label is
    /// outside.
    pub regions: &'a [(u8, i32)],
}

/// How a mesh is made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GenerateOptions<'a> {
    /// Least dihedral angle that moving nodes may leave, degrees (0 to [`MOST_DIHEDRAL_DEG`]; default 12). Smaller follows
    /// interfaces closer, larger solves better.
    pub min_dihedral_deg: f64,
    /// Longest edge of a refined element with tissue in it, mm (before nodes are moved); none leaves it to the budget.
    pub max_edge_mm: Option<f64>,
    /// Segments of the path of a needle, in the world, mm: what of them lies in tissue counts. Default: none.
    pub path: &'a [[[f64; 3]; 2]],
    /// Whether elements are finer along the path: down to [`PATH_EDGE_MM`] near it, and growing by as much for each
    /// [`GRADING_MM`] away from it. Default: they are not.
    pub along_path: bool,
}

impl Default for GenerateOptions<'_> {
    fn default() -> Self {
        GenerateOptions {
            min_dihedral_deg: 12.0,
            max_edge_mm: None,
            path: &[],
            along_path: false,
        }
    }
}

/// A region of a generated mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RegionVolume {
    /// Its number.
    pub region: i32,
    /// Volume of its voxels, ml.
    pub voxel_ml: f64,
    /// Volume of its elements, ml.
    pub mesh_ml: f64,
    /// By how much the second exceeds the first, per cent.
    pub error_percent: f64,
}

/// What came of it.
#[derive(Clone, Debug, PartialEq)]
pub struct GenerateReport {
    /// Nodes of the mesh.
    pub nodes: usize,
    /// Its tetrahedra.
    pub elements: usize,
    /// Parts that hang together through faces.
    pub parts: usize,
    /// Smallest angle between two faces of an element, degrees.
    pub min_dihedral_deg: f64,
    /// Largest condition number of an element's Jacobian against the regular tetrahedron: 1 is regular (P. M. Knupp,
    /// "Algebraic mesh quality metrics", SIAM Journal on Scientific Computing 23, 2001, Frobenius norms over 3).
    pub max_jacobian_condition: f64,
    /// Regions, in the order in which they were asked for.
    pub regions: Vec<RegionVolume>,
    /// Volume that has the wrong region, lies outside the tissue or is missing, as a share of that of the tissue, per cent.
    pub mislabelled_percent: f64,
    /// The same of what lies within [`NEAR_MM`] of the path; none where that meets no tissue.
    pub near_mislabelled_percent: Option<f64>,
}

/// A mesh made from a labelled volume, in world coordinates.
#[derive(Clone, Debug)]
pub struct Generated {
    /// The mesh; all elements have positive volume.
    pub mesh: TetMesh,
    /// Its figures.
    pub report: GenerateReport,
}

/// Why no mesh can be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GenerateError {
    /// The voxels do not match the size.
    #[error("{found} voxels for a size of {size:?}; the product of the size, at least 1, is expected")]
    Size {
        /// Voxels along each axis.
        size: [usize; 3],
        /// Voxels given.
        found: usize,
    },
    /// The matrix has no inverse or is not finite.
    #[error("the index-to-world transform is singular or not finite")]
    Transform,
    /// There is no label to mesh.
    #[error("no label to mesh was given: the volume has no labelled voxel, or none was asked for")]
    NoLabel,
    /// A label without voxels.
    #[error("label {label} (region {region}) has no voxel; the volume holds the labels {present:?}")]
    NoVoxels {
        /// The label.
        label: u8,
        /// The region number that it was to have.
        region: i32,
        /// Labels that have voxels.
        present: Vec<u8>,
    },
    /// A label was asked for twice.
    #[error("label {label} is asked for twice; once is expected")]
    RepeatedLabel {
        /// The label.
        label: u8,
    },
    /// All 256 labels were asked for.
    #[error("256 regions; at most 255 are supported, since one label must be outside")]
    TooManyRegions,
    /// An option is out of range.
    #[error("{key} is {found}; expected {expected}")]
    Option {
        /// Which.
        key: &'static str,
        /// What was asked for.
        found: f64,
        /// What can be.
        expected: &'static str,
    },
    /// The budget is beyond what can be made.
    #[error("{nodes} nodes; at most {MOST_NODES} are supported (about 10 GB of memory)")]
    TooManyNodes {
        /// Nodes asked for.
        nodes: usize,
    },
    /// The budget needs more memory than there is.
    #[error(transparent)]
    Memory(#[from] TooLarge),
    /// The budget is too small for this tissue.
    #[error("{nodes} nodes are too few for this tissue; at least about {least} are needed")]
    TooFewNodes {
        /// Nodes asked for.
        nodes: usize,
        /// The smallest budget found to work.
        least: usize,
    },
    /// No budget tried is enough for this tissue.
    #[error(
        "no mesh of up to {nodes} nodes was found to fill this tissue, which is thin for its extent; check the sizes of its voxels, or mesh a part of it"
    )]
    TooThin {
        /// The largest budget tried.
        nodes: usize,
    },
    /// Elements that lose their volume where the tissue lies in the world.
    #[error("the volume lies so far from the origin of the world that its elements have no volume there")]
    Far,
    /// The budget is spent before all edges are short enough.
    #[error("edges of at most {max_edge_mm} mm need more than {nodes} nodes; allow longer edges or more nodes")]
    LongEdges {
        /// Longest edge asked for, mm.
        max_edge_mm: f64,
        /// Nodes asked for.
        nodes: usize,
    },
    /// The elements make no mesh.
    #[error(transparent)]
    Mesh(#[from] InvalidMesh),
}

impl GenerateError {
    /// Whether the machine failed rather than the input.
    pub fn is_machine(&self) -> bool {
        matches!(self, Self::Memory(_))
    }
}

/// Makes a mesh of at most `nodes` nodes from a labelled volume: a few per cent fewer in anatomy, up to 15 % where a symmetric
/// volume makes many elements change at once, more where tissue is too thin for its elements. `progress` hears the share that
/// is done, ascending from 0 to 1.
///
/// The volumes of regions larger than some twenty mean elements come out within 1 % of their voxels, unless that
/// would need elements that are mostly outside; smaller ones as near as their few elements allow.
///
/// # Errors
/// [`GenerateError`]: input that does not fit together, labels that are not there, budgets out of range.
pub fn generate(
    grid: &LabelGrid,
    nodes: usize,
    options: &GenerateOptions,
    progress: impl FnMut(f32),
) -> Result<Generated, GenerateError> {
    generate_with(&Sampler::new(), grid, nodes, options, progress)
}

fn generate_with(
    sampler: &Sampler,
    grid: &LabelGrid,
    nodes: usize,
    options: &GenerateOptions,
    mut progress: impl FnMut(f32),
) -> Result<Generated, GenerateError> {
    check(nodes, options)?;
    memory::check((nodes * BYTES_A_NODE) as u64, &format!("a mesh of {nodes} nodes"))?;
    progress(0.0);
    let tissue = Tissue::new(grid)?;
    budget::check_thickness(&tissue)?;
    let mut told = 0.0f32;
    let mut ascending = |share: f32| {
        if share > told {
            told = share;
            progress(share);
        }
    };
    match budget::within(&tissue, sampler, nodes, options, &mut ascending)? {
        Some(generated) => {
            ascending(1.0);
            Ok(generated)
        }
        None => Err(budget::shortage(&tissue, sampler, nodes, options)?),
    }
}

fn check(nodes: usize, options: &GenerateOptions) -> Result<(), GenerateError> {
    if nodes > MOST_NODES {
        return Err(GenerateError::TooManyNodes { nodes });
    }
    if !(0.0..=MOST_DIHEDRAL_DEG).contains(&options.min_dihedral_deg) {
        return Err(GenerateError::Option {
            key: "min_dihedral_deg",
            found: options.min_dihedral_deg,
            expected: "0 to 30 degrees",
        });
    }
    if let Some(&found) = options
        .path
        .as_flattened()
        .as_flattened()
        .iter()
        .find(|x| !x.is_finite())
    {
        return Err(GenerateError::Option {
            key: "path",
            found,
            expected: "finite coordinates",
        });
    }
    match options.max_edge_mm {
        Some(found) if found.is_nan() || found <= 0.0 => Err(GenerateError::Option {
            key: "max_edge_mm",
            found,
            expected: "a positive length",
        }),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests;
