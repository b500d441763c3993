use super::record::{largest, relative};
use super::*;

/// Returns a case with a single figure under a limit of 1e-12.
fn one(name: &'static str, run: fn(&mut Record<'_>) -> Result<(), Unexpected>) -> HardCase {
    HardCase {
        name,
        criterion: "under 1e-12",
        covers: &["cpu f64"],
        seed: 5,
        run,
    }
}

fn report(case: &HardCase) -> StabilityReport {
    run(&[("Group", case)], Effort::Quick, &mut |_, _| {})
}

#[test]
fn figures_beyond_their_limit_and_figures_that_are_no_numbers_fail() {
    let good = report(&one("good", |record| {
        record.under("error", 1e-13, 1e-12);
        record.report("size", 1e9);
        Ok(())
    }));
    assert!(good.failed() == 0);
    assert!(!good.page().unwrap().contains("FAILS") && good.page().unwrap().contains("1 of 1 hard cases hold"));
    assert_eq!(good.cases[0].worst().unwrap().margin, Some(10.0));
    let bad: [fn(&mut Record<'_>) -> Result<(), Unexpected>; 8] = [
        |record| {
            record.under("error", 1.1e-12, 1e-12);
            Ok(())
        },
        |record| {
            record.under("error", f64::NAN, 1e-12);
            Ok(())
        },
        |record| {
            record.under("error", f64::NEG_INFINITY, 1e-12);
            Ok(())
        },
        |record| {
            record.report("size", f64::INFINITY);
            Ok(())
        },
        |record| {
            record.zero("wrong", f64::MIN_POSITIVE);
            Ok(())
        },
        |record| {
            record.zero("wrong", -1.0);
            Ok(())
        },
        |_| Err("x".parse::<f64>().unwrap_err().into()),
        |_| Ok(()),
    ];
    for run in bad {
        let report = report(&one("bad", run));
        assert!(report.failed() == 1, "{report}");
        assert!(
            report.to_string().contains("FAILS") && report.markdown().contains("FAILS"),
            "{report}"
        );
        let page = report.page().unwrap();
        assert!(
            page.contains(">FAILS<") && page.contains("0 of 1 hard cases hold"),
            "{page}"
        );
    }
}

#[test]
fn a_refusal_must_be_the_one_expected() {
    let expected = |error: &std::num::ParseIntError| *error.kind() == std::num::IntErrorKind::Empty;
    for (text, holds) in [("", true), ("x", false), ("7", false)] {
        let mut progress = |_| {};
        let mut record = Record::new(Effort::Quick, 0, &mut progress);
        record.refused("a number", text.parse::<i32>(), expected);
        let measure = &record.into_measures()[0];
        assert_eq!(measure.holds, holds, "{measure:?}");
        assert!(measure.note.is_some());
    }
}

#[test]
fn json_keeps_every_figure_and_says_what_is_no_number() {
    let case = one("case", |record| {
        record.under("error", 1.25e-13, 1e-12);
        record.report("lost", f64::NAN);
        Ok(())
    });
    let value = serde_json::to_value(report(&case)).unwrap();
    let case = &value["cases"][0];
    assert_eq!(
        (&case["name"], &case["holds"], &case["seed"]),
        (&"case".into(), &false.into(), &5.into())
    );
    assert_eq!(case["measures"][0]["figure"], 1.25e-13);
    assert_eq!(case["measures"][0]["margin"], 8.0);
    assert_eq!(
        (&case["measures"][1]["figure"], &case["measures"][1]["holds"]),
        (&"NaN".into(), &false.into())
    );
}

#[test]
fn progress_goes_from_nothing_to_all_and_names_the_case() {
    let half: fn(&mut Record<'_>) -> Result<(), Unexpected> = |record| {
        record.done(0.5);
        record.zero("wrong", 0.0);
        Ok(())
    };
    let (first, second) = (one("first", half), one("second", half));
    let mut progress = Vec::new();
    run(&[("a", &first), ("a", &second)], Effort::Quick, &mut |name, share| {
        progress.push((name.to_owned(), share))
    });
    let expected = [("first", 0.0), ("first", 0.25), ("second", 0.5), ("second", 0.75)];
    assert_eq!(progress, expected.map(|(name, share)| (name.to_owned(), share)));
}

#[test]
fn names_are_distinct_and_found_by_a_part_of_them() {
    let cases = select(GROUPS, None);
    for (index, (_, case)) in cases.iter().enumerate() {
        assert!(
            cases[..index]
                .iter()
                .all(|(_, earlier)| earlier.name != case.name && earlier.seed != case.seed),
            "{}",
            case.name
        );
    }
    assert_eq!(select(GROUPS, Some("PATCH")).len(), 1);
    assert_eq!(select(GROUPS, Some("elements, solvers")).len(), GROUPS[0].cases.len());
    assert!(select(GROUPS, Some("no such case")).is_empty());
}

#[test]
fn numbers_that_are_none_are_not_lost_in_a_maximum() {
    assert!(largest([1.0, f64::NAN, 2.0]).is_nan());
    assert_eq!(largest([1.0, -3.0]), 3.0);
    assert_eq!(relative(&[0.0, 0.0], &[0.0, 0.0]), 0.0);
    assert!(relative(&[f64::NAN], &[1.0]).is_nan());
    assert!(!relative(&[1.0], &[0.0]).is_finite());
}

/// Draws a dot for each figure with a limit, placed by its margin alone, in another colour beyond the limit.
#[test]
fn margins_are_where_they_belong() {
    let report = report(&one("a < b", |record| {
        record.under("a tenth", 1.0, 10.0);
        record.under("a hundredth", 1.0, 100.0);
        record.under("the limit", 1.0, 1.0);
        record.zero("none", 0.0);
        record.report("size", 1e9);
        record.under("beyond", 3.0, 1.0);
        record.under("no number", f64::NAN, 1.0);
        Ok(())
    }));
    let (plot, rows) = report.margins();
    let points = |name: &str| -> Vec<[f64; 2]> {
        let named = plot.series.iter().filter(|series| series.name == name);
        named.flat_map(|series| series.points.clone()).collect()
    };
    assert_eq!(points("holds"), [10.0, 100.0, 1.0, 1e13].map(|margin| [margin, -1.0]));
    let fails: Vec<f64> = points("fails").iter().map(|point| point[0]).collect();
    assert!(
        fails.contains(&0.1) && fails.contains(&(1.0 / 3.0)) && fails.len() == 2,
        "{fails:?}"
    );
    assert_eq!(rows[1], "a < b");
    assert!(report.plot().unwrap().contains("a &lt; b"));
}
