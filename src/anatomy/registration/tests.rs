use nalgebra::{Matrix4, Point3, Rotation3, Vector3};

use super::skin::Skin;
use super::*;
use crate::segmentation;
use crate::volume::complete::{CompleteOptions, complete};
use crate::volume::{Label, LabelVolume};
use insonify_base::random::{hash3, unit};

fn random(item: i32, stream: i32) -> f64 {
    f64::from(unit(hash3([item, stream, 77], [3, 4])[0]))
}

fn normal(item: i32, stream: i32) -> f64 {
    // The sum of twelve uniform numbers.
    (0..12).map(|at| random(item, 100 * stream + at)).sum::<f64>() - 6.0
}

/// An uneven body, negative inside.
fn body(p: &Point3<f64>) -> f64 {
    let bumps = (p.x / 31.0).sin() * (p.y / 27.0 + 1.0).cos() + (p.z / 37.0).sin() * (p.x / 29.0 - 0.5).cos();
    (p.x / 150.0).powi(2) + (p.y / 100.0).powi(2) + (p.z / 200.0).powi(2) + 0.12 * bumps + 0.15 * p.x / 150.0 - 1.0
}

/// Point of its surface on a random ray from the centre, and the normal.
fn on_body(item: i32, stream: i32) -> (Point3<f64>, Vector3<f64>) {
    let ray = Vector3::from_fn(|axis, _| normal(item, 3 * stream + axis as i32)).normalize();
    let (mut low, mut high) = (0.0, 400.0);
    for _ in 0..60 {
        let middle = (low + high) / 2.0;
        if body(&(Point3::origin() + ray * middle)) < 0.0 {
            low = middle
        } else {
            high = middle
        }
    }
    let at = Point3::origin() + ray * low;
    let slope = Vector3::from_fn(|axis, _| {
        let step = Vector3::ith(axis, 1e-4);
        body(&(at + step)) - body(&(at - step))
    });
    (at, slope.normalize())
}

fn skin() -> Skin {
    let all: Vec<_> = (0..60_000).map(|item| on_body(item, 1)).collect();
    Skin::new(all.iter().map(|it| it.0).collect(), all.iter().map(|it| it.1).collect())
}

/// A rigid motion with a bend of up to `bend_mm` at 200 mm.
fn truth(bend_mm: f64) -> Quadratic {
    let mut matrix = Rotation3::from_euler_angles(0.1, -0.15, 0.2).to_homogeneous();
    matrix
        .fixed_view_mut::<3, 1>(0, 3)
        .copy_from(&Vector3::new(30.0, -20.0, 10.0));
    let mut map = Quadratic::rigid(&matrix, Point3::new(5.0, 3.0, -4.0), 200.0);
    let bends = [
        [0.5, -0.3, 1.0, 0.4, 0.0, -0.6],
        [-0.7, 0.2, 0.6, 0.1, 0.5, 0.0],
        [0.3, 0.4, -0.5, 0.0, 0.2, 0.6],
    ];
    for (row, bends) in map.coefficients.iter_mut().zip(bends) {
        row[4..]
            .iter_mut()
            .zip(bends)
            .for_each(|(c, bend)| *c += bend_mm * bend);
    }
    map
}

/// Surface points in the world, of which some are noisy or outliers.
fn touched(
    map: &Quadratic,
    count: i32,
    noise_mm: f64,
    outliers: f64,
    keep: impl Fn(&Point3<f64>) -> bool,
) -> Vec<Point3<f64>> {
    let all = (0..count).map(|item| on_body(item, 2).0).filter(keep);
    let worlds = all.map(|at| map.inverse(&at).unwrap()).enumerate().map(|(item, at)| {
        let item = item as i32;
        let far = if random(item, 9) < outliers { 40.0 } else { noise_mm };
        at + Vector3::from_fn(|axis, _| far * normal(item, 20 + axis as i32))
    });
    worlds.collect()
}

fn box_of_body() -> Vec<Point3<f64>> {
    let side = |at: usize, axis: usize, mm: f64| if at >> axis & 1 == 0 { -mm } else { mm };
    (0..8)
        .map(|at| Point3::new(side(at, 0, 160.0), side(at, 1, 110.0), side(at, 2, 210.0)))
        .collect()
}

fn known(landmarks: &[Landmark]) -> Known<'_> {
    Known {
        landmarks,
        accuracy_mm: LANDMARK_MM,
    }
}

/// A point of the world and where a map puts it.
fn landmark(map: &Quadratic, world: &Point3<f64>) -> Landmark {
    Landmark {
        name: format!("{world:.0}"),
        volume_mm: map.map(world),
        surface_mm: *world,
    }
}

/// Mean and largest distance between two maps.
fn apart(a: &Quadratic, b: &Quadratic, world: &[Point3<f64>]) -> [f64; 2] {
    let off: Vec<f64> = world.iter().map(|at| (a.map(at) - b.map(at)).norm()).collect();
    [
        off.iter().sum::<f64>() / off.len() as f64,
        off.iter().copied().fold(0.0, f64::max),
    ]
}

#[test]
fn a_known_quadratic_is_found_again() {
    let (skin, map) = (skin(), truth(10.0));
    let world = touched(&map, 3000, 0.0, 0.0, |_| true);
    let registration = register(&world, &skin, &box_of_body(), known(&[]), &[]).unwrap();
    let off = apart(&registration.quadratic.map, &map, &world);
    assert!(off[0] < 0.05, "{off:?} {registration}");
    assert!(
        registration.quadratic.rms_mm < 0.05
            && registration.rigid.rms_mm > 1.0
            && registration.quadratic.jacobian_min > 0.5,
        "{registration}"
    );
}

#[test]
fn noise_outliers_and_a_missing_back_are_borne() {
    let (skin, map) = (skin(), truth(10.0));
    let front = |at: &Point3<f64>| at.y < 40.0;
    let world = touched(&map, 4000, 0.5, 0.1, front);
    let clean = touched(&map, 1000, 0.0, 0.0, front);
    let mut marks = Vec::new();
    for (item, at) in clean.iter().step_by(200).enumerate() {
        let (name, volume_mm, surface_mm) = (format!("mark {item}"), map.map(at), *at);
        marks.push(Landmark {
            name,
            volume_mm,
            surface_mm,
        });
    }
    let registration = register(&world, &skin, &box_of_body(), known(&marks), &[]).unwrap();
    let off = apart(&registration.quadratic.map, &map, &clean);
    assert!(off[0] < 0.5, "{off:?} {registration}");
    assert!(
        registration.landmarks_mm.iter().all(|it| it.quadratic_mm < 1.5),
        "{registration}"
    );
}

#[test]
fn few_points_do_not_bend_the_map_after_their_noise() {
    let (skin, map) = (skin(), truth(0.0));
    let clean = touched(&map, 500, 0.0, 0.0, |_| true);
    for count in [40, 60] {
        let world = touched(&map, count, 1.0, 0.0, |_| true);
        let registration = register(&world, &skin, &box_of_body(), known(&[]), &[]).unwrap();
        let rigid = Quadratic::rigid(&registration.rigid.matrix.0, Point3::origin(), 1.0);
        let [rigid, bent] = [&rigid, &registration.quadratic.map].map(|fitted| apart(fitted, &map, &clean)[0]);
        // The noise is told, not what is left of it after the map has followed it.
        let rms_mm = registration.quadratic.rms_mm;
        assert!(
            (0.75..1.6).contains(&rms_mm),
            "{count} points: {rms_mm} mm of noise of 1 mm"
        );
        assert!(bent < 1.8 * rigid, "{count} points: {bent} mm, rigid {rigid} mm");
    }
}

#[test]
fn what_lies_beyond_the_end_of_the_skin_is_not_used() {
    // The volume ends at z = 60; the scan goes on to the end of the body.
    let all: Vec<_> = (0..60_000)
        .map(|item| on_body(item, 1))
        .filter(|it| it.0.z < 60.0)
        .collect();
    let skin = Skin::new(all.iter().map(|it| it.0).collect(), all.iter().map(|it| it.1).collect());
    let map = truth(4.0);
    let world = touched(&map, 3000, 0.2, 0.0, |_| true);
    let within = touched(&map, 3000, 0.0, 0.0, |at| at.z < 60.0);
    let marks: Vec<Landmark> = within
        .iter()
        .step_by(500)
        .map(|at| Landmark {
            name: String::new(),
            volume_mm: map.map(at),
            surface_mm: *at,
        })
        .collect();
    let registration = register(&world, &skin, &box_of_body(), known(&marks), &[]).unwrap();
    let beyond = world.iter().filter(|at| map.map(at).z > 75.0).count();
    assert!(
        registration.beyond as f64 > 0.9 * beyond as f64 && beyond > 300,
        "{} of {beyond}",
        registration.beyond
    );
    assert!(registration.quadratic.p95_mm > 40.0, "{registration}");
    let off = apart(&registration.quadratic.map, &map, &within);
    assert!(off[0] < 0.5, "{off:?} {registration}");
}

#[test]
fn resampled_volumes_hold_what_bulges_past_their_corners() {
    let full = |n: usize| Label {
        value: n as i64,
        name: None,
        voxels: 0,
    };
    let volume = LabelVolume::new(
        [40; 3],
        vec![1; 64_000],
        vec![full(0), full(1)],
        Matrix4::new_scaling(10.0),
    )
    .unwrap();
    let mut map = truth(8.0);
    map.centre_mm = [200.0; 3];
    let resampled = resample(&volume, &map).unwrap();
    let [w, h, d] = resampled.size();
    let cells = (0..w * h * d).map(|at| [at % w, at / w % h, at / w / h]);
    let rim = cells.zip(resampled.voxels()).filter(|([i, j, k], label)| {
        let at_rim = *i == 0 || *j == 0 || *k == 0 || *i + 1 == w || *j + 1 == h || *k + 1 == d;
        at_rim && **label == 1
    });
    assert_eq!(rim.count(), 0);
}

#[test]
fn what_cannot_be_registered_is_refused() {
    let (skin, map) = (skin(), truth(10.0));
    let refused = |result: Result<Registration, VolumeError>, words: &str| {
        let error = result.map(drop).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    };
    let world = touched(&map, 40, 0.0, 0.0, |_| true);
    refused(
        register(&world[..20], &skin, &box_of_body(), known(&[]), &[]),
        "20 surface points; expected at least 30",
    );
    let mark = |x: f64| Landmark {
        name: format!("{x}"),
        volume_mm: Point3::new(x, 0.0, 0.0),
        surface_mm: Point3::new(x, 0.0, 0.0),
    };
    refused(
        register(
            &world,
            &skin,
            &box_of_body(),
            known(&[mark(0.0), mark(50.0), mark(90.0)]),
            &[],
        ),
        "3 landmarks; expected at least 3 that do not lie on a line",
    );
    let mut folded = truth(10.0);
    folded.coefficients[0][4] = -400.0;
    let error = folded
        .least_jacobian(&box_of_body(), &Matrix4::identity())
        .unwrap_err()
        .to_string();
    assert!(error.contains("folds the volume at ("), "{error}");
}

#[test]
fn labels_are_resampled_where_the_map_puts_them() {
    let size = [40, 30, 50];
    let centre = [20.0, 15.0, 25.0];
    let index = |at: usize| [at % 40, at / 40 % 30, at / 1200].map(|n| n as f64);
    let distance = |at: [f64; 3]| (0..3).map(|axis| (at[axis] - centre[axis]).powi(2)).sum::<f64>().sqrt();
    let voxels: Vec<u8> = (0..60_000).map(|at| u8::from(distance(index(at)) < 10.0)).collect();
    let labels = [(0, "outside"), (5, "ball")]
        .map(|(value, name)| Label {
            value,
            name: Some(name.to_owned()),
            voxels: 0,
        })
        .to_vec();
    let volume = LabelVolume::new(size, voxels, labels, Matrix4::new_scaling(2.0)).unwrap();
    let map = truth(2.0);
    let resampled = resample(&volume, &map).unwrap();
    let middle = map.inverse(&Point3::new(40.0, 30.0, 50.0)).unwrap();
    let ball: Vec<Point3<f64>> = (0..resampled.voxels().len())
        .filter(|&at| resampled.voxels()[at] == 1)
        .map(|at| {
            let [w, h, _] = resampled.size();
            let index = Point3::from([at % w, at / w % h, at / w / h].map(|n| n as f64));
            resampled.index_to_world().transform_point(&index)
        })
        .collect();
    let mean = ball.iter().map(|at| at.coords).sum::<Vector3<f64>>() / ball.len() as f64;
    assert!((mean - middle.coords).norm() < 0.3, "{mean} {middle}");
    let volume_mm3 = ball.len() as f64 * resampled.voxel_mm3();
    let expected = 4.0 / 3.0 * std::f64::consts::PI * 20_f64.powi(3) / map.jacobian(&middle).determinant();
    assert!((volume_mm3 / expected - 1.0).abs() < 0.03, "{volume_mm3} {expected}");
    assert_eq!(resampled.labels()[1].name.as_deref(), Some("ball"));
}

#[test]
fn maps_are_written_and_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("fit.toml");
    let map = truth(10.0);
    std::fs::write(&path, map.toml()).unwrap();
    assert_eq!(Quadratic::read(&path).unwrap(), map);
    for (text, words) in [
        (
            "version = 2\n".to_owned() + &map.toml().replace("version = 1\n", ""),
            "version 2; expected 1",
        ),
        (
            map.toml().replace("scale_mm = 200.0", "scale_mm = 0.0"),
            "a scale that is not above 0",
        ),
        (map.toml() + "more = 1\n", "no registration"),
        ("volume = 3".to_owned(), "no registration"),
        ("#Insight Transform File V1.0\n".to_owned(), "a transform of ITK"),
    ] {
        std::fs::write(&path, text).unwrap();
        let error = Quadratic::read(&path).unwrap_err().to_string();
        assert!(error.contains(words) && error.contains("fit.toml"), "{error}");
    }
}

#[test]
fn a_real_body_deformed_is_fitted_back() {
    let Some(path) = insonify_testing::shared("volumes/tsd_s0328_labels.nii.gz") else {
        return;
    };
    let volume = segmentation::open(&path, &Default::default()).unwrap().volume;
    let completed = complete(&volume, &CompleteOptions::default()).unwrap().volume;
    let skin = Skin::of(&completed, |label| label > 0).unwrap();
    let centre = completed.centre_mm();
    let mut map = truth(8.0);
    map.centre_mm = centre.into();
    (0..3).for_each(|axis| map.coefficients[axis][0] = centre[axis] + 5.0);
    let surface: Vec<Point3<f64>> = skin
        .points()
        .iter()
        .step_by(7)
        .enumerate()
        .map(|(item, at)| {
            let noise = Vector3::from_fn(|axis, _| 0.3 * normal(item as i32, 50 + axis as i32));
            map.inverse(at).unwrap() + noise
        })
        .collect();
    let registration = register(&surface, &skin, &corners(&completed), known(&[]), &[]).unwrap();
    // Points within the body, none of which took part.
    let inside: Vec<Point3<f64>> = skin
        .points()
        .iter()
        .step_by(501)
        .map(|at| map.inverse(&(centre + (at - centre) * 0.5)).unwrap())
        .collect();
    let off = apart(&registration.quadratic.map, &map, &inside);
    assert!(
        off[0] < 1.0 && registration.quadratic.rms_mm < 0.5 && registration.rigid.rms_mm > 1.0,
        "{off:?} {registration}"
    );
}

/// The turn about the long axis, however the body is tilted, and the whole rotation.
#[test]
fn a_turn_about_the_long_axis_is_measured() {
    use std::f64::consts::PI;
    for (angles, turn_deg, angle_deg) in [
        ([0.0, 0.0, PI], 180.0, 180.0),
        ([0.0, 0.0, -2.5], 143.239, 143.239),
        ([0.1, 0.05, 3.1], 177.474, 177.477),
        ([0.3, -0.2, 0.5], 30.385, 36.553),
        ([3.0, 0.0, 0.0], 0.0, 171.887),
    ] {
        let rigid = Rigid {
            matrix: Rows(Rotation3::from_euler_angles(angles[0], angles[1], angles[2]).to_homogeneous()),
            rms_mm: 0.0,
            p95_mm: 0.0,
        };
        for (found, expected) in [(rigid.turn_deg(), turn_deg), (rigid.angle_deg(), angle_deg)] {
            assert!((found - expected).abs() < 0.001, "{angles:?}: {found}");
        }
    }
}

/// A map drawn from what the fit expects of bodies.
fn drawn(seed: i32) -> Quadratic {
    let mut map = truth(0.0);
    for (axis, row) in map.coefficients.iter_mut().enumerate() {
        for (term, coefficient) in row.iter_mut().enumerate().skip(1) {
            *coefficient += BEND_MM * normal(100 * seed + term as i32, 70 + axis as i32);
        }
    }
    map
}

/// Over drawn maps, errors within the body over their expected sizes have a root mean square below 1, as the noise here
/// is independent and is taken to be alike within patches, and not far below. Where only the front is touched more is
/// expected.
#[test]
fn expected_errors_are_those_that_happen() {
    let skin = skin();
    let inside: Vec<Point3<f64>> = (0..40)
        .map(|item| Point3::from(on_body(item, 3).0.coords * 0.6))
        .collect();
    let named: Vec<(String, Point3<f64>)> = inside.iter().map(|point| (String::new(), *point)).collect();
    let (mut ratio, mut expected) = (Vec::new(), [0.0; 2]);
    for seed in 1..9 {
        let map = drawn(seed);
        for (index, front) in [-20.0, 300.0].into_iter().enumerate() {
            let world = touched(&map, 3000, 0.5, 0.0, |point| point.y < front);
            let marks: Vec<Landmark> = world.iter().step_by(400).map(|point| landmark(&map, point)).collect();
            let registration = register(&world, &skin, &box_of_body(), known(&marks), &named).unwrap();
            for (target, point) in registration.targets_mm.iter().zip(&inside) {
                let world = map.inverse(point).unwrap();
                let error = (registration.quadratic.map.map(&world) - point).norm();
                ratio.push((error / target.expected_mm).powi(2));
                expected[index] += target.expected_mm / (8 * inside.len()) as f64;
            }
        }
    }
    let ratio = (ratio.iter().sum::<f64>() / ratio.len() as f64).sqrt();
    assert!((0.3..1.0).contains(&ratio), "{ratio}");
    assert!(expected[0] > 2.0 * expected[1] && expected[1] < 1.0, "{expected:?}");
}

/// Landmarks that the skin alone would leave 5 mm away are met as far as they are accurate; a wrong one bends the map
/// by less than its distance.
#[test]
fn landmarks_are_met_within_their_accuracy() {
    let (skin, map) = (skin(), truth(14.0));
    let world = touched(&map, 3000, 0.5, 0.0, |point| point.y < -20.0);
    let back = touched(&map, 2000, 0.0, 0.0, |point| point.y > 40.0);
    let mut marks: Vec<Landmark> = world
        .iter()
        .chain(&back)
        .step_by(300)
        .map(|point| landmark(&map, point))
        .collect();
    let farthest = |marks: &[Landmark], accuracy_mm: f64| {
        let known = Known {
            landmarks: marks,
            accuracy_mm,
        };
        let registration = register(&world, &skin, &box_of_body(), known, &[]).unwrap();
        let far = registration.landmarks_mm.iter().map(|landmark| landmark.quadratic_mm);
        far.fold(0.0, f64::max)
    };
    let [loose, met] = [1000.0, 1.0].map(|accuracy_mm| farthest(&marks, accuracy_mm));
    assert!(loose > 5.0 && met < 1.5, "{loose} {met}");
    marks[0].volume_mm.x += 30.0;
    assert!(farthest(&marks, 1.0) > 20.0);
}

#[test]
fn a_surface_in_another_unit_is_told_by_the_size_of_the_body() {
    let skin = skin();
    let shrunk = |factor: f64| -> Vec<Point3<f64>> { skin.points().iter().map(|point| point / factor).collect() };
    for (factor, words, unit) in [
        (10.0, "in centimetres it would be", Some("cm")),
        (25.4, "in inches it would be", None),
    ] {
        let (doubt, flag) = unit_doubt(&shrunk(factor), &skin).unwrap();
        assert!(doubt.contains(words) && flag == unit, "{doubt}: {flag:?}");
    }
    // Points on a part of the body.
    let part = |factor: f64, within_mm: f64| -> Vec<Point3<f64>> {
        let points = shrunk(factor);
        let first = points[0];
        points
            .into_iter()
            .filter(|point| (point - first).norm() < within_mm)
            .collect()
    };
    let (doubt, flag) = unit_doubt(&part(10.0, 12.0), &skin).unwrap();
    assert!(
        doubt.contains("in centimetres it would be") && flag == Some("cm"),
        "{doubt}"
    );
    assert_eq!(unit_doubt(&part(1.0, 40.0), &skin), None);
    // Near misses: the surface itself, a child's, and a fifth of it.
    for factor in [1.0, 1.6, 5.0] {
        assert_eq!(unit_doubt(&shrunk(factor), &skin), None);
    }
}
