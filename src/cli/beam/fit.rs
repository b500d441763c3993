//! `insonify beam fit`: material parameters from measurements.

use std::fmt::Write;
use std::path::PathBuf;

use clap::Args;
use insonify_base::csv::CsvError;
use insonify_mechanics::needle::beam::Compression;
use insonify_mechanics::needle::beam::fit::{self, PARTED, Sample};
use insonify_mechanics::needle::beam::material::Law;
use insonify_report::plot::{Axis, Marker, Plot, Series};
use insonify_study::beam_case::points;
use serde_json::{Map, Value, json};

use crate::output::{self, Force};
use crate::terminal;
use crate::variants::variants;
use insonify::Error;

/// Number of points of a curve.
const FINE: usize = 120;
/// Extent of the drawn curves below the data.
const BEYOND: f64 = 0.15;

const EXAMPLES: &str = "\
POINTS.csv has two columns, `stretch` (length over length at rest: below 1 in compression) and `stress_kpa` (negative in
compression), named by a header line or in this order without one; lines that begin with # are left out:
  stretch,stress_kpa
  1.00,0.0
  0.95,-1.98
  0.90,-4.21

Every model is fitted by least squares. R^2 is 1 of a perfect fit. A warning says where, beyond the data, a model is more than
10 % off the median of all: none of them should be trusted from there on.

Examples:
  insonify beam fit points.csv                          engineering stress, as a test machine gives it
  insonify beam fit points.csv --compression UTru       true stress
  insonify beam fit points.csv --json -o fit.svg";

/// Fits every material model to measured stretch and stress
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Fit {
    /// Measurements: columns `stretch` and `stress_kpa`
    #[arg(value_name = "POINTS.csv")]
    points: PathBuf,
    /// Compression of the sample, and the stress measure
    #[arg(long, value_parser = variants::<Compression>(), ignore_case = true, default_value = "UEng")]
    compression: Compression,
    /// Print one JSON object: `compression`, `stretch`, `models` (model, parameters, `r_squared`, `rms_kpa`,
    /// `parts_below`), `warnings`
    #[arg(long)]
    json: bool,
    /// Draw data and models
    #[arg(short, long, value_name = "PLOT.svg")]
    output: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
}

impl Fit {
    pub(super) fn run(&self) -> Result<(), Error> {
        let inputs = [self.points.clone()];
        self.force.check_ending(&self.output, "svg", "plots", &inputs)?;
        let samples = points::read(&self.points)?;
        let fit = fit::Fit::new(&samples, self.compression).map_err(|cause| CsvError::Contents {
            path: self.points.clone(),
            text: cause.to_string(),
        })?;
        let warnings = warnings(&fit);
        warnings.iter().for_each(terminal::warn);
        output::requested(&self.output, || plot(&samples, &fit).svg())?;
        terminal::show(&json(&fit, &warnings), self.json, || text(&fit))
    }
}

fn warnings(fit: &fit::Fit) -> Vec<String> {
    let parted = fit.partings.iter().map(|parting| {
        format!(
            "{}: more than {} % off the median of all models below stretch {:.2}; the data end at {:.2}",
            parting.model,
            100.0 * PARTED,
            parting.stretch,
            fit.range[0]
        )
    });
    let unusable = fit.models.iter().filter_map(|model| {
        let error = model.material.check().err()?;
        Some(format!(
            "{}: `insonify beam` cannot use this fit: {error}",
            model.material.model()
        ))
    });
    parted.chain(unusable).collect()
}

fn text(fit: &fit::Fit) -> String {
    let [low, high] = fit.range;
    let mut text = format!("{}, stretches {low} to {high}\n\n", fit.compression.name());
    let _ = writeln!(text, "{:<14} {:>10} {:>12}  parameters", "model", "R^2", "rms kPa");
    for model in &fit.models {
        let parameters = model
            .material
            .parameters()
            .into_iter()
            .map(|(key, value)| format!("{key} = {value:.6}"));
        let parameters = parameters.collect::<Vec<_>>().join(", ");
        let name = model.material.model();
        let _ = writeln!(
            text,
            "{name:<14} {:>10.6} {:>12.6}  {parameters}",
            model.r_squared, model.rms_kpa
        );
    }
    text
}

fn json(fit: &fit::Fit, warnings: &[String]) -> Value {
    let models = fit.models.iter().map(|model| {
        let mut map = Map::new();
        let name = model.material.model();
        map.insert("model".to_owned(), json!(name));
        for (key, value) in model.material.parameters() {
            map.insert(key.to_owned(), json!(value));
        }
        let parting = fit.partings.iter().find(|parting| parting.model == name);
        map.insert("r_squared".to_owned(), json!(model.r_squared));
        map.insert("rms_kpa".to_owned(), json!(model.rms_kpa));
        map.insert("parts_below".to_owned(), json!(parting.map(|parting| parting.stretch)));
        Value::Object(map)
    });
    json!({
        "compression": fit.compression.name(),
        "stretch": fit.range,
        "models": models.collect::<Vec<_>>(),
        "warnings": warnings,
    })
}

fn plot(samples: &[Sample], fit: &fit::Fit) -> Plot {
    let [low, high] = [(fit.range[0] - BEYOND).max(0.5 * fit.range[0]), fit.range[1].max(1.0)];
    let measured = samples.iter().map(|sample| [1.0 - sample.stretch, sample.stress_kpa]);
    let mut series = vec![Series::points("measured", 6, Marker::Ring, measured.collect())];
    for (colour, model) in fit.models.iter().enumerate() {
        let law = Law::new(&model.material, fit.compression);
        let stretches = (0..=FINE).map(|index| low + (high - low) * index as f64 / FINE as f64);
        let points = stretches.map(|stretch| [1.0 - stretch, law.at(stretch).stress_kpa]);
        series.push(Series::line(model.material.model(), colour, points.collect()));
    }
    let title = format!("Materials fitted to measurements, {}", fit.compression.name());
    let [x, y] = ["compression, 1 - stretch", "stress, kPa"].map(Axis::linear);
    Plot::new(title, x, y, series)
}
