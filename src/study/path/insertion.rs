//! One insertion along a straight line: where tip and target are, step by step.

use nalgebra::{Point3, Vector3};

use super::guide;
use insonify::Error;
use insonify::input::scenario::Scenario;
use insonify::run::material_points::MaterialPoints;
use insonify::run::{Deformed, Observer, Requests, Step, run};
use insonify_imaging::scene::NeedleKeyframe;
use insonify_mechanics::insertion::{EventKind, StepError};
use insonify_tracking::needle::NeedlePath;
use insonify_tracking::trajectory::Interpolation;

/// Distance of the tip from the entry at the start, mm, but for a needle in a guide.
pub(super) const APPROACH_MM: f64 = 10.0;
/// Rest at the end of the motion, s: the miss counts at its end, when drives and viscous tissue have settled.
const REST_S: f64 = 0.5;
/// Least length of a stroke whose speed counts, mm, and of its component along the needle, as a share.
const STROKE: (f64, f64) = (1.0, 0.7);
/// Travel between two looks at the tissue, mm, where steps are shorter.
const LOOK_MM: f64 = 0.1;
/// Places and directions are rounded to this, as they are written.
const ROUNDED: [f64; 2] = [1e4, 1e6];
/// Tolerance for a whole number of steps, as a fraction of one.
const WHOLE: f64 = 1e-6;

/// Straight motion of the undeflected needle: from before the entry along a line to a depth, and back along it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Course {
    /// Entry on the skin at rest, mm.
    pub entry: Point3<f64>,
    /// Direction, of unit length.
    pub along: Vector3<f64>,
    /// Farthest distance from the entry, mm.
    pub depth_mm: f64,
    /// Way back from there, mm.
    pub back_mm: f64,
    /// Speed, mm/s.
    pub speed_mm_s: f64,
}

/// When a simulation ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Until {
    /// At the end of the motion.
    End,
    /// When the tip passes the target on the way in.
    Passed,
    /// When the target passes the tip on the way back.
    Returned,
}

/// Tip and target at one moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Time, s.
    pub time_s: f64,
    /// Distance of the undeflected tip from the entry along the line, mm.
    pub travel_mm: f64,
    /// Tip, mm.
    pub tip: Point3<f64>,
    /// The tissue at the tip at rest, mm; `None` outside.
    pub tip_at_rest_mm: Option<Point3<f64>>,
    /// The target in the deformed tissue, mm.
    pub target: Point3<f64>,
    /// From the tissue at the tip to the target, both at rest, mm; before the skin, from the tip.
    pub miss: Vector3<f64>,
    /// Force on the hand, N.
    pub force_n: f64,
}

/// Course of a simulation.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trial {
    /// Tip and target over time.
    pub samples: Vec<Sample>,
    /// Largest force on the hand, N.
    pub max_force_n: f64,
    /// Number of surfaces that were punctured.
    pub punctures: usize,
    /// Number of steps that did not converge.
    pub not_converged: usize,
    /// Largest number of elements inverted at once, at the looks at the tissue.
    pub inverted: usize,
    /// Whether the tip met bone.
    pub bone: bool,
}

/// Mean speed of the first inward stroke of the scenario's needle, as it is commanded, mm/s; `None` without one.
pub(super) fn speed_mm_s(scenario: &Scenario) -> Option<f64> {
    // The path of the scene is the commanded one: that of the scenario has the transients of a guide's drive.
    let keys = scenario.scene.needle_path()?.tip().keys();
    let (mut travel_mm, mut seconds) = (0.0, 0.0);
    for pair in keys.windows(2) {
        let travel = pair[1].pose.position_mm() - pair[0].pose.position_mm();
        let forward_mm = travel.dot(&pair[0].pose.axial());
        if forward_mm > STROKE.1 * travel.norm() {
            travel_mm += forward_mm;
            seconds += pair[1].time_s - pair[0].time_s;
        } else if travel_mm >= STROKE.0 {
            break;
        } else {
            (travel_mm, seconds) = (0.0, 0.0);
        }
    }
    Some(travel_mm / seconds).filter(|speed| travel_mm >= STROKE.0 && speed.is_finite())
}

impl Course {
    /// The straight course from an entry to a point, mm, at a speed, mm/s.
    pub fn to(entry: Point3<f64>, aim: &Point3<f64>, speed_mm_s: f64) -> Self {
        let to_aim = aim - entry;
        Self {
            entry,
            along: to_aim.normalize(),
            depth_mm: to_aim.norm(),
            back_mm: 0.0,
            speed_mm_s,
        }
    }

    /// The straight course from the same entry to another point, mm.
    pub(super) fn aimed(&self, aim: &Point3<f64>) -> Self {
        Self::to(self.entry, aim, self.speed_mm_s)
    }

    /// The tip at the end, mm.
    pub(super) fn end(&self) -> Point3<f64> {
        self.at_depth(self.depth_mm - self.back_mm)
    }

    /// The tip at a distance beyond the entry, mm.
    pub(super) fn at_depth(&self, depth_mm: f64) -> Point3<f64> {
        self.entry + self.along * depth_mm
    }

    /// Number of steps between two looks at the tissue.
    fn stride(&self, scenario: &Scenario) -> f64 {
        (LOOK_MM / (self.speed_mm_s * scenario.timing.dt_s)).round().max(1.0)
    }

    /// Travel between two looks at the tissue, mm.
    pub(super) fn look_mm(&self, scenario: &Scenario) -> f64 {
        self.stride(scenario) * scenario.timing.dt_s * self.speed_mm_s
    }

    /// Distance of the tip from the entry at the start, mm.
    pub(super) fn approach_mm(&self, scenario: &Scenario) -> f64 {
        guide::withdrawn_mm(scenario, self).unwrap_or(APPROACH_MM)
    }

    /// Keyframes of the course at its speed, or slightly slower, so that each stroke takes whole steps, and of a rest
    /// at its end.
    pub fn keys(&self, scenario: &Scenario) -> Vec<NeedleKeyframe> {
        let every_s = self.stride(scenario) * scenario.timing.dt_s;
        let approach_mm = self.approach_mm(scenario);
        let round = |value: f64, per_unit: f64| (value * per_unit).round() / per_unit + 0.0;
        let direction = <[f64; 3]>::from(self.along).map(|x| round(x, ROUNDED[1]));
        let tip = |mm: f64| <[f64; 3]>::from(self.at_depth(mm)).map(|x| round(x, ROUNDED[0]));
        let mut time_s = scenario.needle_tip().start_s();
        let key = |time_s, mm| NeedleKeyframe {
            time_s,
            tip_mm: tip(mm),
            direction,
            roll_deg: None,
        };
        let mut keys = vec![key(time_s, -approach_mm)];
        let end_mm = self.depth_mm - self.back_mm;
        let strokes = [
            ((self.depth_mm + approach_mm) / self.speed_mm_s, self.depth_mm),
            (self.back_mm / self.speed_mm_s, end_mm),
            (REST_S, end_mm),
        ];
        for (seconds, depth_mm) in strokes.into_iter().filter(|(seconds, _)| *seconds > 0.0) {
            time_s += (seconds / every_s - WHOLE).ceil().max(1.0) * every_s;
            keys.push(key(round(time_s, ROUNDED[1]), depth_mm));
        }
        keys
    }

    /// Simulates the course, by the guide of the scenario if it has one.
    pub(super) fn run(&self, scenario: &Scenario, target: &Point3<f64>, until: Until) -> Result<Trial, Error> {
        let keys = self.keys(scenario);
        let keys: Vec<(f64, Point3<f64>, Vector3<f64>)> = keys
            .into_iter()
            .map(|key| (key.time_s, key.tip_mm.into(), key.direction.into()))
            .collect();
        let scenario_on = scenario.commanded(NeedlePath::tip_trajectory(&keys, Interpolation::Linear)?)?;
        let mut model = scenario_on.model(|_, _| ())?;
        let requests = Requests {
            frames: false,
            mesh_s: Some(self.stride(scenario) * scenario.timing.dt_s),
        };
        let mut watch = Watch {
            course: self,
            target,
            until,
            turns_s: keys[1].0 - keys[0].0,
            carried: MaterialPoints::default(),
            last: None,
            trial: Trial::default(),
        };
        match run(&scenario_on, model.as_mut(), requests, &mut watch) {
            Ok(_) | Err(Stop::Reached) => Ok(watch.trial),
            Err(Stop::Failed(error)) => Err(error.into()),
        }
    }
}

/// Reason for the end of a simulation before the end of its motion.
enum Stop {
    Reached,
    Failed(StepError),
}

impl From<StepError> for Stop {
    fn from(error: StepError) -> Self {
        Stop::Failed(error)
    }
}

/// Observer of tip and target.
struct Watch<'a> {
    course: &'a Course,
    target: &'a Point3<f64>,
    until: Until,
    /// End of the way in, s from the start of the run.
    turns_s: f64,
    carried: MaterialPoints,
    /// The last step, with the target where it is at rest.
    last: Option<Sample>,
    trial: Trial,
}

impl Observer for Watch<'_> {
    type Error = Stop;

    fn step(&mut self, step: &Step<'_>) -> Result<(), Stop> {
        let outcome = step.outcome;
        let sample = Sample {
            time_s: step.time_s,
            travel_mm: (step.guidance.measured_tip - self.course.entry).dot(&self.course.along),
            tip: outcome.tip_mm,
            tip_at_rest_mm: outcome.tip_at_rest_mm,
            target: *self.target,
            miss: self.target - outcome.tip_at_rest_mm.unwrap_or(outcome.tip_mm),
            force_n: outcome.on_hand.force_n.norm(),
        };
        let trial = &mut self.trial;
        trial.max_force_n = trial.max_force_n.max(sample.force_n);
        trial.not_converged += usize::from(!outcome.converged);
        let count = |kind| outcome.events.iter().filter(|event| event.kind == kind).count();
        trial.punctures += count(EventKind::Puncture);
        self.last = Some(sample);
        if count(EventKind::Bone) > 0 {
            trial.bone = true;
            return Err(Stop::Reached);
        }
        Ok(())
    }

    fn mesh(&mut self, deformed: &Deformed<'_>) -> Result<(), Stop> {
        let Some(mut sample) = self.last else { return Ok(()) };
        self.trial.inverted = self.trial.inverted.max(deformed.tissue.inverted);
        sample.target = self.carried.point(0, self.target, deformed.elements, deformed.tissue);
        self.trial.samples.push(sample);
        let ahead_mm = sample.miss.dot(&self.course.along);
        let goes_back = sample.time_s > self.turns_s * (1.0 + WHOLE);
        let reached = match self.until {
            Until::End => false,
            Until::Passed => sample.tip_at_rest_mm.is_some() && ahead_mm <= 0.0,
            Until::Returned => goes_back && ahead_mm >= 0.0,
        };
        if reached { Err(Stop::Reached) } else { Ok(()) }
    }
}
