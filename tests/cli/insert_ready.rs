//! The scenarios that come with the program run. Coarser meshes and longer steps than their own keep the time short.

use std::path::Path;

use insonify::input::scenario::EXAMPLES;
use serde_json::Value;

use crate::support::Bench;

/// A segmentation of TotalSegmentator, where there is one.
const SEGMENTATION: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../shared/data/volumes/tsd_s0328_labels.nii.gz"
);

fn ready(name: &str) -> String {
    let (_, text) = EXAMPLES.iter().find(|(known, _)| *known == name).expect(name);
    let quick = text
        .replace("nodes = 3300", "nodes = 1200")
        .replace("dt_ms = 1.0", "dt_ms = 4.0");
    assert_ne!(quick, *text, "{name}");
    quick
}

fn summary(name: &str, text: &str) -> Value {
    let bench = Bench::new();
    bench.write("ready.toml", text);
    let summary = bench.run("insert ready.toml -o out --json -q").json();
    assert!(summary["max_base_force_n"].as_f64().expect("a force") > 0.5, "{name}");
    assert!(summary["remeshes"].as_u64().expect("a count") > 5, "{name}");
    summary
}

fn kinds(summary: &Value) -> Vec<&str> {
    let events = summary["events"].as_array().expect("a list");
    events
        .iter()
        .map(|event| event["kind"].as_str().expect("a word"))
        .collect()
}

fn number(of: &Value) -> f64 {
    of.as_f64().expect("a number")
}

#[test]
fn a_needle_goes_into_the_liver_and_out_again() {
    let summary = summary("liver-biopsy", &ready("liver-biopsy"));
    let kinds = kinds(&summary);
    assert!(kinds.contains(&"surface") && kinds.contains(&"out"), "{kinds:?}");
    // 138 mm of the path lie in the body; the needle drags tissue along, by less than a tenth of that.
    assert!(
        (124.0..138.5).contains(&number(&summary["max_inserted_mm"])),
        "{summary}"
    );
    let events = summary["events"].as_array().expect("a list");
    assert!(
        events.iter().any(|event| event["region"] == "liver"),
        "it comes to the liver"
    );
}

#[test]
fn seeds_are_left_in_the_prostate_while_the_probe_presses() {
    let summary = summary("prostate-brachytherapy", &ready("prostate-brachytherapy"));
    let seeds = summary["seeds"].as_array().expect("a list");
    assert_eq!(seeds.len(), 4);
    for seed in seeds {
        let distance = number(&seed["distance_mm"]);
        assert!(distance > 0.0 && distance < 15.0, "{seed}");
    }
    assert!(number(&summary["max_probe_force_n"]) > 0.1, "the probe presses");
    assert!(number(&summary["probe_candidates"]) > 5.0);
    assert!(
        number(&summary["tip_deflection_mm"]) > 0.0,
        "the bevel bends the needle"
    );
    assert!(number(&summary["targets"][0]["nearest_seed_mm"]) < 15.0);
}

#[test]
fn bone_stops_a_needle_at_the_spine() {
    let summary = summary("spine-injection", &ready("spine-injection"));
    assert!(kinds(&summary).contains(&"surface"), "{summary}");
    assert!(number(&summary["max_inserted_mm"]) > 30.0);
}

/// Tissue that stiffens and creeps, coarse: force rises and drops at the capsule and at the wall of the vein. What it cannot have is
/// shown in the file.
#[test]
fn a_needle_punctures_the_liver_and_its_vein() {
    let text = ready("liver-puncture")
        .replace("nodes = 1200", "nodes = 400")
        .replace("dt_ms = 40.0", "dt_ms = 80.0")
        .replace("\"liver-vein\"", "\"liver-vein\"\nresolution_mm = 2.0");
    let bench = Bench::new();
    bench.write("ready.toml", &text);
    let summary = bench.run("insert ready.toml -o out --json -q").json();
    let found = kinds(&summary);
    assert_eq!(found, ["surface", "puncture", "puncture", "region"], "{summary}");
    assert!((0.6..0.9).contains(&number(&summary["max_base_force_n"])), "{summary}");
    let bent = text.replace("diameter_mm = 1.0", "diameter_mm = 1.0\nmodel = \"beam\"");
    bench.write("bent.toml", &bent);
    bench
        .run("insert bent.toml -o bent")
        .fails(2, &["bent.toml", "model = \"beam\"", "goes through straight"]);
}

#[test]
fn a_segmentation_of_a_patient_takes_a_needle() {
    let text = ready("segmentation-biopsy");
    if !Path::new(SEGMENTATION).exists() {
        println!("skipped: {SEGMENTATION} is not there");
        let bench = Bench::new();
        bench.write("ready.toml", &text);
        bench
            .run("insert ready.toml -o out")
            .fails(2, &["your-labels.nii.gz", "ready.toml"]);
        return;
    }
    let summary = summary("segmentation-biopsy", &text.replace("your-labels.nii.gz", SEGMENTATION));
    let events = summary["events"].as_array().expect("a list");
    assert!(
        events.iter().any(|event| event["region"] == "liver"),
        "it comes to the liver"
    );
}
