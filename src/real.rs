//! The scalar of the CPU reference: `f32` is the twin of the GPU, `f64` the gold standard it is measured against.

use num_traits::{Float, FromPrimitive, NumAssign};

/// A floating-point scalar that the CPU reference runs in.
pub trait Real: Float + FromPrimitive + NumAssign + Default + Send + Sync + std::fmt::Debug + 'static {
    /// Rounds an `f64` to this type.
    fn of(value: f64) -> Self;
    /// Widens to `f64`, exactly.
    fn wide(self) -> f64;
}

impl Real for f32 {
    #[inline(always)]
    fn of(value: f64) -> Self {
        value as f32
    }
    #[inline(always)]
    fn wide(self) -> f64 {
        f64::from(self)
    }
}

impl Real for f64 {
    #[inline(always)]
    fn of(value: f64) -> Self {
        value
    }
    #[inline(always)]
    fn wide(self) -> f64 {
        self
    }
}
