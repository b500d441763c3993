//! Anatomy along the needle: regions with their needle interactions, and the channels cut by the tip.

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::contact::SAMPLE_MM;
use crate::insertion::interaction::interaction;
use crate::insertion::{Anatomy, Interaction};

/// Bisections of [`SAMPLE_MM`] to locate the start of a region, to 1e-13 mm.
const HALVINGS: usize = 40;

/// Distance between points of a channel, mm.
const SPACING_MM: f64 = 1.0;
/// Length at the end of a channel that counts as uncut, mm: a tip at rest moves in the tissue by less.
const END_MM: f64 = 0.2;

/// Depths, in radii of a rigid punch, below which lie (k + 1/2)/12 of its dent in even, nearly incompressible tissue: the
/// weight I0 of Gao, Chiu and Lee (Int. J. Solids Struct. 29 (1992) 2471) of a layer, for Poisson's ratio 1/2.
const DENT_DEPTHS: [f64; 12] = [0.13, 0.38, 0.61, 0.85, 1.11, 1.42, 1.80, 2.32, 3.10, 4.46, 7.57, 22.89];

/// The body in the reference state.
pub(super) struct CutTissue {
    pub anatomy: Arc<dyn Anatomy>,
    pub channel: Channel,
    /// Radius of the patch that bears the force at the tip, mm.
    pub patch_mm: f64,
    /// Plane-strain moduli E/(1 - nu^2) of the regions of the mesh, N/mm^2.
    pub moduli: BTreeMap<i32, f64>,
}

impl CutTissue {
    /// Returns the interaction of a region with the needle.
    pub(super) fn interaction(&self, region: Option<i32>) -> Interaction {
        interaction(self.anatomy.as_ref(), region)
    }

    /// Returns the plane-strain modulus E/(1 - nu^2) at a point, N/mm^2; `None` outside, in bone and where none is known.
    fn modulus(&self, at_rest: &Point3<f64>) -> Option<f64> {
        let region = self.anatomy.region(at_rest)?;
        if self.interaction(Some(region)).bone.is_some() {
            return None;
        }
        let of_anatomy = self.anatomy.modulus_kpa(region).map(|modulus| modulus * 1e-3);
        // A region without elements is as any other.
        let of_mesh = || {
            self.moduli
                .get(&region)
                .or_else(|| self.moduli.values().next())
                .copied()
        };
        of_anatomy.or_else(of_mesh)
    }

    /// Returns the compliance of the patch of tissue that bears the force at the tip, at a point and along a direction,
    /// mm/N: that of a rigid punch, 1/(2 a E*), with E* the mean of the layers in front by their share in its dent.
    /// Behind it tissue holds it as much where it reaches as far; at the surface of the body there is none.
    pub(crate) fn patch_compliance(&self, at_rest: &Point3<f64>, direction: &Vector3<f64>) -> f64 {
        let at = |distance: f64| self.modulus(&(at_rest + direction * (distance * self.patch_mm)));
        let mut last = at(0.0).or_else(|| at(DENT_DEPTHS[0]));
        let mut sum = 0.0;
        for depth in DENT_DEPTHS {
            // Bone does not yield, and a needle does not press on what is beyond the body.
            last = at(depth).or(last);
            sum += last.unwrap_or_default() + at(-depth).unwrap_or_default();
        }
        let modulus = sum / DENT_DEPTHS.len() as f64;
        if modulus > 0.0 {
            0.5 / (self.patch_mm * modulus)
        } else {
            0.0
        }
    }

    /// Returns the distance from a point back along the needle to the boundary of the regions `within`, mm.
    pub(crate) fn border_behind(
        &self,
        from: &Point3<f64>,
        tangent: &Vector3<f64>,
        length_mm: f64,
        within: impl Fn(Option<i32>) -> bool,
    ) -> Option<f64> {
        let is_in = |behind: f64| within(self.anatomy.region(&(from - tangent * behind)));
        let samples = (length_mm / SAMPLE_MM).ceil() as usize;
        let beyond = (1..=samples).find(|sample| !is_in(*sample as f64 * SAMPLE_MM))?;
        let [mut inside, mut outside] = [beyond - 1, beyond].map(|sample| sample as f64 * SAMPLE_MM);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (inside + outside);
            *(if is_in(middle) { &mut inside } else { &mut outside }) = middle;
        }
        Some(inside)
    }
}

/// Channels in the tissue at rest: pushed along one again, a needle cuts nothing until its end (Dehghan et al. 2008,
/// Fig. 9: the second and third insertions along a path take less force).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Channel {
    paths: Vec<Vec<Point3<f64>>>,
}

impl Channel {
    /// Returns whether a point is within `radius_mm` of a channel, at more than [`END_MM`] before its end.
    pub(super) fn contains(&self, point: &Point3<f64>, radius_mm: f64) -> bool {
        self.paths.iter().any(|path| {
            let (mut length, mut nearest) = (0.0, [f64::INFINITY, 0.0]);
            for ends in path.windows(2) {
                let (along, offset) = (ends[1] - ends[0], point - ends[0]);
                let share = (offset.dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
                let distance = (offset - along * share).norm();
                // NaN for a segment without length.
                if distance < nearest[0] {
                    nearest = [distance, length + along.norm() * share];
                }
                length += along.norm();
            }
            nearest[0] <= radius_mm && length - nearest[1] > END_MM
        })
    }

    /// Records that the tip has cut from one point to another: the channel that ends there grows, or a new one begins.
    pub(super) fn cut(&mut self, from: &Point3<f64>, point: &Point3<f64>) {
        let near = |end: &Point3<f64>| (from - end).norm() <= END_MM || (point - end).norm() <= SPACING_MM;
        let ends_here = |path: &&mut Vec<Point3<f64>>| path.last().is_some_and(near);
        let Some(path) = self.paths.iter_mut().rev().find(ends_here) else {
            self.paths.push(vec![*from, *point]);
            return;
        };
        if let [.., before, end] = &mut path[..] {
            if (*end - *before).dot(&(point - *end)) < 0.0 {
                // Slightly withdrawn.
            } else if (point - *before).norm() < SPACING_MM {
                *end = *point;
            } else {
                path.push(*point);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn go(channel: &mut Channel, x: f64, from: f64, to: f64) {
        let point = |step: f64| Point3::new(x, 0.0, from + 0.05 * step);
        (1..=((to - from) / 0.05).round() as u32)
            .for_each(|step| channel.cut(&point(f64::from(step) - 1.0), &point(f64::from(step))));
    }

    #[test]
    fn a_path_is_cut_up_to_its_end_and_no_wider_than_the_needle() {
        let mut channel = Channel::default();
        assert!(!channel.contains(&Point3::origin(), 0.6));
        go(&mut channel, 0.0, 0.0, 20.0);
        go(&mut channel, 5.0, 0.0, 10.0);
        for (x, z, expected) in [
            (0.0, 0.0, true),
            (0.0, 19.7, true),
            (0.0, 19.9, false),
            (0.0, 20.5, false),
            (0.3, 20.3, false),
            (0.59, 12.3, true),
            (0.61, 12.3, false),
            (5.0, 9.7, true),
            (5.0, 15.0, false),
        ] {
            assert_eq!(channel.contains(&Point3::new(x, 0.0, z), 0.6), expected, "{x} {z}");
        }
        // Slightly withdrawn, on from the end, and through a surface behind which tissue springs back.
        channel.cut(&Point3::new(0.0, 0.0, 20.0), &Point3::new(0.0, 0.0, 19.9));
        assert!(channel.contains(&Point3::new(0.0, 0.0, 19.7), 0.6));
        go(&mut channel, 0.0, 19.9, 25.0);
        channel.cut(&Point3::new(0.0, 0.0, 25.0), &Point3::new(0.0, 0.0, 28.0));
        for (z, expected) in [(24.7, true), (25.1, true), (26.5, true), (28.5, false)] {
            assert_eq!(channel.contains(&Point3::new(0.0, 0.0, z), 0.6), expected, "{z}");
        }
    }
}
