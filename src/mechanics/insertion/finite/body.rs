//! Anatomy along the needle: regions with their needle interactions, and the channels cut by the tip.

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

/// The body in the reference state.
pub(super) struct CutTissue {
    pub anatomy: Arc<dyn Anatomy>,
    pub channel: Channel,
}

impl CutTissue {
    /// Returns the interaction of a region with the needle.
    pub(super) fn interaction(&self, region: Option<i32>) -> Interaction {
        interaction(self.anatomy.as_ref(), region)
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
