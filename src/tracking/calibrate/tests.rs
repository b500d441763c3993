use std::collections::BTreeMap;

use nalgebra::{Matrix3, Matrix4, Rotation3, Vector3, Vector4};

use super::points::{Feature, Pixel, calibrate, follow};
use super::poses::{MarkerPose, Poses};
use super::*;
use crate::plus::PlusConfig;
use crate::sequence::Sequence;
use insonify_base::random::{hash3, unit};

/// Normally distributed numbers by the method of Box and Muller.
struct Normal(i32, i32);

impl Normal {
    fn next(&mut self) -> f64 {
        self.1 += 1;
        let word = hash3([self.0, self.1, 7], [1, 2]);
        let [a, b] = [word[0], word[1]].map(|word| f64::from(unit(word)));
        (-2.0 * (1.0 - a).ln()).sqrt() * (std::f64::consts::TAU * b).cos()
    }

    fn vector(&mut self, sigma: f64) -> Vector3<f64> {
        Vector3::from_fn(|_, _| sigma * self.next())
    }
}

const TIP: [f64; 3] = [12.0, -3.0, 148.0];
const REST: [f64; 3] = [-40.0, 25.0, -900.0];

/// Poses that turn about a resting tip, with noise of the tip's position, mm; `turns` are the standard deviations of
/// the rotation about the axes, rad.
fn resting(n: usize, turns: [f64; 3], noise_mm: f64, seed: i32) -> Poses {
    let mut normal = Normal(seed, 0);
    let poses = (0..n).map(|frame| {
        let turn = Vector3::from_fn(|axis, _| turns[axis] * normal.next());
        let rotation = *Rotation3::new(turn).matrix();
        let position = Vector3::from(REST) - rotation * Vector3::from(TIP) + normal.vector(noise_mm);
        MarkerPose {
            frame,
            rotation,
            position,
        }
    });
    named(poses.collect())
}

fn named(poses: Vec<MarkerPose>) -> Poses {
    let (marker, tracker) = ("Stylus".to_owned(), "Tracker".to_owned());
    Poses {
        poses,
        skipped: 0,
        marker,
        tracker,
    }
}

fn away(pivoted: &Pivot) -> Vector3<f64> {
    Vector3::from(pivoted.point_mm) - Vector3::from(TIP)
}

#[test]
fn the_tip_of_a_noiseless_motion_is_exact() {
    let pivoted = pivot(&resting(40, [0.3; 3], 0.0, 1)).unwrap();
    assert!(away(&pivoted).norm() < 1e-9, "{pivoted:?}");
    assert!((Vector3::from(pivoted.pivot_mm) - Vector3::from(REST)).norm() < 1e-9);
}

#[test]
fn standard_deviations_cover_the_truth_and_fall_with_the_root_of_the_number() {
    let mut rms = Vec::new();
    for n in [50, 200, 800] {
        let (mut inside, mut squares) = (0, 0.0);
        const TRIALS: i32 = 1000;
        for seed in 0..TRIALS {
            let pivoted = pivot(&resting(n, [0.3; 3], 0.5, seed)).unwrap();
            let error = away(&pivoted);
            squares += error.norm_squared();
            inside += (0..3)
                .filter(|&axis| error[axis].abs() < 1.96 * pivoted.std_mm[axis])
                .count();
        }
        let covered = inside as f64 / f64::from(3 * TRIALS);
        assert!((0.935..=0.965).contains(&covered), "{n} poses: {covered}");
        rms.push((squares / f64::from(TRIALS)).sqrt());
    }
    for pair in rms.windows(2) {
        assert!((1.8..=2.2).contains(&(pair[0] / pair[1])), "{rms:?}");
    }
}

#[test]
fn outliers_are_left_out() {
    let mut poses = resting(100, [0.3; 3], 0.2, 3);
    for at in 0..10 {
        poses.poses[9 * at].position += Vector3::new(30.0, -20.0, 5.0 * at as f64);
    }
    let pivoted = pivot(&poses).unwrap();
    assert!(
        (10..=16).contains(&pivoted.trimmed) && away(&pivoted).norm() < 0.2,
        "{pivoted:?}"
    );
    assert!(pivoted.residuals.iter().filter(|r| !r.used).any(|r| r.frame == 81));
    assert_eq!(pivoted.used + pivoted.trimmed, 100);
}

#[test]
fn motions_that_leave_the_tip_open_are_refused() {
    let refused = |poses: &Poses, words: &str| {
        let error = pivot(poses).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    };
    refused(&resting(50, [0.0, 0.0, 1.0], 0.1, 1), "tilt it to all sides");
    refused(&resting(50, [0.0; 3], 0.1, 1), "turns by 0.00 degrees");
    refused(&resting(3, [0.3; 3], 0.1, 1), "found 3 valid poses");
    let error = spin(&resting(50, [0.01; 3], 0.0, 1), &Vector3::z())
        .unwrap_err()
        .to_string();
    assert!(error.contains("about its axis; expected at least 10"), "{error}");
}

#[test]
fn a_direction_is_found_from_known_ones_from_two_pivots_and_from_a_spin() {
    let truth = Vector3::new(0.2, -0.1, 1.0).normalize();
    let poses = resting(60, [0.5; 3], 0.0, 5);
    let given: Vec<_> = poses
        .poses
        .iter()
        .map(|pose| (pose, pose.rotation * truth * 3.0))
        .collect();
    let direction = held_direction(&given).unwrap();
    assert!((Vector3::from(direction.direction) - truth).norm() < 1e-12 && direction.rms_deg < 1e-5);
    let contrary: Vec<_> = poses.poses.iter().map(|pose| (pose, Vector3::x())).collect();
    assert!(
        held_direction(&contrary)
            .unwrap_err()
            .to_string()
            .contains("degrees RMS; expected at most 20")
    );

    let tip = pivot(&resting(200, [0.3; 3], 0.3, 6)).unwrap();
    let hub = Pivot {
        point_mm: (Vector3::from(TIP) - 100.0 * truth).into(),
        ..tip.clone()
    };
    let direction = direction_between(&hub, &tip).unwrap();
    let angle = Vector3::from(direction.direction).angle(&truth).to_degrees();
    assert!(
        angle < 3.0 * direction.rms_deg && direction.rms_deg < 0.2,
        "{direction:?}"
    );
    assert!(direction_between(&tip, &tip).is_err());

    let axis = nalgebra::Unit::new_normalize(truth);
    let mut normal = Normal(8, 0);
    let turned = (0..200).map(|frame| {
        let rotation = Rotation3::new(normal.vector(0.005)) * Rotation3::from_axis_angle(&axis, 0.02 * frame as f64);
        MarkerPose {
            frame,
            rotation: *rotation.matrix(),
            position: Vector3::zeros(),
        }
    });
    let axis = spin(&named(turned.collect()), &Vector3::z()).unwrap();
    let angle = Vector3::from(axis.direction).angle(&truth).to_degrees();
    assert!(angle < 0.1 && (0.3..0.6).contains(&axis.rms_deg), "{angle} {axis:?}");
}

fn image_to_probe() -> Matrix4<f64> {
    let turn = Rotation3::from_euler_angles(0.1, -0.2, 1.6);
    let axes =
        turn.matrix() * Matrix3::from_diagonal(&Vector3::new(0.08, 0.09, 0.08 * 0.09_f64.sqrt() / 0.08_f64.sqrt()));
    let mut matrix = axes.to_homogeneous();
    matrix
        .fixed_view_mut::<3, 1>(0, 3)
        .copy_from(&Vector3::new(-100.0, -40.0, 5.0));
    matrix
}

/// Six wires in two rows, the middle ones aslant, and pixels on them seen from many sides, with noise in pixels.
fn wires(frames: usize, noise_px: f64) -> (Vec<Pixel>, Poses) {
    let mut normal = Normal(11, 0);
    let mut pixels = Vec::new();
    let mut poses = Vec::new();
    for frame in 0..frames {
        let rotation = *Rotation3::new(normal.vector(0.15)).matrix();
        let position = Vector3::new(300.0, 100.0, -800.0) + normal.vector(5.0);
        poses.push(MarkerPose {
            frame,
            rotation,
            position,
        });
        for (at, slant) in [
            (0.0, 0.0),
            (20.0, 0.5),
            (40.0, 0.0),
            (0.0, 0.1),
            (20.0, -0.5),
            (40.0, 0.0),
        ]
        .into_iter()
        .enumerate()
        {
            let (x, lean) = slant;
            let (column, row) = (
                150.0 + 10.0 * x + normal.next() * 20.0,
                if at < 3 { 200.0 } else { 300.0 } + normal.next() * 20.0,
            );
            let place = image_to_probe() * Vector4::new(column, row, 0.0, 1.0);
            let place = rotation * place.xyz() + position;
            // A line through that place, out of the image plane.
            let along = rotation * image_to_probe().fixed_view::<3, 3>(0, 0) * Vector3::new(lean, 0.0, 1.0);
            let along = along.normalize();
            pixels.push(Pixel {
                frame,
                at: [column + noise_px * normal.next(), row + noise_px * normal.next()],
                feature: Feature::Line(place + along * 7.0, along),
            });
        }
    }
    (pixels, named(poses))
}

#[test]
fn pixels_on_wires_and_of_points_give_the_plane_of_the_image() {
    let (pixels, poses) = wires(12, 0.0);
    let calibration = calibrate(&pixels, &poses).unwrap();
    assert!(
        (calibration.image_to_probe.0 - image_to_probe()).amax() < 1e-7,
        "{calibration:?}"
    );
    let points: Vec<Pixel> = pixels[..6]
        .iter()
        .map(|pixel| {
            let pose = poses.get(pixel.frame).unwrap();
            let place = image_to_probe() * Vector4::new(pixel.at[0], pixel.at[1], 0.0, 1.0);
            Pixel {
                feature: Feature::Point(pose.rotation * place.xyz() + pose.position),
                ..*pixel
            }
        })
        .collect();
    let calibration = calibrate(&points, &poses).unwrap();
    assert!(
        (calibration.image_to_probe.0 - image_to_probe()).amax() < 1e-7,
        "{calibration:?}"
    );

    let (mut noisy, poses) = wires(60, 2.0);
    noisy[100].at[0] += 100.0;
    noisy.push(Pixel {
        frame: 1000,
        ..noisy[0]
    });
    let calibration = calibrate(&noisy, &poses).unwrap();
    assert!(calibration.trimmed >= 1 && calibration.skipped == 1 && !calibration.residuals[100].used);
    let centre = Vector4::new(350.0, 250.0, 0.0, 1.0);
    let off = (calibration.image_to_probe.0 - image_to_probe()) * centre;
    for axis in 0..3 {
        assert!(
            off[axis].abs() < 4.0 * calibration.std_mm[axis] && calibration.std_mm[axis] < 0.05,
            "{off} {calibration:?}"
        );
    }
    // Two pixels of noise in each direction, 0.17 mm, of which distances from wires have both.
    assert!((0.2..0.28).contains(&calibration.rms_mm), "{calibration:?}");
    assert!((calibration.axes_apart_deg - 90.0).abs() < 0.5, "{calibration:?}");
}

#[test]
fn pixels_that_leave_the_plane_open_are_refused() {
    let (pixels, poses) = wires(3, 0.0);
    let error = calibrate(&pixels[..2], &poses).unwrap_err().to_string();
    assert!(error.contains("found 2 usable pixels"), "{error}");
    let same: Vec<Pixel> = (0..6).map(|_| pixels[0]).collect();
    let error = calibrate(&same, &poses).unwrap_err().to_string();
    assert!(error.contains("do not determine the plane"), "{error}");
}

#[test]
fn wires_of_a_real_phantom_are_followed() {
    let files = [
        "tracked/NwirePhantomFreehand.igs.mha",
        "config/PlusDeviceSet_NwirePhantomFreehand_vtkVolumeReconstructorTest2.xml",
    ];
    let [Some(file), Some(config)] = files.map(insonify_testing::shared) else {
        return;
    };
    let config = PlusConfig::read(&config).unwrap();
    let sequence = Sequence::read(&file).unwrap();
    let poses = Poses::from_sequence(&sequence, &file, Some("ProbeToReference"), &BTreeMap::new()).unwrap();
    let placed = config.registration().unwrap();
    let wires: Vec<Feature> = config
        .wires()
        .iter()
        .map(|wire| Feature::wire(wire, placed).unwrap())
        .collect();
    assert_eq!(wires.len(), 6);
    let stated = config.transform("Image", "Probe").unwrap();
    let calibration = follow(&sequence, &poses, &wires, &stated).unwrap();
    // The calibration in the file states an error of 0.51 mm; both are least certain across the image.
    assert!(calibration.used > 450 && calibration.rms_mm < 0.4, "{calibration:?}");
    let centre = Vector4::new(410.0, 200.0, 0.0, 1.0);
    let moved = ((calibration.image_to_probe.0 - stated) * centre).norm();
    assert!(moved < 3.0, "{moved} mm from the stated calibration");
}

#[test]
fn a_motion_about_no_single_axis_is_no_spin() {
    let error = spin(&resting(50, [0.3; 3], 0.0, 4), &Vector3::z())
        .unwrap_err()
        .to_string();
    assert!(error.contains("no axis stays in place"), "{error}");
}

/// An axis and a held direction are found although a tenth of the poses is 15 degrees off.
#[test]
fn outliers_of_directions_are_left_out() {
    let truth = Vector3::new(0.2, -0.1, 1.0).normalize();
    let axis = nalgebra::Unit::new_normalize(truth);
    let mut normal = Normal(9, 0);
    let turned = (0..120).map(|frame| {
        let off = if frame % 10 == 3 {
            Vector3::new(0.26, 0.0, 0.0)
        } else {
            Vector3::zeros()
        };
        let rotation =
            Rotation3::new(normal.vector(0.01) + off) * Rotation3::from_axis_angle(&axis, 0.05 * frame as f64);
        MarkerPose {
            frame,
            rotation: *rotation.matrix(),
            position: Vector3::zeros(),
        }
    });
    let poses = named(turned.collect());
    let along: Vec<_> = poses.poses.iter().map(|pose| (pose, truth)).collect();
    for direction in [spin(&poses, &Vector3::z()), held_direction(&along)].map(Result::unwrap) {
        let angle = Vector3::from(direction.direction).angle(&truth).to_degrees();
        assert!(
            angle < 0.3 && (12..=20).contains(&direction.trimmed),
            "{angle} {direction:?}"
        );
        assert_eq!(direction.used + direction.trimmed, 120);
    }
}

/// Errors over their stated deviations, where all pixels of a frame share the error of its pose.
#[test]
fn deviations_of_an_image_hold_under_errors_of_poses() {
    let (pixels, exact) = wires(60, 0.5);
    let (mut squares, mut trials) = (0.0, 0.0);
    for seed in 0..40 {
        let mut normal = Normal(100 + seed, 0);
        let poses = exact.poses.iter().map(|pose| MarkerPose {
            frame: pose.frame,
            rotation: Rotation3::new(normal.vector(0.002)).matrix() * pose.rotation,
            position: pose.position + normal.vector(0.3),
        });
        let calibration = calibrate(&pixels, &named(poses.collect())).unwrap();
        let [column, row] = calibration.mean_px;
        let off = (calibration.image_to_probe.0 - image_to_probe()) * Vector4::new(column, row, 0.0, 1.0);
        for axis in 0..3 {
            squares += (off[axis] / calibration.std_mm[axis]).powi(2);
            trials += 1.0;
        }
    }
    let ratio = f64::sqrt(squares / trials);
    assert!((0.8..1.25).contains(&ratio), "{ratio}");
}
