//! Completion of the body around segmented organs.
//!
//! On a grid of about [`GRID_MM`] the gaps between the labels are closed, first within each slice, then in all
//! directions, and the outline is smoothed. The unlabelled voxels inside it become soft tissue, with the muscle of the
//! body wall, a layer of fat and a skin around them. Few organs without bones do not form a trunk;
//! [`Completed::warning`] then says so. If the CT is available, unlabelled voxels are classified by its grey values
//! ([`with_ct`]).

mod ct;
mod outline;

use insonify_base::note::Note;
use nalgebra::Point3;

use super::{Label, LabelVolume, VolumeError};
use crate::acoustics::{known, numbering};
pub use ct::with_ct;
use insonify_base::parallel::{self, chunks_mut};
use insonify_base::random::noise::Noise;
use insonify_base::text::some_of;
use outline::Outline;

/// Spacing of the grid for the outline of the body, mm.
pub const GRID_MM: f64 = 3.0;
/// Radius of the closing that joins the labelled anatomy, mm.
pub(crate) const CLOSING_MM: f64 = 60.0;
/// Soft tissue added around the closed anatomy, mm: about the thickness of the abdominal wall.
pub(crate) const WALL_MM: f64 = 7.0;
/// Thickness of soft tissue around labels that extend beyond the smooth outline, mm.
pub const MIN_MM: f64 = 3.0;
/// Largest thickness of muscle, fat or skin, mm.
const THICKEST_MM: f64 = 100.0;

/// Names of the appended labels.
const LAYERS: [&str; 5] = ["soft_tissue", "muscle", "muscle_internal", "fat", "skin"];
/// Irregularity of muscle and fat: the largest relative deviation of their thickness, and the length over which it
/// varies, mm. Set by eye; the skin stays where an even layer would put it.
const UNEVEN: f64 = 0.35;
const UNEVEN_MM: f64 = 40.0;
/// Depths below the fat at which the middle one of three flat muscles begins and ends, as fractions of the thickness:
/// external oblique, internal oblique and transversus measure about 40, 25 and 35 % here.
const MIDDLE_MUSCLE: [f64; 2] = [0.4, 0.65];
/// Number of organs from which a body is closed around labels without bones and without a warning.
const ENOUGH_ORGANS: usize = 8;

/// Names that occur only in volumes with an explicit body.
const BODY_NAMES: [&str; 10] = [
    "skin",
    "fat",
    "subcutaneous_fat",
    "body",
    "body_trunc",
    "external",
    "patient",
    "phantom_top",
    "phantom_bottom",
    "phantom_inclusion",
];
/// Values of fat, soft tissue and skin, which mark an explicit body where labels have no names.
pub(super) const BODY_VALUES: [i64; 3] = [201, 202, 204];
/// Minimum fraction of the labelled voxels with these three values in a body.
const BODY_SHARE: f64 = 1.0 / 3.0;

/// Treatment of unlabelled voxels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Unlabelled {
    /// A body is closed around the labelled anatomy, unless the volume already has one.
    #[default]
    Auto,
    /// Nothing is filled. Unlabelled voxels neither echo nor attenuate, so that a probe off the skin images as
    /// through gel.
    Air,
    /// All unlabelled voxels become soft tissue.
    Tissue,
}

/// Options of the completion of a volume.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CompleteOptions {
    /// Treatment of unlabelled voxels.
    pub mode: Unlabelled,
    /// Thickness of the muscle under the fat, mm (0 to 100; default 8): the outermost unlabelled layer inside the fat.
    pub muscle_mm: f64,
    /// Thickness of the fat under the skin, mm (0 to 100; default 12).
    pub fat_mm: f64,
    /// Thickness of the skin, mm (0 to 100; default 2). Drawn at least one voxel thick, so that it is closed.
    pub skin_mm: f64,
}

impl Default for CompleteOptions {
    fn default() -> Self {
        Self {
            mode: Unlabelled::Auto,
            muscle_mm: 8.0,
            fat_mm: 12.0,
            skin_mm: 2.0,
        }
    }
}

impl CompleteOptions {
    fn check(&self) -> Result<(), VolumeError> {
        let layers = [
            ("muscle_mm", self.muscle_mm),
            ("fat_mm", self.fat_mm),
            ("skin_mm", self.skin_mm),
        ];
        for (key, thickness_mm) in layers {
            if !(0.0..=THICKEST_MM).contains(&thickness_mm) {
                let layer = key.trim_end_matches("_mm");
                let text = format!("{layer} thickness {thickness_mm} mm; expected 0 to {THICKEST_MM} mm");
                return Err(VolumeError::option(key, text));
            }
        }
        Ok(())
    }
}

/// Numbers of filled voxels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Filled {
    /// Voxels filled as soft tissue.
    pub soft_tissue: u64,
    /// Voxels filled as muscle.
    pub muscle: u64,
    /// Voxels filled as fat.
    pub fat: u64,
    /// Voxels filled as skin.
    pub skin: u64,
}

/// A completed volume, with the changes made.
#[derive(Clone, Debug)]
pub struct Completed {
    /// Completed volume. Appended labels are named `soft_tissue`, `muscle`, `fat` and `skin`; their `voxels` stay 0,
    /// since the file had none.
    pub volume: LabelVolume,
    /// Numbers of filled voxels.
    #[cfg_attr(not(test), allow(dead_code, reason = "numbers for tests; the note tells them"))]
    pub filled: Filled,
    /// Assumptions made, for the user.
    pub note: Note,
    /// Warning about a body that was closed around fewer than 8 organs without bone or trunk.
    pub warning: Option<String>,
}

/// Minimum extent of a volume along an axis for closing a body around it, mm.
const SMALLEST_MM: f64 = 0.5;

/// Whether a volume has an explicit body: labels named skin, fat or body, or the values that `--save-labels` gives
/// them.
pub(crate) fn has_body(volume: &LabelVolume) -> bool {
    let mut names = volume.labels().iter().skip(1).filter_map(|label| label.name.as_deref());
    names.any(is_body) || has_body_values(volume)
}

/// Whether unnamed labels form a body by their values: 201, 202 and 204 (fat, soft tissue and skin), which together
/// have a third of the labelled voxels. Otherwise these values have another meaning.
pub(crate) fn has_body_values(volume: &LabelVolume) -> bool {
    let voxels = |value: i64| {
        let is_unnamed = |label: &&Label| label.value == value && label.name.is_none() && label.voxels > 0;
        volume.labels().iter().find(is_unnamed).map(|label| label.voxels)
    };
    let body: Option<u64> = BODY_VALUES.into_iter().map(voxels).sum();
    let labelled: u64 = volume.labels().iter().skip(1).map(|label| label.voxels).sum();
    body.is_some_and(|body| body as f64 >= BODY_SHARE * labelled as f64)
}

/// Whether a name occurs only in volumes with an explicit body.
pub fn is_body(name: &str) -> bool {
    BODY_NAMES.contains(&name.to_ascii_lowercase().replace([' ', '-'], "_").as_str())
}

/// Fills the unlabelled voxels of a volume as described in the module documentation. The box of the volume is
/// unchanged.
///
/// # Errors
/// [`VolumeError`] if a thickness is out of range, or the labels of the body exceed 256 labels.
pub fn complete(volume: &LabelVolume, options: &CompleteOptions) -> Result<Completed, VolumeError> {
    options.check()?;
    let unchanged = |note: &str| Completed {
        volume: volume.clone(),
        filled: Filled::default(),
        note: note.into(),
        warning: None,
    };
    match options.mode {
        Unlabelled::Air => {
            return Ok(unchanged(
                "unlabelled voxels stay empty, as asked: sound passes them without echo or loss, as gel",
            ));
        }
        Unlabelled::Tissue => return everywhere(volume),
        Unlabelled::Auto => {}
    }
    if has_body(volume) {
        return Ok(unchanged("the labels describe the whole body: nothing was filled"));
    }
    let spacing = volume.spacing_mm();
    if (0..3).any(|axis| spacing[axis] * (volume.size()[axis] as f64) < SMALLEST_MM) {
        return Ok(unchanged(
            "the volume is less than 0.5 mm thick: no body was closed around it",
        ));
    }
    let thinnest = spacing.iter().copied().fold(0.0, f64::max);
    let skin_mm = options.skin_mm.max(thinnest);
    let Some(outline) = Outline::around(volume, options.fat_mm + skin_mm) else {
        return Ok(unchanged("no voxel is labelled: nothing was filled"));
    };
    let mut labels = volume.labels().to_vec();
    let body = LAYERS.map(|name| label(&mut labels, name));
    VolumeError::check_labels(labels.len())?;
    let mut voxels = volume.voxels().to_vec();
    let counts = draw_layers(volume, &outline, options, skin_mm, &body, &mut voxels);
    let filled = Filled {
        soft_tissue: counts[0],
        muscle: counts[1] + counts[2],
        fat: counts[3],
        skin: counts[4],
    };
    let warning = shell(volume.labels());
    let [_, muscle, middle, ..] = body;
    // Muscle in one piece for meshes, as organs without structures: the layers are for images only.
    let undivided = voxels.iter().map(|&label| if label == middle { muscle } else { label });
    let undivided = LabelVolume::new(
        volume.size(),
        undivided.collect(),
        labels.clone(),
        *volume.index_to_world(),
    )?;
    let mut volume = LabelVolume::new(volume.size(), voxels, labels, *volume.index_to_world())?;
    volume.set_undivided(undivided);
    let note = note(&volume, options, skin_mm, &filled, &outline, &body);
    Ok(Completed {
        volume,
        filled,
        note,
        warning,
    })
}

/// Draws the layers of a body into the unlabelled voxels, and counts them.
fn draw_layers(
    volume: &LabelVolume,
    outline: &Outline,
    options: &CompleteOptions,
    skin_mm: f64,
    body: &[u8; 5],
    voxels: &mut [u8],
) -> [u64; 5] {
    let [nx, ny, _] = volume.size();
    let to_world = volume.index_to_world();
    let [fat_noise, muscle_noise] = [23, 24].map(|stream| Noise::new(0, stream, UNEVEN_MM));
    // Thickest muscle under the deepest fat: below it, in most of the body, noise need not be computed.
    let deepest = -(1.0 + UNEVEN) * options.muscle_mm - UNEVEN * options.fat_mm;
    let counts = parallel::map((0.., chunks_mut(voxels, nx)), &|(row, line)| {
        let mut count = [0u64; 5];
        let [j, k] = [row % ny, row / ny];
        let (mut fat_noise, mut muscle_noise) = (fat_noise.nearby(), muscle_noise.nearby());
        outline.along_row(j, k, line, |voxel, i, distance| {
            let layer = if distance <= deepest {
                0
            } else if distance > options.fat_mm + skin_mm {
                return;
            } else if distance > options.fat_mm {
                4
            } else {
                let point = to_world.transform_point(&Point3::new(i as f64, j as f64, k as f64));
                let below = UNEVEN * options.fat_mm * fat_noise.at(&point.coords) - distance;
                let thickness = options.muscle_mm * (1.0 + UNEVEN * muscle_noise.at(&point.coords));
                if below < 0.0 {
                    3
                } else if below >= thickness {
                    0
                } else if (MIDDLE_MUSCLE[0]..MIDDLE_MUSCLE[1]).contains(&(below / thickness)) {
                    2
                } else {
                    1
                }
            };
            *voxel = body[layer];
            count[layer] += 1;
        });
        count
    });
    let sum = |a: [u64; 5], b: [u64; 5]| [0, 1, 2, 3, 4].map(|i| a[i] + b[i]);
    counts.into_iter().fold([0; 5], sum)
}

/// Note about a body that was closed around labels.
fn note(
    volume: &LabelVolume,
    options: &CompleteOptions,
    skin_mm: f64,
    filled: &Filled,
    outline: &Outline,
    body: &[u8; 5],
) -> Note {
    let mut head = format!(
        "the body was closed around the labels, under {} mm of muscle, {} mm of fat and {skin_mm:.1} mm of skin",
        options.muscle_mm, options.fat_mm,
    );
    let mut details = format!(
        "unlabelled voxels: gaps of up to {} mm between the labels, and {WALL_MM} mm around them, were filled with soft tissue \
         ({} voxels) and some {} mm of muscle at its edge ({} voxels), all under some {} mm of fat ({} voxels) and {skin_mm:.1} mm of skin \
         ({} voxels); outside the skin voxels stay empty: sound passes them without echo or loss, as gel",
        2.0 * CLOSING_MM,
        filled.soft_tissue,
        options.muscle_mm,
        filled.muscle,
        options.fat_mm,
        filled.fat,
        filled.skin,
    );
    details.push_str(&unusual_values(volume.labels(), body));
    let faces = cut_faces(volume, outline.slice_axis(), body[4]);
    if !faces.is_empty() {
        head.push_str("; cut without skin at the volume's edge");
        details.push_str(&format!(
            "; the body reaches the edge of the volume ({}), where it is cut without skin",
            faces.join(", ")
        ));
    }
    Note::new(head, details)
}

/// Warning if the labels of a file, fewer than [`ENOUGH_ORGANS`] organs and no bone, are not surrounded by a trunk.
fn shell(labels: &[Label]) -> Option<String> {
    let occurring = || labels.iter().skip(1).filter(|label| label.voxels > 0);
    let tissues: Vec<_> = occurring().filter_map(|label| known(label.name.as_deref()?)).collect();
    let names: Vec<String> = occurring()
        .map(|label| label.name.clone().unwrap_or_else(|| label.value.to_string()))
        .collect();
    let is_trunk = tissues.len() >= ENOUGH_ORGANS || tissues.iter().any(|(tissue, _)| tissue.name == "bone");
    (!is_trunk && !names.is_empty()).then(|| {
        format!(
            "the body was closed around {} label{} ({}): a shell around {}, not anatomy; give a segmentation with vertebrae and \
             ribs, or no body: `unlabelled = \"air\"` under [volume], or `mesh make --no-complete`",
            names.len(),
            if names.len() == 1 { "" } else { "s" },
            some_of(&names),
            if names.len() == 1 { "it" } else { "them" },
        )
    })
}

/// Suffix of a note: values of the first of [`LAYERS`], at indices in `labels`, that differ from the usual ones.
fn unusual_values(labels: &[Label], body: &[u8]) -> String {
    let other = |(index, name): (&u8, &str)| {
        let (value, usual) = (labels[usize::from(*index)].value, usual_value(name));
        (value != usual).then(|| format!("{name} is label {value}, not {usual} as usual"))
    };
    let others: Vec<String> = body.iter().zip(LAYERS).filter_map(other).collect();
    if others.is_empty() {
        String::new()
    } else {
        format!("; beside the labels of the file {}", others.join(", "))
    }
}

/// Fills every unlabelled voxel as soft tissue.
fn everywhere(volume: &LabelVolume) -> Result<Completed, VolumeError> {
    let mut labels = volume.labels().to_vec();
    let soft = label(&mut labels, LAYERS[0]);
    VolumeError::check_labels(labels.len())?;
    let mut voxels = volume.voxels().to_vec();
    let counts = parallel::map(chunks_mut(&mut voxels, volume.size()[0]), &|row| {
        let unlabelled = row.iter_mut().filter(|voxel| **voxel == 0);
        unlabelled.map(|voxel| *voxel = soft).count() as u64
    });
    let soft_tissue = counts.into_iter().sum();
    let values = unusual_values(&labels, &[soft]);
    Ok(Completed {
        volume: LabelVolume::new(volume.size(), voxels, labels, *volume.index_to_world())?,
        filled: Filled {
            soft_tissue,
            ..Filled::default()
        },
        note: format!("unlabelled voxels are soft tissue, as asked ({soft_tissue} voxels){values}").into(),
        warning: None,
    })
}

/// Usual value of a body label, if it is free.
fn usual_value(name: &str) -> i64 {
    let mut body = numbering::body().iter();
    body.find(|class| class.name == name).map_or(0, |class| class.value)
}

/// Index of the label of a name, appended if missing: with its usual value, or the next free one.
pub(super) fn label(labels: &mut Vec<Label>, name: &str) -> u8 {
    if let Some(index) = labels.iter().position(|label| label.name.as_deref() == Some(name)) {
        return index as u8;
    }
    let is_used = |value: i64| labels.iter().any(|label| label.value == value);
    let usual = usual_value(name);
    let value = (usual..).find(|&value| !is_used(value)).unwrap_or(usual);
    labels.push(Label {
        value,
        name: Some(name.to_owned()),
        voxels: 0,
    });
    (labels.len() - 1) as u8
}

/// Faces of the box beside the slice axis that are touched by anything other than skin and air.
fn cut_faces(volume: &LabelVolume, slice_axis: usize, skin: u8) -> Vec<String> {
    let size = volume.size();
    let mut faces = Vec::new();
    for axis in (0..3).filter(|&axis| axis != slice_axis) {
        let [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
        for (end, which) in [(0, "low"), (size[axis] - 1, "high")] {
            let touched = (0..size[u] * size[v]).any(|pixel| {
                let mut index = [0; 3];
                (index[axis], index[u], index[v]) = (end, pixel % size[u], pixel / size[u]);
                let label = volume.voxels()[volume.offset(index)];
                label != 0 && label != skin
            });
            if touched {
                faces.push(format!("{which} {}", ["i", "j", "k"][axis]));
            }
        }
    }
    faces
}

#[cfg(test)]
pub(crate) mod tests;
