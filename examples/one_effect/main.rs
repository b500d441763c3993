//! What does each effect do? The same frame with one effect at a time, then with all, as one picture.
//!
//! The first panel is slicing alone: labels become echoes, shown linearly. The second adds the tone curve, which every
//! further panel has too, beside the one effect in its caption.
//!
//! `cargo run --release --example one_effect -- docs/effects.png`

mod caption;

use std::error::Error;
use std::path::PathBuf;

use insonify::{Backend, Effects, FrameState, SceneFile, Synthesizer, write_png};
use nalgebra::Matrix4;

/// A needle pushes the liver before its tip; what it does is exaggerated, as are interfaces, blur and noise.
const SCENE: &str = r#"
version = 1
seed = 11
volume = { phantom = "abdomen" }
probe = { kind = "curvilinear", radius_mm = 60.0, angle_deg = 70.0, depth_mm = 100.0, frequency_mhz = 4.0 }
image = { width = 300, height = 190, margin = 0.015 }
needle = { tip_mm = [-52.3, -20.2, -25.1], entry_mm = [-32.0, -79.6, -7.1] }

[deform.field]
kind = "indentation"
centre_mm = [-52.3, -20.2, -25.1]
direction = [-20.3, 59.4, -18.0]
depth_mm = 12.0
radius_mm = 18.0

[effects]
contact = {}
texture = {}
thickness = { width_mm = 2.0 }
speckle = {}
interface = { mirror_db = 44.0 }
needle = {}
shadow = {}
refraction = {}
blur = { width_mm = 1.3 }
receiver = {}
tone = { gain_db = 8.0 }
noise = { std_grey = 7.0 }
"#;

const COLUMNS: usize = 5;

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args_os().nth(1).map_or("effects.png".into(), PathBuf::from);
    let scene = SceneFile::parse(SCENE, "one_effect")?.resolve(".".as_ref())?;
    let mut state = FrameState::at(Matrix4::identity());
    scene.state(0, 1, &mut state)?;

    let all = &scene.settings.effects;
    #[rustfmt::skip]
    let panels: [(&str, fn(&mut Effects, Effects)); 15] = [
        ("slice", |on, _| on.tone = None),
        ("tone", |_, _| ()),
        ("warp", |_, _| ()),
        ("contact", |on, all| on.contact = all.contact),
        ("texture", |on, all| on.texture = all.texture),
        ("thickness", |on, all| on.thickness = all.thickness),
        ("speckle", |on, all| on.speckle = all.speckle),
        ("interface", |on, all| on.interface = all.interface),
        ("needle", |on, all| on.needle = all.needle),
        ("shadow", |on, all| on.shadow = all.shadow),
        ("refraction", |on, all| on.refraction = all.refraction),
        ("blur", |on, all| on.blur = all.blur),
        ("receiver", |on, all| on.receiver = all.receiver),
        ("noise", |on, all| on.noise = all.noise),
        ("all", |on, all| *on = all),
    ];

    let [width, height] = [scene.settings.image.width, scene.settings.image.height];
    let (columns, rows) = (
        COLUMNS * width,
        panels.len().div_ceil(COLUMNS) * (height + caption::HEIGHT),
    );
    let mut picture = vec![0; columns * rows];
    for (place, (name, switch_on)) in panels.into_iter().enumerate() {
        let (mut anatomy, mut settings) = (scene.anatomy.clone(), scene.settings.clone());
        settings.effects = Effects {
            tone: all.tone.clone(),
            ..Effects::default()
        };
        switch_on(&mut settings.effects, all.clone());
        anatomy.mesh = anatomy.mesh.filter(|_| matches!(name, "warp" | "all"));

        let mut synth = Synthesizer::new(anatomy, settings, Backend::Cpu)?;
        let pixels = &synth.render(&state)?.pixels;
        let (left, top) = (place % COLUMNS * width, place / COLUMNS * (height + caption::HEIGHT));
        for (row, line) in pixels.chunks_exact(width).enumerate() {
            picture[(top + row) * columns + left..][..width].copy_from_slice(line);
        }
        caption::write(&mut picture, columns, [left + 8, top + height + 4], name);
        println!("{name:<10} {} passes", synth.plan().passes.len());
    }
    write_png(&path, columns, rows, &picture)?;
    println!("{}", path.display());
    Ok(())
}
