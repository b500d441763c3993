//! Large compression against another method: the differential equation integrated from the tip to the base by the
//! classical Runge-Kutta method, deflection and slope of the tip sought so that the base is where it should be. Moduli
//! are written out here.

use nalgebra::{Matrix2, Vector2};

use insonify_mechanics::needle::beam::material::Ogden;
use insonify_mechanics::needle::beam::{BeamLayer, Compression, Material, Problem};

use super::case::{PSM, PVC, base, layer, problem, solve};

/// Steps of the integration, mm; they end where layers do.
const STEP: f64 = 0.05;

/// dS/dl of Ogden's material, as powers of the compression ratio.
fn modulus(layer: &BeamLayer, ratio: f64) -> f64 {
    let Material::Ogden(Ogden { mu_kpa: m, alpha: a }) = layer.material else {
        panic!("an Ogden material");
    };
    let l = ratio;
    match layer.compression {
        Compression::UEng => 2.0 * m / a * ((a - 1.0) * l.powf(a - 2.0) + (a / 2.0 + 1.0) * l.powf(-a / 2.0 - 2.0)),
        Compression::UTru => m * (2.0 * l.powf(a - 1.0) + l.powf(-a / 2.0 - 1.0)),
        Compression::CTru => 2.0 * m * (l.powf(a - 1.0) + l.powf(-a - 1.0)),
    }
}

/// u'''' at a deflection and slope in a layer.
fn bend(problem: &Problem, layer: Option<&BeamLayer>, u: f64, slope: f64) -> f64 {
    let Some(layer) = layer else { return 0.0 };
    let ratio = (layer.initial_length_mm - u.abs()) / layer.initial_length_mm;
    let hold = 1.0 - layer.friction * slope.atan().sin().powi(2);
    -1e-3 * modulus(layer, ratio) * u * hold / problem.bending_nmm2
}

/// Deflection, slope and two derivatives at every step from the tip (given) to the base, with their places.
fn integrate(problem: &Problem, tip: &Vector2<f64>) -> Vec<(f64, [f64; 4])> {
    let mut spans: Vec<(f64, Option<&BeamLayer>)> = vec![(problem.control_distance_mm, None)];
    spans.extend(problem.layers.iter().map(|layer| (layer.thickness_mm, Some(layer))));
    let mut y = [tip.x, tip.y, 0.0, 0.0];
    let mut x = problem.inserted_mm;
    let mut all = vec![(x, y)];
    for (length, layer) in spans.into_iter().rev() {
        let count = (length / STEP).round() as usize;
        let (start, h) = (x, -length / count as f64);
        let slope = |y: &[f64; 4]| [y[1], y[2], y[3], bend(problem, layer, y[0], y[1])];
        let moved = |y: &[f64; 4], k: &[f64; 4], by: f64| std::array::from_fn(|i| y[i] + by * k[i]);
        for step in 1..=count {
            let a = slope(&y);
            let b = slope(&moved(&y, &a, h / 2.0));
            let c = slope(&moved(&y, &b, h / 2.0));
            let d = slope(&moved(&y, &c, h));
            y = std::array::from_fn(|i| y[i] + h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]));
            x = start + h * step as f64;
            all.push((x, y));
        }
    }
    all
}

fn miss(problem: &Problem, tip: &Vector2<f64>, goal: &Vector2<f64>) -> Vector2<f64> {
    let all = integrate(problem, tip);
    let end = all[all.len() - 1].1;
    Vector2::new(end[0], end[1]) - goal
}

/// The needle by shooting: the base is moved in small steps, each solved by Newton's method with differences.
fn shoot(problem: &Problem, displacement: f64, slope: f64) -> Vec<(f64, [f64; 4])> {
    let mut tip = Vector2::zeros();
    const SHARES: usize = 15;
    for share in 1..=SHARES {
        let goal = Vector2::new(displacement, slope) * (share as f64 / SHARES as f64);
        for count in 0.. {
            let off = miss(problem, &tip, &goal);
            if off.amax() < 1e-9 {
                break;
            }
            assert!(count < 30 && off.amax().is_finite(), "shooting does not end: {off}");
            let nudges = [Vector2::new(1e-6, 0.0), Vector2::new(0.0, 1e-7)];
            let columns = nudges.map(|nudge| {
                (miss(problem, &(tip + nudge), &goal) - miss(problem, &(tip - nudge), &goal)) / (2.0 * nudge.amax())
            });
            tip -= Matrix2::from_columns(&columns).lu().solve(&off).expect("a direction");
        }
    }
    integrate(problem, &tip)
}

fn compared(problem: &Problem, displacement: f64, slope: f64) -> f64 {
    let shape = solve(problem, &base(displacement, slope));
    assert!(shape.residual < 1e-10);
    let other = shoot(problem, displacement, slope);
    let apart = |(x, y): &(f64, [f64; 4])| (shape.at(*x)[0] - y[0]).abs();
    other.iter().map(apart).fold(0.0, f64::max)
}

/// Tissue of 20 mm, the base moved by 15 mm: to 1e-4 mm throughout.
#[test]
fn large_compression_agrees_with_another_method() {
    let constrained = (PSM.0, Compression::CTru);
    let steep = (
        Material::Ogden(Ogden {
            mu_kpa: 2.0,
            alpha: -12.0,
        }),
        Compression::UTru,
    );
    for tissue in [PVC, PSM, constrained, steep] {
        for (control, depth, slope) in [(20.0, 60.0, -0.4), (20.0, 60.0, 0.0), (5.0, 40.0, -0.1)] {
            let mut layer = layer(tissue, depth);
            layer.initial_length_mm = 20.0;
            let mut needle = problem(control, vec![layer]);
            // With the base near the entry the modulus grows a thousandfold within a few millimetres.
            needle.element_mm = if control < 20.0 { 0.5 } else { 1.0 };
            let worst = compared(&needle, 15.0, slope);
            assert!(worst < 1e-4, "{tissue:?} {control} {depth} {slope}: {worst} mm");
        }
    }
}

#[test]
fn layers_with_friction_agree_with_another_method() {
    let layers = [
        (PSM, 10.0, 0.3),
        (PVC, 2.5, 0.0),
        ((PSM.0, Compression::CTru), 30.0, 1.0),
    ];
    let layers = layers.map(|(tissue, thickness, friction)| BeamLayer {
        friction,
        initial_length_mm: 20.0,
        ..layer(tissue, thickness)
    });
    let needle = problem(20.0, layers.to_vec());
    let worst = compared(&needle, 15.0, -0.4);
    assert!(worst < 1e-4, "{worst} mm");
    // Friction is no trifle here: the same without it is another needle.
    let mut smooth = needle.clone();
    smooth.layers.iter_mut().for_each(|layer| layer.friction = 0.0);
    let tips = [&needle, &smooth].map(|problem| solve(problem, &base(15.0, -0.4)).tip_mm());
    assert!((tips[0] - tips[1]).abs() > 1e-2, "{tips:?}");
}

/// Newton's method doubles the digits at every step once it is near: a handful of steps, and a balance to rounding.
#[test]
fn few_steps_lead_to_a_balance() {
    for tissue in [PVC, PSM, (PSM.0, Compression::CTru)] {
        let mut layer = layer(tissue, 60.0);
        (layer.friction, layer.initial_length_mm) = (0.5, 20.0);
        let shape = solve(&problem(20.0, vec![layer]), &base(15.0, -0.2));
        assert!(
            shape.iterations <= 8 && shape.residual < 1e-10,
            "{} {}",
            shape.iterations,
            shape.residual
        );
    }
}
