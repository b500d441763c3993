//! Springs and beam compared as needle models in insertion: error of the bent shape, and time per call.

use std::time::Instant;

use nalgebra::{Isometry3, Vector3};

use super::{axis, factor};
use crate::base::report::statistics::Spread;
use crate::mechanics::needle::{CentreLine, Flexible, InvalidNeedleModel, Load, Needle, Row, Shaft, Stiffness};
use crate::study::tradeoff::{Figure, Goal, SHIFT_MM, Table};

const LENGTHS_MM: [f64; 5] = [20.0, 10.0, 5.0, 2.0, 1.0];
/// Element length of the reference needle, mm.
const FINE_MM: f64 = 0.25;
/// Number of contacts along the inserted half of the needle. Each pushes as tissue does: in one direction near the entry, in the opposite
/// one at the tip.
const CONTACTS: usize = 20;
/// Number of timed calls.
const REPEATS: usize = 41;
/// Number of calls after which the lever arms follow the bent shape.
const CALLS: usize = 60;

pub(super) fn table() -> Result<Table, InvalidNeedleModel> {
    let axes = [
        axis("length_mm", "length mm", "length of a link or an element, mm", true),
        axis(
            "median_ms",
            "ms",
            "time of shape and flexibility at 20 contacts (median), ms",
            true,
        ),
        axis(
            "p95_ms",
            "p95 ms",
            "time of shape and flexibility at 20 contacts (95th percentile), ms",
            true,
        ),
        axis("error_mm", "error mm", "largest error of the shaft, mm", true),
        axis("tip_mm", "tip mm", "error of the tip, mm", true),
    ];
    let factors = [factor("model", "needle"), factor("length", "link or element")];
    let title = "Models of a needle in insertion: 200 mm, EI 6131 N mm^2, bent by 20 contacts";
    let mut table = Table::new("needles", title, &factors, &axes)
        .against(format!("a beam in elements of {FINE_MM} mm"))
        .seeking(
            Goal::new("median_ms", "error_mm", SHIFT_MM)
                .choosing("springs or a beam as the model of a needle, at one length of its pieces")
                .each(&["length"])
                .beside(&["p95_ms"]),
        );
    let beam = |length| Flexible::beam(Shaft::default(), Stiffness::default(), length, None);
    let truth = bent(&mut beam(FINE_MM)?);
    for length in LENGTHS_MM {
        let springs = Flexible::springs(Shaft::default(), Stiffness::default(), length, None)?;
        let models: [(&str, Box<dyn Needle>); 2] = [("springs", Box::new(springs)), ("beam", Box::new(beam(length)?))];
        for (name, mut needle) in models {
            let line = bent(&mut *needle);
            let away = (0..=200).map(|arc| {
                let [found, expected] = [&line, &truth].map(|line| line.at(f64::from(arc)).point_mm);
                (found - expected).norm()
            });
            let error = away.fold(0.0, f64::max);
            let tip = (line.tip() - truth.tip()).norm();
            let time = time(&mut *needle, line);
            let values = vec![
                Some(length),
                time.map(|time| time.median_ms),
                time.map(|time| time.p95_ms),
                Some(error),
                Some(tip),
            ];
            table.push(vec![name.to_owned(), format!("{length} mm")], values, None);
        }
    }
    Ok(table)
}

fn loads() -> Vec<Load> {
    let load = |at: usize| {
        let share = at as f64 / (CONTACTS - 1) as f64;
        Load {
            arc_mm: 100.0 + 100.0 * share,
            force_n: Vector3::new(0.05 - 0.08 * share, 0.002, -0.002),
        }
    };
    (0..CONTACTS).map(load).collect()
}

/// Returns the equilibrium shape under the loads, with updated lever arms.
fn bent(needle: &mut dyn Needle) -> CentreLine {
    let (loads, mut line) = (loads(), CentreLine::default());
    for _ in 0..CALLS {
        needle.place(&Isometry3::identity(), None, &loads, &loads, &mut line);
    }
    line
}

/// Times the computation of a shape and its flexibility.
fn time(needle: &mut dyn Needle, mut line: CentreLine) -> Option<Spread> {
    let loads = loads();
    let rows = loads.iter().flat_map(|load| {
        [Vector3::x(), Vector3::y()].map(|direction| Row {
            arc_mm: load.arc_mm,
            direction,
        })
    });
    let rows: Vec<Row> = rows.collect();
    let (mut drift, mut out) = (vec![0.0; rows.len()], vec![0.0; rows.len() * rows.len()]);
    let times = (0..REPEATS).map(|_| {
        let start = Instant::now();
        needle.place(&Isometry3::identity(), None, &loads, &loads, &mut line);
        needle.linearise(&line, &loads, &rows, &mut drift, &mut out);
        start.elapsed().as_secs_f64() * 1e3
    });
    Spread::of(times.collect())
}

pub(super) fn figures() -> Vec<Figure> {
    vec![Figure {
        marker: vec!["length"],
        joined: false,
        ..Figure::new(
            "beam-needles",
            "Springs and beam: what accuracy costs",
            "needles",
            ["median_ms", "error_mm"],
            "model",
        )
    }]
}
