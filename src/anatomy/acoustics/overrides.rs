//! `[[tissue]]` tables of a scene file: a preset, changed key by key, and the labels it applies to.

use std::borrow::Cow;

use super::RIGID_KPA;
use super::{Tissue, presets};
use insonify_base::blame::Blame;
use insonify_base::range::{Ranges, parameters};

parameters! {
    /// A `[[tissue]]` of a scene. Keys left open keep the value of the base preset: `like`, else the preset of the same
    /// name, else `soft_tissue`.
    #[derive(Default)]
    pub struct TissueOverride with required keys {
        /// Name, unique in the scene. The name of a preset changes that preset wherever it is used.
        name: String;
        /// The preset to start from.
        #[serde(skip_serializing_if = "Option::is_none")]
        like: Option<String>;
        /// Label values in the volume's file that have this tissue.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        labels: Vec<i64>;
        /// Label names in the volume's file that have this tissue; case, spaces and punctuation are ignored.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        label_names: Vec<String>;
        /// Colour in label maps, sRGB, 0 to 255 each.
        #[serde(skip_serializing_if = "Option::is_none")]
        colour: Option<[u8; 3]>;
        /// Name of a solid texture; `"none"` for a constant echo.
        #[serde(skip_serializing_if = "Option::is_none")]
        texture: Option<String>;
        /// Factor on the lengths in the texture.
        #[serde(skip_serializing_if = "Option::is_none")]
        texture_scale: Option<f64>, in 0.05..=20;
        /// World direction (LPS) of the texture's first axis: along muscle fibres, across layers of fat.
        #[serde(skip_serializing_if = "Option::is_none")]
        texture_direction: Option<[f64; 3]>;
        /// Mean echo amplitude relative to normal liver.
        #[serde(skip_serializing_if = "Option::is_none")]
        echogenicity_db: Option<f64>, in -100..=60 "dB";
        /// One-way attenuation.
        #[serde(skip_serializing_if = "Option::is_none")]
        attenuation_db_cm_mhz: Option<f64>, in 0..=50 "dB/cm/MHz";
        /// Fraction of the amplitude lost per millimetre in addition to attenuation.
        #[serde(skip_serializing_if = "Option::is_none")]
        occlusion_per_mm: Option<f64>, in 0..=1;
        /// Characteristic acoustic impedance.
        #[serde(skip_serializing_if = "Option::is_none")]
        impedance_mrayl: Option<f64>, in 0.0001..=10 "MRayl";
        /// Reflection coefficient of the capsule or wall around it; neighbours that both have one reflect by the
        /// difference.
        #[serde(skip_serializing_if = "Option::is_none")]
        capsule: Option<f64>, in 0..=1;
        /// Young's modulus.
        #[serde(skip_serializing_if = "Option::is_none")]
        young_kpa: Option<f64>, in 0.001..=1e8 "kPa";
        /// In place of `young_kpa`: shear modulus G, kPa. Young's modulus is 2 (1 + poisson) G.
        #[serde(skip_serializing_if = "Option::is_none")]
        shear_kpa: Option<f64>;
        /// Poisson's ratio.
        #[serde(skip_serializing_if = "Option::is_none")]
        poisson: Option<f64>, in 0..=0.4999;
        /// Friction of a needle shaft.
        #[serde(alias = "needle_friction_n_mm", skip_serializing_if = "Option::is_none")]
        friction_n_per_mm: Option<f64>, in 0..=10 "N/mm";
        /// Force to cut the tissue with a needle tip.
        #[serde(alias = "cutting_force_n", skip_serializing_if = "Option::is_none")]
        cutting_n: Option<f64>, in 0..=1000 "N";
        /// Whether a probe without a stated pose may be aimed at it.
        #[serde(skip_serializing_if = "Option::is_none")]
        soft_organ: Option<bool>;
    }
}

/// Why the tissues of a scene are invalid. All causes are user errors.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TissueError {
    /// A number is outside its range or not finite.
    #[error("tissue \"{tissue}\": {key} = {found}, expected {expected}")]
    Range {
        /// Name of the tissue.
        tissue: String,
        /// The key in the scene file.
        key: &'static str,
        /// Value found.
        found: String,
        /// Expected range.
        expected: String,
    },
    /// A table of tissues does not fit itself or its textures.
    #[error("the table of tissues: {0}")]
    Table(String),
    /// A tissue has no name.
    #[error("tissue {position} (counted from 1): name is empty, expected a name such as \"liver\"")]
    Unnamed {
        /// Position in the list, from 1.
        position: usize,
    },
    /// `like` does not name a preset.
    #[error(
        "tissue \"{tissue}\": like = \"{found}\" is no built-in tissue; expected one of {}",
        preset_names()
    )]
    UnknownBase {
        /// Name of the tissue.
        tissue: String,
        /// Name found.
        found: String,
    },
    /// Two tissues share a name.
    #[error("tissue \"{0}\" is defined twice; expected one [[tissue]] a name")]
    Duplicate(String),
    /// Two tissues claim the same label.
    #[error("label {label} is claimed by tissue \"{first}\" and by tissue \"{second}\"; expected one of them")]
    ClaimedTwice {
        /// The label, by value or name.
        label: String,
        /// Name of the first tissue.
        first: String,
        /// Name of the second tissue.
        second: String,
    },
}

impl Blame for TissueError {}

impl TissueError {
    /// Name of the tissue concerned, if it has one.
    pub fn tissue(&self) -> Option<&str> {
        match self {
            Self::Range { tissue, .. } | Self::UnknownBase { tissue, .. } => Some(tissue),
            Self::Duplicate(name) | Self::ClaimedTwice { second: name, .. } => Some(name),
            Self::Unnamed { .. } | Self::Table(_) => None,
        }
    }

    /// Key of the scene file concerned.
    pub fn key(&self) -> &'static str {
        match self {
            Self::Range { key, .. } => key,
            Self::UnknownBase { .. } => "like",
            Self::Duplicate(_) | Self::Unnamed { .. } => "name",
            Self::Table(_) => "tissue",
            Self::ClaimedTwice { .. } => "labels",
        }
    }
}

fn preset_names() -> String {
    let names: Vec<&str> = presets::all().iter().map(|tissue| tissue.name.as_ref()).collect();
    names.join(", ")
}

impl TissueOverride {
    /// Returns the resulting tissue.
    pub fn apply(&self) -> Result<Tissue, TissueError> {
        let base = match &self.like {
            Some(like) => presets::get(like).ok_or_else(|| TissueError::UnknownBase {
                tissue: self.name.clone(),
                found: like.clone(),
            })?,
            None => presets::get(&self.name).unwrap_or_else(super::resolve::fallback),
        };
        let texture = match self.texture.as_deref() {
            Some("none") => None,
            Some(name) => Some(Cow::Owned(name.to_owned())),
            None => base.texture.clone(),
        };
        let tissue = Tissue {
            name: Cow::Owned(self.name.clone()),
            colour: self.colour.unwrap_or(base.colour),
            texture,
            texture_scale: self.texture_scale.unwrap_or(base.texture_scale),
            texture_direction: self.texture_direction.or(base.texture_direction),
            echogenicity_db: self.echogenicity_db.unwrap_or(base.echogenicity_db),
            attenuation_db_cm_mhz: self.attenuation_db_cm_mhz.unwrap_or(base.attenuation_db_cm_mhz),
            occlusion_per_mm: self.occlusion_per_mm.unwrap_or(base.occlusion_per_mm),
            impedance_mrayl: self.impedance_mrayl.unwrap_or(base.impedance_mrayl),
            capsule: self.capsule.unwrap_or(base.capsule),
            // E = 2 (1 + nu) G with the ratio that this tissue ends up with: one written beside G counts.
            young_kpa: match self.shear_kpa {
                Some(shear) => 2.0 * (1.0 + self.poisson.unwrap_or(base.poisson)) * shear,
                None => self.young_kpa.unwrap_or(base.young_kpa),
            },
            poisson: self.poisson.unwrap_or(base.poisson),
            friction_n_per_mm: self.friction_n_per_mm.unwrap_or(base.friction_n_per_mm),
            cutting_n: self.cutting_n.unwrap_or(base.cutting_n),
            soft_organ: self.soft_organ.unwrap_or(base.soft_organ),
        };
        let of_shear = |found: String, expected: &str| TissueError::Range {
            tissue: self.name.clone(),
            key: "shear_kpa",
            found,
            expected: expected.to_owned(),
        };
        // A modulus out of range by `shear_kpa` must be blamed on that key, which was written.
        match (self.shear_kpa, check(&tissue, &self.name)) {
            (Some(shear), _) if self.young_kpa.is_some() => {
                Err(of_shear(format!("{shear} beside `young_kpa`"), "one of the two"))
            }
            (Some(shear), Err(TissueError::Range { key: "young_kpa", .. })) => {
                Err(of_shear(shear.to_string(), "2 (1 + poisson) times it 0.001 to 1e8 kPa"))
            }
            (_, checked) => checked.map(|()| tissue),
        }
    }
}

/// Attenuation above which one is doubted, dB/cm/MHz: of soft tissue, and of what is taken for bone, cartilage or gas.
const STRONG: [f64; 2] = [3.0, 20.0];

impl TissueOverride {
    /// Doubt about a stated attenuation that is not of the kind of tissue which it changes.
    pub fn doubt(&self, tissue: &Tissue) -> Option<String> {
        let stated = self.attenuation_db_cm_mhz?;
        let base = presets::get(self.like.as_deref().unwrap_or(&self.name)).unwrap_or_else(super::resolve::fallback);
        let is_hard = base.attenuation_db_cm_mhz > STRONG[0] || tissue.is_occluder() || tissue.young_kpa >= RIGID_KPA;
        let most = STRONG[usize::from(is_hard)];
        (stated > most).then(|| {
            format!(
                "tissue \"{}\": attenuation_db_cm_mhz = {stated} lets little sound through: tissue like {} has {}, and at most {most}",
                self.name, base.name, base.attenuation_db_cm_mhz
            )
        })
    }
}

/// Checks that every number of `tissue` is within its range; `name` is used in errors.
pub(super) fn check(tissue: &Tissue, name: &str) -> Result<(), TissueError> {
    let error = |key, found: String, expected| TissueError::Range {
        tissue: name.to_owned(),
        key,
        found,
        expected,
    };
    for (key, found) in [
        ("texture_scale", tissue.texture_scale),
        ("echogenicity_db", tissue.echogenicity_db),
        ("attenuation_db_cm_mhz", tissue.attenuation_db_cm_mhz),
        ("occlusion_per_mm", tissue.occlusion_per_mm),
        ("impedance_mrayl", tissue.impedance_mrayl),
        ("capsule", tissue.capsule),
        ("young_kpa", tissue.young_kpa),
        ("poisson", tissue.poisson),
        ("friction_n_per_mm", tissue.friction_n_per_mm),
        ("cutting_n", tissue.cutting_n),
    ] {
        TissueOverride::check_number(key, found).map_err(|wrong| error(key, wrong.found, wrong.expected))?;
    }
    if let Some(direction) = tissue.texture_direction {
        let length = direction.iter().map(|x| x * x).sum::<f64>().sqrt();
        if !(length.is_finite() && length > 1e-9) {
            let expected = "three finite numbers, not all 0";
            return Err(error(
                "texture_direction",
                format!("{direction:?}"),
                expected.to_owned(),
            ));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> TissueOverride {
        toml::from_str(text).unwrap()
    }

    #[test]
    fn unwritten_keys_keep_the_base() {
        let bright = parse("name = \"liver\"\nechogenicity_db = 4.0").apply().unwrap();
        let liver = presets::get("liver").unwrap();
        assert_eq!(bright.echogenicity_db, 4.0);
        assert_eq!(
            Tissue {
                echogenicity_db: 0.0,
                ..bright
            },
            *liver
        );

        let haemangioma = parse("name = \"haemangioma\"\nlike = \"lesion\"\ntexture = \"none\"")
            .apply()
            .unwrap();
        assert_eq!(haemangioma.young_kpa, presets::get("lesion").unwrap().young_kpa);
        assert_eq!(haemangioma.texture, None);
        let unknown = parse("name = \"something\"").apply().unwrap();
        assert_eq!(
            unknown.echogenicity_db,
            presets::get("soft_tissue").unwrap().echogenicity_db
        );
    }

    #[test]
    fn a_shear_modulus_stands_for_youngs() {
        let liver = |keys: &str| parse(&format!("name = \"liver\"\n{keys}")).apply();
        let soft = liver("shear_kpa = 2.0\npoisson = 0.45").unwrap();
        assert_eq!((soft.young_kpa, soft.poisson), (5.8, 0.45));
        for (keys, words) in [
            (
                "shear_kpa = 2.0\nyoung_kpa = 5.0",
                "shear_kpa = 2 beside `young_kpa`, expected one of the two",
            ),
            ("shear_kpa = -1.0", "shear_kpa = -1, expected 2 (1 + poisson)"),
        ] {
            let error = liver(keys).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
    }

    #[test]
    fn unknown_keys_are_errors() {
        let error = toml::from_str::<TissueOverride>("name = \"liver\"\nechogenicity = 4.0").unwrap_err();
        assert!(error.to_string().contains("echogenicity"), "{error}");
    }

    #[test]
    fn every_number_is_checked_and_the_error_says_what_was_expected() {
        for (key, bad) in [
            ("texture_scale", "0.0"),
            ("texture_direction", "[0.0, 0.0, 0.0]"),
            ("texture_direction", "[nan, 0.0, 1.0]"),
            ("echogenicity_db", "61.0"),
            ("attenuation_db_cm_mhz", "-0.1"),
            ("occlusion_per_mm", "1.01"),
            ("impedance_mrayl", "nan"),
            ("young_kpa", "0.0"),
            ("poisson", "0.5"),
            ("friction_n_per_mm", "inf"),
            ("cutting_n", "-1.0"),
        ] {
            let error = parse(&format!("name = \"liver\"\n{key} = {bad}")).apply().unwrap_err();
            assert_eq!(error.key(), key);
            let text = error.to_string();
            assert!(text.contains("liver") && text.contains("expected"), "{text}");
        }
        let error = parse("name = \"x\"\nlike = \"livr\"").apply().unwrap_err();
        assert!(error.to_string().contains("livr") && error.to_string().contains("kidney_cortex"));
    }
}
