use super::*;
use crate::anatomies;

fn tables(roughness: f64) -> Tables {
    let (anatomy, mut settings, _) = anatomies::two_layers();
    settings.effects.interface = Some(Interface {
        roughness,
        ..Interface::default()
    });
    Tables::new(anatomy, settings).unwrap()
}

#[test]
fn roughness_has_unit_power_and_the_spread_that_it_states() {
    for (roughness, stated_db) in [(0.25, 3.7), (1.0, 5.2)] {
        let tables = tables(roughness);
        let surfaces = Surfaces::<f64>::new(&tables, [0.0, 0.0, 1.0]);
        let found: Vec<f64> = (0..40_000)
            .map(|at| {
                let [i, j, k] = [at % 40, at / 40 % 40, at / 1600].map(|n| f64::from(n) * 11.3);
                let [re, im] = surfaces.roughness([i, j, k]);
                re.hypot(im)
            })
            .collect();
        let mean = |of: &dyn Fn(f64) -> f64| found.iter().map(|x| of(*x)).sum::<f64>() / found.len() as f64;
        assert!((mean(&|x| x * x) - 1.0).abs() < 0.02, "{roughness}");
        let db = |x: f64| 20.0 * x.log10();
        let middle = mean(&|x| db(x));
        let spread = mean(&|x| (db(x) - middle).powi(2)).sqrt();
        assert!((spread - stated_db).abs() < 0.2, "{roughness}: {spread} dB");
    }
}

#[test]
fn without_roughness_the_multiplier_is_one() {
    let tables = tables(0.0);
    let surfaces = Surfaces::<f64>::new(&tables, [0.0, 0.0, 1.0]);
    assert_eq!(surfaces.roughness([3.2, -8.1, 40.0]), [1.0, 0.0]);
}

#[test]
fn capsules_count_where_impedances_agree() {
    let mut tables = tables(0.0);
    let row = |impedance: f32, capsule: f32| crate::synth::tables::LabelRow {
        impedance,
        capsule,
        ..tables.label_rows[0]
    };
    tables.label_rows = vec![row(1.5, 0.0), row(1.5, 0.03), row(1.5, 0.06), row(1.7, 0.03)];
    let surfaces = Surfaces::<f64>::new(&tables, [0.0, 0.0, 1.0]);
    for (labels, expected) in [
        ([0, 1], 0.03),
        ([1, 1], 0.0),
        ([2, 1], 0.03),
        ([0, 3], 0.2 / 3.2),
        ([3, 1], 0.2 / 3.2),
    ] {
        assert!((surfaces.coefficient(labels) - expected).abs() < 1e-7, "{labels:?}");
    }
}
