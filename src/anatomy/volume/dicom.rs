//! Segmentations in DICOM (PS3.3 A.51 and A.90, C.8.20): segments as labels, with their names. The world is LPS as in DICOM.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Cursor;
use std::path::Path;

use dicom_dictionary_std::tags;
use dicom_object::{InMemDicomObject, OpenFileOptions, Tag};
use insonify_base::{border, dicom, read};
use nalgebra::{Matrix4, Vector3};

use super::channels::{Sets, flattened};
use super::error::{At, VolumeError};
use super::names::coded;
use super::{Loaded, extent};

/// Classes of segmentations: of one bit or one probability a voxel for each segment, and of the number of a segment.
const SEGMENTATIONS: [&[u8]; 2] = [b"1.2.840.10008.5.1.4.1.1.66.4", b"1.2.840.10008.5.1.4.1.1.66.7"];

/// Deviation of a slice from its place in the stack, in slices, that is taken as rounding.
const UNEVEN: f64 = 0.05;

/// Largest number of slices for each one that is stored: between them lie slices without labels, which files leave out.
const MOST_SLICES: usize = 1000;

/// Whether these first bytes are those of a segmentation.
pub(super) fn recognises(start: &[u8]) -> bool {
    let is_class = |part: &[u8]| SEGMENTATIONS.contains(&part);
    start.get(128..132) == Some(b"DICM") && start.windows(SEGMENTATIONS[0].len()).any(is_class)
}

/// One image of a segment, or of the numbers of segments.
struct Frame {
    /// 0 if the pixels are numbers.
    segment: u16,
    position: Vector3<f64>,
}

/// Reads the segments as labels.
pub(super) fn load(path: &Path) -> Result<Loaded, VolumeError> {
    let bytes = read::bytes(path, read::DICOM).map_err(|cause| VolumeError::read(path, cause))?;
    parse(path, &bytes)
}

fn parse(path: &Path, bytes: &[u8]) -> Result<Loaded, VolumeError> {
    dicom::check(bytes)
        .map_err(|fault| VolumeError::malformed(path, At::Byte(fault.offset as u64), fault.found, fault.expected))?;
    let malformed = |found: String, expected: &str| VolumeError::malformed(path, At::Header, found, expected);
    let object = border::decoded(|| OpenFileOptions::new().from_reader(Cursor::new(bytes)))
        .map_err(|fault| malformed(fault, "a DICOM segmentation"))?;
    let without = |what: &str| {
        malformed(
            format!("no {what}"),
            "a segmentation whose frames have a segment and a place: export it anew, with the image that it was drawn on (3D Slicer, or \
             itkimage2segimage of dcmqi)",
        )
    };
    let segments = segments(&object);
    let Geometry {
        size: [columns, rows],
        steps,
        frames,
        stack,
    } = Geometry::new(&object, &without, &malformed)?;
    let pixels = rows * columns;
    let mask = Mask::new(&object, frames.len() * pixels).map_err(|found| {
        VolumeError::unsupported(
            path,
            At::Pixels,
            found,
            "segments of one bit, of 8-bit probabilities or of numbers of 8 or 16 bits are read, not compressed",
        )
    })?;
    let slices = stack.slices;
    let mut of_voxels: Vec<u32> = read::room(
        pixels * slices,
        &format!("a segmentation of {columns} x {rows} x {slices} voxels"),
    )?;
    of_voxels.resize(pixels * slices, 0);
    let mut sets = Sets::new(None);
    let mut numbered: BTreeSet<u16> = segments.keys().copied().collect();
    match &mask {
        Mask::Numbers(numbers) => numbered.extend(numbers),
        _ => numbered.extend(frames.iter().map(|frame| frame.segment)),
    }
    numbered.remove(&0);
    let numbered: Vec<u16> = numbered.into_iter().collect();
    VolumeError::check_labels(numbered.len() + 1).map_err(|error| error.in_file(path))?;
    for (index, frame) in frames.iter().enumerate() {
        let slice = stack.slice(frame) * pixels;
        for pixel in 0..pixels {
            if let Some(segment) = mask.segment(index * pixels + pixel, frame.segment) {
                let channel = numbered.partition_point(|number| *number < segment);
                let voxel = &mut of_voxels[slice + pixel];
                *voxel = sets.with(*voxel, channel);
            }
        }
    }
    let names: Vec<Option<String>> = numbered.iter().map(|number| segments.get(number).cloned()).collect();
    let mut labelled = flattened(&of_voxels, &sets.channels, &names);
    for (label, number) in labelled.labels[1..].iter_mut().zip(&numbered) {
        label.value = i64::from(*number);
    }
    let mut world = Matrix4::identity();
    for (column, vector) in steps.into_iter().chain([stack.step, stack.origin]).enumerate() {
        world.fixed_view_mut::<3, 1>(0, column).copy_from(&vector);
    }
    let warnings = labelled.warning.into_iter().collect();
    let volume = super::LabelVolume::new([columns, rows, slices], labelled.voxels, labelled.labels, world)
        .and_then(|volume| extent::check(&volume, Some("mm")).map(|()| volume))
        .map_err(|error| error.in_file(path))?;
    Ok(Loaded {
        volume,
        notes: mask.note().into_iter().collect(),
        warnings,
    })
}

/// Geometry of the images of the segments.
struct Geometry {
    /// Columns and rows.
    size: [usize; 2],
    /// From a column to the next, and from a row to the next, mm (LPS).
    steps: [Vector3<f64>; 2],
    frames: Vec<Frame>,
    stack: Stack,
}

impl Geometry {
    fn new(
        object: &InMemDicomObject,
        without: &dyn Fn(&str) -> VolumeError,
        malformed: &dyn Fn(String, &str) -> VolumeError,
    ) -> Result<Self, VolumeError> {
        let integer = |tag: Tag| object.get(tag).and_then(|element| element.to_int::<u32>().ok());
        let size = |tag: Tag, name: &str| {
            let size = integer(tag).filter(|size| (1..=1 << 15).contains(size));
            size.map(|size| size as usize).ok_or_else(|| without(name))
        };
        let (rows, columns) = (size(tags::ROWS, "Rows")?, size(tags::COLUMNS, "Columns")?);
        let groups = items(object, tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE);
        let shared = items(object, tags::SHARED_FUNCTIONAL_GROUPS_SEQUENCE).first();
        let first = groups
            .first()
            .ok_or_else(|| without("PerFrameFunctionalGroupsSequence"))?;
        // What all frames have in common may stand in the shared group or in each one.
        let common = |sequence: Tag, tag: Tag| {
            [shared, Some(first)]
                .into_iter()
                .flatten()
                .find_map(|group| numbers(group, sequence, tag))
        };
        let Some([rx, ry, rz, cx, cy, cz]) = array(common(
            tags::PLANE_ORIENTATION_SEQUENCE,
            tags::IMAGE_ORIENTATION_PATIENT,
        )) else {
            return Err(without("ImageOrientationPatient"));
        };
        let Some([between_rows, between_columns]) = array(common(tags::PIXEL_MEASURES_SEQUENCE, tags::PIXEL_SPACING))
        else {
            return Err(without("PixelSpacing"));
        };
        let (along_row, down_column) = (Vector3::new(rx, ry, rz), Vector3::new(cx, cy, cz));
        let is_of_numbers = is_of_numbers(object);
        let frames: Option<Vec<Frame>> = groups
            .iter()
            .map(|group| {
                let in_shared = |sequence: Tag, tag: Tag| {
                    numbers(group, sequence, tag).or_else(|| shared.and_then(|shared| numbers(shared, sequence, tag)))
                };
                let segment = in_shared(tags::SEGMENT_IDENTIFICATION_SEQUENCE, tags::REFERENCED_SEGMENT_NUMBER);
                let [segment] = array(segment.filter(|_| !is_of_numbers).or(is_of_numbers.then(|| vec![0.0])))?;
                let [x, y, z] = array(in_shared(tags::PLANE_POSITION_SEQUENCE, tags::IMAGE_POSITION_PATIENT))?;
                Some(Frame {
                    segment: segment as u16,
                    position: Vector3::new(x, y, z),
                })
            })
            .collect();
        let frames = frames.ok_or_else(|| without("ReferencedSegmentNumber or ImagePositionPatient in a frame"))?;
        let stated = [tags::SPACING_BETWEEN_SLICES, tags::SLICE_THICKNESS];
        let stated = stated.map(|tag| common(tags::PIXEL_MEASURES_SEQUENCE, tag).and_then(|all| all.first().copied()));
        let normal = along_row.cross(&down_column);
        let stack = Stack::new(&frames, normal, stated).ok_or_else(|| {
            malformed(
                "slices at uneven distances".to_owned(),
                "slices of one distance, along one line (3D Slicer resamples them: save as .seg.nrrd)",
            )
        })?;
        Ok(Self {
            size: [columns, rows],
            steps: [along_row * between_columns, down_column * between_rows],
            frames,
            stack,
        })
    }
}

/// Items of a sequence; none if it is not there.
fn items(object: &InMemDicomObject, sequence: Tag) -> &[InMemDicomObject] {
    object
        .get(sequence)
        .and_then(|element| element.items())
        .unwrap_or_default()
}

/// Numbers of an element in the first item of a sequence.
fn numbers(group: &InMemDicomObject, sequence: Tag, tag: Tag) -> Option<Vec<f64>> {
    let numbers = items(group, sequence).first()?.get(tag)?.to_multi_float64().ok()?;
    numbers.iter().all(|number| number.is_finite()).then_some(numbers)
}

fn array<const N: usize>(numbers: Option<Vec<f64>>) -> Option<[f64; N]> {
    numbers?.try_into().ok()
}

/// Names of the segments by number: their label, or what they are where the label is the name of no tissue, with the
/// side.
fn segments(object: &InMemDicomObject) -> BTreeMap<u16, String> {
    let text = |item: &InMemDicomObject, tag: Tag| {
        let text = item.get(tag)?.to_str().ok()?.trim().to_owned();
        (!text.is_empty()).then_some(text)
    };
    let meaning = |item: &InMemDicomObject, sequence: Tag| text(items(item, sequence).first()?, tags::CODE_MEANING);
    let named = items(object, tags::SEGMENT_SEQUENCE).iter().filter_map(|item| {
        let number = item.get(tags::SEGMENT_NUMBER)?.to_int().ok()?;
        let kind = meaning(item, tags::SEGMENTED_PROPERTY_TYPE_CODE_SEQUENCE);
        let side = items(item, tags::SEGMENTED_PROPERTY_TYPE_CODE_SEQUENCE)
            .first()
            .and_then(|kind| meaning(kind, tags::SEGMENTED_PROPERTY_TYPE_MODIFIER_CODE_SEQUENCE));
        let kind = kind.map(|kind| side.map_or(kind.clone(), |side| format!("{side} {kind}")));
        let says = |label: &String| {
            label
                .to_lowercase()
                .trim_start_matches("segment")
                .contains(char::is_alphabetic)
        };
        let name = coded(text(item, tags::SEGMENT_LABEL).filter(says), kind);
        Some((number, name?))
    });
    named.collect()
}

/// Slices of all frames along one line.
struct Stack {
    origin: Vector3<f64>,
    step: Vector3<f64>,
    slices: usize,
}

impl Stack {
    /// The stack of all positions; `None` if they do not lie at equal distances on a line. Distances stated in the
    /// file, the best first, count where one slice is all there is.
    fn new(frames: &[Frame], normal: Vector3<f64>, stated: [Option<f64>; 2]) -> Option<Self> {
        let normal = normal.try_normalize(0.0)?;
        let depth = |frame: &Frame| frame.position.dot(&normal);
        let mut ordered: Vec<&Frame> = frames.iter().collect();
        ordered.sort_by(|a, b| depth(a).total_cmp(&depth(b)));
        let (first, last) = (ordered.first()?, ordered.last()?);
        let thickness = stated
            .into_iter()
            .flatten()
            .map(f64::abs)
            .find(|distance| *distance > 0.0);
        let span = depth(last) - depth(first);
        let rounding = UNEVEN * thickness.unwrap_or(1.0).min(1.0);
        let distances = ordered.windows(2).map(|pair| depth(pair[1]) - depth(pair[0]));
        let least = distances
            .filter(|distance| *distance > rounding)
            .fold(f64::INFINITY, f64::min);
        if !least.is_finite() {
            let step = normal * thickness.unwrap_or(1.0);
            let (origin, slices) = (first.position, 1);
            return Some(Self { origin, step, slices });
        }
        let intervals = (span / least).round();
        if intervals > (MOST_SLICES * frames.len()) as f64 {
            return None;
        }
        let stack = Self {
            origin: first.position,
            step: (last.position - first.position) / intervals,
            slices: intervals as usize + 1,
        };
        let off = |frame: &Frame| {
            let index = (depth(frame) - depth(first)) / (span / intervals);
            let place = stack.origin + stack.step * index.round();
            (frame.position - place).norm()
        };
        frames
            .iter()
            .all(|frame| off(frame) <= UNEVEN * stack.step.norm())
            .then_some(stack)
    }

    /// Index of the slice of a frame.
    fn slice(&self, frame: &Frame) -> usize {
        let index = (frame.position - self.origin).dot(&self.step) / self.step.norm_squared();
        (index.round().max(0.0) as usize).min(self.slices - 1)
    }
}

/// Whether the pixels are the numbers of segments.
fn is_of_numbers(object: &InMemDicomObject) -> bool {
    let kind = object.get(tags::SEGMENTATION_TYPE).and_then(|kind| kind.to_str().ok());
    kind.is_some_and(|kind| kind.trim() == "LABELMAP")
}

/// Pixels of all frames.
enum Mask {
    Numbers(Vec<u16>),
    Bits(Vec<u8>),
    /// Probabilities, and the number from which they are at least one half.
    Probabilities(Vec<u8>, u8),
}

impl Mask {
    /// The pixels of a segmentation; the error says what is not read.
    fn new(object: &InMemDicomObject, pixels: usize) -> Result<Self, String> {
        let element = object.get(tags::PIXEL_DATA).ok_or("a file without pixels")?;
        if element.fragments().is_some() {
            return Err("compressed pixels".to_owned());
        }
        let bytes = element.to_bytes().map_err(|cause| cause.to_string())?.into_owned();
        let bits = object
            .get(tags::BITS_ALLOCATED)
            .and_then(|bits| bits.to_int::<u32>().ok());
        let is_of_numbers = is_of_numbers(object);
        let needed = match bits {
            Some(1) if !is_of_numbers => pixels.div_ceil(8),
            Some(8) => pixels,
            Some(16) if is_of_numbers => 2 * pixels,
            _ => return Err(format!("pixels of {} bits", bits.unwrap_or(0))),
        };
        if bytes.len() < needed {
            return Err(format!("{} bytes of pixels where {needed} are needed", bytes.len()));
        }
        if is_of_numbers {
            let of_16_bits = bytes.as_chunks::<2>().0;
            return Ok(Self::Numbers(match bits {
                Some(16) => of_16_bits.iter().map(|pair| u16::from_ne_bytes(*pair)).collect(),
                _ => bytes.iter().map(|byte| u16::from(*byte)).collect(),
            }));
        }
        if bits == Some(1) {
            return Ok(Self::Bits(bytes));
        }
        let most = object
            .get(tags::MAXIMUM_FRACTIONAL_VALUE)
            .and_then(|most| most.to_int::<u32>().ok());
        let half = most.unwrap_or(1).clamp(1, 255).div_ceil(2);
        Ok(Self::Probabilities(bytes, half as u8))
    }

    /// Segment of a pixel in a frame of a segment.
    fn segment(&self, pixel: usize, of_frame: u16) -> Option<u16> {
        let segment = match self {
            Self::Numbers(numbers) => numbers[pixel],
            Self::Bits(bytes) => of_frame * u16::from(bytes[pixel / 8] >> (pixel % 8) & 1),
            Self::Probabilities(bytes, half) => of_frame * u16::from(bytes[pixel] >= *half),
        };
        (segment > 0).then_some(segment)
    }

    fn note(&self) -> Option<String> {
        match self {
            Self::Bits(_) | Self::Numbers(_) => None,
            Self::Probabilities(..) => {
                Some("segments are taken where their probability is at least one half".to_owned())
            }
        }
    }
}

#[cfg(test)]
mod tests;
