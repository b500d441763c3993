//! Description of the CPU in use.

use std::fmt;
use std::num::NonZero;
use std::thread::available_parallelism;
use std::time::SystemTime;

use serde::Serialize;

use crate::parallel;

/// Processor as used by the CPU backend.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Machine {
    /// Operating system and architecture, for example `linux x86_64`.
    pub platform: String,
    /// Number of threads that the system lets this process run at once.
    pub cores: usize,
    /// Number of threads that the passes use.
    pub threads: usize,
    /// Vector instruction set that the passes use.
    pub vector: String,
}

impl Machine {
    /// Describes this machine.
    pub fn here() -> Self {
        Self {
            platform: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
            cores: available_parallelism().map_or(1, NonZero::get),
            threads: parallel::threads(),
            vector: vector().to_owned(),
        }
    }
}

/// Returns today's date in UTC, as `2026-01-31`.
pub fn today() -> String {
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
    date(since.map_or(0, |since| since.as_secs() / 86_400))
}

/// Returns the Gregorian date `days` after 1970-01-01.
fn date(days: u64) -> String {
    const YEARS_400: u64 = 146_097;
    let leap = |year: u64| year.is_multiple_of(4) && (!year.is_multiple_of(100) || year.is_multiple_of(400));
    let (mut year, mut left) = (1970 + 400 * (days / YEARS_400), days % YEARS_400);
    while left >= 365 + u64::from(leap(year)) {
        left -= 365 + u64::from(leap(year));
        year += 1;
    }
    let february = 28 + u64::from(leap(year));
    let mut month = 1;
    for length in [31, february, 31, 30, 31, 30, 31, 31, 30, 31, 30] {
        if left < length {
            break;
        }
        left -= length;
        month += 1;
    }
    format!("{year}-{month:02}-{:02}", left + 1)
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
    "vector width of the compiler target"
}

#[cfg(test)]
mod tests {
    use super::date;

    #[test]
    fn dates_follow_the_calendar() {
        let known = [
            (0, "1970-01-01"),
            (58, "1970-02-28"),
            (59, "1970-03-01"),
            (11_016, "2000-02-29"),
            (11_017, "2000-03-01"),
            (19_722, "2023-12-31"),
            (47_540, "2100-02-28"),
            (47_541, "2100-03-01"),
            (146_097, "2370-01-01"),
        ];
        for (days, expected) in known {
            assert_eq!(date(days), expected);
        }
    }
}
