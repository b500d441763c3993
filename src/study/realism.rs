//! Comparison of rendered and real frames: image statistics of both, and their differences in units of the spread among
//! the real frames.
//!
//! Everything is derived from the frames alone, by the same algorithm for both sides: the sector ([`sector`]), its most
//! uniform windows and its darkest ones ([`texture`]). Labels are not used. `MEASURES` is the only list of what is
//! measured. Frames are compared by group, an organ or view: spreads over organs hide every difference.

mod measures;
pub mod picture;
pub(crate) mod report;
pub mod sector;
pub mod texture;

use std::collections::{BTreeMap, BTreeSet};

use serde::{Serialize, Serializer};

use insonify_anatomy::volume::{At, VolumeError};
use insonify_base::parallel;
use insonify_base::statistics::{correlation, mean, percentile, std};
use insonify_base::text;
pub(crate) use measures::MEASURES;
pub use measures::Measure;
use picture::Picture;
use texture::{Patch, Texture, Window, dark_windows, uniform_windows};

/// Side of the uniform windows, pixels.
pub(crate) const WINDOW: usize = 48;
/// Side of the dark windows, pixels.
pub(crate) const DARK_WINDOW: usize = 32;
/// Number of windows of each kind per frame.
const WINDOWS: usize = 5;
/// Accepted mean grey levels of uniform windows: much of a darker one is black.
const GREY: [f64; 2] = [45.0, 200.0];
/// Side of the windows that are divided into blocks of 4 and 8 mm, mm.
const BLOCKS_MM: f64 = 24.0;
/// Depth below the array that must not be empty, mm.
const CONTACT_MM: f64 = 5.0;
/// Grey levels per bin of the histogram.
const BIN_LEVELS: usize = 4;
/// Number of lags reported for autocorrelations, pixels.
const LAGS: usize = 16;
/// Largest difference that counts as within the spread of the real frames, standard deviations.
pub const LIMIT: f64 = 2.0;
/// Least number of real frames with a measure for a verdict on it.
const LEAST_REAL: usize = 3;

/// Raw measurements of one frame, from which [`MEASURES`] computes its values.
pub(crate) struct FrameMeasurements {
    /// Distance between rows and between columns, mm.
    mm: Option<[f64; 2]>,
    /// Grey levels in the sector, ascending.
    sector: Vec<f64>,
    /// Textures of the most uniform windows.
    uniform: Vec<Texture>,
    /// Textures of the darkest windows.
    dark: Vec<Texture>,
    /// Spread of the means of blocks of 4 and 8 mm in uniform windows, dB.
    blocks_db: [Option<f64>; 2],
    /// Share of black pixels in the strip just below the array.
    empty: Option<f64>,
    /// Boundary behind a dark region.
    edge: Option<sector::Edge>,
    /// Correlation with a neighbouring frame in dark and in uniform windows.
    frame_correlation: [Option<f64>; 2],
}

impl FrameMeasurements {
    /// Measures a frame.
    ///
    /// # Errors
    /// [`VolumeError`] for a frame smaller than a window, or without a sector at least that large.
    pub(crate) fn of(picture: &Picture) -> Result<Self, VolumeError> {
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
                let neighbour = Patch::of(neighbour, picture.width, window);
                Some(correlation(&patch(window).values, &neighbour.values))
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
            // Windows of 24 mm have 6 blocks of 4 mm across, and 3 of 8 mm.
            blocks_db: [6, 3].map(spread_of),
            empty: sector::empty_share(picture, &mask, CONTACT_MM),
            edge: sector::edge(picture, &mask),
            frame_correlation: [frame_correlation(&dark), frame_correlation(&uniform)],
        })
    }

    fn percentile(&self, share: f64) -> Option<f64> {
        percentile(&self.sector, share)
    }

    /// Returns the share of the sector whose grey levels satisfy a predicate.
    fn share(&self, counts: impl Fn(f64) -> bool) -> Option<f64> {
        Some(self.sector.iter().filter(|grey| counts(**grey)).count() as f64 / self.sector.len() as f64)
    }
}

/// Finds the sector of a frame.
///
/// # Errors
/// [`VolumeError`] for a frame smaller than a window, or without a sector at least that large.
pub(crate) fn sector_of(picture: &Picture) -> Result<Vec<bool>, VolumeError> {
    let refuse = |wrong, expected: String| {
        let path = picture.name.as_ref();
        Err(VolumeError::malformed(path, At::Pixels, wrong, expected))
    };
    let least = WINDOW + 1;
    if picture.width < least || picture.height < least {
        let size = format!("{} x {} pixels", picture.width, picture.height);
        return refuse(size, format!("at least {least} x {least}"));
    }
    let large = |mask: &Vec<bool>| mask.iter().filter(|inside| **inside).count() >= WINDOW * WINDOW;
    match sector::sector(picture).filter(large) {
        Some(mask) => Ok(mask),
        None => {
            let wrong = "no sector: no connected region of varying grey levels";
            refuse(wrong.to_owned(), format!("one of at least {WINDOW} x {WINDOW} pixels"))
        }
    }
}

/// Returns the mean of the known finite values; `None` if there are none.
fn average(values: impl Iterator<Item = Option<f64>>) -> Option<f64> {
    let known: Vec<f64> = values.flatten().filter(|value| value.is_finite()).collect();
    (!known.is_empty()).then(|| mean(&known))
}

/// Measurements of one frame.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FrameReport {
    /// File name, with the frame number within a sequence.
    pub name: String,
    /// Distance between rows and between columns, mm; `None` if unknown.
    pub mm_per_pixel: Option<[f64; 2]>,
    /// Shares of the sector in bins of 4 grey levels.
    pub histogram: Vec<f64>,
    /// Mean autocorrelation of the uniform windows along depth, at lags of 0, 1, 2, ... pixels.
    pub autocorrelation_axial: Vec<f64>,
    /// Mean autocorrelation of the uniform windows across depth, at lags of 0, 1, 2, ... pixels.
    pub autocorrelation_lateral: Vec<f64>,
    #[serde(skip)]
    values: Vec<Option<f64>>,
}

impl FrameReport {
    fn of(picture: &Picture) -> Result<Self, VolumeError> {
        let parts = FrameMeasurements::of(picture)?;
        let mut histogram = vec![0.0; 256 / BIN_LEVELS];
        for grey in &parts.sector {
            histogram[*grey as usize / BIN_LEVELS] += 1.0 / parts.sector.len() as f64;
        }
        let autocorrelation = |axis: usize| {
            let correlation = |lag: usize| {
                average(
                    parts
                        .uniform
                        .iter()
                        .map(|texture| Some(texture.autocorrelation[axis][lag])),
                )
            };
            (0..=LAGS).map_while(correlation).collect()
        };
        Ok(Self {
            name: picture.name.clone(),
            mm_per_pixel: parts.mm,
            histogram,
            autocorrelation_axial: autocorrelation(0),
            autocorrelation_lateral: autocorrelation(1),
            values: MEASURES
                .iter()
                .map(|measure| (measure.value)(&parts).filter(|value| value.is_finite()))
                .collect(),
        })
    }
}

/// Measure over the frames of one side.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MeasureSummary {
    /// Mean over the frames in which the measure exists.
    pub mean: f64,
    /// Standard deviation over those frames; `None` for a single one.
    pub spread: Option<f64>,
    /// Value in each frame; `None` where it cannot be measured.
    pub values: Vec<Option<f64>>,
}

impl MeasureSummary {
    fn of(frames: &[FrameReport], measure: usize) -> Option<Self> {
        let values: Vec<Option<f64>> = frames.iter().map(|frame| frame.values[measure]).collect();
        let known: Vec<f64> = values.iter().flatten().copied().collect();
        Some(Self {
            mean: average(values.iter().copied())?,
            spread: (known.len() > 1).then(|| std(&known)),
            values,
        })
    }

    /// Spread of enough frames to be one of a distribution.
    fn reliable_spread(&self) -> Option<f64> {
        self.spread
            .filter(|_| self.values.iter().flatten().count() >= LEAST_REAL)
    }
}

/// Whether a measure agrees with the real frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum LikenessVerdict {
    /// The difference is within [`LIMIT`] standard deviations of the real frames.
    Inside,
    /// The difference exceeds [`LIMIT`] standard deviations of the real frames.
    Outside,
}

/// Measure on both sides.
#[derive(Clone, Debug, Serialize)]
pub struct MeasureComparison {
    /// Measured quantity.
    #[serde(flatten)]
    pub measure: &'static Measure,
    /// Values in the rendered frames; `None` if no frame has the measure.
    pub frames: Option<MeasureSummary>,
    /// Values in the real frames; `None` if no frame has the measure.
    pub real: Option<MeasureSummary>,
    /// Mean of the rendered frames less that of the real ones, in units of the spread among the real ones (at least the
    /// measure's floor); `None` if fewer than three real frames have the measure.
    pub difference: Option<f64>,
    /// Verdict on the difference.
    pub verdict: Option<LikenessVerdict>,
}

impl MeasureComparison {
    fn of(measure: &'static Measure, [frames, real]: [Option<MeasureSummary>; 2]) -> Self {
        let difference = frames.as_ref().zip(real.as_ref()).and_then(|(frames, real)| {
            let spread = real.reliable_spread()?;
            Some((frames.mean - real.mean) / spread.max(measure.floor))
        });
        Self {
            measure,
            frames,
            real,
            difference,
            verdict: difference.map(|difference| {
                if difference.abs() <= LIMIT {
                    LikenessVerdict::Inside
                } else {
                    LikenessVerdict::Outside
                }
            }),
        }
    }
}

/// Comparison of the rendered frames of an organ or view with real ones.
#[derive(Clone, Debug, Serialize)]
pub struct GroupComparison {
    /// Name of the group, or `ours against theirs` where they differ.
    pub group: String,
    /// Rendered frames.
    pub frames: Vec<FrameReport>,
    /// Real frames.
    pub real: Vec<FrameReport>,
    /// All measures, in both sets of frames.
    pub measures: Vec<MeasureComparison>,
}

/// Comparison of rendered frames with real ones, group by group.
#[derive(Clone, Debug, Serialize)]
pub struct LikenessReport {
    /// Groups by name; serialised as the list `groups`, or a single one as its fields.
    #[serde(flatten, serialize_with = "single_or_list")]
    pub groups: Vec<GroupComparison>,
    /// Frames and measures omitted, and why.
    pub notes: Vec<String>,
}

fn single_or_list<S: Serializer>(groups: &[GroupComparison], serializer: S) -> Result<S::Ok, S::Error> {
    match groups {
        [single] => single.serialize(serializer),
        _ => serializer.collect_map([("groups", groups)]),
    }
}

/// Group of each frame of both sides. Sides without a group in common are not sorted by organ: of one whose frames are
/// each a group of their own, all are one.
fn groups_of(sides: [&[Picture]; 2]) -> [Vec<&str>; 2] {
    let mut groups = sides.map(|pictures| pictures.iter().map(|it| it.group.as_str()).collect::<Vec<_>>());
    let names = [0, 1].map(|side| groups[side].iter().copied().collect::<BTreeSet<&str>>());
    if names[0].is_disjoint(&names[1]) {
        for (side, all) in SIDES.into_iter().enumerate() {
            if names[side].len() == groups[side].len() && names[side].len() > 1 {
                groups[side].fill(all);
            }
        }
    }
    groups
}

/// Names of the sides.
const SIDES: [&str; 2] = ["frames", "real frames"];

/// Joins names of groups, those that are shown of many.
fn listed<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    let names: Vec<String> = names
        .into_iter()
        .map(|name| text::tail(name, text::WIDEST_NAME))
        .collect();
    text::some_of(&names)
}

/// Pairs groups of the same name. If there are none, and one side has a single group, that is paired with each.
fn pairs<'a>(frames: &BTreeSet<&'a str>, real: &BTreeSet<&'a str>) -> Vec<[&'a str; 2]> {
    let same: Vec<[&str; 2]> = frames.intersection(real).map(|name| [*name; 2]).collect();
    if !same.is_empty() || frames.len() > 1 && real.len() > 1 {
        return same;
    }
    let of_all = |ours: &&'a str| real.iter().map(|theirs| [*ours, *theirs]).collect::<Vec<_>>();
    frames.iter().flat_map(of_all).collect()
}

/// Measures rendered and real frames in parallel and compares them by group.
///
/// # Errors
/// [`VolumeError`] for a frame smaller than a window, or without a sector at least that large, and if both sides have
/// several groups and none in common.
pub fn compare(frames: &[Picture], real: &[Picture]) -> Result<LikenessReport, VolumeError> {
    let groups = groups_of([frames, real]);
    let names = [0, 1].map(|side| groups[side].iter().copied().collect::<BTreeSet<&str>>());
    let pairs = pairs(&names[0], &names[1]);
    if pairs.is_empty() {
        let [ours, theirs] = names.map(listed);
        return Err(VolumeError::new(format!(
            "no frames and real frames of the same group: of frames there are {ours}, of real ones {theirs}; a group is a sub-folder, or the \
             files that differ only in the number at the end of their names (liver_01.png, liver_02.png): name them alike, or give frames \
             of a single group, which is compared with each"
        )));
    }
    let mut notes = Vec::new();
    if names.iter().any(|names| names.len() > 1) {
        notes.push("groups are sub-folders, else files whose names differ only in the number at the end".to_owned());
    }
    let paired = [0, 1].map(|side| pairs.iter().map(|pair| pair[side]).collect::<BTreeSet<&str>>());
    for (side, [kind, other]) in [SIDES, [SIDES[1], SIDES[0]]].into_iter().enumerate() {
        let alone: Vec<&str> = names[side].difference(&paired[side]).copied().collect();
        if !alone.is_empty() {
            notes.push(format!(
                "{kind} without {other} of their group are left out: {}",
                listed(alone)
            ));
        }
    }
    let measured = |side: usize, pictures: &[Picture]| {
        let all = groups[side].iter().zip(pictures);
        let used: Vec<(&&str, &Picture)> = all.filter(|(group, _)| paired[side].contains(**group)).collect();
        let reports = parallel::try_map(&used[..], &|(_, picture): &(&&str, &Picture)| FrameReport::of(picture))?;
        let mut measured = BTreeMap::<&str, Vec<FrameReport>>::new();
        for ((group, _), report) in used.into_iter().zip(reports) {
            measured.entry(group).or_default().push(report);
        }
        Ok::<_, VolumeError>(measured)
    };
    let (frames, real) = (measured(0, frames)?, measured(1, real)?);
    let unscaled: Vec<String> = frames
        .values()
        .chain(real.values())
        .flatten()
        .filter(|frame| frame.mm_per_pixel.is_none())
        .map(|frame| frame.name.clone())
        .collect();
    if !unscaled.is_empty() {
        let names = text::some_of(&unscaled);
        notes.push(format!(
            "measures in mm are left out of {names}: nothing states the size of their pixels"
        ));
    }
    let few: Vec<&str> = real
        .iter()
        .filter(|(_, frames)| frames.len() < LEAST_REAL)
        .map(|(name, _)| *name)
        .collect();
    if !few.is_empty() {
        let names = listed(few);
        notes.push(format!(
            "one or two real frames are no distribution ({names}): they have values and no verdict; give {LEAST_REAL} or more of a group"
        ));
    }
    let group = |[ours, theirs]: [&str; 2]| {
        let (frames, real) = (frames[ours].clone(), real[theirs].clone());
        let rows = MEASURES.iter().enumerate().map(|(index, measure)| {
            MeasureComparison::of(measure, [&frames, &real].map(|side| MeasureSummary::of(side, index)))
        });
        GroupComparison {
            group: if ours == theirs {
                ours.to_owned()
            } else {
                format!("{ours} against {theirs}")
            },
            measures: rows.collect(),
            frames,
            real,
        }
    };
    Ok(LikenessReport {
        groups: pairs.into_iter().map(group).collect(),
        notes,
    })
}

#[cfg(test)]
mod tests;
