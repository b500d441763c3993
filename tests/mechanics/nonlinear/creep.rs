//! Fractional viscosity in a body: closed forms, and where the two laws part.

use insonify_mechanics::tissue::material::Material;
use insonify_mechanics::tissue::nonlinear::creep::{Creep, Memory};
use insonify_mechanics::tissue::nonlinear::{NonlinearError, Scheme, Stiffening};
use insonify_mechanics::tissue::viscoelastic::Rule;

use super::case::{Held, at, block, difference, held, largest, law, options, pulled};

const MEMORIES: [Memory; 2] = [Memory::LoadIntegral, Memory::Rate];

/// Gamma(1 + k) for the orders of these tests.
fn gamma1(order: f64) -> f64 {
    match order {
        0.1 => 0.951_350_769_866_873_2,
        0.5 => 0.886_226_925_452_758,
        _ => panic!("no value for {order}"),
    }
}

fn strain_of(creep: &Creep<3, 4>, edge: f64) -> f64 {
    let nodes = creep.solver().body().nodes();
    let node = nodes.iter().position(|p| (p[0] - edge).abs() < 1e-9).unwrap();
    creep.displacement()[3 * node] / edge
}

fn bar(law: Stiffening, memory: Memory, order: f64, stress: f64) -> (Creep<3, 4>, Vec<f64>) {
    let (body, rollers, unit) = pulled(1, 4.0, law);
    let (solver, _) = held(&body, &rollers, options(Scheme::Newton));
    let loads: Vec<f64> = unit.iter().map(|f| f * stress).collect();
    (
        Creep::new(solver, memory, order, Rule::Trapezoid, &loads).unwrap(),
        loads,
    )
}

fn step(creep: &mut Creep<3, 4>, step_s: f64, loads: &[f64]) {
    let zeros = vec![0.0; creep.solver().supports().prescribed().len()];
    creep.step(step_s, loads, &zeros, None).unwrap();
}

/// Below the knee strain is stress t^k / (E Gamma(1 + k)), exact for the product rule, whatever the steps.
#[test]
fn a_bar_creeps_as_a_power_of_time() {
    for memory in MEMORIES {
        for order in [0.1, 0.5] {
            let (mut creep, loads) = bar(law(0.45), memory, order, 0.1);
            for step_s in [1e-4, 0.02, 0.3, 1.0, 0.01, 5.0] {
                step(&mut creep, step_s, &loads);
                let expected = 0.1 * creep.time_s().powf(order) / (10.0 * gamma1(order));
                let found = strain_of(&creep, 4.0);
                assert!(
                    (found / expected - 1.0).abs() < 1e-9,
                    "{found} instead of {expected}, {memory:?}"
                );
            }
        }
    }
}

/// While K is constant the laws are the same, step by step, driven displacements and all.
#[test]
fn below_the_knee_the_laws_agree() {
    let body = block([3, 3, 2], 2.0, 0.2, law(0.45));
    let mut driven: Held = Vec::new();
    for node in at(&body, 2, 0.0) {
        driven.extend((0..3).map(|axis| (node, axis, 0.0)));
    }
    let top = at(&body, 2, 4.0);
    driven.push((top[0], 2, -0.1));
    let mut loads = vec![0.0; 3 * body.nodes().len()];
    loads[3 * top[9] as usize] = 1e-4;
    for rule in [Rule::Rectangle, Rule::Trapezoid] {
        let run = |memory| {
            let (solver, prescribed) = held(&body, &driven, options(Scheme::Newton));
            let mut creep = Creep::new(solver, memory, 0.3, rule, &loads).unwrap();
            for (i, step_s) in [0.1, 0.1, 0.02, 0.5, 0.3].into_iter().enumerate() {
                let share = [0.2, 0.6, 0.7, 1.0, 0.4][i];
                let now: Vec<f64> = loads.iter().map(|f| f * (1.0 - 0.3 * share)).collect();
                let prescribed: Vec<f64> = prescribed.iter().map(|u| u * share).collect();
                creep.step(step_s, &now, &prescribed, None).unwrap();
            }
            creep
        };
        let [a, b] = MEMORIES.map(run);
        assert!(largest(&body.relative_strains(a.displacement())) < 0.1);
        assert!(difference(a.displacement(), b.displacement()) < 1e-9 * largest(a.displacement()));
        assert!(difference(a.forces(), b.forces()) < 1e-8 * largest(a.forces()));
    }
}

/// Above the knee Kobayashi et al.'s law creeps as E(e_r) e = stress t^k / Gamma(1 + k): by hand at each time.
#[test]
fn above_the_knee_the_load_integral_is_as_by_hand() {
    let law = law(0.3);
    let (mut creep, loads) = bar(law, Memory::LoadIntegral, 0.5, 1.0);
    for _ in 0..20 {
        step(&mut creep, 0.4, &loads);
        let virtual_stress = creep.time_s().sqrt() / gamma1(0.5);
        let strain = strain_of(&creep, 4.0);
        let found = 10.0 * law.secant(1.3 * strain) * strain;
        assert!(
            (found / virtual_stress - 1.0).abs() < 1e-9,
            "{found} instead of {virtual_stress}"
        );
    }
    assert!(strain_of(&creep, 4.0) > 0.2);
}

/// Order 1 is a dashpot: E(e_r) de/dt = stress, whose time to a strain is the integral of E over stress. And where the
/// laws part: under a constant load past the knee Kobayashi et al.'s law is the stiffer.
#[test]
fn above_the_knee_the_rate_is_a_dashpot_at_order_one() {
    let law = law(0.3);
    let error = |steps: u32| {
        let (mut creep, loads) = bar(law, Memory::Rate, 1.0, 1.0);
        for _ in 0..steps {
            step(&mut creep, 4.0 / f64::from(steps), &loads);
        }
        let strain = strain_of(&creep, 4.0);
        // Integral of 10 (1 + 20 (1.3 e - 0.1)^2) from 0 to the strain, over 1 kPa.
        let above = (1.3 * strain - 0.1f64).max(0.0);
        let time = 10.0 * (strain + 20.0 * above.powi(3) / 3.9);
        (time - 4.0).abs()
    };
    let errors = [20, 40, 80].map(error);
    let order = (errors[1] / errors[2]).log2();
    // The knee lies within a step: the order of the rule, 2, up to what that adds.
    assert!(errors[2] < 2e-3 && order > 1.5, "{errors:?}");
    let parted = MEMORIES.map(|memory| {
        let (mut creep, loads) = bar(law, memory, 0.5, 1.0);
        (0..40).for_each(|_| step(&mut creep, 0.2, &loads));
        strain_of(&creep, 4.0)
    });
    assert!(parted[1] > 1.05 * parted[0], "{parted:?}");
}

/// A ramp of displacement is held by E t^(1-k) / Gamma(2-k): at k = 0.5, 2 sqrt(t / pi) times E. The trapezoid's
/// deconvolution has order 2 - k for it.
#[test]
fn a_driven_ramp_finds_its_reaction() {
    let body = block(
        [1, 1, 1],
        4.0,
        0.0,
        Stiffening::linear(Material::new(10.0, 0.0).unwrap()),
    );
    let mut driven: Held = Vec::new();
    for (node, p) in (0..).zip(body.nodes()) {
        driven.extend((1..3).map(|axis| (node, axis, 0.0)));
        driven.push((node, 0, if p[0] > 0.0 { 0.04 } else { 0.0 }));
    }
    for memory in MEMORIES {
        let errors = [8, 16, 32].map(|steps| {
            let (solver, prescribed) = held(&body, &driven, options(Scheme::Newton));
            let mut creep = Creep::new(solver, memory, 0.5, Rule::Trapezoid, &[0.0; 24]).unwrap();
            for step in 1..=steps {
                let share = f64::from(step) / f64::from(steps);
                let now: Vec<f64> = prescribed.iter().map(|u| u * share).collect();
                creep.step(1.0 / f64::from(steps), &[0.0; 24], &now, None).unwrap();
            }
            let pulled = at(&body, 0, 4.0)
                .iter()
                .map(|node| creep.forces()[3 * *node as usize])
                .sum::<f64>();
            let expected = 1e-3 * 10.0 * 0.01 * 16.0 * 2.0 / std::f64::consts::PI.sqrt();
            (pulled / expected - 1.0).abs()
        });
        assert!(
            errors[2] < 0.01 && errors[2] < 0.6 * errors[1],
            "{errors:?} with {memory:?}"
        );
    }
}

#[test]
fn what_has_no_history_is_refused() {
    let (body, rollers, unit) = pulled(1, 4.0, law(0.3));
    let (solver, prescribed) = held(&body, &rollers, options(Scheme::Newton));
    let begin = |order| Creep::new(solver.clone(), Memory::Rate, order, Rule::Trapezoid, &unit);
    assert!(matches!(begin(1.5), Err(NonlinearError::History(_))));
    let mut creep = begin(0.2).unwrap();
    assert!(matches!(
        creep.step(-1.0, &unit, &prescribed, None),
        Err(NonlinearError::History(_))
    ));
    assert!(matches!(
        creep.step(1.0, &unit[1..], &prescribed, None),
        Err(NonlinearError::Length { .. })
    ));
    creep.step(1.0, &unit, &prescribed, None).unwrap();
    let again = Creep::new(creep.solver().clone(), Memory::Rate, 0.2, Rule::Trapezoid, &unit);
    assert!(matches!(again, Err(NonlinearError::Displaced)));
}
