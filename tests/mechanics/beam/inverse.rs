//! Base motions that bring about what is wanted, held against the forward solution.

use insonify::mechanics::needle::beam::inverse::{TOLERANCE_MM, Wanted, find};
use insonify::mechanics::needle::beam::{BeamError, FoundationBeam, Problem};

use super::case::{PSM, PVC, layer, problem, solve};

fn needles() -> [Problem; 2] {
    let mut thin = layer(PVC, 40.0);
    thin.initial_length_mm = 20.0;
    [
        problem(20.0, vec![layer(PSM, 60.0)]),
        problem(40.0, vec![layer(PSM, 10.0), thin]),
    ]
}

#[test]
fn the_base_brings_the_tip_where_it_is_wanted() {
    for needle in needles() {
        let mut beam = FoundationBeam::new(&needle).expect("a problem");
        for tip_mm in [-3.0, 0.0, 0.8] {
            let about = Wanted::TipAbout { tip_mm, rcm_mm: 12.0 };
            for wanted in [about, Wanted::TipFree { tip_mm }] {
                let (base, shape) = find(&mut beam, &wanted).unwrap_or_else(|error| panic!("{wanted:?}: {error}"));
                assert_eq!(solve(&needle, &base), shape);
                assert!((shape.tip_mm() - tip_mm).abs() <= TOLERANCE_MM, "{wanted:?}");
                match wanted {
                    Wanted::TipAbout { .. } if tip_mm != 0.0 => {
                        assert!((shape.rcm_mm().expect("an RCM") - 12.0).abs() < 1e-9);
                    }
                    _ => assert_eq!(base.slope.is_none(), wanted == Wanted::TipFree { tip_mm }),
                }
            }
        }
    }
}

#[test]
fn the_centre_of_motion_comes_where_it_is_wanted() {
    for needle in needles() {
        let mut beam = FoundationBeam::new(&needle).expect("a problem");
        for com_mm in [0.0, 5.0, 18.0, 26.5] {
            for displacement_mm in [-12.0, 3.0] {
                let wanted = Wanted::Centre {
                    com_mm,
                    displacement_mm,
                };
                let (base, shape) = find(&mut beam, &wanted).unwrap_or_else(|error| panic!("{wanted:?}: {error}"));
                assert_eq!(base.displacement_mm, displacement_mm);
                // The needle crosses steeply: slopes of 0.1 turn 1e-9 mm of deflection into 1e-8 of depth.
                assert!((shape.com_mm().expect("a COM") - com_mm).abs() < 1e-6, "{wanted:?}");
            }
            let wanted = Wanted::TipAndCentre { tip_mm: -1.5, com_mm };
            let (base, shape) = find(&mut beam, &wanted).unwrap_or_else(|error| panic!("{wanted:?}: {error}"));
            assert!((shape.tip_mm() + 1.5).abs() <= TOLERANCE_MM && base.slope.is_some());
            assert!((shape.com_mm().expect("a COM") - com_mm).abs() < 1e-6, "{wanted:?}");
        }
    }
}

#[test]
fn what_cannot_be_is_refused() {
    let mut beam = FoundationBeam::new(&needles()[1]).expect("a problem");
    let mut error = |wanted| find(&mut beam, &wanted).expect_err("refused");
    let far = Wanted::Centre {
        com_mm: 51.0,
        displacement_mm: 5.0,
    };
    assert!(matches!(error(far), BeamError::Invalid(error) if error.key == "com_mm"));
    let still = Wanted::Centre {
        com_mm: 20.0,
        displacement_mm: 0.0,
    };
    assert!(matches!(error(still), BeamError::Invalid(error) if error.key == "displacement_mm"));
    let behind = Wanted::TipAbout {
        tip_mm: 1.0,
        rcm_mm: -40.0,
    };
    assert!(matches!(error(behind), BeamError::Invalid(error) if error.key == "rcm_mm"));
    // Tissue ends at 20 mm.
    let through = Wanted::TipFree { tip_mm: 25.0 };
    assert!(matches!(
        error(through),
        BeamError::NoMotion { .. } | BeamError::Crushed { .. }
    ));
}
