//! Forces for the hands, and how they go on after a late step.

use std::time::Duration;

use nalgebra::Vector3;

use super::{Policy, TwoPoints};
use crate::mechanics::insertion::{Instruments, Outcome, Wrench};

/// What a step gives to the hands.
///
/// Forces are those that the instruments put on the hands that hold them, to be rendered by a haptic device as they
/// are: pushing the needle into tissue, the hand feels a force out of the body, against the base frame's z axis.
/// Torques are about the origin of the instrument's own frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Forces {
    /// What the needle does to the hand at its base, about the base, world axes.
    pub hand_world: Wrench,
    /// The same in the axes of the base frame of this step.
    pub hand_base: Wrench,
    /// What the tissue does to the probe, about the probe's origin, world axes; none if no probe presses.
    pub probe_world: Option<Wrench>,
    /// The force of that at each of the points of [`Options::probe_points`](super::Options::probe_points), N, world axes; none
    /// without them or if no probe presses.
    pub probe_points: Option<[Vector3<f64>; 2]>,
    /// Time that the step took.
    pub took: Duration,
    /// By how much that was over the budget, if it was.
    pub overrun: Option<Duration>,
}

impl Forces {
    /// The force on the hand along the needle, N, for a device that renders this axis alone: negative while it is pushed in.
    pub fn axial_n(&self) -> f64 {
        self.hand_base.force_n.z
    }
}

/// The wrenches that a step gives.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Given {
    hand: Wrench,
    probe: Option<Wrench>,
}

impl Given {
    pub(super) fn of(outcome: &Outcome) -> Self {
        Self {
            hand: outcome.on_hand,
            probe: outcome.on_probe,
        }
    }

    pub(super) fn forces(
        &self,
        instruments: &Instruments,
        points: Option<TwoPoints>,
        took: Duration,
        overrun: Option<Duration>,
    ) -> Forces {
        let pressing = points.zip(self.probe).zip(instruments.probe);
        Forces {
            hand_world: self.hand,
            hand_base: self.hand.in_frame(&instruments.base),
            probe_world: self.probe,
            probe_points: pressing.map(|((points, wrench), pose)| points.split(&wrench, &pose)),
            took,
            overrun,
        }
    }
}

/// Forces on their way from what was given to what the model says.
#[derive(Clone, Debug, Default)]
pub(super) struct Easing {
    given: Given,
    /// Simulated time until they are there, s.
    left_s: f64,
}

impl Easing {
    /// What is given after a step of `dt_s`.
    pub(super) fn next(&mut self, computed: Given, dt_s: f64, late: bool, policy: Policy) -> Given {
        if let (Policy::Ease { over }, true) = (policy, late) {
            self.left_s = over.as_secs_f64();
        }
        self.given = if dt_s < self.left_s {
            let share = dt_s / self.left_s;
            self.left_s -= dt_s;
            Given {
                hand: between(&self.given.hand, &computed.hand, share),
                probe: computed
                    .probe
                    .map(|probe| between(&self.given.probe.unwrap_or_default(), &probe, share)),
            }
        } else {
            self.left_s = 0.0;
            computed
        };
        self.given
    }
}

fn between(from: &Wrench, to: &Wrench, share: f64) -> Wrench {
    Wrench {
        force_n: from.force_n.lerp(&to.force_n, share),
        torque_nmm: from.torque_nmm.lerp(&to.torque_nmm, share),
    }
}
