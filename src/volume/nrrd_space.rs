//! Spaces and vectors of an NRRD header.

use nalgebra::Vector3;

use super::error::VolumeError;
use super::text::Field;

/// A named space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Space {
    /// Number of components of its vectors.
    pub(crate) dimension: usize,
    /// Sign of each of its axes in LPS.
    pub(crate) to_lps: Vector3<f64>,
}

impl Space {
    /// Parses a `space` field: three directions by name or letter, or one of the spaces without anatomy, which are taken
    /// as LPS with a warning. A trailing `-time` or `T` adds a dimension.
    pub(crate) fn parse(field: &Field, warnings: &mut Vec<String>) -> Result<Self, VolumeError> {
        let name = field.value.to_ascii_lowercase();
        let (name, timed) = match name.strip_suffix("-time") {
            Some(name) => (name, true),
            None if name.len() == 4 && name.ends_with('t') => (&name[..3], true),
            None => (name.as_str(), false),
        };
        let dimension = 3 + usize::from(timed);
        if matches!(name, "scanner-xyz" | "3d-right-handed" | "3d-left-handed") {
            warnings.push(format!("space {:?} names no anatomy: taken as LPS", field.value));
            return Ok(Self {
                dimension,
                to_lps: Vector3::repeat(1.0),
            });
        }
        let words: Vec<&str> = if name.contains('-') {
            name.split('-').collect()
        } else {
            (0..name.len()).filter_map(|at| name.get(at..=at)).collect()
        };
        let to_lps = match words[..] {
            [x, y, z] => [
                ("left", "right", x),
                ("posterior", "anterior", y),
                ("superior", "inferior", z),
            ]
            .map(|(positive, negative, word)| sign(word, positive, negative)),
            _ => [None; 3],
        };
        match to_lps {
            [Some(x), Some(y), Some(z)] => Ok(Self {
                dimension,
                to_lps: Vector3::new(x, y, z),
            }),
            _ => Err(field.malformed("a space such as left-posterior-superior or RAS")),
        }
    }
}

fn sign(word: &str, positive: &str, negative: &str) -> Option<f64> {
    let is = |name: &str| word == name || word == &name[..1];
    if is(positive) {
        Some(1.0)
    } else if is(negative) {
        Some(-1.0)
    } else {
        None
    }
}

/// Parses vectors such as `(1,0,0) (0,1,0) none`.
pub(crate) fn vectors(field: &Field) -> Result<Vec<Option<Vec<f64>>>, VolumeError> {
    let expected = "vectors such as (1,0,0), or none";
    let mut rest = field.value;
    let mut out = Vec::new();
    while !rest.is_empty() {
        if let Some(after) = rest.strip_prefix("none") {
            out.push(None);
            rest = after.trim_start();
            continue;
        }
        let (inner, after) = rest
            .strip_prefix('(')
            .and_then(|opened| opened.split_once(')'))
            .ok_or_else(|| field.malformed(expected))?;
        let numbers: Result<Vec<f64>, _> = inner.split(',').map(|number| number.trim().parse()).collect();
        out.push(Some(numbers.map_err(|_| field.malformed(expected))?));
        rest = after.trim_start();
    }
    Ok(out)
}
