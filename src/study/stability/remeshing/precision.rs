//! Cases that compare f32 with f64.

use faer::MatRef;

use super::setup::{BACKENDS, Now, Start};
use crate::mechanics::tissue::remesh::{Adaptation, Level, Options, Precision, RemeshError};
use crate::study::stability::record::{Record, Unexpected, largest};

/// Returns the largest difference of two K^c relative to the largest entry of the second.
pub fn difference(found: MatRef<'_, f64>, expected: MatRef<'_, f64>) -> f64 {
    let pairs = (0..expected.nrows()).flat_map(|i| (0..expected.ncols()).map(move |j| (i, j)));
    let worst = largest(pairs.clone().map(|at| found[at] - expected[at]));
    worst / largest(pairs.map(|at| expected[at]))
}

/// Makes the same moves in both precisions.
pub fn single_and_double(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let double = BACKENDS.iter().find(|backend| backend.precision == Precision::Double);
    let double = double.ok_or_else(|| Unexpected::new("no backend in f64"))?;
    for poisson in [0.45, 0.49, 0.499] {
        let start = Start::new(record.seed(), poisson)?;
        for backend in BACKENDS.iter().filter(|backend| backend.precision == Precision::Single) {
            for level in [Level::I, Level::II, Level::III, Level::Exact] {
                let what = format!("level {level}, {} against {}, nu {poisson}", backend.name, double.name);
                let options = Options::default();
                let single = backend.follow(&start, level, options);
                if poisson > options.single_poisson_limit && level != Level::Exact {
                    record.refused(what, single, |error| match error {
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
                    format!("difference of K^c, {what}"),
                    difference(single.remesher().condensed(), reference.remesher().condensed()),
                    limit,
                );
                if matches!(level, Level::I | Level::Exact) {
                    // One refinement step with the residual in f64 squares the relative error (Higham, chapter 12).
                    let backward = refined(record, &mut single)?;
                    let squared = (limit * limit).max(1e-12);
                    record.under(
                        format!("backward error after one refinement, {what}"),
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
