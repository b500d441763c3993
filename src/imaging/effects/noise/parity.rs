//! Noise: integers until the last product.

use insonify_imaging::effects::noise::Noise;

use crate::parity_tests::case::{Case, check_all};
use crate::parity_tests::scenes;
use crate::support::scene;

#[test]
fn noise_of_several_frames_and_strengths() {
    let mut cases = Vec::new();
    for (frame, std_grey) in [(0, 6.0), (1, 0.0), (u64::from(u32::MAX) + 9, 128.0)] {
        let mut settings = scene::settings(scene::small_probe(), scene::bare());
        settings.effects.noise = Some(Noise { std_grey });
        settings.effects.tone = Some(Default::default());
        let mut state = scenes::oblique_pose();
        state.frame = frame;
        cases.push(Case::new(
            format!("frame {frame}, {std_grey}"),
            scenes::random_anatomy(),
            settings,
            state,
        ));
    }
    check_all(&cases);
}
