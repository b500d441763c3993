//! The probe as a rigid cylinder that tissue slides along (haptic simulator paper, section IV).

use nalgebra::Isometry3;

/// A probe in contact. Its frame: origin at the end of the cylinder that goes first, z along the axis into the body.
#[derive(Clone, Debug, PartialEq)]
pub struct ProbeContact {
    /// Probe frame to world when the tissue is at rest.
    pub nominal: Isometry3<f64>,
    /// Length of the cylinder behind its end, mm: nodes along it are in contact.
    pub length_mm: f64,
    /// Nodes that the probe can touch, known beforehand.
    pub candidates: Vec<u32>,
    /// Two points of the axis that drive it, mm behind the end: the force is split between them. None: the whole at the origin.
    pub driven_at_mm: Option<[f64; 2]>,
}
