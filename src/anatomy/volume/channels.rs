//! Label volumes with one mask a label: the channels of an axis that is no direction of space.

use std::collections::HashMap;

use super::data;
use super::element::{Sample, with_sample};
use super::error::VolumeError;
use super::header::{Axis, Header};
use super::values::Values;
use super::{Label, LabelVolume, Loaded, names};

/// Masks of a voxel, and the number of the set that has one more.
type Steps = HashMap<(u32, usize), u32>;

/// Channels of the voxels: a set for each combination that there is.
struct Sets {
    /// Channels of each set, ascending; set 0 is empty.
    channels: Vec<Vec<usize>>,
    steps: Steps,
    /// The last step, which is likely the next one, too.
    last: ((u32, usize), u32),
    values: Values,
}

impl Sets {
    /// Number of a set with one more channel.
    fn with(&mut self, set: u32, channel: usize) -> u32 {
        if self.last.0 != (set, channel) {
            let next = self.channels.len() as u32;
            let number = *self.steps.entry((set, channel)).or_insert(next);
            if number == next {
                let mut channels = self.channels[set as usize].clone();
                channels.push(channel);
                self.channels.push(channels);
            }
            self.last = ((set, channel), number);
        }
        self.last.1
    }

    /// Whether a number marks its voxel; an error with its value if it is neither 0 nor 1.
    fn marks<T: Sample>(&mut self, number: T) -> Result<bool, f64> {
        match self.values.label(number) {
            Ok(label @ (0 | 1)) => Ok(label == 1),
            Ok(label) => Err(label as f64),
            Err(fraction) => Err(fraction.value),
        }
    }
}

/// Index of the only axis with several entries that is no direction of space, if it is the fastest or slowest of them and no
/// segments of 3D Slicer say what its entries are.
pub(super) fn axis(header: &Header) -> Option<usize> {
    let long = |axis: &Axis| axis.size > 1 && axis.direction.is_none();
    let index = header.axes.iter().position(long)?;
    let is_outermost = index == 0 || header.axes[index + 1..].iter().all(|axis| axis.size == 1);
    (is_outermost && names::segments(&header.key_values).is_empty()).then_some(index)
}

/// Reads masks of 0 and 1 as labels, 1 for the first channel; a smaller mask lies above a larger one. Where each voxel has exactly
/// one channel, the first one is the background, as networks have it.
pub(super) fn volume(mut header: Header, axis: usize) -> Result<Loaded, VolumeError> {
    let channels = header.axes.remove(axis);
    let grid = header.grid()?;
    header.axes.insert(axis, channels);
    let count = channels.size;
    let refused = |value: f64, channel: usize| {
        let found = format!("axis {axis} with {count} entries, which are no masks ({value} in entry {channel})");
        let instead = format!(
            "masks of 0 and 1 are read as labels; of anything else save one entry, 0 to {}, as a volume of three axes",
            count - 1
        );
        header.unsupported(found, instead)
    };
    if count > 255 {
        return Err(refused(count as f64, count));
    }
    let voxels = grid.size.iter().product();
    let (order, is_fastest) = (header.data_order(), axis == 0);
    let mut sets = Sets {
        channels: vec![Vec::new()],
        steps: Steps::new(),
        last: ((0, usize::MAX), 0),
        values: Values::new(header.scale),
    };
    let mut of_voxels = vec![0u32; voxels];
    let mut refusal = None;
    let mut read = 0;
    let mut source = header.clone();
    with_sample!(header.element()?, T => data::read_into(&mut source, T::BYTES, &mut |bytes, _: &mut Vec<()>| {
        for number in bytes.chunks_exact(T::BYTES) {
            let (channel, voxel) = if is_fastest { (read % count, read / count) } else { (read / voxels, read % voxels) };
            match sets.marks(T::decode(number, order)) {
                Ok(true) => of_voxels[voxel] = sets.with(of_voxels[voxel], channel),
                Ok(false) => {}
                Err(value) => {
                    refusal = Some(refused(value, channel));
                    return Err(VolumeError::new(""));
                }
            }
            read += 1;
        }
        Ok(())
    }))
    .map_err(|error| refusal.take().unwrap_or(error))?;
    let mut warnings = std::mem::take(&mut source.warnings);
    let labelled = flattened(&of_voxels, &sets.channels, count);
    warnings.extend(labelled.overlaps());
    let last = labelled.labels.len() - 1;
    let background = if labelled.has_background {
        ", the first of them the background"
    } else {
        ""
    };
    let mut notes = vec![format!(
        "{count} masks in axis {axis} are read as labels 1 to {last}{background}"
    )];
    notes.extend(sets.values.notes());
    let volume = LabelVolume::new(grid.size, labelled.voxels, labelled.labels, grid.index_to_world)
        .map_err(|error| error.in_file(&header.path))?;
    Ok(Loaded {
        volume,
        notes,
        warnings,
    })
}

struct Flattened {
    voxels: Vec<u8>,
    labels: Vec<Label>,
    has_background: bool,
    /// Voxels with several channels.
    shared: u64,
}

impl Flattened {
    fn overlaps(&self) -> Option<String> {
        let shared = self.shared;
        (shared > 0).then(|| format!("{shared} voxels lie in several masks: the smaller mask is drawn"))
    }
}

/// One label for each set of channels.
fn flattened(of_voxels: &[u32], sets: &[Vec<usize>], count: usize) -> Flattened {
    let mut voxels_of = vec![0u64; sets.len()];
    for &set in of_voxels {
        voxels_of[set as usize] += 1;
    }
    let held = |set: &usize| voxels_of[*set] > 0;
    let is_partition = (0..sets.len()).filter(held).all(|set| sets[set].len() == 1);
    // Background surrounds a body: it has the first corner.
    let has_background = is_partition && of_voxels.first().is_some_and(|&set| sets[set as usize] == [0]);
    let mut claimed = vec![0u64; count];
    for (set, channels) in sets.iter().enumerate() {
        channels.iter().for_each(|&channel| claimed[channel] += voxels_of[set]);
    }
    let first = u8::from(has_background);
    let tops: Vec<u8> = sets
        .iter()
        .map(|channels| {
            let top = channels.iter().min_by_key(|&&channel| claimed[channel]);
            top.map_or(0, |&channel| channel as u8 + 1 - first)
        })
        .collect();
    let mut labels: Vec<Label> = (0..=count - usize::from(first))
        .map(|value| Label {
            value: value as i64,
            name: None,
            voxels: 0,
        })
        .collect();
    let voxels = of_voxels.iter().map(|&set| tops[set as usize]).collect::<Vec<u8>>();
    for (set, &top) in tops.iter().enumerate() {
        labels[usize::from(top)].voxels += voxels_of[set];
    }
    let shared = (0..sets.len()).filter(|&set| sets[set].len() > 1);
    Flattened {
        shared: shared.map(|set| voxels_of[set]).sum(),
        voxels,
        labels,
        has_background,
    }
}

#[cfg(test)]
mod tests {
    use std::path::{Path, PathBuf};

    use super::super::load;

    /// Two channels of 2 x 2 x 1 voxels, slowest axis last.
    fn file(folder: &Path, header: &str, numbers: &[u8]) -> PathBuf {
        let path = folder.join("masks.nrrd");
        let mut bytes =
            format!("NRRD0004\ntype: uchar\ndimension: 4\nspace: LPS\nencoding: raw\n{header}\n\n").into_bytes();
        bytes.extend_from_slice(numbers);
        std::fs::write(&path, bytes).unwrap();
        path
    }

    const LAST: &str = "sizes: 2 2 1 2\nspace directions: (1,0,0) (0,1,0) (0,0,1) none";
    const FIRST: &str = "sizes: 2 2 2 1\nspace directions: none (1,0,0) (0,1,0) (0,0,1)";

    #[test]
    fn masks_become_labels_and_the_smaller_lies_above() {
        let folder = tempfile::tempdir().unwrap();
        for (header, numbers) in [(LAST, [0, 1, 1, 1, 0, 0, 1, 0]), (FIRST, [0, 0, 1, 0, 1, 1, 1, 0])] {
            let loaded = load(&file(folder.path(), header, &numbers)).unwrap();
            assert_eq!(loaded.volume.voxels(), [0, 1, 2, 1], "{header}");
            let counts: Vec<_> = loaded
                .volume
                .labels()
                .iter()
                .map(|label| (label.value, label.voxels))
                .collect();
            assert_eq!(counts, [(0, 1), (1, 2), (2, 1)]);
            assert!(
                loaded.notes[0].contains("2 masks") && loaded.notes[0].contains("labels 1 to 2"),
                "{:?}",
                loaded.notes
            );
            assert_eq!(
                loaded.warnings,
                ["1 voxels lie in several masks: the smaller mask is drawn"]
            );
        }
    }

    #[test]
    fn the_first_of_channels_that_fill_the_volume_is_the_background() {
        let folder = tempfile::tempdir().unwrap();
        let loaded = load(&file(folder.path(), LAST, &[1, 0, 1, 0, 0, 1, 0, 1])).unwrap();
        assert_eq!(
            (loaded.volume.voxels(), loaded.volume.labels().len()),
            (&[0, 1, 0, 1][..], 2)
        );
        assert!(
            loaded.notes[0].contains("labels 1 to 1, the first of them the background"),
            "{:?}",
            loaded.notes
        );
        // Where the corner has another channel, all of them are labels.
        let loaded = load(&file(folder.path(), LAST, &[0, 1, 1, 1, 1, 0, 0, 0])).unwrap();
        assert_eq!(loaded.volume.voxels(), [2, 1, 1, 1]);
    }

    #[test]
    fn what_is_no_mask_is_refused_with_the_entries_to_choose_from() {
        let folder = tempfile::tempdir().unwrap();
        let message = load(&file(folder.path(), LAST, &[0, 1, 1, 0, 0, 2, 0, 1]))
            .unwrap_err()
            .to_string();
        assert!(
            message.contains("axis 3 with 2 entries, which are no masks (2 in entry 1)")
                && message.contains("save one entry, 0 to 1"),
            "{message}"
        );
    }
}
