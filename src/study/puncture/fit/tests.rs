//! Tests that known parameters are recovered and malformed files are refused.

use super::*;
use crate::puncture::puncture;
use insonify_base::random::{normal, seed_words};

fn simulated_curve() -> (PunctureOptions, Vec<ForceSample>) {
    let options = PunctureOptions {
        step_mm: 2.0,
        order: 0.0,
        young_kpa: 3.0,
        knee_strain: 0.25,
        stiffening: 40.0,
        capsule_n: 0.6,
        ..PunctureOptions::default()
    };
    let rows = puncture(&options, &mut |_| ControlFlow::Continue(())).unwrap().rows;
    let sample = |row: &crate::puncture::PunctureStep| ForceSample {
        travel_mm: row.travel_mm,
        force_n: row.force_n,
    };
    (options, rows.iter().map(sample).collect())
}

/// A curve of the slice itself yields the parameters that it was made with, force drops excluded.
#[test]
fn numbers_that_made_a_curve_are_found_again() {
    let (options, samples) = simulated_curve();
    let start = PunctureOptions {
        young_kpa: 1.0,
        knee_strain: 0.3,
        stiffening: 30.0,
        ..options
    };
    let fitted = fit(&start, &samples, &mut |_| ControlFlow::Continue(())).unwrap();
    assert!(
        fitted.samples.len() < samples.len() && fitted.r_squared > 0.9999,
        "{fitted:?}"
    );
    for (value, expected) in [
        (fitted.young_kpa, 3.0),
        (fitted.knee_strain, 0.25),
        (fitted.stiffening, 40.0),
    ] {
        assert!((value / expected - 1.0_f64).abs() < 0.1, "{fitted:?}");
    }
}

#[test]
fn curves_are_read_and_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("curve.csv");
    let parsed = |text: &str| {
        std::fs::write(&path, text).unwrap();
        read(&path)
    };
    let samples = parsed("time_s,force_n,travel_mm\n0,0.5,1\n1, 0.75 ,2.5\n").unwrap();
    let expected = [(1.0, 0.5), (2.5, 0.75)];
    assert_eq!(
        samples.iter().map(|s| (s.travel_mm, s.force_n)).collect::<Vec<_>>(),
        expected
    );
    for (text, words) in [
        ("a,b\n1,2\n", "line 1: found the header `a,b`"),
        ("travel_mm,force_n\n1,2\n2,x\n", "line 3: found `x`"),
        (
            "travel_mm,force_n\n1,2\n1,3\n",
            "line 3: found `1` in column `travel_mm`; expected a travel that rises",
        ),
        ("travel_mm,force_n\n1,2,3\n", "line 2"),
        ("travel_mm,force_n\n1,inf\n", "line 2: found `inf`"),
    ] {
        let error = parsed(text).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    }
    assert!(
        read(&folder.path().join("none.csv"))
            .unwrap_err()
            .to_string()
            .contains("none.csv")
    );
    let (options, samples) = simulated_curve();
    let error = fit(&options, &samples[..3], &mut |_| ControlFlow::Continue(()))
        .unwrap_err()
        .to_string();
    assert!(error.starts_with("the curve: found "), "{error}");
}

/// An offset of 50 mN is taken off where the curve begins before the capsule, and told where it has one point there.
#[test]
fn an_offset_is_taken_off_or_told() {
    let (options, samples) = simulated_curve();
    let shifted = |before: i32| -> Vec<ForceSample> {
        let before = (1..=before).rev().map(|index| ForceSample {
            travel_mm: -0.5 * f64::from(index),
            force_n: 0.0,
        });
        let all = before.chain(samples.iter().copied().filter(|sample| sample.travel_mm >= 0.0));
        all.map(|sample| ForceSample {
            force_n: sample.force_n + 0.05,
            ..sample
        })
        .collect()
    };
    let fitted = fit(&options, &shifted(6), &mut |_| ControlFlow::Continue(())).unwrap();
    assert!((fitted.young_kpa / 3.0 - 1.0).abs() < 0.05, "{fitted:?}");
    assert!((fitted.offset_n.unwrap() - 0.05).abs() < 1e-9 && fitted.notes.len() == 1);
    let (offset_n, notes) = offset(&shifted(1));
    assert!(offset_n.is_none() && notes[0].contains("not 0"), "{notes:?}");
    assert_eq!(offset(&samples).1, Vec::<String>::new());
}

/// A force of 0.6 N that rises with the square of the travel, drops by three quarters at 16 mm and rises again, with
/// the noise of a load cell: what is used ends at the puncture, not where noise drops by a fifth of next to nothing.
#[test]
fn noise_is_no_puncture() {
    for noise_n in [0.0, 1e-3, 3e-3, 2e-2] {
        let force = |travel: f64| {
            let since = travel - 16.0;
            if since <= 0.0 {
                0.6 * (travel / 16.0).powi(2)
            } else {
                0.15 + 0.05 * since
            }
        };
        let sample = |index: i32| {
            let travel_mm = 0.05 * f64::from(index);
            let noise = noise_n * normal([index, 0, 0], seed_words(7));
            ForceSample {
                travel_mm,
                force_n: force(travel_mm) + noise,
            }
        };
        let samples: Vec<ForceSample> = (0..500).map(sample).collect();
        let pushed = first_push(&samples).unwrap();
        let end_mm = pushed[pushed.len() - 1].travel_mm;
        assert!((15.0..16.01).contains(&end_mm), "{noise_n}: {end_mm}");
    }
}
