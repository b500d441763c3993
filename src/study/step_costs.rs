//! Cost of an insertion step by level, number of nodes, needle discretisation and probe candidates.
//!
//! The costs come from the insertion study: the time of steps that remesh (median, the faster of two passes), as those
//! are what a haptic loop waits for, and the distance of the tip from its position under the finest choice. Levels,
//! needles and candidates are measured on a small block, since a dense inverse of a large one takes minutes; the cost
//! of more nodes is measured at the exact level on blocks up to the usual size. The cost of one choice is assumed
//! independent of all others.

use serde::{Deserialize, Serialize};

use crate::tradeoff::SHIFT_MM;
use crate::tradeoff::insertion::levels::{self, Levels};
use crate::tradeoff::insertion::meshes::{self, MeshRow};
use crate::tradeoff::insertion::pieces::{ELEMENTS, LINKS, PieceRow};
use crate::tradeoff::insertion::thinning::{self, ThinningRow};
use crate::tradeoff::insertion::{InsertionOptions, Progress, StepTimes};
use insonify::Error;
use insonify::input::scenario::DEFAULT_NODES;
use insonify_imaging::quality::{Costs, SettingOption, VariedSetting};
use insonify_mechanics::tissue::remesh::Level;

/// Key of the condensation level in a scenario.
pub const LEVEL: &str = "tissue.level";
/// Key of the number of tissue nodes in a scenario.
pub const NODES: &str = "tissue.nodes";
/// Key of the needle's link length in a scenario.
pub const LINK: &str = "needle.link_mm";
/// Key of the needle's element length in a scenario.
pub const ELEMENT: &str = "needle.element_mm";
/// Key of the thinning of probe candidates in a scenario.
pub const THINNING: &str = "contact_probe.thinning";

/// Number of nodes of the small block, and insertion depth, mm.
const FEW: usize = 500;
const DEPTH_MM: f64 = 20.0;
/// Nodes of the largest block, the default of a scenario; an eighth, a quarter and a half of it are compared too. More
/// are not offered, as a needle that goes deeper than here touches more of them.
const USUAL: usize = DEFAULT_NODES as usize;
/// Length of the needle's pieces while other choices are measured, mm: the default of a scenario.
const USUAL_MM: &str = "10";

/// Tip error treated as zero, mm: a tenth of the smallest that a user would notice.
const SLIGHT_MM: f64 = 0.1 * SHIFT_MM.0;

/// Costs of insertion steps, independent of the scenario.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StepCosts {
    /// Number of nodes of the small block.
    pub few: u32,
    /// Time of a step on the small block, without and with a probe in contact, ms.
    pub base_ms: [f64; 2],
    /// Costs of the levels, without and with a probe.
    pub levels: [VariedSetting; 2],
    /// Costs of more nodes, relative to the small block.
    pub nodes: VariedSetting,
    /// Costs of needle links.
    pub links: VariedSetting,
    /// Costs of beam-needle elements, relative to the default links.
    pub elements: VariedSetting,
    /// Costs of thinned probe candidates.
    pub thinning: VariedSetting,
}

/// Properties of a scenario that determine its costs.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Situation {
    /// Whether a probe is in contact.
    pub probe: bool,
    /// Whether the needle is a beam.
    pub beam: bool,
    /// Length of the needle, mm, which bounds the length of a piece.
    pub needle_mm: Option<f64>,
    /// Number of nodes of the mesh.
    pub nodes: Nodes,
}

/// Number of mesh nodes, as far as it is known before meshing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Nodes {
    /// The number of nodes is free to choose.
    #[default]
    Open,
    /// The scenario states the number of nodes.
    Stated(u32),
    /// The number of nodes is unknown, as for a mesh from a file.
    Unknown,
}

/// Measures the costs. `progress` receives the current task and the completed fraction.
///
/// # Errors
/// [`Error`] if an insertion cannot be simulated.
pub fn measure(progress: &mut (dyn FnMut(&str, f64) + Send)) -> Result<StepCosts, Error> {
    let options = |nodes| InsertionOptions {
        nodes,
        depth_mm: DEPTH_MM,
        passes: 2,
        ..InsertionOptions::default()
    };
    // The study refines to twice the requested number of nodes.
    Ok(StepCosts::of(&Insertions::measure(
        &options(FEW),
        &options(USUAL / 2),
        progress,
    )?))
}

/// Insertions that show the costs: into more and more nodes, and all others into a small block.
pub(crate) struct Insertions {
    pub levels: Levels,
    pub thinning: Vec<ThinningRow>,
    pub links: Vec<PieceRow>,
    pub elements: Vec<PieceRow>,
    pub meshes: Vec<MeshRow>,
}

impl Insertions {
    pub(crate) fn measure(
        quick: &InsertionOptions,
        full: &InsertionOptions,
        progress: Progress<'_>,
    ) -> Result<Self, Error> {
        Ok(Self {
            levels: levels::measure(quick, &mut |what, share| progress(what, 0.15 * share))?,
            thinning: thinning::measure(quick, &mut |what, share| progress(what, 0.15 + 0.15 * share))?,
            links: LINKS.measure(quick, &mut |what, share| progress(what, 0.3 + 0.15 * share))?,
            elements: ELEMENTS.measure(quick, &mut |what, share| progress(what, 0.45 + 0.15 * share))?,
            meshes: meshes::measure(full, &mut |what, share| progress(what, 0.6 + 0.4 * share))?,
        })
    }
}

impl StepCosts {
    fn of(insertions: &Insertions) -> Self {
        let thinning = insertions.thinning.iter();
        let thinning = setting(THINNING, thinning.map(|row| (row.stride, &row.times, row.tip_mm)));
        let of_pieces =
            |key, rows: &[PieceRow]| setting(key, rows.iter().map(|row| (row.length_mm, &row.times, row.tip_mm)));
        let links = of_pieces(LINK, &insertions.links);
        let of_probe = |probe: bool| {
            let rows = insertions.levels.rows.iter();
            // Level IV serves only to show the value of remeshing; its error grows with the depth of the needle.
            let rows = rows.filter(|row| row.probe == probe && row.level != Level::IV && row.measured.flag.is_none());
            let quoted = rows.map(|row| {
                (
                    format!("\"{}\"", row.level),
                    &row.measured.times,
                    row.measured.tip_after_mm,
                )
            });
            let levels = setting(LEVEL, quoted);
            let exact_ms = levels.ms_of("\"exact\"");
            levels.beyond(exact_ms)
        };
        let meshes = insertions.meshes.iter();
        let nodes = setting(NODES, meshes.map(|row| (row.nodes, &row.times, row.tip_mm)));
        let base_ms = [links.ms_of(USUAL_MM), thinning.ms_of("1")];
        StepCosts {
            few: insertions.levels.nodes as u32,
            base_ms,
            levels: [false, true].map(of_probe),
            nodes: nodes.beyond(base_ms[0]),
            elements: of_pieces(ELEMENT, &insertions.elements).beyond(base_ms[0]),
            links: links.beyond(base_ms[0]),
            thinning: thinning.beyond(base_ms[1]),
        }
    }

    /// Returns every setting that was varied, with the costs of its options.
    pub fn settings(&self) -> impl Iterator<Item = &VariedSetting> {
        let other_settings = [&self.nodes, &self.links, &self.elements, &self.thinning];
        self.levels.iter().chain(other_settings)
    }

    /// Returns the choices open to a scenario, and their costs.
    pub fn in_situation(&self, situation: &Situation) -> Costs {
        let row = usize::from(situation.probe);
        let needle = if situation.beam { &self.elements } else { &self.links };
        let mut settings = vec![self.levels[row].clone(), fitting(needle, situation.needle_mm)];
        if situation.probe {
            settings.push(self.thinning.clone());
        }
        if situation.nodes == Nodes::Open {
            settings.push(self.nodes.clone());
        }
        settings.retain(|setting| !setting.options.is_empty());
        let (few, sizes) = (self.few, self.sizes());
        let (mesh, extra_ms) = match situation.nodes {
            Nodes::Open => {
                let largest = sizes.last().map_or(f64::from(few), |(nodes, _)| *nodes);
                (format!("in blocks of {few} to {largest} nodes"), 0.0)
            }
            Nodes::Stated(nodes) => (format!("at {nodes} nodes, from blocks"), extra_of(&sizes, nodes)),
            Nodes::Unknown => (format!("in a block of {few} nodes; a larger mesh takes longer"), 0.0),
        };
        let probe = if situation.probe { "a probe" } else { "no probe" };
        Costs {
            measured: format!("steps that remesh, {probe} in contact, {mesh}"),
            errors: Some("mm at the tip in blocks of tissue".to_owned()),
            base_ms: self.base_ms[row] + extra_ms,
            settings,
        }
    }

    /// Returns numbers of nodes and the time that each adds (ms), ascending, with the small block first.
    fn sizes(&self) -> Vec<(f64, f64)> {
        let options = self.nodes.options.iter();
        let measured = options.filter_map(|option| Some((option.values.first()?.parse().ok()?, option.extra_ms)));
        let mut sizes: Vec<(f64, f64)> = std::iter::once((f64::from(self.few), 0.0)).chain(measured).collect();
        sizes.sort_by(|a, b| a.0.total_cmp(&b.0));
        sizes
    }
}

/// Returns the time that a number of nodes adds, ms: linear between the measured numbers (ascending), extrapolated
/// above the last, and zero below the first.
fn extra_of(sizes: &[(f64, f64)], nodes: u32) -> f64 {
    let nodes = f64::from(nodes);
    let largest = sizes.len().saturating_sub(1);
    let next = sizes.iter().position(|(size, _)| *size >= nodes).unwrap_or(largest);
    let Some(&[(low, before), (high, after)]) = next.checked_sub(1).and_then(|low_index| sizes.get(low_index..=next))
    else {
        return 0.0;
    };
    before + (after - before) * (nodes - low) / (high - low)
}

/// Keeps the options whose needle pieces are no longer than the needle.
fn fitting(setting: &VariedSetting, needle_mm: Option<f64>) -> VariedSetting {
    let fits = |option: &&SettingOption| {
        let length: Option<f64> = option.values.first().and_then(|value| value.parse().ok());
        needle_mm.zip(length).is_none_or(|(needle, length)| length <= needle)
    };
    VariedSetting {
        keys: setting.keys.clone(),
        options: setting.options.iter().filter(fits).cloned().collect(),
    }
}

/// Values of a setting, each with the time of a step that remeshes, ms, and the error of the tip, mm.
struct Measured {
    key: &'static str,
    options: Vec<(String, f64, f64)>,
}

/// Reads values, each with the times of steps and the error of the tip, mm (`None`: the gold standard).
fn setting<'a, T: ToString>(
    key: &'static str,
    rows: impl Iterator<Item = (T, &'a StepTimes, Option<f64>)>,
) -> Measured {
    let options = rows.filter_map(|(value, times, tip_mm)| {
        let error = tip_mm.map_or(Some(0.0), |mm| Some(mm).filter(|mm| mm.is_finite()))?;
        let error = if error < SLIGHT_MM { 0.0 } else { error };
        Some((value.to_string(), times.remesh_median_ms?, error))
    });
    Measured {
        key,
        options: options.collect(),
    }
}

impl Measured {
    /// Time of a value, ms; 0 if it was not measured.
    fn ms_of(&self, value: &str) -> f64 {
        let option = self.options.iter().find(|(choice, ..)| choice == value);
        option.map_or(0.0, |(_, ms, _)| *ms)
    }

    /// Returns the setting with times beyond that of the reference.
    fn beyond(self, base_ms: f64) -> VariedSetting {
        let options = self.options.into_iter().map(|(value, ms, error)| SettingOption {
            values: vec![value],
            extra_ms: ms - base_ms,
            error,
        });
        VariedSetting {
            keys: vec![self.key.to_owned()],
            options: options.collect(),
        }
    }
}

#[cfg(test)]
mod tests;
