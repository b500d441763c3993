//! Text headers followed by binary data, line by line.

use std::io::{self, BufRead, Read};
use std::path::Path;

use super::error::{At, VolumeError, quoted};

/// Longest text header, bytes. Headers of sequences have about a kilobyte per frame.
const MAX_HEADER_BYTES: u64 = 256 << 20;

/// One line of a header.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Line {
    /// Line number, counted from 1.
    pub number: usize,
    /// Text without the line end; bytes that are not UTF-8 are replaced.
    pub text: String,
}

/// Reads lines and counts their bytes.
pub(super) struct Lines<R> {
    reader: R,
    number: usize,
    offset: u64,
}

impl<R: BufRead> Lines<R> {
    pub(super) fn new(reader: R) -> Self {
        Self {
            reader,
            number: 0,
            offset: 0,
        }
    }

    /// Reads the next line; `None` at the end of the file.
    pub(super) fn next(&mut self) -> io::Result<Option<Line>> {
        let mut bytes = Vec::new();
        let left = MAX_HEADER_BYTES.saturating_sub(self.offset);
        let read = (&mut self.reader).take(left).read_until(b'\n', &mut bytes)?;
        self.offset += read as u64;
        if self.offset == MAX_HEADER_BYTES {
            let found = format!("found no end of the header; expected one of less than {MAX_HEADER_BYTES} bytes");
            return Err(io::Error::new(io::ErrorKind::InvalidInput, found));
        }
        if read == 0 {
            return Ok(None);
        }
        self.number += 1;
        while matches!(bytes.last(), Some(b'\n' | b'\r')) {
            bytes.pop();
        }
        Ok(Some(Line {
            number: self.number,
            text: String::from_utf8_lossy(&bytes).into_owned(),
        }))
    }

    /// Number of bytes read so far.
    pub(super) fn offset(&self) -> u64 {
        self.offset
    }

    /// Number of lines read so far.
    pub(super) fn count(&self) -> usize {
        self.number
    }
}

/// A header field with its value and line number.
#[derive(Clone, Debug)]
pub(super) struct Field<'a> {
    pub path: &'a Path,
    pub line: usize,
    pub name: &'a str,
    pub value: &'a str,
}

impl Field<'_> {
    /// An error about this field.
    pub(super) fn malformed(&self, expected: impl Into<String>) -> VolumeError {
        let found = format!("{} {}", self.name, quoted(self.value));
        VolumeError::malformed(self.path, At::Line(self.line), found, expected)
    }

    /// An error about a valid but unsupported value of this field.
    pub(super) fn unsupported(&self, expected: impl Into<String>) -> VolumeError {
        let found = format!("{} {}", self.name, quoted(self.value));
        VolumeError::unsupported(self.path, At::Line(self.line), found, expected)
    }

    /// Parses the blank-separated words as numbers.
    pub(super) fn numbers<T: std::str::FromStr>(&self, what: &str) -> Result<Vec<T>, VolumeError> {
        self.value
            .split_whitespace()
            .map(|word| word.parse().map_err(|_| self.malformed(what)))
            .collect()
    }

    /// Parses exactly `count` numbers.
    pub(super) fn exactly<T: std::str::FromStr>(&self, count: usize, what: &str) -> Result<Vec<T>, VolumeError> {
        let numbers = self.numbers(what)?;
        if numbers.len() == count {
            Ok(numbers)
        } else {
            Err(self.malformed(format!("{count} numbers: {what}")))
        }
    }

    /// Checks that a spacing is finite and above 0.
    pub(crate) fn check_spacing(&self, spacing: f64) -> Result<f64, VolumeError> {
        if spacing > 0.0 && spacing.is_finite() {
            Ok(spacing)
        } else {
            Err(self.malformed("spacings above 0 and finite, mm"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_count_bytes_and_drop_line_ends() {
        let mut lines = Lines::new(&b"one\r\ntwo\n\xff\nlast"[..]);
        let mut texts = Vec::new();
        while let Some(line) = lines.next().unwrap() {
            texts.push((line.number, line.text, lines.offset()));
        }
        let expected = [(1, "one", 5), (2, "two", 9), (3, "\u{fffd}", 11), (4, "last", 15)];
        assert_eq!(texts, expected.map(|(n, t, o)| (n, t.to_owned(), o)));
    }
}
