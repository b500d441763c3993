//! What a step answers.

use nalgebra::{Isometry3, Point3, Vector3};

/// A force and a torque about a point.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wrench {
    /// N, world axes.
    pub force_n: Vector3<f64>,
    /// N mm, world axes.
    pub torque_nmm: Vector3<f64>,
}

impl Wrench {
    /// Adds a force at a point, with its torque about `about`.
    pub fn add(&mut self, force_n: Vector3<f64>, at: &Point3<f64>, about: &Point3<f64>) {
        self.force_n += force_n;
        self.torque_nmm += (at - about).cross(&force_n);
    }

    /// The same in the axes of a frame (to world).
    pub fn in_frame(&self, frame: &Isometry3<f64>) -> Wrench {
        Wrench {
            force_n: frame.rotation.inverse_transform_vector(&self.force_n),
            torque_nmm: frame.rotation.inverse_transform_vector(&self.torque_nmm),
        }
    }
}

/// What a step found.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Outcome {
    /// What the needle does to the hand that holds its base, about the base: pushing the needle in, the hand feels a force
    /// out of the body.
    pub on_hand: Wrench,
    /// What the tissue does to the probe, about the probe's origin.
    pub on_probe: Option<Wrench>,
    /// The tip, mm.
    pub tip_mm: Point3<f64>,
    /// Where the tissue at the tip is at rest, mm; none outside.
    pub tip_at_rest_mm: Option<Point3<f64>>,
    /// Distance of the tip from that of the measured needle, mm: straight from its base, bevel included, unloaded. At bone, a rigid
    /// needle's from where it was stopped; that of one that bends grows as the hand goes on.
    pub tip_deflection_mm: f64,
    /// Length of the needle in the tissue, mm: 0 outside.
    pub inserted_mm: f64,
    /// Needle contacts.
    pub contacts: usize,
    /// Those of them that stick.
    pub stuck: usize,
    /// Nodes in contact with the probe.
    pub probe_contacts: usize,
    /// Nodes moved to the tip, or back, in this step.
    pub remeshes: usize,
    /// Parts that the step was cut into.
    pub substeps: usize,
    /// Iterations over states and needle shape, all parts together.
    pub iterations: usize,
    /// Whether the last of them changed less than the tolerance, in every part.
    pub converged: bool,
    /// Inverted elements that the model came upon around the needle: tissue is crushed there. [`Tissue`](super::Tissue) counts those of
    /// the whole mesh.
    pub crushed: usize,
    /// What happened.
    pub events: Vec<Event>,
}

impl Outcome {
    /// Forgets what the last step counted and found.
    pub(super) fn begin(&mut self) {
        self.remeshes = 0;
        self.substeps = 0;
        self.iterations = 0;
        self.converged = true;
        self.crushed = 0;
        self.events.clear();
    }
}

/// Something that happened in a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Event {
    /// What.
    pub kind: EventKind,
    /// Simulated time at the end of the step, s.
    pub time_s: f64,
    /// Where, mm.
    pub at_mm: Point3<f64>,
    /// The region that was met, entered or left, if it is one's.
    pub region: Option<i32>,
}

/// What can happen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
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
    /// The tip has left the body, drawn out or on another side.
    Out,
    /// A seed is left.
    Seed,
    /// The mesh could not follow the tip: no node could be moved there without spoiling an element. The needle goes on, held by the nodes
    /// before and after.
    NotRemeshed,
    /// The step is not converged.
    NotConverged,
    /// Elements are inverted.
    Crushed,
    /// The device that held the compliance has failed, and the processor goes on.
    DeviceLost,
}

impl EventKind {
    /// As reports write it.
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
