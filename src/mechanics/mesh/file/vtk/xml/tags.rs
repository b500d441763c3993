//! Scanner of the tags of a `.vtu` file. Raw appended data is not XML, so the few relevant tags are parsed by hand, each
//! with its byte offset.

use super::{Fault, quote};
use crate::base::text::unescape;

/// A tag with its attributes.
#[derive(Clone, Debug)]
pub(super) struct Tag {
    pub at: usize,
    pub name: String,
    attributes: Vec<(String, String)>,
    pub closing: bool,
    pub empty: bool,
}

impl Tag {
    pub fn get(&self, key: &str) -> Option<&str> {
        self.attributes
            .iter()
            .find(|(name, _)| name == key)
            .map(|(_, value)| value.as_str())
    }

    pub fn count(&self, key: &str) -> Result<usize, Fault> {
        let text = self.get(key);
        text.and_then(|text| text.trim().parse().ok()).ok_or_else(|| {
            let found = text.map_or("nothing".to_owned(), |text| format!("`{text}`"));
            Fault::at(self.at, format!("{found} for {key} in <{}>", self.name), "a count")
        })
    }
}

/// Scanner from tag to tag.
pub(super) struct Scanner<'a> {
    pub bytes: &'a [u8],
    pub at: usize,
}

impl<'a> Scanner<'a> {
    /// Reads the text up to the next tag.
    pub fn text(&mut self) -> (usize, &'a [u8]) {
        let (at, rest) = (self.at, &self.bytes[self.at..]);
        let end = rest.iter().position(|b| *b == b'<').unwrap_or(rest.len());
        self.at += end;
        (at, &rest[..end])
    }

    /// Reads the next opening, closing or empty tag; comments and declarations are skipped.
    pub fn tag(&mut self) -> Result<Option<Tag>, Fault> {
        loop {
            let (before, text) = self.text();
            let at = before + text.len();
            let rest = &self.bytes[at..];
            if rest.is_empty() {
                return Ok(None);
            }
            let (skip, end): (bool, &[u8]) = match rest {
                [b'<', b'!', b'-', b'-', ..] => (true, b"-->"),
                [b'<', b'?' | b'!', ..] => (true, b">"),
                _ => (false, b">"),
            };
            let length = rest.windows(end.len()).position(|window| window == end);
            let length = length.ok_or_else(|| Fault::at(at, "a tag that does not end", "`>`"))?;
            self.at = at + length + end.len();
            if !skip {
                return parse_tag(at, &rest[1..length]).map(Some);
            }
        }
    }
}

fn parse_tag(at: usize, inside: &[u8]) -> Result<Tag, Fault> {
    let broken = || {
        Fault::at(
            at,
            quote(&inside[..inside.len().min(60)]),
            "a tag with quoted attributes",
        )
    };
    let text = std::str::from_utf8(inside).map_err(|_| broken())?.trim();
    let (closing, text) = text.strip_prefix('/').map_or((false, text), |text| (true, text));
    let (empty, text) = text.strip_suffix('/').map_or((false, text), |text| (true, text));
    let end = text.find(char::is_whitespace).unwrap_or(text.len());
    let (name, mut rest) = (text[..end].to_owned(), text[end..].trim());
    let mut attributes = Vec::new();
    while !rest.is_empty() {
        let (key, after) = rest.split_once('=').ok_or_else(broken)?;
        let after = after.trim_start();
        let quote = after
            .chars()
            .next()
            .filter(|c| matches!(c, '"' | '\''))
            .ok_or_else(broken)?;
        let (value, tail) = after[1..].split_once(quote).ok_or_else(broken)?;
        attributes.push((key.trim().to_owned(), unescape(value)));
        rest = tail.trim_start();
    }
    Ok(Tag {
        at,
        name,
        attributes,
        closing,
        empty,
    })
}
