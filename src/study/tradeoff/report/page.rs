//! HTML page of the report.

use super::Report;
use crate::tradeoff::{Study, Table};
use insonify_base::machine;
use insonify_base::number::significant;
use insonify_base::output::OutputError;
use insonify_base::table::{self, Cell};
use insonify_base::text::escape;
use insonify_report::page::Page;
use insonify_report::plot::Plot;

/// Number of table rows above which a table is folded.
const ROWS: usize = 40;

impl Report {
    /// Returns the report as one self-contained HTML document.
    ///
    /// # Errors
    /// [`OutputError`] if a plot cannot be drawn.
    pub fn page(&self) -> Result<String, OutputError> {
        let mut page = Page::new("What accuracy costs in time");
        page.paragraph("soft", &self.sentence());
        for missing in &self.missing {
            let text = format!("{} could not be measured: {}", missing.name, missing.reason);
            page.paragraph("warning", &text);
        }
        self.notes.iter().for_each(|note| page.paragraph("soft", note));
        let has_wrong = self.wrong().count() > 0;
        page.paragraph(if has_wrong { "warning" } else { "" }, &self.verdict());
        // Wrong rows stand before all advice, which is not to be followed without knowing them.
        for (chapter, table, row) in self.wrong() {
            let flag = row.flag.as_deref().unwrap_or_default();
            let text = format!(
                "{}, {}: {}: WRONG: {flag}",
                chapter.study.title,
                table.title,
                row.choices.join("; ")
            );
            page.paragraph("warning", &text);
        }
        self.in_time_on(&mut page);
        self.in_short(&mut page);
        for chapter in &self.chapters {
            page.put(format_args!(
                "<h2 id=\"{0}\">{1}</h2>",
                escape(chapter.name),
                escape(chapter.study.title)
            ));
            page.paragraph("", chapter.question);
            chapter.study.show(&mut page, Some(chapter.seconds))?;
            page.put(format_args!(
                "<p class=\"soft\">More of this: <code>insonify tradeoff {} --help</code></p>",
                escape(chapter.name)
            ));
        }
        Ok(page.finish())
    }

    /// Adds the recommendations at the required pace, one per line.
    fn in_time_on(&self, page: &mut Page) {
        let table = self.pace_table("better, but slower");
        if table.is_empty() {
            return;
        }
        let [heading, times] = self.at_this_pace();
        page.put(format_args!("<h2>{}</h2>", escape(&heading)));
        page.paragraph("soft", &times);
        page.stacked(&table);
    }

    /// Returns the recommendations at the required pace; `better` heads the column of slower variants.
    pub(super) fn pace_table(&self, better: &str) -> table::Table {
        let [time, error] = ["time", "error"].map(Cell::number);
        let mut table = table::Table::new(["for".into(), "recommended".into(), time, error, better.into()]);
        for choice in self.in_time() {
            let time = format!("{} ms", significant(choice.take.cost));
            let cells = [
                choice.what(),
                choice.recommended(),
                time,
                choice.off(&choice.take),
                choice.beyond(),
            ];
            table.row(if choice.met { "" } else { "wrong" }, cells);
        }
        table
    }

    /// Adds the recommendations, one per line.
    fn in_short(&self, page: &mut Page) {
        let [cost, error] = ["cost", "error"].map(Cell::number);
        let mut table = table::Table::new(["for".into(), "recommended".into(), cost, error]);
        for advice in self.tables().flat_map(|(_, table)| table.advice()) {
            let [cost, error] = &advice.units;
            let condition = if advice.given.is_empty() {
                advice.choosing.clone()
            } else {
                format!("{} ({})", advice.choosing, advice.given)
            };
            let [name, cost, error] = match &advice.take {
                Some(variant) => {
                    let error = if variant.gold {
                        Cell::Text("none (the gold standard)".to_owned())
                    } else {
                        format!("{} {error}", significant(variant.error)).into()
                    };
                    let cost = format!("{} {cost}", significant(variant.cost));
                    [Cell::from(variant.name.as_str()), cost.into(), error]
                }
                None => ["none within the tolerance", "", ""].map(|text| Cell::Text(text.to_owned())),
            };
            table.row("", [condition.into(), name, cost, error]);
        }
        if table.is_empty() {
            return;
        }
        page.put("<h2>In short</h2>");
        page.paragraph("soft", "The cheapest option whose error is within its tolerance; each chapter states the tolerance and the other options.");
        page.stacked(&table);
    }
}

impl Study {
    /// Returns the study as one self-contained HTML document.
    ///
    /// # Errors
    /// [`OutputError`] if a plot cannot be drawn.
    pub fn page(&self) -> Result<String, OutputError> {
        let mut page = Page::new(self.title);
        let (version, date) = (insonify_base::VERSION, machine::today());
        let text = format!(
            "Measured by insonify {version} on {date} ({}). Times are this machine's.",
            self.machine
        );
        page.paragraph("soft", &text);
        self.show(&mut page, None)?;
        Ok(page.finish())
    }

    /// Adds tables, plots, notes and settings, with the duration (s) if it was taken.
    fn show(&self, page: &mut Page, seconds: Option<f64>) -> Result<(), OutputError> {
        for table in self.listed() {
            table.show(page);
            self.figures(page, Some(table))?;
        }
        self.figures(page, None)?;
        self.notes
            .iter()
            .for_each(|note| page.paragraph("soft", &format!("Note: {note}")));
        page.put("<details><summary>Settings and sizes</summary>");
        let rows = self
            .about
            .iter()
            .map(|(key, value)| [key.replace('_', " "), value.clone()]);
        let took = seconds.map(|seconds| ["measured in".to_owned(), format!("{seconds:.1} s")]);
        page.table(&table::Table::new(["what", "here"]).with(rows.chain(took)));
        page.put("</details>");
        Ok(())
    }

    fn figures(&self, page: &mut Page, table: Option<&Table>) -> Result<(), OutputError> {
        let plots: Vec<Plot> = self.plots_of(table).map(|(_, plot)| plot).collect();
        if plots.is_empty() { Ok(()) } else { page.plots(&plots) }
    }
}

impl Table {
    fn show(&self, page: &mut Page) {
        page.put(format_args!("<h3>{}</h3>", escape(&self.title)));
        if !self.gold.is_empty() {
            page.paragraph("soft", &format!("Errors against: {}.", self.gold));
        }
        for advice in self.advice() {
            page.paragraph("advice", &advice.sentence());
        }
        let (filled, primary) = (self.filled(), self.primary());
        // Long and wide tables are folded but complete.
        let many = self.rows.len() > ROWS;
        if !many {
            self.add_rows(page, &primary);
        }
        if many || primary.len() < filled.len() {
            let summary = format!("All {} figures of {} rows", filled.len(), self.rows.len());
            page.put(format_args!("<details><summary>{summary}</summary>"));
            self.add_rows(page, &filled);
            page.put("</details>");
        }
    }

    fn add_rows(&self, page: &mut Page, axes: &[usize]) {
        page.table(&self.cells(axes));
        match self.legend(axes) {
            none if none.is_empty() => {}
            legend => page.paragraph("soft", &legend),
        }
    }
}
