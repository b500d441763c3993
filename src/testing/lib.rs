//! Shared by tests of several crates: a GPU or a visible skip, threads without a cache, the least accurate arithmetic
//! of WGSL.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use insonify_base::parallel::Pool;

pub mod gpu;
pub mod lossy;
pub mod pages;
pub mod shader;

/// The result of `make` on this many threads, none of which uses the cache.
///
/// # Panics
/// If the threads cannot be started.
pub fn made_on<T: Send>(threads: usize, make: impl FnOnce() -> T + Send) -> T {
    let pool = Pool::started(threads, insonify_base::cache::bypass);
    pool.expect("threads").install(make)
}

/// Says that the test is skipped and why, past the capture of its output. Skips are counted, so that the last one of a
/// binary has their number.
pub fn skip(why: &str) {
    static SKIPPED: AtomicUsize = AtomicUsize::new(0);
    let number = SKIPPED.fetch_add(1, Ordering::Relaxed) + 1;
    let test = std::thread::current().name().unwrap_or("a test").to_owned();
    writeln!(std::io::stderr(), "SKIPPED ({number}) {test}: {why}").expect("standard error");
}

/// Environment variable that turns skips for missing data into failures.
const REQUIRE_DATA: &str = "INSONIFY_REQUIRE_DATA";

/// A file or folder of the real data beside the repository, or `None` after saying that the test is skipped.
///
/// # Panics
/// If it is missing and the environment variable `INSONIFY_REQUIRE_DATA` is 1.
pub fn shared(path: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../../shared/data")
        .join(path);
    if path.exists() {
        return Some(path);
    }
    let required = std::env::var(REQUIRE_DATA).is_ok_and(|value| value == "1");
    assert!(!required, "{REQUIRE_DATA}=1, and {} is not there", path.display());
    skip(&format!("{} is not there", path.display()));
    None
}
