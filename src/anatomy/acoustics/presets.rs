//! Built-in tissues.
//!
//! Sources of the numbers:
//!
//! - Attenuation at 1 MHz with a linear law, and impedance: T. L. Szabo, *Diagnostic Ultrasound Imaging: Inside Out*
//!   (2nd ed., 2014), appendix B; F. A. Duck, *Physical Properties of Tissues* (1990), chapter 4; S. A. Goss,
//!   R. L. Johnston and F. Dunn, JASA 64 (1978) 423; M. O. Culjat et al., Ultrasound Med. Biol. 36 (2010) 861, table 1;
//!   the IT'IS Foundation's tissue database, acoustic properties; impedance of lung: J. T. Bushberg et al., *The
//!   Essential Physics of Medical Imaging* (2nd ed., 2002), chapter 16. Muscles of the back are met across their fibres,
//!   where less is lost than along them (D. K. Nassiri et al., Ultrasonics 17 (1979) 230); 0.75 is by eye.
//! - Echogenicity: order and spacing after the backscatter coefficients in Szabo, appendix B, and Duck, section 4.4
//!   (blood some 25 dB and more below liver, fat and connective tissue above, muscle below across its fibres),
//!   rounded to the appearance of B-mode frames: in five of the liver the wall of the body is at least as bright as
//!   the liver, and the cortex of kidneys beside it has 0.45 to 0.7 of its grey. Fluids are near the floor of a 60 dB
//!   display: what is visible in them is clutter.
//! - Capsules and walls: no measurement available; 0.06 gives some 10 dB above liver at perpendicular incidence, as the
//!   capsules of liver and kidney show in clinical frames. A vessel in an organ has half of that, between the walls of
//!   portal branches, which have twice as much, and of hepatic veins, which have none. The middle one of the flat
//!   muscles carries the fasciae between them. The heart has its pericardium, the brightest line of clinical frames of
//!   hearts beside the lung, 22 dB above liver; its chambers differ from it by half.
//! - Parts of nerves, lymph nodes, and fat between muscles, whose strands of connective tissue bring its impedance near
//!   theirs: by eye, beside frames of a linear probe. The wall of an artery is brighter than that of a vein.
//! - Stiffness: T. A. Krouskop et al., Ultrasonic Imaging 20 (1998) 260 (prostate); P. N. T. Wells and H.-D. Liang, J.
//!   R. Soc. Interface 8 (2011) 1521 (soft organs, fat, muscle); Duck, chapter 5 (bone, cartilage, ligament, skin).
//!   Poisson's ratio represents near incompressibility: 0.49 for solid tissue, 0.495 for fluids, 0.3 for bone.
//! - Needle forces: A. M. Okamura, C. Simone and M. D. O'Leary, IEEE Trans. Biomed. Eng. 51 (2004) 1707, measured
//!   0.94 N of cutting force and some 0.02 N/mm of friction in bovine liver; the other tissues are scaled from it by
//!   stiffness and by perceived puncture resistance, and are meant to be replaced by a user's own measurements.
//! - Occlusion is not a material constant: it represents reflection at the surface and loss within. Bone removes six
//!   tenths in a millimetre beside what it attenuates, and echoes by its roughness, so that laminae and ribs have a bright
//!   cap of 1 to 3 mm (by eye, of frames of the lumbar spine); gas and lung as much or more.

use std::borrow::Cow;

use super::Tissue;

/// Returns the built-in tissue of that name.
pub fn get(name: &str) -> Option<&'static Tissue> {
    PRESETS.iter().find(|tissue| tissue.name == name)
}

/// Returns the built-in tissues; the first is the background, without echo, attenuation or resistance.
pub fn all() -> &'static [Tissue] {
    PRESETS
}

/// Direction across the layers of the front and back of the trunk: antero-posterior.
pub(super) const ACROSS_LAYERS: [f64; 3] = [0.06, 1.0, 0.08];
/// Fibre direction of the muscles of the abdominal wall, between the transverse and the oblique course.
const ABDOMINAL_FIBRES: [f64; 3] = [0.92, 0.08, 0.38];
/// Fibre direction of the internal oblique muscle, which crosses [`ABDOMINAL_FIBRES`].
const INTERNAL_FIBRES: [f64; 3] = [0.5, 0.06, -0.86];
/// Fibre direction of the muscles along the spine.
const PARASPINAL_FIBRES: [f64; 3] = [0.12, 0.1, 0.99];
/// Fibre direction of the muscles of limbs, along them.
const LIMB_FIBRES: [f64; 3] = [0.2, 0.15, 0.97];

/// Reflection coefficient of a capsule or a vessel's wall.
const CAPSULE: f64 = 0.06;

/// Creates a tissue: colour `0xRRGGBB`, texture ("" for none), acoustics (echo in dB, attenuation in dB/cm/MHz,
/// occlusion per mm, impedance in MRayl), mechanics (Young's modulus in kPa, Poisson's ratio, needle friction in N/mm,
/// cutting force in N).
const fn row(
    name: &'static str,
    colour: u32,
    texture: &'static str,
    acoustics: [f64; 4],
    mechanics: [f64; 4],
) -> Tissue {
    Tissue {
        name: Cow::Borrowed(name),
        colour: [(colour >> 16) as u8, (colour >> 8) as u8, colour as u8],
        texture: if texture.is_empty() {
            None
        } else {
            Some(Cow::Borrowed(texture))
        },
        texture_scale: 1.0,
        texture_direction: None,
        echogenicity_db: acoustics[0],
        attenuation_db_cm_mhz: acoustics[1],
        occlusion_per_mm: acoustics[2],
        impedance_mrayl: acoustics[3],
        capsule: 0.0,
        young_kpa: mechanics[0],
        poisson: mechanics[1],
        friction_n_per_mm: mechanics[2],
        cutting_n: mechanics[3],
        soft_organ: false,
    }
}

impl Tissue {
    const fn along(mut self, direction: [f64; 3]) -> Self {
        self.texture_direction = Some(direction);
        self
    }

    const fn scaled(mut self, scale: f64) -> Self {
        self.texture_scale = scale;
        self
    }

    const fn within(mut self, capsule: f64) -> Self {
        self.capsule = capsule;
        self
    }

    const fn organ(mut self) -> Self {
        self.soft_organ = true;
        self
    }
}

#[rustfmt::skip]
static PRESETS: &[Tissue] = &[
    //   name                     colour    texture                 echo    att   occl  Z         E       nu     frict  cut
    row("background",             0x000000, "",                    [-100.0, 0.0,  0.0,  1.54],   [1.0,    0.45,  0.0,   0.0]),
    row("air",                    0x101820, "",                    [-60.0,  1.6,  1.0,  0.0004], [0.1,    0.0,   0.0,   0.0]),
    row("gas",                    0x5a6a78, "gas",                 [12.0,   1.6,  0.75, 0.0004], [0.1,    0.0,   0.0,   0.0]),
    row("skin",                   0xe0b090, "skin",                [0.0,    1.8,  0.0,  1.99],   [100.0,  0.48,  0.04,  2.0]).along(ACROSS_LAYERS),
    row("fat",                    0xf2d36b, "fat",                 [1.0,    0.6,  0.0,  1.38],   [3.0,    0.49,  0.008, 0.3]).along(ACROSS_LAYERS),
    row("peritoneal_fat",         0xe6c25a, "fat",                 [3.0,    0.6,  0.0,  1.38],   [2.5,    0.49,  0.008, 0.3]).scaled(1.3),
    row("epidural_fat",           0xd8b44c, "fat",                 [4.0,    0.6,  0.0,  1.38],   [2.5,    0.49,  0.006, 0.2]).scaled(0.6),
    row("intermuscular_fat",      0xe0bc60, "fat",                 [1.0,    0.6,  0.0,  1.60],   [2.5,    0.49,  0.008, 0.3]).scaled(0.5),
    row("muscle",                 0xa8483c, "muscle",              [-1.0,   1.1,  0.0,  1.70],   [12.0,   0.49,  0.02,  0.9]).along(ABDOMINAL_FIBRES),
    row("muscle_paraspinal",      0x9a3f36, "muscle",              [-6.0,   0.75, 0.0,  1.70],   [14.0,   0.49,  0.02,  0.9]).along(PARASPINAL_FIBRES),
    row("muscle_internal",        0xb4564a, "muscle",              [-1.0,   1.1,  0.0,  1.70],   [12.0,   0.49,  0.02,  0.9]).along(INTERNAL_FIBRES).within(0.75 * CAPSULE),
    row("muscle_limb",            0xa04038, "muscle",              [-4.0,   1.1,  0.0,  1.70],   [12.0,   0.49,  0.02,  0.9]).along(LIMB_FIBRES),
    row("fascia",                 0xe8dcc8, "fascia",              [11.0,   1.57, 0.0,  1.81],   [300.0,  0.48,  0.06,  3.0]).along(ACROSS_LAYERS),
    row("ligament",               0xd8ccb0, "fascia",              [8.0,    2.5,  0.0,  1.84],   [500.0,  0.48,  0.08,  4.0]).along(ACROSS_LAYERS),
    row("capsule",                0xf0e6d8, "",                    [10.0,   1.57, 0.0,  1.80],   [100.0,  0.49,  0.04,  1.5]),
    row("diaphragm",              0xc87a68, "",                    [15.0,   1.1,  0.0,  1.75],   [30.0,   0.49,  0.02,  1.0]),
    row("bone",                   0xefe6c4, "",                    [16.0,   6.9,  0.6,  7.38],   [1.5e7,  0.3,   1.0,   100.0]),
    row("cartilage",              0xbcd0c8, "gel",                 [-6.0,   5.0,  0.03, 1.93],   [1.0e4,  0.46,  0.3,   10.0]),
    row("disc",                   0xa8bcc8, "gel",                 [-4.0,   2.0,  0.0,  1.70],   [1.0e3,  0.47,  0.2,   5.0]),
    row("lung",                   0xd8a0a8, "gas",                 [15.0,   4.3,  0.6,  0.18],   [2.0,    0.3,   0.005, 0.2]),
    row("liver",                  0x8a4030, "liver",               [0.0,    0.5,  0.0,  1.66],   [5.0,    0.49,  0.02,  0.94]).within(CAPSULE).organ(),
    row("lesion",                 0xb05a8c, "lesion",              [-9.0,   0.6,  0.0,  1.66],   [25.0,   0.49,  0.03,  1.3]).within(CAPSULE),
    row("vessel",                 0x3c50b4, "blood",               [-56.0,  0.2,  0.0,  1.66],   [1.0,    0.495, 0.0,   0.0]).within(1.5 * CAPSULE),
    row("hepatic_vein",           0x3448a0, "blood",               [-56.0,  0.2,  0.0,  1.66],   [1.0,    0.495, 0.0,   0.0]).within(CAPSULE),
    row("splenic_vein",           0x3c50a8, "blood",               [-56.0,  0.2,  0.0,  1.66],   [1.0,    0.495, 0.0,   0.0]).within(CAPSULE),
    row("portal_branch",          0x4c64cc, "blood",               [-56.0,  0.2,  0.0,  1.66],   [1.0,    0.495, 0.0,   0.0]).within(3.0 * CAPSULE),
    row("blood",                  0xb02848, "blood",               [-56.0,  0.2,  0.0,  1.66],   [1.0,    0.495, 0.0,   0.0]).within(2.0 * CAPSULE),
    row("artery",                 0xc83040, "blood",               [-56.0,  0.2,  0.0,  1.66],   [1.0,    0.495, 0.0,   0.0]).within(2.0 * CAPSULE),
    row("vein",                   0x3858b8, "blood",               [-56.0,  0.2,  0.0,  1.66],   [1.0,    0.495, 0.0,   0.0]).within(CAPSULE),
    row("vessel_wall",            0xc05060, "",                    [8.0,    1.57, 0.0,  1.70],   [300.0,  0.49,  0.03,  1.2]),
    row("bile",                   0x5c8c3c, "bile",                [-66.0,  0.05, 0.0,  1.54],   [0.5,    0.495, 0.0,   0.0]).within(2.0 * CAPSULE),
    row("gallbladder_wall",       0x7ca858, "",                    [8.0,    0.8,  0.0,  1.64],   [50.0,   0.49,  0.02,  1.0]),
    row("kidney_cortex",          0x96503c, "kidney_cortex",       [-7.0,   0.6,  0.0,  1.63],   [7.0,    0.49,  0.02,  1.0]).within(CAPSULE).organ(),
    row("kidney_medulla",         0x7a3c30, "kidney_medulla",      [-12.0,   0.5,  0.0,  1.62],   [5.0,    0.49,  0.02,  0.9]).within(CAPSULE),
    row("renal_sinus",            0xdcb478, "renal_sinus",         [9.0,    0.7,  0.0,  1.45],   [4.0,    0.49,  0.01,  0.4]).within(CAPSULE),
    row("spleen",                 0x7c3050, "spleen",              [1.0,    0.4,  0.0,  1.66],   [15.0,   0.49,  0.02,  0.9]).within(CAPSULE).organ(),
    row("pancreas",               0xd09060, "pancreas",            [3.0,    0.8,  0.0,  1.64],   [5.0,    0.49,  0.015, 0.7]).organ(),
    row("adrenal",                0xc8a050, "kidney_cortex",       [-5.0,   0.5,  0.0,  1.62],   [5.0,    0.49,  0.015, 0.7]),
    row("thyroid",                0xb86850, "liver",               [4.0,    0.6,  0.0,  1.63],   [10.0,   0.49,  0.02,  0.8]).within(CAPSULE).scaled(0.6).organ(),
    row("heart",                  0xa03038, "muscle",              [-4.0,   0.52, 0.0,  1.67],   [20.0,   0.49,  0.02,  1.0]).within(4.0 * CAPSULE).scaled(0.7).organ(),
    row("brain",                  0xd0a8a0, "kidney_medulla",      [-7.0,   0.6,  0.0,  1.60],   [2.0,    0.49,  0.006, 0.2]).scaled(2.0),
    row("nerve",                  0xe0d070, "muscle",              [2.0,    0.9,  0.0,  1.65],   [60.0,   0.49,  0.02,  1.0]).along(PARASPINAL_FIBRES).scaled(0.5),
    row("epineurium",             0xf0e498, "soft_tissue",         [6.0,    1.2,  0.0,  1.68],   [60.0,   0.49,  0.02,  1.0]).scaled(0.5),
    row("fascicle",               0xc8b450, "gel",                 [-6.0,   0.9,  0.0,  1.63],   [40.0,   0.49,  0.02,  1.0]),
    row("lymph_node",             0x987898, "gel",                 [-10.0,  0.6,  0.0,  1.63],   [10.0,   0.49,  0.02,  0.9]).within(CAPSULE),
    row("csf",                    0x60a0d0, "",                    [-68.0,  0.01, 0.0,  1.51],   [0.5,    0.495, 0.0,   0.0]),
    row("cyst",                   0x50b0b0, "",                    [-68.0,  0.02, 0.0,  1.52],   [0.5,    0.495, 0.0,   0.0]),
    row("stomach_wall",           0xc87858, "bowel",               [-3.0,   0.8,  0.0,  1.63],   [20.0,   0.49,  0.02,  0.9]).scaled(0.5),
    row("bowel_wall",             0xc08068, "bowel",               [-5.0,   0.8,  0.0,  1.63],   [20.0,   0.49,  0.02,  0.9]).scaled(0.5),
    row("small_bowel",            0xc89878, "bowel",               [-5.0,   0.8,  0.01, 1.60],   [8.0,    0.49,  0.01,  0.5]),
    row("bowel_content",          0x8c7048, "bowel",               [2.0,    1.2,  0.05, 1.55],   [2.0,    0.49,  0.005, 0.1]),
    row("prostate_peripheral",    0xc07090, "prostate_peripheral", [-1.0,   0.5,  0.0,  1.62],   [30.0,   0.49,  0.02,  1.0]).within(CAPSULE).organ(),
    row("prostate_central",       0xa85878, "prostate_central",    [-5.0,   0.6,  0.0,  1.62],   [40.0,   0.49,  0.02,  1.1]).within(CAPSULE).organ(),
    row("urethra",                0x7898b0, "",                    [-14.0,  0.5,  0.0,  1.60],   [10.0,   0.49,  0.01,  0.5]).within(CAPSULE),
    row("seminal_vesicle",        0xb08098, "pancreas",            [-11.0,  0.5,  0.0,  1.58],   [8.0,    0.49,  0.01,  0.6]).scaled(0.6),
    row("bladder_wall",           0xc8a090, "",                    [2.0,    0.9,  0.0,  1.64],   [40.0,   0.49,  0.03,  1.2]).within(CAPSULE),
    row("urine",                  0xd8d050, "",                    [-70.0,  0.01, 0.0,  1.53],   [0.5,    0.495, 0.0,   0.0]).within(CAPSULE),
    row("rectum_wall",            0xb87858, "bowel",               [-1.0,   0.8,  0.0,  1.63],   [20.0,   0.49,  0.02,  1.0]).scaled(0.5),
    row("gel",                    0x88c8d8, "gel",                 [-62.0,  0.01, 0.0,  1.50],   [1.0,    0.49,  0.0,   0.0]),
    row("soft_tissue",            0xb89080, "soft_tissue",         [-4.0,   0.6,  0.0,  1.50],   [8.0,    0.49,  0.015, 0.8]),
    row("phantom_top",            0x90a890, "gel",                 [-3.0,   0.5,  0.0,  1.60],   [10.0,   0.49,  0.02,  0.5]),
    row("phantom_bottom",         0x6c8c98, "gel",                 [-8.0,   0.5,  0.0,  1.60],   [20.0,   0.49,  0.02,  0.8]),
    row("phantom_inclusion",      0xc89050, "gel",                 [6.0,    0.7,  0.0,  1.65],   [33.0,   0.49,  0.04,  1.5]),
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::acoustics::{bank, overrides};

    #[test]
    fn every_preset_is_within_its_ranges_and_names_a_texture_of_the_bank() {
        for tissue in all() {
            overrides::check(tissue, &tissue.name).unwrap();
            if let Some(texture) = tissue.texture.as_deref() {
                assert!(bank::names().any(|name| name == texture), "{}: {texture}", tissue.name);
            }
        }
    }

    #[test]
    fn names_and_colours_are_unique_and_the_background_does_nothing() {
        for (i, a) in all().iter().enumerate() {
            for b in &all()[..i] {
                assert_ne!(a.name, b.name);
                assert_ne!(a.colour, b.colour, "{} and {}", a.name, b.name);
            }
        }
        let background = &all()[0];
        assert_eq!(background.name, "background");
        assert_eq!(
            (
                background.echogenicity_db,
                background.attenuation_db_cm_mhz,
                background.occlusion_per_mm
            ),
            (-100.0, 0.0, 0.0)
        );
    }

    #[test]
    fn echoes_are_ordered_as_on_a_scanner() {
        let echo = |name: &str| get(name).unwrap().echogenicity_db;
        for fluid in ["vessel", "bile", "urine", "csf", "cyst"] {
            assert!((-70.0..=-55.0).contains(&echo(fluid)), "{fluid}");
        }
        assert!(echo("kidney_medulla") < echo("kidney_cortex") && echo("kidney_cortex") < echo("liver"));
        assert!(echo("liver") < echo("renal_sinus") && echo("liver") < echo("bone"));
        assert!(echo("muscle") < echo("liver"));
        // Blood, wall and pericardium of the heart.
        let [heart, blood] = ["heart", "blood"].map(|name| get(name).unwrap());
        let line = |reflected: f64| 34.0 + 20.0 * reflected.log10();
        let endocardium = line(heart.capsule - blood.capsule);
        let order = [
            blood.echogenicity_db,
            heart.echogenicity_db,
            endocardium,
            line(heart.capsule),
        ];
        assert!(order.is_sorted_by(|a, b| a + 5.0 < *b), "{order:?}");
        for occluder in ["bone", "gas", "lung", "air"] {
            assert!(get(occluder).unwrap().is_occluder(), "{occluder}");
        }
        assert_eq!(all().iter().filter(|tissue| tissue.is_occluder()).count(), 4);
    }
}
