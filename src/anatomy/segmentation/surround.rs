//! Labels that are no organs: a background that is not 0, and a body.

use super::extent::Extents;
use super::{Naming, Segmentation};
use crate::acoustics::{Preset, fallback, known};
use crate::volume::complete::{has_body_values, is_body};
use crate::volume::{Label, LabelVolume, VolumeError};
use insonify_base::document::plain;

/// Values that files use for the background in place of 0, or for what is not to be looked at.
const BACKGROUNDS: [i64; 2] = [-1, 255];

/// Name of a body.
const BODY: &str = "body";
/// Volume from which a label through all slices may be a body, and from which a single one is, ml: no organ is as
/// large.
const BODY_ML: [f64; 2] = [3000.0, 11000.0];
/// Least fraction of its box that a body fills with what lies in it, and least fraction of all labelled voxels in it.
const BODY_FILL: f64 = 0.5;
/// Voxels by which labels may stick out of the box of the body around them.
const STICKS_OUT: usize = 2;

impl Segmentation {
    /// Takes a label -1 or 255 that has all corners of the volume, beside other labels, for the background.
    pub(super) fn unlabel_background(&mut self, naming: &Naming) -> Result<(), VolumeError> {
        let volume = &self.volume;
        let Some(around) = surrounding(volume) else {
            return Ok(());
        };
        let labels = volume.labels();
        let Label { value, name, voxels } = &labels[usize::from(around)];
        let mut others = (1..labels.len()).filter(|&label| label != usize::from(around) && volume.holds(label));
        let is_guess = BACKGROUNDS.contains(value) && name.is_none() && !naming.claimed.contains(value);
        if !is_guess || others.next().is_none() {
            return Ok(());
        }
        let litres = *voxels as f64 * volume.voxel_mm3() / 1e6;
        let mut note = format!("label {value} ({litres:.1} l) surrounds all others and is taken as unlabelled");
        if labels[0].voxels > 0 {
            note.push_str(", as is 0");
        }
        let mut labels = labels.to_vec();
        labels[0].voxels += labels.remove(usize::from(around)).voxels;
        let moved = volume.voxels().iter().map(|&voxel| match voxel.cmp(&around) {
            std::cmp::Ordering::Less => voxel,
            std::cmp::Ordering::Equal => 0,
            std::cmp::Ordering::Greater => voxel - 1,
        });
        self.volume = LabelVolume::new(volume.size(), moved.collect(), labels, *volume.index_to_world())?;
        self.notes.push(note);
        Ok(())
    }

    /// Names a label that is as large as a body and encloses all others: one without a name, or whose name is that of
    /// no organ, or of the skin, which is filled.
    pub(super) fn name_body(&mut self, naming: &Naming, extents: &Extents, has_table: bool) {
        if naming.preset != Preset::Auto || has_body_values(&self.volume) {
            return;
        }
        let volume = &self.volume;
        let spacing = volume.spacing_mm();
        let upwards = |axis: &usize| volume.index_to_world()[(2, *axis)].abs() / spacing[*axis];
        let slices = [0, 1, 2].into_iter().max_by(|a, b| upwards(a).total_cmp(&upwards(b)));
        let present: Vec<usize> = (1..volume.labels().len())
            .filter(|label| volume.holds(*label))
            .collect();
        let voxels = |label: usize| volume.labels()[label].voxels as f64;
        let labelled: f64 = present.iter().map(|&label| voxels(label)).sum();
        let encloses_all = |&label: &usize| {
            let extent = &extents.labels[label];
            let sides = extent.voxels.map(|[first, last]| last + 1 - first);
            let fill = labelled / sides.iter().product::<usize>() as f64;
            let through = slices.is_some_and(|axis| sides[axis] == volume.size()[axis]);
            let encloses = |other: &usize| {
                let other = &extents.labels[*other].voxels;
                (0..3).all(|axis| {
                    let [first, last] = extent.voxels[axis];
                    first <= other[axis][0] + STICKS_OUT && other[axis][1] <= last + STICKS_OUT
                })
            };
            let is_named = volume.labels()[label].name.is_some();
            let is_large = if present.len() == 1 {
                extent.ml >= BODY_ML[1] || (through && extent.ml >= BODY_ML[0])
            } else {
                (through || is_named) && extent.ml >= BODY_ML[0]
            };
            is_large
                && surrounding(volume).map(usize::from) != Some(label)
                && fill >= BODY_FILL
                && voxels(label) >= BODY_FILL * labelled
                && present.iter().all(encloses)
        };
        let may_be_body = |&label: &usize| {
            let Label { value, name, .. } = &volume.labels()[label];
            match name {
                None => !has_table && !naming.claimed.contains(value),
                Some(name) => !naming.claimed_names.contains(name) && !naming.claimed.contains(value) && is_vague(name),
            }
        };
        let labels = || present.iter().copied();
        let has_body = labels().any(|label| {
            let name = volume.labels()[label].name.as_deref();
            name.is_some_and(|name| is_body(name) && !is_vague(name))
        });
        let Some(label) = labels().filter(may_be_body).find(encloses_all).filter(|_| !has_body) else {
            return;
        };
        let Label { value, name, .. } = &self.volume.labels()[label];
        let shown = match name {
            Some(name) => format!("label {value} ({name})"),
            None => format!("label {value}"),
        };
        let ml = extents.labels[label].ml;
        self.notes.push(format!(
            "{shown} is taken for the body: {:.1} l that enclose all other labels",
            ml / 1000.0
        ));
        self.volume.name(label, BODY.to_owned());
    }
}

/// Whether a name is that of no organ, or of the skin, whose inside files often have with it.
fn is_vague(name: &str) -> bool {
    plain(name) != BODY
        && known(name).is_none_or(|(tissue, _)| ["skin", &fallback().name].contains(&tissue.name.as_ref()))
}

/// Label of all corners of a volume.
fn surrounding(volume: &LabelVolume) -> Option<u8> {
    let last = volume.size().map(|n| n - 1);
    let corner = |which: usize| {
        let index = [0, 1, 2].map(|axis| (which >> axis & 1) * last[axis]);
        volume.voxels()[volume.offset(index)]
    };
    (1..8).all(|which| corner(which) == corner(0)).then(|| corner(0))
}
