//! What speaks for and against a numbering.

use super::*;

/// Organs of a torso in the order of their values from 1.
fn ordered(organs: &[&'static str]) -> Segmentation {
    let labels: Vec<(i64, &str)> = (1..).zip(organs.iter().copied()).collect();
    named("a.nrrd", &torso(&labels))
}

fn all_named(segmentation: &Segmentation) -> bool {
    names(segmentation).iter().all(|(_, name)| *name != "-")
}

fn none_named(segmentation: &Segmentation) -> bool {
    names(segmentation).iter().all(|(_, name)| *name == "-")
}

#[test]
fn the_places_of_organs_tell_numberings_apart() {
    for (organs, numbering) in [
        (["liver", "kidney_right", "kidney_left", "spleen"], Preset::Chaos),
        (["liver", "spleen", "kidney_right", "kidney_left"], Preset::Learn2reg),
        (["liver", "spleen", "kidney_left", "kidney_right"], Preset::Word),
    ] {
        let read = ordered(&organs);
        assert_eq!(preset(&read), Some(numbering), "{:?}", read.warnings);
        assert!(read.warnings.is_empty(), "{:?}", read.warnings);
        let read: Vec<&str> = names(&read).iter().map(|(_, name)| *name).collect();
        assert_eq!(read, organs);
    }
    // An order that no data set has.
    let read = ordered(&["liver", "kidney_right", "spleen", "kidney_left"]);
    assert!(
        none_named(&read) && read.warnings[0].contains("on weak evidence"),
        "{read:?}"
    );
    // Kidneys on the wrong sides in an otherwise plausible torso.
    let read = ordered(&[
        "spleen",
        "kidney_left",
        "kidney_right",
        "gallbladder",
        "liver",
        "stomach",
    ]);
    assert!(none_named(&read), "{read:?}");
    assert!(
        read.warnings[0].contains("; against them, label 2 (kidney_right) lies left of label 3 (kidney_left)"),
        "{:?}",
        read.warnings
    );
}

#[test]
fn labels_of_another_part_of_the_body_get_no_names() {
    // Femur, tibia and patella; humerus, scapula and clavicle.
    let knee = [
        (0, [0.0, 0.0, 60.0], [28.0, 25.0, 40.0]),
        (1, [0.0, 0.0, -60.0], [28.0, 25.0, 40.0]),
        (2, [0.0, -40.0, 0.0], [18.0, 11.0, 18.0]),
    ];
    let shoulder = [
        (0, [0.0, 0.0, -40.0], [15.0, 15.0, 60.0]),
        (1, [35.0, 10.0, 0.0], [12.0, 28.0, 40.0]),
        (2, [25.0, -30.0, 60.0], [40.0, 8.0, 8.0]),
    ];
    for bones in [knee, shoulder] {
        let read = named("a.nrrd", &boxes(&[1, 2, 3], &bones));
        assert!(none_named(&read), "{:?}", names(&read));
        let warning = &read.warnings[0];
        assert!(warning.contains("they do not lie as these organs do"), "{warning}");
        assert!(
            warning.contains("state volume.preset = \"total_segmentator\" if that is right"),
            "{warning}"
        );
    }
    // Near miss: as few organs, which lie where they do.
    let read = ordered(&["spleen", "kidney_right", "kidney_left"]);
    assert!(all_named(&read) && read.warnings.is_empty(), "{read:?}");
}

#[test]
fn a_contradicted_label_stays_without_a_name_beside_others() {
    let organs = ["liver", "spleen", "kidney_left", "kidney_right", "aorta"];
    let read = ordered(&organs);
    assert_eq!(
        names(&read)[3..],
        [(4, "kidney_right"), (5, "-")],
        "{:?}",
        read.warnings
    );
    assert!(
        read.notes.iter().next().is_none()
            && read.warnings[0].contains("read by the numbers of WORD")
            && read.warnings[0].contains("label 5 (stomach) is a tube")
            && read.warnings[0].contains("in doubt stay without a name"),
        "{read:?}"
    );
    // Near miss: a stomach.
    let read = ordered(&["liver", "spleen", "kidney_left", "kidney_right", "stomach"]);
    assert!(all_named(&read) && read.warnings.is_empty(), "{read:?}");
}

#[test]
fn a_value_that_a_numbering_lacks_does_not_discard_it() {
    let organs = [
        (1, "spleen"),
        (3, "kidney_left"),
        (4, "gallbladder"),
        (6, "liver"),
        (7, "stomach"),
        (11, "pancreas"),
    ];
    let with = |value| {
        let mut labels = organs.to_vec();
        labels.push((value, "duodenum"));
        named("a.nrrd", &torso(&labels))
    };
    let read = with(14);
    assert_eq!(names(&read)[6], (14, "duodenum"), "{:?}", read.warnings);
    let read = with(90);
    assert_eq!(preset(&read), Some(Preset::Btcv), "{:?}", read.warnings);
    assert_eq!(names(&read)[5..], [(11, "pancreas"), (90, "-")]);
    assert!(
        read.warnings[0].starts_with("BTCV has no label 90"),
        "{:?}",
        read.warnings
    );
}

#[test]
fn values_that_few_numberings_have_are_evidence() {
    let read = named("a.nrrd", &torso(&[(5, "liver"), (52, "aorta")]));
    assert_eq!(names(&read)[0], (5, "liver"), "{:?}", read.warnings);
    assert!(read.warnings[0].contains("on weak evidence"), "{:?}", read.warnings);
    // Near miss: values that all have.
    let read = named("a.nrrd", &torso(&[(1, "liver"), (2, "kidney_right")]));
    assert!(none_named(&read), "{read:?}");
}

#[test]
fn no_turn_of_the_file_decides_on_names() {
    let organs = numbered(Preset::TotalSegmentator);
    let expected = names(&named("a.nrrd", &organs)).len();
    for (axis, angle_deg) in [
        (0, -20.0),
        (0, 90.0),
        (1, 20.0),
        (1, -90.0),
        (2, 45.0),
        (2, 90.0),
        (2, 180.0),
    ] {
        let mut turn = [0.0; 3];
        turn[axis] = f64::to_radians(angle_deg);
        let to_world = Matrix4::new_rotation(turn.into()) * organs.index_to_world();
        let read = named("a.nrrd", &moved(organs.clone(), to_world));
        assert!(
            all_named(&read) && names(&read).len() == expected,
            "{axis} {angle_deg}: {read:?}"
        );
        let is_large = f64::abs(angle_deg) > 80.0;
        let told: Vec<&String> = read
            .warnings
            .iter()
            .filter(|line| line.contains("check its orientation"))
            .collect();
        assert_eq!(
            (told.len(), read.warnings.len()),
            if is_large { (1, 1) } else { (0, 0) },
            "{axis} {angle_deg}: {:?}",
            read.warnings
        );
    }
    let on_side = Matrix4::new_rotation([0.0, 0.0, 90_f64.to_radians()].into()) * organs.index_to_world();
    let read = named("a.nrrd", &moved(organs, on_side));
    assert!(
        read.warnings[0].starts_with("the body is turned by ") && read.warnings[0].contains(" degrees in the file"),
        "{:?}",
        read.warnings
    );
}

#[test]
fn a_thin_part_of_a_body_keeps_its_names() {
    let organs = numbered(Preset::TotalSegmentator);
    let [nx, ny, _] = organs.size();
    for first in [8, 14, 18] {
        let slices = 3 * nx * ny;
        let voxels = &organs.voxels()[first * nx * ny..][..slices];
        let present: Vec<usize> = (1..organs.labels().len())
            .filter(|label| voxels.contains(&(*label as u8)))
            .collect();
        let labels: Vec<(i64, usize)> = present
            .iter()
            .map(|&label| {
                let count = voxels.iter().filter(|voxel| usize::from(**voxel) == label).count();
                (organs.labels()[label].value, count)
            })
            .collect();
        let index = |&voxel: &u8| {
            let position = present.iter().position(|label| *label == usize::from(voxel));
            position.map_or(0, |position| position as u8 + 1)
        };
        let slab = volume([nx, ny, 3], voxels.iter().map(index).collect(), &labels, 1.0);
        let read = named("a.nrrd", &moved(slab, *organs.index_to_world()));
        assert!(all_named(&read) && read.warnings.is_empty(), "{first}: {read:?}");
    }
}
