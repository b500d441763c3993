//! Outcome of a step: forces, state of the needle, and events.

use nalgebra::{Isometry3, Point3, Vector3};
use serde::{Deserialize, Serialize};

/// A force and a torque about a point.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Wrench {
    /// Force, N, world axes.
    pub force_n: Vector3<f64>,
    /// Torque, N mm, world axes.
    pub torque_nmm: Vector3<f64>,
}

impl Wrench {
    /// Adds a force at a point, with its torque about `about`.
    pub fn add(&mut self, force_n: Vector3<f64>, at: &Point3<f64>, about: &Point3<f64>) {
        self.force_n += force_n;
        self.torque_nmm += (at - about).cross(&force_n);
    }

    /// Returns the wrench in the axes of a frame (to world).
    pub fn in_frame(&self, frame: &Isometry3<f64>) -> Wrench {
        Wrench {
            force_n: frame.rotation.inverse_transform_vector(&self.force_n),
            torque_nmm: frame.rotation.inverse_transform_vector(&self.torque_nmm),
        }
    }
}

/// Outcome of a step.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// Wrench of the needle on the hand at its base, about the base: as the needle is pushed in, the force points out
    /// of the body.
    pub on_hand: Wrench,
    /// Wrench of the tissue on the probe, about the probe's origin.
    pub on_probe: Option<Wrench>,
    /// Position of the tip, mm.
    pub tip_mm: Point3<f64>,
    /// Position of the tissue at the tip at rest, mm; `None` outside.
    pub tip_at_rest_mm: Option<Point3<f64>>,
    /// Distance of the tip from that of the measured needle, mm: straight from its base, bevel included, unloaded. At
    /// bone, that of a rigid needle counts from where it was stopped; that of a flexible needle grows as the hand moves
    /// on.
    pub tip_deflection_mm: f64,
    /// Length of the needle in the tissue, mm: 0 outside.
    pub inserted_mm: f64,
    /// Number of needle contacts.
    pub contacts: usize,
    /// Number of needle contacts that stick.
    pub stuck: usize,
    /// Number of nodes in contact with the probe.
    pub probe_contacts: usize,
    /// Number of nodes moved to the tip, or back, in this step.
    pub remeshes: usize,
    /// Number of substeps.
    pub substeps: usize,
    /// Iterations over contact states and needle shape, summed over all substeps.
    pub iterations: usize,
    /// Whether the last iteration changed less than the tolerance, in every substep.
    pub converged: bool,
    /// Number of inverted elements found around the needle: tissue is crushed there. [`Tissue`](super::Tissue) counts
    /// those of the entire mesh.
    pub crushed: usize,
    /// Events of the step.
    pub events: Vec<Event>,
}

impl Outcome {
    /// Resets the counts and events of the last step.
    pub(super) fn begin(&mut self) {
        self.remeshes = 0;
        self.substeps = 0;
        self.iterations = 0;
        self.converged = true;
        self.crushed = 0;
        self.events.clear();
    }
}

/// An event in a step.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Event {
    /// Kind of event.
    pub kind: EventKind,
    /// Simulated time at the end of the step, s.
    pub time_s: f64,
    /// Position, mm.
    pub at_mm: Point3<f64>,
    /// Region met, entered or left, if the event concerns one.
    pub region: Option<i32>,
}

/// Kinds of events.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum EventKind {
    /// The tip touches the surface of the body.
    Skin,
    /// The tip breaks through a surface: the skin, a capsule, a vessel wall.
    Puncture,
    /// The tip enters another region.
    Region,
    /// The tip meets bone.
    Bone,
    /// The tip enters a region that must not be hit.
    Critical,
    /// The tip has left the body, withdrawn or on another side.
    Out,
    /// A seed is left at the tip.
    Seed,
    /// The mesh could not follow the tip: no node could be moved there without spoiling an element. The needle
    /// continues with the contacts before and after.
    NotRemeshed,
    /// The step has not converged.
    NotConverged,
    /// Elements are inverted.
    Crushed,
    /// The device that held the compliance has failed, and the CPU continues.
    DeviceLost,
}

impl EventKind {
    /// Returns the name used in reports.
    pub fn name(self) -> &'static str {
        match self {
            EventKind::Skin => "surface",
            EventKind::Puncture => "puncture",
            EventKind::Region => "region",
            EventKind::Bone => "bone",
            EventKind::Critical => "critical",
            EventKind::Out => "out",
            EventKind::Seed => "seed",
            EventKind::NotRemeshed => "not-remeshed",
            EventKind::NotConverged => "not-converged",
            EventKind::Crushed => "crushed",
            EventKind::DeviceLost => "device-lost",
        }
    }
}
