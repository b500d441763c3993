//! Error bounds of quantisation to the nearest byte: a bounded grey level may become any byte between those of its
//! ends.

use crate::parity::rounding::ULP;
use crate::parity::{Slack, Step};

pub(crate) fn carry(_: &Step, slack: &mut Slack) {
    let bytes = |[grey, off]: [f64; 2]| {
        let off = off + 256.0 * ULP;
        [grey - off, grey + off].map(|grey| (grey + 0.5).clamp(0.0, 255.0) as u8)
    };
    slack.bytes = slack.image.iter().copied().map(bytes).collect();
}
