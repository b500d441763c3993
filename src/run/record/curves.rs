//! Curves over the steps of a run, thinned to the resolution of a plot while keeping every peak.

use nalgebra::Point3;

use crate::input::scenario::Scenario;
use crate::run::Step;
use insonify_report::plot::{Axis, Marker, Plot, Series};

/// Number of intervals of steps for which a curve keeps minimum and maximum: about one per pixel.
pub(super) const STRETCHES: u64 = 800;
/// Maximum number of individually marked steps that remesh.
const MARKED: usize = 1500;
/// Names of the ways of needle and probe: directions of x, y, z in the world (LPS).
const WAYS: [&str; 6] = [
    "needle to the left",
    "needle to the back",
    "needle to the head",
    "probe to the left",
    "probe to the back",
    "probe to the head",
];
/// Time of a step at haptic rate, ms.
const HAPTIC_MS: f64 = 1.0;

/// Minimum and maximum of an interval, each with its time, s.
type Extremes = [[f64; 2]; 2];

#[derive(Clone, Debug, Default)]
pub(super) struct Curve {
    points: Vec<Extremes>,
}

impl Curve {
    pub(super) fn add(&mut self, time_s: f64, value: f64, starts: bool) {
        let point = [time_s, value];
        match self.points.last_mut().filter(|_| !starts) {
            Some([least, most]) => {
                if value < least[1] {
                    *least = point;
                }
                if value > most[1] {
                    *most = point;
                }
            }
            None => self.points.push([point; 2]),
        }
    }

    pub(super) fn series(&self, name: &str, colour: usize) -> Series {
        let mut points = Vec::with_capacity(2 * self.points.len());
        for &[a, b] in &self.points {
            let (first, last) = if a[0] <= b[0] { (a, b) } else { (b, a) };
            points.push(first);
            if first != last {
                points.push(last);
            }
        }
        Series::line(name, colour, points)
    }
}

#[derive(Clone, Debug, Default)]
pub(super) struct Curves {
    steps_a_stretch: u64,
    axial: Curve,
    lateral: Curve,
    probe: Option<Curve>,
    inserted: Curve,
    deflection: Curve,
    target: Option<Curve>,
    /// Base of the needle and array of the probe at the first step, mm.
    from: Option<[Point3<f64>; 2]>,
    /// Ways from there along x, y, z: of the needle, then of the probe.
    ways: [Curve; 6],
    ms: Curve,
    remeshed: Vec<[f64; 2]>,
    end_s: f64,
}

impl Curves {
    pub(super) fn new(scenario: &Scenario) -> Self {
        Self {
            steps_a_stretch: scenario.timing.steps.div_ceil(STRETCHES).max(1),
            probe: scenario.contact().is_some().then(Curve::default),
            target: (!scenario.targets.is_empty()).then(Curve::default),
            ..Self::default()
        }
    }

    pub(super) fn add(&mut self, step: &Step<'_>, target_mm: Option<f64>) {
        let starts = (step.number - 1).is_multiple_of(self.steps_a_stretch);
        let (time_s, outcome) = (step.time_s, step.outcome);
        let force = outcome.on_hand.in_frame(&step.base).force_n;
        self.axial.add(time_s, force.z, starts);
        self.lateral.add(time_s, force.x.hypot(force.y), starts);
        if let (Some(curve), Some(wrench)) = (&mut self.probe, &outcome.on_probe) {
            curve.add(time_s, wrench.force_n.norm(), starts);
        }
        self.inserted.add(time_s, outcome.inserted_mm, starts);
        self.deflection.add(time_s, outcome.tip_deflection_mm, starts);
        if let (Some(curve), Some(distance)) = (&mut self.target, target_mm) {
            curve.add(time_s, distance, starts);
        }
        let now = [Point3::from(step.base.translation.vector), step.guidance.array];
        let from = *self.from.get_or_insert(now);
        for (index, curve) in self.ways.iter_mut().enumerate() {
            let (instrument, axis) = (index / 3, index % 3);
            curve.add(time_s, now[instrument][axis] - from[instrument][axis], starts);
        }
        self.ms.add(time_s, step.ms, starts);
        if outcome.remeshes > 0 && self.remeshed.len() < MARKED {
            self.remeshed.push([time_s, step.ms]);
        }
        self.end_s = time_s;
    }

    pub(super) fn plots(&self) -> [Plot; 4] {
        let mut forces = vec![
            self.axial.series("along the needle", 0),
            self.lateral.series("across the needle", 1),
        ];
        forces.extend(self.probe.iter().map(|curve| curve.series("on the probe", 2)));
        let mut tip = vec![
            self.inserted.series("inserted", 0),
            self.deflection.series("tip deflection", 1),
        ];
        tip.extend(
            self.target
                .iter()
                .map(|curve| curve.series("distance to the target", 2)),
        );
        let ways = WAYS.into_iter().zip(&self.ways).enumerate();
        let ways = ways.map(|(index, (name, curve))| curve.series(name, index)).collect();
        let remeshed = Series::points("steps that remesh", 1, Marker::Cross, self.remeshed.clone());
        let limit = vec![[0.0, HAPTIC_MS], [self.end_s, HAPTIC_MS]];
        let haptic = Series::line("1 ms: haptic rate", 6, limit);
        let times = vec![self.ms.series("all steps", 0), remeshed, haptic];
        let plot = |title: &str, y, series| Plot::new(title, Axis::linear("simulated time, s"), y, series);
        [
            plot(
                "Force on the hand (along: positive into the body)",
                Axis::linear("force, N"),
                forces,
            ),
            plot("Tip of the needle", Axis::linear("mm"), tip),
            plot("Paths of needle and probe from their start", Axis::linear("mm"), ways),
            plot("Time of a step", Axis::log("ms"), times),
        ]
    }
}
