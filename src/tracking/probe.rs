//! Probe geometry: origin and direction of each scanline in the probe frame.
//!
//! The probe frame has its origin at the centre of the transducer array, x lateral towards the marked side, y axial into
//! the body, z = x cross y. Sample `i` of a scanline lies `(i + 0.5) * depth / samples` millimetres along it.

mod beam;
mod image_grid;
mod spec;

pub use beam::{BeamGrid, Bounds, Ray};
pub use image_grid::{ImageGrid, OUTSIDE, scan_map};
pub use spec::{GridSpec, ImageSpec, ProbeKind, ProbeSpec};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::error::{TrackingError, in_ranges, within};

/// Shape of a transducer's field of view.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum ProbeShape {
    /// Parallel scanlines from a straight array.
    Linear {
        /// Length of the array, mm (1 to 300).
        width_mm: f64,
    },
    /// Scanlines perpendicular to a convex array.
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

/// A transducer and the sampling of its field of view.
///
/// In files it is one flat table (see [`ProbeSpec`]); reading one validates it. A value made in code is checked by
/// [`Probe::validate`], which [`BeamGrid::new`] calls.
///
/// ```
/// use insonify_tracking::probe::{Probe, ProbeShape};
///
/// let probe = Probe::new(ProbeShape::Curvilinear { radius_mm: 60.0, angle_deg: 70.0 }, 150.0)?;
/// assert_eq!((probe.lines, probe.samples), (256, 512));
/// assert!(Probe::new(ProbeShape::Linear { width_mm: -38.0 }, 60.0).is_err());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(try_from = "ProbeSpec", into = "ProbeSpec")]
#[schemars(with = "ProbeSpec")]
pub struct Probe {
    /// Shape of the field of view.
    pub shape: ProbeShape,
    /// Length of every scanline, mm (0.1 to 1000).
    pub depth_mm: f64,
    /// Centre frequency, MHz (0.1 to 100).
    pub frequency_mhz: f64,
    /// Number of scanlines, spread from edge to edge inclusive (1 to 8192); a single one runs down the middle.
    pub lines: u32,
    /// Number of samples along each scanline (1 to 16384).
    pub samples: u32,
}

impl ProbeShape {
    /// Kind of probe, as named in files.
    pub fn kind(&self) -> ProbeKind {
        match self {
            Self::Linear { .. } => ProbeKind::Linear,
            Self::Curvilinear { .. } => ProbeKind::Curvilinear,
            Self::Phased { .. } => ProbeKind::Phased,
            Self::TrusTransverse { .. } => ProbeKind::TrusTransverse,
            Self::TrusSagittal { .. } => ProbeKind::TrusSagittal,
        }
    }

    /// Checks the ranges that are narrower than those of [`ProbeSpec`].
    fn validate(&self) -> Result<(), TrackingError> {
        match *self {
            Self::Curvilinear { angle_deg, .. } => within("probe", "angle_deg", angle_deg, [1.0, 180.0]),
            Self::Phased { angle_deg } => within("probe", "angle_deg", angle_deg, [1.0, 120.0]),
            Self::TrusTransverse { radius_mm, .. } => within("probe", "radius_mm", radius_mm, [2.0, 50.0]),
            Self::Linear { .. } | Self::TrusSagittal { .. } => Ok(()),
        }
    }
}

impl Probe {
    /// Creates a probe of `shape` with imaging depth `depth_mm`, the kind's usual frequency and the default grid of 256
    /// scanlines by 512 samples.
    pub fn new(shape: ProbeShape, depth_mm: f64) -> Result<Self, TrackingError> {
        let probe = Self {
            shape,
            depth_mm,
            frequency_mhz: shape.kind().usual_frequency_mhz(),
            lines: spec::DEFAULT_LINES,
            samples: spec::DEFAULT_SAMPLES,
        };
        probe.validate()?;
        Ok(probe)
    }

    /// Checks every number against its documented range. One scanline and one sample are allowed; a sector without angle
    /// or depth is not.
    pub fn validate(&self) -> Result<(), TrackingError> {
        self.shape.validate()?;
        in_ranges("probe", &ProbeSpec::from(*self))
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// One probe of each kind, with few scanlines so that a complete grid is quickly traversed.
    pub(crate) fn one_of_each() -> [Probe; 5] {
        [
            ProbeShape::Linear { width_mm: 40.0 },
            ProbeShape::Curvilinear {
                radius_mm: 50.0,
                angle_deg: 70.0,
            },
            ProbeShape::Phased { angle_deg: 90.0 },
            ProbeShape::TrusTransverse {
                radius_mm: 10.0,
                angle_deg: 250.0,
            },
            ProbeShape::TrusSagittal { length_mm: 60.0 },
        ]
        .map(|shape| Probe {
            shape,
            depth_mm: 80.0,
            frequency_mhz: 5.0,
            lines: 33,
            samples: 40,
        })
    }

    #[test]
    fn degenerate_sectors_are_refused_by_key() {
        let good = one_of_each()[1];
        let curved = |radius_mm, angle_deg| Probe {
            shape: ProbeShape::Curvilinear { radius_mm, angle_deg },
            ..good
        };
        let cases = [
            ("angle_deg", curved(50.0, 0.0)),
            ("angle_deg", curved(50.0, -70.0)),
            ("angle_deg", curved(50.0, 180.5)),
            ("radius_mm", curved(f64::NAN, 70.0)),
            ("depth_mm", Probe { depth_mm: 0.0, ..good }),
            (
                "depth_mm",
                Probe {
                    depth_mm: f64::INFINITY,
                    ..good
                },
            ),
            (
                "frequency_mhz",
                Probe {
                    frequency_mhz: -1.0,
                    ..good
                },
            ),
            ("lines", Probe { lines: 0, ..good }),
            ("samples", Probe { samples: 0, ..good }),
        ];
        for (key, probe) in cases {
            let error = probe.validate().expect_err(key);
            assert_eq!(error.key(), Some(key), "{error}");
            assert!(BeamGrid::new(&probe).is_err());
        }
    }

    #[test]
    fn a_single_line_and_a_single_sample_are_allowed() {
        for probe in one_of_each() {
            let single = Probe {
                lines: 1,
                samples: 1,
                ..probe
            };
            assert!(single.validate().is_ok());
        }
    }
}
