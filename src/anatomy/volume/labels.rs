//! Conversion of image numbers to a compact label volume.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use super::data::{self, Push};
use super::element::{ByteOrder, Sample, Scale, label_of, with_sample};
use super::error::VolumeError;
use super::header::Header;
use super::{Label, LabelVolume, Loaded, names};

/// Layer and value of a label in the file. The background is layer 0, value 0.
type Stored = (usize, i64);

const BACKGROUND: Stored = (0, 0);

/// Numbers the stored labels in order of appearance, and counts their voxels.
struct Index {
    numbers: HashMap<Stored, usize>,
    stored: Vec<Stored>,
    counts: Vec<u64>,
    last: (Stored, usize),
}

impl Index {
    fn new() -> Self {
        Self {
            numbers: HashMap::from([(BACKGROUND, 0)]),
            stored: vec![BACKGROUND],
            counts: vec![0],
            last: (BACKGROUND, 0),
        }
    }

    fn number(&mut self, label: Stored) -> usize {
        if self.last.0 != label {
            let next = self.stored.len();
            let number = *self.numbers.entry(label).or_insert(next);
            if number == next {
                self.stored.push(label);
                self.counts.push(0);
            }
            self.last = (label, number);
        }
        self.last.1
    }
}

/// Maximum number of distinct labels that are counted.
const MAX_COUNTED: usize = 1 << 16;

/// Stored labels of voxels, and the conversion of numbers to them.
struct Stacks {
    index: Index,
    layers: usize,
    order: ByteOrder,
    scale: Option<Scale>,
    /// Number of voxels claimed by more than one layer.
    overlaps: u64,
}

/// Why numbers form no labels.
enum Unfit {
    /// A number that is not a label, in the next voxel.
    Fraction(f64),
    /// More than [`MAX_COUNTED`] distinct labels.
    TooMany,
}

impl Stacks {
    /// Appends the number of the stored label of each voxel.
    fn push<T: Sample>(&mut self, bytes: &[u8], voxels: &mut Vec<u8>) -> Result<(), Unfit> {
        for stack in bytes.chunks_exact(T::BYTES * self.layers) {
            let mut top = 0;
            let mut claims = 0;
            for (layer, number) in stack.chunks_exact(T::BYTES).enumerate() {
                let sample = T::decode(number, self.order);
                let label = match self.scale {
                    None => sample.as_label(),
                    Some(scale) => label_of(scale.apply(sample.as_f64())),
                };
                let Some(value) = label else {
                    let value = self.scale.map_or(sample.as_f64(), |scale| scale.apply(sample.as_f64()));
                    return Err(Unfit::Fraction(value));
                };
                if value != 0 {
                    top = self.index.number((layer, value));
                    self.index.counts[top] += 1;
                    claims += 1;
                }
            }
            self.index.counts[0] += u64::from(claims == 0);
            self.overlaps += u64::from(claims > 1);
            // Past 256 the volume is refused below; only the count of labels still matters.
            voxels.push(top as u8);
        }
        if self.index.stored.len() > MAX_COUNTED {
            Err(Unfit::TooMany)
        } else {
            Ok(())
        }
    }
}

/// Reads the label volume of an image. If the first axis holds the layers of a segmentation, they are flattened: a higher
/// layer takes precedence.
pub(super) fn volume(header: Header) -> Result<Loaded, VolumeError> {
    volume_from(header, |header, group, push| data::read_into(header, group, push))
}

fn volume_from(
    mut header: Header,
    read: impl FnOnce(&mut Header, usize, Push<u8>) -> Result<Vec<u8>, VolumeError>,
) -> Result<Loaded, VolumeError> {
    let named = names::segments(&header.key_values);
    let layered = header.axes.len() == 4 && header.axes[0].direction.is_none() && !named.is_empty();
    let stacked = layered.then(|| header.axes.remove(0));
    // Data errors take precedence: they may be the cause of header errors.
    let grid = header.grid();
    let size = grid.as_ref().map_or([1; 3], |grid| grid.size);
    header.axes.splice(..0, stacked);
    let layers = stacked.map_or(1, |axis| axis.size);
    let mut stacks = Stacks {
        index: Index::new(),
        layers,
        order: header.data_order(),
        scale: header.scale,
        overlaps: 0,
    };
    let path = header.path.clone();
    let mut voxels = with_sample!(header.element()?, T => read(&mut header, layers * T::BYTES, &mut |bytes, voxels| {
        stacks.push::<T>(bytes, voxels).map_err(|unfit| match unfit {
            Unfit::TooMany => VolumeError::TooManyLabels(stacks.index.stored.len()).in_file(&path),
            Unfit::Fraction(value) => {
                let (voxel, [x, y, _]) = (voxels.len(), size);
                VolumeError::Fractional {
                    path: path.clone(),
                    voxel: [voxel % x, voxel / x % y, voxel / x / y],
                    value,
                }
            }
        })
    }))?;
    let grid = grid?;
    let mut warnings = std::mem::take(&mut header.warnings);
    if let Some(degrees) = grid.shear_deg {
        warnings.push(format!(
            "the axes are sheared: {degrees:.2} degrees off a right angle; taken as they are"
        ));
    }
    for &label in named.keys().filter(|&&(_, value)| value != 0) {
        stacks.index.number(label);
    }
    let stored = &stacks.index.stored;
    VolumeError::check_labels(stored.len()).map_err(|error| error.in_file(&path))?;
    if stacks.overlaps > 0 {
        let overlaps = stacks.overlaps;
        warnings.push(format!(
            "{overlaps} voxels belong to segments of several layers: the highest layer is used"
        ));
    }
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
            voxels: stacks.index.counts[number],
        });
    }
    for voxel in &mut voxels {
        *voxel = new_index[usize::from(*voxel)];
    }
    warnings.extend(grey_image(&voxels, grid.size[0], &labels));
    let volume =
        LabelVolume::new(grid.size, voxels, labels, grid.index_to_world).map_err(|error| error.in_file(&path))?;
    Ok(Loaded { volume, warnings })
}

/// Number of labels from which a file may be a grey image.
const MANY_LABELS: usize = 32;

/// Fraction of neighbouring voxels with different labels from which a file is considered a grey image: segmentations, which
/// consist of bodies many voxels across, stay far below it.
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

    use super::super::element::Element;
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
        volume_from(header, |_, _, push| {
            let mut voxels = Vec::new();
            push(bytes, &mut voxels).map(|()| voxels)
        })
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
        scaled.scale = Scale::new(0.5, 0.0);
        let message = volume(scaled, &bytes(&[2, 3])).unwrap_err().to_string();
        assert!(message.contains("voxel (1, 0, 0) is 1.5"), "{message}");
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

    #[test]
    fn higher_layers_win_and_shared_values_part() {
        let mut layered = cube([4, 1, 1], Element::I16);
        layered.axes.insert(
            0,
            Axis {
                size: 2,
                direction: None,
            },
        );
        let keys = [
            ("Segment0_Name", "low"),
            ("Segment0_LabelValue", "1"),
            ("Segment1_Name", "high"),
            ("Segment1_LabelValue", "1"),
            ("Segment1_Layer", "1"),
            ("Segment2_Name", "empty"),
            ("Segment2_LabelValue", "2"),
        ];
        layered.key_values = keys.map(|(key, value)| (key.to_owned(), value.to_owned())).to_vec();
        let loaded = volume(layered, &bytes(&[0, 0, 1, 0, 1, 1, 0, 1])).unwrap();
        assert_eq!(values(&loaded), [(0, 1), (1, 2), (2, 0), (3, 2)]);
        let names: Vec<_> = loaded
            .volume
            .labels()
            .iter()
            .map(|label| label.name.as_deref())
            .collect();
        assert_eq!(names, [None, Some("low"), Some("empty"), Some("high")]);
        assert_eq!(loaded.volume.voxels(), [0, 1, 3, 3]);
        assert!(
            loaded.warnings.iter().any(|w| w.starts_with("1 voxels belong")),
            "{:?}",
            loaded.warnings
        );
        assert!(
            loaded.warnings.iter().any(|w| w.contains("takes value 3")),
            "{:?}",
            loaded.warnings
        );
    }
}
