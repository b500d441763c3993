//! Beam space, scanlines by samples, and its mapping to and from the probe's plane.

use std::f64::consts::PI;

use super::Probe;
use super::kind::Layout;
use crate::TrackingError;

/// A scanline in the probe's x,y plane, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Starting point on the array.
    pub origin: [f64; 2],
    /// Direction, unit length.
    pub direction: [f64; 2],
}

/// An axis-aligned rectangle in the probe's plane, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Smallest x and y.
    pub min: [f64; 2],
    /// Largest x and y.
    pub max: [f64; 2],
}

/// Tolerance at the edges of the sector, as a fraction of its extent, for points displaced by rounding.
const EDGE: f64 = 1e-12;

/// Scanlines of a probe and the samples along them.
///
/// Coordinates in beam space are continuous: line `i` and sample `j` have integer coordinates, so line coordinates run
/// over `0..=lines - 1` and sample coordinates over `-0.5..=samples - 0.5`. A probe of one scanline has line coordinate
/// 0 throughout its sector.
#[derive(Clone, Debug, PartialEq)]
pub struct BeamGrid {
    layout: Layout,
    depth: f64,
    samples: usize,
    rays: Vec<Ray>,
}

impl BeamGrid {
    /// Lays out the scanlines of a valid probe: edge to edge inclusive, unmarked side first.
    pub fn new(probe: &Probe) -> Result<Self, TrackingError> {
        probe.validate()?;
        let lines = probe.lines as usize;
        let mut grid = Self {
            layout: probe.shape.layout(),
            depth: probe.depth_mm,
            samples: probe.samples as usize,
            rays: Vec::with_capacity(lines),
        };
        for line in 0..lines {
            let across = if lines > 1 {
                2.0 * line as f64 / (lines - 1) as f64 - 1.0
            } else {
                0.0
            };
            grid.rays.push(grid.ray_across(across));
        }
        Ok(grid)
    }

    /// Scanline at a fraction of the field of view: -1 is the unmarked edge, 0 the middle, 1 the marked edge.
    fn ray_across(&self, across: f64) -> Ray {
        match self.layout {
            Layout::Parallel { width } => Ray {
                origin: [across * width / 2.0, 0.0],
                direction: [0.0, 1.0],
            },
            Layout::Fan { radius, half } => {
                let (sin, cos) = (across * half).sin_cos();
                Ray {
                    origin: [radius * sin, radius * (cos - 1.0)],
                    direction: [sin, cos],
                }
            }
        }
    }

    /// Scanlines, unmarked side first.
    pub fn rays(&self) -> &[Ray] {
        &self.rays
    }

    /// Number of scanlines.
    pub fn lines(&self) -> usize {
        self.rays.len()
    }

    /// Number of samples along each scanline.
    pub fn samples(&self) -> usize {
        self.samples
    }

    /// Length of a scanline, mm.
    pub fn depth_mm(&self) -> f64 {
        self.depth
    }

    /// Whether the first and last scanlines overlap, as those of a full circle do.
    pub fn has_overlap(&self) -> bool {
        matches!(self.layout, Layout::Fan { half, .. } if half > PI)
    }

    /// Distance between neighbouring samples, mm.
    pub fn sample_spacing_mm(&self) -> f64 {
        self.depth / self.samples as f64
    }

    /// Depth of a sample along its scanline, mm.
    pub fn sample_depth_mm(&self, sample: usize) -> f64 {
        (sample as f64 + 0.5) * self.sample_spacing_mm()
    }

    /// Distance from the array back to the point where the scanlines meet, mm: the radius of curvature, 0 for a phased
    /// array, `None` for parallel scanlines.
    pub fn virtual_apex_mm(&self) -> Option<f64> {
        match self.layout {
            Layout::Parallel { .. } => None,
            Layout::Fan { radius, .. } => Some(radius),
        }
    }

    /// Angle between neighbouring scanlines, radians (the complete field of view for a single one); 0 for parallel
    /// scanlines.
    pub fn angular_spacing(&self) -> f64 {
        match self.layout {
            Layout::Parallel { .. } => 0.0,
            Layout::Fan { half, .. } => 2.0 * half / self.gaps(),
        }
    }

    /// Distance between neighbouring scanlines at a depth, mm, along the arc for a fan; the full width for a single
    /// one.
    pub fn lateral_spacing_mm(&self, depth_mm: f64) -> f64 {
        match self.layout {
            Layout::Parallel { width } => width / self.gaps(),
            Layout::Fan { radius, half } => (radius + depth_mm) * 2.0 * half / self.gaps(),
        }
    }

    fn gaps(&self) -> f64 {
        self.rays.len().saturating_sub(1).max(1) as f64
    }

    /// Point of the probe's plane at a line and sample coordinate, mm. Also defined outside the sector.
    pub fn to_plane(&self, line: f64, sample: f64) -> [f64; 2] {
        let across = if self.rays.len() > 1 {
            2.0 * line / self.gaps() - 1.0
        } else {
            0.0
        };
        let ray = self.ray_across(across);
        let along = (sample + 0.5) * self.sample_spacing_mm();
        [0, 1].map(|axis| ray.origin[axis] + along * ray.direction[axis])
    }

    /// Line and sample coordinate of a point of the probe's plane (mm); `None` outside the sector or beyond its depth.
    pub fn to_beam(&self, x: f64, y: f64) -> Option<(f64, f64)> {
        let (across, along) = self.across_and_along(x, y);
        let share = along / self.depth;
        if !(across.abs() <= 1.0 + EDGE && (-EDGE..=1.0 + EDGE).contains(&share)) {
            return None;
        }
        let line = if self.rays.len() > 1 {
            (across.clamp(-1.0, 1.0) + 1.0) / 2.0 * self.gaps()
        } else {
            0.0
        };
        Some((line, share.clamp(0.0, 1.0) * self.samples as f64 - 0.5))
    }

    /// Line coordinate and depth (mm) of a point of the probe's plane (mm). Also defined outside the sector.
    pub fn to_line_and_depth(&self, x: f64, y: f64) -> (f64, f64) {
        let (across, along) = self.across_and_along(x, y);
        ((across + 1.0) / 2.0 * self.gaps(), along)
    }

    /// Distance of a point of the probe's plane from the sector, mm; 0 within it.
    pub fn distance_mm(&self, x: f64, y: f64) -> f64 {
        if self.to_beam(x, y).is_some() {
            return 0.0;
        }
        // The nearest point lies on the scanline through the point, or on that at the edge.
        let ray = self.ray_across(self.across_and_along(x, y).0.clamp(-1.0, 1.0));
        let [x, y] = [x - ray.origin[0], y - ray.origin[1]];
        let [towards_x, towards_y] = ray.direction;
        let along = (x * towards_x + y * towards_y).clamp(0.0, self.depth);
        (x - along * towards_x).hypot(y - along * towards_y)
    }

    fn across_and_along(&self, x: f64, y: f64) -> (f64, f64) {
        match self.layout {
            Layout::Parallel { width } => (2.0 * x / width, y),
            Layout::Fan { radius, half } => (x.atan2(y + radius) / half, x.hypot(y + radius) - radius),
        }
    }

    /// Bounding rectangle of the sector.
    pub fn bounds_mm(&self) -> Bounds {
        match self.layout {
            Layout::Parallel { width } => Bounds {
                min: [-width / 2.0, 0.0],
                max: [width / 2.0, self.depth],
            },
            Layout::Fan { radius, half } => {
                let (far, half) = (radius + self.depth, half.min(PI));
                let widest = if half < PI / 2.0 { far * half.sin() } else { far };
                let lowest = if half.cos() < 0.0 { far } else { radius } * half.cos() - radius;
                Bounds {
                    min: [-widest, lowest],
                    max: [widest, self.depth],
                }
            }
        }
    }

    /// Area of the sector, square millimetres, in closed form.
    pub fn sector_area_mm2(&self) -> f64 {
        match self.layout {
            Layout::Parallel { width } => width * self.depth,
            Layout::Fan { radius, half } => half.min(PI) * self.depth * (self.depth + 2.0 * radius),
        }
    }

    /// Outline of the sector as a closed polygon in the probe's plane, mm, without repeating its first point: along the
    /// array from the unmarked side, then back along the far edge, each arc in `steps` segments (at least 1).
    pub fn outline_mm(&self, steps: usize) -> Vec<[f64; 2]> {
        let steps = steps.max(1);
        // Without the overlap of a full circle.
        let share = match self.layout {
            Layout::Fan { half, .. } => (PI / half).min(1.0),
            Layout::Parallel { .. } => 1.0,
        };
        let edge = |step: usize, along: f64| {
            let ray = self.ray_across(share * (2.0 * step as f64 / steps as f64 - 1.0));
            [0, 1].map(|axis| ray.origin[axis] + along * ray.direction[axis])
        };
        let near = (0..=steps).map(|step| edge(step, 0.0));
        let far = (0..=steps).rev().map(|step| edge(step, self.depth));
        near.chain(far).collect()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use std::f64::consts::TAU;

    use super::super::ProbeKind;
    use super::super::tests::one_of_each;
    use super::*;

    #[test]
    fn the_middle_of_the_array_is_the_origin_and_rays_run_outwards() {
        for probe in one_of_each() {
            let grid = BeamGrid::new(&probe).expect("grid");
            let middle = grid.rays()[probe.lines as usize / 2];
            assert!(middle.origin.iter().all(|x| x.abs() < 1e-12), "{:?}", probe.shape);
            assert!((middle.direction[1] - 1.0).abs() < 1e-12 && middle.direction[0].abs() < 1e-12);
            for ray in grid.rays() {
                assert!((ray.direction[0].hypot(ray.direction[1]) - 1.0).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn corners_of_a_curvilinear_sector_are_where_trigonometry_puts_them() {
        let probe = one_of_each()[1];
        let grid = BeamGrid::new(&probe).expect("grid");
        let half = 30f64.to_radians();
        let first = grid.rays()[0];
        assert!((first.origin[0] + 30.0 * half.sin()).abs() < 1e-12);
        assert!((first.origin[1] - (30.0 * half.cos() - 30.0)).abs() < 1e-12);
        let last = grid.to_plane(32.0, 39.5);
        assert!((last[0] - 110.0 * half.sin()).abs() < 1e-11 && (last[1] - (110.0 * half.cos() - 30.0)).abs() < 1e-11);
        assert!((grid.sample_depth_mm(0) - 1.0).abs() < 1e-12 && (grid.sample_depth_mm(39) - 79.0).abs() < 1e-12);
        assert_eq!(grid.virtual_apex_mm(), Some(30.0));
        let neighbours = [15.0, 16.0].map(|line| grid.to_plane(line, 19.5));
        let chord = (neighbours[0][0] - neighbours[1][0]).hypot(neighbours[0][1] - neighbours[1][1]);
        let arc = grid.lateral_spacing_mm(40.0);
        assert!(chord < arc && arc - chord < 1e-3 * arc, "{chord} {arc}");
    }

    #[test]
    fn bounds_touch_the_outline_on_every_side() {
        for probe in one_of_each() {
            let grid = BeamGrid::new(&probe).expect("grid");
            let bounds = grid.bounds_mm();
            let outline = grid.outline_mm(3600);
            for axis in 0..2 {
                let low = outline.iter().map(|p| p[axis]).fold(f64::INFINITY, f64::min);
                let high = outline.iter().map(|p| p[axis]).fold(f64::NEG_INFINITY, f64::max);
                assert!((low - bounds.min[axis]).abs() < 1e-4, "{:?} {axis} {low}", probe.shape);
                assert!(
                    (high - bounds.max[axis]).abs() < 1e-4,
                    "{:?} {axis} {high}",
                    probe.shape
                );
            }
        }
    }

    #[test]
    fn the_outline_encloses_the_stated_area() {
        for probe in one_of_each() {
            let grid = BeamGrid::new(&probe).expect("grid");
            let outline = grid.outline_mm(2000);
            let doubled: f64 = (0..outline.len())
                .map(|i| {
                    let (a, b) = (outline[i], outline[(i + 1) % outline.len()]);
                    a[0] * b[1] - b[0] * a[1]
                })
                .sum();
            let area = grid.sector_area_mm2();
            assert!((doubled.abs() / 2.0 - area).abs() < 1e-5 * area, "{:?}", probe.shape);
        }
    }

    #[test]
    fn a_single_line_owns_its_whole_sector() {
        for probe in one_of_each() {
            let grid = BeamGrid::new(&Probe {
                lines: 1,
                samples: 1,
                ..probe
            })
            .expect("grid");
            assert_eq!(
                grid.rays(),
                &[Ray {
                    origin: [0.0, 0.0],
                    direction: [0.0, 1.0]
                }]
            );
            assert_eq!(grid.to_beam(0.5, 20.0).map(|beam| beam.0), Some(0.0));
            assert_eq!(grid.to_beam(0.0, 40.0), Some((0.0, 0.0)));
            assert_eq!(grid.to_beam(0.0, 80.1), None);
        }
    }

    #[test]
    fn points_that_are_no_numbers_are_outside() {
        for probe in one_of_each() {
            let grid = BeamGrid::new(&probe).expect("grid");
            assert_eq!(grid.to_beam(f64::NAN, 1.0), None);
            assert_eq!(grid.to_beam(0.0, f64::NAN), None);
            assert_eq!(grid.to_beam(f64::INFINITY, f64::INFINITY), None);
        }
    }

    proptest! {
        #[test]
        fn beam_to_plane_to_beam_returns(kind in 0..ProbeKind::ALL.len(), across in 0.0..1.0f64, along in 0.0..1.0f64) {
            let grid = BeamGrid::new(&one_of_each()[kind]).expect("grid");
            let (line, sample) = (across * 32.0, along * 40.0 - 0.5);
            // At the apex of a phased array all lines coincide.
            prop_assume!(grid.virtual_apex_mm() != Some(0.0) || along > 1e-3);
            let [x, y] = grid.to_plane(line, sample);
            let (line_back, sample_back) = grid.to_beam(x, y).expect("inside");
            // Where the first and last scanlines of a full circle overlap, a whole turn lies between.
            let (lines_between, turn) = ((line_back - line).abs(), TAU / grid.angular_spacing());
            prop_assert!(lines_between < 1e-9 || (lines_between - turn).abs() < 1e-9);
            prop_assert!((sample_back - sample).abs() < 1e-9);
        }

        #[test]
        fn points_beyond_the_depth_or_the_edges_are_outside(kind in 0..ProbeKind::ALL.len(), across in 0.0..1.0f64, beyond in 1e-6..5.0f64) {
            let grid = BeamGrid::new(&one_of_each()[kind]).expect("grid");
            let [x, y] = grid.to_plane(across * 32.0, 39.5 + beyond);
            prop_assert!(grid.to_beam(x, y).is_none());
            if 32.0 * grid.angular_spacing() < TAU {
                let [x, y] = grid.to_plane(32.0 + beyond, 20.0);
                prop_assert!(grid.to_beam(x, y).is_none());
            }
        }
    }
}
