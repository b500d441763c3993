//! Warnings about names, orientation and spacing.

use super::*;

#[test]
fn turned_files_are_told_as_such() {
    let numbers = numbered(Preset::TotalSegmentator);
    let names_of = |segmentation: &Segmentation| -> Vec<_> {
        let labels = segmentation.volume.labels().iter();
        labels.map(|label| label.name.clone()).collect()
    };
    let upright = named("a.nrrd", &numbers);
    assert!(upright.warnings.is_empty(), "{:?}", upright.warnings);
    for (flips, words) in [
        (
            [-1.0, 1.0, 1.0],
            "the file is mirrored: label 8 (adrenal_gland_right) lies left of label 9 (adrenal_gland_left) and",
        ),
        ([1.0, 1.0, -1.0], "the file is upside down: "),
        ([-1.0, -1.0, 1.0], "the file is mirrored and back to front: "),
    ] {
        let turn = Matrix4::new_nonuniform_scaling(&flips.into());
        let turned = named("a.nrrd", &moved(numbers.clone(), turn * numbers.index_to_world()));
        assert_eq!(names_of(&turned), names_of(&upright));
        let [warning] = &turned.warnings[..] else {
            panic!("{:?}", turned.warnings);
        };
        assert!(
            warning.starts_with(words) && warning.ends_with("check its orientation, not its names"),
            "{warning}"
        );
    }
    for (axes, words) in [([0, 1], "x and y"), ([0, 2], "x and z"), ([1, 2], "y and z")] {
        let mut turn = Matrix4::identity();
        turn.swap_rows(axes[0], axes[1]);
        let exchanged = named("a.nrrd", &moved(numbers.clone(), turn * numbers.index_to_world()));
        let told = format!("the axes {words} seem to be exchanged (transpose the array");
        assert!(exchanged.warnings[0].starts_with(&told), "{:?}", exchanged.warnings);
    }
    // Sides in other words.
    let mut pair = torso(&[(1, "kidney_right"), (2, "kidney_left"), (3, "liver"), (4, "spleen")]);
    let turn = Matrix4::new_nonuniform_scaling(&[-1.0, 1.0, 1.0].into()) * pair.index_to_world();
    for (index, name) in ["Kidney_R", "Kidney Lt", "Liver", "Spleen"].into_iter().enumerate() {
        pair.name(index + 1, name.to_owned());
    }
    assert!(named("a.nrrd", &pair).warnings.is_empty());
    let mirrored = named("a.nrrd", &moved(pair, turn));
    assert!(
        mirrored.warnings[0].contains("label 1 (Kidney_R) lies left of label 2 (Kidney Lt)"),
        "{:?}",
        mirrored.warnings
    );
}

#[test]
fn organs_that_are_all_too_small_or_large_are_a_matter_of_spacing() {
    let organs = numbered(Preset::TotalSegmentator);
    let scaled = |factor: f64| {
        let to_world = Matrix4::new_scaling(factor) * organs.index_to_world();
        named("a.nrrd", &moved(organs.clone(), to_world))
    };
    for (factor, words) in [
        (1.0 / 7.0, "all organs are too small alike, by a factor of about 1/"),
        (10.0, "all organs are too large alike, by a factor of about"),
    ] {
        let read = scaled(factor);
        assert_eq!(names(&read), names(&scaled(1.0)), "{factor}: {:?}", read.warnings);
        let [warning] = &read.warnings[..] else {
            panic!("{factor}: {:?}", read.warnings);
        };
        assert!(warning.starts_with(words), "{warning}");
        assert!(
            warning.ends_with(": check the voxel spacing and its unit, not the names"),
            "{warning}"
        );
    }
    // Near misses: a child, and one odd organ.
    assert!(scaled(0.7).warnings.is_empty(), "{:?}", scaled(0.7).warnings);
    assert!(scaled(1.0).warnings.is_empty());
}

#[test]
fn what_the_edge_of_the_scan_cuts_may_be_small() {
    let doubts = |voxels: &dyn Fn([usize; 3]) -> bool, name: &str| {
        let place = |at: usize| [at % SIDE, at / SIDE % SIDE, at / SIDE / SIDE];
        let voxels: Vec<u8> = (0..SIDE * SIDE * SIDE).map(|at| u8::from(voxels(place(at)))).collect();
        let count = voxels.iter().filter(|voxel| **voxel > 0).count();
        let mut volume = volume([SIDE; 3], voxels, &[(1, count)], 10.0);
        volume.name(1, name.to_owned());
        let segmentation = Segmentation::from(volume);
        segmentation.doubts(&Extents::of(&segmentation.volume)).pop()
    };
    let slab = |depth: usize| {
        move |[x, y, z]: [usize; 3]| (4..8).contains(&x) && (4..8).contains(&y) && z >= depth && z < depth + 1
    };
    assert_eq!(doubts(&slab(0), "liver"), None, "16 ml that the lower face cuts");
    let inside = doubts(&slab(3), "liver").unwrap();
    assert!(
        inside.contains("16.00 ml") && inside.contains("check names"),
        "{inside}"
    );
    let tube = |[x, y, z]: [usize; 3]| x == 4 && y == 4 && z < 13;
    assert!(doubts(&tube, "liver").is_some(), "a tube that leaves the scan");
    assert_eq!(doubts(&tube, "esophagus"), None);
    let large = |[x, y, _]: [usize; 3]| x < 5 && y < 5;
    assert!(
        doubts(&large, "Left adrenal gland").is_some(),
        "450 ml are too large, cut or not"
    );
}

#[test]
fn volumes_are_questioned_wherever_names_are_from() {
    let folder = Folder::new();
    let file = folder.save("scan.nrrd", &organs(&[(1, 1126), (2, 13), (3, 160)]));
    let table = "value,name\n1,inferior vena cava\n2,Liver\n3,kidney_left\n";
    let naming = Naming {
        names: Some(Names::read(&folder.write("names.csv", table)).unwrap()),
        ..Naming::default()
    };
    folder.write("scan.csv", table);
    for segmentation in [open(&file, &naming).unwrap(), opened(&file)] {
        let expected = "label 1 (inferior vena cava) has 1126.00 ml, expected 0.0 to 954 ml, label 2 (Liver) has 13.00 ml, expected \
                        43.3 to 10800 ml: check names, voxel spacing and orientation";
        assert_eq!(segmentation.warnings, [expected]);
    }
}

#[test]
fn sides_that_are_exchanged_are_questioned() {
    let named = |right: usize, left: usize| {
        let mut volume = organs(&[(1, 150), (2, 160)]);
        volume.name(right, "kidney_right".to_owned());
        volume.name(left, "Left kidney".to_owned());
        volume
    };
    let doubts = |volume: LabelVolume| {
        let segmentation = Segmentation::from(volume);
        segmentation.doubts(&Extents::of(&segmentation.volume)).pop()
    };
    assert_eq!(doubts(named(1, 2)), None);
    let mut mirrored = named(2, 1);
    mirrored.name(1, "kidney_left".to_owned());
    let doubt = doubts(mirrored).unwrap();
    assert!(
        doubt.starts_with("label 2 (kidney_right) lies left of label 1 (kidney_left): check names"),
        "{doubt}"
    );
    // A liver lies right of the spine, by more than a little.
    let mut liver = torso(&[(1, "liver"), (2, "vertebrae")]);
    liver.name(1, "Liver".to_owned());
    liver.name(2, "Spine".to_owned());
    assert_eq!(doubts(liver.clone()), None);
    let turn = Matrix4::new_nonuniform_scaling(&[-1.0, 1.0, 1.0].into());
    let doubt = doubts(moved(liver.clone(), turn * liver.index_to_world())).unwrap();
    assert!(
        doubt.starts_with("label 1 (Liver) lies left of label 2 (Spine): check names"),
        "{doubt}"
    );
}

#[test]
fn a_body_turned_about_its_long_axis_is_in_order() {
    let organs = numbered(Preset::TotalSegmentator);
    let to_world = |turn_deg: f64, shear: f64, mirror: f64| {
        let turn = Matrix4::new_rotation([0.0, 0.0, turn_deg.to_radians()].into());
        let mut sheared = Matrix4::new_nonuniform_scaling(&[mirror, 1.0, 1.0].into());
        sheared[(1, 2)] = shear;
        turn * sheared * organs.index_to_world()
    };
    for (turn_deg, shear) in [(25.0, 0.0), (-25.0, 0.0), (20.0, 0.1), (-20.0, -0.1)] {
        let read = named("a.nrrd", &moved(organs.clone(), to_world(turn_deg, shear, 1.0)));
        let doubts: Vec<&String> = read.warnings.iter().filter(|line| !line.contains("sheared")).collect();
        assert!(doubts.is_empty(), "{turn_deg} {shear}: {doubts:?}");
        let mirrored = named("a.nrrd", &moved(organs.clone(), to_world(turn_deg, shear, -1.0)));
        assert!(
            mirrored
                .warnings
                .iter()
                .any(|warning| warning.starts_with("the file is mirrored: ")),
            "{turn_deg} {shear}: {:?}",
            mirrored.warnings
        );
    }
}
