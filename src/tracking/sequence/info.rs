//! What a tracked sequence holds, for people and for scripts.

use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;

use serde::Serialize;

use super::{Orientation, keys, stored_size};
use crate::volume::read_header;

/// Interval between frames, in medians, from which it is a gap: a frame is missing.
const GAP: f64 = 1.5;

/// A summary of a tracked sequence, from its header alone.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SequenceInfo {
    /// The file it came from, as it was named.
    pub file: String,
    /// Size of that file.
    pub bytes: u64,
    /// Images, or frames that carry keys where there are more of those.
    pub frames: usize,
    /// The images; none in a recording of poses alone.
    pub images: Option<ImageInfo>,
    /// When frames were recorded; none without time stamps.
    pub time: Option<TimeInfo>,
    /// The transforms, by name.
    pub transforms: Vec<TransformInfo>,
    /// What the reader had to assume or found odd.
    pub warnings: Vec<String>,
}

/// The images of a [`SequenceInfo`].
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ImageInfo {
    /// Columns, as stored.
    pub width: usize,
    /// Rows, as stored.
    pub height: usize,
    /// Type of a pixel.
    pub pixel: &'static str,
    /// Directions of columns and rows in PLUS's terms, such as `MF`; none where the file does not say.
    pub orientation: Option<String>,
    /// Meaning of the pixels in PLUS's terms, such as `BRIGHTNESS`; none where the file does not say.
    pub content: Option<String>,
    /// Images that the file does not mark as invalid.
    pub valid: usize,
}

/// The time stamps of a [`SequenceInfo`], s.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TimeInfo {
    /// First time stamp.
    pub start_s: f64,
    /// Last time stamp.
    pub end_s: f64,
    /// Frames that carry one.
    pub frames: usize,
    /// Median of the intervals between them; none for a single one.
    pub median_interval_s: Option<f64>,
    /// Longest interval; none for a single one.
    pub longest_interval_s: Option<f64>,
    /// Intervals longer than 1.5 medians.
    pub gaps: usize,
    /// Time stamps that are not after the one before.
    pub not_after: usize,
}

/// One transform of a [`SequenceInfo`].
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TransformInfo {
    /// Name, such as `ProbeToTracker`.
    pub name: String,
    /// Frames that carry it.
    pub frames: usize,
    /// Frames in which the tracker calls it valid and it is a finite affine matrix.
    pub valid: usize,
}

impl SequenceInfo {
    /// Summarises a file; none for a file that is no sequence: one with neither keys of frames nor an orientation of
    /// ultrasound images, or none that can be read.
    pub fn of(path: &Path) -> Option<Self> {
        let header = read_header(path).ok()?;
        let [width, height, images] = stored_size(&header).ok()?;
        let keys = keys::parse(&header.key_values);
        if keys.frames.is_empty() && keys.orientation.is_none() {
            return None;
        }
        let mut warnings = header.warnings.clone();
        warnings.extend(keys.warnings);
        let element = header.element.filter(|_| width > 0 && height > 0);
        let images = element.map_or(0, |_| images);
        let named = keys.frames.len();
        if element.is_some() && named != images {
            warnings.push(format!("{images} images, and {named} frames that carry keys"));
        }
        let orientation = keys.orientation;
        if let Some(name) = orientation.as_deref().filter(|_| element.is_some())
            && Orientation::parse(name).is_none()
        {
            warnings.push(format!(
                "the orientation of the images is given as {name:?}: taken as MF"
            ));
        }
        let refused = keys.frames.values().filter(|frame| frame.image_valid == Some(false));
        let valid = images.saturating_sub(refused.count());
        Some(Self {
            file: path.display().to_string(),
            bytes: std::fs::metadata(path).map_or(0, |data| data.len()),
            frames: images.max(named),
            images: element.map(|element| ImageInfo {
                width,
                height,
                pixel: element.name(),
                orientation,
                content: keys.image_type,
                valid,
            }),
            time: TimeInfo::of(keys.frames.values().filter_map(|frame| frame.timestamp)),
            transforms: transforms(keys.frames.values()),
            warnings,
        })
    }
}

fn transforms<'a>(frames: impl Iterator<Item = &'a keys::Frame>) -> Vec<TransformInfo> {
    let mut counts: BTreeMap<&str, [usize; 2]> = BTreeMap::new();
    for (name, transform) in frames.flat_map(|frame| &frame.transforms) {
        let [frames, valid] = counts.entry(name).or_default();
        *frames += 1;
        *valid += usize::from(transform.valid);
    }
    let info = |(name, [frames, valid]): (&str, [usize; 2])| TransformInfo {
        name: name.to_owned(),
        frames,
        valid,
    };
    counts.into_iter().map(info).collect()
}

impl TimeInfo {
    fn of(stamps: impl Iterator<Item = f64>) -> Option<Self> {
        let stamps: Vec<f64> = stamps.collect();
        let mut intervals: Vec<f64> = stamps.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let not_after = intervals.iter().filter(|interval| **interval <= 0.0).count();
        intervals.sort_by(f64::total_cmp);
        let median = intervals.get(intervals.len() / 2).copied();
        let long = |interval: &&f64| median.is_some_and(|median| **interval > GAP * median);
        Some(Self {
            start_s: *stamps.first()?,
            end_s: *stamps.last()?,
            frames: stamps.len(),
            median_interval_s: median,
            longest_interval_s: intervals.last().copied(),
            gaps: intervals.iter().filter(long).count(),
            not_after,
        })
    }
}

impl fmt::Display for SequenceInfo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "file         {}", self.file)?;
        match self.bytes as f64 / 1e3 {
            kilobytes if kilobytes < 1e3 => writeln!(f, "size         {kilobytes:.1} kB")?,
            kilobytes => writeln!(f, "size         {:.1} MB", kilobytes / 1e3)?,
        }
        writeln!(f, "frames       {}", self.frames)?;
        match &self.images {
            None => writeln!(f, "images       none: poses alone")?,
            Some(images) => writeln!(
                f,
                "images       {} x {} pixels of {}, orientation {}, {}; {} valid",
                images.width,
                images.height,
                images.pixel,
                images.orientation.as_deref().unwrap_or("not stated"),
                images.content.as_deref().unwrap_or("content not stated"),
                images.valid
            )?,
        }
        match &self.time {
            None => writeln!(f, "time         no time stamps")?,
            Some(time) => time.fmt(f)?,
        }
        let widest = self.transforms.iter().map(|transform| transform.name.len()).max();
        let width = widest.unwrap_or(0).max("transform".len());
        writeln!(f, "\n{:width$}  {:>7}  {:>7}", "transform", "frames", "valid")?;
        for TransformInfo { name, frames, valid } in &self.transforms {
            writeln!(f, "{name:width$}  {frames:>7}  {valid:>7}")?;
        }
        for warning in &self.warnings {
            writeln!(f, "\nwarning: {warning}")?;
        }
        Ok(())
    }
}

impl fmt::Display for TimeInfo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (start, end) = (self.start_s, self.end_s);
        writeln!(f, "time         {start:.3} to {end:.3} s ({:.3} s)", end - start)?;
        if let (Some(median), Some(longest)) = (self.median_interval_s, self.longest_interval_s) {
            let rate = if median > 0.0 { 1.0 / median } else { f64::NAN };
            write!(
                f,
                "rate         {rate:.2} frames a second (median interval {median:.3} s); "
            )?;
            writeln!(
                f,
                "{} gaps above {GAP} medians, longest interval {longest:.3} s",
                self.gaps
            )?;
        }
        match self.not_after {
            0 => Ok(()),
            count => writeln!(f, "             {count} time stamps are not after the one before"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_have_a_median_and_gaps() {
        let time = TimeInfo::of([1.0, 1.1, 1.2, 1.5, 1.5, 1.6].into_iter()).unwrap();
        assert_eq!((time.start_s, time.end_s, time.frames), (1.0, 1.6, 6));
        assert!((time.median_interval_s.unwrap() - 0.1).abs() < 1e-9);
        assert!((time.longest_interval_s.unwrap() - 0.3).abs() < 1e-9);
        assert_eq!((time.gaps, time.not_after), (1, 1));
        assert_eq!(TimeInfo::of(std::iter::empty()), None);
        let single = TimeInfo::of(std::iter::once(2.0)).unwrap();
        assert_eq!((single.median_interval_s, single.gaps), (None, 0));
    }
}
