use std::fs;
use std::path::PathBuf;

use nalgebra::Matrix4;
use tempfile::TempDir;

use super::*;
use crate::acoustics::TissueTable;
use crate::volume::complete::{CompleteOptions, complete};
use crate::volume::save;

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

/// Organs of a torso as boxes: centre (LPS) and half the edges, mm.
const TORSO: [(&str, [f64; 3], [f64; 3]); 19] = [
    ("liver", [-70.0, -20.0, 40.0], [58.0, 50.0, 50.0]),
    ("spleen", [95.0, 40.0, 45.0], [20.0, 35.0, 40.0]),
    ("kidney_right", [-60.0, 58.0, -25.0], [21.0, 21.0, 52.0]),
    ("kidney_left", [60.0, 55.0, -10.0], [21.0, 21.0, 52.0]),
    ("gallbladder", [-35.0, -55.0, -22.0], [14.0, 14.0, 24.0]),
    ("stomach", [50.0, -35.0, 45.0], [32.0, 32.0, 42.0]),
    ("pancreas", [15.0, -5.0, -20.0], [45.0, 14.0, 14.0]),
    ("adrenal_gland_right", [-35.0, 42.0, 43.0], [8.0, 8.0, 11.0]),
    ("adrenal_gland_left", [39.0, 42.0, 46.0], [8.0, 8.0, 11.0]),
    ("esophagus", [6.0, 6.0, 80.0], [8.0, 8.0, 21.0]),
    ("duodenum", [-12.0, -28.0, -45.0], [21.0, 11.0, 20.0]),
    ("colon", [0.0, -70.0, -62.0], [100.0, 15.0, 18.0]),
    ("urinary_bladder", [0.0, -30.0, -87.0], [30.0, 30.0, 11.0]),
    ("aorta", [10.0, 28.0, 0.0], [8.0, 11.0, 200.0]),
    ("inferior_vena_cava", [-20.0, 25.0, 0.0], [11.0, 8.0, 200.0]),
    ("vertebrae_L2", [0.0, 63.0, -70.0], [18.0, 18.0, 28.0]),
    ("vertebrae_L1", [0.0, 63.0, 0.0], [18.0, 18.0, 28.0]),
    ("vertebrae_T12", [0.0, 63.0, 70.0], [18.0, 18.0, 28.0]),
    ("liver_tumor", [-80.0, -20.0, 50.0], [12.0, 12.0, 12.0]),
];

/// A torso of 48 x 36 x 30 voxels of 7 mm with unnamed labels: of these values, each of the organs whose names begin with that of the
/// value, without a side in it on both.
fn torso(labels: &[(i64, &str)]) -> LabelVolume {
    let (size, spacing) = ([48, 36, 30], 7.0);
    let origin = size.map(|n| -0.5 * spacing * (n as f64 - 1.0));
    let mut voxels = vec![0; size.iter().product()];
    for (organ, centre, half) in &TORSO {
        let of = |name: &str| organ.starts_with(name) && (name != "liver" || *organ == "liver");
        let Some(label) = labels.iter().position(|(_, name)| of(name)) else {
            continue;
        };
        for (offset, voxel) in voxels.iter_mut().enumerate() {
            let index = [offset % size[0], offset / size[0] % size[1], offset / size[0] / size[1]];
            let inside = |axis: usize| (origin[axis] + spacing * index[axis] as f64 - centre[axis]).abs() < half[axis];
            if (0..3).all(inside) {
                *voxel = label as u8 + 1;
            }
        }
    }
    let count = |label: usize| voxels.iter().filter(|voxel| usize::from(**voxel) == label + 1).count();
    let labels: Vec<(i64, usize)> = labels
        .iter()
        .zip(0..)
        .map(|((value, _), label)| (*value, count(label)))
        .collect();
    let to_world = Matrix4::new_translation(&origin.into()) * Matrix4::new_scaling(spacing);
    moved(volume(size, voxels, &labels, 1.0), to_world)
}

/// The volume at another place.
fn moved(volume: LabelVolume, to_world: Matrix4<f64>) -> LabelVolume {
    LabelVolume::new(
        volume.size(),
        volume.voxels().to_vec(),
        volume.labels().to_vec(),
        to_world,
    )
    .unwrap()
}

/// A torso in the values of a numbering, of the organs that it has.
fn numbered(preset: Preset) -> LabelVolume {
    let is_here = |name: &str| TORSO.iter().any(|(organ, ..)| organ.starts_with(name));
    let labels: Vec<(i64, &str)> = preset
        .classes()
        .iter()
        .map(|class| (class.value, class.name.as_str()))
        .filter(|(_, name)| is_here(name))
        .collect();
    torso(&labels)
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

/// Notes and warnings about real files.
#[test]
fn real_files_say_what_they_said() {
    for (file, lines) in [
        ("ts_example_seg.nii.gz", &[][..]),
        ("ts_example_seg_full.nii.gz", &[]),
        ("ts_spine_totalseg.nii.gz", &[]),
        ("Segmentation.seg.nrrd", &[]),
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
                "2 labels without names may have the numbers of FLARE21 (1 liver, 2 kidney) on weak evidence; those of FLARE22, WORD, LiTS, \
                 TotalSegmentator lung_vessels, TotalSegmentator liver_vessels fit as well; all stay without a name, as soft tissue: 1 liver or \
                 lung_vessels or liver_vessels, 2 kidney or kidney_right or spleen or liver_tumor or lung_trachea_bronchia: name the labels \
                 with --names FILE or volume.names, choose another volume.preset, or write [[tissue]] with name and labels = [VALUE, ...]",
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
        let said = info.notes.iter().chain(&info.warnings);
        let said: Vec<String> = said.map(|line| line.replace(&folder, "FOLDER")).collect();
        assert_eq!(said, lines, "{file}");
    }
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
    table.tissue(index).name.to_string()
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

    // Colour tables whose names have blanks and numbers.
    for text in [
        "40 Right Kidney 255 0 0 255\n41 Rib 5 1 2 3 255\n42 Aorta 0 0 0 0\n",
        "40\tRight Kidney\t255 0 0\n41 Rib 5 1 2 3\n42 Aorta 0.5 0 0\n",
        "40 Right Kidney\n41 Rib 5\n42 Aorta\n",
    ] {
        let colours = open(&file, &naming(&folder.write("colours.ctbl", text))).unwrap();
        assert_eq!(
            names(&colours),
            [(40, "Right Kidney"), (41, "Rib 5"), (42, "Aorta")],
            "{text}"
        );
    }

    folder.write("scan.csv", "time,force\n1,2\n");
    let unused = opened(&file);
    assert!(unused.notes[0].contains("not used as label names") && unused.notes[0].contains("time, force"));
}

#[test]
fn data_sets_of_nnunet_name_labels() {
    let folder = Folder::new();
    fs::create_dir(folder.path("labelsTr")).unwrap();
    fs::create_dir(folder.path("other")).unwrap();
    let file = folder.row("labelsTr/case.nii.gz", [1, 2, 0, 3], 1.0);
    let of = |text: &str| {
        let names = Names::read(&folder.write("dataset.json", text));
        [1, 2, 3].map(|value| names.as_ref().unwrap().of(value).unwrap_or("-").to_owned())
    };
    let by_name =
        r#"{"labels": {"background": 0, "liver": 1, "left kidney": 2, "spleen": 3}, "file_ending": ".nii.gz"}"#;
    assert_eq!(of(by_name), ["liver", "left kidney", "spleen"]);
    let by_value = r#"{"labels": {"0": "background", "1": "liver", "2": "left kidney"}}"#;
    assert_eq!(of(by_value), ["liver", "left kidney", "-"]);
    let regions = r#"{"labels": {"background": 0, "core": [2, 3], "enhancing": 3, "whole": [1, 2, 3]}}"#;
    assert_eq!(of(regions), ["whole", "core", "enhancing"]);

    of(by_name);
    let found = opened(&file);
    assert_eq!(names(&found), [(1, "liver"), (2, "left kidney"), (3, "spleen")]);
    assert!(
        found.notes[0].contains("named by") && found.notes[0].contains("dataset.json"),
        "{:?}",
        found.notes
    );
    // Near misses: another folder, and a data set of other values.
    let apart = opened(&folder.row("other/case.nii.gz", [1, 2, 0, 3], 1.0));
    assert!(
        !apart.notes.iter().any(|note| note.contains("dataset.json")),
        "{:?}",
        apart.notes
    );
    of(r#"{"labels": {"liver": 7}}"#);
    assert!(!opened(&file).notes.iter().any(|note| note.contains("dataset.json")));

    for (text, words) in [
        (
            "{\"labels\": {\n \"liver\": 1,\n \"spleen\": 1}}",
            ["line 3", "\"spleen\""],
        ),
        ("{\"labels\": {\n \"liver\": 1.5}}", ["line 2", "\"liver\": 1.5"]),
        ("{\"labels\": {\n \"liver\": 1", ["line 2", "EOF"]),
        ("{\"names\": {}}", ["line 1", "no table `labels`"]),
        ("[1, 2]", ["line 1", "dataset.json"]),
    ] {
        let message = Names::read(&folder.write("wrong.json", text)).unwrap_err().to_string();
        assert!(
            message.contains("wrong.json") && words.iter().all(|word| message.contains(word)),
            "{text:?}: {message}"
        );
    }
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

/// Opens a volume from a file of this name.
fn named(name: &str, volume: &LabelVolume) -> Segmentation {
    let folder = Folder::new();
    opened(&folder.save(name, volume))
}

fn preset(segmentation: &Segmentation) -> Option<Preset> {
    segmentation.by_value.as_ref().map(|(preset, _)| *preset)
}

#[test]
fn every_numbering_is_recognised_by_a_torso() {
    for &numbering in Preset::NUMBERINGS {
        let read = named("a.nrrd", &numbered(numbering));
        let thin = matches!(numbering, Preset::Lits | Preset::LungVessels | Preset::LiverVessels);
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

/// A volume with names of TotalSegmentator in the values of a numbering, without names. A class has all labels that it comprises.
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
        let thin = matches!(numbering, Preset::Lits | Preset::LungVessels | Preset::LiverVessels);
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
    // The lobe of a lung, or an entire one, or a pancreas: each as small.
    let labels = [
        (1, "spleen"),
        (2, "kidney_right"),
        (3, "kidney_left"),
        (5, "liver"),
        (18, "duodenum"),
    ];
    let read = named("a.nrrd", &torso(&labels));
    assert_eq!(names(&read)[4], (18, "-"), "{:?}", read.warnings);
    assert_eq!(
        (names(&read)[3], tissue(&read, 5).as_str()),
        ((5, "liver"), "soft_tissue")
    );
    let warning = &read.warnings[0];
    assert!(
        warning.contains("those of TotalSegmentator total_mr") && warning.contains("18 small_bowel or sacrum"),
        "{warning}"
    );
    // The file's name decides.
    let read = named("case3_total_mr.nrrd", &torso(&labels));
    assert_eq!(
        (names(&read)[4], read.warnings.len()),
        ((18, "sacrum"), 0),
        "{:?}",
        read.warnings
    );
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
        (1, 200),
        (3, 160),
        (5, 1178),
        (201, 900),
        (202, 900),
        (204, 200),
        (205, 300),
    ];
    let segmentation = read(organs(&body), Preset::Auto);
    let expected = [(201, "fat"), (202, "soft_tissue"), (204, "skin"), (205, "muscle")];
    assert_eq!(names(&segmentation)[3..], expected);
    assert!(segmentation.warnings.is_empty(), "{:?}", segmentation.warnings);
}

#[test]
fn weak_evidence_warns_and_names_nothing() {
    let folder = Folder::new();
    let small = opened(&folder.save("scan.nrrd", &organs(&[(6, 1178), (5, 13)])));
    assert_eq!(names(&small), [(5, "-"), (6, "-")]);
    assert!(
        small.warnings[0].contains("may have the numbers of BTCV (5 esophagus, 6 liver) on weak evidence; all stay without a name, as soft tissue: name"),
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
            warning.ends_with("in length: check the voxel spacing and its unit, not the names"),
            "{warning}"
        );
    }
    // Near misses: a child, and one odd organ.
    assert!(scaled(0.7).warnings.is_empty(), "{:?}", scaled(0.7).warnings);
    assert!(scaled(1.0).warnings.is_empty());
}

#[test]
fn a_single_label_as_large_as_a_body_is_a_body() {
    let filled = |size: [usize; 3], value: i64, inside: &dyn Fn([usize; 3]) -> bool| {
        let place = |offset: usize| [offset % size[0], offset / size[0] % size[1], offset / size[0] / size[1]];
        let voxels: Vec<u8> = (0..size.iter().product())
            .map(|offset| u8::from(inside(place(offset))))
            .collect();
        let count = voxels.iter().filter(|voxel| **voxel > 0).count();
        named("mask.nii", &volume(size, voxels, &[(value, count)], 10.0))
    };
    let round = |radius: f64| move |[x, y, _]: [usize; 3]| (x as f64 - 20.0).hypot(y as f64 - 15.0) < radius;
    for value in [1, 5, 255] {
        let body = filled([40, 30, 20], value, &round(14.0));
        assert_eq!(names(&body), [(value, "body")]);
        assert!(
            body.notes[0].contains("taken for the body") && body.warnings.is_empty(),
            "{:?}",
            body.warnings
        );
        let completed = complete(&body.volume, &CompleteOptions::default()).unwrap();
        assert!(completed.note.contains("nothing was filled"), "{}", completed.note);
    }
    // Near miss: a liver through all slices.
    let liver = filled([40, 30, 20], 1, &round(6.5));
    assert_eq!(names(&liver), [(1, "-")]);
    assert!(liver.warnings[0].contains("names no tissue"), "{:?}", liver.warnings);
}

#[test]
fn a_background_that_is_not_0_is_guessed_and_told() {
    let organs = numbered(Preset::TotalSegmentator);
    let around = |value: i64| {
        let mut labels = organs.labels().to_vec();
        let last = labels.len() as u8;
        labels.push(Label {
            value,
            ..labels[0].clone()
        });
        labels[0].voxels = 0;
        let voxels = organs
            .voxels()
            .iter()
            .map(|&voxel| if voxel == 0 { last } else { voxel });
        LabelVolume::new(organs.size(), voxels.collect(), labels, *organs.index_to_world()).unwrap()
    };
    let plain = named("a.nrrd", &organs);
    for value in [-1, 255] {
        let read = named("a.nrrd", &around(value));
        assert_eq!(
            (names(&read), read.volume.voxels()),
            (names(&plain), plain.volume.voxels())
        );
        assert_eq!(read.volume.labels()[0].voxels, plain.volume.labels()[0].voxels);
        let told = format!("label {value} (14.9 l) surrounds all others and is taken as unlabelled");
        assert_eq!((&read.notes[0], read.warnings.len()), (&told, 0), "{:?}", read.warnings);
    }
    // Near misses: another value, and 255 that does not surround.
    assert!(
        named("a.nrrd", &around(254))
            .warnings
            .iter()
            .any(|warning| warning.contains("no label 254"))
    );
    let inner = named("a.nrrd", &torso(&[(1, "liver"), (255, "spleen")]));
    assert_eq!(inner.volume.labels().len(), 3);
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
