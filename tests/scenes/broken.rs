//! Whatever is done to the text of a scene, the answer is a scene or an error, never a panic.

use std::path::Path;

use insonify::input::scene::{DEFAULT, EXAMPLES, SceneFile};
use proptest::prelude::*;

use super::support::uncommented;

/// Parses and, if that succeeds, resolves with a coarse phantom; shows an error both ways.
fn survive(text: &str) {
    let scene = SceneFile::parse(text, "broken.toml").and_then(|mut file| {
        if let Some(volume) = &mut file.volume
            && volume.phantom.is_some()
            && volume.resolution_mm.is_none_or(|mm| (0.3..5.0).contains(&mm))
        {
            volume.resolution_mm = Some(5.0);
        }
        if let Some(nodes) = file.deform.as_mut().and_then(|deform| deform.nodes.as_mut()) {
            *nodes = (*nodes).min(2000);
        }
        file.resolve(Path::new("/nowhere"))
    });
    match scene {
        Ok(scene) => {
            let frames = scene.frames();
            let mut state = insonify::imaging::synth::FrameState::at(nalgebra::Matrix4::identity());
            scene.state(0, frames, &mut state).expect("first frame");
            scene.state(frames - 1, frames, &mut state).expect("last frame");
        }
        Err(error) => {
            assert!(!error.to_string().is_empty());
            let _ = format!("{:?}", miette::Report::new(error));
        }
    }
}

const WORDS: &[&str] = &[
    "nan",
    "inf",
    "-inf",
    "-1",
    "0",
    "1e999",
    "-1e308",
    "99999999999999999999",
    "9223372036854775807",
    "\"\"",
    "\"x\"",
    "[]",
    "{}",
    "[[1]]",
    "true",
    "1979-05-27",
    "'''",
    "\u{0}",
    "é",
    "[1, 2, 3]",
    "[nan, 0, 0]",
    "4294967296",
];

fn texts() -> impl Strategy<Value = String> {
    let mut texts: Vec<String> = EXAMPLES.iter().map(|(_, text)| (*text).to_owned()).collect();
    texts.push(uncommented());
    prop::sample::select(texts)
}

/// The values in a text: what stands between `=` and the comment.
fn values(text: &str) -> Vec<std::ops::Range<usize>> {
    let mut start = 0;
    let mut found = Vec::new();
    for line in text.split_inclusive('\n') {
        if let (false, Some(equals)) = (line.starts_with('#'), line.find('=')) {
            let end = line
                .find(" #")
                .filter(|end| *end > equals)
                .unwrap_or(line.trim_end().len());
            found.push(start + equals + 1..start + end.max(equals + 1));
        }
        start += line.len();
    }
    found
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, ..ProptestConfig::default() })]

    #[test]
    fn bytes_deleted_or_flipped(text in texts(), at in any::<prop::sample::Index>(), span in 0usize..30, bit in 0u8..8) {
        let mut bytes = text.into_bytes();
        let at = at.index(bytes.len());
        if span == 0 {
            bytes[at] ^= 1 << bit;
        } else {
            bytes.drain(at..(at + span).min(bytes.len()));
        }
        survive(&String::from_utf8_lossy(&bytes));
    }

    #[test]
    fn values_replaced(text in texts(), which in any::<prop::sample::Index>(), word in prop::sample::select(WORDS)) {
        let places = values(&text);
        let place = places[which.index(places.len())].clone();
        let mut text = text;
        text.replace_range(place, &format!(" {word}"));
        survive(&text);
    }

    #[test]
    fn lines_left_out_doubled_or_swapped(text in texts(), a in any::<prop::sample::Index>(), b in any::<prop::sample::Index>(), way in 0..3) {
        let mut lines: Vec<&str> = text.lines().collect();
        let (a, b) = (a.index(lines.len()), b.index(lines.len()));
        match way {
            0 => drop(lines.remove(a)),
            1 => lines.insert(b, lines[a]),
            _ => lines.swap(a, b),
        }
        survive(&lines.join("\n"));
    }

    #[test]
    fn any_text_at_all(text in "\\PC{0,80}") {
        survive(&text);
        survive(&format!("version = 1\n[volume]\nphantom = \"spine\"\n{text}"));
    }
}

#[test]
fn every_value_replaced_by_every_word() {
    for text in [DEFAULT.to_owned(), uncommented()] {
        for place in values(&text) {
            for word in WORDS {
                let mut broken = text.clone();
                broken.replace_range(place.clone(), &format!(" {word}"));
                if let Err(error) = SceneFile::parse(&broken, "broken.toml") {
                    assert!(!error.to_string().is_empty());
                    let _ = format!("{:?}", miette::Report::new(error));
                }
            }
        }
    }
}

#[test]
fn long_strings_and_deep_nesting() {
    survive(&format!("{} = 1", "a".repeat(100_000)));
    survive(&format!("version = 1\n[volume]\nfile = \"{}\"", "a".repeat(100_000)));
    survive(&format!("x = {}", "[".repeat(5000)));
    survive(&format!(
        "version = 1\n[volume]\nphantom = \"spine\"\n[pose]\ntarget = \"{}\"",
        "liver ".repeat(20_000)
    ));
}
