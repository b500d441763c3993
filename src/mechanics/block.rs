//! Block of tissue on a table, and the needles that the studies insert into it.
//!
//! The block reaches from the origin to its extents (mm). The needle moves along z from the skin at z = 0; the far end
//! is fixed.

use nalgebra::{Isometry3, Matrix4, Point3, Translation3, UnitQuaternion, Vector3};

use crate::insertion::finite::{FiniteOptions, Setup};
use crate::insertion::{Instruments, Interaction};
use crate::needle::{Bevel, Flexible, Needle, Rigid, Shaft, Stiffness};
use crate::tissue::material::Material;
use crate::tissue::remesh::{Level, Precision};
use insonify_base::range::OutOfRange;
use insonify_mesh::{InvalidMesh, TetMesh};

/// Interaction of a tissue with friction, cutting resistance and a skin.
pub const USUAL: Interaction = Interaction {
    friction_n_per_mm: 0.02,
    static_ratio: 1.0,
    cutting_n: 0.5,
    puncture_n: 1.0,
    peak: None,
    bone: None,
    critical: false,
};

/// Bevel of a brachytherapy needle, 10 mm long instead of the default [`BEVEL_MM`](crate::needle::BEVEL_MM): the block
/// is hardly deeper than the insertions, and the figures of the studies stay comparable.
pub const BEVEL: Bevel = Bevel {
    r_mm: 0.6,
    length_mm: 10.0,
};

/// Link length of the angular-spring needle of Goksel et al. 2011, mm.
pub const LINK_MM: f64 = 10.0;

/// Meshes a block with mirrored cells, all of region 0, so that planes between cells are planes of symmetry.
///
/// # Errors
/// [`InvalidMesh`].
pub fn mirrored(extent: [f64; 3], cell_mm: f64) -> Result<TetMesh, InvalidMesh> {
    TetMesh::mirrored_lattice(cells(extent, cell_mm), &scaling(extent))
}

/// Meshes a block with identical cells.
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

/// Sets up tissue of one material, fixed at its far end along z, at the exact condensed level and without a probe.
pub fn on_table(mesh: TetMesh, material: Material, interaction: Interaction, needle: Box<dyn Needle>) -> Setup {
    let end = mesh.bounds()[1][2];
    let fixed_nodes = (0..).zip(mesh.nodes()).filter(|(_, p)| p[2] == end);
    Setup {
        materials: vec![material; mesh.elements().len()],
        fixed: fixed_nodes
            .flat_map(|(node, _)| [0, 1, 2].map(|axis| (node, axis)))
            .collect(),
        interactions: vec![(0, interaction)],
        anatomy: None,
        needle,
        probe: None,
        level: Level::Exact,
        precision: Precision::Double,
        options: FiniteOptions::default(),
        mesh,
    }
}

/// Creates a rigid needle with the default shaft.
///
/// # Errors
/// [`OutOfRange`].
pub fn rigid() -> Result<Box<dyn Needle>, OutOfRange> {
    Ok(Box::new(Rigid::new(Shaft::default(), None)?))
}

/// Creates a needle of angular springs.
///
/// # Errors
/// [`OutOfRange`].
pub fn springs(stiffness: Stiffness, link_mm: f64, bevel: Bevel) -> Result<Box<dyn Needle>, OutOfRange> {
    Ok(Box::new(Flexible::springs(
        Shaft::default(),
        stiffness,
        link_mm,
        Some(bevel),
    )?))
}

/// Creates a beam needle.
///
/// # Errors
/// [`OutOfRange`].
pub fn beam(stiffness: Stiffness, element_mm: f64, bevel: Bevel) -> Result<Box<dyn Needle>, OutOfRange> {
    Ok(Box::new(Flexible::beam(
        Shaft::default(),
        stiffness,
        element_mm,
        Some(bevel),
    )?))
}

/// Places a needle with the default shaft along z so that its undeformed tip is at `tip`, mm.
pub fn tip_at(tip: [f64; 3]) -> Instruments {
    let base = Translation3::new(tip[0], tip[1], tip[2] - Shaft::default().length_mm);
    Instruments {
        base: Isometry3::from_parts(base, UnitQuaternion::identity()),
        probe: None,
        guide: None,
        deposit: false,
    }
}

/// Places a needle like [`tip_at`], guided by a template hole 5 mm above the skin.
pub fn guided(tip: [f64; 3]) -> Instruments {
    Instruments {
        guide: Some(Point3::new(tip[0], tip[1], -5.0)),
        ..tip_at(tip)
    }
}
