//! Levels, nodes, pieces of the needle and candidates: what a step of an insertion costs with each.
//!
//! They come from the study of insertions: the time of its steps that remesh (median, the faster of two passes), as those are what a
//! haptic loop waits for, and how far the tip is from where the finest choice has it. Levels, needles and candidates are measured on a
//! small block, since a dense inverse of a large one takes minutes; what more nodes cost is measured at the exact level on blocks up
//! to the size that is usual. What one choice adds is taken to be the same beside every other.

use serde::{Deserialize, Serialize};

use crate::quality::{Costs, Dial, Rung};
use crate::scenario::DEFAULT_NODES;
use crate::study::tradeoff::insertion::{InsertionOptions, InsertionStudyError, Part, study};
use crate::study::tradeoff::{Row, SHIFT_MM, Study, Table};

/// The keys of what is picked.
pub const LEVEL: &str = "tissue.level";
/// As `LEVEL`.
pub const NODES: &str = "tissue.nodes";
/// As `LEVEL`.
pub const LINK: &str = "needle.link_mm";
/// As `LEVEL`.
pub const ELEMENT: &str = "needle.element_mm";
/// As `LEVEL`.
pub const THINNING: &str = "contact_probe.thinning";

/// Nodes of the small block, and how deep the needle goes, mm.
const FEW: usize = 500;
const DEPTH_MM: f64 = 20.0;
/// Nodes of the block whose eighth, quarter, half and whole are compared: those of a scenario that states none. More are not offered,
/// as a needle that goes deeper than here touches more of them.
const USUAL: usize = DEFAULT_NODES as usize;
/// Length of pieces of the needle where the other choices are measured, mm: that of a scenario that states none.
const USUAL_MM: &str = "10";

/// The tip may be off by so much without any more time being paid for it, mm: a tenth of what is of no matter.
const SLIGHT_MM: f64 = 0.1 * SHIFT_MM.0;

/// The time that counts: other steps take less.
const TIME: &str = "remesh_median_ms";

/// What steps cost, whatever the scenario.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StepCosts {
    /// Nodes of the small block.
    pub few: u32,
    /// Time of a step there, without and with a probe in contact, ms.
    pub base_ms: [f64; 2],
    /// Levels, without and with a probe.
    pub levels: [Dial; 2],
    /// Nodes: beyond the small block.
    pub nodes: Dial,
    /// Links of a needle.
    pub links: Dial,
    /// Elements of a needle that is a beam: beyond the usual links.
    pub elements: Dial,
    /// Candidates of the probe.
    pub thinning: Dial,
}

/// What a scenario is like.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Situation {
    /// Whether a probe is in contact.
    pub probe: bool,
    /// Whether the needle is a beam.
    pub beam: bool,
    /// Length of the needle, mm: no piece is longer.
    pub needle_mm: Option<f64>,
    /// Nodes of the mesh.
    pub nodes: Nodes,
}

/// What is known of the nodes of a mesh before it is there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Nodes {
    /// They may be picked.
    #[default]
    Open,
    /// How many.
    Stated(u32),
    /// Nothing, as of a file.
    Unknown,
}

/// Measures them. `progress` hears what is being done, and the share done.
///
/// # Errors
/// [`InsertionStudyError`].
pub fn measure(progress: &mut (dyn FnMut(&str, f64) + Send)) -> Result<StepCosts, InsertionStudyError> {
    let options = |nodes, parts| InsertionOptions {
        nodes,
        depth_mm: DEPTH_MM,
        passes: 2,
        parts,
        ..InsertionOptions::default()
    };
    let small = vec![Part::Levels, Part::Thinning, Part::Links, Part::Elements];
    let small = study(&options(FEW, small), &mut |what, share| progress(what, 0.6 * share))?;
    // The study goes up to twice what it is asked for.
    let meshes = options(USUAL / 2, vec![Part::Mesh]);
    let meshes = study(&meshes, &mut |what, share| progress(what, 0.6 + 0.4 * share))?;
    Ok(StepCosts::of(&small, &meshes))
}

impl StepCosts {
    /// The costs that studies of insertions have found: one on a small block, and one of nodes.
    fn of(small: &Study, meshes: &Study) -> Self {
        let first = |row: &Row| Some(row.choices[0].clone());
        let (links, free_ms) = dial(small, ["links", LINK, "tip_mm"], first, Base::Rung(USUAL_MM));
        let (thinning, pressed_ms) = dial(small, ["thinning", THINNING, "tip_mm"], first, Base::Rung("1"));
        let of_probe = |probe: &'static str| {
            let name = move |row: &Row| {
                let name = match row.choices[0].as_str() {
                    "exact condensed" => "exact",
                    // It shows what remeshing is worth, and errs the more the farther a needle goes.
                    "IV" => return None,
                    other => other,
                };
                (row.choices[1] == probe).then(|| format!("\"{name}\""))
            };
            dial(small, ["levels", LEVEL, "tip_after_mm"], name, Base::Rung("\"exact\"")).0
        };
        let beyond = |study, table| dial(study, table, first, Base::Ms(free_ms)).0;
        let nodes = small.about.iter().find(|(key, _)| *key == "nodes");
        StepCosts {
            few: nodes.and_then(|(_, nodes)| nodes.parse().ok()).unwrap_or(FEW as u32),
            base_ms: [free_ms, pressed_ms],
            levels: ["without", "with"].map(of_probe),
            nodes: beyond(meshes, ["mesh", NODES, "tip_mm"]),
            elements: beyond(small, ["elements", ELEMENT, "tip_mm"]),
            links,
            thinning,
        }
    }

    /// All dials.
    pub fn dials(&self) -> impl Iterator<Item = &Dial> {
        let others = [&self.nodes, &self.links, &self.elements, &self.thinning];
        self.levels.iter().chain(others)
    }

    /// What a scenario can choose, and what it costs there.
    pub fn in_situation(&self, situation: &Situation) -> Costs {
        let at = usize::from(situation.probe);
        let needle = match situation.beam {
            true => &self.elements,
            false => &self.links,
        };
        let mut dials = vec![self.levels[at].clone(), fitting(needle, situation.needle_mm)];
        if situation.probe {
            dials.push(self.thinning.clone());
        }
        if situation.nodes == Nodes::Open {
            dials.push(self.nodes.clone());
        }
        dials.retain(|dial| !dial.rungs.is_empty());
        let (few, sizes) = (self.few, self.sizes());
        let (mesh, extra_ms) = match situation.nodes {
            Nodes::Open => {
                let most = sizes.last().map_or(f64::from(few), |(nodes, _)| *nodes);
                (format!("in blocks of {few} to {most} nodes"), 0.0)
            }
            Nodes::Stated(nodes) => (format!("at {nodes} nodes, from blocks"), extra_of(&sizes, nodes)),
            Nodes::Unknown => (format!("in a block of {few} nodes; a larger mesh takes longer"), 0.0),
        };
        let probe = if situation.probe { "a probe" } else { "no probe" };
        Costs {
            measured: format!("steps that remesh, {probe} in contact, {mesh}"),
            errors: Some("mm at the tip in blocks of tissue".to_owned()),
            base_ms: self.base_ms[at] + extra_ms,
            dials,
        }
    }

    /// Numbers of nodes and what they add, ascending, the small block first.
    fn sizes(&self) -> Vec<(f64, f64)> {
        let rungs = self.nodes.rungs.iter();
        let measured = rungs.filter_map(|rung| Some((rung.values.first()?.parse().ok()?, rung.extra_ms)));
        let mut sizes: Vec<(f64, f64)> = std::iter::once((f64::from(self.few), 0.0)).chain(measured).collect();
        sizes.sort_by(|a, b| a.0.total_cmp(&b.0));
        sizes
    }
}

/// What a number of nodes adds, ms: along straight lines between those that were measured (ascending), and along the last beyond
/// them; nothing below the first.
fn extra_of(sizes: &[(f64, f64)], nodes: u32) -> f64 {
    let nodes = f64::from(nodes);
    let last = sizes.len().saturating_sub(1);
    let next = sizes.iter().position(|(size, _)| *size >= nodes).unwrap_or(last);
    let Some(&[(low, before), (high, after)]) = next.checked_sub(1).and_then(|at| sizes.get(at..=next)) else {
        return 0.0;
    };
    before + (after - before) * (nodes - low) / (high - low)
}

/// The rungs of a needle whose pieces are no longer than it.
fn fitting(dial: &Dial, needle_mm: Option<f64>) -> Dial {
    let fits = |rung: &&Rung| {
        let length: Option<f64> = rung.values.first().and_then(|value| value.parse().ok());
        needle_mm.zip(length).is_none_or(|(needle, length)| length <= needle)
    };
    Dial {
        keys: dial.keys.clone(),
        rungs: dial.rungs.iter().filter(fits).cloned().collect(),
    }
}

/// What a dial adds to.
#[derive(Clone, Copy)]
enum Base {
    /// The time of the rung with this value.
    Rung(&'static str),
    /// This time, ms.
    Ms(f64),
}

/// A dial from the rows of a table, and the time that it adds to, ms.
fn dial(
    study: &Study,
    [table, key, error]: [&str; 3],
    value: impl Fn(&Row) -> Option<String>,
    base: Base,
) -> (Dial, f64) {
    let table: Option<&Table> = study.tables.iter().find(|it| it.key == table);
    let rows = table
        .into_iter()
        .flat_map(|table| table.rows.iter().map(move |row| (table, row)));
    let found = rows.filter(|(_, row)| row.flag.is_none()).filter_map(|(table, row)| {
        let error = if row.gold { 0.0 } else { table.value(row, error)? };
        let error = if error < SLIGHT_MM { 0.0 } else { error };
        Some((value(row)?, table.value(row, TIME)?, error))
    });
    let found: Vec<(String, f64, f64)> = found.collect();
    let base_ms = match base {
        Base::Ms(ms) => ms,
        Base::Rung(usual) => found
            .iter()
            .find(|(value, ..)| value == usual)
            .map_or(0.0, |(_, ms, _)| *ms),
    };
    let rungs = found.into_iter().map(|(value, ms, error)| Rung {
        values: vec![value],
        extra_ms: ms - base_ms,
        error,
    });
    let dial = Dial {
        keys: vec![key.to_owned()],
        rungs: rungs.collect(),
    };
    (dial, base_ms)
}

#[cfg(test)]
mod tests;
