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
    /// Truncates a number from 0 to below 2^31, exactly and in vector registers; others give an arbitrary integer.
    #[inline(always)]
    fn natural(self) -> u32 {
        let high = (self * Self::of(1.0 / 65_536.0)).trunc();
        let low = (self - high * Self::of(65_536.0)).trunc();
        ((high.integer() as u32) << 16).wrapping_add(low.integer() as u32)
    }
    /// Two to a power of at most 0, in vector registers in single precision; 0 where that is no normal number.
    #[inline(always)]
    fn fraction_of_two(self) -> Self {
        self.exp2()
    }
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
    // Taylor's series of 2^x to the sixth power, from -1/2 to 1/2 within 2e-7; the exponent's bits for the rest.
    #[inline(always)]
    fn fraction_of_two(self) -> Self {
        const LEAST: f32 = -126.0;
        let power = self.max(LEAST);
        let whole = (power + 0.5).floor();
        let x = (power - whole) * std::f32::consts::LN_2;
        let series = 1.0 + x * (1.0 + x * (0.5 + x * (1.0 / 6.0 + x * (1.0 / 24.0 + x * (1.0 / 120.0 + x / 720.0)))));
        let value = series * Self::from_bits(((whole.integer() + 127) << 23) as u32);
        if self < LEAST { 0.0 } else { value }
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
    fn fractions_of_two_are_those_of_the_library() {
        for step in 0..=126_000 {
            let power = -0.001 * f64::from(step);
            let (fraction, expected) = ((power as f32).fraction_of_two(), f64::from(power as f32).exp2());
            assert!(
                (f64::from(fraction) / expected - 1.0).abs() < 3e-7,
                "2^{power}: {fraction}"
            );
        }
        assert_eq!((0.0f32.fraction_of_two(), (-130.0f32).fraction_of_two()), (1.0, 0.0));
    }

    #[test]
    fn whole_numbers_become_integers() {
        for number in [0, 1, -1, 2, 17, -4096, 4_194_303, -4_194_304] {
            assert_eq!(<f32 as Real>::integer(number as f32), number);
            assert_eq!(<f64 as Real>::integer(f64::from(number)), number);
        }
        assert_eq!((-0.0f32).integer(), 0);
        for number in [
            0.0,
            0.75,
            65_535.5,
            65_536.0,
            8_388_607.5,
            1_234_567_936.0,
            2_147_483_520.0,
        ] {
            assert_eq!([(number as f32).natural(), number.natural()], [number as u32; 2]);
        }
    }
}
