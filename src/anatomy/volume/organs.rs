//! Organs behind labels that are not of the file: vessels and other structures of organs, gas that a CT shows,
//! the body that completion closes.

use super::complete::BODY_VALUES;
use super::{LabelVolume, VolumeError};
use crate::acoustics;
use insonify_base::document::plain;

/// Maximum number of labels.
const MAX_LABELS: usize = 256;

impl LabelVolume {
    /// Value in the file of the voxels that a label was drawn into, 0 for unlabelled ones; `None` for a label of the
    /// file.
    pub fn drawn_into(&self, label_index: usize) -> Option<i64> {
        self.drawn_into.get(label_index).copied().flatten()
    }

    /// Value of a label in the file before anything was drawn.
    pub fn organ(&self, label_index: usize) -> i64 {
        let label = self.labels.get(label_index).map_or(0, |label| label.value);
        self.drawn_into(label_index).unwrap_or(label)
    }

    /// Whether the file itself holds a completed body, as `--save-labels` writes it: what lies behind the structures in it
    /// is not known.
    pub fn is_of_saved_body(&self) -> bool {
        let is_of_file = |index: usize| self.labels[index].voxels > 0 && self.drawn_into(index).is_none();
        let holds =
            |value: &i64| (1..self.labels.len()).any(|index| self.labels[index].value == *value && is_of_file(index));
        BODY_VALUES.iter().all(holds)
    }

    /// Side of the patient, `left` or `right`, that the name of a label or of the organ that it was drawn into states.
    pub fn side(&self, label_index: usize) -> Option<&'static str> {
        let organ = self.organ(label_index);
        let of_file = |index: &usize| self.drawn_into(*index).is_none() && self.labels[*index].value == organ;
        let index = (0..self.labels.len()).find(of_file)?;
        let side = acoustics::side(&plain(self.labels[index].name.as_deref()?))?;
        Some(match side {
            acoustics::Side::Left => "left",
            acoustics::Side::Right => "right",
        })
    }

    /// The volume, which was drawn from `file`, with a label of its own for each organ that a label was drawn into: of
    /// the same value and name, so that label values stay what they are. Second, a warning if 256 labels do not
    /// suffice.
    ///
    /// # Errors
    /// Those of [`LabelVolume::new`].
    pub fn by_organ(self, file: &Self) -> Result<(Self, Option<String>), VolumeError> {
        let of_file = file.labels.len();
        let is_prefix = self.labels.len() >= of_file
            && (0..of_file).all(|index| self.labels[index].value == file.labels[index].value);
        if self.size != file.size || !is_prefix || (self.voxels == file.voxels && self.labels.len() == of_file) {
            return Ok((self, None));
        }
        let mut counts = vec![[0u64; MAX_LABELS]; MAX_LABELS];
        for (&label, &organ) in self.voxels.iter().zip(&*file.voxels) {
            counts[usize::from(label)][usize::from(organ)] += 1;
        }
        let mut labels = self.labels.clone();
        let mut drawn_into = vec![None; labels.len()];
        let mut index_of: Vec<[u8; MAX_LABELS]> = (0..=255).map(|label| [label; MAX_LABELS]).collect();
        let mut merged = Vec::new();
        for label in 0..self.labels.len() {
            let mut organs: Vec<usize> = (0..of_file).filter(|organ| counts[label][*organ] > 0).collect();
            // What the file labels so is no drawing; of the others the largest keeps the index.
            organs.retain(|organ| *organ != label);
            organs.sort_by_key(|organ| (std::cmp::Reverse(counts[label][*organ]), *organ));
            let mut organs = organs.into_iter().peekable();
            let is_of_file = label < of_file;
            if let Some(first) = organs.next_if(|_| !is_of_file) {
                drawn_into[label] = Some(file.labels[first].value);
            } else if !is_of_file {
                drawn_into[label] = Some(0);
            }
            for organ in organs {
                if labels.len() == MAX_LABELS {
                    merged.push(labels[label].value.to_string());
                    break;
                }
                index_of[label][organ] = labels.len() as u8;
                labels.push(super::Label {
                    voxels: 0,
                    ..labels[label].clone()
                });
                drawn_into.push(Some(file.labels[organ].value));
            }
        }
        let warning = (!merged.is_empty()).then(|| {
            format!(
                "256 labels do not suffice to tell organs apart: what was drawn with label {} belongs to several",
                merged.join(", ")
            )
        });
        let mut divided = if labels.len() == self.labels.len() {
            self
        } else {
            let voxels = self.voxels.iter().zip(&*file.voxels);
            let voxels = voxels.map(|(&label, &organ)| index_of[usize::from(label)][usize::from(organ)]);
            let divided = Self::new(self.size, voxels.collect(), labels, self.index_to_world)?;
            Self {
                undivided: self.undivided,
                ..divided
            }
        };
        divided.drawn_into = drawn_into;
        Ok((divided, warning))
    }

    /// Takes over what the labels of another volume, which are the same, were drawn into.
    pub(crate) fn with_organs_of(self, other: &Self) -> Self {
        Self {
            drawn_into: other.drawn_into.clone(),
            ..self
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix4;

    use super::super::Label;
    use super::*;

    fn volume(voxels: &[u8], names: &[&str]) -> LabelVolume {
        let label = |(index, name): (usize, &&str)| Label {
            value: 10 * index as i64,
            name: Some((*name).to_owned()),
            voxels: 1,
        };
        let labels = names.iter().enumerate().map(label).collect();
        LabelVolume::new([voxels.len(), 1, 1], voxels.to_vec(), labels, Matrix4::identity()).unwrap()
    }

    #[test]
    fn what_is_drawn_has_a_label_for_each_organ_and_keeps_its_value() {
        let names = ["background", "kidney_right", "kidney_left", "sinus", "fat", "gas"];
        let file = volume(&[0, 1, 1, 1, 2, 2, 0], &names[..3]);
        // A label of the file is drawn, too: into unlabelled voxels.
        let drawn = volume(&[4, 1, 3, 3, 3, 2, 2], &names);
        let (divided, warning) = drawn.by_organ(&file).unwrap();
        assert_eq!(warning, None);
        let values = |of: &dyn Fn(usize) -> i64| -> Vec<i64> {
            let voxels = divided.voxels().iter();
            voxels.map(|index| of(usize::from(*index))).collect()
        };
        assert_eq!(
            values(&|index| divided.labels()[index].value),
            [40, 10, 30, 30, 30, 20, 20]
        );
        assert_eq!(values(&|index| divided.organ(index)), [0, 10, 10, 10, 20, 20, 0]);
        let sides: Vec<_> = divided
            .voxels()
            .iter()
            .map(|index| divided.side(usize::from(*index)))
            .collect();
        let (left, right) = (Some("left"), Some("right"));
        assert_eq!(sides, [None, right, right, right, left, left, None]);
        // Not drawn at all, and of the file.
        assert_eq!((divided.drawn_into(5), divided.drawn_into(1)), (Some(0), None));
    }

    #[test]
    fn a_saved_body_is_told_from_one_that_was_drawn() {
        let mut saved = volume(&[1, 2, 3], &["background", "fat", "soft tissue", "skin"]);
        for (label, value) in saved.labels[1..].iter_mut().zip(BODY_VALUES) {
            (label.value, label.voxels) = (value, 1);
        }
        assert!(saved.is_of_saved_body());
        saved.drawn_into = vec![None, Some(0), Some(0), Some(0)];
        assert!(!saved.is_of_saved_body());
    }

    #[test]
    fn nothing_drawn_changes_nothing() {
        let file = volume(&[0, 1, 2], &["background", "a", "b"]);
        let (same, warning) = file.clone().by_organ(&file).unwrap();
        assert_eq!(
            (same.voxels(), same.labels(), warning),
            (file.voxels(), file.labels(), None)
        );
        assert_eq!([0, 1, 2].map(|index| same.organ(index)), [0, 10, 20]);
    }

    #[test]
    fn too_many_labels_are_told() {
        let names: Vec<String> = (0..200).map(|index| format!("organ {index}")).collect();
        let mut names: Vec<&str> = names.iter().map(String::as_str).collect();
        let voxels: Vec<u8> = (0..200).collect();
        let file = volume(&voxels, &names);
        names.push("gas");
        let (divided, warning) = volume(&[200; 200], &names).by_organ(&file).unwrap();
        assert_eq!(divided.labels().len(), 256);
        assert!(warning.is_some_and(|warning| warning.contains("label 2000 belongs to several")));
    }
}
