//! The same frame has the same bytes on every run and at any number of threads.

use insonify_base::parallel::Pool;
use insonify_imaging::synth::layers::Layer;
use insonify_imaging::synth::{Backend, FrameState, SynthError, Synthesizer};
use insonify_mesh::TetMesh;

use crate::support::gpu::{backend, gpu_or_skip};
use crate::support::scene::synthesizer;
use crate::support::scene::{everything, frame_of};

#[test]
fn the_same_bytes_at_one_two_and_five_threads() {
    let (anatomy, settings, _) = everything();
    for precision in [|| Backend::Cpu, || Backend::CpuF64] {
        let frames = |threads: usize| -> Vec<Vec<u8>> {
            let pool = Pool::new(threads).expect("a pool");
            pool.install(|| {
                let mut synthesizer = synthesizer(&anatomy, &settings, precision());
                (0..4)
                    .map(|at| {
                        synthesizer
                            .render(&frame_of(&anatomy, at))
                            .expect("a frame")
                            .pixels
                            .clone()
                    })
                    .collect()
            })
        };
        let one = frames(1);
        assert!(one.windows(2).all(|pair| pair[0] != pair[1]), "the frames move");
        for threads in [2, 5] {
            assert_eq!(frames(threads), one, "{threads} threads");
        }
    }
}

#[test]
fn a_frame_does_not_remember_the_frames_before_it() {
    let (anatomy, settings, _) = everything();
    for precision in [|| Backend::Cpu, || Backend::CpuF64] {
        let fresh = |at: u64| -> Vec<u8> {
            synthesizer(&anatomy, &settings, precision())
                .render(&frame_of(&anatomy, at))
                .expect("a frame")
                .pixels
                .clone()
        };
        let mut used = synthesizer(&anatomy, &settings, precision());
        for at in [0, 7, 3, 19, 3, 0] {
            let pixels = used.render(&frame_of(&anatomy, at)).expect("a frame").pixels.clone();
            assert_eq!(pixels, fresh(at), "frame {at}");
        }
    }
}

fn pool(threads: usize) -> Pool {
    Pool::new(threads).expect("a pool")
}

/// States in batches and alone: a probe and tissue that move and rest, nodes of the reference state that remeshing
/// moves and moves back, and nodes that only the first frame of a batch gives.
fn rounds(mesh: &TetMesh, at: impl Fn(u64) -> FrameState) -> [Vec<FrameState>; 4] {
    let mut states: Vec<FrameState> = (0..26).map(at).collect();
    for (frame, state) in states.iter_mut().enumerate() {
        if frame % 4 == 2 || frame > 13 && frame != 17 {
            state.nodes = None;
        }
    }
    for frame in [4, 8, 10, 11] {
        states[frame].probe_to_world = states[frame - 1].probe_to_world;
    }
    let mut remeshed = mesh.nodes().to_vec();
    for node in &mut remeshed {
        node[0] += 1.0;
    }
    states[5].reference = Some(remeshed);
    states[8].reference = Some(mesh.nodes().to_vec());
    let last = states.split_off(17);
    let third = states.split_off(14);
    let second = states.split_off(13);
    [states, second, third, last]
}

#[test]
fn batches_have_the_bytes_of_single_frames() {
    let (anatomy, mut settings, _) = everything();
    settings.layers = Layer::ALL.to_vec();
    let rounds = rounds(anatomy.mesh.as_ref().expect("a mesh"), |at| frame_of(&anatomy, at));
    let gpu = gpu_or_skip();
    let on_gpu = || backend(gpu.clone().expect("a GPU"));
    let precisions: [&(dyn Fn() -> Backend + Sync); 3] = [&|| Backend::Cpu, &|| Backend::CpuF64, &on_gpu];
    for precision in &precisions[..if gpu.is_some() { 3 } else { 2 }] {
        let mut single = synthesizer(&anatomy, &settings, precision());
        let expected = rounds.iter().flatten();
        let expected: Vec<_> = expected
            .map(|state| single.render(state).expect("a frame").clone())
            .collect();
        let beam = single.beam().expect("a beam");
        for threads in [1, 2, 7] {
            pool(threads).install(|| {
                let mut batches = synthesizer(&anatomy, &settings, precision());
                let mut frames = Vec::new();
                for states in &rounds {
                    let before = frames.len();
                    let sunk = batches.render_batch(states, |at, frame| {
                        assert_eq!(before + at, frames.len(), "in order");
                        frames.push(frame.clone());
                        Ok::<_, SynthError>(())
                    });
                    sunk.expect("a batch");
                    assert_eq!(batches.frame(), &frames[frames.len() - 1]);
                }
                let differ = frames
                    .iter()
                    .zip(&expected)
                    .position(|(frame, expected)| frame != expected);
                assert_eq!((differ, frames.len()), (None, expected.len()), "{threads} threads");
                assert_eq!(batches.beam().expect("a beam"), beam, "{threads} threads");
                // The mesh stays as the last frame left it, and settings change for all threads.
                let mut more = settings.clone();
                more.effects.tone.get_or_insert_default().gain_db += 3.0;
                batches.set(more.clone()).expect("settings");
                let rest = &rounds[3][1..];
                let mut brighter = Vec::new();
                let sunk = batches.render_batch(rest, |_, frame| {
                    brighter.push(frame.pixels.clone());
                    Ok::<_, SynthError>(())
                });
                sunk.expect("a batch");
                let mut single = synthesizer(&anatomy, &more, precision());
                rounds.iter().flatten().for_each(|state| drop(single.render(state)));
                let expected = rest
                    .iter()
                    .map(|state| single.render(state).expect("a frame").pixels.clone());
                assert!(brighter.into_iter().eq(expected), "{threads} threads, other settings");
            });
        }
    }
}

#[test]
fn a_batch_ends_with_the_first_error() {
    let (anatomy, settings, _) = everything();
    let mut states: Vec<FrameState> = (0..12).map(|at| frame_of(&anatomy, at)).collect();
    let run = |synth: &mut Synthesizer, states: &[FrameState], stop: usize| {
        let mut seen = Vec::new();
        let result = synth.render_batch(states, |at, _| {
            seen.push(at);
            if at == stop { Err(SynthError::Busy) } else { Ok(()) }
        });
        (seen, result.is_err())
    };
    for threads in [1, 3] {
        pool(threads).install(|| {
            let mut synth = synthesizer(&anatomy, &settings, Backend::Cpu);
            assert_eq!(run(&mut synth, &states, 5), ((0..6).collect(), true), "the sink's");
            states[7].nodes = Some(vec![[0.0; 3]; 2]);
            assert_eq!(run(&mut synth, &states, 99), ((0..7).collect(), true), "a frame's");
            states[7] = frame_of(&anatomy, 7);
            assert_eq!(run(&mut synth, &states, 99), ((0..12).collect(), false), "usable again");
            assert_eq!(run(&mut synth, &[], 99), (Vec::new(), false), "no frames");
        });
    }
}
