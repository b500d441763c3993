//! Cases of remeshing levels on every available GPU.

use std::sync::Arc;

use super::precision::difference;
use super::setup::{BACKENDS, Now, Start};
use crate::mechanics::remesh_gpu::follow;
use crate::mechanics::tissue::remesh::{Level, Options, Precision, Remesher, Source};
use crate::study::stability::images::setup::gpus;
use crate::study::stability::record::{Record, Unexpected};

/// Number of moves after which single and double precision are compared, as on the CPU.
const COMPARED: u64 = 10;

/// Makes the same moves on a device and in double precision on the CPU, then many more.
pub fn all(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let many = record.effort().pick(60, 1000);
    let gpus = gpus(record);
    let double = BACKENDS.iter().find(|backend| backend.precision == Precision::Double);
    let double = double.ok_or_else(|| Unexpected::new("no backend in f64"))?;
    let start = Start::new(record.seed(), 0.45)?;
    for gpu in &gpus {
        for level in [Level::I, Level::II, Level::III] {
            let what = format!("level {level}, {}", gpu.report().name);
            let source = Source::Single(Arc::clone(&start.single));
            let mut device = follow(gpu, &start.mesh, &source, level, Options::default())?;
            device.set_contacts(&start.contacts)?;
            let mut mesh = start.mesh.clone();
            let mut reference = double.follow(&start, level, Options::default())?;
            start.go(&mut reference, &start.free, 0..COMPARED, |_, _| Ok(()))?;
            let (mut rebuilds, mut wrong) = (0, 0);
            for n in 0..many {
                if n == COMPARED {
                    let limit = Now::of(&mesh)?.condition * f64::from(f32::EPSILON);
                    record.under(
                        format!("difference of K^c to f64 after {COMPARED} moves, {what}"),
                        difference(device.condensed(), reference.remesher().condensed()),
                        limit,
                    );
                }
                let (node, position) = start.nth_move(&start.free, n);
                if mesh.assess(node, position).is_ok() {
                    let change = mesh.move_node(node, position)?;
                    let report = device.remesh(&mesh, &change)?;
                    rebuilds += usize::from(report.rebuilt.is_some());
                    wrong += usize::from(
                        device
                            .condensed()
                            .col_iter()
                            .any(|column| column.iter().any(|x| !x.is_finite())),
                    );
                }
            }
            record.zero(
                format!("states of K^c that are not finite in {many} moves, {what}"),
                wrong as f64,
            );
            record.report(
                format!("times that all was computed anew in {many} moves, {what}"),
                rebuilds as f64,
            );
        }
    }
    Ok(())
}
