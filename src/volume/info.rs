//! What a label volume holds, for people and for scripts.

use std::fmt;
use std::path::Path;

use serde::Serialize;

use super::LabelVolume;
use crate::text::{self, column};

/// Name of the background in listings.
const BACKGROUND: &str = "unlabelled";

/// A summary of a label volume.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Info {
    /// The file it came from, as it was named.
    pub file: String,
    /// Voxels along each index axis.
    pub size: [usize; 3],
    /// Distance between voxel centres along each index axis, mm.
    pub spacing_mm: [f64; 3],
    /// The direction of the body that each index axis runs towards, one letter each: Left or Right, Posterior or
    /// Anterior, Superior or Inferior. `LPS` is the identity of the world frame.
    pub orientation: String,
    /// Centre of voxel (0, 0, 0) in LPS, mm.
    pub origin_mm: [f64; 3],
    /// Labels by ascending value after the background.
    pub labels: Vec<LabelInfo>,
    /// What the reader had to assume or found odd.
    pub warnings: Vec<String>,
}

/// One label of an [`Info`].
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LabelInfo {
    /// Value in the file.
    pub value: i64,
    /// Name in the file; `unlabelled` for value 0 without a name, empty for others without one.
    pub name: String,
    /// Voxels that carry it, as stored.
    pub voxels: u64,
    /// Their volume, ml.
    pub millilitres: f64,
}

/// Summarises a volume that was read from `file` with these warnings.
pub fn describe(volume: &LabelVolume, file: &Path, warnings: &[String]) -> Info {
    let voxel_ml = volume.voxel_mm3() / 1000.0;
    let labels = volume
        .labels()
        .iter()
        .map(|label| LabelInfo {
            value: label.value,
            name: match &label.name {
                Some(name) => name.clone(),
                None if label.value == 0 => BACKGROUND.to_owned(),
                None => String::new(),
            },
            voxels: label.voxels,
            millilitres: label.voxels as f64 * voxel_ml,
        })
        .collect();
    let origin = volume.index_to_world().fixed_view::<3, 1>(0, 3);
    Info {
        file: file.display().to_string(),
        size: volume.size(),
        spacing_mm: volume.spacing_mm(),
        orientation: orientation(volume),
        origin_mm: [origin[0], origin[1], origin[2]],
        labels,
        warnings: warnings.to_vec(),
    }
}

/// The assignment of index axes to world axes whose direction cosines add up to most.
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

impl fmt::Display for Info {
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
        let names = column("name", self.labels.iter().map(|label| label.name.as_str()));
        writeln!(f, "{:>6}  {}  {:>10}  {:>12}", "value", names[0], "voxels", "ml")?;
        for (label, name) in self.labels.iter().zip(&names[1..]) {
            writeln!(
                f,
                "{:>6}  {name}  {:>10}  {:>12.2}",
                label.value, label.voxels, label.millilitres
            )?;
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

    use super::super::Label;
    use super::*;

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
        let info = describe(&volume, Path::new("a.nrrd"), &["odd".to_owned()]);
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
    }
}
