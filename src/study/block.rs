//! What studies put needles into: a block of tissue that stands on a table, and a hand that moves the needle.
//!
//! The block reaches from the origin to its extents (mm); the needle goes along z from the skin at z = 0; the far end is held.

use nalgebra::{Isometry3, Matrix4, Point3, Translation3, UnitQuaternion, Vector3};

use crate::mechanics::insertion::finite::{Options, Setup};
use crate::mechanics::insertion::{Instruments, Interaction};
use crate::mechanics::mesh::{InvalidMesh, TetMesh};
use crate::mechanics::needle::{Bevel, Cantilever, InvalidNeedleModel, Needle, Rigid, Shaft, Springs, Stiffness};
use crate::mechanics::tissue::material::Material;
use crate::mechanics::tissue::remesh::{Level, Precision};

/// Tissue that grips, resists cutting, and has a skin.
pub const USUAL: Interaction = Interaction {
    friction_n_per_mm: 0.02,
    static_ratio: 1.0,
    cutting_n: 0.5,
    puncture_n: 1.0,
    peak: None,
    bone: None,
    critical: false,
};

/// A bevel as of a brachytherapy needle, over 10 mm in place of the usual [`BEVEL_MM`](crate::mechanics::needle::BEVEL_MM): the block
/// is little deeper than a needle goes, and figures of studies stay comparable.
pub const BEVEL: Bevel = Bevel {
    r_mm: 0.6,
    length_mm: 10.0,
};

/// Length of the links of a needle of springs in Goksel et al. 2011, mm.
pub const LINK_MM: f64 = 10.0;

/// Cells that mirror each other over a block, one region 0: planes between them are planes of symmetry.
///
/// # Errors
/// [`InvalidMesh`].
pub fn mirrored(extent: [f64; 3], cell_mm: f64) -> Result<TetMesh, InvalidMesh> {
    TetMesh::mirrored_lattice(cells(extent, cell_mm), &scaling(extent))
}

/// Equal cells over a block.
///
/// # Errors
/// [`InvalidMesh`].
pub fn plain(extent: [f64; 3], cell_mm: f64) -> Result<TetMesh, InvalidMesh> {
    TetMesh::lattice(cells(extent, cell_mm), &scaling(extent))
}

fn cells(extent: [f64; 3], cell_mm: f64) -> [usize; 3] {
    extent.map(|edge| (edge / cell_mm).round() as usize)
}

fn scaling(extent: [f64; 3]) -> Matrix4<f64> {
    Matrix4::new_nonuniform_scaling(&Vector3::from(extent))
}

/// Tissue of one material, held at its far end along z, without a probe: exact condensed level.
pub fn on_table(mesh: TetMesh, material: Material, interaction: Interaction, needle: Box<dyn Needle>) -> Setup {
    let end = mesh.bounds()[1][2];
    let held = (0..).zip(mesh.nodes()).filter(|(_, p)| p[2] == end);
    Setup {
        materials: vec![material; mesh.elements().len()],
        fixed: held.flat_map(|(node, _)| [0, 1, 2].map(|axis| (node, axis))).collect(),
        interactions: vec![(0, interaction)],
        anatomy: None,
        needle,
        probe: None,
        level: Level::Exact,
        precision: Precision::Double,
        options: Options::default(),
        mesh,
    }
}

/// A needle of the usual shaft that nothing bends.
///
/// # Errors
/// [`InvalidNeedleModel`].
pub fn rigid() -> Result<Box<dyn Needle>, InvalidNeedleModel> {
    Ok(Box::new(Rigid::new(Shaft::default(), None)?))
}

/// A needle of angular springs.
///
/// # Errors
/// [`InvalidNeedleModel`].
pub fn springs(stiffness: Stiffness, link_mm: f64, bevel: Bevel) -> Result<Box<dyn Needle>, InvalidNeedleModel> {
    Ok(Box::new(Springs::new(
        Shaft::default(),
        stiffness,
        link_mm,
        Some(bevel),
    )?))
}

/// A needle that is a beam.
///
/// # Errors
/// [`InvalidNeedleModel`].
pub fn beam(stiffness: Stiffness, element_mm: f64, bevel: Bevel) -> Result<Box<dyn Needle>, InvalidNeedleModel> {
    Ok(Box::new(Cantilever::new(
        Shaft::default(),
        stiffness,
        element_mm,
        Some(bevel),
    )?))
}

/// A needle of the usual shaft along z, whose tip would be at `tip` (mm) if nothing bent it.
pub fn tip_at(tip: [f64; 3]) -> Instruments {
    let base = Translation3::new(tip[0], tip[1], tip[2] - Shaft::default().length_mm);
    Instruments {
        base: Isometry3::from_parts(base, UnitQuaternion::identity()),
        probe: None,
        guide: None,
        deposit: false,
    }
}

/// The same through a hole of a template, 5 mm before the skin.
pub fn guided(tip: [f64; 3]) -> Instruments {
    Instruments {
        guide: Some(Point3::new(tip[0], tip[1], -5.0)),
        ..tip_at(tip)
    }
}
