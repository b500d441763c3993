//! Output of a study as text, JSON, CSV and plots.

use std::fmt::Write;
use std::path::Path;

use serde_json::{Map, Value, json};

use super::{Figure, Row, Study, Table};
use insonify_base::number;
use insonify_base::output::{OutputError, atomic, png};
use insonify_base::table::{self, Cell};
use insonify_report::plot::{self, Marker, Plot, Series};

impl Study {
    /// Returns the study as text: settings, tables, notes.
    pub fn text(&self) -> String {
        let mut text = String::new();
        for (key, value) in &self.about {
            let _ = writeln!(text, "{key}: {value}");
        }
        let _ = writeln!(text, "machine: {}", self.machine);
        for table in self.listed() {
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
        let about = self.about.iter().map(|(key, value)| ((*key).to_owned(), json!(value)));
        let tables = self.tables.iter().map(|table| (table.key.to_owned(), table.json()));
        json!({
            "study": self.name,
            "about": about.collect::<Map<_, _>>(),
            "machine": self.machine,
            "tables": tables.collect::<Map<_, _>>(),
            "figures": self.figures,
            "notes": self.notes,
        })
    }

    /// Returns the tables, except long traces, which are only plotted.
    pub fn listed(&self) -> impl Iterator<Item = &Table> {
        self.tables.iter().filter(|table| table.listed)
    }

    /// Returns the plots of a table, or with `None` those of traces.
    pub(super) fn plots_of(&self, table: Option<&Table>) -> impl Iterator<Item = (&Figure, Plot)> {
        self.plots().into_iter().filter(move |(figure, _)| match table {
            Some(table) => table.key == figure.table,
            None => self.listed().all(|table| table.key != figure.table),
        })
    }

    /// Returns the plots of the figures that have points.
    pub fn plots(&self) -> Vec<(&Figure, Plot)> {
        let figures = self.figures.iter().filter_map(|figure| {
            let table = self.tables.iter().find(|table| table.key == figure.table)?;
            Some((figure, table.plot(figure)?))
        });
        figures.collect()
    }

    /// Writes every table as CSV, the study as JSON, every plot as PNG and SVG, and a page of everything into an
    /// existing folder. Returns the file names in the order written.
    ///
    /// # Errors
    /// [`OutputError`]. Each file is written completely or not at all.
    pub fn write(&self, folder: &Path) -> Result<Vec<String>, OutputError> {
        let mut files = Files::new(folder);
        for table in &self.tables {
            files.put(format!("{}.csv", table.key), &table.csv())?;
        }
        files.put(format!("{}.json", self.name), &format!("{:#}\n", self.json()))?;
        let plots = self.plots();
        for (figure, plot) in &plots {
            files.put(format!("{}.svg", figure.file), &plot.svg()?)?;
        }
        for (figure, plot) in &plots {
            let name = format!("{}.png", figure.file);
            let [width, height] = plot::SIZE.map(|x| x as usize);
            png::write_rgb(&folder.join(&name), width, height, &plot.rgb()?)?;
            files.names.push(name);
        }
        files.put("index.html", &self.page()?)?;
        Ok(files.names)
    }
}

/// Files written into a folder.
pub(super) struct Files<'a> {
    folder: &'a Path,
    /// Names in the order written.
    pub names: Vec<String>,
}

impl<'a> Files<'a> {
    pub(super) fn new(folder: &'a Path) -> Self {
        let names = Vec::new();
        Files { folder, names }
    }

    /// Writes a text file atomically.
    pub(super) fn put(&mut self, name: impl Into<String>, text: &str) -> Result<(), OutputError> {
        let name = name.into();
        atomic::write(&self.folder.join(&name), |file| {
            std::io::Write::write_all(file, text.as_bytes())
        })?;
        self.names.push(name);
        Ok(())
    }
}

impl Table {
    /// Returns the axes that have values.
    pub(super) fn filled(&self) -> Vec<usize> {
        let filled = |axis: &usize| self.rows.iter().any(|row| row.values[*axis].is_some());
        (0..self.axes.len()).filter(filled).collect()
    }

    /// Returns the primary axes that have values: cost, error, and those shown beside them; all if the table offers no
    /// choice.
    pub(super) fn primary(&self) -> Vec<usize> {
        let filled = self.filled();
        let Some(goal) = &self.goal else { return filled };
        let keys = [goal.cost, goal.error].into_iter().chain(goal.beside.iter().copied());
        keys.filter_map(|key| self.axis(key).filter(|axis| filled.contains(axis)))
            .collect()
    }

    /// Returns the rows, each with whether it is one of the best.
    pub(super) fn judged(&self) -> impl Iterator<Item = (&Row, bool)> {
        self.rows.iter().zip(self.best())
    }

    /// Returns the rows with some of the axes, for Markdown and pages.
    pub(super) fn cells(&self, axes: &[usize]) -> table::Table {
        let factors = self.factors.iter().map(|factor| Cell::from(factor.label));
        let axis =
            |index: &usize| Cell::Explained(self.axes[*index].heading.to_owned(), self.axes[*index].label.to_owned());
        let mut table = table::Table::new(factors.chain(axes.iter().map(axis)).chain(["".into()]));
        for (row, best) in self.judged() {
            let choices = row.choices.iter().map(|choice| Cell::from(choice.as_str()));
            let values = axes.iter().map(|axis| row.figure(*axis).into());
            let class = if row.flag.is_some() { "wrong" } else { "" };
            table.row(class, choices.chain(values).chain([Cell::Tags(row.tags(best))]));
        }
        table
    }

    /// Describes the columns of some axes, and the marks of the rows.
    pub(super) fn legend(&self, axes: &[usize]) -> String {
        let axes = axes.iter().map(|axis| &self.axes[*axis]);
        let columns = axes.filter(|axis| axis.heading != axis.label);
        let columns = columns.map(|axis| format!("{}: {}", axis.heading, axis.label));
        let columns = columns.collect::<Vec<_>>().join("; ");
        let words = [("Columns: ", columns), ("", self.meaning_of_best())];
        let words = words.into_iter().filter(|(_, words)| !words.is_empty());
        words
            .map(|(what, words)| format!("{what}{words}."))
            .collect::<Vec<_>>()
            .join(" ")
    }

    /// Returns the table as text: its gold standard and aligned columns, with a star for best choices and flags at the
    /// end of rows.
    pub fn text(&self) -> String {
        let filled = self.filled();
        let factors = self.factors.iter().map(|factor| Cell::from(factor.label));
        let axes = filled.iter().map(|axis| Cell::number(self.axes[*axis].heading));
        let head = std::iter::once("".into()).chain(factors).chain(axes).chain(["".into()]);
        let rows = self.judged().map(|(row, best)| {
            let star = if best { "*" } else { "" };
            let flag = row.flag.as_ref().map_or(String::new(), |flag| format!("WRONG: {flag}"));
            let values = filled.iter().map(|axis| row.figure(*axis));
            let cells = std::iter::once(star.to_owned()).chain(row.choices.iter().cloned());
            cells.chain(values).chain([flag]).collect::<Vec<_>>()
        });
        let text = table::Table::new(head).with(rows).text("  ", &[]);
        if self.gold.is_empty() {
            text
        } else {
            format!("errors against: {}\n{text}", self.gold)
        }
    }

    /// Returns comma-separated values with a header, in full precision, empty where nothing was measured.
    pub fn csv(&self) -> String {
        let keys = self.factors.iter().map(|factor| factor.key);
        let keys = keys.chain(self.axes.iter().map(|axis| axis.key));
        let rows = self.judged().map(|(row, best)| {
            let values = row
                .values
                .iter()
                .map(|value| value.map_or(String::new(), |x| x.to_string()));
            let end = [
                best.to_string(),
                row.gold.to_string(),
                row.flag.clone().unwrap_or_default(),
            ];
            row.choices.iter().cloned().chain(values).chain(end).collect::<Vec<_>>()
        });
        table::Table::new(keys.chain(["best", "gold", "flag"])).with(rows).csv()
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
            "rows": self.judged().map(row).collect::<Vec<_>>(),
        })
    }

    /// Returns the plot of a figure; `None` if it has no points.
    pub(super) fn plot(&self, figure: &Figure) -> Option<Plot> {
        let (x, y) = (self.axis(figure.x)?, self.axis(figure.y)?);
        let by_colour = self.factor(figure.colour)?;
        let markers: Vec<usize> = figure.marker.iter().filter_map(|key| self.factor(key)).collect();
        let wanted = |row: &&Row| {
            let is_shown =
                |(key, choice): &(&str, String)| self.factor(key).is_some_and(|factor| row.choices[factor] == *choice);
            figure.only.iter().all(is_shown)
        };
        let [x_axis, y_axis] = [x, y].map(|axis| plot::Axis {
            label: self.axes[axis].label.to_owned(),
            log: self.axes[axis].log,
        });
        let mut colours: Vec<String> = Vec::new();
        let mut kinds: Vec<String> = Vec::new();
        let mut series: Vec<Series> = Vec::new();
        for row in self.rows.iter().filter(wanted) {
            // The gold standard has no error, and not every row was measured:
            // such rows have no place in the plot.
            let (Some(across), Some(value)) = (row.values[x], row.values[y]) else {
                continue;
            };
            let point = [across, value];
            let name_of = |factor: usize| self.factors[factor].name(&row.choices[factor]);
            let name = name_of(by_colour);
            let kind = markers
                .iter()
                .map(|factor| name_of(*factor))
                .collect::<Vec<_>>()
                .join(", ");
            let colour = index_of(&mut colours, &name);
            let marker = if figure.marked {
                Marker::nth(index_of(&mut kinds, &kind))
            } else {
                Marker::None
            };
            let of_this = |series: &&mut Series| series.colour == colour && series.marker == marker;
            match series.iter_mut().find(of_this) {
                Some(series) => series.points.push(point),
                None => series.push(Series {
                    name,
                    points: vec![point],
                    joined: figure.joined,
                    marker,
                    colour,
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
            equal: false,
        })
    }
}

/// Returns the index of a name in a list, appending it if it is new.
fn index_of(names: &mut Vec<String>, name: &str) -> usize {
    names.iter().position(|known| known == name).unwrap_or_else(|| {
        names.push(name.to_owned());
        names.len() - 1
    })
}

impl Row {
    /// Returns the labels of a row (flagged, gold standard, best), each with a CSS class.
    fn tags(&self, best: bool) -> Vec<(&'static str, String)> {
        let flag = self.flag.as_ref().map(|flag| ("bad", format!("WRONG: {flag}")));
        let gold = self.gold.then(|| ("plain", "gold standard".to_owned()));
        let best = best.then(|| ("good", "best".to_owned()));
        [flag, gold, best].into_iter().flatten().collect()
    }

    /// Formats a value: integers in full; the gold standard has no measurable error.
    pub(super) fn figure(&self, axis: usize) -> String {
        match self.values[axis] {
            Some(value) => number::grouped(value),
            None if self.gold => "standard".to_owned(),
            None => "-".to_owned(),
        }
    }
}
