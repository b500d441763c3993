//! HTML page of the report.

use super::{CaseReport, Report, limit, margin, sentence};
use crate::base::output::OutputError;
use crate::base::report::number::figure;
use crate::base::report::page::{Page, escape};
use crate::base::report::table::{Cell, Table};
use crate::study::stability::record::Measure;

impl Report {
    /// Returns the report, with every figure, as one self-contained HTML document.
    ///
    /// # Errors
    /// [`OutputError`] if the plot cannot be drawn.
    pub fn page(&self) -> Result<String, OutputError> {
        let mut page = Page::new("Hard cases");
        let (failed, all) = (self.failed(), self.cases.len());
        let verdict = format!(
            "{} of {all} hard cases hold ({}, {}).",
            all - failed,
            self.effort(),
            self.machine
        );
        page.paragraph(if failed > 0 { "warning" } else { "advice" }, &verdict);
        for case in self.cases.iter().filter(|case| !case.holds) {
            let failures: Vec<String> = case.failures().map(sentence).collect();
            page.paragraph(
                "warning",
                &format!("{} does not hold: {}", case.name, failures.join("; ")),
            );
        }
        page.paragraph(
            "soft",
            "Each case is something that breaks numerics, with a criterion from theory. Shown is the figure nearest to its limit; the \
             margin is how many times larger it might be. NaN and infinity never hold, and what must be refused fails if it is not.",
        );
        page.wide_figure(
            &self.plot()?,
            "How many times larger each figure might be before its case fails",
        );
        for group in self.groups() {
            page.put(format_args!("<h2>{}</h2>", escape(group)));
            let head = [
                Cell::from("hard case"),
                Cell::from("measured nearest to its limit"),
                Cell::number("margin"),
                Cell::from(""),
            ];
            let mut table = Table::new(head);
            for case in self.of_group(group) {
                table.row(if case.holds { "" } else { "wrong" }, case.row());
            }
            page.stacked(&table);
            for case in self.of_group(group) {
                case.details(&mut page);
            }
        }
        Ok(page.finish())
    }
}

impl CaseReport {
    fn row(&self) -> [Cell; 4] {
        let (nearest, margin) = match self.worst() {
            Some(worst) => (Cell::Pair(worst.what.clone(), bound(worst)), margin(worst)),
            None => ("nothing".into(), "-".to_owned()),
        };
        let class = if self.holds { "good" } else { "bad" };
        [
            Cell::Pair(self.name.clone(), self.criterion.clone()),
            nearest,
            margin.into(),
            Cell::Tags(vec![(class, self.verdict().to_owned())]),
        ]
    }

    fn details(&self, page: &mut Page) {
        let covers = self.covers.join(", ");
        page.put(format_args!(
            "<details><summary>{}: all {} figures</summary>",
            escape(&self.name),
            self.measures.len()
        ));
        let seconds = self.seconds;
        page.paragraph("soft", &format!("On {covers}; seed {}; {seconds:.1} s.", self.seed));
        let [figures, limits, margins] = ["figure", "limit", "margin"].map(Cell::number);
        let mut table = Table::new([Cell::from("measured"), figures, limits, margins, Cell::from("")]);
        for measure in &self.measures {
            let tags = (!measure.holds).then(|| ("bad", "FAILS".to_owned()));
            let what = match &measure.note {
                Some(note) => Cell::Pair(measure.what.clone(), note.clone()),
                None => measure.what.clone().into(),
            };
            let numbers = [figure(measure.figure), limit(measure), margin(measure)].map(Cell::from);
            let cells = std::iter::once(what).chain(numbers);
            let class = if measure.holds { "" } else { "wrong" };
            table.row(class, cells.chain([Cell::Tags(tags.into_iter().collect())]));
        }
        page.table(&table);
        page.put("</details>");
    }
}

/// Describes a figure and its limit.
fn bound(measure: &Measure) -> String {
    match measure.limit {
        Some(_) => format!("{}, at most {}", figure(measure.figure), limit(measure)),
        None => figure(measure.figure),
    }
}
