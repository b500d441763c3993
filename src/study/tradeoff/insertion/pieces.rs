//! Length of a needle's pieces (links of angular springs or beam elements): error of the shape against the finest, and cost.

use super::columns::{TIMES, UNSETTLED, factor, largest, points, times, unsettled};
use super::course::{self, Course, Step};
use super::{Findings, InsertionOptions, InsertionStudyError, Progress};
use crate::mechanics::needle::{InvalidNeedleModel, Needle, Shaft, Stiffness};
use crate::study::block;
use crate::study::tradeoff::{Axis, Beat, Factor, Goal, SHIFT_MM, Table};

/// Discretisation of a needle.
pub(super) struct Pieces {
    /// Name of the pieces, used in the keys of the table and its factor.
    name: &'static str,
    length: Factor,
    /// Lengths, mm; the last and finest is the gold standard.
    lengths_mm: &'static [f64],
    choosing: &'static str,
    figure: [&'static str; 2],
    needle: fn(f64) -> Result<Box<dyn Needle>, InvalidNeedleModel>,
}

/// Links joined by angular springs.
pub(super) const LINKS: Pieces = Pieces {
    name: "links",
    length: factor("link_mm", "links of, mm"),
    lengths_mm: &[20.0, 10.0, 5.0, 2.5, 1.25],
    choosing: "links of the needle",
    figure: ["insertion-links", "Links of the needle: what accuracy costs"],
    needle: |length_mm| block::springs(Stiffness::default(), length_mm, block::BEVEL),
};

/// Elements of a beam.
pub(super) const ELEMENTS: Pieces = Pieces {
    name: "elements",
    length: factor("element_mm", "elements of, mm"),
    lengths_mm: &[20.0, 10.0, 5.0, 2.5],
    choosing: "elements of a beam in an insertion",
    figure: ["insertion-elements", "Elements of a beam needle: what accuracy costs"],
    needle: |length_mm| block::beam(Stiffness::default(), length_mm, block::BEVEL),
};

pub(super) fn run(
    pieces: &Pieces,
    options: &InsertionOptions,
    progress: Progress<'_>,
) -> Result<Findings, InsertionStudyError> {
    let finest = pieces.lengths_mm[pieces.lengths_mm.len() - 1];
    let (name, key) = (pieces.name, pieces.length.key);
    let axes = [
        Axis::linear("pieces", "pieces", "pieces of the whole needle"),
        Axis::linear(
            "deflection_mm",
            "aside mm",
            "tip beside the straight path at full depth, mm",
        ),
        Axis::log(
            "tip_mm",
            "tip off, mm",
            "largest difference of the tip on the way in, mm",
        ),
        Axis::log(
            "force_n",
            "force off, N",
            "largest difference of the force at the base on the way in, N",
        ),
    ];
    let mut table = Table::new(
        name,
        format!("Needle in {name}: differences from {name} of {finest} mm"),
        &[pieces.length],
        &[&axes[..], &TIMES, &[UNSETTLED]].concat(),
    )
    .against(format!("{name} of {finest} mm"))
    .seeking(
        Goal::new("remesh_median_ms", "tip_mm", SHIFT_MM)
            .choosing(pieces.choosing)
            .in_every(Beat::Step, "remesh_median_ms")
            .beside(&["median_ms", "p99_ms", "force_n"]),
    );
    let course = Course {
        depth_mm: options.depth_mm,
        probe: false,
    };
    let mut models = Vec::new();
    for &length_mm in pieces.lengths_mm {
        models.push(course::model(course::tissue(
            options.nodes,
            (pieces.needle)(length_mm)?,
        )?)?);
    }
    let traces = course.drive(&mut models, options.passes, |share| progress(pieces.choosing, share))?;
    let gold = &traces[traces.len() - 1];
    let inward = course.moved();
    for (&length_mm, steps) in pieces.lengths_mm.iter().zip(&traces) {
        let most = |of: &dyn Fn(&Step, &Step) -> f64| {
            let pairs = gold.iter().zip(steps).take(inward);
            (length_mm != finest).then(|| largest(pairs.map(|(a, b)| of(a, b))))
        };
        let tip = steps[inward - 1].tip_mm;
        let aside = (tip.x - course::ENTRY[0]).hypot(tip.y - course::ENTRY[1]);
        let own = [
            Some((Shaft::default().length_mm / length_mm).round()),
            Some(aside),
            most(&|a, b| (a.tip_mm - b.tip_mm).norm()),
            most(&|a, b| (a.force_n - b.force_n).norm()),
        ];
        let values = [&own[..], &times(steps), &[unsettled(steps)]].concat();
        table.push(vec![length_mm.to_string()], values, None);
    }
    table.mark_gold(key, &finest.to_string());
    let [file, title] = pieces.figure;
    let figure = points(file, title, name, ["remesh_median_ms", "tip_mm"], key);
    Ok(Findings {
        tables: vec![table],
        figures: vec![figure],
        ..Findings::default()
    })
}
