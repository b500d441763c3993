//! Output of a study as text, JSON, CSV and plots.

use std::fmt::Write;
use std::path::Path;

use serde_json::{Map, Value, json};

use super::{Axis, Figure, Row, Study, Table};
use crate::output::png;
use crate::output::{OutputError, atomic};
use crate::study::plot::{self, Marker, Plot, PlotError, Series};

/// Error of writing the files of a study.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    /// A file cannot be written.
    #[error(transparent)]
    Write(#[from] OutputError),
    /// A plot cannot be drawn.
    #[error(transparent)]
    Plot(#[from] PlotError),
    /// The report cannot be serialised as JSON.
    #[error("the report cannot be written as JSON: {0}")]
    Json(#[from] serde_json::Error),
}

impl Study {
    /// Returns the study as text: settings, tables, notes.
    pub fn text(&self) -> String {
        let mut text = String::new();
        for (key, value) in &self.about {
            let _ = writeln!(text, "{key}: {value}");
        }
        let _ = writeln!(text, "machine: {}", self.machine);
        for table in self.tables.iter().filter(|table| table.listed) {
            let _ = write!(text, "\n{}\n{}", table.title, table.text());
            for advice in table.advice() {
                let _ = writeln!(text, "=> {}", advice.sentence());
            }
        }
        if !self.notes.is_empty() {
            text.push('\n');
        }
        for note in &self.notes {
            let _ = writeln!(text, "note: {note}");
        }
        text
    }

    /// Returns the study as JSON.
    pub fn json(&self) -> Value {
        let about: Map<String, Value> = self
            .about
            .iter()
            .map(|(key, value)| ((*key).to_owned(), json!(value)))
            .collect();
        let tables: Map<String, Value> = self
            .tables
            .iter()
            .map(|table| (table.key.to_owned(), table.json()))
            .collect();
        json!({
            "study": self.name,
            "about": about,
            "machine": self.machine,
            "tables": tables,
            "figures": self.figures,
            "notes": self.notes,
        })
    }

    /// Returns the plots, each with the stem of its files; plots without points are omitted.
    pub fn plots(&self) -> Vec<(&str, Plot)> {
        let figures = self.figures.iter().filter_map(|figure| {
            let table = self.tables.iter().find(|table| table.key == figure.table)?;
            Some((figure.file.as_str(), table.plot(figure)?))
        });
        figures.collect()
    }

    /// Writes every table as CSV, the study as JSON, every plot as PNG and SVG, and a page of everything into an existing folder. Returns
    /// the file names in the order written.
    ///
    /// # Errors
    /// [`RenderError`]. Each file is written completely or not at all.
    pub fn write(&self, folder: &Path) -> Result<Vec<String>, RenderError> {
        let mut files = Vec::new();
        let mut put = |name: String, bytes: &[u8]| -> Result<(), RenderError> {
            atomic::write(&folder.join(&name), |file| std::io::Write::write_all(file, bytes))?;
            files.push(name);
            Ok(())
        };
        for table in &self.tables {
            put(format!("{}.csv", table.key), table.csv().as_bytes())?;
        }
        put(format!("{}.json", self.name), format!("{:#}\n", self.json()).as_bytes())?;
        let plots = self.plots();
        for (stem, plot) in &plots {
            put(format!("{stem}.svg"), plot.svg()?.as_bytes())?;
        }
        for (stem, plot) in &plots {
            let name = format!("{stem}.png");
            let [width, height] = plot::SIZE.map(|x| x as usize);
            png::write_rgb(&folder.join(&name), width, height, &plot.rgb()?)?;
            files.push(name);
        }
        let (name, page) = ("index.html".to_owned(), self.page()?);
        atomic::write(&folder.join(&name), |file| {
            std::io::Write::write_all(file, page.as_bytes())
        })?;
        files.push(name);
        Ok(files)
    }
}

impl Table {
    /// Returns the table as text: its gold standard and aligned columns, with a star for best choices and flags at the end of rows.
    pub fn text(&self) -> String {
        let shown: Vec<usize> = (0..self.axes.len())
            .filter(|at| self.rows.iter().any(|row| row.values[*at].is_some()))
            .collect();
        let headings = self.factors.iter().map(|factor| factor.label);
        let mut lines: Vec<Vec<String>> = vec![
            std::iter::once("")
                .chain(headings)
                .chain(shown.iter().map(|at| self.axes[*at].heading))
                .map(str::to_owned)
                .collect(),
        ];
        for (row, best) in self.rows.iter().zip(self.best()) {
            let star = if best { "*" } else { "" };
            let values = shown.iter().map(|at| row.figure(*at));
            lines.push(
                std::iter::once(star.to_owned())
                    .chain(row.choices.iter().cloned())
                    .chain(values)
                    .collect(),
            );
        }
        let columns = 1 + self.factors.len() + shown.len();
        let width = |column: usize| lines.iter().map(|line| line[column].chars().count()).max().unwrap_or(0);
        let widths: Vec<usize> = (0..columns).map(width).collect();
        let mut text = match self.gold.is_empty() {
            true => String::new(),
            false => format!("errors against: {}\n", self.gold),
        };
        for (at, line) in lines.iter().enumerate() {
            let mut out = String::new();
            for (column, (cell, width)) in line.iter().zip(&widths).enumerate() {
                // Names are left-aligned, numbers right-aligned.
                let _ = match column <= self.factors.len() {
                    true => write!(out, "{cell:<width$}  "),
                    false => write!(out, "{cell:>width$}  "),
                };
            }
            if let Some(flag) = at.checked_sub(1).and_then(|row| self.rows[row].flag.as_ref()) {
                let _ = write!(out, "WRONG: {flag}");
            }
            let _ = writeln!(text, "{}", out.trim_end());
        }
        text
    }

    /// Returns comma-separated values with a header, in full precision, empty where nothing was measured.
    pub fn csv(&self) -> String {
        let keys = self.factors.iter().map(|factor| factor.key);
        let keys = keys
            .chain(self.axes.iter().map(|axis| axis.key))
            .chain(["best", "gold", "flag"]);
        let mut text = keys.collect::<Vec<_>>().join(",");
        text.push('\n');
        for (row, best) in self.rows.iter().zip(self.best()) {
            let values = row
                .values
                .iter()
                .map(|value| value.map_or(String::new(), |x| format!("{x}")));
            let cells = row.choices.iter().map(|choice| quoted(choice)).chain(values);
            let end = [
                best.to_string(),
                row.gold.to_string(),
                quoted(row.flag.as_deref().unwrap_or("")),
            ];
            text.push_str(&cells.chain(end).collect::<Vec<_>>().join(","));
            text.push('\n');
        }
        text
    }

    fn json(&self) -> Value {
        let row = |(row, best): (&Row, bool)| {
            let mut map = Map::new();
            for (factor, choice) in self.factors.iter().zip(&row.choices) {
                map.insert(factor.key.to_owned(), json!(choice));
            }
            for (axis, value) in self.axes.iter().zip(&row.values) {
                map.insert(axis.key.to_owned(), json!(value));
            }
            map.insert("best".to_owned(), json!(best));
            map.insert("gold".to_owned(), json!(row.gold));
            map.insert("flag".to_owned(), json!(row.flag));
            Value::Object(map)
        };
        json!({
            "title": self.title,
            "gold": self.gold,
            "advice": self.advice(),
            "axes": self.axes,
            "rows": self.rows.iter().zip(self.best()).map(row).collect::<Vec<_>>(),
        })
    }

    /// Returns the plot of a figure; `None` if it has no points.
    pub(super) fn plot(&self, figure: &Figure) -> Option<Plot> {
        let (x, y) = (self.axis(figure.x)?, self.axis(figure.y)?);
        let colour = self.factor(figure.colour)?;
        let markers: Vec<usize> = figure.marker.iter().filter_map(|key| self.factor(key)).collect();
        let wanted = |row: &&Row| {
            let kept = |(key, choice): &(&str, String)| self.factor(key).is_some_and(|at| row.choices[at] == *choice);
            figure.only.iter().all(kept)
        };
        let [x_axis, y_axis] = [x, y].map(|at| axis(&self.axes[at]));
        let mut colours: Vec<String> = Vec::new();
        let mut kinds: Vec<String> = Vec::new();
        let mut series: Vec<Series> = Vec::new();
        for row in self.rows.iter().filter(wanted) {
            let (Some(across), Some(up)) = (row.values[x], row.values[y]) else {
                continue;
            };
            let point = [across, up];
            let name_of = |at: usize| self.factors[at].name(&row.choices[at]);
            let name = name_of(colour);
            let kind = markers.iter().map(|at| name_of(*at)).collect::<Vec<_>>().join(", ");
            let own = place(&mut colours, &name);
            let marker = match figure.marked {
                true => Marker::nth(place(&mut kinds, &kind)),
                false => Marker::None,
            };
            let of_this = |series: &&mut Series| series.colour == own && series.marker == marker;
            match series.iter_mut().find(of_this) {
                Some(series) => series.points.push(point),
                None => series.push(Series {
                    name,
                    points: vec![point],
                    joined: figure.joined,
                    marker,
                    colour: own,
                }),
            }
        }
        (!series.is_empty()).then(|| Plot {
            title: figure.title.clone(),
            x: x_axis,
            y: y_axis,
            series,
            markers: kinds.into_iter().filter(|kind| !kind.is_empty()).collect(),
            front: self.fronts(figure.x, figure.y, |row| wanted(&row)),
        })
    }
}

/// Returns the index of a name in `seen`, appending it if it is new.
fn place(seen: &mut Vec<String>, name: &str) -> usize {
    seen.iter().position(|other| other == name).unwrap_or_else(|| {
        seen.push(name.to_owned());
        seen.len() - 1
    })
}

fn axis(axis: &Axis) -> plot::Axis {
    match axis.log {
        true => plot::Axis::log(axis.label),
        false => plot::Axis::linear(axis.label),
    }
}

impl Row {
    /// Formats a value: integers in full; the gold standard has no measurable error.
    pub(super) fn figure(&self, at: usize) -> String {
        match self.values[at] {
            Some(value) if value.fract() == 0.0 && value.abs() < 1e12 => whole(value),
            Some(value) => number(value),
            None if self.gold => "standard".to_owned(),
            None => "-".to_owned(),
        }
    }
}

/// Quotes a cell of comma-separated values where necessary.
pub fn quoted(text: &str) -> String {
    match text.contains([',', '"', '\n']) {
        true => format!("\"{}\"", text.replace('"', "\"\"")),
        false => text.to_owned(),
    }
}

/// Formats a number with three digits, with a power of ten if it is small or large.
pub fn number(value: f64) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    let exponent = value.abs().log10().floor();
    if (-3.0..6.0).contains(&exponent) {
        let digits = (2.0 - exponent).clamp(0.0, 5.0) as usize;
        format!("{value:.digits$}")
    } else {
        format!("{value:.1e}")
    }
}

/// Formats an integer, in groups of three digits from 10,000 on.
fn whole(value: f64) -> String {
    let digits = format!("{:.0}", value.abs());
    let sign = if value < 0.0 { "-" } else { "" };
    if digits.len() < 5 {
        return format!("{sign}{digits}");
    }
    let mut text = sign.to_owned();
    for (at, digit) in digits.chars().enumerate() {
        if at > 0 && (digits.len() - at).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}
