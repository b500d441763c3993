//! Motion of the tip: pushing, cutting, sliding in its channel, or held.

use serde::{Deserialize, Serialize};

use super::{Phase, Pushing};
use crate::tissue::nonlinear::Contact;

/// Travel that counts as rest, mm.
const STILL_MM: f64 = 1e-9;

/// Bisections to locate the tip, to rounding.
const HALVINGS: usize = 60;

/// State of the needle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::insertion) struct At {
    pub phase: Phase,
    /// Position of the tip beyond the entry, mm.
    pub travel_mm: f64,
    /// Depth of the tip in the tissue, in the reference state, mm.
    pub depth_mm: f64,
    /// Largest depth reached so far, mm.
    pub cut_mm: f64,
    /// Largest depth reached when the needle last slid out, mm.
    #[serde(default)]
    pub channel_mm: f64,
    /// Phase of the tip where tissue is intact: at `cut_mm`.
    #[serde(rename = "whole")]
    pub intact: Phase,
    /// Whether the shaft slides out.
    pub outward: bool,
    /// Force of the tip against the direction of insertion, N.
    pub tip_n: f64,
    pub shaft_n: f64,
    /// Force of the tip when the needle stopped, N.
    pub held_tip_n: f64,
}

impl At {
    /// State before the first membrane.
    pub(crate) fn before() -> At {
        At {
            intact: Phase::Pushing(0),
            ..At::default()
        }
    }

    /// Returns the length behind the tip that was cut since the needle last slid out, mm; 0 while it slides out, or its
    /// tip is out of the body.
    pub(super) fn newly_cut_mm(&self) -> f64 {
        if self.outward || self.intact == Phase::Free {
            0.0
        } else {
            (self.depth_mm - self.channel_mm).max(0.0)
        }
    }

    /// Returns whether the hand pulls at a held needle.
    fn is_pulled(&self) -> bool {
        self.phase == Phase::Held && self.tip_n + self.shaft_n <= 0.0
    }
}

impl<const D: usize, const N: usize> Pushing<D, N> {
    /// Returns the next state of the needle, with its tip at `travel_mm` and the current displacements.
    pub(super) fn advance(&self, travel_mm: f64) -> At {
        let now = &self.state;
        let mut next = At { travel_mm, ..*now };
        let moved = travel_mm - now.travel_mm;
        let in_tissue = now.depth_mm > 0.0 || matches!(now.phase, Phase::Cutting(_));
        let goes_on = if now.outward { -moved } else { moved } > STILL_MM;
        if in_tissue && !goes_on && now.phase != Phase::Held {
            if now.tip_n + now.shaft_n.abs() > 0.0 {
                next.phase = Phase::Held;
                next.held_tip_n = now.tip_n;
            } else if moved.abs() > STILL_MM {
                // No friction holds it.
                next.phase = Phase::Free;
                next.outward = moved < 0.0;
            }
        }
        match next.phase {
            Phase::Free if next.depth_mm == 0.0 && !next.outward => {
                if self.place(0.0) < travel_mm && self.line.length() > 0.0 {
                    self.slide_in(&mut next);
                }
            }
            Phase::Free if next.outward => self.slide_out(&mut next),
            Phase::Free => self.slide_in(&mut next),
            Phase::Cutting(layer) => self.cut(&mut next, layer),
            Phase::Pushing(_) | Phase::Held => {}
        }
        next
    }

    /// Returns the current position of the tissue of a depth, mm beyond the entry.
    pub(super) fn place(&self, depth: f64) -> f64 {
        depth + self.along(depth)
    }

    /// Returns the depth whose tissue is at the tip, between two.
    pub(super) fn depth_at(&self, travel_mm: f64, [mut low, mut high]: [f64; 2]) -> f64 {
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if self.place(middle) < travel_mm {
                low = middle;
            } else {
                high = middle;
            }
        }
        low
    }

    /// Advances through the channel, at most to intact tissue.
    fn slide_in(&self, next: &mut At) {
        if next.cut_mm == 0.0 || self.place(next.cut_mm) <= next.travel_mm {
            (next.phase, next.depth_mm) = (next.intact, next.cut_mm);
        } else {
            next.depth_mm = self.depth_at(next.travel_mm, [next.depth_mm, next.cut_mm]);
        }
    }

    /// Withdraws through the channel, and out of it.
    fn slide_out(&self, next: &mut At) {
        next.channel_mm = next.cut_mm;
        if self.place(0.0) >= next.travel_mm {
            (next.depth_mm, next.outward) = (0.0, false);
        } else {
            next.depth_mm = self.depth_at(next.travel_mm, [0.0, next.depth_mm]);
        }
    }

    /// Advances through intact tissue, to the next layer or the far side.
    fn cut(&self, next: &mut At, layer: usize) {
        let below = self.layers.get(layer + 1).map_or(f64::INFINITY, |layer| layer.from_mm);
        let end = below.min(self.line.length());
        if self.place(end) > next.travel_mm {
            // Cut tissue stays cut: the tip is not above where it was.
            next.depth_mm = self.depth_at(next.travel_mm, [next.depth_mm, end]);
        } else {
            next.depth_mm = end;
            next.phase = if end < below {
                Phase::Free
            } else if self.layers[layer + 1].membrane_n > 0.0 {
                Phase::Pushing(layer + 1)
            } else {
                Phase::Cutting(layer + 1)
            };
        }
        (next.cut_mm, next.intact) = (next.depth_mm, next.phase);
    }

    /// Returns the sliding and the static friction summed over the shaft, N.
    fn friction_n(&self, depth_mm: f64, cut_mm: f64) -> [f64; 2] {
        self.frictions(depth_mm, cut_mm)
            .fold([0.0; 2], |[sum, held], (_, force, limit)| [sum + force, held + limit])
    }

    /// Returns the length behind the tip of a held needle that bears the density of the peak, mm.
    fn held_cut_mm(&self, next: &At) -> f64 {
        if self.state.is_pulled() {
            0.0
        } else {
            next.newly_cut_mm()
        }
    }

    /// Returns the force of the tip in a held needle, as it was when the needle stopped; a needle does not pull with
    /// its tip.
    fn held_tip(&self, next: &At) -> f64 {
        if self.state.is_pulled() {
            0.0
        } else {
            next.held_tip_n.max(0.0)
        }
    }

    /// Constrains all tissue that the needle holds, as one: the mean of its displacements, weighted by shares of the
    /// force, moves with the needle, by `moved` mm.
    pub(super) fn held(&self, next: &At, moved: f64) -> Contact {
        let tip = self.held_tip(next);
        let cut_mm = self.held_cut_mm(next);
        let [friction, _] = self.friction_n(next.depth_mm, cut_mm);
        let scale = 1.0 / (tip + friction);
        let tip = (self.line.tip(self.body(), next.depth_mm, 0.0), tip);
        let shaft = self
            .frictions(next.depth_mm, cut_mm)
            .map(|(point, force, _)| (point, force));
        let mut contact = Contact::default();
        for (point, force) in shaft.chain([(&tip.0, tip.1)]).filter(|(_, force)| *force > 0.0) {
            let shares = point.weights.iter().map(|&(dof, weight)| (dof, weight * force * scale));
            contact.weights.extend(shares);
        }
        contact.place_mm = contact.along(self.structure.displacement()) + moved;
        contact
    }

    /// Distributes the force of a held needle between tip and shaft, and lets it slide if the friction is exceeded.
    pub(super) fn share(&self, next: &mut At) {
        let force = self.structure.contact_force();
        let tip = self.held_tip(next);
        let [friction, _] = self.friction_n(next.depth_mm, self.held_cut_mm(next));
        let [inward_n, outward_n] = [next.newly_cut_mm(), 0.0].map(|cut_mm| self.friction_n(next.depth_mm, cut_mm)[1]);
        next.tip_n = force * tip / (tip + friction);
        next.shaft_n = force - next.tip_n;
        if force >= next.held_tip_n + inward_n && next.travel_mm > self.state.travel_mm + STILL_MM {
            let intact = next.depth_mm >= next.cut_mm;
            next.phase = if intact { next.intact } else { Phase::Free };
            next.outward = false;
        } else if force <= -outward_n {
            (next.phase, next.outward, next.channel_mm) = (Phase::Free, true, next.cut_mm);
            next.depth_mm = self.depth_at(next.travel_mm, [0.0, next.depth_mm]);
        }
    }
}
