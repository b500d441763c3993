//! Insertion of a straight needle into tissue that stiffens with strain and may creep: it pushes, punctures and cuts.
//!
//! The tissue is that of Y. Kobayashi et al., "Development of an integrated needle insertion system with image guidance
//! and deformation simulation", Computerized Medical Imaging and Graphics 34, 2010 ([`crate::tissue::nonlinear`]), over
//! tetrahedra; the needle is that of [`pushing`](super::pushing), and quasi-static. The mesh is not remeshed: the force
//! at the tip acts on the corners of the element around it, so that the displacement of the tissue there depends on the
//! element size.
//!
//! The needle is rigid and moves along its axis while it is in tissue; sideways motion is refused then. Outside it
//! moves freely, and enters the next time along another line, through intact tissue. The layers along a line follow
//! from the regions of its elements: each begins with a membrane that bears the `puncture_n` of its region (or
//! `cutting_n`, if that is more).
//!
//! A step is cut into substeps, in each of which the tip advances by at most [`NonlinearOptions::part_mm`] in tissue. A
//! substep that cannot be solved is bisected; where that does not help either, the tissue lags behind until the next
//! step, which is reported.

mod frame;
mod needle_line;
mod saved;
mod setup;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use nalgebra::{Isometry3, Point3, Unit, Vector3};

use super::imager::MeshImager;
use super::interaction::interaction;
use super::pushing::{Phase, Pushing};
use super::{
    Anatomy, Event, EventKind, Field, Instruments, Model, NodeSolver, Outcome, Saved, ShaftLoad, Snapshot, StepError,
    Wrench,
};
use crate::needle::{CentreLine, Shaft};
use crate::tissue::nonlinear::Structure;
use frame::Frame;
use insonify_mesh::TetMesh;
use needle_line::NeedleLine;
pub use needle_line::{in_body, obstacle};
pub use setup::{NonlinearOptions, NonlinearSetup, Plane, Viscosity};

/// Maximum distance of a needle from its line of insertion, mm: rounding of poses, and hands that are nearly still.
const BESIDE_MM: f64 = 0.05;

/// Maximum number of bisections of a substep that cannot be solved.
const HALVINGS: u32 = 6;

/// Model of a straight needle in stiffening tissue, in three dimensions or in a plane (see [`NonlinearSetup`]).
/// ```
/// use std::sync::Arc;
///
/// use insonify_mechanics::insertion::nonlinear::{Nonlinear, NonlinearOptions, NonlinearSetup};
/// use insonify_mechanics::insertion::{Instruments, Interaction, Model};
/// use insonify_mechanics::needle::Shaft;
/// use insonify_mechanics::tissue::law::Stiffening;
/// use insonify_mechanics::tissue::material::Material;
/// use insonify_mesh::TetMesh;
/// use nalgebra::Isometry3;
///
/// let mesh = TetMesh::over_box([-15.0, -15.0, 0.0], [15.0, 15.0, 20.0], 200)?;
/// let law = Stiffening::new(Material::new(3.0, 0.4)?, 0.3, 10.0)?;
/// let bottom = (0..).zip(mesh.nodes()).filter(|(_, node)| node[2] == 20.0);
/// let fixed = bottom.flat_map(|(node, _)| [0, 1, 2].map(|axis| (node, axis))).collect();
/// let shaft = Shaft { length_mm: 60.0, radius_mm: 0.5 };
/// let tissue = Interaction { cutting_n: 0.01, puncture_n: 0.05, ..Interaction::default() };
/// let mut model = Nonlinear::new(NonlinearSetup {
///     laws: vec![law.into(); mesh.elements().len()],
///     interactions: mesh.regions().iter().take(1).map(|region| (*region, tissue)).collect(),
///     mesh: Arc::new(mesh),
///     fixed,
///     anatomy: None,
///     shaft,
///     patch_mm: 1.0,
///     viscosity: None,
///     stress: false,
///     options: NonlinearOptions::default(),
/// })?;
/// let mut largest_n = 0.0_f64;
/// for step in 0..16 {
///     let base = Isometry3::translation(0.7, 0.3, 0.5 * f64::from(step) - shaft.length_mm);
///     let instruments = Instruments { base, probe: None, guide: None, deposit: false };
///     let outcome = model.step(&instruments, 0.05)?;
///     assert!(outcome.converged);
///     largest_n = largest_n.max(outcome.on_hand.force_n.norm());
/// }
/// // The surface gave way at 0.05 N, to within the advance in a substep; the tip cuts on with 0.01 N.
/// assert!(largest_n > 0.05);
/// assert!((model.outcome().on_hand.force_n.norm() - 0.01).abs() < 1e-4);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Nonlinear<const D: usize = 3, const N: usize = 4> {
    /// The tissue at rest; of a plane, a slab with its nodes once on each face.
    mesh: Arc<TetMesh>,
    frame: Frame<D>,
    anatomy: Arc<dyn Anatomy>,
    shaft: Shaft,
    options: NonlinearOptions,
    /// Fingerprint of all fixed inputs of the model, to recognise saved states of others.
    name: String,
    needle: Pushing<D, N>,
    /// Line of the needle with its layers, once found.
    axis: Option<NeedleLine>,
    steps: u64,
    time_s: f64,
    /// Time by which the tissue lags behind, s.
    behind_s: f64,
    /// Last position of the tip beyond the entry, mm.
    travel_mm: f64,
    /// Region of the tip.
    region: Option<i32>,
    line: CentreLine,
    seeds: Vec<Point3<f64>>,
    outcome: Outcome,
}

impl<const D: usize, const N: usize> Nonlinear<D, N> {
    /// Returns the position of the tip beyond the entry on its line, which is renewed while the needle is outside.
    fn on_line(&mut self, base: &Isometry3<f64>) -> Result<f64, StepError> {
        let tip = base * Point3::new(0.0, 0.0, self.shaft.length_mm);
        let direction = base.rotation * Vector3::z_axis();
        let aside = self
            .frame
            .aside_mm(&tip)
            .max(self.frame.aside_mm(&base.translation.vector.into()));
        if aside > BESIDE_MM {
            return Err(StepError::Input {
                what: "the needle's distance (mm) from the plane of the tissue",
                found: aside,
                expected: "at most 0.05: this model is of a plane",
            });
        }
        if let Some(axis) = &self.axis {
            let hub = Point3::from(base.translation.vector);
            let beside = axis.beside_mm(&tip).max(axis.beside_mm(&hub));
            // For a needle that may start on a new line, only rounding counts as being on it.
            let tolerance_mm = if self.needle.is_outside() { 1e-9 } else { BESIDE_MM };
            if beside <= tolerance_mm && axis.direction.dot(&direction) > 0.0 {
                return Ok(axis.travel_mm(&tip));
            }
            if !self.needle.is_outside() {
                return Err(StepError::Input {
                    what: "the needle's distance (mm) from the line that it went into the tissue along",
                    found: beside,
                    expected: "at most 0.05 until it is out: this model does not support lateral motion",
                });
            }
        }
        self.aim(&tip, &direction);
        let axis = self.axis.as_ref();
        let travel = axis.map_or(0.0, |axis| axis.travel_mm(&tip));
        // A needle first seen in tissue has been pushed in along its axis.
        self.travel_mm = travel.min(0.0);
        Ok(travel)
    }

    /// Finds the line of a needle outside.
    fn aim(&mut self, tip: &Point3<f64>, direction: &Unit<Vector3<f64>>) {
        let body = Arc::clone(self.needle.body());
        self.axis = Some(NeedleLine::find(
            &body,
            &self.frame,
            self.anatomy.as_ref(),
            tip,
            direction,
        ));
        self.take_axis();
    }

    /// Aims the needle along its line.
    fn take_axis(&mut self) {
        let anatomy = self.anatomy.as_ref();
        let interaction_of = |region: i32| interaction(anatomy, Some(region));
        let axis = self.axis.as_ref().filter(|axis| !axis.regions.is_empty());
        let aimed = axis.map(|axis| {
            let (entry, direction) = (self.frame.point(&axis.entry), self.frame.vector(&axis.direction));
            self.needle.aim(entry, direction, axis.layers(interaction_of))
        });
        if aimed.is_none_or(|aimed| aimed.is_err()) {
            self.needle.withdraw();
        }
    }

    /// Moves the tip to `travel_mm`, in substeps.
    fn travel(&mut self, travel_mm: f64, dt_s: f64) {
        // Outside, a needle meets nothing; tissue that bulges there is met within one substep.
        let from = self.travel_mm;
        let [low, high] = [from, travel_mm].map(|travel| travel.max(-self.options.part_mm));
        let parts = ((high - low).abs() / self.options.part_mm).ceil().max(1.0);
        let parts = parts.min(self.options.most_parts as f64) as usize;
        self.outcome.substeps = parts;
        let part_s = dt_s / parts as f64;
        for part in 1..=parts {
            let share = part as f64 / parts as f64;
            let to = if part == parts {
                travel_mm
            } else {
                low + share * (high - low)
            };
            let time = self.behind_s + part_s;
            self.behind_s = self.part(to, time, HALVINGS);
            if self.behind_s > 0.0 {
                self.outcome.converged = false;
                self.behind_s += part_s * (parts - part) as f64;
                break;
            }
        }
        if self.behind_s > 0.0 {
            self.note(EventKind::NotConverged, None);
        }
    }

    /// Makes one substep; returns the time that could not be simulated, s.
    fn part(&mut self, to_mm: f64, time_s: f64, halvings: u32) -> f64 {
        let (was_outside, was_through) = (self.needle.is_outside(), self.needle.is_through());
        let was_inside = self.needle.depth_mm() > 0.0;
        match self.needle.step(to_mm, time_s) {
            Ok(pushed) => {
                self.outcome.iterations += self.needle.structure().solver().progress().iterations;
                self.outcome.stuck = usize::from(pushed.phase == Phase::Held);
                self.set_force(pushed.force_n);
                self.travel_mm = to_mm;
                let entry_region = self.entered();
                if was_outside && pushed.phase != Phase::Free {
                    self.note(EventKind::Skin, entry_region);
                }
                if let Some(layer) = pushed.punctured {
                    let region = self.axis.as_ref().and_then(|axis| axis.region(layer));
                    self.note(EventKind::Puncture, region);
                }
                let region = self.tip_region();
                if region != self.region {
                    if region.is_some() && self.region.is_some() {
                        self.note(EventKind::Region, region);
                    }
                    if interaction(self.anatomy.as_ref(), region).critical {
                        self.note(EventKind::Critical, region);
                    }
                    self.region = region;
                }
                let is_through = self.needle.is_through() && !was_through;
                if (was_inside && self.needle.is_outside()) || is_through {
                    self.note(EventKind::Out, None);
                }
                0.0
            }
            Err(_) if halvings > 0 => {
                let middle = 0.5 * (self.travel_mm + to_mm);
                let left = self.part(middle, 0.5 * time_s, halvings - 1);
                // From where the first half failed, the second would be the whole way again: its time is left
                // too.
                if left > 0.0 {
                    return left + 0.5 * time_s;
                }
                self.part(to_mm, 0.5 * time_s, halvings - 1)
            }
            Err(_) => time_s,
        }
    }

    /// Returns the first region on the line.
    fn entered(&self) -> Option<i32> {
        self.axis.as_ref().and_then(|axis| axis.region(0))
    }

    /// Returns the region of the tip, not one whose membrane it still pushes.
    fn tip_region(&self) -> Option<i32> {
        let layer = self.needle.tip_layer()?;
        self.axis.as_ref().and_then(|axis| axis.region(layer))
    }

    /// Places the needle at the pose of the hand.
    fn place(&mut self, base: &Isometry3<f64>) {
        let length = self.shaft.length_mm;
        let tip = base * Point3::new(0.0, 0.0, length);
        self.line.set([(0.0, base.translation.vector.into()), (length, tip)]);
    }

    /// Sets the wrench on the hand from a force against the direction of insertion, N.
    fn set_force(&mut self, force_n: f64) {
        let mut on_hand = Wrench::default();
        let (hub, tip) = (self.line.point_at_arc(0.0), self.line.tip());
        on_hand.add(-force_n * hub.tangent.into_inner(), &tip, &hub.point_mm);
        self.outcome.on_hand = on_hand;
    }

    fn note(&mut self, kind: EventKind, region: Option<i32>) {
        self.outcome.events.push(Event {
            kind,
            time_s: self.time_s,
            at_mm: self.line.tip(),
            region,
        });
    }

    /// Fills in the results known at the end of a step.
    fn conclude(&mut self, instruments: &Instruments, was_crushed: bool) {
        let tip = self.line.tip();
        let depth = self.needle.tip_depth_mm();
        let inside = self.axis.as_ref().filter(|_| depth > 0.0 && !self.needle.is_outside());
        let at_rest = inside.map(|axis| axis.entry + depth * axis.direction.into_inner());
        if let Some(position) = at_rest.filter(|_| instruments.deposit) {
            self.seeds.push(position);
            self.note(EventKind::Seed, self.region);
        }
        self.outcome.crushed = self.crushed();
        if self.outcome.crushed > 0 && !was_crushed {
            self.note(EventKind::Crushed, self.region);
        }
        let pushes = matches!(self.needle.phase(), Phase::Pushing(_));
        self.outcome.tip_mm = tip;
        self.outcome.tip_at_rest_mm = at_rest;
        self.outcome.inserted_mm = depth;
        self.outcome.contacts = self.needle.pieces() + usize::from(pushes);
        self.outcome.stuck *= self.outcome.contacts;
    }

    /// Returns the number of inverted elements on the line of the needle.
    fn crushed(&self) -> usize {
        let (body, displacement) = (self.needle.body(), self.needle.structure().displacement());
        let is_inverted = |element: &&u32| body.is_inverted(**element as usize, displacement);
        self.needle.elements().iter().filter(is_inverted).count()
    }
}

impl<const D: usize, const N: usize> Model for Nonlinear<D, N> {
    fn step(&mut self, instruments: &Instruments, dt_s: f64) -> Result<&Outcome, StepError> {
        let base = &instruments.base;
        instruments.check(dt_s)?;
        let travel_mm = self.on_line(base)?;
        self.steps += 1;
        self.time_s += dt_s;
        let was_crushed = self.outcome.crushed > 0;
        self.outcome.begin();
        self.place(base);
        self.travel(travel_mm, dt_s);
        self.conclude(instruments, was_crushed);
        Ok(&self.outcome)
    }

    fn outcome(&self) -> &Outcome {
        &self.outcome
    }

    fn tip_direction(&self) -> Option<Unit<Vector3<f64>>> {
        self.line.direction()
    }

    fn snapshot(&mut self, into: &mut Snapshot) {
        into.step = self.steps;
        into.time_s = self.time_s;
        into.line.clone_from(&self.line);
        into.seeds.clone_from(&self.seeds);
        into.moved.clear();
        let mut field = match std::mem::take(&mut into.field) {
            Field::Displacement(field) => field,
            Field::BaseForces(_) => Vec::new(),
        };
        field.clear();
        let displacement = self.needle.structure().displacement();
        let moved = displacement
            .as_chunks::<D>()
            .0
            .iter()
            .map(|moved| self.frame.in_world(moved));
        while field.len() < self.mesh.nodes().len() {
            field.extend(moved.clone());
        }
        into.field = Field::Displacement(field);
    }

    fn imager(&self) -> Box<dyn NodeSolver> {
        Box::new(MeshImager::new(Arc::clone(&self.mesh), None, None))
    }

    fn stress_kpa(&self) -> Option<&[[[f64; 3]; 3]]> {
        match self.needle.structure() {
            Structure::Elastic(_) => None,
            // Of a section, stress across its plane is not known.
            Structure::Viscous(creep) if D == 3 => {
                let components = creep.stress_kpa()?.as_flattened().as_flattened();
                Some(components.as_chunks::<3>().0.as_chunks::<3>().0)
            }
            Structure::Viscous(_) => None,
        }
    }

    fn shaft_loads(&self, into: &mut Vec<ShaftLoad>) {
        into.clear();
        if self.line.nodes().is_empty() || self.needle.is_outside() {
            return;
        }
        let (length, direction) = (self.line.length_mm(), self.line.point_at_arc(0.0).tangent.into_inner());
        // The shaft passes a place of the line at the arc that is as far behind the tip. The tip follows the tissue by
        // a step.
        let arc = |place_mm: f64| (length + place_mm - self.travel_mm).min(length);
        into.extend(self.needle.shaft().map(|([from, to], force)| ShaftLoad {
            from_mm: arc(from),
            to_mm: arc(to),
            force_n: -force * direction,
        }));
        into.push(ShaftLoad {
            from_mm: length,
            to_mm: length,
            force_n: -self.needle.at().tip_n * direction,
        });
    }

    fn save(&mut self) -> Saved {
        self.save_state()
    }

    fn restore(&mut self, saved: &Saved) -> Result<(), StepError> {
        self.take_saved(saved)
    }
}
