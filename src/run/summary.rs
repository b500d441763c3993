//! Summary of a run.

use std::collections::BTreeMap;
use std::fmt;

use nalgebra::{Point3, Vector3};
use serde::Serialize;

use super::Step;
use crate::input::scenario::Scenario;
use crate::input::scenario::planning_study::{ImageMatch, Nearest};
use crate::input::scenario::reported_points::{Displaced, Extremes};
use insonify_base::statistics::{Times, mean, std};
use insonify_mechanics::insertion::{EventKind, LevelChange, Snapshot, Tissue, Work};

/// Maximum number of events kept: a run that never converges reports one per step.
const MAX_EVENTS: usize = 10_000;

/// Number of longest steps that are kept.
const LONGEST: usize = 10;
/// Dent of a surface before its puncture above which it is told, mm.
const MAX_DENT_MM: f64 = 10.0;

/// Summary of a run, as `insonify insert --json` prints it.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Summary {
    /// Number of steps.
    pub steps: u64,
    /// Simulated time, s.
    pub simulated_s: f64,
    /// Number of nodes of the mesh.
    pub nodes: usize,
    /// Number of tetrahedra of the mesh.
    pub elements: usize,
    /// Number of nodes that the probe can touch.
    pub probe_candidates: usize,
    /// Largest force on the hand, N.
    pub max_base_force_n: f64,
    /// Largest force on the probe, N; `None` without a probe in contact.
    pub max_probe_force_n: Option<f64>,
    /// Largest distance of the tip from that of the unloaded needle, mm.
    pub tip_deflection_mm: f64,
    /// Largest depth of the tip, mm.
    pub max_inserted_mm: f64,
    /// Largest distance by which the tip went on from the touch of a surface to its puncture, mm.
    pub max_dent_mm: f64,
    /// Number of nodes moved to the tip or back.
    pub remeshes: u64,
    /// Number of steps that did not converge.
    pub not_converged: u64,
    /// Maximum number of inverted elements, evaluated at frames and mesh outputs: tissue was crushed there. `None`
    /// without such outputs.
    pub max_inverted_elements: Option<usize>,
    /// Distribution of step times.
    pub step_ms: StepMs,
    /// Changes of the level of remeshing.
    pub level_changes: Vec<LevelChanged>,
    /// Events of the run.
    pub events: Vec<EventRecord>,
    /// Seeds, in the order of deposition.
    pub seeds: Vec<Seed>,
    /// Distances of all seeds from their plan; `None` if no planned seed is in tissue.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub misplacement: Option<Misplacement>,
    /// Closest approach to each target.
    pub targets: Vec<Reached>,
    /// Nearest matches of the images of the planning study; absent without one.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub images: Vec<ImageMatch>,
    /// Displacement of each reported point: its extremes over the frames of the run; absent without any.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub points: Vec<Extremes>,
    /// Critical structures near the tip; `None` if there is none within 30 mm of the planned path.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub critical: Option<CriticalMet>,
    /// Warnings of the run.
    pub warnings: Vec<String>,
}

/// Critical structures met in a run.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CriticalMet {
    /// Number of times that the tip entered one.
    pub entries: usize,
    /// Least distance of the tip from one in the anatomy at rest, mm.
    pub clearance_mm: f64,
}

/// Distribution of times, ms; percentiles to within 0.6 %.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Distribution {
    /// Median.
    pub median: f64,
    /// 95th percentile.
    pub p95: f64,
    /// 99th percentile.
    pub p99: f64,
    /// 99.9th percentile.
    pub p999: f64,
    /// Maximum.
    pub max: f64,
}

impl Distribution {
    fn new(times: &Times) -> Self {
        let rank = |share| times.percentile(share).unwrap_or(0.0);
        Distribution {
            median: rank(0.5),
            p95: rank(0.95),
            p99: rank(0.99),
            p999: rank(0.999),
            max: rank(1.0),
        }
    }
}

/// Times of steps, ms.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct StepMs {
    /// Wall time.
    #[serde(flatten)]
    pub wall: Distribution,
    /// Median wall time of steps that remesh; `None` if there are none.
    pub remesh_median: Option<f64>,
    /// Maximum wall time of steps that remesh; `None` if there are none.
    pub remesh_max: Option<f64>,
    /// CPU time of the thread that steps; `None` where the system does not state it.
    pub cpu: Option<Distribution>,
    /// The longest steps by CPU time (wall time where the system does not state that), the longest first: at most 10.
    pub longest: Vec<LongStep>,
}

/// One of the longest steps.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LongStep {
    /// Number of the step, from 1 on.
    pub step: u64,
    /// Wall time, ms.
    pub ms: f64,
    /// CPU time, ms; `None` where the system does not state it.
    pub cpu_ms: Option<f64>,
    /// Number of nodes moved to the tip, or back.
    pub remeshes: usize,
    /// Number of iterations over contact states and needle shape.
    pub iterations: usize,
    /// Wall time by kind of work, ms; empty for models that do not measure it.
    pub spent_ms: BTreeMap<&'static str, f64>,
}

impl LongStep {
    fn new(step: &Step<'_>) -> Self {
        let spent = step
            .cost
            .map(|cost| Work::ALL.map(|(work, name)| (name, cost.ms(work))));
        LongStep {
            step: step.number,
            ms: step.ms,
            cpu_ms: step.cpu_ms,
            remeshes: step.outcome.remeshes,
            iterations: step.outcome.iterations,
            spent_ms: spent.into_iter().flatten().collect(),
        }
    }

    fn length_ms(&self) -> f64 {
        self.cpu_ms.unwrap_or(self.ms)
    }
}

impl StepMs {
    /// Keeps a step if it is among the longest.
    fn rank(&mut self, step: &Step<'_>) {
        let length_ms = step.cpu_ms.unwrap_or(step.ms);
        let rank = self.longest.partition_point(|longer| longer.length_ms() >= length_ms);
        if rank < LONGEST {
            self.longest.truncate(LONGEST - 1);
            self.longest.insert(rank, LongStep::new(step));
        }
    }

    /// Returns the kinds of work with their shares of the time of the longest steps, the largest first.
    pub fn shares_of_longest(&self) -> Vec<(&'static str, f64)> {
        let sum_ms = |name: &str| {
            self.longest
                .iter()
                .filter_map(|step| step.spent_ms.get(name))
                .sum::<f64>()
        };
        let mut shares = Work::ALL.map(|(_, name)| (name, sum_ms(name))).to_vec();
        let total_ms: f64 = shares.iter().map(|(_, ms)| ms).sum();
        shares.retain_mut(|(_, ms)| {
            *ms /= total_ms;
            *ms > 0.0
        });
        shares.sort_by(|a, b| b.1.total_cmp(&a.1));
        shares
    }
}

/// A change of the level of remeshing.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LevelChanged {
    /// Time at the end of the step before the change, s from the start of the run.
    pub time_s: f64,
    /// Level before the change.
    pub from: String,
    /// Level after the change.
    pub to: String,
    /// Change of the force on the hand at the same pose, N.
    pub force_jump_n: f64,
    /// Largest change of an entry of the compliance at the contacts, over its largest entry.
    pub compliance_change: f64,
    /// Duration of the change on this machine, s.
    pub seconds: f64,
}

/// An event.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct EventRecord {
    /// Machine-readable kind: `surface`, `puncture`, `region`, `bone`, `critical`, `out`, `seed`, `not-remeshed`,
    /// `not-converged`, `crushed` or `device-lost`.
    pub kind: &'static str,
    /// Description for the user.
    pub text: String,
    /// Time, s from the start of the run.
    pub time_s: f64,
    /// Position, mm.
    pub at_mm: [f64; 3],
    /// Region concerned.
    pub region: Option<String>,
}

/// A deposited seed.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Seed {
    /// Time of deposition, s from the start of the run.
    pub time_s: f64,
    /// Planned position in the anatomy at rest, mm; `None` for a seed that was only commanded.
    pub planned_mm: Option<[f64; 3]>,
    /// Position of the tip at deposition, mm.
    pub left_at_mm: [f64; 3],
    /// Position in the anatomy at rest of the tissue that contains it, mm; `None` if it was left outside tissue.
    pub deposited_mm: Option<[f64; 3]>,
    /// Distance from `planned_mm` to `deposited_mm`, mm.
    pub distance_mm: Option<f64>,
}

/// Misplacement of the seeds of a plan that came to lie in tissue, in the anatomy at rest, mm.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Misplacement {
    /// Number of these seeds.
    pub seeds: usize,
    /// Mean distance from the plan.
    pub mean_mm: f64,
    /// Standard deviation of the distance; `None` for one seed.
    pub sd_mm: Option<f64>,
    /// Largest distance.
    pub max_mm: f64,
    /// Mean displacement from the plan: what all seeds have in common.
    pub mean_offset_mm: [f64; 3],
}

impl Misplacement {
    fn of_seeds(seeds: &[Seed]) -> Option<Self> {
        let offsets = seeds
            .iter()
            .filter_map(|seed| Some(Point3::from(seed.deposited_mm?) - Point3::from(seed.planned_mm?)));
        let offsets: Vec<Vector3<f64>> = offsets.collect();
        let distances: Vec<f64> = offsets.iter().map(|offset| offset.norm()).collect();
        let max_mm = distances.iter().copied().reduce(f64::max)?;
        Some(Self {
            seeds: offsets.len(),
            mean_mm: mean(&distances),
            sd_mm: (offsets.len() > 1).then(|| std(&distances)),
            max_mm,
            mean_offset_mm: (offsets.iter().sum::<Vector3<f64>>() / offsets.len() as f64).into(),
        })
    }
}

impl fmt::Display for Misplacement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.2} mm", self.mean_mm)?;
        if let Some(sd_mm) = self.sd_mm {
            write!(f, " +- {sd_mm:.2}")?;
        }
        write!(f, " from their plan, at most {:.2} mm", self.max_mm)
    }
}

/// Closest approach to a target, in the anatomy at rest.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Reached {
    /// Name of the target.
    pub name: String,
    /// Position of the target, mm.
    pub at_mm: [f64; 3],
    /// Smallest distance of the tip from the target, mm.
    pub nearest_tip_mm: f64,
    /// Distance of the nearest seed from the target, mm; `None` without seeds in tissue.
    pub nearest_seed_mm: Option<f64>,
}

/// Describes an event for the user.
fn in_words(kind: EventKind, region: Option<&str>, is_skin: bool) -> String {
    let surface = match region {
        Some(_) if is_skin => "skin".to_owned(),
        Some(region) => format!("surface of {region}"),
        None => "surface".to_owned(),
    };
    let region = region.unwrap_or("tissue without a name");
    match kind {
        EventKind::Skin => format!("{surface} touched"),
        EventKind::Puncture => format!("{surface} punctured"),
        EventKind::Region => format!("entering {region}"),
        EventKind::Bone => format!("bone met: {region}"),
        EventKind::Critical => format!("critical structure entered: {region}"),
        EventKind::Out => "needle out of the body".to_owned(),
        EventKind::Seed => format!("seed left in {region}"),
        EventKind::NotRemeshed => "the mesh does not follow the tip".to_owned(),
        EventKind::NotConverged => "step not converged: its forces are approximate".to_owned(),
        EventKind::Crushed => "elements inverted beside the needle or probe".to_owned(),
        EventKind::DeviceLost => "the GPU failed: the CPU goes on".to_owned(),
    }
}

/// Running summary of a run.
pub struct Tally<'a> {
    scenario: &'a Scenario,
    ms: Times,
    remesh_ms: Times,
    cpu_ms: Times,
    summary: Summary,
    /// Indices of the seeds taken by the model, among all seeds.
    taken_seeds: Vec<usize>,
    nearest_images: Vec<Nearest>,
    /// Whether the tip is in a critical structure.
    in_critical: bool,
    /// The last region that was met, and where, mm.
    touched: Option<(Option<i32>, Point3<f64>)>,
    unheard: u64,
}

impl<'a> Tally<'a> {
    /// Starts the summary of a run of a scenario.
    pub fn new(scenario: &'a Scenario) -> Self {
        let contact = scenario.contact();
        let summary = Summary {
            nodes: scenario.mesh.nodes().len(),
            elements: scenario.mesh.elements().len(),
            probe_candidates: contact.map_or(0, |contact| contact.probe.candidates.len()),
            max_probe_force_n: contact.map(|_| 0.0),
            targets: scenario
                .targets
                .iter()
                .map(|target| Reached {
                    name: target.name.clone(),
                    at_mm: target.at_mm.into(),
                    nearest_tip_mm: f64::INFINITY,
                    nearest_seed_mm: None,
                })
                .collect(),
            points: scenario.reports.iter().map(Extremes::new).collect(),
            warnings: scenario.warnings.clone(),
            ..Summary::default()
        };
        Self {
            scenario,
            ms: Times::default(),
            remesh_ms: Times::default(),
            cpu_ms: Times::default(),
            summary,
            taken_seeds: Vec::new(),
            nearest_images: Vec::new(),
            in_critical: false,
            touched: None,
            unheard: 0,
        }
    }

    /// Records a step.
    pub fn add(&mut self, step: &Step<'_>) {
        let (summary, outcome) = (&mut self.summary, step.outcome);
        self.ms.add(step.ms);
        if let Some(cpu_ms) = step.cpu_ms {
            self.cpu_ms.add(cpu_ms);
        }
        summary.step_ms.rank(step);
        if outcome.remeshes > 0 {
            self.remesh_ms.add(step.ms);
        }
        summary.steps = step.number;
        summary.simulated_s = step.time_s;
        summary.max_base_force_n = summary.max_base_force_n.max(outcome.on_hand.force_n.norm());
        if let (Some(largest_n), Some(wrench)) = (&mut summary.max_probe_force_n, &outcome.on_probe) {
            *largest_n = largest_n.max(wrench.force_n.norm());
        }
        summary.tip_deflection_mm = summary.tip_deflection_mm.max(outcome.tip_deflection_mm);
        summary.max_inserted_mm = summary.max_inserted_mm.max(outcome.inserted_mm);
        summary.remeshes += outcome.remeshes as u64;
        summary.not_converged += u64::from(!outcome.converged);
        // Outside the tissue the tip is not displaced.
        let tip = outcome.tip_at_rest_mm.unwrap_or(outcome.tip_mm);
        for target in &mut summary.targets {
            let distance = (tip - Point3::from(target.at_mm)).norm();
            target.nearest_tip_mm = target.nearest_tip_mm.min(distance);
        }
        if let Some(clearance) = step.guidance.clearance_mm {
            let critical = summary.critical.get_or_insert(CriticalMet {
                entries: 0,
                clearance_mm: f64::INFINITY,
            });
            critical.clearance_mm = critical.clearance_mm.min(clearance);
        }
        // As `score` counts: from outside into one, however many regions are critical there.
        let is_inside = outcome.inserted_mm > 0.0 && step.guidance.clearance_mm == Some(0.0);
        if let Some(critical) = &mut summary.critical {
            critical.entries += usize::from(is_inside && !self.in_critical);
        }
        self.in_critical = is_inside;
        let probe = self.scenario.probe(step.number);
        self.scenario.study.look(step.time_s, &probe, &mut self.nearest_images);
        for event in &outcome.events {
            match event.kind {
                EventKind::Skin | EventKind::Region => self.touched = Some((event.region, event.at_mm)),
                EventKind::Puncture => {
                    // Nonlinear tissue tells of a region within only as its surface breaks.
                    let touched = self.touched.filter(|(region, _)| *region == event.region);
                    let dent = touched.map_or(0.0, |(_, at_mm)| (event.at_mm - at_mm).norm());
                    summary.max_dent_mm = summary.max_dent_mm.max(dent);
                }
                _ => {}
            }
        }
        self.seed(step);
        for event in &outcome.events {
            if self.summary.events.len() == MAX_EVENTS {
                self.unheard += 1;
                continue;
            }
            let scenario = self.scenario;
            let region = event.region.map(|region| scenario.region_name(region).to_owned());
            let is_skin = event.region.is_some_and(|region| scenario.is_skin(region));
            self.summary.events.push(EventRecord {
                kind: event.kind.name(),
                text: in_words(event.kind, region.as_deref(), is_skin),
                time_s: event.time_s,
                at_mm: event.at_mm.into(),
                region,
            });
        }
    }

    /// Records a change of level before a step.
    pub fn change(&mut self, step: u64, change: &LevelChange) {
        self.summary.level_changes.push(LevelChanged {
            time_s: (step - 1) as f64 * self.scenario.timing.dt_s,
            from: change.from.to_string(),
            to: change.to.to_string(),
            force_jump_n: change.force_jump_n,
            compliance_change: change.compliance_change,
            seconds: change.seconds,
        });
    }

    /// Records displacements of the reported points.
    pub fn displace(&mut self, displaced: &Displaced<'_>) {
        for (point, moved) in self.summary.points.iter_mut().zip(displaced.displacement_mm) {
            point.add(displaced.time_s, moved);
        }
    }

    /// Records the tissue at a frame or mesh output.
    pub fn see(&mut self, tissue: &Tissue) {
        let max_inverted = &mut self.summary.max_inverted_elements;
        *max_inverted = (*max_inverted).max(Some(tissue.inverted));
    }

    fn seed(&mut self, step: &Step<'_>) {
        let timing = &self.scenario.timing;
        let mut deposits = self.scenario.deposits.iter();
        let Some(deposit) = deposits.find(|deposit| timing.step_at(deposit.time_s) == step.number) else {
            return;
        };
        if step.outcome.events.iter().any(|event| event.kind == EventKind::Seed) {
            self.taken_seeds.push(self.summary.seeds.len());
        }
        self.summary.seeds.push(Seed {
            time_s: step.time_s,
            planned_mm: deposit.planned_mm.map(Into::into),
            left_at_mm: step.outcome.tip_mm.into(),
            deposited_mm: None,
            distance_mm: None,
        });
    }

    /// Completes the summary with the seeds in the last state of the run.
    pub fn finish(mut self, last: &Snapshot) -> Summary {
        self.summary.step_ms = StepMs {
            wall: Distribution::new(&self.ms),
            remesh_median: self.remesh_ms.percentile(0.5),
            remesh_max: self.remesh_ms.percentile(1.0),
            cpu: self.cpu_ms.percentile(1.0).map(|_| Distribution::new(&self.cpu_ms)),
            longest: std::mem::take(&mut self.summary.step_ms.longest),
        };
        for (seed, position_mm) in self.taken_seeds.iter().zip(&last.seeds) {
            let seed = &mut self.summary.seeds[*seed];
            seed.deposited_mm = Some((*position_mm).into());
            seed.distance_mm = seed
                .planned_mm
                .map(|planned| (position_mm - Point3::from(planned)).norm());
            for target in &mut self.summary.targets {
                let distance = (position_mm - Point3::from(target.at_mm)).norm();
                target.nearest_seed_mm = Some(target.nearest_seed_mm.map_or(distance, |least| least.min(distance)));
            }
        }
        let (scenario, nearest) = (self.scenario, &self.nearest_images);
        let label_at = |point: &Point3<f64>| scenario.scene.anatomy.volume.label_index_at(point);
        self.summary.images = scenario.study.matches(label_at, nearest);
        self.summary.misplacement = Misplacement::of_seeds(&self.summary.seeds);
        self.warn();
        self.summary
    }

    fn warn(&mut self) {
        let summary = &mut self.summary;
        let outside = summary.seeds.iter().filter(|seed| seed.deposited_mm.is_none()).count();
        if outside > 0 {
            summary.warnings.push(format!(
                "{outside} of {} seeds were left outside the tissue",
                summary.seeds.len()
            ));
        }
        if summary.not_converged > 0 {
            let (unconverged, steps) = (summary.not_converged, summary.steps);
            summary.warnings.push(format!(
                "{unconverged} of {steps} steps did not converge: their forces are approximate"
            ));
        }
        if summary.max_dent_mm > MAX_DENT_MM {
            summary.warnings.push(format!(
                "a surface gave way by {:.1} mm before it broke, which is far for skin or a capsule: check its `puncture_n`, the moduli \
                 below it, and `tissue.patch_mm`, over which the force is spread",
                summary.max_dent_mm
            ));
        }
        if let Some(inverted @ 1..) = summary.max_inverted_elements {
            summary.warnings.push(format!(
                "up to {inverted} elements were inverted at once: tissue is crushed there, and where layers overlap \
                 only one is imaged"
            ));
        }
        for (kind, sentence) in [
            (EventKind::Bone, "the needle hit bone"),
            (EventKind::Critical, "the needle entered a critical structure"),
        ] {
            let events = summary.events.iter().filter(|event| event.kind == kind.name());
            let mut regions: Vec<&str> = events.clone().filter_map(|event| event.region.as_deref()).collect();
            regions.sort_unstable();
            regions.dedup();
            if let Some(first) = events.clone().next() {
                let (time_s, named) = (first.time_s, regions.join(", "));
                let times = match events.count() {
                    1 => format!("at {time_s:.2} s"),
                    times => format!("{times} times, first at {time_s:.2} s"),
                };
                summary.warnings.push(format!("{sentence}: {named} ({times})"));
            }
        }
        // These may come at every step and fill the list of events: their number could be that of the list.
        let count = |kind: EventKind| summary.events.iter().filter(|event| event.kind == kind.name()).count();
        for (kind, sentence) in [
            (
                EventKind::Crushed,
                "elements beside the contacts were inverted: tissue is crushed there",
            ),
            (EventKind::DeviceLost, "the GPU failed; remeshing continued on the CPU"),
            (
                EventKind::NotRemeshed,
                "the mesh did not follow the tip, as no node could be moved there without spoiling an element; the needle is held by the \
                 nodes before and after, and forces are less exact there (a finer mesh helps: `tissue.nodes`)",
            ),
        ] {
            let times = count(kind);
            if times > 0 {
                let plural = if times == 1 { "once" } else { "more than once" };
                summary.warnings.push(format!("{sentence} ({plural}; see the events)"));
            }
        }
        if summary.max_inserted_mm == 0.0 {
            summary.warnings.push("the needle never met the tissue".to_owned());
        }
        if self.unheard > 0 {
            summary
                .warnings
                .push(format!("{} more events are not listed", self.unheard));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn misplacement_is_that_of_planned_seeds_in_tissue() {
        let seed = |planned_mm, deposited_mm| Seed {
            time_s: 0.0,
            planned_mm,
            left_at_mm: [0.0; 3],
            deposited_mm,
            distance_mm: None,
        };
        let mut seeds = vec![
            seed(Some([1.0, 1.0, 1.0]), None),
            seed(None, Some([9.0, 9.0, 9.0])),
            seed(Some([1.0, 1.0, 1.0]), Some([4.0, 5.0, 1.0])),
        ];
        assert_eq!(Misplacement::of_seeds(&seeds[..2]), None);
        let one = Misplacement::of_seeds(&seeds).expect("a seed");
        assert_eq!((one.seeds, one.mean_mm, one.sd_mm, one.max_mm), (1, 5.0, None, 5.0));
        seeds.push(seed(Some([2.0, 0.0, 0.0]), Some([2.0, 0.0, -1.0])));
        // Distances 5 and 1.
        let two = Misplacement::of_seeds(&seeds).expect("seeds");
        assert_eq!((two.seeds, two.mean_mm, two.max_mm), (2, 3.0, 5.0));
        assert_eq!(two.sd_mm, Some(8_f64.sqrt()));
        assert_eq!(two.mean_offset_mm, [1.5, 2.0, -0.5]);
        assert_eq!(two.to_string(), "3.00 mm +- 2.83 from their plan, at most 5.00 mm");
    }
}
