//! HTML page of the report.

use std::time::Duration;

use super::{Chapter, Column, Report, Section};
use crate::study::machine;
use crate::study::page::{Cell, Page, escape};
use crate::study::plot::PlotError;
use crate::study::tradeoff::render::number;
use crate::study::tradeoff::{Pace, Study};

/// Number of table rows above which a table is folded.
const ROWS: usize = 40;

impl Report {
    /// Returns the report as one self-contained HTML document.
    ///
    /// # Errors
    /// [`PlotError`] if a plot cannot be drawn.
    pub fn page(&self) -> Result<String, PlotError> {
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
        let rows = self.in_time().map(|found| {
            let cells = vec![
                Cell::Text(found.what()),
                Cell::Text(found.way()),
                Cell::Number(format!("{} ms", number(found.take.cost))),
                Cell::Number(found.off(&found.take)),
                Cell::Text(found.beyond()),
            ];
            (if found.met { "" } else { "wrong" }, cells)
        });
        let rows: Vec<_> = rows.collect();
        if rows.is_empty() {
            return;
        }
        let [heading, times] = self.at_this_pace();
        page.put(format_args!("<h2>{}</h2>", escape(&heading)));
        page.paragraph("soft", &times);
        let headings = [
            Cell::Text("for".to_owned()),
            Cell::Text("recommended".to_owned()),
            Cell::Number("time".to_owned()),
            Cell::Number("error".to_owned()),
            Cell::Text("better, but slower".to_owned()),
        ];
        page.stacked(&headings, &rows);
    }

    /// Adds the recommendations, one per line.
    fn in_short(&self, page: &mut Page) {
        let mut rows = Vec::new();
        for section in self.chapters.iter().flat_map(|chapter| &chapter.sections) {
            for advice in &section.advice {
                let [cost, error] = &advice.units;
                let what = match advice.given.is_empty() {
                    true => advice.choosing.clone(),
                    false => format!("{} ({})", advice.choosing, advice.given),
                };
                let mut cells = vec![Cell::Text(what)];
                match &advice.take {
                    Some(way) => {
                        let error = match way.gold {
                            true => Cell::Text("none (the gold standard)".to_owned()),
                            false => Cell::Number(format!("{} {error}", number(way.error))),
                        };
                        cells.push(Cell::Text(way.name.clone()));
                        cells.push(Cell::Number(format!("{} {cost}", number(way.cost))));
                        cells.push(error);
                    }
                    None => cells.extend(["none within the tolerance", "", ""].map(|it| Cell::Text(it.to_owned()))),
                }
                rows.push(("", cells));
            }
        }
        if rows.is_empty() {
            return;
        }
        page.put("<h2>In short</h2>");
        page.paragraph("soft", "The cheapest option whose error is within its tolerance; each chapter states the tolerance and the other options.");
        let headings = [
            Cell::Text("for".to_owned()),
            Cell::Text("recommended".to_owned()),
            Cell::Number("cost".to_owned()),
            Cell::Number("error".to_owned()),
        ];
        page.stacked(&headings, &rows);
    }
}

impl Study {
    /// Returns the study as one self-contained HTML document.
    ///
    /// # Errors
    /// [`PlotError`] if a plot cannot be drawn.
    pub fn page(&self) -> Result<String, PlotError> {
        let mut page = Page::new(self.title);
        let (version, date) = (env!("CARGO_PKG_VERSION"), machine::today());
        let text = format!(
            "Measured by insonify {version} on {date} ({}). Times are this machine's.",
            self.machine
        );
        page.paragraph("soft", &text);
        let chapter = Chapter::of(self.name, "", self, &Pace::default(), Duration::ZERO);
        chapter.body(&mut page)?;
        Ok(page.finish())
    }
}

impl Chapter {
    fn show(&self, page: &mut Page) -> Result<(), PlotError> {
        page.put(format_args!(
            "<h2 id=\"{0}\">{1}</h2>",
            escape(&self.name),
            escape(&self.title)
        ));
        page.paragraph("", &self.question);
        self.body(page)?;
        page.put(format_args!(
            "<p class=\"soft\">More of this: <code>insonify tradeoff {} --help</code></p>",
            escape(&self.name)
        ));
        Ok(())
    }

    /// Adds tables, plots, notes and settings.
    fn body(&self, page: &mut Page) -> Result<(), PlotError> {
        for section in &self.sections {
            section.show(page);
            self.figures(page, Some(section))?;
        }
        self.figures(page, None)?;
        self.notes
            .iter()
            .for_each(|note| page.paragraph("soft", &format!("Note: {note}")));
        page.put("<details><summary>Settings and sizes</summary>");
        let rows = self.about.iter().map(|(key, value)| {
            let cells = [key.replace('_', " "), value.clone()];
            ("", cells.map(Cell::Text).to_vec())
        });
        let took = (self.seconds > 0.0).then(|| {
            let words = ["measured in".to_owned(), format!("{:.1} s", self.seconds)];
            ("", words.map(Cell::Text).to_vec())
        });
        let headings = ["what", "here"].map(|it| Cell::Text(it.to_owned()));
        page.table(&headings, &rows.chain(took).collect::<Vec<_>>());
        page.put("</details>");
        Ok(())
    }

    fn figures(&self, page: &mut Page, section: Option<&Section>) -> Result<(), PlotError> {
        let mut drawings = self.drawings_of(section).peekable();
        if drawings.peek().is_none() {
            return Ok(());
        }
        page.put("<div class=\"figures\">");
        for drawing in drawings {
            page.figure(&drawing.plot.svg_for_page()?, &drawing.plot.title);
        }
        page.put("</div>");
        Ok(())
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
        let text = |column: &Column| Cell::Text(column.heading.clone());
        let number_of = |at: &usize| Cell::Explained(self.axes[*at].heading.clone(), self.axes[*at].label.clone());
        let headings = self.factors.iter().map(text).chain(axes.iter().map(number_of));
        let headings: Vec<Cell> = headings.chain([Cell::Text(String::new())]).collect();
        let rows = self.judged().map(|(row, best)| {
            let choices = row.choices.iter().cloned().map(Cell::Text);
            let values = axes.iter().map(|at| Cell::Number(row.figure(*at)));
            let class = if row.flag.is_some() { "wrong" } else { "" };
            let tags = Cell::Tags(Section::tags((row, best)));
            (class, choices.chain(values).chain([tags]).collect::<Vec<_>>())
        });
        page.table(&headings, &rows.collect::<Vec<_>>());
        match self.legend(axes) {
            none if none.is_empty() => {}
            legend => page.paragraph("soft", &legend),
        }
    }
}
