//! Completion of a segmentation by its source CT.
//!
//! The body is the region denser than gas that is connected with the labels, without the table. Unlabelled voxels in it
//! are classified by their grey values, smoothed over three voxels. The classes correspond to the values of
//! [`numbering::body`](crate::acoustics::numbering::body).

use std::ops::RangeInclusive;

use insonify_base::note::Note;
use insonify_base::parallel::{chunks_mut, for_each};
use nalgebra::Point3;

use super::{CompleteOptions, Completed, Filled, MIN_MM, Outline, label};
use crate::acoustics::known;
use crate::volume::distance::Grid;
use crate::volume::{Label, LabelVolume, ScalarImage, VolumeError};

/// Upper limits of gas, fat and soft tissue, HU; denser voxels are bone.
const LIMITS_HU: [f32; 3] = [-300.0, -30.0, 150.0];
/// Radius of the morphological opening that separates table and sheets from the body, mm.
const OPENING_MM: f64 = 4.0;
/// Distance from the outline around the labels within which soft tissue is muscle of the wall, mm.
const WALL_MM: f64 = 20.0;
/// Contrast of vessels in a liver, HU above its median, and the range of their fraction of the liver: less is noise,
/// more cannot be vessels.
const VESSELS_HU: f32 = 40.0;
const VESSELS_SHARE: [f64; 2] = [0.003, 0.2];
/// Medians by which a CT is known to be that of its labels, HU: of solid organs from unenhanced fatty livers to arterial
/// kidneys, of lungs up to consolidated ones, of bones from osteoporotic vertebrae on.
const ORGANS_HU: RangeInclusive<f32> = -30.0..=300.0;
const LUNGS_HU: RangeInclusive<f32> = -1100.0..=-300.0;
const BONES_HU: RangeInclusive<f32> = 50.0..=2000.0;
/// Minimum fraction of the labelled voxels that lie in the CT.
const COVERED: f64 = 0.98;

/// Names of the appended labels.
const CLASSES: [&str; 8] = [
    "soft_tissue",
    "muscle",
    "fat",
    "peritoneal_fat",
    "skin",
    "gas",
    "dense",
    "hepatic_vein",
];

/// Completes a segmentation by its CT: unlabelled voxels of the body become gas, fat, muscle, soft tissue or bone by
/// their grey values, the outermost [`CompleteOptions::skin_mm`] skin; gas in labels of bowel becomes gas, and voxels
/// much brighter than the rest of a liver become its vessels.
///
/// # Errors
/// [`VolumeError`] if the CT does not cover the labels, a thickness is out of range, or 256 labels do not
/// suffice.
pub fn with_ct(volume: &LabelVolume, ct: &ScalarImage, options: &CompleteOptions) -> Result<Completed, VolumeError> {
    options.check()?;
    let (size, spacing) = (volume.size(), volume.spacing_mm());
    let [nx, ny, _] = size;
    let grey = sampled(volume, ct)?;
    let smooth = smoothed(size, spacing, &grey);

    let tissue = |label: u8| known(volume.labels()[usize::from(label)].name.as_deref()?).map(|(tissue, _)| tissue);
    let indices = (0..=255u8).take(volume.labels().len());
    let tissues: Vec<_> = indices
        .map(|label| if label == 0 { None } else { tissue(label) })
        .collect();
    let is_tissue = |label: u8, names: &[&str]| {
        tissues[usize::from(label)].is_some_and(|tissue| names.contains(&tissue.name.as_ref()))
    };
    let is_organ = |label: u8| tissues[usize::from(label)].is_some_and(|tissue| tissue.soft_organ);
    let median = |wanted: &dyn Fn(u8) -> bool| median(volume, &smooth, wanted);
    let lungs = |label: u8| is_tissue(label, &["lung"]);
    let bones = |label: u8| is_tissue(label, &["bone"]);
    let expected: [(&str, &dyn Fn(u8) -> bool, _); 3] = [
        ("solid organs", &is_organ, ORGANS_HU),
        ("lungs", &lungs, LUNGS_HU),
        ("bones", &bones, BONES_HU),
    ];
    let wrong = expected.iter().filter_map(|(what, wanted, range)| {
        let hu = median(wanted).filter(|hu| !range.contains(hu))?;
        let [low, high] = [range.start(), range.end()];
        Some(format!(
            "the {what} have a median of {hu:.0} in the CT, not {low} to {high} HU"
        ))
    });
    let wrong: Vec<String> = wrong.collect();
    let text = wrong.join(", ");
    // One may be ill; two are another place or another patient.
    let warning = match wrong.len() {
        0 => None,
        1 => Some(format!("{text}: is it the CT of these labels, in Hounsfield units?")),
        _ => {
            let text = format!("{text}; expected the CT that was segmented, in Hounsfield units");
            return Err(VolumeError::option("ct", text));
        }
    };

    let mut labels = volume.labels().to_vec();
    let class = CLASSES.map(|name| label(&mut labels, name));
    VolumeError::check_labels(labels.len())?;
    let [.., skin, gas, _, vein] = class;
    let liver = |label_index: u8| is_tissue(label_index, &["liver"]);
    let bright = median(&liver).map(|hu| hu + VESSELS_HU);
    let is_vessel =
        |(label_index, hu): &(&u8, &f32)| liver(**label_index) && bright.is_some_and(|bright| **hu > bright);
    let vessels = volume.voxels().iter().zip(&smooth).filter(is_vessel).count() as f64;
    let livers = volume
        .voxels()
        .iter()
        .filter(|label_index| liver(**label_index))
        .count()
        .max(1) as f64;
    let has_vessels = (VESSELS_SHARE[0]..=VESSELS_SHARE[1]).contains(&(vessels / livers));

    let thinnest = spacing.iter().copied().fold(0.0, f64::max);
    let outer = outside(volume, &grey);
    // Skin is measured from the air of the CT: the outline around the labels may lie far from the surface.
    let from_outside = Grid::squared_distances(&outer, size, spacing, &[0, 1, 2]).values;
    let reach = options.skin_mm.max(thinnest) + 1e-3;
    let mut voxels = volume.voxels().to_vec();
    let Some(outline) = Outline::around(volume, MIN_MM) else {
        return Err(elsewhere(0.0));
    };
    for_each((0.., chunks_mut(&mut voxels, nx)), &|(row, line)| {
        let index = |i: usize| row * nx + i;
        // Labels of the file first: the row then holds no appended labels, which `tissues` lacks.
        for (i, voxel) in line.iter_mut().enumerate().filter(|(_, voxel)| **voxel != 0) {
            let hu = smooth[index(i)];
            if is_tissue(*voxel, &["bowel_content", "small_bowel"]) && hu < LIMITS_HU[0] {
                *voxel = gas;
            } else if has_vessels && is_vessel(&(voxel, &hu)) {
                *voxel = vein;
            }
        }
        outline.along_row(row % ny, row / ny, line, |voxel, i, distance| {
            if outer[index(i)] {
                return;
            }
            let hu = smooth[index(i)];
            let is_skin = f64::from(from_outside[index(i)]).sqrt() <= reach;
            *voxel = if is_skin {
                skin
            } else {
                classified(hu, distance, &class)
            };
        });
    });
    let changed = voxels.iter().zip(volume.voxels()).filter(|(new, old)| new != old);
    let mut counts = [0u64; 256];
    changed.for_each(|(new, _)| counts[usize::from(*new)] += 1);
    let filled = filled(class, &counts);
    let head = if bright.is_some() && !has_vessels {
        "unlabelled voxels were filled by the CT; the liver shows no vessels"
    } else {
        "unlabelled voxels were filled by the CT"
    };
    let note = note(&labels, class, &counts, reach, head);
    Ok(Completed {
        volume: LabelVolume::new(size, voxels, labels, *volume.index_to_world())?,
        filled,
        note,
        warning,
    })
}

fn filled([soft, muscle, fat, deep_fat, skin, ..]: [u8; 8], counts: &[u64; 256]) -> Filled {
    let count = |class: u8| counts[usize::from(class)];
    Filled {
        soft_tissue: count(soft),
        muscle: count(muscle),
        fat: count(fat) + count(deep_fat),
        skin: count(skin),
    }
}

/// Class of an unlabelled voxel under the skin, at a distance from the outline of the labels, mm.
fn classified(hu: f32, distance: f64, class: &[u8; 8]) -> u8 {
    let [soft, muscle, fat, deep_fat, _, gas, bone, _] = *class;
    match () {
        _ if hu < LIMITS_HU[0] => gas,
        _ if hu < LIMITS_HU[1] && distance > 0.0 => fat,
        _ if hu < LIMITS_HU[1] => deep_fat,
        _ if hu >= LIMITS_HU[2] => bone,
        _ if distance > -WALL_MM => muscle,
        _ => soft,
    }
}

/// Median of the grey values under the wanted labels.
fn median(volume: &LabelVolume, grey: &[f32], wanted: &dyn Fn(u8) -> bool) -> Option<f32> {
    let voxels = volume.voxels().iter().zip(grey);
    let mut values: Vec<f32> = voxels.filter(|(label, _)| wanted(**label)).map(|(_, hu)| *hu).collect();
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f32::total_cmp).1)
}

/// Note about a body that was filled by a CT, with the voxels of each class.
fn note(labels: &[Label], class: [u8; 8], counts: &[u64; 256], reach: f64, head: &str) -> Note {
    let counted: Vec<String> = CLASSES
        .iter()
        .zip(class)
        .filter(|(_, class)| counts[usize::from(*class)] > 0)
        .map(|(name, class)| {
            format!(
                "{name} ({}) {}",
                labels[usize::from(class)].value,
                counts[usize::from(class)]
            )
        })
        .collect();
    let details = format!(
        "below {} HU as gas, to {} as fat, to {} as muscle near the outline of the labels and soft tissue elsewhere, above as \
         bone, the outermost {reach:.1} mm as skin; voxels: {}",
        LIMITS_HU[0],
        LIMITS_HU[1],
        LIMITS_HU[2],
        counted.join(", ")
    );
    Note::new(head, details)
}

/// Grey values of voxels, smoothed over three of them; air where there is no CT.
fn smoothed(size: [usize; 3], spacing: [f64; 3], grey: &[f32]) -> Vec<f32> {
    let mut smooth = Grid {
        size,
        spacing,
        values: grey
            .iter()
            .map(|hu| if hu.is_finite() { *hu } else { -1000.0 })
            .collect(),
    };
    (0..3).for_each(|axis| smooth.convolve(axis, &[2.0, 1.0]));
    smooth.values
}

/// Error of a CT that covers only this share of the labelled voxels.
fn elsewhere(share: f64) -> VolumeError {
    let covered = 100.0 * share;
    let expected = "the CT that was segmented, at its own place";
    let text = format!("the CT covers {covered:.0} % of the labelled voxels; expected {expected}");
    VolumeError::option("ct", text)
}

/// Grey values of the nearest voxels of a CT, which covers the labels; not finite outside it.
fn sampled(volume: &LabelVolume, ct: &ScalarImage) -> Result<Vec<f32>, VolumeError> {
    let grey = nearest(volume, ct);
    let labelled = || volume.voxels().iter().zip(&grey).filter(|(label, _)| **label != 0);
    let covered = labelled().filter(|(_, grey)| grey.is_finite()).count();
    let share = covered as f64 / labelled().count().max(1) as f64;
    if share < COVERED {
        Err(elsewhere(share))
    } else {
        Ok(grey)
    }
}

fn nearest(volume: &LabelVolume, ct: &ScalarImage) -> Vec<f32> {
    let [nx, ny, _] = volume.size();
    let Some(to_index) = ct.index_to_world.try_inverse() else {
        return vec![f32::NAN; volume.voxels().len()];
    };
    let to_index = to_index * volume.index_to_world();
    let value = |voxel: usize| {
        let index = Point3::new(
            (voxel % nx) as f64,
            (voxel / nx % ny) as f64,
            (voxel / (nx * ny)) as f64,
        );
        let index = to_index.transform_point(&index).map(f64::round);
        let inside = (0..3).all(|axis| index[axis] >= 0.0 && index[axis] < ct.size[axis] as f64);
        let [i, j, k] = [0, 1, 2].map(|axis| index[axis] as usize);
        if inside {
            ct.data[i + ct.size[0] * (j + ct.size[1] * k)]
        } else {
            f32::NAN
        }
    };
    let mut grey = vec![0.0; volume.voxels().len()];
    for_each((0.., &mut grey[..]), &|(voxel, grey)| *grey = value(voxel));
    grey
}

/// Voxels outside the body: a flood fill from the sides of the box, after a morphological opening that removes table
/// and sheets.
fn outside(volume: &LabelVolume, grey: &[f32]) -> Vec<bool> {
    let (size, spacing) = (volume.size(), volume.spacing_mm());
    let axes = [0, 1, 2];
    let empty: Vec<bool> = grey
        .iter()
        .zip(volume.voxels())
        .map(|(hu, &label)| label == 0 && (hu.is_nan() || *hu < LIMITS_HU[0]))
        .collect();
    let opening = (OPENING_MM * OPENING_MM) as f32;
    let from_empty = Grid::squared_distances(&empty, size, spacing, &axes).values;
    let seeds = volume
        .voxels()
        .iter()
        .zip(&from_empty)
        .map(|(&label, &squared)| label != 0 && squared > opening);
    let core = flooded(size, seeds, |voxel| from_empty[voxel] > opening);
    let from_core = Grid::squared_distances(&core, size, spacing, &axes).values;
    let is_body = |voxel: usize| volume.voxels()[voxel] != 0 || (!empty[voxel] && from_core[voxel] <= opening);
    // Gas that the box cuts off at the head or the feet is inside: floods start from the sides only.
    let upwards = |axis: usize| volume.index_to_world()[(2, axis)].abs() / spacing[axis];
    let up = (0..3).fold(0, |best, axis| if upwards(axis) > upwards(best) { axis } else { best });
    let at_side = |voxel: usize| {
        let index = [voxel % size[0], voxel / size[0] % size[1], voxel / (size[0] * size[1])];
        (0..3).any(|axis| axis != up && (index[axis] == 0 || index[axis] + 1 == size[axis]))
    };
    let seeds = (0..grey.len()).map(|voxel| at_side(voxel) && !is_body(voxel));
    flooded(size, seeds, |voxel| !is_body(voxel))
}

/// Flood fill: open voxels connected with the seeds across faces.
fn flooded(size: [usize; 3], seeds: impl Iterator<Item = bool>, open: impl Fn(usize) -> bool) -> Vec<bool> {
    let mut reached: Vec<bool> = seeds.collect();
    let mut next: Vec<usize> = (0..reached.len()).filter(|voxel| reached[*voxel]).collect();
    let strides = [1, size[0], size[0] * size[1]];
    while let Some(voxel) = next.pop() {
        for axis in 0..3 {
            let index = voxel / strides[axis] % size[axis];
            let low = (index > 0).then(|| voxel - strides[axis]);
            let high = (index + 1 < size[axis]).then(|| voxel + strides[axis]);
            for other in [low, high].into_iter().flatten() {
                if !reached[other] && open(other) {
                    reached[other] = true;
                    next.push(other);
                }
            }
        }
    }
    reached
}

#[cfg(test)]
mod tests;
