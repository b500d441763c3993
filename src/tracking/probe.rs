//! Probe geometry: where each scanline starts and which way it runs, in the probe frame.
//!
//! The probe frame has its origin at the centre of the transducer array, x lateral towards the marked side, y axial into
//! the body, z = x cross y. Sample `i` of a scanline lies `(i + 0.5) * depth / samples` millimetres along it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The shape of a transducer's field of view.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum ProbeShape {
    /// Parallel scanlines from a straight array.
    Linear {
        /// Length of the array, mm (1 to 300).
        width_mm: f64,
    },
    /// Scanlines that leave a convex array at right angles.
    Curvilinear {
        /// Radius of curvature of the array, mm (2 to 200).
        radius_mm: f64,
        /// Field of view, degrees (1 to 180).
        angle_deg: f64,
    },
    /// Scanlines that fan out from one point on a small flat array.
    Phased {
        /// Field of view, degrees (1 to 120).
        angle_deg: f64,
    },
    /// Transrectal, transverse plane: an end ring of elements around the probe's axis (z), looking outwards.
    TrusTransverse {
        /// Radius of the probe, mm (2 to 50).
        radius_mm: f64,
        /// Field of view, degrees (1 to 270).
        angle_deg: f64,
    },
    /// Transrectal, sagittal plane: a straight array along the probe's side; x runs along the probe's axis.
    TrusSagittal {
        /// Length of the array, mm (1 to 300).
        length_mm: f64,
    },
}
