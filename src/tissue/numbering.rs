//! Organ numberings of public data sets.

use super::{Preset, totalsegmentator};

/// Labels of BTCV, 1 to 13, by the names of TotalSegmentator's classes (B. Landman et al., MICCAI Multi-Atlas Labeling
/// Beyond the Cranial Vault, 2015, Synapse syn3193805).
const BTCV: &[&str] = &[
    "spleen",
    "kidney_right",
    "kidney_left",
    "gallbladder",
    "esophagus",
    "liver",
    "stomach",
    "aorta",
    "inferior_vena_cava",
    "portal_vein_and_splenic_vein",
    "pancreas",
    "adrenal_gland_right",
    "adrenal_gland_left",
];

/// Labels of AMOS, 1 to 15, by the names of TotalSegmentator's classes (Y. Ji et al., AMOS: A Large-Scale Abdominal
/// Multi-Organ Benchmark, NeurIPS 2022, `dataset.json`).
const AMOS: &[&str] = &[
    "spleen",
    "kidney_right",
    "kidney_left",
    "gallbladder",
    "esophagus",
    "liver",
    "stomach",
    "aorta",
    "inferior_vena_cava",
    "pancreas",
    "adrenal_gland_right",
    "adrenal_gland_left",
    "duodenum",
    "urinary_bladder",
    "prostate_or_uterus",
];

impl Preset {
    /// Presets that name labels by their values, the most common first.
    pub const NUMBERINGS: [Self; 3] = [Self::TotalSegmentator, Self::Btcv, Self::Amos];

    /// Organ of a label value; `None` for a value that the preset does not know.
    pub fn organ(self, value: i64) -> Option<&'static str> {
        let listed = |list: &[&'static str]| list.get(usize::try_from(value).ok()?.checked_sub(1)?).copied();
        match self {
            Self::TotalSegmentator => totalsegmentator::by_value(value).map(|class| class.name),
            Self::Btcv => listed(BTCV),
            Self::Amos => listed(AMOS),
            Self::Auto | Self::Phantom | Self::None => None,
        }
    }

    /// Name of the data set of the numbering, or of the preset.
    pub fn title(self) -> &'static str {
        match self {
            Self::TotalSegmentator => "TotalSegmentator",
            Self::Btcv => "BTCV",
            Self::Amos => "AMOS",
            Self::Auto => "auto",
            Self::Phantom => "phantom",
            Self::None => "none",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::TissueTable;
    use super::*;
    use crate::volume::Label;

    #[test]
    fn organs_are_those_of_the_published_tables_and_have_tissues() {
        let organs = |preset: Preset, values: [i64; 5]| values.map(|value| preset.organ(value).unwrap_or("-"));
        let common = ["spleen", "kidney_right"];
        assert_eq!(
            organs(Preset::TotalSegmentator, [1, 2, 5, 13, 118]),
            [common[0], common[1], "liver", "lung_middle_lobe_right", "-"]
        );
        assert_eq!(
            organs(Preset::Btcv, [1, 2, 6, 13, 14]),
            [common[0], common[1], "liver", "adrenal_gland_left", "-"]
        );
        assert_eq!(
            organs(Preset::Amos, [1, 6, 10, 13, 15]),
            [common[0], "liver", "pancreas", "duodenum", "prostate_or_uterus"]
        );
        for preset in [Preset::Btcv, Preset::Amos] {
            assert_eq!(organs(preset, [-1, 0, 16, i64::MIN, i64::MAX]), ["-"; 5]);
            let label = |value| Label {
                value,
                name: preset.organ(value).map(str::to_owned),
                voxels: 1,
            };
            let labels: Vec<Label> = (0..=15)
                .take_while(|&v| v == 0 || preset.organ(v).is_some())
                .map(label)
                .collect();
            let (_, warnings) = TissueTable::resolve(&labels, &[], preset).unwrap();
            assert!(warnings.is_empty(), "{warnings:?}");
        }
    }
}
