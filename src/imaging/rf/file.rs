//! Sequences of echoes: those of this program, of PLUS (`RF_REAL`, `RF_IQ_LINE`, `RF_I_LINE_Q_LINE`), and volumes whose
//! slices are frames.

use std::path::Path;

use super::SPEED_M_S;
use insonify_anatomy::volume::header::Header;
use insonify_anatomy::volume::{At, VolumeError, numbers, read_header};
use insonify_base::note::Notes;
use insonify_base::{memory, number};
use insonify_tracking::sequence::Sequence;

/// Names of the fields in which this program states sampling rate (MHz), distance between lines (mm), radius of the
/// array (mm) and field of view (degrees).
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
    pub notes: Notes,
}

/// Order of the values of a file's frames.
struct Layout {
    width: usize,
    height: usize,
    columns_are_samples: bool,
    /// Samples run towards the transducer.
    upwards: bool,
    /// Lines run away from the marked side.
    unmarked: bool,
    /// Rows of in-phase and quadrature values alternate.
    by_rows: bool,
}

impl Layout {
    fn lines(&self) -> usize {
        if self.columns_are_samples {
            self.height
        } else {
            self.width
        }
    }

    fn samples(&self) -> usize {
        if self.columns_are_samples {
            self.width
        } else {
            self.height
        }
    }

    /// Values line by line, away from the probe.
    fn ordered(&self, frame: &[f32]) -> Vec<f32> {
        let (lines, samples) = (self.lines(), self.samples());
        // Rows of in-phase and quadrature values stay in their order.
        let rows = if self.by_rows { 2 } else { 1 };
        let index = |line: usize, sample: usize| {
            let sample = if self.upwards { samples - 1 - sample } else { sample };
            let line = if self.unmarked {
                lines - rows - line / rows * rows + line % rows
            } else {
                line
            };
            if self.columns_are_samples {
                line * self.width + sample
            } else {
                sample * self.width + line
            }
        };
        let order = (0..lines).flat_map(|line| (0..samples).map(move |sample| (line, sample)));
        order.map(|(line, sample)| frame[index(line, sample)]).collect()
    }

    /// Layout by the orientation that a header states, in letters of PLUS: columns and rows run far from or near to the
    /// transducer (F, N), towards the marked or the unmarked side (M, U); without one by the spacing, and a note.
    fn of(header: &Header, [width, height]: [usize; 2], by_rows: bool, notes: &mut Notes) -> Self {
        let named = |key: &str| key.to_ascii_lowercase().replace(' ', "") == "ultrasoundimageorientation";
        let unit = header.key_values.iter().find(|(key, _)| named(key));
        let letters = unit.map_or_else(String::new, |(_, value)| value.trim().to_ascii_uppercase());
        let steps = [0, 1].map(|axis| step_mm(header, axis));
        let columns_are_samples = match letters.bytes().next() {
            Some(b'F' | b'N') => true,
            Some(b'M' | b'U') => false,
            _ => {
                let columns = if steps[0] == steps[1] {
                    width >= height
                } else {
                    steps[0] < steps[1]
                };
                let which = if columns { "columns" } else { "rows" };
                notes.push(format!(
                    "the orientation is not stated: {which} are taken as samples, away from the probe"
                ));
                columns
            }
        };
        Self {
            width,
            height,
            columns_are_samples,
            upwards: letters.contains('N'),
            unmarked: letters.contains('U'),
            by_rows,
        }
    }
}

fn step_mm(header: &Header, axis: usize) -> f64 {
    header.axes[axis].direction.map_or(1.0, |direction| direction.norm())
}

/// Values of [`FIELDS`] that a header states, or that follow from its spacing.
fn stated(header: &Header, layout: &Layout, baseband: bool, notes: &mut Notes) -> [Option<f64>; 4] {
    let mut stated = FIELDS.map(|name| {
        let (_, value) = header.key_values.iter().find(|(key, _)| key == name)?;
        number::parsed(value.trim())
    });
    let [columns, rows] = [0, 1].map(|axis| step_mm(header, axis));
    if [columns, rows] == [1.0; 2] {
        return stated;
    }
    let (axial, lateral) = if layout.columns_are_samples {
        (columns, rows)
    } else {
        (rows, columns)
    };
    if stated[0].is_none() && !baseband {
        let mhz = SPEED_M_S * 1e-3 / (2.0 * axial);
        stated[0] = Some(mhz);
        notes.push(format!(
            "samples are {axial} mm apart: taken as {mhz:.2} MHz at {SPEED_M_S} m/s"
        ));
    }
    stated[1] = stated[1].or(Some(lateral));
    stated
}

impl Echoes {
    /// Reads a sequence of echoes of any number type.
    ///
    /// # Errors
    /// [`VolumeError`] with the file, what was found and what was expected: images of another type, no data, or lines
    /// that are constant.
    pub fn read(path: &Path) -> Result<Self, VolumeError> {
        let mut header = read_header(path)?;
        let wrong = |found: String, expected: &str| VolumeError::malformed(path, At::Header, found, expected);
        let kind = Sequence::read_poses(path)?.image_type;
        let (baseband, by_rows) = match kind.as_deref() {
            Some("RF_REAL") | None => (false, false),
            Some("RF_IQ_LINE") => (true, false),
            Some("RF_I_LINE_Q_LINE") => (true, true),
            Some(other) => {
                let expected = "RF_REAL, RF_IQ_LINE or RF_I_LINE_Q_LINE: echoes before detection";
                return Err(wrong(format!("images of type {other}"), expected));
            }
        };
        let sizes: Vec<usize> = header.axes.iter().map(|axis| axis.size).collect();
        let size = match sizes[..] {
            [width, height] | [width, height, _] | [width, height, _, 1] => [width, height],
            _ => return Err(wrong(format!("sizes {}", header.sizes()), "frames of two dimensions")),
        };
        if header.element.is_none() || sizes.contains(&0) {
            return Err(wrong(format!("sizes {}", header.sizes()), "frames with samples"));
        }
        let mut notes = Notes::default();
        let layout = Layout::of(&header, size, by_rows, &mut notes);
        let stated = stated(&header, &layout, baseband, &mut notes);
        if kind.is_none() {
            notes.push("the type of the data is not stated: taken as radio frequency (RF_REAL)".to_owned());
        }
        let (mut lines, mut samples) = (layout.lines(), layout.samples());
        match (baseband, by_rows) {
            (true, true) => lines /= 2,
            (true, false) => samples /= 2,
            _ => {}
        }
        if lines == 0 || samples < 16 || (by_rows && 2 * lines != layout.lines()) {
            let expected = "lines of at least 16 samples, rows of in-phase and quadrature values in pairs";
            return Err(wrong(format!("{lines} lines of {samples} samples"), expected));
        }
        let values = numbers(&mut header)?;
        // The numbers again in the order of the lines, and a frame in between.
        let needed = size_of_val(&values[..]) + size[0] * size[1] * size_of::<f32>();
        memory::check(needed as u64, "echoes").map_err(|cause| VolumeError::read(path, cause.into()))?;
        let frames = values.chunks_exact(size[0] * size[1]).map(|frame| {
            let frame = layout.ordered(frame);
            if by_rows { interleaved(&frame, samples) } else { frame }
        });
        let frames: Vec<Vec<f32>> = frames.collect();
        // Noise alone tells neighbouring echoes apart: equal ones come from a constant or saturated channel.
        let stuck = |frame: &Vec<f32>| {
            let same = frame.windows(2).filter(|pair| pair[0] == pair[1]).count();
            same as f64 > STUCK * frame.len() as f64
        };
        match frames.iter().position(stuck) {
            Some(frame) => Err(wrong(
                format!("frame {frame} in which most neighbouring samples are equal"),
                "echoes: neither constant nor saturated",
            )),
            None => Ok(Self {
                lines,
                samples,
                baseband,
                frames,
                stated,
                notes,
            }),
        }
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
