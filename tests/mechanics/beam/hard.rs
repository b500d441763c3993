//! Hard cases: a balance or an error that says why, never a number that is none.

use insonify_mechanics::needle::beam::material::{NeoHookean, Ogden};
use insonify_mechanics::needle::beam::{
    BeamError, BeamLayer, Compression, FoundationBeam, Material, Shape, bending_stiffness_nmm2,
};

use super::case::{PSM, PVC, base, free, layer, problem, solve};

fn defined(shape: &Shape) -> bool {
    let points = shape.points.iter();
    let mut numbers = points.flat_map(|p| [p.u_mm, p.slope, p.reaction_n_per_mm]);
    numbers.all(f64::is_finite) && shape.residual < 1e-6 && shape.least_ratio > 0.0
}

#[test]
fn foundations_over_fifteen_decades_converge() {
    for decade in -6..=9 {
        for compression in Compression::ALL {
            for alpha in [-1.0, 8.74] {
                let mu_kpa = 10f64.powi(decade);
                let layer = layer((Material::Ogden(Ogden { mu_kpa, alpha }), compression), 60.0);
                let needle = problem(20.0, vec![layer]);
                for motion in [base(15.0, -0.3), base(1e-3, 0.0), free(5.0)] {
                    let shape = solve(&needle, &motion);
                    assert!(
                        defined(&shape),
                        "1e{decade} kPa, {compression:?}, {motion:?}: {}",
                        shape.residual
                    );
                }
            }
        }
    }
}

#[test]
fn large_exponents_of_either_sign_converge() {
    for alpha in [-200.0, -50.0, -8.0, 0.01, 30.0, 100.0] {
        for compression in Compression::ALL {
            let layer = layer((Material::Ogden(Ogden { mu_kpa: 5.0, alpha }), compression), 60.0);
            let needle = problem(20.0, vec![layer]);
            for displacement in [0.5, 15.0, 40.0] {
                let shape = solve(&needle, &base(displacement, -0.3));
                assert!(defined(&shape), "{alpha} {compression:?}: {}", shape.residual);
            }
        }
    }
}

/// A base that turns about an axis, near or far behind it. Tissue of 1e9 kPa and an arm of 10 m leave 4e-4 of the
/// moment to rounding.
#[test]
fn axes_near_and_far_converge_over_fourteen_decades() {
    for decade in -6..=8 {
        for pivot_mm in [1e-3, 40.0, 1e4] {
            let material = Material::NeoHookean(NeoHookean {
                mu_kpa: 10f64.powi(decade),
            });
            let mut needle = problem(20.0, vec![layer((material, Compression::UTru), 60.0)]);
            needle.pivot_mm = pivot_mm;
            let shape = solve(&needle, &free(10.0));
            assert!(defined(&shape), "1e{decade} kPa, {pivot_mm} mm: {}", shape.residual);
        }
    }
}

/// Thin tissue is all but crushed, and pushes the needle out of the way.
#[test]
fn ratios_near_zero_stay_above_it() {
    let mut tissue = layer(PSM, 60.0);
    tissue.initial_length_mm = 3.0;
    let shape = solve(&problem(20.0, vec![tissue]), &base(15.0, 0.0));
    assert!(defined(&shape) && shape.least_ratio < 0.2, "{}", shape.least_ratio);
}

#[test]
fn tissue_crushed_by_the_base_itself_is_an_error() {
    for displacement in [20.0, 20.5, -400.0] {
        let mut tissue = layer(PVC, 60.0);
        tissue.initial_length_mm = 20.0;
        let mut beam = FoundationBeam::new(&problem(0.0, vec![tissue])).expect("a problem");
        let error = beam.solve(&base(displacement, 0.0)).unwrap_err();
        let BeamError::Crushed {
            depth_mm,
            share_percent,
            initial_length_mm,
            ..
        } = error
        else {
            panic!("{error}");
        };
        assert_eq!((depth_mm, initial_length_mm), (0.0, 20.0));
        // Most of the way to the wall was possible.
        let way = 0.01 * share_percent * displacement.abs();
        assert!((10.0..=20.0).contains(&way), "{way} mm");
        // The beam can go on with what is possible.
        assert!(defined(&beam.solve(&base(10.0, 0.0)).expect("a shape")));
    }
}

#[test]
fn thin_and_thick_needles_converge() {
    for diameter in [0.2, 2.0] {
        for tissue in [PVC, PSM] {
            let mut needle = problem(20.0, vec![layer(tissue, 60.0)]);
            needle.bending_nmm2 = bending_stiffness_nmm2(200.0, diameter);
            for motion in [base(15.0, -0.4), base(15.0, 0.2), free(15.0)] {
                assert!(defined(&solve(&needle, &motion)), "{diameter} {motion:?}");
            }
        }
    }
}

#[test]
fn a_base_that_stays_leaves_all_at_rest() {
    for motion in [base(0.0, 0.0), free(0.0)] {
        let shape = solve(&problem(20.0, vec![layer(PSM, 60.0)]), &motion);
        assert!(
            shape
                .points
                .iter()
                .all(|p| [p.u_mm, p.slope, p.reaction_n_per_mm] == [0.0; 3])
        );
        assert_eq!((shape.com_mm(), shape.rcm_mm(), shape.residual), (None, None, 0.0));
    }
}

#[test]
fn a_needle_that_only_touches_the_skin_is_straight() {
    for control in [20.0, 0.0] {
        let mut needle = problem(control, vec![layer(PSM, 60.0)]);
        needle.inserted_mm = 0.0;
        let shape = solve(&needle, &base(6.0, -0.1));
        assert!((shape.tip_mm() - (6.0 - 0.1 * control)).abs() < 1e-14);
        assert_eq!((shape.com_mm(), shape.rcm_mm()), (None, Some(60.0 - control)));
        let mut beam = FoundationBeam::new(&needle).expect("a problem");
        assert_eq!(beam.solve(&free(6.0)), Err(BeamError::Unheld));
    }
}

#[test]
fn layers_thinner_than_elements_count() {
    let stiff = (Material::NeoHookean(NeoHookean { mu_kpa: 4000.0 }), Compression::CTru);
    let layers = |thin| vec![layer(PSM, 20.3), layer(thin, 0.05), layer(PSM, 29.65)];
    let mut needle = problem(20.0, layers(stiff));
    needle.element_mm = 5.0;
    let coarse = solve(&needle, &base(10.0, -0.2));
    needle.element_mm = 0.05;
    let fine = solve(&needle, &base(10.0, -0.2));
    assert!(
        (coarse.tip_mm() - fine.tip_mm()).abs() < 1e-3,
        "{} {}",
        coarse.tip_mm(),
        fine.tip_mm()
    );
    let soft = solve(&problem(20.0, layers(PSM)), &base(10.0, -0.2));
    assert!((coarse.tip_mm() - soft.tip_mm()).abs() > 0.1);
}

/// What a needle has been asked before does not show.
#[test]
fn answers_depend_on_the_motion_alone() {
    let needle = problem(20.0, vec![layer(PSM, 30.0), layer(PVC, 30.0)]);
    let fresh = solve(&needle, &base(15.0, -0.4));
    let mut beam = FoundationBeam::new(&needle).expect("a problem");
    for motion in [free(3.0), base(-80.0, 0.9), base(15.0, -0.4)] {
        // The second may or may not have a balance.
        let _ = beam.solve(&motion);
    }
    assert_eq!(beam.solve(&base(15.0, -0.4)), Ok(fresh));
}

#[test]
fn numbers_out_of_range_are_refused_by_name() {
    let good = problem(20.0, vec![layer(PSM, 60.0)]);
    let key = |change: &dyn Fn(&mut insonify_mechanics::needle::beam::Problem)| {
        let mut bad = good.clone();
        change(&mut bad);
        FoundationBeam::new(&bad).expect_err("refused").key
    };
    assert_eq!(key(&|p| p.inserted_mm = 60.1), "inserted_mm");
    assert_eq!(key(&|p| p.inserted_mm = -1.0), "inserted_mm");
    assert_eq!(key(&|p| p.element_mm = 0.0), "element_mm");
    assert_eq!(key(&|p| p.element_mm = 1e-9), "element_mm");
    assert_eq!(key(&|p| p.control_distance_mm = f64::NAN), "control_distance_mm");
    assert_eq!(key(&|p| p.bending_nmm2 = 0.0), "bending_stiffness_nmm2");
    let of_layer = |change: &dyn Fn(&mut BeamLayer)| key(&|p| change(&mut p.layers[0]));
    assert_eq!(of_layer(&|l| l.thickness_mm = 0.0), "thickness_mm");
    assert_eq!(of_layer(&|l| l.initial_length_mm = -2.0), "initial_length_mm");
    assert_eq!(of_layer(&|l| l.friction = 1.5), "friction");
    let mut beam = FoundationBeam::new(&good).expect("a problem");
    for (motion, key) in [
        (base(f64::NAN, 0.0), "displacement_mm"),
        (base(1.0, f64::INFINITY), "slope"),
    ] {
        assert!(matches!(beam.solve(&motion), Err(BeamError::Invalid(error)) if error.key == key));
    }
}
