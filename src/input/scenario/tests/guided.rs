//! Needles in the frame of the probe, and needle guides.

use nalgebra::{Point3, Vector3};

use super::{BLOCK, resolved};
use crate::input::scenario::Scenario;
use crate::input::scenario::manipulator::SensorSpec;
use insonify_base::blame::Blame;
use insonify_mechanics::insertion::Wrench;

const POSE: &str = "[scene.pose]\nposition_mm = [0, 0, -60]\ndirection = [0, 0, 1]\nlateral = [1, 0, 0]\n";
const MOVED: &str = "[[scene.motion.keyframes]]\ntime_s = 0\nposition_mm = [0, 0, -60]\ndirection = [0, 0, 1]\nlateral = [1, 0, 0]\n\
                     [[scene.motion.keyframes]]\ntime_s = 2\nposition_mm = [6, 0, -60]\ndirection = [0.2, 0, 1]\nlateral = [1, 0, -0.2]\n";
const GUIDE: &str = "[manipulator.guide]\nside_mm = 0\ntilt_deg = 0\n";

/// The block with a probe over the needle, without roll.
fn block(probe: &str) -> String {
    BLOCK
        .replace("roll_deg = 90\n", "")
        .replace("[scene.image]", &format!("{probe}[scene.image]"))
}

/// The block whose needle is stated in the frame of the probe.
fn in_probe(probe: &str) -> String {
    block(probe)
        .replace("deposit_s", "frame = \"probe\"\ndeposit_s")
        .replace(
            "tip_mm = [0, 0, -50]\ndirection = [0, 0, 1]",
            "tip_mm = [0, 10, 0]\ndirection = [0, 1, 0]",
        )
        .replace(
            "tip_mm = [0, 0, -30]\ndirection = [0, 0, 1]",
            "tip_mm = [0, 30, 0]\ndirection = [0, 1, 0]",
        )
}

/// The block whose needle the keyframes of a guide move.
fn by_guide(probe: &str, control: &str) -> String {
    let text = block(probe);
    let start = text.find("[[needle.motion").unwrap();
    format!(
        "{}[manipulator]\ncontrol = \"{control}\"\n{GUIDE}\
         [[manipulator.keyframes]]\ntime_s = 0\nposition_mm = 0\nposture_deg = 0\ninsertion_mm = 8\n\
         [[manipulator.keyframes]]\ntime_s = 2\nposition_mm = 2\nposture_deg = 5\ninsertion_mm = 18\n",
        &text[..start]
    )
}

fn tip(scenario: &Scenario, step: u64) -> Point3<f64> {
    scenario.instruments(step).base * Point3::new(0.0, 0.0, scenario.needle.length_mm)
}

#[test]
fn a_needle_in_the_frame_of_the_probe_goes_with_it() {
    let (world, still) = (resolved(&block(POSE)).unwrap(), resolved(&in_probe(POSE)).unwrap());
    for step in [0, 50, 133, 200] {
        assert!((tip(&world, step) - tip(&still, step)).norm() < 1e-9);
    }
    let moved = resolved(&in_probe(MOVED)).unwrap();
    for step in [0, 50, 133, 200] {
        let depth = 10.0 + 20.0 * step as f64 / 200.0;
        let expected = moved.probe(step) * Point3::new(0.0, depth, 0.0);
        assert!((tip(&moved, step) - expected).norm() < 1e-6, "{step}");
        let direction = moved.instruments(step).base.rotation * Vector3::z();
        assert!((direction - moved.probe(step).rotation * Vector3::y()).norm() < 1e-6);
    }
}

#[test]
fn a_guide_makes_the_motion_of_the_needle() {
    let plan = resolved(&block(POSE)).unwrap();
    let ideal = format!("{}[manipulator]\ncontrol = \"ideal\"\n{GUIDE}", block(POSE));
    for (text, bound) in [(ideal.clone(), 1e-9), (ideal.replace("ideal", "closed-loop"), 0.1)] {
        let guided = resolved(&text).unwrap();
        for step in [0, 60, 133, 200] {
            let error_mm = (tip(&plan, step) - tip(&guided, step)).norm();
            assert!(error_mm < bound, "{step}: {error_mm}");
        }
    }
    let open = resolved(&ideal.replace("ideal", "open-loop")).unwrap();
    let lost = open.manipulator.as_ref().unwrap().drive;
    let lost = lost.lost_mm(0.0)[0] * lost.reduction();
    let error_mm = (tip(&plan, 150) - tip(&open, 150)).norm();
    assert!((error_mm - lost).abs() < 1e-6 && lost > 0.25, "{error_mm} {lost}");
}

#[test]
fn keyframes_of_a_guide_move_the_needle_with_the_probe() {
    let scenario = resolved(&by_guide(MOVED, "ideal")).unwrap();
    let guided = scenario.manipulator.clone().unwrap();
    for step in [0, 77, 200] {
        let share = step as f64 / 200.0;
        let command = guided.at(2.0 * share).command;
        assert!(
            (command.posture_deg - 5.0 * share).abs() < 1e-9
                && (command.insertion_mm - 8.0 - 10.0 * share).abs() < 1e-9
        );
        let [x, y] = guided.guide.needle(&command).tip_mm;
        let expected = scenario.probe(step) * Point3::new(x, y, 0.0);
        assert!((tip(&scenario, step) - expected).norm() < 1e-6, "{step}");
    }
}

#[test]
fn what_a_guide_cannot_do_is_refused() {
    let guide = |tables: &str| format!("{}{tables}", block(POSE));
    let key = "[[manipulator.keyframes]]\ntime_s = 0\nposition_mm = 0\nposture_deg = 0\ninsertion_mm = 0\n";
    let only = |keys: &str| {
        by_guide(POSE, "ideal")
            .split("[[manipulator")
            .next()
            .unwrap()
            .to_owned()
            + keys
    };
    let cases = [
        (
            guide("[manipulator]\n"),
            "needle.motion",
            "at 0.000 s the guide would have to hold horizontal positioning (A) of -40.000 mm; expected -20 to 20",
        ),
        (
            guide("[manipulator.guide]\nside_mm = 0\ntilt_deg = 0\nbehind_mm = 60\n"),
            "needle.motion",
            "needle insertion (C) of 60.0",
        ),
        (
            guide(&format!("[manipulator]\n{GUIDE}")).replace("tip_mm = [0, 0, -30]", "tip_mm = [0, 4, -30]"),
            "needle.motion",
            "from the image plane",
        ),
        (
            guide("[manipulator.guide]\nrod_mm = 1\n"),
            "manipulator.guide.crank_mm",
            "dead point",
        ),
        (
            guide("[manipulator.drive]\nlead_mm = 0\n"),
            "manipulator.drive.lead_mm",
            "expected 0.1 to 50",
        ),
        (
            guide("[manipulator.sensor]\nnoise_n = -1\n"),
            "manipulator.sensor.noise_n",
            "0 to 100 N",
        ),
        (
            guide(&format!("[manipulator]\n{key}")),
            "manipulator.keyframes",
            "both `needle.motion` and `manipulator.keyframes`",
        ),
        (
            only(&key.replace("posture_deg = 0", "posture_deg = 31")),
            "manipulator.keyframes[0].posture_deg",
            "posture (B) of 31.000 degrees",
        ),
        (
            only(&format!("{key}{key}")),
            "manipulator.keyframes[1].time_s",
            "after that of the keyframe before",
        ),
        (
            format!("{}[manipulator]\n{GUIDE}", block(POSE)).replace(
                "direction = [0, 0, 1]\n[manip",
                "direction = [0, 0, 1]\nroll_deg = 9\n[manip",
            ),
            "manipulator",
            "turns about its axis",
        ),
        (
            by_guide(POSE, "ideal").replace("deposit_s", "frame = \"probe\"\ndeposit_s"),
            "needle.frame",
            "`frame` without `needle.motion`",
        ),
        (by_guide(POSE, "pid"), "", "unknown value `pid`"),
    ];
    for (text, key, words) in cases {
        let error = resolved(&text).map(drop).expect_err(words);
        assert!(error.to_string().contains(words), "{error}\nexpected {words}");
        assert!(key.is_empty() || error.key() == Some(key), "{:?}", error.key());
        assert!(!error.is_machine());
    }
}

#[test]
fn the_sensor_reads_the_wrench_with_its_noise() {
    let (sensor, wrench) = (
        SensorSpec::default(),
        Wrench {
            force_n: Vector3::new(0.0, 0.1, -0.8),
            torque_nmm: Vector3::new(3.0, 0.0, 0.0),
        },
    );
    let count = 4000;
    let mut squares = [[0.0; 3]; 2];
    for step in 0..count {
        let read = sensor.reading(step, &wrench);
        assert_eq!(read, sensor.reading(step, &wrench));
        for (sum, (read, exact)) in squares
            .iter_mut()
            .zip(read.iter().zip([wrench.force_n, wrench.torque_nmm]))
        {
            for (axis, sum) in sum.iter_mut().enumerate() {
                *sum += (read[axis] - exact[axis]).powi(2) / count as f64;
            }
        }
    }
    for (sums, size) in squares.iter().zip([sensor.noise_n, sensor.noise_nmm]) {
        assert!(
            sums.iter().all(|square| (square.sqrt() / size - 1.0).abs() < 0.05),
            "{squares:?}"
        );
    }
    let reseeded = SensorSpec { seed: 1, ..sensor };
    assert_ne!(sensor.reading(5, &wrench), reseeded.reading(5, &wrench));
    let exact = SensorSpec {
        noise_n: 0.0,
        noise_nmm: 0.0,
        seed: 0,
    };
    assert_eq!(exact.reading(5, &wrench), [wrench.force_n, wrench.torque_nmm]);
}
