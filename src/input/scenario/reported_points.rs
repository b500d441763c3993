//! `[[report]]` tables of a scenario file: points of the tissue whose displacement is reported.

use nalgebra::{Isometry3, Point3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::file::ScenarioFile;
use super::resolve::Scenario;
use crate::run::material_points::MaterialPoints;
use insonify_base::document::{InputError, InvalidFile};
use insonify_mechanics::insertion::{NodeSolver, Tissue};
use insonify_mesh::{Locator, NO_ELEMENT, TetMesh};

/// A point of the tissue whose displacement is reported over time: one of `at_mm` and `node`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ReportSpec {
    /// Name in tables and plots: letters, digits, `_` and `-`; each name once.
    pub name: String,
    /// Position in the tissue at rest (LPS), mm; the element that contains it carries it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub at_mm: Option<[f64; 3]>,
    /// Node whose position at rest is taken, from 0 in the order of the mesh.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub node: Option<i64>,
}

/// A point whose displacement is reported.
#[derive(Clone, Debug, PartialEq)]
pub struct Reported {
    /// Name of the point.
    pub name: String,
    /// Position in the tissue at rest, mm.
    pub at_mm: Point3<f64>,
}

/// Names of the components of a displacement: world (LPS), then in the image: away from the array along the middle of
/// the image, towards its marked side, and along its normal.
pub const COMPONENTS: [&str; 6] = ["x", "y", "z", "axial", "lateral", "elevational"];

/// Displacements of the reported points at a moment.
#[derive(Clone, Copy, Debug)]
pub struct Displaced<'a> {
    /// Simulated time, s from the start of the run.
    pub time_s: f64,
    /// Depth of the needle's tip, mm.
    pub inserted_mm: f64,
    /// Displacement of each point from rest, mm: [`COMPONENTS`].
    pub displacement_mm: &'a [[f64; 6]],
}

/// Extremes of the displacement of a reported point, each as least and most, mm.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Extremes {
    /// Name of the point.
    pub name: String,
    /// Position in the tissue at rest, mm.
    pub at_mm: [f64; 3],
    /// Largest distance from rest, mm.
    pub max_displacement_mm: f64,
    /// Time of the largest distance from rest, s from the start of the run.
    pub max_at_s: f64,
    /// Along x of the world (LPS).
    pub x_mm: [f64; 2],
    /// Along y of the world.
    pub y_mm: [f64; 2],
    /// Along z of the world.
    pub z_mm: [f64; 2],
    /// Away from the array, along the middle of the image.
    pub axial_mm: [f64; 2],
    /// Towards the marked side of the image.
    pub lateral_mm: [f64; 2],
    /// Along the normal of the image.
    pub elevational_mm: [f64; 2],
}

impl Extremes {
    /// Extremes of a point that is still at rest.
    pub fn new(point: &Reported) -> Self {
        Self {
            name: point.name.clone(),
            at_mm: point.at_mm.into(),
            ..Self::default()
        }
    }

    /// Extremes of each of [`COMPONENTS`], least and most, mm.
    fn ranges_mm(&mut self) -> [&mut [f64; 2]; 6] {
        let [x, y, z] = [&mut self.x_mm, &mut self.y_mm, &mut self.z_mm];
        [
            x,
            y,
            z,
            &mut self.axial_mm,
            &mut self.lateral_mm,
            &mut self.elevational_mm,
        ]
    }

    /// Takes a displacement into account.
    pub(crate) fn add(&mut self, time_s: f64, displacement_mm: &[f64; 6]) {
        for (range, value) in self.ranges_mm().into_iter().zip(displacement_mm) {
            *range = [range[0].min(*value), range[1].max(*value)];
        }
        let [x, y, z, ..] = *displacement_mm;
        let distance = x.hypot(y).hypot(z);
        if distance > self.max_displacement_mm {
            (self.max_displacement_mm, self.max_at_s) = (distance, time_s);
        }
    }
}

/// Follows the reported points of a run.
pub struct Points<'a> {
    points: &'a [Reported],
    carried: MaterialPoints,
    displacement_mm: Vec<[f64; 6]>,
}

impl<'a> Points<'a> {
    /// Starts to follow the reported points of a scenario.
    pub fn new(scenario: &'a Scenario) -> Self {
        Self {
            points: &scenario.reports,
            carried: MaterialPoints::default(),
            displacement_mm: Vec::new(),
        }
    }

    /// True if there is a point to follow.
    pub(crate) fn follows(&self) -> bool {
        !self.points.is_empty()
    }

    /// Displacements in a state of the tissue, with the imaging probe at a pose.
    pub(crate) fn carry(&mut self, imager: &dyn NodeSolver, tissue: &Tissue, probe: &Isometry3<f64>) -> &[[f64; 6]] {
        self.displacement_mm.clear();
        for (slot, point) in self.points.iter().enumerate() {
            let now = self.carried.point(slot, &point.at_mm, imager.elements(), tissue);
            let moved = now - point.at_mm;
            let seen = probe.inverse_transform_vector(&moved);
            self.displacement_mm
                .push([moved.x, moved.y, moved.z, seen.y, seen.x, seen.z]);
        }
        &self.displacement_mm
    }
}

impl ScenarioFile {
    /// Points whose displacement is reported.
    pub(crate) fn reports(&self, mesh: &TetMesh) -> Result<Vec<Reported>, InputError> {
        // The cylinder of masses and springs takes its place when the needle enters.
        let locator = if self.tissue.model.is_meshed() && !self.report.is_empty() {
            Some(Locator::<f64>::new(mesh))
        } else {
            None
        };
        let mut points: Vec<Reported> = Vec::new();
        for (index, spec) in self.report.iter().enumerate() {
            let table = format!("report[{index}]");
            let is_plain = |c: char| c.is_ascii_alphanumeric() || "_-".contains(c);
            if spec.name.is_empty() || !spec.name.chars().all(is_plain) {
                let found = format!("\"{}\"", spec.name);
                return Err(self.wrong_keys(format!("{table}.name"), found, "letters, digits, `_` and `-`"));
            }
            if points.iter().any(|point| point.name == spec.name) {
                let found = format!("a second point \"{}\"", spec.name);
                return Err(self.wrong_keys(format!("{table}.name"), found, "each name once"));
            }
            let at_mm = match (spec.at_mm, spec.node, &locator) {
                (Some(at_mm), None, _) => self.place(&format!("{table}.at_mm"), at_mm)?,
                (None, Some(_), None) => {
                    let found = "a node of the mass-spring model, whose place is known only when the needle enters";
                    return Err(self.wrong_keys(format!("{table}.node"), found, "a point by `at_mm`"));
                }
                (None, Some(found), Some(_)) => {
                    let nodes = mesh.nodes();
                    let node = usize::try_from(found).ok().and_then(|node| nodes.get(node));
                    let unknown = || self.fault(format!("{table}.node"), InvalidFile::node(found, nodes.len()));
                    (*node.ok_or_else(unknown)?).into()
                }
                (at_mm, _, _) => {
                    let found = at_mm.map_or("neither `at_mm` nor `node`", |_| "both `at_mm` and `node`");
                    return Err(self.wrong_keys(table, found, "one of them"));
                }
            };
            if spec.node.is_none()
                && let Some(locator) = &locator
                && locator.locate(at_mm.into(), NO_ELEMENT).element == NO_ELEMENT
            {
                let found = format!("{:?}, which is in no element of the mesh", <[f64; 3]>::from(at_mm));
                let expected = "a point within the meshed tissue at rest (LPS, mm)";
                return Err(self.wrong_keys(format!("{table}.at_mm"), found, expected));
            }
            points.push(Reported {
                name: spec.name.clone(),
                at_mm,
            });
        }
        Ok(points)
    }
}
