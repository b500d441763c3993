//! Break-even sizes, from which a GPU is faster than the CPU.

use super::factor;
use crate::study::tradeoff::{Axis, Row, Table};

/// Finds, for each GPU and item in the tables (GPU, item, size; with a ratio as the last value), the size from which the ratio stays above
/// 1, or the largest size at which it does not.
pub fn crossing(tables: &[&Table]) -> Table {
    let factors = [
        factor("gpu", "GPU"),
        factor("what", "what"),
        factor("wins", "the GPU wins"),
    ];
    let axes = [
        Axis::log("ratio_smallest", "at smallest", "CPU over GPU at the smallest size"),
        Axis::log(
            "ratio_largest",
            "at largest",
            "CPU over GPU at the largest size that both did",
        ),
    ];
    let title = "From which size on the GPU wins";
    let mut table = Table::new("compare_crossing", title, &factors, &axes);
    let mut seen: Vec<&[String]> = Vec::new();
    let rows = || tables.iter().flat_map(|table| &table.rows);
    for row in rows() {
        let key = &row.choices[..2];
        if seen.contains(&key) {
            continue;
        }
        seen.push(key);
        let own = rows().filter(|other| other.choices[..2] == *key);
        let both: Vec<(&Row, f64)> = own
            .filter_map(|row| Some((row, row.values.last().copied()??)))
            .collect();
        let (Some(first), Some(last)) = (both.first(), both.last()) else {
            continue;
        };
        let wins = both.iter().rposition(|(_, ratio)| *ratio <= 1.0).map_or(0, |at| at + 1);
        let size = |row: &Row| row.choices[2].clone();
        let words = match both.get(wins) {
            Some((row, _)) if wins == 0 => format!("from the smallest, {}", size(row)),
            Some((row, _)) => format!("from {}", size(row)),
            None => format!("never up to {}", size(last.0)),
        };
        let mut choices = key.to_vec();
        choices.push(words);
        table.push(choices, vec![Some(first.1), Some(last.1)], None);
    }
    table
}
