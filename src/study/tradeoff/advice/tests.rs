use super::*;
use crate::testing::mark_gold;
use crate::tradeoff::{Axis, Factor};

const fn factor(key: &'static str) -> Factor {
    Factor { key, label: key }
}

const FACTORS: [Factor; 3] = [factor("nodes"), factor("way"), factor("load")];
const AXES: [Axis; 2] = [
    Axis::log("ms", "ms", "time, ms"),
    Axis::log("error_mm", "error", "error, mm"),
];

/// Returns variants by name, with time and error under each of two loads.
fn table(rows: &[(&str, &str, [[f64; 2]; 2])]) -> Table {
    let goal = Goal::new("ms", "error_mm", (0.1, "nobody sees it"));
    let mut table = Table::new("ways", "Ways", &FACTORS, &AXES)
        .against("the finest")
        .seeking(goal.each(&["nodes"]).over(&["load"]));
    for (nodes, method, figures) in rows {
        for (load, [ms, error]) in ["small", "large"].into_iter().zip(figures) {
            let choices = [nodes, method, load].map(str::to_owned);
            let error = (*method != "finest").then_some(*error);
            table.push(choices.to_vec(), vec![Some(*ms), error], None);
        }
    }
    mark_gold(&mut table, "finest");
    table
}

fn usual() -> Table {
    table(&[
        ("10", "finest", [[50.0, 0.0], [60.0, 0.0]]),
        ("10", "good", [[5.0, 0.01], [6.0, 0.02]]),
        ("10", "good in one case", [[1.0, 0.001], [1.0, 0.7]]),
        ("20", "finest", [[500.0, 0.0], [500.0, 0.0]]),
        ("20", "good", [[50.0, 0.2], [50.0, 0.3]]),
    ])
}

#[test]
fn the_cheapest_way_within_the_limit_under_all_conditions_is_taken() {
    let advice = usual().advice();
    assert_eq!(advice.len(), 2, "one for each number of nodes");
    let advised = advice[0].take.as_ref().unwrap();
    assert_eq!(
        (advised.name.as_str(), advised.cost, advised.error, advised.gold),
        ("good", 6.0, 0.02, false)
    );
    assert_eq!(
        advice[0].sentence(),
        "nodes: 10: Recommended: good: 6.00 ms, error 0.0200 mm; the cheapest within 0.1 mm (nobody sees it). Cheaper: good in one \
         case: 1.00 ms, error 0.700 mm. The gold standard takes 60.0 ms."
    );
    // If the error of every other variant is too large, the gold standard remains.
    assert!(advice[1].take.as_ref().unwrap().gold, "{}", advice[1].words);
    assert!(
        advice[1]
            .words
            .starts_with("Recommended: finest (the gold standard): 500 ms. Nothing cheaper")
    );
}

#[test]
fn a_baseline_is_never_advised() {
    let mut table = usual();
    let baseline = |table: &mut Table, choice| {
        table.goal = table
            .goal
            .take()
            .map(|goal| goal.baseline("way", choice, "it does nothing"));
    };
    baseline(&mut table, "good");
    let advice = &table.advice()[0];
    assert_eq!(
        advice.take.as_ref().map(|advised| advised.name.as_str()),
        Some("finest")
    );
    assert!(
        advice
            .words
            .ends_with("good is a baseline and never recommended: it does nothing."),
        "{}",
        advice.words
    );
}

#[test]
fn what_is_flagged_or_not_measured_under_all_conditions_is_no_choice() {
    let mut flagged = usual();
    let row = flagged.rows.iter().position(|row| row.choices[1] == "good").unwrap();
    flagged.rows[row].flag = Some("off".to_owned());
    let advice = &flagged.advice()[0];
    assert!(
        advice.take.as_ref().unwrap().gold && advice.words.contains("One row is marked WRONG"),
        "{}",
        advice.words
    );
    let mut missing = usual();
    missing.rows.remove(row);
    assert!(missing.advice()[0].take.as_ref().unwrap().gold);
}

#[test]
fn of_ways_that_cost_the_same_the_one_that_errs_least_is_taken() {
    let close = table(&[
        ("10", "fast", [[1.0, 0.09], [1.0, 0.09]]),
        ("10", "as fast", [[1.04, 0.01], [1.04, 0.01]]),
        ("10", "slower", [[1.06, 0.001], [1.06, 0.001]]),
    ]);
    let advice = &close.advice()[0];
    assert_eq!(
        advice.take.as_ref().map(|advised| advised.name.as_str()),
        Some("as fast")
    );
    assert!(!advice.words.contains("Cheaper"), "{}", advice.words);
}

#[test]
fn what_nothing_reaches_is_said_with_the_nearest() {
    let far = table(&[
        ("10", "far", [[1.0, 3.0], [1.0, 2.0]]),
        ("10", "near", [[2.0, 0.2], [2.0, 0.3]]),
    ]);
    let advice = &far.advice()[0];
    assert_eq!(advice.take, None);
    assert!(
        advice.words.contains("No option has an error within 0.1 mm")
            && advice.words.contains("near: 2.00 ms, error 0.300 mm"),
        "{}",
        advice.words
    );
    assert_eq!(table(&[]).advice(), []);
}

#[test]
fn units_stand_behind_the_last_comma() {
    assert_eq!(AXES[0].unit(), "ms");
    assert_eq!(Axis::log("x", "x", "relative error of K^c").unit(), "");
}
