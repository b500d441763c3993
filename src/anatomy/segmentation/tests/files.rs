//! Label files and folders of masks.

use super::*;

/// Notes and warnings about real files.
#[test]
fn real_files_say_what_they_said() {
    for (file, lines) in [
        ("ts_example_seg.nii.gz", &[][..]),
        ("ts_example_seg_full.nii.gz", &[]),
        ("ts_spine_totalseg.nii.gz", &[]),
        (
            "Segmentation.seg.nrrd",
            &["label 7 (tissue) is taken for the body: 14.4 l that enclose all other labels"],
        ),
        (
            "DERIVED_ts_example_body_labels.nii.gz",
            &["66 labels without names are read by the numbers of TotalSegmentator"],
        ),
        (
            "tsd_s0328_labels.nii.gz",
            &["labels are named by FOLDER/tsd_s0328_labels.csv"],
        ),
        (
            "dcmqi_liver_spine_seg.nrrd",
            &[
                "2 labels without names may have the numbers of LiTS (1 liver, 2 liver_tumor) on weak evidence; those of FLARE21, FLARE22, CHAOS, \
                 CT-ORG, KiTS, TotalSegmentator liver_vessels fit as well; all stay without a name, as soft tissue: 1 liver or kidney or \
                 liver_vessels, 2 liver_tumor or kidney or kidney_right or urinary_bladder or kidney_tumor: state volume.preset = \"lits\" if that is right, name the \
                 labels with --names FILE or volume.names, or write [[tissue]] with name and labels = [VALUE, ...]",
                "no tissue known for labels 1, 2; taken as soft_tissue; to choose, name the labels with --names FILE or volume.names, or write \
                 [[tissue]] with name and labels = [VALUE, ...]",
            ],
        ),
    ] {
        let Some(path) = insonify_testing::shared(&format!("volumes/{file}")) else {
            return;
        };
        let folder = path.parent().unwrap().display().to_string();
        let info = SegmentationInfo::new(&opened(&path), &path);
        let said = info
            .notes
            .iter()
            .map(|note| &**note)
            .chain(info.warnings.iter().map(String::as_str));
        let said: Vec<String> = said.map(|line| line.replace(&folder, "FOLDER")).collect();
        assert_eq!(said, lines, "{file}");
    }
}

#[test]
fn stems_are_names_without_the_endings_of_volumes() {
    let stem_of = |name: &str| stem(Path::new(name));
    assert_eq!(stem_of("a/kidney_right.nii.gz").as_deref(), Some("kidney_right"));
    assert_eq!(stem_of("Liver.SEG.NRRD").as_deref(), Some("Liver"));
    assert_eq!(stem_of("a.b.mha").as_deref(), Some("a.b"));
    assert_eq!(stem_of("scene.toml"), None);
}

#[test]
fn a_single_mask_is_named_by_its_file_and_never_by_its_value() {
    let folder = Folder::new();
    let kidney = opened(&folder.row("kidney_right.nii.gz", [0, 1, 1, 0], 1.0));
    assert_eq!(names(&kidney), [(1, "kidney_right")]);
    assert_eq!(
        (tissue(&kidney, 1).as_str(), kidney.warnings.len()),
        ("kidney_cortex", 0)
    );
    assert!(kidney.notes[0].contains("named by its file"), "{:?}", kidney.notes);

    let unknown = opened(&folder.row("mask.nii.gz", [0, 1, 1, 0], 1.0));
    assert_eq!(names(&unknown), [(1, "-")]);
    assert_eq!(tissue(&unknown, 1), "soft_tissue");
    assert!(
        unknown.warnings[0].contains("\"mask\" names no tissue"),
        "{:?}",
        unknown.warnings
    );

    let by_total_segmentator = Naming {
        preset: Preset::TotalSegmentator,
        ..Naming::default()
    };
    let spleen = open(&folder.path("mask.nii.gz"), &by_total_segmentator).unwrap();
    assert_eq!(names(&spleen), [(1, "spleen")]);
    assert!(spleen.warnings.is_empty(), "{:?}", spleen.warnings);
}

#[test]
fn the_masks_of_a_folder_are_one_volume_named_by_files() {
    let folder = Folder::new();
    folder.row("odd_thing.nrrd", [1, 0, 0, 0], 2.0);
    folder.row("kidney_right.nii.gz", [0, 1, 1, 0], 2.0);
    folder.row("liver.mha", [0, 0, 255, 255], 2.0);
    folder.row("skin.nii", [1, 1, 0, 0], 2.0);
    folder.row("spleen.nii.gz", [0; 4], 2.0);
    folder.row(".hidden.nii", [1, 2, 3, 4], 2.0);
    folder.write("statistics.json", "{}");
    let whole = opened(folder.0.path());
    assert_eq!(
        names(&whole),
        [(2, "kidney_right"), (5, "liver"), (301, "skin"), (302, "odd_thing")]
    );
    // Skin lies below the others; of masks of two voxels each the last by name is on top.
    assert_eq!(whole.volume.voxels(), [4, 1, 2, 2]);
    let counts: Vec<u64> = whole.volume.labels().iter().map(|label| label.voxels).collect();
    assert_eq!(counts, [0, 1, 2, 0, 1]);
    assert_eq!(whole.volume.spacing_mm(), [2.0; 3]);
    assert!(whole.notes[0].contains("5 masks, 1 of them empty"), "{:?}", whole.notes);
    assert!(
        whole.warnings[0]
            .ends_with("skin: 100 % covered by kidney_right, odd_thing; kidney_right: 50 % covered by liver"),
        "{:?}",
        whole.warnings
    );
}

#[test]
fn folders_that_are_no_segmentation_are_refused() {
    let folder = Folder::new();
    assert!(refused(folder.0.path()).contains("found no mask"));
    folder.row("a.nii", [0, 1, 0, 1], 1.0);
    folder.row("b.nii", [0, 7, 3, 0], 1.0);
    let message = refused(folder.0.path());
    assert!(message.contains("b.nii, voxels: found values 3 and 7"), "{message}");
    let grey = b"NRRD0004\ntype: float\ndimension: 3\nsizes: 1 1 1\nspacings: 1 1 1\nencoding: ascii\n\n0.5\n";
    fs::write(folder.path("b.nrrd"), grey).unwrap();
    fs::remove_file(folder.path("b.nii")).unwrap();
    let message = refused(folder.0.path());
    assert!(
        message.contains("b.nrrd, voxels: found the value 0.5")
            && message.contains("such as the CT, out of the folder"),
        "{message}"
    );
    fs::remove_file(folder.path("b.nrrd")).unwrap();
    let image = folder.row("ct.nii.gz", [1, 2, 3, 4], 1.0);
    let message = refused(folder.0.path());
    assert!(
        message.contains("ct.nii.gz, voxels: found an image, by its name"),
        "{message}"
    );
    fs::remove_file(image).unwrap();
    folder.row("b.nii", [0, 7, 7, 0], 1.5);
    let message = refused(folder.0.path());
    assert!(
        message.contains("b.nii")
            && message.contains("a.nii")
            && message.contains("4.500")
            && message.contains("3.000"),
        "{message}"
    );
    folder.save("b.nii", &organs(&[(1, 5)]));
    let message = refused(folder.0.path());
    assert!(
        message.contains("b.nii") && message.contains("[18, 18, 18]") && message.contains("[4, 1, 1]"),
        "{message}"
    );
    folder.row("a.mha", [0, 1, 0, 1], 1.0);
    assert!(refused(folder.0.path()).contains("a.mha and a.nii"));
    folder.row("b.igs.mha", [0, 1, 0, 1], 1.0);
    assert!(refused(folder.0.path()).contains("b.igs.mha, a recording of tracked frames"));
}

#[test]
fn the_folder_of_masks_in_a_folder_is_told() {
    let folder = Folder::new();
    fs::create_dir(folder.path("segmentations")).unwrap();
    assert!(!refused(folder.0.path()).contains("give that folder"));
    folder.row("segmentations/liver.nii.gz", [0, 1, 1, 0], 1.0);
    for _ in 0..2 {
        let message = refused(folder.0.path());
        assert!(
            message.contains("found no mask") && message.contains("segmentations: give that folder"),
            "{message}"
        );
        folder.row("ct.nii.gz", [1, 2, 3, 4], 1.0);
    }
}
