//! Lengths of the needle's links and of its elements as a beam.

use super::{Course, ENTRY_MM, InsertionOptions, Progress, Step, StepTimes, Timed, largest, points, times, unsettled};
use crate::tradeoff::{Axis, Column, Deadline, Factor, Goal, SHIFT_MM, Study, Table};
use insonify::Error;
use insonify_base::range::OutOfRange;
use insonify_mechanics::block;
use insonify_mechanics::needle::{Needle, Shaft, Stiffness};

/// Discretisation of a needle.
pub(crate) struct Pieces {
    /// Name of the pieces, used in the keys of the table and its factor.
    name: &'static str,
    length: Factor,
    /// Lengths, mm; the last and finest is the gold standard.
    lengths_mm: &'static [f64],
    choosing: &'static str,
    figure: [&'static str; 2],
    needle: fn(f64) -> Result<Box<dyn Needle>, OutOfRange>,
}

/// Links joined by angular springs.
pub(crate) const LINKS: Pieces = Pieces {
    name: "links",
    length: Factor::new("link_mm", "links of, mm"),
    lengths_mm: &[20.0, 10.0, 5.0, 2.5, 1.25],
    choosing: "links of the needle",
    figure: ["insertion-links", "Links of the needle: what accuracy costs"],
    needle: |length_mm| block::springs(Stiffness::default(), length_mm, block::BEVEL),
};

/// Elements of a beam.
pub(crate) const ELEMENTS: Pieces = Pieces {
    name: "elements",
    length: Factor::new("element_mm", "elements of, mm"),
    lengths_mm: &[20.0, 10.0, 5.0, 2.5],
    choosing: "elements of a beam in an insertion",
    figure: ["insertion-elements", "Elements of a beam needle: what accuracy costs"],
    needle: |length_mm| block::beam(Stiffness::default(), length_mm, block::BEVEL),
};

/// An insertion of a needle in pieces of a length.
pub(crate) struct PieceRow {
    pub length_mm: f64,
    /// Tip beside the straight path at full depth, mm.
    deflection_mm: f64,
    pub times: StepTimes,
    /// Largest differences from the finest pieces on the way in, mm and N; `None` for the finest.
    pub tip_mm: Option<f64>,
    force_n: Option<f64>,
}

impl Timed for PieceRow {
    fn times(&self) -> &StepTimes {
        &self.times
    }
}

const COLUMNS: [Column<PieceRow>; 4] = [
    Axis::linear("pieces", "pieces", "pieces of the whole needle")
        .of(|row| Some((Shaft::default().length_mm / row.length_mm).round())),
    Axis::linear(
        "deflection_mm",
        "aside mm",
        "tip beside the straight path at full depth, mm",
    )
    .of(|row| Some(row.deflection_mm)),
    Axis::log(
        "tip_mm",
        "tip off, mm",
        "largest difference of the tip on the way in, mm",
    )
    .of(|row| row.tip_mm),
    Axis::log(
        "force_n",
        "force off, N",
        "largest difference of the force at the base on the way in, N",
    )
    .of(|row| row.force_n),
];

impl Pieces {
    fn finest_mm(&self) -> f64 {
        self.lengths_mm[self.lengths_mm.len() - 1]
    }

    /// Measures one insertion with pieces of every length.
    pub(crate) fn measure(&self, options: &InsertionOptions, progress: Progress<'_>) -> Result<Vec<PieceRow>, Error> {
        let course = Course {
            depth_mm: options.depth_mm,
            probe: false,
        };
        let mut models = Vec::new();
        for &length_mm in self.lengths_mm {
            let tissue = super::tissue(options.nodes, (self.needle)(length_mm)?)?;
            models.push(super::model(tissue)?);
        }
        let traces = course.drive(&mut models, options.passes, &mut |share| progress(self.choosing, share))?;
        let gold = &traces[traces.len() - 1];
        let inward = course.moved();
        let rows = self.lengths_mm.iter().zip(&traces).map(|(&length_mm, steps)| {
            let largest_change = |change: &dyn Fn(&Step, &Step) -> f64| {
                let pairs = gold.iter().zip(steps).take(inward);
                (length_mm != self.finest_mm()).then(|| largest(pairs.map(|(a, b)| change(a, b))))
            };
            let tip = steps[inward - 1].tip_mm;
            PieceRow {
                length_mm,
                deflection_mm: (tip.x - ENTRY_MM[0]).hypot(tip.y - ENTRY_MM[1]),
                times: StepTimes::of(steps),
                tip_mm: largest_change(&|a, b| (a.tip_mm - b.tip_mm).norm()),
                force_n: largest_change(&|a, b| (a.force_n - b.force_n).norm()),
            }
        });
        Ok(rows.collect())
    }

    pub(super) fn table(&self, rows: &[PieceRow]) -> Table {
        let (name, finest) = (self.name, self.finest_mm());
        let goal = Goal::new("remesh_median_ms", "tip_mm", SHIFT_MM)
            .choosing(self.choosing)
            .in_every(Deadline::Step, "remesh_median_ms")
            .beside(&["median_ms", "p99_ms", "force_n"]);
        let title = format!("Needle in {name}: differences from {name} of {finest} mm");
        let columns: Vec<_> = COLUMNS.into_iter().chain(times()).chain([unsettled()]).collect();
        let length = self.length.of(|row: &PieceRow| row.length_mm.to_string());
        Table::of(name, title, &[length], &columns, rows)
            .gold_where(rows, |row| row.length_mm == finest)
            .against(format!("{name} of {finest} mm"))
            .seeking(goal)
    }

    pub(super) fn run(
        &self,
        options: &InsertionOptions,
        study: &mut Study,
        progress: Progress<'_>,
    ) -> Result<(), Error> {
        let [file, title] = self.figure;
        study.tables.push(self.table(&self.measure(options, progress)?));
        let axes = ["remesh_median_ms", "tip_mm"];
        study
            .figures
            .push(points(file, title, self.name, axes, self.length.key));
        Ok(())
    }
}
