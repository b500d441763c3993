//! State of a run at an export time of the deformed mesh: stress, and needle, seeds and probe as poly-data.

use std::f64::consts::TAU;

use nalgebra::{Isometry3, Point3};

use crate::input::scenario::Scenario;
use insonify_imaging::synth::NeedleShaft;
use insonify_mechanics::insertion::{Model, ShaftLoad, Tissue};
use insonify_mechanics::needle::CentreLine;
use insonify_mechanics::tissue::nonlinear::{Solid, von_mises};
use insonify_mesh::file::Poly;
use insonify_tracking::probe::BeamGrid;

/// Corners of the cylinder of a probe.
const CORNERS: u32 = 32;
/// Length below which a load acts at a point, mm.
const POINT_MM: f64 = 1e-9;

impl Scenario {
    /// Von Mises stress of each element, kPa, in its shape after remeshing; `None` for masses and springs, for a plane,
    /// and for viscous tissue of which it is not followed.
    pub fn von_mises_kpa(&self, model: &dyn Model, elements: &[[u32; 4]], tissue: &Tissue) -> Option<Vec<f64>> {
        if let Some(stress) = model.stress_kpa() {
            return Some(stress.iter().map(von_mises).collect());
        }
        let laws = self.tissue.elastic_laws()?;
        let body = Solid::of(tissue.reference.clone(), elements.to_vec(), &laws, 1.0).ok()?;
        let pairs = tissue
            .reference
            .as_flattened()
            .iter()
            .zip(tissue.current.as_flattened());
        let moved: Vec<f64> = pairs.map(|(then, now)| now - then).collect();
        Some(body.stresses_kpa(&moved, &moved).iter().map(von_mises).collect())
    }

    /// Array of the imaging probe as a line, and the cylinder of a probe in contact.
    pub fn probe_poly(&self, imaging: &Isometry3<f64>, contact: Option<&Isometry3<f64>>) -> Poly {
        let mut poly = Poly::default();
        let grid = BeamGrid::new(&self.scene.settings.probe).ok();
        let array = grid.iter().flat_map(BeamGrid::rays).map(|ray| ray.origin);
        let array = array.map(|[x, y]| imaging * Point3::new(x, y, 0.0));
        poly.points.extend(array.map(<[f64; 3]>::from));
        if poly.points.len() > 1 {
            poly.lines.push((0..poly.points.len() as u32).collect());
        }
        if let (Some(pose), Some(contact)) = (contact, self.contact()) {
            let first_point = poly.points.len() as u32;
            for z in [0.0, -contact.probe.length_mm] {
                let corner = |corner: u32| {
                    let (sin, cos) = (TAU * f64::from(corner) / f64::from(CORNERS)).sin_cos();
                    pose * Point3::new(contact.radius_mm * cos, contact.radius_mm * sin, z)
                };
                poly.points
                    .extend((0..CORNERS).map(|index| <[f64; 3]>::from(corner(index))));
            }
            let sides = (0..CORNERS).map(|corner| {
                let [start, end] = [corner, (corner + 1) % CORNERS].map(|corner| first_point + corner);
                vec![start, start + CORNERS, end + CORNERS, end]
            });
            poly.polygons.extend(sides);
            poly.polygons.push((first_point..first_point + CORNERS).collect());
            poly.polygons
                .push((first_point + CORNERS..first_point + 2 * CORNERS).rev().collect());
        }
        poly
    }
}

/// Needle as poly-data: points along the shaft, a vertex for each force at a point, a line for each length of shaft.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NeedlePoly {
    /// The points and cells.
    pub poly: Poly,
    /// Arc from the base to each point, mm.
    pub arc_mm: Vec<f64>,
    /// Force of the tissue on each cell, N, world axes.
    pub force_n: Vec<[f64; 3]>,
    /// Force per length on each cell along the needle, N/mm: negative while tissue holds the needle back; 0 for points.
    pub along_n_per_mm: Vec<f64>,
    /// Force per length on each cell across the needle, N/mm; 0 for points.
    pub across_n_per_mm: Vec<f64>,
}

impl NeedlePoly {
    /// Needle on a centre line, under the loads of the tissue.
    pub fn new(line: &CentreLine, loads: &[ShaftLoad]) -> Self {
        let mut needle = Self::default();
        let length = line.length_mm();
        let inside = |arc: f64| arc.clamp(0.0, length);
        let ends = loads.iter().flat_map(|load| [inside(load.from_mm), inside(load.to_mm)]);
        // A node at each end of a load, so that the density is constant along a segment.
        needle.arc_mm = line.nodes().iter().map(|(arc, _)| *arc).chain(ends).collect();
        needle.arc_mm.sort_by(f64::total_cmp);
        needle.arc_mm.dedup_by(|next, before| *next - *before <= POINT_MM);
        if needle.arc_mm.len() < 2 {
            return Self::default();
        }
        needle.poly.points = needle
            .arc_mm
            .iter()
            .map(|arc| line.point_at_arc(*arc).point_mm.into())
            .collect();
        // First, since VTK counts vertices before lines, and the values of cells are in that order.
        for load in loads.iter().filter(|load| load.length_mm() <= POINT_MM) {
            let nearest = needle
                .arc_mm
                .partition_point(|arc| *arc < inside(load.from_mm) - POINT_MM);
            needle.poly.vertices.push(nearest.min(needle.arc_mm.len() - 1) as u32);
            needle.force_n.push(load.force_n.into());
            needle.along_n_per_mm.push(0.0);
            needle.across_n_per_mm.push(0.0);
        }
        for (segment, ends) in needle.arc_mm.windows(2).enumerate() {
            let middle = 0.5 * (ends[0] + ends[1]);
            let spread = loads.iter().filter(|load| load.length_mm() > POINT_MM);
            let loads_here = spread.filter(|load| (load.from_mm..load.to_mm).contains(&middle));
            let density: nalgebra::Vector3<f64> = loads_here.map(|load| load.force_n / load.length_mm()).sum();
            let along_n_per_mm = line.point_at_arc(middle).tangent.dot(&density);
            needle.poly.lines.push(vec![segment as u32, segment as u32 + 1]);
            needle.force_n.push((density * (ends[1] - ends[0])).into());
            needle.along_n_per_mm.push(along_n_per_mm);
            needle
                .across_n_per_mm
                .push((density - line.point_at_arc(middle).tangent.into_inner() * along_n_per_mm).norm());
        }
        needle
    }
}

/// Seeds as lines of poly-data.
pub fn seeds_poly(seeds: &[NeedleShaft]) -> Poly {
    let mut poly = Poly::default();
    for seed in seeds {
        let first_point = poly.points.len() as u32;
        poly.points
            .extend(seed.nodes.iter().map(|node| <[f64; 3]>::from(*node)));
        poly.lines.push((first_point..poly.points.len() as u32).collect());
    }
    poly
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;

    #[test]
    fn loads_lie_along_the_needle() {
        let mut line = CentreLine::default();
        line.set([
            (0.0, Point3::origin()),
            (60.0, Point3::new(0.0, 0.0, 60.0)),
            (100.0, Point3::new(0.0, 40.0, 60.0)),
        ]);
        let load = |from_mm, to_mm, force_n| ShaftLoad {
            from_mm,
            to_mm,
            force_n,
        };
        let loads = [
            load(50.0, 60.0, Vector3::new(0.0, 0.3, -1.0)),
            load(60.0, 100.0, Vector3::new(0.0, -2.0, 0.0)),
            load(100.0, 100.0, Vector3::new(0.0, -0.5, 0.0)),
        ];
        let needle = NeedlePoly::new(&line, &loads);
        assert_eq!(needle.arc_mm, [0.0, 50.0, 60.0, 100.0]);
        assert_eq!(needle.poly.points[2..], [[0.0, 0.0, 60.0], [0.0, 40.0, 60.0]]);
        assert_eq!((&needle.poly.vertices[..], needle.poly.lines.len()), (&[3][..], 3));
        let near = |values: &[f64], expected: [f64; 4]| values.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12);
        assert!(near(&needle.along_n_per_mm, [0.0, 0.0, -0.1, -0.05]), "{needle:?}");
        assert!(near(&needle.across_n_per_mm, [0.0, 0.0, 0.03, 0.0]), "{needle:?}");
        let sum: Vector3<f64> = needle.force_n.iter().map(|force| Vector3::from(*force)).sum();
        assert!((sum - Vector3::new(0.0, -2.2, -1.0)).norm() < 1e-12);
        assert_eq!(NeedlePoly::new(&CentreLine::default(), &[]), NeedlePoly::default());
    }
}
