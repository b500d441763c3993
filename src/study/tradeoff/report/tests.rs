use super::*;
use crate::StudyError;
use crate::testing::mark_gold;
use crate::tradeoff::entry::{About, AnyEntry, Backends, Context, Entry};
use crate::tradeoff::gather::{Devices, gather};
use crate::tradeoff::{Axis, Deadline, Factor, Figure, Goal, Rates, RealTimeChoice, STUDIES};
use insonify::Error;
use insonify_base::text::escape;

const FACTORS: [Factor; 1] = [Factor::new("way", "way")];
const AXES: [Axis; 4] = [
    Axis::log("ms", "ms", "time, ms"),
    Axis::log("p95_ms", "p95", "time (95th percentile), ms"),
    Axis::log("error_mm", "error", "error, mm"),
    Axis::log("never", "never", "never measured"),
];

/// Returns a study with the gold standard, a good variant, one with the error `error_of_wrong`, and a trace of it.
fn study(error_of_wrong: f64) -> Study {
    let goal = Goal::new("ms", "error_mm", (0.1, "a <reason>")).beside(&["p95_ms"]);
    let goal = goal.in_every(Deadline::Step, "p95_ms");
    let mut table = Table::new("ways", "Ways & means", &FACTORS, &AXES)
        .against("the exact way")
        .seeking(goal);
    let rows = [
        ("exact", 9.0, 0.0),
        ("good, \"or so\"", 2.0, 0.05),
        ("wrong", 1.0, error_of_wrong),
    ];
    for (method, ms, error) in rows {
        let flag = (error > 1.0).then(|| format!("off by {error} mm: at most 1 is expected"));
        let error = (method != "exact").then_some(error);
        table.push(
            vec![method.to_owned()],
            vec![Some(ms), Some(1.5 * ms), error, None],
            flag,
        );
    }
    mark_gold(&mut table, "exact");
    let mut trace = Table::new("trace", "Along the way", &FACTORS, &AXES).unlisted();
    for step in 1..10 {
        trace.push(
            vec!["exact".to_owned()],
            vec![Some(f64::from(step)), None, Some(0.1 / f64::from(step)), None],
            None,
        );
    }
    let figure = |file: &str, table| Figure {
        joined: false,
        ..Figure::new(file, format!("Figure {file}"), table, ["ms", "error_mm"], "way")
    };
    Study {
        name: "tradeoff-made-up",
        title: "Made up",
        about: vec![("nodes_of_it", "10".to_owned())],
        machine: Machine::here(),
        tables: vec![table, trace],
        figures: vec![figure("cost", "ways"), figure("along", "trace")],
        notes: vec!["one <b>was</b> left out".to_owned()],
    }
}

const fn entry(name: &'static str, run: RunFn) -> Entry<()> {
    Entry {
        about: About {
            name,
            title: "Made up",
            question: "What is it for?",
            help: "A study",
            examples: "",
            backends: Backends::Cpu,
        },
        options: &[],
        settings: |_| (),
        in_report: |_| (),
        run,
    }
}

type RunFn = fn(&(), Context<'_>) -> Result<Study, Error>;

const RIGHT: Entry<()> = entry("right", |(), _| Ok(study(0.5)));
const WRONG: Entry<()> = entry("wrong", |(), _| Ok(study(7.0)));
const BROKEN: Entry<()> = entry("broken", |(), _| Err(StudyError::refused("no memory")));

/// Rates with 5 ms per step.
const PACE: Rates = Rates {
    frames: 60.0,
    steps: 200.0,
};

fn report(entries: &[&dyn AnyEntry]) -> Report {
    let mut shares = Vec::new();
    let report = gather(entries, &Devices::default(), Effort::Quick, PACE, &mut |_, share| {
        shares.push(share)
    });
    assert!(shares.is_sorted() && shares.last() == Some(&1.0), "{shares:?}");
    report
}

#[test]
fn a_wrong_way_is_flagged_wherever_it_is_shown_and_never_advised() {
    for (entry, wrong_count) in [(&RIGHT, 0), (&WRONG, 1)] {
        let report = report(&[entry]);
        assert_eq!(report.wrong().count(), wrong_count);
        let (page, markdown) = (report.page().unwrap(), report.markdown());
        for text in [&page, &markdown, &report.csv(), &report.json().unwrap()] {
            assert_eq!(text.contains("at most 1 is expected"), wrong_count == 1, "{text}");
        }
        assert_eq!(
            page.contains("WRONG") && markdown.contains("marked WRONG"),
            wrong_count == 1
        );
        let take = report.chapters[0].study.tables[0].advice()[0].take.clone().unwrap();
        assert_eq!(take.name, "good, \"or so\"");
    }
    assert_eq!(report(&[&RIGHT, &BROKEN]).missing[0].reason, "no memory");
}

#[test]
fn what_keeps_to_the_pace_stands_first() {
    let report = report(&[&RIGHT]);
    let choices: Vec<RealTimeChoice> = report.in_time().collect();
    assert_eq!(choices.len(), 1);
    // 1.5 times 2 ms; the exact variant takes 13.5.
    assert_eq!(
        choices[0].sentence(),
        "Ways & means: good, \"or so\": 3.00 ms, error 0.0500 mm"
    );
    let (page, markdown) = (report.page().unwrap(), report.markdown());
    for text in [&page, &markdown] {
        let [pace, short] = ["For 60 frames and 200 steps a second", "In short"].map(|heading| text.find(heading));
        assert!(pace.is_some() && pace < short, "{text}");
        assert!(
            text.contains("exact: 13.5 ms, error none (the gold standard)"),
            "{text}"
        );
    }
}

#[test]
fn every_column_mark_and_cell_says_what_it_is() {
    let report = report(&[&RIGHT]);
    let (page, markdown) = (report.page().unwrap(), report.markdown());
    let meaning = "p95: time (95th percentile), ms";
    let best = "best: no other row has both less \"ms\" and less \"error\"";
    assert!(page.contains(meaning) && page.contains(&escape(best)), "{page}");
    assert!(markdown.contains(meaning) && markdown.contains(best), "{markdown}");
    assert!(
        page.contains("<th class=\"n\" title=\"time (95th percentile), ms\">p95</th>"),
        "{page}"
    );
    // In block layout there are no headings above.
    for label in ["recommended", "time", "error", "better, but slower"] {
        assert!(page.contains(&format!("data-label=\"{label}\">")), "{label}");
    }
    for text in [&page, &markdown] {
        assert!(text.contains("below 0.1 of the tolerance count as zero"), "{text}");
    }
    // The gold standard has no error and is among the best; the report states that it is exact.
    let table = &report.chapters[0].study.tables[0];
    assert_eq!(table.best(), [true, true, true]);
    assert!(
        markdown.contains("| exact | 9 | 13.5 | standard | gold standard, best |"),
        "{markdown}"
    );
}

#[test]
fn a_study_by_itself_has_a_page_too() {
    let page = study(0.5).page().unwrap();
    for text in [
        "<h1>Made up</h1>",
        "Ways &amp; means",
        "<svg",
        "one &lt;b&gt;was&lt;/b&gt; left out",
    ] {
        assert!(page.contains(text), "{text}");
    }
    assert!(!page.contains("measured in"), "a time that nobody took");
}

#[test]
fn what_is_not_in_the_list_is_nowhere() {
    let two_entries = report(&[&RIGHT, &entry("rival", RIGHT.run)]);
    let one_entry = report(&[&RIGHT]);
    for (with_rival, without_rival) in [
        (two_entries.page().unwrap(), one_entry.page().unwrap()),
        (two_entries.markdown(), one_entry.markdown()),
        (two_entries.csv(), one_entry.csv()),
    ] {
        assert!(with_rival.len() > without_rival.len() && !without_rival.contains("rival"));
    }
    let names: Vec<&str> = STUDIES.iter().map(|entry| entry.about().name).collect();
    let mut distinct = names.clone();
    distinct.sort_unstable();
    distinct.dedup();
    assert_eq!(distinct.len(), names.len(), "{names:?}");
}

#[test]
fn the_page_asks_for_nothing_and_escapes_what_it_shows() {
    let page = report(&[&RIGHT]).page().unwrap();
    for asks in ["<script", "src=", "url(", "@import", "<link rel=\"stylesheet\""] {
        assert!(!page.contains(asks), "{asks}");
    }
    // A namespace of the plots' format, not an external address.
    let addresses: Vec<_> = page
        .match_indices("http")
        .map(|(offset, _)| &page[offset..offset + 26])
        .collect();
    assert!(
        addresses.iter().all(|address| *address == "http://www.w3.org/2000/svg"),
        "{addresses:?}"
    );
    for text in [
        "Ways &amp; means",
        "a &lt;reason&gt;",
        "good, &quot;or so&quot;",
        "one &lt;b&gt;was&lt;/b&gt; left out",
        "gold standard",
    ] {
        assert!(page.contains(text), "{text}");
    }
    assert_eq!(page.matches("<figure").count(), 2, "of the table and of the trace");
    assert!(
        !page.contains("never measured") && !page.contains(">never<"),
        "a column that nobody filled"
    );
}

#[test]
fn files_are_written_whole_and_csv_has_a_line_a_figure() {
    let folder = tempfile::tempdir().unwrap();
    let report = report(&[&RIGHT]);
    let files = report.write(folder.path()).unwrap();
    assert_eq!(
        files,
        [
            "right-cost.svg",
            "right-along.svg",
            "results.csv",
            "results.json",
            "report.md",
            "index.html"
        ]
    );
    let mut reader = csv::Reader::from_path(folder.path().join("results.csv")).unwrap();
    let records: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
    // Three times, three spreads, two errors.
    assert_eq!(records.len(), 8);
    let error = records
        .iter()
        .find(|record| &record[2] == "way=good, \"or so\"" && &record[3] == "error_mm");
    assert_eq!(error.map(|record| (&record[4], &record[5])), Some(("mm", "0.05")));
    assert!(report.write(&folder.path().join("none")).is_err());
}
