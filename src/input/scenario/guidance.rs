//! Geometry of needle, image and target at every step, from which an insertion is scored.

use nalgebra::{Isometry3, Matrix4, Point3, Vector3};

use super::resolve::Scenario;
use crate::run::material_points::MaterialPoints;
use insonify_anatomy::volume::distance::Grid;
use insonify_imaging::effects::shadow::Shadow;
use insonify_mechanics::insertion::{EventKind, Interaction, Model, NodeSolver, Outcome, Tissue};
use insonify_tracking::probe::BeamGrid;

/// Two-way loss above which a target counts as hidden, dB: the dynamic range of an image (60 dB) and the loss in
/// Thickness of the slice if the scene states none, mm.
const THICKNESS_MM: f64 = 3.0;
/// average soft tissue (0.5 dB/cm/MHz) down to 100 mm at 4 MHz, which the gain for depth restores (40 dB).
const HIDDEN_DB: f64 = 100.0;
/// Distance between samples of a ray, mm.
const RAY_MM: f64 = 0.5;
/// Margin about the needle's path within which critical structures are searched for, mm.
const MARGIN_MM: f64 = 30.0;

/// Geometry at the end of a step. Points in the world, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Guidance {
    /// Direction of the constrained needle at its tip.
    pub direction: Vector3<f64>,
    /// Tip of the measured needle, straight from its base.
    pub measured_tip: Point3<f64>,
    /// Centre of the imaging probe's array.
    pub array: Point3<f64>,
    /// Normal of the image plane.
    pub normal: Vector3<f64>,
    /// Point at which the needle entered the body: at rest, and carried by the tissue.
    pub entry: Option<[Point3<f64>; 2]>,
    /// The first target: at rest, and carried by the tissue.
    pub target: Option<[Point3<f64>; 2]>,
    /// True if the image shows the target: within the sector and the slice thickness, and not shadowed.
    pub shown: bool,
    /// Distance of the tip from the nearest critical structure at rest, mm, 0 in a step that enters one; `None` if
    /// there is none within 30 mm of the path.
    pub clearance_mm: Option<f64>,
}

/// Source of a run's guidance.
pub struct Guide<'a> {
    scenario: &'a Scenario,
    length_mm: f64,
    /// Reach of the target out of the image plane at which it is shown, mm.
    reach_mm: f64,
    grid: Option<BeamGrid>,
    critical: Option<Critical>,
    carried: MaterialPoints,
    entry: Option<[Point3<f64>; 2]>,
    target: Option<[Point3<f64>; 2]>,
}

impl<'a> Guide<'a> {
    /// Starts the guidance of a run of a scenario.
    pub fn new(scenario: &'a Scenario) -> Self {
        let settings = &scenario.scene.settings;
        let stated = settings
            .effects
            .thickness
            .as_ref()
            .and_then(|thickness| thickness.width_mm);
        let target = scenario.targets.first();
        Self {
            scenario,
            length_mm: scenario.needle.length_mm,
            reach_mm: stated.unwrap_or(THICKNESS_MM) / 2.0 + target.map_or(0.0, |target| target.radius_mm),
            grid: BeamGrid::new(&settings.probe).ok(),
            critical: Critical::around(scenario, &scenario.planned_points()),
            carried: MaterialPoints::default(),
            entry: None,
            target: target.map(|target| [target.at_mm; 2]),
        }
    }

    /// True if there is a point that moves with the tissue.
    pub(crate) fn follows(&self) -> bool {
        self.target.is_some()
    }

    /// Carries entry and target with the tissue.
    pub(crate) fn carry(&mut self, imager: &dyn NodeSolver, tissue: &Tissue) {
        for (slot, places) in [&mut self.entry, &mut self.target].into_iter().enumerate() {
            if let Some([at_rest, now]) = places {
                *now = self.carried.point(slot, at_rest, imager.elements(), tissue);
            }
        }
    }

    /// Geometry at the end of a step.
    pub fn at(&mut self, model: &dyn Model, base: &Isometry3<f64>, probe: &Isometry3<f64>) -> Guidance {
        let outcome: &Outcome = model.outcome();
        if let Some(event) = outcome.events.iter().find(|event| event.kind == EventKind::Skin) {
            self.entry = Some([outcome.tip_at_rest_mm.unwrap_or(event.at_mm), event.at_mm]);
        }
        if outcome.inserted_mm > 0.0 && self.entry.is_none() {
            self.entry = Some([outcome.tip_at_rest_mm.unwrap_or(outcome.tip_mm), outcome.tip_mm]);
        }
        let direction = base.rotation * Vector3::z();
        let tip = outcome.tip_at_rest_mm;
        // A step may be longer than a vessel is wide.
        let entered = outcome.events.iter().any(|event| event.kind == EventKind::Critical);
        let clearance_mm = tip.and_then(|tip| self.critical.as_ref()?.distance(&tip));
        Guidance {
            direction: model
                .tip_direction()
                .map_or(direction, |direction| direction.into_inner()),
            measured_tip: base * Point3::new(0.0, 0.0, self.length_mm),
            array: probe * Point3::origin(),
            normal: probe.rotation * Vector3::z(),
            entry: self.entry,
            target: self.target,
            shown: self.target.is_some_and(|target| self.shows(&target, probe)),
            clearance_mm: if entered { Some(0.0) } else { clearance_mm },
        }
    }

    fn shows(&self, [rest, now]: &[Point3<f64>; 2], probe: &Isometry3<f64>) -> bool {
        let seen = probe.inverse_transform_point(now);
        let Some((line, sample)) = self.grid.as_ref().and_then(|grid| grid.to_beam(seen.x, seen.y)) else {
            return false;
        };
        seen.z.abs() <= self.reach_mm && self.loss_db(rest, probe, line, sample) < HIDDEN_DB
    }

    /// Two-way loss along a scanline down to a sample, dB, through the anatomy at rest as seen from the probe.
    fn loss_db(&self, point: &Point3<f64>, probe: &Isometry3<f64>, line: f64, sample: f64) -> f64 {
        let (Some(grid), scene) = (&self.grid, &self.scenario.scene) else {
            return 0.0;
        };
        let shadow = scene.settings.effects.shadow.clone().unwrap_or(Shadow {
            attenuation: false,
            occlusion: false,
            ..Shadow::default()
        });
        let [x, y] = grid.to_plane(line, 0.0);
        let start = probe.transform_point(&Point3::new(x, y, 0.0));
        let [x, y] = grid.to_plane(line, sample);
        // The scanline in the anatomy at rest ends at the target.
        let ray = probe.transform_point(&Point3::new(x, y, 0.0)) - start;
        let start = point - ray;
        let steps = (ray.norm() / RAY_MM).ceil().max(1.0);
        let volume = &scene.anatomy.volume;
        let lost = |step: usize| {
            let point = start + ray * ((step as f64 + 0.5) / steps);
            let label = volume.label_index_at(&point);
            label.map_or(0.0, |label| {
                let tissue = scene.anatomy.tissues.tissue(label);
                shadow
                    .db_per_mm(tissue, scene.settings.probe.frequency_mhz)
                    .iter()
                    .sum()
            })
        };
        (0..steps as usize).map(lost).sum::<f64>() * ray.norm() / steps
    }
}

/// Distances from critical structures around some points.
pub struct Critical {
    grid: Grid,
    /// First voxel of the grid in the volume.
    origin: [usize; 3],
    world_to_index: Matrix4<f64>,
    half_mm: f64,
}

impl Critical {
    /// Distances within [`MARGIN_MM`] of the points; `None` if no critical structure is near.
    pub(crate) fn around(scenario: &Scenario, points: &[Point3<f64>]) -> Option<Self> {
        let volume = &scenario.scene.anatomy.volume;
        let is_critical = |value: i64| {
            let known =
                |(region, interaction): &&(i32, Interaction)| i64::from(*region) == value && interaction.critical;
            scenario.interactions.iter().any(|interaction| known(&interaction))
        };
        let critical: Vec<bool> = volume.labels().iter().map(|label| is_critical(label.value)).collect();
        if !critical.contains(&true) {
            return None;
        }
        let spacing = volume.spacing_mm();
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for point in points {
            let index = volume.world_to_index().transform_point(point);
            for axis in 0..3 {
                let margin = MARGIN_MM / spacing[axis];
                low[axis] = low[axis].min(index[axis] - margin);
                high[axis] = high[axis].max(index[axis] + margin);
            }
        }
        // A grid of the whole volume would take long, and distances beyond the margin are not used.
        let origin = low.map(|index| index.floor().max(0.0) as usize);
        let size = [0, 1, 2].map(|axis| {
            let end = (high[axis].ceil() + 1.0).clamp(0.0, volume.size()[axis] as f64) as usize;
            end.saturating_sub(origin[axis])
        });
        if size.contains(&0) {
            return None;
        }
        let mut set = Vec::with_capacity(size.iter().product());
        for k in 0..size[2] {
            for j in 0..size[1] {
                for i in 0..size[0] {
                    let voxel = volume.offset([origin[0] + i, origin[1] + j, origin[2] + k]);
                    set.push(critical[usize::from(volume.voxels()[voxel])]);
                }
            }
        }
        set.contains(&true).then(|| Self {
            grid: Grid::squared_distances(&set, size, spacing, &[0, 1, 2]),
            origin,
            world_to_index: *volume.world_to_index(),
            // Distances are between centres of voxels, and the surface is half a voxel before the centre.
            half_mm: spacing.iter().copied().fold(f64::INFINITY, f64::min) / 2.0,
        })
    }

    /// Distance of a point at rest from the nearest critical voxel, mm, 0 only within one; `None` outside the grid.
    pub(crate) fn distance(&self, point: &Point3<f64>) -> Option<f64> {
        let index = self.world_to_index.transform_point(point);
        let mut offset = 0;
        for axis in (0..3).rev() {
            let cell = index[axis].round() - self.origin[axis] as f64;
            if !(0.0..self.grid.size[axis] as f64).contains(&cell) {
                return None;
            }
            offset = offset * self.grid.size[axis] + cell as usize;
        }
        let distance = f64::from(self.grid.values[offset]).sqrt();
        Some((distance - self.half_mm).max(0.0))
    }
}
