//! The same frame has the same bytes on every run and at any number of threads.

use insonify::imaging::synth::Backend;

use super::synthesizer;
use crate::support::scene::{everything, frame_of};

#[test]
fn the_same_bytes_at_one_two_and_five_threads() {
    let (anatomy, settings, _) = everything();
    for precision in [|| Backend::Cpu, || Backend::CpuF64] {
        let frames = |threads: usize| -> Vec<Vec<u8>> {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .expect("a pool");
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
            let found = used.render(&frame_of(&anatomy, at)).expect("a frame").pixels.clone();
            assert_eq!(found, fresh(at), "frame {at}");
        }
    }
}
