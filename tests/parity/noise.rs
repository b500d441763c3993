//! Noise: integers until the last product.

use insonify::effects::noise::{Noise, deviate};
use insonify::random::seed_words;
use insonify::synth::tables::Tables;

use crate::case::{Case, check_all};
use crate::rounding::ULP;
use crate::scenes;
use crate::support::scene;

/// Standard deviation of the sum of twelve bytes, by which the asked one is divided.
const SUM_STD: f64 = 255.998_046_867_549_4;

/// Adds the noise of a frame to grey levels known to within a bound.
pub fn carry(tables: &Tables, frame: u64, image: &mut [[f64; 2]]) {
    let Some(own) = &tables.settings.effects.noise else {
        return;
    };
    let scale = f64::from((own.std_grey / SUM_STD) as f32);
    for (index, (pixel, at)) in image.iter_mut().zip(&tables.scan_map).enumerate() {
        if at[0] < 0.0 {
            continue;
        }
        let (row, column) = (index / tables.width(), index % tables.width());
        let noise = scale
            * f64::from(deviate(
                column as i32,
                row as i32,
                frame as u32,
                seed_words(tables.settings.seed),
            ));
        *pixel = [
            (pixel[0] + noise).clamp(0.0, 255.0),
            pixel[1] + ULP * (2.0 * noise.abs() + pixel[0]),
        ];
    }
}

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
    check_all("noise", &cases);
}
