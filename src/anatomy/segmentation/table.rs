//! Tables of label names: CSV, colour tables of 3D Slicer and FreeSurfer, label descriptions of ITK-SNAP, data sets of
//! nnU-Net.

use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::volume::{At, VolumeError};
use insonify_base::csv::line;
use insonify_base::read;

/// Accepted headers of the value and name columns, without capitals, blanks and punctuation; the first one present
/// counts.
const VALUES: [&str; 5] = ["value", "labelvalue", "index", "id", "label"];
const NAMES: [&str; 4] = ["name", "labelname", "structure", "label"];

/// Names of label values.
#[derive(Clone, Debug)]
pub struct Names {
    path: PathBuf,
    by_value: BTreeMap<i64, String>,
}

impl Names {
    /// Reads a table: CSV with columns such as `value` (or `label`) and `name`, or these two without a header; a colour
    /// table of 3D Slicer (number, name and colour per line) or FreeSurfer; label descriptions of ITK-SNAP;
    /// `dataset.json` of nnU-Net.
    ///
    /// # Errors
    /// [`VolumeError`] with the line, for tables of other formats, values that are not integers, and values with two
    /// names.
    pub fn read(path: &Path) -> Result<Self, VolumeError> {
        let text = read::text(path, read::CSV).map_err(|cause| VolumeError::read(path, cause))?;
        let mut names = Self {
            path: path.to_owned(),
            by_value: BTreeMap::new(),
        };
        let first = text
            .lines()
            .map(str::trim)
            .find(|line| !line.is_empty() && !line.starts_with('#'));
        let first = first.unwrap_or_default();
        let after = first.trim_start_matches(|c: char| c.is_ascii_digit());
        let is_value = after.len() < first.len();
        if first.starts_with(['{', '[']) {
            names.read_json(&text)?;
        } else if is_value && !after.trim_start().starts_with([',', ';']) {
            names.read_colours(&text)?;
        } else {
            names.read_csv(&text, first, !is_value)?;
        }
        Ok(names)
    }

    /// Path of the table.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Name of a label value.
    pub fn of(&self, value: i64) -> Option<&str> {
        self.by_value.get(&value).map(String::as_str)
    }

    fn add(&mut self, line: usize, value: &str, name: &str) -> Result<(), VolumeError> {
        let fail =
            |found: String, expected: &str| Err(VolumeError::malformed(&self.path, At::Line(line), found, expected));
        let Ok(number) = value.parse::<i64>() else {
            return fail(format!("{value:?}"), "a label value, a whole number");
        };
        if name.is_empty() {
            return fail(format!("no name for {number}"), "a name");
        }
        match self.by_value.get(&number) {
            Some(known) if known != name => fail(
                format!("{number} {name:?} after {number} {known:?}"),
                "one name a value",
            ),
            _ => {
                self.by_value.insert(number, name.to_owned());
                Ok(())
            }
        }
    }

    /// Parses lines of a number, a name and a colour, or of a number, a colour and a name in quotes. Names may have
    /// blanks.
    fn read_colours(&mut self, text: &str) -> Result<(), VolumeError> {
        let rows: Vec<(usize, &str)> = (1..)
            .zip(text.lines().map(str::trim))
            .filter(|(_, row)| !row.is_empty() && !row.starts_with('#'))
            .collect();
        let is_number = |word: &&str| word.parse::<f64>().is_ok();
        let numbers = |row: &str| row.split_whitespace().rev().take_while(is_number).count();
        let unquoted = rows.iter().filter(|(_, row)| !row.contains('"'));
        // The colour of all rows: a name may end in a number, too.
        let colour = match unquoted.map(|(_, row)| numbers(row)).min().unwrap_or(0) {
            numbers @ 3.. => numbers.min(4),
            _ => 0,
        };
        for (line, row) in rows {
            let words: Vec<&str> = row.split_whitespace().collect();
            let name = match row.split_once('"') {
                Some((_, rest)) => rest.trim_end_matches('"').trim().to_owned(),
                None => words[1..words.len().saturating_sub(colour).max(1)].join(" "),
            };
            self.add(line, words[0], &name)?;
        }
        Ok(())
    }

    /// Parses the `labels` of a data set of nnU-Net, or a table of nothing else: names with values, or values with names.
    /// A name may have several values, as a region does; a value then has the name of the smallest one.
    fn read_json(&mut self, text: &str) -> Result<(), VolumeError> {
        const EXPECTED: &str = "`labels` with a value or a list of values for each name, or a name for each value, as nnU-Net's dataset.json \
                                has it";
        let fail = |line: usize, found: String| VolumeError::malformed(&self.path, At::Line(line), found, EXPECTED);
        let json: Value = serde_json::from_str(text).map_err(|error| fail(error.line(), error.to_string()))?;
        let is_row = |(key, value): (&String, &Value)| match value {
            Value::String(_) => key.parse::<i64>().is_ok(),
            value => value.is_i64(),
        };
        let bare = json
            .as_object()
            .filter(|rows| !rows.is_empty() && rows.iter().all(is_row));
        let labels = json.get("labels").and_then(Value::as_object).or(bare);
        let labels = labels.ok_or_else(|| fail(1, "no table `labels`".to_owned()))?;
        let mut regions = Vec::new();
        for (key, value) in labels {
            let line = text
                .lines()
                .position(|line| line.contains(&format!("\"{key}\"")))
                .map_or(1, |index| index + 1);
            let number = |value: &Value| value.as_i64().ok_or_else(|| fail(line, format!("{key:?}: {value}")));
            let (values, name) = match value {
                Value::String(name) if key.parse::<i64>().is_ok() => (vec![key.parse().unwrap_or_default()], name),
                Value::Array(values) => (values.iter().map(number).collect::<Result<_, _>>()?, key),
                value => (vec![number(value)?], key),
            };
            regions.push((line, values, name));
        }
        regions.sort_by_key(|(_, values, _)| Reverse(values.len()));
        for (line, values, name) in regions {
            match values[..] {
                [value] => {
                    let of_region = labels
                        .values()
                        .any(|other| other.as_array().is_some_and(|all| all.contains(&value.into())));
                    if of_region {
                        self.by_value.remove(&value);
                    }
                    self.add(line, &value.to_string(), name)?;
                }
                _ => self
                    .by_value
                    .extend(values.into_iter().map(|value| (value, name.clone()))),
            }
        }
        Ok(())
    }

    /// Parses rows by their columns; without a header, of a value and a name. `first` is the first line.
    fn read_csv(&mut self, text: &str, first: &str, has_header: bool) -> Result<(), VolumeError> {
        let fail = |line: u64, found: String, expected: &str| {
            VolumeError::malformed(&self.path, At::Line(line as usize), found, expected)
        };
        // Comma last: names hold commas more often than tabs or semicolons.
        let delimiter = ['\t', ';'].into_iter().find(|c| first.contains(*c)).unwrap_or(',');
        let text = text.as_bytes();
        let mut reader = csv::ReaderBuilder::new()
            .trim(csv::Trim::All)
            .has_headers(has_header)
            .comment(Some(b'#'))
            .delimiter(delimiter as u8)
            .from_reader(text);
        let broken = |error: csv::Error| fail(line(text, error.position()), error.to_string(), "a CSV table");
        let headers: Vec<String> = reader.headers().map_err(broken)?.iter().map(plain).collect();
        let column = |wanted: &[&str], not: Option<usize>| {
            let position =
                |name: &&str| (0..headers.len()).find(|index| headers[*index] == *name && Some(*index) != not);
            wanted.iter().find_map(position)
        };
        let (value, name) = if has_header {
            // `label` heads values in some tables and names in others, but not both in one.
            let value = column(&VALUES, None);
            (value, column(&NAMES, value))
        } else {
            (Some(0), Some(1))
        };
        let (Some(value), Some(name)) = (value, name) else {
            let found = format!("columns {}", headers.join(", "));
            return Err(fail(1, found, "columns `value` (or `label`) and `name`"));
        };
        let rows: Vec<_> = reader.records().collect::<Result<_, _>>().map_err(broken)?;
        for row in rows {
            self.add(line(text, row.position()) as usize, &row[value], &row[name])?;
        }
        Ok(())
    }
}

fn plain(header: &str) -> String {
    header.to_lowercase().chars().filter(|c| c.is_alphanumeric()).collect()
}
