use nalgebra::Point3;

use super::drive::{Control, Drive, Driven, PERIOD_S, follow};
use super::*;

fn guides() -> [Guide; 2] {
    let other = Guide {
        side_mm: -35.0,
        behind_mm: -4.0,
        tilt_deg: 12.5,
        standoff_mm: 7.0,
        crank_mm: 14.0,
        rod_mm: 31.0,
        rail_mm: 3.0,
    };
    [Guide::default(), other]
}

/// Postures over the whole workspace, its corners included.
fn workspace() -> Vec<Posture> {
    let share = |[low, high]: [f64; 2], at: i32| low + (high - low) * f64::from(at) / 12.0;
    let mut all = Vec::new();
    for a in 0..=12 {
        for b in 0..=12 {
            for c in 0..=12 {
                all.push(Posture {
                    position_mm: share(POSITION_MM, a),
                    posture_deg: share(POSTURE_DEG, b),
                    insertion_mm: share(INSERTION_MM, c),
                });
            }
        }
    }
    all
}

fn largest_difference(a: &Posture, b: &Posture) -> f64 {
    let off = [
        a.position_mm - b.position_mm,
        a.posture_deg - b.posture_deg,
        a.insertion_mm - b.insertion_mm,
    ];
    off.iter().fold(0.0, |most, off| off.abs().max(most))
}

#[test]
fn kinematics_invert_over_the_workspace() {
    for guide in guides() {
        guide.check().unwrap();
        let [low, high] = POSTURE_DEG.map(|degrees| guide.reach(degrees.to_radians()).unwrap());
        assert!(high > low);
        for posture in workspace() {
            let slides = guide.slides(&posture).unwrap();
            assert!(
                largest_difference(&guide.posture(slides).unwrap(), &posture) < 1e-9,
                "{posture:?}"
            );
            let needle = guide.needle(&posture);
            assert!(
                largest_difference(&guide.reaching(&needle).unwrap(), &posture) < 1e-9,
                "{posture:?}"
            );
            let pose = needle.pose().unwrap();
            let back = InPlane::of(&pose).unwrap();
            assert!((back.angle_deg - needle.angle_deg).abs() < 1e-9 && pose.position_mm().z == 0.0);
            // The crank's pin is the rod's length from the slide.
            let angle = posture.posture_deg.to_radians();
            let d = guide.reach(angle).unwrap();
            let rod = (d - guide.crank_mm * angle.sin()).hypot(guide.rail_mm - guide.crank_mm * angle.cos());
            assert!((rod - guide.rod_mm).abs() < 1e-12);
        }
    }
}

#[test]
fn the_turn_is_the_derivative_of_the_posture() {
    for guide in guides() {
        for posture in workspace() {
            let [a, b, c] = guide.slides(&posture).unwrap();
            let at = |step: f64| guide.at([a, b + step, c]).unwrap().posture_deg.to_radians();
            let difference = (at(1e-5) - at(-1e-5)) / 2e-5;
            let turn = guide.turn_per_mm(posture.posture_deg.to_radians()).unwrap();
            assert!((difference / turn - 1.0).abs() < 1e-6, "{difference} {turn}");
        }
    }
}

#[test]
fn both_first_slides_together_leave_the_angle() {
    for guide in guides() {
        let start = Posture {
            posture_deg: 17.3,
            insertion_mm: 20.0,
            ..Posture::default()
        };
        let [a, b, c] = guide.slides(&start).unwrap();
        for by in [-19.7, -3.3, 1e-3, 12.5] {
            let moved = guide.posture([a + by, b + by, c]).unwrap();
            assert!((moved.posture_deg - start.posture_deg).abs() < 1e-12);
            assert!((moved.position_mm - by).abs() < 1e-12);
            let [from, to] = [start, moved].map(|it| guide.needle(&it).tip_mm);
            assert!((to[0] - from[0] - by).abs() < 1e-12 && (to[1] - from[1]).abs() < 1e-12);
        }
    }
}

#[test]
fn what_is_out_of_range_names_its_axis() {
    let guide = Guide::default();
    let with = |position_mm, posture_deg, insertion_mm| Posture {
        position_mm,
        posture_deg,
        insertion_mm,
    };
    for (posture, words) in [
        (
            with(20.5, 0.0, 0.0),
            "horizontal positioning (A) of 20.500 mm; expected -20 to 20",
        ),
        (
            with(0.0, -31.0, 0.0),
            "posture (B) of -31.000 degrees; expected -30 to 30",
        ),
        (
            with(0.0, 0.0, 60.1),
            "needle insertion (C) of 60.100 mm; expected 0 to 60",
        ),
        (with(0.0, 0.0, f64::NAN), "needle insertion (C) of NaN"),
    ] {
        let error = guide.slides(&posture).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    }
    let error = guide.posture([0.0, 40.0, 0.0]).unwrap_err();
    assert!(
        error.to_string().contains("does not close") && error.key() == Some("slide_2_mm"),
        "{error}"
    );
    let error = guide.posture([0.0, 12.0, 0.0]).unwrap_err().to_string();
    assert!(error.contains("posture (B)"), "{error}");
    // Dead points: the rod in line with the crank, and square to the rail.
    let dead = [
        Guide {
            rail_mm: 47.0,
            rod_mm: 25.0,
            ..guide
        },
        Guide {
            rail_mm: 3.0,
            rod_mm: 17.1,
            ..guide
        },
        Guide { rod_mm: 1.0, ..guide },
    ];
    for guide in dead {
        let error = guide.check().unwrap_err().to_string();
        assert!(error.contains("dead point"), "{error}");
    }
    let tilted = Guide {
        tilt_deg: 60.0,
        ..guide
    };
    assert_eq!(tilted.check().unwrap_err().key(), Some("tilt_deg"));
    let aside = InPlane {
        tip_mm: [0.0, 0.0],
        angle_deg: 0.0,
    };
    let mut matrix = *aside.pose().unwrap().probe_to_world();
    matrix[(2, 3)] = 5.0;
    let error = InPlane::of(&Pose::from_matrix(&matrix).unwrap())
        .unwrap_err()
        .to_string();
    assert!(error.contains("5.00 mm from the image plane"), "{error}");
}

/// A point is in reach exactly where some posture of a fine grid comes near it.
#[test]
fn points_in_reach_are_those_that_postures_reach() {
    let fine = |[low, high]: [f64; 2], count: i32| {
        (0..=count).map(move |at| low + (high - low) * f64::from(at) / f64::from(count))
    };
    for guide in guides() {
        let mut tips = Vec::new();
        for position_mm in fine(POSITION_MM, 40) {
            for posture_deg in fine(POSTURE_DEG, 60) {
                for insertion_mm in fine(INSERTION_MM, 60) {
                    let posture = Posture {
                        position_mm,
                        posture_deg,
                        insertion_mm,
                    };
                    tips.push(guide.needle(&posture).tip_mm);
                }
            }
        }
        let inside = tips.iter().step_by(97).all(|tip| guide.angles_deg(*tip).is_some());
        assert!(inside);
        let mut reached = 0;
        for x in fine([-120.0, 120.0], 24) {
            for y in fine([-20.0, 80.0], 10) {
                let nearest = tips
                    .iter()
                    .map(|tip| (tip[0] - x).hypot(tip[1] - y))
                    .fold(f64::INFINITY, f64::min);
                let angles = guide.angles_deg([x, y]);
                reached += usize::from(angles.is_some());
                assert!(angles.is_none() || nearest < 2.0, "{x} {y}: {nearest}");
                for angle_deg in angles.into_iter().flatten() {
                    let tip_mm = [x, y];
                    let posture = guide.reaching(&InPlane { tip_mm, angle_deg });
                    assert!(posture.is_ok(), "{posture:?}");
                }
            }
        }
        assert!(reached > 20, "{reached}");
    }
}

/// Across, a turn, 40 mm in at 5 mm/s, 10 mm back, with a second of rest after each.
fn commands() -> Vec<Posture> {
    let mut keys = vec![(0.0, Posture::default())];
    let mut key = |seconds: f64, change: fn(&mut Posture)| {
        let (time, mut posture) = keys[keys.len() - 1];
        change(&mut posture);
        keys.push((time + seconds, posture));
        keys.push((time + seconds + 1.0, posture));
    };
    key(2.0, |it| it.position_mm = 8.0);
    key(2.0, |it| it.posture_deg = -12.0);
    key(8.0, |it| it.insertion_mm = 40.0);
    key(2.0, |it| it.insertion_mm = 30.0);
    let end = (keys[keys.len() - 1].0 / PERIOD_S).round() as usize;
    let at = |step: usize| {
        let time = step as f64 * PERIOD_S;
        let after = keys
            .iter()
            .position(|key| key.0 >= time)
            .unwrap_or(keys.len() - 1)
            .max(1);
        let (from, to) = (keys[after - 1], keys[after]);
        from.1.lerp(&to.1, ((time - from.0) / (to.0 - from.0)).clamp(0.0, 1.0))
    };
    (0..=end).map(at).collect()
}

fn driven(drive: &Drive, control: Control) -> Vec<Driven> {
    follow(&Guide::default(), drive, control, 0.0, &commands()).unwrap()
}

/// Distance of the tip from where it is commanded to be, mm.
fn off(at: &Driven) -> f64 {
    let [a, b] = [at.command, at.posture].map(|it| Guide::default().needle(&it).tip_mm);
    (a[0] - b[0]).hypot(a[1] - b[1])
}

#[test]
fn the_closed_loop_holds_the_tip_and_the_open_loop_loses_the_lost_motion() {
    let drive = Drive {
        load_n: 1.0,
        ..Drive::default()
    };
    drive.check().unwrap();
    let closed = driven(&drive, Control::ClosedLoop);
    // At the end of every rest, and while the needle advances. A slide that is to turn back rests until the motor, at
    // the gain times the error, has crossed the band: 0.56 mm / (100/s x 1 s) = 0.006 mm, twice that as the integral
    // unwinds; the tip, 55 mm from the pivot, moves 4 mm a mm.
    for second in [2.99, 5.99, 14.99, 17.99] {
        let at = &closed[(second / PERIOD_S) as usize];
        assert!(off(at) < 0.05, "{second}: {at:?}");
    }
    let advance = &closed[6_100..14_000];
    let worst = advance.iter().map(off).fold(0.0, f64::max);
    assert!(worst < 0.1, "{worst}");
    let speed = (advance[7_800].posture.insertion_mm - advance[400].posture.insertion_mm) / 7.4;
    assert!((speed / 5.0 - 1.0).abs() < 0.01, "{speed}");

    let open = driven(&drive, Control::OpenLoop);
    let [push, pull] = drive.lost_mm(1.0).map(|mm| mm * drive.reduction());
    // Half the dead band and friction with a hindering load over the stiffness, through the screw.
    let by_hand = (2.0 + (3.0 + drive.reduction() / 0.3) / 2.0) * 2.0 / (std::f64::consts::TAU * 4.0);
    assert!((push - by_hand).abs() < 1e-12 && push > 0.25, "{push} {by_hand}");
    // A pull is helped by the load.
    let helped = (2.0 + (3.0 - drive.reduction() / 0.3) / 2.0) * drive.reduction();
    assert!((pull - helped).abs() < 1e-12, "{pull} {helped}");
    let depth = |at: usize| open[at].posture.insertion_mm;
    assert!((depth(14_500) - (40.0 - push)).abs() < 1e-9, "{}", depth(14_500));
    assert!((depth(17_900) - (30.0 + pull)).abs() < 1e-9, "{}", depth(17_900));
    assert!((open[14_500].lost_mm[2] - push).abs() < 1e-9);
    assert!(off(&open[14_500]) > 0.25);
    let ideal = driven(&drive, Control::Ideal);
    assert!(
        ideal
            .iter()
            .all(|at| largest_difference(&at.command, &at.posture) < 1e-9)
    );
}

/// An output at rest does not follow the input within the dead band, whatever the load.
#[test]
fn a_screw_at_rest_stays() {
    let (guide, drive) = (
        Guide::default(),
        Drive {
            load_n: 5.0,
            ..Drive::default()
        },
    );
    let [push, pull] = drive.lost_mm(5.0).map(|mm| mm * drive.reduction());
    let sway = |at: i32| Posture {
        insertion_mm: 10.0 + if at % 2 == 0 { 0.9 * push } else { -0.9 * pull },
        ..Posture::default()
    };
    let start = Posture {
        insertion_mm: 10.0,
        ..Posture::default()
    };
    let commands: Vec<Posture> = std::iter::once(start).chain((0..50).map(sway)).collect();
    let all = follow(&guide, &drive, Control::OpenLoop, 0.0, &commands).unwrap();
    assert!(all.iter().all(|at| (at.posture.insertion_mm - 10.0).abs() < 1e-12));
}

/// The pose in the world is that of the probe times that in its frame.
#[test]
fn the_guide_goes_where_the_probe_goes() {
    let needle = Guide::default().needle(&Posture::default());
    let probe = Pose::from_direction(Point3::new(5.0, -40.0, 10.0), Vector3::y(), Some(Vector3::x())).unwrap();
    let tip = probe
        .probe_to_world()
        .transform_point(&needle.pose().unwrap().position_mm());
    let expected = Point3::new(5.0 + needle.tip_mm[0], -40.0 + needle.tip_mm[1], 10.0);
    assert!((tip - expected).norm() < 1e-12);
}
