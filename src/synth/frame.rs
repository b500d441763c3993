//! Input state and output of a frame.

use nalgebra::{Matrix4, Point3, Vector3};

/// Shaft of a needle, or a seed, in the world.
#[derive(Clone, Debug, PartialEq)]
pub struct NeedleShaft {
    /// Nodes of the shaft, mm, hub first and tip last; two for a straight one. If there are more than 65, those towards the tip
    /// are shown.
    pub nodes: Vec<Point3<f64>>,
    /// Diameter, mm.
    pub diameter_mm: f64,
}

/// Length of a usual brachytherapy seed, mm.
pub const SEED_LENGTH_MM: f64 = 4.5;
/// Diameter of a usual brachytherapy seed, mm.
pub const SEED_DIAMETER_MM: f64 = 0.8;

impl NeedleShaft {
    /// A brachytherapy seed centred at `centre_mm` (world) along a direction of any length.
    pub fn seed(centre_mm: Point3<f64>, along: &Vector3<f64>) -> Self {
        let half = along.normalize() * (SEED_LENGTH_MM / 2.0);
        Self {
            nodes: vec![centre_mm - half, centre_mm + half],
            diameter_mm: SEED_DIAMETER_MM,
        }
    }
}

/// State that varies from frame to frame. All positions are in the world, at any distance from its origin: they are in double
/// precision, and are translated near 0 before they are rounded ([`super::local_origin`]).
#[derive(Clone, Debug)]
pub struct FrameState {
    /// Frame number; it seeds the additive noise.
    pub frame: u64,
    /// Transform from the probe frame to the world, mm.
    pub probe_to_world: Matrix4<f64>,
    /// Needle of this frame, if any.
    pub needle: Option<NeedleShaft>,
    /// Seeds in the tissue, and other shafts beside the needle: shown as the needle is, with or without one. Of those that meet
    /// the scan plane the first are shown, up to 256 segments with the needle's; [`Frame::left_out`] counts the others.
    pub seeds: Vec<NeedleShaft>,
    /// Current positions of the mesh nodes, mm; `None` keeps those of the last frame (initially the reference).
    pub nodes: Option<Vec<[f64; 3]>>,
    /// Reference positions of the mesh nodes, mm, which remeshing moves; `None` keeps those of the last frame (initially
    /// those of the mesh). Labels, textures and speckle are looked up there.
    pub reference: Option<Vec<[f64; 3]>>,
}

impl FrameState {
    /// A frame state with only a probe pose.
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
    /// Transform from pixels (column, row, 0) to the world, mm.
    pub image_to_world: Matrix4<f64>,
    /// Pixel size, mm.
    pub pixel_mm: f64,
    /// Number of segments of needle and seeds not shown because there are too many.
    pub left_out: usize,
}
