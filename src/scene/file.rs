//! The tables of a scene file, exactly as written: nothing is read, made or checked against anything else here.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::deform::DeformSpec;
use super::paths::{MotionSpec, NeedleTable};
use crate::document::{Source, Version};
use crate::effects::Effects;
use crate::phantom::Phantom;
use crate::quality::QualitySpec;
use crate::tissue::{Preset, TissueOverride};
use crate::tracking::matrix::Rows;
use crate::tracking::placement::ScanPlane;
use crate::tracking::pose::PoseSpec;
use crate::tracking::probe::ProbeSpec;
use crate::tracking::world::World;
use crate::volume::complete::Unlabelled;
use crate::volume::texture::{Seam, Values};

/// A scene file. Paths in it are relative to the folder that it lies in.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SceneFile {
    /// Version of the format: 1, which is the default.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub version: Option<Version>,
    /// Seed of everything random in a frame: speckle, noise, solid textures. Default 0.
    #[serde(default)]
    pub seed: u64,
    /// How long frames, and steps of an insertion, may take: what the scene leaves open is picked from what it costs on this
    /// machine. Without it what is open has its defaults.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub quality: Option<QualitySpec>,
    /// What is imaged.
    #[schemars(required)]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub volume: Option<VolumeSpec>,
    /// The transducer. Default: what the PLUS configuration of a recording says; the one that suits the phantom; for a file a
    /// curvilinear one of 60 mm and 70 degrees, 150 mm deep.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub probe: Option<ProbeSpec>,
    /// Where the probe stays. Default: the phantom's own pose, or on the skin over the largest soft organ.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pose: Option<PoseTable>,
    /// How the probe moves, and how many frames are made of it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub motion: Option<MotionSpec>,
    /// A needle. Without it no needle is simulated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub needle: Option<NeedleTable>,
    /// A deformation of the tissue. Without it no mesh is made.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub deform: Option<DeformSpec>,
    /// The frame's pixels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub image: Option<ImageSpec>,
    /// Tissues that differ from the built-in ones.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub tissue: Vec<TissueOverride>,
    /// Solid textures from files.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub texture: Vec<TextureSpec>,
    /// The effects. Without any `[effects]` table the usual ones act with their defaults; with one, exactly those that it
    /// names, and `[effects]` alone leaves slicing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub effects: Option<Effects>,
    /// The text that it was read from, for errors that point into it.
    #[serde(skip)]
    pub(super) source: Option<Arc<Source>>,
}

impl SceneFile {
    /// The scene of a label file or folder of masks alone: the body completed, tissues by name or value, the probe on the skin
    /// over the largest soft organ, the usual effects.
    pub fn for_labels(path: &Path) -> Self {
        Self {
            version: Some(Version),
            volume: Some(VolumeSpec {
                file: Some(path.to_owned()),
                ..VolumeSpec::default()
            }),
            ..Self::default()
        }
    }
}

/// What is imaged: exactly one of `phantom` and `file`. It may lie anywhere in the world, with probe, needle and deformation in the
/// same coordinates: where a coordinate of its centre exceeds 4096 mm, all of it is synthesised about the nearest whole metres.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct VolumeSpec {
    /// A volume made from code.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub phantom: Option<Phantom>,
    /// Phantom only: edge of a voxel, mm (0.3 to 5). Default: the phantom's own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub resolution_mm: Option<f64>,
    /// Phantom only: seed of its uneven surfaces, vessels and gas. Default 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
    /// A label file (NIfTI, NRRD or MetaImage), or a folder of binary masks named by their files. NIfTI holds its place in single precision, in steps of 0.008 mm at 1e5 mm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file: Option<PathBuf>,
    /// File only: a table of label names: CSV with columns `value` and `name`, a colour table of 3D Slicer, label descriptions
    /// of ITK-SNAP. Default: the file of the same name that ends in .csv, beside labels without names.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub names: Option<PathBuf>,
    /// File only: what unlabelled voxels are taken for. Default `auto`: a body is closed around the labelled anatomy unless
    /// the labels describe one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unlabelled: Option<Unlabelled>,
    /// File only: the CT that the labels were made from (NIfTI, NRRD or MetaImage, Hounsfield units). What is unlabelled in the body is then gas, fat,
    /// muscle, soft tissue or bone by its grey value, gas in the bowel is gas, and vessels of the liver are drawn that contrast agent shows.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ct: Option<PathBuf>,
    /// File only: whether structures are drawn into organs that are labelled in one piece: veins of liver and spleen, sinus and pyramids of kidneys, chambers
    /// of the heart, fat around the kidneys and in soft tissue. They are imaged; meshes and needles know the organs alone. Default true.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub structures: Option<bool>,
    /// File only: thickness of the muscle that `auto` adds under the fat, mm (0 to 100). Default 8.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub muscle_mm: Option<f64>,
    /// File only: thickness of the fat that `auto` adds, mm (0 to 100). Default 12.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fat_mm: Option<f64>,
    /// File only: thickness of the skin that `auto` adds, mm (0 to 100). Default 2.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub skin_mm: Option<f64>,
    /// How labels without a `[[tissue]]` find theirs. Default `auto`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub preset: Option<Preset>,
}

/// Where the probe stays: a pose, or a target over which it is placed. Turns apply to either, and to the default pose.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PoseTable {
    /// What the probe is placed over: the name of a label, a tissue or a TotalSegmentator class, a part of one such as
    /// `kidney` (the largest label that has it counts), or a label value.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub target: Option<String>,
    /// Orientation of the scan plane of a probe that is placed. Default: the one that shows more.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub plane: Option<ScanPlane>,
    /// Axes of the world that the pose is stated in: `lps` (default), or `ras` as in 3D Slicer.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub world: Option<World>,
    /// Centre of the array in the world, mm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub position_mm: Option<[f64; 3]>,
    /// Where the probe looks in the world; any length.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub direction: Option<[f64; 3]>,
    /// Hint for the side of the marker in the world. Default: the patient's left, or the feet where the probe looks along
    /// the left-right axis.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lateral: Option<[f64; 3]>,
    /// Probe-to-world transform, mm: rigid.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub matrix: Option<Rows>,
    /// Turn about the axial direction, degrees. Default 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rotate_deg: Option<f64>,
    /// Turn within the image plane, degrees. Default 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rock_deg: Option<f64>,
    /// Turn out of the image plane, degrees. Default 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tilt_deg: Option<f64>,
}

impl PoseTable {
    /// The keys that make a pose, in LPS.
    pub fn pose(&self) -> PoseSpec {
        PoseSpec {
            position_mm: self.position_mm,
            direction: self.direction,
            lateral: self.lateral,
            rotate_deg: self.rotate_deg,
            rock_deg: self.rock_deg,
            tilt_deg: self.tilt_deg,
            matrix: self.matrix,
        }
        .in_lps(self.world.unwrap_or_default())
    }

    /// Whether it says where the probe is, rather than how a place found otherwise is changed.
    pub fn is_explicit(&self) -> bool {
        self.position_mm.is_some() || self.direction.is_some() || self.lateral.is_some() || self.matrix.is_some()
    }
}

/// Where the pixels of a frame lie.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum GridSpec {
    /// The whole sector in `width` by `height` square pixels.
    #[default]
    Fitted,
    /// Pixel for pixel those of the recording that moves the probe, by its size (or that in its PLUS configuration) and its
    /// calibration.
    Recorded,
}

/// The frame's pixels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ImageSpec {
    /// Where the pixels lie. Default `fitted`.
    pub grid: GridSpec,
    /// Columns (1 to 16384). Default 640; with `recorded` what the recording has, as `height`, and no `margin`.
    pub width: u32,
    /// Rows (1 to 16384). Default 480.
    pub height: u32,
    /// Share of the image left free on each side of the sector (0 to 0.45). Default 0.02.
    pub margin: f64,
    /// Grey level outside the sector (0 to 255). Default 0.
    pub fill: u8,
}

impl Default for ImageSpec {
    fn default() -> Self {
        Self {
            grid: GridSpec::Fitted,
            width: 640,
            height: 480,
            margin: 0.02,
            fill: 0,
        }
    }
}

/// A solid texture from a file, for tissues to name.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TextureSpec {
    /// The name by which tissues call for it; one of the built-in bank's replaces that texture.
    pub name: String,
    /// A three-dimensional grey file: NIfTI, NRRD or MetaImage.
    pub file: PathBuf,
    /// Distance between voxel centres along each axis, mm, above 0. Default: what the file says.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spacing_mm: Option<[f64; 3]>,
    /// What the voxels mean. Default `amplitude`.
    #[serde(default)]
    pub values: Values,
    /// How the ends are joined. Default: the end of each axis fades into its beginning over a fifth of it.
    #[serde(default)]
    pub seam: Seam,
}
