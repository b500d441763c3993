//! Synthetic structures within organs that a segmentation labels as one piece, and within soft tissue filled by
//! completion.
//!
//! Livers and spleens get the trees of the vessels that enter them (`vessels`), kidneys a sinus and pyramids, a heart
//! without chambers four chambers, one with chambers their walls, lungs the diaphragm where they meet what lies under
//! it, and soft tissue fat around the kidneys and patches of fat and muscle. Everything is drawn voxel by voxel: structures narrower than about two voxels are left out. Structures
//! that the file labels itself are not drawn. [`LabelVolume::undivided`] returns the organs without structures.
//!
//! Sources: kidney, W. C. O'Neill, Am. J. Kidney Dis. 35 (2000) 1021 (parenchyma of 15 to 20 mm); heart, R. M. Lang et
//! al., J. Am. Soc. Echocardiogr. 28 (2015) 1 (walls of 6 to 10 mm). Patches, the proportion of pyramids and fat around
//! kidneys are set by eye.

pub mod organ;
mod vessels;

use insonify_base::note::Note;
use nalgebra::{Matrix3, Point3, Vector3};

use super::{Label, LabelVolume, VolumeError};
use crate::acoustics::known;
use insonify_base::parallel::{chunks_mut, for_each};
use insonify_base::random::noise::Noise;
use organ::Organ;
use vessels::{Root, Tree};

/// Depths below the surface of a kidney at which pyramids and the sinus begin, mm, and the largest ratio of the latter
/// to the greatest depth.
const KIDNEY_MM: [f64; 2] = [7.0, 15.0];
const SINUS_SHARE: f64 = 0.65;
/// Width of a pyramid, mm, and the noise threshold for pyramids: three fifths of the volume.
const PYRAMID_MM: f64 = 12.0;
const PYRAMIDS_ABOVE: f64 = -0.1;
/// Thickness of the walls of a heart, of its septum and of the plane of its valves, mm.
const HEART_MM: f64 = 10.0;
const SEPTUM_MM: f64 = 9.0;
const VALVES_MM: f64 = 3.0;
/// Thickness of the walls drawn into chambers that a file labels as cavities, mm: of two that touch they make a septum
/// or a valve, and the wall of the right heart and of atria is 2 to 4 mm (R. M. Lang et al., J. Am. Soc. Echocardiogr.
/// 28 (2015) 1).
const CHAMBER_WALL_MM: f64 = 2.0;
/// Thickness of the diaphragm at rest, mm (A. J. Boon et al., Muscle & Nerve 47 (2013) 884).
const DIAPHRAGM_MM: f64 = 3.3;
/// Distance of the plane of the valves from the centre of a heart towards its base, relative to its extent along its
/// axis.
const VALVES_AT: f64 = 0.1;
/// Least share of a kidney outside its sinus and pyramids, and of a heart outside its chambers: in an adult they are
/// two thirds and half, in voxels wider than cortex or walls next to nothing.
const LEAST_CORTEX: f64 = 0.5;
const LEAST_WALL: f64 = 0.25;
/// Thickness of the fat around kidneys and adrenal glands, mm.
const RENAL_FAT_MM: f64 = 8.0;
/// Width of the patches in soft tissue, mm, and the noise thresholds above which they are fat, and below which
/// muscle.
const PATCH_MM: f64 = 18.0;
const FAT_ABOVE: f64 = 0.25;
const MUSCLE_BELOW: f64 = -0.5;

/// A volume with synthetic structures.
pub struct Structured {
    /// Volume with structures. Appended labels have the names of built-in tissues; their `voxels` stay 0, since the
    /// file had none.
    pub volume: LabelVolume,
    /// Note about the structures drawn; `None` if there are none.
    pub note: Option<Note>,
}

/// Voxels and labels of the volume being drawn.
struct Drawing<'a> {
    volume: &'a LabelVolume,
    voxels: Vec<u8>,
    labels: Vec<Label>,
    /// Descriptions of what was drawn.
    notes: Vec<String>,
    /// Names of the organs whose voxels are too large for their structures.
    coarse: Vec<String>,
}

/// Draws structures into the organs of a completed volume.
///
/// # Errors
/// [`VolumeError::TooManyLabels`] if 256 labels do not suffice.
pub fn add(volume: &LabelVolume) -> Result<Structured, VolumeError> {
    let mut drawing = Drawing {
        volume,
        voxels: volume.voxels().to_vec(),
        labels: volume.labels().to_vec(),
        notes: Vec::new(),
        coarse: Vec::new(),
    };
    drawing.trees();
    drawing.kidneys();
    drawing.heart();
    drawing.diaphragm();
    drawing.filler();
    let Drawing {
        voxels,
        labels,
        notes,
        coarse,
        ..
    } = drawing;
    let coarse = (!coarse.is_empty()).then(|| format!("voxels are too large for structures in {}", coarse.join(", ")));
    if notes.is_empty() {
        return Ok(Structured {
            volume: volume.clone(),
            note: coarse.map(Note::from),
        });
    }
    let coarse = coarse.map_or_else(String::new, |coarse| format!("; {coarse}"));
    let mut structured = LabelVolume::new(volume.size(), voxels, labels, *volume.index_to_world())?;
    structured.set_undivided(volume.undivided().clone());
    Ok(Structured {
        volume: structured,
        note: Some(Note::new(
            format_args!(
                "structures were drawn into organs labelled in one piece; `structures = false` under [volume] leaves them \
                 out{coarse}"
            ),
            format_args!("drawn: {}", notes.join(", ")),
        )),
    })
}

impl Drawing<'_> {
    /// Labels of the file with a given tissue.
    fn of_tissue(&self, tissue: &str) -> Vec<u8> {
        let is = |label: &Label| {
            label
                .name
                .as_deref()
                .and_then(known)
                .is_some_and(|(found_tissue, _)| found_tissue.name == tissue)
        };
        let labels = (0..=255u8).zip(self.volume.labels()).skip(1);
        let present = labels.filter(|(index, label)| self.volume.holds(usize::from(*index)) && is(label));
        present.map(|(index, _)| index).collect()
    }

    /// Whether the file has a label with voxels whose name contains one of these words.
    fn has_named(&self, words: &[&str]) -> bool {
        let mut names = self.volume.labels().iter().filter(|label| label.voxels > 0);
        names.any(|label| {
            let name = label.name.as_deref().unwrap_or_default().to_lowercase();
            words.iter().any(|word| name.contains(word))
        })
    }

    /// Label of a structure, appended if missing; `None` if the file has one of that name, or no label is free.
    fn label(&mut self, name: &str) -> Option<u8> {
        let known = self.labels.iter().find(|label| label.name.as_deref() == Some(name));
        match known {
            Some(label) if label.voxels > 0 => return None,
            None if self.labels.len() > 255 => return None,
            _ => {}
        }
        Some(super::complete::label(&mut self.labels, name))
    }

    fn world(&self, voxel: [usize; 3]) -> Point3<f64> {
        self.volume
            .index_to_world()
            .transform_point(&Point3::from(voxel.map(|index| index as f64)))
    }

    /// Relabels voxels of an organ, of one label: `structure` returns the label at a depth, mm, and a position in the
    /// world, mm, if it is inside a structure. An organ of which less than the share `least` would remain is left alone.
    fn relabel(
        &mut self,
        (organ, label): (&Organ, u8),
        least: f64,
        structure: impl Fn(f64, &Point3<f64>) -> Option<u8>,
    ) -> usize {
        let inside = |(voxel, depth)| Some((self.volume.offset(voxel), structure(depth, &self.world(voxel))?));
        let drawn: Vec<(usize, u8)> = organ.voxels().filter_map(inside).collect();
        if drawn.len() as f64 > (1.0 - least) * organ.voxels().count() as f64 {
            let name = self.volume.labels()[usize::from(label)].name.clone();
            self.coarse.extend(name);
            return 0;
        }
        for (voxel, label) in &drawn {
            self.voxels[*voxel] = *label;
        }
        drawn.len()
    }

    /// Draws the veins of livers and spleens.
    fn trees(&mut self) {
        let by_ct = self
            .volume
            .labels()
            .iter()
            .position(|label| label.name.as_deref() == Some("hepatic_vein"));
        // Vessels that the CT shows or the file labels are real: grown ones would contradict them.
        if by_ct.is_some_and(|index| self.volume.holds(index)) || self.has_named(&["hepat", "liver_v", "liver v"]) {
            return;
        }
        let vessels = |words: &[&str]| -> Vec<u8> {
            let named = |label: &Label| {
                let name = label.name.as_deref().unwrap_or_default().to_lowercase();
                words.iter().any(|word| name.contains(word))
            };
            let labels = (0..=255u8).zip(self.volume.labels());
            labels
                .filter(|(_, label)| named(label))
                .map(|(index, _)| index)
                .collect()
        };
        let portal = vessels(&["portal"]);
        let caval = vessels(&["inferior_vena_cava", "inferior vena cava", "postcava", "ivc"]);
        let splenic = if portal.is_empty() {
            vessels(&["splenic"])
        } else {
            portal.clone()
        };
        let trees = [
            ("liver", &caval, Root::Highest, "hepatic_vein", "hepatic veins"),
            ("liver", &portal, Root::Innermost, "portal_branch", "portal branches"),
            ("spleen", &splenic, Root::Innermost, "splenic_vein", "splenic veins"),
        ];
        for (stream, (tissue, from, root, name, description)) in (1u32..).zip(trees) {
            let organs = self.of_tissue(tissue);
            let Some(organ) = Organ::of(self.volume, |label| organs.contains(&label)) else {
                continue;
            };
            let Some(tree) = Tree::grown(self.volume, &organ, |label| from.contains(&label), root, stream) else {
                continue;
            };
            let Some(label) = self.label(name) else {
                return;
            };
            let mut drawn = 0;
            tree.paint(self.volume, |voxel| {
                if organs.contains(&self.voxels[voxel]) {
                    self.voxels[voxel] = label;
                    drawn += 1;
                }
            });
            if drawn > 0 {
                self.notes.push(format!(
                    "{description} (label {})",
                    self.labels[usize::from(label)].value
                ));
            }
        }
    }

    /// Draws the sinus and pyramids of kidneys.
    fn kidneys(&mut self) {
        let kidneys = self.of_tissue("kidney_cortex");
        let kidneys: Vec<u8> = kidneys
            .into_iter()
            .filter(|index| self.is_named(*index, "kidney"))
            .collect();
        if kidneys.is_empty() || self.has_named(&["medulla", "renal_sinus", "pyramid", "kidney_cortex"]) {
            return;
        }
        let [Some(sinus), Some(medulla)] = ["renal_sinus", "kidney_medulla"].map(|name| self.label(name)) else {
            return;
        };
        let noise = Noise::new(0, 21, PYRAMID_MM);
        let mut drawn = 0;
        for kidney in kidneys {
            let Some(organ) = Organ::of(self.volume, |label| label == kidney) else {
                continue;
            };
            let [cortex_mm, parenchyma_mm] = KIDNEY_MM;
            let sinus_mm = parenchyma_mm.min(SINUS_SHARE * organ.deepest_mm());
            drawn += self.relabel((&organ, kidney), LEAST_CORTEX, |depth, point| match depth {
                _ if depth > sinus_mm => Some(sinus),
                _ if depth > cortex_mm && noise.at(&point.coords) > PYRAMIDS_ABOVE => Some(medulla),
                _ => None,
            });
        }
        if drawn > 0 {
            let value = |index: u8| self.labels[usize::from(index)].value;
            let note = format!("sinus ({}) and pyramids ({}) of kidneys", value(sinus), value(medulla));
            self.notes.push(note);
        }
    }

    fn is_named(&self, label: u8, word: &str) -> bool {
        let name = self.volume.labels()[usize::from(label)].name.as_deref();
        name.is_some_and(|name| name.to_lowercase().contains(word))
    }

    /// Draws the chambers of a heart with a single label: the part deeper than its walls, except a septum along its
    /// axis and a plane of valves across it.
    fn heart(&mut self) {
        let hearts = self.of_tissue("heart");
        let [heart] = hearts[..] else { return };
        if self.has_named(&["ventric", "atrium", "myocard", "blood"]) {
            return self.chamber_walls(heart);
        }
        let Some(organ) = Organ::of(self.volume, |label| label == heart) else {
            return;
        };
        let (mut middle, mut spread, mut count) = (Vector3::zeros(), Matrix3::zeros(), 0.0);
        for (voxel, _) in organ.voxels() {
            let point = self.world(voxel).coords;
            middle += point;
            spread += point * point.transpose();
            count += 1.0;
        }
        middle /= count;
        let axes = (spread / count - middle * middle.transpose()).symmetric_eigen();
        let longest = axes.eigenvalues.imax();
        // The apex points to the left, anteriorly and inferiorly; the right heart lies anterior and to the right of the
        // left one (LPS).
        let axis = axes.eigenvectors.column(longest).into_owned();
        let axis = axis * axis.dot(&Vector3::new(1.0, -1.0, -1.0)).signum();
        let across = Vector3::new(1.0, 1.0, 0.0);
        let across = (across - axis * axis.dot(&across)).normalize();
        // Twice the standard deviation of a solid ellipsoid is nine tenths of its half axis.
        let valves = -VALVES_AT * 4.0 * axes.eigenvalues[longest].sqrt();
        let Some(blood) = self.label("blood") else {
            return;
        };
        let drawn = self.relabel((&organ, heart), LEAST_WALL, |depth, point| {
            let from = point.coords - middle;
            let (along, aside) = (from.dot(&axis) - valves, from.dot(&across));
            let is_wall = depth <= HEART_MM || aside.abs() < 0.5 * SEPTUM_MM || along.abs() < 0.5 * VALVES_MM;
            (!is_wall).then_some(blood)
        });
        if drawn > 0 {
            let note = format!("chambers of the heart ({})", self.labels[usize::from(blood)].value);
            self.notes.push(note);
        }
    }

    /// Draws walls, septa and closed valves into the chambers of a heart that the file labels as cavities.
    fn chamber_walls(&mut self, heart: u8) {
        let chambers: Vec<u8> = self
            .of_tissue("blood")
            .into_iter()
            .filter(|label| self.is_named(*label, "heart_"))
            .collect();
        let mut drawn = 0;
        for chamber in chambers {
            if let Some(organ) = Organ::of(self.volume, |label| label == chamber) {
                drawn += self.relabel((&organ, chamber), LEAST_WALL, |depth, _| {
                    (depth <= CHAMBER_WALL_MM).then_some(heart)
                });
            }
        }
        if drawn > 0 {
            self.notes.push("walls between chambers of the heart".into());
        }
    }

    /// Draws the diaphragm into lungs, and into soft tissue filled by completion beside them, around the organs that lie
    /// under it.
    fn diaphragm(&mut self) {
        let lungs = self.of_tissue("lung");
        let below: Vec<u8> = ["liver", "spleen"]
            .iter()
            .flat_map(|organ| self.of_tissue(organ))
            .collect();
        if lungs.is_empty() || below.is_empty() || self.has_named(&["diaphragm"]) {
            return;
        }
        let around = |labels: &[u8]| Organ::around(self.volume, |label| labels.contains(&label), DIAPHRAGM_MM);
        let (Some(below), Some(lung)) = (around(&below), around(&lungs)) else {
            return;
        };
        let soft = self.appended("soft_tissue");
        let between = |(voxel, _): ([usize; 3], f64)| {
            let offset = self.volume.offset(voxel);
            let label = self.volume.voxels()[offset];
            let is_between = lungs.contains(&label) || (Some(label) == soft && lung.holds(voxel));
            is_between.then_some(offset)
        };
        let drawn: Vec<usize> = below.voxels().filter_map(between).collect();
        if drawn.is_empty() {
            return;
        }
        if let Some(diaphragm) = self.label("diaphragm") {
            drawn.into_iter().for_each(|offset| self.voxels[offset] = diaphragm);
            self.notes
                .push(format!("diaphragm ({})", self.labels[usize::from(diaphragm)].value));
        }
    }

    /// Label appended by completion, which has no voxels in the file: the file's own soft tissue is left alone.
    fn appended(&self, name: &str) -> Option<u8> {
        let is_appended = |label: &Label| label.name.as_deref() == Some(name) && label.voxels == 0;
        let labels = self.volume.labels();
        labels.iter().position(is_appended).map(|index| index as u8)
    }

    /// Draws fat around kidneys and patches of fat and muscle, in soft tissue filled by completion.
    fn filler(&mut self) {
        let (Some(soft), Some(muscle)) = (self.appended("soft_tissue"), self.appended("muscle")) else {
            return;
        };
        if !self.volume.holds(usize::from(soft)) || self.has_named(&["peritoneal_fat"]) {
            return;
        }
        let Some(fat) = self.label("peritoneal_fat") else {
            return;
        };
        let mut renal = self.of_tissue("kidney_cortex");
        renal.extend(self.of_tissue("adrenal"));
        let around = Organ::around(self.volume, |label| renal.contains(&label), RENAL_FAT_MM);
        let noise = Noise::new(0, 22, PATCH_MM);
        let [nx, ny, _] = self.volume.size();
        let to_world = self.volume.index_to_world();
        for_each((0.., chunks_mut(&mut self.voxels, nx)), &|(row, line)| {
            let [j, k] = [row % ny, row / ny];
            let mut noise = noise.nearby();
            for (i, voxel) in line.iter_mut().enumerate().filter(|(_, voxel)| **voxel == soft) {
                let near = around.as_ref().is_some_and(|around| around.holds([i, j, k]));
                let point = to_world.transform_point(&Point3::new(i as f64, j as f64, k as f64));
                let patch = noise.at(&point.coords);
                if near || patch > FAT_ABOVE {
                    *voxel = fat;
                } else if patch < MUSCLE_BELOW {
                    *voxel = muscle;
                }
            }
        });
        let value = self.labels[usize::from(fat)].value;
        self.notes.push(format!(
            "fat around kidneys and patches of fat ({value}) and muscle in soft tissue"
        ));
    }
}

#[cfg(test)]
mod tests;
