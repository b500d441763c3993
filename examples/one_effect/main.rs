//! What does each effect do? The same frame with one effect at a time, then with all, as one picture.
//!
//! The first panel is slicing alone: labels become echoes, shown linearly. The second adds the tone curve, which every
//! further panel has too, beside the one effect in its caption. What the effects do is that of their examples, which exaggerate.
//!
//! `cargo run --release --example one_effect -- docs/effects.png`

mod caption;

use std::error::Error;
use std::path::PathBuf;

use insonify::imaging::effects::{Effect, LISTED};
use insonify::{Backend, FrameState, SceneFile, Synthesizer, write_png};
use nalgebra::Matrix4;

/// What the examples of effects are added to.
const SCENE: &str = r#"
version = 1
seed = 11
volume = { phantom = "abdomen" }
probe = { kind = "curvilinear", radius_mm = 60.0, angle_deg = 70.0, depth_mm = 100.0, frequency_mhz = 4.0 }
image = { width = 300, height = 190, margin = 0.015 }
"#;

const COLUMNS: usize = 5;

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args_os().nth(1).map_or("effects.png".into(), PathBuf::from);
    let removable = || {
        LISTED
            .iter()
            .filter(|effect| effect.remove.is_some() && !effect.example.is_empty())
    };
    let examples: Vec<&str> = removable().map(|effect| effect.example).collect();
    let scene = SceneFile::parse(&format!("{SCENE}{}", examples.join("\n")), "one_effect")?.resolve(".".as_ref())?;
    let mut state = FrameState::at(Matrix4::identity());
    scene.state(0, 1, &mut state)?;

    let single = removable()
        .filter(|effect| effect.name != "tone")
        .map(|effect| effect.name);
    let panels: Vec<&str> = ["slice", "tone"].into_iter().chain(single).chain(["all"]).collect();
    let is_shown = |panel: &str, effect: &Effect| match panel {
        "all" => true,
        "slice" => false,
        _ => effect.name == panel || effect.name == "tone",
    };

    let [width, height] = [scene.settings.image.width, scene.settings.image.height];
    let (columns, rows) = (
        COLUMNS * width,
        panels.len().div_ceil(COLUMNS) * (height + caption::HEIGHT),
    );
    let mut picture = vec![0; columns * rows];
    for (place, panel) in panels.into_iter().enumerate() {
        let (mut anatomy, mut settings) = (scene.anatomy.clone(), scene.settings.clone());
        for effect in LISTED.iter().filter(|effect| !is_shown(panel, effect)) {
            if let Some(remove) = effect.remove {
                remove(&mut anatomy, &mut settings);
            }
        }
        let mut synth = Synthesizer::new(anatomy, settings, Backend::Cpu)?;
        let pixels = &synth.render(&state)?.pixels;
        let (left, top) = (place % COLUMNS * width, place / COLUMNS * (height + caption::HEIGHT));
        for (row, line) in pixels.chunks_exact(width).enumerate() {
            picture[(top + row) * columns + left..][..width].copy_from_slice(line);
        }
        caption::write(&mut picture, columns, [left + 8, top + height + 4], panel);
        println!("{panel:<10} {} passes", synth.plan().passes.len());
    }
    write_png(&path, columns, rows, &picture)?;
    println!("{}", path.display());
    Ok(())
}
