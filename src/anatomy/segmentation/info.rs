//! Summary of a segmentation, as text and JSON.

use std::fmt;
use std::path::Path;

use serde::Serialize;

use super::Segmentation;
use crate::acoustics::{Origin, Preset, TissueTable, fallback, known, presets};
use crate::volume::LabelVolume;
use insonify_base::note::Notes;
use insonify_base::text::{self, column};

/// Name of the background in listings.
const BACKGROUND: &str = "unlabelled";

/// Summary of a label volume.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SegmentationInfo {
    /// Path of the file, as given.
    pub file: String,
    /// Number of voxels along each index axis.
    pub size: [usize; 3],
    /// Distance between voxel centres along each index axis, mm.
    pub spacing_mm: [f64; 3],
    /// Anatomical direction of each index axis, one letter each: Left or Right, Posterior or Anterior, Superior or
    /// Inferior. `LPS` is the identity of the world frame.
    pub orientation: String,
    /// Centre of voxel (0, 0, 0) in LPS, mm.
    pub origin_mm: [f64; 3],
    /// Labels by ascending value after the background.
    pub labels: Vec<LabelInfo>,
    /// Sources of the names.
    pub notes: Notes,
    /// Assumptions and warnings of the reader.
    pub warnings: Vec<String>,
}

/// A label with its voxels and the tissue that it is taken for.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LabelInfo {
    /// Label value in the file.
    pub value: i64,
    /// Name; `unlabelled` for value 0 without a name, empty for others without one.
    pub name: String,
    /// Number of voxels, as stored.
    pub voxels: u64,
    /// Volume, ml.
    pub millilitres: f64,
    /// Tissue assigned by default.
    pub tissue: String,
    /// Evidence for the tissue: `name`, `class name`, `word`, a value of a numbering such as `BTCV value`, or
    /// `fallback`.
    pub from: String,
    /// Whether the evidence is a complete name.
    pub sure: bool,
}

impl SegmentationInfo {
    /// Creates the summary of a segmentation from `file`.
    pub fn new(segmentation: &Segmentation, file: &Path) -> Self {
        let volume = &segmentation.volume;
        let labels = (0..volume.labels().len()).map(|index| LabelInfo::new(segmentation, index));
        let origin = volume.index_to_world().fixed_view::<3, 1>(0, 3);
        let mut warnings = segmentation.warnings.clone();
        warnings.extend(
            TissueTable::resolve(volume.labels(), &[], Preset::Auto).map_or_else(|_| Vec::new(), |resolved| resolved.1),
        );
        Self {
            file: file.display().to_string(),
            size: volume.size(),
            spacing_mm: volume.spacing_mm(),
            orientation: orientation(volume),
            origin_mm: [origin[0], origin[1], origin[2]],
            labels: labels.collect(),
            notes: segmentation.notes.clone(),
            warnings,
        }
    }
}

impl LabelInfo {
    fn new(segmentation: &Segmentation, index: usize) -> Self {
        let volume = &segmentation.volume;
        let label = &volume.labels()[index];
        let named = label.name.as_deref().and_then(known);
        let (tissue, origin) = match (&segmentation.by_value, named) {
            _ if index == 0 => (&presets::all()[0], Origin::Name),
            (Some((preset, values)), named) if values.contains(&label.value) => {
                (named.map_or(fallback(), |(tissue, _)| tissue), Origin::Value(*preset))
            }
            (_, named) => named.unwrap_or((fallback(), Origin::Fallback)),
        };
        Self {
            value: label.value,
            name: match &label.name {
                Some(name) => name.clone(),
                None if label.value == 0 => BACKGROUND.to_owned(),
                None => String::new(),
            },
            voxels: label.voxels,
            millilitres: label.voxels as f64 * volume.voxel_mm3() / 1000.0,
            tissue: tissue.name.to_string(),
            from: origin.to_string(),
            sure: origin.is_sure(),
        }
    }
}

/// Assignment of index axes to world axes with the largest sum of direction cosines.
fn orientation(volume: &LabelVolume) -> String {
    const ASSIGNMENTS: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
    const LETTERS: [[char; 2]; 3] = [['L', 'R'], ['P', 'A'], ['S', 'I']];
    let spacing = volume.spacing_mm();
    let cosine = |world: usize, axis: usize| volume.index_to_world()[(world, axis)] / spacing[axis];
    let agreement = |assignment: &[usize; 3]| -> f64 { (0..3).map(|axis| cosine(assignment[axis], axis).abs()).sum() };
    let best = ASSIGNMENTS
        .iter()
        .copied()
        .reduce(|best, next| {
            if agreement(&next) > agreement(&best) {
                next
            } else {
                best
            }
        })
        .unwrap_or([0, 1, 2]);
    (0..3)
        .map(|axis| LETTERS[best[axis]][usize::from(cosine(best[axis], axis) < 0.0)])
        .collect()
}

impl fmt::Display for SegmentationInfo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, z] = self.size;
        let [dx, dy, dz] = self.spacing_mm;
        let [ox, oy, oz] = self.origin_mm;
        writeln!(f, "file         {}", text::clipped(&self.file, text::MESSAGE))?;
        writeln!(f, "size         {x} x {y} x {z} voxels")?;
        writeln!(f, "spacing      {dx:.4} x {dy:.4} x {dz:.4} mm")?;
        writeln!(
            f,
            "orientation  {} (directions the index axes run towards)",
            self.orientation
        )?;
        writeln!(f, "origin       {ox:.3}, {oy:.3}, {oz:.3} mm (LPS)")?;
        writeln!(f)?;
        let doubt = |label: &LabelInfo| if label.sure { "" } else { " ?" };
        let tissues: Vec<String> = self
            .labels
            .iter()
            .map(|label| format!("{}{}", label.tissue, doubt(label)))
            .collect();
        // Cells include their heading, so that the widest of both sets the width of a column.
        let names = column("name", self.labels.iter().map(|label| label.name.as_str()));
        let tissues = column("tissue", tissues.iter().map(String::as_str));
        let head = ["value", "voxels", "ml"];
        writeln!(
            f,
            "{:>6}  {}  {:>10}  {:>12}  {}  from",
            head[0], names[0], head[1], head[2], tissues[0]
        )?;
        for (index, label) in self.labels.iter().enumerate() {
            writeln!(
                f,
                "{:>6}  {}  {:>10}  {:>12.2}  {}  {}",
                label.value,
                names[index + 1],
                label.voxels,
                label.millilitres,
                tissues[index + 1],
                label.from
            )?;
        }
        for note in self.notes.iter() {
            writeln!(f, "note: {}", text::clipped(note, text::MESSAGE))?;
        }
        for warning in &self.warnings {
            writeln!(f, "warning: {}", text::clipped(warning, text::MESSAGE))?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix4;

    use super::*;
    use crate::volume::Label;

    #[test]
    fn axes_are_named_by_what_they_run_towards() {
        #[rustfmt::skip]
        let world = Matrix4::new(
            0.0, 0.1, -3.0, 10.0,
            2.0, 0.0, 0.0, 20.0,
            0.0, -1.0, 0.2, 30.0,
            0.0, 0.0, 0.0, 1.0,
        );
        let label = |value, voxels| Label {
            value,
            name: None,
            voxels,
        };
        let volume = LabelVolume::new([2, 1, 1], vec![0, 1], vec![label(0, 1), label(9, 1)], world).unwrap();
        let mut segmentation = Segmentation::from(volume.clone());
        segmentation.warnings.push("odd".to_owned());
        let info = SegmentationInfo::new(&segmentation, Path::new("a.nrrd"));
        assert_eq!(info.orientation, "PIR");
        assert_eq!(info.origin_mm, [10.0, 20.0, 30.0]);
        assert_eq!(
            (info.labels[0].name.as_str(), info.labels[1].name.as_str()),
            ("unlabelled", "")
        );
        assert!((info.labels[1].millilitres - volume.voxel_mm3() / 1000.0).abs() < 1e-12);
        let json = serde_json::to_value(&info).unwrap();
        assert_eq!(json["labels"][1]["value"], 9);
        let table = info.to_string();
        assert!(table.contains("2 x 1 x 1") && table.contains("warning: odd"), "{table}");
        assert!(
            table.contains("warning: no tissue known for label 9; taken as soft_tissue"),
            "{table}"
        );
    }
}
