//! Analysis by synthesis: probe and effects estimated from a single real frame, so that rendered frames resemble it.
//!
//! The sector's outline gives the probe ([`outline`]). The frame is resampled to scanlines by samples, and the standard
//! deviation of grey levels, the widths of the autocorrelation and the mean are measured in its most uniform windows
//! over depth. A uniform phantom is rendered under the same probe, resampled to the same windows and measured in the
//! same way. Parameters are then corrected by the ratios of these figures until they agree: dynamic range by that of
//! the standard deviations, lengths of the point spread by that of the widths, and the gain at each depth by the
//! difference of the means. Finally, dark windows are compared with those of a phantom without echoes, for noise and
//! clutter. Windowing, log compression and blur affect both sides equally.
//!
//! Automatic gain is off and the grey-level curve straight: both depend on the content of the frame, and only under a
//! straight curve does a spread of grey levels give a dynamic range. Compensation is twice the 0.5 dB/cm/MHz of soft
//! tissue plus the frame's departure from it, so that other tissue keeps its own loss.

mod bench;
mod correct;
mod findings;
mod model;
pub mod outline;
mod report;

use serde::Serialize;

use super::realism::picture::Picture;
use super::realism::sector_of;
use super::realism::texture::Texture;
use bench::{Bench, WINDOW};
use correct::MAX_RANGE_DB;
use insonify::Error;
use insonify_anatomy::volume::{At, VolumeError};
use insonify_base::stage::{self, Extent};
use insonify_imaging::anatomies::PLAIN;
use insonify_imaging::effects::Effects;
use model::Model;
use outline::{Outline, Shape};

/// Maximum number of correction rounds; one more follows with noise and clutter.
const ROUNDS: usize = 6;
/// Relative change in all figures (gain: in tenths of a dB) below which rounds stop.
const SETTLED: f64 = 0.02;

/// Parameter estimated from the frame.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct EstimatedParameter {
    /// Key in a scene file.
    pub key: &'static str,
    /// Unit of the value.
    pub unit: &'static str,
    /// Estimated value.
    pub value: f64,
    /// Standard deviation over the windows; `None` for a figure that is not measured in windows.
    pub spread: Option<f64>,
}

/// Parameter that the frame does not identify.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Unidentified {
    /// Name of the parameter.
    pub what: &'static str,
    /// Reason, and the value used in the scene instead.
    pub why: String,
}

/// Means over the windows at one depth.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DepthMeasurements {
    /// Mean depth of the windows, mm.
    pub depth_mm: f64,
    /// Number of windows.
    pub windows: usize,
    /// Mean grey level.
    pub grey: f64,
    /// Standard deviation of detrended grey levels.
    pub grey_std: f64,
    /// Full width at half maximum of the autocorrelation along the beam, mm; `None` if it stays above one half.
    pub axial_mm: Option<f64>,
    /// Full width at half maximum of the autocorrelation across the beam, mm; `None` if it stays above one half.
    pub lateral_mm: Option<f64>,
}

/// Measurements in the windows of the real frame or of a phantom.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WindowMeasurements {
    /// Means over the windows, by depth.
    pub depths: Vec<DepthMeasurements>,
    /// Share of the windows' pixels at each grey level.
    pub histogram: Vec<f64>,
    /// Share of the sector's pixels at each grey level.
    pub sector_histogram: Vec<f64>,
    /// Mean autocorrelation along the beam, by lag in samples.
    pub autocorrelation_axial: Vec<f64>,
    /// Mean autocorrelation across the beam, by lag in scanlines.
    pub autocorrelation_lateral: Vec<f64>,
    /// Windows of all frames, by depth.
    #[serde(skip)]
    windows: Vec<Vec<Texture>>,
    /// First frame.
    #[serde(skip)]
    frame: Picture,
}

/// Wasserstein-1 distance of grey-level histograms from those of the real frame (mean difference of equal quantiles),
/// grey levels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct HistogramDistance {
    /// Distance over the windows.
    pub windows: f64,
    /// Distance over the whole sector, whose anatomy a uniform phantom lacks.
    pub sector: f64,
}

/// Real frame and the model matched to it.
#[derive(Clone, Debug, Serialize)]
pub struct Match {
    /// Name of the frame.
    pub name: String,
    /// Pixel size, mm.
    pub mm_per_pixel: f64,
    /// Outline of the sector, pixels.
    pub sector: Outline,
    /// Number of correction rounds.
    pub rounds: usize,
    /// Largest relative change of a figure in the last round (gain: in tenths of a dB).
    pub residual: f64,
    /// Estimated figures.
    pub figures: Vec<EstimatedParameter>,
    /// Parameters that the frame does not identify.
    pub unidentified: Vec<Unidentified>,
    /// Reasons to doubt the result.
    pub notes: Vec<String>,
    /// Measurements of the real frame.
    pub real: WindowMeasurements,
    /// Measurements of the uniform phantom with the estimated figures.
    pub matched: WindowMeasurements,
    /// Measurements of the uniform phantom with the default effects of the probe type.
    pub default: WindowMeasurements,
    /// Distance of the phantom with the estimated figures from the real frame.
    pub score: HistogramDistance,
    /// Distance of the phantom with default effects from the real frame.
    pub default_score: HistogramDistance,
    /// Scene text with the figures found, ready to render, on a phantom that stands in for the real anatomy.
    pub scene: String,
}

/// Returns the Wasserstein-1 distance of two histograms: the area between their cumulative sums.
fn distance(a: &[f64], b: &[f64]) -> f64 {
    let mut ahead = 0.0;
    let steps = a.iter().zip(b).map(|(a, b)| {
        ahead += a - b;
        f64::abs(ahead)
    });
    steps.sum()
}

fn refuse(picture: &Picture, fault: &str, expected: &str) -> VolumeError {
    VolumeError::malformed(picture.name.as_ref(), At::Pixels, fault, expected)
}

/// Side of a pixel, mm, from the depth shown by the middle scanline (mm), or from the frame.
fn pixel_mm(picture: &Picture, outline: Outline, depth_mm: Option<f64>) -> Result<f64, VolumeError> {
    let shown_px = match outline.shape {
        Shape::Rectangle { rows, .. } => rows[1] - rows[0],
        // The picture may cut the far edge.
        Shape::Fan { apex, radii, .. } => radii[1].min(picture.height as f64 - 0.5 - apex[1]) - radii[0],
    };
    match (depth_mm, picture.mm) {
        (Some(depth_mm), _) => Ok(depth_mm / shown_px),
        (None, Some([x, y])) if (x / y - 1.0).abs() < 0.01 => Ok(0.5 * (x + y)),
        (None, Some([x, y])) => Err(refuse(
            picture,
            &format!("pixels of {x} x {y} mm"),
            "square ones: scale the frame",
        )),
        (None, None) => {
            let expected =
                "--mm-per-pixel, --depth-mm, or a sidecar beside the frame (scales in the picture are not read)";
            Err(refuse(picture, "no size of its pixels", expected))
        }
    }
}

/// Estimates probe and effects from a frame with the array at its top. The pixel size is taken from the frame, or from
/// `depth_mm`, the depth shown by its middle scanline, mm. A dynamic range `range_db` is taken as stated, dB; else it
/// is estimated, or where the scanner has smoothed the speckle too much for that, is the default.
///
/// # Errors
/// [`VolumeError`] for a frame that is too small, or lacks a sector of lines and arcs, speckle, or a known pixel size.
pub fn fit(picture: &Picture, depth_mm: Option<f64>, range_db: Option<f64>, seed: u64) -> Result<Match, Error> {
    let mask = sector_of(picture)?;
    let Some(outline) = Outline::of(&mask, picture.width) else {
        let expected = "a fan or a rectangle, the array at the top: turn frames with the array at the bottom upside down, and crop frames to \
             the part that shows echoes";
        return Err(refuse(picture, "a sector whose edges are no lines and arcs", expected).into());
    };
    let mm = pixel_mm(picture, outline, depth_mm)?;
    let mut bench = Bench::new(picture, mask, outline, mm, range_db, seed)?;
    if bench.windows.is_empty() {
        let wrong = "no window of speckle in the sector";
        let expected = format!(
            "one of {} scanlines by {} samples of mean grey 20 to 200",
            WINDOW[0], WINDOW[1]
        );
        return Err(refuse(picture, wrong, &expected).into());
    }
    let real = bench.measure(vec![picture.clone()]);
    let stage = stage::enter("matching", Extent::Share(0.0));
    let mut model = Model::start(&bench.probe);
    let default = bench.measure(bench.phantoms(bench.probe, &Effects::usual(), PLAIN)?);
    let phantom = |bench: &Bench, model: &Model| -> Result<WindowMeasurements, Error> {
        Ok(bench.measure(bench.phantoms(model.probe(bench.probe), &model.effects(), PLAIN)?))
    };
    let (mut rounds, mut residual) = (0, f64::INFINITY);
    while rounds < ROUNDS && residual > SETTLED {
        let rendered = phantom(&bench, &model)?;
        residual = bench.correct(&mut model, &real, &rendered);
        rounds += 1;
        stage.share(rounds as f64 / (ROUNDS + 2) as f64);
    }
    stage.share(ROUNDS as f64 / (ROUNDS + 2) as f64);
    let dark = bench.darkness(&mut model)?;
    // Noise and clutter add to the windows too.
    let rendered = phantom(&bench, &model)?;
    residual = bench.correct(&mut model, &real, &rendered);
    rounds += 1;
    let matched = phantom(&bench, &model)?;
    let score = |measure: &WindowMeasurements| HistogramDistance {
        windows: distance(&measure.histogram, &real.histogram),
        sector: distance(&measure.sector_histogram, &real.sector_histogram),
    };
    let (score, default_score) = (score(&matched), score(&default));
    let mut notes = bench.notes(&real, &matched, residual);
    if let (None, Some(range_db)) = (range_db, bench.range_db) {
        notes.push(format!(
            "the dynamic range cannot be known: grey levels are more even than speckle of {MAX_RANGE_DB} dB, as the scanner has smoothed the \
             frame (compounding, speckle reduction); the scene has {range_db} dB and so harder speckle: state the scanner's, \
             --set effects.tone.dynamic_range_db=DB"
        ));
    }
    let mut result = Match {
        name: picture.name.clone(),
        mm_per_pixel: mm,
        sector: outline,
        rounds,
        residual,
        figures: bench.figures(&model, &real, &matched, dark),
        unidentified: bench.unidentified(&model, &real, outline, dark),
        notes,
        real,
        matched,
        default,
        score,
        default_score,
        scene: String::new(),
    };
    result.scene = result.written(&bench.scene(&model));
    Ok(result)
}

#[cfg(test)]
mod tests;
