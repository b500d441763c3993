use std::collections::HashSet;
use std::io::Read;

use nalgebra::{Matrix4, Point3, Vector3};

use super::*;
use insonify_testing::made_on;

fn label(value: i64, name: Option<&str>) -> Label {
    Label {
        value,
        name: name.map(str::to_owned),
        voxels: 0,
    }
}

/// A trunk of organs: an upright ring of rods around a column, in a larger box.
fn trunk(spacing: [f64; 3]) -> LabelVolume {
    let size = [0, 1, 2].map(|axis| ([300.0, 260.0, 150.0][axis] / spacing[axis]) as usize);
    let centre = Vector3::new(150.0, 130.0, 0.0);
    let mut voxels = vec![0; size.iter().product()];
    for (at, voxel) in voxels.iter_mut().enumerate() {
        let index = Vector3::new(at % size[0], at / size[0] % size[1], at / (size[0] * size[1]));
        let p = index.map(|i| i as f64).component_mul(&Vector3::from(spacing)) - centre;
        for rod in 0..8 {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(rod) / 8.0).sin_cos();
            if (p.x - 80.0 * cos).hypot(p.y - 60.0 * sin) < 12.0 {
                *voxel = 1;
            }
        }
        // Every other stretch of the column is unlabelled.
        if p.x.hypot(p.y) < 15.0 && (p.z / 20.0) as i64 % 2 == 0 {
            *voxel = 2;
        }
    }
    let to_world = Matrix4::new_nonuniform_scaling(&Vector3::from(spacing));
    LabelVolume::new(
        size,
        voxels,
        vec![label(0, None), label(5, Some("liver")), label(9, Some("aorta"))],
        to_world,
    )
    .unwrap()
}

fn run(volume: &LabelVolume) -> Completed {
    complete(volume, &CompleteOptions::default()).unwrap()
}

/// No voxel of the body except skin touches air across a face, other than through faces of the box.
fn skin_is_closed(volume: &LabelVolume) {
    let size = volume.size();
    let skin = volume
        .labels()
        .iter()
        .position(|l| l.name.as_deref() == Some("skin"))
        .unwrap() as u8;
    let voxels = volume.voxels();
    let strides = [1, size[0], size[0] * size[1]];
    for at in 0..voxels.len() {
        for axis in 0..3 {
            if at / strides[axis] % size[axis] + 1 < size[axis] {
                let pair = [voxels[at], voxels[at + strides[axis]]];
                if pair.contains(&0) {
                    assert!(pair.iter().all(|&l| l == 0 || l == skin), "{pair:?} at {at}");
                }
            }
        }
    }
}

#[test]
fn a_trunk_gets_soft_tissue_fat_and_skin_of_the_stated_thickness() {
    for spacing in [[2.0, 2.0, 3.0], [1.0, 2.0, 5.0]] {
        let before = trunk(spacing);
        let done = run(&before);
        let after = &done.volume;
        assert_eq!(after.size(), before.size());
        for (old, new) in before.voxels().iter().zip(after.voxels()) {
            assert!(*old == 0 || old == new, "labels stay");
        }
        skin_is_closed(after);
        let name = |p: [f64; 3]| {
            let at = after.label_index_at(&Point3::from(p)).unwrap();
            after.labels()[usize::from(at)].name.clone().unwrap_or_default()
        };
        // Between the rods, and in an unlabelled stretch of the column.
        assert_eq!(name([150.0, 130.0, 30.0]), "soft_tissue");
        assert_eq!(name([190.0, 130.0, 75.0]), "soft_tissue");
        // Outwards along the rod at (80, 0): its edge at 92 mm, then soft tissue, fat, skin, air.
        let mut lengths = std::collections::BTreeMap::<String, f64>::new();
        for step in 0..1400 {
            *lengths
                .entry(name([150.0 + f64::from(step) * 0.1, 130.0, 75.0]))
                .or_insert(0.0) += 0.1;
        }
        // The wall beyond the rod is thinner than the muscle, which takes all of it and no label.
        assert!(
            lengths["muscle"] <= WALL_MM + 12.0 * UNEVEN + 1.5 * spacing[0],
            "{lengths:?}"
        );
        assert!(
            (lengths["fat"] - 12.0).abs() <= 1.5 * spacing[0] + 12.0 * UNEVEN,
            "{lengths:?}"
        );
        let skin = 2.0f64.max(spacing.iter().copied().fold(0.0, f64::max));
        assert!((lengths["skin"] - skin).abs() <= 1.5 * spacing[0], "{lengths:?}");
        let body = 140.0 - lengths[""];
        assert!(
            (body - (92.0 + WALL_MM + 12.0 + skin)).abs() < 6.0,
            "{body} mm: {lengths:?}"
        );
        let count = |name: &str| {
            let at = after
                .labels()
                .iter()
                .position(|l| l.name.as_deref() == Some(name))
                .unwrap();
            after.voxels().iter().filter(|&&v| usize::from(v) == at).count() as u64
        };
        assert_eq!(done.filled.soft_tissue, count("soft_tissue"));
        assert_eq!(done.filled.muscle, count("muscle") + count("muscle_internal"));
        let undivided = done.volume.undivided();
        let middle = after
            .labels()
            .iter()
            .position(|l| l.name.as_deref() == Some("muscle_internal"));
        assert!(after.holds(middle.unwrap()) && !undivided.holds(middle.unwrap()));
        assert_eq!(done.filled.fat, count("fat"));
        assert_eq!(done.filled.skin, count("skin"));
        assert!(
            done.note.contains("12 mm of fat") && !done.note.contains("edge of the volume"),
            "{}",
            done.note
        );
    }
}

#[test]
fn fat_and_muscle_are_uneven_about_their_stated_thickness() {
    let done = run(&trunk([2.0, 2.0, 3.0])).volume;
    let thickness = |wanted: &[&str], angle: f64, z: f64| {
        let (sin, cos) = angle.sin_cos();
        let at = |r: f64| Point3::new(150.0 + r * cos, 130.0 + r * sin, z);
        let of = |step: i32| {
            let label = done.label_index_at(&at(0.1 * f64::from(step)))?;
            done.labels()[usize::from(label)].name.as_deref()
        };
        0.1 * (600..1500)
            .filter(|step| of(*step).is_some_and(|name| wanted.contains(&name)))
            .count() as f64
    };
    // Perpendicular to the outline along the axes of the ellipse only, so angles near the ends of the long one.
    let all = |wanted: &[&str]| -> Vec<f64> {
        let places = (0..48).flat_map(|z| {
            [-8.0, 0.0, 8.0, 172.0, 180.0, 188.0].map(|angle| (f64::to_radians(angle), 3.0 * f64::from(z)))
        });
        places.map(|(angle, z)| thickness(wanted, angle, z)).collect()
    };
    let fat = all(&["fat"]);
    let mean = insonify_base::statistics::mean(&fat);
    let std = insonify_base::statistics::std(&fat);
    println!("fat of {mean:.2} +- {std:.2} mm");
    // The noise is a mean of at most eight uniform numbers: a third to a half of its range.
    assert!(
        (mean - 12.0).abs() < 1.5 && (0.8..3.0).contains(&std),
        "{mean} +- {std}"
    );
    let middle = insonify_base::statistics::mean(&all(&["muscle_internal"]));
    assert!(middle > 0.5, "{middle}");
}

#[test]
fn slices_lie_along_the_axis_closest_to_the_worlds_z() {
    let upright = trunk([3.0; 3]);
    let [nx, ny, nz] = upright.size();
    // The same body with permuted index axes: i runs along z, j along x, k along y.
    let mut voxels = vec![0; nx * ny * nz];
    for (at, &v) in upright.voxels().iter().enumerate() {
        let [x, y, z] = [at % nx, at / nx % ny, at / (nx * ny)];
        voxels[z + nz * (x + nx * y)] = v;
    }
    let turned = Matrix4::new(
        0.0, 3.0, 0.0, 0.0, //
        0.0, 0.0, 3.0, 0.0, //
        3.0, 0.0, 0.0, 0.0, //
        0.0, 0.0, 0.0, 1.0,
    );
    let other = LabelVolume::new([nz, nx, ny], voxels, upright.labels().to_vec(), turned).unwrap();
    let (a, b) = (run(&upright).filled, run(&other).filled);
    let close = |a: u64, b: u64| (a as f64 / b as f64 - 1.0).abs() < 1e-3;
    assert!(
        close(a.soft_tissue, b.soft_tissue)
            && close(a.muscle, b.muscle)
            && close(a.fat, b.fat)
            && close(a.skin, b.skin),
        "{a:?} {b:?}"
    );
}

#[test]
fn volumes_with_a_body_and_empty_ones_stay_as_they_are() {
    let plain = trunk([4.0; 3]);
    for named in [
        label(3, Some("Subcutaneous fat")),
        label(3, Some("skin")),
        label(1, Some("phantom_top")),
    ] {
        let mut labels = plain.labels().to_vec();
        labels.push(named);
        let volume = LabelVolume::new(plain.size(), plain.voxels().to_vec(), labels, *plain.index_to_world()).unwrap();
        let done = run(&volume);
        assert_eq!(done.filled, Filled::default());
        assert_eq!(done.volume.voxels(), volume.voxels());
    }
    let by_value = |values: [i64; 3]| {
        let row = values.map(|value| Label {
            voxels: 9,
            ..label(value, None)
        });
        let labels = plain.labels().iter().cloned().chain(row).collect();
        LabelVolume::new(plain.size(), plain.voxels().to_vec(), labels, *plain.index_to_world()).unwrap()
    };
    assert!(has_body(&by_value([201, 202, 204])));
    assert!(!has_body(&by_value([200, 203, 204])) && !has_body(&by_value([1, 2, 200])));
    let empty = LabelVolume::new([4, 4, 4], vec![0; 64], vec![label(0, None)], Matrix4::identity()).unwrap();
    assert_eq!(run(&empty).filled, Filled::default());
    let mut thin = *plain.index_to_world();
    thin.column_mut(1).scale_mut(1e-38);
    let thin = LabelVolume::new(plain.size(), plain.voxels().to_vec(), plain.labels().to_vec(), thin).unwrap();
    assert_eq!(run(&thin).filled, Filled::default());
    let phantom = crate::phantom::make(
        crate::phantom::Phantom::TwoLayer,
        &crate::phantom::PhantomOptions {
            resolution_mm: Some(4.0),
            seed: 0,
        },
    )
    .unwrap();
    assert_eq!(run(&phantom).filled, Filled::default());
}

#[test]
fn air_and_tissue_do_as_they_say() {
    let volume = trunk([4.0; 3]);
    let mode = |mode| CompleteOptions {
        mode,
        ..CompleteOptions::default()
    };
    let air = complete(&volume, &mode(Unlabelled::Air)).unwrap();
    assert_eq!(air.volume.voxels(), volume.voxels());
    let tissue = complete(&volume, &mode(Unlabelled::Tissue)).unwrap();
    assert!(!tissue.volume.voxels().contains(&0));
    assert_eq!(
        tissue.filled.soft_tissue as usize,
        volume.voxels().iter().filter(|&&v| v == 0).count()
    );
}

#[test]
fn labels_get_values_that_are_free_and_thicknesses_are_checked() {
    let plain = trunk([4.0; 3]);
    let mut labels = plain.labels().to_vec();
    labels.push(label(202, Some("pebble")));
    let volume = LabelVolume::new(plain.size(), plain.voxels().to_vec(), labels, *plain.index_to_world()).unwrap();
    let done = run(&volume);
    assert!(
        done.note.contains("soft_tissue is label 203, not 202 as usual") && !done.note.contains("skin is"),
        "{}",
        done.note
    );
    assert!(!run(&plain).note.contains("as usual"));
    let values: Vec<i64> = done.volume.labels().iter().map(|l| l.value).collect();
    assert_eq!(values.iter().collect::<HashSet<_>>().len(), values.len(), "{values:?}");
    for fat_mm in [-1.0, f64::NAN, 101.0] {
        let options = CompleteOptions {
            fat_mm,
            ..CompleteOptions::default()
        };
        assert!(matches!(
            complete(&plain, &options),
            Err(VolumeError::Value {
                key: Some("fat_mm"),
                ..
            })
        ));
    }
    let none = CompleteOptions {
        muscle_mm: 0.0,
        ..CompleteOptions::default()
    };
    let (with, without) = (run(&plain).filled, complete(&plain, &none).unwrap().filled);
    assert_eq!(without.muscle, 0);
    assert_eq!(with.soft_tissue + with.muscle, without.soft_tissue);
    assert_eq!((with.fat, with.skin), (without.fat, without.skin));
    let mut full = plain.labels().to_vec();
    full.extend((0..252).map(|v| label(1000 + v, Some("x"))));
    let full = LabelVolume::new(plain.size(), plain.voxels().to_vec(), full, *plain.index_to_world()).unwrap();
    assert!(complete(&full, &CompleteOptions::default()).is_err());
}

#[test]
fn a_body_around_few_organs_is_questioned() {
    let warning = |names: &[&str]| {
        let row = names.iter().zip(1..).map(|(name, value)| Label {
            voxels: 5,
            ..label(value, (*name != "-").then_some(*name))
        });
        shell(&std::iter::once(label(0, None)).chain(row).collect::<Vec<_>>())
    };
    let one = warning(&["kidney_right"]).unwrap();
    assert!(
        one.starts_with("the body was closed around 1 label (kidney_right): a shell around it"),
        "{one}"
    );
    let two = warning(&["liver", "-"]).unwrap();
    assert!(two.contains("2 labels (liver, 2): a shell around them"), "{two}");
    assert!(warning(&["pebble"; 9]).is_some());
    assert_eq!(warning(&["liver", "vertebrae_L3"]), None);
    assert_eq!(
        warning(&[
            "liver", "spleen", "pancreas", "aorta", "stomach", "colon", "heart", "brain"
        ]),
        None
    );
}

#[test]
fn the_thread_count_does_not_matter() {
    let volume = trunk([3.0; 3]);
    let voxels = |threads| made_on(threads, || run(&volume)).volume.voxels().to_vec();
    assert_eq!(voxels(1), voxels(3));
}

/// Reads a `.nii.gz` of bytes or 16-bit integers, well formed, without names.
pub(crate) fn nifti(file: &str) -> Option<LabelVolume> {
    let path = insonify_testing::shared(&format!("volumes/{file}"))?;
    let packed = std::fs::File::open(path).unwrap();
    let mut bytes = Vec::new();
    flate2::read::GzDecoder::new(packed).read_to_end(&mut bytes).unwrap();
    let short = |at: usize| i16::from_le_bytes([bytes[at], bytes[at + 1]]);
    let float = |at: usize| {
        f64::from(f32::from_le_bytes([
            bytes[at],
            bytes[at + 1],
            bytes[at + 2],
            bytes[at + 3],
        ]))
    };
    let size = [42, 44, 46].map(|at| short(at) as usize);
    let width = short(72) as usize / 8;
    let values: Vec<u8> = bytes[float(108) as usize..]
        .chunks_exact(width)
        .take(size.iter().product())
        .map(|chunk| chunk[0])
        .collect();
    let to_world = Matrix4::from_fn(|row, column| match row {
        3 => f64::from(u8::from(column == 3)),
        _ => float(280 + 16 * row + 4 * column) * if row < 2 { -1.0 } else { 1.0 },
    });
    let labels = (0..=255).map(|value| label(value, None)).take(150).collect();
    Some(LabelVolume::new(size, values, labels, to_world).unwrap())
}

#[test]
fn real_segmentations_become_whole_bodies() {
    // File and expected volume of the body in its box, litres: slim adults of 40 and 34 cm of trunk.
    for (file, litres) in [
        ("tsd_s0328_labels.nii.gz", 20.0..36.0),
        ("ts_example_seg_full.nii.gz", 14.0..32.0),
    ] {
        let Some(volume) = nifti(file) else { return };
        let done = run(&volume);
        skin_is_closed(&done.volume);
        let body = done.volume.voxels().iter().filter(|&&v| v != 0).count() as f64 * done.volume.voxel_mm3() / 1e6;
        assert!(litres.contains(&body), "{file}: {body} l");
        let shape = done.filled;
        assert!(
            shape.soft_tissue + shape.muscle > shape.fat && shape.fat > 3 * shape.skin,
            "{shape:?}"
        );
    }
}
