use super::*;
use crate::tradeoff::{Axis, Factor};

const FACTORS: [Factor; 3] = [factor("content"), factor("way"), factor("load")];
const AXES: [Axis; 3] = [
    Axis::log("ms", "ms", "time, ms"),
    Axis::log("p95_ms", "p95", "time (95th percentile), ms"),
    Axis::log("error", "error", "error, grey levels"),
];

const fn factor(key: &'static str) -> Factor {
    Factor { key, label: key }
}

/// Returns variants by name with their error; the 95th percentile is twice the time, and twice that again under the
/// larger load.
fn table(rows: &[(&str, &str, f64, f64)]) -> Table {
    let goal = Goal::new("ms", "error", (5.0, "nobody sees it")).choosing("grid");
    let mut table = Table::new("ways", "Ways", &FACTORS, &AXES)
        .against("the finest")
        .seeking(
            goal.each(&["content"])
                .over(&["load"])
                .in_every(Deadline::Frame, "p95_ms"),
        );
    for (content, method, ms, error) in rows {
        for (load, times) in [("small", 1.0), ("large", 2.0)] {
            let choices = [content, method, load].map(str::to_owned);
            let values = vec![Some(times * ms), Some(2.0 * times * ms), Some(*error)];
            table.push(choices.to_vec(), values, None);
        }
    }
    table
}

fn names(table: &Table, pace: &Rates) -> Vec<(String, bool)> {
    let choices = table.in_time(pace).into_iter();
    choices.map(|choice| (choice.take.name, choice.met)).collect()
}

/// 16.7 ms at 60 frames per second: the time that counts is the 95th percentile under the worst load.
#[test]
fn what_errs_least_in_time_is_taken_though_it_errs_more_than_asked() {
    let rows = [
        ("plain", "coarse", 1.0, 20.0),
        ("plain", "middle", 4.0, 9.0),
        ("plain", "fine", 4.5, 6.0),
        ("full", "middle", 10.0, 9.0),
        ("full", "fine", 90.0, 4.0),
    ];
    let choices = table(&rows).in_time(&Rates::default());
    assert_eq!(choices.len(), 2);
    let (plain, full) = (&choices[0], &choices[1]);
    assert_eq!(
        plain.sentence(),
        "grid (plain): middle: 16.0 ms, error 9.00 grey levels"
    );
    assert_eq!(plain.beyond(), "fine: 18.0 ms, error 6.00 grey levels");
    assert!(plain.met && !full.met);
    assert_eq!(
        full.sentence(),
        "grid (full): middle: the fastest, but too slow: 40.0 ms, error 9.00 grey levels"
    );
    assert_eq!(full.beyond(), "fine: 360 ms, error 4.00 grey levels");
    let slow = Rates {
        frames: 2.0,
        steps: 1.0,
    };
    let expected = ["fine", "fine"].map(|name| (name.to_owned(), true));
    assert_eq!(names(&table(&rows), &slow), expected);
}

/// Below a tenth of the tolerance, here 0.5 grey levels, the faster variant is recommended.
#[test]
fn nothing_is_paid_for_an_error_that_is_none() {
    let rows = [("plain", "good", 1.0, 0.4), ("plain", "better", 3.0, 1e-9)];
    assert_eq!(names(&table(&rows), &Rates::default()), [("good".to_owned(), true)]);
    let rows = [("plain", "good", 1.0, 0.6), ("plain", "better", 3.0, 1e-9)];
    assert_eq!(names(&table(&rows), &Rates::default()), [("better".to_owned(), true)]);
}

#[test]
fn what_breaks_a_promise_or_knows_no_pace_is_not_taken() {
    let mut flagged = table(&[("plain", "good", 1.0, 0.1), ("plain", "other", 3.0, 1.0)]);
    flagged.rows[0].flag = Some("off".to_owned());
    assert_eq!(names(&flagged, &Rates::default()), [("other".to_owned(), true)]);
    let goal = flagged.goal.take().unwrap();
    let single_row = Table {
        goal: Some(Goal { every: None, ..goal }),
        ..flagged
    };
    assert_eq!(names(&single_row, &Rates::default()), []);
}
