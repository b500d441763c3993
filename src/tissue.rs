//! The tissue table: what each label is made of. One table serves imaging and mechanics.

use std::borrow::Cow;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What a tissue looks like to ultrasound and how it yields.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Tissue {
    /// Name, unique in a table, in snake case.
    pub name: Cow<'static, str>,
    /// Colour in label maps, sRGB.
    pub colour: [u8; 3],
    /// Name of its solid texture in the bank, if any; none means a constant echo.
    pub texture: Option<Cow<'static, str>>,
    /// Mean echo amplitude, dB relative to normal liver parenchyma (-100 to 60).
    pub echogenicity_db: f64,
    /// One-way attenuation, dB/cm/MHz (0 to 50).
    pub attenuation_db_cm_mhz: f64,
    /// Share of the amplitude that one millimetre of it takes away beyond attenuation, as bone and gas do (0 to 1).
    pub occlusion_per_mm: f64,
    /// Characteristic acoustic impedance, MRayl (0.0001 to 10).
    pub impedance_mrayl: f64,
    /// Young's modulus, kPa.
    pub young_kpa: f64,
    /// Poisson's ratio (0 to 0.4999).
    pub poisson: f64,
    /// Friction of a needle shaft against it, N per mm of shaft.
    pub needle_friction_n_mm: f64,
    /// Force to cut it with a needle tip, N.
    pub cutting_force_n: f64,
}

/// The tissues of a scene and which label index is made of which.
#[derive(Clone, Debug, PartialEq)]
pub struct TissueTable {
    /// The tissues; the first is the background.
    pub tissues: Vec<Tissue>,
    /// Index into `tissues` for each label index of the volume.
    pub of_label: Vec<u8>,
}
