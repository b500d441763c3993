//! Hand calculation of a column that is pushed, punctured and cut.

use super::*;
use crate::insertion::{InvalidSetup, Peak};
use crate::tissue::material::Material;
use crate::tissue::nonlinear::creep::{Creep, Memory};
use crate::tissue::nonlinear::{Sheet, Solver, SolverOptions, Stiffening, Supports};
use crate::tissue::viscoelastic::Rule;

/// Two columns of 1 x 20 mm, 2 mm thick, whose nodes move along y only and in pairs: a bar of E (Poisson's ratio 0).
/// The needle goes down between them, from the top at y = 20.
fn bar() -> (Arc<Sheet>, Supports<2>) {
    let rows = 20u32;
    let nodes = (0..=rows)
        .flat_map(|row| [-1.0, 0.0, 1.0].map(|x| [x, f64::from(row)]))
        .collect();
    let mut triangles = Vec::new();
    for row in 0..rows {
        for column in 0..2 {
            let low = 3 * row + column;
            triangles.push([low, low + 1, low + 4]);
            triangles.push([low, low + 4, low + 3]);
        }
    }
    let law = Stiffening::linear(Material::new(10.0, 0.0).unwrap());
    let body = Sheet::plane_strain(nodes, triangles.clone(), &vec![law; triangles.len()], 2.0).unwrap();
    let supports = (0..3 * (rows + 1))
        .map(|node| (node, 0))
        .chain((0..3).map(|node| (node, 1)));
    (Arc::new(body), Supports::new(3 * (rows as usize + 1), supports))
}

fn elastic() -> Structure<2, 3> {
    let (body, supports) = bar();
    Structure::Elastic(Box::new(Solver::new(body, supports, SolverOptions::default()).unwrap()))
}

const LAYERS: [PathLayer; 2] = [
    PathLayer {
        from_mm: 0.0,
        membrane_n: 0.01,
        cutting_n: 0.002,
        friction_n_per_mm: 0.0005,
        static_ratio: 1.0,
        peak: None,
    },
    PathLayer {
        from_mm: 12.0,
        membrane_n: 0.012,
        cutting_n: 0.002,
        friction_n_per_mm: 0.0005,
        static_ratio: 1.0,
        peak: None,
    },
];

fn push(structure: Structure<2, 3>, layers: &[PathLayer]) -> Pushing<2, 3> {
    Pushing::new(structure, [0.0, 20.0], [0.0, -2.0], layers.to_vec()).unwrap()
}

#[test]
fn a_needle_pushes_punctures_and_cuts() {
    let mut needle = push(elastic(), &LAYERS);
    let far = needle.step(-3.0, 0.1).unwrap();
    assert_eq!((far.force_n, far.phase), (0.0, Phase::Free));
    let mut trace = Vec::new();
    for step in 1..=200 {
        let travel = 0.1 * f64::from(step);
        trace.push((travel, needle.step(travel, 0.02).unwrap()));
    }
    let punctures: Vec<usize> = (0..trace.len())
        .filter(|step| trace[*step].1.punctured.is_some())
        .collect();
    assert_eq!(punctures.len(), 2, "{trace:?}");
    for (&step, layer) in punctures.iter().zip(0..) {
        let (_, pushed) = trace[step];
        assert_eq!((pushed.punctured, pushed.phase), (Some(layer), Phase::Pushing(layer)));
        let bears = LAYERS[layer].membrane_n;
        assert!(pushed.tip_n > bears && trace[step - 1].1.tip_n <= bears);
        // After the puncture only the cutting force acts on the tip.
        assert!((trace[step + 1].1.tip_n - 0.002).abs() < 1e-15);
        assert!(trace[step + 1].1.force_n < pushed.force_n);
    }
    // Up to the first puncture, the tip stays in place in the tissue and the force rises with its travel.
    for pair in trace[..punctures[0]].windows(2) {
        assert!(pair[1].1.force_n > pair[0].1.force_n && pair[1].1.depth_mm == 0.0);
    }
    // Everywhere the shaft drags the tissue that it has passed.
    for (_, pushed) in &trace {
        assert!(
            (pushed.force_n - pushed.tip_n - 0.0005 * pushed.depth_mm).abs() < 1e-12,
            "{pushed:?}"
        );
    }
    // While it cuts, tissue at the tip is at the tip: a bar of 2 x 2 mm and 10 kPa, the tip at s, yields to the cutting
    // force by (20 - s) / EA times it, and to friction q from 0 to s by q times (20 - s) s / EA. The mesh is not
    // uniform across: within 5 %.
    let (travel, cut) = trace[punctures[1] - 1];
    assert!(matches!(cut.phase, Phase::Pushing(1)));
    let (travel, cut) = trace
        .iter()
        .rev()
        .find(|(t, p)| *t < travel && p.phase == Phase::Cutting(0))
        .unwrap();
    let (stiffness, s) = (0.04, cut.depth_mm);
    let expected = (0.002 + 0.0005 * s) * (20.0 - s) / stiffness;
    // The tip is where tissue was a step before: a tenth of a millimetre.
    assert!(
        (travel - s - expected).abs() < 0.05 * expected + 0.1,
        "{travel} at {s}: {expected}"
    );
}

/// A viscous body yields more the slower it is pushed: the same travel takes a lower force.
#[test]
fn a_slow_needle_meets_less_force() {
    let at_speed = |mm_per_s: f64| {
        let (body, supports) = bar();
        let solver = Solver::new(body, supports, SolverOptions::default()).unwrap();
        let loads = vec![0.0; solver.supports().all()];
        let creep = Creep::new(solver, Memory::LoadIntegral, 0.1, Rule::Trapezoid, &loads).unwrap();
        let strong = [PathLayer {
            membrane_n: 10.0,
            ..LAYERS[0]
        }];
        let mut needle = push(Structure::Viscous(Box::new(creep)), &strong);
        (1..=20)
            .map(|step| needle.step(0.1 * f64::from(step), 0.1 / mm_per_s).unwrap().force_n)
            .last()
            .unwrap()
    };
    let [fast, slow] = [5.0, 0.5].map(at_speed);
    // A ramp is resisted by t^(1-k) per unit rate: the force scales with the speed to the power k.
    assert!((fast / slow - 10f64.powf(0.1)).abs() < 1e-3, "{fast} {slow}");
}

#[test]
fn a_way_that_begins_where_a_line_meets_the_body_is_one_whatever_its_direction() {
    let mut needle = push(elastic(), &LAYERS);
    for index in 0..200 {
        let angle = 0.9 * f64::from(index - 100) / 100.0;
        let direction = [angle.sin(), -angle.cos()];
        let tip = [0.3 - 7.0 * direction[0], 20.0 - 7.0 * direction[1]];
        let crossed = crossings(needle.body(), &tip, &direction);
        let from_mm = crossed
            .iter()
            .fold(f64::INFINITY, |least, crossing| least.min(crossing.from_mm));
        let entry = [0, 1].map(|axis| tip[axis] + from_mm * direction[axis]);
        needle
            .aim(entry, direction, LAYERS.to_vec())
            .unwrap_or_else(|error| panic!("{angle} rad: {error}"));
    }
}

#[test]
fn ways_are_checked() {
    let refused = |entry, direction, layers: &[PathLayer]| {
        Pushing::new(elastic(), entry, direction, layers.to_vec()).unwrap_err()
    };
    let down = [0.0, -1.0];
    assert!(matches!(
        refused([5.0, 20.0], down, &LAYERS),
        InvalidSetup::Outside { .. }
    ));
    assert!(matches!(
        refused([0.0, 20.0], [0.0, 0.0], &LAYERS),
        InvalidSetup::Direction { .. }
    ));
    assert!(matches!(
        refused([0.0, 20.0], down, &[]),
        InvalidSetup::First { found: None }
    ));
    assert!(matches!(
        refused([0.0, 20.0], down, &LAYERS[1..]),
        InvalidSetup::First { found: Some(_) }
    ));
    let twice = [LAYERS[0], LAYERS[1], LAYERS[1]];
    assert!(matches!(
        refused([0.0, 20.0], down, &twice),
        InvalidSetup::Layer { layer: 2, cause } if cause.key == "from_mm"
    ));
    let negative = [PathLayer {
        cutting_n: -1.0,
        ..LAYERS[0]
    }];
    assert!(matches!(
        refused([0.0, 20.0], down, &negative),
        InvalidSetup::Layer { cause, .. } if cause.key == "cutting_n"
    ));
}

/// Layers without membranes and cutting forces, whose densities near the tip are higher in the first and lower in the
/// second than the friction behind it.
fn peaked() -> [PathLayer; 2] {
    [(0.0, 0.001, 3.0), (12.0, 0.0002, 5.0)].map(|(from_mm, density_n_per_mm, width_mm)| PathLayer {
        from_mm,
        membrane_n: 0.0,
        cutting_n: 0.0,
        peak: Some(Peak {
            density_n_per_mm,
            width_mm,
        }),
        ..LAYERS[0]
    })
}

/// Integral of the density over the shaft with the tip at a depth, where `channel_mm` had been cut before, N.
fn peaked_n(depth_mm: f64, channel_mm: f64) -> f64 {
    let layers = peaked();
    let parts = 100_000;
    let part_mm = depth_mm / f64::from(parts);
    let forces = (0..parts).map(|part| {
        let at_mm = (f64::from(part) + 0.5) * part_mm;
        let layer = layers[usize::from(at_mm > 12.0)];
        let peak = layer.peak.expect("a peak");
        let is_near = at_mm > channel_mm && depth_mm - at_mm < peak.width_mm;
        part_mm
            * if is_near {
                peak.density_n_per_mm
            } else {
                layer.friction_n_per_mm
            }
    });
    forces.sum()
}

#[test]
fn near_the_tip_newly_cut_tissue_has_the_density_of_the_peak() {
    let mut needle = push(elastic(), &peaked());
    let (mut checked, mut in_channel) = ([0; 2], 0);
    let mut check = |stage: usize, pushed: &Pushed, channel_mm: f64| {
        if matches!(pushed.phase, Phase::Cutting(_)) {
            let expected = peaked_n(pushed.depth_mm, channel_mm);
            assert!((pushed.force_n - expected).abs() < 1e-7, "{pushed:?}: {expected}");
            checked[stage] += 1;
        }
    };
    for step in 1..=100 {
        check(0, &needle.step(0.1 * f64::from(step), 0.02).unwrap(), 0.0);
    }
    let channel_mm = needle.depth_mm();
    let mut sliding_out = 0;
    for step in (40..100).rev() {
        let pushed = needle.step(0.1 * f64::from(step), 0.02).unwrap();
        if pushed.phase == Phase::Free {
            // Outward there is friction alone.
            assert!((pushed.force_n + 0.0005 * pushed.depth_mm).abs() < 1e-12, "{pushed:?}");
            sliding_out += 1;
        }
    }
    assert!(sliding_out > 20, "{sliding_out}");
    for step in 41..=200 {
        let pushed = needle.step(0.1 * f64::from(step), 0.02).unwrap();
        if pushed.phase == Phase::Free {
            assert!((pushed.force_n - 0.0005 * pushed.depth_mm).abs() < 1e-12, "{pushed:?}");
            in_channel += 1;
        }
        check(1, &pushed, channel_mm);
    }
    assert!(
        checked.iter().all(|count| *count > 20) && in_channel > 20,
        "{checked:?} {in_channel}"
    );
}

/// Dehghan et al. 2008, figure 9 b: the force falls while the needle rests, and returns when it goes on.
#[test]
fn the_force_of_a_resting_needle_relaxes() {
    let forces = [false, true].map(|is_viscous| {
        let structure = if is_viscous {
            let (body, supports) = bar();
            let solver = Solver::new(body, supports, SolverOptions::default()).unwrap();
            let loads = vec![0.0; solver.supports().all()];
            let creep = Creep::new(solver, Memory::LoadIntegral, 0.2, Rule::Trapezoid, &loads).unwrap();
            Structure::Viscous(Box::new(creep))
        } else {
            elastic()
        };
        let mut needle = push(structure, &peaked());
        let travels = (1..=80).chain(std::iter::repeat_n(80, 40)).chain(81..=120);
        let steps = travels.map(|step| needle.step(0.1 * f64::from(step), 0.02).unwrap());
        steps.collect::<Vec<Pushed>>()
    });
    for (is_viscous, pushed) in [false, true].into_iter().zip(&forces) {
        let rest = &pushed[80..120];
        assert!(rest.iter().all(|pushed| pushed.phase == Phase::Held));
        let fall = 1.0 - rest[39].force_n / pushed[79].force_n;
        if is_viscous {
            let falls = rest.windows(2).all(|pair| pair[1].force_n < pair[0].force_n);
            assert!(falls && fall > 0.1, "{fall}: {rest:?}");
        } else {
            assert!(fall.abs() < 1e-6, "{fall}");
        }
        let last = pushed[159];
        assert!(matches!(last.phase, Phase::Cutting(_)), "{last:?}");
        assert!((last.force_n - peaked_n(last.depth_mm, 0.0)).abs() < 1e-7);
    }
}
