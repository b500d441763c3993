//! Animated GIFs of frames: at their own size, or as previews small enough for a page or a message.

use std::borrow::Cow;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use gif::{Encoder, EncodingError, Repeat};

use insonify_base::output::OutputError;
use insonify_base::output::atomic::folder_of;
use insonify_base::output::staged::StagedFile;

/// Largest width, pixels: pictures are downscaled by an integer to fit.
const WIDEST: usize = 426;
/// Minimum interval between pictures, s: half the frames of a typical run, and as fast as most programs show them.
const MIN_S: f64 = 0.08;
/// Number of grey levels of a preview: fewer are smaller, and the steps are invisible on speckle.
const GREYS: usize = 64;

/// Writer of an animated GIF. It repeats for ever, and appears under its name when [`finish`](Gif::finish) returns.
pub struct Gif {
    path: PathBuf,
    staged: StagedFile,
    encoder: Encoder<BufWriter<File>>,
    /// Number of grey levels.
    greys: usize,
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

impl Gif {
    /// Begins a file for grey frames of `width` x `height` pixels (1 to 65,535 each) at intervals of `frame_s` seconds
    /// (above 0), all of them at their own size. Programs show 50 a second at most.
    ///
    /// # Errors
    /// [`OutputError`] if the file cannot be written, or the size is out of range.
    pub fn create(path: &Path, width: usize, height: usize, frame_s: f64) -> Result<Self, OutputError> {
        let delay = (100.0 * frame_s).round().clamp(2.0, 6000.0) as u16;
        Self::begun(path, [width, height], 1, 256, (1, delay))
    }

    /// Begins a preview of such frames: downscaled, with fewer grey levels and frames.
    ///
    /// # Errors
    /// The errors of [`create`](Self::create); sizes may be larger by the downscaling.
    pub fn preview(path: &Path, width: usize, height: usize, frame_s: f64) -> Result<Self, OutputError> {
        let every = (MIN_S / frame_s - 1e-6).ceil().clamp(1.0, 1e6);
        let delay = (100.0 * frame_s * every).round().clamp(1.0, 6000.0) as u16;
        let cell = width.div_ceil(WIDEST).max(1);
        Self::begun(path, [width, height], cell, GREYS, (every as usize, delay))
    }

    fn begun(
        path: &Path,
        size: [usize; 2],
        cell: usize,
        greys: usize,
        (every, delay): (usize, u16),
    ) -> Result<Self, OutputError> {
        let side = |pixels: usize| u16::try_from(pixels / cell).ok().filter(|side| *side > 0);
        let [width, height] = size;
        let (Some(columns), Some(rows)) = (side(width), side(height)) else {
            let cause = format!("{width} x {height} pixels make no animated picture");
            return Err(OutputError::write(
                path,
                io::Error::new(io::ErrorKind::InvalidInput, cause),
            ));
        };
        let wrong = |cause| OutputError::write(path, cause);
        let staged = StagedFile::within(folder_of(path)).map_err(wrong)?;
        let file = BufWriter::new(staged.file.as_file().try_clone().map_err(wrong)?);
        let grey = |level: usize| [(level * 255 / (greys - 1)) as u8; 3];
        let palette: Vec<u8> = (0..greys).flat_map(grey).collect();
        let mut encoder = Encoder::new(file, columns, rows, &palette).map_err(|error| wrong(system(error)))?;
        encoder
            .set_repeat(Repeat::Infinite)
            .map_err(|error| wrong(system(error)))?;
        Ok(Self {
            path: path.to_owned(),
            staged,
            encoder,
            greys,
            size,
            cell,
            every,
            delay,
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
                self.shown
                    .push(((2 * sum * (self.greys - 1) + white) / (2 * white)) as u8);
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
        file.flush().map_err(wrong)?;
        self.staged.persist(&path).map_err(wrong)
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
        let mut preview = Gif::preview(&path, 900, 30, 0.04).unwrap();
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
    fn frames_at_their_own_size_keep_their_grey_levels() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("b.gif");
        let pixels: Vec<u8> = (0..512).map(|index| (index % 256) as u8).collect();
        let mut film = Gif::create(&path, 512, 1, 0.001).unwrap();
        (0..3).for_each(|_| film.push(&pixels).unwrap());
        assert!(!path.exists(), "not before it is whole");
        film.finish().unwrap();
        let mut options = gif::DecodeOptions::new();
        options.set_color_output(gif::ColorOutput::RGBA);
        let mut decoder = options.read_info(File::open(&path).unwrap()).unwrap();
        let mut frames = 0;
        while let Some(frame) = decoder.read_next_frame().unwrap() {
            assert_eq!((frame.delay, frame.width), (2, 512));
            let grey: Vec<u8> = frame.buffer.chunks(4).map(|pixel| pixel[0]).collect();
            assert_eq!(grey, pixels);
            frames += 1;
        }
        assert_eq!(frames, 3);
    }

    #[test]
    fn what_cannot_be_written_is_told() {
        let folder = tempfile::tempdir().unwrap();
        assert!(Gif::preview(&folder.path().join("none/a.gif"), 8, 8, 0.04).is_err());
        let refused = Gif::preview(&folder.path().join("a.gif"), 0, 8, 0.04).err().unwrap();
        assert!(refused.to_string().contains("0 x 8"), "{refused}");
    }
}
