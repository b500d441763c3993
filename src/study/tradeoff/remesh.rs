//! Remeshing levels: cost and error on one or more meshes.
//!
//! A needle enters the mesh along a line. Wherever it enters an element, a corner of that element is moved to its tip;
//! then it is withdrawn and the moves are undone, repeatedly. Every contender follows the same moves, is timed at each
//! of them including a read of its K^c, and is compared with a gold standard that is factorised from the moved mesh and
//! solved with iterative refinement in the same run: K^c, sampled columns of K^-1 and the displacements under a fixed
//! load in some states of the first insertion, of which the worst counts, and K^c again after increasing numbers of
//! updates.
//!
//! Guarantees are checked: a contender that claims to be exact up to rounding must keep the relative residual |K X e -
//! e| / (|K| |X e|) and the errors of K^-1, K^c and displacements below the limits at which the levels rebuild
//! themselves (see [`RemesherOptions`](insonify_mechanics::tissue::remesh::RemesherOptions)), or its row is flagged.
//!
//! | module | contents |
//! |---|---|
//! | `subject` | mesh, supports, contacts and moves; reference solutions |
//! | `contender` | update methods; memory bandwidth of this machine |

pub(crate) mod contender;
mod report;
pub(crate) mod subject;

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::Study;
use super::entry::{About, Backends, Entry, StudyOption, all_ranged, ranged, seconds};
use super::gather::Devices;
use crate::StudyError;
use crate::stability::Effort;
pub(crate) use contender::Contender;
pub(crate) use contender::Kind;
use contender::Sources;
use insonify::Error;
use insonify_base::memory;
use insonify_gpu::{Gpu, Traffic};
use insonify_mechanics::tissue::inverse::invert;
use insonify_mechanics::tissue::remesh::Source;
use insonify_mechanics::tissue::symmetric::Symmetric;
use insonify_mesh::TetMesh;
use insonify_mesh::file::{ReadOptions, read_mesh};
use report::RemeshReport;
pub(crate) use report::RemeshRow;
use subject::{Gold, Subject};

/// Number of states of the first insertion in which errors are evaluated.
const STATES: usize = 8;

/// Reason for never recommending level IV, however accurate it is after a few moves.
pub(crate) const FROZEN: &str = "it never updates the compliance, so that its error grows with the moves of the mesh";

/// Lower limit of times, ms: clocks are no finer, and level IV does nothing.
const GRAIN_MS: f64 = 1e-3;

/// Options of the study.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct RemeshOptions {
    /// Young's modulus, kPa (default 10).
    pub young_kpa: f64,
    /// Poisson's ratio (default 0.45, as in Goksel et al. 2011).
    pub poisson: f64,
    /// Maximum number of moves in one insertion (default 24).
    pub moves: usize,
    /// Number of updates, counting insertions and withdrawals (default 1,000).
    pub updates: usize,
    /// Time after which a contender ends early, once the needle has been fully inserted (default 120 s).
    pub patience: Duration,
    /// Whether the f64 and f32 levels on the CPU take part, along with the other CPU contenders.
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
    /// Returns the options for an effort: the default, or few updates of few moves.
    pub(crate) fn of(effort: Effort) -> Self {
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

/// Registration of this study.
pub(crate) const ENTRY: Entry<RemeshSettings> = Entry {
    about: About {
        name: "remesh",
        title: "Remeshing",
        question: "The mesh follows the needle's tip: what does an update of the compliance at its contacts cost, and how large is the error? \
                   Levels, dense inverse or columns on demand, precision, device, size of the mesh.",
        help: "Levels of remeshing: time against error, for each level, backend and precision",
        examples: "\
Examples:
  insonify tradeoff remesh --quick                              a first look, in seconds
  insonify tradeoff remesh -o study                             the default mesh, with plots
  insonify tradeoff remesh --nodes 500,1000,3300,10000 -o study  growth with the size of the mesh
  insonify tradeoff remesh --mesh organs.vtu --poisson 0.49 --json

A row with a star is a best choice: no other is both faster and nearer to the truth. A row that violates the guarantee of its
level is marked WRONG.",
        backends: Backends::All,
    },
    options: &[
        StudyOption::<RemeshSettings>::value(
            "mesh",
            "FILE",
            "Tetrahedral mesh to study (Gmsh, VTK, VTU); its lowest nodes along z, at least 3 % of all, are fixed [default: a generated block]",
            |options, texts| {
                options.mesh = Some(texts.concat().into());
                Ok(())
            },
        )
        .excludes("nodes"),
        StudyOption::<RemeshSettings>::value(
            "nodes",
            "N,...",
            "Nodes of the generated meshes [default: 3300; with --quick 500]",
            |options, texts| all_ranged(texts, 100..=100_000, "a number of nodes from 100 to 100000").map(|value| options.nodes = value),
        )
        .list(),
        StudyOption::value(
            "updates",
            "N",
            "Number of remeshes of each contender, insertions and withdrawals of the needle together [default: 1000; with --quick 60]",
            |options, texts| ranged(texts, 1..=1_000_000, "a number of updates from 1 to 1000000").map(|value| options.options.updates = value),
        ),
        StudyOption::number("young-kpa", "KPA", "Young's modulus, kPa", |options| &mut options.options.young_kpa),
        StudyOption::number("poisson", "NU", "Poisson's ratio, above -1 and below 0.5", |options| &mut options.options.poisson),
        StudyOption::<RemeshSettings>::value(
            "time-limit-s",
            "S",
            "Seconds after which a contender ends early",
            |options, texts| seconds(texts).map(|value| options.options.patience = value),
        )
        .alias("patience-s"),
        StudyOption::quick("A small mesh and few updates"),
    ],
    settings: |effort| RemeshSettings {
        mesh: None,
        nodes: vec![effort.pick(500, 3300)],
        options: RemeshOptions::of(effort),
    },
    in_report: |effort| {
        let usual = RemeshOptions::of(effort);
        RemeshSettings {
            mesh: None,
            nodes: effort.pick(&[500][..], &[500, 1500, 3300]).to_vec(),
            options: RemeshOptions {
                updates: usual.updates.min(200),
                patience: usual.patience.min(Duration::from_secs(8)),
                ..usual
            },
        }
    },
    run: |settings, context| {
        let meshes = settings.meshes(context.warn)?;
        let Devices { gpus, skips_cpu, .. } = context.devices;
        let options = RemeshOptions {
            cpu: !skips_cpu,
            ..settings.options
        };
        study(&meshes, gpus, &options, context.progress)
    },
};

/// Settings of the study: its meshes, and how they are remeshed.
pub(crate) struct RemeshSettings {
    /// File of the only mesh, in place of generated ones.
    mesh: Option<PathBuf>,
    /// Nodes of the generated meshes; by default in a full run those of the detailed model of Goksel et al. 2011.
    nodes: Vec<usize>,
    options: RemeshOptions,
}

impl RemeshSettings {
    fn meshes(&self, warn: &dyn Fn(&str)) -> Result<Vec<TetMesh>, Error> {
        if let Some(path) = &self.mesh {
            let file = read_mesh(path, &ReadOptions::default())?;
            file.warnings.iter().for_each(|warning| warn(warning));
            return Ok(vec![file.mesh]);
        }
        let meshes = self.nodes.iter().map(|&nodes| {
            let refused = |error| StudyError::refused(format!("--nodes {nodes}: {error}"));
            subject::generated(nodes).map_err(refused)
        });
        meshes.collect()
    }
}

/// Measurements of a contender.
#[derive(Clone, Debug, Default)]
pub(crate) struct Measured {
    /// Time of each update, ms.
    pub times_ms: Vec<f64>,
    /// Time of each update on a device, ms.
    pub device_ms: Vec<f64>,
    /// Preparation time: the inverse where one is needed, and the first K^c, ms.
    pub prepare_ms: f64,
    /// Bytes in use at the end.
    pub memory_bytes: usize,
    /// Bytes of large matrices read and written by each update, where known.
    pub bytes: Vec<usize>,
    /// Exchanges of each update with a device.
    pub traffic: Vec<Traffic>,
    /// Number of updates that recomputed everything.
    pub rebuilds: usize,
    /// Worst errors of one insertion: relative errors of sampled columns of K^-1, of K^c and of displacements, in
    /// Frobenius and 2-norms; the relative residual of the sampled columns; the largest error of displacements per
    /// newton of load, mm.
    pub errors: Option<[f64; 5]>,
    /// Numbers of updates, each with the error of K^c after them.
    pub drift: Vec<(usize, f64)>,
    /// Description of a failure or a violated guarantee.
    pub flag: Option<String>,
}

/// Studies the meshes, in any order. `gpus` are measured in addition to the CPU. `progress` receives the current task
/// and the completed fraction, increasing from 0 to 1.
///
/// # Errors
/// [`Error`]; memory is checked before any large allocation.
pub(crate) fn study(
    meshes: &[TetMesh],
    gpus: &[Gpu],
    options: &RemeshOptions,
    progress: &mut (dyn FnMut(&str, f64) + Send),
) -> Result<Study, Error> {
    Ok(contended(meshes, gpus, options, progress)?.finish())
}

/// The measurements of a [`study`].
///
/// # Errors
/// Those of [`study`].
pub(crate) fn rows(meshes: &[TetMesh], gpus: &[Gpu], options: &RemeshOptions) -> Result<Vec<RemeshRow>, Error> {
    Ok(contended(meshes, gpus, options, &mut |_, _| {})?.rows)
}

fn contended(
    meshes: &[TetMesh],
    gpus: &[Gpu],
    options: &RemeshOptions,
    progress: &mut (dyn FnMut(&str, f64) + Send),
) -> Result<RemeshReport, Error> {
    for mesh in meshes {
        check_memory(subject::supports(mesh).free(), gpus, memory::available())?;
    }
    let subjects = meshes.iter().map(|mesh| Subject::new(mesh, options));
    let subjects = subjects.collect::<Result<Vec<_>, _>>()?;
    let mut report = RemeshReport::new(&subjects, gpus, options)?;
    let total = subjects.len() as f64;
    for (index, subject) in subjects.iter().enumerate() {
        let mut subject_progress = |text: &str, share: f64| {
            progress(
                &format!("{} nodes: {text}", subject.nodes()),
                (index as f64 + share) / total,
            );
        };
        study_mesh(subject, gpus, options, &mut report, &mut subject_progress)?;
    }
    progress("done", 1.0);
    Ok(report)
}

/// Studies one mesh.
fn study_mesh(
    subject: &Subject,
    gpus: &[Gpu],
    options: &RemeshOptions,
    report: &mut RemeshReport,
    progress: &mut (dyn FnMut(&str, f64) + Send),
) -> Result<(), Error> {
    const INVERSE: f64 = 0.2;
    const GOLD: f64 = 0.1;
    // One inverse serves all contenders; each that needs it is charged its time below.
    let begun = Instant::now();
    let double = invert::<f64>(&subject.factor, &mut |done, of| {
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
    for (index, kind) in kinds.iter().enumerate() {
        let start = INVERSE + GOLD + (1.0 - INVERSE - GOLD) * index as f64 / count;
        progress(&kind.to_string(), start);
        let begun = Instant::now();
        match kind.make(subject, &sources) {
            Ok(mut contender) => {
                let made_ms = begun.elapsed().as_secs_f64() * 1e3;
                let mut measured = measure(&mut *contender, subject, &truth, options);
                measured.prepare_ms += made_ms + if kind.needs_inverse() { inverse_ms } else { 0.0 };
                report.add(subject, kind, contender.limit().is_some(), measured);
            }
            Err(error) => report.note(format!("{} nodes, {kind}: not measured: {error}", subject.nodes())),
        }
    }
    Ok(())
}

/// Gold standards with the number of updates after which each applies.
pub(crate) struct Truth(Vec<(usize, Gold)>);

impl Truth {
    /// Computes the gold standards.
    ///
    /// # Errors
    /// [`Error`] if a state of the mesh cannot be solved.
    pub(crate) fn new(subject: &Subject, options: &RemeshOptions) -> Result<Truth, Error> {
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

/// Returns whether all errors are evaluated after an update: in [`STATES`] states of the first insertion, the last of
/// them with the needle fully inserted.
fn is_sampled(update: usize, inserted: usize) -> bool {
    update <= inserted && update * STATES / inserted > (update - 1) * STATES / inserted
}

/// Returns whether the error of K^c is evaluated: after 1, 3, 10, 30, ... updates and after the last.
fn is_checkpoint(update: usize, updates: usize) -> bool {
    let decade = 10usize.pow(update.max(1).ilog10());
    update <= updates && (update == decade || update == 3 * decade || update == updates)
}

/// Runs one contender; a failure is reported in its flag.
pub(crate) fn measure(
    contender: &mut dyn Contender,
    subject: &Subject,
    truth: &Truth,
    options: &RemeshOptions,
) -> Measured {
    let mut measured = Measured::default();
    if let Err(error) = run(contender, subject, truth, options, &mut measured) {
        let updates = measured.times_ms.len();
        measured.flag = Some(format!("stopped after {updates} updates: {error}"));
        return measured;
    }
    measured.flag = contender::broken(contender.limit(), &measured);
    measured
}

fn run(
    contender: &mut dyn Contender,
    subject: &Subject,
    truth: &Truth,
    options: &RemeshOptions,
    measured: &mut Measured,
) -> Result<(), Error> {
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
        let before = contender.traffic();
        let start = Instant::now();
        let step = contender.remesh(&mesh, &change)?;
        measured
            .times_ms
            .push((start.elapsed().as_secs_f64() * 1e3).max(GRAIN_MS));
        let exchanged = contender.traffic().zip(before).map(|(after, before)| after - before);
        measured.traffic.extend(exchanged);
        measured.bytes.extend(step.bytes);
        measured.rebuilds += usize::from(step.rebuilt);
        if let Some((_, gold)) = next.filter(|(update_compared, _)| *update_compared == update) {
            measured
                .drift
                .push((update, gold.error_of_contacts(contender.condensed())));
            if gold.has_samples() {
                let errors = gold.errors(subject, contender)?;
                let worst = measured.errors.get_or_insert([0.0; 5]);
                for (worst, error) in worst.iter_mut().zip(errors) {
                    *worst = if error.is_nan() { error } else { worst.max(error) };
                }
            }
            next = states.next();
        }
        if update >= inserted && begun.elapsed() > options.patience {
            break;
        }
    }
    measured.memory_bytes = contender.memory_bytes();
    // Timing on the device requires a wait at each update, so it is done apart from wall-clock timing.
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

/// Compares the peak memory of a study of one mesh with the available memory.
fn check_memory(size: usize, gpus: &[Gpu], available: Option<usize>) -> Result<(), Error> {
    let [double, single] = [Symmetric::<f64>::bytes_of(size), Symmetric::<f32>::bytes_of(size)];
    // Both bases and one working copy; software adapters keep theirs in the same memory.
    let software = gpus.iter().any(|gpu| gpu.report().software);
    let device = if software { single } else { 0 };
    let samples = 2 * STATES * size_of::<f64>() * size * subject::SAMPLES;
    let buffers = [double, double, single, device, samples, 2 * contender::BYTES];
    let needed = buffers.into_iter().fold(0usize, usize::saturating_add);
    match available {
        Some(available) if needed > available => Err(StudyError::Memory {
            what: format!("the mesh of {size} degrees of freedom"),
            needed,
            available,
        }
        .into()),
        _ => Ok(()),
    }
}

impl std::fmt::Debug for Kind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Kind({self})")
    }
}

#[cfg(test)]
mod tests;
