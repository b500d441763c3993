//! Displacements of the reported points: table and curves.

use std::io::{self, Write};

use super::curves::{Curve, STRETCHES};
use crate::input::scenario::Scenario;
use crate::input::scenario::reported_points::{COMPONENTS, Displaced};
use insonify_report::plot::{Axis, Plot};

/// Names and titles of the plots.
const PLOTS: [(&str, &str); 3] = [
    (
        "displacement_axial",
        "Displacement of points, axial (positive away from the array)",
    ),
    (
        "displacement_lateral",
        "Displacement of points, lateral (positive towards the marked side)",
    ),
    (
        "displacement_elevational",
        "Displacement of points, elevational (along the normal of the image)",
    ),
];

/// Curves of each point: axial, lateral and elevational.
#[derive(Clone, Debug)]
pub(super) struct Points {
    names: Vec<String>,
    curves: Vec<[Curve; 3]>,
    moments_a_stretch: u64,
    moments: u64,
}

impl Points {
    pub(super) fn new(scenario: &Scenario) -> Self {
        let moments = scenario.timing.moments(scenario.timing.frame_s);
        Self {
            names: scenario.reports.iter().map(|point| point.name.clone()).collect(),
            curves: scenario.reports.iter().map(|_| <[Curve; 3]>::default()).collect(),
            moments_a_stretch: moments.div_ceil(STRETCHES).max(1),
            moments: 0,
        }
    }

    /// Writes the header line of `points.csv`.
    pub(super) fn head(&self, out: &mut impl Write) -> io::Result<()> {
        write!(out, "time_s,inserted_mm")?;
        for name in &self.names {
            COMPONENTS
                .iter()
                .try_for_each(|axis| write!(out, ",{name}_{axis}_mm"))?;
        }
        writeln!(out)
    }

    /// Adds a moment, and writes its line of `points.csv`.
    pub(super) fn add(&mut self, displaced: &Displaced<'_>, out: &mut impl Write) -> io::Result<()> {
        let starts = self.moments.is_multiple_of(self.moments_a_stretch);
        self.moments += 1;
        write!(out, "{},{:.6}", displaced.time_s, displaced.inserted_mm)?;
        for (curves, moved) in self.curves.iter_mut().zip(displaced.displacement_mm) {
            moved.iter().try_for_each(|value| write!(out, ",{value:.6}"))?;
            for (curve, value) in curves.iter_mut().zip(&moved[3..]) {
                curve.add(displaced.time_s, *value, starts);
            }
        }
        writeln!(out)
    }

    /// Plots of the components in the image, with a line for each point; none without points.
    pub(super) fn plots(&self) -> Vec<(&'static str, Plot)> {
        let plot = |(component, (file, title)): (usize, (&'static str, &str))| {
            let curves = self.names.iter().zip(&self.curves).enumerate();
            let series = curves.map(|(index, (name, curves))| curves[component].series(name, index));
            let y = Axis::linear("displacement, mm");
            let plot = Plot::new(title, Axis::linear("simulated time, s"), y, series.collect());
            (file, plot)
        };
        let plots = PLOTS.into_iter().enumerate().map(plot);
        plots.filter(|_| !self.names.is_empty()).collect()
    }
}
