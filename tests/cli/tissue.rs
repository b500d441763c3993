//! What `insonify puncture` and `insonify tradeoff tissue` print and refuse.

use crate::support::Bench;

/// The force rises ever faster and drops where capsule and vein give way; the same goes into the files.
#[test]
fn a_puncture_is_told_and_written() {
    let bench = Bench::new();
    let json = bench.run("puncture --step-mm 1 --quiet --json -o out").json();
    let rows = json["rows"].as_array().expect("rows");
    let force = |at: usize| rows[at]["force_n"].as_f64().expect("a force");
    let punctured: Vec<usize> = (0..rows.len()).filter(|at| !rows[*at]["punctured"].is_null()).collect();
    assert!(punctured.len() >= 2, "{json}");
    for at in &punctured[..2] {
        assert!(force(at + 1) < 0.7 * force(*at), "{at}: {json}");
    }
    assert!(force(punctured[0]) > 2.2 * force(punctured[0] / 2), "{json}");
    let files = bench.files("out");
    for name in ["force.csv", "force.svg"] {
        assert!(files.iter().any(|file| file == name), "{files:?}");
    }
}

/// A curve that the slice itself has made is met; one that is none is shown.
#[test]
fn a_measured_force_is_fitted() {
    let bench = Bench::new();
    bench
        .run("puncture --order 0 --young-kpa 3 --step-mm 3 --quiet -o made")
        .text();
    let json = bench
        .run("puncture --order 0 --step-mm 3 --fit made/force.csv --quiet --json")
        .json();
    let young = json["fit"]["young_kpa"].as_f64().expect("a modulus");
    assert!((young / 3.0 - 1.0).abs() < 0.02, "{}", json["fit"]);
    assert!(json["fit"]["r_squared"].as_f64().expect("a number") > 0.9999);
    assert_eq!(json["options"]["young_kpa"], json["fit"]["young_kpa"]);
    bench.write("bad.csv", "travel_mm,force_n\n1,2\n2,x\n");
    bench
        .run("puncture --fit bad.csv")
        .fails(2, &["bad.csv, line 3", "`x`"]);
}

#[test]
fn numbers_out_of_range_end_with_2_and_their_names() {
    for (command, name) in [
        ("puncture --step-mm 0", "step_mm"),
        ("puncture --speed -1", "speed_mm_per_s"),
        ("tradeoff tissue --poisson 0.5 --quick", "poisson"),
    ] {
        Bench::new().run(command).fails(2, &[name]);
    }
}
