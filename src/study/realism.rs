//! Comparison with real frames: the same measures on frames and on real frames, and their differences in units of the spread among the real ones.
//!
//! Everything is found from the frames alone, by one algorithm for both sides: the sector ([`sector`]), its most uniform windows and its
//! darkest ones ([`texture`]). Nothing knows of labels. [`MEASURES`] is the one table of what is measured.

mod measures;
pub mod picture;
pub(in crate::study) mod report;
pub mod sector;
pub mod texture;

use rayon::prelude::*;
use serde::Serialize;

use crate::study::spread::percentile;
use crate::study::statistics::{correlation, mean, std};
use crate::volume::{At, VolumeError};
pub use measures::{MEASURES, Measure};
use picture::Picture;
use texture::{Patch, Texture, Window, dark_windows, uniform_windows};

/// Side of the uniform windows, pixels.
pub const WINDOW: usize = 48;
/// Side of the dark windows, pixels.
pub const DARK_WINDOW: usize = 32;
/// Windows of each kind in a frame.
const WINDOWS: usize = 5;
/// Mean grey levels of uniform windows: of darker ones much is black.
const GREY: [f64; 2] = [45.0, 200.0];
/// Side of the windows that are cut into blocks of 4 and 8 mm, mm.
const BLOCKS_MM: f64 = 24.0;
/// Depth below the array that must not be empty, mm.
const CONTACT_MM: f64 = 5.0;
/// Grey levels of a class of the histogram.
const CLASS: usize = 4;
/// Lags of the autocorrelations that are told, pixels.
const LAGS: usize = 16;
/// Largest difference that counts as inside the spread of the real frames, standard deviations.
pub const LIMIT: f64 = 2.0;

/// Measurements of one frame before [`MEASURES`] make numbers of it.
pub struct Parts {
    /// Distance between rows and between columns, mm.
    mm: Option<[f64; 2]>,
    /// Grey levels in the sector, ascending.
    sector: Vec<f64>,
    /// Its most uniform windows.
    uniform: Vec<Texture>,
    /// Its darkest windows.
    dark: Vec<Texture>,
    /// Spread of the means of blocks of 4 and 8 mm in uniform windows, dB.
    blocks_db: [Option<f64>; 2],
    /// Black share of the strip just below the array.
    empty: Option<f64>,
    /// Boundary behind a dark region.
    edge: Option<sector::Edge>,
    /// Correlation with a neighbouring frame, of dark and of uniform windows.
    frame_correlation: [Option<f64>; 2],
}

impl Parts {
    /// Measures a frame.
    ///
    /// # Errors
    /// [`VolumeError`] for a frame smaller than a window, or without a sector as large as one.
    pub fn of(picture: &Picture) -> Result<Self, VolumeError> {
        let mask = sector_of(picture)?;
        let inside = picture.grey.iter().zip(&mask).filter(|(_, inside)| **inside);
        let mut sector: Vec<f64> = inside.map(|(grey, _)| *grey).collect();
        sector.sort_by(f64::total_cmp);
        let uniform = uniform_windows(picture, &mask, [WINDOW; 2], WINDOWS, GREY);
        let dark = dark_windows(picture, &mask, [DARK_WINDOW; 2], WINDOWS);
        let patch = |window: Window| Patch::of(&picture.grey, picture.width, window);
        let textures = |windows: &[Window]| windows.iter().map(|&window| patch(window).texture()).collect();
        let frame_correlation = |windows: &[Window]| {
            let neighbour = picture.neighbour.as_ref()?;
            average(windows.iter().map(|&window| {
                let other = Patch::of(neighbour, picture.width, window);
                Some(correlation(&patch(window).values, &other.values))
            }))
        };
        let blocks = picture.mm.map(|mm| {
            let size = mm.map(|mm| (BLOCKS_MM / mm).round() as usize);
            uniform_windows(picture, &mask, size, WINDOWS, GREY)
        });
        let spread_of = |across: usize| {
            average(
                blocks
                    .iter()
                    .flatten()
                    .map(|&window| Some(patch(window).block_spread_db(across))),
            )
        };
        Ok(Self {
            mm: picture.mm.map(|[x, y]| [y, x]),
            sector,
            uniform: textures(&uniform),
            dark: textures(&dark),
            blocks_db: [6, 3].map(spread_of),
            empty: sector::empty_share(picture, &mask, CONTACT_MM),
            edge: sector::edge(picture, &mask),
            frame_correlation: [frame_correlation(&dark), frame_correlation(&uniform)],
        })
    }

    fn percentile(&self, share: f64) -> Option<f64> {
        percentile(&self.sector, share)
    }

    /// Share of the sector whose grey levels are such.
    fn share(&self, of: impl Fn(f64) -> bool) -> Option<f64> {
        Some(self.sector.iter().filter(|grey| of(**grey)).count() as f64 / self.sector.len() as f64)
    }
}

/// The sector of a frame.
///
/// # Errors
/// [`VolumeError`] for a frame smaller than a window, or without a sector as large as one.
pub(in crate::study) fn sector_of(picture: &Picture) -> Result<Vec<bool>, VolumeError> {
    let refuse = |found, expected: String| {
        let path = picture.name.as_ref();
        Err(VolumeError::malformed(path, At::Pixels, found, expected))
    };
    let least = WINDOW + 1;
    if picture.width < least || picture.height < least {
        let found = format!("{} x {} pixels", picture.width, picture.height);
        return refuse(found, format!("at least {least} x {least}"));
    }
    let large = |mask: &Vec<bool>| mask.iter().filter(|inside| **inside).count() >= WINDOW * WINDOW;
    match sector::sector(picture).filter(large) {
        Some(mask) => Ok(mask),
        None => {
            let found = "no sector: no connected region of varying grey levels";
            refuse(found.to_owned(), format!("one of at least {WINDOW} x {WINDOW} pixels"))
        }
    }
}

/// Mean of what is known; none where nothing is.
fn average(values: impl Iterator<Item = Option<f64>>) -> Option<f64> {
    let known: Vec<f64> = values.flatten().filter(|value| value.is_finite()).collect();
    (!known.is_empty()).then(|| mean(&known))
}

/// A frame that was measured.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FrameReport {
    /// The file, and of a sequence which frame.
    pub name: String,
    /// Distance between rows and between columns, mm; none where nothing states it.
    pub mm_per_pixel: Option<[f64; 2]>,
    /// Shares of the sector in classes of 4 grey levels.
    pub histogram: Vec<f64>,
    /// Mean autocorrelation of its uniform windows along depth at 0, 1, 2, ... pixels.
    pub autocorrelation_axial: Vec<f64>,
    /// The same across.
    pub autocorrelation_lateral: Vec<f64>,
    #[serde(skip)]
    values: Vec<Option<f64>>,
}

impl FrameReport {
    fn of(picture: &Picture) -> Result<Self, VolumeError> {
        let parts = Parts::of(picture)?;
        let mut histogram = vec![0.0; 256 / CLASS];
        for grey in &parts.sector {
            histogram[*grey as usize / CLASS] += 1.0 / parts.sector.len() as f64;
        }
        let autocorrelation = |axis: usize| {
            let at = |lag: usize| {
                average(
                    parts
                        .uniform
                        .iter()
                        .map(|texture| Some(texture.autocorrelation[axis][lag])),
                )
            };
            (0..=LAGS).map_while(at).collect()
        };
        Ok(Self {
            name: picture.name.clone(),
            mm_per_pixel: parts.mm,
            histogram,
            autocorrelation_axial: autocorrelation(0),
            autocorrelation_lateral: autocorrelation(1),
            values: MEASURES
                .iter()
                .map(|measure| (measure.of)(&parts).filter(|value| value.is_finite()))
                .collect(),
        })
    }
}

/// A measure over the frames of one side.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Figure {
    /// Mean over the frames in which it can be measured.
    pub mean: f64,
    /// Standard deviation over them; none of a single one.
    pub spread: Option<f64>,
    /// The value in each frame; none where it cannot be measured.
    pub values: Vec<Option<f64>>,
}

impl Figure {
    fn of(frames: &[FrameReport], measure: usize) -> Option<Self> {
        let values: Vec<Option<f64>> = frames.iter().map(|frame| frame.values[measure]).collect();
        let known: Vec<f64> = values.iter().flatten().copied().collect();
        Some(Self {
            mean: average(values.iter().copied())?,
            spread: (known.len() > 1).then(|| std(&known)),
            values,
        })
    }
}

/// Whether a measure is as in the real frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// Within [`LIMIT`] spreads of their mean.
    Inside,
    /// Beyond.
    Outside,
}

/// A measure on both sides.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// What is measured.
    #[serde(flatten)]
    pub measure: &'static Measure,
    /// In the frames; none where none shows it.
    pub frames: Option<Figure>,
    /// In the real frames.
    pub real: Option<Figure>,
    /// Mean of the frames less that of the real ones, in units of the spread among these, which counts as at least the measure's floor; none
    /// where only one real frame shows it.
    pub difference: Option<f64>,
    /// What follows from that.
    pub verdict: Option<Verdict>,
}

/// Frames against real frames.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// The frames.
    pub frames: Vec<FrameReport>,
    /// The real frames.
    pub real: Vec<FrameReport>,
    /// Every measure.
    pub measures: Vec<Row>,
    /// What could not be measured, and why.
    pub notes: Vec<String>,
}

/// Measures frames and real frames, over all cores.
///
/// # Errors
/// As [`Parts::of`].
pub fn compare(frames: &[Picture], real: &[Picture]) -> Result<Report, VolumeError> {
    let measured = |pictures: &[Picture]| pictures.par_iter().map(FrameReport::of).collect::<Result<Vec<_>, _>>();
    let (frames, real) = (measured(frames)?, measured(real)?);
    let rows = MEASURES.iter().enumerate().map(|(at, measure)| {
        let figures = [Figure::of(&frames, at), Figure::of(&real, at)];
        let difference = match &figures {
            [Some(ours), Some(real)] => real
                .spread
                .map(|spread| (ours.mean - real.mean) / spread.max(measure.floor)),
            _ => None,
        };
        let [ours, real] = figures;
        Row {
            measure,
            frames: ours,
            real,
            difference,
            verdict: difference.map(|d| {
                if d.abs() <= LIMIT {
                    Verdict::Inside
                } else {
                    Verdict::Outside
                }
            }),
        }
    });
    let measures: Vec<Row> = rows.collect();
    let mut notes = Vec::new();
    let unscaled: Vec<String> = frames
        .iter()
        .chain(&real)
        .filter(|it| it.mm_per_pixel.is_none())
        .map(|it| it.name.clone())
        .collect();
    if !unscaled.is_empty() {
        let names = crate::text::some_of(&unscaled);
        notes.push(format!(
            "measures in mm are left out of {names}: nothing states the size of their pixels"
        ));
    }
    if real.len() == 1 {
        notes.push(
            "one real frame has no spread: differences have no unit and no verdict; give more real frames".to_owned(),
        );
    }
    Ok(Report {
        frames,
        real,
        measures,
        notes,
    })
}

#[cfg(test)]
mod tests;
