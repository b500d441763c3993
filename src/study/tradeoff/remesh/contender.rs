//! Contenders: methods that update K^c as the mesh changes.

use std::fmt;
use std::sync::Arc;
use std::time::Instant;

use faer::{Mat, MatRef};
use insonify_base::parallel::{chunks, chunks_mut, for_each};

use super::subject::Subject;
use super::{Measured, RemeshOptions};
use insonify::Error;
use insonify_gpu::{Gpu, GpuError, StorageBuffer, Traffic};
use insonify_mechanics::remesh_gpu::{DeviceLevels, follow};
use insonify_mechanics::tissue::assembly::Stiffness;
use insonify_mechanics::tissue::columns::Columns;
use insonify_mechanics::tissue::factor::Factor;
use insonify_mechanics::tissue::remesh::{
    AdaptedMesh, Change, Level, Precision, Remesher, RemesherOptions, Source, make,
};

/// Report of an update.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Step {
    /// Bytes of large matrices read and written, where known.
    pub bytes: Option<usize>,
    /// Whether everything was recomputed.
    pub rebuilt: bool,
}

/// Describes how measurements break what a contender promises, if they do: values are finite and, of an exact one,
/// within its limit.
pub(crate) fn broken(limit: Option<f64>, measured: &Measured) -> Option<String> {
    // The error in mm follows from the others.
    const KINDS: [&str; 4] = ["K^-1", "K^c", "displacements", "relative residual"];
    let errors = measured.errors.iter().flatten().zip(KINDS);
    let drift = measured.drift.iter().map(|(_, error)| (error, "K^c"));
    let errors = errors.chain(drift);
    if let Some((_, kind)) = errors.clone().find(|(error, _)| !error.is_finite()) {
        return Some(format!("{kind}: not finite"));
    }
    let limit = limit?;
    let (worst, kind) = errors.max_by(|a, b| a.0.total_cmp(b.0))?;
    (*worst > limit).then(|| format!("{kind} off by {worst:.1e}, at most {limit:.0e} expected of an exact level"))
}

/// Method that keeps K^c, and requested blocks of K^-1, up to date with a mesh.
pub(crate) trait Contender {
    /// Returns the upper limit of the residual and of the error of K^c if the contender is exact up to rounding.
    fn limit(&self) -> Option<f64>;

    /// Sets the degrees of freedom in contact.
    ///
    /// # Errors
    /// [`Error`] if the contacts cannot be condensed.
    fn set_contacts(&mut self, dofs: &[usize]) -> Result<(), Error>;

    /// Applies one change of the mesh; K^c is then up to date.
    ///
    /// # Errors
    /// [`Error`] if the update fails.
    fn remesh(&mut self, mesh: &AdaptedMesh, change: &Change) -> Result<Step, Error>;

    /// Returns K^c, mm/N.
    fn condensed(&self) -> MatRef<'_, f64>;

    /// Returns a block of K^-1, mm/N.
    ///
    /// # Errors
    /// [`Error`] if the block cannot be computed.
    fn block(&mut self, rows: &[usize], columns: &[usize]) -> Result<Mat<f64>, Error>;

    /// Computes displacements (mm) under forces (N) on the contacts.
    ///
    /// # Errors
    /// [`Error`] if the displacements cannot be computed.
    fn displacement(&mut self, forces: &[f64], displacement_mm: &mut [f64]) -> Result<(), Error>;

    /// Returns the bytes in use, including the base.
    fn memory_bytes(&self) -> usize;

    /// Returns what has been exchanged with the device so far, if there is one.
    fn traffic(&mut self) -> Option<Traffic> {
        None
    }

    /// Starts timing updates on a device; returns false without a device or if it cannot time them.
    ///
    /// # Errors
    /// [`Error`] if the device fails.
    fn time_device(&mut self) -> Result<bool, Error> {
        Ok(false)
    }

    /// Returns the time of the last update on the device, ms.
    fn device_ms(&mut self) -> Option<f64> {
        None
    }
}

/// Base inverses that contenders start from.
pub(crate) struct Sources {
    /// Inverse in f64.
    pub double: Source,
    /// Inverse rounded to f32.
    pub single: Source,
}

/// Kind of contender, to be created for a subject.
#[derive(Clone)]
pub(crate) enum Kind {
    /// Level with a dense inverse on the CPU.
    Dense(Level, Precision),
    /// Exact level with columns solved on demand.
    OnDemand,
    /// Level on a device.
    Device(Level, Box<Gpu>),
    /// Refactorisation with solutions for the contacts.
    Refactored,
}

/// Returns all kinds of contenders that take part.
pub(crate) fn kinds(gpus: &[Gpu], options: &RemeshOptions) -> Vec<Kind> {
    use Level::{Exact, I, II, III, IV};
    let mut kinds = Vec::new();
    if options.cpu {
        for precision in [Precision::Double, Precision::Single] {
            kinds.extend([I, II, III, IV, Exact].map(|level| Kind::Dense(level, precision)));
        }
        kinds.extend([Kind::OnDemand, Kind::Refactored]);
    }
    for gpu in gpus {
        kinds.extend([I, II, III].map(|level| Kind::Device(level, Box::new(gpu.clone()))));
    }
    kinds
}

impl Kind {
    /// Returns level, backend and precision as named in tables.
    pub(crate) fn choices(&self) -> [String; 3] {
        let cpu = || "CPU".to_owned();
        let double = || Precision::Double.to_string();
        match self {
            Kind::Dense(level, precision) => [level.to_string(), cpu(), precision.to_string()],
            Kind::OnDemand => ["exact, columns on demand".to_owned(), cpu(), double()],
            Kind::Refactored => ["refactorisation".to_owned(), cpu(), double()],
            Kind::Device(level, gpu) => {
                let report = gpu.report();
                // Driver details follow the name in parentheses and are omitted.
                let name = report.name.split(" (").next().unwrap_or(&report.name);
                let kind = if report.software { "software GPU" } else { "GPU" };
                [
                    level.to_string(),
                    format!("{kind} {name}"),
                    Precision::Single.to_string(),
                ]
            }
        }
    }

    /// Returns the backend as named in tables.
    pub(crate) fn backend(&self) -> String {
        let [_, backend, _] = self.choices();
        backend
    }

    /// Returns the device used, if any.
    pub(crate) fn gpu(&self) -> Option<&Gpu> {
        match self {
            Kind::Device(_, gpu) => Some(gpu),
            _ => None,
        }
    }

    /// Returns whether the contender starts from the dense inverse.
    pub(crate) fn needs_inverse(&self) -> bool {
        matches!(self, Kind::Dense(..) | Kind::Device(..))
    }

    /// Creates the contender.
    ///
    /// # Errors
    /// [`Error`] if the device lacks memory, or the precision is insufficient for the material.
    pub(crate) fn make(&self, subject: &Subject, sources: &Sources) -> Result<Box<dyn Contender>, Error> {
        let options = RemesherOptions::default();
        let mesh = &subject.mesh;
        Ok(match self {
            Kind::Dense(level, precision) => {
                let source = match precision {
                    Precision::Double => &sources.double,
                    Precision::Single => &sources.single,
                };
                Box::new(Follower::Cpu(make(*level, *precision, source, mesh, options)?))
            }
            Kind::OnDemand => {
                let columns = Columns::new(Arc::clone(&subject.factor), subject.size());
                let source = Source::Columns(columns);
                let remesher = make(Level::Exact, Precision::Double, &source, mesh, options)?;
                Box::new(Follower::Cpu(remesher))
            }
            Kind::Device(level, gpu) => {
                let levels = follow(gpu, mesh, &sources.single, *level, options)?;
                Box::new(Follower::Device(Box::new(levels)))
            }
            Kind::Refactored => Box::new(Refactored::new(subject)?),
        })
    }
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [level, backend, precision] = self.choices();
        write!(f, "{level} in {precision} on {backend}")
    }
}

/// Returns the limit of residual and error of an exact level in a precision.
fn limit(level: Level, precision: Precision) -> Option<f64> {
    let RemesherOptions {
        residual_double,
        residual_single,
        ..
    } = RemesherOptions::default();
    match (level, precision) {
        (Level::I | Level::Exact, Precision::Double) => Some(residual_double),
        (Level::I | Level::Exact, Precision::Single) => Some(residual_single),
        (Level::II | Level::III | Level::IV, _) => None,
    }
}

/// Remesher; one on a device keeps its type, so that it can be timed there.
enum Follower {
    Cpu(Box<dyn Remesher>),
    Device(Box<DeviceLevels>),
}

impl Follower {
    fn get(&self) -> &dyn Remesher {
        match self {
            Follower::Cpu(remesher) => &**remesher,
            Follower::Device(levels) => &**levels,
        }
    }

    fn get_mut(&mut self) -> &mut dyn Remesher {
        match self {
            Follower::Cpu(remesher) => &mut **remesher,
            Follower::Device(levels) => &mut **levels,
        }
    }
}

impl Contender for Follower {
    fn limit(&self) -> Option<f64> {
        limit(self.get().level(), self.get().precision())
    }

    fn set_contacts(&mut self, dofs: &[usize]) -> Result<(), Error> {
        Ok(self.get_mut().set_contacts(dofs)?)
    }

    fn remesh(&mut self, mesh: &AdaptedMesh, change: &Change) -> Result<Step, Error> {
        let report = self.get_mut().remesh(mesh, change)?;
        Ok(Step {
            bytes: (report.bytes_moved > 0).then_some(report.bytes_moved),
            rebuilt: report.rebuilt.is_some(),
        })
    }

    fn condensed(&self) -> MatRef<'_, f64> {
        self.get().condensed()
    }

    fn block(&mut self, rows: &[usize], columns: &[usize]) -> Result<Mat<f64>, Error> {
        Ok(self.get_mut().compliance(rows, columns)?)
    }

    fn displacement(&mut self, forces: &[f64], displacement_mm: &mut [f64]) -> Result<(), Error> {
        Ok(self.get_mut().displacement(forces, displacement_mm)?)
    }

    fn memory_bytes(&self) -> usize {
        self.get().memory()
    }

    fn traffic(&mut self) -> Option<Traffic> {
        match self {
            Follower::Cpu(_) => None,
            Follower::Device(levels) => Some(levels.store().gpu().traffic()),
        }
    }

    fn time_device(&mut self) -> Result<bool, Error> {
        match self {
            Follower::Cpu(_) => Ok(false),
            Follower::Device(levels) => {
                // The clock of a software device gives no more information than wall-clock time.
                let gpu = levels.store().gpu();
                let can = gpu.has_timestamps() && !gpu.report().software;
                levels.store().time_updates(can)?;
                Ok(can)
            }
        }
    }

    fn device_ms(&mut self) -> Option<f64> {
        match self {
            Follower::Cpu(_) => None,
            Follower::Device(levels) => levels.store().update_ms(),
        }
    }
}

/// Refactorisation at each change, with the symbolic analysis of the first.
struct Refactored {
    stiffness: Stiffness,
    factor: Factor,
    contacts: Vec<usize>,
    solutions: Mat<f64>,
    condensed: Mat<f64>,
}

impl Refactored {
    fn new(subject: &Subject) -> Result<Self, Error> {
        let stiffness = subject.mesh.stiffness().at_nodes(subject.mesh.nodes())?;
        Ok(Refactored {
            factor: Factor::new(&stiffness)?,
            stiffness,
            contacts: Vec::new(),
            solutions: Mat::new(),
            condensed: Mat::new(),
        })
    }

    fn solve(&mut self) {
        self.solutions.fill(0.0);
        for (k, &dof) in self.contacts.iter().enumerate() {
            self.solutions[(dof, k)] = 1.0;
        }
        self.factor.solve_many_in_place(self.solutions.as_mut());
        for j in 0..self.contacts.len() {
            for (i, &dof) in self.contacts.iter().enumerate() {
                self.condensed[(i, j)] = self.solutions[(dof, j)];
            }
        }
    }
}

impl Contender for Refactored {
    fn limit(&self) -> Option<f64> {
        limit(Level::Exact, Precision::Double)
    }

    fn set_contacts(&mut self, dofs: &[usize]) -> Result<(), Error> {
        self.contacts = dofs.to_vec();
        self.solutions = Mat::zeros(self.factor.size(), dofs.len());
        self.condensed = Mat::zeros(dofs.len(), dofs.len());
        self.solve();
        Ok(())
    }

    fn remesh(&mut self, mesh: &AdaptedMesh, _: &Change) -> Result<Step, Error> {
        self.stiffness = mesh.stiffness().at_nodes(mesh.nodes())?;
        self.factor.refactor(&self.stiffness)?;
        self.solve();
        Ok(Step {
            bytes: None,
            rebuilt: true,
        })
    }

    fn condensed(&self) -> MatRef<'_, f64> {
        self.condensed.as_ref()
    }

    fn block(&mut self, rows: &[usize], columns: &[usize]) -> Result<Mat<f64>, Error> {
        let mut solutions = Mat::zeros(self.factor.size(), columns.len());
        for (k, &dof) in columns.iter().enumerate() {
            solutions[(dof, k)] = 1.0;
        }
        self.factor.solve_many_in_place(solutions.as_mut());
        Ok(Mat::from_fn(rows.len(), columns.len(), |i, j| solutions[(rows[i], j)]))
    }

    fn displacement(&mut self, forces: &[f64], displacement_mm: &mut [f64]) -> Result<(), Error> {
        displacement_mm.fill(0.0);
        for (&dof, force) in self.contacts.iter().zip(forces) {
            displacement_mm[dof] = *force;
        }
        self.factor.solve_in_place(displacement_mm);
        Ok(())
    }

    /// Returns the bytes of the factor's entries with their row indices, and of the solutions.
    fn memory_bytes(&self) -> usize {
        let factor = self.factor.entries() * (size_of::<f64>() + size_of::<u32>());
        factor + self.solutions.nrows() * self.solutions.ncols() * size_of::<f64>()
    }
}

/// Bytes per copy: more than fits in caches, small beside the matrices of a study.
pub(crate) const BYTES: usize = 128 << 20;
/// Number of runs, of which the fastest counts: others were disturbed.
const RUNS: usize = 7;
/// Number of copies per submission, so that the round trip to the device has little weight.
const COPIES: usize = 8;

/// Returns the bytes read and written per second by memory copies on all threads.
pub(crate) fn of_cpu() -> f64 {
    let chunk = 1 << 20;
    let from = vec![1u8; BYTES];
    let mut to = vec![0u8; BYTES];
    let mut best = f64::INFINITY;
    for _ in 0..RUNS {
        let start = Instant::now();
        for_each((chunks_mut(&mut to, chunk), chunks(&from, chunk)), &|(to, from)| {
            to.copy_from_slice(from)
        });
        std::hint::black_box(&mut to);
        best = best.min(start.elapsed().as_secs_f64());
    }
    2.0 * BYTES as f64 / best
}

/// Returns the bytes read and written per second by copies within a device's memory.
///
/// # Errors
/// [`GpuError`] if the device fails.
pub(crate) fn of_gpu(gpu: &Gpu) -> Result<f64, GpuError> {
    let bytes = (BYTES as u64).min(gpu.limits().max_storage_buffer_binding_size);
    let source = StorageBuffer::zeroed(gpu, "copy source", bytes)?;
    let target = StorageBuffer::zeroed(gpu, "copy target", bytes)?;
    let mut best = f64::INFINITY;
    for _ in 0..RUNS {
        let start = Instant::now();
        gpu.submit("copies", |recorder| {
            for _ in 0..COPIES {
                recorder
                    .encoder()
                    .copy_buffer_to_buffer(source.raw(), 0, target.raw(), 0, bytes);
            }
            Ok(())
        })?;
        gpu.wait("copies")?;
        best = best.min(start.elapsed().as_secs_f64());
    }
    Ok(2.0 * COPIES as f64 * bytes as f64 / best)
}
