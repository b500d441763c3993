//! Cursor in a file of words and lines.

use super::error::{Fault, quote};

/// Reader of words and lines, each with its byte offset.
pub(super) struct Cursor<'a> {
    pub bytes: &'a [u8],
    pub at: usize,
}

impl<'a> Cursor<'a> {
    pub fn new(bytes: &'a [u8]) -> Cursor<'a> {
        Cursor { bytes, at: 0 }
    }

    /// Returns the unread bytes.
    pub fn rest(&self) -> &'a [u8] {
        &self.bytes[self.at..]
    }

    /// Reads the rest of the line, without its end.
    pub fn line(&mut self) -> &'a [u8] {
        let rest = self.rest();
        let end = rest.iter().position(|b| *b == b'\n').unwrap_or(rest.len());
        self.at += (end + 1).min(rest.len());
        &rest[..end]
    }

    /// Returns the next word and its offset without consuming it; empty at the end.
    pub fn peek(&self) -> (usize, &'a [u8]) {
        let rest = self.rest();
        let start = rest.iter().position(|b| !b.is_ascii_whitespace()).unwrap_or(rest.len());
        let end = rest[start..]
            .iter()
            .position(u8::is_ascii_whitespace)
            .map_or(rest.len(), |n| start + n);
        (self.at + start, &rest[start..end])
    }

    /// Reads the next word and its offset; empty at the end.
    pub fn word(&mut self) -> (usize, &'a [u8]) {
        let (at, word) = self.peek();
        self.at = at + word.len();
        (at, word)
    }

    /// Reads the next word as a number; `expected` describes it.
    pub fn number<T: std::str::FromStr>(&mut self, expected: impl FnOnce() -> String) -> Result<T, Fault> {
        let (at, word) = self.word();
        let number = std::str::from_utf8(word).ok().and_then(|word| word.parse().ok());
        number.ok_or_else(|| Fault::at(at, quote(word), expected()))
    }

    pub fn count(&mut self) -> Result<usize, Fault> {
        self.number(|| "a count".to_owned())
    }

    /// Reads the next `count` bytes.
    pub fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let taken = self.rest().get(..count)?;
        self.at += count;
        Some(taken)
    }
}
