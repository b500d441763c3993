//! Probe contact: a rigid cylinder along which tissue slides (Goksel et al. 2011, section IV).

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};

use super::Wrench;

/// Thickness of a ring of candidates as a share of their spacing: rings of a lattice are a full spacing apart.
const RING: f64 = 0.9;

/// A probe in contact. Its frame: origin at the leading end of the cylinder, z along the axis into the body.
#[derive(Clone, Debug, PartialEq)]
pub struct ProbeContact {
    /// Probe frame to world when the tissue is at rest.
    pub nominal: Isometry3<f64>,
    /// Length of the cylinder behind its end, mm: nodes along it are in contact.
    pub length_mm: f64,
    /// Nodes that the probe may touch, known beforehand.
    pub candidates: Vec<u32>,
    /// Two points on the axis at which the probe is driven, mm behind the end: the force is split between them. `None`:
    /// the entire force acts at the origin.
    pub driven_at_mm: Option<[f64; 2]>,
}

impl ProbeContact {
    /// Splits the force of the tissue on the probe between its two driving points: linearly along the axis, by the law
    /// of the lever, so that their sum and their torque across the axis are those of `wrench` (about the origin of the
    /// probe at `pose`). Returns `None` without driving points.
    pub fn split(&self, wrench: &Wrench, pose: &Isometry3<f64>) -> Option<[Vector3<f64>; 2]> {
        Some(lever(self.driven_at_mm?, wrench, pose))
    }

    /// Keeps every n-th ring of candidates along the axis, from the back to the leading end; with 1, all. A ring is
    /// what lies within 0.9 of the median distance from a candidate to its nearest neighbour: the planes of a lattice,
    /// in other meshes slices one node thick. `nodes` are those of the mesh at rest, mm.
    pub fn thin(&mut self, nodes: &[[f64; 3]], every: usize) {
        if every <= 1 {
            return;
        }
        let in_probe = |&node: &u32| (self.nominal.inverse_transform_point(&nodes[node as usize].into()), node);
        let mut places: Vec<(Point3<f64>, u32)> = self.candidates.iter().map(in_probe).collect();
        places.sort_by(|(a, m), (b, n)| a.z.total_cmp(&b.z).then(m.cmp(n)));
        let thickness = RING * spacing(&places);
        let (mut ring, mut start) = (0, places.first().map_or(0.0, |(position, _)| position.z));
        places.retain(|(position, _)| {
            if position.z - start > thickness {
                (ring, start) = (ring + 1, position.z);
            }
            ring % every == 0
        });
        self.candidates = places.into_iter().map(|(_, node)| node).collect();
        self.candidates.sort_unstable();
    }
}

/// Returns a rotation turned by the shortest rotation that brings its z axis to the unit vector `direction`, without
/// roll.
pub fn pointed(rotation: &UnitQuaternion<f64>, direction: &Vector3<f64>) -> UnitQuaternion<f64> {
    let turn = UnitQuaternion::rotation_between(&(rotation * Vector3::z()), direction)
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&(rotation * Vector3::x_axis()), std::f64::consts::PI));
    turn * rotation
}

/// Splits a wrench as [`ProbeContact::split`] does; `at_mm` are two different positions behind the probe's origin.
pub fn lever([first, second]: [f64; 2], wrench: &Wrench, pose: &Isometry3<f64>) -> [Vector3<f64>; 2] {
    let axis = pose.rotation * Vector3::z();
    // The torque of forces f at -b along the axis is -b axis x f: (axis x torque) gives back the sum of b f across.
    let moment = axis.cross(&wrench.torque_nmm);
    let across = wrench.force_n - axis * axis.dot(&wrench.force_n);
    let axial = wrench.force_n - across;
    let share = (moment - across * first) / (second - first);
    [across - share + axial * 0.5, share + axial * 0.5]
}

/// Returns the median distance from a point to its nearest neighbour, mm; infinite for a single point. Points ascend
/// along z.
fn spacing(places: &[(Point3<f64>, u32)]) -> f64 {
    let nearest = |index: usize| {
        let position = places[index].0;
        let (mut before, mut after) = (places[..index].iter().rev(), places[index + 1..].iter());
        let sides: [&mut dyn Iterator<Item = &(Point3<f64>, u32)>; 2] = [&mut before, &mut after];
        let mut least = f64::INFINITY;
        for others in sides {
            for (neighbour, _) in others {
                if (neighbour.z - position.z).abs() >= least {
                    break;
                }
                least = least.min((neighbour - position).norm());
            }
        }
        least
    };
    let mut distances: Vec<f64> = (0..places.len()).map(nearest).collect();
    distances.sort_by(f64::total_cmp);
    distances.get(distances.len() / 2).copied().unwrap_or(f64::INFINITY)
}

#[cfg(test)]
mod tests {
    use super::*;
    use insonify_base::random::{hash3, seed_words, unit};
    use nalgebra::Translation3;

    /// 20 rings of 16 points, 4 mm apart along a slanted axis, perturbed by a share of that.
    fn cylinder(shaken: f64) -> (ProbeContact, Vec<[f64; 3]>) {
        let nominal = Isometry3::from_parts(
            Translation3::new(5.0, -70.0, 31.0),
            UnitQuaternion::from_euler_angles(0.4, -0.7, 1.1),
        );
        // Numbered neither along the axis nor around it: 7 and 320 have no common divisor.
        let places = (0..320i32).map(|number| {
            let index = number * 7 % 320;
            let shift = hash3([index, 0, 0], seed_words(3)).map(|word| shaken * 4.0 * (f64::from(unit(word)) - 0.5));
            let (turn, ring) = (f64::from(index % 16), f64::from(index / 16));
            let (sine, cosine) = (turn * std::f64::consts::TAU / 16.0).sin_cos();
            let position = Point3::new(
                10.2 * cosine + shift[0],
                10.2 * sine + shift[1],
                4.0 * ring - 80.0 + shift[2],
            );
            (nominal * position).into()
        });
        let contact = ProbeContact {
            nominal,
            length_mm: 100.0,
            candidates: (0..320).collect(),
            driven_at_mm: None,
        };
        (contact, places.collect())
    }

    fn thinned(shaken: f64, every: usize) -> Vec<Point3<f64>> {
        let (mut contact, nodes) = cylinder(shaken);
        contact.thin(&nodes, every);
        assert!(contact.candidates.is_sorted());
        let in_probe = |node: &u32| contact.nominal.inverse_transform_point(&nodes[*node as usize].into());
        contact.candidates.iter().map(in_probe).collect()
    }

    #[test]
    fn every_nth_ring_of_a_lattice_is_kept_whole() {
        assert_eq!(thinned(0.0, 1).len(), 320);
        for every in [2, 3, 7, 40] {
            let mut depths_mm: Vec<i64> = thinned(0.0, every)
                .iter()
                .map(|position| position.z.round() as i64)
                .collect();
            depths_mm.sort_unstable();
            let rings = (0..20).step_by(every).flat_map(|ring| [4 * ring - 80; 16]);
            assert_eq!(depths_mm, rings.collect::<Vec<i64>>(), "every {every}");
        }
    }

    /// About a third remains, along the entire axis and all around it.
    #[test]
    fn an_irregular_surface_is_thinned_evenly() {
        let kept = thinned(0.6, 3);
        assert!((80..=140).contains(&kept.len()), "{}", kept.len());
        let mut depths_mm: Vec<f64> = kept.iter().map(|position| position.z).collect();
        depths_mm.sort_by(f64::total_cmp);
        let gap = depths_mm.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max);
        assert!(gap < 3.0 * 4.0, "{gap} mm");
        assert!(
            depths_mm[0] < -79.0 && depths_mm[depths_mm.len() - 1] > -16.0,
            "{depths_mm:?}"
        );
        let middle = kept
            .iter()
            .fold(Vector3::zeros(), |sum, position| sum + position.coords)
            / kept.len() as f64;
        assert!(middle.xy().norm() < 1.5, "{middle}");
    }

    #[test]
    fn one_candidate_or_none_is_kept() {
        for count in [0, 1] {
            let (mut contact, nodes) = cylinder(0.0);
            contact.candidates.truncate(count);
            contact.thin(&nodes, 5);
            assert_eq!(contact.candidates.len(), count);
        }
    }
}
