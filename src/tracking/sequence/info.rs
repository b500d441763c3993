//! Summary of a tracked sequence, as text and JSON.

use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;

use serde::Serialize;

use super::{Orientation, Stored, keys};
use insonify_anatomy::volume::read_header;

/// Ratio of an interval between frames to the median above which a frame is missing.
const GAP: f64 = 1.5;

/// A summary of a tracked sequence, from its header alone.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SequenceInfo {
    /// Path of the file, as given.
    pub file: String,
    /// Size of the file, bytes.
    pub bytes: u64,
    /// Number of images, or of frames with keys if larger.
    pub frames: usize,
    /// Image properties; `None` for a recording of poses alone.
    pub images: Option<ImageInfo>,
    /// Time stamps; `None` if there are none.
    pub time: Option<TimeInfo>,
    /// Transforms, sorted by name.
    pub transforms: Vec<TransformInfo>,
    /// Assumptions and warnings of the reader.
    pub warnings: Vec<String>,
}

/// Images of a [`SequenceInfo`].
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ImageInfo {
    /// Columns, as stored.
    pub width: usize,
    /// Rows, as stored.
    pub height: usize,
    /// Type of the values of a pixel.
    pub pixel: &'static str,
    /// Values of a pixel: 1 for grey, 3 or 4 for colour.
    #[serde(skip_serializing_if = "is_grey")]
    pub channels: usize,
    /// Directions of columns and rows in PLUS's terms, such as `MF`; `None` if not stated in the file.
    pub orientation: Option<String>,
    /// Meaning of the pixels in PLUS's terms, such as `BRIGHTNESS`; `None` if not stated in the file.
    pub content: Option<String>,
    /// Number of images that the file does not mark as invalid.
    pub valid: usize,
}

/// Time stamps of a [`SequenceInfo`], s.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TimeInfo {
    /// First time stamp.
    pub start_s: f64,
    /// Last time stamp.
    pub end_s: f64,
    /// Number of frames with a time stamp.
    pub frames: usize,
    /// Median interval; `None` for a single time stamp.
    pub median_interval_s: Option<f64>,
    /// Longest interval; `None` for a single time stamp.
    pub longest_interval_s: Option<f64>,
    /// Number of intervals longer than 1.5 medians.
    pub gaps: usize,
    /// Number of time stamps that do not increase.
    pub not_after: usize,
}

/// A transform of a [`SequenceInfo`].
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TransformInfo {
    /// Name, such as `ProbeToTracker`.
    pub name: String,
    /// Number of frames with this transform.
    pub frames: usize,
    /// Number of frames in which the tracker marks it valid and it is a finite affine matrix.
    pub valid: usize,
}

fn is_grey(channels: &usize) -> bool {
    *channels == 1
}

impl SequenceInfo {
    /// Summarises a file; `None` for a file that is not a sequence: one with neither keys of frames, an orientation of
    /// ultrasound images nor the name of a sequence of images of 3D Slicer, or an unreadable one.
    pub fn of(path: &Path) -> Option<Self> {
        let header = read_header(path).ok()?;
        let keys = keys::parse(&header.key_values);
        let is_named = || path.to_string_lossy().to_ascii_lowercase().ends_with(".seq.nrrd");
        let has_images = || Stored::of(&header, &keys).is_ok_and(|stored| stored.images > 1);
        if keys.frames.is_empty() && keys.orientation.is_none() && !(is_named() && has_images()) {
            return None;
        }
        let mut warnings = header.warnings.clone();
        let stored = Stored::of(&header, &keys).unwrap_or_else(|error| {
            warnings.push(error.to_string());
            Stored::default()
        });
        let [width, height] = stored.size;
        warnings.extend(keys.warnings);
        // A recording of the tracker alone has no pixels: its frames are counted by their keys.
        let element = header.element.filter(|_| width > 0 && height > 0);
        let images = element.map_or(0, |_| stored.images);
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
                channels: stored.channels,
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
                "images       {} x {} pixels of {}{}, orientation {}, {}; {} valid",
                images.width,
                images.height,
                if is_grey(&images.channels) {
                    String::new()
                } else {
                    format!("{} colours of ", images.channels)
                },
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
            let rate = if median > 0.0 {
                format!("{:.2} frames a second", 1.0 / median)
            } else {
                "unknown".to_owned()
            };
            write!(f, "rate         {rate} (median interval {median:.3} s); ")?;
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
        let equal = TimeInfo::of([0.0; 3].into_iter()).unwrap().to_string();
        assert!(
            equal.contains("rate         unknown (median interval 0.000 s)") && !equal.contains("NaN"),
            "{equal}"
        );
        let single = TimeInfo::of(std::iter::once(2.0)).unwrap();
        assert_eq!((single.median_interval_s, single.gaps), (None, 0));
    }
}
