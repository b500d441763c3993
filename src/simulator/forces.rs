//! Forces on the hands, and their blending after a late step.

use std::time::Duration;

use nalgebra::Vector3;

use super::{Policy, TwoPoints};
use insonify_mechanics::insertion::{Instruments, Outcome, Wrench};

/// Forces on the hands after a step.
///
/// Forces are those of the instruments on the hands, to be rendered by a haptic device without change: as the needle is
/// pushed into tissue, the hand feels a force out of the body, against the base frame's z axis. Torques are about the
/// origin of the instrument's own frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Forces {
    /// Wrench of the needle on the hand at its base, about the base, world axes.
    pub hand_world: Wrench,
    /// Wrench of the needle on the hand at its base, about the base, in the axes of the base frame of this step.
    pub hand_base: Wrench,
    /// Wrench of the tissue on the probe, about the probe's origin, world axes; `None` if no probe presses.
    pub probe_world: Option<Wrench>,
    /// Forces at each of the points of [`SimulatorOptions::probe_points`](super::SimulatorOptions::probe_points) that
    /// are equivalent to `probe_world`, N, world axes; `None` without points or if no probe presses.
    pub probe_points: Option<[Vector3<f64>; 2]>,
    /// Duration of the step.
    pub took: Duration,
    /// Excess of the duration over the budget, if any.
    pub overrun: Option<Duration>,
}

impl Forces {
    /// Returns the force on the hand along the needle, N, for a device that renders only this axis: negative while the
    /// needle is pushed in.
    pub fn axial_n(&self) -> f64 {
        self.hand_base.force_n.z
    }
}

/// Wrenches returned by a step.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Wrenches {
    hand: Wrench,
    probe: Option<Wrench>,
}

impl Wrenches {
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

/// Blend from the forces returned last to those of the model.
#[derive(Clone, Debug, Default)]
pub(super) struct Easing {
    returned: Wrenches,
    /// Remaining simulated time of the blend, s.
    left_s: f64,
}

impl Easing {
    /// Returns the forces after a step of `dt_s`.
    pub(super) fn next(&mut self, computed: Wrenches, dt_s: f64, late: bool, policy: Policy) -> Wrenches {
        if let (Policy::Ease { over }, true) = (policy, late) {
            self.left_s = over.as_secs_f64();
        }
        self.returned = if dt_s < self.left_s {
            let share = dt_s / self.left_s;
            self.left_s -= dt_s;
            Wrenches {
                hand: between(&self.returned.hand, &computed.hand, share),
                probe: computed
                    .probe
                    .map(|probe| between(&self.returned.probe.unwrap_or_default(), &probe, share)),
            }
        } else {
            self.left_s = 0.0;
            computed
        };
        self.returned
    }
}

fn between(from: &Wrench, to: &Wrench, share: f64) -> Wrench {
    Wrench {
        force_n: from.force_n.lerp(&to.force_n, share),
        torque_nmm: from.torque_nmm.lerp(&to.torque_nmm, share),
    }
}
