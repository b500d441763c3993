//! Error bounds of slice thickness: a power average over sub-planes. Only the central sub-plane is read back; the others are treated as
//! central planes of probes moved in elevation, where every label possible within rounding is taken into account.

use crate::effects::common::plane_step;
use nalgebra::{Matrix4, Vector3};

use super::rounding::{ROOT, ULP};
use super::slack::{Slack, Step};
use super::{Trail, geometry, slice, texture, warp};
use crate::synth::SynthError;
use crate::synth::layers::Beam;
use crate::synth::tables::Tables;

/// Rounding error of the sum of powers, in ULP of it: weight stored (1/2), two products (2), nine sums (9). The root halves it.
const SUM: f64 = 11.5;

pub(super) fn carry(step: &Step, slack: &mut Slack) -> Result<(), SynthError> {
    let Some(own) = &step.tables.settings.effects.thickness else {
        slack.fault("a thickness pass without thickness");
        return Ok(());
    };
    let mut squares = vec![0.0; slack.amplitude.len()];
    for (plane, weight) in own.weights().enumerate() {
        let offs = match plane {
            0 => std::mem::take(&mut slack.amplitude),
            _ => plane_slack(step, f64::from(plane_step(plane)) * own.plane_mm(), slack)?,
        };
        for (square, off) in squares.iter_mut().zip(offs) {
            *square += weight * off * off;
        }
    }
    // The root of a weighted sum of squares is a norm: its change is at most the norm of the changes of its terms.
    let rounding = 0.5 * SUM * ULP + ROOT;
    slack.amplitude = squares
        .iter()
        .zip(&step.after.amplitude)
        .map(|(square, amplitude)| square.sqrt() + amplitude * rounding)
        .collect();
    Ok(())
}

/// Bounds the amplitudes of the sub-plane at elevation `z` mm before averaging.
fn plane_slack(step: &Step, z: f64, outer: &mut Slack) -> Result<Vec<f64>, SynthError> {
    let mut case = step.case.clone();
    case.settings.effects.thickness = None;
    case.state.probe_to_world *= Matrix4::new_translation(&Vector3::new(0.0, 0.0, z));
    let mut exact = case.exact()?;
    let mut trail = Trail::of(&mut exact, &case.state)?;
    let last = trail
        .passes
        .iter()
        .position(|pass| *pass == "texture")
        .or(trail.passes.iter().position(|pass| *pass == "slice"));
    let Some(last) = last else {
        outer.fault("a thickness pass without a slice");
        return Ok(outer.amplitude.clone());
    };
    let mut slack = Slack::default();
    let empty = Beam::default();
    for at in 0..=last {
        // The reference stands in for the twin, whose labels cannot be read: where rounding could change a label, `doubt` below counts
        // every possible outcome.
        let own = Step {
            case: step.case,
            tables: exact.tables(),
            state: step.state,
            before: at.checked_sub(1).map_or(&empty, |before| &trail.beams[before]),
            after: &trail.beams[at],
            twin: &trail.beams[at],
        };
        match trail.passes[at] {
            "geometry" => {
                geometry::carry(&own, &mut slack);
                for index in 0..slack.position.len() {
                    slack.position[index] = geometry::position(&own, index, z);
                }
            }
            "contact" | "warp_raster" => {}
            "warp" => {
                warp::carry(&own, &mut slack);
                slack.torn = warp::near_a_surface(&own, &slack);
            }
            "slice" => slice::carry(&own, &mut slack),
            "texture" => texture::carry(&own, &mut slack),
            other => slack.fault(format!("unexpected pass {other} before thickness")),
        }
    }
    outer.faults.append(&mut slack.faults);
    Ok(doubt(exact.tables(), &trail.beams.swap_remove(last), &slack))
}

/// Returns the bounds of `slack`, widened to the full range of amplitudes where a label is in doubt.
fn doubt(tables: &Tables, beam: &Beam, slack: &Slack) -> Vec<f64> {
    let most = tables
        .label_rows
        .iter()
        .map(|row| f64::from(row.echo))
        .fold(0.0, f64::max);
    let texture = tables
        .effects
        .texture
        .as_ref()
        .map_or(1.0, |atlas| f64::from(atlas.data.iter().fold(1.0f32, |a, &b| a.max(b))));
    let strength = tables.settings.effects.texture.as_ref().map_or(0.0, |own| own.strength);
    let loudest = most * (1.0 + strength * texture);
    (0..beam.label.len())
        .map(|index| {
            let sure = !slack.torn[index]
                && slice::possible_labels(tables, beam.position[index], slack.position[index]).len() == 1;
            if sure { slack.amplitude[index] } else { loudest }
        })
        .collect()
}
