//! Tests of the shape of the force curve and of the vein.

use super::*;
use crate::StudyError;
use insonify_base::range::OutOfRange;
use insonify_mechanics::insertion::InvalidSetup;
use insonify_mechanics::tissue::nonlinear::NonlinearError;

/// The needle's force rises faster than linearly up to the capsule, drops, rises, and drops at the vein, which has
/// flattened.
#[test]
fn the_curve_has_its_shape() {
    let options = PunctureOptions {
        step_mm: 0.4,
        ..PunctureOptions::default()
    };
    let run = puncture(&options, &mut |_| ControlFlow::Continue(())).unwrap();
    let punctures: Vec<usize> = (0..run.rows.len())
        .filter(|row| run.rows[*row].punctured.is_some())
        .collect();
    let layers: Vec<_> = punctures.iter().map(|row| run.rows[*row].punctured).collect();
    assert_eq!(layers[..2], [Some(0), Some(1)], "{}", run.text());
    let [capsule, wall] = [punctures[0], punctures[1]];
    let force = |row: usize| run.rows[row].force_n;
    assert!(force(capsule) > 2.2 * force(capsule / 2), "{}", run.csv());
    for row in [capsule, wall] {
        assert!(force(row + 1) < 0.5 * force(row), "{}", run.csv());
    }
    assert!(force(wall) > 2.0 * force(capsule + 2), "{}", run.csv());
    // Flattened, but never inverted.
    let least = run.rows[..=wall]
        .iter()
        .map(|row| row.vein_mm)
        .fold(f64::INFINITY, f64::min);
    assert!((0.5..4.0).contains(&least), "{least} of {} mm", run.rows[0].vein_mm);
    assert!(run.rows[wall + 1].vein_mm > least);
    assert!(run.pictures.len() >= 4 && run.pictures.iter().all(|(_, text)| text.trim_end().ends_with("</svg>")));
}

#[test]
fn what_makes_no_curve_is_refused() {
    let default = PunctureOptions::default();
    let refused = |options: PunctureOptions| puncture(&options, &mut |_| ControlFlow::Continue(())).unwrap_err();
    assert!(matches!(
        refused(PunctureOptions {
            step_mm: 0.0,
            ..default
        }).downcast_ref(),
        Some(OutOfRange { key, .. }) if key == "step_mm"
    ));
    assert!(matches!(
        refused(PunctureOptions {
            step_mm: 1e-5,
            ..default
        })
        .downcast_ref(),
        Some(OutOfRange { .. })
    ));
    assert!(matches!(
        refused(PunctureOptions {
            speed_mm_per_s: f64::NAN,
            ..default
        })
        .downcast_ref(),
        Some(OutOfRange { .. })
    ));
    assert!(matches!(
        refused(PunctureOptions {
            young_kpa: 0.0,
            ..default
        })
        .downcast_ref(),
        Some(OutOfRange { .. })
    ));
    assert!(matches!(
        refused(PunctureOptions {
            stiffening: -1.0,
            ..default
        })
        .downcast_ref(),
        Some(OutOfRange { .. })
    ));
    assert!(matches!(
        refused(PunctureOptions {
            thickness_mm: 0.0,
            ..default
        })
        .downcast_ref(),
        Some(NonlinearError::Thickness { .. })
    ));
    let wall = refused(PunctureOptions {
        wall_n: -1.0,
        ..default
    });
    assert!(wall.downcast_ref::<InvalidSetup>().is_some());
    assert!(matches!(
        refused(PunctureOptions { order: 1.5, ..default }).downcast_ref(),
        Some(StudyError::Travel { .. })
    ));
}

#[test]
fn the_callback_stops_the_needle() {
    let mut steps = 0;
    let stopped = puncture(&PunctureOptions::default(), &mut |share| {
        steps += 1;
        if share > 0.02 {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    });
    let error = stopped.unwrap_err().to_string();
    assert_eq!(error, "stopped before the end");
    assert!(steps < 20, "{steps}");
}
