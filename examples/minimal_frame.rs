//! What is the least code that makes a frame? The default scene, on the CPU, to a PNG.
//!
//! `cargo run --release --example minimal_frame -- docs/frame.png`

use std::error::Error;
use std::path::PathBuf;

use insonify::{Backend, DEFAULT_SCENE, FrameState, SceneFile, Synthesizer, write_png};
use nalgebra::Matrix4;

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args_os().nth(1).map_or("frame.png".into(), PathBuf::from);
    let scene = SceneFile::parse(DEFAULT_SCENE, "default.toml")?.resolve(".".as_ref())?;
    let mut state = FrameState::at(Matrix4::identity());
    scene.state(0, 1, &mut state)?;

    let mut synth = Synthesizer::new(scene.anatomy, scene.settings, Backend::Cpu)?;
    let frame = synth.render(&state)?;
    write_png(&path, frame.width, frame.height, &frame.pixels)?;
    println!(
        "{}: {} x {} pixels of {:.3} mm",
        path.display(),
        frame.width,
        frame.height,
        frame.pixel_mm
    );
    Ok(())
}
