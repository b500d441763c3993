//! Probe table of a scene file: flat, so that an unknown key is an error on its own line.

use std::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Probe, ProbeShape};
use crate::TrackingError;
use insonify_base::range::parameters;

/// Default number of scanlines.
pub(super) const DEFAULT_LINES: u32 = 256;
/// Default number of samples along a scanline.
pub(super) const DEFAULT_SAMPLES: u32 = 512;

/// Kind of probe.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ProbeKind {
    /// Straight array, parallel scanlines; takes `width_mm`.
    Linear,
    /// Convex array; takes `radius_mm` and `angle_deg`.
    Curvilinear,
    /// Fan from one point; takes `angle_deg`.
    Phased,
    /// Transrectal ring around the probe's axis; takes `radius_mm` and `angle_deg`.
    TrusTransverse,
    /// Transrectal straight array along the probe's side; takes `length_mm`.
    TrusSagittal,
}

impl ProbeKind {
    /// A centre frequency common for the kind, MHz: low for deep abdominal and cardiac probes, high for surface and
    /// transrectal ones.
    pub fn usual_frequency_mhz(self) -> f64 {
        match self {
            Self::Linear => 9.0,
            Self::Curvilinear => 3.5,
            Self::Phased => 2.5,
            Self::TrusTransverse | Self::TrusSagittal => 7.0,
        }
    }

    /// Whether the probe images from inside the rectum.
    pub fn is_transrectal(self) -> bool {
        matches!(self, Self::TrusTransverse | Self::TrusSagittal)
    }
}

impl fmt::Display for ProbeKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Linear => "linear",
            Self::Curvilinear => "curvilinear",
            Self::Phased => "phased",
            Self::TrusTransverse => "trus-transverse",
            Self::TrusSagittal => "trus-sagittal",
        })
    }
}

/// Placement of the pixels of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum GridSpec {
    /// The complete sector in `width` by `height` square pixels.
    #[default]
    Fitted,
    /// The pixels of the recording that moves the probe, by its size (or that in its PLUS configuration) and its
    /// calibration.
    Recorded,
}

parameters! {
    /// Pixels of the frame.
    #[derive(Copy)]
    pub struct ImageSpec {
        /// Placement of the pixels. Default `fitted`.
        grid: GridSpec;
        /// Columns. With `recorded`, `width` and `height` are those of the recording, without `margin`.
        width: u32 = 640, in 1..=16384;
        /// Rows.
        height: u32 = 480, in 1..=16384;
        /// Fraction of the image left free on each side of the sector.
        margin: f64 = 0.02, in 0..=0.45;
        /// Grey level outside the sector (0 to 255). Default 0.
        fill: u8;
    }
}

parameters! {
    /// A probe as written in a file; `Probe::try_from` validates it.
    #[derive(Copy)]
    pub struct ProbeSpec {
        /// Shape of the field of view. Required, unless the configuration of a tracked sequence states it.
        #[serde(skip_serializing_if = "Option::is_none")]
        kind: Option<ProbeKind>;
        /// Linear only: length of the array, mm.
        #[serde(skip_serializing_if = "Option::is_none")]
        width_mm: Option<f64>, in 1..=300;
        /// Curvilinear, and trus-transverse (at most 50): radius of the array, mm.
        #[serde(skip_serializing_if = "Option::is_none")]
        radius_mm: Option<f64>, in 2..=200;
        /// Curvilinear (at most 180), phased (at most 120) and trus-transverse: field of view, degrees.
        #[serde(skip_serializing_if = "Option::is_none")]
        angle_deg: Option<f64>, in 1..=270;
        /// Trus-sagittal only: length of the array, mm.
        #[serde(skip_serializing_if = "Option::is_none")]
        length_mm: Option<f64>, in 1..=300;
        /// Length of every scanline, mm. Required, unless the configuration of a tracked sequence states it.
        #[serde(skip_serializing_if = "Option::is_none")]
        depth_mm: Option<f64>, in 0.1..=1000;
        /// Centre frequency, MHz. Default: linear 9, curvilinear 3.5, phased 2.5, transrectal 7.
        #[serde(skip_serializing_if = "Option::is_none")]
        frequency_mhz: Option<f64>, in 0.1..=100;
        /// Number of scanlines. Default 256.
        #[serde(skip_serializing_if = "Option::is_none")]
        lines: Option<u32>, in 1..=8192;
        /// Number of samples along each scanline. Default 512.
        #[serde(skip_serializing_if = "Option::is_none")]
        samples: Option<u32>, in 1..=16384;
    }
}

impl ProbeSpec {
    /// Returns this table with open keys taken from another table, and those keys with their values.
    pub fn filled_from(mut self, other: &Self) -> (Self, Vec<String>) {
        fn fill<T: Copy + fmt::Display>(key: &str, open: &mut Option<T>, from: Option<T>, taken: &mut Vec<String>) {
            if let (None, Some(value)) = (&open, from) {
                taken.push(format!("{key} = {value}"));
                *open = from;
            }
        }
        let mut taken = Vec::new();
        fill("kind", &mut self.kind, other.kind, &mut taken);
        fill("width_mm", &mut self.width_mm, other.width_mm, &mut taken);
        fill("radius_mm", &mut self.radius_mm, other.radius_mm, &mut taken);
        fill("angle_deg", &mut self.angle_deg, other.angle_deg, &mut taken);
        fill("depth_mm", &mut self.depth_mm, other.depth_mm, &mut taken);
        fill("lines", &mut self.lines, other.lines, &mut taken);
        (self, taken)
    }

    fn shape(&self, kind: ProbeKind) -> Result<ProbeShape, TrackingError> {
        let needed = |key, value: Option<f64>| value.ok_or_else(|| missing(key, kind));
        let shape = match kind {
            ProbeKind::Linear => ProbeShape::Linear {
                width_mm: needed("width_mm", self.width_mm)?,
            },
            ProbeKind::Curvilinear => ProbeShape::Curvilinear {
                radius_mm: needed("radius_mm", self.radius_mm)?,
                angle_deg: needed("angle_deg", self.angle_deg)?,
            },
            ProbeKind::Phased => ProbeShape::Phased {
                angle_deg: needed("angle_deg", self.angle_deg)?,
            },
            ProbeKind::TrusTransverse => ProbeShape::TrusTransverse {
                radius_mm: needed("radius_mm", self.radius_mm)?,
                angle_deg: needed("angle_deg", self.angle_deg)?,
            },
            ProbeKind::TrusSagittal => ProbeShape::TrusSagittal {
                length_mm: needed("length_mm", self.length_mm)?,
            },
        };
        let used = Self::of_shape(&shape);
        let given = [
            ("width_mm", self.width_mm, used.width_mm),
            ("radius_mm", self.radius_mm, used.radius_mm),
            ("angle_deg", self.angle_deg, used.angle_deg),
            ("length_mm", self.length_mm, used.length_mm),
        ];
        match given.iter().find(|(_, given, used)| given.is_some() && used.is_none()) {
            Some(&(key, ..)) => {
                let text = format!("probe key `{key}` has no meaning for a {kind} probe; remove it");
                Err(TrackingError::at(key, text))
            }
            None => Ok(shape),
        }
    }

    fn of_shape(shape: &ProbeShape) -> Self {
        let mut spec = Self {
            kind: Some(shape.kind()),
            ..Self::default()
        };
        match *shape {
            ProbeShape::Linear { width_mm } => spec.width_mm = Some(width_mm),
            ProbeShape::Curvilinear { radius_mm, angle_deg } | ProbeShape::TrusTransverse { radius_mm, angle_deg } => {
                spec.radius_mm = Some(radius_mm);
                spec.angle_deg = Some(angle_deg);
            }
            ProbeShape::Phased { angle_deg } => spec.angle_deg = Some(angle_deg),
            ProbeShape::TrusSagittal { length_mm } => spec.length_mm = Some(length_mm),
        }
        spec
    }
}

fn missing(key: &'static str, kind: ProbeKind) -> TrackingError {
    TrackingError::at(key, format!("probe key `{key}` is missing; a {kind} probe needs it"))
}

impl TryFrom<ProbeSpec> for Probe {
    type Error = TrackingError;

    fn try_from(spec: ProbeSpec) -> Result<Self, TrackingError> {
        let kind = spec.kind.ok_or_else(|| {
            let expected = "expected linear, curvilinear, phased, trus-transverse or trus-sagittal";
            TrackingError::at("kind", format!("probe key `kind` is missing; {expected}"))
        })?;
        let probe = Self {
            shape: spec.shape(kind)?,
            depth_mm: spec.depth_mm.ok_or_else(|| missing("depth_mm", kind))?,
            frequency_mhz: spec.frequency_mhz.unwrap_or(kind.usual_frequency_mhz()),
            lines: spec.lines.unwrap_or(DEFAULT_LINES),
            samples: spec.samples.unwrap_or(DEFAULT_SAMPLES),
        };
        probe.validate()?;
        Ok(probe)
    }
}

impl From<Probe> for ProbeSpec {
    fn from(probe: Probe) -> Self {
        Self {
            depth_mm: Some(probe.depth_mm),
            frequency_mhz: Some(probe.frequency_mhz),
            lines: Some(probe.lines),
            samples: Some(probe.samples),
            ..Self::of_shape(&probe.shape)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::one_of_each;
    use super::*;

    #[test]
    fn every_kind_survives_toml_and_json() {
        for probe in one_of_each() {
            let text = toml::to_string(&probe).expect("toml");
            assert_eq!(toml::from_str::<Probe>(&text).expect("toml"), probe, "{text}");
            let text = serde_json::to_string(&probe).expect("json");
            assert_eq!(serde_json::from_str::<Probe>(&text).expect("json"), probe, "{text}");
            assert!(text.contains(&format!("\"{}\"", probe.shape.kind())), "{text}");
        }
    }

    #[test]
    fn a_short_table_takes_the_defaults_of_its_kind() {
        let probe: Probe = toml::from_str("kind = \"phased\"\nangle_deg = 80\ndepth_mm = 160").expect("probe");
        assert_eq!(
            (probe.lines, probe.samples, probe.frequency_mhz),
            (DEFAULT_LINES, DEFAULT_SAMPLES, 2.5)
        );
    }

    #[test]
    fn unknown_missing_and_superfluous_keys_are_named() {
        let cases = [
            ("kind = \"phased\"\nangle_deg = 80\ndepth_mm = 160\ndepht = 3", "depht"),
            (
                "kind = \"curvilinear\"\nangle_deg = 80\ndepth_mm = 160",
                "`radius_mm` is missing",
            ),
            (
                "kind = \"phased\"\nangle_deg = 80\ndepth_mm = 160\nwidth_mm = 3",
                "`width_mm` has no meaning for a phased probe",
            ),
            (
                "kind = \"phased\"\nangle_deg = 0\ndepth_mm = 160",
                "`angle_deg` is 0; expected 1 to 120",
            ),
            ("kind = \"sector\"\nangle_deg = 9\ndepth_mm = 160", "sector"),
            ("angle_deg = 9\ndepth_mm = 160", "`kind` is missing"),
            ("kind = \"phased\"\nangle_deg = 9", "`depth_mm` is missing"),
        ];
        for (text, message) in cases {
            let error = toml::from_str::<Probe>(text).expect_err(text).to_string();
            assert!(error.contains(message), "{error}");
        }
    }
}
