//! Record of a run: a table of its steps, plots, and a report page.

mod curves;
mod film;
mod page;
mod points;
mod profile;
mod table;

use std::io::{self, Write};
use std::sync::Arc;

use super::summary::Summary;
use super::{Moment, Step};
use crate::input::scenario::Scenario;
use crate::input::scenario::manipulator::GuideMotion;
use crate::input::scenario::reported_points::Displaced;
use curves::Curves;
use film::Film;
use insonify_base::output::OutputError;
use insonify_imaging::synth::Frame;
use insonify_report::plot::Plot;
use nalgebra::Point3;
use points::Points;
use profile::Profiles;

/// Names of the plots of every run.
const PLOTS: [&str; 4] = ["forces", "tip", "paths", "step_time"];

/// Data of a run kept for its plots, of bounded size whatever the length of the run.
#[derive(Clone, Debug)]
pub struct Record {
    curves: Curves,
    profiles: Profiles,
    points: Points,
    /// Columns of `steps.csv`.
    head: String,
    film: Film,
    targets: Vec<Point3<f64>>,
    manipulator: Option<Arc<GuideMotion>>,
    start_s: f64,
    /// Depth of the tip and its distance from the nearest target at the last step, mm.
    last_step: (f64, Option<f64>),
}

impl Record {
    /// Creates the record of a run of `scenario`.
    pub fn new(scenario: &Scenario) -> Self {
        Self {
            curves: Curves::new(scenario),
            profiles: Profiles::default(),
            points: Points::new(scenario),
            head: table::head(
                scenario.contact().map(|contact| &contact.probe),
                scenario.manipulator.is_some(),
            ),
            film: Film::new(scenario.timing.moments(scenario.timing.frame_s)),
            targets: scenario.targets.iter().map(|target| target.at_mm).collect(),
            manipulator: scenario.manipulator.clone(),
            start_s: scenario.timing.start_s,
            last_step: (0.0, None),
        }
    }

    /// Writes the header line of `steps.csv`.
    ///
    /// # Errors
    /// Errors of the output.
    pub fn head(&self, out: &mut impl Write) -> io::Result<()> {
        writeln!(out, "{}", self.head)
    }

    /// Records a step and writes its line of `steps.csv`.
    ///
    /// # Errors
    /// Errors of the output.
    pub fn step(&mut self, step: &Step<'_>, out: &mut impl Write) -> io::Result<()> {
        let outcome = step.outcome;
        let tip = outcome.tip_at_rest_mm.unwrap_or(outcome.tip_mm);
        let distances = self.targets.iter().map(|target| (tip - target).norm());
        self.last_step = (outcome.inserted_mm, distances.reduce(f64::min));
        self.curves.add(step, self.last_step.1);
        self.profiles.add(step);
        let guided = self
            .manipulator
            .as_ref()
            .map(|guided| (&**guided, guided.at(self.start_s + step.time_s)));
        table::row(step, guided, out)
    }

    /// Records a frame if the page shows it.
    pub fn frame(&mut self, moment: &Moment<'_>, frame: &Frame) {
        let (inserted_mm, target_mm) = self.last_step;
        self.film
            .add(frame, moment.number, moment.time_s, inserted_mm, target_mm);
    }

    /// Writes the header line of `points.csv`.
    ///
    /// # Errors
    /// Errors of the output.
    pub fn points_head(&self, out: &mut impl Write) -> io::Result<()> {
        self.points.head(out)
    }

    /// Records the displacements of the reported points and writes their line of `points.csv`.
    ///
    /// # Errors
    /// Errors of the output.
    pub fn points(&mut self, displaced: &Displaced<'_>, out: &mut impl Write) -> io::Result<()> {
        self.points.add(displaced, out)
    }

    /// Plots with their names: over simulated time forces, tip, paths, step times, and the displacements of reported
    /// points; and the force along the needle, once it has met tissue.
    pub fn plots(&self) -> Vec<(&'static str, Plot)> {
        let mut plots: Vec<_> = PLOTS.into_iter().zip(self.curves.plots()).collect();
        let profile = self.profiles.plot().map(|plot| ("profile", plot));
        plots.splice(3..3, profile.into_iter().chain(self.points.plots()));
        plots
    }

    /// Self-contained HTML page with summary, frames and plots; `others` are files beside it that it links to.
    ///
    /// # Errors
    /// [`OutputError`].
    pub fn page(&self, title: &str, summary: &Summary, others: &[&str]) -> Result<String, OutputError> {
        page::page(title, summary, &self.film, &self.plots(), others)
    }
}
