//! Element length of the beam: error against time.

use std::hint::black_box;
use std::time::Instant;

use super::{FINE_MM, apart, axis, factor, solve};
use crate::base::report::statistics::Spread;
use crate::mechanics::needle::beam::{Base, BeamError, Compression, FoundationBeam};
use crate::study::beam::{TISSUES, problem};
use crate::study::tradeoff::{Figure, Goal, SHIFT_MM, Table};

const ELEMENTS_MM: [f64; 5] = [5.0, 2.0, 1.0, 0.5, FINE_MM];
/// Number of timed solutions.
const REPEATS: usize = 41;

pub(super) fn table() -> Result<Table, BeamError> {
    let axes = [
        axis("elements", "elements", "elements", true),
        axis("median_ms", "ms", "time of a solution (median), ms", true),
        axis("p95_ms", "p95 ms", "time of a solution (95th percentile), ms", true),
        axis("error_mm", "error mm", "largest error of the deflection, mm", true),
        axis("iterations", "Newton", "Newton steps", false),
    ];
    let factors = [factor("case", "case"), factor("element_mm", "element")];
    let title = "Length of elements: 60 mm in, base 20 mm before the entry, moved by 15 mm, slope -0.2";
    let mut table = Table::new("elements", title, &factors, &axes)
        .against(format!("elements of {FINE_MM} mm"))
        .seeking(
            Goal::new("median_ms", "error_mm", SHIFT_MM)
                .over(&["case"])
                .choosing("elements of a beam by itself in tissue (insonify beam)")
                .beside(&["p95_ms"]),
        );
    let base = Base {
        displacement_mm: 15.0,
        slope: Some(-0.2),
    };
    let [pvc, psm] = TISSUES;
    let cases = [
        ("PVC", pvc.material, pvc.compression, 50.0),
        ("PSM", psm.material, psm.compression, 50.0),
        ("PSM, CTru, t0 20 mm", psm.material, Compression::CTru, 20.0),
    ];
    for (name, material, compression, initial_length_mm) in cases {
        let of = |element_mm: f64| {
            let mut problem = problem(material, compression, 20.0, 60.0, element_mm);
            problem.layers[0].initial_length_mm = initial_length_mm;
            problem
        };
        let truth = solve(&of(FINE_MM), &base)?;
        for element_mm in ELEMENTS_MM {
            let mut beam = FoundationBeam::new(&of(element_mm))?;
            let shape = beam.solve(&base)?;
            let mut times = Vec::with_capacity(REPEATS);
            for _ in 0..REPEATS {
                let start = Instant::now();
                black_box(beam.solve(black_box(&base))?);
                times.push(start.elapsed().as_secs_f64() * 1e3);
            }
            let error = (element_mm > FINE_MM).then(|| apart(&shape, &truth));
            let time = Spread::of(times);
            let values = vec![
                Some((shape.points.len() - 1) as f64),
                time.map(|time| time.median_ms),
                time.map(|time| time.p95_ms),
                error,
                Some(shape.iterations as f64),
            ];
            table.push(vec![name.to_owned(), format!("{element_mm} mm")], values, None);
        }
    }
    table.mark_gold("element_mm", &format!("{FINE_MM} mm"));
    Ok(table)
}

pub(super) fn figures() -> Vec<Figure> {
    vec![Figure {
        marker: vec!["element_mm"],
        joined: false,
        ..Figure::new(
            "beam-elements",
            "Length of elements: what accuracy costs",
            "elements",
            ["median_ms", "error_mm"],
            "case",
        )
    }]
}
