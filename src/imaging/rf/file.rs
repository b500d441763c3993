//! Sequences of echoes: those of this program, of PLUS (`RF_REAL`, `RF_IQ_LINE`, `RF_I_LINE_Q_LINE`), and volumes whose slices are frames.

use std::path::Path;

use crate::anatomy::volume::{At, VolumeError, numbers, read_header};
use crate::tracking::sequence::Sequence;

/// Names of the fields in which this program states sampling rate (MHz), distance between lines (mm), radius of the array (mm) and field of view
/// (degrees).
pub const FIELDS: [&str; 4] = ["RfSamplingMHz", "RfPitchMm", "RfRadiusMm", "RfAngleDeg"];
/// Share of equal neighbouring samples at which lines are constant or saturated.
const STUCK: f64 = 0.5;

/// Echoes of a sequence.
#[derive(Clone, Debug)]
pub struct Echoes {
    /// Number of lines.
    pub lines: usize,
    /// Number of samples of a line.
    pub samples: usize,
    /// True for pairs of in-phase and quadrature values, false for radio frequency.
    pub baseband: bool,
    /// Values of each frame, line by line, away from the probe.
    pub frames: Vec<Vec<f32>>,
    /// Values of [`FIELDS`] that the file states.
    pub stated: [Option<f64>; 4],
    /// Assumptions, one sentence each.
    pub notes: Vec<String>,
}

impl Echoes {
    /// Reads a sequence of echoes of any number type.
    ///
    /// # Errors
    /// [`VolumeError`] with the file, what was found and what was expected: images of another type, no data, or lines that are constant.
    pub fn read(path: &Path) -> Result<Self, VolumeError> {
        let mut header = read_header(path)?;
        let keys = Sequence::read_poses(path)?;
        let wrong = |found: String, expected: &str| VolumeError::malformed(path, At::Header, found, expected);
        let kind = keys.image_type.as_deref();
        let (baseband, by_rows) = match kind {
            Some("RF_REAL") | None => (false, false),
            Some("RF_IQ_LINE") => (true, false),
            Some("RF_I_LINE_Q_LINE") => (true, true),
            Some(other) => {
                let expected = "RF_REAL, RF_IQ_LINE or RF_I_LINE_Q_LINE: echoes before detection";
                return Err(wrong(format!("images of type {other}"), expected));
            }
        };
        let sizes: Vec<usize> = header.axes.iter().map(|axis| axis.size).collect();
        let [width, height, count] = match sizes[..] {
            [width, height] => [width, height, 1],
            [width, height, count] | [width, height, count, 1] => [width, height, count],
            _ => return Err(wrong(format!("sizes {}", header.sizes()), "frames of two dimensions")),
        };
        if header.element.is_none() || width * height * count == 0 {
            return Err(wrong(format!("sizes {}", header.sizes()), "frames with samples"));
        }
        let step = |axis: usize| header.axes[axis].direction.map_or(1.0, |direction| direction.norm());
        let steps = [step(0), step(1)];
        let field = |name: &str| {
            let found = header.key_values.iter().find(|(key, _)| key == name);
            found
                .and_then(|(_, value)| value.trim().parse().ok())
                .filter(|value: &f64| value.is_finite())
        };
        let mut stated = FIELDS.map(field);
        let mut notes = Vec::new();
        // The first letter of the orientation is the direction of the columns: far from or near to the transducer, or along the array.
        let named = |key: &str| key.to_ascii_lowercase().replace(' ', "") == "ultrasoundimageorientation";
        let orientation = header.key_values.iter().find(|(key, _)| named(key));
        let letters = orientation.map_or_else(String::new, |(_, value)| value.trim().to_ascii_uppercase());
        // Samples that run towards the transducer, and lines that run away from the marked side.
        let (upwards, unmarked) = (letters.contains('N'), letters.contains('U'));
        let columns_are_samples = match letters.bytes().next() {
            Some(b'F' | b'N') => true,
            Some(b'M' | b'U') => false,
            _ => {
                let columns = if steps[0] == steps[1] {
                    width >= height
                } else {
                    steps[0] < steps[1]
                };
                notes.push(format!(
                    "the orientation is not stated: {} are taken as samples, away from the probe",
                    if columns { "columns" } else { "rows" }
                ));
                columns
            }
        };
        let (axial, lateral) = if columns_are_samples { (0, 1) } else { (1, 0) };
        if steps != [1.0; 2] {
            if stated[0].is_none() && !baseband {
                stated[0] = Some(super::SPEED_M_S * 1e-3 / (2.0 * steps[axial]));
                notes.push(format!(
                    "samples are {} mm apart: taken as {:.2} MHz at {} m/s",
                    steps[axial],
                    super::SPEED_M_S * 1e-3 / (2.0 * steps[axial]),
                    super::SPEED_M_S
                ));
            }
            stated[1] = stated[1].or(Some(steps[lateral]));
        }
        let data = numbers(&mut header)?;
        let (mut lines, mut samples) = if columns_are_samples {
            (height, width)
        } else {
            (width, height)
        };
        let rows = if by_rows { 2 } else { 1 };
        let place = |line: usize, sample: usize| {
            let sample = if upwards { samples - 1 - sample } else { sample };
            // Rows of in-phase and quadrature values stay in their order.
            let line = if unmarked {
                lines - rows - line / rows * rows + line % rows
            } else {
                line
            };
            match columns_are_samples {
                true => line * width + sample,
                false => sample * width + line,
            }
        };
        let mut frames: Vec<Vec<f32>> = data
            .chunks_exact(width * height)
            .map(|frame| {
                let order = (0..lines).flat_map(|line| (0..samples).map(move |sample| (line, sample)));
                order.map(|(line, sample)| frame[place(line, sample)]).collect()
            })
            .collect();
        if baseband {
            if by_rows {
                frames.iter_mut().for_each(|frame| *frame = interleaved(frame, samples));
                lines /= 2;
            } else {
                samples /= 2;
            }
        }
        if lines == 0 || samples < 16 {
            return Err(wrong(
                format!("{lines} lines of {samples} samples"),
                "lines of at least 16 samples",
            ));
        }
        let stuck = |frame: &Vec<f32>| {
            let same = frame.windows(2).filter(|pair| pair[0] == pair[1]).count();
            same as f64 > STUCK * frame.len() as f64
        };
        if let Some(frame) = frames.iter().position(stuck) {
            let found = format!("frame {frame} in which most neighbouring samples are equal");
            return Err(wrong(found, "echoes: neither constant nor saturated"));
        }
        if kind.is_none() {
            notes.push("the type of the data is not stated: taken as radio frequency (RF_REAL)".to_owned());
        }
        Ok(Self {
            lines,
            samples,
            baseband,
            frames,
            stated,
            notes,
        })
    }
}

/// Rows of in-phase and of quadrature values in turn as rows of pairs.
fn interleaved(frame: &[f32], samples: usize) -> Vec<f32> {
    let pairs = frame.chunks_exact(2 * samples);
    pairs
        .flat_map(|pair| {
            let (i, q) = pair.split_at(samples);
            i.iter().zip(q).flat_map(|(i, q)| [*i, *q])
        })
        .collect()
}
