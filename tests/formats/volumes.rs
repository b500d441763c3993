use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;

use insonify::Blame;
use insonify_anatomy::segmentation::SegmentationInfo;
use insonify_anatomy::volume::{self, LabelVolume, Loaded};
use nalgebra::{Point3, Vector3};

use crate::data;

fn counts(volume: &LabelVolume) -> BTreeMap<i64, u64> {
    volume
        .labels()
        .iter()
        .map(|label| (label.value, label.voxels))
        .collect()
}

/// The stored counts are those of the voxels, where no layers were flattened.
fn recount(volume: &LabelVolume) {
    let mut found = vec![0; volume.labels().len()];
    for &voxel in volume.voxels() {
        found[usize::from(voxel)] += 1;
    }
    let told: Vec<u64> = volume.labels().iter().map(|label| label.voxels).collect();
    assert_eq!(found, told);
}

fn load(name: &str) -> Option<Loaded> {
    let path = data(name)?;
    let loaded = volume::load(&path).unwrap_or_else(|error| panic!("{error}"));
    recount(&loaded.volume);
    Some(loaded)
}

fn refused(name: &str, expected: &str) {
    if let Some(path) = data(name) {
        let error = volume::load(&path).expect_err("should be refused");
        let message = error.to_string();
        assert!(
            message.contains(expected) && message.contains(name),
            "{message} should hold {expected}"
        );
        assert!(!error.is_machine());
    }
}

/// Sum of all values, computed from labels.
fn sum(volume: &LabelVolume) -> i64 {
    volume
        .labels()
        .iter()
        .map(|label| label.value * label.voxels as i64)
        .sum()
}

#[test]
fn totalsegmentator_counts_are_those_of_its_list() {
    let (Some(loaded), Some(list)) = (
        load("volumes/tsd_s0328_labels.nii.gz"),
        data("volumes/tsd_s0328_labels.csv"),
    ) else {
        return;
    };
    assert_eq!(loaded.volume.size(), [265, 265, 269]);
    for spacing in loaded.volume.spacing_mm() {
        assert!((spacing - 1.5).abs() < 1e-6);
    }
    let mut listed = BTreeMap::new();
    for row in std::fs::read_to_string(list).unwrap().lines().skip(1) {
        let mut columns = row.split(',');
        let value: i64 = columns.next().unwrap().parse().unwrap();
        let voxels: u64 = columns.nth(1).unwrap().parse().unwrap();
        if voxels > 0 {
            listed.insert(value, voxels);
        }
    }
    let mut found = counts(&loaded.volume);
    found.remove(&0);
    assert_eq!(found.len(), 69);
    assert!(found.keys().eq(listed.keys()));
    // The list counts the masks of the classes, of which 2269 voxels lie in two; the file gives each to one.
    let lost: u64 = found
        .iter()
        .map(|(value, voxels)| listed[value].checked_sub(*voxels).unwrap())
        .sum();
    assert_eq!(lost, 2269);
    assert_eq!(
        (found[&1], found[&4], found[&5], found[&25]),
        (62_826, 17_782, 600_157, 56_825)
    );
}

#[test]
fn header_extensions_name_labels() {
    let Some(loaded) = load("volumes/ts_example_seg_full.nii.gz") else {
        return;
    };
    let labels = loaded.volume.labels();
    assert_eq!((loaded.volume.size(), labels.len()), ([122, 101, 112], 62));
    for (value, name, voxels) in [
        (5, "liver", 41_692),
        (2, "kidney_right", 7134),
        (52, "aorta", 1839),
        (27, "vertebrae_L5", 2508),
    ] {
        let label = labels.iter().find(|label| label.value == value).unwrap();
        assert_eq!((label.name.as_deref(), label.voxels), (Some(name), voxels));
    }
    assert!(labels[1..].iter().all(|label| label.name.is_some()));
    assert_eq!(labels.last().unwrap().value, 117);
    if let Some(crop) = load("volumes/ts_example_seg.nii.gz") {
        assert_eq!((crop.volume.size(), crop.volume.labels().len()), ([122, 101, 30], 42));
    }
    if let Some(spine) = load("volumes/ts_spine_totalseg.nii.gz") {
        let values: Vec<i64> = counts(&spine.volume).into_keys().collect();
        assert_eq!(values, [0, 26, 27, 28, 29, 30, 31, 32, 33]);
        assert_eq!(spine.volume.labels()[1].name.as_deref(), Some("vertebrae_S1"));
        assert_eq!(spine.volume.index_to_world(), loaded.volume.index_to_world());
    }
}

#[test]
fn filled_body_has_its_counts() {
    if let Some(loaded) = load("volumes/DERIVED_ts_example_body_labels.nii.gz") {
        let found = counts(&loaded.volume);
        let expected = [(200, 1176), (201, 355_865), (202, 141_777), (203, 1712), (204, 33_135)];
        for (value, voxels) in expected {
            assert_eq!(found[&value], voxels, "{value}");
        }
    }
}

#[test]
fn slicer_segments_have_names_and_counts() {
    let Some(loaded) = load("volumes/Segmentation.seg.nrrd") else {
        return;
    };
    let found: Vec<_> = loaded.volume.labels()[1..]
        .iter()
        .map(|label| (label.value, label.name.as_deref().unwrap(), label.voxels))
        .collect();
    let expected = [
        (1, "ribs", 8487),
        (2, "cervical vertebral column", 1216),
        (3, "thoracic vertebral column", 2712),
        (4, "lumbar vertebral column", 3259),
        (5, "right lung", 34_450),
        (6, "left lung", 33_700),
        (7, "tissue", 154_589),
    ];
    assert_eq!(found, expected);
    let info = SegmentationInfo::new(&loaded.clone().into(), Path::new("x"));
    assert_eq!(info.orientation, "RAS");
    assert_eq!(info.origin_mm[2], -340.249_999_999_999_94);
    assert!((info.spacing_mm[0] - 3.046_875_953_674_32).abs() < 1e-12);
}

#[test]
fn plain_label_maps_have_their_counts() {
    if let Some(loaded) = load("volumes/dcmqi_liver_spine_seg.nrrd") {
        let found = counts(&loaded.volume);
        assert_eq!((found[&1], found[&2], found.len()), (107_098, 12_439, 3));
        assert_eq!(loaded.volume.size(), [512, 512, 3]);
    }
    if let Some(loaded) = load("rf/MouseLiverRF-label.mha") {
        assert_eq!(counts(&loaded.volume)[&1], 415_390);
        assert_eq!(loaded.volume.size(), [1536, 128, 4]);
    }
}

#[test]
fn grey_images_are_told_from_labels() {
    for name in ["formats/niivue_mha.mha", "rf/MouseLiverRF.mha"] {
        refused(name, "is this a grey image, such as a reconstructed volume");
    }
    for name in [
        "volumes/CTChest4.nrrd",
        "volumes/ts_example_ct.nii.gz",
        "volumes/ts_example_ct_sm.nii.gz",
        "formats/niivue_shear_crop.nii.gz",
    ] {
        refused(
            name,
            "HU), expected labels: give its segmentation; `--ct`, or `volume.ct` of a scene, takes the CT",
        );
    }
    refused(
        "formats/niivue_LPS.nii.gz",
        "expected a whole number: this is no label volume",
    );
    refused(
        "formats/niivue_PIL.nii.gz",
        "expected a whole number: this is no label volume",
    );
}

#[test]
fn grey_images_of_one_byte_load_as_they_are() {
    if let Some(loaded) = load("volumes/plus_SpinePhantomFreehandReconstructed.mha") {
        assert_eq!(loaded.volume.size(), [147, 106, 104]);
        assert_eq!(loaded.volume.spacing_mm(), [0.5; 3]);
    }
    if let Some(loaded) = load("textures/MouseLiverB.mha") {
        let info = SegmentationInfo::new(&loaded.clone().into(), Path::new("x"));
        assert_eq!((info.orientation.as_str(), info.size), ("PLS", [128, 512, 4]));
    }
    if let Some(loaded) = load("formats/niivue_ras.hdr") {
        let again = volume::load(&data("formats/niivue_ras.img").unwrap()).unwrap();
        assert_eq!(again.volume.voxels(), loaded.volume.voxels());
        assert_eq!(
            SegmentationInfo::new(&loaded.clone().into(), Path::new("x")).orientation,
            "RAS"
        );
    }
}

#[test]
fn every_encoding_of_the_ball_is_the_same_ball() {
    for name in [
        "BallBinary30x30x30.nhdr",
        "BallBinary30x30x30.nrrd",
        "BallBinary30x30x30_byteskip_minus_one.nhdr",
        "BallBinary30x30x30_bz2.nrrd",
        "BallBinary30x30x30_gz.nrrd",
        "BallBinary30x30x30_gz_lineskip.nrrd",
    ] {
        if let Some(loaded) = load(&format!("formats/pynrrd/{name}")) {
            assert_eq!(sum(&loaded.volume), 3_682_296, "{name}");
            assert_eq!(loaded.volume.size(), [30; 3]);
        }
    }
}

#[test]
fn flat_and_long_nrrd_images() {
    if let Some(loaded) = load("formats/pynrrd/test2d_ascii.nrrd") {
        assert_eq!(loaded.volume.size(), [3, 9, 1]);
        assert_eq!(sum(&loaded.volume), 27 * 28 / 2);
        assert_eq!(loaded.volume.spacing_mm(), [1.0458, 2.0, 1.0]);
    }
    refused("formats/pynrrd/test_simple4d_raw.nrrd", "voxel (0, 0, 0) is 0.769034");
    for name in [
        "NwirePhantomFreehand.igs.nrrd",
        "NwirePhantomFreehandCropped.igs.mha",
        "Prostate10_tracker.igs.mha",
    ] {
        refused(
            &format!("tracked/{name}"),
            "a recording of tracked frames is not supported",
        );
    }
}

#[test]
fn other_formats_are_named() {
    for (name, expected) in [
        (
            "tracked/SlidingProbeTrackingData.igs.mha",
            "a recording of tracked frames is not supported",
        ),
        (
            "textures/gdcm-US-ALOKA-16.dcm",
            "an ultrasound image in DICOM is not supported",
        ),
        ("meshes/aigt_NeedleModel.vtk", "a VTK surface is not supported"),
        ("meshes/plus_Needle_20cm.stl", "an STL surface is not supported"),
        ("meshes/DERIVED_s0328_liver.obj", "an OBJ surface is not supported"),
        (
            "meshes/DERIVED_s0328_3organ_tet.vtu",
            "a mesh is not supported; give a volume of labels",
        ),
        (
            "formats/pynrrd/BallBinary30x30x30.raw",
            "numbers without a header is not supported; give its header",
        ),
    ] {
        refused(name, expected);
    }
    let missing = insonify_anatomy::volume::load("/nowhere/no_such_file.nrrd".as_ref())
        .map(drop)
        .unwrap_err()
        .to_string();
    assert!(missing.contains("cannot be read"), "{missing}");
}

/// A scan with its grey scale taken away, so that its stored bytes load as labels.
fn without_scale(name: &str) -> Option<LabelVolume> {
    let packed = std::fs::read(data(name)?).unwrap();
    let mut bytes = Vec::new();
    flate2::read::GzDecoder::new(&packed[..])
        .read_to_end(&mut bytes)
        .unwrap();
    bytes[112..116].copy_from_slice(&1f32.to_le_bytes());
    bytes[116..120].copy_from_slice(&0f32.to_le_bytes());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("plain.nii");
    std::fs::write(&path, bytes).unwrap();
    Some(volume::load(&path).unwrap().volume)
}

/// Centre of the bright voxels in the world, mm.
fn bright_centre(volume: &LabelVolume) -> Vector3<f64> {
    let [x, y, _] = volume.size();
    let mut sum = Vector3::zeros();
    let mut count = 0.0;
    for (at, &voxel) in volume.voxels().iter().enumerate() {
        if volume.labels()[usize::from(voxel)].value > 100 {
            let index = Point3::new((at % x) as f64, (at / x % y) as f64, (at / x / y) as f64);
            sum += volume.index_to_world().transform_point(&index).coords;
            count += 1.0;
        }
    }
    sum / count
}

#[test]
fn two_orientations_of_one_scene_agree_in_the_world() {
    let (Some(first), Some(second)) = (
        without_scale("formats/niivue_LPS.nii.gz"),
        without_scale("formats/niivue_PIL.nii.gz"),
    ) else {
        return;
    };
    let letters = |volume| SegmentationInfo::new(&LabelVolume::clone(volume).into(), Path::new("x")).orientation;
    assert_eq!(
        (letters(&first), letters(&second)),
        ("LPS".to_owned(), "PIL".to_owned())
    );
    let apart = (bright_centre(&first) - bright_centre(&second)).norm();
    let voxel = first.spacing_mm().into_iter().fold(0.0, f64::max);
    assert!(apart < voxel, "{apart} mm apart with voxels of {voxel} mm");
}

#[test]
fn scalars_keep_scale_size_and_spacing() {
    if let Some(path) = data("volumes/ts_example_ct.nii.gz") {
        let image = volume::load_scalar(&path).unwrap();
        assert_eq!(image.size, [122, 101, 112]);
        let range = image
            .data
            .iter()
            .fold((f32::MAX, f32::MIN), |(low, high), &n| (low.min(n), high.max(n)));
        assert_eq!(range, (-1207.0, 3382.0));
    }
    if let Some(path) = data("formats/niivue_shear_crop.nii.gz") {
        let image = volume::load_scalar(&path).unwrap();
        assert_eq!(image.size, [64, 64, 32]);
        assert!(image.data.iter().all(|&n| n >= -1024.0), "slope 7.11, intercept -1024");
    }
    if let Some(path) = data("textures/MouseLiverB.mha") {
        let image = volume::load_scalar(&path).unwrap();
        assert_eq!(
            (image.size, image.spacing_mm),
            ([128, 512, 4], [0.1, 0.038_575_299_999_999_99, 0.1])
        );
    }
}
