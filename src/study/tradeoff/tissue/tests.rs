//! Test of the complete study on a small block.

use super::*;
use insonify_base::range::OutOfRange;
use insonify_mechanics::tissue::law::AnyLaw;
use insonify_mechanics::tissue::material::Material;
use insonify_mechanics::tissue::nonlinear::NonlinearError;

#[test]
fn a_small_block_is_studied() {
    let options = TissueOptions {
        nodes: 120,
        steps: [4, 8],
        ..TissueOptions::default()
    };
    let mut reached = 0.0;
    let study = study(&options, &mut |_, share| {
        assert!((reached..=1.0).contains(&share));
        reached = share;
    });
    let study = study.unwrap();
    assert_eq!(reached, 1.0);
    let [schemes, models, laws] = &study.tables[..] else {
        panic!("{:?}", study.tables)
    };
    assert_eq!((schemes.rows.len(), models.rows.len()), (12, 8));
    let value = |table: &Table, name: &str, steps: &str, key: &str| {
        let row = table.rows.iter().find(|row| row.choices == [name, steps]).unwrap();
        assert_eq!(row.flag, None, "{name}");
        row.values[table.axes.iter().position(|axis| axis.key == key).unwrap()].unwrap()
    };
    // Iterative schemes reach their tolerance, relative to the displacements; Euler's error decreases with the step.
    for name in ["modified (Kobayashi 2010)", "modified, accelerated", "full Newton"] {
        assert!(value(schemes, name, "8", "error") < 1e-5, "{name}");
    }
    for name in ["Euler (Kobayashi 2010)", "Euler, consistent", "Euler, corrected"] {
        let [coarse, fine] = ["4", "8"].map(|steps| value(schemes, name, steps, "error"));
        assert!(fine < coarse && coarse < 0.2, "{name}: {coarse} {fine}");
    }
    assert_eq!(value(schemes, "Euler (Kobayashi 2010)", "8", "iterations"), 1.0);
    // Linear tissue is softest; elastic tissue does not relax, viscoelastic tissue does.
    let force = |name: &str, key: &str| value(models, name, "8", key);
    assert!(force("linear", "force_n") < force("nonlinear", "force_n"));
    assert!((force("nonlinear", "relaxed_n") / force("nonlinear", "force_n") - 1.0).abs() < 1e-6);
    for name in ["viscoelastic, load integral", "viscoelastic, rate"] {
        assert!(force(name, "relaxed_n") < 0.99 * force(name, "force_n"), "{name}");
    }
    assert!(force("viscoelastic, rate", "error_force") < 0.02);
    // Of every law there are rows, and a tighter tolerance comes nearer to its exact solution.
    let examples = AnyLaw::examples(Material::new(1.16, 0.45).unwrap()).unwrap();
    assert_eq!(laws.rows.len(), 5 * examples.len());
    for (law, _) in examples {
        for scheme in ["modified, accelerated", "full Newton"] {
            let error = |tolerance: &str| {
                let row = laws
                    .rows
                    .iter()
                    .find(|row| row.choices == [law, scheme, tolerance])
                    .unwrap();
                assert_eq!(row.flag, None, "{law}, {scheme}");
                laws.value(row, "error").unwrap()
            };
            assert!(
                error("1e-8") < 1e-6 && error("1e-8") <= error("1e-3"),
                "{law}, {scheme}: {}",
                error("1e-8")
            );
        }
    }
}

#[test]
fn what_is_no_tissue_is_refused() {
    let refused = |options| study(&options, &mut |_, _| {}).unwrap_err();
    let default = TissueOptions {
        nodes: 60,
        ..TissueOptions::default()
    };
    assert!(matches!(
        refused(TissueOptions {
            poisson: 0.5,
            ..default
        })
        .downcast_ref(),
        Some(OutOfRange { .. })
    ));
    assert!(matches!(
        refused(TissueOptions {
            stiffening: -1.0,
            ..default
        })
        .downcast_ref(),
        Some(OutOfRange { .. })
    ));
    assert!(matches!(
        refused(TissueOptions { order: 2.0, ..default }).downcast_ref(),
        Some(NonlinearError::History(_))
    ));
}
