//! Error bounds of the geometry: probe pose times a point on a ray.

use crate::parity::rounding::ULP;
use crate::parity::{Slack, Step};

/// Rounding error of one term of a coordinate, in ULP of the term. Along the ray: sample distance stored (1/2) and
/// multiplied (1), ray stored (1/2), product (1) and sum (1): 4. Then matrix stored (1/2), product (1) and three sums
/// (3).
const TERM: f64 = 4.0 + 4.5;

/// Rounding error of the shift that `contact` adds, in ULP of its largest value: direction and matrix stored and
/// multiplied (2), two such summed (1), the gap multiplied (1); its share, a square of a difference from 1 (8); their
/// product (1).
const PRESSED: f64 = 13.0;

pub(crate) fn carry(step: &Step, slack: &mut Slack) {
    slack.position = (0..step.lines() * step.samples())
        .map(|index| position(step, index))
        .collect();
    slack.torn = vec![false; slack.position.len()];
    // The following passes overwrite the remains of the last frame; nothing is compared before they do.
    slack.amplitude = vec![0.0; slack.position.len()];
}

/// Bounds the world position of a sample.
pub(crate) fn position(step: &Step, index: usize) -> [f64; 3] {
    let (line, sample) = step.place(index);
    let [ox, oy, dx, dy] = step.tables.rays[line].map(f64::abs);
    let along = step.tables.grid.sample_depth_mm(sample);
    let matrix = &step.state.probe_to_world;
    std::array::from_fn(|row| {
        let m = |column: usize| matrix[(row, column)].abs();
        let terms = m(0) * (ox + dx * along) + m(1) * (oy + dy * along) + m(3);
        let reach = step
            .tables
            .settings
            .effects
            .contact
            .as_ref()
            .map_or(0.0, |contact| contact.reach_mm);
        let pressed = reach * (m(0) * dx + m(1) * dy);
        TERM * ULP * terms + ULP * (PRESSED * pressed + f64::from(u8::from(reach > 0.0)) * (terms + pressed))
    })
}
