//! Writing of NRRD.

use std::borrow::Cow;
use std::fmt::Write as _;
use std::io::Write;
use std::path::Path;

use flate2::Compression;
use flate2::write::GzEncoder;

use crate::volume::element::Element;
use crate::volume::save::{element, line, named, write_voxels};
use crate::volume::{Label, LabelVolume, VolumeError, names};
use insonify_base::output::atomic;

/// Writes `.nrrd`, or `.seg.nrrd` with the segments of 3D Slicer.
pub(super) fn write(volume: &LabelVolume, path: &Path) -> Result<(), VolumeError> {
    let segmented = path.to_string_lossy().to_ascii_lowercase().ends_with(".seg.nrrd");
    let element = element(volume);
    let world = volume.index_to_world();
    let column = |axis: usize| format!("({},{},{})", world[(0, axis)], world[(1, axis)], world[(2, axis)]);
    let [x, y, z] = volume.size();
    let mut header = String::from("NRRD0005\n");
    line!(header, "type: {}", type_name(element));
    line!(header, "dimension: 3");
    line!(header, "space: left-posterior-superior");
    line!(header, "sizes: {x} {y} {z}");
    line!(header, "space directions: {} {} {}", column(0), column(1), column(2));
    line!(header, "kinds: domain domain domain");
    line!(header, "endian: little");
    line!(header, "encoding: gzip");
    line!(header, "space origin: {}", column(3));
    if segmented {
        push_segments(volume, &mut header);
    } else {
        for (value, name) in named(volume) {
            line!(header, "{}:={}", names::key(value), escaped(name));
        }
    }
    header.push('\n');
    atomic::write(path, |file| {
        file.write_all(header.as_bytes())?;
        let mut packed = GzEncoder::new(file, Compression::default());
        write_voxels(volume, element, &mut packed)?;
        packed.finish().map(drop)
    })?;
    Ok(())
}

/// Type of labels in a header.
fn type_name(element: Element) -> &'static str {
    match element {
        Element::U8 => "unsigned char",
        Element::I8 => "signed char",
        Element::U16 => "unsigned short",
        Element::I16 => "short",
        Element::U32 => "unsigned int",
        Element::I32 => "int",
        _ => "int64",
    }
}

/// Applies the key escapes of NRRD ("Key/value pairs").
fn escaped(text: &str) -> String {
    text.replace('\\', "\\\\").replace('\n', "\\n").replace('\r', " ")
}

/// Appends the segment keys of 3D Slicer (`vtkMRMLSegmentationStorageNode`).
fn push_segments(volume: &LabelVolume, header: &mut String) {
    line!(header, "Segmentation_MasterRepresentation:=Binary labelmap");
    line!(header, "Segmentation_ContainedRepresentationNames:=Binary labelmap|");
    line!(header, "Segmentation_ReferenceImageExtentOffset:=0 0 0");
    let extents = extents(volume);
    let foreground = volume.labels().iter().zip(&extents).skip(1).enumerate();
    for (number, (Label { value, name, .. }, extent)) in foreground {
        let name = name
            .as_deref()
            .map_or_else(|| Cow::from(format!("label {value}")), Cow::from);
        let [red, green, blue] = colour(number);
        let [low, high] = extent.map(|bound| bound.map(|n| n.to_string()));
        line!(header, "Segment{number}_ID:=Segment_{value}");
        line!(header, "Segment{number}_Name:={}", escaped(&name));
        line!(header, "Segment{number}_Color:={red:.6} {green:.6} {blue:.6}");
        line!(header, "Segment{number}_LabelValue:={value}");
        line!(header, "Segment{number}_Layer:=0");
        line!(
            header,
            "Segment{number}_Extent:={} {} {} {} {} {}",
            low[0],
            high[0],
            low[1],
            high[1],
            low[2],
            high[2]
        );
        line!(header, "Segment{number}_Tags:=");
    }
}

/// First and last voxel of each label along each axis; the first is above the last for an empty label, as VTK
/// writes it.
fn extents(volume: &LabelVolume) -> Vec<[[i64; 3]; 2]> {
    let [x, y, _] = volume.size();
    let mut extents = vec![[[0; 3], [-1; 3]]; volume.labels().len()];
    for (number, &voxel) in volume.voxels().iter().enumerate() {
        let [low, high] = &mut extents[usize::from(voxel)];
        let index = [number % x, number / x % y, number / x / y].map(|n| n as i64);
        let first = high[0] < 0;
        for axis in 0..3 {
            low[axis] = if first { index[axis] } else { low[axis].min(index[axis]) };
            high[axis] = high[axis].max(index[axis]);
        }
    }
    extents
}

/// Colour of the n-th segment, each channel 0 to 1: hues a golden section apart, so that neighbours differ.
fn colour(number: usize) -> [f64; 3] {
    const GOLDEN_SECTION: f64 = 0.618_033_988_749_894_9;
    let hue = (number as f64 * GOLDEN_SECTION).fract() * 6.0;
    [5.0, 3.0, 1.0].map(|shift: f64| {
        let phase = (shift + hue) % 6.0;
        0.9 - 0.6 * phase.min(4.0 - phase).clamp(0.0, 1.0)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volume::save::tests::sample;

    #[test]
    fn segments_carry_their_extent() {
        let volume = sample(&[0, 1, 2]);
        let extents = extents(&volume);
        for (index, extent) in extents.iter().enumerate() {
            for axis in 0..3 {
                let along = (0..60).filter(|&at| usize::from(volume.voxels()[at]) == index);
                let places = along.map(|at| [at % 3, at / 3 % 4, at / 12][axis] as i64);
                let (low, high) = places.fold((i64::MAX, -1), |(low, high), n| (low.min(n), high.max(n)));
                assert_eq!([extent[0][axis], extent[1][axis]], [low, high]);
            }
        }
    }

    /// Hues a golden section of the circle apart: the brightest and the darkest channel are those of full saturation,
    /// and neighbours differ.
    #[test]
    fn colours_of_segments_are_hues_that_differ() {
        assert_eq!(colour(0), [0.9, 0.9 - 0.6, 0.9 - 0.6]);
        for number in 0..60 {
            let of = colour(number);
            let ends = [f64::min as fn(f64, f64) -> f64, f64::max].map(|end| of.into_iter().reduce(end).unwrap());
            assert!(
                (ends[0] - 0.3).abs() < 1e-9 && (ends[1] - 0.9).abs() < 1e-9,
                "{number}: {of:?}"
            );
            let next = colour(number + 1);
            let difference = (0..3)
                .map(|channel| (of[channel] - next[channel]).abs())
                .fold(0.0, f64::max);
            assert!(difference > 0.3, "{number}: {of:?} {next:?}");
        }
    }
}
