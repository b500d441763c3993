//! Tables and figures of the study.

use super::contender::{self, Kind};
use super::subject::Subject;
use super::{FROZEN, Measured, RemeshOptions};
use crate::tradeoff::{Axis, Choice, Column, Deadline, Factor, Figure, Goal, SHIFT_MM, Study, Table};
use insonify::Error;
use insonify_base::machine::Machine;
use insonify_base::statistics::Spread;
use insonify_gpu::{Gpu, Traffic};
use insonify_mechanics::tissue::symmetric::Symmetric;

/// Measurements of a remesher on a mesh.
pub(crate) struct Contended<T> {
    pub(crate) nodes: usize,
    pub(crate) kind: Kind,
    measured: T,
}

const fn choices<T>() -> [Choice<Contended<T>>; 4] {
    [
        Factor::new("nodes", "nodes").of(|row: &Contended<T>| row.nodes.to_string()),
        Factor::new("level", "level").of(|row: &Contended<T>| row.kind.choices()[0].clone()),
        Factor::new("backend", "backend").of(|row: &Contended<T>| row.kind.choices()[1].clone()),
        Factor::new("precision", "precision").of(|row: &Contended<T>| row.kind.choices()[2].clone()),
    ]
}

/// Measurements with what they relate to.
pub(crate) struct Remeshing {
    dofs: usize,
    measured: Measured,
    /// Bandwidth of a plain copy on the same device, B/s.
    copy_b_s: Option<f64>,
}

impl Remeshing {
    fn time(&self) -> Option<Spread> {
        Spread::of(self.measured.times_ms.clone())
    }

    /// Bytes read and written by an update (median).
    fn bytes(&self) -> Option<f64> {
        median(self.measured.bytes.iter().map(|bytes| *bytes as f64).collect())
    }

    /// Bandwidth of an update, B/s.
    fn rate(&self) -> Option<f64> {
        Some(self.bytes()? / (self.time()?.median_ms * 1e-3))
    }

    /// Mean of an exchange with the device.
    fn exchanged(&self, field: fn(&Traffic) -> u64) -> Option<f64> {
        let traffic = &self.measured.traffic;
        let total: u64 = traffic.iter().map(field).sum();
        (!traffic.is_empty()).then(|| total as f64 / traffic.len() as f64)
    }

    fn error(&self, index: usize) -> Option<f64> {
        Some(self.measured.errors?[index])
    }
}

const ERROR_CONDENSED: Axis = Axis::log(
    "error_condensed",
    "err K^c",
    "relative error of K^c, the compliance at the contacts",
);

pub(crate) type RemeshRow = Contended<Remeshing>;

impl RemeshRow {
    /// Free degrees of freedom.
    pub(crate) fn dofs(&self) -> f64 {
        self.measured.dofs as f64
    }

    /// Median time of a remesh with its K^c, ms.
    pub(crate) fn median_ms(&self) -> Option<f64> {
        Some(self.measured.time()?.median_ms)
    }

    /// Median time of the update on the device, ms.
    pub(crate) fn device_ms(&self) -> Option<f64> {
        median(self.measured.measured.device_ms.clone())
    }
}

const REMESH: [Column<RemeshRow>; 21] = [
    Axis::log("dofs", "unknowns", "free degrees of freedom").of(|row| Some(row.dofs())),
    Axis::log("median_ms", "ms", "time of a remesh with its K^c (median), ms").of(RemeshRow::median_ms),
    Axis::log(
        "p95_ms",
        "p95 ms",
        "time of a remesh with its K^c (95th percentile), ms",
    )
    .of(|row| Some(row.measured.time()?.p95_ms)),
    Axis::log(
        "prepare_ms",
        "ready ms",
        "time to get ready, the inverse included where one is needed, ms",
    )
    .of(|row| Some(row.measured.measured.prepare_ms)),
    Axis::log("held_mb", "holds MB", "memory held, MB").of(|row| Some(megabytes(row.measured.measured.memory_bytes))),
    Axis::log(
        "device_ms",
        "device ms",
        "time of the update on the device (median), ms",
    )
    .of(RemeshRow::device_ms),
    Axis::linear(
        "submissions",
        "submissions",
        "submissions to the device in a remesh (mean, samples of errors and rebuilds included)",
    )
    .of(|row| row.measured.exchanged(|traffic| traffic.submissions)),
    Axis::linear("waits", "waits", "waits for the device in a remesh (mean)")
        .of(|row| row.measured.exchanged(|traffic| traffic.waits)),
    Axis::log("up_kb", "up kB", "bytes sent to the device in a remesh (mean), kB")
        .of(|row| Some(1e-3 * row.measured.exchanged(|traffic| traffic.bytes_up)?)),
    Axis::log(
        "down_kb",
        "down kB",
        "bytes fetched from the device in a remesh (mean), kB",
    )
    .of(|row| Some(1e-3 * row.measured.exchanged(|traffic| traffic.bytes_down)?)),
    Axis::log("moved_mb", "moves MB", "bytes read and written by an update, MB")
        .of(|row| Some(row.measured.bytes()? * 1e-6)),
    Axis::log(
        "bandwidth_gb_s",
        "GB/s",
        "bytes read and written over the time of an update, GB/s",
    )
    .of(|row| Some(row.measured.rate()? * 1e-9)),
    Axis::linear(
        "copy_share_percent",
        "of a copy, %",
        "bandwidth as a share of that of a plain copy, %",
    )
    .of(|row| Some(100.0 * row.measured.rate()? / row.measured.copy_b_s?)),
    Axis::log(
        "error_inverse",
        "err K^-1",
        "relative error of sampled columns of the inverse stiffness",
    )
    .of(|row| row.measured.error(0)),
    ERROR_CONDENSED.of(|row| row.measured.error(1)),
    Axis::log(
        "error_solution",
        "err u",
        "relative error of displacements under a fixed load",
    )
    .of(|row| row.measured.error(2)),
    Axis::log(
        "error_mm",
        "err mm",
        "largest error of displacements where 1 N presses on the contacts, mm",
    )
    .of(|row| row.measured.error(4)),
    Axis::log(
        "residual",
        "residual",
        "relative residual |K X e - e| / (|K| |X e|) of sampled columns e, X being the inverse (infinity norms)",
    )
    .of(|row| row.measured.error(3)),
    Axis::log(
        "error_drift",
        "err K^c at last",
        "relative error of the compliance at the contacts after all updates",
    )
    .of(|row| Some(row.measured.measured.drift.last()?.1)),
    Axis::linear("updates", "updates", "updates").of(|row| Some(row.measured.measured.times_ms.len() as f64)),
    Axis::linear("rebuilds", "rebuilds", "number of rebuilds").of(|row| Some(row.measured.measured.rebuilds as f64)),
];

/// Number of updates, and the error of K^c after them.
type Drift = (usize, f64);

const DRIFT: [Column<Contended<Drift>>; 2] = [
    Axis::log("updates", "updates", "updates").of(|row| Some(row.measured.0 as f64)),
    ERROR_CONDENSED.of(|row| Some(row.measured.1)),
];

const GOLD: &str = "refactorisation of the moved mesh, solutions refined";

/// Report under construction.
pub(super) struct RemeshReport {
    study: Study,
    pub(super) rows: Vec<RemeshRow>,
    copy_cpu: f64,
    copy_gpus: Vec<(String, f64)>,
}

impl RemeshReport {
    pub(super) fn new(subjects: &[Subject], gpus: &[Gpu], options: &RemeshOptions) -> Result<Self, Error> {
        // Updates stream the whole inverse through memory: a plain copy says how fast that can be at best.
        let copy_cpu = contender::of_cpu();
        let copy_gpus = gpus
            .iter()
            .map(|gpu| Ok((gpu.report().name.clone(), contender::of_gpu(gpu)?)));
        let copy_gpus = copy_gpus.collect::<Result<Vec<_>, Error>>()?;
        let list = |text: &dyn Fn(&Subject) -> String| subjects.iter().map(text).collect::<Vec<_>>().join(", ");
        let mut about = vec![
            ("nodes", list(&|subject| subject.nodes().to_string())),
            ("nodes_fixed", list(&|subject| subject.fixed().to_string())),
            ("elements", list(&|subject| subject.mesh.elements().len().to_string())),
            ("degrees_of_freedom", list(&|subject| subject.size().to_string())),
            (
                "inverse_mb_f32",
                list(&|subject| format!("{:.0}", megabytes(Symmetric::<f32>::bytes_of(subject.size())))),
            ),
            (
                "contact_degrees_of_freedom",
                list(&|subject| subject.contacts.len().to_string()),
            ),
            ("moves_of_an_insertion", list(&|subject| subject.inserted().to_string())),
            ("rank", list(&|subject| format!("{:.0}", subject.rank()))),
            ("updates", options.updates.to_string()),
            ("young_kpa", options.young_kpa.to_string()),
            ("poisson", options.poisson.to_string()),
            ("copy_gb_s", format!("{:.1}", copy_cpu * 1e-9)),
        ];
        for (name, copy) in &copy_gpus {
            about.push(("copy_gb_s_of_gpu", format!("{:.1} ({name})", copy * 1e-9)));
        }
        let mut notes = Vec::new();
        if gpus.iter().any(|gpu| gpu.report().software) {
            notes.push("a software GPU runs on the CPU: its times say nothing of a GPU".to_owned());
        }
        Ok(Self {
            study: Study {
                name: "tradeoff-remesh",
                title: super::ENTRY.about.title,
                about,
                machine: Machine::here(),
                tables: Vec::new(),
                figures: figures(subjects),
                notes,
            },
            rows: Vec::new(),
            copy_cpu,
            copy_gpus,
        })
    }

    pub(super) fn add(&mut self, subject: &Subject, kind: &Kind, is_exact: bool, measured: Measured) {
        let copy_b_s = match kind.gpu() {
            None => Some(self.copy_cpu),
            Some(gpu) => {
                let mut copies = self.copy_gpus.iter();
                let copy = copies.find(|(name, _)| *name == gpu.report().name);
                copy.map(|(_, copy)| *copy)
            }
        };
        if let Some(flag) = measured.flag.as_ref().filter(|_| is_exact) {
            let note = format!("{} nodes, {kind}: {flag}", subject.nodes());
            self.study.notes.push(note);
        }
        self.rows.push(Contended {
            nodes: subject.nodes(),
            kind: kind.clone(),
            measured: Remeshing {
                dofs: subject.size(),
                measured,
                copy_b_s,
            },
        });
    }

    pub(super) fn note(&mut self, note: String) {
        self.study.notes.push(note);
    }

    pub(super) fn finish(mut self) -> Study {
        let goal = Goal::new("median_ms", "error_mm", SHIFT_MM)
            .choosing("level of remeshing alone")
            .baseline("level", "IV", FROZEN)
            .in_every(Deadline::Step, "p95_ms")
            .each(&["nodes"])
            .beside(&["p95_ms", "prepare_ms", "held_mb"]);
        let title = "What a remesh costs, and how far it is from the truth";
        let remesh = Table::of("remesh", title, &choices(), &REMESH, &self.rows)
            .flagged(&self.rows, |row| row.measured.measured.flag.clone())
            .against(GOLD)
            .seeking(goal);
        let drift = self.rows.iter().flat_map(|row| {
            row.measured.measured.drift.iter().map(|drift| Contended {
                nodes: row.nodes,
                kind: row.kind.clone(),
                measured: *drift,
            })
        });
        let drift: Vec<_> = drift.collect();
        let title = "Error of the compliance at the contacts, K^c, by number of updates";
        let drift = Table::of("drift", title, &choices(), &DRIFT, &drift).against(GOLD);
        self.study.tables = vec![remesh, drift];
        self.study
    }
}

fn figures(subjects: &[Subject]) -> Vec<Figure> {
    let figure = |file: &str, title: String, table, x, y| Figure {
        marker: vec!["backend", "precision"],
        ..Figure::new(file, title, table, [x, y], "level")
    };
    let mut figures = Vec::new();
    for subject in subjects {
        let nodes = subject.nodes();
        let of_mesh = vec![("nodes", nodes.to_string())];
        // Figures of one mesh keep plain names of files; those of several would overwrite each other.
        let suffix = if subjects.len() > 1 {
            format!("-{nodes}")
        } else {
            String::new()
        };
        figures.push(Figure {
            only: of_mesh.clone(),
            joined: false,
            marked: true,
            ..figure(
                &format!("remesh-error-time{suffix}"),
                format!("Remeshing {nodes} nodes: what accuracy costs"),
                "remesh",
                "median_ms",
                "error_condensed",
            )
        });
        figures.push(Figure {
            only: of_mesh,
            ..figure(
                &format!("remesh-drift{suffix}"),
                format!("Remeshing {nodes} nodes: does the error grow?"),
                "drift",
                "updates",
                "error_condensed",
            )
        });
    }
    if subjects.len() > 1 {
        let title = "Remeshing: growth with the size of the mesh".to_owned();
        figures.push(figure("remesh-size", title, "remesh", "dofs", "median_ms"));
    }
    figures
}

fn megabytes(bytes: usize) -> f64 {
    bytes as f64 * 1e-6
}

/// Returns the nearest-rank median; `None` for no values.
fn median(values: Vec<f64>) -> Option<f64> {
    Spread::of(values).map(|spread| spread.median_ms)
}
