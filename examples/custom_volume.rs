//! How is anatomy imaged that exists only in memory? An array of labels, a table of tissues and a solid texture, all
//! made here: a cyst and a stone in a gland, under a linear probe.
//!
//! `cargo run --release --example custom_volume -- cyst.png`

use std::collections::BTreeMap;
use std::error::Error;
use std::path::PathBuf;
use std::sync::Arc;

use insonify::probe::Linear;
use insonify::{
    Anatomy, Backend, Effects, FrameState, Label, LabelVolume, Pose, Probe, Settings, SolidTexture, Synthesizer,
    Tissue, TissueTable, builtin_tissue, write_png,
};
use nalgebra::{Matrix4, Point3, Vector3};

/// Voxels along each axis, each half a millimetre long.
const SIZE: [usize; 3] = [100, 100, 40];
const VOXEL_MM: f64 = 0.5;

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args_os().nth(1).map_or("cyst.png".into(), PathBuf::from);

    // Labels: 0 background, 1 gland, 2 cyst, 3 stone; x fastest.
    let ball = |p: [f64; 3], centre: [f64; 3], radius: f64| {
        (0..3).map(|i| (p[i] - centre[i]).powi(2)).sum::<f64>() < radius * radius
    };
    let voxels = (0..SIZE.iter().product()).map(|at: usize| {
        let p = [at % SIZE[0], at / SIZE[0] % SIZE[1], at / SIZE[0] / SIZE[1]].map(|i| i as f64 * VOXEL_MM);
        if ball(p, [16.0, 20.0, 10.0], 7.0) {
            2
        } else {
            1 + 2 * u8::from(ball(p, [36.0, 22.0, 10.0], 2.5))
        }
    });
    let labels = ["background", "gland", "cyst", "stone"].iter().zip(0..);
    let labels = labels.map(|(name, value)| Label {
        value,
        name: Some((*name).into()),
        voxels: 0,
    });
    let volume = LabelVolume::new(SIZE, voxels.collect(), labels.collect(), Matrix4::new_scaling(VOXEL_MM))?;

    // Tissues: built-in ones, and a gland with a texture of its own.
    let preset = |name: &str| {
        builtin_tissue(name)
            .cloned()
            .ok_or(format!("no tissue is called {name}"))
    };
    let gland = Tissue {
        name: "gland".into(),
        texture: Some("lobules".into()),
        ..preset("soft_tissue")?
    };
    let tissues = TissueTable {
        tissues: vec![preset("background")?, gland, preset("cyst")?, preset("bone")?],
        of_label: vec![0, 1, 2, 3],
        ..TissueTable::default()
    };

    // The texture: bright septa between lobules, periodic along all axes.
    let wave = |i: usize| (std::f32::consts::TAU * i as f32 / 24.0).cos();
    let lobules = (0..24 * 24 * 24).map(|at| 0.4 + (wave(at % 24) + wave(at / 24 % 24) + wave(at / 576)).powi(2) / 3.0);
    let lobules = SolidTexture::new([24; 3], [0.4; 3], lobules.collect())?;

    let anatomy = Anatomy {
        volume: Arc::new(volume),
        tissues: Arc::new(tissues),
        textures: BTreeMap::from([("lobules".to_owned(), Arc::new(lobules))]),
        mesh: None,
    };
    let probe = Probe::new(Linear { width_mm: 44.0 }, 45.0)?;
    let mut settings = Settings::new(probe, [480; 2], Effects::usual());
    settings.seed = 1;
    settings.image.margin = 0.02;
    let pose = Pose::from_direction(Point3::new(25.0, 0.0, 10.0), Vector3::y(), None)?;
    let mut synth = Synthesizer::new(anatomy, settings, Backend::Cpu)?;
    let frame = synth.render(&FrameState::at(*pose.probe_to_world()))?;
    write_png(&path, frame.width, frame.height, &frame.pixels)?;
    println!("{}", path.display());
    Ok(())
}
