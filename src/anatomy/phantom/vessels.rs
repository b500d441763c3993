//! Branching vessels grown inside an organ: each branch steers away from the surface and from other branches.
//!
//! Radii at a fork follow Murray's law, r0^3 = r1^3 + r2^3 (C. D. Murray, "The physiological principle of minimum
//! work", PNAS 12, 1926).

use super::geometry::{Point, Shape, Tube, frame};
use insonify_base::random::noise::choice;

/// Growth conditions of a tree.
pub(super) struct Growth<'a> {
    /// Signed distance of the organ (negative inside), mm.
    pub(super) organ: &'a dyn Fn(&Point) -> f64,
    /// Tubes and balls to be avoided.
    pub(super) avoid: &'a [Tube],
    /// Radius below which branches end, mm.
    pub(super) thinnest_mm: f64,
    /// Seed of the phantom.
    pub(super) seed: u64,
    /// Number of this tree.
    pub(super) stream: u32,
}

/// The growing end of a branch.
struct Tip {
    at: Point,
    along: Point,
    radius: f64,
    id: i32,
}

/// Maximum angle between a branch and its parent, in the order tried, radians.
const SPREADS_RAD: [f64; 3] = [0.45, 0.8, 1.3];
/// Number of directions tried for each segment of a branch.
const TRIES: i32 = 12;
/// Fraction of the cube of the radius that the larger branch of a fork takes: from this value to 0.2 more.
const LARGER_SHARE: f64 = 0.52;
/// Maximum number of segments of one tree.
const MAX_PIECES: usize = 600;

impl Growth<'_> {
    /// Grows a tree from the end of a trunk: every branch begins inside its parent.
    pub(super) fn from(&self, trunk: &Tube) -> Vec<Tube> {
        let mut pieces = Vec::new();
        let mut tips = std::collections::VecDeque::from([Tip {
            at: trunk.ends[1],
            along: (trunk.ends[1] - trunk.ends[0]).normalize(),
            radius: trunk.radii[1],
            id: 1,
        }]);
        while let Some(tip) = tips.pop_front() {
            if pieces.len() >= MAX_PIECES {
                break;
            }
            let segment = SPREADS_RAD
                .iter()
                .enumerate()
                .find_map(|(part, &spread)| self.piece(&tip, part as i32, spread, &pieces));
            let Some(first) = segment else {
                continue;
            };
            pieces.push(first);
            let middle = Tip {
                at: first.ends[1],
                along: (first.ends[1] - first.ends[0]).normalize(),
                radius: first.radii[1],
                id: tip.id,
            };
            self.fork(&middle, &mut tips);
        }
        pieces
    }

    fn fork(&self, tip: &Tip, tips: &mut std::collections::VecDeque<Tip>) {
        let share = LARGER_SHARE + 0.2 * choice(self.seed, self.stream, [tip.id, 90]);
        let turn = std::f64::consts::TAU * choice(self.seed, self.stream, [tip.id, 91]);
        let [_, u, v] = frame(tip.along, off_axis(&tip.along));
        let side = u * turn.cos() + v * turn.sin();
        for (child, (cubes, angle)) in [(share, 0.38), (1.0 - share, -0.72f64)].into_iter().enumerate() {
            let radius = tip.radius * cubes.cbrt();
            if radius < self.thinnest_mm {
                continue;
            }
            tips.push_back(Tip {
                at: tip.at,
                along: tip.along * angle.cos() + side * angle.sin(),
                radius,
                id: tip.id.wrapping_mul(2).wrapping_add(child as i32),
            });
        }
    }

    /// Best of several segments from a tip, if any stays inside the organ.
    fn piece(&self, tip: &Tip, part: i32, spread: f64, grown: &[Tube]) -> Option<Tube> {
        let radius = tip.radius;
        let [_, u, v] = frame(tip.along, off_axis(&tip.along));
        let mut best: Option<(f64, Tube)> = None;
        for attempt in 0..TRIES {
            let draw = |which: i32| choice(self.seed, self.stream, [tip.id, which + 4 * (attempt + 16 * part)]);
            let turn = std::f64::consts::TAU * draw(0);
            // The root spreads directions evenly over the cone; a uniform angle would crowd them at its axis.
            let lean = spread * draw(1).sqrt();
            let along = tip.along * lean.cos() + (u * turn.cos() + v * turn.sin()) * lean.sin();
            let length = (radius * 4.2).clamp(9.0, 22.0) * (0.7 + 0.6 * draw(2));
            let end = tip.at + along * length;
            let margin = -(self.organ)(&end) - radius;
            if margin < 2.0 {
                continue;
            }
            let clearance = self.avoid.iter().fold(30.0, |least: f64, tube| {
                least
                    .min(tube.distance(&end))
                    .min(tube.distance(&(tip.at + along * (0.6 * length))))
            }) - radius;
            let crowding = grown
                .iter()
                .fold(30.0, |least: f64, tube| least.min((tube.ends[1] - end).norm()));
            if clearance < 1.5 {
                continue;
            }
            // Room counts up to these limits only: beyond them a straighter branch is better.
            let score = margin.min(14.0) + clearance.min(8.0) + crowding.min(16.0) - 8.0 * lean;
            if best.as_ref().is_none_or(|(best_score, _)| score > *best_score) {
                let tube = Tube {
                    ends: [tip.at, end],
                    radii: [radius, 0.94 * radius],
                };
                best = Some((score, tube));
            }
        }
        best.map(|(_, tube)| tube)
    }
}

/// A direction not parallel to the given one.
fn off_axis(along: &Point) -> Point {
    if along.z.abs() < 0.8 { Point::z() } else { Point::x() }
}
