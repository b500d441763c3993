use nalgebra::{Matrix4, Vector3};

use super::*;
use crate::volume::complete::tests::nifti;
use crate::volume::complete::{CompleteOptions, complete};

fn label(value: i64, name: &str, voxels: u64) -> Label {
    Label {
        value,
        name: (value != 0).then(|| name.to_owned()),
        voxels,
    }
}

/// A volume of 1.5 mm voxels around the origin, with labels (one of `names`, from 1) given as a function of position.
fn volume(half_mm: [f64; 3], names: &[&str], of: impl Fn(Vector3<f64>) -> u8) -> LabelVolume {
    let size = half_mm.map(|half| (2.0 * half / 1.5) as usize);
    let corner = Vector3::from(half_mm) * -1.0;
    let count = size.iter().product();
    let place = |at: usize| {
        let index = [at % size[0], at / size[0] % size[1], at / (size[0] * size[1])];
        Vector3::from(index.map(|i| 1.5 * i as f64)) + corner
    };
    let voxels: Vec<u8> = (0..count).map(|at| of(place(at))).collect();
    let named = names.iter().zip(1..).map(|(name, value)| label(value, name, 1));
    let labels = std::iter::once(label(0, "", 1)).chain(named).collect();
    let to_world = Matrix4::new_translation(&corner) * Matrix4::new_scaling(1.5);
    LabelVolume::new(size, voxels, labels, to_world).unwrap()
}

fn at(volume: &LabelVolume, name: &str) -> Option<u8> {
    let named = |label: &Label| label.name.as_deref() == Some(name);
    volume.labels().iter().position(named).map(|at| at as u8)
}

fn count(volume: &LabelVolume, name: &str) -> usize {
    let wanted = at(volume, name);
    volume.voxels().iter().filter(|voxel| Some(**voxel) == wanted).count()
}

/// Number of face-connected regions of a label of at least 20 voxels.
fn regions(volume: &LabelVolume, name: &str) -> usize {
    let [nx, ny, _] = volume.size();
    let strides = [1, nx, nx * ny];
    let wanted = at(volume, name).unwrap();
    let mut left: Vec<bool> = volume.voxels().iter().map(|voxel| *voxel == wanted).collect();
    let mut regions = 0;
    for start in 0..left.len() {
        let (mut next, mut size) = (vec![start], 0);
        while let Some(at) = next.pop() {
            if std::mem::take(&mut left[at]) {
                size += 1;
                let both = strides
                    .iter()
                    .flat_map(|stride| [at + stride, at.wrapping_sub(*stride)]);
                next.extend(both.filter(|other| *other < left.len()));
            }
        }
        regions += usize::from(size >= 20);
    }
    regions
}

/// A liver of 1.4 l with a portal vein below and a vena cava behind it.
fn liver(names: [&str; 3]) -> LabelVolume {
    volume([90.0, 75.0, 65.0], &names, |p| match () {
        _ if p.component_div(&Vector3::new(80.0, 65.0, 60.0)).norm() < 1.0 => 1,
        _ if (p.x - 5.0).hypot(p.y + 8.0) < 6.0 && p.z < 0.0 => 2,
        _ if p.x.hypot(p.y - 68.0) < 12.0 => 3,
        _ => 0,
    })
}

const LIVER: [&str; 3] = ["liver", "portal_vein_and_splenic_vein", "inferior_vena_cava"];

#[test]
fn trees_fill_a_liver_from_the_veins_that_touch_it() {
    let before = liver(LIVER);
    let after = add(&before).unwrap();
    let volume = &after.volume;
    let livers = count(&before, "liver");
    for name in ["portal_branch", "hepatic_vein"] {
        let share = count(volume, name) as f64 / livers as f64;
        println!(
            "{name}: {:.2} % of the liver, {} pieces",
            100.0 * share,
            regions(volume, name)
        );
        assert!((0.005..0.05).contains(&share), "{name}: {share}");
    }
    assert_eq!(volume.undivided().voxels(), before.voxels());
    assert_eq!(regions(volume, "hepatic_vein"), 1, "one tree");
    let changed = before
        .voxels()
        .iter()
        .zip(volume.voxels())
        .filter(|(old, new)| old != new);
    assert!(
        changed.into_iter().all(|(old, _)| *old == 1),
        "vessels stay in the liver"
    );
    assert!(after.note.unwrap().contains("portal branches (label 207)"));
}

#[test]
fn radii_follow_murrays_law_up_to_the_widest_and_terminals_fill_the_organ() {
    let volume = liver(LIVER);
    let organ = Organ::of(&volume, |label| label == 1).unwrap();
    let tree = Tree::grown(&volume, &organ, |label| label == 2, Root::Innermost, 2).unwrap();
    let nodes = tree.nodes();
    let leaves = (1..nodes.len())
        .filter(|node| nodes.iter().skip(1).all(|other| other.1 != *node))
        .count();
    println!("{} nodes, {leaves} ends, a trunk of {:.2} mm", nodes.len(), nodes[0].2);
    assert!((200..450).contains(&nodes.len()), "{}", nodes.len());
    for (node, &(_, _, radius)) in nodes.iter().enumerate().filter(|(_, it)| it.2 < 5.0) {
        let children: Vec<_> = nodes.iter().skip(1).filter(|it| it.1 == node).collect();
        let cubes: f64 = children.iter().map(|it| it.2.powi(3)).sum();
        let expected = if children.is_empty() { 1.0 } else { cubes.cbrt() };
        assert!((radius - expected).abs() < 1e-9, "{node}: {radius} {expected}");
    }
    // No point of the liver is far from a branch.
    for (voxel, _) in organ.voxels().step_by(997) {
        let place = volume
            .index_to_world()
            .transform_point(&Point3::from(voxel.map(|at| at as f64)));
        let nearest = nodes
            .iter()
            .map(|it| (it.0 - place).norm())
            .fold(f64::INFINITY, f64::min);
        assert!(nearest < 22.0, "{nearest} mm from {place}");
    }
}

#[test]
fn what_a_file_has_by_itself_is_not_drawn() {
    for names in [
        ["liver", "portal_vein_and_splenic_vein", "liver_vessels"],
        ["liver", "hepatic_vein", "inferior_vena_cava"],
        ["liver", "pebble", "marble"],
        ["lesion", "portal_vein_and_splenic_vein", "inferior_vena_cava"],
    ] {
        let before = liver(names);
        let after = add(&before).unwrap();
        assert_eq!(after.volume.voxels(), before.voxels(), "{names:?}");
        assert_eq!(after.note, None);
    }
}

#[test]
fn a_spleen_has_veins_of_its_own_and_a_label_of_the_file_is_not_drawn_into() {
    for (third, drawn) in [("marble", true), ("splenic_vein", false)] {
        let before = volume(
            [70.0, 60.0, 60.0],
            &["spleen", "portal_vein_and_splenic_vein", third],
            |p| match () {
                _ if p.component_div(&Vector3::new(60.0, 50.0, 50.0)).norm() < 1.0 => 1 + 2 * u8::from(p.norm() < 4.0),
                _ if p.y.hypot(p.z) < 6.0 && p.x > 0.0 => 2,
                _ => 0,
            },
        );
        let after = add(&before).unwrap().volume;
        assert_eq!(after.voxels() != before.voxels(), drawn, "{third}");
        assert!(!drawn || count(&after, "splenic_vein") > 100);
        assert_eq!(count(&after, "hepatic_vein"), 0);
        assert_eq!(after.undivided().voxels(), before.voxels());
    }
}

#[test]
fn a_kidney_has_a_sinus_within_pyramids_within_a_cortex() {
    let radius = 24.0;
    let before = volume([30.0; 3], &["kidney_left"], |p| u8::from(p.norm() < radius));
    let after = add(&before).unwrap().volume;
    let share = |name: &str| count(&after, name) as f64 / count(&before, "kidney_left") as f64;
    // Volume fractions of shells of a ball; pyramids fill three fifths of theirs.
    let within = |depth: f64| ((radius - depth) / radius).powi(3);
    let sinus = within(15.0);
    let shell = within(7.0) - sinus;
    println!(
        "sinus {:.3} of {sinus:.3}, pyramids {:.3} of a shell of {shell:.3}",
        share("renal_sinus"),
        share("kidney_medulla")
    );
    assert!((share("renal_sinus") - sinus).abs() < 0.02);
    assert!((0.4..0.8).contains(&(share("kidney_medulla") / shell)));
    let organ = Organ::of(&before, |label| label == 1).unwrap();
    for (voxel, depth) in organ.voxels().filter(|(_, depth)| *depth <= 7.0) {
        assert_eq!(after.voxels()[after.offset(voxel)], 1, "{depth} mm deep");
    }
}

#[test]
fn a_heart_has_four_chambers_within_its_walls() {
    // Its axis from right, posterior and superior to left, anterior and inferior.
    let axis = Vector3::new(1.0, -1.0, -0.6).normalize();
    // Beside the origin.
    let before = volume([70.0; 3], &["heart"], |p| {
        let p = p - Vector3::new(14.0, -9.0, 11.0);
        let along = p.dot(&axis);
        u8::from((along / 62.0).hypot((p - axis * along).norm() / 42.0) < 1.0)
    });
    let after = add(&before).unwrap().volume;
    assert_eq!(regions(&after, "blood"), 4);
    let (blood, organ) = (
        at(&after, "blood").unwrap(),
        Organ::of(&before, |label| label == 1).unwrap(),
    );
    for (voxel, depth) in organ.voxels() {
        assert!(after.voxels()[after.offset(voxel)] != blood || depth > 10.0);
    }
    let share = count(&after, "blood") as f64 / count(&before, "heart") as f64;
    assert!((0.25..0.5).contains(&share), "{share}");
    let appendage = volume([70.0; 3], &["heart", "atrial_appendage_left"], |p| {
        u8::from(p.norm() < 50.0) + u8::from((p - Vector3::new(40.0, 0.0, 0.0)).norm() < 6.0)
    });
    assert!(add(&appendage).unwrap().note.is_some(), "an appendage is no chamber");
}

#[test]
fn chambers_have_walls_and_a_septum_between_them() {
    let chamber = |x: f64, p: &Vector3<f64>| (p - Vector3::new(x, 0.0, 0.0)).norm() < 15.0;
    let names = ["heart_myocardium", "heart_atrium_left", "heart_atrium_right"];
    let before = volume([40.0; 3], &names, |p| {
        let inside = u8::from(chamber(-10.0, &p) && p.x < 0.0) + 2 * u8::from(chamber(10.0, &p) && p.x >= 0.0);
        u8::from(p.norm() < 36.0) * (1 + inside)
    });
    let after = add(&before).unwrap();
    assert!(after.note.is_some());
    for label in [2, 3] {
        let chamber = Organ::of(&before, |held| held == label).unwrap();
        for (voxel, depth) in chamber.voxels() {
            let expected = if depth <= 2.0 { 1 } else { label };
            assert_eq!(
                after.volume.voxels()[after.volume.offset(voxel)],
                expected,
                "{depth} mm deep"
            );
        }
    }
    assert_eq!(regions(&after.volume, "heart_atrium_left"), 1);
}

#[test]
fn organs_of_voxels_wider_than_their_structures_stay_in_one_piece() {
    let fine = volume([12.0; 3], &["kidney_left"], |p| {
        u8::from(p.component_div(&Vector3::new(3.5, 3.0, 5.5)).norm() < 1.0)
    });
    let scaling = Matrix4::new_scaling(14.0);
    let coarse = LabelVolume::new(fine.size(), fine.voxels().to_vec(), fine.labels().to_vec(), scaling).unwrap();
    let after = add(&coarse).unwrap();
    assert_eq!(after.volume.voxels(), coarse.voxels());
    let note = after.note.unwrap();
    assert!(note.contains("too large for structures in kidney_left"), "{note}");
}

#[test]
fn surroundings_are_the_deeper_the_nearer() {
    let one = volume([15.0; 3], &["kidney_left"], |p| u8::from(p.norm() < 1.0));
    let around = Organ::around(&one, |label| label == 1, 5.0).unwrap();
    for (voxel, depth) in around.voxels() {
        let away = voxel.map(|at| 1.5 * at as f64 - 15.0);
        let expected = 5.0 - Vector3::from(away).norm();
        assert!((depth - expected).abs() < 1e-5, "{voxel:?}: {depth} {expected}");
    }
    assert!((around.deepest_mm() - 5.0).abs() < 1e-6);
}

#[test]
fn fat_lies_around_kidneys_and_in_patches_and_other_labels_stay() {
    let Some(plain) = nifti("tsd_s0328_labels.nii.gz") else {
        return;
    };
    let mut named = plain.clone();
    for class in crate::acoustics::Preset::TotalSegmentator.classes() {
        let position = named.labels().iter().position(|label| label.value == class.value);
        named.name(position.unwrap(), class.name.clone());
    }
    let before = complete(&named, &CompleteOptions::default()).unwrap().volume;
    let after = add(&before).unwrap().volume;
    let [soft, muscle, fat] = ["soft_tissue", "muscle", "peritoneal_fat"].map(|name| at(&after, name).unwrap());
    let counted =
        |volume: &LabelVolume, label: u8| volume.voxels().iter().filter(|voxel| **voxel == label).count() as f64;
    let all = counted(&before, soft);
    let share = |label: u8| (counted(&after, label) - counted(&before, label)) / all;
    println!(
        "of the soft tissue {:.1} % is fat now and {:.1} % muscle",
        100.0 * share(fat),
        100.0 * share(muscle)
    );
    assert!((0.15..0.5).contains(&share(fat)) && (0.02..0.25).contains(&share(muscle)));
    let kidneys = Organ::around(
        &before,
        |label| before.labels().get(usize::from(label)).is_some_and(|it| it.value == 2),
        8.0,
    )
    .unwrap();
    for (voxel, _) in kidneys.voxels() {
        assert_ne!(after.voxels()[after.offset(voxel)], soft, "beside the right kidney");
    }
    for (old, new) in before.voxels().iter().zip(after.voxels()) {
        let is_organ = ["liver", "spleen", "kidney", "heart"];
        let name = before.labels()[usize::from(*old)].name.as_deref().unwrap_or_default();
        let is_diaphragm = name.contains("lung") && Some(*new) == at(&after, "diaphragm");
        let is_divided = is_organ.iter().any(|organ| name.contains(organ)) || is_diaphragm;
        assert!(old == new || *old == soft || is_divided, "{name}");
    }
}

#[test]
fn a_diaphragm_is_drawn_where_lungs_meet_liver_and_spleen() {
    let names = ["liver", "lung_lower_lobe_right", "heart"];
    let body = |names: &[&str]| {
        volume([30.0, 30.0, 30.0], names, |p| match () {
            _ if p.norm() < 18.0 => 1,
            _ if p.x > 20.0 => 3,
            // A gap of a voxel between lung and liver.
            _ if p.z > 0.0 && p.norm() < 19.6 => 0,
            _ if p.z > 0.0 => 2,
            _ => 0,
        })
    };
    let before = body(&names);
    let after = add(&before).unwrap();
    let diaphragm = at(&after.volume, "diaphragm").expect("a diaphragm");
    let note = after.note.expect("a note").to_string();
    assert!(note.contains("diaphragm"), "{note}");
    let mut thickest = 0.0f64;
    for (offset, (old, new)) in before.voxels().iter().zip(after.volume.voxels()).enumerate() {
        let [nx, ny, _] = before.size();
        let index = [offset % nx, offset / nx % ny, offset / (nx * ny)];
        let from_middle = Vector3::from(index.map(|i| 1.5 * i as f64 - 30.0)).norm();
        if *new == diaphragm {
            assert_eq!(*old, 2, "what is not lung stays");
            thickest = thickest.max(from_middle);
        } else if *old == 2 {
            assert!(
                from_middle > 18.0 + DIAPHRAGM_MM - 1.6,
                "lung {from_middle} mm from the middle"
            );
        }
    }
    assert!((thickest - 18.0 - DIAPHRAGM_MM).abs() < 1.5, "up to {thickest} mm");
    // That of a file stays.
    let labelled = add(&body(&["liver", "lung_lower_lobe_right", "diaphragm_muscle"])).unwrap();
    assert!(at(&labelled.volume, "diaphragm").is_none());
}
