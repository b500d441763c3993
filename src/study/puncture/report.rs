//! Output of a puncture as text, table and plot.

use super::{NAMES, Puncture};
use crate::base::output::OutputError;
use crate::base::report::plot::{Axis, Plot, Series};

impl Puncture {
    /// Returns a CSV table with one row per step.
    pub fn csv(&self) -> String {
        let mut text = "travel_mm,time_s,force_n,tip_n,depth_mm,vein_mm,punctured\n".to_owned();
        for row in &self.rows {
            let punctured = row.punctured.map_or(String::new(), |layer| layer.to_string());
            text += &format!(
                "{},{},{},{},{},{},{punctured}\n",
                row.travel_mm, row.time_s, row.force_n, row.tip_n, row.depth_mm, row.vein_mm
            );
        }
        text
    }

    /// Describes the punctures in words.
    pub fn text(&self) -> String {
        let mut text = String::new();
        for (at, row) in self.rows.iter().enumerate() {
            let Some(layer) = row.punctured else { continue };
            let after = self.rows.get(at + 1).map_or(row.force_n, |row| row.force_n);
            text += &format!(
                "{:<10} punctured at {:>5.1} mm: {:.3} N, then {after:.3} N; the vein is {:.1} mm high\n",
                NAMES.get(layer).copied().unwrap_or("layer"),
                row.travel_mm,
                row.force_n,
                row.vein_mm
            );
        }
        text
    }
}

/// Plots the force against the needle's travel for several runs.
///
/// # Errors
/// [`OutputError`] if the plot cannot be drawn.
pub fn curves(runs: &[(&str, &Puncture)]) -> Result<String, OutputError> {
    let series = runs.iter().enumerate().map(|(colour, (name, run))| {
        let points = run.rows.iter().map(|row| [row.travel_mm, row.force_n]);
        Series::line(*name, colour, points.collect())
    });
    let [x, y] = ["travel of the needle, mm", "force on the needle, N"].map(Axis::linear);
    Plot::new("A needle pushes, punctures and cuts", x, y, series.collect()).svg()
}
