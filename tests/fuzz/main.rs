//! Mutated files of every format, through what the commands do with them: each case ends with a result or a message of
//! bounded length, within seconds and a limit of memory, without a panic, and leaves no file where it failed.
//!
//! `INSONIFY_FUZZ_CASES` (of each format), `INSONIFY_FUZZ_SEED`, `INSONIFY_FUZZ_FORMAT` and `INSONIFY_FUZZ_FIRST`
//! choose the cases.

mod corpus;
mod formats;
mod mutate;

use std::alloc::{GlobalAlloc, Layout, System};
use std::collections::BTreeMap;
use std::io::Write;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use formats::Format;
use mutate::Dice;

/// Cases of each format where none are asked for: about a minute in all.
const CASES: u64 = 400;
/// Longest case, s.
const PATIENCE_S: f64 = 10.0;
/// Most memory of a case, bytes: twice what a decoder may take.
const MOST: usize = 2 << 30;
/// Failures of one cause that are shown.
const SHOWN: usize = 2;

/// The last case: what reproduces it, where its file is kept, and its bytes.
static RUNNING: Mutex<Option<(String, PathBuf, Vec<u8>)>> = Mutex::new(None);
/// Number of the case that runs, 0 between cases.
static CASE: AtomicU64 = AtomicU64::new(0);
/// What the last panic said, and where.
static PANIC: Mutex<String> = Mutex::new(String::new());

/// Counts the memory that is taken, and its peak since the last case.
struct Counted;

static TAKEN: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);

fn take(bytes: usize) {
    let taken = TAKEN.fetch_add(bytes, Ordering::Relaxed) + bytes;
    PEAK.fetch_max(taken, Ordering::Relaxed);
}

// SAFETY: every call goes unchanged to the system allocator; pages of zeros count though they are not touched.
#[allow(unsafe_code, reason = "an allocator cannot be watched without implementing one")]
unsafe impl GlobalAlloc for Counted {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        take(layout.size());
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        take(layout.size());
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        take(size);
        TAKEN.fetch_sub(layout.size(), Ordering::Relaxed);
        unsafe { System.realloc(pointer, layout, size) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        TAKEN.fetch_sub(layout.size(), Ordering::Relaxed);
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counted = Counted;

/// A number from the environment.
fn number(name: &str, default: u64) -> u64 {
    std::env::var(name).map_or(default, |text| {
        text.parse()
            .unwrap_or_else(|_| panic!("{name}: a whole number, not {text}"))
    })
}

fn main() -> ExitCode {
    let [cases, seed, first] = [("CASES", CASES), ("SEED", 0), ("FIRST", 0)]
        .map(|(name, default)| number(&format!("INSONIFY_FUZZ_{name}"), default));
    let only = std::env::var("INSONIFY_FUZZ_FORMAT").ok();
    std::panic::set_hook(Box::new(|info| {
        *PANIC.lock().unwrap() = info.to_string().replace('\n', ": ")
    }));
    std::thread::spawn(watch);
    // In memory where the system has such a place.
    let shared = Path::new("/dev/shm");
    let folder = if shared.is_dir() {
        tempfile::tempdir_in(shared)
    } else {
        tempfile::tempdir()
    };
    let folder = folder.expect("a folder");
    let mut causes: BTreeMap<String, usize> = BTreeMap::new();
    let mut total = 0;
    for format in formats::all(folder.path()) {
        if only.as_ref().is_some_and(|only| only != format.name) {
            continue;
        }
        let (start, mut accepted) = (Instant::now(), 0);
        for case in first..first + cases {
            match run(&format, folder.path(), seed, case) {
                Ok(sound) => accepted += u64::from(sound),
                Err(cause) => {
                    let count = causes.entry(cause.clone()).or_default();
                    *count += 1;
                    if *count <= SHOWN {
                        report(&cause);
                    }
                }
            }
        }
        total += cases;
        println!(
            "{:<12} {cases} cases, {accepted} accepted, {:.1} s",
            format.name,
            start.elapsed().as_secs_f64()
        );
    }
    println!("{total} cases with seed {seed}: {} causes of failure", causes.len());
    for (cause, count) in &causes {
        println!("{count:>8} x {cause}");
    }
    ExitCode::from(u8::from(!causes.is_empty() || total == 0))
}

/// Runs a case: whether its file was accepted, or why it failed.
fn run(format: &Format, folder: &Path, seed: u64, case: u64) -> Result<bool, String> {
    let mut dice = Dice::new(seed, format.name, case);
    let bytes = match usize::try_from(case).ok().and_then(|case| format.corpus.get(case)) {
        Some(sound) => sound.clone(),
        None => mutate::mutated(&format.corpus, format.binary, &mut dice),
    };
    let path = folder.join(format.file);
    let out = folder.join("out");
    let again = format!(
        "INSONIFY_FUZZ_FORMAT={} INSONIFY_FUZZ_SEED={seed} INSONIFY_FUZZ_FIRST={case} INSONIFY_FUZZ_CASES=1 cargo test --test fuzz",
        format.name
    );
    let kept =
        Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("fuzz-{}-{seed}-{case}-{}", format.name, format.file));
    *RUNNING.lock().unwrap() = Some((again, kept, bytes.clone()));
    CASE.store(case + 1, Ordering::Relaxed);
    std::fs::create_dir(&out)
        .and_then(|()| std::fs::write(&path, &bytes))
        .expect("a folder that can be written");
    let entries = || std::fs::read_dir(folder).map_or(0, Iterator::count);
    let before = entries();
    let start = TAKEN.load(Ordering::Relaxed);
    PEAK.store(start, Ordering::Relaxed);
    let outcome = catch_unwind(AssertUnwindSafe(|| (format.run)(&path, &bytes, &mut dice)));
    let names = |entry: std::io::Result<std::fs::DirEntry>| entry.map(|entry| entry.file_name().into_encoded_bytes());
    let written: Vec<Vec<u8>> = std::fs::read_dir(&out).into_iter().flatten().flat_map(names).collect();
    let stray = entries() != before || written.iter().any(|name| name.starts_with(b"."));
    let _ = std::fs::remove_dir_all(&out);
    CASE.store(0, Ordering::Relaxed);
    let taken = PEAK.load(Ordering::Relaxed).saturating_sub(start);
    if taken > MOST {
        return Err(format!("{}: {} MiB are taken", format.name, taken >> 20));
    }
    match outcome.map_err(|_| PANIC.lock().unwrap().clone())? {
        Ok(()) if !stray => Ok(true),
        Err(error) if !stray && written.is_empty() => told(error).and_then(|()| match case {
            0 => Err(format!("{}: a sound file is refused", format.name)),
            _ => Ok(false),
        }),
        _ => Err(format!("{}: a file was left", format.name)),
    }
}

/// Checks the message of an error, as text and beside its line.
fn told(error: insonify::Error) -> Result<(), String> {
    let message = error.to_string();
    let input = error.input();
    let excerpt = input.and_then(|input| input.excerpt());
    let is_inside = excerpt.is_none_or(|excerpt| excerpt.text.get(excerpt.span.clone()).is_some());
    let shown = excerpt.map_or(0, |excerpt| excerpt.name.len() + excerpt.text.len());
    let help = input.and_then(|input| input.help()).map_or(0, str::len);
    match (message.len(), shown + help) {
        (0, _) => Err("an empty message".to_owned()),
        _ if !is_inside => Err(format!("an error outside its lines: {message}")),
        (..20_000, ..20_000) => Ok(()),
        _ => Err(format!(
            "a message without end: {}",
            message.chars().take(60).collect::<String>()
        )),
    }
}

/// Shows the case that ran last, and keeps its file.
fn report(cause: &str) {
    if let Some((again, kept, bytes)) = RUNNING.lock().unwrap().as_ref() {
        let _ = std::fs::write(kept, bytes);
        println!("FAILED: {cause}\n  {again}\n  {}", kept.display());
        let _ = std::io::stdout().flush();
    }
}

/// Ends the process where a case takes too long: of the processor, so that other programs do not count, or of the clock
/// by far.
fn watch() {
    let (mut watched, mut from, mut since) = (0, 0.0, Instant::now());
    loop {
        std::thread::sleep(Duration::from_millis(500));
        let (case, used) = (CASE.load(Ordering::Relaxed), processor_s());
        if case != watched || case == 0 {
            (watched, from, since) = (case, used.unwrap_or(0.0), Instant::now());
        }
        let waited = since.elapsed().as_secs_f64();
        if used.unwrap_or(waited) - from > PATIENCE_S || waited > 20.0 * PATIENCE_S {
            report(&format!("it takes more than {PATIENCE_S} s"));
            std::process::abort();
        }
    }
}

/// Time of the processor that this process has used, s, where the system says so (hundredths, Linux).
fn processor_s() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/self/stat").ok()?;
    let fields = text.rsplit_once(')')?.1.split_whitespace().skip(11).take(2);
    Some(fields.filter_map(|ticks| ticks.parse::<f64>().ok()).sum::<f64>() / 100.0)
}
