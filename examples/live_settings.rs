//! What does it cost to turn a knob while imaging? Settings change between frames, and only what depends on them is
//! made anew.
//!
//! `cargo run --release --example live_settings`

use std::error::Error;
use std::time::Instant;

use insonify::{Backend, FrameState, SceneFile, Settings, Synthesizer, Thickness};
use nalgebra::Matrix4;

const SCENE: &str = r#"
volume = { phantom = "abdomen", resolution_mm = 2.0 }
"#;

fn main() -> Result<(), Box<dyn Error>> {
    let scene = SceneFile::parse(SCENE, "live_settings")?.resolve(".".as_ref())?;
    let mut state = FrameState::at(Matrix4::identity());
    scene.state(0, 1, &mut state)?;
    let start = Instant::now();
    let mut synth = Synthesizer::new(scene.anatomy, scene.settings, Backend::Cpu)?;
    synth.render(&state)?;
    println!("{:<18} {:>8} {:>8}  rebuilt", "change", "set ms", "frame ms");
    println!("{:<18} {:>8.2} {:>8}  everything", "first frame", ms(start), "");

    let knobs: [(&str, fn(&mut Settings)); 8] = [
        ("nothing", |_| ()),
        ("gain +6 dB", |new| {
            if let Some(tone) = &mut new.effects.tone {
                tone.gain_db += 6.0;
            }
        }),
        ("focus at 40 mm", |new| {
            if let Some(speckle) = &mut new.effects.speckle {
                speckle.focus_mm = Some(40.0);
            }
        }),
        ("depth 150 to 90 mm", |new| new.probe.depth_mm = 90.0),
        ("size 320 x 240", |new| (new.image.width, new.image.height) = (320, 240)),
        ("shadow off", |new| new.effects.shadow = None),
        ("texture off", |new| new.effects.texture = None),
        ("thickness on", |new| new.effects.thickness = Some(Thickness::default())),
    ];
    for (name, turn) in knobs {
        let mut settings = synth.settings().clone();
        turn(&mut settings);
        let start = Instant::now();
        let rebuilt = synth.set(settings)?;
        let set_ms = ms(start);
        let start = Instant::now();
        synth.render(&state)?;
        println!("{name:<18} {set_ms:>8.2} {:>8.2}  {rebuilt:?}", ms(start));
    }

    let mut settings = synth.settings().clone();
    settings.probe.depth_mm = -1.0;
    let refused = synth.set(settings).err().map(|error| error.to_string());
    println!("depth -1 mm is refused: {}", refused.unwrap_or_default());
    println!("and the depth stays {} mm", synth.settings().probe.depth_mm);
    Ok(())
}

fn ms(start: Instant) -> f64 {
    start.elapsed().as_secs_f64() * 1e3
}
