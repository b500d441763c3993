//! Loops compiled for the widest vector registers of the machine that runs them.

use pulp::{Arch, Simd, WithSimd};

/// A loop with its arguments. `run` must be `#[inline(always)]`, as must what it calls: only what is inlined into
/// [`vectorised`] is compiled for the wide registers.
pub(crate) trait Kernel {
    /// What it returns.
    type Output;

    /// Runs the loop.
    fn run(self) -> Self::Output;
}

/// Runs a kernel, compiled for every vector extension that may be there and chosen at run time. Results do not depend on
/// which: Rust neither fuses nor reorders floating-point operations.
#[inline(always)]
pub(crate) fn vectorised<K: Kernel>(kernel: K) -> K::Output {
    Arch::new().dispatch(Call(kernel))
}

struct Call<K>(K);

impl<K: Kernel> WithSimd for Call<K> {
    type Output = K::Output;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> K::Output {
        self.0.run()
    }
}
