//! What happens when the driver resets the GPU in the middle of a session? The frame fails with an error that says so, and
//! a new device picks up where the old one was.
//!
//! `cargo run --release --example lost_device`

use std::error::Error;

use insonify::gpu::{AdapterChoice, Gpu, GpuError, Needs};
use insonify::scene::SceneFile;
use insonify::synth::{Backend, FrameState, SynthError, Synthesizer};
use nalgebra::Matrix4;

const SCENE: &str = r#"
version = 1
volume = { phantom = "abdomen", resolution_mm = 2.0 }
"#;

fn main() -> Result<(), Box<dyn Error>> {
    let gpu = match Gpu::open(&AdapterChoice::from_flag(None), &Needs::default()) {
        Err(GpuError::NoAdapter) => {
            println!("no GPU adapter: nothing to lose");
            return Ok(());
        }
        opened => opened?,
    };
    println!("device on {}", gpu.report().name);

    let scene = SceneFile::parse(SCENE, "lost_device")?.resolve(".".as_ref())?;
    let mut state = FrameState::at(Matrix4::identity());
    scene.state(0, 1, &mut state)?;
    let mut synth = Synthesizer::new(scene.anatomy, scene.settings, Backend::Gpu(Box::new(gpu.clone())))?;
    let before = synth.render(&state)?.clone();
    println!("a frame of {} x {} pixels", before.width, before.height);

    gpu.simulate_loss()?;
    match synth.render(&state) {
        Err(SynthError::Gpu(error @ GpuError::Lost { .. })) => println!("next frame: {error}"),
        Err(other) => return Err(other.into()),
        Ok(_) => return Err("a lost device rendered a frame".into()),
    }

    // Anatomy is shared, so making the synthesizer anew costs the uploads and the pipelines, not the volume.
    let (anatomy, settings) = (synth.tables().anatomy.clone(), synth.settings().clone());
    let gpu = Gpu::open(&AdapterChoice::from_flag(None), &Needs::default())?;
    let mut synth = Synthesizer::new(anatomy, settings, Backend::Gpu(Box::new(gpu)))?;
    let after = synth.render(&state)?;
    println!(
        "new device: the frame is {}",
        if *after == before { "the same" } else { "another" }
    );
    Ok(())
}
