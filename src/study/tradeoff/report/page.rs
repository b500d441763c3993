//! HTML page of the report.

use std::time::Duration;

use super::{Chapter, Report, Section};
use crate::tradeoff::{Rates, Study};
use insonify_base::machine;
use insonify_base::number::significant;
use insonify_base::output::OutputError;
use insonify_base::table::{Cell, Table};
use insonify_base::text::escape;
use insonify_report::page::Page;

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
        let wrong = self.wrong().count() > 0;
        page.paragraph(if wrong { "warning" } else { "" }, &self.verdict());
        for (chapter, section, row) in self.wrong() {
            let flag = row.flag.as_deref().unwrap_or_default();
            let text = format!(
                "{}, {}: {}: WRONG: {flag}",
                chapter.title,
                section.title,
                row.choices.join("; ")
            );
            page.paragraph("warning", &text);
        }
        self.in_time_on(&mut page);
        self.in_short(&mut page);
        for chapter in &self.chapters {
            chapter.show(&mut page)?;
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
    pub(super) fn pace_table(&self, better: &str) -> Table {
        let [time, error] = ["time", "error"].map(Cell::number);
        let mut table = Table::new(["for".into(), "recommended".into(), time, error, better.into()]);
        for found in self.in_time() {
            let time = format!("{} ms", significant(found.take.cost));
            let cells = [
                found.what(),
                found.recommended(),
                time,
                found.off(&found.take),
                found.beyond(),
            ];
            table.row(if found.met { "" } else { "wrong" }, cells);
        }
        table
    }

    /// Adds the recommendations, one per line.
    fn in_short(&self, page: &mut Page) {
        let [cost, error] = ["cost", "error"].map(Cell::number);
        let mut table = Table::new(["for".into(), "recommended".into(), cost, error]);
        for advice in self.sections().flat_map(|(_, section)| &section.advice) {
            let [cost, error] = &advice.units;
            let what = match advice.given.is_empty() {
                true => advice.choosing.clone(),
                false => format!("{} ({})", advice.choosing, advice.given),
            };
            let [way, cost, error] = match &advice.take {
                Some(way) => {
                    let error = match way.gold {
                        true => Cell::Text("none (the gold standard)".to_owned()),
                        false => format!("{} {error}", significant(way.error)).into(),
                    };
                    let cost = format!("{} {cost}", significant(way.cost));
                    [Cell::from(way.name.as_str()), cost.into(), error]
                }
                None => ["none within the tolerance", "", ""].map(|it| Cell::Text(it.to_owned())),
            };
            table.row("", [what.into(), way, cost, error]);
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
        let chapter = Chapter::of(self.name, "", self, &Rates::default(), Duration::ZERO);
        chapter.body(&mut page)?;
        Ok(page.finish())
    }
}

impl Chapter {
    fn show(&self, page: &mut Page) -> Result<(), OutputError> {
        page.put(format_args!(
            "<h2 id=\"{0}\">{1}</h2>",
            escape(self.name),
            escape(self.title)
        ));
        page.paragraph("", self.question);
        self.body(page)?;
        page.put(format_args!(
            "<p class=\"soft\">More of this: <code>insonify tradeoff {} --help</code></p>",
            escape(self.name)
        ));
        Ok(())
    }

    /// Adds tables, plots, notes and settings.
    fn body(&self, page: &mut Page) -> Result<(), OutputError> {
        for section in &self.sections {
            section.show(page);
            self.figures(page, Some(section))?;
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
        let took = (self.seconds > 0.0).then(|| ["measured in".to_owned(), format!("{:.1} s", self.seconds)]);
        page.table(&Table::new(["what", "here"]).with(rows.chain(took)));
        page.put("</details>");
        Ok(())
    }

    fn figures(&self, page: &mut Page, section: Option<&Section>) -> Result<(), OutputError> {
        let mut drawings = self.drawings_of(section).peekable();
        if drawings.peek().is_none() {
            return Ok(());
        }
        page.plots(drawings.map(|drawing| &drawing.plot))
    }
}

impl Section {
    fn show(&self, page: &mut Page) {
        page.put(format_args!("<h3>{}</h3>", escape(&self.title)));
        if !self.gold.is_empty() {
            page.paragraph("soft", &format!("Errors against: {}.", self.gold));
        }
        for advice in &self.advice {
            page.paragraph("advice", &advice.sentence());
        }
        let all: Vec<usize> = (0..self.axes.len()).collect();
        // Long and wide tables are folded but complete.
        let many = self.rows.len() > ROWS;
        if !many {
            self.rows(page, &self.first);
        }
        if many || self.first.len() < all.len() {
            let what = format!("All {} figures of {} rows", all.len(), self.rows.len());
            page.put(format_args!("<details><summary>{what}</summary>"));
            self.rows(page, &all);
            page.put("</details>");
        }
    }

    fn rows(&self, page: &mut Page, axes: &[usize]) {
        page.table(&self.table(axes));
        match self.legend(axes) {
            none if none.is_empty() => {}
            legend => page.paragraph("soft", &legend),
        }
    }
}
