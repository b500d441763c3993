//! Receiver: integers up to the power drawn, then a sum of squares and a root.

use insonify_imaging::effects::receiver::Receiver;
use insonify_imaging::effects::shadow::Shadow;

use crate::parity_tests::case::{Case, check_all};
use crate::parity_tests::scenes;
use crate::support::scene::{self, SHAPES};

#[test]
fn noise_and_clutter_on_every_probe_shape() {
    let mut cases = Vec::new();
    for (number, (name, shape)) in SHAPES.into_iter().enumerate() {
        for receiver in [
            Receiver::default(),
            Receiver {
                noise_db: 20.0,
                clutter_db: Some(-200.0),
                clutter_decay_db_cm: 0.0,
                ring_down_db: -200.0,
            },
            Receiver {
                noise_db: -200.0,
                clutter_db: Some(-20.0),
                clutter_decay_db_cm: 12.0,
                ring_down_db: -200.0,
            },
        ] {
            // A count that is no multiple of a workgroup nor of a block.
            let mut settings = scene::settings(scene::probe(shape, 40.0, 11, 151), scene::bare());
            settings.effects.receiver = Some(receiver.clone());
            settings.effects.tone = Some(Default::default());
            settings.effects.shadow = (number % 2 == 0).then(Shadow::default);
            let mut state = scenes::oblique_pose();
            state.frame = [0, 3, u64::from(u32::MAX) + 9][number % 3];
            cases.push(Case::new(
                format!("{name}, {receiver:?}"),
                scenes::random_anatomy(),
                settings,
                state,
            ));
        }
    }
    check_all(&cases);
}
