//! What happens when the driver resets the GPU in the middle of a session? The frame fails with an error that says so,
//! and a new device picks up where the old one was.
//!
//! `cargo run --release --example lost_device`

use std::error::Error;

use insonify::{AdapterChoice, Backend, GpuError, SceneFile, SynthError};

const SCENE: &str = r#"
volume = { phantom = "abdomen", resolution_mm = 2.0 }
"#;

fn main() -> Result<(), Box<dyn Error>> {
    let scene = SceneFile::parse(SCENE, "lost_device")?.resolve(".".as_ref())?;
    let backend = || Backend::Adapter(AdapterChoice::from_flag(None));
    let mut synth = match scene.synthesizer(backend()) {
        Err(SynthError::Gpu(GpuError::NoAdapter)) => {
            println!("no GPU adapter: nothing to lose");
            return Ok(());
        }
        opened => opened?,
    };
    let gpu = synth.gpu().ok_or("the adapter is a GPU")?.clone();
    println!("device on {}", gpu.report().name);
    let state = scene.states(1).next().ok_or("a scene has a frame")??;
    let before = synth.render(&state)?.clone();
    println!("a frame of {} x {} pixels", before.width, before.height);

    gpu.simulate_loss()?;
    match synth.render(&state) {
        Err(SynthError::Gpu(error @ GpuError::Lost { .. })) => println!("next frame: {error}"),
        Err(other) => return Err(other.into()),
        Ok(_) => return Err("a lost device rendered a frame".into()),
    }

    // Anatomy is shared: a new synthesizer costs the uploads and the pipelines, not the volume.
    let mut synth = scene.synthesizer(backend())?;
    let after = synth.render(&state)?;
    println!(
        "new device: the frame is {}",
        if *after == before { "the same" } else { "another" }
    );
    Ok(())
}
