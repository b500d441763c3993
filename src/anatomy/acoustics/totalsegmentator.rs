//! Classes of TotalSegmentator's `total` task (J. Wasserthal et al., Radiology: AI 5 (2023) e230024; class list of
//! version 2) and the tissue of each, with further values for the rest of the body.

use super::{Preset, Tissue, presets, totalsegmentator};

/// A class: its value in a label map, its name, and its tissue preset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Class {
    /// Value in a combined label map, 1 to 117, or 200 to 213 for body labels, which TotalSegmentator itself does not have.
    pub value: i64,
    /// Name as TotalSegmentator writes it.
    pub name: &'static str,
    /// Name of the preset in [`presets`].
    pub tissue: &'static str,
}

impl Class {
    /// Preset of the class, from [`presets::all`].
    pub(crate) fn preset(&self) -> Option<&'static Tissue> {
        presets::get(self.tissue)
    }

    /// Whether it is a solid organ that a probe may be aimed at.
    #[cfg(test)]
    fn is_soft_organ(&self) -> bool {
        self.preset().is_some_and(|tissue| tissue.soft_organ)
    }
}

/// Class of a value in a combined label map.
pub(crate) fn by_value(value: i64) -> Option<&'static Class> {
    CLASSES.iter().chain(BODY).find(|class| class.value == value)
}

/// Class of a name, exactly as TotalSegmentator writes it.
pub(crate) fn by_name(name: &str) -> Option<&'static Class> {
    CLASSES.iter().find(|class| class.name == name)
}

/// The 117 classes in the order of their values.
pub(crate) fn classes() -> &'static [Class] {
    CLASSES
}

/// Labels that fill the rest of a segmented body, from the grey values of the CT: gas below -300 HU, fat to -30 HU, soft
/// tissue to 150 HU, anything denser (unsegmented bone, calcification), and the outermost shell; the muscle added by
/// completion, and the structures drawn into organs.
pub(crate) fn body() -> &'static [Class] {
    BODY
}

const fn class(value: i64, name: &'static str, tissue: &'static str) -> Class {
    Class { value, name, tissue }
}

static BODY: &[Class] = &[
    class(200, "gas", "gas"),
    class(201, "fat", "fat"),
    class(202, "soft_tissue", "soft_tissue"),
    class(203, "dense", "bone"),
    class(204, "skin", "skin"),
    class(205, "muscle", "muscle"),
    class(206, "hepatic_vein", "hepatic_vein"),
    class(207, "portal_branch", "portal_branch"),
    class(208, "blood", "blood"),
    class(209, "renal_sinus", "renal_sinus"),
    class(210, "kidney_medulla", "kidney_medulla"),
    class(211, "peritoneal_fat", "peritoneal_fat"),
    class(212, "muscle_internal", "muscle_internal"),
    class(213, "splenic_vein", "splenic_vein"),
];

static CLASSES: &[Class] = &[
    class(1, "spleen", "spleen"),
    class(2, "kidney_right", "kidney_cortex"),
    class(3, "kidney_left", "kidney_cortex"),
    class(4, "gallbladder", "bile"),
    class(5, "liver", "liver"),
    class(6, "stomach", "bowel_content"),
    class(7, "pancreas", "pancreas"),
    class(8, "adrenal_gland_right", "adrenal"),
    class(9, "adrenal_gland_left", "adrenal"),
    class(10, "lung_upper_lobe_left", "lung"),
    class(11, "lung_lower_lobe_left", "lung"),
    class(12, "lung_upper_lobe_right", "lung"),
    class(13, "lung_middle_lobe_right", "lung"),
    class(14, "lung_lower_lobe_right", "lung"),
    class(15, "esophagus", "stomach_wall"),
    class(16, "trachea", "gas"),
    class(17, "thyroid_gland", "thyroid"),
    class(18, "small_bowel", "small_bowel"),
    class(19, "duodenum", "small_bowel"),
    class(20, "colon", "bowel_content"),
    class(21, "urinary_bladder", "urine"),
    class(22, "prostate", "prostate_central"),
    class(23, "kidney_cyst_left", "cyst"),
    class(24, "kidney_cyst_right", "cyst"),
    class(25, "sacrum", "bone"),
    class(26, "vertebrae_S1", "bone"),
    class(27, "vertebrae_L5", "bone"),
    class(28, "vertebrae_L4", "bone"),
    class(29, "vertebrae_L3", "bone"),
    class(30, "vertebrae_L2", "bone"),
    class(31, "vertebrae_L1", "bone"),
    class(32, "vertebrae_T12", "bone"),
    class(33, "vertebrae_T11", "bone"),
    class(34, "vertebrae_T10", "bone"),
    class(35, "vertebrae_T9", "bone"),
    class(36, "vertebrae_T8", "bone"),
    class(37, "vertebrae_T7", "bone"),
    class(38, "vertebrae_T6", "bone"),
    class(39, "vertebrae_T5", "bone"),
    class(40, "vertebrae_T4", "bone"),
    class(41, "vertebrae_T3", "bone"),
    class(42, "vertebrae_T2", "bone"),
    class(43, "vertebrae_T1", "bone"),
    class(44, "vertebrae_C7", "bone"),
    class(45, "vertebrae_C6", "bone"),
    class(46, "vertebrae_C5", "bone"),
    class(47, "vertebrae_C4", "bone"),
    class(48, "vertebrae_C3", "bone"),
    class(49, "vertebrae_C2", "bone"),
    class(50, "vertebrae_C1", "bone"),
    class(51, "heart", "heart"),
    class(52, "aorta", "vessel"),
    class(53, "pulmonary_vein", "vessel"),
    class(54, "brachiocephalic_trunk", "vessel"),
    class(55, "subclavian_artery_right", "vessel"),
    class(56, "subclavian_artery_left", "vessel"),
    class(57, "common_carotid_artery_right", "vessel"),
    class(58, "common_carotid_artery_left", "vessel"),
    class(59, "brachiocephalic_vein_left", "vessel"),
    class(60, "brachiocephalic_vein_right", "vessel"),
    class(61, "atrial_appendage_left", "vessel"),
    class(62, "superior_vena_cava", "vessel"),
    class(63, "inferior_vena_cava", "vessel"),
    class(64, "portal_vein_and_splenic_vein", "vessel"),
    class(65, "iliac_artery_left", "vessel"),
    class(66, "iliac_artery_right", "vessel"),
    class(67, "iliac_vena_left", "vessel"),
    class(68, "iliac_vena_right", "vessel"),
    class(69, "humerus_left", "bone"),
    class(70, "humerus_right", "bone"),
    class(71, "scapula_left", "bone"),
    class(72, "scapula_right", "bone"),
    class(73, "clavicula_left", "bone"),
    class(74, "clavicula_right", "bone"),
    class(75, "femur_left", "bone"),
    class(76, "femur_right", "bone"),
    class(77, "hip_left", "bone"),
    class(78, "hip_right", "bone"),
    class(79, "spinal_cord", "nerve"),
    class(80, "gluteus_maximus_left", "muscle"),
    class(81, "gluteus_maximus_right", "muscle"),
    class(82, "gluteus_medius_left", "muscle"),
    class(83, "gluteus_medius_right", "muscle"),
    class(84, "gluteus_minimus_left", "muscle"),
    class(85, "gluteus_minimus_right", "muscle"),
    class(86, "autochthon_left", "muscle_paraspinal"),
    class(87, "autochthon_right", "muscle_paraspinal"),
    class(88, "iliopsoas_left", "muscle_paraspinal"),
    class(89, "iliopsoas_right", "muscle_paraspinal"),
    class(90, "brain", "brain"),
    class(91, "skull", "bone"),
    class(92, "rib_left_1", "bone"),
    class(93, "rib_left_2", "bone"),
    class(94, "rib_left_3", "bone"),
    class(95, "rib_left_4", "bone"),
    class(96, "rib_left_5", "bone"),
    class(97, "rib_left_6", "bone"),
    class(98, "rib_left_7", "bone"),
    class(99, "rib_left_8", "bone"),
    class(100, "rib_left_9", "bone"),
    class(101, "rib_left_10", "bone"),
    class(102, "rib_left_11", "bone"),
    class(103, "rib_left_12", "bone"),
    class(104, "rib_right_1", "bone"),
    class(105, "rib_right_2", "bone"),
    class(106, "rib_right_3", "bone"),
    class(107, "rib_right_4", "bone"),
    class(108, "rib_right_5", "bone"),
    class(109, "rib_right_6", "bone"),
    class(110, "rib_right_7", "bone"),
    class(111, "rib_right_8", "bone"),
    class(112, "rib_right_9", "bone"),
    class(113, "rib_right_10", "bone"),
    class(114, "rib_right_11", "bone"),
    class(115, "rib_right_12", "bone"),
    class(116, "sternum", "bone"),
    class(117, "costal_cartilages", "cartilage"),
];

// Organ numberings of public data sets.

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
    pub(crate) const NUMBERINGS: [Self; 3] = [Self::TotalSegmentator, Self::Btcv, Self::Amos];

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
    fn classes_equal_the_published_list() {
        let text = include_str!("../../../tests/data/totalsegmentator_total_classes.csv");
        let listed: Vec<(i64, &str)> = text
            .lines()
            .skip(1)
            .filter_map(|line| line.split_once(','))
            .map(|(value, name)| (value.parse().unwrap(), name))
            .collect();
        let ours: Vec<(i64, &str)> = CLASSES.iter().map(|class| (class.value, class.name)).collect();
        assert_eq!(ours, listed);
    }

    #[test]
    fn every_class_has_a_preset_and_values_are_unbroken() {
        for (class, value) in CLASSES.iter().zip(1..=117).chain(BODY.iter().zip(200..=213)) {
            assert_eq!(class.value, value);
            assert!(class.preset().is_some(), "{}: {}", class.name, class.tissue);
        }
        assert_eq!((CLASSES.len(), BODY.len()), (117, 14));
    }

    #[test]
    fn organs_bones_and_gas_are_told_apart() {
        for name in ["liver", "spleen", "kidney_left", "pancreas", "prostate"] {
            assert!(by_name(name).unwrap().is_soft_organ(), "{name}");
        }
        for name in [
            "colon",
            "lung_upper_lobe_left",
            "autochthon_left",
            "urinary_bladder",
            "brain",
        ] {
            assert!(!by_name(name).unwrap().is_soft_organ(), "{name}");
        }
        for name in ["rib_left_1", "vertebrae_L5", "trachea", "skull", "hip_right"] {
            assert!(by_name(name).unwrap().preset().unwrap().is_occluder(), "{name}");
        }
    }

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
