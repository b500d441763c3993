//! Naming of labels by their values, and plausibility checks of names.

use super::{Naming, Segmentation};
use crate::acoustics::{Preset, numbering, without_side};
use crate::volume::LabelVolume;
use crate::volume::complete::has_body_values;
use insonify_base::document::plain;
use insonify_base::text::some_of;

/// Mass of an organ of a newborn and of an adult man, g (ICRP Publication 89, 2002, table 2.8; one of a pair; hollow organs with
/// their contents), by its name without a side. For a vessel, without a newborn's: the blood in all large arteries or all large
/// veins of a man (6 and 18 % of 5.3 l, table 2.14), above which it is implausible.
pub(super) const ORGANS: &[(&str, f64, f64)] = &[
    ("spleen", 9.5, 150.0),
    ("kidney", 12.5, 155.0),
    ("gallbladder", 3.3, 68.0),
    ("liver", 130.0, 1800.0),
    ("stomach", 47.0, 400.0),
    ("pancreas", 6.0, 140.0),
    ("adrenal_gland", 3.0, 7.0),
    ("esophagus", 2.0, 40.0),
    ("thyroid_gland", 1.3, 20.0),
    ("heart", 46.0, 840.0),
    ("brain", 380.0, 1450.0),
    ("aorta", 0.0, 318.0),
    ("inferior_vena_cava", 0.0, 954.0),
];

/// Smallest plausible fraction of a newborn's organ, and largest plausible multiple of an adult's: empty organs and large
/// spleens are within them. Tissue weighs about 1 g/ml.
const SPAN: [f64; 2] = [1.0 / 3.0, 6.0];

/// Number of organs of plausible volume from which a numbering is accepted without a warning.
const ENOUGH: usize = 3;

/// Whether a value is common in masks and thus carries no information.
pub(super) fn is_mask(value: i64) -> bool {
    matches!(value, 1 | 255)
}

/// Size and position of a label.
struct Size {
    ml: f64,
    /// Whether the edge of the scan cuts the label, so that it may be small.
    cut: bool,
    /// Mean coordinate towards the left, mm; NaN for a label without voxels.
    left_mm: f64,
}

/// Size of each label.
pub(super) struct Sizes(Vec<Size>);

impl Sizes {
    pub(super) fn of(volume: &LabelVolume) -> Self {
        let means = left_mm(volume);
        let places = cut_mm2(volume).into_iter().zip(means);
        let sizes = volume.labels().iter().zip(places).map(|(label, (cut, left_mm))| {
            let mm3 = label.voxels as f64 * volume.voxel_mm3();
            Size {
                ml: mm3 / 1000.0,
                // A tube that leaves the scan is cut across less than a face of the cube of its volume, other truncated
                // organs across more.
                cut: cut >= mm3.powf(2.0 / 3.0),
                left_mm,
            }
        });
        Self(sizes.collect())
    }
}

/// Mean coordinate of each label towards the patient's left, mm.
fn left_mm(volume: &LabelVolume) -> Vec<f64> {
    let (mut sums, mut counts) = (vec![0.0; volume.labels().len()], vec![0.0; volume.labels().len()]);
    let [nx, ny, _] = volume.size();
    let to_left = volume.index_to_world().row(0).into_owned();
    for (row, voxels) in volume.voxels().chunks(nx).enumerate() {
        let start = to_left[1] * (row % ny) as f64 + to_left[2] * (row / ny) as f64 + to_left[3];
        for (column, &voxel) in voxels.iter().enumerate() {
            sums[usize::from(voxel)] += start + to_left[0] * column as f64;
            counts[usize::from(voxel)] += 1.0;
        }
    }
    sums.iter().zip(counts).map(|(sum, count)| sum / count).collect()
}

/// Area of contact of each label with the edge of the scan, mm^2.
fn cut_mm2(volume: &LabelVolume) -> Vec<f64> {
    let (size, to_world) = (volume.size(), volume.index_to_world());
    let step = |axis: usize| to_world.fixed_view::<3, 1>(0, axis).into_owned();
    let mut areas = vec![0.0; volume.labels().len()];
    for axis in 0..3 {
        let [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
        let face = step(u).cross(&step(v)).norm();
        for end in [0, size[axis] - 1] {
            for pixel in 0..size[u] * size[v] {
                let mut index = [0; 3];
                (index[axis], index[u], index[v]) = (end, pixel % size[u], pixel / size[u]);
                areas[usize::from(volume.voxels()[volume.offset(index)])] += face;
            }
        }
    }
    areas
}

/// Plausibility of the names of labels.
#[derive(Default)]
struct Fit {
    /// Number of labels with a plausible volume for their organ.
    sound: usize,
    /// Descriptions of labels with an implausible volume for their name.
    odd: Vec<String>,
    /// Sum of the squares of logarithmic distances from an adult's organs.
    misfit: f64,
}

impl Segmentation {
    fn fit(&self, names: &[(usize, String)], sizes: &Sizes) -> Fit {
        let mut fit = Fit::default();
        let value = |index: usize| self.volume.labels()[index].value;
        for (index, name) in names {
            let Size { ml, cut, left_mm } = sizes.0[*index];
            let plain_name = plain(name);
            let mirrored = plain_name.replace("right", "left");
            let other = names
                .iter()
                .find(|(_, other)| mirrored != plain_name && plain(other) == mirrored);
            if let Some((other, other_name)) = other.filter(|(other, _)| left_mm > sizes.0[*other].left_mm) {
                let [right, left] = [value(*index), value(*other)];
                fit.odd.push(format!(
                    "label {right} ({name}) lies left of label {left} ({other_name})"
                ));
            }
            let organ = without_side(&plain_name);
            let Some((_, newborn, adult)) = ORGANS.iter().find(|(known, ..)| *known == organ) else {
                continue;
            };
            let is_vessel = *newborn == 0.0;
            let [low, high] = [SPAN[0] * newborn, if is_vessel { *adult } else { SPAN[1] * adult }];
            // What is not in the scan as a whole, and vessels, of which any length is scanned, may be small.
            let excused = ml == 0.0 || (cut && ml < *adult) || (is_vessel && ml <= high);
            if excused {
                continue;
            }
            if (low..=high).contains(&ml) {
                fit.sound += 1;
                fit.misfit += (ml / adult).ln().powi(2);
            } else {
                let value = value(*index);
                fit.odd.push(format!(
                    "label {value} ({name}) has {ml:.2} ml, expected {low:.1} to {high:.0} ml"
                ));
            }
        }
        fit
    }

    /// Organ of a label by its value. Body values, which TotalSegmentator does not have, count only in a file that has a body.
    fn organ(&self, preset: Preset, index: usize) -> Option<&'static str> {
        let value = self.volume.labels()[index].value;
        let of_body = numbering::body().iter().any(|class| class.value == value);
        preset
            .organ(value)
            .filter(|_| !of_body || has_body_values(&self.volume))
    }

    /// Names of labels by a numbering that knows all of them.
    fn organs(&self, preset: Preset, nameless: &[usize]) -> Option<Vec<(usize, String)>> {
        let organ = |&index: &usize| Some((index, self.organ(preset, index)?.to_owned()));
        nameless.iter().map(organ).collect()
    }

    /// Names the unnamed labels by their values, in the best-fitting numbering.
    pub(super) fn read_values(&mut self, naming: &Naming, sizes: &Sizes) {
        let all: Vec<usize> = self.nameless(naming).collect();
        if naming.preset != Preset::Auto {
            return self.read_as(naming.preset, &all);
        }
        // Values unknown to every numbering do not prevent naming the others, if these give plausible organs.
        let numbered = |index: &usize| self.organ(Preset::TotalSegmentator, *index).is_some();
        let (nameless, strange): (Vec<usize>, Vec<usize>) = all.iter().partition(|index| numbered(index));
        let only_mask = self.volume.labels().len() == 2 && is_mask(self.volume.labels()[1].value);
        if only_mask {
            return;
        }
        if nameless.is_empty() {
            return self.read_as(Preset::TotalSegmentator, &strange);
        }
        let fit = |&preset: &Preset| {
            let names = self.organs(preset, &nameless)?;
            Some((preset, self.fit(&names, sizes), names))
        };
        let fits: Vec<_> = Preset::NUMBERINGS.iter().map(fit).collect();
        let Some((usual, fit, names)) = &fits[0] else {
            return;
        };
        let others = || fits[1..].iter().flatten().filter(|(_, fit, _)| fit.odd.is_empty());
        let other = others().min_by(|a, b| a.1.misfit.total_cmp(&b.1.misfit));
        let count = match nameless.len() {
            1 => "1 label without a name is".to_owned(),
            n => format!("{n} labels without names are"),
        };
        let by = format!("{count} read by the numbers of");
        let title = usual.title();
        let mut preset = *usual;
        match other {
            Some((other, better, _)) if !fit.odd.is_empty() && better.sound > ENOUGH => {
                let odd = fit.odd.join(", ");
                self.notes
                    .push(format!("{by} {}: by those of {title}, {odd}", other.title()));
                preset = *other;
            }
            _ if fit.odd.is_empty() && fit.sound >= ENOUGH && others().all(|(.., same)| same == names) => {
                self.notes.push(format!("{by} {title}"));
            }
            _ if !strange.is_empty() && fit.sound < ENOUGH => return self.read_as(*usual, &strange),
            _ => {
                let shown = |(index, name): &(usize, String)| format!("{} {name}", self.volume.labels()[*index].value);
                let some: Vec<String> = names.iter().take(4).map(shown).collect();
                let more = if names.len() > some.len() { ", ..." } else { "" };
                let fitting = match other {
                    Some((other, ..)) if !fit.odd.is_empty() => format!("; those of {} would fit", other.title()),
                    _ => String::new(),
                };
                self.warnings.push(format!(
                    "{by} {title} ({}{more}) on weak evidence{fitting}: name the labels with --names FILE or volume.names, \
                     choose another volume.preset, or write [[tissue]] with name and labels = [VALUE, ...]",
                    some.join(", ")
                ));
            }
        }
        self.read_as(preset, &all);
    }

    /// Names labels by the values of a numbering, with a warning about unknown values.
    fn read_as(&mut self, preset: Preset, nameless: &[usize]) {
        let organs: Vec<_> = nameless.iter().map(|index| self.organ(preset, *index)).collect();
        let (mut values, mut strange) = (Vec::new(), Vec::new());
        for (&index, organ) in nameless.iter().zip(organs) {
            let value = self.volume.labels()[index].value;
            match organ {
                Some(organ) => {
                    self.volume.name(index, organ.to_owned());
                    values.push(value);
                }
                None => {
                    let ml = self.volume.labels()[index].voxels as f64 * self.volume.voxel_mm3() / 1000.0;
                    strange.push(format!("{value} ({ml:.2} ml)"));
                }
            }
        }
        if !strange.is_empty() && Preset::NUMBERINGS.contains(&preset) {
            let (title, plural) = (preset.title(), if strange.len() == 1 { "" } else { "s" });
            self.warnings
                .push(format!("{title} has no label{plural} {}", some_of(&strange)));
        }
        if !values.is_empty() {
            self.by_value = Some((preset, values));
        }
    }

    /// Warning about labels that are implausible for their names.
    pub(super) fn doubts(&self, sizes: &Sizes) -> Option<String> {
        let labels = self.volume.labels().iter().enumerate().skip(1);
        let names: Vec<(usize, String)> = labels
            .filter_map(|(index, label)| Some((index, label.name.clone()?)))
            .collect();
        let odd = self.fit(&names, sizes).odd;
        let remedy = match self.by_value {
            Some(_) => "name the labels with --names FILE, or choose another volume.preset",
            None => "check names, voxel spacing and orientation",
        };
        (!odd.is_empty()).then(|| format!("{}: {remedy}", odd.join(", ")))
    }
}
