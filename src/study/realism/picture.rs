//! Input frames from PNG and DICOM files, folders of them, and image sequences.

mod dicom;
#[cfg(test)]
mod tests;

use std::fs;
use std::io::Cursor;
use std::path::{Path, PathBuf};

use image::{DynamicImage, ImageFormat, ImageReader, Limits};

use insonify_anatomy::volume::{At, VolumeError};
use insonify_base::{border, read};
use insonify_imaging::sidecar::Sidecar;
use insonify_imaging::synth::layers::Layer;
use insonify_tracking::sequence::Sequence;

/// Least difference between the channels of a coloured overlay pixel: grey maps of scanners are tinted by less.
const COLOURED: u8 = 40;
/// Plausible pixel sizes, mm.
pub const PIXEL_MM: std::ops::RangeInclusive<f64> = 0.001..=10.0;
/// Largest number of columns and of rows of a picture.
const MAX_SIDE_PX: u32 = 8192;

/// Luminance of a frame (Rec. 709), row by row, rows along depth.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Picture {
    /// File name, with the frame number within a sequence.
    pub name: String,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Grey levels, 0 to 255.
    pub grey: Vec<f64>,
    /// Mask of coloured pixels: text, rulers, colour Doppler. Empty if there are none.
    pub overlay: Vec<bool>,
    /// Distance between columns and between rows, mm; `None` if unknown.
    pub mm: Option<[f64; 2]>,
    /// Grey levels of a neighbouring frame of the sequence: the next one, or for the last frame the previous one.
    pub neighbour: Option<Vec<f64>>,
}

/// Reads frames from PNG files, folders of PNG and DICOM files (without the layers that this program writes beside its
/// frames), and DICOM files and image sequences, of which up to `per_sequence` evenly spaced frames are taken. The
/// pixel size comes from the sidecar of a PNG file or from the sequence (its spacing, or the scale of its transform
/// from `Image`; of DICOM its calibrated regions), otherwise from `mm_per_pixel`.
///
/// # Errors
/// [`VolumeError`] with the file, the content found and the content expected.
pub fn read(paths: &[PathBuf], per_sequence: usize, mm_per_pixel: Option<f64>) -> Result<Vec<Picture>, VolumeError> {
    let mut pictures = Vec::new();
    for path in paths {
        if path.is_dir() {
            for file in folder(path)? {
                pictures.extend(frames(&file, per_sequence)?);
            }
        } else {
            pictures.extend(frames(path, per_sequence)?);
        }
    }
    for picture in &mut pictures {
        let stated = picture.mm.filter(|mm| mm.iter().all(|mm| PIXEL_MM.contains(mm)));
        picture.mm = stated.or(mm_per_pixel.map(|mm| [mm; 2]));
    }
    Ok(pictures)
}

/// Reads frames of a file by its kind.
fn frames(path: &Path, max_frames: usize) -> Result<Vec<Picture>, VolumeError> {
    match path {
        _ if has_ending(path, "png") => Ok(vec![png(path)?]),
        _ if is_dicom(path) => dicom::read(path, max_frames),
        _ => sequence(path, max_frames),
    }
}

/// Evenly spaced frame numbers, up to `max_frames`, the first and the last among them.
fn spread(frames: usize, max_frames: usize) -> impl Iterator<Item = usize> {
    let count = max_frames.clamp(1, frames.max(1));
    (0..count).map(move |n| n * (frames - 1) / (count - 1).max(1))
}

fn has_ending(path: &Path, ending: &str) -> bool {
    path.extension()
        .is_some_and(|extension| extension.eq_ignore_ascii_case(ending))
}

/// Lists the PNG and DICOM files of a folder by name, without layers and overviews.
fn folder(path: &Path) -> Result<Vec<PathBuf>, VolumeError> {
    let fail = |cause| VolumeError::read(path, cause);
    let layer_suffixes: Vec<String> = Layer::ALL
        .iter()
        .map(|layer| format!("_{}", layer.name()))
        .chain(["_overview".to_owned()])
        .collect();
    let mut files = Vec::new();
    for entry in fs::read_dir(path).map_err(fail)? {
        let file = entry.map_err(fail)?.path();
        let stem = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        if (has_ending(&file, "png") || has_ending(&file, "dcm"))
            && !layer_suffixes.iter().any(|suffix| stem.ends_with(suffix))
        {
            files.push(file);
        }
    }
    files.sort();
    if files.is_empty() {
        return Err(VolumeError::malformed(
            path,
            At::Folder,
            "no PNG or DICOM file",
            "frames as .png or .dcm files",
        ));
    }
    Ok(files)
}

fn png(path: &Path) -> Result<Picture, VolumeError> {
    let mm = pixel_mm(&Sidecar::path_for(path)).map(|mm| [mm; 2]);
    Ok(Picture::of(decoded_png(path)?, path.display().to_string(), mm))
}

/// Decodes a PNG file of at most [`MAX_SIDE_PX`] columns and rows.
pub(crate) fn decoded_png(path: &Path) -> Result<DynamicImage, VolumeError> {
    let bytes = read::bytes(path, read::PNG).map_err(|cause| VolumeError::read(path, cause))?;
    let refuse = |fault: String| VolumeError::malformed(path, At::Pixels, fault, "a PNG file, grey or RGB");
    let promised = png_bytes(&bytes).map_err(refuse)?;
    border::check(promised, bytes.len() as u64, "a picture").map_err(|cause| VolumeError::read(path, cause))?;
    let mut reader = ImageReader::with_format(Cursor::new(bytes), ImageFormat::Png);
    let mut limits = Limits::default();
    (limits.max_image_width, limits.max_image_height) = (Some(MAX_SIDE_PX), Some(MAX_SIDE_PX));
    reader.limits(limits);
    border::decoded(|| reader.decode()).map_err(refuse)
}

/// Bytes of the rows of a PNG file by its header; the error says what a decoder must not be given. What is not a header
/// is for the decoder to refuse.
fn png_bytes(file: &[u8]) -> Result<u64, String> {
    let mut promised = 0;
    let mut rest = file.get(8..).unwrap_or_default();
    while let Some((head, after)) = rest.split_first_chunk::<8>() {
        let [a, b, c, d, kind @ ..] = *head;
        let length = u32::from_be_bytes([a, b, c, d]) as usize;
        let Some(data) = after.get(..length) else { break };
        match (&kind, data) {
            (b"IHDR", [w0, w1, w2, w3, h0, h1, h2, h3, depth, colour, ..]) => {
                let [width, height] = [[*w0, *w1, *w2, *w3], [*h0, *h1, *h2, *h3]].map(u32::from_be_bytes);
                let channels = match colour {
                    2 => 3,
                    4 => 2,
                    6 => 4,
                    _ => 1,
                };
                let row = (u64::from(width) * channels * u64::from(*depth)).div_ceil(8);
                promised = row.saturating_mul(u64::from(height));
            }
            (b"PLTE", _) if length == 0 || length > 768 || !length.is_multiple_of(3) => {
                return Err(format!("a palette of {length} bytes, which is not 1 to 256 colours"));
            }
            (b"IDAT", _) => break,
            _ => {}
        }
        // The checksum follows.
        rest = after.get(length + 4..).unwrap_or_default();
    }
    Ok(promised)
}

/// Whether a pixel has a hue, as Doppler and annotations have.
fn is_coloured([red, green, blue]: [u8; 3]) -> bool {
    red.max(green).max(blue) - red.min(green).min(blue) >= COLOURED
}

impl Picture {
    fn of(image: DynamicImage, name: String, mm: Option<[f64; 2]>) -> Self {
        let mut overlay = Vec::new();
        if image.color().has_color() {
            overlay = image.to_rgb8().pixels().map(|pixel| is_coloured(pixel.0)).collect();
        }
        Self {
            name,
            width: image.width() as usize,
            height: image.height() as usize,
            grey: image.into_luma8().iter().map(|&grey| f64::from(grey)).collect(),
            overlay,
            mm,
            neighbour: None,
        }
    }
}

/// Reads the pixel size from a sidecar, mm; `None` if there is none.
fn pixel_mm(sidecar: &Path) -> Option<f64> {
    let text = read::text(sidecar, read::TOML).ok()?;
    let json: serde_json::Value = serde_json::from_str(&text).ok()?;
    json["image"]["pixel_mm"].as_f64()
}

/// Reads evenly spaced frames of a sequence.
fn sequence(path: &Path, max_frames: usize) -> Result<Vec<Picture>, VolumeError> {
    let expected =
        "frames as .png or .dcm files, folders of them, or image sequences (.mha, .mhd, .nrrd) of grey bytes";
    let sequence = Sequence::read(path)?;
    let is_picture = |kind: &str| matches!(kind, "BRIGHTNESS" | "RGB_COLOR");
    if let Some(kind) = sequence.image_type.as_ref().filter(|kind| !is_picture(kind)) {
        let kind_found = format!("images of type {kind}");
        return Err(VolumeError::malformed(
            path,
            At::Header,
            kind_found,
            "images of type BRIGHTNESS or RGB_COLOR",
        ));
    }
    // Frames without a valid image go before the choice, which is then even among those that can be measured.
    let image_indices: Vec<usize> = (0..sequence.frames.len())
        .filter(|&index| sequence.image(index).is_some())
        .collect();
    if image_indices.is_empty() {
        return Err(VolumeError::malformed(path, At::Pixels, "no valid image", expected));
    }
    let chosen = spread(image_indices.len(), max_frames).map(|n| image_indices[n]);
    let grey = |index: usize| -> Option<Vec<f64>> {
        let image = sequence.image(index)?;
        Some(image.pixels.iter().map(|&grey| f64::from(grey)).collect())
    };
    let pictures = chosen.filter_map(|index| {
        let [width, height] = sequence.image_size?;
        Some(Picture {
            name: format!("{}, frame {index}", path.display()),
            width,
            height,
            grey: grey(index)?,
            overlay: sequence
                .colours(index)
                .map_or_else(Vec::new, |colours| colours.into_iter().map(is_coloured).collect()),
            mm: sequence.spacing_mm.or_else(|| scale(&sequence, index)),
            neighbour: grey(index + 1).or_else(|| grey(index.checked_sub(1)?)),
        })
    });
    Ok(pictures.collect())
}

/// Returns the scale of a frame's transform from pixels to millimetres; `None` if it is missing, or 1 as for an unknown
/// size.
fn scale(sequence: &Sequence, frame: usize) -> Option<[f64; 2]> {
    let transforms = sequence.frames.get(frame)?.transforms.iter();
    let from_pixels =
        |name: &str| (name.starts_with("ImageTo") || name.starts_with("CroppedImageTo")) && !name.ends_with("Image");
    let known = transforms.filter(|(name, transform)| transform.valid && from_pixels(name));
    known
        .map(|(_, transform)| [0, 1].map(|axis| transform.matrix.fixed_view::<3, 1>(0, axis).norm()))
        .find(|mm| *mm != [1.0; 2])
}

/// Returns whether a file is a DICOM file by its header (DICOM PS3.10, 7.1: 128 bytes, then `DICM`) or its name.
fn is_dicom(path: &Path) -> bool {
    use std::io::Read;
    let mut start = [0; 132];
    let is_read = read::open(path).and_then(|mut file| file.read_exact(&mut start));
    has_ending(path, "dcm") || is_read.is_ok() && start[128..] == *b"DICM"
}
