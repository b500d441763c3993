//! The probe as a rigid cylinder that tissue slides along (Goksel et al. 2011, section IV).

use nalgebra::{Isometry3, Vector3};

use super::Wrench;

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

impl ProbeContact {
    /// The force of the tissue on the probe, split between its two driving points: each force on the axis between them linearly, as a
    /// lever does, so that their sum and their torque across the axis are those of `wrench` (about the origin of the probe at
    /// `pose`). None without driving points.
    pub fn split(&self, wrench: &Wrench, pose: &Isometry3<f64>) -> Option<[Vector3<f64>; 2]> {
        let [first, second] = self.driven_at_mm?;
        let axis = pose.rotation * Vector3::z();
        // The torque of forces f at -b along the axis is -b axis x f: (axis x torque) gives back the sum of b f across.
        let moment = axis.cross(&wrench.torque_nmm);
        let across = wrench.force_n - axis * axis.dot(&wrench.force_n);
        let along = wrench.force_n - across;
        let share = (moment - across * first) / (second - first);
        Some([across - share + along * 0.5, share + along * 0.5])
    }
}
