//! Conversion of image numbers to a compact label volume.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use super::data::{self, Push};
use super::element::{ByteOrder, Sample, with_sample};
use super::error::VolumeError;
use super::header::Header;
use super::overlap::{Overlaps, precedence};
use super::values::{Fraction, Values};
use super::{Label, LabelVolume, Loaded, names};

/// Layer and value of a label in the file. The background is layer 0, value 0.
type Stored = (usize, i64);

const BACKGROUND: Stored = (0, 0);

/// Maximum number of distinct stacks of labels that are counted.
const MAX_COUNTED: usize = 1 << 16;

/// The labels of voxels: a stack has one for each layer that labels the voxel, the lowest first.
struct Stacks {
    /// Number of each stack, in order of appearance; that of no label is 0.
    numbers: HashMap<Vec<Stored>, usize>,
    /// Stacks with their voxels.
    counted: Vec<(Vec<Stored>, u64)>,
    /// Bytes of the last stack, its number, and how many of its numbers are missing.
    last: (Vec<u8>, usize, u64),
    layers: usize,
    order: ByteOrder,
    values: Values,
}

/// Labels of which each voxel has the top one of its stack.
struct Flattened {
    /// The background, and all labels of the file.
    stored: Vec<Stored>,
    /// Voxels that each label claims, and those that it keeps.
    claimed: Vec<u64>,
    counts: Vec<u64>,
    /// Top label of each stack.
    tops: Vec<u8>,
    overlaps: Overlaps,
}

/// Why numbers form no labels.
enum Unfit {
    /// A number that is not a label, in the next voxel.
    Fraction(Fraction),
    /// More than `MAX_COUNTED` distinct stacks.
    TooMany,
}

/// Source of image data.
trait Source {
    /// As [`data::read_into`].
    fn read<V>(self, header: &mut Header, group: usize, push: Push<V>) -> Result<Vec<V>, VolumeError>;
}

/// The file of a header.
struct DataFile;

impl Source for DataFile {
    fn read<V>(self, header: &mut Header, group: usize, push: Push<V>) -> Result<Vec<V>, VolumeError> {
        data::read_into(header, group, push)
    }
}

impl Stacks {
    fn new(header: &Header, layers: usize) -> Self {
        Self {
            numbers: HashMap::from([(Vec::new(), 0)]),
            counted: vec![(Vec::new(), 0)],
            last: (Vec::new(), 0, 0),
            layers,
            order: header.data_order(),
            values: Values::new(header.scale),
        }
    }

    /// Reads the number of the stack of each voxel, as a type that holds it.
    fn read<V>(
        &mut self,
        header: &mut Header,
        size: [usize; 3],
        source: impl Source,
        voxel: fn(usize) -> V,
    ) -> Result<Vec<V>, VolumeError> {
        let (path, scale) = (header.path.clone(), header.scale);
        with_sample!(header.element()?, T => source.read(header, self.layers * T::BYTES, &mut |bytes, voxels| {
            self.push::<T, V>(bytes, voxels, voxel).map_err(|unfit| match unfit {
                Unfit::TooMany => VolumeError::TooManyLabels(self.labels().len()).in_file(&path),
                Unfit::Fraction(fraction) => {
                    let (voxel, [x, y, _]) = (voxels.len(), size);
                    VolumeError::Fractional {
                        path: path.clone(),
                        voxel: [voxel % x, voxel / x % y, voxel / x / y],
                        value: fraction.value,
                        origin: fraction.origin(scale),
                    }
                }
            })
        }))
    }

    fn push<T: Sample, V>(&mut self, bytes: &[u8], voxels: &mut Vec<V>, voxel: fn(usize) -> V) -> Result<(), Unfit> {
        for stack in bytes.chunks_exact(T::BYTES * self.layers) {
            if self.last.0 != stack {
                let mut labels = Vec::with_capacity(self.layers);
                let missing = self.values.missing;
                for (layer, number) in stack.chunks_exact(T::BYTES).enumerate() {
                    let sample = T::decode(number, self.order);
                    let value = self.values.label(sample).map_err(Unfit::Fraction)?;
                    if value != 0 {
                        labels.push((layer, value));
                    }
                }
                let next = self.counted.len();
                let number = *self.numbers.entry(labels.clone()).or_insert(next);
                if number == next {
                    self.counted.push((labels, 0));
                }
                self.last.0.clear();
                self.last.0.extend_from_slice(stack);
                (self.last.1, self.last.2) = (number, self.values.missing - missing);
            } else {
                self.values.missing += self.last.2;
            }
            self.counted[self.last.1].1 += 1;
            voxels.push(voxel(self.last.1));
        }
        if self.counted.len() > MAX_COUNTED {
            Err(Unfit::TooMany)
        } else {
            Ok(())
        }
    }

    /// Takes the top label of each stack.
    fn flattened(&self, named: &BTreeMap<Stored, Option<String>>) -> Flattened {
        let mut stored = self.labels();
        let unseen = named.keys().filter(|label| label.1 != 0 && !stored.contains(label));
        stored.extend(unseen.copied().collect::<Vec<_>>());
        let number: HashMap<Stored, usize> = stored.iter().copied().zip(0..).collect();
        let mut claimed = vec![0; stored.len()];
        for (stack, voxels) in &self.counted {
            for label in stack {
                claimed[number[label]] += voxels;
            }
        }
        let mut flattened = Flattened {
            tops: Vec::with_capacity(self.counted.len()),
            counts: vec![0; stored.len()],
            overlaps: Overlaps::default(),
            claimed,
            stored,
        };
        for (stack, voxels) in &self.counted {
            let numbers = || stack.iter().map(|label| number[label]);
            // Of equals the higher layer is on top.
            let top = numbers().max_by_key(|&label| {
                let name = named.get(&flattened.stored[label]).and_then(Option::as_deref);
                precedence(name, flattened.claimed[label])
            });
            let top = top.unwrap_or(0);
            flattened.counts[top] += voxels;
            for below in numbers().filter(|label| *label != top) {
                flattened.overlaps.add(below, top, *voxels);
            }
            // Past 256 labels the volume is refused; only their count still matters.
            flattened.tops.push(top as u8);
        }
        flattened
    }

    /// The background, and the labels in order of appearance.
    fn labels(&self) -> Vec<Stored> {
        let mut seen = BTreeSet::from([BACKGROUND]);
        let labels = self.counted.iter().flat_map(|(stack, _)| stack);
        std::iter::once(BACKGROUND)
            .chain(labels.copied().filter(|label| seen.insert(*label)))
            .collect()
    }
}

/// Reads the label volume of an image. If the first axis holds the layers of a segmentation, they are flattened: a body
/// lies below organs, and a larger segment below a smaller one.
pub(super) fn volume(header: Header) -> Result<Loaded, VolumeError> {
    volume_from(header, DataFile)
}

fn volume_from(mut header: Header, source: impl Source) -> Result<Loaded, VolumeError> {
    let named = names::segments(&header.key_values);
    let layered = header.axes.len() == 4 && header.axes[0].direction.is_none() && !named.is_empty();
    let stacked = layered.then(|| header.axes.remove(0));
    // Data errors take precedence: they may be the cause of header errors.
    let grid = header.grid();
    let size = grid.as_ref().map_or([1; 3], |grid| grid.size);
    header.axes.splice(..0, stacked);
    let mut stacks = Stacks::new(&header, stacked.map_or(1, |axis| axis.size));
    let path = header.path.clone();
    let flattened: Flattened;
    let mut voxels;
    if layered {
        let numbers = stacks.read(&mut header, size, source, |number| number as u32)?;
        flattened = stacks.flattened(&named);
        voxels = numbers.iter().map(|number| flattened.tops[*number as usize]).collect();
    } else {
        voxels = stacks.read(&mut header, size, source, |number| number as u8)?;
        flattened = stacks.flattened(&named);
    }
    let grid = grid?;
    let stored = &flattened.stored;
    VolumeError::check_labels(stored.len()).map_err(|error| error.in_file(&path))?;
    let mut warnings = std::mem::take(&mut header.warnings);
    if let Some(degrees) = grid.shear_deg {
        warnings.push(format!(
            "the axes are sheared: {degrees:.2} degrees off a right angle; taken as they are"
        ));
    }
    warnings.extend(flattened.overlaps.warning("segments", |label| {
        let (layer, value) = stored[label];
        let name = named.get(&stored[label]).cloned().flatten();
        let name = name.unwrap_or_else(|| format!("value {value} of layer {layer}"));
        (name, flattened.claimed[label])
    }));
    let values = values(stored, &named, &mut warnings);
    let mut order: Vec<usize> = (1..stored.len()).collect();
    order.sort_by_key(|&number| values[number]);
    order.insert(0, 0);
    let mut new_index = [0u8; 256];
    let mut labels = Vec::with_capacity(order.len());
    for (position, &number) in order.iter().enumerate() {
        new_index[number] = position as u8;
        let name = named.get(&stored[number]).cloned().flatten();
        labels.push(Label {
            value: values[number],
            name: name.or_else(|| header.names.get(&values[number]).cloned()),
            voxels: flattened.counts[number],
        });
    }
    for voxel in &mut voxels {
        *voxel = new_index[usize::from(*voxel)];
    }
    warnings.extend(grey_image(&voxels, grid.size[0], &labels));
    let volume =
        LabelVolume::new(grid.size, voxels, labels, grid.index_to_world).map_err(|error| error.in_file(&path))?;
    Ok(Loaded {
        volume,
        notes: stacks.values.notes(),
        warnings,
    })
}

/// Number of labels from which a file may be a grey image.
const MANY_LABELS: usize = 32;

/// Fraction of neighbouring voxels with different labels from which a file is considered a grey image: segmentations,
/// which consist of bodies many voxels across, stay far below it.
const MIXED: f64 = 0.5;

/// Warning if values vary from voxel to voxel as grey levels do.
fn grey_image(voxels: &[u8], row: usize, labels: &[Label]) -> Option<String> {
    if labels.len() <= MANY_LABELS || labels.iter().any(|label| label.name.is_some()) {
        return None;
    }
    let (mut pairs, mut mixed) = (0u64, 0u64);
    for row in voxels.chunks(row) {
        for pair in row.windows(2).filter(|pair| pair[0] > 0 && pair[1] > 0) {
            pairs += 1;
            mixed += u64::from(pair[0] != pair[1]);
        }
    }
    let share = mixed as f64 / pairs.max(1) as f64;
    (share > MIXED).then(|| {
        format!(
            "{} values, and {:.0} % of neighbouring voxels differ: this looks like a grey image, not like labels",
            labels.len() - 1,
            100.0 * share
        )
    })
}

/// A unique value for each stored label: that of the file, unless a lower layer already has it.
fn values(stored: &[Stored], named: &BTreeMap<Stored, Option<String>>, warnings: &mut Vec<String>) -> Vec<i64> {
    let mut order: Vec<usize> = (1..stored.len()).collect();
    order.sort_by_key(|&number| stored[number]);
    let mut used: BTreeSet<i64> = BTreeSet::from([0]);
    let highest = stored.iter().map(|&(_, value)| value).max().unwrap_or(0);
    let mut free = highest.max(0);
    let mut values = vec![0; stored.len()];
    for number in order {
        let (layer, value) = stored[number];
        values[number] = value;
        if !used.insert(value) {
            free = free.saturating_add(1);
            values[number] = free;
            used.insert(free);
            let name = named.get(&(layer, value)).cloned().flatten().unwrap_or_default();
            warnings.push(format!(
                "segment {name:?} of layer {layer} takes value {free}: a lower layer already uses its value {value}"
            ));
        }
    }
    values
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::super::element::{Element, Scale};
    use super::super::header::Axis;
    use super::super::header::tests::header;
    use super::*;

    fn cube(sizes: [usize; 3], element: Element) -> Header {
        let mut header = header(
            (0..3)
                .map(|axis| Axis {
                    size: sizes[axis],
                    direction: Some(Vector3::ith(axis, 1.0)),
                })
                .collect(),
        );
        header.element = Some(element);
        header
    }

    fn volume(header: Header, bytes: &[u8]) -> Result<Loaded, VolumeError> {
        volume_from(header, bytes)
    }

    impl Source for &[u8] {
        fn read<V>(self, _: &mut Header, _: usize, push: Push<V>) -> Result<Vec<V>, VolumeError> {
            let mut voxels = Vec::new();
            push(self, &mut voxels).map(|()| voxels)
        }
    }

    fn bytes(values: &[i16]) -> Vec<u8> {
        values.iter().flat_map(|value| value.to_le_bytes()).collect()
    }

    fn values(loaded: &Loaded) -> Vec<(i64, u64)> {
        loaded
            .volume
            .labels()
            .iter()
            .map(|label| (label.value, label.voxels))
            .collect()
    }

    #[test]
    fn background_is_first_and_the_rest_ascend() {
        let loaded = volume(cube([5, 1, 1], Element::I16), &bytes(&[300, -7, 300, 5, -7])).unwrap();
        assert_eq!(values(&loaded), [(0, 0), (-7, 2), (5, 1), (300, 2)]);
        assert_eq!(loaded.volume.voxels(), [3, 1, 3, 2, 1]);
    }

    #[test]
    fn floats_must_be_whole() {
        let numbers: Vec<u8> = [1.0f64, 2.0, 2.0, 1.5].iter().flat_map(|n| n.to_le_bytes()).collect();
        let loaded = volume(cube([3, 1, 1], Element::F64), &numbers[..24]).unwrap();
        assert_eq!(values(&loaded), [(0, 0), (1, 1), (2, 2)]);
        let message = volume(cube([2, 2, 1], Element::F64), &numbers).unwrap_err().to_string();
        assert!(message.contains("voxel (1, 1, 0) is 1.5"), "{message}");
        let mut scaled = cube([2, 1, 1], Element::I16);
        scaled.scale = Scale::new("scl_slope", 0.5, 0.0);
        let message = volume(scaled, &bytes(&[2, 3])).unwrap_err().to_string();
        assert!(message.contains("voxel (1, 0, 0) is 1.5"), "{message}");
    }

    #[test]
    fn numbers_near_whole_ones_are_rounded_and_nan_is_unlabelled() {
        let nan = f64::NAN;
        let numbers: Vec<u8> = [nan, nan, 1.999_9, 1.999_9, nan]
            .iter()
            .flat_map(|n| n.to_le_bytes())
            .collect();
        let loaded = volume(cube([5, 1, 1], Element::F64), &numbers).unwrap();
        assert_eq!(values(&loaded), [(0, 3), (2, 2)]);
        let expected = "values are rounded to whole numbers, by at most 1.0e-4 (1.9999 to 2)";
        assert_eq!(
            loaded.notes.join("\n"),
            [expected, "3 voxels are NaN: taken as unlabelled"].join("\n")
        );
        let mut scaled = cube([2, 1, 1], Element::U8);
        scaled.scale = Scale::new("scl_slope", 63.0 / 255.0, 0.0);
        let message = volume(scaled, &[255, 121]).unwrap_err().to_string();
        assert!(
            message.contains("(stored 121, scl_slope 0.247059), expected a whole number"),
            "{message}"
        );
    }

    #[test]
    fn more_than_256_labels_look_like_a_grey_image() {
        let grey: Vec<i16> = (1..=256).collect();
        let message = volume(cube([256, 1, 1], Element::I16), &bytes(&grey))
            .unwrap_err()
            .to_string();
        assert!(
            message.contains("at least 257 distinct labels") && message.contains("grey image"),
            "{message}"
        );
        assert!(volume(cube([255, 1, 1], Element::I16), &bytes(&grey[..255])).is_ok());
        let many: Vec<u8> = (0..100_000i32).flat_map(i32::to_le_bytes).collect();
        let message = volume(cube([100_000, 1, 1], Element::I32), &many)
            .unwrap_err()
            .to_string();
        assert!(message.contains("at least 100000 distinct labels"), "{message}");
    }

    #[test]
    fn grey_levels_in_no_order_look_like_a_grey_image() {
        let warned = |values: &[i16]| {
            let loaded = volume(cube([values.len() / 4, 4, 1], Element::I16), &bytes(values)).unwrap();
            loaded.warnings.iter().any(|warning| warning.contains("grey image"))
        };
        let mixed: Vec<i16> = (0..400).map(|at| 1 + at * 37 % 101).collect();
        assert!(warned(&mixed));
        let bodies: Vec<i16> = (0..400).map(|at| 1 + at / 8).collect();
        assert!(!warned(&bodies), "fifty labels, each of several voxels in a row");
        let few: Vec<i16> = (0..400).map(|at| 1 + at % 7).collect();
        assert!(!warned(&few));
    }

    /// Reads segments of a row of voxels, each with its name, value and layer. Bytes have one number a layer for each
    /// voxel.
    fn segments(layers: usize, segments: &[(&str, i64, usize)], numbers: &[i16]) -> Loaded {
        let mut layered = cube([numbers.len() / layers, 1, 1], Element::I16);
        layered.axes.insert(
            0,
            Axis {
                size: layers,
                direction: None,
            },
        );
        for (number, (name, value, layer)) in segments.iter().enumerate() {
            let key = |key: &str, value: String| (format!("Segment{number}_{key}"), value);
            layered.key_values.extend([
                key("Name", (*name).to_owned()),
                key("LabelValue", value.to_string()),
                key("Layer", layer.to_string()),
            ]);
        }
        volume(layered, &bytes(numbers)).unwrap()
    }

    fn names(loaded: &Loaded) -> Vec<Option<&str>> {
        let labels = loaded.volume.labels().iter();
        labels.map(|label| label.name.as_deref()).collect()
    }

    #[test]
    fn smaller_segments_lie_above_larger_ones_and_shared_values_part() {
        let loaded = segments(
            2,
            &[("low", 1, 0), ("high", 1, 1), ("empty", 2, 0)],
            &[0, 0, 1, 0, 1, 1, 0, 1],
        );
        // Of two segments of two voxels each, that of the higher layer is on top.
        assert_eq!(values(&loaded), [(0, 1), (1, 1), (2, 0), (3, 2)]);
        assert_eq!(names(&loaded), [None, Some("low"), Some("empty"), Some("high")]);
        assert_eq!(loaded.volume.voxels(), [0, 1, 3, 3]);
        let told = |words: &str| loaded.warnings.iter().any(|warning| warning.contains(words));
        assert!(told("low: 50 % covered by high"), "{:?}", loaded.warnings);
        assert!(told("takes value 3"), "{:?}", loaded.warnings);
        let small_below = segments(2, &[("small", 1, 0), ("large", 1, 1)], &[0, 1, 1, 1, 0, 1]);
        assert_eq!(small_below.volume.voxels(), [2, 1, 2]);
    }

    #[test]
    fn a_body_lies_below_organs_whatever_its_layer_and_size() {
        // The body has as many voxels as the liver: only its name puts it below.
        let numbers = [1, 1, 1, 1, 2, 0, 0, 0];
        let loaded = segments(2, &[("liver", 1, 0), ("kidney", 2, 0), ("Body", 1, 1)], &numbers);
        assert_eq!(values(&loaded), [(0, 1), (1, 2), (2, 1), (3, 0)]);
        assert_eq!(loaded.volume.voxels(), [1, 1, 2, 0]);
        assert_eq!(loaded.warnings.len(), 2, "{:?}", loaded.warnings);
        assert!(
            loaded.warnings[0].ends_with("Body: 100 % covered by liver"),
            "{:?}",
            loaded.warnings
        );
        let apart = segments(2, &[("liver", 1, 0), ("Body", 2, 1)], &[1, 0, 0, 2]);
        assert!(apart.warnings.is_empty(), "{:?}", apart.warnings);
    }

    #[test]
    fn more_combinations_of_segments_than_labels_are_flattened() {
        // Two layers of 30 labels each, all pairs of them once, and the labels of the second layer once more alone.
        let pairs = (0..900).flat_map(|pair: i16| [1 + pair / 30, 31 + pair % 30]);
        let numbers: Vec<i16> = pairs.chain((0..30).flat_map(|label| [0, 31 + label])).collect();
        let keys: Vec<(&str, i64, usize)> = (1..=60).map(|value| ("", value, usize::from(value > 30))).collect();
        let loaded = segments(2, &keys, &numbers);
        let kept: Vec<u64> = loaded.volume.labels()[1..].iter().map(|label| label.voxels).collect();
        assert_eq!(kept, [[30; 30], [1; 30]].concat());
    }
}
