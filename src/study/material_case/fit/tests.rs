use std::fs;

use super::*;
use crate::material_case::{CaseFile, EXAMPLE};
use insonify_base::random;

/// Reads tables and fits them.
fn fitted(tables: &[&str], order: Option<f64>, memory: Structure) -> Result<MaterialFit, String> {
    let folder = tempfile::tempdir().unwrap();
    let mut measured = Measurements::default();
    for (index, table) in tables.iter().enumerate() {
        let path = folder.path().join(format!("{index}.csv"));
        fs::write(&path, table).unwrap();
        measured.add(&path).map_err(|error| error.to_string())?;
    }
    MaterialFit::new(&measured, order, memory)
}

/// Measurements of the virtual rheometer on the example under a memory.
fn rheometer(memory: &str) -> [String; 2] {
    let text = EXAMPLE.replace("memory = \"rate\"", &format!("memory = \"{memory}\""));
    let case = CaseFile::parse(&text, "e.toml").unwrap().resolve().unwrap();
    case.rheometer().unwrap().tables().map(|(_, table)| table.csv())
}

fn near(estimate: Estimate, exact: f64, bound: f64) {
    assert!((estimate.value / exact - 1.0).abs() < bound, "{estimate:?} of {exact}");
}

#[test]
fn what_the_rheometer_measures_returns_its_material() {
    for (name, memory) in [("load-integral", Structure::LoadIntegral), ("rate", Structure::Rate)] {
        let [moduli, creep] = rheometer(name);
        let fit = fitted(&[&moduli, &creep], None, memory).unwrap();
        let (dynamic, creep) = (fit.dynamic.unwrap(), fit.creep.unwrap());
        near(dynamic.order, 0.1, 1e-3);
        near(dynamic.modulus_kpa, 0.4, 1e-3);
        assert!((dynamic.loss_tangent / (0.05 * std::f64::consts::PI).tan() - 1.0).abs() < 1e-3);
        assert!((dynamic.spring_pot_loss_tangent - 0.158).abs() < 5e-4);
        near(creep.modulus_kpa, 0.4, 2e-3);
        near(creep.knee_shear.unwrap(), 0.35, 5e-3);
        near(creep.stiffening.unwrap(), 8.0, 2e-2);
        assert!(fit.warnings.is_empty(), "{:?}", fit.warnings);
    }
}

#[test]
fn the_order_is_that_of_the_least_stress_without_moduli() {
    let [_, creep] = rheometer("load-integral");
    let fit = fitted(&[&creep], None, Structure::LoadIntegral).unwrap();
    assert!((fit.creep.unwrap().order - 0.1).abs() < 1e-6 && fit.dynamic.is_none());
}

/// A sweep of another order, and strains that hardly grow: both are doubted, the rheometer's own tables are not.
#[test]
fn orders_that_contradict_or_are_uncertain_are_told() {
    let [moduli, creep] = rheometer("load-integral");
    let doubts = |tables: &[&str], order| {
        let fit = fitted(tables, order, Structure::LoadIntegral).unwrap();
        fit.warnings
            .into_iter()
            .filter(|text| text.contains("order"))
            .collect::<Vec<_>>()
    };
    assert_eq!(doubts(&[&moduli, &creep], None), Vec::<String>::new());
    assert!(doubts(&[&creep], Some(0.25))[0].contains("one spring-pot does not fit both"));
    let flat =
        "stress_kpa,time_s,strain\n0.05,1,0.1\n0.05,10,0.13\n0.05,100,0.102\n0.2,1,0.4\n0.2,10,0.41\n0.3,1,0.7\n";
    assert!(doubts(&[flat], None)[0].contains("not clearly above 0"));
}

/// Every number of a table but those of the first column times 1 and noise of this size.
fn noisy(table: &str, share: f64, seed: u64) -> String {
    let (seed, mut count) = (random::seed_words(seed), 0);
    let mut lines: Vec<String> = table.lines().map(str::to_owned).collect();
    for line in &mut lines[1..] {
        let cells = line.split(',').enumerate().map(|(column, cell)| {
            count += 1;
            let noise = random::normal([count, 0, 0], seed) * share;
            let factor = if column == 0 || cell.parse::<f64>().is_err() {
                1.0
            } else {
                1.0 + noise
            };
            (cell.parse::<f64>().unwrap()
                * if column == 1 && table.contains("time_s") {
                    1.0
                } else {
                    factor
                })
            .to_string()
        });
        let cells: Vec<String> = cells.collect();
        *line = cells.join(",");
    }
    lines.join("\n")
}

#[test]
fn noise_of_two_percent_moves_the_parameters_by_their_standard_errors() {
    let [moduli, creep] = rheometer("load-integral");
    let (mut worst, mut offs) = ([0.0f64; 5], Vec::new());
    for seed in 0..20 {
        let tables = [noisy(&moduli, 0.02, seed), noisy(&creep, 0.02, 100 + seed)];
        let fit = fitted(&[&tables[0], &tables[1]], Some(0.1), Structure::LoadIntegral).unwrap();
        let (dynamic, creep) = (fit.dynamic.unwrap(), fit.creep.unwrap());
        let estimates = [
            (dynamic.order, 0.1),
            (dynamic.modulus_kpa, 0.4),
            (creep.modulus_kpa, 0.4),
            (creep.knee_shear.unwrap(), 0.35),
            (creep.stiffening.unwrap(), 8.0),
        ];
        for (worst, (estimate, exact)) in worst.iter_mut().zip(estimates) {
            *worst = worst.max((estimate.value / exact - 1.0).abs());
            offs.push((estimate.value - exact) / estimate.standard_error);
        }
    }
    for (worst, bound) in worst.iter().zip([0.1, 0.02, 0.01, 0.06, 0.2]) {
        assert!(*worst < bound, "{worst:?}");
    }
    // Deviations in standard errors have a variance of one.
    let variance = offs.iter().map(|error| error * error).sum::<f64>() / offs.len() as f64;
    assert!((0.5..2.0).contains(&variance), "{variance}");
}

#[test]
fn tissue_that_does_not_stiffen_has_no_knee() {
    let rows = |noise: f64| {
        let mut table = String::from("stress_pa,time_s,strain_percent\n");
        for stress in [50.0, 100.0, 200.0] {
            for time in [1.0f64, 10.0, 100.0] {
                let scale = 1.0 + noise * (stress * time).sin();
                table += &format!(
                    "{stress},{time},{}\n",
                    100.0 * scale * stress * 1e-3 / 0.4 * time.powf(0.1) / tgamma(1.1)
                );
            }
        }
        table
    };
    for noise in [0.0, 0.02] {
        let fit = fitted(&[&rows(noise)], Some(0.1), Structure::Rate).unwrap();
        assert!(fit.to_string().contains("no knee"), "{fit}");
        let creep = fit.creep.unwrap();
        near(creep.modulus_kpa, 0.4, 1e-9 + noise);
        assert!(creep.knee_shear.is_none() && creep.stiffening.is_none());
    }
}

#[test]
fn what_does_not_determine_the_parameters_is_refused() {
    const SWEEP: &str = "frequency_hz,storage_pa,loss_pa\n0.1,400,63\n1,500,79\n10,630,100\n";
    const CREEP: &str = "stress_kpa,time_s,strain\n0.1,0,0\n0.1,1,0.2\n0.1,10,0.3\n0.2,1,0.4\n0.2,10,0.5\n";
    let cases = [
        (
            "a,b\n1,2\n".to_owned(),
            "line 1: found the columns of neither kind of test; expected the columns frequency_rad_s",
        ),
        (
            SWEEP.replace("0.1,400,63\n", ""),
            "found moduli at 2 frequencies; expected at least 3",
        ),
        (
            SWEEP.replace("500,79", "500,"),
            "line 3: found `` in column `loss_pa`; expected a finite number",
        ),
        (
            SWEEP.replace("79", "-79"),
            "line 3: found `-79` in column `loss_pa`; expected a number above 0",
        ),
        (
            SWEEP.replace("630,100", "330,50"),
            "expected a power above 0 and below 1",
        ),
        (
            CREEP.replace("0.1,10,", "0.1,1,"),
            "line 4: found `1` in column `time_s`; expected a time from 0 that rises",
        ),
        (
            CREEP.replace("0.2,10,0.5", "0.2,10,0.3"),
            "line 6: found `0.3` in column `strain`; expected a strain that rises",
        ),
        (
            CREEP.replace("0.2,1,0.4\n0.2,10,0.5\n", ""),
            "found 2 strains; expected at least 4",
        ),
        (CREEP.replace("10,0.3", "10,nan"), "line 4: found `nan`"),
    ];
    for (table, words) in cases {
        let message = fitted(&[&table], Some(0.1), Structure::LoadIntegral).unwrap_err();
        assert!(message.contains(words), "{message}\nexpected {words}");
    }
    let message = fitted(&[CREEP], None, Structure::LoadIntegral).unwrap_err();
    assert!(
        message.contains("from 2 times in the test of the least stress; expected `--order`"),
        "{message}"
    );
    // Slopes of 0.1 and a loss that does not belong to them.
    let odd = fitted(&[&SWEEP.replace("630,100", "630,200")], None, Structure::Rate).unwrap();
    assert!(odd.warnings[0].contains("no spring-pot fits"), "{:?}", odd.warnings);
}
