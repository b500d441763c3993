//! Small insertions and marked tables for tests.

use std::sync::OnceLock;

use crate::step_costs::Insertions;
use crate::tradeoff::Table;
use crate::tradeoff::insertion::InsertionOptions;

/// Insertions into blocks of some 300 nodes, made once.
pub(crate) fn insertions() -> &'static Insertions {
    static INSERTIONS: OnceLock<Insertions> = OnceLock::new();
    INSERTIONS.get_or_init(|| {
        let options = |nodes| InsertionOptions {
            nodes,
            depth_mm: 12.0,
            passes: 1,
            ..InsertionOptions::default()
        };
        Insertions::measure(&options(300), &options(600), &mut |_, _| {}).unwrap()
    })
}

/// Marks the rows with this choice as the gold standard.
pub(crate) fn mark_gold(table: &mut Table, choice: &str) {
    let rows = table.rows.iter_mut();
    let gold = rows.filter(|row| row.choices.iter().any(|listed| listed == choice));
    gold.for_each(|row| row.gold = true);
}
