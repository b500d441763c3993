//! Laws of finite strain in a body: bars by their closed form, and Newton's order.

use insonify_mechanics::tissue::law::{AnyLaw, Tensor};
use insonify_mechanics::tissue::material::Material;
use insonify_mechanics::tissue::nonlinear::{NonlinearError, Scheme};

use super::case::{at, difference, held, newton_orders, options, pulled, target};

fn finite(poisson: f64) -> Vec<(&'static str, AnyLaw)> {
    let laws = AnyLaw::examples(Material::new(10.0, poisson).unwrap()).unwrap();
    laws.into_iter().filter(|(_, law)| law.as_secant().is_none()).collect()
}

/// Stretches of a bar along and across a nominal stress (kPa), by Newton's method on the law alone.
fn bar(law: &AnyLaw, stress: f64) -> [f64; 2] {
    let (mut along, mut across) = (0.0, 0.0);
    for _ in 0..60 {
        let gradient = Tensor::from_diagonal(&[along, across, across].into());
        let (found, moduli) = (law.stress_kpa(&gradient), law.moduli_kpa(&gradient));
        let rest = nalgebra::Vector2::new(stress - found[(0, 0)], -found[(1, 1)]);
        let slope = nalgebra::Matrix2::new(
            moduli[(0, 0)],
            moduli[(0, 4)] + moduli[(0, 8)],
            moduli[(4, 0)],
            moduli[(4, 4)] + moduli[(4, 8)],
        );
        let step = slope.try_inverse().unwrap() * rest;
        (along, across) = (along + 0.5 * step.x, across + 0.5 * step.y);
    }
    [along, across]
}

#[test]
fn bars_of_finite_strain_stretch_as_the_law_says() {
    for poisson in [0.3, 0.45, 0.499] {
        for (name, law) in finite(poisson) {
            for scheme in [Scheme::Newton, Scheme::MODIFIED] {
                let (body, rollers, unit) = pulled(2, 6.0, law);
                let (mut solver, prescribed) = held(&body, &rollers, options(scheme));
                // Between the last ones other equilibria lie near.
                for stress in [1.0, 3.0, -1.0, -3.0, 3.0, -3.0] {
                    let loads: Vec<f64> = unit.iter().map(|f| f * stress).collect();
                    let solved = solver.step(&target(&loads, &prescribed));
                    solved.unwrap_or_else(|error| panic!("{name} {poisson} {scheme:?} {stress}: {error}"));
                    let [along, across] = bar(&law, stress);
                    for (node, p) in body.nodes().iter().enumerate() {
                        let found = &solver.displacement()[3 * node..3 * node + 3];
                        let off = difference(found, &[along * p[0], across * p[1], across * p[2]]) / 6.0;
                        assert!(off < 1e-7 / (1.0 - 2.0 * poisson), "{name} {poisson} {stress}: {off:e}");
                    }
                    let cauchy = solver.body().stresses_kpa(solver.displacement(), solver.displacement())[0];
                    let expected = stress / (1.0 + across).powi(2);
                    assert!(
                        (cauchy[0][0] / expected - 1.0).abs() < 1e-4,
                        "{name}: {cauchy:?} {expected}"
                    );
                }
            }
        }
    }
}

/// The factor follows the tangent when iterations contract slowly, and is kept while they do not.
#[test]
fn modified_newton_takes_few_factors_for_laws_of_finite_strain() {
    for (name, law) in finite(0.45) {
        let (body, rollers, unit) = pulled(2, 6.0, law);
        let (mut solver, prescribed) = held(&body, &rollers, options(Scheme::MODIFIED));
        let (mut iterations, mut factorisations) = (0, 0);
        for stress in [1.0, 2.0, 3.0, 2.0, 1.0, -1.0, -2.0, -3.0] {
            let loads: Vec<f64> = unit.iter().map(|f| f * stress).collect();
            let progress = solver.step(&target(&loads, &prescribed)).unwrap();
            iterations += progress.iterations;
            factorisations += progress.factorisations;
        }
        assert!(
            iterations <= 8 * 15 && 3 * factorisations <= iterations,
            "{name}: {iterations} iterations, {factorisations} factorisations"
        );
    }
}

/// A bar of the Ogden law with free sides, whose volume hardly resists, collapses sideways under a compression to 0.3:
/// its balance is not stable, and the state stays that of the last increment.
#[test]
fn balance_that_is_not_stable_is_refused() {
    let laws = finite(0.45);
    let (_, law) = laws.iter().find(|(name, _)| *name == "ogden").unwrap();
    let (body, mut driven, unit) = pulled(4, 8.0, *law);
    let top = at(&body, 2, 8.0).into_iter();
    driven.extend(top.map(|node| (node, 2, -0.7 * 8.0)));
    let (mut solver, prescribed) = held(&body, &driven, options(Scheme::Newton));
    let loads = vec![0.0; unit.len()];
    let error = solver.step(&target(&loads, &prescribed)).unwrap_err();
    assert!(matches!(error, NonlinearError::Unstable { .. }), "{error}");
    assert!(solver.displacement().iter().all(|u| *u == 0.0));
    let half: Vec<f64> = prescribed.iter().map(|u| 0.5 * u).collect();
    solver.step(&target(&loads, &half)).unwrap();
}

#[test]
fn newton_is_quadratic_for_laws_of_finite_strain() {
    for (name, law) in finite(0.45) {
        let (orders, residuals) = newton_orders(law);
        assert!(
            orders.last().is_some_and(|order| *order > 1.6),
            "{name}: {orders:?} of {residuals:?}"
        );
    }
}
