//! What is written of a run: a table of its steps, plots, and a page that shows them.

mod curves;
mod page;
mod table;

use std::io::{self, Write};

use super::resolve::Scenario;
use super::run::Step;
use super::summary::Summary;
use crate::study::plot::{Plot, PlotError};
use curves::Curves;

/// Names of the plots, in the order of [`Record::plots`].
pub const PLOTS: [&str; 3] = ["forces", "tip", "step_time"];

/// What is kept of a run for its plots: as much of a long one as of a short one.
#[derive(Clone, Debug)]
pub struct Record {
    curves: Curves,
    /// Whether the probe is driven at two points.
    driven: bool,
}

impl Record {
    /// Of a run of a scenario.
    pub fn new(scenario: &Scenario) -> Self {
        Self {
            curves: Curves::new(scenario.timing.steps, scenario.contact.is_some()),
            driven: scenario
                .contact
                .iter()
                .any(|contact| contact.probe.driven_at_mm.is_some()),
        }
    }

    /// Writes the first line of `steps.csv`.
    ///
    /// # Errors
    /// What the system says.
    pub fn head(&self, out: &mut impl Write) -> io::Result<()> {
        table::head(self.driven, out)
    }

    /// Keeps a step and writes its line of `steps.csv`.
    ///
    /// # Errors
    /// What the system says.
    pub fn step(&mut self, step: &Step<'_>, out: &mut impl Write) -> io::Result<()> {
        self.curves.add(step);
        table::row(step, out)
    }

    /// Forces, tip and times of steps over simulated time: see [`PLOTS`].
    pub fn plots(&self) -> [Plot; 3] {
        self.curves.plots()
    }

    /// A page (HTML) that holds summary and plots and asks for nothing else.
    ///
    /// # Errors
    /// [`PlotError`].
    pub fn page(&self, title: &str, summary: &Summary) -> Result<String, PlotError> {
        page::page(title, summary, &self.plots())
    }
}
