use nalgebra::{Matrix4, Vector3};

use super::super::CompleteOptions;
use super::super::tests::nifti;
use super::*;

const SIZE: [usize; 3] = [100, 100, 40];
const SPACING_MM: f64 = 2.0;

fn place(at: usize) -> Vector3<f64> {
    let [nx, ny, _] = SIZE;
    SPACING_MM
        * (Vector3::new((at % nx) as f64, (at / nx % ny) as f64, (at / nx / ny) as f64)
            - Vector3::new(50.0, 50.0, 20.0))
}

/// A trunk of 75 mm radius: fat from 62 mm outwards, a wall of muscle, a liver and a bowel in fat, on a table.
fn trunk() -> (LabelVolume, ScalarImage) {
    let liver = |p: &Vector3<f64>| (p - Vector3::new(-25.0, 0.0, 0.0)).xy().norm() < 25.0;
    let bowel = |p: &Vector3<f64>| (p - Vector3::new(35.0, 0.0, 0.0)).xy().norm() < 16.0;
    let bone = |p: &Vector3<f64>| (p - Vector3::new(0.0, 45.0, 0.0)).xy().norm() < 12.0;
    let grey = |p: &Vector3<f64>| match p.xy().norm() {
        _ if (86.0..90.0).contains(&p.y) => 100.0,
        r if r > 75.0 => -1000.0,
        r if r > 62.0 => -100.0,
        r if r > 54.0 => 55.0,
        _ if liver(p) && (p - Vector3::new(-25.0, 0.0, 0.0)).xz().norm() < 6.0 => 180.0,
        _ if liver(p) => 100.0,
        _ if bowel(p) && p.y < 0.0 => -900.0,
        _ if bowel(p) => 20.0,
        _ if bone(p) => 500.0,
        _ if (p - Vector3::new(0.0, -40.0, 0.0)).norm() < 10.0 => -800.0,
        _ => -90.0,
    };
    let count = SIZE.iter().product();
    let labels = (0..count).map(|at| match place(at) {
        p if liver(&p) => 1,
        p if bowel(&p) => 2,
        p if p.xy().norm() < 62.0 && bone(&p) => 3,
        _ => 0,
    });
    let table = [(0, ""), (5, "liver"), (20, "colon"), (27, "vertebrae_L5")];
    let table = table.map(|(value, name)| Label {
        value,
        name: (value != 0).then(|| name.to_owned()),
        voxels: 9,
    });
    let index_to_world = Matrix4::new_scaling(SPACING_MM);
    let image = ScalarImage {
        size: SIZE,
        spacing_mm: [SPACING_MM; 3],
        index_to_world,
        data: (0..count).map(|at| grey(&place(at))).collect(),
    };
    (
        LabelVolume::new(SIZE, labels.collect(), table.to_vec(), index_to_world).unwrap(),
        image,
    )
}

fn name_at(volume: &LabelVolume, p: [f64; 3]) -> String {
    let world = Vector3::from(p) + SPACING_MM * Vector3::new(50.0, 50.0, 20.0);
    let label = volume.label_index_at(&world.into()).unwrap();
    volume.labels()[usize::from(label)].name.clone().unwrap_or_default()
}

#[test]
fn grey_values_say_what_is_unlabelled() {
    let (labels, ct) = trunk();
    let done = with_ct(&labels, &ct, &CompleteOptions::default()).unwrap();
    println!("{}", done.note);
    assert_eq!(done.warning, None);
    for (p, expected) in [
        ([0.0, -74.0, 0.0], "skin"),
        ([0.0, -68.0, 0.0], "fat"),
        ([0.0, -58.0, 0.0], "muscle"),
        ([0.0, -40.0, 0.0], "gas"),
        ([8.0, 20.0, 0.0], "peritoneal_fat"),
        ([-25.0, 15.0, 12.0], "liver"),
        ([-25.0, 0.0, 0.0], "hepatic_vein"),
        ([35.0, -8.0, 0.0], "gas"),
        ([35.0, 8.0, 0.0], "colon"),
        ([0.0, 45.0, 0.0], "vertebrae_L5"),
        ([0.0, 88.0, 0.0], ""),
        ([70.0, 70.0, 0.0], ""),
    ] {
        assert_eq!(name_at(&done.volume, p), expected, "{p:?}");
    }
}

#[test]
fn a_ct_that_lies_elsewhere_is_refused_and_a_doubtful_one_questioned() {
    let (labels, mut ct) = trunk();
    ct.index_to_world.append_translation_mut(&Vector3::new(100.0, 0.0, 0.0));
    let error = with_ct(&labels, &ct, &CompleteOptions::default()).unwrap_err();
    assert_eq!(error.key(), Some("ct"));
    let text = error.to_string();
    let share = text
        .strip_prefix("the CT covers ")
        .and_then(|rest| rest.split_once(" %"));
    let share: f64 = share.expect(&text).0.parse().expect(&text);
    assert!((10.0..90.0).contains(&share), "{text}");
    let (labels, mut ct) = trunk();
    ct.data.iter_mut().for_each(|hu| *hu += 1000.0);
    let warning = with_ct(&labels, &ct, &CompleteOptions::default())
        .unwrap()
        .warning
        .unwrap();
    assert!(warning.contains("median of 1100 in the CT"), "{warning}");
    let (labels, mut ct) = trunk();
    ct.data.iter_mut().for_each(|hu| *hu = -hu.abs());
    let error = with_ct(&labels, &ct, &CompleteOptions::default())
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("solid organs") && error.contains("the bones have a median of -"),
        "{error}"
    );
}

/// Two scans of one patient whose grids coincide: that of the liver has not the CT of the pelvis.
#[test]
fn the_ct_of_another_region_is_refused() {
    let Some(path) = insonify_testing::shared("volumes/ts_example_seg.nii.gz") else {
        return;
    };
    let labels = crate::segmentation::open(&path, &Default::default()).unwrap().volume;
    let of = |name: &str| {
        let path = insonify_testing::shared(&format!("volumes/{name}")).unwrap();
        with_ct(
            &labels,
            &crate::volume::load_scalar(&path).unwrap(),
            &CompleteOptions::default(),
        )
    };
    let error = of("ts_example_ct.nii.gz").unwrap_err().to_string();
    assert!(
        error.contains("the lungs have a median of") && error.contains("the bones have"),
        "{error}"
    );
    let own = of("ts_example_ct_sm.nii.gz").unwrap();
    assert_eq!(own.warning, None);
    let labels_as_ct = of("ts_example_seg.nii.gz").unwrap_err().to_string();
    assert!(labels_as_ct.contains("the lungs have a median of"), "{labels_as_ct}");
}

/// The body of the example of TotalSegmentator, whose unlabelled voxels were classified elsewhere by the same limits
/// without smoothing.
#[test]
fn a_real_ct_gives_the_classes_that_its_voxels_were_given_elsewhere() {
    let Some(labels) = nifti("ts_example_seg_full.nii.gz") else {
        return;
    };
    let [known, ct] = ["DERIVED_ts_example_body_labels.nii.gz", "ts_example_ct.nii.gz"]
        .map(|name| insonify_testing::shared(&format!("volumes/{name}")).unwrap());
    let known = crate::volume::load(&known).unwrap().volume;
    let ct = crate::volume::load_scalar(&ct).unwrap();
    let done = with_ct(&labels, &ct, &CompleteOptions::default()).unwrap();
    println!("{}", done.note);
    let class = |name: Option<&str>| match name {
        Some("fat" | "peritoneal_fat") => 201,
        Some("soft_tissue" | "muscle") => 202,
        Some("gas") => 200,
        Some("dense") => 203,
        Some("skin") => 204,
        _ => 0,
    };
    let mut table = std::collections::BTreeMap::<(i64, i64), u64>::new();
    for (at, old) in labels.voxels().iter().enumerate().filter(|(_, old)| **old == 0) {
        let ours = class(
            done.volume.labels()[usize::from(done.volume.voxels()[at])]
                .name
                .as_deref(),
        );
        let theirs = known.labels()[usize::from(known.voxels()[at])].value;
        *table.entry((ours, theirs)).or_default() += u64::from(*old == 0);
    }
    println!("{table:?}");
    // Outside the body both are unlabelled.
    table.remove(&(0, 0));
    let all: u64 = table.values().sum();
    let same: u64 = table
        .iter()
        .filter(|((ours, theirs), _)| ours == theirs)
        .map(|(_, count)| count)
        .sum();
    let share = same as f64 / all as f64;
    assert!(share > 0.9, "{share}: {table:?}");
}
