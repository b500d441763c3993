//! Tetrahedral meshes from labelled volumes: conforming, with a region per tissue, graded to a node budget.
//!
//! 1. A lattice of near-cubic cells over the box of the tissue, each of six tetrahedra, is refined by bisection
//!    (`bisection`): always the element with the largest volume that is not its majority tissue, until the requested
//!    number of nodes belong to tissue (`refine`). The contents of an element are sampled at regular points inside it
//!    (`contents`).
//! 2. Each element gets its majority region, modified by a price on faces between unlike elements and by the volumes of
//!    the regions, which must be correct (`assign`).
//! 3. Nodes of interfaces move onto the interfaces of the voxels and the nodes around them follow, as far as every
//!    element stays sound (`fit`); the contents of the elements are sampled again. This is repeated [`ROUNDS`] times.
//! 4. Elements outside the tissue are removed.
//!
//! Refinement alone produces three shapes of element, in cubic cells with no dihedral angle below 45 degrees, so the
//! least angle of the result is the limit of the fit: [`GenerateOptions::min_dihedral_deg`], or that of the refinement
//! where the cells are far from cubes. No element is inverted, and parts of the mesh that touch do so in faces.
//!
//! Along a path elements are finer ([`GenerateOptions::along_path`]): the refinement criterion is divided by the volume
//! permitted for an element at its distance from the path.
//!
//! The same input gives the same mesh, for any number of threads.

mod assign;
mod bisection;
mod budget;
mod contents;
mod draft;
mod finish;
mod fit;
mod path;
mod refine;
mod smooth;
mod tissue;

use nalgebra::Matrix4;

use super::vector::{cross, dot, minus, norm};
use super::{InvalidMesh, TetMesh};
use contents::Sampler;
use insonify_base::blame::Blame;
use insonify_base::memory::{self, TooLarge};
use tissue::Tissue;

/// Maximum number of nodes of a mesh: about 10 GB are needed to make it.
pub const MAX_NODES: usize = 5_000_000;

/// Peak memory per node, bytes: measured at 40,000 nodes.
const BYTES_A_NODE: usize = 2048;
/// Upper limit of the requested least dihedral angle, degrees: refinement alone leaves 45 in cubic cells, about 35 in
/// the flattest, and the fit needs room.
const MAX_DIHEDRAL_DEG: f64 = 30.0;
/// Number of times that nodes are fitted to the interfaces; the gain of a sixth round is below 1 % of the mislabelled
/// volume.
pub const ROUNDS: usize = 5;

/// Distance from the path within which a report has separate figures, mm.
pub const NEAR_MM: f64 = 20.0;
/// Distance from the path at which elements are twice as long as on it, mm.
pub(crate) const GRADING_MM: f64 = 10.0;

/// Longest edge of the elements within [`GRADING_MM`] of the path, as far as the nodes suffice, mm; shorter only where
/// all elements are. It is the length over which tissue takes the force of a needle's tip: a point force indents linear
/// tissue without limit as elements shrink.
pub(crate) const PATH_EDGE_MM: f64 = 5.0;

/// Input of the mesh generator: a labelled volume.
#[derive(Clone, Copy, Debug)]
pub struct LabelGrid<'a> {
    /// Label of each voxel, x fastest.
    pub labels: &'a [u8],
    /// Number of voxels along each axis.
    pub size: [usize; 3],
    /// Voxel index to world (mm); voxel centres lie at whole indices. Rotations, reflections, shears and any spacing
    /// are permitted: elements are shaped in the world.
    pub index_to_world: Matrix4<f64>,
    /// Labels to mesh, each with the region number of its elements; labels may share one. Every other label is outside.
    pub regions: &'a [(u8, i32)],
}

/// Options of the mesh generator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GenerateOptions<'a> {
    /// Least dihedral angle that moving nodes may cause, degrees (0 to 30; default 12). Smaller follows
    /// interfaces more closely, larger solves better.
    pub min_dihedral_deg: f64,
    /// Longest edge of a refined element with tissue in it, mm (before nodes are moved); `None` leaves it to the
    /// budget.
    pub max_edge_mm: Option<f64>,
    /// Segments of the path of a needle, in the world, mm; only their parts in tissue count. Default: none.
    pub path: &'a [[[f64; 3]; 2]],
    /// Whether elements are finer along the path: down to `PATH_EDGE_MM` near it, and growing by as much for each
    /// `GRADING_MM` away from it. Default: false.
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

/// Volumes of a region of a generated mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RegionVolume {
    /// Region number.
    pub region: i32,
    /// Volume of its voxels, ml.
    pub voxel_ml: f64,
    /// Volume of its elements, ml.
    pub mesh_ml: f64,
    /// Relative error of the mesh volume, per cent.
    pub error_percent: f64,
}

/// Figures of a generated mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct GenerateReport {
    /// Number of nodes of the mesh.
    pub nodes: usize,
    /// Number of tetrahedra.
    pub elements: usize,
    /// Number of parts connected through faces.
    pub parts: usize,
    /// Smallest angle between two faces of an element, degrees.
    pub min_dihedral_deg: f64,
    /// Largest condition number of an element's Jacobian relative to the regular tetrahedron: 1 is regular (P. M.
    /// Knupp, "Algebraic mesh quality metrics", SIAM Journal on Scientific Computing 23, 2001, Frobenius norms over 3).
    pub max_jacobian_condition: f64,
    /// Volumes of the regions, in the requested order.
    pub regions: Vec<RegionVolume>,
    /// Volume that has the wrong region, lies outside the tissue or is missing, as a share of that of the tissue, per
    /// cent.
    pub mislabelled_percent: f64,
    /// Share of mislabelled volume within [`NEAR_MM`] of the path, per cent; `None` where that meets no tissue.
    pub near_mislabelled_percent: Option<f64>,
}

/// A mesh made from a labelled volume, in world coordinates.
#[derive(Clone, Debug)]
pub struct Generated {
    /// The mesh; all elements have positive volume.
    pub mesh: TetMesh,
    /// Figures of the mesh.
    pub report: GenerateReport,
}

/// Reason why no mesh can be generated.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GenerateError {
    /// The number of voxels does not match the size.
    #[error("{found} voxels for a size of {size:?}; the product of the size, at least 1, is expected")]
    Size {
        /// Number of voxels along each axis.
        size: [usize; 3],
        /// Number of voxels given.
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
        /// Region number requested for the label.
        region: i32,
        /// Labels that have voxels.
        present: Vec<u8>,
    },
    /// A label is listed twice.
    #[error("label {label} is asked for twice; once is expected")]
    RepeatedLabel {
        /// The label.
        label: u8,
    },
    /// All 256 labels are listed.
    #[error("256 regions; at most 255 are supported, since one label must be outside")]
    TooManyRegions,
    /// An option is out of range.
    #[error("{key} is {found}; expected {expected}")]
    Option {
        /// Name of the option.
        key: &'static str,
        /// The rejected value.
        found: f64,
        /// Permitted values.
        expected: &'static str,
    },
    /// The budget exceeds the maximum.
    #[error("{nodes} nodes; at most {MAX_NODES} are supported (about 10 GB of memory)")]
    TooManyNodes {
        /// Requested number of nodes.
        nodes: usize,
    },
    /// The budget needs more memory than is available.
    #[error(transparent)]
    Memory(#[from] TooLarge),
    /// The budget is too small for this tissue.
    #[error("{nodes} nodes are too few for this tissue; at least about {least} are needed")]
    TooFewNodes {
        /// Requested number of nodes.
        nodes: usize,
        /// Smallest budget found to work.
        least: usize,
    },
    /// No budget tried is enough for this tissue.
    #[error(
        "no mesh of up to {nodes} nodes was found to fill this tissue, which is thin for its extent; check the sizes of its voxels, or mesh a part of it"
    )]
    TooThin {
        /// Largest budget tried.
        nodes: usize,
    },
    /// Elements lose their volume at the position of the tissue in the world.
    #[error("the volume lies so far from the origin of the world that its elements have no volume there")]
    Far,
    /// The budget is spent before all edges are short enough.
    #[error("edges of at most {max_edge_mm} mm need more than {nodes} nodes; allow longer edges or more nodes")]
    LongEdges {
        /// Requested longest edge, mm.
        max_edge_mm: f64,
        /// Requested number of nodes.
        nodes: usize,
    },
    /// The elements do not form a valid mesh.
    #[error(transparent)]
    Mesh(#[from] InvalidMesh),
}

impl Blame for GenerateError {
    fn is_machine(&self) -> bool {
        matches!(self, Self::Memory(_))
    }
}

/// Generates a mesh of at most `nodes` nodes from a labelled volume: a few per cent fewer in anatomy, up to 15 % where
/// a symmetric volume makes many elements change at once, more where tissue is too thin for its elements. `progress`
/// receives the share that is done, ascending from 0 to 1.
///
/// The volumes of regions larger than some twenty mean elements are within 1 % of their voxels, unless that would need
/// elements that are mostly outside; smaller ones as close as their few elements allow.
///
/// # Errors
/// [`GenerateError`]: inconsistent input, missing labels, budgets out of range.
pub fn generate(
    grid: &LabelGrid,
    nodes: usize,
    options: &GenerateOptions,
    mut progress: impl FnMut(f32),
) -> Result<Generated, GenerateError> {
    generate_with(&Sampler::new(), grid, nodes, options, &mut progress)
}

fn generate_with(
    sampler: &Sampler,
    grid: &LabelGrid,
    nodes: usize,
    options: &GenerateOptions,
    progress: &mut dyn FnMut(f32),
) -> Result<Generated, GenerateError> {
    check(nodes, options)?;
    memory::check((nodes * BYTES_A_NODE) as u64, &format!("a mesh of {nodes} nodes"))?;
    progress(0.0);
    let tissue = Tissue::new(grid)?;
    budget::check_thickness(&tissue)?;
    let mut reported = 0.0f32;
    let mut ascending = |share: f32| {
        if share > reported {
            reported = share;
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
    if nodes > MAX_NODES {
        return Err(GenerateError::TooManyNodes { nodes });
    }
    if !(0.0..=MAX_DIHEDRAL_DEG).contains(&options.min_dihedral_deg) {
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

/// Corners of the face opposite each corner.
const FACES: [[usize; 3]; 4] = [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]];

/// Returns six times the signed volume, mm^3.
fn six_volumes(corners: &[[f64; 3]; 4]) -> f64 {
    let [a, b, c] = [1, 2, 3].map(|corner: usize| minus(corners[corner], corners[0]));
    dot(a, cross(b, c))
}

/// Returns the cosine of the smallest dihedral angle: the smaller the better; 1 for a flat element.
fn sharpest_cosine(corners: &[[f64; 3]; 4]) -> f64 {
    let [a, b, c] = [1, 2, 3].map(|corner: usize| minus(corners[corner], corners[0]));
    // Normals of the faces opposite corners 1, 2, 3 and 0, all inwards or all outwards.
    let faces = [cross(b, c), cross(c, a), cross(a, b)];
    let last = [0, 1, 2].map(|axis| -(faces[0][axis] + faces[1][axis] + faces[2][axis]));
    let faces = [faces[0], faces[1], faces[2], last];
    let scales = faces.map(|face| 1.0 / norm(face));
    let mut sharpest = -1.0f64;
    for i in 0..4 {
        for j in 0..i {
            let cosine = -dot(faces[i], faces[j]) * scales[i] * scales[j];
            // NaN where a face has no area.
            if cosine.is_nan() {
                return 1.0;
            }
            sharpest = sharpest.max(cosine);
        }
    }
    sharpest
}

#[cfg(test)]
mod tests;
