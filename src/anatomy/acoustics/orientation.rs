//! Orientation of textures: along the fibres of muscle, across the layers of the body's wall.
//!
//! The first axis of a texture lies along the direction of its tissue. In a scene two kinds follow the body instead of
//! the built-in directions: layers of skin, fat and fascia lie across the way from the skin inwards, and muscles and
//! nerves of a segmentation run along their label, its first principal axis, or if it is as broad as long, in its
//! built-in direction laid parallel to the skin. Fascicles of muscle meet that line at `PENNATION_DEG`.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Unit, UnitQuaternion, Vector3};

use super::TissueTable;
use super::presets::ACROSS_LAYERS;
use crate::volume::LabelVolume;

/// Angle between the fascicles of a muscle and its long axis, degrees: 10 to 28 in the buttock and the calf (S. R. Ward
/// et al., Clin. Orthop. Relat. Res. 467 (2009) 1074, table 2).
const PENNATION_DEG: f64 = 15.0;

/// Least ratio of the variances along the first two principal axes of a label that has a long axis.
const LONG: f64 = 2.0;

/// Roll about the first axis, radians; no small multiple of it is close to a quarter turn.
const ROLL: f64 = 0.27;

/// A direction no small multiple of which meets the lattice of a texture's periods.
const OBLIQUE: [f64; 3] = [0.730, 0.338, 0.594];

/// Cosine of the angle to the first axis from which on a direction does not tell the second.
const NEAR: f64 = 0.9;

impl TissueTable {
    /// Rows of the rotation from world directions to the axes of the texture of a label index: right-handed,
    /// determinant 1.
    ///
    /// The roll about the first axis is a fixed oblique angle, for the same reason as the orientation without a
    /// direction.
    pub fn texture_rotation(&self, label_index: u8) -> [[f64; 3]; 3] {
        let is_directed = self.along.contains_key(&label_index) || self.tissue(label_index).texture_direction.is_some();
        let inwards = self.inwards.filter(|_| is_directed).map(Vector3::from);
        let first = self.first_axis(label_index, inwards);
        let second = [inwards, Some(Vector3::y()), Some(Vector3::x())]
            .into_iter()
            .flatten()
            .find_map(|towards| across(&first, towards))
            .unwrap_or(Vector3::z_axis());
        let second = UnitQuaternion::from_axis_angle(&first, ROLL) * second;
        let third = first.cross(&second);
        [first.into_inner(), second.into_inner(), third].map(|axis| [axis.x, axis.y, axis.z])
    }

    fn first_axis(&self, label_index: u8, inwards: Option<Vector3<f64>>) -> Unit<Vector3<f64>> {
        let unit = |vector| Unit::try_new(vector, f64::MIN_POSITIVE).unwrap_or(Vector3::x_axis());
        if let Some(axis) = self.along.get(&label_index) {
            let axis = unit(Vector3::from(*axis));
            let (sin, cos) = PENNATION_DEG.to_radians().sin_cos();
            return match inwards.and_then(|inwards| across(&axis, inwards)) {
                Some(inwards) => unit(axis.into_inner() * cos + inwards.into_inner() * sin),
                None => axis,
            };
        }
        let direction = self.tissue(label_index).texture_direction;
        match inwards.filter(|_| direction == Some(ACROSS_LAYERS)) {
            Some(inwards) => unit(inwards),
            None => unit(Vector3::from(direction.unwrap_or(OBLIQUE))),
        }
    }

    /// Lets textures follow the body: layers lie across the way `inwards`, muscles and nerves run along their labels in
    /// a volume that is a segmentation. Tissues whose direction is `stated` keep it.
    pub fn follow(&mut self, volume: &LabelVolume, inwards: Option<[f64; 3]>, stated: impl Fn(&str) -> bool) {
        self.inwards = inwards;
        let has_fibres = |label: u8| {
            let tissue = self.tissue(label);
            let is_muscle = tissue.texture.as_deref() == Some("muscle") && tissue.texture_direction.is_some();
            is_muscle && !stated(&tissue.name)
        };
        let fibrous = std::array::from_fn(|label| has_fibres(label as u8));
        let mut along = long_axes(volume, &fibrous);
        if let Some(inwards) = inwards.and_then(|inwards| Unit::try_new(Vector3::from(inwards), f64::MIN_POSITIVE)) {
            for label in (0..=u8::MAX).filter(|label| fibrous[usize::from(*label)]) {
                let direction = self.tissue(label).texture_direction.map(Vector3::from);
                let parallel = [direction, Some(Vector3::z()), Some(Vector3::x())];
                let parallel = parallel
                    .into_iter()
                    .flatten()
                    .find_map(|towards| across(&inwards, towards));
                along
                    .entry(label)
                    .or_insert(parallel.map_or([0.0, 0.0, 1.0], |axis| [axis.x, axis.y, axis.z]));
            }
        }
        self.along = along;
    }
}

/// Direction at right angles to an axis that is nearest to another; `None` if they are nearly parallel.
fn across(axis: &Unit<Vector3<f64>>, towards: Vector3<f64>) -> Option<Unit<Vector3<f64>>> {
    let towards = towards.try_normalize(f64::MIN_POSITIVE)?;
    let along = axis.dot(&towards);
    (along.abs() < NEAR).then(|| Unit::new_normalize(towards - axis.into_inner() * along))
}

/// First principal axes in the world of the label indices `wanted` that have a long one.
fn long_axes(volume: &LabelVolume, wanted: &[bool; 256]) -> BTreeMap<u8, [f64; 3]> {
    let [columns, rows, _] = volume.size();
    let mut moments = BTreeMap::<u8, Moments>::new();
    for (number, row) in volume.voxels().chunks(columns).enumerate() {
        let mut column = 0;
        for run in row.chunk_by(|a, b| a == b) {
            let columns = column..column + run.len();
            column += run.len();
            if wanted[usize::from(run[0])] {
                let moments = moments.entry(run[0]).or_default();
                columns.for_each(|column| moments.add([column, number % rows, number / rows]));
            }
        }
    }
    let to_world = volume.index_to_world().fixed_view::<3, 3>(0, 0).into_owned();
    let axes = moments
        .into_iter()
        .filter_map(|(label, moments)| Some((label, moments.long_axis(&to_world)?)));
    axes.collect()
}

/// Sums of indices and of their products.
#[derive(Default)]
struct Moments {
    count: f64,
    first: Vector3<f64>,
    second: Matrix3<f64>,
}

impl Moments {
    fn add(&mut self, index: [usize; 3]) {
        let index = Vector3::from(index.map(|i| i as f64));
        self.count += 1.0;
        self.first += index;
        self.second += index * index.transpose();
    }

    fn long_axis(&self, to_world: &Matrix3<f64>) -> Option<[f64; 3]> {
        let mean = self.first / self.count;
        let covariance = to_world * (self.second / self.count - mean * mean.transpose()) * to_world.transpose();
        let principal = covariance.symmetric_eigen();
        let longest = principal.eigenvalues.imax();
        let others = (0..3)
            .filter(|axis| *axis != longest)
            .map(|axis| principal.eigenvalues[axis]);
        let is_long = principal.eigenvalues[longest] >= LONG * others.fold(0.0, f64::max).max(f64::MIN_POSITIVE);
        let axis = principal.eigenvectors.column(longest);
        // Of the two signs one, whatever the decomposition finds.
        let sign = axis[axis.iamax()].signum();
        is_long.then(|| [axis.x, axis.y, axis.z].map(|number| sign * number))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::acoustics::{Preset, Tissue, presets};
    use crate::volume::Label;
    use nalgebra::Matrix4;

    /// A table of one tissue at label index 1.
    fn table(tissue: Tissue) -> TissueTable {
        TissueTable {
            tissues: vec![presets::all()[0].clone(), tissue],
            of_label: vec![0, 1],
            ..TissueTable::default()
        }
    }

    fn angle_deg(a: [f64; 3], b: [f64; 3]) -> f64 {
        let cosine = Vector3::from(a).normalize().dot(&Vector3::from(b).normalize());
        cosine.abs().min(1.0).acos().to_degrees()
    }

    #[test]
    fn rotations_are_proper_and_put_the_first_axis_along_the_direction() {
        let muscle = presets::get("muscle").unwrap();
        for direction in [
            None,
            Some([1.0, 0.0, 0.0]),
            Some([0.0, -3.0, 0.1]),
            Some([0.95, 0.1, 0.0]),
        ] {
            for inwards in [None, Some([0.0, -1.0, 0.0]), Some([0.6, 0.0, 0.8])] {
                let mut table = table(Tissue {
                    texture_direction: direction,
                    ..muscle.clone()
                });
                table.inwards = inwards;
                let axes = table.texture_rotation(1).map(Vector3::from);
                let rotation = Matrix3::from_columns(&axes).transpose();
                assert!((rotation.determinant() - 1.0).abs() < 1e-12);
                assert!((rotation * rotation.transpose() - Matrix3::identity()).norm() < 1e-12);
                if let Some(direction) = direction {
                    assert!(angle_deg(direction, axes[0].into()) < 1e-5);
                }
            }
        }
    }

    #[test]
    fn layers_lie_across_the_way_inwards_and_lamellae_of_muscle_face_it() {
        let inwards = [0.6, -0.3, 0.2];
        for (name, axis) in [("fat", 0), ("skin", 0), ("fascia", 0), ("muscle_limb", 1)] {
            let mut table = table(presets::get(name).unwrap().clone());
            let before = table.texture_rotation(1)[axis];
            table.inwards = Some(inwards);
            let after = table.texture_rotation(1)[axis];
            // The fibres of muscle need not be at right angles to it.
            assert!(angle_deg(after, inwards) < 30.0, "{name}: {after:?}");
            assert!(angle_deg(before, inwards) > 40.0, "{name}: {before:?}");
        }
    }

    #[test]
    fn muscles_run_along_their_labels_and_meet_the_long_axis_at_their_pennation() {
        // Two oblique ellipsoids, one long and one nearly round, in anisotropic voxels turned in the world.
        let size = [60, 40, 30];
        let to_world = nalgebra::Rotation3::from_euler_angles(0.3, -0.5, 1.1).to_homogeneous()
            * Matrix4::new_nonuniform_scaling(&Vector3::new(1.0, 1.5, 2.0));
        let turned = |vector: [f64; 3]| to_world.transform_vector(&Vector3::from(vector));
        let axis = turned([0.8, 0.3, 0.2]).normalize();
        let within = |index: [usize; 3], middle: [f64; 3], half: [f64; 2]| {
            let away = turned([0, 1, 2].map(|i| index[i] as f64 - middle[i]));
            let along = away.dot(&axis);
            let aside = (away.norm_squared() - along * along).sqrt();
            (along / half[0]).hypot(aside / half[1]) < 1.0
        };
        let voxels: Vec<u8> = (0..size.iter().product())
            .map(|offset| {
                let index = [
                    offset % size[0],
                    offset / size[0] % size[1],
                    offset / (size[0] * size[1]),
                ];
                match () {
                    () if within(index, [18.0, 20.0, 15.0], [17.0, 7.0]) => 1,
                    () if within(index, [46.0, 20.0, 15.0], [11.0, 9.0]) => 2,
                    () => 0,
                }
            })
            .collect();
        let labels: Vec<Label> = ["background", "gluteus_maximus_left", "gluteus_medius_left"]
            .iter()
            .enumerate()
            .map(|(value, name)| Label {
                value: value as i64,
                name: Some((*name).to_owned()),
                voxels: voxels.iter().filter(|voxel| usize::from(**voxel) == value).count() as u64,
            })
            .collect();
        let (mut table, _) = TissueTable::resolve(&labels, &[], Preset::Auto).unwrap();
        let volume = LabelVolume::new(size, voxels, labels, to_world).unwrap();
        table.follow(&volume, None, |_| false);
        assert_eq!(table.along.keys().collect::<Vec<_>>(), [&1], "{:?}", table.along);
        let found = table.along[&1];
        assert!(angle_deg(found, axis.into()) < 2.0, "{found:?} for {axis:?}");
        // Without a way inwards along the muscle, with one at their pennation and towards it.
        assert!(angle_deg(table.texture_rotation(1)[0], found) < 1e-5);
        let inwards = Vector3::new(0.1, 0.2, -1.0);
        table.inwards = Some(inwards.into());
        let fibres = table.texture_rotation(1)[0];
        assert!((angle_deg(fibres, found) - PENNATION_DEG).abs() < 1e-6);
        assert!(Vector3::from(fibres).dot(&inwards) > Vector3::from(found).dot(&inwards));
        // Without a long axis parallel to the skin.
        table.follow(&volume, Some(inwards.into()), |_| false);
        assert!((angle_deg(table.along[&2], inwards.into()) - 90.0).abs() < 1e-6);
        assert_eq!(table.along[&1], found);
        // A stated direction stays.
        table.follow(&volume, None, |_| true);
        assert!(table.along.is_empty());
    }
}
