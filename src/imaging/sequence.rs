//! Image sequences with one pose per frame, in the convention of PLUS: `.mha` and `.nrrd`, uint8 (layers uint16),
//! orientation MF; and NumPy arrays (`.npy`), of pixels alone.

use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use flate2::Compression;
use flate2::write::{GzEncoder, ZlibEncoder};
use nalgebra::Matrix4;

use insonify_base::output::atomic::folder_of;
use insonify_base::output::{OutputError, atomic};
use insonify_tracking::sequence::SequenceFrame;

/// Metadata of an image.
#[derive(Clone, Debug, Default)]
pub struct FrameInfo<'a> {
    /// Timestamp, s.
    pub timestamp: f64,
    /// Name such as `ProbeToTracker`, matrix from the first coordinates to the second (mm), and whether it is
    /// valid. A matrix that is not finite is written as the identity and marked invalid.
    pub transforms: &'a [(&'a str, Matrix4<f64>, bool)],
    /// Whether the image shows anything.
    pub image_valid: bool,
}

/// Transforms of a rendered frame: `ImageToWorld` (`CroppedImageToWorld` if it has the pixels of a cropped recording)
/// and `TransducerToWorld` (the centre of the array), and all others recorded for it by a tracker.
pub fn transforms(
    [image_to_world, transducer_to_world]: [Matrix4<f64>; 2],
    recorded: Option<&SequenceFrame>,
) -> Vec<(&str, Matrix4<f64>, bool)> {
    let cropped = recorded.is_some_and(|frame| frame.transforms.contains_key("ImageToCroppedImage"));
    let image = if cropped { "CroppedImageToWorld" } else { "ImageToWorld" };
    let mut transforms = vec![
        (image, image_to_world, true),
        ("TransducerToWorld", transducer_to_world, true),
    ];
    let others = recorded.into_iter().flat_map(|frame| &frame.transforms);
    let others = others
        .filter(|(name, _)| !["ImageToWorld", "CroppedImageToWorld", "TransducerToWorld"].contains(&name.as_str()));
    transforms.extend(others.map(|(name, transform)| (name.as_str(), transform.matrix, transform.valid)));
    transforms
}

fn wrong_size(path: &Path, frame: usize, found: usize, [width, height]: [usize; 2]) -> OutputError {
    let expected = format!("{width} x {height} and at least one");
    OutputError::contents(
        path,
        format!("found {found} pixels in frame {frame}, expected {expected}"),
    )
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Format {
    MetaImage,
    Nrrd,
    /// Version 1.0 of NumPy's format, in C order: frames, rows, columns.
    Npy,
}

/// Contents of the pixels.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Pixels {
    Grey,
    Layer,
    Echoes,
    FloatEchoes,
}

impl Pixels {
    fn bytes(self) -> usize {
        match self {
            Self::Grey => 1,
            Self::Layer | Self::Echoes => 2,
            Self::FloatEchoes => 4,
        }
    }
}

enum Packer {
    Zlib(ZlibEncoder<BufWriter<File>>),
    Gzip(GzEncoder<BufWriter<File>>),
    Raw(BufWriter<File>),
}

/// Writer of a sequence, frame by frame: `.mha` and `.nrrd` with the transforms and times of the frames, compressed
/// unless [`SequenceWriter::uncompressed`]; `.npy` with the pixels alone, never compressed. Pixels go to a temporary
/// file, so memory use is independent of their number; the sequence appears under its name when
/// [`SequenceWriter::finish`] returns, and not at all if it is dropped before.
///
/// ```
/// use insonify_imaging::sequence::{FrameInfo, SequenceWriter};
/// use insonify_tracking::sequence::Sequence;
/// use nalgebra::Matrix4;
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("sweep.igs.mha");
/// let mut writer = SequenceWriter::create(&path, 2, 3)?;
/// let transforms = [("ImageToWorld", Matrix4::new_scaling(0.2), true)];
/// let info = FrameInfo { timestamp: 0.5, transforms: &transforms, image_valid: true };
/// writer.push(&[0, 50, 100, 150, 200, 250], &info)?;
/// writer.finish()?;
///
/// let image = Sequence::read(&path)?.image(0).ok_or("no image")?;
/// assert_eq!((image.width, image.height, image.pixels[5]), (2, 3, 250));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct SequenceWriter {
    path: PathBuf,
    format: Format,
    width: usize,
    height: usize,
    pixels: Pixels,
    frames: usize,
    keys: String,
    packer: Packer,
}

impl SequenceWriter {
    /// Starts a sequence of images of `width` columns and `height` rows.
    ///
    /// # Errors
    /// [`OutputError::Contents`] for another ending or images without pixels, [`OutputError::Write`].
    pub fn create(path: &Path, width: usize, height: usize) -> Result<Self, OutputError> {
        let ending = path
            .extension()
            .map(|ending| ending.to_string_lossy().to_ascii_lowercase());
        let format = match ending.as_deref() {
            Some("mha") => Format::MetaImage,
            Some("nrrd") => Format::Nrrd,
            Some("npy") => Format::Npy,
            other => {
                let found = other.unwrap_or_default();
                let text = format!("found the ending {found:?}, expected .mha, .nrrd or .npy");
                return Err(OutputError::contents(path, text));
            }
        };
        if width == 0 || height == 0 {
            return Err(wrong_size(path, 0, 0, [width, height]));
        }
        let file = pixel_file(path)?;
        let packer = match format {
            Format::MetaImage => Packer::Zlib(ZlibEncoder::new(file, Compression::default())),
            Format::Nrrd => Packer::Gzip(GzEncoder::new(file, Compression::default())),
            Format::Npy => Packer::Raw(file),
        };
        Ok(Self {
            path: path.to_owned(),
            format,
            width,
            height,
            pixels: Pixels::Grey,
            frames: 0,
            keys: String::new(),
            packer,
        })
    }

    /// Starts a sequence of layers: pixels of 16 bits, two bytes each (little-endian) in [`SequenceWriter::push`].
    ///
    /// # Errors
    /// The errors of [`SequenceWriter::create`].
    pub fn create_layer(path: &Path, width: usize, height: usize) -> Result<Self, OutputError> {
        let images = Self::create(path, width, height)?;
        Ok(Self {
            pixels: Pixels::Layer,
            ..images
        })
    }

    /// Starts a sequence of radio-frequency echoes (`RF_REAL`): a row of samples for each line, away from the probe,
    /// signed 16-bit numbers or 32-bit floating-point ones.
    ///
    /// # Errors
    /// The errors of [`SequenceWriter::create`].
    pub fn create_echoes(path: &Path, samples: usize, lines: usize, float: bool) -> Result<Self, OutputError> {
        let images = Self::create(path, samples, lines)?;
        Ok(Self {
            pixels: if float { Pixels::FloatEchoes } else { Pixels::Echoes },
            ..images
        })
    }

    /// Leaves out the compression, which takes most of the time of writing, before the first frame.
    ///
    /// # Errors
    /// [`OutputError::Write`].
    pub fn uncompressed(self) -> Result<Self, OutputError> {
        debug_assert!(self.frames == 0);
        let packer = Packer::Raw(pixel_file(&self.path)?);
        Ok(Self { packer, ..self })
    }

    /// Sets a field of the sequence, such as `WorldAxes`, before the first frame; `.npy` has none. Names consist of
    /// letters, and values of one line.
    pub fn field(&mut self, name: &str, value: &str) {
        debug_assert!(self.frames == 0 && name.chars().all(|c| c.is_ascii_alphabetic()) && !value.contains('\n'));
        let is = self.assignment();
        // Writing to a string cannot fail.
        let _ = writeln!(self.keys, "{name}{is}{value}");
    }

    /// Adds a frame: pixels row by row from the near unmarked corner.
    ///
    /// # Errors
    /// [`OutputError::Contents`], [`OutputError::Write`].
    pub fn push(&mut self, pixels: &[u8], info: &FrameInfo) -> Result<(), OutputError> {
        let expected = self.width.checked_mul(self.height);
        if expected.and_then(|expected| expected.checked_mul(self.pixels.bytes())) != Some(pixels.len()) {
            let (found, size) = (pixels.len() / self.pixels.bytes(), [self.width, self.height]);
            return Err(wrong_size(&self.path, self.frames, found, size));
        }
        for (name, _, _) in info.transforms {
            if name.is_empty() || !name.chars().all(|c| c.is_alphanumeric() || "_-.".contains(c)) {
                let expected = "expected letters, digits, `_`, `-` and `.` as in \"ProbeToTracker\"";
                let text = format!("found the transform name {name:?}, {expected}");
                return Err(OutputError::contents(&self.path, text));
            }
        }
        match &mut self.packer {
            Packer::Zlib(packer) => packer.write_all(pixels),
            Packer::Gzip(packer) => packer.write_all(pixels),
            Packer::Raw(packer) => packer.write_all(pixels),
        }
        .map_err(|cause| OutputError::write(&self.path, cause))?;
        if self.format != Format::Npy {
            self.push_keys(info);
        }
        self.frames += 1;
        Ok(())
    }

    fn key(&mut self, name: &str, value: &str) {
        let is = self.assignment();
        // Writing to a string cannot fail.
        let _ = writeln!(self.keys, "Seq_Frame{:04}_{name}{is}{value}", self.frames);
    }

    fn assignment(&self) -> &'static str {
        match self.format {
            Format::MetaImage => " = ",
            Format::Nrrd | Format::Npy => ":=",
        }
    }

    fn push_keys(&mut self, info: &FrameInfo) {
        let status = |ok: bool| if ok { "OK" } else { "INVALID" };
        for &(name, matrix, valid) in info.transforms {
            let finite = matrix.iter().all(|number| number.is_finite());
            let matrix = if finite { matrix } else { Matrix4::identity() };
            let numbers: Vec<String> = matrix.transpose().iter().map(f64::to_string).collect();
            self.key(&format!("{name}Transform"), &numbers.join(" "));
            self.key(&format!("{name}TransformStatus"), status(valid && finite));
        }
        self.key("Timestamp", &info.timestamp.to_string());
        // PLUS's own NRRD sequences shorten this key.
        let image_status = match self.format {
            Format::MetaImage => "ImageStatus",
            Format::Nrrd | Format::Npy => "Status",
        };
        self.key(image_status, status(info.image_valid));
    }

    /// Writes the header and renames the file to its final path.
    ///
    /// # Errors
    /// [`OutputError::Contents`] without frames, [`OutputError::Write`].
    pub fn finish(mut self) -> Result<(), OutputError> {
        if self.frames == 0 {
            let text = "found no frames, expected at least one".to_owned();
            return Err(OutputError::contents(&self.path, text));
        }
        let Self { path, packer, .. } = &mut self;
        let packed = match packer {
            Packer::Zlib(packer) => packer.try_finish().map(|()| packer.get_mut()),
            Packer::Gzip(packer) => packer.try_finish().map(|()| packer.get_mut()),
            Packer::Raw(packer) => Ok(packer),
        };
        let fail = |cause| OutputError::write(path, cause);
        let packed = packed.and_then(|buffer| buffer.flush().map(|()| buffer.get_mut()));
        let mut packed = packed.and_then(|packed| packed.try_clone()).map_err(fail)?;
        let length = packed.stream_position().map_err(fail)?;
        packed.seek(SeekFrom::Start(0)).map_err(fail)?;
        let head = self.header(length);
        atomic::write(&self.path, |file| {
            file.write_all(&head)?;
            io::copy(&mut packed, file).map(drop)
        })
    }

    /// Header of a file whose pixels take `length` bytes, packed or not.
    fn header(&self, length: u64) -> Vec<u8> {
        let Self {
            width,
            height,
            frames,
            keys,
            ..
        } = self;
        let packed = !matches!(self.packer, Packer::Raw(_));
        let (kind, orientation) = match self.pixels {
            Pixels::Grey | Pixels::Layer => ("BRIGHTNESS", "MF"),
            Pixels::Echoes | Pixels::FloatEchoes => ("RF_REAL", "FM"),
        };
        let element = self.element();
        match self.format {
            Format::MetaImage => {
                let compressed = if packed { "True" } else { "False" };
                let size = if packed {
                    format!("CompressedDataSize = {length}\n")
                } else {
                    String::new()
                };
                format!(
                    "ObjectType = Image\nNDims = 3\nAnatomicalOrientation = RAI\nBinaryData = True\n\
                     BinaryDataByteOrderMSB = False\nCenterOfRotation = 0 0 0\nCompressedData = {compressed}\n\
                     DimSize = {width} {height} {frames}\nElementNumberOfChannels = 1\nElementSpacing = 1 1 1\nElementType = {element}\n\
                     Kinds = domain domain list\nOffset = 0 0 0\nTransformMatrix = 1 0 0 0 1 0 0 0 1\n\
                     UltrasoundImageOrientation = {orientation}\nUltrasoundImageType = {kind}\n{size}{keys}ElementDataFile = LOCAL\n"
                )
                .into()
            }
            Format::Nrrd => {
                let encoding = if packed { "gzip" } else { "raw" };
                format!(
                    "NRRD0004\ntype: {element}\ndimension: 3\nspace dimension: 2\nsizes: {width} {height} {frames}\n\
                     space directions: (1,0) (0,1) none\nkinds: domain domain list\nendian: little\nencoding: {encoding}\n\
                     space origin: (0,0)\nultrasound image orientation:={orientation}\nultrasound image type:={kind}\n{keys}\n"
                )
                .into()
            }
            Format::Npy => {
                let shape = format!("({frames}, {height}, {width})");
                let text = format!("{{'descr': '{element}', 'fortran_order': False, 'shape': {shape}, }}");
                // Magic, version, length of the text, then the text, a multiple of 64 bytes with the end of its line.
                let length = (text.len() + 11).next_multiple_of(64) - 10;
                let mut head = b"\x93NUMPY\x01\x00".to_vec();
                head.extend((length as u16).to_le_bytes());
                head.extend(format!("{text:<0$}\n", length - 1).bytes());
                head
            }
        }
    }

    /// Name of the type of a pixel.
    fn element(&self) -> &'static str {
        let names = match self.pixels {
            Pixels::Grey => ["MET_UCHAR", "uint8", "|u1"],
            Pixels::Layer => ["MET_USHORT", "uint16", "<u2"],
            Pixels::Echoes => ["MET_SHORT", "int16", "<i2"],
            Pixels::FloatEchoes => ["MET_FLOAT", "float", "<f4"],
        };
        names[self.format as usize]
    }
}

/// A file for pixels, beside the target and unnamed, so that a full or forbidden folder is detected at once.
fn pixel_file(path: &Path) -> Result<BufWriter<File>, OutputError> {
    let file = tempfile::tempfile_in(folder_of(path)).map_err(|cause| OutputError::write(path, cause))?;
    Ok(BufWriter::new(file))
}

#[cfg(test)]
mod tests {
    use super::*;
    use insonify_base::blame::Blame;
    use insonify_tracking::sequence::{Sequence, TrackedTransform};

    #[test]
    fn sequences_come_back() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.igs.mha", "a.igs.nrrd"] {
            let path = folder.path().join(name);
            let mut writer = SequenceWriter::create(&path, 3, 2).unwrap();
            let pose = Matrix4::from_fn(|r, c| {
                if r == 3 {
                    f64::from(u8::from(c == 3))
                } else {
                    0.1 * (r * 4 + c) as f64
                }
            });
            let broken = Matrix4::repeat(f64::NAN);
            writer.field("WorldAxes", "RAS");
            for frame in 0..4u8 {
                let transforms = [("ProbeToTracker", pose, frame != 2), ("NeedleToTracker", broken, true)];
                let info = FrameInfo {
                    timestamp: f64::from(frame) * 0.1,
                    transforms: &transforms,
                    image_valid: frame != 3,
                };
                writer.push(&[frame, 1, 2, 3, 4, 5], &info).unwrap();
            }
            writer.finish().unwrap();
            let read = Sequence::read(&path).unwrap();
            assert_eq!(read.warnings, [""; 0], "{name}");
            let field = ["\nWorldAxes = RAS\n", "\nWorldAxes:=RAS\n"][usize::from(name.ends_with("nrrd"))];
            let bytes = std::fs::read(&path).unwrap();
            assert!(
                bytes.windows(field.len()).any(|window| window == field.as_bytes()),
                "{name}"
            );
            assert_eq!((read.image_size, read.frames.len()), (Some([3, 2]), 4));
            assert_eq!(read.image_type.as_deref(), Some("BRIGHTNESS"));
            assert_eq!(read.frames[1].timestamp, Some(0.1));
            assert_eq!(read.frames[1].transforms["ProbeToTracker"].matrix, pose);
            let valid: Vec<bool> = read
                .frames
                .iter()
                .map(|f| f.transforms["ProbeToTracker"].valid)
                .collect();
            assert_eq!(valid, [true, true, false, true]);
            assert!(!read.frames[0].transforms["NeedleToTracker"].valid);
            assert_eq!(read.image(1).unwrap().pixels, [1, 1, 2, 3, 4, 5]);
            assert_eq!(read.image(3), None);
            let length = std::fs::metadata(&path).unwrap().len();
            assert!(length < 4000, "{length}");
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
    }

    #[test]
    fn images_on_the_pixels_of_a_cropped_recording_are_named_so() {
        let place = Matrix4::identity();
        let names = |frame: Option<&SequenceFrame>| transforms([place; 2], frame)[0].0.to_owned();
        let crop = TrackedTransform {
            matrix: place,
            valid: true,
        };
        let cropped = SequenceFrame {
            index: 0,
            timestamp: None,
            transforms: [("ImageToCroppedImage".to_owned(), crop)].into(),
            image_valid: true,
        };
        assert_eq!(
            [names(None), names(Some(&cropped))],
            ["ImageToWorld", "CroppedImageToWorld"]
        );
    }

    #[test]
    fn without_compression_the_pixels_end_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let pixels: Vec<u8> = (0..18).collect();
        for name in ["a.mha", "a.nrrd", "a.npy"] {
            let path = folder.path().join(name);
            let mut writer = SequenceWriter::create(&path, 3, 2).unwrap().uncompressed().unwrap();
            writer.field("WorldAxes", "LPS");
            let transforms = [("ProbeToTracker", Matrix4::identity(), true)];
            let info = FrameInfo {
                timestamp: 0.5,
                transforms: &transforms,
                image_valid: true,
            };
            for frame in pixels.chunks(6) {
                writer.push(frame, &info).unwrap();
            }
            writer.finish().unwrap();
            let bytes = std::fs::read(&path).unwrap();
            assert!(bytes.ends_with(&pixels), "{name}");
            if name != "a.npy" {
                let read = Sequence::read(&path).unwrap();
                assert_eq!((read.frames.len(), read.warnings.len()), (3, 0), "{name}");
                assert_eq!(read.image(2).unwrap().pixels, pixels[12..], "{name}");
                assert_eq!(read.frames[1].timestamp, Some(0.5));
            }
        }
    }

    /// NumPy's format, version 1.0, from its specification (NEP 1).
    #[test]
    fn arrays_have_the_header_of_numpy() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npy");
        let mut layers = SequenceWriter::create_layer(&path, 3, 2).unwrap();
        let pixels: Vec<u8> = (1..=6u16).flat_map(|value| (1000 * value).to_le_bytes()).collect();
        for _ in 0..12 {
            layers.push(&pixels, &FrameInfo::default()).unwrap();
        }
        let other = layers.push(&pixels[2..], &FrameInfo::default()).unwrap_err();
        assert!(
            other.to_string().contains("found 5 pixels in frame 12, expected 3 x 2"),
            "{other}"
        );
        layers.finish().unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let (magic, rest) = bytes.split_at(8);
        assert_eq!(magic, b"\x93NUMPY\x01\x00");
        let length = usize::from(u16::from_le_bytes([rest[0], rest[1]]));
        assert_eq!((10 + length) % 64, 0);
        let (text, data) = rest[2..].split_at(length);
        let text = std::str::from_utf8(text).unwrap();
        assert_eq!(
            text.trim_end(),
            "{'descr': '<u2', 'fortran_order': False, 'shape': (12, 2, 3), }"
        );
        assert!(text.ends_with('\n') && text.is_ascii());
        assert_eq!(data, pixels.repeat(12));
    }

    #[test]
    fn half_written_sequences_leave_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mha");
        let mut writer = SequenceWriter::create(&path, 2, 2).unwrap();
        let info = FrameInfo::default();
        assert!(matches!(writer.push(&[0; 3], &info), Err(OutputError::Contents { .. })));
        writer.push(&[0; 4], &info).unwrap();
        drop(writer);
        let empty = SequenceWriter::create(&path, 2, 2).unwrap().finish().unwrap_err();
        assert!(matches!(empty, OutputError::Contents { .. }) && !empty.is_machine());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn wrong_names_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        assert!(matches!(
            SequenceWriter::create(&folder.path().join("a.avi"), 1, 1),
            Err(OutputError::Contents { .. })
        ));
        let away = SequenceWriter::create(&folder.path().join("no/a.mha"), 1, 1);
        assert!(away.is_err_and(|error| !error.is_machine()));
        let mut writer = SequenceWriter::create(&folder.path().join("a.mha"), 1, 1).unwrap();
        let transforms = [("Probe = x\nTo", Matrix4::identity(), true)];
        let info = FrameInfo {
            transforms: &transforms,
            ..FrameInfo::default()
        };
        assert!(matches!(writer.push(&[0], &info), Err(OutputError::Contents { .. })));
        // A name of 3D Slicer's joins no two frames, and is kept.
        let transforms = [("LinearTransform_3", Matrix4::identity(), true)];
        let info = FrameInfo {
            transforms: &transforms,
            ..info
        };
        writer.push(&[0], &info).unwrap();
        writer.finish().unwrap();
        let read = Sequence::read(&folder.path().join("a.mha")).unwrap();
        assert!(read.frames[0].transforms.contains_key("LinearTransform_3"));
    }
}
