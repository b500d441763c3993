//! Names of several data files in a header: a list of lines, or a numbered pattern such as `slice%03d.raw 0 29 1`.

use std::path::Path;

use super::error::{At, VolumeError};
use super::text::Field;

/// Largest number of data files.
const MOST: usize = 1 << 16;

/// Whether a value announces a list of names, one a line: `LIST`, perhaps with the number of axes of each file.
pub(super) fn is_list(value: &str) -> bool {
    let axes = value.strip_prefix("LIST").map(|rest| rest.trim().trim_end_matches('D'));
    axes.is_some_and(|axes| axes.chars().all(|c| c.is_ascii_digit()))
}

/// An error about too many files.
pub(super) fn check(path: &Path, line: At, files: usize) -> Result<(), VolumeError> {
    if files > MOST {
        let expected = format!("at most {MOST} data files");
        Err(VolumeError::malformed(path, line, format!("{files} or more"), expected))
    } else {
        Ok(())
    }
}

/// The name of a data file, or those of a pattern with its first and last number and step.
pub(super) fn names(field: &Field) -> Result<Vec<String>, VolumeError> {
    let mut words = field.value.split_whitespace();
    let Some(pattern) = words.next().and_then(Pattern::parse) else {
        return Ok(vec![field.value.to_owned()]);
    };
    let expected = "a pattern with first number, last number and step, such as part%03d.raw 0 29 1";
    let numbers: Result<Vec<i64>, _> = words.map(str::parse).collect();
    // A fourth number is that of the axes of each file, which the sizes tell as well.
    let (Ok([first, last]) | Ok([first, last, ..])) = numbers.as_deref() else {
        return Err(field.malformed(expected));
    };
    let step = numbers
        .as_deref()
        .ok()
        .and_then(|numbers| numbers.get(2))
        .copied()
        .unwrap_or(1);
    let steps = last.checked_sub(*first).and_then(|span| span.checked_div(step));
    let steps = steps.and_then(|steps| usize::try_from(steps).ok());
    let count = steps.ok_or_else(|| field.malformed(expected))?.saturating_add(1);
    check(field.path, At::Line(field.line), count)?;
    Ok((0..count as i64)
        .map(|index| pattern.name(first + index * step))
        .collect())
}

/// A file name with a number in it, after `printf`.
struct Pattern<'a> {
    before: &'a str,
    digits: usize,
    after: &'a str,
}

impl<'a> Pattern<'a> {
    fn parse(word: &'a str) -> Option<Self> {
        let (before, rest) = word.split_once('%')?;
        let end = rest.find(|c: char| !(c.is_ascii_digit() || c == '.'))?;
        let (width, after) = rest.split_at(end);
        let after = after.strip_prefix(['d', 'i', 'u'])?;
        let digits = if width.is_empty() {
            0
        } else {
            width.trim_start_matches('.').parse().ok()?
        };
        (digits <= 32).then_some(Self { before, digits, after })
    }

    fn name(&self, number: i64) -> String {
        format!("{}{number:0digits$}{}", self.before, self.after, digits = self.digits)
    }
}
