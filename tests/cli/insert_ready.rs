//! The scenario of a segmentation runs. A coarser mesh and longer steps than its own keep the time short.

use std::path::Path;

use crate::support::Bench;
use insonify::input::scenario::EXAMPLES;

/// A segmentation of TotalSegmentator, where there is one.
const SEGMENTATION: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../../../shared/data/volumes/tsd_s0328_labels.nii.gz"
);

#[test]
fn a_segmentation_of_a_patient_takes_a_needle() {
    let (_, text) = EXAMPLES
        .iter()
        .find(|(known, _)| *known == "segmentation-biopsy")
        .expect("an example");
    let quick = text
        .replace("nodes = 3300", "nodes = 1200")
        .replace("dt_ms = 1.0", "dt_ms = 4.0");
    assert_ne!(quick, *text);
    let bench = Bench::new();
    if !Path::new(SEGMENTATION).exists() {
        println!("skipped: {SEGMENTATION} is not there");
        bench.write("ready.toml", &quick);
        bench
            .run("insert ready.toml -o out")
            .fails(2, &["your-labels.nii.gz", "ready.toml"]);
        return;
    }
    bench.write("ready.toml", &quick.replace("your-labels.nii.gz", SEGMENTATION));
    let summary = bench.run("insert ready.toml -o out --json -q").json();
    assert!(summary["max_base_force_n"].as_f64().expect("a force") > 0.5);
    assert!(summary["remeshes"].as_u64().expect("a count") > 5);
    let events = summary["events"].as_array().expect("a list");
    assert!(
        events.iter().any(|event| event["region"] == "liver"),
        "it comes to the liver"
    );
}
