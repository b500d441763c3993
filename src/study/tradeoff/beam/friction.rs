//! Effect and cost of the friction term.

use std::hint::black_box;
use std::time::Instant;

use super::{FINE_MM, apart, axis, factor, solve};
use crate::base::report::statistics::Spread;
use crate::mechanics::needle::beam::{Base, BeamError, FoundationBeam};
use crate::study::beam::{ELEMENT_MM, TISSUES, problem};
use crate::study::tradeoff::{Figure, Goal, SHIFT_MM, Table};

const FRICTION: [f64; 5] = [0.0, 0.1, 0.3, 0.6, 1.0];
const SLOPES: [f64; 3] = [-0.1, -0.4, -0.8];

pub(super) fn table() -> Result<Table, BeamError> {
    let axes = [
        axis("gamma", "gamma", "friction, gamma", false),
        axis(
            "tip_mm",
            "tip mm",
            "change of the tip's deflection against no friction, mm",
            false,
        ),
        axis("shape_mm", "shape mm", "largest change of the deflection, mm", false),
        axis("com_mm", "COM mm", "change of the centre of motion's depth, mm", false),
    ];
    let factors = [
        factor("tissue", "tissue"),
        factor("slope", "slope"),
        factor("friction", "friction"),
    ];
    let title = "Friction: change against none, 60 mm in, base 20 mm before the entry, moved by 15 mm";
    let mut table = Table::new("friction", title, &factors, &axes).against("the same needle without friction");
    for tissue in TISSUES {
        for slope in SLOPES {
            let base = Base {
                displacement_mm: 15.0,
                slope: Some(slope),
            };
            let mut needle = problem(tissue.material, tissue.compression, 20.0, 60.0, ELEMENT_MM);
            let smooth = solve(&needle, &base)?;
            for friction in FRICTION {
                needle.layers[0].friction = friction;
                let rough = solve(&needle, &base)?;
                let com = rough
                    .com_mm()
                    .zip(smooth.com_mm())
                    .map(|(rough, smooth)| rough - smooth);
                let values = vec![
                    Some(friction),
                    Some(rough.tip_mm() - smooth.tip_mm()),
                    Some(apart(&rough, &smooth)),
                    com,
                ];
                let choices = vec![tissue.name.to_owned(), format!("slope {slope}"), format!("{friction}")];
                table.push(choices, values, None);
            }
        }
    }
    Ok(table)
}

/// Number of timed solutions.
const REPEATS: usize = 21;

/// Compares solutions with and without the term in the presence of friction.
pub(super) fn term() -> Result<Table, BeamError> {
    let axes = [
        axis("median_ms", "ms", "time of a solution (median), ms", true),
        axis("p95_ms", "p95 ms", "time of a solution (95th percentile), ms", true),
        axis("error_mm", "error mm", "largest error of the deflection, mm", true),
    ];
    let factors = [
        factor("friction", "friction gamma"),
        factor("tissue", "tissue"),
        factor("slope", "slope"),
        factor("term", "friction term"),
    ];
    let goal = Goal::new("median_ms", "error_mm", SHIFT_MM).choosing("friction term of a beam");
    let title = "Friction: the term left out where there is friction";
    let mut table = Table::new("friction-term", title, &factors, &axes)
        .against(format!("the term kept, elements of {FINE_MM} mm"))
        .seeking(goal.each(&["friction"]).over(&["tissue", "slope"]).beside(&["p95_ms"]));
    for friction in FRICTION.into_iter().filter(|gamma| *gamma > 0.0) {
        for tissue in TISSUES {
            for slope in SLOPES {
                let base = Base {
                    displacement_mm: 15.0,
                    slope: Some(slope),
                };
                let of = |element_mm: f64, friction: f64| {
                    let mut needle = problem(tissue.material, tissue.compression, 20.0, 60.0, element_mm);
                    needle.layers[0].friction = friction;
                    needle
                };
                let truth = solve(&of(FINE_MM, friction), &base)?;
                for (term, gamma) in [("left out", 0.0), ("kept", friction)] {
                    let mut beam = FoundationBeam::new(&of(ELEMENT_MM, gamma))?;
                    let shape = beam.solve(&base)?;
                    let mut times = Vec::with_capacity(REPEATS);
                    for _ in 0..REPEATS {
                        let start = Instant::now();
                        black_box(beam.solve(black_box(&base))?);
                        times.push(start.elapsed().as_secs_f64() * 1e3);
                    }
                    let time = Spread::of(times);
                    let choices = [
                        friction.to_string(),
                        tissue.name.to_owned(),
                        format!("slope {slope}"),
                        term.to_owned(),
                    ];
                    let values = [
                        time.map(|time| time.median_ms),
                        time.map(|time| time.p95_ms),
                        Some(apart(&shape, &truth)),
                    ];
                    table.push(choices.to_vec(), values.to_vec(), None);
                }
            }
        }
    }
    Ok(table)
}

pub(super) fn figures() -> Vec<Figure> {
    vec![Figure {
        marker: vec!["tissue"],
        ..Figure::new(
            "beam-friction",
            "Friction: how far it moves the needle",
            "friction",
            ["gamma", "shape_mm"],
            "slope",
        )
    }]
}
