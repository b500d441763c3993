use std::collections::{BTreeMap, VecDeque};
use std::sync::OnceLock;

use nalgebra::Point3;

use super::*;
use insonify_testing::made_on;

/// A phantom with names and bounds of its contents.
type Case<T> = (Phantom, &'static [T]);

/// Radius, half angle in degrees and depth of a fan.
type View = [f64; 3];

/// Phantoms of exact solids, which are independent of the seed.
const EXACT: [Phantom; 2] = [Phantom::TwoLayer, Phantom::LiverVein];

fn made(kind: Phantom, resolution_mm: f64, seed: u64) -> LabelVolume {
    let options = PhantomOptions {
        resolution_mm: Some(resolution_mm),
        seed,
    };
    make(kind, &options).unwrap()
}

/// A phantom at 1 mm with seed 0, made once for all tests.
fn fine(kind: Phantom) -> &'static LabelVolume {
    static MADE: [OnceLock<LabelVolume>; Phantom::ALL.len()] = [const { OnceLock::new() }; Phantom::ALL.len()];
    let at = Phantom::ALL.iter().position(|known| *known == kind).unwrap();
    MADE[at].get_or_init(|| made(kind, 1.0, 0))
}

fn millilitres(volume: &LabelVolume) -> BTreeMap<String, f64> {
    let scale = volume.voxel_mm3() / 1000.0;
    volume
        .labels()
        .iter()
        .map(|label| (label.name.clone().unwrap_or_default(), label.voxels as f64 * scale))
        .collect()
}

fn value(kind: Phantom, name: &str) -> u8 {
    labels(kind).iter().find(|label| label.1 == name).unwrap().0
}

#[test]
fn the_same_seed_gives_the_same_bytes_at_any_thread_count() {
    for &kind in Phantom::ALL {
        let (one, three) = (made_on(1, || made(kind, 3.0, 7)), made_on(3, || made(kind, 3.0, 7)));
        assert_eq!(one.voxels(), three.voxels(), "{kind:?}");
        assert_eq!(one.labels(), three.labels());
        if !EXACT.contains(&kind) {
            assert_ne!(
                one.voxels(),
                made(kind, 3.0, 8).voxels(),
                "{kind:?}: the seed must matter"
            );
            assert_ne!(
                one.voxels(),
                made(kind, 3.0, 7 | 1 << 40).voxels(),
                "{kind:?}: all of it"
            );
        }
    }
}

#[test]
fn labels_are_numbered_from_one_and_named_once() {
    for &kind in Phantom::ALL {
        let table = labels(kind);
        for (i, (value, name)) in table.iter().enumerate() {
            assert_eq!(usize::from(*value), i + 1);
            assert_eq!(table.iter().filter(|other| other.1 == *name).count(), 1);
        }
        // Not every limb has muscle of both directions: that of this seed does.
        let volume = made(kind, 2.0, 3);
        assert_eq!(volume.labels().len(), table.len() + 1);
        for label in volume.labels() {
            assert!(label.voxels > 0, "{kind:?}: no {:?}", label.name);
        }
        let total: u64 = volume.labels().iter().map(|label| label.voxels).sum();
        assert_eq!(total, volume.voxels().len() as u64);
    }
}

/// Ranges for adults, ml; organs that the box cuts have theirs from the part inside.
#[test]
fn organs_have_the_size_of_real_ones() {
    let cases: [Case<(&str, f64, f64)>; 6] = [
        (
            Phantom::Abdomen,
            &[
                ("liver", 850.0, 1700.0),
                ("bile", 15.0, 50.0),
                ("lesion", 2.2, 3.9),
                ("kidney_cortex", 70.0, 130.0),
                ("kidney_medulla", 15.0, 50.0),
                ("renal_sinus", 4.0, 20.0),
                ("pancreas", 25.0, 110.0),
                ("vessel", 120.0, 320.0),
                ("gas", 20.0, 250.0),
                ("skin", 150.0, 350.0),
            ],
        ),
        (
            Phantom::Prostate,
            &[
                ("prostate_peripheral", 8.0, 25.0),
                ("prostate_central", 6.0, 20.0),
                ("seminal_vesicle", 3.0, 15.0),
                ("urine", 40.0, 300.0),
                ("bone", 30.0, 150.0),
            ],
        ),
        (
            Phantom::Spine,
            &[
                ("bone", 180.0, 420.0),
                ("disc", 30.0, 120.0),
                ("csf", 15.0, 60.0),
                ("cartilage", 0.5, 6.0),
                ("ligament", 6.0, 40.0),
            ],
        ),
        (
            Phantom::Limb,
            &[("artery", 0.1, 2.0), ("fat", 3.0, 25.0), ("bone", 0.5, 25.0)],
        ),
        // Sphere and cylinder of radius 15 mm and length 20 mm (28.27 ml), and 25 mm of a cylinder of radius 6 mm (2.83
        // ml and a little where its end is hollow).
        (Phantom::TwoLayer, &[("phantom_inclusion", 31.0, 31.3)]),
        // A cylinder of half axes 11 and 6.5 mm, 48 mm long.
        (Phantom::LiverVein, &[("vessel", 10.70, 10.86)]),
    ];
    for (kind, ranges) in cases {
        let resolution_mm = if EXACT.contains(&kind) { 0.5 } else { 2.0 };
        let volumes_ml = millilitres(&made(kind, resolution_mm, 3));
        for (name, low, high) in ranges {
            let ml = volumes_ml[*name];
            assert!((*low..=*high).contains(&ml), "{kind:?} {name}: {ml:.1} ml");
        }
    }
}

/// Compact parts only: thin shells, and slabs across the grid, are sampled by chance.
#[test]
fn two_resolutions_agree() {
    let cases: [Case<&str>; 6] = [
        (
            Phantom::Abdomen,
            &[
                "fat",
                "muscle",
                "bone",
                "lung",
                "liver",
                "bile",
                "kidney_cortex",
                "vessel",
                "bowel_content",
            ],
        ),
        (
            Phantom::Prostate,
            &[
                "prostate_peripheral",
                "prostate_central",
                "urine",
                "muscle",
                "fat",
                "bone",
                "gel",
            ],
        ),
        (Phantom::Spine, &["fat", "muscle", "bone", "csf", "vessel"]),
        (Phantom::TwoLayer, &["phantom_top", "phantom_inclusion"]),
        (Phantom::LiverVein, &["liver", "vessel"]),
        (Phantom::Limb, &["fat", "muscle_limb", "bone"]),
    ];
    for (kind, names) in cases {
        let (coarse, fine) = (millilitres(&made(kind, 2.0, 0)), millilitres(fine(kind)));
        for name in names {
            let ml = fine[*name];
            // Small parts agree less closely than large ones.
            let tolerance = 0.03 + 0.5 / ml;
            let difference = (coarse[*name] / ml - 1.0).abs();
            assert!(difference < tolerance, "{kind:?} {name}: {} and {ml} ml", coarse[*name]);
        }
    }
}

/// Neighbours of a voxel inside the volume, sharing a face (or at least a corner).
fn neighbours(volume: &LabelVolume, at: usize, corners: bool) -> impl Iterator<Item = usize> {
    let size = volume.size().map(|n| n as i64);
    let [x, y, z] = [
        at as i64 % size[0],
        at as i64 / size[0] % size[1],
        at as i64 / (size[0] * size[1]),
    ];
    (0..27).filter_map(move |code| {
        let step = [code % 3 - 1, code / 3 % 3 - 1, code / 9 - 1];
        let moved = step.iter().map(|s: &i64| s.abs()).sum::<i64>();
        let to = [x + step[0], y + step[1], z + step[2]];
        let inside = (0..3).all(|axis| (0..size[axis]).contains(&to[axis]));
        (moved > 0 && (corners || moved == 1) && inside).then(|| (to[0] + size[0] * (to[1] + size[1] * to[2])) as usize)
    })
}

#[test]
fn the_abdomen_is_whole_at_its_own_resolution() {
    let kind = Phantom::Abdomen;
    let volume = fine(kind);
    let voxels = volume.voxels();
    let (skin, bile, gallbladder) = (
        value(kind, "skin"),
        value(kind, "bile"),
        value(kind, "gallbladder_wall"),
    );
    for (at, &label) in voxels.iter().enumerate() {
        if label != 0 && label != skin {
            assert!(
                neighbours(volume, at, false).all(|n| voxels[n] != 0),
                "{label} touches air at {at}"
            );
        }
        if label == bile {
            assert!(neighbours(volume, at, false).all(|n| [bile, gallbladder].contains(&voxels[n])));
        }
    }
    // Vena cava, portal vein, aorta and mesenteric artery: every vessel voxel is connected with one of them.
    let vessel = value(kind, "vessel");
    let mut reached = vec![false; voxels.len()];
    let mut queue = VecDeque::new();
    for root in [
        [-20.0, 22.0, -60.0],
        [-2.0, 8.0, -28.0],
        [9.0, 18.0, -60.0],
        [9.0, -6.0, -8.0],
    ] {
        let index = volume.world_to_index().transform_point(&Point3::from(root));
        let at = volume.offset([
            index.x.round() as usize,
            index.y.round() as usize,
            index.z.round() as usize,
        ]);
        assert_eq!(voxels[at], vessel, "root {root:?}");
        reached[at] = true;
        queue.push_back(at);
    }
    while let Some(at) = queue.pop_front() {
        for next in neighbours(volume, at, true) {
            if voxels[next] == vessel && !reached[next] {
                reached[next] = true;
                queue.push_back(next);
            }
        }
    }
    let (total, loose) = voxels
        .iter()
        .zip(&reached)
        .fold((0, 0), |(total, loose), (&label, &reached)| {
            let is = usize::from(label == vessel);
            (total + is, loose + usize::from(label == vessel && !reached))
        });
    assert!(loose * 500 < total, "{loose} of {total} vessel voxels hang in the air");
}

/// Fraction of each label in the fan of a pose, by name.
fn view(kind: Phantom, radius: f64, half_deg: f64, depth: f64) -> BTreeMap<&'static str, f64> {
    let volume = fine(kind);
    let pose = default_pose(kind);
    let mut shares = BTreeMap::new();
    let (rays, samples) = (61, 120);
    for ray in 0..rays {
        let (sin, cos) = (half_deg.to_radians() * (ray as f64 / 30.0 - 1.0)).sin_cos();
        for sample in 0..samples {
            let along = radius + depth * (f64::from(sample) + 0.5) / f64::from(samples);
            let p = pose.transform_point(&Point3::new(along * sin, along * cos - radius, 0.0));
            if let Some(label) = volume.label_index_at(&p).filter(|&label| label > 0) {
                *shares.entry(labels(kind)[usize::from(label) - 1].1).or_insert(0.0) += 1.0 / f64::from(rays * samples);
            }
        }
    }
    shares
}

#[test]
fn default_poses_show_what_they_promise() {
    let cases: [(View, Case<(&str, f64)>); 5] = [
        (
            [60.0, 35.0, 150.0],
            (
                Phantom::Abdomen,
                &[
                    ("liver", 0.15),
                    ("bile", 0.015),
                    ("kidney_cortex", 0.05),
                    ("renal_sinus", 0.002),
                    ("vessel", 0.02),
                    ("bone", 0.002),
                ],
            ),
        ),
        (
            [10.0, 75.0, 60.0],
            (
                Phantom::Prostate,
                &[
                    ("prostate_peripheral", 0.04),
                    ("prostate_central", 0.05),
                    ("urethra", 0.002),
                    ("bone", 0.002),
                ],
            ),
        ),
        (
            [60.0, 30.0, 100.0],
            (Phantom::Spine, &[("muscle", 0.2), ("bone", 0.2), ("cartilage", 0.001)]),
        ),
        (
            [2000.0, 0.545, 75.0],
            (Phantom::TwoLayer, &[("phantom_inclusion", 0.3), ("phantom_top", 0.3)]),
        ),
        (
            [2000.0, 0.544, 40.0],
            (
                Phantom::Limb,
                &[
                    ("artery", 0.005),
                    ("vein", 0.005),
                    ("epineurium", 0.003),
                    ("fascicle", 0.001),
                ],
            ),
        ),
    ];
    for ([radius, half_deg, depth], (kind, least)) in cases {
        let shares = view(kind, radius, half_deg, depth);
        for (name, share) in least {
            let actual = shares.get(name).copied().unwrap_or(0.0);
            assert!(
                actual >= *share,
                "{kind:?}: {name} fills {actual:.4} of the view; {shares:?}"
            );
        }
        let turn = default_pose(kind).fixed_view::<3, 3>(0, 0).into_owned();
        assert!((turn.transpose() * turn - nalgebra::Matrix3::identity()).norm() < 1e-12);
        assert!((turn.determinant() - 1.0).abs() < 1e-12);
    }
}

#[test]
fn limbs_differ_by_their_seeds_and_have_vessels_and_nerves_in_view() {
    let kind = Phantom::Limb;
    let area = |volume: &LabelVolume, names: &[&str]| {
        let [nx, ny, nz] = volume.size();
        let middle = &volume.voxels()[nx * ny * (nz / 2)..][..nx * ny];
        let wanted: Vec<u8> = names.iter().map(|name| value(kind, name)).collect();
        middle.iter().filter(|label| wanted.contains(label)).count()
    };
    let mut seen = std::collections::BTreeSet::new();
    for seed in 0..100 {
        let volume = made(kind, 0.8, seed);
        let [artery, vein, nerve] =
            [&["artery"][..], &["vein"], &["epineurium", "fascicle"]].map(|names| area(&volume, names));
        assert!(artery > 3 && nerve > 0, "{seed}: {artery} {vein} {nerve}");
        seen.insert([artery, vein, nerve, area(&volume, &["fat"]), area(&volume, &["bone"])]);
    }
    assert_eq!(seen.len(), 100);
}

#[test]
fn skin_lies_on_the_convex_array_of_the_default_pose() {
    for (kind, half_deg) in [(Phantom::Abdomen, 25.0), (Phantom::Spine, 25.0)] {
        let volume = fine(kind);
        let pose = default_pose(kind);
        for deg in [-1.0, -0.5, 0.0, 0.5, 1.0] {
            let (sin, cos) = f64::to_radians(deg * half_deg).sin_cos();
            let at = |r: f64| volume.label_index_at(&pose.transform_point(&Point3::new(r * sin, r * cos - 60.0, 0.0)));
            assert_eq!(at(57.5), Some(0), "{kind:?}: air outside the array at {deg}");
            assert_ne!(at(62.0), Some(0), "{kind:?}: body inside the array at {deg}");
        }
    }
}

#[test]
fn resolutions_out_of_range_are_errors() {
    for resolution_mm in [0.0, 0.29, 5.1, -1.0, f64::INFINITY] {
        let options = PhantomOptions {
            resolution_mm: Some(resolution_mm),
            seed: 0,
        };
        let error = make(Phantom::Spine, &options).unwrap_err();
        assert_eq!(
            error.to_string(),
            format!("resolution {resolution_mm} mm; expected 0.3 to 5 mm")
        );
    }
    let nan = PhantomOptions {
        resolution_mm: Some(f64::NAN),
        seed: 0,
    };
    assert!(make(Phantom::Spine, &nan).is_err());
    let too_fine = PhantomOptions {
        resolution_mm: Some(0.3),
        seed: 0,
    };
    let error = make(Phantom::Abdomen, &too_fine).unwrap_err().to_string();
    assert!(error.contains("choose a coarser resolution"), "{error}");
}
