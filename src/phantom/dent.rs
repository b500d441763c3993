//! Indentation of the skin by a convex probe: the body is painted as deformed by the probe of the default pose.

use nalgebra::{Matrix4, Vector3};

use super::geometry::{Bounds, Point, step};

/// Depth below the probe's face at which the displacement vanishes, mm.
const REACH_MM: f64 = 70.0;
/// Half thickness of the probe's face in the elevational direction, mm.
const FACE_HALF_MM: f64 = 9.0;
/// Elevational distance at which the skin is undeformed, mm.
const FADE_MM: f64 = 34.0;

/// Tissue indented by a convex array so that the skin is in contact with its complete face.
pub(super) struct Dent {
    origin: Point,
    lateral: Point,
    axial: Point,
    across: Point,
    radius_mm: f64,
    depth_mm: f64,
    bounds: Bounds,
    skin_depth: fn(&Point) -> f64,
}

impl Dent {
    /// Creates an indentation of at most `depth_mm` by an array of radius `radius_mm` at a pose (probe to world), in
    /// a body whose undeformed depth below the skin (positive inside) is `skin_depth`.
    pub(super) fn new(pose: &Matrix4<f64>, radius_mm: f64, depth_mm: f64, skin_depth: fn(&Point) -> f64) -> Self {
        let column = |i: usize| -> Vector3<f64> { pose.fixed_view::<3, 1>(0, i).into_owned() };
        let origin = column(3);
        Self {
            origin,
            lateral: column(0),
            axial: column(1),
            across: column(2),
            radius_mm,
            depth_mm,
            bounds: Bounds {
                min: origin,
                max: origin,
            }
            .grown(REACH_MM + radius_mm),
            skin_depth,
        }
    }

    /// Box that holds the deformed positions of every point of a box: displacements are along the axis of the probe, by at most the depth.
    pub(super) fn displaced(&self, bounds: &Bounds) -> Bounds {
        let most = self.axial * self.depth_mm;
        let swept = Bounds {
            min: bounds.min.inf(&(bounds.min + most)),
            max: bounds.max.sup(&(bounds.max + most)),
        };
        if swept.meets(&self.bounds) { swept } else { *bounds }
    }

    /// Maps a point of the deformed body to its undeformed position.
    pub(super) fn undo(&self, p: &Point) -> Point {
        let offset = p - self.origin;
        let (l, a, e) = (
            offset.dot(&self.lateral),
            offset.dot(&self.axial),
            offset.dot(&self.across),
        );
        if l.abs() >= 0.95 * self.radius_mm || e.abs() >= FADE_MM || a.abs() >= REACH_MM {
            return *p;
        }
        let face = (self.radius_mm.powi(2) - l * l).sqrt() - self.radius_mm;
        let below = a - face;
        if below >= REACH_MM {
            return *p;
        }
        let on_face = self.origin + self.lateral * l + self.axial * face + self.across * e;
        let pressed = (self.skin_depth)(&on_face).clamp(0.0, self.depth_mm);
        let fade = (1.0 - below.max(0.0) / REACH_MM).powi(2) * (1.0 - step(FACE_HALF_MM, FADE_MM, e.abs()));
        p - self.axial * (pressed * fade)
    }
}
