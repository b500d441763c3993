//! Markdown version of the report.

use std::fmt::Write;

use super::Report;
use crate::tradeoff::Table;

impl Report {
    /// Returns the report in Markdown, with every figure.
    pub fn markdown(&self) -> String {
        // Writing to a string cannot fail.
        let mut text = format!("# What accuracy costs in time\n\n{}\n", self.sentence());
        for missing in &self.missing {
            let _ = writeln!(text, "\n**{} could not be measured:** {}", missing.name, missing.reason);
        }
        for note in &self.notes {
            let _ = writeln!(text, "\n{note}");
        }
        let _ = writeln!(text, "\n{}", self.verdict());
        self.pace_in_markdown(&mut text);
        let _ = write!(text, "\n## In short\n\n");
        for advice in self.tables().flat_map(|(_, table)| table.advice()) {
            let _ = writeln!(text, "- **{}**: {}", advice.choosing, advice.sentence());
        }
        for chapter in &self.chapters {
            let study = &chapter.study;
            let _ = write!(text, "\n## {}\n\n{}\n\n", study.title, chapter.question);
            for (key, value) in &study.about {
                let _ = writeln!(text, "- {}: {value}", key.replace('_', " "));
            }
            let draw = |text: &mut String, table: Option<&Table>| {
                for (figure, plot) in study.plots_of(table) {
                    let _ = write!(text, "\n![{}]({}.svg)\n", plot.title, chapter.stem(figure));
                }
            };
            for table in study.listed() {
                let _ = write!(text, "\n### {}\n\n", table.title);
                if !table.gold.is_empty() {
                    let _ = write!(text, "Errors against: {}.\n\n", table.gold);
                }
                for advice in table.advice() {
                    let _ = write!(text, "> {}\n\n", advice.sentence());
                }
                text += &table.markdown();
                draw(&mut text, Some(table));
            }
            draw(&mut text, None);
            for note in &study.notes {
                let _ = write!(text, "\nNote: {note}\n");
            }
        }
        text
    }

    /// Adds the recommendations at the required pace.
    fn pace_in_markdown(&self, text: &mut String) {
        if self.in_time().next().is_none() {
            return;
        }
        let [heading, times] = self.at_this_pace();
        let _ = write!(text, "\n## {heading}\n\n{times}\n\n");
        text.push_str(&self.pace_table("better").markdown());
    }

    /// States the machine, the date and the duration of the measurements.
    pub(super) fn sentence(&self) -> String {
        format!(
            "Measured by {} on {} ({}; {} run, {:.0} s). Times are this machine's; errors are against the gold standard of each table, \
             found in the same run.",
            self.program,
            self.date,
            self.machine,
            self.effort.pick("quick", "whole"),
            self.seconds
        )
    }

    /// States whether any row violates its guarantee.
    pub(super) fn verdict(&self) -> String {
        match self.wrong().count() {
            0 => "No row violates its guarantee.".to_owned(),
            1 => "One row violates its guarantee and is marked WRONG.".to_owned(),
            wrong => format!("{wrong} rows violate their guarantees and are marked WRONG."),
        }
    }
}

impl Table {
    fn markdown(&self) -> String {
        let axes = self.filled();
        format!(
            "{}\n{}\n",
            self.cells(&axes).markdown(),
            self.legend(&axes).replace('|', "\\|")
        )
    }
}
