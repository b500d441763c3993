//! Pages of reference and their pictures: effects, laws of tissue, kinds of probes.
//!
//! `effects.png` shows the same frame with one effect at a time, then with all. The first panel is slicing alone:
//! labels become echoes, shown linearly. The second adds the tone curve, which every further panel has too, beside the
//! one effect in its caption, and speckle and shadows where looks of them are averaged or speckle is reduced. What the
//! effects do is that of their examples, which exaggerate.
//!
//! `cargo run --release --example reference_pages -- docs`

mod caption;
mod pages;

use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};

use insonify::imaging::effects::LISTED;
use insonify::{Backend, Frame, FrameState, Layer, Scene, SceneFile, write_png};
use nalgebra::Matrix4;

/// The scene to which the examples of effects are added. The probe is 4 mm off the skin, and grey around the sector
/// shows it.
const SCENE: &str = r#"
seed = 11
volume = { phantom = "abdomen", resolution_mm = 2.0 }
probe = { kind = "curvilinear", radius_mm = 60.0, angle_deg = 70.0, depth_mm = 104.0, frequency_mhz = 4.0 }
pose = { position_mm = [-68.7, -81.0, -47.2], direction = [0.15, 0.96, 0.23], lateral = [0.66, -0.27, 0.7] }
image = { width = 300, height = 190, margin = 0.015, fill = 48 }
"#;

const COLUMNS: usize = 5;

/// Grey level around the sector, in the scene and below its panel.
const FILL: u8 = 48;

/// Between the two frames of a picture, pixels.
const GAP: usize = 4;

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args_os().nth(1).map_or(".".into(), PathBuf::from);
    for kind in ["effects", "laws", "probes"] {
        fs::create_dir_all(folder.join(kind))?;
    }
    let effects = || LISTED.iter().filter(|effect| !effect.example.is_empty());
    for effect in effects() {
        let others = beside(effect.name);
        let frames = [frame(others)?, frame(&[others, &[effect.name]].concat())?];
        let frames = if effect.name == "contact" {
            frames.map(|frame| enlarged(&frame))
        } else {
            frames
        };
        write_pair(&folder.join("effects").join(format!("{}.png", effect.name)), &frames)?;
    }
    let all: Vec<&str> = effects().map(|effect| effect.name).collect();
    let single = all.iter().filter(|name| !["slice", "tone"].contains(name));
    let mut panels = vec![("slice", frame(&["slice"])?), ("tone", frame(&["tone"])?)];
    for name in single {
        panels.push((name, frame(&[beside(name), &[name]].concat())?));
    }
    panels.push(("all", frame(&all)?));
    write_panels(&folder.join("effects.png"), &panels)?;
    write_pair(&folder.join("effects/scan_conversion.png"), &beam_and_frame(&all)?)?;
    write_panels(&folder.join("effects/truth.png"), &layers(&all)?)?;
    for (name, text) in pages::files()? {
        fs::write(folder.join(name), text)?;
    }
    println!("{}", folder.display());
    Ok(())
}

/// Effects beside which one is shown.
fn beside(effect: &str) -> &'static [&'static str] {
    match effect {
        "tone" => &[],
        "compound" => &["tone", "speckle", "shadow"],
        "speckle_reduction" => &["tone", "speckle"],
        _ => &["tone"],
    }
}

/// A frame of the scene with the examples of these effects.
fn frame(effects: &[&str]) -> Result<Frame, Box<dyn Error>> {
    let scene = scene(effects)?;
    Ok(scene.synthesizer(Backend::Cpu)?.render(&state(&scene)?)?.clone())
}

/// The scene with the examples of these effects.
fn scene(effects: &[&str]) -> Result<Scene, Box<dyn Error>> {
    let shown = LISTED.iter().filter(|effect| effects.contains(&effect.name));
    // A mesh has no table among the effects.
    let keyed = shown.clone().filter(|effect| effect.example.contains("effects."));
    let names: Vec<&str> = keyed.map(|effect| effect.name).collect();
    let mut text = format!("{SCENE}effects.only = {names:?}\n");
    if !names.contains(&"slice") {
        text += "effects.slice.beyond = \"void\"\n";
    }
    for effect in shown {
        text += &format!("{}\n", effect.example);
    }
    Ok(SceneFile::parse(&text, "reference_pages")?.resolve(".".as_ref())?)
}

fn state(scene: &Scene) -> Result<FrameState, Box<dyn Error>> {
    let mut state = FrameState::at(Matrix4::identity());
    scene.state(0, 1, &mut state)?;
    Ok(state)
}

/// The middle of the upper half of a frame, twice as large.
fn enlarged(frame: &Frame) -> Frame {
    let (width, height) = (frame.width, frame.height);
    let pixel = |index: usize| {
        let (column, row) = (index % width, index / width);
        frame.pixels[row / 2 * width + width / 4 + column / 2]
    };
    Frame {
        pixels: (0..width * height).map(pixel).collect(),
        ..frame.clone()
    }
}

/// Grey levels in beam space, scanlines from left to right, and the frame.
fn beam_and_frame(effects: &[&str]) -> Result<[Frame; 2], Box<dyn Error>> {
    let scene = scene(effects)?;
    let mut synthesizer = scene.synthesizer(Backend::Cpu)?;
    let frame = synthesizer.render(&state(&scene)?)?.clone();
    let beam = synthesizer.beam()?;
    let (width, height) = (frame.width, frame.height);
    let pixel = |index: usize| {
        let line = index % width * beam.lines / width;
        let sample = index / width * beam.samples / height;
        beam.amplitude[line * beam.samples + sample].round() as u8
    };
    let unfolded = Frame {
        pixels: (0..width * height).map(pixel).collect(),
        ..frame.clone()
    };
    Ok([unfolded, frame])
}

/// Layers of ground truth of a frame, with their names.
fn layers(effects: &[&str]) -> Result<Vec<(&'static str, Frame)>, Box<dyn Error>> {
    let mut scene = scene(effects)?;
    scene.settings.layers = Layer::ALL.to_vec();
    let state = state(&scene)?;
    let frame = scene.synthesizer(Backend::Cpu)?.render(&state)?.clone();
    let panel = |(layer, values): (Layer, &Vec<u16>)| {
        let [least, largest] =
            [values.iter().min(), values.iter().max()].map(|value| value.map_or(0.0, |value| f64::from(*value)));
        let grey = |value: &u16| (255.0 * (f64::from(*value) - least) / (largest - least).max(1.0)) as u8;
        let pixels = values.iter().map(grey).collect();
        (
            layer.name(),
            Frame {
                pixels,
                ..frame.clone()
            },
        )
    };
    Ok(Layer::ALL.into_iter().zip(&frame.layers).map(panel).collect())
}

/// Writes frames with their names.
fn write_panels(path: &Path, panels: &[(&str, Frame)]) -> Result<(), Box<dyn Error>> {
    let [width, height] = [panels[0].1.width, panels[0].1.height];
    let (columns, rows) = (
        COLUMNS * width,
        panels.len().div_ceil(COLUMNS) * (height + caption::HEIGHT),
    );
    let mut picture = vec![FILL; columns * rows];
    for (index, (name, frame)) in panels.iter().enumerate() {
        let (left, top) = (index % COLUMNS * width, index / COLUMNS * (height + caption::HEIGHT));
        copy(frame, &mut picture, columns, [left, top]);
        caption::write(&mut picture, columns, [left + 8, top + height + 4], name);
    }
    write_png(path, columns, rows, &picture)?;
    Ok(())
}

/// Writes two frames side by side.
fn write_pair(path: &Path, frames: &[Frame; 2]) -> Result<(), Box<dyn Error>> {
    let [width, height] = [frames[0].width, frames[0].height];
    let columns = 2 * width + GAP;
    let mut picture = vec![0; columns * height];
    copy(&frames[0], &mut picture, columns, [0, 0]);
    copy(&frames[1], &mut picture, columns, [width + GAP, 0]);
    write_png(path, columns, height, &picture)?;
    Ok(())
}

/// Copies a frame into a picture with its upper left pixel at `corner`.
fn copy(frame: &Frame, picture: &mut [u8], columns: usize, [left, top]: [usize; 2]) {
    for (row, line) in frame.pixels.chunks_exact(frame.width).enumerate() {
        picture[(top + row) * columns + left..][..frame.width].copy_from_slice(line);
    }
}
