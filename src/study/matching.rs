//! Analysis by synthesis: probe and effects with which frames look like a real one, estimated from that frame alone.
//!
//! The sector's outline gives the probe ([`outline`]). The frame is resampled to scanlines by samples, and its most uniform windows over depth are
//! measured: standard deviation of grey levels, widths of the autocorrelation, mean. A uniform phantom is rendered under the same probe, resampled
//! to the same windows and measured in the same way, and parameters are corrected by the ratios of the figures until these agree: dynamic range
//! by that of standard deviations, lengths of the point spread by those of widths, the gain at each depth by the difference of means. Then
//! dark windows are put against those of a phantom that does not echo, for noise and clutter. Whatever a window, a log scale or a blur does to a figure
//! it does to both sides.
//!
//! Automatic gain is off and the curve straight: both depend on what is in the frame, and a straight curve is the one under which a spread of grey
//! levels is a dynamic range. Compensation is twice 0.5 dB/cm/MHz of soft tissue plus what the frame departs from that, so that other tissue keeps
//! its own loss.

mod bench;
mod correct;
mod findings;
mod model;
pub mod outline;
mod report;

use serde::Serialize;

use super::anatomies::PLAIN;
use super::realism::picture::Picture;
use super::realism::sector_of;
use super::realism::texture::Texture;
use crate::effects::Effects;
use crate::error::Error;
use crate::volume::{At, VolumeError};
use bench::{Bench, WINDOW};
use model::Model;
use outline::{Outline, Shape};

/// Rounds of correction at most, before one more with noise and clutter, and the change in all figures below which they end (gain: as many
/// tenths of a dB).
const ROUNDS: usize = 6;
const SETTLED: f64 = 0.02;

/// A figure of the frame.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Figure {
    /// Its key in a scene.
    pub key: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// Its value.
    pub value: f64,
    /// Its standard deviation over windows; none of a figure that is not made of windows.
    pub spread: Option<f64>,
}

/// A parameter that the frame does not identify.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Unidentified {
    /// Name of the parameter.
    pub what: &'static str,
    /// Reason, and the value that the scene has instead.
    pub why: String,
}

/// Means over the windows at one depth.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AtDepth {
    /// Their mean depth, mm.
    pub depth_mm: f64,
    /// Number of windows.
    pub windows: usize,
    /// Mean grey level.
    pub grey: f64,
    /// Standard deviation of grey levels, a trend removed.
    pub grey_std: f64,
    /// Full width at half maximum of the autocorrelation along the beam, mm; none where it stays above one half.
    pub axial_mm: Option<f64>,
    /// The same across.
    pub lateral_mm: Option<f64>,
}

/// Measurements on the windows of the real frame or of its phantoms.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Side {
    /// By depth.
    pub depths: Vec<AtDepth>,
    /// Shares of the windows at each grey level.
    pub histogram: Vec<f64>,
    /// The same of the sector.
    pub sector_histogram: Vec<f64>,
    /// Mean autocorrelation along the beam, each sample.
    pub autocorrelation_axial: Vec<f64>,
    /// The same across, each scanline.
    pub autocorrelation_lateral: Vec<f64>,
    /// Windows by depth, of all frames.
    #[serde(skip)]
    windows: Vec<Vec<Texture>>,
    /// The first frame.
    #[serde(skip)]
    frame: Picture,
}

/// Distance of histograms of grey levels from those of the real frame (Wasserstein-1: mean difference of equal quantiles), grey levels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Score {
    /// Of the windows.
    pub windows: f64,
    /// Of the whole sector, whose anatomy a uniform phantom has not.
    pub sector: f64,
}

/// A real frame and what it is matched by.
#[derive(Clone, Debug, Serialize)]
pub struct Match {
    /// The frame.
    pub name: String,
    /// Side of a pixel, mm.
    pub mm_per_pixel: f64,
    /// The sector in pixels.
    pub sector: Outline,
    /// Rounds of correction.
    pub rounds: usize,
    /// The largest share by which a figure changed in the last one (gain: as many tenths of a dB).
    pub residual: f64,
    /// Every figure.
    pub figures: Vec<Figure>,
    /// Parameters that the frame does not identify.
    pub unidentified: Vec<Unidentified>,
    /// Doubts about this frame.
    pub notes: Vec<String>,
    /// The real frame.
    pub real: Side,
    /// The uniform phantom with the figures found.
    pub matched: Side,
    /// The uniform phantom with the default effects of the kind of probe.
    pub default: Side,
    /// How far the phantom with the figures found is from the real frame.
    pub score: Score,
    /// How far that with default effects is.
    pub default_score: Score,
    /// A scene that can be rendered: the figures, under a phantom to be replaced.
    pub scene: String,
}

/// Wasserstein-1 distance of two histograms: the area between their sums.
fn distance(a: &[f64], b: &[f64]) -> f64 {
    let mut ahead = 0.0;
    let steps = a.iter().zip(b).map(|(a, b)| {
        ahead += a - b;
        f64::abs(ahead)
    });
    steps.sum()
}

fn refuse(picture: &Picture, found: &str, expected: &str) -> VolumeError {
    VolumeError::malformed(picture.name.as_ref(), At::Pixels, found, expected)
}

/// Estimates probe and effects from a frame with its array at the top. The size of a pixel is the frame's, or follows from the depth that its
/// middle scanline shows, mm.
///
/// # Errors
/// [`VolumeError`] for a frame that is too small, has no sector of lines and arcs, no speckle, or no size of its pixels.
pub fn fit(picture: &Picture, depth_mm: Option<f64>, seed: u64) -> Result<Match, Error> {
    let mask = sector_of(picture)?;
    let Some(outline) = Outline::of(&mask, picture.width) else {
        let expected =
            "a fan or a rectangle, the array at the top: turn frames with the array at the bottom upside down";
        return Err(refuse(picture, "a sector whose edges are no lines and arcs", expected).into());
    };
    let shown = match outline.shape {
        Shape::Rectangle { rows, .. } => rows[1] - rows[0],
        Shape::Fan { apex, radii, .. } => radii[1].min(picture.height as f64 - 0.5 - apex[1]) - radii[0],
    };
    let mm = match (depth_mm, picture.mm) {
        (Some(depth_mm), _) => depth_mm / shown,
        (None, Some([x, y])) if (x / y - 1.0).abs() < 0.01 => 0.5 * (x + y),
        (None, Some([x, y])) => {
            return Err(refuse(
                picture,
                &format!("pixels of {x} x {y} mm"),
                "square ones: scale the frame",
            )
            .into());
        }
        (None, None) => {
            let expected =
                "--mm-per-pixel, --depth-mm, or a sidecar beside the frame (scales in the picture are not read)";
            return Err(refuse(picture, "no size of its pixels", expected).into());
        }
    };
    let bench = Bench::new(picture, mask, outline, mm, seed)?;
    if bench.windows.is_empty() {
        let found = "no window of speckle in the sector";
        let expected = format!(
            "one of {} scanlines by {} samples of mean grey 20 to 200",
            WINDOW[0], WINDOW[1]
        );
        return Err(refuse(picture, found, &expected).into());
    }
    let real = bench.side(vec![picture.clone()]);
    let mut model = Model::start(&bench.probe);
    let default = bench.side(bench.phantoms(bench.probe, &Effects::usual(), PLAIN)?);
    let phantom = |model: &Model| -> Result<Side, Error> {
        Ok(bench.side(bench.phantoms(model.probe(bench.probe), &model.effects(), PLAIN)?))
    };
    let (mut rounds, mut residual) = (0, f64::INFINITY);
    while rounds < ROUNDS && residual > SETTLED {
        let own = phantom(&model)?;
        residual = bench.correct(&mut model, &real, &own);
        rounds += 1;
    }
    let dark = bench.darkness(&mut model)?;
    // Noise and clutter lie over the windows too.
    let own = phantom(&model)?;
    residual = bench.correct(&mut model, &real, &own);
    rounds += 1;
    let matched = phantom(&model)?;
    let score = |side: &Side| Score {
        windows: distance(&side.histogram, &real.histogram),
        sector: distance(&side.sector_histogram, &real.sector_histogram),
    };
    let (score, default_score) = (score(&matched), score(&default));
    let mut found = Match {
        name: picture.name.clone(),
        mm_per_pixel: mm,
        sector: outline,
        rounds,
        residual,
        figures: bench.figures(&model, &real, &matched, dark),
        unidentified: bench.unidentified(&model, &real, outline, dark),
        notes: bench.notes(&real, &matched, residual),
        real,
        matched,
        default,
        score,
        default_score,
        scene: String::new(),
    };
    found.scene = found.written(&bench.scene(&model));
    Ok(found)
}

#[cfg(test)]
mod tests;
