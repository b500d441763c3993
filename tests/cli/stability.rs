//! `insonify stability` from outside.

use crate::support::Bench;

#[test]
fn cases_are_shown_written_and_chosen_by_name() {
    let bench = Bench::new();
    let table = bench.run("stability --quick --only PATCH");
    for word in ["patch test", "criterion", "margin", "holds", "1 of 1 cases hold"] {
        assert!(table.text().contains(word), "{word}: {table:?}");
    }
    let run = bench.run("stability --quick --only units -o here/report --json");
    let json = run.json();
    let case = &json["cases"][0];
    assert_eq!((&json["effort"], &case["name"]), (&"quick".into(), &"units".into()));
    assert!(case["holds"] == true && case["seed"].is_u64() && case["margin"].as_f64() > Some(1.0));
    for measure in case["measures"].as_array().expect("figures") {
        assert!(measure["figure"].as_f64() <= measure["limit"].as_f64(), "{measure}");
    }
    assert_eq!(
        bench.files("here/report"),
        ["index.html", "margins.svg", "report.md", "results.json"]
    );
    assert_eq!(bench.read::<serde_json::Value>("here/report/results.json"), json);
    let text = bench.text("here/report/report.md");
    assert!(text.contains("### units: holds") && text.contains("seed 5"), "{text}");
}

#[test]
fn a_name_of_no_case_is_status_2_and_the_cases_are_named() {
    let bench = Bench::new();
    bench
        .run("stability --quick --only nonsense")
        .fails(2, &["no case has `nonsense`", "patch test", "out and back"]);
    bench.write("file", "");
    bench
        .run("stability --quick --only units -o file/report")
        .fails(2, &["must be a folder"]);
}
