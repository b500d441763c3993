//! Tables of numbers and names in CSV files: columns by name, errors with file and line.

use std::io;
use std::path::{Path, PathBuf};

use csv::StringRecord;

use crate::blame::Blame;
use crate::number::{self, LARGEST};
use crate::read;
use crate::text::{clipped, head};

/// Maximum number of columns of a quoted cell.
const QUOTED: usize = 60;

/// Why a CSV file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum CsvError {
    /// The file cannot be read.
    #[error("{}: cannot be read: {cause}", path.display())]
    Read {
        /// Path of the file.
        path: PathBuf,
        /// Error of the operating system.
        cause: io::Error,
    },
    /// A line holds something else than expected.
    #[error("{}, line {line}: found {found}; expected {expected}", path.display())]
    Line {
        /// Path of the file.
        path: PathBuf,
        /// Line number, from 1.
        line: u64,
        /// Text found.
        found: String,
        /// Text expected.
        expected: String,
    },
    /// The numbers cannot be used.
    #[error("{}: {text}", path.display())]
    Contents {
        /// Path of the file.
        path: PathBuf,
        /// Reason.
        text: String,
    },
}

impl Blame for CsvError {
    fn is_machine(&self) -> bool {
        matches!(self, Self::Read { cause, .. } if read::is_machine(cause))
    }
}

/// Table with a header. Lines that begin with `#` are comments.
#[derive(Debug)]
pub struct Csv {
    path: PathBuf,
    header: StringRecord,
    /// Records with their lines.
    records: Vec<(u64, StringRecord)>,
}

/// Row of a table.
#[derive(Clone, Copy)]
pub struct Row<'a> {
    table: &'a Csv,
    line: u64,
    record: &'a StringRecord,
}

/// Line, from 1, of a record in a text that begins at a position of the reader: that of comments, blank lines and the
/// rest of a line end before it.
pub fn line(text: &[u8], position: Option<&csv::Position>) -> u64 {
    let Some(position) = position else { return 1 };
    let rest = text.get(position.byte() as usize..).unwrap_or_default();
    let lines = rest.split(|byte| *byte == b'\n').map(<[u8]>::trim_ascii);
    let before = lines.take_while(|line| line.is_empty() || line.starts_with(b"#"));
    position.line() + before.count() as u64
}

/// Returns the name of the separator that a header has in place of commas; `None` for any other header.
pub fn other_separator(header: &StringRecord) -> Option<&'static str> {
    let separators = [(';', "semicolons"), ('\t', "tabs")];
    let (_, name) = separators.into_iter().find(|(mark, _)| {
        let cell = header.get(0).unwrap_or_default();
        header.len() == 1 && cell.contains(*mark)
    })?;
    Some(name)
}

/// Expected where [`other_separator`] is found.
pub const COMMAS: &str = "commas between cells, and points in numbers (1.5): export the table with these";

impl Csv {
    /// Reads a table with all `required` columns, any of the `optional` ones, and no others, in any order.
    ///
    /// # Errors
    /// [`CsvError`] with the line, what was found and what was expected; also if there are no rows.
    pub fn read(path: &Path, required: &[&str], optional: &[&str]) -> Result<Self, CsvError> {
        let table = Self::open(path, required)?;
        let known = |name: &str| required.contains(&name) || optional.contains(&name);
        match table.header.iter().find(|name| !known(name)) {
            Some(name) => Err(table.wrong(
                1,
                format!("the unknown column `{}`", head(name, QUOTED)),
                expected(required, optional),
            )),
            None => Ok(table),
        }
    }

    /// Reads a table with all `required` columns; others are ignored.
    ///
    /// # Errors
    /// The errors of [`Csv::read`].
    pub fn open(path: &Path, required: &[&str]) -> Result<Self, CsvError> {
        let text = read::text(path, read::CSV).map_err(|cause| CsvError::Read {
            path: path.to_owned(),
            cause,
        })?;
        Self::parse(path, text.as_bytes(), required)
    }

    /// Reads a table from memory as [`Csv::open`] does; `path` is used only in errors.
    ///
    /// # Errors
    /// The errors of [`Csv::open`].
    pub fn parse(path: &Path, bytes: &[u8], required: &[&str]) -> Result<Self, CsvError> {
        let mut reader = csv::ReaderBuilder::new()
            .trim(csv::Trim::All)
            .comment(Some(b'#'))
            .from_reader(bytes);
        let mut table = Self {
            path: path.to_owned(),
            header: StringRecord::new(),
            records: Vec::new(),
        };
        table.header = reader.headers().map_err(|error| table.torn(bytes, error))?.clone();
        if let Some(separator) = other_separator(&table.header) {
            let found = format!("{separator} between the cells of `{}`", head(&table.header[0], QUOTED));
            return Err(table.wrong(1, found, COMMAS));
        }
        for (index, name) in table.header.iter().enumerate() {
            if table.header.iter().take(index).any(|other| other == name) {
                let found = format!("the column `{}` twice", head(name, QUOTED));
                return Err(table.wrong(1, found, "each column once"));
            }
        }
        if let Some(missing) = required.iter().find(|name| !table.has(name)) {
            let names = clipped(&table.header.iter().collect::<Vec<_>>().join(","), QUOTED);
            let found = format!("the header `{names}` without `{missing}`");
            return Err(table.wrong(1, found, expected(required, &[])));
        }
        for record in reader.records() {
            let record = record.map_err(|error| table.torn(bytes, error))?;
            table.records.push((line(bytes, record.position()), record));
        }
        if table.records.is_empty() {
            Err(table.wrong(1, "no rows after the header".to_owned(), "at least one"))
        } else {
            Ok(table)
        }
    }

    /// Whether the table has a column.
    pub fn has(&self, name: &str) -> bool {
        self.header.iter().any(|other| other == name)
    }

    /// Rows in the order of the file.
    pub fn rows(&self) -> impl ExactSizeIterator<Item = Row<'_>> {
        self.records.iter().map(|(line, record)| Row {
            table: self,
            line: *line,
            record,
        })
    }

    fn wrong(&self, line: u64, found: String, expected: impl Into<String>) -> CsvError {
        CsvError::Line {
            path: self.path.clone(),
            line,
            found,
            expected: expected.into(),
        }
    }

    fn torn(&self, bytes: &[u8], error: csv::Error) -> CsvError {
        let line = line(bytes, error.position());
        match error.kind() {
            csv::ErrorKind::UnequalLengths { expected_len, len, .. } => {
                let expected = format!("{expected_len}, as in the header");
                self.wrong(line, format!("{len} cells"), expected)
            }
            csv::ErrorKind::Utf8 { err, .. } => {
                let found = format!("other bytes in cell {}", err.field() + 1);
                self.wrong(line, found, "UTF-8 text")
            }
            _ => self.wrong(line, error.to_string(), "a table"),
        }
    }
}

impl<'a> Row<'a> {
    /// Cell of a column; empty if the table has no such column.
    pub fn text(self, column: &str) -> &'a str {
        let index = self.table.header.iter().position(|name| name == column);
        index.and_then(|index| self.record.get(index)).unwrap_or_default()
    }

    /// Finite number in a column, as [`number::parsed`] takes it.
    ///
    /// # Errors
    /// [`CsvError::Line`] for anything else.
    pub fn number(self, column: &str) -> Result<f64, CsvError> {
        number::parsed(self.text(column)).ok_or_else(|| match self.text(column).parse::<f64>() {
            Ok(number) if number.is_finite() => self.wrong(column, format!("a number of at most {LARGEST:e}")),
            _ => self.wrong(column, "a finite number"),
        })
    }

    /// Finite numbers in several columns.
    ///
    /// # Errors
    /// [`CsvError::Line`] for anything else.
    pub fn numbers<const N: usize>(self, columns: [&str; N]) -> Result<[f64; N], CsvError> {
        let mut numbers = [0.0; N];
        for (number, column) in numbers.iter_mut().zip(columns) {
            *number = self.number(column)?;
        }
        Ok(numbers)
    }

    /// Count from 0 in a column.
    ///
    /// # Errors
    /// [`CsvError::Line`] for anything else.
    pub fn count(self, column: &str) -> Result<usize, CsvError> {
        let count = self.text(column).parse();
        count.map_err(|_| self.wrong(column, "a whole number from 0"))
    }

    /// Error for numbers of the row that do not go together.
    pub fn refused(self, text: impl std::fmt::Display) -> CsvError {
        CsvError::Contents {
            path: self.table.path.clone(),
            text: format!("line {}: {text}", self.line),
        }
    }

    /// Error for the cell of a column.
    pub fn wrong(self, column: &str, expected: impl Into<String>) -> CsvError {
        let found = format!("`{}` in column `{column}`", head(self.text(column), QUOTED));
        self.table.wrong(self.line, found, expected)
    }
}

/// Names of the columns in words.
fn expected(required: &[&str], optional: &[&str]) -> String {
    match optional {
        [] => format!("the columns {}", required.join(",")),
        _ => format!("the columns {}, and perhaps {}", required.join(","), optional.join(",")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Csv, CsvError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.csv");
        std::fs::write(&path, text).unwrap();
        Csv::read(&path, &["frame", "u_px"], &["wire"])
    }

    #[test]
    fn columns_are_found_by_name_in_any_order() {
        let table = read("\u{feff}u_px, frame\n# noted by hand\n 1.5 , 3\n").unwrap();
        let row = table.rows().next().unwrap();
        assert_eq!((row.count("frame").unwrap(), row.number("u_px").unwrap()), (3, 1.5));
        assert!(!table.has("wire") && row.text("wire").is_empty());
    }

    #[test]
    fn faults_say_where_they_are() {
        let fault = |text: &str| match read(text) {
            Err(error) => error.to_string(),
            Ok(table) => {
                let row = table.rows().last().unwrap();
                let (count, number) = (row.count("frame").map(drop), row.number("u_px").map(drop));
                count.and(number).unwrap_err().to_string()
            }
        };
        let cases = [
            (
                "frame,u_px,x\n0,1,2\n",
                "line 1: found the unknown column `x`; expected the columns frame,u_px, and perhaps wire",
            ),
            (
                "frame,wire\n0,1\n",
                "line 1: found the header `frame,wire` without `u_px`",
            ),
            ("frame,u_px,frame\n0,1,2\n", "line 1: found the column `frame` twice"),
            ("frame,u_px\n", "line 1: found no rows after the header"),
            (
                "\u{feff}frame;u_px\r\n0;1,5\r\n",
                "line 1: found semicolons between the cells of `frame;u_px`; expected commas between cells, and points in numbers",
            ),
            ("frame\tu_px\n0\t1\n", "line 1: found tabs between the cells"),
            // Near miss: a semicolon within the name of a column.
            (
                "frame,u;px\n0,1\n",
                "line 1: found the header `frame,u;px` without `u_px`",
            ),
            (
                "frame,u_px\n0,1\n2\n",
                "line 3: found 1 cells; expected 2, as in the header",
            ),
            (
                "frame,u_px\n0,1\n-1,2\n",
                "line 3: found `-1` in column `frame`; expected a whole number from 0",
            ),
            (
                "frame,u_px\n1,nan\n",
                "line 2: found `nan` in column `u_px`; expected a finite number",
            ),
        ];
        for (text, words) in cases {
            let error = fault(text);
            assert!(
                error.contains(words) && error.contains("t.csv"),
                "{error}\nexpected {words}"
            );
        }
    }
}
