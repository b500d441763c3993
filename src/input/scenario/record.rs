//! Record of a run: a table of its steps, plots, and a report page.

mod curves;
mod film;
mod page;
mod table;

use std::io::{self, Write};
use std::sync::Arc;

use super::manipulator::Guided;
use super::resolve::Scenario;
use super::run::{Moment, Step};
use super::summary::Summary;
use crate::base::output::OutputError;
use crate::base::report::plot::Plot;
use crate::imaging::synth::Frame;
use curves::Curves;
use film::Film;
use nalgebra::Point3;

/// Names of the plots, in the order of [`Record::plots`].
pub const PLOTS: [&str; 3] = ["forces", "tip", "step_time"];

/// Data of a run kept for its plots, of bounded size whatever the length of the run.
#[derive(Clone, Debug)]
pub struct Record {
    curves: Curves,
    /// Columns of `steps.csv`.
    head: String,
    film: Film,
    targets: Vec<Point3<f64>>,
    manipulator: Option<Arc<Guided>>,
    start_s: f64,
    /// Depth of the tip and its distance from the nearest target at the last step, mm.
    last: (f64, Option<f64>),
}

impl Record {
    /// Creates the record of a run of `scenario`.
    pub fn new(scenario: &Scenario) -> Self {
        Self {
            curves: Curves::new(scenario),
            head: table::head(
                scenario.contact.as_ref().map(|contact| &contact.probe),
                scenario.manipulator.is_some(),
            ),
            film: Film::new(scenario.timing.moments(scenario.timing.frame_s)),
            targets: scenario.targets.iter().map(|target| target.at_mm).collect(),
            manipulator: scenario.manipulator.clone(),
            start_s: scenario.timing.start_s,
            last: (0.0, None),
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
        self.last = (outcome.inserted_mm, distances.reduce(f64::min));
        self.curves.add(step, self.last.1);
        let guided = self
            .manipulator
            .as_ref()
            .map(|guided| (&**guided, guided.at(self.start_s + step.time_s)));
        table::row(step, guided, out)
    }

    /// Records a frame if the page shows it.
    pub fn frame(&mut self, moment: &Moment<'_>, frame: &Frame) {
        let (inserted_mm, target_mm) = self.last;
        self.film
            .add(frame, moment.number, moment.time_s, inserted_mm, target_mm);
    }

    /// Plots of forces, tip and step times over simulated time: see [`PLOTS`].
    pub fn plots(&self) -> [Plot; 3] {
        self.curves.plots()
    }

    /// Self-contained HTML page with summary, frames and plots; `others` are files beside it that it links to.
    ///
    /// # Errors
    /// [`OutputError`].
    pub fn page(&self, title: &str, summary: &Summary, others: &[&str]) -> Result<String, OutputError> {
        page::page(title, summary, &self.film, &self.plots(), others)
    }
}
