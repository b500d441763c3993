//! Run-time dispatch of loops to the widest vector registers of the machine.

use std::ops::{Add, Div, Mul, Sub};

use pulp::Arch;
pub use pulp::{Simd, WithSimd};

/// A loop with its arguments. `run` and all that it calls must be `#[inline(always)]`: only code inlined into
/// [`vectorised`] is compiled for the wide registers.
pub trait Kernel {
    /// Result of the loop.
    type Output;

    /// Runs the loop.
    fn run(self) -> Self::Output;
}

/// Runs a kernel, compiled for every supported vector extension and selected at run time. Results do not depend on the
/// selection: Rust neither fuses nor reorders floating-point operations.
#[inline(always)]
pub fn vectorised<K: Kernel>(kernel: K) -> K::Output {
    dispatch(Call(kernel))
}

/// Runs a kernel written with explicit registers. Results of multiply-add depend on whether the machine fuses the two
/// operations, but never on the number of threads.
#[inline(always)]
pub fn dispatch<K: WithSimd>(kernel: K) -> K::Output {
    Arch::new().dispatch(kernel)
}

/// Array whose elements are a function of their index. Unlike `std::array::from_fn` it is always inlined, as everything
/// in a kernel must be.
#[inline(always)]
pub fn array<T: Copy, const N: usize>(value: impl Fn(usize) -> T) -> [T; N] {
    let mut values = [value(0); N];
    for lane in 1..N {
        values[lane] = value(lane);
    }
    values
}

/// Elements of an array, each transformed. Unlike `map` of the standard library it is always inlined.
#[inline(always)]
pub fn map<T: Copy, U: Copy, const N: usize>(elements: [T; N], function: impl Fn(T) -> U) -> [U; N] {
    array(|index| function(elements[index]))
}

/// Numbers in `N` lanes, with lane-wise arithmetic.
#[derive(Clone, Copy, Debug)]
pub struct Pack<const N: usize>(pub [f64; N]);

impl<const N: usize> Pack<N> {
    /// The same number in every lane.
    #[inline(always)]
    pub fn splat(value: f64) -> Self {
        Self([value; N])
    }

    /// A function, lane by lane.
    #[inline(always)]
    pub fn map(self, function: impl Fn(f64) -> f64) -> Self {
        Self(map(self.0, function))
    }

    /// A function of two arguments, lane by lane.
    #[inline(always)]
    pub fn zip(self, other: Self, function: impl Fn(f64, f64) -> f64) -> Self {
        Self(array(|lane| function(self.0[lane], other.0[lane])))
    }

    /// Lane-wise minimum; of NaN and a number the number.
    #[inline(always)]
    pub fn min(self, other: Self) -> Self {
        self.zip(other, f64::min)
    }

    /// Lane-wise maximum; of NaN and a number the number.
    #[inline(always)]
    pub fn max(self, other: Self) -> Self {
        self.zip(other, f64::max)
    }

    /// Lane-wise absolute value.
    #[inline(always)]
    pub fn abs(self) -> Self {
        self.map(f64::abs)
    }

    /// Lane-wise square root.
    #[inline(always)]
    pub fn sqrt(self) -> Self {
        self.map(f64::sqrt)
    }

    /// Lane-wise selection: `yes` in lanes below those of `other`, `no` in the rest and at NaN.
    #[inline(always)]
    pub fn if_below(self, other: Self, yes: Self, no: Self) -> Self {
        Self(array(|lane| {
            if self.0[lane] < other.0[lane] {
                yes.0[lane]
            } else {
                no.0[lane]
            }
        }))
    }
}

macro_rules! operators {
    ($($operator:ident, $function:ident);*) => {
        $(impl<const N: usize> $operator for Pack<N> {
            type Output = Self;

            #[inline(always)]
            fn $function(self, other: Self) -> Self {
                self.zip(other, |a, b| a.$function(b))
            }
        }

        impl<const N: usize> $operator<f64> for Pack<N> {
            type Output = Self;

            #[inline(always)]
            fn $function(self, other: f64) -> Self {
                self.map(|a| a.$function(other))
            }
        })*
    };
}

operators!(Add, add; Sub, sub; Mul, mul; Div, div);

/// A scalar with vector registers: one interface to pulp's per-type functions.
pub trait Lanes: Copy + 'static {
    /// Vector register of this scalar.
    type Vector<S: Simd>: Copy;

    /// Returns a vector with one value in every lane.
    fn splat<S: Simd>(simd: S, value: Self) -> Self::Vector<S>;
    /// Returns `a * b + c`, fused where the machine supports it.
    fn multiply_add<S: Simd>(simd: S, a: Self::Vector<S>, b: Self::Vector<S>, c: Self::Vector<S>) -> Self::Vector<S>;
    /// Returns `a - b`.
    fn difference<S: Simd>(simd: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Vector<S>;
    /// Returns the sum of all lanes.
    fn total<S: Simd>(simd: S, a: Self::Vector<S>) -> Self;
    /// Returns the part of a slice that fills complete registers; the remainder is left out.
    fn vectors<S: Simd>(values: &[Self]) -> &[Self::Vector<S>];
    /// Returns the mutable part of a slice that fills complete registers; the remainder is left out.
    fn vectors_mut<S: Simd>(values: &mut [Self]) -> &mut [Self::Vector<S>];
}

macro_rules! lanes {
    ($scalar:ty, $vector:ident, $splat:ident, $mul_add:ident, $sub:ident, $sum:ident, $slice:ident, $slice_mut:ident) => {
        impl Lanes for $scalar {
            type Vector<S: Simd> = S::$vector;

            #[inline(always)]
            fn splat<S: Simd>(simd: S, value: Self) -> S::$vector {
                simd.$splat(value)
            }
            #[inline(always)]
            fn multiply_add<S: Simd>(simd: S, a: S::$vector, b: S::$vector, c: S::$vector) -> S::$vector {
                simd.$mul_add(a, b, c)
            }
            #[inline(always)]
            fn difference<S: Simd>(simd: S, a: S::$vector, b: S::$vector) -> S::$vector {
                simd.$sub(a, b)
            }
            #[inline(always)]
            fn total<S: Simd>(simd: S, a: S::$vector) -> Self {
                simd.$sum(a)
            }
            #[inline(always)]
            fn vectors<S: Simd>(values: &[Self]) -> &[S::$vector] {
                S::$slice(values).0
            }
            #[inline(always)]
            fn vectors_mut<S: Simd>(values: &mut [Self]) -> &mut [S::$vector] {
                S::$slice_mut(values).0
            }
        }
    };
}

lanes!(
    f32,
    f32s,
    splat_f32s,
    mul_add_e_f32s,
    sub_f32s,
    reduce_sum_f32s,
    as_simd_f32s,
    as_mut_simd_f32s
);
lanes!(
    f64,
    f64s,
    splat_f64s,
    mul_add_e_f64s,
    sub_f64s,
    reduce_sum_f64s,
    as_simd_f64s,
    as_mut_simd_f64s
);

struct Call<K>(K);

impl<K: Kernel> WithSimd for Call<K> {
    type Output = K::Output;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> K::Output {
        self.0.run()
    }
}
