//! Centre line of a needle: a polyline from base to tip, by arc length of the undeformed shaft.

use nalgebra::{Isometry3, Point3, Unit, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// Returns two unit vectors perpendicular to a unit vector and to each other.
pub fn across(direction: &Vector3<f64>) -> [Vector3<f64>; 2] {
    let mut aside = Vector3::zeros();
    aside[direction.iamin()] = 1.0;
    let across = direction.cross(&aside).normalize();
    [across, direction.cross(&across)]
}

/// A point of the shaft.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShaftPoint {
    /// Position, mm.
    pub point_mm: Point3<f64>,
    /// Unit tangent of the shaft, towards the tip.
    pub tangent: Unit<Vector3<f64>>,
}

/// A polyline from base to tip; its last link extends beyond the tip, the first one before the base.
#[derive(Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CentreLine {
    nodes: Vec<(f64, Point3<f64>)>,
    /// Rotations of the joints of the needle that placed it (axis times angle, rad, world axes), base first.
    turns: Vec<Vector3<f64>>,
}

impl Clone for CentreLine {
    fn clone(&self) -> Self {
        CentreLine {
            nodes: self.nodes.clone(),
            turns: self.turns.clone(),
        }
    }

    /// Reuses the memory.
    fn clone_from(&mut self, other: &Self) {
        self.nodes.clone_from(&other.nodes);
        self.turns.clone_from(&other.turns);
    }
}

impl CentreLine {
    /// Replaces the nodes: arcs (mm) rising from 0 at the base to the length at the tip, no two points coinciding.
    ///
    /// # Panics
    /// With fewer than two nodes, or arcs that do not rise.
    pub fn set(&mut self, nodes: impl IntoIterator<Item = (f64, Point3<f64>)>) {
        self.set_turned(nodes, &[]);
    }

    /// Replaces the nodes, for a needle whose joints turn by `turns`.
    pub(crate) fn set_turned(&mut self, nodes: impl IntoIterator<Item = (f64, Point3<f64>)>, turns: &[Vector3<f64>]) {
        self.nodes.clear();
        self.nodes.extend(nodes);
        self.turns.clear();
        self.turns.extend_from_slice(turns);
        let rises = self.nodes.windows(2).all(|pair| pair[0].0 < pair[1].0);
        assert!(
            self.nodes.len() >= 2 && rises,
            "a centre line needs two nodes or more with rising arcs; found {:?}",
            self.nodes
        );
    }

    /// Returns the unit direction before a node: of the link before it, or, at the base, that of the first link before
    /// the rotation of the joint there.
    pub(super) fn before(&self, node: usize, turn: &Vector3<f64>) -> Vector3<f64> {
        if node > 0 {
            (self.nodes[node].1 - self.nodes[node - 1].1).normalize()
        } else {
            UnitQuaternion::from_scaled_axis(-*turn) * (self.nodes[1].1 - self.nodes[0].1).normalize()
        }
    }

    /// Moves the line rigidly.
    pub(crate) fn transform(&mut self, motion: &Isometry3<f64>) {
        self.nodes.iter_mut().for_each(|node| node.1 = motion * node.1);
        self.turns.iter_mut().for_each(|turn| *turn = motion.rotation * *turn);
    }

    /// Returns arcs (mm) and points, base first; empty before the needle is first placed.
    pub fn nodes(&self) -> &[(f64, Point3<f64>)] {
        &self.nodes
    }

    /// Returns the rotations of the joints, rad, world axes, base first; empty if the needle that placed the line has
    /// none.
    pub(crate) fn turns(&self) -> &[Vector3<f64>] {
        &self.turns
    }

    /// Returns the arc of the tip, mm.
    pub fn length_mm(&self) -> f64 {
        self.nodes.last().map_or(0.0, |node| node.0)
    }

    /// Returns the position of the tip, mm.
    pub fn tip(&self) -> Point3<f64> {
        self.nodes.last().map_or_else(Point3::origin, |node| node.1)
    }

    /// Returns the direction of the last link; `None` before the needle is first placed.
    pub fn direction(&self) -> Option<Unit<Vector3<f64>>> {
        let [.., (_, before), (_, tip)] = self.nodes[..] else {
            return None;
        };
        Unit::try_new(tip - before, 0.0)
    }

    /// Returns the point at an arc (mm).
    pub fn point_at_arc(&self, arc_mm: f64) -> ShaftPoint {
        let after = self.nodes.partition_point(|node| node.0 <= arc_mm);
        self.on_link(after.clamp(1, self.nodes.len() - 1), arc_mm)
    }

    /// Returns the arc (mm) of the point nearest to `point`: below 0 before the base, above the length beyond the tip.
    pub fn nearest(&self, point: &Point3<f64>) -> f64 {
        let last_link = self.nodes.len() - 1;
        let candidates = (1..=last_link).map(|link| {
            let [(from, a), (to, b)] = [self.nodes[link - 1], self.nodes[link]];
            let segment = b - a;
            let mut share = (point - a).dot(&segment) / segment.norm_squared();
            if link > 1 {
                share = share.max(0.0);
            }
            if link < last_link {
                share = share.min(1.0);
            }
            (
                (point - (a + segment * share)).norm_squared(),
                from + share * (to - from),
            )
        });
        candidates
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .map_or(0.0, |(_, arc)| arc)
    }

    /// Returns the largest distance (mm) between corresponding nodes of two lines; infinite if their node counts
    /// differ.
    pub fn distance(&self, other: &CentreLine) -> f64 {
        if self.nodes.len() != other.nodes.len() {
            return f64::INFINITY;
        }
        let pairs = self.nodes.iter().zip(&other.nodes);
        pairs.map(|(a, b)| (a.1 - b.1).norm()).fold(0.0, f64::max)
    }

    fn on_link(&self, link: usize, arc_mm: f64) -> ShaftPoint {
        let [(from, a), (to, b)] = [self.nodes[link - 1], self.nodes[link]];
        let segment = b - a;
        ShaftPoint {
            point_mm: a + segment * ((arc_mm - from) / (to - from)),
            tangent: Unit::new_normalize(segment),
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
            assert_eq!(line.point_at_arc(arc).point_mm, Point3::from(point));
            assert_eq!(line.nearest(&Point3::from(point)), arc);
        }
        assert_eq!(line.point_at_arc(10.0).tangent, Unit::new_unchecked(Vector3::x()));
        // Off the line, outside the corner.
        assert_eq!(line.nearest(&Point3::new(-1.0, 3.0, 11.0)), 10.0);
        let mut moved = line.clone();
        assert_eq!(line.distance(&moved), 0.0);
        moved.set([
            (0.0, Point3::origin()),
            (10.0, corner),
            (14.0, Point3::new(4.0, 0.5, 10.0)),
        ]);
        assert_eq!(line.distance(&moved), 0.5);
        moved.set([(0.0, Point3::origin()), (10.0, corner)]);
        assert_eq!(line.distance(&moved), f64::INFINITY);
    }
}
