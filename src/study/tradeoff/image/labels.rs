//! Labels of samples near boundaries.

use super::compare::{Apart, inside, picture, values};
use super::scene::coarsened;
use super::{ImageError, ImageOptions, PICTURE, Table, factor};
use crate::imaging::effects::Effects;
use crate::imaging::effects::slice::Boundary;
use crate::imaging::effects::tone::Tone;
use crate::imaging::synth::tables::{Anatomy, ImageSize, Settings};
use crate::imaging::synth::{Backend, FrameState, Synthesizer};
use crate::study::anatomies::{self, Acoustics, Frame, PLAIN, SILENT};
use crate::study::tradeoff::{Axis, Goal, SHIFT_MM};
use crate::tracking::probe::{Probe, ProbeShape};
use nalgebra::Matrix4;

/// Voxel sizes compared, mm, and the finest, from which the standard of grey levels is sliced.
const VOXELS_MM: [f64; 4] = [3.0, 2.0, 1.0, 0.5];
const FINEST_MM: f64 = 0.25;

/// Returns the label at a position (mm): a tilted layer, a ball in it and a vessel through both.
fn label(p: [f64; 3]) -> u8 {
    let square = |axes: &[usize], at: [f64; 3]| axes.iter().map(|&axis| (p[axis] - at[axis]).powi(2)).sum::<f64>();
    if square(&[0, 2], [6.3, 0.0, 1.1]) + 0.2 * (p[1] - 20.0) < 9.0 {
        3
    } else if square(&[0, 1, 2], [-5.2, 21.7, 0.4]) < 81.0 {
        2
    } else {
        u8::from(p[1] + 0.31 * p[0] + 0.17 * p[2] > 7.3)
    }
}

fn anatomy(voxel_mm: f64) -> Anatomy {
    let tissue = |echo_db| Acoustics { echo_db, ..PLAIN };
    let across = (46.0 / voxel_mm).ceil() as usize;
    let size = [across, across, (12.0 / voxel_mm).ceil() as usize];
    let frame = Frame::around([0.0, 20.0, 0.0], size, voxel_mm);
    anatomies::of(frame, &[SILENT, tissue(0.0), tissue(8.0), tissue(-15.0)], label)
}

fn settings(boundary: Boundary, [lines, samples]: [u32; 2]) -> Settings {
    let mut effects = Effects {
        tone: Some(Tone::linear()),
        ..Effects::default()
    };
    effects.slice.boundary = boundary;
    Settings {
        seed: 0,
        probe: Probe {
            shape: ProbeShape::Linear { width_mm: 40.0 },
            depth_mm: 40.0,
            frequency_mhz: 7.0,
            lines,
            samples,
        },
        image: ImageSize {
            width: 480,
            height: 480,
            margin: 0.0,
            fill: 0,
            placed: None,
        },
        effects,
        has_needle: false,
    }
}

/// Returns the mean distance of the sliced boundaries from the closed form, mm: the area of wrong labels divided by the length of all
/// boundaries. The length is counted along the grid's two axes, which averages 4/pi of the true length over all directions.
fn boundary_mm(synth: &mut Synthesizer, state: &FrameState) -> Result<f64, ImageError> {
    let beam = synth.render_until("slice", state)?;
    let tables = synth.tables();
    let (line_mm, sample_mm) = (tables.grid.lateral_spacing_mm(0.0), tables.sample_mm());
    let exact: Vec<u8> = (0..beam.label.len())
        .map(|at| {
            let p = crate::imaging::synth::layers::world_position(
                tables,
                &state.probe_to_world,
                at / beam.samples,
                at % beam.samples,
            );
            label([p.x, p.y, p.z])
        })
        .collect();
    let wrong = exact.iter().zip(&beam.label).filter(|(a, b)| a != b).count();
    let down = exact
        .chunks(beam.samples)
        .flat_map(|line| line.windows(2))
        .filter(|pair| pair[0] != pair[1])
        .count();
    let across = (beam.samples..exact.len())
        .filter(|&at| exact[at] != exact[at - beam.samples])
        .count();
    let length = (down as f64 * line_mm + across as f64 * sample_mm) * std::f64::consts::FRAC_PI_4;
    Ok(wrong as f64 * line_mm * sample_mm / length)
}

pub fn labels(options: &ImageOptions, _: &mut Vec<String>) -> Result<Vec<Table>, ImageError> {
    let state = FrameState::at(Matrix4::identity());
    let grid = coarsened(options, [256, 512]);
    let axes: Vec<Axis> = [
        Axis::log("voxel_mm", "voxel mm", "edge of a voxel, mm"),
        Axis::log(
            "boundary_mm",
            "mm off",
            "mean distance of boundaries from their place, mm",
        ),
    ]
    .into_iter()
    .chain(PICTURE)
    .collect();
    let title = format!(
        "Labels at boundaries: millimetres against their closed form, grey levels against voxels of {FINEST_MM} mm, voted"
    );
    let factors = [factor("boundary", "label"), factor("voxel", "voxel")];
    let goal = Goal::new("median_ms", "boundary_mm", SHIFT_MM).choosing("labels at boundaries");
    let mut table = Table::new("image_labels", title, &factors, &axes)
        .against(format!(
            "boundaries of a closed form (mm); voxels of {FINEST_MM} mm, voted (grey levels)"
        ))
        .seeking(goal.beside(&["p95_ms", "rms_grey", "memory_mb"]));
    let mut finest = Synthesizer::new(anatomy(FINEST_MM), settings(Boundary::Vote, grid), Backend::CpuF64)?;
    let standard = finest.render(&state)?.pixels.clone();
    let inside = inside(&finest);
    for (name, boundary) in [
        ("nearest voxel", Boundary::Nearest),
        ("voted", Boundary::Vote),
        ("smoothed", Boundary::Smooth),
    ] {
        let mut coarser: Option<Apart> = None;
        for voxel_mm in VOXELS_MM {
            let mut synth = Synthesizer::new(anatomy(voxel_mm), settings(boundary, grid), Backend::Cpu)?;
            let found = picture(&mut synth, &state, options.patience)?;
            let apart = Apart::of(&standard, &found.pixels, &inside);
            let off = boundary_mm(&mut synth, &state)?;
            let all = [Some(voxel_mm), Some(off)]
                .into_iter()
                .chain(values(&found, Some(&apart)));
            let flag = apart.flag(coarser.as_ref());
            table.push(vec![name.to_owned(), format!("{voxel_mm} mm")], all.collect(), flag);
            coarser = Some(apart);
        }
    }
    Ok(vec![table])
}
