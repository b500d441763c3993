//! Places of organs in an adult lying straight, a line each.

use crate::acoustics::{Side, side, without_side};
use nalgebra::Vector3;

/// Place of an organ.
struct Row {
    /// Name without a side, or of the left one of a pair.
    name: &'static str,
    /// To the left, back and head of a point in front of the spine between the first two lumbar vertebrae, mm; no height
    /// for organs of which scans show any length.
    left_mm: f64,
    back_mm: f64,
    up_mm: Option<f64>,
}

const fn at(name: &'static str, left_mm: f64, back_mm: f64, up_mm: f64) -> Row {
    Row {
        name,
        left_mm,
        back_mm,
        up_mm: Some(up_mm),
    }
}

const fn along(name: &'static str, left_mm: f64, back_mm: f64) -> Row {
    Row {
        name,
        left_mm,
        back_mm,
        up_mm: None,
    }
}

/// From the pelvis to the tenth thoracic vertebra, means of the segmentations of two adults, which differ by at most
/// 26 mm; above, estimates from the heights of vertebrae and the usual levels of organs. Places of ribs lie between
/// their middles and those of their lower parts, which scans of the abdomen have.
const PLACES: &[Row] = &[
    at("spleen", 104.0, 3.0, 56.0),
    at("kidney_left", 76.0, -7.0, -10.0),
    at("gallbladder", -60.0, -90.0, -9.0),
    at("liver", -58.0, -85.0, 43.0),
    at("stomach", 65.0, -75.0, 50.0),
    at("pancreas", 24.0, -68.0, 2.0),
    at("adrenal_gland_left", 41.0, -32.0, 35.0),
    at("lung_left", 72.0, -30.0, 180.0),
    at("lung_upper_lobe_left", 85.0, -70.0, 200.0),
    at("lung_lower_lobe_left", 80.0, 2.0, 140.0),
    at("lung_middle_lobe_left", 75.0, -105.0, 160.0),
    along("lung_vessels", 0.0, -30.0),
    along("lung_trachea_bronchia", 0.0, -30.0),
    along("esophagus", 10.0, -30.0),
    along("trachea", 0.0, -15.0),
    at("thyroid_gland", 0.0, -45.0, 330.0),
    at("small_bowel", 20.0, -81.0, -105.0),
    at("duodenum", -17.0, -68.0, -30.0),
    along("colon", 7.0, -76.0),
    at("urinary_bladder", -1.0, -52.0, -225.0),
    at("prostate", -1.0, -20.0, -272.0),
    at("prostate_or_uterus", -1.0, -20.0, -260.0),
    at("rectum", 0.0, 20.0, -215.0),
    at("sacrum", -4.0, 39.0, -169.0),
    at("vertebrae_s1", 0.0, 13.0, -147.0),
    at("vertebrae_l5", 0.0, -1.0, -122.0),
    at("vertebrae_l4", 0.0, -8.0, -90.0),
    at("vertebrae_l3", 0.0, -7.0, -54.0),
    at("vertebrae_l2", 0.0, -1.0, -19.0),
    at("vertebrae_l1", 0.0, 7.0, 16.0),
    at("vertebrae_t12", 0.0, 9.0, 51.0),
    at("vertebrae_t11", 0.0, 14.0, 83.0),
    at("vertebrae_t10", 0.0, 21.0, 110.0),
    at("vertebrae_t9", 0.0, 28.0, 136.0),
    at("vertebrae_t8", 0.0, 34.0, 161.0),
    at("vertebrae_t7", 0.0, 38.0, 185.0),
    at("vertebrae_t6", 0.0, 40.0, 208.0),
    at("vertebrae_t5", 0.0, 39.0, 230.0),
    at("vertebrae_t4", 0.0, 36.0, 251.0),
    at("vertebrae_t3", 0.0, 30.0, 272.0),
    at("vertebrae_t2", 0.0, 22.0, 292.0),
    at("vertebrae_t1", 0.0, 12.0, 311.0),
    at("vertebrae_c7", 0.0, 2.0, 328.0),
    at("vertebrae_c6", 0.0, -6.0, 343.0),
    at("vertebrae_c5", 0.0, -12.0, 357.0),
    at("vertebrae_c4", 0.0, -15.0, 371.0),
    at("vertebrae_c3", 0.0, -16.0, 386.0),
    at("vertebrae_c2", 0.0, -15.0, 406.0),
    at("vertebrae_c1", 0.0, -14.0, 422.0),
    along("vertebrae", 0.0, 10.0),
    along("intervertebral_discs", 0.0, 0.0),
    along("spinal_cord", 0.0, 18.0),
    at("heart", 25.0, -80.0, 165.0),
    at("superior_vena_cava", -30.0, -50.0, 225.0),
    at("pulmonary_vein", 5.0, -35.0, 195.0),
    at("pulmonary_artery", 5.0, -65.0, 205.0),
    at("atrial_appendage_left", 40.0, -80.0, 195.0),
    at("brachiocephalic_trunk", -10.0, -45.0, 275.0),
    at("brachiocephalic_vein_left", 27.0, -60.0, 275.0),
    at("subclavian_artery_left", 50.0, -25.0, 295.0),
    at("common_carotid_artery_left", 30.0, -35.0, 310.0),
    along("aorta", 15.0, -36.0),
    along("inferior_vena_cava", -18.0, -50.0),
    at("portal_vein_and_splenic_vein", 2.0, -68.0, 23.0),
    at("celiac_trunk", 8.0, -60.0, 30.0),
    at("hepatic_vessel", -50.0, -80.0, 45.0),
    at("iliac_artery_left", 40.0, -52.0, -176.0),
    at("iliac_vena_left", 41.0, -43.0, -186.0),
    along("femur_left", 106.0, -21.0),
    at("head_of_femur_left", 90.0, -25.0, -235.0),
    at("hip_left", 77.0, -10.0, -193.0),
    at("gluteus_maximus_left", 96.0, 42.0, -220.0),
    at("gluteus_medius_left", 126.0, -7.0, -176.0),
    at("gluteus_minimus_left", 119.0, -30.0, -200.0),
    along("autochthon_left", 36.0, 50.0),
    along("iliopsoas_left", 69.0, -33.0),
    at("rib_left_1", 45.0, -30.0, 300.0),
    at("rib_left_2", 70.0, -30.0, 275.0),
    at("rib_left_3", 90.0, -35.0, 245.0),
    at("rib_left_4", 105.0, -38.0, 215.0),
    at("rib_left_5", 115.0, -50.0, 185.0),
    at("rib_left_6", 118.0, -70.0, 150.0),
    at("rib_left_7", 126.0, -75.0, 115.0),
    at("rib_left_8", 134.0, -60.0, 88.0),
    at("rib_left_9", 138.0, -35.0, 68.0),
    at("rib_left_10", 128.0, 5.0, 50.0),
    at("rib_left_11", 100.0, 32.0, 32.0),
    at("rib_left_12", 64.0, 39.0, 21.0),
    at("scapula_left", 120.0, 45.0, 225.0),
    at("clavicula_left", 85.0, -60.0, 300.0),
    at("sternum", 3.0, -135.0, 180.0),
    at("costal_cartilages", 10.0, -132.0, 70.0),
    at("brain", 0.0, -5.0, 520.0),
    at("skull", 0.0, -15.0, 500.0),
];

/// Place of an organ in a body lying straight.
#[derive(Clone, Copy)]
pub(super) struct Place {
    /// To the left, back and head, mm.
    pub mm: Vector3<f64>,
    /// Whether the organ has no height, since scans show any length of it.
    pub any_height: bool,
}

impl Place {
    /// Place of the organ of a normalised name. Both of a pair lie about the middle.
    pub(super) fn of(plain_name: &str) -> Option<Self> {
        let (organ, organ_side) = match plain_name.strip_prefix("heart_") {
            Some(_) => ("heart".to_owned(), None),
            None => (without_side(plain_name), side(plain_name)),
        };
        let row = PLACES.iter().find(|row| without_side(row.name) == organ)?;
        let across = match (side(row.name), organ_side) {
            (None, _) | (_, Some(Side::Left)) => 1.0,
            (_, Some(Side::Right)) => -1.0,
            (Some(_), None) => 0.0,
        };
        Some(Self {
            mm: Vector3::new(across * row.left_mm, row.back_mm, row.up_mm.unwrap_or(0.0)),
            any_height: row.up_mm.is_none(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sides_mirror_a_place_and_a_pair_lies_in_the_middle() {
        let across = |name| Place::of(name).unwrap().mm.x;
        assert_eq!(
            [across("kidney_right"), across("kidney_left"), across("kidney")],
            [-76.0, 76.0, 0.0]
        );
        assert_eq!([across("liver"), across("heart_atrium_left")], [-58.0, 25.0]);
        assert!(Place::of("aorta").unwrap().any_height && Place::of("liver_tumor").is_none());
        for (index, row) in PLACES.iter().enumerate() {
            let bare = without_side(row.name);
            assert!(
                PLACES[..index].iter().all(|other| without_side(other.name) != bare),
                "{bare} twice"
            );
        }
    }
}
