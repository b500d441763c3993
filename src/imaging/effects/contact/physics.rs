//! Skin conforms to the array: no gap within reach, none closed beyond it, and tissue at depth stays.

use insonify_imaging::effects::contact::Contact;
use insonify_imaging::effects::slice::Beyond;
use insonify_imaging::synth::layers::Layer;
use insonify_tracking::probe::{Linear, ProbeShape};

use crate::support::anatomy::{self, Frame, PLAIN, SILENT};
use crate::support::scene;
use crate::support::scene::{beam_after, precisions};

const LINES: u32 = 61;
const SAMPLES: u32 = 160;
const DEPTH_MM: f64 = 80.0;

/// A belly whose skin falls away from the array to both sides: by `x^2 / 100` mm at x mm.
fn belly(x: f64) -> f64 {
    x * x / 100.0
}

#[test]
fn a_belly_touches_a_straight_array_within_reach() {
    let frame = Frame::around([0.0, 45.0, 0.0], [121, 200, 5], 0.5);
    let body = anatomy::anatomy_from(frame, &[SILENT, PLAIN], |p| u8::from(p[1] > belly(p[0])));
    for (name, backend) in precisions() {
        let probe = scene::probe(ProbeShape::Linear(Linear { width_mm: 58.0 }), DEPTH_MM, LINES, SAMPLES);
        let mut settings = scene::settings(probe, scene::bare());
        settings.effects.contact = Some(Contact {
            reach_mm: 5.0,
            fade_mm: 50.0,
        });
        let beam = beam_after(&body, &settings, backend, "slice", &scene::straight());
        for line in 0..LINES as usize {
            let x = -29.0 + 58.0 * line as f64 / f64::from(LINES - 1);
            let void = beam.label[line * SAMPLES as usize..][..SAMPLES as usize]
                .iter()
                .take_while(|label| **label == 0)
                .count() as f64;
            let gap_mm = void * DEPTH_MM / f64::from(SAMPLES);
            // Gaps are smoothed over five scanlines, 4.8 mm, and voxels are 0.5 mm.
            match belly(x) {
                gap if gap < 4.0 => assert!(gap_mm <= 0.5, "{name}: {gap_mm} mm at {x} mm"),
                gap if gap > 6.0 => assert!((gap_mm - gap).abs() < 1.0, "{name}: {gap_mm} mm at {x} mm"),
                _ => {}
            }
            let deep = line * SAMPLES as usize + 101;
            assert!(
                (beam.position[deep][1] - 50.75).abs() < 1e-3,
                "{name}: {:?}",
                beam.position[deep]
            );
            let order = (1..SAMPLES as usize).all(|sample| {
                let row = line * SAMPLES as usize;
                beam.position[row + sample][1] > beam.position[row + sample - 1][1]
            });
            assert!(order, "{name}: line {line}");
        }
    }
}

/// Skin into which an array is pressed lies against it, within reach; deep tissue stays, and so does all of it without
/// skin in reach or beside a face that cuts the body.
#[test]
fn skin_gives_way_where_an_array_is_pressed_in() {
    // In the last case the volume begins at -3 mm.
    for (skin_mm, pressed_mm, middle_mm) in [(-4.0, 4.0, 45.0), (-9.0, 0.0, 45.0), (-100.0, 0.0, 57.0)] {
        let frame = Frame::around([0.0, middle_mm, 0.0], [121, 240, 5], 0.5);
        let body = anatomy::anatomy_from(frame, &[SILENT, PLAIN], |p| u8::from(p[1] > skin_mm));
        for (name, backend) in precisions() {
            let probe = scene::probe(ProbeShape::Linear(Linear { width_mm: 40.0 }), DEPTH_MM, LINES, SAMPLES);
            let mut settings = scene::settings(probe, scene::bare());
            settings.effects.contact = Some(Contact {
                reach_mm: 6.0,
                fade_mm: 50.0,
            });
            let beam = beam_after(&body, &settings, backend, "slice", &scene::straight());
            let row = &beam.position[30 * SAMPLES as usize..][..SAMPLES as usize];
            let (first, deep) = (row[0][1], row[101][1]);
            // The first sample lies 0.25 mm below the array; skin is found within a sixteenth of a step of 0.25 mm
            // from the face of a voxel.
            let expected = 0.25 - pressed_mm * (1.0f64 - 0.25 / 50.0).powi(2);
            assert!(
                (first - expected).abs() < 0.3,
                "{name}, skin at {skin_mm} mm: {first}, not {expected}"
            );
            assert!((deep - 50.75).abs() < 1e-3, "{name}: {deep}");
            assert!(row.windows(2).all(|pair| pair[1][1] > pair[0][1]), "{name}: order");
        }
    }
}

/// A body that a face of the volume cuts goes on beyond it, one that ends before it does not.
#[test]
fn a_body_goes_on_where_the_volume_is_cut() {
    let frame = Frame::around([0.0, 20.0, 0.0], [41, 41, 5], 1.0);
    let body = anatomy::anatomy_from(frame, &[SILENT, PLAIN, PLAIN], |p| match p[0] {
        x if x < -15.0 => 0,
        x if x < 18.0 => 1,
        _ => 2,
    });
    for (name, backend) in precisions() {
        let probe = scene::probe(ProbeShape::Linear(Linear { width_mm: 60.0 }), 20.0, LINES, 20);
        let mut settings = scene::settings(probe, scene::bare());
        let mut labels = |beyond: Beyond| {
            settings.effects.slice.beyond = beyond;
            let backend = match backend {
                insonify_imaging::synth::Backend::CpuF64 => insonify_imaging::synth::Backend::CpuF64,
                _ => insonify_imaging::synth::Backend::Cpu,
            };
            let beam = beam_after(&body, &settings, backend, "slice", &scene::straight());
            (0..LINES as usize)
                .map(|line| beam.label[line * 20 + 10])
                .collect::<Vec<_>>()
        };
        let (void, goes_on) = (labels(Beyond::Void), labels(Beyond::Continue));
        // Scanlines 1 mm apart from x = -30 mm on; the volume reaches from -20.5 to 20.5 mm.
        assert_eq!((void[50], void[51], void[5]), (2, 0, 0), "{name}");
        assert_eq!(
            (goes_on[51], goes_on[53], goes_on[57], goes_on[5]),
            (2, goes_on[53], 1, 0),
            "{name}: {goes_on:?}"
        );
        assert_eq!(void[..=50], goes_on[..=50], "{name}");
    }
}

/// The layer `beyond` marks what is continued, and nothing where nothing is.
#[test]
fn the_layer_beyond_marks_what_is_continued() {
    let frame = Frame::around([0.0, 20.0, 0.0], [41, 41, 5], 1.0);
    let body = anatomy::anatomy_from(frame, &[SILENT, PLAIN], |_| 1);
    let probe = scene::probe(ProbeShape::Linear(Linear { width_mm: 60.0 }), 20.0, LINES, 20);
    let mut settings = scene::settings(probe, scene::bare());
    settings.layers = vec![Layer::Beyond, Layer::Sector];
    for (beyond, expected) in [(Beyond::Void, 0.0), (Beyond::Continue, 19.5 / 60.0)] {
        settings.effects.slice.beyond = beyond;
        let mut synth = crate::support::scene::synthesizer(&body, &settings, insonify_imaging::synth::Backend::Cpu);
        let state = scene::straight();
        let frame = synth.render(&state).expect("a frame");
        let [beyond_it, sector] =
            [0, 1].map(|layer| frame.layers[layer].iter().map(|&value| f64::from(value)).sum::<f64>());
        let share = beyond_it / sector;
        // 19.5 of the 60 mm of the array lie beside the 41 mm of the volume; columns are 60 mm over the width of the
        // image.
        assert!((share - expected).abs() < 0.05, "{beyond:?}: {share}, not {expected}");
    }
}
