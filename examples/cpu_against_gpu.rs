//! Do CPU and GPU show the same frame, and how long do they take? One scene on both, pixel against pixel.
//!
//! `cargo run --release --example cpu_against_gpu`

use std::error::Error;
use std::time::Instant;

use insonify::{AdapterChoice, Backend, Frame, FrameState, GpuError, SceneFile, SynthError, Synthesizer};
use nalgebra::Matrix4;

const SCENE: &str = r#"
volume = { phantom = "abdomen", resolution_mm = 2.0 }
needle = { tip_mm = [-52.3, -20.2, -25.1], entry_mm = [-32.0, -79.6, -7.1] }
"#;

/// Frames timed on each backend.
const FRAMES: usize = 10;

fn main() -> Result<(), Box<dyn Error>> {
    let scene = SceneFile::parse(SCENE, "cpu_against_gpu")?.resolve(".".as_ref())?;
    let mut state = FrameState::at(Matrix4::identity());
    scene.state(0, 1, &mut state)?;
    let run = |backend| {
        let mut synth = Synthesizer::new(scene.anatomy.clone(), scene.settings.clone(), backend)?;
        frames(&mut synth, &state)
    };

    let gold = run(Backend::CpuF64)?;
    let cpu = run(Backend::Cpu)?;
    compare("cpu in single against cpu in double precision", &cpu, &gold);
    match run(Backend::Adapter(AdapterChoice::from_flag(None))) {
        Err(SynthError::Gpu(GpuError::NoAdapter)) => println!("no GPU adapter: nothing further to compare"),
        frame => compare("gpu against cpu", &frame?, &cpu),
    }
    Ok(())
}

/// The same frame a few times over; the first is not timed, for it fills caches and finishes pipelines.
fn frames(synth: &mut Synthesizer, state: &FrameState) -> Result<Frame, SynthError> {
    synth.render(state)?;
    let mut times = Vec::with_capacity(FRAMES);
    for _ in 0..FRAMES {
        let start = Instant::now();
        synth.render(state)?;
        times.push(start.elapsed().as_secs_f64() * 1e3);
    }
    times.sort_by(f64::total_cmp);
    println!("{:<8} median {:>7.2} ms", synth.backend(), times[FRAMES / 2]);
    Ok(synth.frame().clone())
}

fn compare(what: &str, one: &Frame, other: &Frame) {
    let differences = || one.pixels.iter().zip(&other.pixels).map(|(a, b)| a.abs_diff(*b));
    println!(
        "{what}: largest difference {} of 255 grey levels, {} of {} pixels differ",
        differences().max().unwrap_or(0),
        differences().filter(|difference| *difference > 0).count(),
        one.pixels.len()
    );
}
