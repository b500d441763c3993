//! Sizes of organs: the plausible volumes and the largest heights, a line each.

/// An organ by its name without a side; numbered ones (vertebrae, ribs) by what they have in common.
pub(super) struct Organ {
    pub name: &'static str,
    /// Smallest and largest plausible volume, ml. No smallest one for what is scanned at any length.
    pub ml: [f64; 2],
    /// Volume in an adult, ml; 0 where volumes vary too much to be evidence.
    pub adult_ml: f64,
    /// Largest plausible extent from head to feet, mm.
    pub tallest_mm: f64,
}

/// An organ by the mass of a newborn's and of an adult man's, g (ICRP Publication 89, 2002, table 2.8; one of a pair;
/// hollow organs with their contents). Plausible are a third of the first to six times the second: empty organs and
/// large spleens are within them. Tissue weighs about 1 g/ml.
const fn solid(name: &'static str, newborn: f64, adult_ml: f64, tallest_mm: f64) -> Organ {
    Organ {
        name,
        ml: [newborn / 3.0, 6.0 * adult_ml],
        adult_ml,
        tallest_mm,
    }
}

/// An organ with a largest plausible volume only: at least twice that of the segmentations of adults tried.
const fn any(name: &'static str, most_ml: f64, tallest_mm: f64) -> Organ {
    Organ {
        name,
        ml: [0.0, most_ml],
        adult_ml: 0.0,
        tallest_mm,
    }
}

/// All organs; of others no size is implausible.
pub(super) const ORGANS: &[Organ] = &[
    solid("spleen", 9.5, 150.0, 300.0),
    solid("kidney", 12.5, 155.0, 190.0),
    solid("gallbladder", 3.3, 68.0, 160.0),
    solid("liver", 130.0, 1800.0, 400.0),
    solid("stomach", 47.0, 400.0, 400.0),
    solid("pancreas", 6.0, 140.0, 180.0),
    solid("adrenal_gland", 3.0, 7.0, 90.0),
    solid("esophagus", 2.0, 40.0, 400.0),
    solid("thyroid_gland", 1.3, 20.0, 150.0),
    solid("heart", 46.0, 840.0, 250.0),
    solid("brain", 380.0, 1450.0, 250.0),
    // The blood in all large arteries or all large veins of a man (6 and 18 % of 5.3 l, table 2.14).
    any("aorta", 318.0, 700.0),
    any("inferior_vena_cava", 954.0, 500.0),
    any("portal_vein_and_splenic_vein", 250.0, 250.0),
    any("iliac_artery", 150.0, 400.0),
    any("iliac_vena", 200.0, 400.0),
    any("kidney_cyst", 1500.0, 180.0),
    any("duodenum", 350.0, 180.0),
    any("urinary_bladder", 1500.0, 220.0),
    any("prostate", 300.0, 120.0),
    any("trachea", 150.0, 250.0),
    any("lung", 5000.0, 450.0),
    any("sacrum", 600.0, 250.0),
    any("vertebra", 200.0, 110.0),
    any("rib", 80.0, 300.0),
    any("spinal_cord", 200.0, 700.0),
    any("scapula", 400.0, 280.0),
    any("clavicula", 150.0, 150.0),
    any("sternum", 300.0, 300.0),
    any("liver_vessels", 500.0, 300.0),
    any("lung_vessels", 800.0, 400.0),
];
