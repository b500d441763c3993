//! Labels of the scene's volume as regions along the needle, with smoothed boundaries.

use std::collections::BTreeMap;

use nalgebra::Point3;

use insonify_anatomy::volume::LabelVolume;
use insonify_imaging::scene::Scene;
use insonify_mechanics::insertion::{Anatomy, Interaction};
use insonify_mechanics::tissue::material::Material;
use insonify_tracking::trajectory::Trajectory;

/// Distance between samples of a path, mm.
const STEP_MM: f64 = 0.5;

/// Labels of a volume with their interactions.
#[derive(Clone, Debug)]
pub(crate) struct Labels {
    volume: LabelVolume,
    /// Region of each label; `None` for excluded labels.
    regions: Vec<Option<i32>>,
    interactions: BTreeMap<i32, Interaction>,
    /// Plane-strain moduli of the regions, kPa.
    moduli: BTreeMap<i32, f64>,
    /// Part of the volume that is meshed, mm.
    within: Option<[[f64; 3]; 2]>,
}

impl Labels {
    /// Labels whose values are regions of `interactions`, restricted to a box (mm) if given.
    pub(crate) fn new(
        volume: &LabelVolume,
        interactions: &[(i32, Interaction)],
        within: Option<[[f64; 3]; 2]>,
    ) -> Labels {
        let interactions: BTreeMap<_, _> = interactions.iter().copied().collect();
        let region = |value: i64| {
            i32::try_from(value)
                .ok()
                .filter(|region| interactions.contains_key(region))
        };
        let regions = volume.labels().iter().enumerate();
        let regions = regions.map(|(index, label)| region(label.value).filter(|_| index > 0));
        Labels {
            regions: regions.collect(),
            volume: volume.clone(),
            interactions,
            moduli: BTreeMap::new(),
            within,
        }
    }

    /// States the materials of the regions.
    pub(crate) fn with_materials(mut self, materials: impl Iterator<Item = (i32, Material)>) -> Labels {
        let modulus = |material: Material| material.young_kpa() / (1.0 - material.poisson().powi(2));
        self.moduli = materials
            .map(|(region, material)| (region, modulus(material)))
            .collect();
        self
    }
}

impl Anatomy for Labels {
    fn region(&self, at_rest_mm: &Point3<f64>) -> Option<i32> {
        let outside =
            |[low, high]: [[f64; 3]; 2]| (0..3).any(|axis| !(low[axis]..=high[axis]).contains(&at_rest_mm[axis]));
        if self.within.is_some_and(outside) {
            return None;
        }
        let region = |label: u8| self.regions.get(usize::from(label)).copied().flatten();
        let label = self
            .volume
            .smoothed_label_at(at_rest_mm, |label| region(label).is_some())?;
        region(label)
    }

    fn interaction(&self, region: i32) -> Interaction {
        self.interactions.get(&region).copied().unwrap_or_default()
    }

    fn modulus_kpa(&self, region: i32) -> Option<f64> {
        self.moduli.get(&region).copied()
    }
}

/// Warning about tissue on a needle's path that is not meshed. `read`: the mesh is from a file, around which the tissue
/// may be unknown.
pub(super) fn unmeshed(scene: &Scene, path: &Trajectory, meshed: &dyn Anatomy, read: bool) -> Option<String> {
    let body = scene.body();
    let mut passed: BTreeMap<u8, f64> = BTreeMap::new();
    let mut begins_outside = false;
    for pair in path.keys().windows(2) {
        let [start, end] = [&pair[0], &pair[1]].map(|key| key.pose.position_mm());
        let steps = ((end - start).norm() / STEP_MM).ceil();
        for step in 0..steps as usize {
            let point = start + (end - start) * ((step as f64 + 0.5) / steps);
            if meshed.region(&point).is_some() {
                continue;
            }
            begins_outside |= passed.is_empty();
            if let Some(label) = body.label_at(&point) {
                *passed.entry(label).or_default() += (end - start).norm() / steps;
            }
        }
    }
    // A mismatch between voxels and elements is not a layer.
    passed.retain(|_, length| *length > 2.0 * STEP_MM);
    let names: Vec<String> = passed.keys().map(|label| body.name(*label)).collect();
    match (names.is_empty(), read && begins_outside) {
        (false, _) => Some(format!(
            "the needle's path leads through tissue that is not meshed and offers no resistance: {}",
            names.join(", ")
        )),
        (true, true) => {
            Some("no tissue is known around the mesh: what lies outside it offers no resistance".to_owned())
        }
        (true, false) => None,
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix4;

    use super::*;
    use insonify_anatomy::volume::Label;

    /// Body (1) below an oblique surface of 2 mm voxels, a skin (2) of one voxel on it, gel (3) above.
    fn labels(within: Option<[[f64; 3]; 2]>) -> Labels {
        let size = [20, 20, 20];
        let voxels = (0..8000).map(|voxel| match (voxel / 400) as f64 - 0.5 * (voxel % 20) as f64 {
            ..4.0 => 3,
            ..5.0 => 2,
            _ => 1,
        });
        let named = |value: i64| Label {
            value,
            name: None,
            voxels: 1,
        };
        let voxels: Vec<u8> = voxels.collect();
        let table = [0, 11, 12, 13].map(named).to_vec();
        let volume = LabelVolume::new(size, voxels, table, Matrix4::new_scaling(2.0)).unwrap();
        let known = [11, 12].map(|region| (region, Interaction::default()));
        Labels::new(&volume, &known, within)
    }

    /// The depth of the skin varies continuously along the surface, not in steps of a voxel.
    #[test]
    fn boundaries_are_smooth() {
        let labels = labels(None);
        let begins = |x: f64| {
            (0..400)
                .map(|step| 0.1 * f64::from(step))
                .find(|z| labels.region(&Point3::new(x, 20.0, *z)).is_some())
        };
        for step in 20..80 {
            let x = 0.25 * f64::from(step);
            let [begin, next] = [begins(x), begins(x + 0.25)].map(Option::unwrap);
            assert!((next - begin).abs() < 0.45, "{x}: {begin} {next}");
            // Voxels of skin have their centres where z is from 8 + x / 2 to 10 + x / 2 mm.
            assert!((begin - 8.0 - 0.5 * x).abs() < 1.1, "{x}: {begin}");
            let skin = (0..400)
                .map(|step| 0.1 * f64::from(step))
                .filter(|z| labels.region(&Point3::new(x, 20.0, *z)) == Some(12));
            assert!(
                (0.8..3.2).contains(&(0.1 * skin.count() as f64)),
                "a skin of one voxel has no hole at {x}"
            );
        }
    }

    #[test]
    fn what_is_left_out_is_outside() {
        let inside = Point3::new(20.0, 20.0, 30.0);
        assert_eq!(labels(None).region(&inside), Some(11));
        assert_eq!(labels(None).region(&Point3::new(20.0, 20.0, 2.0)), None, "gel");
        assert_eq!(
            labels(None).region(&Point3::new(20.0, 20.0, 39.1)),
            None,
            "beyond the volume"
        );
        let [low, high] = [[f64::NEG_INFINITY; 3], [f64::INFINITY, f64::INFINITY, 29.9]];
        assert_eq!(labels(Some([low, high])).region(&inside), None, "beyond the box");
    }
}
