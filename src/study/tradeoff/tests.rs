use super::*;
use crate::testing::mark_gold;
use insonify_report::plot::Marker;

const FACTORS: [Factor; 3] = [
    Factor::new("size", "size"),
    Factor::new("way", "way"),
    Factor::new("on", "on"),
];
const AXES: [Axis; 3] = [
    Axis::log("ms", "ms", "time, ms"),
    Axis::log("error", "err", "relative error"),
    Axis::linear("mb", "MB", "memory, MB"),
];

fn row(table: &mut Table, choices: [&str; 3], values: [Option<f64>; 3], flag: Option<&str>) {
    table.push(
        choices.map(str::to_owned).to_vec(),
        values.to_vec(),
        flag.map(str::to_owned),
    );
}

/// Returns four variants at one size, one of them flagged, and two at another.
fn table() -> Table {
    let goal = Goal::new("ms", "error", (0.1, "nobody sees it")).each(&["size"]);
    let mut table = Table::new("ways", "Ways", &FACTORS, &AXES).seeking(goal);
    row(&mut table, ["10", "slow", "a"], [Some(10.0), Some(1e-12), None], None);
    row(&mut table, ["10", "fast", "a"], [Some(1.0), Some(1e-3), None], None);
    row(&mut table, ["10", "worse", "b"], [Some(2.0), Some(1e-2), None], None);
    row(
        &mut table,
        ["10", "wrong, \"x\"", "b"],
        [Some(0.1), Some(1e-15), None],
        Some("off"),
    );
    row(&mut table, ["20", "slow", "a"], [Some(100.0), Some(1e-11), None], None);
    row(
        &mut table,
        ["20", "fast", "b"],
        [Some(50.0), Some(f64::NAN), None],
        None,
    );
    table
}

fn study() -> Study {
    Study {
        name: "tradeoff-test",
        title: "Made up",
        about: vec![("nodes", "10, 20".to_owned())],
        machine: Machine::here(),
        tables: vec![table()],
        figures: vec![
            Figure {
                marker: vec!["on"],
                only: vec![("size", "10".to_owned())],
                joined: false,
                ..Figure::new("cost", "What it costs", "ways", ["ms", "error"], "way")
            },
            Figure {
                marker: vec![],
                only: vec![],
                ..Figure::new("nothing", "Nothing was measured", "ways", ["ms", "mb"], "way")
            },
        ],
        notes: vec!["one was left out".to_owned()],
    }
}

#[test]
fn the_best_are_found_within_each_group_and_broken_promises_are_none() {
    let mut table = table();
    assert_eq!(table.best(), [true, true, false, false, true, false]);
    // The gold standard has no error, whatever it costs.
    row(&mut table, ["10", "finest", "a"], [Some(9.0), None, None], None);
    mark_gold(&mut table, "finest");
    assert_eq!(table.best(), [false, true, false, false, true, false, true]);
    assert_eq!(
        table.meaning_of_best(),
        "best: no other row with the same size has both less \"ms\" and less \"err\""
    );
    // Without a goal no row is best.
    table.goal = None;
    assert!(!table.best().contains(&true) && table.meaning_of_best().is_empty());
}

#[test]
fn what_is_not_finite_is_flagged_and_counts_as_not_measured() {
    let table = table();
    let row = &table.rows[5];
    assert_eq!(row.values, [Some(50.0), None, None]);
    assert_eq!(row.flag.as_deref(), Some("not finite: error"));
}

#[test]
fn text_json_and_csv_say_the_same() {
    let study = study();
    let text = study.text();
    assert!(
        text.contains("nodes: 10, 20") && text.contains("note: one was left out"),
        "{text}"
    );
    let lines: Vec<&str> = text.lines().filter(|line| line.contains("slow")).collect();
    assert!(
        lines[0].starts_with('*') && lines[0].contains("10  ") && lines[0].contains("1.0e-12"),
        "{text}"
    );
    assert!(
        text.lines()
            .any(|line| line.contains("wrong") && line.ends_with("WRONG: off")),
        "{text}"
    );
    assert!(!text.contains("MB"), "a column that nobody filled is not shown: {text}");

    let json = study.json();
    let rows = json["tables"]["ways"]["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 6);
    assert_eq!(rows[1]["way"], "fast");
    assert_eq!(rows[1]["error"], 1e-3);
    assert_eq!(rows[1]["best"], true);
    assert!(rows[5]["error"].is_null());

    let table = &study.tables[0];
    let mut reader = csv::Reader::from_reader(table.csv().leak().as_bytes());
    assert_eq!(
        reader.headers().unwrap().iter().collect::<Vec<_>>(),
        ["size", "way", "on", "ms", "error", "mb", "best", "gold", "flag"]
    );
    let records: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
    assert_eq!(&records[3][1], "wrong, \"x\"");
    for ((record, row), best) in records.iter().zip(&table.rows).zip(table.best()) {
        assert_eq!(record[3].parse::<f64>().ok(), row.values[0]);
        assert_eq!(record[4].parse::<f64>().ok(), row.values[1]);
        assert_eq!(&record[6], best.to_string());
    }
}

#[test]
fn figures_take_their_rows_and_leave_out_what_has_none() {
    let study = study();
    let plots = study.plots();
    assert_eq!(plots.len(), 1);
    let (figure, plot) = &plots[0];
    assert_eq!(figure.file, "cost");
    assert_eq!(plot.series.len(), 4);
    assert_eq!(plot.markers, ["a", "b"]);
    assert_eq!(plot.series[2].marker, Marker::nth(1));
    assert_eq!(
        plot.front,
        [[[1.0, 1e-3], [10.0, 1e-12]]],
        "the flagged point is none of the best"
    );
    plot.svg().unwrap();
}

#[test]
fn counts_are_whole_and_a_standard_is_no_gap() {
    let mut table = table();
    row(
        &mut table,
        ["10", "finest", "a"],
        [Some(13_107_200.0), None, Some(60.0)],
        None,
    );
    mark_gold(&mut table, "finest");
    let last_row = &table.rows[6];
    assert_eq!(
        [0, 1, 2].map(|axis| last_row.figure(axis)),
        ["13,107,200", "standard", "60"].map(str::to_owned)
    );
    assert_eq!(table.rows[5].figure(1), "-");
    assert_eq!(
        [-12_345.0, 999.0, 1234.0, 0.0].map(|value| Row {
            values: vec![Some(value)],
            ..last_row.clone()
        }
        .figure(0)),
        ["-12,345", "999", "1234", "0"]
    );
}

#[test]
fn a_bare_number_is_named_by_its_factor() {
    let factor = |label| Factor { key: "key", label };
    assert_eq!(factor("spacing, mm").name("5.0"), "spacing 5.0 mm");
    assert_eq!(factor("nodes").name("150"), "nodes: 150");
    assert_eq!(factor("link, mm").name("none"), "none");
}

#[test]
fn files_are_written_whole_and_the_same_each_time() {
    let folder = tempfile::tempdir().unwrap();
    let files = study().write(folder.path()).unwrap();
    assert_eq!(
        files,
        ["ways.csv", "tradeoff-test.json", "cost.svg", "cost.png", "index.html"]
    );
    let read_files = || {
        files
            .iter()
            .map(|file| std::fs::read(folder.path().join(file)).unwrap())
            .collect::<Vec<_>>()
    };
    let written = read_files();
    study().write(folder.path()).unwrap();
    assert_eq!(read_files(), written);
    assert!(study().write(&folder.path().join("none")).is_err());
}
