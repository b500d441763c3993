//! Error bounds of slice thickness: a power average over sub-planes. Only the central sub-plane is read back; the
//! others are treated as central planes of probes moved in elevation, where every label possible within rounding is
//! taken into account.

use crate::effects::common::plane_step;
use crate::effects::slice::bound::possible_labels;
use crate::effects::{REGISTRY, Stage};
use nalgebra::{Matrix4, Vector3};

use crate::parity::rounding::{ROOT, ULP};
use crate::parity::{Bound, Slack, Step, Trail};
use crate::synth::SynthError;
use crate::synth::layers::Beam;
use crate::synth::tables::Tables;

/// Rounding error of the sum of powers, in ULP of it: weight stored (1/2), two products (2), nine sums (9). The root
/// halves it.
const SUM: f64 = 11.5;

pub(crate) fn carry(step: &Step, slack: &mut Slack) {
    let Some(thickness) = &step.tables.settings.effects.thickness else {
        return slack.fault("a thickness pass without thickness");
    };
    let mut squares = vec![0.0; slack.amplitude.len()];
    for (plane, weight) in thickness.weights().enumerate() {
        let offs = match plane {
            0 => std::mem::take(&mut slack.amplitude),
            _ => match plane_slack(step, f64::from(plane_step(plane)) * thickness.plane_mm(), slack) {
                Ok(offs) => offs,
                Err(error) => return slack.fault(error.to_string()),
            },
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
}

/// Bounds the amplitudes of the sub-plane at elevation `z` mm before averaging.
fn plane_slack(step: &Step, z: f64, outer: &mut Slack) -> Result<Vec<f64>, SynthError> {
    let mut case = step.case.clone();
    case.settings.effects.thickness = None;
    case.state.probe_to_world *= Matrix4::new_translation(&Vector3::new(0.0, 0.0, z));
    let mut exact = case.exact()?;
    let mut trail = Trail::of(&mut exact, &case.state)?;
    let tissue = exact
        .plan()
        .passes
        .iter()
        .take_while(|planned| is_tissue(planned.effect));
    let last = tissue.count() - 1;
    let mut slack = Slack::default();
    let empty = Beam::default();
    for index in 0..=last {
        // The reference stands in for the twin, whose labels cannot be read: where rounding could change a label,
        // `doubt` below counts every possible outcome.
        let step = Step {
            case: step.case,
            tables: exact.tables(),
            state: step.state,
            before: index.checked_sub(1).map_or(&empty, |before| &trail.beams[before]),
            after: &trail.beams[index],
            twin: &trail.beams[index],
            to_nearest: step.to_nearest,
            sub_plane_mm: Some(z),
        };
        if let Bound::By(carry) = trail.passes[index].bound {
            carry(&step, &mut slack);
        }
    }
    outer.faults.append(&mut slack.faults);
    Ok(doubt(exact.tables(), &trail.beams.swap_remove(last), &slack))
}

/// Whether an effect is of the stage whose passes run for every sub-plane.
fn is_tissue(effect: &str) -> bool {
    let effect = REGISTRY.iter().find(|known| known.name == effect);
    effect.is_some_and(|effect| effect.stage == Stage::Tissue)
}

/// Returns the bounds of `slack`, widened to the full range of amplitudes where a label is in doubt.
fn doubt(tables: &Tables, beam: &Beam, slack: &Slack) -> Vec<f64> {
    let largest = tables
        .label_rows
        .iter()
        .map(|row| f64::from(row.echo))
        .fold(0.0, f64::max);
    let brightest = tables
        .effects
        .texture
        .as_ref()
        .map_or(1.0, |atlas| f64::from(atlas.data.iter().fold(1.0f32, |a, &b| a.max(b))));
    let strength = tables
        .settings
        .effects
        .texture
        .as_ref()
        .map_or(0.0, |texture| texture.strength);
    let loudest = largest * (1.0 + strength * brightest);
    (0..beam.label.len())
        .map(|index| {
            let sure =
                !slack.torn[index] && possible_labels(tables, beam.position[index], slack.position[index]).len() == 1;
            if sure { slack.amplitude[index] } else { loudest }
        })
        .collect()
}
