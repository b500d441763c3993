//! The centre line of a needle: a polyline from base to tip, by arc length of the undeformed shaft.

use nalgebra::{Isometry3, Point3, Unit, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// Two directions across a unit vector and each other.
pub(in crate::mechanics) fn across(along: &Vector3<f64>) -> [Vector3<f64>; 2] {
    let mut aside = Vector3::zeros();
    aside[along.iamin()] = 1.0;
    let across = along.cross(&aside).normalize();
    [across, along.cross(&across)]
}

/// A point of the shaft.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShaftPoint {
    /// Where it is, mm.
    pub point_mm: Point3<f64>,
    /// The direction of the shaft there, towards the tip.
    pub tangent: Unit<Vector3<f64>>,
}

/// A polyline from base to tip; the link behind the last node goes on beyond the tip, the first one before the base.
#[derive(Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CentreLine {
    nodes: Vec<(f64, Point3<f64>)>,
    /// What the joints of the needle that laid it turn by (axis times angle, rad, world axes), base first.
    turns: Vec<Vector3<f64>>,
}

impl Clone for CentreLine {
    fn clone(&self) -> Self {
        CentreLine {
            nodes: self.nodes.clone(),
            turns: self.turns.clone(),
        }
    }

    /// Keeps its memory.
    fn clone_from(&mut self, other: &Self) {
        self.nodes.clone_from(&other.nodes);
        self.turns.clone_from(&other.turns);
    }
}

impl CentreLine {
    /// Takes other nodes: arcs (mm) rising from 0 at the base to the length at the tip, at least two, no two points in one place.
    pub fn set(&mut self, nodes: impl IntoIterator<Item = (f64, Point3<f64>)>) {
        self.set_turned(nodes, &[]);
    }

    /// The same, of a needle whose joints turn by `turns`.
    pub(in crate::mechanics) fn set_turned(
        &mut self,
        nodes: impl IntoIterator<Item = (f64, Point3<f64>)>,
        turns: &[Vector3<f64>],
    ) {
        self.nodes.clear();
        self.nodes.extend(nodes);
        self.turns.clear();
        self.turns.extend_from_slice(turns);
        debug_assert!(self.nodes.len() >= 2 && self.nodes.windows(2).all(|pair| pair[0].0 < pair[1].0));
    }

    /// The direction before a node (of unit length): of the link before it, or, at the base, where the first link pointed before the
    /// joint there turned.
    pub(super) fn before(&self, node: usize, turn: &Vector3<f64>) -> Vector3<f64> {
        if node > 0 {
            (self.nodes[node].1 - self.nodes[node - 1].1).normalize()
        } else {
            UnitQuaternion::from_scaled_axis(-*turn) * (self.nodes[1].1 - self.nodes[0].1).normalize()
        }
    }

    /// Moves all of it.
    pub(in crate::mechanics) fn transform(&mut self, motion: &Isometry3<f64>) {
        self.nodes.iter_mut().for_each(|node| node.1 = motion * node.1);
        self.turns.iter_mut().for_each(|turn| *turn = motion.rotation * *turn);
    }

    /// Arcs (mm) and points, base first. Empty before the needle is first placed.
    pub fn nodes(&self) -> &[(f64, Point3<f64>)] {
        &self.nodes
    }

    /// What its joints turn by, rad, world axes, base first. Empty if the needle that laid it has none.
    pub(in crate::mechanics) fn turns(&self) -> &[Vector3<f64>] {
        &self.turns
    }

    /// The arc of the tip, mm.
    pub fn length_mm(&self) -> f64 {
        self.nodes.last().map_or(0.0, |node| node.0)
    }

    /// The tip, mm.
    pub fn tip(&self) -> Point3<f64> {
        self.nodes.last().map_or_else(Point3::origin, |node| node.1)
    }

    /// The point at an arc (mm).
    pub fn at(&self, arc_mm: f64) -> ShaftPoint {
        let after = self.nodes.partition_point(|node| node.0 <= arc_mm);
        self.on_link(after.clamp(1, self.nodes.len() - 1), arc_mm)
    }

    /// The arc (mm) of the point nearest to `point`: below 0 before the base, above the length beyond the tip.
    pub fn nearest(&self, point: &Point3<f64>) -> f64 {
        let last = self.nodes.len() - 1;
        let candidates = (1..=last).map(|link| {
            let [(from, a), (to, b)] = [self.nodes[link - 1], self.nodes[link]];
            let along = b - a;
            let mut share = (point - a).dot(&along) / along.norm_squared();
            if link > 1 {
                share = share.max(0.0);
            }
            if link < last {
                share = share.min(1.0);
            }
            ((point - (a + along * share)).norm_squared(), from + share * (to - from))
        });
        candidates
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .map_or(0.0, |found| found.1)
    }

    /// Largest distance (mm) between the nodes of two lines of as many nodes; infinite if they have not.
    pub fn distance(&self, other: &CentreLine) -> f64 {
        if self.nodes.len() != other.nodes.len() {
            return f64::INFINITY;
        }
        let pairs = self.nodes.iter().zip(&other.nodes);
        pairs.map(|(a, b)| (a.1 - b.1).norm()).fold(0.0, f64::max)
    }

    fn on_link(&self, link: usize, arc_mm: f64) -> ShaftPoint {
        let [(from, a), (to, b)] = [self.nodes[link - 1], self.nodes[link]];
        let along = b - a;
        ShaftPoint {
            point_mm: a + along * ((arc_mm - from) / (to - from)),
            tangent: Unit::new_normalize(along),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arcs_points_and_back() {
        let mut line = CentreLine::default();
        let corner = Point3::new(0.0, 0.0, 10.0);
        line.set([
            (0.0, Point3::origin()),
            (10.0, corner),
            (14.0, Point3::new(4.0, 0.0, 10.0)),
        ]);
        assert_eq!((line.length_mm(), line.tip()), (14.0, Point3::new(4.0, 0.0, 10.0)));
        for (arc, point) in [
            (-2.0, [0.0, 0.0, -2.0]),
            (5.0, [0.0, 0.0, 5.0]),
            (12.0, [2.0, 0.0, 10.0]),
            (15.0, [5.0, 0.0, 10.0]),
        ] {
            assert_eq!(line.at(arc).point_mm, Point3::from(point));
            assert_eq!(line.nearest(&Point3::from(point)), arc);
        }
        assert_eq!(line.at(10.0).tangent, Unit::new_unchecked(Vector3::x()));
        // Off the line, outside the corner.
        assert_eq!(line.nearest(&Point3::new(-1.0, 3.0, 11.0)), 10.0);
        let mut other = line.clone();
        assert_eq!(line.distance(&other), 0.0);
        other.set([
            (0.0, Point3::origin()),
            (10.0, corner),
            (14.0, Point3::new(4.0, 0.5, 10.0)),
        ]);
        assert_eq!(line.distance(&other), 0.5);
        other.set([(0.0, Point3::origin()), (10.0, corner)]);
        assert_eq!(line.distance(&other), f64::INFINITY);
    }
}
