//! Label volumes with one mask a label: the channels of an axis that is no direction of space.

use insonify_base::note::Notes;
use std::collections::HashMap;

use super::data;
use super::element::{Sample, Scale, with_sample};
use super::error::VolumeError;
use super::header::{Axis, Header};
use super::overlap::{Overlaps, precedence};
use super::values::Values;
use super::{Label, LabelVolume, Loaded, names};

/// Masks of a voxel, and the number of the set that has one more.
type Steps = HashMap<(u32, usize), u32>;

/// Channels of the voxels: a set for each combination that there is.
pub(super) struct Sets {
    /// Channels of each set; set 0 is empty.
    pub(super) channels: Vec<Vec<usize>>,
    steps: Steps,
    /// The last step, which is likely the next one, too.
    last: ((u32, usize), u32),
    values: Values,
}

impl Sets {
    pub(super) fn new(scale: Option<Scale>) -> Self {
        Self {
            channels: vec![Vec::new()],
            steps: Steps::new(),
            last: ((0, usize::MAX), 0),
            values: Values::new(scale),
        }
    }

    /// Number of a set with one more channel.
    pub(super) fn with(&mut self, set: u32, channel: usize) -> u32 {
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

/// Index of the only axis with several entries that is no direction of space, if it is the fastest or slowest of them
/// and no segments of 3D Slicer say what its entries are.
pub(super) fn axis(header: &Header) -> Option<usize> {
    let long = |axis: &Axis| axis.size > 1 && axis.direction.is_none();
    let index = header.axes.iter().position(long)?;
    let is_outermost = index == 0 || header.axes[index + 1..].iter().all(|axis| axis.size == 1);
    (is_outermost && names::segments(&header.key_values).is_empty()).then_some(index)
}

/// Reads masks of 0 and 1 as labels, 1 for the first channel, unless that one is a background, as networks have it.
pub(super) fn volume(mut header: Header, axis: usize) -> Result<Loaded, VolumeError> {
    let channels = header.axes.remove(axis);
    let grid = header.grid()?;
    header.axes.insert(axis, channels);
    let count = channels.size;
    let refused = |value: f64, channel: usize| {
        let found = format!("axis {axis} with {count} entries that are no masks ({value} in entry {channel})");
        let instead = format!(
            "masks of 0 and 1 are read as labels; of probabilities save the number of the largest (argmax along this axis), of anything else \
             save one entry, 0 to {}, as a volume of three axes",
            count - 1
        );
        header.unsupported(found, instead)
    };
    // Indices of labels are bytes, 0 the background.
    if count > 255 {
        let found = format!("axis {axis} with {count} entries");
        let instead = "up to 255 masks in one axis are read as labels: save fewer of them, or one volume of labels";
        return Err(header.unsupported(found, instead));
    }
    let voxels = grid.size.iter().product();
    let (order, is_fastest) = (header.data_order(), axis == 0);
    // A voxel keeps the number of its set of channels: sets are few, and channels may come in either order in one pass.
    let mut sets = Sets::new(header.scale);
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
                    // Ends the reading; the refusal takes its place.
                    return Err(VolumeError::new(""));
                }
            }
            read += 1;
        }
        Ok(())
    }))
    .map_err(|error| refusal.take().unwrap_or(error))?;
    let mut warnings = std::mem::take(&mut source.warnings);
    let has_background = has_background(&of_voxels, &sets.channels);
    if has_background {
        // The set of the first channel alone is that of no label.
        for set in &mut sets.channels {
            *set = set.iter().filter_map(|channel| channel.checked_sub(1)).collect();
        }
    }
    let values = 1..=count as i64 - i64::from(has_background);
    let names: Vec<Option<String>> = values.map(|value| header.names.get(&value).cloned()).collect();
    let labelled = flattened(&of_voxels, &sets.channels, &names);
    // Regions within others lie above them: where others hide most masks wholly, they are no masks of labels.
    let is_claimed = |channel: &usize| sets.channels.iter().any(|set| set.contains(channel));
    let is_hidden = |channel: &usize| labelled.labels[channel + 1].voxels == 0 && is_claimed(channel);
    let hidden = (0..names.len()).filter(is_hidden).count();
    if !is_fastest && 2 * hidden >= names.len() && grid.size[0] < count {
        let found = format!("{count} masks in axis {axis}, {hidden} of which others cover wholly");
        let instead = format!(
            "the masks seem to be the {} entries of axis 0: save them along the last axis (numpy.moveaxis(masks, 0, -1))",
            grid.size[0]
        );
        return Err(header.unsupported(found, instead));
    }
    warnings.extend(labelled.warning);
    let background = if has_background {
        ", the first of them the background"
    } else {
        ""
    };
    let mut notes = Notes::default();
    notes.push(format!(
        "{count} masks in axis {axis} are read as labels 1 to {}{background}",
        names.len()
    ));
    notes.extend(sets.values.notes());
    let volume = LabelVolume::new(grid.size, labelled.voxels, labelled.labels, grid.index_to_world)
        .map_err(|error| error.in_file(&header.path))?;
    Ok(Loaded {
        volume,
        notes,
        warnings,
    })
}

/// Masks as one label a voxel.
pub(super) struct Flattened {
    pub(super) voxels: Vec<u8>,
    /// The background, and the labels of the channels, by number.
    pub(super) labels: Vec<Label>,
    /// Masks that lose voxels to others.
    pub(super) warning: Option<String>,
}

/// Whether the first channel is a background: it has the first corner, which a body seldom reaches, and half of the
/// voxels, and shares none with others.
fn has_background(of_voxels: &[u32], sets: &[Vec<usize>]) -> bool {
    let first = |set: &&u32| sets[**set as usize].contains(&0);
    let alone = |set: &u32| sets[*set as usize] == [0];
    let voxels = of_voxels.iter().filter(first).count();
    of_voxels.first().is_some_and(alone) && 2 * voxels >= of_voxels.len() && of_voxels.iter().filter(first).all(alone)
}

/// One label for each channel, by its name if it has one; a body lies below organs, and a larger mask below a smaller
/// one.
pub(super) fn flattened(of_voxels: &[u32], sets: &[Vec<usize>], names: &[Option<String>]) -> Flattened {
    let mut voxels_of = vec![0u64; sets.len()];
    for &set in of_voxels {
        voxels_of[set as usize] += 1;
    }
    let mut claimed = vec![0u64; names.len()];
    for (channels, voxels) in sets.iter().zip(&voxels_of) {
        channels.iter().for_each(|&channel| claimed[channel] += voxels);
    }
    let rank = |channel: usize| precedence(names[channel].as_deref(), claimed[channel]);
    let mut labels = vec![Label {
        value: 0,
        name: None,
        voxels: 0,
    }];
    labels.extend((1..).zip(names).map(|(value, name)| Label {
        value,
        name: name.clone(),
        voxels: 0,
    }));
    let mut overlaps = Overlaps::default();
    let mut tops = Vec::with_capacity(sets.len());
    for (channels, &voxels) in sets.iter().zip(&voxels_of) {
        let top = channels.iter().copied().max_by_key(|&channel| rank(channel));
        for &below in channels.iter().filter(|&&channel| voxels > 0 && Some(channel) != top) {
            overlaps.add(below, top.unwrap_or(below), voxels);
        }
        let label = top.map_or(0, |channel| channel + 1);
        labels[label].voxels += voxels;
        tops.push(label as u8);
    }
    let named = |channel: usize| {
        let name = names[channel].clone();
        (
            name.unwrap_or_else(|| format!("label {}", channel + 1)),
            claimed[channel],
        )
    };
    Flattened {
        voxels: of_voxels.iter().map(|&set| tops[set as usize]).collect(),
        warning: overlaps.warning("masks", named),
        labels,
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
                [
                    "masks overlap, and a body lies below organs, a larger one below a smaller one: label 1: 33 % covered by label 2"
                ]
            );
        }
    }

    #[test]
    fn a_first_channel_around_all_others_is_the_background() {
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
        let loaded = load(&file(folder.path(), LAST, &[1, 0, 1, 0, 0, 1, 0, 0])).unwrap();
        assert_eq!(loaded.volume.voxels(), [0, 1, 0, 0], "a channel is missing");
        let loaded = load(&file(folder.path(), LAST, &[1, 1, 1, 0, 0, 1, 0, 0])).unwrap();
        assert_eq!(loaded.volume.voxels(), [1, 2, 1, 0], "a body has other masks in it");
        // Where the corner has another channel, all of them are labels.
        let loaded = load(&file(folder.path(), LAST, &[0, 1, 1, 1, 1, 0, 0, 0])).unwrap();
        assert_eq!(loaded.volume.voxels(), [2, 1, 1, 1]);
    }

    #[test]
    fn masks_that_hide_one_another_lie_along_a_shorter_axis() {
        let folder = tempfile::tempdir().unwrap();
        // Two organs of 3 x 2 x 1 voxels, the organs in the first axis: entry after entry of the last one is the same.
        let header = "sizes: 2 2 1 3\nspace directions: (1,0,0) (0,1,0) (0,0,1) none";
        let nested = [1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0];
        let message = load(&file(folder.path(), header, &nested)).unwrap_err().to_string();
        assert!(
            message.contains("3 masks in axis 3, 2 of which others cover wholly")
                && message.contains("the 2 entries of axis 0"),
            "{message}"
        );
        // Regions within regions and empty masks are read.
        for masks in [
            [1, 1, 1, 0, 1, 1, 0, 0, 1, 0, 0, 0],
            [1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0],
        ] {
            assert!(load(&file(folder.path(), header, &masks)).is_ok());
        }
    }

    #[test]
    fn what_is_no_mask_is_refused_with_the_entries_to_choose_from() {
        let folder = tempfile::tempdir().unwrap();
        let message = load(&file(folder.path(), LAST, &[0, 1, 1, 0, 0, 2, 0, 1]))
            .unwrap_err()
            .to_string();
        assert!(
            message.contains("axis 3 with 2 entries that are no masks (2 in entry 1)")
                && message.contains("save one entry, 0 to 1"),
            "{message}"
        );
    }
}
