//! Receiver: integers up to the power drawn, then a sum of squares and a root.

use insonify::effects::receiver::{Receiver, draw};
use insonify::effects::shadow::Shadow;

use crate::case::{Case, check_all};
use crate::rounding::{ROOT, TINY, ULP, root_off};
use crate::scenes;
use crate::slack::{Slack, Step};
use crate::support::scene::{self, SHAPES};

pub fn carry(step: &Step, slack: &mut Slack) {
    let tables = step.tables;
    let power = tables.receiver_power.of::<f64>();
    for index in 0..step.after.amplitude.len() {
        let (line, sample) = step.place(index);
        let drawn = f64::from(draw(line, sample, step.state.frame, tables.settings.seed));
        let heard = power[sample] * drawn;
        let silent = [step.after, step.twin].map(|beam| beam.label[index] == 0);
        let (echo, off) = (step.before.amplitude[index].abs(), slack.amplitude[index]);
        // Power stored (1/2), the integer rounded (1), product (1); the square of the echo (1); their sum (1).
        let rounding = ULP * (3.5 * heard + 2.0 * (echo + off).powi(2)) + 2.0 * TINY;
        let square_off = (2.0 * echo + off) * off + rounding;
        let square = echo * echo + if silent[0] { 0.0 } else { heard };
        // Where a label within rounding of a face is background on one side only, all the noise may come or go.
        let torn = if silent[0] == silent[1] { 0.0 } else { heard };
        let root = (square + square_off + torn).sqrt();
        slack.amplitude[index] = root_off(square, square_off + torn) + ROOT * root;
    }
}

#[test]
fn noise_and_clutter_on_every_probe_shape() {
    let mut cases = Vec::new();
    for (at, (name, shape)) in SHAPES.into_iter().enumerate() {
        for receiver in [
            Receiver::default(),
            Receiver {
                noise_db: 20.0,
                clutter_db: -200.0,
                clutter_decay_db_cm: 0.0,
            },
            Receiver {
                noise_db: -200.0,
                clutter_db: -20.0,
                clutter_decay_db_cm: 12.0,
            },
        ] {
            // A count that is no multiple of a workgroup nor of a block.
            let mut settings = scene::settings(scene::probe(shape, 40.0, 11, 151), scene::bare());
            settings.effects.receiver = Some(receiver.clone());
            settings.effects.tone = Some(Default::default());
            settings.effects.shadow = (at % 2 == 0).then(Shadow::default);
            let mut state = scenes::oblique_pose();
            state.frame = [0, 3, u64::from(u32::MAX) + 9][at % 3];
            cases.push(Case::new(
                format!("{name}, {receiver:?}"),
                scenes::random_anatomy(),
                settings,
                state,
            ));
        }
    }
    check_all("receiver", &cases);
}
