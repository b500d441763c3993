//! What is written of a run: a table of its steps, plots, and a page that shows them.

mod curves;
mod film;
mod page;
mod table;

use std::io::{self, Write};

use super::resolve::Scenario;
use super::run::{Moment, Step};
use super::summary::Summary;
use crate::study::plot::{Plot, PlotError};
use crate::synth::Frame;
use curves::Curves;
use film::Film;
use nalgebra::Point3;

/// Names of the plots, in the order of [`Record::plots`].
pub const PLOTS: [&str; 3] = ["forces", "tip", "step_time"];

/// What is kept of a run for its plots: as much of a long one as of a short one.
#[derive(Clone, Debug)]
pub struct Record {
    curves: Curves,
    /// Columns of `steps.csv`.
    head: String,
    film: Film,
    targets: Vec<Point3<f64>>,
    /// Depth of the tip and its distance from the nearest target at the last step, mm.
    last: (f64, Option<f64>),
}

impl Record {
    /// Of a run of a scenario.
    pub fn new(scenario: &Scenario) -> Self {
        Self {
            curves: Curves::new(scenario),
            head: table::head(scenario.contact.as_ref().map(|contact| &contact.probe)),
            film: Film::new(scenario.timing.moments(scenario.timing.frame_s)),
            targets: scenario.targets.iter().map(|target| target.at_mm).collect(),
            last: (0.0, None),
        }
    }

    /// Writes the first line of `steps.csv`.
    ///
    /// # Errors
    /// What the system says.
    pub fn head(&self, out: &mut impl Write) -> io::Result<()> {
        writeln!(out, "{}", self.head)
    }

    /// Keeps a step and writes its line of `steps.csv`.
    ///
    /// # Errors
    /// What the system says.
    pub fn step(&mut self, step: &Step<'_>, out: &mut impl Write) -> io::Result<()> {
        let outcome = step.outcome;
        let tip = outcome.tip_at_rest_mm.unwrap_or(outcome.tip_mm);
        let distances = self.targets.iter().map(|target| (tip - target).norm());
        self.last = (outcome.inserted_mm, distances.reduce(f64::min));
        self.curves.add(step, self.last.1);
        table::row(step, out)
    }

    /// Keeps a frame for the page, if it is one that the page shows.
    pub fn frame(&mut self, moment: &Moment<'_>, frame: &Frame) {
        let (inserted_mm, target_mm) = self.last;
        self.film
            .add(frame, moment.number, moment.time_s, inserted_mm, target_mm);
    }

    /// Forces, tip and times of steps over simulated time: see [`PLOTS`].
    pub fn plots(&self) -> [Plot; 3] {
        self.curves.plots()
    }

    /// A page (HTML) that holds summary, frames and plots and asks for nothing else; `others` are files beside it that it points to.
    ///
    /// # Errors
    /// [`PlotError`].
    pub fn page(&self, title: &str, summary: &Summary, others: &[&str]) -> Result<String, PlotError> {
        page::page(title, summary, &self.film, &self.plots(), others)
    }
}
