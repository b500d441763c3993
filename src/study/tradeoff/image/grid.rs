//! Grid sizes, precisions and backends.

use super::compare::{Apart, inside, picture, values};
use super::scene::{Subject, coarsened, silent, single, too_large, without_grain};
use super::{BACKEND, ImageError, ImageOptions, PICTURE, Table, factor};
use crate::gpu::Gpu;
use crate::imaging::synth::Backend;
use crate::imaging::synth::tables::Settings;
use crate::study::tradeoff::{Axis, Beat, GREY_LEVELS, Goal};

fn name([lines, samples]: [u32; 2]) -> String {
    format!("{lines} x {samples}")
}

/// Name of a comparison, and the change of settings that isolates its content.
type Content = (&'static str, fn(Settings) -> Settings);

/// Contents to compare: structure alone, and everything in a frame except receiver noise, which is random for each sample of a grid.
const CONTENTS: [Content; 2] = [("structure", without_grain), ("every usual effect", silent)];

/// Note on the receiver.
const QUIET: &str = "Beam grids are compared with the receiver at work but too quiet to be seen: its noise is drawn anew for each sample \
                     of a grid as it is for each frame, so that frames differ by it however fine the grids are.";

pub fn grids(options: &ImageOptions, notes: &mut Vec<String>) -> Result<Vec<Table>, ImageError> {
    let subject = Subject::new(options.voxel_mm)?;
    let samples = Axis::log("samples", "samples", "samples of a frame");
    let axes: Vec<Axis> = std::iter::once(samples).chain(PICTURE).collect();
    // Comparing a grid with itself would show no error.
    let Some((&finest, grids)) = options.grids.split_last().filter(|(_, grids)| !grids.is_empty()) else {
        return Err(ImageError::Grids(options.grids.len()));
    };
    let largest = grids[grids.len() - 1];
    let title = format!("Beam grid, against {} in double precision", name(finest));
    let factors = [factor("content", "content"), BACKEND, factor("grid", "grid")];
    let goal = Goal::new("median_ms", "rms_grey", GREY_LEVELS)
        .choosing("grid of the beam")
        .in_every(Beat::Frame, "p95_ms");
    notes.push(QUIET.to_owned());
    let mut table = Table::new("image_grid", title, &factors, &axes)
        .against(format!("{} in double precision", name(finest)))
        .seeking(goal.each(&["content"]).beside(&["p95_ms", "p99_grey", "memory_mb"]));
    for (content, keep) in CONTENTS {
        let settings = |grid| keep(subject.grid(grid));
        let mut gold = subject.on(settings(finest), Backend::CpuF64)?;
        let standard = gold.render(&subject.state)?.pixels.clone();
        let inside = inside(&gold);
        drop(gold);
        for (backend, device) in single(fitting(options, &subject, &settings(largest), notes)?) {
            let mut synth = subject.on(settings(grids[0]), device)?;
            let mut coarser: Option<Apart> = None;
            for &grid in grids {
                synth.set(settings(grid))?;
                let found = picture(&mut synth, &subject.state, options.patience)?;
                let apart = Apart::of(&standard, &found.pixels, &inside);
                let flag = apart.flag(coarser.as_ref());
                let size = f64::from(grid[0]) * f64::from(grid[1]);
                let all = std::iter::once(Some(size))
                    .chain(values(&found, Some(&apart)))
                    .collect();
                table.push(vec![content.to_owned(), backend.clone(), name(grid)], all, flag);
                coarser = Some(apart);
            }
        }
    }
    Ok(vec![table])
}

/// Returns the GPUs if all of them support the finest grid.
fn fitting<'a>(
    options: &'a ImageOptions,
    subject: &Subject,
    largest: &Settings,
    notes: &mut Vec<String>,
) -> Result<&'a [Gpu], ImageError> {
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
fn all(options: &ImageOptions) -> Vec<(String, Backend)> {
    std::iter::once(("cpu f64".to_owned(), Backend::CpuF64))
        .chain(single(&options.gpus))
        .collect()
}

/// Compares double precision, single precision and each GPU on the same scene, at the default scene's grid and one below it.
pub fn backends(options: &ImageOptions, _: &mut Vec<String>) -> Result<Vec<Table>, ImageError> {
    let subject = Subject::new(options.voxel_mm)?;
    let factors = [factor("grid", "grid"), BACKEND];
    let title = "Precisions and backends, every usual effect, against double precision on the CPU";
    let goal = Goal::new("median_ms", "rms_grey", GREY_LEVELS).choosing("backend of images");
    let mut table = Table::new("image_backend", title, &factors, &PICTURE)
        .against("double precision on the CPU")
        .seeking(goal.each(&["grid"]).beside(&["p95_ms", "p99_grey", "memory_mb"]));
    for grid in [[128, 256], [256, 512]].map(|grid| coarsened(options, grid)) {
        let mut standard: Option<Vec<u8>> = None;
        for (backend, device) in all(options) {
            let mut synth = subject.on(subject.grid(grid), device)?;
            let found = picture(&mut synth, &subject.state, options.patience)?;
            let apart = Apart::of(
                standard.as_ref().unwrap_or(&found.pixels),
                &found.pixels,
                &inside(&synth),
            );
            table.push(
                vec![name(grid), backend],
                values(&found, Some(&apart)),
                rounding(&apart),
            );
            standard.get_or_insert(found.pixels);
        }
    }
    Ok(vec![table])
}

/// Describes an error too large for rounding: more than 1 % of pixels beyond one grey level, or an offset.
pub fn rounding(apart: &Apart) -> Option<String> {
    (apart.p99 > 1.0 || apart.bias.abs() > 0.1).then(|| {
        format!(
            "99 of 100 pixels within {} grey levels, {:+.2} on the whole: more than rounding",
            apart.p99, apart.bias
        )
    })
}
