//! Base motions that bring about what is wanted, held against the forward solution.

use insonify_mechanics::needle::beam::inverse::{TOLERANCE_MM, Wanted, find, reach};
use insonify_mechanics::needle::beam::{BeamError, FoundationBeam, Problem};

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

/// No RCM of a fine scan compresses the tissue less.
#[test]
fn the_least_compression_is_found() {
    for needle in needles() {
        let mut beam = FoundationBeam::new(&needle).expect("a problem");
        for tip_mm in [-2.0, 0.7] {
            let (base, shape) = find(&mut beam, &Wanted::TipLeast { tip_mm }).expect("a motion");
            assert_eq!(solve(&needle, &base), shape);
            assert!((shape.tip_mm() - tip_mm).abs() <= TOLERANCE_MM);
            let mut nearest = f64::INFINITY;
            for step in -30..180 {
                let about = Wanted::TipAbout {
                    tip_mm,
                    rcm_mm: 0.5 * f64::from(step),
                };
                if let Ok((_, other)) = find(&mut beam, &about) {
                    assert!(other.least_ratio <= shape.least_ratio + 1e-9, "{about:?}");
                    nearest = nearest.min(shape.least_ratio - other.least_ratio);
                }
            }
            // The RCM of least compression lies between two of the scan, where the ratio changes by 0.01 a millimetre.
            assert!(nearest < 5e-3, "{tip_mm}: {nearest}");
        }
    }
}

/// Limits refuse motions that compress a layer beyond them, and shift the best motion towards layers without.
#[test]
fn limits_of_compression_hold() {
    let mut needle = problem(20.0, vec![layer(PSM, 10.0), layer(PSM, 50.0)]);
    let mut beam = FoundationBeam::new(&needle).expect("a problem");
    let about = Wanted::TipAbout {
        tip_mm: -2.0,
        rcm_mm: 20.0,
    };
    let least = Wanted::TipLeast { tip_mm: -2.0 };
    let ratio = find(&mut beam, &about).expect("a motion").1.layers[0].least_ratio;
    let free = find(&mut beam, &least).expect("a motion").1;
    needle.layers[0].least_ratio = ratio + 1e-3;
    let mut beam = FoundationBeam::new(&needle).expect("a problem");
    let error = find(&mut beam, &about).expect_err("refused");
    assert!(
        matches!(error, BeamError::Compressed { layer: 1, ratio: found, always: false, .. } if found == ratio),
        "{error}"
    );
    assert!(reach(&mut beam, &about).is_ok());
    // A limit that the motion of least compression breaks: another motion keeps it.
    let tight = 1.0 - 0.8 * (1.0 - free.layers[0].least_ratio);
    needle.layers[0].least_ratio = tight;
    let mut beam = FoundationBeam::new(&needle).expect("a problem");
    let shape = find(&mut beam, &least).expect("a motion within the limit").1;
    assert!(shape.layers[0].least_ratio >= tight && shape.least_ratio < free.least_ratio);
    // One that no motion keeps.
    needle.layers.iter_mut().for_each(|layer| layer.least_ratio = 0.999);
    let mut beam = FoundationBeam::new(&needle).expect("a problem");
    let error = find(&mut beam, &least).expect_err("refused");
    assert!(matches!(error, BeamError::Compressed { always: true, .. }), "{error}");
}

/// What the layers take together is what the base gives.
#[test]
fn forces_on_layers_add_up() {
    let needle = problem(20.0, vec![layer(PSM, 10.0), layer(PVC, 12.5), layer(PSM, 30.0)]);
    let shape = solve(&needle, &super::case::base(12.0, -0.3));
    let sum: f64 = shape.layers.iter().map(|load| load.force_n).sum();
    assert!((sum - shape.base_force_n).abs() < 1e-12, "{sum} {}", shape.base_force_n);
    let depths: Vec<_> = shape.layers.iter().map(|load| load.depths_mm).collect();
    assert_eq!(depths, [[0.0, 10.0], [10.0, 22.5], [22.5, 52.5]]);
    let least = shape.layers.iter().map(|load| load.least_ratio).fold(1.0, f64::min);
    assert_eq!((least, shape.layers[0].least_at_mm), (shape.least_ratio, 0.0));
}
