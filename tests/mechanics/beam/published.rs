//! Wang et al.'s figures.

use insonify_mechanics::needle::beam::Material;
use insonify_mechanics::needle::beam::material::Ogden;

use super::case::{PSM, PVC, base, free, layer, problem, solve};

/// Table I: control distance, inserted depths, RCM and simulated COM; mm.
const TABLE: [(bool, f64, [f64; 3], [f64; 3]); 4] = [
    (false, 20.0, [9.7, 10.9, 9.0], [11.3, 21.3, 25.9]),
    (false, 40.0, [8.4, 6.8, 2.6], [11.4, 21.0, 25.5]),
    (true, 20.0, [12.6, 21.0, 26.2], [12.7, 23.8, 35.0]),
    (true, 40.0, [11.9, 20.6, 22.6], [11.8, 23.1, 33.8]),
];
const DEPTHS: [f64; 3] = [20.0, 40.0, 60.0];

/// Driven with the published mean RCM, the centre of motion lies where Wang et al.'s simulation has it, within 1.2 mm
/// in muscle and 2.6 mm in the phantom. Wang et al.'s COM is a mean over motions from -15 to 15 mm, its RCM is rounded
/// to 0.1 mm and a mean too; tissue is 50 mm long here, which it does not say.
#[test]
fn centres_of_motion_lie_where_table_one_has_them() {
    for (muscle, control, rcms, coms) in TABLE {
        let (tissue, near) = if muscle { (PSM, 1.2) } else { (PVC, 2.6) };
        for ((depth, rcm), com) in DEPTHS.into_iter().zip(rcms).zip(coms) {
            let needle = problem(control, vec![layer(tissue, depth)]);
            for displacement in [2.5, 7.5, 12.5] {
                let shape = solve(&needle, &base(displacement, -displacement / (control + rcm)));
                assert!((shape.rcm_mm().expect("an RCM") - rcm).abs() < 1e-12);
                let found = shape.com_mm().expect("a COM");
                // A base left alone turns so that the needle tilts within the tissue too.
                let natural = solve(&needle, &free(displacement)).rcm_mm().expect("an RCM");
                assert!(
                    natural > 0.0 && natural < depth,
                    "{control} {depth} {displacement}: {natural}"
                );
                assert!(
                    (found - com).abs() < near,
                    "{control} {depth} {displacement}: {found} {com}"
                );
            }
        }
    }
}

/// Figure 5: 15 mm and -40 % at 20 mm before the entry.
#[test]
fn the_rcm_of_figure_five_is_exact() {
    let layers = [2.0, 4.0, 8.0].map(|times| {
        let (Material::Ogden(Ogden { mu_kpa, alpha }), compression) = PSM else {
            panic!("an Ogden material")
        };
        let mu_kpa = times * mu_kpa;
        layer((Material::Ogden(Ogden { mu_kpa, alpha }), compression), 20.0)
    });
    let shape = solve(&problem(20.0, layers.to_vec()), &base(15.0, -0.4));
    assert_eq!(shape.rcm_mm(), Some(17.5));
}

/// The rotary axis of Wang et al.'s stage lies behind the base (section II-C). Natural RCM at 60 mm for a translation
/// of 7.5 mm and arms of 0, 40 and 80 mm, by another solver (plain Hermite elements of 2 mm with deflections as
/// unknowns), which the free base of this one meets within 0.2 mm.
#[test]
fn an_axis_behind_the_base_moves_the_natural_rcm() {
    let expected = [
        (PVC, 20.0, [Some(18.3), Some(11.8), Some(10.1)]),
        (PVC, 40.0, [Some(10.7), Some(3.9), Some(1.7)]),
        (PSM, 20.0, [Some(29.1), Some(22.6), None]),
        (PSM, 40.0, [Some(23.0), Some(16.3), None]),
    ];
    for (tissue, control, rcms) in expected {
        for (arm, expected) in [0.0, 40.0, 80.0].into_iter().zip(rcms) {
            let mut needle = problem(control, vec![layer(tissue, 60.0)]);
            needle.pivot_mm = arm;
            let shape = solve(&needle, &free(7.5));
            let (base, found) = (shape.points[0], shape.rcm_mm().expect("an RCM"));
            if let Some(expected) = expected {
                assert!((found - expected).abs() < 0.2, "{control} {arm}: {found} {expected}");
            }
            let share = base.u_mm / 7.5;
            if arm == 40.0 {
                assert!((0.425..0.585).contains(&share), "{control}: {share}");
            }
            // The arm is rigid, and its axis takes no moment.
            assert!((base.u_mm - (7.5 + arm * base.slope)).abs() < 1e-12, "{base:?}");
            let moment = shape.base_moment_nmm + arm * shape.base_force_n;
            assert!(moment.abs() < 1e-8, "{moment}");
        }
    }
}

/// Without an arm nothing changes, and a short arm changes little.
#[test]
fn a_short_arm_is_none() {
    let mut needle = problem(20.0, vec![layer(PSM, 60.0)]);
    let without = solve(&needle, &free(10.0));
    needle.pivot_mm = 1e-6;
    let with = solve(&needle, &free(10.0));
    // The slope of about -0.2 times the arm.
    let apart = (without.tip_mm() - with.tip_mm()).abs();
    assert!(apart > 0.0 && apart < 1e-6, "{apart}");
}
