use std::fs;
use std::path::PathBuf;

use nalgebra::Matrix4;
use tempfile::TempDir;

use super::*;
use crate::acoustics::numbering::Class;
use crate::acoustics::{TissueTable, without_side};
use crate::volume::{Label, save};

/// Edge of the grid of [`organs`], voxels of 1 ml.
const SIDE: usize = 18;

/// A volume of unnamed labels, from right to left, each of a number of voxels of 1 ml, clear of the edge of the scan.
fn organs(ml: &[(i64, usize)]) -> LabelVolume {
    let mut voxels = vec![0; SIDE * SIDE * SIDE];
    let inner = |at: &usize| {
        [at % SIDE, at / SIDE % SIDE, at / SIDE / SIDE]
            .iter()
            .all(|n| (1..SIDE - 1).contains(n))
    };
    let mut free: Vec<usize> = (0..voxels.len()).filter(inner).collect();
    free.sort_by_key(|at| at % SIDE);
    let mut free = free.into_iter();
    for (label, (_, count)) in ml.iter().enumerate() {
        free.by_ref().take(*count).for_each(|at| voxels[at] = label as u8 + 1);
    }
    volume([SIDE; 3], voxels, ml, 10.0)
}

fn volume(size: [usize; 3], voxels: Vec<u8>, labels: &[(i64, usize)], spacing_mm: f64) -> LabelVolume {
    let label = |&(value, voxels): &(i64, usize)| Label {
        value,
        name: None,
        voxels: voxels as u64,
    };
    let labels = std::iter::once(&(0, 0)).chain(labels).map(label).collect();
    LabelVolume::new(size, voxels, labels, Matrix4::new_scaling(spacing_mm)).unwrap()
}

struct Folder(TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Saves a row of four voxels with these values.
    fn row(&self, name: &str, values: [i64; 4], spacing_mm: f64) -> PathBuf {
        let mut labels: Vec<(i64, usize)> = values
            .iter()
            .filter(|value| **value != 0)
            .map(|value| (*value, 1))
            .collect();
        labels.dedup();
        let index = |value: &i64| {
            labels
                .iter()
                .position(|label| label.0 == *value)
                .map_or(0, |at| at as u8 + 1)
        };
        let voxels = values.iter().map(index).collect();
        self.save(name, &volume([4, 1, 1], voxels, &labels, spacing_mm))
    }

    fn save(&self, name: &str, volume: &LabelVolume) -> PathBuf {
        let path = self.path(name);
        save(volume, &path).unwrap();
        path
    }

    fn write(&self, name: &str, text: &str) -> PathBuf {
        let path = self.path(name);
        fs::write(&path, text).unwrap();
        path
    }
}

fn opened(path: &Path) -> Segmentation {
    open(path, &Naming::default()).unwrap()
}

fn refused(path: &Path) -> String {
    open(path, &Naming::default()).unwrap_err().to_string()
}

fn names(segmentation: &Segmentation) -> Vec<(i64, &str)> {
    let labels = segmentation.volume.labels().iter().skip(1);
    labels
        .map(|label| (label.value, label.name.as_deref().unwrap_or("-")))
        .collect()
}

fn tissue(segmentation: &Segmentation, index: u8) -> String {
    let (table, _) = TissueTable::resolve(segmentation.volume.labels(), &[], Preset::Auto).unwrap();
    table.of(index).name.to_string()
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
    // Skin has the lowest priority; otherwise the last by name takes precedence.
    assert_eq!(whole.volume.voxels(), [4, 1, 2, 2]);
    let counts: Vec<u64> = whole.volume.labels().iter().map(|label| label.voxels).collect();
    assert_eq!(counts, [0, 2, 2, 2, 1]);
    assert_eq!(whole.volume.spacing_mm(), [2.0; 3]);
    assert!(whole.notes[0].contains("5 masks, 1 of them empty"), "{:?}", whole.notes);
    assert!(
        whole.warnings[0].starts_with("3 voxels belong to several"),
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

#[test]
fn tables_beside_a_file_or_given_name_its_labels() {
    let folder = Folder::new();
    let file = folder.row("scan.nrrd", [40, 41, 0, 42], 1.0);
    folder.write("scan.csv", "label,name,voxels\n40,liver,3\n41,\"left kidney\",1\n");
    let beside = opened(&file);
    assert_eq!(names(&beside), [(40, "liver"), (41, "left kidney"), (42, "-")]);
    assert!(beside.notes[0].contains("scan.csv"), "{:?}", beside.notes);
    assert!(
        beside.warnings[0].contains("names no label 42"),
        "{:?}",
        beside.warnings
    );

    let other = folder.write("other.ctbl", "# colours\n0 Background 0 0 0 0\n40 spleen 1 2 3 255\n");
    let naming = |path: &Path| Naming {
        names: Some(Names::read(path).unwrap()),
        ..Naming::default()
    };
    assert_eq!(names(&open(&file, &naming(&other)).unwrap())[0], (40, "spleen"));
    let snap = folder.write("snap.txt", "# ITK-SNAP\n  40  255 0 0  1 1 1  \"right lung\"\n");
    assert_eq!(names(&open(&file, &naming(&snap)).unwrap())[0], (40, "right lung"));
    let slicer = folder.write("slicer.csv", "LabelValue;Name;Color_R\n41;aorta;9\n");
    assert_eq!(names(&open(&file, &naming(&slicer)).unwrap())[1], (41, "aorta"));
    for text in [
        "# mine\n40,liver\n 42 , right kidney\n",
        "40;liver;1\n42;right kidney;2\n",
    ] {
        let headless = open(&file, &naming(&folder.write("headless.csv", text))).unwrap();
        assert_eq!(
            names(&headless),
            [(40, "liver"), (41, "-"), (42, "right kidney")],
            "{text}"
        );
    }

    folder.write("scan.csv", "time,force\n1,2\n");
    let unused = opened(&file);
    assert!(unused.notes[0].contains("not used as label names") && unused.notes[0].contains("time, force"));
}

#[test]
fn tables_that_are_wrong_are_refused_with_their_line() {
    let folder = Folder::new();
    for (text, words) in [
        ("label,name\n1,liver\nx,spleen\n", ["line 3", "\"x\""]),
        ("label,name\n1,liver\n1,spleen\n", ["line 3", "\"spleen\""]),
        ("label,name\n1,\n", ["line 2", "no name"]),
        ("label,name\n1\n", ["line 2", "CSV"]),
        ("label\n1\n", ["line 1", "columns"]),
        ("", ["line 1", "columns"]),
        ("1 liver\n2.5 spleen\n", ["line 2", "2.5"]),
        ("1\n", ["line 1", "no name"]),
        ("1,liver\n2,\n", ["line 2", "no name"]),
        ("1,liver\nvalue,name\n", ["line 2", "\"value\""]),
    ] {
        let message = Names::read(&folder.write("names.csv", text)).unwrap_err().to_string();
        assert!(
            message.contains("names.csv") && words.iter().all(|word| message.contains(word)),
            "{text:?}: {message}"
        );
    }
}

/// Plausible organ volumes by the numbers of BTCV, ml.
const BTCV: [(i64, usize); 13] = [
    (1, 200),
    (2, 150),
    (3, 160),
    (4, 30),
    (5, 13),
    (6, 1178),
    (7, 300),
    (8, 80),
    (9, 60),
    (10, 30),
    (11, 80),
    (12, 4),
    (13, 5),
];

/// Names labels of these values and volumes (ml) by the numbering that fits.
fn read(labels: &[(i64, usize)]) -> (Option<Preset>, Segmentation) {
    let mut segmentation = Segmentation::from(organs(labels));
    let sizes = Sizes::of(&segmentation.volume);
    segmentation.read_values(&Naming::default(), &sizes);
    let preset = segmentation.by_value.as_ref().map(|(preset, _)| *preset);
    (preset, segmentation)
}

#[test]
fn every_numbering_is_recognised_by_organs_of_an_adult() {
    for &preset in Preset::NUMBERINGS {
        let adult_ml = |class: &Class| {
            let organ = without_side(&class.name);
            let (.., adult) = naming::ORGANS.iter().find(|(name, ..)| *name == organ)?;
            Some((class.value, *adult as usize))
        };
        let labels: Vec<(i64, usize)> = preset.classes().iter().filter_map(adult_ml).collect();
        let (recognised, segmentation) = read(&labels);
        assert_eq!(recognised, Some(preset));
        assert!(segmentation.warnings.is_empty(), "{:?}", segmentation.warnings);
    }
}

#[test]
fn the_numbering_is_the_one_that_fits_the_volumes() {
    let (preset, btcv) = read(&BTCV);
    assert_eq!(preset, Some(Preset::Btcv));
    assert_eq!(
        (names(&btcv)[5], names(&btcv)[9].1),
        ((6, "liver"), "portal_vein_and_splenic_vein")
    );
    assert!(btcv.warnings.is_empty(), "{:?}", btcv.warnings);
    assert!(
        btcv.notes[0].contains("BTCV")
            && btcv.notes[0].contains("label 5 (liver) has 13.00 ml, expected 43.3 to 10800"),
        "{:?}",
        btcv.notes
    );
    let mut amos = BTCV.to_vec();
    amos.truncate(9);
    amos.extend([(10, 80), (11, 4), (12, 5), (13, 70)]);
    assert_eq!(read(&amos).0, Some(Preset::Amos));
    amos.extend([(14, 200), (15, 40)]);
    assert_eq!(read(&amos).0, Some(Preset::Amos));

    let total = [(1, 200), (2, 150), (3, 160), (5, 1178), (6, 300), (27, 60)];
    let (preset, total) = read(&total);
    assert_eq!(preset, Some(Preset::TotalSegmentator));
    assert!(total.warnings.is_empty() && total.notes.len() == 1, "{total:?}");
    assert_eq!(read(&[(5, 1178), (150, 3)]).0, None);
}

#[test]
fn values_that_totalsegmentator_does_not_have_are_read_only_as_a_whole_body() {
    let read = |labels: &[(i64, usize)], preset: Preset| {
        let mut segmentation = Segmentation::from(organs(labels));
        let sizes = Sizes::of(&segmentation.volume);
        let naming = Naming {
            preset,
            ..Naming::default()
        };
        segmentation.read_values(&naming, &sizes);
        segmentation
    };
    // A right kidney under a value of this program's own bodies, which TotalSegmentator does not have.
    let strange = [(1, 200), (3, 160), (5, 1178), (6, 300), (200, 150)];
    for preset in [Preset::Auto, Preset::TotalSegmentator] {
        let segmentation = read(&strange, preset);
        assert_eq!(
            (names(&segmentation)[2], names(&segmentation)[4]),
            ((5, "liver"), (200, "-"))
        );
        assert_eq!(segmentation.warnings, ["TotalSegmentator has no label 200 (150.00 ml)"]);
        let info = SegmentationInfo::new(&segmentation, Path::new("a.nrrd"));
        let label = &info.labels[5];
        assert_eq!(
            (label.tissue.as_str(), label.from.as_str()),
            ("soft_tissue", "fallback")
        );
    }
    for few in [&[(5, 1178), (200, 150)][..], &[(200, 150)]] {
        let segmentation = read(few, Preset::Auto);
        assert!(
            names(&segmentation).iter().all(|(_, name)| *name == "-"),
            "{:?}",
            names(&segmentation)
        );
        assert_eq!(segmentation.warnings, ["TotalSegmentator has no label 200 (150.00 ml)"]);
    }
    let body = [
        (1, 200),
        (3, 160),
        (5, 1178),
        (201, 900),
        (202, 900),
        (204, 200),
        (205, 300),
    ];
    let segmentation = read(&body, Preset::Auto);
    let expected = [(201, "fat"), (202, "soft_tissue"), (204, "skin"), (205, "muscle")];
    assert_eq!(names(&segmentation)[3..], expected);
    assert!(segmentation.warnings.is_empty(), "{:?}", segmentation.warnings);
}

#[test]
fn weak_evidence_keeps_the_reading_and_warns() {
    let folder = Folder::new();
    let small = opened(&folder.save("scan.nrrd", &organs(&[(5, 13), (6, 1178)])));
    assert_eq!(names(&small), [(5, "liver"), (6, "stomach")]);
    assert!(
        small.warnings[0].contains("5 liver, 6 stomach") && small.warnings[0].contains("those of BTCV would fit"),
        "{:?}",
        small.warnings
    );
    assert!(
        small.warnings[1].contains("label 5 (liver) has 13.00 ml, expected 43.3 to 10800 ml: name the labels"),
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
fn what_the_edge_of_the_scan_cuts_may_be_small() {
    let doubts = |voxels: &dyn Fn([usize; 3]) -> bool, name: &str| {
        let place = |at: usize| [at % SIDE, at / SIDE % SIDE, at / SIDE / SIDE];
        let voxels: Vec<u8> = (0..SIDE * SIDE * SIDE).map(|at| u8::from(voxels(place(at)))).collect();
        let count = voxels.iter().filter(|voxel| **voxel > 0).count();
        let mut volume = volume([SIDE; 3], voxels, &[(1, count)], 10.0);
        volume.name(1, name.to_owned());
        let segmentation = Segmentation::from(volume);
        segmentation.doubts(&Sizes::of(&segmentation.volume))
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
        segmentation.doubts(&Sizes::of(&segmentation.volume))
    };
    assert_eq!(doubts(named(1, 2)), None);
    let mut mirrored = named(2, 1);
    mirrored.name(1, "kidney_left".to_owned());
    let doubt = doubts(mirrored).unwrap();
    assert!(
        doubt.starts_with("label 2 (kidney_right) lies left of label 1 (kidney_left): check names"),
        "{doubt}"
    );
}
