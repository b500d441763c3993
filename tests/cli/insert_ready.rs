//! The scenario of a segmentation runs. A coarser mesh and longer steps than its own keep the time short.

use crate::support::Bench;
use insonify::input::scenario::EXAMPLES;

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
    // A segmentation of TotalSegmentator, where there is one.
    let Some(segmentation) = insonify_testing::shared("volumes/tsd_s0328_labels.nii.gz") else {
        bench.write("ready.toml", &quick);
        bench
            .run("insert ready.toml -o out")
            .fails(2, &["your-labels.nii.gz", "ready.toml"]);
        return;
    };
    bench.write(
        "ready.toml",
        &quick.replace("your-labels.nii.gz", &segmentation.display().to_string()),
    );
    let run = bench.run("insert ready.toml -o out --json");
    // The needle begins outside of the image, and goes through it.
    assert!(!run.stderr.contains("never meets the scan plane"), "{run:?}");
    let summary = run.json();
    assert!(summary["max_base_force_n"].as_f64().expect("a force") > 0.5);
    assert!(summary["remeshes"].as_u64().expect("a count") > 5);
    let events = summary["events"].as_array().expect("a list");
    assert!(
        events.iter().any(|event| event["region"] == "liver"),
        "it comes to the liver"
    );
}
