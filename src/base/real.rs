//! Scalar type of the CPU reference: `f32` matches the GPU, `f64` is the gold standard for it.

use num_traits::{Float, FromPrimitive, NumAssign};

use crate::simd::{self, Kernel};

/// Floating-point scalar of the CPU reference.
pub trait Real: Float + FromPrimitive + NumAssign + Default + Send + Sync + std::fmt::Debug + 'static {
    /// Rounds an `f64` to this type.
    fn of(value: f64) -> Self;
    /// Widens to `f64`, exactly.
    fn wide(self) -> f64;
    /// Converts a signed integer, with rounding.
    fn from_signed(value: i32) -> Self;
    /// Truncates towards zero, with saturation.
    fn truncate(self) -> i32;
    /// Converts a whole number between -2^22 and 2^22, exactly and in vector registers; others give an arbitrary
    /// integer.
    fn integer(self) -> i32;
    /// Returns the copy of a table in this type.
    fn pick(numbers: &Numbers) -> &[Self];
    /// Runs a kernel of numbers of this type: in the widest vector registers of the machine where speed counts, which
    /// is single precision.
    #[inline(always)]
    fn vectorised<K: Kernel>(kernel: K) -> K::Output {
        kernel.run()
    }
}

/// A table computed in double precision, stored in both precisions.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Numbers {
    wide: Vec<f64>,
    narrow: Vec<f32>,
}

impl Numbers {
    /// Stores the numbers and their rounded copies.
    pub fn new(wide: Vec<f64>) -> Self {
        let narrow: Vec<f32> = wide.iter().map(|&x| x as f32).collect();
        Self { wide, narrow }
    }

    /// Returns the copy in the scalar of a backend.
    pub fn of<T: Real>(&self) -> &[T] {
        T::pick(self)
    }
}

impl Real for f32 {
    #[inline(always)]
    fn of(value: f64) -> Self {
        value as f32
    }
    #[inline(always)]
    fn from_signed(value: i32) -> Self {
        value as Self
    }
    #[inline(always)]
    fn truncate(self) -> i32 {
        self as i32
    }
    // Saturating casts are made lane by lane. Between 2^23 and 2^24 the last bits of a number are its integer.
    #[inline(always)]
    fn integer(self) -> i32 {
        const MIDDLE: f32 = 12_582_912.0;
        ((self + MIDDLE).to_bits() as i32).wrapping_sub(MIDDLE.to_bits() as i32)
    }
    fn pick(numbers: &Numbers) -> &[Self] {
        &numbers.narrow
    }
    #[inline(always)]
    fn wide(self) -> f64 {
        f64::from(self)
    }
    #[inline(always)]
    fn vectorised<K: Kernel>(kernel: K) -> K::Output {
        simd::vectorised(kernel)
    }
}

impl Real for f64 {
    #[inline(always)]
    fn of(value: f64) -> Self {
        value
    }
    #[inline(always)]
    fn from_signed(value: i32) -> Self {
        value as Self
    }
    #[inline(always)]
    fn truncate(self) -> i32 {
        self as i32
    }
    #[inline(always)]
    fn integer(self) -> i32 {
        const MIDDLE: f64 = 6_755_399_441_055_744.0;
        (self + MIDDLE).to_bits() as i32
    }
    fn pick(numbers: &Numbers) -> &[Self] {
        &numbers.wide
    }
    #[inline(always)]
    fn wide(self) -> f64 {
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_numbers_become_integers() {
        for number in [0, 1, -1, 2, 17, -4096, 4_194_303, -4_194_304] {
            assert_eq!(<f32 as Real>::integer(number as f32), number);
            assert_eq!(<f64 as Real>::integer(f64::from(number)), number);
        }
        assert_eq!((-0.0f32).integer(), 0);
    }
}
