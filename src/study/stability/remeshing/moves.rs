//! Cases of node moves that return, and of moves with overlapping supports.

use super::setup::{BACKENDS, Now, Start, bits};
use crate::mechanics::tissue::remesh::{Level, Options, Precision};
use crate::study::stability::record::{Record, Unexpected};

/// Moves a node away and back, many times.
pub fn out_and_back(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let rounds = record.effort().pick(60, 1000);
    for poisson in [0.45, 0.499, 0.4999] {
        let start = Start::new(record.seed(), poisson)?;
        for backend in BACKENDS {
            let what = format!("{}, nu {poisson}", backend.name);
            let mut exact = backend.follow(&start, Level::Exact, Options::default())?;
            let (before, mut changed, mut held) = (bits(&exact), 0, 0);
            for n in 0..rounds {
                start.go(&mut exact, &start.free, n..n + 1, |exact, _| {
                    held += exact.undo()?.map_or(1, |report| report.held);
                    Ok(())
                })?;
                changed += usize::from(bits(&exact) != before);
            }
            record.zero(
                format!("rounds after which K^c has changed, exact, {what}"),
                changed as f64,
            );
            record.zero(format!("rows of S left, exact, {what}"), held as f64);
            if backend.precision == Precision::Single && poisson > Options::default().single_poisson_limit {
                continue;
            }
            let mut first = backend.follow(&start, Level::I, Options::default())?;
            for n in 0..rounds {
                start.go(&mut first, &start.free, n..n + 1, |first, _| {
                    first.undo()?;
                    Ok(())
                })?;
            }
            let now = Now::of(first.mesh())?;
            let error = now.error_of_all(&mut first)?;
            record.under(
                format!("error of K^-1 after {rounds} rounds, level I, {what}"),
                error,
                start.allowed(&now, backend),
            );
        }
    }
    Ok(())
}

/// Moves nodes whose supports overlap.
pub fn overlapping(record: &mut Record<'_>) -> Result<(), Unexpected> {
    for poisson in [0.45, 0.499] {
        let start = Start::new(record.seed(), poisson)?;
        let is_free = |corners: &&[u32; 4]| corners.iter().all(|node| start.free.contains(node));
        let element = start.mesh.elements().iter().find(is_free);
        let [a, b, c, d] = *element.ok_or_else(|| Unexpected::new("no element without a fixed node"))?;
        let sequences: [(&str, &[u32]); 3] = [
            ("two neighbours", &[a, b]),
            ("the same node twice", &[a, a]),
            ("every node of an element, some twice", &[a, b, a, c, d, b]),
        ];
        for backend in BACKENDS {
            for level in [Level::I, Level::Exact] {
                if level == Level::I && backend.precision == Precision::Single && poisson > 0.49 {
                    continue;
                }
                for (name, nodes) in sequences {
                    let mut adaptation = backend.follow(&start, level, Options::default())?;
                    let mut moved = 0;
                    for (n, node) in (0..).zip(nodes) {
                        start.go(&mut adaptation, &[*node], n..n + 1, |_, _| {
                            moved += 1;
                            Ok(())
                        })?;
                    }
                    let what = format!("{name}, level {level}, {}, nu {poisson}", backend.name);
                    record.zero(format!("moves that did not fit, {what}"), (nodes.len() - moved) as f64);
                    let now = Now::of(adaptation.mesh())?;
                    let error = now.error_of_all(&mut adaptation)?;
                    record.under(format!("error of K^-1, {what}"), error, start.allowed(&now, backend));
                }
            }
        }
    }
    Ok(())
}
