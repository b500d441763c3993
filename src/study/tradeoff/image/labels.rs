//! Grids, labels and effects of an image.

use nalgebra::Matrix4;

use super::{
    BACKEND, Compared, Difference, Factor, ImageOptions, Subject, Table, coarsened, compared, inside, picture, silent,
    single, too_large, without_grain,
};
use crate::StudyError;
use crate::tradeoff::{Axis, Choice, Column, Deadline, GREY_LEVELS, Goal, SHIFT_MM};
use insonify::Error;
use insonify_gpu::Gpu;
use insonify_imaging::anatomies::{self, Acoustics, Frame, PLAIN, SILENT};
use insonify_imaging::effects::slice::{Beyond, Boundary};
use insonify_imaging::effects::tone::Tone;
use insonify_imaging::effects::{Effects, REGISTRY};
use insonify_imaging::synth::tables::{Anatomy, Settings};
use insonify_imaging::synth::{Backend, FrameState, Synthesizer};
use insonify_tracking::probe::{Linear, Probe, ProbeShape};

/// Voxel sizes compared, mm, and the finest, from which the standard of grey levels is sliced.
const VOXELS_MM: [f64; 4] = [3.0, 2.0, 1.0, 0.5];
const FINEST_MM: f64 = 0.25;

/// Returns the label at a position (mm): a tilted layer, a ball in it and a vessel through both.
fn label(p: [f64; 3]) -> u8 {
    let square =
        |axes: &[usize], centre: [f64; 3]| axes.iter().map(|&axis| (p[axis] - centre[axis]).powi(2)).sum::<f64>();
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
    anatomies::anatomy_from(frame, &[SILENT, tissue(0.0), tissue(8.0), tissue(-15.0)], label)
}

fn settings(boundary: Boundary, [lines, samples]: [u32; 2]) -> Settings {
    let mut effects = Effects {
        tone: Some(Tone::linear()),
        ..Effects::default()
    };
    effects.slice.boundary = boundary;
    let probe = Probe {
        shape: ProbeShape::Linear(Linear { width_mm: 40.0 }),
        depth_mm: 40.0,
        frequency_mhz: 7.0,
        lines,
        samples,
        aperture: Default::default(),
    };
    Settings::new(probe, [480; 2], effects)
}

/// Returns the mean distance of the sliced boundaries from the closed form, mm: the area of wrong labels divided by the
/// length of all boundaries. The length is counted along the grid's two axes, which averages 4/pi of the true length
/// over all directions.
fn boundary_mm(synth: &mut Synthesizer, state: &FrameState) -> Result<f64, Error> {
    let beam = synth.render_until("slice", state)?;
    let tables = synth.tables();
    let (line_mm, sample_mm) = (tables.grid.lateral_spacing_mm(0.0), tables.sample_mm());
    let exact: Vec<u8> = (0..beam.label.len())
        .map(|index| {
            let p = insonify_imaging::synth::layers::world_position(
                tables,
                &state.probe_to_world,
                index / beam.samples,
                index % beam.samples,
            );
            label([p.x, p.y, p.z])
        })
        .collect();
    // A boundary off by a distance mislabels an area of that width: no boundary has to be traced.
    let mislabelled = exact.iter().zip(&beam.label).filter(|(a, b)| a != b).count();
    let vertical = exact
        .chunks(beam.samples)
        .flat_map(|line| line.windows(2))
        .filter(|pair| pair[0] != pair[1])
        .count();
    let across = (beam.samples..exact.len())
        .filter(|&index| exact[index] != exact[index - beam.samples])
        .count();
    let length = (vertical as f64 * line_mm + across as f64 * sample_mm) * std::f64::consts::FRAC_PI_4;
    Ok(mislabelled as f64 * line_mm * sample_mm / length)
}

/// Accuracy of labels at a boundary.
struct Labelled {
    boundary: &'static str,
    voxel_mm: f64,
    /// Mean distance of boundaries from their place, mm.
    boundary_mm: f64,
}

const LABELLED: [Choice<Compared<Labelled>>; 2] = [
    Factor::new("boundary", "label").of(|row| row.variant.boundary.to_owned()),
    Factor::new("voxel", "voxel").of(|row| format!("{} mm", row.variant.voxel_mm)),
];

const BOUNDARIES: [Column<Compared<Labelled>>; 2] = [
    Axis::log("voxel_mm", "voxel mm", "edge of a voxel, mm").of(|row| Some(row.variant.voxel_mm)),
    Axis::log(
        "boundary_mm",
        "mm off",
        "mean distance of boundaries from their place, mm",
    )
    .of(|row| Some(row.variant.boundary_mm)),
];

pub(super) fn labels(options: &ImageOptions, _: &mut Vec<String>) -> Result<Vec<Table>, Error> {
    let state = FrameState::at(Matrix4::identity());
    let grid = coarsened(options, [256, 512]);
    // Grey levels have no closed form, so that the finest voxels stand for the truth; boundaries have one.
    let mut finest = Synthesizer::new(anatomy(FINEST_MM), settings(Boundary::Vote, grid), Backend::CpuF64)?;
    let standard = finest.render(&state)?.pixels.clone();
    let inside = inside(&finest);
    let mut rows = Vec::new();
    for (name, boundary) in [
        ("nearest voxel", Boundary::Nearest),
        ("voted", Boundary::Vote),
        ("smoothed", Boundary::Smooth),
    ] {
        let mut coarser: Option<Difference> = None;
        for voxel_mm in VOXELS_MM {
            let mut synth = Synthesizer::new(anatomy(voxel_mm), settings(boundary, grid), Backend::Cpu)?;
            let picture = picture(&mut synth, &state, options.patience)?;
            let difference = Difference::of(&standard, &picture.pixels, &inside);
            rows.push(Compared {
                variant: Labelled {
                    boundary: name,
                    voxel_mm,
                    boundary_mm: boundary_mm(&mut synth, &state)?,
                },
                picture,
                difference,
                flag: difference.flag(coarser.as_ref()),
            });
            coarser = Some(difference);
        }
    }
    let title = format!(
        "Labels at boundaries: millimetres against their closed form, grey levels against voxels of {FINEST_MM} mm, voted"
    );
    let goal = Goal::new("median_ms", "boundary_mm", SHIFT_MM).choosing("labels at boundaries");
    let columns: Vec<_> = BOUNDARIES.into_iter().chain(compared()).collect();
    let table = Table::of("image_labels", title, &LABELLED, &columns, &rows)
        .flagged(&rows, |row| row.flag.clone())
        .against(format!(
            "boundaries of a closed form (mm); voxels of {FINEST_MM} mm, voted (grey levels)"
        ))
        .seeking(goal.beside(&["p95_ms", "rms_grey", "memory_mb"]));
    Ok(vec![table])
}

pub(super) fn name([lines, samples]: [u32; 2]) -> String {
    format!("{lines} x {samples}")
}

/// Name of a comparison, and the change of settings that isolates its content.
type Content = (&'static str, fn(Settings) -> Settings);

/// Contents to compare: structure alone, and everything in a frame except haze and receiver noise, which are random for
/// each sample of a grid.
const CONTENTS: [Content; 2] = [("structure", without_grain), ("every usual effect", silent)];

/// Note on the receiver.
const QUIET: &str = "Beam grids are compared with haze and receiver enabled at an invisible level, because they are drawn for each sample \
                     and therefore differ from grid to grid, however fine the grids are.";

/// A grid of the beam on a backend.
struct Gridded {
    content: &'static str,
    backend: String,
    grid: [u32; 2],
}

const GRIDDED: [Choice<Compared<Gridded>>; 3] = [
    Factor::new("content", "content").of(|row| row.variant.content.to_owned()),
    BACKEND.of(|row| row.variant.backend.clone()),
    Factor::new("grid", "grid").of(|row| name(row.variant.grid)),
];

const SAMPLES: Column<Compared<Gridded>> = Axis::log("samples", "samples", "samples of a frame").of(|row| {
    let [lines, samples] = row.variant.grid.map(f64::from);
    Some(lines * samples)
});

pub(super) fn grids(options: &ImageOptions, notes: &mut Vec<String>) -> Result<Vec<Table>, Error> {
    let subject = Subject::new(options.voxel_mm)?;
    // Comparing a grid with itself would show no error.
    let Some((&finest, grids)) = options.grids.split_last().filter(|(_, grids)| !grids.is_empty()) else {
        let count = options.grids.len();
        return Err(StudyError::refused(format!(
            "{count} grids: expected two or more; the finest is the gold standard"
        )));
    };
    let largest = grids[grids.len() - 1];
    notes.push(QUIET.to_owned());
    let mut rows = Vec::new();
    for (content, reduced) in CONTENTS {
        let settings = |grid| reduced(subject.grid(grid));
        let mut gold = subject.on(settings(finest), Backend::CpuF64)?;
        let standard = gold.render(&subject.state)?.pixels.clone();
        let inside = inside(&gold);
        drop(gold);
        for (backend, device) in single(fitting(options, &subject, &settings(largest), notes)?) {
            let mut synth = subject.on(settings(grids[0]), device)?;
            let mut coarser: Option<Difference> = None;
            for &grid in grids {
                synth.set(settings(grid))?;
                let picture = picture(&mut synth, &subject.state, options.patience)?;
                let difference = Difference::of(&standard, &picture.pixels, &inside);
                rows.push(Compared {
                    variant: Gridded {
                        content,
                        backend: backend.clone(),
                        grid,
                    },
                    picture,
                    difference,
                    flag: difference.flag(coarser.as_ref()),
                });
                coarser = Some(difference);
            }
        }
    }
    let title = format!("Beam grid, against {} in double precision", name(finest));
    let goal = Goal::new("median_ms", "rms_grey", GREY_LEVELS)
        .choosing("grid of the beam")
        .in_every(Deadline::Frame, "p95_ms");
    let columns: Vec<_> = std::iter::once(SAMPLES).chain(compared()).collect();
    let table = Table::of("image_grid", title, &GRIDDED, &columns, &rows)
        .flagged(&rows, |row| row.flag.clone())
        .against(format!("{} in double precision", name(finest)))
        .seeking(goal.each(&["content"]).beside(&["p95_ms", "p99_grey", "memory_mb"]));
    Ok(vec![table])
}

/// Returns the GPUs if all of them support the finest grid.
fn fitting<'a>(
    options: &'a ImageOptions,
    subject: &Subject,
    largest: &Settings,
    notes: &mut Vec<String>,
) -> Result<&'a [Gpu], Error> {
    Ok(match too_large(subject, largest, &options.gpus)? {
        None => &options.gpus,
        Some(why) => {
            if !notes.contains(&why) {
                notes.push(why);
            }
            &[]
        }
    })
}

/// Returns all backends, the gold standard first.
fn all_backends(options: &ImageOptions) -> Vec<(String, Backend)> {
    std::iter::once(("cpu f64".to_owned(), Backend::CpuF64))
        .chain(single(&options.gpus))
        .collect()
}

/// A grid, and the backend that renders it.
type OnBackend = Compared<([u32; 2], String)>;

const ON_BACKEND: [Choice<OnBackend>; 2] = [
    Factor::new("grid", "grid").of(|row| name(row.variant.0)),
    BACKEND.of(|row| row.variant.1.clone()),
];

/// Compares double precision, single precision and each GPU on the same scene, at the default scene's grid and one
/// below it.
pub(super) fn backends(options: &ImageOptions, _: &mut Vec<String>) -> Result<Vec<Table>, Error> {
    let subject = Subject::new(options.voxel_mm)?;
    let mut rows: Vec<OnBackend> = Vec::new();
    for grid in [[128, 256], [256, 512]].map(|grid| coarsened(options, grid)) {
        let mut standard: Option<Vec<u8>> = None;
        for (backend, device) in all_backends(options) {
            let mut synth = subject.on(subject.grid(grid), device)?;
            let picture = picture(&mut synth, &subject.state, options.patience)?;
            let standard = standard.get_or_insert_with(|| picture.pixels.clone());
            let difference = Difference::of(standard, &picture.pixels, &inside(&synth));
            rows.push(Compared {
                variant: (grid, backend),
                picture,
                difference,
                flag: rounding(&difference),
            });
        }
    }
    let title = "Precisions and backends, every usual effect, against double precision on the CPU";
    let goal = Goal::new("median_ms", "rms_grey", GREY_LEVELS).choosing("backend of images");
    let table = Table::of("image_backend", title, &ON_BACKEND, &compared(), &rows)
        .flagged(&rows, |row| row.flag.clone())
        .against("double precision on the CPU")
        .seeking(goal.each(&["grid"]).beside(&["p95_ms", "p99_grey", "memory_mb"]));
    Ok(vec![table])
}

/// Describes an error too large for rounding: more than 1 % of pixels beyond one grey level, or an offset.
pub(super) fn rounding(difference: &Difference) -> Option<String> {
    (difference.p99 > 1.0 || difference.bias.abs() > 0.1).then(|| {
        format!(
            "99 of 100 pixels within {} grey levels, {:+.2} on the whole: more than rounding",
            difference.p99, difference.bias
        )
    })
}

/// Simplification of a frame: its name and the change of effects.
type Simpler = (&'static str, fn(&mut Effects));

/// Simplifications within an effect, beside the removal of each.
const SIMPLER: [Simpler; 9] = [
    ("body ends at the volume", |effects| effects.slice.beyond = Beyond::Void),
    ("labels voted", |effects| effects.slice.boundary = Boundary::Vote),
    ("labels of the nearest voxel", |effects| {
        effects.slice.boundary = Boundary::Nearest
    }),
    ("interfaces without roughness", |effects| {
        if let Some(interface) = &mut effects.interface {
            interface.roughness = 0.0;
        }
    }),
    ("shadows straight down", |effects| {
        if let Some(shadow) = &mut effects.shadow {
            shadow.f_number = Some(0.0);
        }
    }),
    ("without reverberation", |effects| {
        if let Some(shadow) = &mut effects.shadow {
            shadow.reverberation = 0.0;
        }
    }),
    ("without mirror images", |effects| {
        if let Some(shadow) = &mut effects.shadow {
            shadow.mirror = 0.0;
        }
    }),
    ("without automatic gain", |effects| {
        if let Some(tone) = &mut effects.tone {
            tone.auto_gain = 0.0;
        }
    }),
    ("tone alone on labels", |effects| {
        *effects = Effects {
            tone: effects.tone.clone(),
            ..Effects::default()
        };
    }),
];

/// Settings of a frame with all effects, without each, and with each simplified.
fn simplified(full: &Settings, synth: &Synthesizer) -> Vec<(String, Settings)> {
    let mut rows = vec![("every usual effect".to_owned(), full.clone())];
    for effect in REGISTRY.iter().filter(|effect| synth.plan().has(effect.name)) {
        let (mut anatomy, mut settings) = (synth.tables().anatomy.clone(), full.clone());
        effect
            .remove
            .iter()
            .for_each(|remove| remove(&mut anatomy, &mut settings));
        if settings != *full {
            rows.push((format!("without {}", effect.name), settings));
        }
    }
    rows.extend(SIMPLER.iter().map(|(name, simplify)| {
        let mut settings = full.clone();
        simplify(&mut settings.effects);
        ((*name).to_owned(), settings)
    }));
    rows
}

pub(super) fn effects(options: &ImageOptions, _: &mut Vec<String>) -> Result<Vec<Table>, Error> {
    let subject = Subject::new(options.voxel_mm)?;
    let usual = subject.grid(coarsened(options, [256, 512]));
    let mut gold = subject.on(usual.clone(), Backend::CpuF64)?;
    let standard = gold.render(&subject.state)?.pixels.clone();
    let inside = inside(&gold);
    let mut synth = subject.on(usual.clone(), Backend::Cpu)?;
    let mut rows = Vec::new();
    for (name, settings) in simplified(&usual, &gold) {
        synth.set(settings)?;
        let picture = picture(&mut synth, &subject.state, options.patience)?;
        rows.push(Compared {
            variant: name,
            difference: Difference::of(&standard, &picture.pixels, &inside),
            picture,
            // Removing an effect may change the frame as a whole.
            flag: None,
        });
    }
    let title = "Effects: what a frame without one saves, and by how much it differs from the frame with all";
    let goal = Goal::new("median_ms", "rms_grey", GREY_LEVELS).choosing("effects");
    let choice = Factor::new("effects", "effects").of(|row: &Compared<String>| row.variant.clone());
    let table = Table::of("image_effects", title, &[choice], &compared(), &rows)
        .against("every usual effect in double precision")
        .seeking(goal.beside(&["p95_ms", "p99_grey", "memory_mb"]));
    Ok(vec![table])
}
