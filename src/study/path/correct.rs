//! Correction of a line for the displacement of its target.
//!
//! The needle is pivoted about its entry and sent deeper or less deep until the tissue at its tip is that of the target.
//! Each run goes on until the tip passes the target; the remaining distance across the needle turns the line by a
//! damped fixed point, P' = P + c m with the miss m at P, or, for needles that bend or have a bevel, by a Gauss-Newton
//! step with the derivatives of m by both angles, from two more runs. Where a surface gives way so that the tip leaps
//! past the target, the needle is drawn back to it. A last run to the end of the motion found measures the miss, which
//! the same steps, along the needle too, then reduce.

use nalgebra::{Matrix2, Point3, Vector2, Vector3};
use serde::Serialize;

use super::candidates::DEFORMED_BONE;
use super::guide;
use super::insertion::{Course, Sample, Trial, Until};
use insonify::Error;
use insonify::input::scenario::Scenario;
use insonify_mechanics::needle::across;

/// Travel beyond the target at rest, and way back, within which the target is searched for, mm.
const BEYOND_MM: f64 = 15.0;
/// Largest numbers of runs that search for the line, and of those that measure the miss.
const SEARCHES: usize = 6;
const LANDINGS: usize = 6;
/// Shift of the line for derivatives, mm.
const SHIFT_MM: f64 = 2.0;
/// Factor on a step after one that made the miss larger.
const DAMPED: f64 = 0.5;
/// Advance relative to the tissue over that of the needle above which the tip has leapt.
const LEAP: f64 = 3.0;

/// A line and its simulations.
#[derive(Clone, Debug, Serialize)]
pub struct Corrected {
    /// Direction of the needle.
    pub direction: [f64; 3],
    /// Depth of the tip beyond the entry, mm.
    pub insertion_mm: f64,
    /// Way back from there to the target, mm: above 0 where the tip leaps past it as a surface gives way.
    pub back_mm: f64,
    /// Distance of the tissue at the tip from the target, both at rest, when the needle is sent to where the target is at
    /// rest, mm.
    pub miss_before_mm: f64,
    /// The same at the end of the corrected path, mm.
    pub miss_mm: f64,
    /// Part of it across the image plane, in which a guide holds the needle, mm; `None` without a guide.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub miss_across_mm: Option<f64>,
    /// Displacement of the tissue at the tip at that end, along the needle and across it, mm.
    pub displacement_mm: [f64; 2],
    /// Turn of the line by the correction, degrees.
    pub turn_deg: f64,
    /// Largest force on the hand, N.
    pub max_force_n: f64,
    /// Distance of the nearest bone or critical structure, at rest or as the tissue deforms, mm; `None` beyond 30 mm.
    pub clearance_mm: Option<f64>,
    /// Number of surfaces punctured.
    pub punctures: usize,
    /// Number of simulations.
    pub runs: usize,
    /// Motion of the needle.
    #[serde(skip)]
    pub course: Course,
    /// Simulation of the uncorrected path.
    #[serde(skip)]
    pub first: Trial,
    /// Simulation of the corrected path.
    #[serde(skip)]
    pub last: Trial,
}

impl Corrected {
    /// Warnings about the best path.
    pub(super) fn warnings(&self, tolerance_mm: f64) -> Vec<String> {
        let mut warnings = Vec::new();
        if self.miss_mm > tolerance_mm {
            warnings.push(format!(
                "no line reaches the target within {tolerance_mm} mm: the best misses it by {:.2} mm after {} simulations{}",
                self.miss_mm,
                self.runs,
                self.miss_across_mm.map_or_else(String::new, |across_mm| format!(
                    ", by {across_mm:.2} mm across the image plane, which the guide cannot change"
                ))
            ));
        }
        if self.last.not_converged > 0 {
            warnings.push(format!(
                "{} steps of the best path did not converge: its figures are approximate",
                self.last.not_converged
            ));
        }
        if self.last.inverted > 0 {
            warnings.push(format!(
                "up to {} elements were inverted at once on the best path: tissue is crushed there, and its displacement approximate",
                self.last.inverted
            ));
        }
        warnings
    }
}

/// Meeting of tip and target on a run that goes on beyond it.
struct Meeting {
    depth_mm: f64,
    back_mm: f64,
    /// Remaining miss across the needle, mm.
    aside: Vector3<f64>,
}

struct Search<'a> {
    scenario: &'a Scenario,
    target: Point3<f64>,
    runs: usize,
}

/// End of a search without a path.
pub(super) enum Fault {
    /// Reason to exclude the line.
    Excluded(&'static str),
    Failed(Error),
}

impl From<Error> for Fault {
    fn from(error: Error) -> Self {
        Fault::Failed(error)
    }
}

/// Corrects a straight course to `target`.
pub(super) fn correct(
    scenario: &Scenario,
    straight: Course,
    target: Point3<f64>,
    tolerance_mm: f64,
) -> Result<Corrected, Fault> {
    let mut search = Search {
        scenario,
        target,
        runs: 0,
    };
    let uncorrected = search.run(&straight, Until::End)?;
    if uncorrected.bone {
        return Err(Fault::Excluded(DEFORMED_BONE));
    }
    let Some(miss_before_mm) = uncorrected.samples.last().map(|sample| sample.miss.norm()) else {
        return Err(Fault::Excluded("the simulation has no step"));
    };
    let (mut course, mut latest, mut miss_mm) = (straight, uncorrected.clone(), miss_before_mm);
    if miss_mm > tolerance_mm {
        let on_line = search.line(straight, tolerance_mm)?;
        (course, latest) = search.land(on_line, tolerance_mm)?;
        miss_mm = latest.samples.last().map_or(f64::INFINITY, |sample| sample.miss.norm());
        // A search that ends farther off than it began has found nothing.
        if miss_mm >= miss_before_mm || !miss_mm.is_finite() {
            (course, latest, miss_mm) = (straight, uncorrected.clone(), miss_before_mm);
        }
    }
    if latest.bone {
        return Err(Fault::Excluded(DEFORMED_BONE));
    }
    let end = latest.samples.last();
    let Some(displacement) = end.and_then(|end| Some(end.tip - end.tip_at_rest_mm?)) else {
        return Err(Fault::Excluded("the simulated tip ends outside the tissue"));
    };
    let forward = displacement.dot(&course.along);
    Ok(Corrected {
        direction: course.along.into(),
        insertion_mm: course.depth_mm,
        back_mm: course.back_mm,
        miss_before_mm,
        miss_mm,
        miss_across_mm: end.and_then(|end| guide::across_mm(scenario, &end.miss)),
        displacement_mm: [forward, (displacement - course.along * forward).norm()],
        turn_deg: course.along.angle(&straight.along).to_degrees(),
        max_force_n: latest.max_force_n,
        clearance_mm: None,
        punctures: latest.punctures,
        runs: search.runs,
        course,
        first: uncorrected,
        last: latest,
    })
}

impl Search<'_> {
    fn run(&mut self, course: &Course, until: Until) -> Result<Trial, Fault> {
        if let Some(reason) = guide::beyond(self.scenario, course) {
            return Err(Fault::Excluded(reason));
        }
        self.runs += 1;
        Ok(course.run(self.scenario, &self.target, until)?)
    }

    /// Turns the line until the tip meets the target on its way.
    fn line(&mut self, straight: Course, tolerance_mm: f64) -> Result<Course, Fault> {
        let mut course = straight;
        let mut meeting = self.meeting(&course)?;
        let mut best = (meeting.aside.norm(), course.at(&meeting));
        let mut damping = 1.0;
        let mut gain = None;
        for _ in 1..SEARCHES {
            if best.0 <= 0.5 * tolerance_mm {
                break;
            }
            // Derivatives hardly change within the few degrees that a line turns, and cost two runs: once.
            let gain = match gain {
                Some(gain) => gain,
                None => *gain.insert(self.gain(&course, &meeting)?),
            };
            let start = best.1;
            let aim = start.end() + step(&gain, &straight.along, &meeting.aside) * damping;
            course = Course {
                depth_mm: start.depth_mm,
                ..start.aimed(&guide::aim(self.scenario, aim))
            };
            let next = self.meeting(&course)?;
            let aside_mm = next.aside.norm();
            if aside_mm < best.0 {
                best = (aside_mm, course.at(&next));
                meeting = next;
            } else {
                damping *= DAMPED;
            }
        }
        Ok(best.1)
    }

    /// Derivatives of the miss across the needle by the aim: those of a rigid needle, or from two runs.
    fn gain(&mut self, course: &Course, meeting: &Meeting) -> Result<Matrix2<f64>, Fault> {
        // A guide turns the needle in its plane alone: shifts out of it, for derivatives, are beyond it.
        if self.scenario.needle.is_straight() || guide::holds(self.scenario) {
            return Ok(-Matrix2::identity());
        }
        let axes = across(&course.along);
        let tip = course.at_depth(meeting.depth_mm - meeting.back_mm);
        let mut columns = [Vector2::zeros(); 2];
        for (column, axis) in columns.iter_mut().zip(axes) {
            let shifted = course.aimed(&(tip + axis * SHIFT_MM));
            let change = (self.meeting(&shifted)?.aside - meeting.aside) / SHIFT_MM;
            *column = Vector2::from(axes.map(|axis| axis.dot(&change)));
        }
        Ok(Matrix2::from_columns(&columns))
    }

    /// Runs along a line until the tip meets the target, drawn back to it if it leapt past it.
    fn meeting(&mut self, course: &Course) -> Result<Meeting, Fault> {
        let reach_mm = guide::reach_mm(self.scenario, course);
        let beyond = Course {
            depth_mm: ((self.target - course.entry).norm() + BEYOND_MM).min(reach_mm),
            back_mm: 0.0,
            ..*course
        };
        let trial = self.run(&beyond, Until::Passed)?;
        let passed = met(&trial.samples, &course.along);
        let leap_mm = LEAP * course.look_mm(self.scenario);
        let leapt = passed.advance_mm > leap_mm && passed.ahead_mm < 0.0;
        if !leapt {
            return Ok(Meeting {
                depth_mm: passed.travel_mm,
                back_mm: 0.0,
                aside: passed.aside,
            });
        }
        let there_and_back = Course {
            // Where the surface gives way, a little farther, so that it does so again.
            depth_mm: (passed.end_mm + leap_mm).min(reach_mm),
            back_mm: BEYOND_MM,
            ..*course
        };
        let trial = self.run(&there_and_back, Until::Returned)?;
        let returned = met(&trial.samples, &-course.along);
        Ok(Meeting {
            depth_mm: there_and_back.depth_mm,
            back_mm: (there_and_back.depth_mm - returned.travel_mm).max(0.0),
            aside: returned.aside,
        })
    }

    /// Runs to the end of a motion, and moves that by the miss until it is within the tolerance; returns the best
    /// motion.
    fn land(&mut self, start: Course, tolerance_mm: f64) -> Result<(Course, Trial), Fault> {
        let mut course = start;
        let mut best: Option<(f64, Course, Trial, Vector3<f64>)> = None;
        let mut damping = 1.0;
        for _ in 0..LANDINGS {
            let trial = self.run(&course, Until::End)?;
            let Some(miss) = trial.samples.last().map(|sample| sample.miss) else {
                break;
            };
            if best.as_ref().is_none_or(|(least, ..)| miss.norm() < *least) {
                best = Some((miss.norm(), course, trial, miss));
            } else {
                // No better: again from the best motion so far, by less of its miss.
                damping *= DAMPED;
            }
            let Some((least, start, _, miss)) = &best else { break };
            if *least <= tolerance_mm {
                break;
            }
            // A miss aside turns the line, one ahead changes its depth: neither affects the other much, so that one run
            // corrects both.
            let ahead = miss.dot(&start.along);
            let aim = start.end() + (miss - start.along * ahead) * damping;
            course = Course {
                depth_mm: start.depth_mm,
                back_mm: start.back_mm,
                ..start.aimed(&guide::aim(self.scenario, aim))
            };
            if start.back_mm > 0.0 {
                course.back_mm = (start.back_mm - damping * ahead).max(0.0)
            } else {
                course.depth_mm += damping * ahead
            }
        }
        Ok(best.map_or((start, Trial::default()), |(_, course, trial, _)| (course, trial)))
    }
}

impl Course {
    fn at(&self, meeting: &Meeting) -> Self {
        Self {
            depth_mm: meeting.depth_mm,
            back_mm: meeting.back_mm,
            ..*self
        }
    }
}

/// Step of the aim across the needle that takes a miss away.
fn step(gain: &Matrix2<f64>, direction: &Vector3<f64>, aside: &Vector3<f64>) -> Vector3<f64> {
    let axes = across(direction);
    let miss = Vector2::from(axes.map(|axis| axis.dot(aside)));
    let step = gain.try_inverse().map_or(miss, |inverse| -inverse * miss);
    axes[0] * step.x + axes[1] * step.y
}

/// End of a run at which the tip and the target meet.
struct Met {
    /// Travel at which they are level, mm.
    travel_mm: f64,
    /// Travel at the end, mm.
    end_mm: f64,
    /// Distance of the target in front of the tip at the end, mm.
    ahead_mm: f64,
    /// Advance relative to the target between the last two samples, mm.
    advance_mm: f64,
    aside: Vector3<f64>,
}

/// Interpolates between the last two samples, of which the last is the first beyond the target in the direction of
/// travel.
fn met(samples: &[Sample], direction: &Vector3<f64>) -> Met {
    let ahead = |sample: &Sample| sample.miss.dot(direction);
    let aside = |sample: &Sample| sample.miss - direction * ahead(sample);
    let Some(after) = samples.last() else {
        return Met {
            travel_mm: 0.0,
            end_mm: 0.0,
            ahead_mm: 0.0,
            advance_mm: 0.0,
            aside: Vector3::zeros(),
        };
    };
    let before = samples.len().checked_sub(2).map_or(after, |index| &samples[index]);
    let (before_mm, after_mm) = (ahead(before), ahead(after));
    let share = if before_mm > 0.0 && after_mm <= 0.0 {
        before_mm / (before_mm - after_mm)
    } else {
        1.0
    };
    Met {
        travel_mm: before.travel_mm + share * (after.travel_mm - before.travel_mm),
        end_mm: after.travel_mm,
        ahead_mm: after_mm,
        advance_mm: before_mm - after_mm,
        aside: aside(before) * (1.0 - share) + aside(after) * share,
    }
}
