//! Loops compiled for the widest vector registers of the machine that runs them.

use pulp::{Arch, Simd, WithSimd};

/// Calls `function(arguments)`, compiled for every vector extension that may be there and chosen at run time. Results do not
/// depend on which: Rust neither fuses nor reorders floating-point operations.
///
/// The function must be `#[inline(always)]`: only what is inlined here is compiled for the wide registers. (A closure is not.)
#[inline(always)]
pub(crate) fn vectorised<A, R>(function: impl FnOnce(A) -> R, arguments: A) -> R {
    Arch::new().dispatch(Call { function, arguments })
}

struct Call<F, A> {
    function: F,
    arguments: A,
}

impl<A, R, F: FnOnce(A) -> R> WithSimd for Call<F, A> {
    type Output = R;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> R {
        (self.function)(self.arguments)
    }
}
