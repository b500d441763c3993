//! HTML page of the report.

use super::{CaseReport, Report, limit, margin, sentence, short};
use crate::study::page::{Cell, Page, escape};
use crate::study::stability::record::Measure;

impl Report {
    /// Returns the report, with every figure, as one self-contained HTML document.
    pub fn page(&self) -> String {
        let mut page = Page::new("Hard cases");
        let (failed, all) = (self.failed(), self.cases.len());
        let verdict = format!(
            "{} of {all} hard cases hold ({}, {}).",
            all - failed,
            self.effort(),
            self.machine
        );
        page.paragraph(if failed > 0 { "warning" } else { "advice" }, &verdict);
        for case in self.cases.iter().filter(|case| !case.holds()) {
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
            &self.plot(),
            "How many times larger each figure might be before its case fails",
        );
        for group in self.groups() {
            page.put(format_args!("<h2>{}</h2>", escape(group)));
            let headings = [
                Cell::Text("hard case".to_owned()),
                Cell::Text("measured nearest to its limit".to_owned()),
                Cell::Number("margin".to_owned()),
                Cell::Text(String::new()),
            ];
            let rows: Vec<_> = self.of_group(group).map(CaseReport::row).collect();
            page.stacked(&headings, &rows);
            for case in self.of_group(group) {
                case.details(&mut page);
            }
        }
        page.finish()
    }
}

impl CaseReport {
    fn row(&self) -> (&'static str, Vec<Cell>) {
        let (nearest, margin) = match self.worst() {
            Some(worst) => (Cell::Pair(worst.what.clone(), bound(worst)), margin(worst)),
            None => (Cell::Text("nothing".to_owned()), "-".to_owned()),
        };
        let cells = vec![
            Cell::Pair(self.name.clone(), self.criterion.clone()),
            nearest,
            Cell::Number(margin),
            Cell::Tags(vec![(
                if self.holds() { "good" } else { "bad" },
                self.verdict().to_owned(),
            )]),
        ];
        (if self.holds() { "" } else { "wrong" }, cells)
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
        let headings = [
            Cell::Text("measured".to_owned()),
            Cell::Number("figure".to_owned()),
            Cell::Number("limit".to_owned()),
            Cell::Number("margin".to_owned()),
            Cell::Text(String::new()),
        ];
        let rows = self.measures.iter().map(|measure| {
            let tags = (!measure.holds()).then(|| ("bad", "FAILS".to_owned()));
            let what = match &measure.note {
                Some(note) => Cell::Pair(measure.what.clone(), note.clone()),
                None => Cell::Text(measure.what.clone()),
            };
            let numbers = [short(measure.figure), limit(measure), margin(measure)];
            let cells = std::iter::once(what).chain(numbers.map(Cell::Number));
            let class = if measure.holds() { "" } else { "wrong" };
            (class, cells.chain([Cell::Tags(tags.into_iter().collect())]).collect())
        });
        page.table(&headings, &rows.collect::<Vec<_>>());
        page.put("</details>");
    }
}

/// Describes a figure and its limit.
fn bound(measure: &Measure) -> String {
    match measure.limit {
        Some(_) => format!("{}, at most {}", short(measure.figure), limit(measure)),
        None => short(measure.figure),
    }
}
