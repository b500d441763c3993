//! Nodes of the mesh on which a body breathes, or is pressed by the probe.

use std::time::Instant;

use super::{
    Axis, Column, Compared, Difference, Factor, ImageOptions, Table, coarsened, compared, inside, picture,
    without_grain,
};
use crate::tradeoff::{Choice, GREY_LEVELS, Goal};
use insonify::Error;
use insonify_imaging::scene::SceneFile;
use insonify_imaging::synth::{Backend, FrameState, Synthesizer};
use nalgebra::Matrix4;

/// Motions, each with the frame in which they are largest, of a number.
const MOTIONS: [(&str, &str, [usize; 2]); 2] = [
    ("breathing", "[motion.breathing]\nrate_per_min = 15\n", [1, 3]),
    ("pressing", "[motion.press]\nindent_mm = 10\n", [0, 1]),
];

struct Variant {
    motion: &'static str,
    nodes: usize,
    /// Time of making the mesh and its motion, s.
    prepare_s: f64,
}

const CHOICES: [Choice<Compared<Variant>>; 2] = [
    Factor::new("motion", "motion").of(|row| row.variant.motion.to_owned()),
    Factor::new("nodes", "nodes").of(|row| row.variant.nodes.to_string()),
];

const PREPARE: Column<Compared<Variant>> =
    Axis::log("prepare_s", "prepare s", "time of making the mesh and its motion, s")
        .of(|row| Some(row.variant.prepare_s));

/// Frames of a breath and of a pressed probe on coarse and fine meshes, against the finest.
pub(super) fn bodies(options: &ImageOptions, _: &mut Vec<String>) -> Result<Vec<Table>, Error> {
    let mut rows: Vec<Compared<Variant>> = Vec::new();
    let volume = format!(
        "volume = {{ phantom = \"abdomen\", resolution_mm = {} }}\n",
        options.voxel_mm
    );
    let resolve = |text: &str| SceneFile::parse(text, "the scene of the study")?.resolve(".".as_ref());
    let before = Instant::now();
    resolve(&volume)?;
    let at_rest_s = before.elapsed().as_secs_f64();
    for (motion, table, [frame, frames]) in MOTIONS {
        let mut standard: Option<Vec<u8>> = None;
        for &nodes in &options.moving_nodes {
            let before = Instant::now();
            let scene = resolve(&format!("{volume}deform = {{ nodes = {nodes} }}\n{table}"))?;
            let prepare_s = (before.elapsed().as_secs_f64() - at_rest_s).max(0.0);
            let mut settings = without_grain(scene.settings.clone());
            [settings.probe.lines, settings.probe.samples] = coarsened(options, [256, 512]);
            (settings.image.width, settings.image.height) = (640, 480);
            let mut synth = Synthesizer::new(scene.anatomy.clone(), settings, Backend::Cpu)?;
            let mut state = FrameState::at(Matrix4::identity());
            scene.state(frame, frames, &mut state)?;
            let picture = picture(&mut synth, &state, options.patience)?;
            let Some(standard) = &standard else {
                standard = Some(picture.pixels);
                continue;
            };
            rows.push(Compared {
                variant: Variant {
                    motion,
                    nodes: scene.anatomy.mesh.as_ref().map_or(0, |mesh| mesh.nodes().len()),
                    prepare_s,
                },
                difference: Difference::of(standard, &picture.pixels, &inside(&synth)),
                picture,
                flag: None,
            });
        }
    }
    let title = "A body that breathes, or is pressed: nodes of the mesh that moves it, without grain";
    let [median, p95, memory, rms, p99, bias] = compared();
    let columns = [PREPARE, median, p95, memory, rms, p99, bias];
    let goal = Goal::new("prepare_s", "rms_grey", GREY_LEVELS).choosing("nodes of a moving body");
    let table = Table::of("image_body", title, &CHOICES, &columns, &rows)
        .against("the finest mesh")
        .seeking(goal.each(&["motion"]).beside(&["median_ms", "p99_grey"]));
    Ok(vec![table])
}
