//! What the CPU backend runs on.

use std::fmt;
use std::num::NonZero;
use std::thread::available_parallelism;

use serde::Serialize;

/// The processor as the CPU backend uses it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Machine {
    /// Operating system and architecture, such as `linux x86_64`.
    pub platform: String,
    /// Threads that the system lets this process run at once.
    pub cores: usize,
    /// Threads that the passes run on.
    pub threads: usize,
    /// The vector registers that the passes run on.
    pub vector: &'static str,
}

impl Machine {
    /// This machine.
    pub fn here() -> Self {
        Self {
            platform: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
            cores: available_parallelism().map_or(1, NonZero::get),
            threads: rayon::current_num_threads(),
            vector: vector(),
        }
    }
}

impl fmt::Display for Machine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            platform,
            cores,
            threads,
            vector,
        } = self;
        write!(f, "{platform}, {cores} cores, {threads} threads, {vector}")
    }
}

#[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
fn vector() -> &'static str {
    match pulp::Arch::new() {
        pulp::Arch::Scalar => "SSE2, 128 bits",
        pulp::Arch::V3(_) => "AVX2, 256 bits",
        _ => "AVX-512, 512 bits",
    }
}

#[cfg(target_arch = "aarch64")]
fn vector() -> &'static str {
    "NEON, 128 bits"
}

#[cfg(not(any(target_arch = "x86", target_arch = "x86_64", target_arch = "aarch64")))]
fn vector() -> &'static str {
    "what the compiler was told of"
}
