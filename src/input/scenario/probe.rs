//! Probe contact of a scenario, and selection of the nodes that the probe can touch.

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};

use super::file::ScenarioFile;
use super::instruments::ContactProbeSpec;
use super::regions::Regions;
use super::tissue_setup::Deforming;
use insonify_base::document::InputError;
use insonify_imaging::scene::Scene;
use insonify_mechanics::insertion::{Outcome, ProbeContact};
use insonify_mesh::{Face, TetMesh};
use insonify_tracking::pose::Pose;

/// Default maximum distance of a contact candidate from the cylinder, mm.
const WITHIN_MM: f64 = 4.0;

/// A probe in contact, and the transform of its cylinder to the imaging probe.
#[derive(Clone, Debug)]
pub struct Contact {
    /// Probe contact of the model.
    pub probe: ProbeContact,
    /// Transform from the frame of the cylinder to the probe frame of images.
    pub in_probe: Isometry3<f64>,
    /// Radius of the cylinder, mm.
    pub radius_mm: f64,
}

impl Contact {
    /// Tissue force on the probe, split between the two points that drive it, N, world axes; `None` for a probe without
    /// such points, zero while the probe is away.
    pub fn driven(&self, pose: Option<&Isometry3<f64>>, outcome: &Outcome) -> Option<[Vector3<f64>; 2]> {
        self.probe.driven_at_mm?;
        let pressing = outcome.on_probe.as_ref().zip(pose);
        let split = pressing.and_then(|(wrench, pose)| self.probe.split(wrench, pose));
        Some(split.unwrap_or_default())
    }
}

/// Rigid transform of a pose.
pub(super) fn rigid(pose: &Pose) -> Isometry3<f64> {
    Isometry3::from_parts(pose.position_mm().coords.into(), pose.rotation())
}

impl ScenarioFile {
    /// Returns the probe in contact, if the scenario has one. Fixed nodes cannot touch it.
    pub(crate) fn contact(&self, scene: &Scene, tissue: &Deforming) -> Result<Option<Contact>, InputError> {
        let Some(spec) = &self.contact_probe else {
            return Ok(None);
        };
        let (mesh, fixed) = (&*tissue.mesh, &tissue.fixed);
        let regions = Regions::new(self, scene, &tissue.names);
        self.in_ranges("contact_probe", spec)?;
        let in_probe = self.cylinder(spec)?;
        let within = spec.within_mm.unwrap_or(WITHIN_MM);
        let thinning = spec.thinning.unwrap_or(1);
        for (index, driven) in spec.driven_at_mm.iter().flatten().enumerate() {
            let key = format!("contact_probe.driven_at_mm[{index}]");
            self.number(key, *driven, |x| x.abs() <= 1000.0, "-1000 to 1000 mm")?;
        }
        if let Some([a, b]) = spec.driven_at_mm
            && (a - b).abs() < 1.0
        {
            let found = format!("[{a}, {b}]");
            return Err(self.wrong_keys("contact_probe.driven_at_mm", found, "two points at least 1 mm apart"));
        }
        let numbers = match &spec.surface_of {
            None => None,
            Some(name) => Some(regions.numbers("contact_probe.surface_of", name)?),
        };
        let poses = scene.probe_path().keys();
        let nominal = rigid(&scene.probe_path().at(scene.probe_path().start_s())) * in_probe;
        // A node that the probe can reach anywhere along its motion is a candidate: positions of the end along the
        // initial axis.
        let ends = poses.iter().map(|key| {
            nominal
                .inverse_transform_point(&(rigid(&key.pose) * in_probe).translation.vector.into())
                .z
        });
        let [deepest, outermost] = ends.fold([0.0f64, 0.0f64], |[deepest, outermost], z| {
            [deepest.min(z), outermost.max(z)]
        });
        let reach = [deepest - spec.length_mm, outermost];
        let touches = |node: u32| {
            let local = nominal.inverse_transform_point(&Point3::from(mesh.nodes()[node as usize]));
            let gap = local.x.hypot(local.y) - spec.radius_mm;
            gap.abs() <= within && (reach[0]..=reach[1]).contains(&local.z)
        };
        let is_fixed = |node: u32| (0..3).any(|axis| fixed.binary_search(&(node, axis)).is_ok());
        let candidates: Vec<u32> = surface(mesh, numbers.as_deref())
            .into_iter()
            .filter(|node| touches(*node) && !is_fixed(*node))
            .collect();
        if candidates.is_empty() {
            let found = format!("no free node of the surface within {within} mm of the probe's cylinder");
            let expected = "a larger `within_mm`, another `surface_of`, or a mesh that leaves out what lies between (`tissue.outside`)";
            return Err(self.wrong_keys("contact_probe", found, expected));
        }
        let mut probe = ProbeContact {
            nominal,
            length_mm: spec.length_mm,
            candidates,
            driven_at_mm: spec.driven_at_mm,
        };
        probe.thin(mesh.nodes(), thinning as usize);
        Ok(Some(Contact {
            probe,
            in_probe,
            radius_mm: spec.radius_mm,
        }))
    }

    /// Transform from the frame of the cylinder to the probe frame.
    fn cylinder(&self, spec: &ContactProbeSpec) -> Result<Isometry3<f64>, InputError> {
        let axis = self.direction("contact_probe.axis", spec.axis.unwrap_or([0.0, 0.0, -1.0]))?;
        let end = match spec.end_mm {
            Some(end) => self.place("contact_probe.end_mm", end)?,
            None => Point3::new(0.0, -spec.radius_mm, 0.0),
        };
        // Any rotation about the axis will do: the contact frame does not roll with the probe.
        let turn = UnitQuaternion::rotation_between(&Vector3::z(), &axis)
            .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
        Ok(Isometry3::from_parts(end.coords.into(), turn))
    }
}

/// Nodes on the surface of a mesh, ascending; optionally of some regions only.
fn surface(mesh: &TetMesh, regions: Option<&[i32]>) -> Vec<u32> {
    let is_chosen = |face: &Face| regions.is_none_or(|regions| regions.contains(&face.region));
    let mut nodes: Vec<u32> = mesh.surface().filter(is_chosen).flat_map(|face| face.nodes).collect();
    nodes.sort_unstable();
    nodes.dedup();
    nodes
}
