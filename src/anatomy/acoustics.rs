//! Tissue table: the tissue of each label, shared by imaging and mechanics.
//!
//! [`presets`] holds built-in tissues, [`TissueTable::resolve`] finds the tissue of each label of a volume, and
//! [`bank`] generates the solid textures that tissues name.

use std::borrow::Cow;
use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub mod bank;
pub(crate) mod numbering;
mod orientation;
pub(crate) mod overrides;
pub mod presets;
mod resolve;

pub use numbering::Preset;
pub use overrides::{TissueError, TissueOverride};
pub use resolve::{Origin, fallback, known};
pub(crate) use resolve::{Side, side, without_side};

/// Young's modulus from which a tissue is rigid by default, kPa.
pub const RIGID_KPA: f64 = 1e6;

/// Acoustic and mechanical properties of a tissue.
///
/// ```
/// use insonify_anatomy::acoustics::{Tissue, presets};
///
/// let liver = presets::get("liver").ok_or("no liver")?;
/// let steatosis = Tissue {
///     name: "fatty_liver".into(),
///     echogenicity_db: liver.echogenicity_db + 4.0,
///     attenuation_db_cm_mhz: 0.9,
///     ..liver.clone()
/// };
/// assert!(!steatosis.is_occluder() && presets::get("bone").is_some_and(Tissue::is_occluder));
/// # Ok::<(), &str>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Tissue {
    /// Name, unique in a table, in snake case.
    pub name: Cow<'static, str>,
    /// Colour in label maps, sRGB.
    pub colour: [u8; 3],
    /// Name of its solid texture in the bank; without one the echo is constant.
    pub texture: Option<Cow<'static, str>>,
    /// Factor on the lengths in the texture (0.05 to 20): 2 makes every structure twice as large.
    #[serde(default = "unscaled")]
    pub texture_scale: f64,
    /// Direction in the world (LPS, any non-zero length) along which the texture's first axis lies: along the fibres of
    /// muscle, across the layers of fat, fascia and skin. The second axis, which the lamellae of muscle face, is then
    /// as close as possible to the way inwards from the skin under the probe ([`TissueTable::inwards`]; antero-posterior
    /// without), apart from a small roll. Without a direction the texture has a fixed oblique orientation, so that its
    /// period does not show in planes along the world's axes.
    #[serde(default)]
    pub texture_direction: Option<[f64; 3]>,
    /// Mean echo amplitude, dB relative to normal liver parenchyma (-100 to 60).
    pub echogenicity_db: f64,
    /// One-way attenuation, dB/cm/MHz (0 to 50).
    pub attenuation_db_cm_mhz: f64,
    /// Fraction of the amplitude lost per millimetre in addition to attenuation, as in bone and gas (0 to 1).
    pub occlusion_per_mm: f64,
    /// Characteristic acoustic impedance, MRayl (0.0001 to 10).
    pub impedance_mrayl: f64,
    /// Reflection coefficient of the capsule or wall around the tissue (0 to 1), used where the impedance mismatch
    /// reflects less. Neighbours that both have one share it: the difference remains, so that a lesion in a liver has
    /// none and a vessel there a wall.
    #[serde(default)]
    pub capsule: f64,
    /// Young's modulus, kPa (0.001 to 1e8).
    pub young_kpa: f64,
    /// Poisson's ratio (0 to 0.4999).
    pub poisson: f64,
    /// Friction of a needle shaft in this tissue, N per mm of shaft (0 to 10).
    pub friction_n_per_mm: f64,
    /// Force to cut this tissue with a needle tip, N (0 to 1000).
    pub cutting_n: f64,
    /// Whether it is a solid organ at which a probe without a stated pose may be aimed.
    #[serde(default)]
    pub soft_organ: bool,
}

fn unscaled() -> f64 {
    1.0
}

/// Occlusion per millimetre above which a tissue counts as an obstacle: half of the amplitude is lost after about 3
/// mm.
const OCCLUDER_PER_MM: f64 = 0.2;

impl Tissue {
    /// Whether the tissue alone blocks the beam, as bone, gas and lung do.
    pub fn is_occluder(&self) -> bool {
        self.occlusion_per_mm >= OCCLUDER_PER_MM
    }
}

/// Acoustic and mechanical properties of the tissues of a scene, and for each label index (0 to 255, background 0) the
/// number of its tissue.
///
/// ```
/// use insonify_anatomy::acoustics::{TissueTable, presets};
///
/// let tissue = |name| presets::get(name).cloned().ok_or(name);
/// let table = TissueTable {
///     tissues: vec![tissue("background")?, tissue("liver")?, tissue("bone")?],
///     of_label: vec![0, 2, 1, 2],
///     ..TissueTable::default()
/// };
/// assert_eq!((&*table.tissue(2).name, &*table.tissue(3).name), ("liver", "bone"));
/// assert_eq!(table.tissue(200).name, "background");
/// assert!(table.textures().len() <= table.tissues.len());
/// # Ok::<(), &str>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TissueTable {
    /// Tissues; the first is that of label index 0, the background.
    pub tissues: Vec<Tissue>,
    /// Index into `tissues` for each label index of the volume.
    pub of_label: Vec<u8>,
    /// World direction across the layers of the body under the probe, from the skin inwards; that of the front and back
    /// of the trunk if `None`.
    pub inwards: Option<[f64; 3]>,
    /// World directions of label indices whose textures run along them, whatever the direction of their tissues.
    pub along: BTreeMap<u8, [f64; 3]>,
}

impl TissueTable {
    /// Tissue of a label index; that of the background if the index is past the end.
    pub fn tissue(&self, label_index: u8) -> &Tissue {
        let tissue = self.of_label.get(usize::from(label_index)).copied().unwrap_or(0);
        &self.tissues[usize::from(tissue)]
    }

    /// Checks that acoustic numbers are possible (a file has narrower ranges), indices for a volume of so many
    /// `labels`, background included, and names of textures; `textures` are those beside the bank.
    ///
    /// # Errors
    /// [`TissueError`] with the tissue, what was found and what was expected.
    pub fn check<'a>(&self, labels: usize, textures: impl IntoIterator<Item = &'a str>) -> Result<(), TissueError> {
        let count = self.tissues.len();
        if count == 0 {
            return Err(TissueError::Table(
                "no tissues; expected at least that of the background".to_owned(),
            ));
        }
        if let Some(label) = self.of_label.iter().position(|tissue| usize::from(*tissue) >= count) {
            let tissue = self.of_label[label];
            let wrong = format!("label index {label} has tissue {tissue} of {count}; expected one below {count}");
            return Err(TissueError::Table(wrong));
        }
        if self.of_label.len() < labels {
            let found = self.of_label.len();
            let wrong = format!("tissues of {found} label indices (`of_label`); expected those of {labels} labels");
            return Err(TissueError::Table(wrong));
        }
        for tissue in &self.tissues {
            let numbers = [
                ("attenuation_db_cm_mhz", tissue.attenuation_db_cm_mhz, 0.0, "0 or more"),
                ("occlusion_per_mm", tissue.occlusion_per_mm, 0.0, "0 or more"),
                (
                    "impedance_mrayl",
                    tissue.impedance_mrayl,
                    f64::MIN_POSITIVE,
                    "more than 0",
                ),
                // Of a tissue without echo it is below any number.
                ("echogenicity_db", tissue.echogenicity_db, f64::NEG_INFINITY, "a number"),
            ];
            for (key, number, least, expected) in numbers {
                if !(least..f64::INFINITY).contains(&number) {
                    return Err(TissueError::Range {
                        tissue: tissue.name.to_string(),
                        key,
                        found: number.to_string(),
                        expected: expected.to_owned(),
                    });
                }
            }
        }
        let mut known: Vec<&str> = bank::names().collect();
        known.extend(textures);
        match self.textures().into_iter().find(|name| !known.contains(name)) {
            Some(name) => Err(TissueError::Table(format!(
                "no texture is called \"{name}\"; expected one of {}",
                known.join(", ")
            ))),
            None => Ok(()),
        }
    }

    /// Names of the bank textures that the tissues use, each once, in the order of the tissues.
    pub fn textures(&self) -> Vec<&str> {
        let mut names: Vec<&str> = Vec::new();
        for name in self.tissues.iter().filter_map(|tissue| tissue.texture.as_deref()) {
            if !names.contains(&name) {
                names.push(name);
            }
        }
        names
    }
}
