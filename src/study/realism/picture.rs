//! Input frames from PNG, JPEG and DICOM files, folders of them, and image sequences.

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
/// Endings of the pictures that are read.
const PICTURES: [&str; 3] = ["png", "jpg", "jpeg"];
/// Formats that are read, and converters of others to them.
const READ: &str = "frames as .png, .jpg or .dcm files, folders of them, or image sequences (.mha, .mhd, .nrrd) of grey bytes; \
                    `magick a.tif a.png` (ImageMagick) converts other pictures, `ffmpeg -i a.mp4 a_%03d.png` videos";

/// Luminance of a frame (Rec. 709), row by row, rows along depth.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Picture {
    /// File name, with the frame number within a sequence.
    pub name: String,
    /// Organ or view: frames of one group are compared together.
    pub group: String,
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

/// Reads frames from PNG and JPEG files, folders of these and DICOM files, and DICOM files and image sequences, of
/// which up to `per_sequence` evenly spaced frames are taken. A folder without frames is read by its sub-folders;
/// layers that this program writes beside its frames are left out. The pixel size comes from the sidecar of a PNG or
/// JPEG file or from the sequence (its spacing, or the scale of its transform from `Image`; of DICOM its calibrated
/// regions), otherwise from `mm_per_pixel`.
///
/// Groups are the sub-folders, or the folders where several are given; of other files the names without the number at
/// the end (`liver_01.png`: `liver`), or their folder's where nothing else remains.
///
/// # Errors
/// [`VolumeError`] with the file, the content found and the content expected.
pub fn read(paths: &[PathBuf], per_sequence: usize, mm_per_pixel: Option<f64>) -> Result<Vec<Picture>, VolumeError> {
    let mut pictures = Vec::new();
    let several = paths.iter().filter(|path| path.is_dir()).count() > 1;
    for path in paths {
        let files = if path.is_dir() {
            folder(path)?
        } else {
            vec![path.clone()]
        };
        for file in files {
            let is_by_folder = path.is_dir() && (several || file.parent() != Some(path.as_path()));
            let group = group(&file, is_by_folder);
            pictures.extend(frames(&file, per_sequence)?.into_iter().map(|picture| Picture {
                group: group.clone(),
                ..picture
            }));
        }
    }
    for picture in &mut pictures {
        let stated = picture.mm.filter(|mm| mm.iter().all(|mm| PIXEL_MM.contains(mm)));
        picture.mm = stated.or(mm_per_pixel.map(|mm| [mm; 2]));
    }
    Ok(pictures)
}

/// Group of a file, in lower case: the name of its folder, or its own without ending and the number at its end.
fn group(file: &Path, is_by_folder: bool) -> String {
    let folder = file.parent().and_then(Path::file_name).unwrap_or_default();
    let stem = file.file_stem().unwrap_or_default().to_string_lossy();
    let name = stem.trim_end_matches(".igs");
    let name = name.trim_end_matches(|letter: char| letter.is_ascii_digit() || "_-. ()".contains(letter));
    if is_by_folder || name.is_empty() {
        folder.to_string_lossy().to_lowercase()
    } else {
        name.to_lowercase()
    }
}

/// Reads frames of a file by its kind.
fn frames(path: &Path, max_frames: usize) -> Result<Vec<Picture>, VolumeError> {
    match path {
        _ if is_picture(path) => Ok(vec![picture(path)?]),
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

fn is_picture(path: &Path) -> bool {
    PICTURES.iter().any(|ending| has_ending(path, ending))
}

/// Lists the pictures and DICOM files of a folder by name, or of its sub-folders if there are none.
fn folder(path: &Path) -> Result<Vec<PathBuf>, VolumeError> {
    let (mut files, folders) = frames_in(path)?;
    if files.is_empty() {
        for folder in folders {
            files.extend(frames_in(&folder)?.0);
        }
    }
    if files.is_empty() {
        return Err(VolumeError::malformed(
            path,
            At::Folder,
            "no PNG, JPEG or DICOM file",
            "frames as .png, .jpg or .dcm files, or sub-folders of them",
        ));
    }
    Ok(files)
}

/// Lists pictures and DICOM files without layers and overviews, and sub-folders, by name.
fn frames_in(path: &Path) -> Result<(Vec<PathBuf>, Vec<PathBuf>), VolumeError> {
    let fail = |cause| VolumeError::read(path, cause);
    let layer_suffixes: Vec<String> = Layer::ALL
        .iter()
        .map(|layer| format!("_{}", layer.name()))
        .chain(["_overview".to_owned()])
        .collect();
    let (mut files, mut folders) = (Vec::new(), Vec::new());
    for entry in fs::read_dir(path).map_err(fail)? {
        let file = entry.map_err(fail)?.path();
        let stem = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        if file.is_dir() {
            folders.push(file);
        } else if (is_picture(&file) || has_ending(&file, "dcm"))
            && !layer_suffixes.iter().any(|suffix| stem.ends_with(suffix))
        {
            files.push(file);
        }
    }
    files.sort();
    folders.sort();
    Ok((files, folders))
}

fn picture(path: &Path) -> Result<Picture, VolumeError> {
    let mm = pixel_mm(&Sidecar::path_for(path)).map(|mm| [mm; 2]);
    Ok(Picture::of(decoded(path)?, path.display().to_string(), mm))
}

/// Decodes a PNG or JPEG file of at most [`MAX_SIDE_PX`] columns and rows; which of them it is, its bytes say.
pub(crate) fn decoded(path: &Path) -> Result<DynamicImage, VolumeError> {
    let bytes = read::bytes(path, read::PICTURE).map_err(|cause| VolumeError::read(path, cause))?;
    let refuse = |fault: String| VolumeError::malformed(path, At::Pixels, fault, "a PNG or JPEG file, grey or RGB");
    let (format, promised) = if bytes.starts_with(&JPEG_START) {
        (ImageFormat::Jpeg, jpeg_bytes(&bytes))
    } else {
        (ImageFormat::Png, png_bytes(&bytes))
    };
    border::check(promised.map_err(refuse)?, bytes.len() as u64, "a picture")
        .map_err(|cause| VolumeError::read(path, cause))?;
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    let mut limits = Limits::default();
    (limits.max_image_width, limits.max_image_height) = (Some(MAX_SIDE_PX), Some(MAX_SIDE_PX));
    reader.limits(limits);
    border::decoded(|| reader.decode()).map_err(refuse)
}

/// Marker with which JPEG images start (ISO 10918-1, table B.1).
const JPEG_START: [u8; 2] = [0xff, 0xd8];

/// Columns, rows, samples a pixel and bits a sample by the header of a JPEG image; `None` if it has none.
fn jpeg_sizes(image: &[u8]) -> Option<[usize; 4]> {
    let mut rest = image.strip_prefix(&JPEG_START)?;
    while let [0xff, marker, high, low, segment @ ..] = rest {
        // A start of frame, of any process but hierarchical ones (ISO 10918-1, table B.1).
        if (0xc0..=0xcf).contains(marker) && ![0xc4, 0xc8, 0xcc].contains(marker) {
            let [bits, rows_high, rows_low, columns_high, columns_low, samples, ..] = *segment else {
                return None;
            };
            let [rows, columns] = [[rows_high, rows_low], [columns_high, columns_low]].map(u16::from_be_bytes);
            return Some([columns, rows, samples.into(), bits.into()].map(usize::from));
        }
        match *marker {
            0xff => rest = &rest[1..],
            // Markers without a segment do not precede the sizes.
            0x01 | 0xd0..=0xd9 => return None,
            _ => {
                let length = usize::from(u16::from_be_bytes([*high, *low]));
                rest = rest.get(2 + length.max(2)..).unwrap_or_default();
            }
        }
    }
    None
}

/// Bytes of the pixels of a JPEG file by its header; the error says what a decoder would make up.
fn jpeg_bytes(file: &[u8]) -> Result<u64, String> {
    let [columns, rows, samples, _] = jpeg_sizes(file).ok_or("a JPEG image without sizes")?;
    // Coded data hold no marker (ISO 10918-1, B.1.1.5): of a whole image the end lies behind the start of its last
    // scan.
    let last = |marker: u8| file.windows(2).rposition(|pair| pair == [0xff, marker]);
    if last(0xd9) <= last(0xda) {
        return Err("a JPEG image that is cut off".to_owned());
    }
    Ok((columns * rows * samples) as u64)
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
            ..Self::default()
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
    // Readers of volumes tell by the first bytes what a file is, and what to do for labels.
    let sequence = Sequence::read(path).map_err(|error| match error {
        VolumeError::Malformed { path, at, found, .. } | VolumeError::Unsupported { path, at, found, .. }
            if at == At::Byte(0) =>
        {
            VolumeError::unsupported(&path, at, found, READ)
        }
        error => error,
    })?;
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
        return Err(VolumeError::malformed(path, At::Pixels, "no valid image", READ));
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
            ..Picture::default()
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
