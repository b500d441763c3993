//! Frames of DICOM files: native, RLE and JPEG pixels, colour palettes (PS3.3 C.7.9), and the pixel size from the
//! calibrated regions (PS3.3 C.8.5.5) or the pixel spacing.

mod layout;
#[cfg(test)]
mod tests;

use std::io::Cursor;
use std::path::Path;

use dicom_dictionary_std::tags;
use dicom_object::{DefaultDicomObject, InMemDicomObject, OpenFileOptions, Tag};
use dicom_pixeldata::{
    ConvertOptions, DecodedPixelData, PhotometricInterpretation, PixelDecoder, PlanarConfiguration, VoiLutOption,
};
use image::{DynamicImage, GrayImage, RgbImage};

use super::Picture;
use insonify_anatomy::volume::{At, VolumeError};
use insonify_base::{border, dicom, read};
use layout::Layout;

/// Physical units of a region's pixels: centimetres (PS3.3 C.8.5.5.1.15).
const CENTIMETRES: u16 = 3;
/// Descriptor, entries and segmented entries of the palettes of red, green and blue.
const PALETTES: [[Tag; 3]; 3] = [
    [
        tags::RED_PALETTE_COLOR_LOOKUP_TABLE_DESCRIPTOR,
        tags::RED_PALETTE_COLOR_LOOKUP_TABLE_DATA,
        tags::SEGMENTED_RED_PALETTE_COLOR_LOOKUP_TABLE_DATA,
    ],
    [
        tags::GREEN_PALETTE_COLOR_LOOKUP_TABLE_DESCRIPTOR,
        tags::GREEN_PALETTE_COLOR_LOOKUP_TABLE_DATA,
        tags::SEGMENTED_GREEN_PALETTE_COLOR_LOOKUP_TABLE_DATA,
    ],
    [
        tags::BLUE_PALETTE_COLOR_LOOKUP_TABLE_DESCRIPTOR,
        tags::BLUE_PALETTE_COLOR_LOOKUP_TABLE_DATA,
        tags::SEGMENTED_BLUE_PALETTE_COLOR_LOOKUP_TABLE_DATA,
    ],
];

/// Reads up to `max_frames` evenly spaced frames.
pub(super) fn read(path: &Path, max_frames: usize) -> Result<Vec<Picture>, VolumeError> {
    let bytes = read::bytes(path, read::DICOM).map_err(|cause| VolumeError::read(path, cause))?;
    dicom::check(&bytes)
        .map_err(|fault| VolumeError::malformed(path, At::Byte(fault.offset as u64), fault.found, fault.expected))?;
    let object = border::decoded(|| OpenFileOptions::new().from_reader(Cursor::new(bytes)))
        .map_err(|fault| VolumeError::malformed(path, At::Header, fault, "a DICOM file with images"))?;
    let refuse = |fault: String| {
        let expected = "grey, RGB, YBR or palette images; others can be converted to PNG with dcmj2pnm of DCMTK";
        VolumeError::malformed(path, At::Pixels, fault, expected)
    };
    let layout = Layout::new(&object).map_err(refuse)?;
    let frames = layout.frames;
    let frame_bytes = layout.bytes as u64;
    border::check(frame_bytes, layout.stored as u64, "a frame").map_err(|cause| VolumeError::read(path, cause))?;
    let grey = |index: usize| {
        let image = border::guarded(|| frame(&object, index as u32));
        let image = image.map_err(|panicked| format!("frame {index} with {panicked}"))??;
        Ok(Picture::of(image, String::new(), None))
    };
    let mm = pixel_mm(&object);
    let pictures = super::spread(frames, max_frames).map(|index| {
        let picture = grey(index).map_err(refuse)?;
        let neighbour_index = if index + 1 < frames {
            Some(index + 1)
        } else {
            index.checked_sub(1)
        };
        Ok(Picture {
            name: match frames {
                1 => path.display().to_string(),
                _ => format!("{}, frame {index}", path.display()),
            },
            mm,
            neighbour: neighbour_index
                .and_then(|next| grey(next).ok())
                .map(|picture| picture.grey),
            ..picture
        })
    });
    pictures.collect()
}

fn number(object: &InMemDicomObject, tag: Tag) -> Option<f64> {
    object.get(tag)?.to_float64().ok()
}

/// Decodes a frame to 8 bits a channel; the error says what is wrong with it.
fn frame(object: &DefaultDicomObject, index: u32) -> Result<DynamicImage, String> {
    let fail = |cause: dicom_pixeldata::Error| format!("frame {index}: {cause}");
    let pixels = object.decode_pixel_data_frame(index).map_err(fail)?;
    let kind = pixels.photometric_interpretation();
    if *kind == PhotometricInterpretation::PaletteColor {
        return coloured(object, &pixels)
            .ok_or_else(|| format!("frame {index} with a colour palette that cannot be read"));
    }
    let (width, height) = (pixels.columns(), pixels.rows());
    // Of 16 bits a channel the upper 8 are shown.
    let shift = if pixels.bits_allocated() == 8 { 0 } else { 8 };
    let image = match pixels.samples_per_pixel() {
        1 => {
            // Without a window, levels are as stored; the default would stretch them.
            let window = match object.get(tags::WINDOW_CENTER) {
                Some(_) => VoiLutOption::First,
                None => VoiLutOption::Identity,
            };
            let options = ConvertOptions::new().with_voi_lut(window);
            let levels: Vec<u16> = pixels.to_vec_frame_with_options(0, &options).map_err(fail)?;
            let inverted = if *kind == PhotometricInterpretation::Monochrome1 {
                255
            } else {
                0
            };
            let levels = levels.iter().map(|level| (level >> shift) as u8 ^ inverted);
            GrayImage::from_raw(width, height, levels.collect()).map(DynamicImage::from)
        }
        3 => {
            let bytes = match shift {
                0 => pixels.frame_data(0).map_err(fail)?.to_vec(),
                _ => {
                    let words = pixels.frame_data_ow(0).map_err(fail)?;
                    words.iter().map(|word| (word >> shift) as u8).collect()
                }
            };
            let plane = bytes.len() / 3;
            let channels = |pixel: usize| match pixels.planar_configuration() {
                PlanarConfiguration::Standard => [0, 1, 2].map(|channel| bytes[3 * pixel + channel]),
                PlanarConfiguration::PixelFirst => [0, 1, 2].map(|channel| bytes[channel * plane + pixel]),
            };
            let to_rgb = match kind {
                PhotometricInterpretation::Rgb => |rgb: [u8; 3]| rgb,
                PhotometricInterpretation::YbrFull | PhotometricInterpretation::YbrFull422 => rgb_of,
                other => return Err(format!("frame {index} of {other}")),
            };
            let bytes = (0..plane).flat_map(|pixel| to_rgb(channels(pixel)));
            RgbImage::from_raw(width, height, bytes.collect()).map(DynamicImage::from)
        }
        samples => return Err(format!("frame {index} with {samples} samples a pixel")),
    };
    image.ok_or_else(|| format!("frame {index} with fewer pixels than {width} x {height}"))
}

/// RGB of Y, Cb and Cr (PS3.3 C.7.6.3.1.2).
fn rgb_of([y, blue, red]: [u8; 3]) -> [u8; 3] {
    let [y, blue, red] = [f32::from(y), f32::from(blue) - 128.0, f32::from(red) - 128.0];
    [1.402 * red, -0.344_136 * blue - 0.714_136 * red, 1.772 * blue].map(|chroma| (y + chroma).round() as u8)
}

/// Colours the indices of a frame by the palettes of the file.
fn coloured(object: &InMemDicomObject, pixels: &DecodedPixelData<'_>) -> Option<DynamicImage> {
    let data = pixels.frame_data(0).ok()?;
    let words: Vec<u16> = match pixels.bits_allocated() {
        8 => data.iter().map(|byte| u16::from(*byte)).collect(),
        16 => pixels.frame_data_ow(0).ok()?,
        _ => return None,
    };
    let mut palettes = [(0, Vec::new()), (0, Vec::new()), (0, Vec::new())];
    for (palette, tags) in palettes.iter_mut().zip(PALETTES) {
        *palette = entries(object, tags)?;
    }
    let bytes = words.iter().flat_map(|word| {
        palettes.each_ref().map(|(first_word, levels)| {
            let level = usize::from(word.saturating_sub(*first_word));
            levels[level.min(levels.len() - 1)]
        })
    });
    RgbImage::from_raw(pixels.columns(), pixels.rows(), bytes.collect()).map(DynamicImage::from)
}

/// First index and 8-bit levels of a palette.
fn entries(object: &InMemDicomObject, [descriptor, plain, segmented]: [Tag; 3]) -> Option<(u16, Vec<u8>)> {
    let [count, first_word, bits] = <[i64; 3]>::try_from(object.get(descriptor)?.to_multi_int().ok()?).ok()?;
    let count = if count == 0 {
        1 << 16
    } else {
        usize::try_from(count).ok()?
    };
    let levels: Vec<u16> = match (object.get(plain), object.get(segmented)) {
        (Some(data), _) => {
            let bytes = data.to_bytes().ok()?;
            // Entries of 8 bits may be packed by two.
            if bits == 8 && bytes.len() < 2 * count {
                bytes.iter().map(|byte| u16::from(*byte)).collect()
            } else {
                data.to_multi_int().ok()?
            }
        }
        (None, Some(data)) => expanded(&data.to_multi_int().ok()?, count)?,
        (None, None) => return None,
    };
    let shift = if bits == 8 { 0 } else { 8 };
    let levels: Vec<u8> = levels.iter().take(count).map(|level| (level >> shift) as u8).collect();
    (!levels.is_empty()).then_some((first_word as u16, levels))
}

/// Entries of a segmented palette: discrete (0) and linear (1) segments (PS3.3 C.7.9.2); `None` for others, and for
/// more than `max_entries`.
fn expanded(words: &[u16], max_entries: usize) -> Option<Vec<u16>> {
    let mut levels: Vec<u16> = Vec::new();
    let mut words = words.iter().copied();
    while let Some(kind) = words.next() {
        // A last word may pad the data to even length.
        let Some(length) = words.next() else { break };
        let length = usize::from(length);
        if levels.len() + length > max_entries {
            return None;
        }
        match kind {
            0 => levels.extend(words.by_ref().take(length)),
            1 => {
                let (from, to) = (f64::from(*levels.last()?), f64::from(words.next()?));
                levels
                    .extend((1..=length).map(|step| (from + (to - from) * step as f64 / length as f64).round() as u16));
            }
            _ => return None,
        }
    }
    Some(levels)
}

/// Pixel size of the largest region calibrated in centimetres, otherwise the pixel spacing, mm: columns, rows.
fn pixel_mm(object: &InMemDicomObject) -> Option<[f64; 2]> {
    let regions = object.get(tags::SEQUENCE_OF_ULTRASOUND_REGIONS);
    let regions = regions.and_then(|element| element.items()).unwrap_or_default();
    let in_mm = regions.iter().filter_map(|region| {
        let units = [tags::PHYSICAL_UNITS_X_DIRECTION, tags::PHYSICAL_UNITS_Y_DIRECTION];
        let in_centimetres = units
            .iter()
            .all(|tag| number(region, *tag) == Some(f64::from(CENTIMETRES)));
        let side = |low: Tag, high: Tag| Some(number(region, high)? - number(region, low)?);
        let area = side(tags::REGION_LOCATION_MIN_X0, tags::REGION_LOCATION_MAX_X1)?
            * side(tags::REGION_LOCATION_MIN_Y0, tags::REGION_LOCATION_MAX_Y1)?;
        let delta = [
            number(region, tags::PHYSICAL_DELTA_X)?,
            number(region, tags::PHYSICAL_DELTA_Y)?,
        ];
        in_centimetres.then_some((area, delta.map(|cm| 10.0 * cm.abs())))
    });
    let largest = in_mm.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, mm)| mm);
    largest.or_else(|| {
        let spacing = object.get(tags::PIXEL_SPACING)?.to_multi_float64().ok()?;
        <[f64; 2]>::try_from(spacing)
            .ok()
            .map(|[rows, columns]| [columns, rows])
    })
}
