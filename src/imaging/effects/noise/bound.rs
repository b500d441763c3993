//! Error bounds of noise: integers until the last product.

use crate::effects::noise::deviate;
use insonify_base::random::seed_words;

use crate::parity::rounding::ULP;
use crate::parity::{Slack, Step};

/// Standard deviation of the sum of twelve bytes, by which the requested one is divided.
const SUM_STD: f64 = 255.998_046_867_549_4;

pub(crate) fn carry(step: &Step, slack: &mut Slack) {
    let tables = step.tables;
    let Some(noise) = &tables.settings.effects.noise else {
        return slack.fault("a noise pass without noise");
    };
    let scale = f64::from((noise.std_grey / SUM_STD) as f32);
    for (index, (pixel, beam_position)) in slack.image.iter_mut().zip(&tables.scan_map).enumerate() {
        if beam_position[0] < 0.0 {
            continue;
        }
        let (row, column) = (index / tables.width(), index % tables.width());
        let noise = scale
            * f64::from(deviate(
                column as i32,
                row as i32,
                step.state.frame as u32,
                seed_words(tables.settings.seed),
            ));
        *pixel = [
            (pixel[0] + noise).clamp(0.0, 255.0),
            pixel[1] + ULP * (2.0 * noise.abs() + pixel[0]),
        ];
    }
}
