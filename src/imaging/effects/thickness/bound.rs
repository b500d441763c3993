//! Error bounds of slice thickness: a power average over sub-planes, on which every label possible within rounding
//! counts.

use crate::effects::common::elevation;
use crate::effects::slice::Boundary;
use crate::effects::slice::bound::labels_by;
use crate::effects::warp::bound as warp;
use crate::parity::rounding::{ROOT, ULP};
use crate::parity::{Slack, Step};
use nalgebra::Vector3;

/// Rounding error of the sum of powers, in ULP of it: weight stored (1/2), two products (2), nine sums (9), and where
/// all labels agree the sum of the stored weights (1/2). The root halves it.
const SUM: f64 = 12.0;

/// Rounding error of a position beside the plane, in ULP of its size: distance and direction stored (1), product (1),
/// sum (1), and as much again where direction and position are turned to voxels before they are added.
const BESIDE: f64 = 6.0;

pub(crate) fn carry(step: &Step, slack: &mut Slack) {
    let tables = step.tables;
    let (planes, samples) = (&tables.effects.thickness, step.samples());
    let (rows, echoes) = (planes.rows.of::<f64>(), planes.echoes.of::<f64>());
    let elevation = Vector3::from(elevation::<f64>(step.state));
    let loudest = echoes.iter().fold(0.0f64, |loudest, echo| loudest.max(*echo));
    for index in 0..step.after.label.len() {
        let sample = index % samples;
        let row = |row: usize| rows[row * samples + sample];
        let (before, off) = (step.before.amplitude[index].abs(), slack.amplitude[index]);
        let range = [(before - off).max(0.0), before + off];
        // Least and greatest power of a sub-plane.
        let beside = |away: Vector3<f64>| -> [f64; 2] {
            if slack.torn[index] {
                return [0.0, loudest.max(range[1]).powi(2)];
            }
            let (carried, carried_off) = warp::carried(step, index, away);
            let position = step.after.position[index];
            let mut place = position;
            let mut place_off = slack.position[index];
            for axis in 0..3 {
                place[axis] += carried[axis];
                place_off[axis] += carried_off[axis] + BESIDE * ULP * (position[axis].abs() + carried[axis].abs());
            }
            let possible = labels_by(tables, place, place_off, Boundary::Nearest);
            let amplitudes = possible.iter().flat_map(|label| {
                [step.after, step.twin].into_iter().flat_map(move |beam| {
                    let echo = echoes[usize::from(*label)];
                    if *label == beam.label[index] { range } else { [echo; 2] }
                })
            });
            let (least, greatest) = amplitudes.fold((f64::INFINITY, 0.0f64), |(least, greatest), amplitude| {
                (least.min(amplitude), greatest.max(amplitude))
            });
            [least, greatest].map(|amplitude| amplitude * amplitude)
        };
        let mut power = range.map(|amplitude| row(0) * amplitude * amplitude);
        for number in 0..2 * planes.on_side {
            let pair = 1 + number / 2 * 2;
            let side = if number % 2 == 0 { 1.0 } else { -1.0 };
            let [least, greatest] = beside(side * row(pair) * elevation);
            power[0] += row(pair + 1) * least;
            power[1] += row(pair + 1) * greatest;
        }
        let [least, greatest] = power.map(f64::sqrt);
        let exact = step.after.amplitude[index];
        let rounding = (0.5 * SUM * ULP + ROOT) * greatest;
        slack.amplitude[index] = (greatest - exact).max(exact - least).max(0.0) + rounding;
    }
}
