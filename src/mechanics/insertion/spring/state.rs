//! Lossless encoding of saved states: all numbers by their bits, so that a round trip through text changes nothing.

use nalgebra::{Isometry3, Point3, Quaternion, Translation3, Unit, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// A saved model.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Document {
    /// Identity of the model: its parameters and its needle as text.
    pub model: String,
    /// State, in the order in which the [`Words`] were written.
    pub words: Vec<u64>,
}

/// Encoder of numbers, one after another.
#[derive(Default)]
pub(super) struct Words(pub Vec<u64>);

impl Words {
    pub fn whole(&mut self, number: u64) {
        self.0.push(number);
    }

    pub fn flag(&mut self, flag: bool) {
        self.0.push(flag.into());
    }

    pub fn real(&mut self, number: f64) {
        self.0.push(number.to_bits());
    }

    pub fn vector(&mut self, vector: &Vector3<f64>) {
        vector.iter().for_each(|&number| self.real(number));
    }

    pub fn pose(&mut self, pose: &Isometry3<f64>) {
        self.vector(&pose.translation.vector);
        pose.rotation.coords.iter().for_each(|&number| self.real(number));
    }

    pub fn optional<T>(&mut self, value: Option<T>, put: impl FnOnce(&mut Words, T)) {
        self.flag(value.is_some());
        if let Some(value) = value {
            put(self, value);
        }
    }

    pub fn list<T>(&mut self, items: &[T], put: impl Fn(&mut Words, &T)) {
        self.whole(items.len() as u64);
        items.iter().for_each(|item| put(self, item));
    }

    pub fn region(&mut self, region: Option<i32>) {
        self.optional(region, |to, region| to.whole(region as u32 as u64));
    }
}

/// Decoder of [`Words`]. What does not fit is an error with the expectation.
pub(super) struct Reader<'a>(pub &'a [u64]);

impl Reader<'_> {
    pub fn whole(&mut self) -> Result<u64, String> {
        let (first, rest) = self.0.split_first().ok_or("it ends too early")?;
        self.0 = rest;
        Ok(*first)
    }

    /// Reads a number below a limit.
    pub fn below(&mut self, limit: usize, what: &str) -> Result<u32, String> {
        let found = self.whole()?;
        match found < limit as u64 {
            true => Ok(found as u32),
            false => Err(format!("{what} is {found}; expected one below {limit}")),
        }
    }

    pub fn flag(&mut self) -> Result<bool, String> {
        Ok(self.below(2, "a flag")? == 1)
    }

    /// Reads a finite number.
    pub fn real(&mut self) -> Result<f64, String> {
        let found = f64::from_bits(self.whole()?);
        match found.is_finite() {
            true => Ok(found),
            false => Err(format!("a number is {found}; expected a finite one")),
        }
    }

    pub fn vector(&mut self) -> Result<Vector3<f64>, String> {
        Ok(Vector3::new(self.real()?, self.real()?, self.real()?))
    }

    pub fn point(&mut self) -> Result<Point3<f64>, String> {
        self.vector().map(Point3::from)
    }

    pub fn direction(&mut self) -> Result<Unit<Vector3<f64>>, String> {
        self.vector().map(Unit::new_unchecked)
    }

    pub fn pose(&mut self) -> Result<Isometry3<f64>, String> {
        let translation = Translation3::from(self.vector()?);
        let [i, j, k, w] = [self.real()?, self.real()?, self.real()?, self.real()?];
        let rotation = UnitQuaternion::new_unchecked(Quaternion::new(w, i, j, k));
        Ok(Isometry3::from_parts(translation, rotation))
    }

    pub fn optional<T>(&mut self, get: impl FnOnce(&mut Self) -> Result<T, String>) -> Result<Option<T>, String> {
        match self.flag()? {
            true => get(self).map(Some),
            false => Ok(None),
        }
    }

    pub fn list<T>(&mut self, get: impl Fn(&mut Self) -> Result<T, String>) -> Result<Vec<T>, String> {
        let count = self.below(self.0.len() + 1, "a length")?;
        (0..count).map(|_| get(self)).collect()
    }

    pub fn region(&mut self) -> Result<Option<i32>, String> {
        self.optional(|from| Ok(from.below(1 << 32, "a region")? as i32))
    }

    /// Checks that nothing is left.
    pub fn end(&self) -> Result<(), String> {
        match self.0.len() {
            0 => Ok(()),
            more => Err(format!("it holds {more} numbers too many")),
        }
    }
}
