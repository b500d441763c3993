//! Measured stretch-stress points from a CSV file.

use std::path::Path;

use insonify_base::csv::{COMMAS, CsvError, line as line_of, other_separator};
use insonify_base::number;
use insonify_base::read;
use insonify_base::text::clipped;
use insonify_mechanics::needle::beam::fit::Sample;

/// Maximum number of columns of a cell quoted in a message.
const MAX_QUOTED: usize = 60;

/// Names of the columns.
const COLUMNS: [&str; 2] = ["stretch", "stress_kpa"];

/// Range of stretch.
const STRETCH_RANGE: [f64; 2] = [1e-3, 1e3];
/// Largest stress, kPa.
const MAX_STRESS_KPA: f64 = 1e9;

/// Reads a file of points (see [`parse`]).
///
/// # Errors
/// [`CsvError`] as in [`parse`], or if the file cannot be read.
pub fn read(path: &Path) -> Result<Vec<Sample>, CsvError> {
    let text = read::text(path, read::CSV).map_err(|cause| CsvError::Read {
        path: path.to_owned(),
        cause,
    })?;
    parse(text.as_bytes(), path)
}

/// Parses points: a header with the columns `stretch` and `stress_kpa` in any order, or no header and these two in this
/// order; lines that begin with `#` are ignored. `path` is the file name shown in errors.
///
/// # Errors
/// [`CsvError`] if a line is invalid.
pub fn parse(text: &[u8], path: &Path) -> Result<Vec<Sample>, CsvError> {
    let wrong = |line: u64, found: String, expected: &str| CsvError::Line {
        path: path.to_owned(),
        line,
        found: clipped(&found, MAX_QUOTED),
        expected: expected.to_owned(),
    };
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .trim(csv::Trim::All)
        .comment(Some(b'#'))
        .from_reader(text);
    let (mut samples, mut columns) = (Vec::new(), None);
    for record in reader.records() {
        let record = record.map_err(|error| {
            let line = line_of(text, error.position());
            wrong(line, error.to_string(), "two numbers, separated by a comma")
        })?;
        let line = line_of(text, record.position());
        if record.len() != COLUMNS.len() {
            if let Some(separator) = other_separator(&record) {
                return Err(wrong(line, format!("{separator} between cells"), COMMAS));
            }
            let found = format!("{} columns", record.len());
            return Err(wrong(line, found, "two, `stretch` and `stress_kpa`"));
        }
        // The first record names the columns, or already has numbers.
        let Some(columns) = columns else {
            let column = |name: &str| record.iter().position(|cell| cell.eq_ignore_ascii_case(name));
            match COLUMNS.map(column) {
                [Some(stretch), Some(stress)] => columns = Some([stretch, stress]),
                _ if record.iter().all(|cell| cell.parse::<f64>().is_ok()) => {
                    columns = Some([0, 1]);
                    samples.push(sample(&record, [0, 1]).map_err(|(found, expected)| wrong(line, found, expected))?);
                }
                _ => {
                    let found = format!("the header `{}`", record.iter().collect::<Vec<_>>().join(","));
                    return Err(wrong(line, found, "`stretch,stress_kpa`, or numbers"));
                }
            }
            continue;
        };
        samples.push(sample(&record, columns).map_err(|(found, expected)| wrong(line, found, expected))?);
    }
    Ok(samples)
}

fn sample(record: &csv::StringRecord, columns: [usize; 2]) -> Result<Sample, (String, &'static str)> {
    let number = |column: usize| {
        number::parsed(&record[column]).ok_or_else(|| (format!("`{}`", &record[column]), "a finite number"))
    };
    let [stretch, stress_kpa] = [number(columns[0])?, number(columns[1])?];
    if !(STRETCH_RANGE[0]..=STRETCH_RANGE[1]).contains(&stretch) {
        return Err((
            format!("stretch {stretch}"),
            "a stretch of 0.001 to 1000: length over length at rest",
        ));
    }
    if stress_kpa.abs() > MAX_STRESS_KPA {
        return Err((format!("stress_kpa {stress_kpa:e}"), "a stress of -1e9 to 1e9 kPa"));
    }
    Ok(Sample { stretch, stress_kpa })
}
