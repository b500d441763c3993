//! Animated GIF previews, small enough for a page or a message.

use std::borrow::Cow;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use gif::{Encoder, EncodingError, Repeat};

use insonify_base::output::OutputError;

/// Largest width, pixels: pictures are downscaled by an integer to fit.
const WIDEST: usize = 426;
/// Minimum interval between pictures, s: half the frames of a typical run, and as fast as most programs show them.
const MIN_S: f64 = 0.08;
/// Number of grey levels: fewer are smaller, and the steps are invisible on speckle.
const GREYS: usize = 64;

/// Writer of an animated GIF. It repeats for ever.
pub struct Preview {
    path: PathBuf,
    encoder: Encoder<BufWriter<File>>,
    /// Columns and rows of the input frames.
    size: [usize; 2],
    /// Downscaling factor along each side.
    cell: usize,
    /// Interval between used frames.
    every: usize,
    /// Display time of a picture, in hundredths of a second.
    delay: u16,
    seen: usize,
    shown: Vec<u8>,
}

impl Preview {
    /// Begins a file for grey frames of `width` x `height` pixels (1 or more each, at most 65,535 after downscaling) at
    /// intervals of `frame_s` seconds (above 0).
    ///
    /// # Errors
    /// [`OutputError`] if the file cannot be written, or the size is out of range.
    pub fn create(path: &Path, width: usize, height: usize, frame_s: f64) -> Result<Preview, OutputError> {
        let cell = width.div_ceil(WIDEST).max(1);
        let side = |pixels: usize| u16::try_from(pixels / cell).ok().filter(|side| *side > 0);
        let (Some(columns), Some(rows)) = (side(width), side(height)) else {
            let cause = format!("{width} x {height} pixels make no animated picture");
            return Err(OutputError::write(
                path,
                io::Error::new(io::ErrorKind::InvalidInput, cause),
            ));
        };
        let wrong = |cause| OutputError::write(path, cause);
        let file = BufWriter::new(File::create(path).map_err(wrong)?);
        let grey = |level: usize| [(level * 255 / (GREYS - 1)) as u8; 3];
        let palette: Vec<u8> = (0..GREYS).flat_map(grey).collect();
        let mut encoder = Encoder::new(file, columns, rows, &palette).map_err(|error| wrong(system(error)))?;
        encoder
            .set_repeat(Repeat::Infinite)
            .map_err(|error| wrong(system(error)))?;
        let every = (MIN_S / frame_s - 1e-6).ceil().clamp(1.0, 1e6);
        Ok(Preview {
            path: path.to_owned(),
            encoder,
            size: [width, height],
            cell,
            every: every as usize,
            delay: (100.0 * frame_s * every).round().clamp(1.0, 6000.0) as u16,
            seen: 0,
            shown: Vec::with_capacity(usize::from(columns) * usize::from(rows)),
        })
    }

    /// Adds the next frame, one byte per pixel, row by row.
    ///
    /// # Errors
    /// [`OutputError`] if the file cannot be written, or the frame has another size.
    pub fn push(&mut self, pixels: &[u8]) -> Result<(), OutputError> {
        self.seen += 1;
        if !(self.seen - 1).is_multiple_of(self.every) {
            return Ok(());
        }
        let [width, height] = self.size;
        if pixels.len() != width * height {
            let cause = format!("{} pixels found, {width} x {height} expected", pixels.len());
            return Err(OutputError::write(
                &self.path,
                io::Error::new(io::ErrorKind::InvalidInput, cause),
            ));
        }
        let cell = self.cell;
        self.shown.clear();
        for row in 0..height / cell {
            for column in 0..width / cell {
                let rows = (row * cell..(row + 1) * cell).map(|row| row * width + column * cell);
                let sum: usize = rows
                    .flat_map(|start| &pixels[start..start + cell])
                    .map(|grey| usize::from(*grey))
                    .sum();
                // The grey level nearest to the mean.
                let white = 255 * cell * cell;
                self.shown.push(((2 * sum * (GREYS - 1) + white) / (2 * white)) as u8);
            }
        }
        let frame = gif::Frame {
            width: (width / cell) as u16,
            height: (height / cell) as u16,
            delay: self.delay,
            buffer: Cow::Borrowed(&self.shown),
            ..gif::Frame::default()
        };
        self.encoder
            .write_frame(&frame)
            .map_err(|error| OutputError::write(&self.path, system(error)))
    }

    /// Completes the file.
    ///
    /// # Errors
    /// [`OutputError`] if the file cannot be written.
    pub fn finish(self) -> Result<(), OutputError> {
        let path = self.path;
        let wrong = |cause| OutputError::write(&path, cause);
        let mut file = self.encoder.into_inner().map_err(|error| wrong(system(error)))?;
        file.flush().map_err(wrong)
    }
}

/// Converts an encoder error into an I/O error.
fn system(error: EncodingError) -> io::Error {
    match error {
        EncodingError::Io(error) => error,
        other => io::Error::other(other.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 900 pixels are 2.1 times too wide: downscaled by three. Of frames every 0.04 s every other is used.
    #[test]
    fn a_preview_is_small_and_as_long_as_the_frames() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.gif");
        let mut preview = Preview::create(&path, 900, 30, 0.04).unwrap();
        for frame in 0..5u8 {
            // A step from dark to bright in the middle of a cell.
            let pixels: Vec<u8> = (0..900 * 30)
                .map(|index| if index % 900 < 451 { 0 } else { 50 * (frame + 1) })
                .collect();
            preview.push(&pixels).unwrap();
        }
        assert!(preview.push(&[0; 7]).is_ok(), "one that is not taken");
        assert!(preview.push(&[0; 7]).is_err());
        preview.finish().unwrap();
        let mut options = gif::DecodeOptions::new();
        options.set_color_output(gif::ColorOutput::Indexed);
        let mut decoder = options.read_info(File::open(&path).unwrap()).unwrap();
        assert_eq!((decoder.width(), decoder.height()), (300, 10));
        let palette = decoder.global_palette().unwrap().to_vec();
        let mut frames = 0;
        while let Some(frame) = decoder.read_next_frame().unwrap() {
            assert_eq!(frame.delay, 8);
            let bright = f64::from(50 * (2 * frames + 1));
            let shown = |index: usize| f64::from(palette[3 * usize::from(frame.buffer[index])]);
            for (index, expected) in [
                (0, 0.0),
                (149, 0.0),
                (150, 2.0 / 3.0 * bright),
                (151, bright),
                (299, bright),
            ] {
                assert!(
                    (shown(index) - expected).abs() <= 2.1,
                    "frame {frames}, {index}: {} {expected}",
                    shown(index)
                );
            }
            frames += 1;
        }
        assert_eq!(frames, 3);
    }

    #[test]
    fn what_cannot_be_written_is_told() {
        let folder = tempfile::tempdir().unwrap();
        assert!(Preview::create(&folder.path().join("none/a.gif"), 8, 8, 0.04).is_err());
        let refused = Preview::create(&folder.path().join("a.gif"), 0, 8, 0.04).err().unwrap();
        assert!(refused.to_string().contains("0 x 8"), "{refused}");
    }
}
