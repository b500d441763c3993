//! Cases of error accumulation: many remeshes, every GPU, and single against double precision.

use std::sync::Arc;

use faer::MatRef;

use crate::stability::fixtures::{BACKENDS, Inverses, Now, Start, gpus};
use crate::stability::record::{Record, Unexpected, largest};
use insonify_mechanics::remesh_gpu::follow;
use insonify_mechanics::tissue::factor::pivots;
use insonify_mechanics::tissue::inverse::sampled_residual;
use insonify_mechanics::tissue::remesh::{
    Adaptation, Level, Precision, Rebuilt, RemeshError, Remesher, RemesherOptions, Source,
};

const POISSON: [f64; 3] = [0.45, 0.499, 0.4999];

/// Relative error of 1: a rounding bound this large is meaningless.
const ALL: f64 = 1.0;

/// Numbers of remeshes after which the inverse is compared with a fresh one.
fn counts(record: &Record<'_>) -> &'static [u64] {
    record.effort().pick(&[1, 10, 50], &[1, 10, 100, 1000, 5000])
}

/// Calls `measure` for every backend and Poisson's ratio, and reports progress.
fn each(
    record: &mut Record<'_>,
    mut measure: impl FnMut(&mut Record<'_>, &Inverses, &Start, f64) -> Result<(), Unexpected>,
) -> Result<(), Unexpected> {
    let total = (BACKENDS.len() * POISSON.len()) as f64;
    for (index, poisson) in POISSON.into_iter().enumerate() {
        let start = Start::new(record.seed(), poisson)?;
        for (nth, backend) in BACKENDS.iter().enumerate() {
            record.done((index * BACKENDS.len() + nth) as f64 / total);
            measure(record, backend, &start, poisson)?;
        }
    }
    Ok(())
}

/// Returns nodes spread over the block, which are moved repeatedly.
fn spread(start: &Start) -> Vec<u32> {
    start.free.iter().copied().step_by(9).collect()
}

/// Tests the exact level: S computed from scratch, C monitored and refreshed.
pub(super) fn exact(record: &mut Record<'_>) -> Result<(), Unexpected> {
    each(record, |record, backend, start, poisson| {
        let mut adaptation = backend.follow(start, Level::Exact, RemesherOptions::default())?;
        let (nodes, mut done, mut rebuilds, mut failed) = (spread(start), 0, 0u32, 0u32);
        for &count in counts(record) {
            start.go(&mut adaptation, &nodes, done..count, |_, report| {
                rebuilds += u32::from(report.rebuilt.is_some());
                failed += u32::from(report.rebuild_failed);
                Ok(())
            })?;
            done = count;
            let state = Now::of(adaptation.mesh())?;
            let subject = format!("{}, nu {poisson}, {count} remeshes", backend.name);
            let allowed = start.allowed(&state, backend);
            for (matrix, error) in [
                ("K^-1", state.error_of_all(&mut adaptation)?),
                ("K^c", state.error_of_contacts(&adaptation)),
            ] {
                let subject = format!("error of {matrix}, {subject}");
                // Near the incompressible rounding may take every digit: such an error is shown, not judged.
                if allowed < ALL {
                    record.under(subject, error, allowed)
                } else {
                    record.report(format!("{subject}, of which rounding may take all"), error)
                }
            }
        }
        record.report(
            format!("number of rebuilds, {}, nu {poisson}", backend.name),
            f64::from(rebuilds),
        );
        record.zero(
            format!("refreshes that failed, {}, nu {poisson}", backend.name),
            f64::from(failed),
        );
        Ok(())
    })
}

/// Returns the residual tolerance enforced by the monitor of level I.
fn tolerance(options: &RemesherOptions, precision: Precision) -> f64 {
    match precision {
        Precision::Single => options.residual_single,
        Precision::Double => options.residual_double,
    }
}

/// Returns the residual over all columns of the contacts.
fn of_contacts(adaptation: &mut Adaptation) -> Result<f64, RemeshError> {
    let contacts = adaptation.remesher().contacts().to_vec();
    let (mesh, remesher) = adaptation.parts();
    remesher.residual(mesh, &contacts)
}

/// Tests level I: rounding accumulates in the inverse and is monitored.
pub(super) fn first(record: &mut Record<'_>) -> Result<(), Unexpected> {
    each(record, |record, backend, start, poisson| {
        let options = RemesherOptions::default();
        let beyond = poisson > options.single_poisson_limit && backend.precision == Precision::Single;
        if beyond {
            let refused = backend.follow(start, Level::I, options);
            record.refused(
                format!("level I in {} at nu {poisson}", backend.name),
                refused,
                |error| matches!(error, RemeshError::Unsuited { reason, .. } if reason.contains(&poisson.to_string())),
            );
            return Ok(());
        }
        let limit = tolerance(&options, backend.precision);
        let mut adaptation = backend.follow(start, Level::I, options)?;
        let (nodes, mut done, mut rebuilds) = (spread(start), 0, 0u32);
        let [mut residuals, mut reported] = [Vec::new(), Vec::new()];
        for &count in counts(record) {
            start.go(&mut adaptation, &nodes, done..count, |adaptation, report| {
                let residual = of_contacts(adaptation)?;
                // Where a refresh fails, the level has said that it cannot meet
                // its tolerance: reported, but no fault.
                if report.rebuild_failed {
                    &mut reported
                } else {
                    &mut residuals
                }
                .push(residual);
                rebuilds += u32::from(report.rebuilt.is_some());
                Ok(())
            })?;
            done = count;
            let state = Now::of(adaptation.mesh())?;
            record.under(
                format!("error of K^-1, {}, nu {poisson}, {count} remeshes", backend.name),
                state.error_of_all(&mut adaptation)?,
                start.allowed(&state, backend),
            );
        }
        let subject = format!("{}, nu {poisson}", backend.name);
        // Even an inverse computed afresh leaves a residual: below this floor no update can get.
        let mut recomputed = Now::of(adaptation.mesh())?.inverse;
        let stiffness = adaptation.mesh().stiffness().at_nodes(adaptation.mesh().nodes())?;
        let floor = sampled_residual(&stiffness, &mut recomputed, &start.contacts)?;
        record.under(format!("worst residual, {subject}"), largest(residuals), limit);
        record.report(
            format!("worst residual where the level reports that it cannot meet {limit:.0e}, {subject}"),
            largest(reported),
        );
        record.report(format!("residual of an inverse recomputed in f64, {subject}"), floor);
        record.report(format!("refreshes, {subject}"), f64::from(rebuilds));
        Ok(())
    })?;
    drifting(record)
}

/// Tests that the monitor detects drift when level I runs in f32 beyond its Poisson limit.
fn drifting(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let start = Start::new(record.seed(), 0.499)?;
    let backends = BACKENDS.iter().filter(|backend| backend.precision == Precision::Single);
    for backend in backends {
        // Without the limit of level I single precision drifts, as it must here for the monitor to see it.
        let watched = RemesherOptions {
            single_poisson_limit: 0.5,
            check_every: 1,
            ..RemesherOptions::default()
        };
        let unwatched = RemesherOptions {
            check_every: 0,
            ..watched
        };
        let count = record.effort().pick(100, 1000);
        let error = |options| -> Result<(f64, u32), Unexpected> {
            let mut adaptation = backend.follow(&start, Level::I, options)?;
            let mut rebuilds = 0;
            start.go(&mut adaptation, &spread(&start), 0..count, |_, report| {
                rebuilds += u32::from(matches!(report.rebuilt, Some(Rebuilt::Residual(_))));
                Ok(())
            })?;
            Ok((Now::of(adaptation.mesh())?.error_of_contacts(&adaptation), rebuilds))
        };
        let ((watched_error, rebuilds), (unwatched_error, _)) = (error(watched)?, error(unwatched)?);
        let subject = format!("{} at nu 0.499, {count} remeshes", backend.name);
        record.zero(format!("drift unseen, {subject}"), f64::from(rebuilds == 0));
        record.report(format!("error of K^c, watched, {subject}"), watched_error);
        record.report(
            format!("error of K^c, not watched, {subject}"),
            unwatched_error.min(f64::MAX),
        );
        record.under(
            format!("error watched over error not watched, {subject}"),
            watched_error / unwatched_error,
            0.5,
        );
    }
    Ok(())
}

fn is_definite(adaptation: &Adaptation) -> bool {
    pivots(adaptation.remesher().condensed()).is_some()
}

/// Tests levels II and III: they leave entries outdated, so K^c is an approximation, but it remains a compliance.
pub(super) fn lower(record: &mut Record<'_>) -> Result<(), Unexpected> {
    each(record, |record, backend, start, poisson| {
        for level in [Level::II, Level::III] {
            let options = RemesherOptions::default();
            let mut adaptation = match backend.follow(start, level, options) {
                Err(RemeshError::Unsuited { .. }) if backend.precision == Precision::Single && poisson > 0.49 => {
                    continue;
                }
                result => result?,
            };
            let (nodes, mut done, mut rebuilds, mut indefinite) = (start.free.clone(), 0, 0u32, 0u32);
            let subject = format!("level {level}, {}, nu {poisson}", backend.name);
            for &count in counts(record) {
                start.go(&mut adaptation, &nodes, done..count, |adaptation, report| {
                    rebuilds += u32::from(report.rebuilt == Some(Rebuilt::Indefinite));
                    indefinite += u32::from(!is_definite(adaptation));
                    Ok(())
                })?;
                done = count;
                let state = Now::of(adaptation.mesh())?;
                // An error of the size of the compliance itself would make K^c meaningless.
                let error = state.error_of_contacts(&adaptation);
                record.under(format!("error of K^c, {subject}, {count} remeshes"), error, 1.0);
            }
            record.zero(
                format!("times K^c was left indefinite, {subject}"),
                f64::from(indefinite),
            );
            record.report(format!("refreshes, {subject}"), f64::from(rebuilds));
        }
        Ok(())
    })
}

/// Number of moves after which single and double precision are compared, as on the CPU.
const COMPARED: u64 = 10;

/// Makes the same moves on a device and in double precision on the CPU, then many more.
pub(super) fn all(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let many = record.effort().pick(60, 1000);
    let gpus = gpus(record);
    let double = BACKENDS.iter().find(|backend| backend.precision == Precision::Double);
    let double = double.ok_or_else(|| Unexpected::new("no backend in f64"))?;
    let start = Start::new(record.seed(), 0.45)?;
    for gpu in &gpus {
        for level in [Level::I, Level::II, Level::III] {
            let subject = format!("level {level}, {}", gpu.report().name);
            let source = Source::Single(Arc::clone(&start.single));
            let mut device = follow(gpu, &start.mesh, &source, level, RemesherOptions::default())?;
            device.set_contacts(&start.contacts)?;
            let mut mesh = start.mesh.clone();
            let mut reference = double.follow(&start, level, RemesherOptions::default())?;
            start.go(&mut reference, &start.free, 0..COMPARED, |_, _| Ok(()))?;
            let (mut rebuilds, mut violations) = (0, 0);
            for n in 0..many {
                // Rounding in f32 adds up with every move: a comparison with f64 has a bound after a few
                // moves only, later K^c merely has to stay finite.
                if n == COMPARED {
                    let limit = Now::of(&mesh)?.condition * f64::from(f32::EPSILON);
                    record.under(
                        format!("difference of K^c to f64 after {COMPARED} moves, {subject}"),
                        difference(device.condensed(), reference.remesher().condensed()),
                        limit,
                    );
                }
                let (node, position) = start.nth_move(&start.free, n);
                if mesh.assess(node, position).is_ok() {
                    let change = mesh.move_node(node, position)?;
                    let report = device.remesh(&mesh, &change)?;
                    rebuilds += usize::from(report.rebuilt.is_some());
                    violations += usize::from(
                        device
                            .condensed()
                            .col_iter()
                            .any(|column| column.iter().any(|x| !x.is_finite())),
                    );
                }
            }
            record.zero(
                format!("states of K^c that are not finite in {many} moves, {subject}"),
                violations as f64,
            );
            record.report(
                format!("number of rebuilds in {many} moves, {subject}"),
                rebuilds as f64,
            );
        }
    }
    Ok(())
}

/// Returns the largest difference of two K^c relative to the largest entry of the second.
pub(super) fn difference(matrix: MatRef<'_, f64>, expected: MatRef<'_, f64>) -> f64 {
    let pairs = (0..expected.nrows()).flat_map(|i| (0..expected.ncols()).map(move |j| (i, j)));
    let worst = largest(pairs.clone().map(|index| matrix[index] - expected[index]));
    worst / largest(pairs.map(|index| expected[index]))
}

/// Makes the same moves in both precisions.
pub(crate) fn single_and_double(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let double = BACKENDS.iter().find(|backend| backend.precision == Precision::Double);
    let double = double.ok_or_else(|| Unexpected::new("no backend in f64"))?;
    for poisson in [0.45, 0.49, 0.499] {
        let start = Start::new(record.seed(), poisson)?;
        for backend in BACKENDS.iter().filter(|backend| backend.precision == Precision::Single) {
            for level in [Level::I, Level::II, Level::III, Level::Exact] {
                let subject = format!("level {level}, {} against {}, nu {poisson}", backend.name, double.name);
                let options = RemesherOptions::default();
                let single = backend.follow(&start, level, options);
                if poisson > options.single_poisson_limit && level != Level::Exact {
                    record.refused(subject, single, |error| match error {
                        RemeshError::Unsuited {
                            level: named, reason, ..
                        } => *named == level && reason.contains("use f64"),
                        _ => false,
                    });
                    continue;
                }
                let (mut single, mut reference) = (single?, double.follow(&start, level, options)?);
                start.go(&mut single, &start.free, 0..10, |_, _| Ok(()))?;
                start.go(&mut reference, &start.free, 0..10, |_, _| Ok(()))?;
                let limit = Now::of(reference.mesh())?.condition * f64::from(f32::EPSILON);
                record.under(
                    format!("difference of K^c, {subject}"),
                    difference(single.remesher().condensed(), reference.remesher().condensed()),
                    limit,
                );
                if matches!(level, Level::I | Level::Exact) {
                    // One refinement step with the residual in f64 squares the relative error (Higham, chapter 12).
                    let backward = refined(record, &mut single)?;
                    let squared = (limit * limit).max(1e-12);
                    record.under(
                        format!("backward error after one refinement, {subject}"),
                        backward,
                        squared,
                    );
                }
            }
        }
    }
    Ok(())
}

/// Returns the backward error, after one refinement step, of displacements under forces on all contacts.
fn refined(record: &Record<'_>, adaptation: &mut Adaptation) -> Result<f64, Unexpected> {
    let (mesh, remesher) = adaptation.parts();
    let forces: Vec<f64> = (0..remesher.contacts().len() as u64).map(|i| record.noise(i)).collect();
    let mut displacement = vec![0.0; mesh.dofs().free()];
    Ok(remesher.displacement_refined(mesh, &forces, &mut displacement)?)
}
