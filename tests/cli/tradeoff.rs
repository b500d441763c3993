//! What `insonify tradeoff` prints and writes.

use serde_json::Value;

use crate::support::Bench;

#[test]
fn a_study_is_printed_and_written() {
    let bench = Bench::new();
    let run = bench.run("tradeoff remesh --nodes 250 --updates 12 --quick --quiet --backend cpu --json -o study");
    let json = run.json();
    let rows = json["tables"]["remesh"]["rows"].as_array().expect("rows");
    assert!(rows.iter().all(|row| row["updates"] == 12.0), "{json}");
    check_folder(&bench, &json, "tradeoff-remesh.json");
}

/// The folder of a study has its page and results, the rows of each table, and each plot in both forms.
fn check_folder(bench: &Bench, json: &Value, results: &str) {
    assert_eq!(bench.read::<Value>(&format!("study/{results}")), *json);
    let mut files = bench.files("study");
    for (name, table) in json["tables"].as_object().expect("tables") {
        let file = format!("{name}.csv");
        let rows = bench.text(&format!("study/{file}")).lines().count() - 1;
        assert_eq!(Some(rows), table["rows"].as_array().map(Vec::len), "{file}");
        files.retain(|other| *other != file);
    }
    let plots: Vec<String> = files
        .iter()
        .filter_map(|file| Some(file.strip_suffix(".svg")?.to_owned()))
        .collect();
    assert!(!plots.is_empty(), "{files:?}");
    let pictures = plots
        .iter()
        .flat_map(|plot| [format!("{plot}.png"), format!("{plot}.svg")]);
    let mut expected: Vec<String> = pictures.chain(["index.html".to_owned(), results.to_owned()]).collect();
    expected.sort();
    assert_eq!(files, expected);
}

#[test]
fn what_cannot_be_studied_is_refused_with_status_2() {
    let bench = Bench::new();
    bench
        .run("tradeoff --only remsh")
        .fails(2, &["no study `remsh`", "remesh, insertion"]);
    bench.write("file", "");
    bench
        .run("tradeoff --quick --only history -o file/report")
        .fails(2, &["must be a folder"]);
    bench.run("tradeoff remesh --nodes 7").fails(2, &["100", "7"]);
    bench.run("tradeoff remesh --mesh none.vtu").fails(2, &["none.vtu"]);
    bench
        .run("tradeoff remesh --mesh a.vtu --nodes 500")
        .fails(2, &["--nodes"]);
    bench
        .run("tradeoff remesh --nodes 250 --poisson 0.5 --backend cpu")
        .fails(2, &["0.5"]);
    bench
        .run("tradeoff remesh --nodes 250 --young-kpa -1 --backend cpu")
        .fails(2, &["-1"]);
    // Dense inverses beyond any memory: said before anything is allocated.
    bench
        .run("tradeoff remesh --nodes 100000 --backend cpu")
        .fails(2, &["GiB", "coarser"]);
}

#[test]
fn insertions_are_studied_part_by_part() {
    let bench = Bench::new();
    let run =
        bench.run("tradeoff insertion --quick --nodes 300 --depth-mm 12 --only bevel,thinning --quiet --json -o study");
    let json = run.json();
    assert_eq!(json["tables"]["bevel"]["rows"].as_array().map(Vec::len), Some(5));
    assert_eq!(json["tables"]["thinning"]["rows"].as_array().map(Vec::len), Some(5));
    check_folder(&bench, &json, "tradeoff-insertion.json");
    bench
        .run("tradeoff insertion --quick --only lines")
        .fails(2, &["links", "lines"]);
    bench.run("tradeoff insertion --nodes 7").fails(2, &["100", "7"]);
    bench
        .run("tradeoff insertion --depth-mm 500")
        .fails(2, &["500", "10 to 80 mm"]);
}

#[test]
fn all_studies_go_into_one_report() {
    let bench = Bench::new();
    let run = bench.run("tradeoff --quick --only history,tissue --quiet --json -o here/report");
    let json = run.json();
    let names = |of: &str, key: &str| -> Vec<String> {
        let list = json[of].as_array().expect("a list");
        list.iter()
            .map(|it| it[key].as_str().expect("a name").to_owned())
            .collect()
    };
    assert_eq!(
        names("chapters", "name"),
        ["tissue", "history"],
        "in the order of the list"
    );
    assert_eq!(json["missing"].as_array().map(Vec::len), Some(0));
    for chapter in json["chapters"].as_array().expect("chapters") {
        for section in chapter["sections"].as_array().expect("sections") {
            assert!(
                !section["gold"].as_str().expect("a gold standard").is_empty(),
                "{section}"
            );
            assert!(!section["advice"].as_array().expect("advice").is_empty(), "{section}");
        }
    }
    let files = bench.files("here/report");
    for file in [
        "index.html",
        "report.md",
        "results.csv",
        "results.json",
        "history-error-time.svg",
    ] {
        assert!(files.contains(&file.to_owned()), "{files:?}");
    }
    let written: Value = bench.read("here/report/results.json");
    assert_eq!(written, json);
    let text = bench
        .run("tradeoff --quick --only history --quiet -o report")
        .text()
        .to_owned();
    assert!(
        text.contains("memory of viscoelastic tissue") && text.contains("Recommended: "),
        "{text}"
    );
}
