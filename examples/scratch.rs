use insonify::effects::*;
use insonify::synth::{tables::*, *};
use insonify::tracking::probe::*;
use std::sync::Arc;
fn main() {
    let t0 = std::time::Instant::now();
    let volume = insonify::phantom::make(insonify::phantom::Phantom::Abdomen, &Default::default()).unwrap();
    eprintln!("phantom {:?} {:?}", t0.elapsed(), volume.size());
    let (tissues, w) = insonify::tissue::TissueTable::resolve(volume.labels(), &[], Default::default()).unwrap();
    eprintln!("{w:?}");
    let probe = Probe::new(
        ProbeShape::Curvilinear {
            radius_mm: 60.0,
            angle_deg: 70.0,
        },
        150.0,
    )
    .unwrap();
    let anatomy = Anatomy {
        volume: Arc::new(volume),
        tissues: Arc::new(tissues),
        textures: Default::default(),
        mesh: None,
    };
    let settings = Settings {
        seed: 1,
        probe,
        image: ImageSize {
            width: 640,
            height: 480,
            margin: 0.02,
            fill: 0,
        },
        effects: Effects::usual(),
        has_needle: false,
    };
    let pose = insonify::phantom::default_pose(insonify::phantom::Phantom::Abdomen);
    let mut state = FrameState::at(pose);
    let mut synth = Synthesizer::new(anatomy.clone(), settings.clone(), Backend::Cpu).unwrap();
    println!("{}", synth.plan().report());
    synth.time_passes(true).unwrap();
    for i in 0..6 {
        let t = std::time::Instant::now();
        state.frame = i;
        synth.render(&state).unwrap();
        eprintln!(
            "cpu {:?} {:?}",
            t.elapsed(),
            synth
                .pass_times()
                .iter()
                .map(|p| format!("{} {:.2}", p.name, p.ms))
                .collect::<Vec<_>>()
        );
    }
    let f = synth.frame().clone();
    insonify::output::png::write_grey("/tmp/cpu.png".as_ref(), f.width, f.height, &f.pixels).unwrap();
    let gpu = insonify::gpu::Gpu::open(&Default::default(), &Default::default()).unwrap();
    let mut g = Synthesizer::new(anatomy, settings, Backend::Gpu(Box::new(gpu))).unwrap();
    g.time_passes(true).unwrap();
    for i in 0..3 {
        let t = std::time::Instant::now();
        state.frame = i;
        g.render(&state).unwrap();
        eprintln!(
            "gpu {:?} {:?}",
            t.elapsed(),
            g.pass_times()
                .iter()
                .map(|p| format!("{} {:.2}", p.name, p.ms))
                .collect::<Vec<_>>()
        );
    }
    let c = synth.render(&state).unwrap().pixels.clone();
    let g = &g.frame().pixels;
    let mut worst = 0;
    let mut n = 0;
    for (a, b) in c.iter().zip(g) {
        let d = a.abs_diff(*b);
        worst = worst.max(d);
        n += usize::from(d > 1);
    }
    eprintln!("worst {worst} over one: {n}");
    insonify::output::png::write_grey("/tmp/gpu.png".as_ref(), f.width, f.height, g).unwrap();
}
