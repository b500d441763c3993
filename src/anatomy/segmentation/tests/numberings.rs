//! Labels that are named by their values.

use super::*;

#[test]
fn every_numbering_is_recognised_by_a_torso() {
    for &numbering in Preset::NUMBERINGS {
        let organs = numbered(numbering);
        let read = named("a.nrrd", &organs);
        let present = (1..organs.labels().len()).filter(|label| organs.holds(*label)).count();
        let thin = present <= naming::ENOUGH;
        assert_eq!(
            preset(&read) == Some(numbering),
            !thin,
            "{numbering:?}: {:?}",
            read.warnings
        );
        if !thin {
            assert!(read.warnings.is_empty(), "{numbering:?}: {:?}", read.warnings);
            for label in &read.volume.labels()[1..] {
                assert_eq!(label.name.as_deref(), numbering.organ(label.value), "{numbering:?}");
            }
        }
    }
    let btcv = named("a.nrrd", &numbered(Preset::Btcv));
    assert!(
        btcv.notes[0].contains("the numbers of BTCV: by those of TotalSegmentator, label 5 (liver) has"),
        "{:?}",
        btcv.notes
    );
}

/// A volume with names of TotalSegmentator in the values of a numbering, without names. A class has all labels that it
/// comprises.
fn recoded(volume: &LabelVolume, numbering: Preset) -> LabelVolume {
    let comprises = |class: &str, organ: &str| {
        let lung = class
            .strip_prefix("lung_")
            .filter(|side| ["left", "right"].contains(side));
        organ == class
            || organ.strip_prefix(class).is_some_and(|rest| rest.starts_with('_'))
            || lung.is_some_and(|side| organ.starts_with("lung_") && organ.ends_with(side))
    };
    let classes = numbering.classes();
    let of_label: Vec<u8> = volume
        .labels()
        .iter()
        .map(|label| {
            let name = label.name.as_deref().unwrap_or_default();
            let class = classes.iter().position(|class| comprises(&class.name, name));
            class.map_or(0, |class| class as u8 + 1)
        })
        .collect();
    let voxels = volume
        .voxels()
        .iter()
        .map(|&voxel| of_label[usize::from(voxel)])
        .collect();
    let counts = |class: usize| {
        let labels = volume.labels().iter().zip(&of_label);
        labels
            .filter(|(_, of)| usize::from(**of) == class + 1)
            .map(|(label, _)| label.voxels as usize)
            .sum()
    };
    let labels: Vec<(i64, usize)> = classes
        .iter()
        .enumerate()
        .map(|(class, of)| (of.value, counts(class)))
        .collect();
    moved(
        self::volume(volume.size(), voxels, &labels, 1.0),
        *volume.index_to_world(),
    )
}

#[test]
fn real_anatomy_is_recognised_in_every_numbering() {
    let Some(path) = insonify_testing::shared("volumes/ts_example_seg_full.nii.gz") else {
        return;
    };
    let real = load(&path).unwrap().volume;
    for &numbering in Preset::NUMBERINGS {
        let mut read = Segmentation::from(recoded(&real, numbering));
        let extents = Extents::of(&read.volume);
        read.read_values(&Naming::default(), None, &extents);
        let thin = numbering.classes().len() <= naming::ENOUGH;
        assert_eq!(
            preset(&read) == Some(numbering),
            !thin,
            "{numbering:?}: {:?}",
            read.warnings
        );
        assert_eq!(read.warnings.is_empty(), !thin, "{numbering:?}: {:?}", read.warnings);
    }
}

#[test]
fn total_mr_is_not_read_as_total() {
    let mr = [
        (5, "liver"),
        (2, "kidney_right"),
        (19, "vertebrae"),
        (23, "aorta"),
        (24, "inferior_vena_cava"),
    ];
    let read = named("a.nrrd", &torso(&mr));
    assert_eq!(preset(&read), Some(Preset::TotalMr), "{:?}", read.warnings);
    assert!(
        read.notes[0].contains("label 23 (kidney_cyst_left) is 203 mm from head to feet, expected at most 180 mm"),
        "{:?}",
        read.notes
    );
    // Near misses: a cyst, and values that mean the same in both.
    let cyst = [
        (5, "liver"),
        (1, "spleen"),
        (2, "kidney_right"),
        (3, "kidney_left"),
        (23, "gallbladder"),
    ];
    let mut same = torso(&cyst);
    assert_eq!(preset(&named("a.nrrd", &same)), Some(Preset::TotalSegmentator));
    same = torso(&cyst[..4]);
    let read = named("a.nrrd", &same);
    assert_eq!(
        (preset(&read), read.warnings.len()),
        (Some(Preset::TotalSegmentator), 0),
        "{read:?}"
    );
}

#[test]
fn what_another_numbering_explains_as_well_is_soft_tissue() {
    // Between a liver and a stomach, in place and volume.
    let organs = [
        (0, [95.0, 40.0, 45.0], [20.0, 35.0, 40.0]),
        (1, [-60.0, 58.0, -25.0], [21.0, 21.0, 52.0]),
        (2, [60.0, 55.0, -10.0], [21.0, 21.0, 52.0]),
        (3, [4.0, -18.0, 38.0], [47.0, 47.0, 47.0]),
    ];
    let volume = boxes(&[1, 2, 3, 6], &organs);
    let read = named("a.nrrd", &volume);
    assert_eq!(names(&read)[2..], [(3, "kidney_left"), (6, "-")], "{:?}", read.warnings);
    assert_eq!(tissue(&read, 4), "soft_tissue");
    let warning = &read.warnings[0];
    assert!(
        warning.contains(" fit as well; in doubt stay without a name, as soft tissue: 6 ")
            && warning.contains("liver")
            && warning.contains("stomach"),
        "{warning}"
    );
    // The file's name decides.
    for (name, organ) in [("case3_amos.nrrd", "liver"), ("total_mr.nrrd", "stomach")] {
        let read = named(name, &volume);
        assert_eq!(
            (names(&read)[3], read.warnings.len()),
            ((6, organ), 0),
            "{:?}",
            read.warnings
        );
    }
    let read = named("case3_amos.nrrd", &volume);
    assert!(
        read.notes[0].contains("which the file's name states"),
        "{:?}",
        read.notes
    );
}

#[test]
fn a_value_or_two_are_no_numbering() {
    let vessels = torso(&[(1, "aorta"), (2, "inferior_vena_cava")]);
    let read = named("a.nrrd", &vessels);
    assert_eq!(names(&read), [(1, "-"), (2, "-")], "{:?}", read.warnings);
    assert_eq!(
        (tissue(&read, 1).as_str(), tissue(&read, 2).as_str()),
        ("soft_tissue", "soft_tissue")
    );
    assert!(
        read.warnings[0].contains("on weak evidence") && read.warnings[0].contains("all stay"),
        "{read:?}"
    );
    let read = named("lung_vessels.nii.gz", &vessels);
    assert_eq!(
        names(&read),
        [(1, "lung_vessels"), (2, "lung_trachea_bronchia")],
        "{read:?}"
    );
    assert_eq!(
        (tissue(&read, 1).as_str(), tissue(&read, 2).as_str()),
        ("vessel", "gas")
    );
    let lits = numbered(Preset::Lits);
    let read = named("segmentation-7.nii", &lits);
    assert_eq!(names(&read), [(1, "-"), (2, "-")], "{:?}", read.warnings);
    let told =
        "2 labels without names may have the numbers of LiTS (1 liver, 2 liver_tumor) on weak evidence; all stay";
    assert!(read.warnings[0].starts_with(told), "{:?}", read.warnings);
    let read = named("lits_7.nii", &lits);
    assert_eq!(
        (names(&read)[1], read.warnings.len()),
        ((2, "liver_tumor"), 0),
        "{read:?}"
    );
}

#[test]
fn values_that_totalsegmentator_does_not_have_are_read_only_as_a_whole_body() {
    let read = |volume: LabelVolume, preset: Preset| {
        let mut segmentation = Segmentation::from(volume);
        let extents = Extents::of(&segmentation.volume);
        let naming = Naming {
            preset,
            ..Naming::default()
        };
        segmentation.read_values(&naming, None, &extents);
        segmentation
    };
    // A right kidney under a value of this program's own bodies, which TotalSegmentator does not have.
    let strange = torso(&[
        (1, "spleen"),
        (3, "kidney_left"),
        (5, "liver"),
        (6, "stomach"),
        (200, "kidney_right"),
    ]);
    for preset in [Preset::Auto, Preset::TotalSegmentator] {
        let segmentation = read(strange.clone(), preset);
        assert_eq!(
            (names(&segmentation)[2], names(&segmentation)[4]),
            ((5, "liver"), (200, "-"))
        );
        assert_eq!(segmentation.warnings, ["TotalSegmentator has no label 200 (185.22 ml)"]);
        let info = SegmentationInfo::new(&segmentation, Path::new("a.nrrd"));
        let label = &info.labels[5];
        assert_eq!(
            (label.tissue.as_str(), label.from.as_str()),
            ("soft_tissue", "fallback")
        );
    }
    for few in [&[(5, 1178), (200, 150)][..], &[(200, 150)]] {
        let segmentation = read(organs(few), Preset::Auto);
        assert!(
            names(&segmentation).iter().all(|(_, name)| *name == "-"),
            "{:?}",
            names(&segmentation)
        );
        assert_eq!(segmentation.warnings, ["TotalSegmentator has no label 200 (150.00 ml)"]);
    }
    let body = [
        (1, "spleen"),
        (3, "kidney_left"),
        (5, "liver"),
        (201, "colon"),
        (202, "vertebrae"),
        (204, "stomach"),
        (205, "duodenum"),
    ];
    let segmentation = read(torso(&body), Preset::Auto);
    let expected = [(201, "fat"), (202, "soft_tissue"), (204, "skin"), (205, "muscle")];
    assert_eq!(names(&segmentation)[3..], expected);
    assert!(segmentation.warnings.is_empty(), "{:?}", segmentation.warnings);
}

#[test]
fn weak_evidence_warns_and_names_nothing() {
    let folder = Folder::new();
    let small = opened(&folder.save("scan.nrrd", &organs(&[(6, 1178), (5, 30)])));
    assert_eq!(names(&small), [(5, "-"), (6, "-")]);
    assert!(
        small.warnings[0]
            .contains("on weak evidence; those of BTCV, AMOS fit as well; all stay without a name, as soft tissue: 5 "),
        "{:?}",
        small.warnings
    );
    let claimed = Naming {
        claimed: &[5, 6],
        ..Naming::default()
    };
    assert_eq!(
        names(&open(&folder.path("scan.nrrd"), &claimed).unwrap()),
        [(5, "-"), (6, "-")]
    );
}

#[test]
fn of_numberings_that_fit_as_well_totalsegmentator_is_proposed() {
    let whole = numbered(Preset::TotalSegmentator);
    let [columns, rows, slices] = whole.size();
    let proposed = (0..columns).filter_map(|column| {
        let voxels = whole.voxels().chunks(columns).map(|row| row[column]).collect();
        let labels = whole
            .labels()
            .iter()
            .map(|label| (label.value, 1))
            .skip(1)
            .collect::<Vec<_>>();
        let plane = volume([1, rows, slices], voxels, &labels, 7.0);
        let read = named("a.nrrd", &plane);
        read.warnings
            .into_iter()
            .find(|warning| warning.contains("fit as well"))
    });
    let proposed: Vec<String> = proposed.collect();
    assert!(!proposed.is_empty());
    for warning in proposed {
        let (by, others) = warning.split_once("; those of ").unwrap();
        println!("{by} | {others}");
        assert!(
            !others.starts_with("TotalSegmentator,") && !others.starts_with("TotalSegmentator fit"),
            "{warning}"
        );
    }
}

#[test]
fn grey_levels_as_labels_stay_without_names() {
    let levels = [
        (63, "liver"),
        (126, "kidney_right"),
        (190, "kidney_left"),
        (254, "spleen"),
    ];
    let read = named("a.nrrd", &torso(&levels));
    assert_eq!(names(&read), [(63, "-"), (126, "-"), (190, "-"), (254, "-")]);
    assert!((1..=4).all(|index| tissue(&read, index) == "soft_tissue"));
    assert!(
        read.warnings.iter().any(|warning| warning.contains("254")),
        "{:?}",
        read.warnings
    );
    // Near miss: CHAOS numbers the organs of its MR images by grey levels.
    let chaos = levels.map(|(value, name)| (value / 63 * 63, name));
    let read = named("a.nrrd", &torso(&chaos));
    assert_eq!(
        (preset(&read), read.warnings.len()),
        (Some(Preset::Chaos), 0),
        "{:?}",
        read.warnings
    );
    // Kidneys with a tumour, in a file that says so.
    let read = named("case_00012_kits.nii.gz", &torso(&[(1, "kidney"), (2, "gallbladder")]));
    assert_eq!(names(&read), [(1, "kidney"), (2, "kidney_tumor")]);
    // Near miss: lesions that nothing speaks for.
    let read = named("a.nrrd", &torso(&[(1, "kidney"), (2, "gallbladder"), (3, "spleen")]));
    assert!(!read.warnings[0].contains("KiTS"), "{:?}", read.warnings);
    // One label of a data set of kidneys, whose file says nothing.
    let read = named("kits.nii.gz", &torso(&[(1, "kidney")]));
    assert_eq!(names(&read), [(1, "-")]);
    assert!(
        read.warnings[0].contains("\"kits\" names no tissue: name the file after it"),
        "{:?}",
        read.warnings
    );
}
