//! Probe geometry: origin and direction of each scanline in the probe frame.
//!
//! The probe frame has its origin at the centre of the transducer array, x lateral towards the marked side, y axial
//! into the body, z = x cross y. Sample `i` of a scanline lies `(i + 0.5) * depth / samples` millimetres along it.

mod aperture;
mod beam;
mod image_grid;
mod kind;
mod spec;

pub use aperture::{Aperture, Apodisation, Transducer};
pub use beam::{BeamGrid, Bounds, Ray};
pub use image_grid::{ImageGrid, OUTSIDE, scan_map};
pub use kind::Site;
pub use spec::{GridSpec, ImageSpec, ProbeSpec, Sampling};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::error::{TrackingError, in_ranges};
use kind::{Kind, kinds};

kinds! {
    linear: Linear;
    curvilinear: Curvilinear;
    phased: Phased;
    trus_transverse: TrusTransverse;
    trus_sagittal: TrusSagittal;
    radial: Radial;
}

/// A transducer and the sampling of its field of view.
///
/// In files it is one flat table (see [`ProbeSpec`]); reading one validates it. A value made in code is checked by
/// [`Probe::validate`], which [`BeamGrid::new`] calls.
///
/// ```
/// use insonify_tracking::probe::{Curvilinear, Linear, Probe};
///
/// let probe = Probe::new(Curvilinear { radius_mm: 60.0, angle_deg: 70.0 }, 150.0)?;
/// assert_eq!((probe.lines, probe.samples), (256, 512));
/// assert!(Probe::new(Linear { width_mm: -38.0 }, 60.0).is_err());
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
    /// Aperture, pulse and lens, as far as they are stated.
    pub aperture: Aperture,
}

impl ProbeKind {
    /// Name in files.
    pub fn name(self) -> &'static str {
        self.facts().name
    }

    /// A centre frequency common for the kind, MHz: low for deep abdominal and cardiac probes, high for surface probes
    /// and those inside the body.
    pub fn usual_frequency_mhz(self) -> f64 {
        self.facts().usual_mhz
    }

    /// A usual probe of the kind.
    pub fn usual(self) -> Probe {
        Probe {
            shape: ProbeShape::usual(self),
            depth_mm: self.facts().usual_depth_mm,
            frequency_mhz: self.usual_frequency_mhz(),
            lines: spec::DEFAULT_LINES,
            samples: spec::DEFAULT_SAMPLES,
            aperture: Aperture::default(),
        }
    }

    /// Place of the array.
    pub fn site(self) -> Site {
        self.facts().site
    }

    /// Length of a flat array that all scanlines share, mm: its diffraction widens the beam in proportion to depth.
    /// `None` where the active elements move with the scanline.
    pub fn shared_aperture_mm(self) -> Option<f64> {
        self.facts().shared_aperture_mm
    }

    /// Keys of the kind's own table.
    fn keys(self) -> Vec<&'static str> {
        (self.facts().keys)()
    }

    /// Description of the kind, and the schema of its keys.
    fn described(self) -> (String, Map<String, Value>) {
        let schema = (self.facts().schema)();
        let description = schema.get("description").and_then(Value::as_str);
        let properties = schema.get("properties").and_then(Value::as_object);
        (
            description.unwrap_or_default().to_owned(),
            properties.cloned().unwrap_or_default(),
        )
    }
}

impl ProbeShape {
    /// Scanlines along the radii of a circle: from a convex array, or of a phased array where the radius is 0.
    pub fn sector(radius_mm: f64, angle_deg: f64) -> Self {
        if radius_mm == 0.0 {
            Phased { angle_deg }.into()
        } else {
            Curvilinear { radius_mm, angle_deg }.into()
        }
    }
}

impl Probe {
    /// Creates a probe of a shape (or of a kind's table, such as [`Linear`]) with imaging depth `depth_mm`, the kind's
    /// usual frequency and the default grid of 256 scanlines by 512 samples.
    pub fn new(shape: impl Into<ProbeShape>, depth_mm: f64) -> Result<Self, TrackingError> {
        let shape = shape.into();
        let probe = Self {
            shape,
            depth_mm,
            frequency_mhz: shape.kind().usual_frequency_mhz(),
            lines: spec::DEFAULT_LINES,
            samples: spec::DEFAULT_SAMPLES,
            aperture: Aperture::default(),
        };
        probe.validate()?;
        Ok(probe)
    }

    /// The table of a file that states kind, shape and depth.
    pub fn shape_and_depth(&self) -> ProbeSpec {
        ProbeSpec {
            kind: Some(self.shape.kind()),
            shape: self.shape.numbers(),
            sampling: Sampling {
                depth_mm: Some(self.depth_mm),
                ..Sampling::default()
            },
            aperture: Aperture::default(),
        }
    }

    /// Checks every number against its documented range. One scanline and one sample are allowed; a sector without
    /// angle or depth is not.
    pub fn validate(&self) -> Result<(), TrackingError> {
        self.shape.check()?;
        in_ranges("probe", &ProbeSpec::from(*self).sampling)?;
        in_ranges("probe", &self.aperture)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// One probe of each kind, with few scanlines so that a complete grid is quickly traversed.
    pub(crate) fn one_of_each() -> Vec<Probe> {
        let probes = ProbeShape::EXAMPLES.map(|(_, shape)| Probe {
            shape,
            depth_mm: 80.0,
            frequency_mhz: 5.0,
            lines: 33,
            samples: 40,
            aperture: Aperture::default(),
        });
        probes.to_vec()
    }

    #[test]
    fn the_usual_probe_of_every_kind_is_one() {
        for &kind in ProbeKind::ALL {
            let usual = kind.usual();
            assert!(usual.validate().is_ok(), "{kind}");
            assert_eq!(usual.shape.kind(), kind);
            let table = ProbeSpec {
                kind: Some(kind),
                ..ProbeSpec::default()
            };
            let (filled, taken) = table.filled_from(&usual.shape_and_depth());
            assert_eq!(Probe::try_from(filled).ok(), Some(usual), "{kind}");
            assert!(taken.contains(&format!("depth_mm = {}", usual.depth_mm)), "{taken:?}");
        }
    }

    #[test]
    fn degenerate_sectors_are_refused_by_key() {
        let good = one_of_each()[1];
        let curved = |radius_mm, angle_deg| Probe {
            shape: ProbeShape::Curvilinear(Curvilinear { radius_mm, angle_deg }),
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
