//! How does a simulator drive the synthesizer? It owns the motion: each step it writes the probe's pose, the needle and
//! the mesh nodes into one state that it keeps, and renders. In the steady state nothing is allocated. With tickets a
//! GPU works on up to three frames while the simulator takes its next steps. And what do frames take whose states are
//! all known in advance, as those of a training set? They go in a batch.
//!
//! `cargo run --release --example embedding_loop -- 200 [cpu | gpu]`

use std::collections::VecDeque;
use std::error::Error;
use std::time::Instant;

use insonify::{Backend, Displacement, FrameState, SceneFile, SynthError, Synthesizer, TetMesh};
use nalgebra::{Matrix4, Point3, Rotation3, Translation3, Vector3};

/// The scene without its motion, which is the simulator's.
const SCENE: &str = r#"
volume = { phantom = "abdomen", resolution_mm = 2.0 }
needle = { tip_mm = [-52.3, -20.2, -25.1], entry_mm = [-32.0, -79.6, -7.1] }

[deform]
nodes = 5000
field = { kind = "indentation", centre_mm = [0, 0, 0], direction = [0, 1, 0], depth_mm = 0.0, radius_mm = 25.0 }
"#;

const ENTRY_MM: Point3<f64> = Point3::new(-32.0, -79.6, -7.1);
const TARGET_MM: Point3<f64> = Point3::new(-52.3, -20.2, -25.1);

/// The state of a frame of the motion, in memory that is used again.
fn fill(state: &mut FrameState, frame: usize, rest: &Matrix4<f64>, mesh: &TetMesh) {
    let phase = std::f64::consts::TAU * frame as f64 / 50.0;

    // The hand rocks the probe and slides it along the skin.
    let rock = Rotation3::from_axis_angle(&Vector3::z_axis(), 0.1 * phase.sin()).to_homogeneous();
    state.probe_to_world = rest * Translation3::new(2.0 * phase.cos(), 0.0, 0.0).to_homogeneous() * rock;

    // The needle advances to the target and comes back.
    let reach = 0.5 - 0.5 * phase.cos();
    let tip = ENTRY_MM + (TARGET_MM - ENTRY_MM) * reach;
    if let Some(last) = state.needle.as_mut().and_then(|needle| needle.nodes.last_mut()) {
        *last = tip;
    }

    // Tissue before the tip gives way: here a closed form, in a simulator the nodes of its last step.
    let press = Displacement::Indentation {
        centre_mm: tip.into(),
        direction: (TARGET_MM - ENTRY_MM).into(),
        depth_mm: 4.0 * reach,
        radius_mm: 15.0,
    };
    press.displace(mesh.nodes(), state.nodes.get_or_insert_default());
    state.frame = frame as u64;
}

fn main() -> Result<(), Box<dyn Error>> {
    let frames: usize = std::env::args().nth(1).map_or(Ok(100), |frames| frames.parse())?;
    let backend = match std::env::args().nth(2).as_deref() {
        None | Some("cpu") => Backend::Cpu,
        Some("gpu") => Backend::gpu(),
        Some(other) => return Err(format!("backend \"{other}\": expected cpu or gpu").into()),
    };
    let scene = SceneFile::parse(SCENE, "embedding_loop")?.resolve(".".as_ref())?;
    let rest = *scene.probe_pose(0, 1).probe_to_world();
    let mut state = FrameState::at(Matrix4::identity());
    scene.state(0, 1, &mut state)?;
    let mesh = scene.anatomy.mesh.clone().ok_or("the scene deforms a mesh")?;
    let mut synth = Synthesizer::new(scene.anatomy, scene.settings, backend)?;

    let mut times = Vec::with_capacity(frames);
    for frame in 0..frames {
        fill(&mut state, frame, &rest, &mesh);
        let start = Instant::now();
        synth.render(&state)?;
        times.push(start.elapsed().as_secs_f64() * 1e3);
    }
    let last = synth.frame().clone();

    times.sort_by(f64::total_cmp);
    let median = times.get(frames / 2).ok_or("no frames were asked for")?;
    println!(
        "{frames} frames of {} nodes on the {}",
        mesh.nodes().len(),
        synth.backend()
    );
    println!("median {median:.2} ms, {:.0} frames a second", 1e3 / median);
    println!("95 of 100 frames within {:.2} ms", times[95 * (frames - 1) / 100]);

    // In flight: while a GPU works on frames, the states of the next ones are filled. A frame is taken when three are
    // under way.
    let start = Instant::now();
    let mut in_flight = VecDeque::with_capacity(3);
    for frame in 0..frames {
        fill(&mut state, frame, &rest, &mesh);
        if in_flight.len() == 3
            && let Some(oldest) = in_flight.pop_front()
        {
            std::hint::black_box(synth.take(oldest)?);
        }
        in_flight.push_back(synth.submit(&state)?);
    }
    for ticket in in_flight {
        std::hint::black_box(synth.take(ticket)?);
    }
    println!(
        "in flight {:.0} frames a second",
        frames as f64 / start.elapsed().as_secs_f64()
    );
    assert!(*synth.frame() == last, "the same pixels");

    // The same frames once more, now that all their states are known: each core renders frames of its own.
    let filled = (0..frames).map(|frame| {
        fill(&mut state, frame, &rest, &mesh);
        state.clone()
    });
    let states: Vec<FrameState> = filled.collect();
    let start = Instant::now();
    synth.render_batch(&states, |_, frame| {
        std::hint::black_box(frame);
        Ok::<_, SynthError>(())
    })?;
    println!(
        "in a batch {:.0} frames a second",
        frames as f64 / start.elapsed().as_secs_f64()
    );
    assert!(*synth.frame() == last, "the same pixels");
    Ok(())
}
