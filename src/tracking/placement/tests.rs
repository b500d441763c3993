use super::*;
use crate::error::key;
use crate::probe::Radial;
use insonify_anatomy::volume::Label;
use insonify_anatomy::volume::complete::{CompleteOptions, complete};

/// Labels: background, body, target, bone.
fn labels() -> Vec<Label> {
    (0..4)
        .map(|value| Label {
            value,
            name: None,
            voxels: 0,
        })
        .collect()
}

/// A ball in an upright cylinder (radius 90 mm, axis at the origin) with an obstacle in front of it, 2 mm voxels.
fn cylinder(ball: Vector3<f64>, bone: impl Fn(&Vector3<f64>) -> bool, half: [f64; 3]) -> LabelVolume {
    let size = half.map(|h| h as usize);
    let mut voxels = vec![0; size.iter().product()];
    for (at, voxel) in voxels.iter_mut().enumerate() {
        let index = Vector3::new(at % size[0], at / size[0] % size[1], at / (size[0] * size[1]));
        let p = index.map(|i| 2.0 * i as f64) - Vector3::from(half).add_scalar(-1.0);
        *voxel = if (p - ball).norm() < 20.0 {
            2
        } else if p.x.hypot(p.y) >= 90.0 {
            0
        } else if bone(&p) {
            3
        } else {
            1
        };
    }
    let to_world = Matrix4::new_translation(&-Vector3::from(half).add_scalar(-1.0)) * Matrix4::new_scaling(2.0);
    LabelVolume::new(size, voxels, labels(), to_world).unwrap()
}

fn placed(volume: &LabelVolume, plane: ScanPlane) -> Result<Placement, TrackingError> {
    let meaning = Meaning {
        is_body: &|label| label != 0,
        is_bone_or_gas: &|label| label == 3,
    };
    let options = PlacementOptions {
        plane: Some(plane),
        may_press: false,
        ..PlacementOptions::default()
    };
    place(volume, &[2], &meaning, &options)
}

/// A convex array whose ends lie off the skin of the cylinder, unless it is pressed in.
const SMALL: ProbeShape = ProbeShape::Curvilinear(Curvilinear {
    radius_mm: 40.0,
    angle_deg: 70.0,
});

/// Gaps between the ends of the array and the cylinder, and the depth to which its middle is pressed in, mm.
fn contact_mm(pose: &Matrix4<f64>) -> ([f64; 2], f64) {
    let grid = BeamGrid::new(&Probe::new(SMALL, 150.0).unwrap()).unwrap();
    let ends = [0, grid.lines() - 1].map(|line| {
        let ray = &grid.rays()[line];
        let start = pose.transform_point(&Point3::new(ray.origin[0], ray.origin[1], 0.0));
        let along = pose.transform_vector(&Vector3::new(ray.direction[0], ray.direction[1], 0.0));
        let gaps = (0..400).map(|step| 0.1 * f64::from(step));
        let mut gaps = gaps.filter(|gap| {
            let p = start + along * *gap;
            p.x.hypot(p.y) < 90.0
        });
        gaps.next().unwrap_or(f64::INFINITY)
    });
    let origin = column(pose, 3);
    (ends, 90.0 - origin.x.hypot(origin.y))
}

/// A convex array on a round body touches with its middle alone; it is pressed in until both ends are within reach.
#[test]
fn the_array_is_pressed_in_until_its_ends_are_in_reach() {
    let volume = cylinder(Vector3::new(0.0, -40.0, 5.0), |_| false, BOX);
    let meaning = Meaning {
        is_body: &|label| label != 0,
        is_bone_or_gas: &|label| label == 3,
    };
    for (may_press, reach_mm) in [(false, 8.0), (true, 8.0), (true, 0.0), (true, 0.2)] {
        let options = PlacementOptions {
            plane: Some(ScanPlane::Transverse),
            may_press,
            shape: SMALL,
            reach_mm,
            ..PlacementOptions::default()
        };
        let place = place(&volume, &[2], &meaning, &options).unwrap();
        let (ends_mm, pressed_mm) = contact_mm(&place.probe_to_world);
        if may_press && reach_mm > 1.0 {
            assert!(ends_mm.iter().all(|end| *end < 9.0), "{ends_mm:?}");
            assert!((3.0..9.0).contains(&pressed_mm), "{pressed_mm}");
        } else {
            assert!(ends_mm.iter().any(|end| *end > 11.0), "{ends_mm:?}");
            assert!(pressed_mm < 2.0, "{pressed_mm}");
        }
    }
}

/// Off a gap between ribs, the probe slides, rocks and tilts to where more of the target shows.
#[test]
fn the_probe_moves_to_a_gap_between_ribs() {
    let ball = Vector3::new(0.0, -10.0, 0.0);
    let angle_deg = |p: &Vector3<f64>| p.x.atan2(-p.y).to_degrees();
    let volume = cylinder(
        ball,
        move |p| (76.0..82.0).contains(&p.x.hypot(p.y)) && (angle_deg(p).abs() > 15.0 || p.z.abs() > 20.0),
        BOX,
    );
    let meaning = Meaning {
        is_body: &|label| label != 0,
        is_bone_or_gas: &|label| label == 3,
    };
    for plane in [ScanPlane::Transverse, ScanPlane::Sagittal] {
        let options = PlacementOptions {
            shape: SMALL,
            ..PlacementOptions::default()
        };
        let probe = Probe {
            lines: RAYS as u32,
            ..Probe::new(SMALL, options.depth_mm).unwrap()
        };
        let search = Search {
            volume: &volume,
            in_target: std::array::from_fn(|label| label == 2),
            meaning: &meaning,
            options: &options,
            fan: BeamGrid::new(&probe).unwrap(),
        };
        let aside = 13f64.to_radians();
        let start = search.candidate(&Position {
            aim: ball.into(),
            outward: Vector3::new(aside.sin(), -aside.cos(), 0.12).normalize(),
            lean_deg: [0.0; 2],
            plane,
        });
        let start = start.expect("a position");
        let moved = search.moved(start.clone());
        let [before, after] =
            [&start, &moved].map(|candidate| angle_deg(&column(&candidate.placement.probe_to_world, 3)).abs());
        println!(
            "{plane:?}: from {before:.1} to {after:.1} degrees; {:.2} to {:.2}",
            start.placement.visible, moved.placement.visible
        );
        assert!(moved.placement.score > start.placement.score + 0.1, "{plane:?}");
        assert!(after < 0.6 * before, "{plane:?}: from {before} to {after} degrees");
    }
}

const BOX: [f64; 3] = [110.0, 110.0, 120.0];

fn column(pose: &Matrix4<f64>, i: usize) -> Vector3<f64> {
    pose.fixed_view::<3, 1>(0, i).into_owned()
}

#[test]
fn nothing_in_the_way_means_straight_from_the_nearest_front() {
    let ball = Vector3::new(0.0, -40.0, 5.0);
    let volume = cylinder(ball, |_| false, BOX);
    let place = placed(&volume, ScanPlane::Transverse).unwrap();
    let origin = column(&place.probe_to_world, 3);
    assert!((origin.x.hypot(origin.y) - 90.0).abs() < 2.0, "on the skin: {origin}");
    let axial = column(&place.probe_to_world, 1);
    assert!(axial.y > 0.95, "{axial}");
    let miss = (ball - origin) - axial * (ball - origin).dot(&axial);
    assert!(miss.norm() < 15.0, "aims at the ball: {miss}");
    assert!((place.target_depth_mm - 30.0).abs() < 6.0);
    assert_eq!(place.visible, 1.0);
    assert!(
        column(&place.probe_to_world, 0).x > 0.95,
        "columns run to the patient's left"
    );
    let sagittal = placed(&volume, ScanPlane::Sagittal).unwrap();
    assert!(column(&sagittal.probe_to_world, 0).z < -0.9, "columns run to the feet");
    for pose in [place.probe_to_world, sagittal.probe_to_world] {
        assert!((pose.determinant() - 1.0).abs() < 1e-9);
    }
}

#[test]
fn the_normal_of_slanted_skin_is_found() {
    // Skin of a block, and not of a ball: symmetric about no axis of the volume.
    for degrees in [0.0, 20.0, 35.0f64] {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let inward = Vector3::new(0.6 * sin, cos, 0.8 * sin);
        let body = |p: &Vector3<f64>| p.dot(&inward) > 0.0;
        let mut voxels = vec![0; 60 * 60 * 60];
        for (at, voxel) in voxels.iter_mut().enumerate() {
            let index = Vector3::new(at % 60, at / 60 % 60, at / 3600);
            *voxel = u8::from(body(&index.map(|i| i as f64 - 29.5)));
        }
        let to_world = Matrix4::new_translation(&Vector3::repeat(-29.5));
        let volume = LabelVolume::new([60; 3], voxels, labels(), to_world).unwrap();
        let meaning = Meaning {
            is_body: &|label| label != 0,
            is_bone_or_gas: &|_| false,
        };
        let options = PlacementOptions::default();
        let search = Search {
            volume: &volume,
            in_target: [false; 256],
            meaning: &meaning,
            options: &options,
            fan: BeamGrid::new(&Probe::new(options.shape, options.depth_mm).unwrap()).unwrap(),
        };
        let normal = search.inward_normal(&Point3::origin()).expect("a normal");
        let angle_deg = normal.angle(&inward).to_degrees();
        assert!(angle_deg < 2.5, "{degrees}: {angle_deg}");
    }
}

#[test]
fn bone_in_front_sends_the_probe_to_the_side() {
    let ball = Vector3::new(-30.0, -20.0, 0.0);
    let plate = |p: &Vector3<f64>| (p.y + 70.0).abs() < 4.0 && p.x > -65.0;
    let volume = cylinder(ball, plate, BOX);
    let place = placed(&volume, ScanPlane::Transverse).unwrap();
    let origin = column(&place.probe_to_world, 3);
    assert!(origin.x < -60.0, "from the right: {origin}");
    assert!(place.visible > 0.95, "{place:?}");
    let x = column(&place.probe_to_world, 0);
    assert!(x.y < -0.5, "from the right side columns run to the front: {x}");
    let again = placed(&volume, ScanPlane::Transverse).unwrap();
    assert_eq!(place, again);
}

#[test]
fn a_target_wrapped_in_bone_is_hidden() {
    let ball = Vector3::new(0.0, -30.0, 0.0);
    let volume = cylinder(ball, |p| (p - ball).norm() < 28.0, BOX);
    let error = placed(&volume, ScanPlane::Transverse).unwrap_err();
    assert!(error.to_string().contains("or deeper than 150 mm"), "{error}");
}

#[test]
fn the_probe_never_stands_on_a_face_that_cuts_the_body() {
    // The box ends at y = -60: the front of the body is cut away.
    let ball = Vector3::new(0.0, -30.0, 0.0);
    let volume = cylinder(ball, |_| false, [110.0, 60.0, 120.0]);
    let place = placed(&volume, ScanPlane::Transverse).unwrap();
    let origin = column(&place.probe_to_world, 3);
    assert!((origin.x.hypot(origin.y) - 90.0).abs() < 2.0, "{origin}");
    // Cut on all sides, there is no skin at all.
    let volume = cylinder(ball, |_| false, [50.0, 60.0, 60.0]);
    let error = placed(&volume, ScanPlane::Transverse).unwrap_err();
    assert!(error.to_string().starts_with("no skin is in reach"), "{error}");
}

#[test]
fn the_array_does_not_reach_past_a_face_that_cuts_the_body() {
    // The right half of the body, which ends at x = 0: above the ball, beside the face, the array would stand half on
    // nothing.
    let ball = Vector3::new(-16.0, -55.0, 5.0);
    let whole = cylinder(ball, |_| false, BOX);
    let [nx, ny, nz] = whole.size();
    let voxels = whole.voxels().chunks(nx).flat_map(|row| row[..nx / 2].to_vec());
    let half = LabelVolume::new([nx / 2, ny, nz], voxels.collect(), labels(), *whole.index_to_world()).unwrap();
    let past_cut = |volume: &LabelVolume| {
        let place = placed(volume, ScanPlane::Transverse).unwrap();
        let [origin, x] = [3, 0].map(|at| column(&place.probe_to_world, at));
        // Half of the array's chord: a radius of 60 mm over 70 degrees.
        ((origin + x * 34.4).x.max((origin - x * 34.4).x), place.note)
    };
    let (end, note) = past_cut(&half);
    assert!(end < 0.0 && !note.contains("cuts the body"), "{end} {note}");
    let (end, _) = past_cut(&whole);
    assert!(end > 0.0, "a whole body is imaged across the midline: {end}");
    // Where nothing else is in reach, it is told: a slab no wider than the array.
    let slab = nx / 2 - 15..nx / 2 + 15;
    let voxels = whole.voxels().chunks(nx).flat_map(|row| row[slab.clone()].to_vec());
    let shift = Matrix4::new_translation(&Vector3::new(2.0 * slab.start as f64, 0.0, 0.0));
    let slab = LabelVolume::new([30, ny, nz], voxels.collect(), labels(), shift * whole.index_to_world()).unwrap();
    let (_, note) = past_cut(&slab);
    assert!(
        note.contains("of the array lies past a face of the volume that cuts the body"),
        "{note}"
    );
}

#[test]
fn missing_targets_and_bad_depths_are_errors() {
    let volume = cylinder(Vector3::zeros(), |_| false, BOX);
    let meaning = Meaning {
        is_body: &|label| label != 0,
        is_bone_or_gas: &|_| false,
    };
    let options = PlacementOptions::default();
    let error = place(&volume, &[3], &meaning, &options).unwrap_err();
    assert!(error.to_string().contains("no voxels"), "{error}");
    for depth_mm in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let options = PlacementOptions { depth_mm, ..options };
        assert_eq!(key(place(&volume, &[2], &meaning, &options)), Some("depth_mm"));
    }
}

#[test]
fn real_organs_are_seen_from_where_a_sonographer_would_stand() {
    let Some(volume) = insonify_testing::shared("volumes/tsd_s0328_labels.nii.gz")
        .map(|path| insonify_anatomy::volume::load(&path).expect("a volume").volume)
    else {
        return;
    };
    let volume = complete(&volume, &CompleteOptions::default()).unwrap().volume;
    // Lungs 10 to 14, sacrum and vertebrae 25 to 50, limbs and hips 69 to 78, skull, ribs and sternum 91 to 117.
    let labels = volume.labels();
    let meaning = Meaning {
        is_body: &|label| label != 0,
        is_bone_or_gas: &|label| matches!(labels[usize::from(label)].value, 10..=14 | 25..=50 | 69..=78 | 91..=117),
    };
    // Value of the label, plane, fraction of rays, allowed axial direction of the probe.
    for (organ, plane, rays) in [
        (5, ScanPlane::Transverse, 0.8),
        (2, ScanPlane::Sagittal, 0.3),
        (21, ScanPlane::Transverse, 0.4),
    ] {
        let options = PlacementOptions {
            plane: Some(plane),
            ..PlacementOptions::default()
        };
        let index = labels.iter().position(|label| label.value == organ).expect("an organ") as u8;
        let placement = place(&volume, &[index], &meaning, &options).unwrap();
        println!("label {organ}: score {:.2}, {}", placement.score, placement.note);
        assert!(
            placement.rays_on_target >= rays && placement.visible > 0.9,
            "{}",
            placement.note
        );
        let axial = column(&placement.probe_to_world, 1);
        assert!(axial.y > -0.3, "not through the back: {axial}");
        let origin = Point3::from(column(&placement.probe_to_world, 3));
        let label = |p: Point3<f64>| volume.label_index_at(&p).unwrap();
        assert_eq!(label(origin - axial * (MAX_PRESS_MM + 3.0)), 0, "air behind the array");
        assert_ne!(label(origin + axial * 1.0), 0, "body in front of it");
    }
}

#[test]
fn a_radial_probe_lies_in_the_middle_of_a_vessel_across_it() {
    // A slanted tube of 8 mm radius that widens to 12 mm around a point of its axis.
    let axis = Vector3::new(0.3, -0.2, 0.9).normalize();
    let wide = axis * 14.0;
    let volume = cylinder(Vector3::repeat(500.0), |_| false, [60.0; 3]);
    let (size, to_world) = (volume.size(), *volume.index_to_world());
    let inside = |at: usize| {
        let index = [at % size[0], at / size[0] % size[1], at / (size[0] * size[1])].map(|i| i as f64);
        let p = to_world.transform_point(&Point3::from(index)).coords;
        let along = p.dot(&axis);
        let radius = 8.0 + 4.0 * (-((along - wide.norm()) / 10.0).powi(2)).exp();
        (p - axis * along).norm() < radius && along.abs() < 40.0
    };
    let voxels = (0..volume.voxels().len()).map(|at| if inside(at) { 2 } else { volume.voxels()[at] });
    let volume = LabelVolume::new(size, voxels.collect(), labels(), to_world).unwrap();
    let meaning = Meaning {
        is_body: &|label| label != 0,
        is_bone_or_gas: &|_| false,
    };
    let options = |radius_mm, plane| PlacementOptions {
        reach_mm: 0.0,
        may_press: false,
        plane,
        shape: Radial { radius_mm }.into(),
        depth_mm: 20.0,
    };
    let place = |options: &PlacementOptions| place(&volume, &[2], &meaning, options);
    let pose = place(&options(1.5, None)).unwrap().probe_to_world;
    let centre = pose.transform_point(&Point3::new(0.0, -1.5, 0.0)).coords;
    assert!((centre - wide).norm() < 3.0, "{centre} {wide}");
    let along = column(&pose, 2);
    assert!(along.angle(&axis).to_degrees() < 4.0, "{along}");
    let down = column(&pose, 1);
    assert!(
        down.y > 0.9 && column(&pose, 0).x > 0.9,
        "rows run to the back, columns to the left: {pose}"
    );
    assert!((pose.determinant() - 1.0).abs() < 1e-9);
    let narrow = place(&options(15.0, None)).unwrap_err();
    assert!(narrow.to_string().contains("does not fit"), "{narrow}");
    assert_eq!(key(place(&options(1.5, Some(ScanPlane::Sagittal)))), Some("plane"));
}
