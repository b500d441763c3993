//! Section of a scenario's tissue by the image plane: triangles in plane strain, as in Kobayashi et al. 2010 (sections
//! 3.2 and 4.2.2).

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::{Point3, Vector3};

use super::nonlinear_tissue::NonlinearTissue;
use super::regions::Regions;
use super::resolve::Scenario;
use super::tissue_setup::TissueSetup;
use insonify_base::document::InputError;
use insonify_mechanics::insertion::nonlinear::{NonlinearOptions, Plane};
use insonify_mechanics::tissue::law::AnyLaw;
use insonify_mechanics::tissue::nonlinear::Sheet;
use insonify_mesh::TetMesh;
use insonify_mesh::outline::{Triangles, triangulate};

/// Number of triangles of a section, about.
const TRIANGLES: f64 = 1200.0;
/// Number of samples along the longer side of a section that find its outlines.
const SAMPLES: f64 = 200.0;
/// Least spacing of these samples, mm.
const MIN_MM: f64 = 0.4;
/// Half thickness of the slab that stands for the section in images and in the selection of fixed nodes, mm.
const HALF_MM: f64 = 0.5;
/// Component of an axis of the plane along an axis of the world below which they are square to each other.
const SQUARE: f64 = 1e-6;

/// Tissue in the image plane, without strain across it; the mesh of the scenario is a slab around it.
#[derive(Clone, Debug)]
pub struct PlaneSection {
    /// Laws of the triangles, and the fixed nodes and axes of the sheet.
    pub tissue: NonlinearTissue,
    /// The sheet and its place.
    pub plane: Arc<Plane>,
}

impl Scenario {
    /// Checks that the tissue does not depend on the path of the needle.
    ///
    /// # Errors
    /// [`InputError`] for masses and springs.
    pub fn check_path_independent(&self) -> Result<(), InputError> {
        match self.tissue {
            TissueSetup::MassSpring(_) => {
                let found = "masses and springs, whose cylinder lies along one path";
                Err(self.file.wrong_keys("tissue.model", found, "another tissue model"))
            }
            _ => Ok(()),
        }
    }

    /// The scenario with tissue of two dimensions: what the image plane at the start cuts, `thickness_mm` thick and
    /// without strain across it. Materials, viscosity and fixed places are those of the scenario; linear tissue stays
    /// linear.
    ///
    /// # Errors
    /// [`InputError`] for a scenario with parts that a plane cannot have, or without tissue in the plane.
    pub fn section(&self, thickness_mm: f64) -> Result<Self, InputError> {
        self.fits_a_plane()?;
        let pose = self.scene.probe_path().at(self.timing.start_s);
        let axes = [pose.lateral().into_inner(), pose.axial().into_inner()];
        let plane = Outline {
            origin: pose.position_mm(),
            axes,
        };
        // Triangles keep their order in the plane only with a right-handed pair of axes, which lateral and axial are.
        let flat = plane.triangles(self);
        if flat.triangles.is_empty() {
            let found = "no tissue in the image plane";
            return Err(self
                .file
                .wrong_keys("scene", found, "a probe whose image plane cuts the tissue"));
        }
        let slab = plane.slab(&flat).map_err(|error| self.file.fault("tissue", error))?;
        let none = BTreeMap::new();
        let regions = Regions::new(&self.file, &self.scene, &none);
        let mut present = flat.regions.clone();
        present.sort_unstable();
        present.dedup();
        let properties = regions.properties(&present)?;
        let laws: Vec<AnyLaw> = flat.regions.iter().map(|region| properties[region].law).collect();
        let (mut notes, mut warnings) = (Default::default(), Vec::new());
        let clamped = self
            .file
            .fixed(&slab, &regions, &properties, &mut notes, &mut warnings)?;
        let sheet = Sheet::plane_strain(flat.nodes, flat.triangles, &laws, thickness_mm);
        let sheet = sheet.map_err(|error| self.file.fault("tissue", error))?;
        let solid = self.tissue.nonlinear();
        let mut section = self.clone();
        section.tissue = TissueSetup::Plane(PlaneSection {
            tissue: NonlinearTissue {
                laws,
                fixed: plane.fixed(&clamped, sheet.nodes().len()),
                viscosity: solid.and_then(|tissue| tissue.viscosity),
                stress: false,
                // Per thickness of a sheet a strip dents otherwise than a disk does a solid.
                patch_mm: 0.0,
                options: solid.map_or_else(NonlinearOptions::default, |tissue| tissue.options),
            },
            plane: Arc::new(Plane {
                origin: plane.origin,
                axes: plane.axes,
                sheet: Arc::new(sheet),
            }),
        });
        section.mesh = Arc::new(slab);
        section.scene.anatomy.mesh = Some(Arc::clone(&section.mesh));
        section.warnings.extend(warnings);
        Ok(section)
    }

    /// Refuses what a plane model does not support.
    fn fits_a_plane(&self) -> Result<(), InputError> {
        let wrong = |key: &str, found: &str, expected: &str| Err(self.file.wrong_keys(key, found, expected));
        if self.contact().is_some() {
            return wrong(
                "contact_probe",
                "a probe in contact with a section of tissue",
                "a scenario without",
            );
        }
        if !self.needle.is_straight() {
            let found = "a needle that bends or has a bevel in a section of tissue, which it goes through straight";
            return wrong("needle", found, "`model = \"rigid\"` without `bevel`");
        }
        match self
            .file
            .tissue
            .fix
            .iter()
            .position(|fix| fix.surface || fix.nodes.is_some())
        {
            Some(index) => {
                let found = "`nodes` or `surface`, which name no places in a section";
                wrong(&format!("tissue.fix[{index}]"), found, "`box_mm` or `region`")
            }
            None => Ok(()),
        }
    }
}

/// Origin and axes of a section in the world.
struct Outline {
    origin: Point3<f64>,
    axes: [Vector3<f64>; 2],
}

impl Outline {
    fn world(&self, [x, y]: [f64; 2], aside_mm: f64) -> Point3<f64> {
        let normal = self.axes[0].cross(&self.axes[1]);
        self.origin + self.axes[0] * x + self.axes[1] * y + normal * aside_mm
    }

    /// Triangulates the tissue in the plane.
    fn triangles(&self, scenario: &Scenario) -> Triangles {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for node in scenario.mesh.nodes() {
            let offset = Point3::from(*node) - self.origin;
            for axis in 0..2 {
                let coordinate = offset.dot(&self.axes[axis]);
                (low[axis], high[axis]) = (low[axis].min(coordinate), high[axis].max(coordinate));
            }
        }
        // The surface of a mesh may lie within that of the labels.
        let sides = [0, 1].map(|axis: usize| high[axis] - low[axis]);
        let margin = 0.05 * sides[0].max(sides[1]);
        let corners = [low.map(|x| x - margin), high.map(|x| x + margin)];
        let grid_mm = (sides[0].max(sides[1]) / SAMPLES).max(MIN_MM);
        // Twice the area of an equilateral triangle is sqrt(3)/2 of its squared edge.
        let edge_mm = (sides[0] * sides[1] / TRIANGLES * 4.0 / 3f64.sqrt()).sqrt();
        let region = |position: [f64; 2]| scenario.anatomy.region(&self.world(position, 0.0));
        triangulate(region, corners, grid_mm, edge_mm)
    }

    /// The section as a slab of tetrahedra: three for each triangle, the nodes of one face before those of the other.
    fn slab(&self, flat: &Triangles) -> Result<TetMesh, insonify_mesh::InvalidMesh> {
        let count = flat.nodes.len() as u32;
        let face = |aside: f64| {
            flat.nodes
                .iter()
                .map(move |position| self.world(*position, aside).into())
        };
        let nodes = face(-HALF_MM).chain(face(HALF_MM)).collect();
        let mut elements = Vec::with_capacity(3 * flat.triangles.len());
        for corners in &flat.triangles {
            // Diagonals of the side faces start at the lower number, so that neighbours agree.
            let mut order = *corners;
            let least = (0..3).min_by_key(|corner| corners[*corner]).unwrap_or(0);
            order.rotate_left(least);
            let ([a, b, c], [d, e, f]) = (order, order.map(|node| node + count));
            elements.extend(if b < c {
                [[a, b, c, f], [a, b, f, e], [a, e, f, d]]
            } else {
                [[a, b, c, e], [a, e, c, f], [a, e, f, d]]
            });
        }
        let regions = flat.regions.iter().flat_map(|region| [*region; 3]).collect();
        TetMesh::new(nodes, elements, regions)
    }

    /// Fixed nodes and axes of the sheet, from those of the slab: an axis in the plane is held where all axes of the
    /// world are that it has a part along.
    fn fixed(&self, of_slab: &[(u32, u8)], nodes: usize) -> Vec<(u32, u8)> {
        let mut is_fixed = vec![[false; 3]; nodes];
        for &(node, axis) in of_slab.iter().filter(|(node, _)| (*node as usize) < nodes) {
            is_fixed[node as usize][usize::from(axis)] = true;
        }
        let axes = |(node, is_fixed): (usize, [bool; 3])| {
            let holds =
                move |in_plane: &usize| (0..3).all(|axis| is_fixed[axis] || self.axes[*in_plane][axis].abs() < SQUARE);
            (0..2).filter(holds).map(move |axis| (node as u32, axis as u8))
        };
        is_fixed.into_iter().enumerate().flat_map(axes).collect()
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::{PlaneSection, TissueSetup};
    use crate::input::scenario::{EXAMPLES, ScenarioFile};

    /// The section of a scenario has the areas of the labels in the image plane, and holds what the scenario holds.
    #[test]
    fn areas_are_those_of_the_labels() {
        let text = EXAMPLES.iter().find(|(name, _)| *name == "liver-puncture").unwrap().1;
        let text = text.replace("nodes = 3300", "nodes = 200");
        let file = ScenarioFile::parse(&text, "test.toml").unwrap();
        let scenario = file.resolve(Path::new(""), |_| ()).unwrap();
        let section = scenario.section(20.0).unwrap();
        let TissueSetup::Plane(PlaneSection { tissue, plane }) = &section.tissue else {
            panic!("a section");
        };
        let area = |label: i32| -> f64 {
            let parts = plane
                .sheet
                .elements()
                .iter()
                .zip(section.mesh.regions().iter().step_by(3));
            let parts = parts.filter(|(_, region)| **region == label);
            parts
                .map(|(corners, _)| {
                    let [a, b, c] = corners.map(|node| plane.sheet.nodes()[node as usize]);
                    0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]))
                })
                .sum()
        };
        let volume = &scenario.scene.anatomy.volume;
        let step = 0.1;
        let mut counted = [0.0; 3];
        for j in 0..580 {
            for i in 0..760 {
                let point =
                    nalgebra::Point3::new(-42.0 + (f64::from(i) + 0.5) * step, (f64::from(j) + 0.5) * step, 0.0);
                counted[usize::from(volume.label_index_at(&point).unwrap())] += step * step;
            }
        }
        for label in [1, 2] {
            let area_mm2 = area(label);
            assert!(
                (area_mm2 / counted[label as usize] - 1.0).abs() < 0.01,
                "{label}: {area_mm2} {counted:?}"
            );
        }
        // Held: the back and both sides, but not the capsule.
        let is_fixed = |position: [f64; 3]| {
            let nodes = section.mesh.nodes()[..plane.sheet.nodes().len()].iter().enumerate();
            let away = |node: &[f64; 3]| (node[0] - position[0]).hypot(node[1] - position[1]);
            let nearest = nodes.min_by(|a, b| away(a.1).total_cmp(&away(b.1))).unwrap().0;
            tissue
                .fixed
                .iter()
                .filter(|(node, _)| *node as usize == nearest)
                .count()
        };
        assert_eq!(
            [[0.0, 58.0, 0.0], [-42.0, 20.0, 0.0], [34.0, 20.0, 0.0]].map(is_fixed),
            [2; 3]
        );
        assert_eq!(is_fixed([0.0, 0.0, 0.0]), 0);
        assert!((section.mesh.nodes().len()) / 2 == plane.sheet.nodes().len());
    }

    #[test]
    fn what_has_no_part_in_a_plane_is_refused() {
        let text = EXAMPLES.iter().find(|(name, _)| *name == "liver-puncture").unwrap().1;
        let text = text.replace("nodes = 3300", "nodes = 200");
        let text = text.replacen("[[tissue.fix]]", "[[tissue.fix]]\nsurface = true", 1);
        let scenario = ScenarioFile::parse(&text, "test.toml")
            .unwrap()
            .resolve(Path::new(""), |_| ())
            .unwrap();
        let error = scenario.section(20.0).unwrap_err();
        assert_eq!(error.key(), Some("tissue.fix[0]"));
        let scenario = ScenarioFile::parse(&text.replacen("\nsurface = true", "", 1), "test.toml").unwrap();
        let scenario = scenario.resolve(Path::new(""), |_| ()).unwrap();
        assert!(scenario.section(0.0).is_err());
    }
}
