//! Tables and figures of the study.

use super::contender::{self, Kind};
use super::subject::Subject;
use super::{FROZEN, Measured, RemeshOptions};
use crate::tradeoff::{Axis, Deadline, Factor, Figure, Goal, SHIFT_MM, Study, Table};
use insonify::Error;
use insonify_base::machine::Machine;
use insonify_base::statistics::Spread;
use insonify_gpu::{Gpu, Traffic};
use insonify_mechanics::tissue::symmetric::Symmetric;

const FACTORS: [Factor; 4] = [
    Factor::new("nodes", "nodes"),
    Factor::new("level", "level"),
    Factor::new("backend", "backend"),
    Factor::new("precision", "precision"),
];

const ERROR_CONDENSED: Axis = Axis::log(
    "error_condensed",
    "err K^c",
    "relative error of K^c, the compliance at the contacts",
);

const AXES: [Axis; 21] = [
    Axis::log("dofs", "unknowns", "free degrees of freedom"),
    Axis::log("median_ms", "ms", "time of a remesh with its K^c (median), ms"),
    Axis::log(
        "p95_ms",
        "p95 ms",
        "time of a remesh with its K^c (95th percentile), ms",
    ),
    Axis::log(
        "prepare_ms",
        "ready ms",
        "time to get ready, the inverse included where one is needed, ms",
    ),
    Axis::log("held_mb", "holds MB", "memory held, MB"),
    Axis::log(
        "device_ms",
        "device ms",
        "time of the update on the device (median), ms",
    ),
    Axis::linear(
        "submissions",
        "submissions",
        "submissions to the device in a remesh (mean, samples of errors and rebuilds included)",
    ),
    Axis::linear("waits", "waits", "waits for the device in a remesh (mean)"),
    Axis::log("up_kb", "up kB", "bytes sent to the device in a remesh (mean), kB"),
    Axis::log(
        "down_kb",
        "down kB",
        "bytes fetched from the device in a remesh (mean), kB",
    ),
    Axis::log("moved_mb", "moves MB", "bytes read and written by an update, MB"),
    Axis::log(
        "bandwidth_gb_s",
        "GB/s",
        "bytes read and written over the time of an update, GB/s",
    ),
    Axis::linear(
        "copy_share_percent",
        "of a copy, %",
        "bandwidth as a share of that of a plain copy, %",
    ),
    Axis::log(
        "error_inverse",
        "err K^-1",
        "relative error of sampled columns of the inverse stiffness",
    ),
    ERROR_CONDENSED,
    Axis::log(
        "error_solution",
        "err u",
        "relative error of displacements under a fixed load",
    ),
    Axis::log(
        "error_mm",
        "err mm",
        "largest error of displacements where 1 N presses on the contacts, mm",
    ),
    Axis::log(
        "residual",
        "residual",
        "relative residual |K X e - e| / (|K| |X e|) of sampled columns e, X being the inverse (infinity norms)",
    ),
    Axis::log(
        "error_drift",
        "err K^c at last",
        "relative error of the compliance at the contacts after all updates",
    ),
    Axis::linear("updates", "updates", "updates"),
    Axis::linear("rebuilds", "rebuilds", "number of rebuilds"),
];

const GOLD: &str = "refactorisation of the moved mesh, solutions refined";

const DRIFT: [Axis; 2] = [Axis::log("updates", "updates", "updates"), ERROR_CONDENSED];

/// Report under construction.
pub(super) struct Report {
    study: Study,
    remesh: Table,
    drift: Table,
    copy_cpu: f64,
    copy_gpus: Vec<(String, f64)>,
}

impl Report {
    pub(super) fn new(subjects: &[Subject], gpus: &[Gpu], options: &RemeshOptions) -> Result<Report, Error> {
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
        Ok(Report {
            study: Study {
                name: "tradeoff-remesh",
                title: super::ENTRY.title,
                about,
                machine: Machine::here(),
                tables: Vec::new(),
                figures: figures(subjects),
                notes,
            },
            remesh: Table::new(
                "remesh",
                "What a remesh costs, and how far it is from the truth",
                &FACTORS,
                &AXES,
            )
            .against(GOLD)
            .seeking(
                Goal::new("median_ms", "error_mm", SHIFT_MM)
                    .choosing("level of remeshing alone")
                    .baseline("level", "IV", FROZEN)
                    .in_every(Deadline::Step, "p95_ms")
                    .each(&["nodes"])
                    .beside(&["p95_ms", "prepare_ms", "held_mb"]),
            ),
            drift: Table::new(
                "drift",
                "Error of the compliance at the contacts, K^c, by number of updates",
                &FACTORS,
                &DRIFT,
            )
            .against(GOLD),
            copy_cpu,
            copy_gpus,
        })
    }

    pub(super) fn add(&mut self, subject: &Subject, kind: &Kind, is_exact: bool, measured: Measured) {
        let choices: Vec<String> = std::iter::once(subject.nodes().to_string())
            .chain(kind.choices())
            .collect();
        let updates = measured.times_ms.len();
        let time = Spread::of(measured.times_ms);
        let bytes = median(measured.bytes.iter().map(|bytes| *bytes as f64).collect());
        let rate = time.zip(bytes).map(|(time, bytes)| bytes / (time.median_ms * 1e-3));
        let copy = match kind.gpu() {
            None => Some(self.copy_cpu),
            Some(gpu) => {
                let own = self.copy_gpus.iter().find(|(name, _)| *name == gpu.report().name);
                own.map(|(_, copy)| *copy)
            }
        };
        let error = |at: usize| measured.errors.map(|errors| errors[at]);
        for (after, error) in &measured.drift {
            let values = vec![Some(*after as f64), Some(*error)];
            self.drift.push(choices.clone(), values, None);
        }
        let traffic = &measured.traffic;
        let exchanged = |part: fn(&Traffic) -> u64, unit: f64| {
            let total: u64 = traffic.iter().map(part).sum();
            (!traffic.is_empty()).then(|| unit * total as f64 / traffic.len() as f64)
        };
        let flag = measured.flag;
        if let Some(flag) = flag.as_ref().filter(|_| is_exact) {
            self.study
                .notes
                .push(format!("{} nodes, {kind}: {flag}", subject.nodes()));
        }
        let values = vec![
            Some(subject.size() as f64),
            time.map(|time| time.median_ms),
            time.map(|time| time.p95_ms),
            Some(measured.prepare_ms),
            Some(megabytes(measured.held)),
            median(measured.device_ms),
            exchanged(|traffic| traffic.submissions, 1.0),
            exchanged(|traffic| traffic.waits, 1.0),
            exchanged(|traffic| traffic.bytes_up, 1e-3),
            exchanged(|traffic| traffic.bytes_down, 1e-3),
            bytes.map(|bytes| bytes * 1e-6),
            rate.map(|rate| rate * 1e-9),
            rate.zip(copy).map(|(rate, copy)| 100.0 * rate / copy),
            error(0),
            error(1),
            error(2),
            error(4),
            error(3),
            measured.drift.last().map(|(_, error)| *error),
            Some(updates as f64),
            Some(measured.rebuilds as f64),
        ];
        self.remesh.push(choices, values, flag);
    }

    pub(super) fn note(&mut self, note: String) {
        self.study.notes.push(note);
    }

    pub(super) fn finish(mut self) -> Study {
        self.study.tables = vec![self.remesh, self.drift];
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
        let only = vec![("nodes", nodes.to_string())];
        let several = if subjects.len() > 1 {
            format!("-{nodes}")
        } else {
            String::new()
        };
        figures.push(Figure {
            only: only.clone(),
            joined: false,
            marked: true,
            ..figure(
                &format!("remesh-error-time{several}"),
                format!("Remeshing {nodes} nodes: what accuracy costs"),
                "remesh",
                "median_ms",
                "error_condensed",
            )
        });
        figures.push(Figure {
            only,
            ..figure(
                &format!("remesh-drift{several}"),
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
