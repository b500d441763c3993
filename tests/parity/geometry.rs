//! Geometry: probe pose times a point of a ray.

use crate::case::{Case, check_all};
use crate::rounding::ULP;
use crate::scenes;
use crate::slack::{Slack, Step};
use crate::support::scene::{self, SHAPES};

/// Losses of one term of a coordinate, in ULP of the term. Along the ray: the sample distance is stored (1/2) and
/// multiplied (1), the ray is stored (1/2), the product (1) and the sum (1) rounded: 4. Then the matrix is stored (1/2),
/// the product (1) and three sums (3) rounded.
const TERM: f64 = 4.0 + 4.5;

pub fn carry(step: &Step, slack: &mut Slack) {
    slack.position = (0..step.lines() * step.samples())
        .map(|index| position(step, index, 0.0))
        .collect();
    slack.torn = vec![false; slack.position.len()];
    // The passes that follow overwrite what is left of the last frame; nothing is compared before they do.
    slack.amplitude = vec![0.0; slack.position.len()];
}

/// Bound on the world position of a sample of the plane at elevation `z` mm.
pub fn position(step: &Step, index: usize, z: f64) -> [f64; 3] {
    let (line, sample) = step.place(index);
    let [ox, oy, dx, dy] = step.tables.rays[line].map(f64::abs);
    let along = step.tables.grid.sample_depth_mm(sample);
    let matrix = &step.state.probe_to_world;
    std::array::from_fn(|row| {
        let m = |column: usize| matrix[(row, column)].abs();
        let terms = m(0) * (ox + dx * along) + m(1) * (oy + dy * along) + m(2) * z.abs() + m(3);
        TERM * ULP * terms
    })
}

#[test]
fn every_probe_shape() {
    let cases: Vec<Case> = SHAPES
        .iter()
        .map(|&(name, shape)| {
            let probe = scene::probe(shape, 40.0, 24, 96);
            Case::new(
                name,
                scenes::random_anatomy(),
                scene::settings(probe, scene::bare()),
                scenes::oblique_pose(),
            )
        })
        .collect();
    check_all("geometry of every probe shape", &cases);
}

#[test]
fn one_line_one_sample_one_pixel() {
    let mut cases = Vec::new();
    for (name, shape) in SHAPES {
        for (lines, samples) in [(1, 96), (24, 1), (1, 1), (2, 2)] {
            for (width, height) in [(64, 48), (1, 1)] {
                let probe = scene::probe(shape, 40.0, lines, samples);
                cases.push(Case::new(
                    format!("{name} {lines} x {samples}, image {width} x {height}"),
                    scenes::random_anatomy(),
                    scene::sized(probe, scenes::all_effects(), width, height),
                    scenes::oblique_pose(),
                ));
            }
        }
    }
    check_all("degenerate grids", &cases);
}

#[test]
fn far_from_the_origin_of_the_world() {
    let (anatomy, state) = scenes::far_away();
    let settings = scene::settings(scene::small_probe(), scenes::all_effects());
    check_all(
        "a volume 900 mm away",
        &[Case::new("far away", anatomy, settings, state)],
    );
}
