//! Levels, links and candidates: what a step of an insertion costs with each.
//!
//! They come from the study of insertions, run on a small block: the time of its steps that remesh (median, the faster of two passes),
//! as those are what a haptic loop waits for, and how far the tip is from where the finest choice has it. What one choice adds is taken to be the same beside every other.

use super::{Costs, Dial, Rung};
use crate::study::tradeoff::insertion::{InsertionOptions, InsertionStudyError, Part, study};
use crate::study::tradeoff::{Study, Table};

/// The keys of what is picked.
pub const LEVEL: &str = "tissue.level";
/// As `LEVEL`.
pub const LINK: &str = "needle.link_mm";
/// As `LEVEL`.
pub const THINNING: &str = "contact_probe.thinning";

/// Nodes of the block, and how deep the needle goes into it, mm.
const NODES: usize = 500;
const DEPTH_MM: f64 = 20.0;
/// Length of links where the other choices are measured, mm: that of a scenario that states none.
const USUAL_LINK: &str = "10";

/// The time that counts: other steps take less.
const TIME: &str = "remesh_median_ms";

/// Measures them, without and with a probe in contact. `progress` hears what is being done, and the share done.
///
/// # Errors
/// [`InsertionStudyError`].
pub fn measure(progress: &mut (dyn FnMut(&str, f64) + Send)) -> Result<[Costs; 2], InsertionStudyError> {
    let options = InsertionOptions {
        nodes: NODES,
        depth_mm: DEPTH_MM,
        passes: 2,
        parts: vec![Part::Levels, Part::Thinning, Part::Links],
        ..InsertionOptions::default()
    };
    Ok(costs(&study(&options, progress)?))
}

/// The costs that a study of insertions has found, without and with a probe.
fn costs(study: &Study) -> [Costs; 2] {
    let table = |key: &str| study.tables.iter().find(|table| table.key == key);
    let dial = |key: &str, table: Option<&Table>, error: &str, wanted: &dyn Fn(&[String]) -> Option<(String, bool)>| {
        let rows = table
            .into_iter()
            .flat_map(|table| table.rows.iter().map(move |row| (table, row)));
        let found = rows.filter(|(_, row)| row.flag.is_none()).filter_map(|(table, row)| {
            let (value, usual) = wanted(&row.choices)?;
            let error = if row.gold { 0.0 } else { table.value(row, error)? };
            Some((value, usual, table.value(row, TIME)?, error))
        });
        let found: Vec<_> = found.collect();
        let base_ms = found
            .iter()
            .find(|(_, usual, ..)| *usual)
            .map_or(0.0, |(_, _, ms, _)| *ms);
        let rungs = found.into_iter().map(|(value, _, ms, error)| Rung {
            values: vec![value],
            extra_ms: ms - base_ms,
            error,
        });
        let dial = Dial {
            keys: vec![key.to_owned()],
            rungs: rungs.collect(),
        };
        (dial, base_ms)
    };
    let levels = |probe: &'static str| {
        dial(LEVEL, table("levels"), "tip_after_mm", &move |choices| {
            let name = if choices[0] == "exact condensed" {
                "exact"
            } else {
                &choices[0]
            };
            (choices[1] == probe).then(|| (format!("\"{name}\""), name == "exact"))
        })
        .0
    };
    let (links, free_ms) = dial(LINK, table("links"), "tip_mm", &|choices| {
        Some((choices[0].clone(), choices[0] == USUAL_LINK))
    });
    let (thinning, pressed_ms) = dial(THINNING, table("thinning"), "tip_mm", &|choices| {
        Some((choices[0].clone(), choices[0] == "1"))
    });
    let measured = |what: &str| {
        let nodes = study.about.iter().find(|(key, _)| *key == "nodes");
        let nodes = nodes.map_or("?", |(_, nodes)| nodes);
        format!("steps that remesh, {what}, on a block of {nodes} nodes; larger meshes take longer")
    };
    [
        Costs {
            measured: measured("no probe in contact"),
            base_ms: free_ms,
            dials: vec![levels("without"), links.clone()],
        },
        Costs {
            measured: measured("a probe in contact"),
            base_ms: pressed_ms,
            dials: vec![levels("with"), links, thinning],
        },
    ]
}

#[cfg(test)]
mod tests;
