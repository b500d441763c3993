//! The same frame has the same bytes on every run and at any number of threads.

use insonify::imaging::effects::Effects;
use insonify::imaging::synth::tables::{Anatomy, Settings};
use insonify::imaging::synth::{Backend, FrameState, NeedleShaft};
use insonify::mechanics::mesh::Displacement;

use super::synthesizer;
use crate::support::anatomy::{self, Acoustics, Frame, PLAIN, SILENT};
use crate::support::scene;

/// Everything at once: textures, a deforming mesh, a bent needle, noise, a thick plane.
pub fn everything() -> (Anatomy, Settings, FrameState) {
    let tissues = [
        SILENT,
        Acoustics {
            attenuation_db_cm_mhz: 0.6,
            texture: Some("liver"),
            ..PLAIN
        },
        Acoustics {
            echo_db: 8.0,
            occlusion_per_mm: 0.1,
            impedance_mrayl: 2.0,
            ..PLAIN
        },
    ];
    let frame = Frame::around([0.0, 20.0, 0.0], [40; 3], 1.0);
    let anatomy = anatomy::random(frame, &tissues, 5);
    let anatomy = anatomy::with_mesh(anatomy, [[-14.0, 4.0, -14.0], [14.0, 36.0, 14.0]], 400);
    let effects = Effects {
        thickness: Some(Default::default()),
        noise: Some(Default::default()),
        ..Effects::usual()
    };
    let mut settings = scene::settings(scene::small_probe(), effects);
    settings.has_needle = true;
    (anatomy.clone(), settings, frame_of(&anatomy, 0))
}

/// A frame of a motion: tissue, needle and probe move.
pub fn frame_of(anatomy: &Anatomy, frame: u64) -> FrameState {
    let share = frame as f64 / 20.0;
    let press = Displacement::Indentation {
        centre_mm: [0.0, 5.0, 0.0],
        direction: [0.1, 1.0, 0.0],
        depth_mm: 4.0 * share.sin(),
        radius_mm: 8.0,
    };
    let mut state = scene::aimed([0.2 * share, 1.0, 0.3], [1.0, 20.0, 0.0], 0.1 * share);
    let mut nodes = Vec::new();
    press.displace(anatomy.mesh.as_ref().expect("a mesh").nodes(), &mut nodes);
    state.nodes = Some(nodes);
    state.frame = frame;
    state.needle = Some(NeedleShaft {
        nodes: [[-15.0, 4.0, 0.0], [-4.0, 14.0 + share, 0.3], [3.0, 24.0, 0.9]]
            .map(Into::into)
            .to_vec(),
        diameter_mm: 1.2,
    });
    state
}

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
