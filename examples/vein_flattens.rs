//! What does an ultrasound image show when a needle pushes into the liver? The vein that it is meant for, at rest,
//! pressed flat before the capsule gives way, pressed flatter before its own wall does, and after: four frames of the
//! scenario `liver-puncture` side by side.
//!
//! `cargo run --release --example vein_flattens -- docs/vein.png` (a minute)

use std::error::Error;
use std::path::{Path, PathBuf};

use insonify::{
    Backend, EventKind, FrameState, Moment, Observer, Requests, SCENARIOS, ScenarioFile, Step, Synthesizer,
    run_scenario, write_png,
};

/// Width and height of a frame, pixels.
const SIZE: [usize; 2] = [420, 300];

/// Keeps the states that are to be seen.
#[derive(Default)]
struct Moments {
    kept: Vec<(f64, FrameState)>,
    last: Option<(f64, FrameState)>,
}

impl Observer for Moments {
    type Error = Box<dyn Error>;

    fn step(&mut self, step: &Step<'_>) -> Result<(), Self::Error> {
        for event in &step.outcome.events {
            println!(
                "{:6.2} s  {:<8} {:.2} N",
                step.time_s,
                event.kind.name(),
                step.outcome.on_hand.force_n.norm()
            );
            if event.kind == EventKind::Puncture {
                // The frame before shows tissue as it was pushed.
                self.kept.extend(self.last.take());
            }
        }
        Ok(())
    }

    fn frame(&mut self, moment: &Moment<'_>) -> Result<(), Self::Error> {
        let now = (moment.time_s, moment.state.clone());
        if moment.number == 0 {
            self.kept.push(now.clone());
        }
        self.last = Some(now);
        Ok(())
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args_os().nth(1).map_or("vein.png".into(), PathBuf::from);
    let name = "liver-puncture";
    let text = SCENARIOS.iter().find(|(known, _)| *known == name);
    let (_, text) = text.ok_or("the scenario comes with the crate")?;
    let mut scenario = ScenarioFile::parse(text, name)?.resolve(Path::new("."), |_| {})?;
    let [width, height] = SIZE;
    (
        scenario.scene.settings.image.width,
        scenario.scene.settings.image.height,
    ) = (width, height);
    let mut model = scenario.model(|_, _| {})?;
    let mut moments = Moments::default();
    let requests = Requests {
        frames: true,
        mesh_s: None,
    };
    run_scenario(&scenario, model.as_mut(), requests, &mut moments)?;
    moments.kept.extend(moments.last.take());

    let (anatomy, settings) = (scenario.scene.anatomy.clone(), scenario.scene.settings.clone());
    let mut synth = Synthesizer::new(anatomy, settings, Backend::Cpu)?;
    let columns = width * moments.kept.len();
    let mut picture = vec![0; columns * height];
    for (place, (time_s, state)) in moments.kept.iter().enumerate() {
        println!("{time_s:6.2} s  a frame");
        let pixels = &synth.render(state)?.pixels;
        for (row, line) in pixels.chunks_exact(width).enumerate() {
            picture[row * columns + place * width..][..width].copy_from_slice(line);
        }
    }
    write_png(&path, columns, height, &picture)?;
    println!("{}", path.display());
    Ok(())
}
