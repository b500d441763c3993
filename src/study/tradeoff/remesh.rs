//! Levels of remeshing: what each costs and how far it is from the truth, on one mesh after another.
//!
//! A needle goes into the mesh along a line. Wherever it enters an element, a corner of that is moved to its tip; then it is
//! withdrawn and the moves are undone, and so on, as often as asked. Every contender follows the same moves, is timed at each of
//! them with its K^c read, and is compared with a gold standard that is factored from the moved mesh and solved with iterative
//! refinement in the same run: K^c, sampled columns of K^-1 and the displacements under a fixed load in some states of the first
//! insertion, of which the worst counts, and K^c again after more and more updates.
//!
//! Promises are checked: a contender that claims to be exact up to rounding must leave a relative residual |K X e - e| / (|K| |X e|) and
//! errors of K^-1, K^c and displacements below the limits at which the levels rebuild themselves (see
//! [`Options`](crate::mechanics::tissue::remesh::Options)), or its row is flagged.
//!
//! | module | what it holds |
//! |---|---|
//! | [`subject`] | mesh, supports, contacts and moves |
//! | [`gold`] | the truth |
//! | [`contender`] | the ways to follow |
//! | `switching` | pivots against a new factorisation where contacts switch |
//! | [`bandwidth`] | how fast this machine copies |

pub mod bandwidth;
pub mod contender;
mod error;
pub mod gold;
mod report;
pub mod subject;
mod switching;
#[cfg(test)]
mod tests;

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::Study;
use super::gather::Entry;
use crate::gpu::Gpu;
use crate::mechanics::mesh::TetMesh;
use crate::mechanics::tissue::inverse::invert;
use crate::mechanics::tissue::remesh::Source;
use crate::mechanics::tissue::symmetric::Symmetric;
use crate::memory;
use crate::study::stability::Effort;
use contender::{Contender, Kind, Sources};
pub use error::StudyError;
use gold::Gold;
use report::Report;
use subject::Subject;

/// States of the first insertion in which errors are looked at.
const STATES: usize = 8;

/// Why level IV is no choice, however near it is after a few moves.
pub const FROZEN: &str = "it never updates the compliance, so that its error grows with the moves of the mesh";

/// What takes less counts as this, ms: clocks are no finer, and level IV does nothing.
const GRAIN_MS: f64 = 1e-3;

/// What to study, and for how long.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RemeshOptions {
    /// Young's modulus, kPa (default 10).
    pub young_kpa: f64,
    /// Poisson's ratio (default 0.45, as in Goksel et al. 2011).
    pub poisson: f64,
    /// Most moves of one insertion (default 24).
    pub moves: usize,
    /// Updates, insertions and withdrawals together (default 1,000).
    pub updates: usize,
    /// A contender ends early when it has taken this long and the needle has been in once (default 120 s).
    pub patience: Duration,
    /// Whether the levels in f64 and f32 on the CPU take part, as do the others that it runs.
    pub cpu: bool,
}

impl Default for RemeshOptions {
    fn default() -> Self {
        RemeshOptions {
            young_kpa: 10.0,
            poisson: 0.45,
            moves: 24,
            updates: 1000,
            patience: Duration::from_secs(120),
            cpu: true,
        }
    }
}

impl RemeshOptions {
    /// What is studied, and how long, at an effort: the default, or few updates of few moves.
    pub fn of(effort: Effort) -> Self {
        let usual = RemeshOptions::default();
        effort.pick(
            RemeshOptions {
                moves: 8,
                updates: 60,
                ..usual
            },
            usual,
        )
    }
}

/// Nodes of the mesh that is studied where no other is asked for; quickly, and wholly: those of the detailed model of Goksel et al.
/// 2011.
pub const NODES: (usize, usize) = (500, 3300);
/// Sizes that the report of all studies compares.
const GATHERED: (&[usize], &[usize]) = (&[500], &[500, 1500, 3300]);
/// Updates and patience of a contender in that report, at whole length.
const GATHERED_UPDATES: (usize, Duration) = (200, Duration::from_secs(8));

/// This study among all.
pub const ENTRY: Entry = Entry {
    name: "remesh",
    title: "Remeshing",
    question: "The mesh follows the needle's tip: what does it cost to keep the compliance of its contacts right, and how wrong is it then? \
               Levels, dense inverse or columns on demand, precision, device, size of the mesh.",
    run: |means, effort, progress| {
        let (updates, patience) = GATHERED_UPDATES;
        let usual = RemeshOptions::of(effort);
        let options = RemeshOptions {
            updates: usual.updates.min(updates),
            patience: usual.patience.min(patience),
            ..usual
        };
        let (quick, whole) = GATHERED;
        let meshes = effort.pick(quick, whole).iter().map(|nodes| subject::generated(*nodes));
        let meshes = meshes.collect::<Result<Vec<_>, _>>()?;
        Ok(study(&meshes, &means.gpus, &options, progress)?)
    },
};

/// How a contender did.
#[derive(Clone, Debug, Default)]
pub struct Measured {
    /// Time of each update, ms.
    pub times_ms: Vec<f64>,
    /// Time of updates on a device, ms.
    pub device_ms: Vec<f64>,
    /// Time to get ready: the inverse where one is needed, and the first K^c, ms.
    pub prepare_ms: f64,
    /// Bytes held at the end.
    pub held: usize,
    /// Bytes of large matrices read and written by an update, where known.
    pub bytes: Vec<usize>,
    /// Updates after which everything was computed anew.
    pub rebuilds: usize,
    /// The worst of one insertion: relative errors of sampled columns of K^-1, of K^c and of displacements, in Frobenius and
    /// 2-norms; the relative residual of the sampled columns; the largest error of displacements for each newton of load, mm.
    pub errors: Option<[f64; 5]>,
    /// Error of K^c after so many updates.
    pub drift: Vec<(usize, f64)>,
    /// What went wrong.
    pub flag: Option<String>,
}

/// Studies the meshes, smallest first or in any order. `gpus` are measured beside the CPU. `progress` is told what is being done
/// and the share that is done, ascending from 0 to 1.
///
/// # Errors
/// [`StudyError`]; memory is checked before anything large is allocated.
pub fn study(
    meshes: &[TetMesh],
    gpus: &[Gpu],
    options: &RemeshOptions,
    progress: &mut (dyn FnMut(&str, f64) + Send),
) -> Result<Study, StudyError> {
    for mesh in meshes {
        check_memory(subject::supports(mesh).free(), gpus, memory::available())?;
    }
    let subjects = meshes.iter().map(|mesh| Subject::new(mesh, options));
    let subjects = subjects.collect::<Result<Vec<_>, _>>()?;
    let mut report = Report::new(&subjects, gpus, options)?;
    let total = subjects.len() as f64;
    for (at, subject) in subjects.iter().enumerate() {
        let mut inner = |text: &str, share: f64| {
            progress(
                &format!("{} nodes: {text}", subject.nodes()),
                (at as f64 + share) / total,
            );
        };
        one(subject, gpus, options, &mut report, &mut inner)?;
        if at + 1 == subjects.len() && options.cpu {
            report.set_switching(switching::table(subject)?);
        }
    }
    progress("done", 1.0);
    Ok(report.finish())
}

/// Studies one mesh.
fn one(
    subject: &Subject,
    gpus: &[Gpu],
    options: &RemeshOptions,
    report: &mut Report,
    progress: &mut (dyn FnMut(&str, f64) + Send),
) -> Result<(), StudyError> {
    const INVERSE: f64 = 0.2;
    const GOLD: f64 = 0.1;
    let begun = Instant::now();
    let double = invert::<f64>(&subject.factor, |done, of| {
        progress("the dense inverse", INVERSE * done as f64 / of as f64);
    })?;
    let double = Arc::new(double);
    let sources = Sources {
        single: Source::Single(Arc::new(double.cast())),
        double: Source::Double(double),
    };
    let inverse_ms = begun.elapsed().as_secs_f64() * 1e3;
    progress("the gold standard", INVERSE);
    let truth = Truth::new(subject, options)?;
    let kinds = contender::kinds(gpus, options);
    let count = kinds.len() as f64;
    for (at, kind) in kinds.iter().enumerate() {
        let start = INVERSE + GOLD + (1.0 - INVERSE - GOLD) * at as f64 / count;
        progress(&kind.to_string(), start);
        let begun = Instant::now();
        match kind.make(subject, &sources) {
            Ok(mut contender) => {
                let made_ms = begun.elapsed().as_secs_f64() * 1e3;
                let mut measured = measure(&mut *contender, subject, &truth, options);
                measured.prepare_ms += made_ms + if kind.needs_inverse() { inverse_ms } else { 0.0 };
                report.add(subject, kind, contender.promise(), measured);
            }
            Err(error) => report.note(format!("{} nodes, {kind}: not measured: {error}", subject.nodes())),
        }
    }
    Ok(())
}

/// The gold standards that contenders are compared with, after so many updates.
pub struct Truth(Vec<(usize, Gold)>);

impl Truth {
    /// Computes them.
    ///
    /// # Errors
    /// [`StudyError`].
    pub fn new(subject: &Subject, options: &RemeshOptions) -> Result<Truth, StudyError> {
        let mut mesh = subject.mesh.clone();
        let mut states = Vec::new();
        let inserted = subject.inserted();
        for update in 1..=options.updates.max(inserted) {
            subject.step(&mut mesh, update - 1)?;
            if is_sampled(update, inserted) {
                states.push((update, Gold::with_samples(subject, &mesh)?));
            } else if is_checkpoint(update, options.updates) {
                states.push((update, Gold::of_contacts(subject, &mesh)?));
            }
        }
        Ok(Truth(states))
    }
}

/// Whether all errors are looked at: in [`STATES`] states of the first insertion, the last of them when the needle is in.
fn is_sampled(update: usize, inserted: usize) -> bool {
    update <= inserted && update * STATES / inserted > (update - 1) * STATES / inserted
}

/// Whether the error of K^c is looked at: after 1, 3, 10, 30, ... updates and the last.
fn is_checkpoint(update: usize, updates: usize) -> bool {
    let decade = 10usize.pow(update.max(1).ilog10());
    update <= updates && (update == decade || update == 3 * decade || update == updates)
}

/// Runs one contender. What it fails of is in its flag.
pub fn measure(contender: &mut dyn Contender, subject: &Subject, truth: &Truth, options: &RemeshOptions) -> Measured {
    let mut measured = Measured::default();
    if let Err(error) = run(contender, subject, truth, options, &mut measured) {
        let updates = measured.times_ms.len();
        measured.flag = Some(format!("stopped after {updates} updates: {error}"));
        return measured;
    }
    measured.flag = contender.promise().broken(&measured);
    measured
}

fn run(
    contender: &mut dyn Contender,
    subject: &Subject,
    truth: &Truth,
    options: &RemeshOptions,
    measured: &mut Measured,
) -> Result<(), StudyError> {
    let mut mesh = subject.mesh.clone();
    let inserted = subject.inserted();
    let ready = Instant::now();
    contender.set_contacts(&subject.contacts)?;
    measured.prepare_ms = ready.elapsed().as_secs_f64() * 1e3;
    let begun = Instant::now();
    let mut states = truth.0.iter();
    let mut next = states.next();
    for update in 1..=options.updates.max(inserted) {
        let change = subject.step(&mut mesh, update - 1)?;
        let start = Instant::now();
        let step = contender.remesh(&mesh, &change)?;
        measured
            .times_ms
            .push((start.elapsed().as_secs_f64() * 1e3).max(GRAIN_MS));
        measured.bytes.extend(step.bytes);
        measured.rebuilds += usize::from(step.rebuilt);
        if let Some((_, gold)) = next.filter(|(at, _)| *at == update) {
            measured
                .drift
                .push((update, gold.error_of_contacts(contender.condensed())));
            if gold.has_samples() {
                let found = gold.errors(subject, contender)?;
                let worst = measured.errors.get_or_insert([0.0; 5]);
                for (worst, error) in worst.iter_mut().zip(found) {
                    *worst = if error.is_nan() { error } else { worst.max(error) };
                }
            }
            next = states.next();
        }
        if update >= inserted && begun.elapsed() > options.patience {
            break;
        }
    }
    measured.held = contender.held();
    // Measuring the device costs a wait at each update, so it is done apart from the clock on the wall.
    let done = measured.times_ms.len();
    if contender.time_device()? {
        for update in done..done + 2 * inserted {
            let change = subject.step(&mut mesh, update)?;
            contender.remesh(&mesh, &change)?;
            measured.device_ms.extend(contender.device_ms());
        }
    }
    Ok(())
}

/// Checks what the study of a mesh needs at its height against what there is.
fn check_memory(size: usize, gpus: &[Gpu], available: Option<usize>) -> Result<(), StudyError> {
    let [double, single] = [Symmetric::<f64>::bytes_of(size), Symmetric::<f32>::bytes_of(size)];
    // Both bases and one that follows; software adapters keep theirs in the same memory.
    let software = gpus.iter().any(|gpu| gpu.report().software);
    let device = if software { single } else { 0 };
    let samples = 2 * STATES * size_of::<f64>() * size * gold::SAMPLES;
    let all = [double, double, single, device, samples, 2 * bandwidth::BYTES];
    let needed = all.into_iter().fold(0usize, usize::saturating_add);
    match available {
        Some(available) if needed > available => Err(StudyError::Memory {
            size,
            needed,
            available,
        }),
        _ => Ok(()),
    }
}

impl std::fmt::Debug for Kind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Kind({self})")
    }
}
