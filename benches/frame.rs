//! Whole frames at 256 scanlines x 512 samples to 640 x 480 pixels, and the passes that they are made of.
//!
//! Times of passes are those that the synthesizer measures itself; a group is all passes of one effect. The CPU backend is
//! measured always, the GPU where there is an adapter.

use std::time::Duration;

use criterion::{Criterion, SamplingMode, criterion_group, criterion_main};
use insonify::gpu::{AdapterChoice, Gpu, Needs};
use insonify::imaging::effects::{Effects, REGISTRY};
use insonify::imaging::synth::{Backend, FrameState, Synthesizer};
use insonify::input::scene::SceneFile;
use nalgebra::Matrix4;

/// The default abdomen with everything that a frame can have.
const SCENE: &str = r#"
version = 1
volume = { phantom = "abdomen" }
needle = { tip_mm = [-52.3, -20.2, -25.1], entry_mm = [-32.0, -79.6, -7.1] }

[deform]
nodes = 5000
field = { kind = "indentation", centre_mm = [-52.3, -20.2, -25.1], direction = [0, 1, 0], depth_mm = 4, radius_mm = 15 }

[effects]
contact = {}
texture = {}
speckle = {}
interface = {}
needle = {}
shadow = {}
blur = {}
receiver = {}
tone = {}
noise = {}
"#;

/// What a frame is made of, from little to much.
#[derive(Clone, Copy)]
enum Load {
    Slicing,
    Usual,
    Full,
}

impl Load {
    const ALL: [(&str, Self); 3] = [("slicing", Self::Slicing), ("usual", Self::Usual), ("full", Self::Full)];

    fn prepare(self, backend: Backend) -> (Synthesizer, FrameState) {
        let scene = SceneFile::parse(SCENE, "benches/frame.rs").and_then(|file| file.resolve(".".as_ref()));
        let mut scene = scene.expect("a valid scene");
        let mut state = FrameState::at(Matrix4::identity());
        scene.state(0, 1, &mut state).expect("a first frame");
        if !matches!(self, Self::Full) {
            (scene.anatomy.mesh, scene.settings.has_needle) = (None, false);
            (state.nodes, state.needle) = (None, None);
        }
        match self {
            Self::Slicing => scene.settings.effects = Effects::default(),
            Self::Usual => scene.settings.effects = Effects::usual(),
            Self::Full => (),
        }
        let synth = Synthesizer::new(scene.anatomy, scene.settings, backend).expect("a synthesizer");
        (synth, state)
    }
}

fn whole_frames(criterion: &mut Criterion) {
    let gpu = Gpu::open(&AdapterChoice::from_flag(None), &Needs::default());
    if let Err(error) = &gpu {
        println!("only the CPU is measured: {error}");
    }
    for backend in ["cpu", "gpu"] {
        let mut group = criterion.benchmark_group(format!("frame/{backend}"));
        group.sampling_mode(SamplingMode::Flat);
        for (name, load) in Load::ALL {
            let backend = match (&gpu, backend) {
                (_, "cpu") => Backend::Cpu,
                (Ok(gpu), _) => Backend::Gpu(Box::new(gpu.clone())),
                (Err(_), _) => continue,
            };
            let (mut synth, state) = load.prepare(backend);
            group.bench_function(name, |bencher| {
                bencher.iter(|| synth.render(&state).map(|frame| frame.pixels[0]).expect("a frame"));
            });
        }
        group.finish();
    }
}

fn passes(criterion: &mut Criterion) {
    let (mut synth, state) = Load::Full.prepare(Backend::Cpu);
    synth.time_passes(true).expect("the CPU can time passes");
    let mut group = criterion.benchmark_group("pass/cpu");
    group.sampling_mode(SamplingMode::Flat);
    for effect in REGISTRY {
        if !synth.plan().has(effect.name) {
            continue;
        }
        let names: Vec<&str> = (effect.passes)(synth.tables()).iter().map(|pass| pass.name).collect();
        group.bench_function(effect.name, |bencher| {
            bencher.iter_custom(|frames| {
                let mut ms = 0.0;
                for _ in 0..frames {
                    synth.render(&state).expect("a frame");
                    let of_effect = synth.pass_times().iter().filter(|time| names.contains(&time.name));
                    ms += of_effect.map(|time| time.ms).sum::<f64>();
                }
                Duration::from_secs_f64(ms / 1e3)
            });
        });
    }
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_secs(2));
    targets = whole_frames, passes
}
criterion_main!(benches);
