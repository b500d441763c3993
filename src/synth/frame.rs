//! What goes into a frame, and what comes out.

use nalgebra::{Matrix4, Point3, Vector3};

/// The shaft of a needle, or a seed, in the world.
#[derive(Clone, Debug, PartialEq)]
pub struct NeedleShaft {
    /// Nodes of the shaft, mm, hub first and tip last; two for a straight one. Of more than 65 those towards the tip are shown.
    pub nodes: Vec<Point3<f64>>,
    /// Diameter, mm.
    pub diameter_mm: f64,
}

/// Length of a usual brachytherapy seed, mm.
pub const SEED_LENGTH_MM: f64 = 4.5;
/// Diameter of a usual brachytherapy seed, mm.
pub const SEED_DIAMETER_MM: f64 = 0.8;

impl NeedleShaft {
    /// A brachytherapy seed about `centre_mm` (world) along a direction of any length.
    pub fn seed(centre_mm: Point3<f64>, along: &Vector3<f64>) -> Self {
        let half = along.normalize() * (SEED_LENGTH_MM / 2.0);
        Self {
            nodes: vec![centre_mm - half, centre_mm + half],
            diameter_mm: SEED_DIAMETER_MM,
        }
    }
}

/// What changes from frame to frame. All places are in the world, however far from its origin: they are double precision, and are
/// moved near 0 before they are rounded ([`super::local_origin`]).
#[derive(Clone, Debug)]
pub struct FrameState {
    /// Number of the frame; it seeds the additive noise.
    pub frame: u64,
    /// Probe frame to world, mm.
    pub probe_to_world: Matrix4<f64>,
    /// The needle, if there is one in this frame.
    pub needle: Option<NeedleShaft>,
    /// Seeds left in the tissue, and other shafts beside the needle: shown as the needle is, with or without one. Of those that
    /// meet the scan plane the first are shown, up to 256 segments with the needle's; [`Frame::left_out`] tells of more.
    pub seeds: Vec<NeedleShaft>,
    /// Current positions of the mesh nodes, mm; none leaves them where the last frame had them (at first: the reference).
    pub nodes: Option<Vec<[f64; 3]>>,
    /// Reference positions of the mesh nodes, mm, which remeshing moves; none leaves them where the last frame had them (at
    /// first: those of the mesh). Labels, textures and speckle are read there.
    pub reference: Option<Vec<[f64; 3]>>,
}

impl FrameState {
    /// A frame with nothing but a probe pose.
    pub fn at(probe_to_world: Matrix4<f64>) -> Self {
        Self {
            frame: 0,
            probe_to_world,
            needle: None,
            seeds: Vec::new(),
            nodes: None,
            reference: None,
        }
    }
}

/// A rendered frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Grey levels, row by row from the top.
    pub pixels: Vec<u8>,
    /// Pixel (column, row, 0) to world, mm.
    pub image_to_world: Matrix4<f64>,
    /// Side of a pixel, mm.
    pub pixel_mm: f64,
    /// Segments of needle and seeds that are not shown, being too many.
    pub left_out: usize,
}
