//! Serde types of a scene file, as written: no files are read and nothing is validated here.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::deform::DeformSpec;
use super::paths::{MotionSpec, NeedleTable};
use super::vary::Randomise;
use crate::effects::{EffectsTable, Scanner};
use crate::quality::QualitySpec;
use insonify_anatomy::acoustics::{Preset, TissueOverride};
use insonify_anatomy::phantom::Phantom;
use insonify_anatomy::volume::complete::Unlabelled;
use insonify_anatomy::volume::texture::{Seam, Values};
use insonify_base::document::{self, Source};
use insonify_base::range::{Kind, parameters};
use insonify_tracking::placement::ScanPlane;
use insonify_tracking::pose::{PoseSpec, pose_table};
use insonify_tracking::probe::{ImageSpec, ProbeSpec};
use insonify_tracking::world::World;

/// Version of scenes and scenarios.
pub type Version = document::Version<2>;

/// A scene file. Paths are relative to the folder of the file.
/// ```
/// use insonify_anatomy::phantom::Phantom;
/// use insonify_imaging::scene::SceneFile;
///
/// let text = "seed = 3\nvolume = { phantom = \"two-layer\", resolution_mm = 4.0 }\n";
/// let mut file = SceneFile::parse(text, "scene.toml")?;
/// file.image.get_or_insert_default().width = 320;
/// if let Some(volume) = &mut file.volume {
///     volume.phantom = Some(Phantom::LiverVein);
/// }
/// let scene = file.resolve(".".as_ref())?;
/// assert_eq!((scene.settings.seed, scene.settings.image.width), (3, 320));
///
/// // A number out of range is told with its line.
/// let coarse = SceneFile::parse(&text.replace("4.0", "40.0"), "scene.toml");
/// let error = coarse.and_then(|file| file.resolve(".".as_ref())).unwrap_err();
/// assert_eq!(error.location(), Some(("scene.toml", 2)));
/// # Ok::<(), insonify_base::document::InputError>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SceneFile {
    /// Version of the format: 1 or 2, which is the default. With 1, `[effects]` leaves out all effects that it does not
    /// name.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub version: Option<Version>,
    /// Seed of all random numbers of a frame: speckle, noise and, by its lower 32 bits, solid textures. Default 0.
    #[serde(default)]
    pub seed: u64,
    /// Time budgets of frames and steps of an insertion: settings left open are chosen by their measured cost on this
    /// machine. Without it, open keys have their defaults.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub quality: Option<QualitySpec>,
    /// Imaged volume. Default: the abdomen phantom.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub volume: Option<VolumeSpec>,
    /// Transducer. Default: that of a recording's PLUS configuration; or the one that suits the phantom; for a file a
    /// curvilinear one of 60 mm and 70 degrees, 150 mm deep.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub probe: Option<ProbeSpec>,
    /// Constant pose of the probe. Default: the phantom's own pose, or on the skin over the largest soft organ.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pose: Option<PoseTable>,
    /// Motion of the probe, and the number of frames.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub motion: Option<MotionSpec>,
    /// Needle. Without it no needle is simulated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub needle: Option<NeedleTable>,
    /// Deformation of the tissue. Without it no mesh is made.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub deform: Option<DeformSpec>,
    /// Pixels of the frame.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub image: Option<ImageSpec>,
    /// Tissues that differ from the built-in ones.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub tissue: Vec<TissueOverride>,
    /// Solid textures from files.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub texture: Vec<TextureSpec>,
    /// Processing by the scanner, which decides on the usual effects. Default: `clinical` with a curvilinear or
    /// linear probe; `raw` with others, with `version = 1`, and where `effects.only` lists the effects.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scanner: Option<Scanner>,
    /// Changes of the usual effects.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub effects: Option<EffectsTable>,
    /// Ranges that parameters of frames are drawn from: each frame is then a scene of its own, with a seed of its own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub randomise: Option<Randomise>,
    /// Whether a mesh of which the file says nothing will deform the tissue, as in a scenario: a probe that is placed
    /// is then not pressed in.
    #[serde(skip)]
    pub gets_mesh: bool,
    /// Source text, for errors that point into it.
    #[serde(skip)]
    pub(super) source: Option<Arc<Source>>,
}

document::input_file!(SceneFile, in_ranges);

impl SceneFile {
    /// Whether the text of the file has a key such as `motion`, whatever is set in it.
    pub fn states(&self, path: &str) -> bool {
        self.source.as_ref().is_some_and(|source| source.states(path))
    }

    /// Default scene for a label file or folder of masks: the body completed, tissues by name or value, the probe on
    /// the skin over the largest soft organ, the usual effects.
    pub fn for_labels(path: &Path) -> Self {
        Self {
            version: Some(Version::NEWEST),
            volume: Some(VolumeSpec {
                file: Some(path.to_owned()),
                ..VolumeSpec::default()
            }),
            ..Self::default()
        }
    }
}

parameters! {
    /// Imaged volume: one of `phantom` and `file`, or the abdomen phantom. It may lie anywhere in the world, with
    /// probe, needle and deformation in the same coordinates: if a coordinate of its centre exceeds 4096 mm, synthesis
    /// uses a local origin at the nearest whole metres.
    pub struct VolumeSpec by VolumeKind {
        /// A volume generated from code.
        #[serde(skip_serializing_if = "Option::is_none")]
        phantom: Option<Phantom>;
        /// Voxel edge of a phantom, 0.3 mm or more, or of closed surfaces. Default: the phantom's own; of surfaces at
        /// most 1 mm.
        #[serde(skip_serializing_if = "Option::is_none")]
        resolution_mm: Option<f64>, for Phantom | File | Ct, in 0.01..=5 "mm";
        /// Seed of irregular surfaces, vessels and gas. Default 0.
        #[serde(skip_serializing_if = "Option::is_none")]
        seed: Option<u64>, for Phantom;
        /// Label file, or folder of binary masks or of closed surfaces named by their files (formats:
        /// `insonify info --help`). NIfTI stores its position in single precision, in steps of 0.008 mm at 1e5 mm.
        #[serde(skip_serializing_if = "Option::is_none")]
        file: Option<PathBuf>;
        /// Table of label names: CSV with columns `value` and `name`, a colour table of 3D Slicer or FreeSurfer, label
        /// descriptions of ITK-SNAP, `dataset.json` of nnU-Net. Default: for labels without names, the file of the same
        /// stem that ends in .csv, .tsv or .ctbl, or `dataset.json` beside it or, if the folder is `labelsTr` or the
        /// like, above it.
        #[serde(skip_serializing_if = "Option::is_none")]
        names: Option<PathBuf>, for File | Ct;
        /// Treatment of unlabelled voxels. Default `auto`: a body is closed around the labelled anatomy unless the
        /// labels describe one.
        #[serde(skip_serializing_if = "Option::is_none")]
        unlabelled: Option<Unlabelled>, for File;
        /// Registration by `insonify register`, which places the completed anatomy in the world.
        #[serde(skip_serializing_if = "Option::is_none")]
        registration: Option<PathBuf>, for File | Ct;
        /// CT that the labels were made from, in Hounsfield units. Unlabelled voxels in the body are then gas, fat,
        /// muscle, soft tissue or bone by their grey value, gas in the bowel is gas, and contrast-enhanced vessels of
        /// the liver are drawn.
        #[serde(skip_serializing_if = "Option::is_none")]
        ct: Option<PathBuf>, for File | Ct;
        /// Whether structures are drawn into organs that are labelled in one piece: veins of liver and spleen, sinus
        /// and pyramids of kidneys, chambers of the heart, fat around the kidneys and in soft tissue. They are imaged
        /// only; meshes and needles use the undivided organs. Default true.
        #[serde(skip_serializing_if = "Option::is_none")]
        structures: Option<bool>, for File | Ct;
        /// Thickness of the muscle that `auto` adds under the fat. Default 8.
        #[serde(skip_serializing_if = "Option::is_none")]
        muscle_mm: Option<f64>, for File, in 0..=100 "mm";
        /// Thickness of the fat that `auto` adds. Default 12.
        #[serde(skip_serializing_if = "Option::is_none")]
        fat_mm: Option<f64>, for File, in 0..=100 "mm";
        /// Thickness of the skin that `auto` adds. Default 2.
        #[serde(skip_serializing_if = "Option::is_none")]
        skin_mm: Option<f64>, for File | Ct, in 0..=100 "mm";
        /// Numbering by which labels without a `[[tissue]]` are assigned tissues. Default `auto`.
        #[serde(skip_serializing_if = "Option::is_none")]
        preset: Option<Preset>;
    }
}

/// Kind of a volume.
#[derive(Clone, Copy, PartialEq, serde::Serialize)]
pub enum VolumeKind {
    /// Generated.
    Phantom,
    /// Labels alone.
    File,
    /// Labels, and the CT that says what surrounds them.
    Ct,
}

impl Kind for VolumeKind {
    fn stated_as(self) -> String {
        match self {
            Self::Phantom => "a phantom".to_owned(),
            Self::File => "`file` alone".to_owned(),
            Self::Ct => "`file` and `ct`".to_owned(),
        }
    }
}

impl VolumeSpec {
    /// Kind of the volume, if exactly one is stated.
    pub fn kind(&self) -> Option<VolumeKind> {
        match (&self.phantom, &self.file, &self.ct) {
            (Some(_), None, _) => Some(VolumeKind::Phantom),
            (None, Some(_), None) => Some(VolumeKind::File),
            (None, Some(_), Some(_)) => Some(VolumeKind::Ct),
            _ => None,
        }
    }
}

pose_table! {
    /// Constant pose of the probe: stated, or placed over a target. Rotations apply to either, and to the default pose.
    #[derive(Default)]
    pub struct PoseTable {
        /// Target under the probe: the name of a label, a tissue or a TotalSegmentator class, a part of one such as
        /// `kidney` (the largest matching label counts), or a label value. Beside a path in `[motion]` it is what the
        /// manifest of frames is to tell of.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        target: Option<String>;
        /// Orientation of the scan plane of an automatically placed probe. Default: the one that shows more.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        plane: Option<ScanPlane>;
        /// World axes of the pose: `lps` (default), or `ras` as in 3D Slicer.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        world: Option<World>;
    }
}

impl PoseTable {
    /// Returns the pose keys, in LPS.
    pub fn pose(&self) -> PoseSpec {
        PoseSpec::from(self).in_lps(self.world.unwrap_or_default())
    }

    /// Whether the table has a say in where the probe is, rather than only naming a target.
    pub(crate) fn places(&self) -> bool {
        let other = Self {
            target: None,
            ..self.clone()
        };
        other != Self::default()
    }

    /// Whether the table states the pose itself, rather than a change to a pose determined otherwise.
    pub(crate) fn is_explicit(&self) -> bool {
        self.position_mm.is_some() || self.direction.is_some() || self.lateral.is_some() || self.matrix.is_some()
    }
}

/// A solid texture from a file, referred to by tissues.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TextureSpec {
    /// Name of the texture; that of a built-in texture replaces it.
    pub name: String,
    /// Three-dimensional grey file.
    pub file: PathBuf,
    /// Distance between voxel centres along each axis, mm, above 0. Default: that of the file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spacing_mm: Option<[f64; 3]>,
    /// Meaning of the voxel values. Default `amplitude`.
    #[serde(default)]
    pub values: Values,
    /// Method for making the texture periodic. Default: the end of each axis fades into its beginning over a fifth
    /// of it.
    #[serde(default)]
    pub seam: Seam,
}
