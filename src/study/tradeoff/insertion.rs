//! Needle insertions: what each way to calculate them costs, and how far it is from the best.
//!
//! Every part drives several models along one insertion and compares what hand and image get. Steps are calculated several times
//! over, the contenders of a part in turn; the time of a step is the least of these, since other work on the machine only adds.
//!
//! | module | what it compares |
//! |---|---|
//! | `levels` | levels of remeshing, a probe moved sideways midway (Goksel et al. 2011, figures 13c and 14) |
//! | `bevel` | bevels and meshes in a block of PVC: deflection against depth (Goksel et al. 2011, section VI-A) |
//! | `thinning` | every n-th candidate of the probe |
//! | `pieces` | lengths of the links of a needle of angular springs, and of the elements of a beam |
//! | `mesh` | nodes of the mesh |
//! | `masses` | masses and springs against finite elements |
//!
//! `course` moves hands and clocks, `columns` has the columns that tables share.

mod bevel;
mod columns;
mod course;
mod error;
mod levels;
mod masses;
mod mesh;
mod pieces;
#[cfg(test)]
mod tests;
mod thinning;

pub use error::InsertionStudyError;

use super::gather::Entry;
use super::{Figure, Study, Table};
use crate::study::machine::Machine;
use crate::study::stability::Effort;

/// What can be compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// Levels of remeshing.
    Levels,
    /// Bevels.
    Bevel,
    /// Masses and springs against finite elements.
    Masses,
    /// Candidates of the probe.
    Thinning,
    /// Links of the needle.
    Links,
    /// Elements of a needle that is a beam.
    Elements,
    /// Nodes of the mesh.
    Mesh,
}

impl Part {
    /// All of them.
    pub const ALL: [Part; 7] = [
        Part::Levels,
        Part::Mesh,
        Part::Bevel,
        Part::Masses,
        Part::Thinning,
        Part::Links,
        Part::Elements,
    ];

    fn run(self, options: &InsertionOptions, progress: Progress<'_>) -> Result<Findings, InsertionStudyError> {
        match self {
            Part::Levels => levels::run(options, progress),
            Part::Bevel => bevel::run(options, progress),
            Part::Masses => masses::run(options, progress),
            Part::Thinning => thinning::run(options, progress),
            Part::Links => pieces::run(&pieces::LINKS, options, progress),
            Part::Elements => pieces::run(&pieces::ELEMENTS, options, progress),
            Part::Mesh => mesh::run(options, progress),
        }
    }
}

/// What to study, and at what size.
#[derive(Clone, Debug, PartialEq)]
pub struct InsertionOptions {
    /// Nodes of the block, about (default 3,300: the detailed model of Goksel et al. 2011).
    pub nodes: usize,
    /// How deep the needle goes, mm (10 to 80, default 60).
    pub depth_mm: f64,
    /// How deep it goes into the block of PVC, mm (10 to 140, default 140).
    pub bevel_depth_mm: f64,
    /// Whether bevels of half and one and a half times the usual length and finer meshes are compared too (default true).
    pub bevel_sweep: bool,
    /// How often every step is calculated and timed (default 3).
    pub passes: usize,
    /// What to compare (default all).
    pub parts: Vec<Part>,
}

impl Default for InsertionOptions {
    fn default() -> Self {
        InsertionOptions {
            nodes: 3300,
            depth_mm: 60.0,
            bevel_depth_mm: 140.0,
            bevel_sweep: true,
            passes: 3,
            parts: Part::ALL.to_vec(),
        }
    }
}

/// This study among all.
pub const ENTRY: Entry = Entry {
    name: "insertion",
    title: "Needle insertion",
    question: "A needle goes in and comes out while a probe presses: what do step times, forces and the tip's place pay for each model? \
               Levels of remeshing, nodes of the mesh, links and elements of the needle, candidates of the probe, masses and springs.",
    run: |_, effort, progress| {
        let usual = InsertionOptions::of(effort);
        let whole = InsertionOptions {
            passes: 1,
            ..usual.clone()
        };
        Ok(study(&effort.pick(usual, whole), progress)?)
    },
};

impl InsertionOptions {
    /// What is studied at an effort: the default, or a small block and short ways.
    pub fn of(effort: Effort) -> Self {
        effort.pick(
            InsertionOptions {
                nodes: 500,
                depth_mm: 20.0,
                bevel_depth_mm: 60.0,
                bevel_sweep: false,
                passes: 1,
                ..InsertionOptions::default()
            },
            InsertionOptions::default(),
        )
    }

    fn check(&self) -> Result<(), InsertionStudyError> {
        let numbers = [
            (
                "the number of nodes",
                self.nodes as f64,
                100.0..=100_000.0,
                "100 to 100000",
            ),
            ("the depth", self.depth_mm, 10.0..=80.0, "10 to 80 mm"),
            ("the depth in PVC", self.bevel_depth_mm, 10.0..=140.0, "10 to 140 mm"),
            ("the number of passes", self.passes as f64, 1.0..=1000.0, "1 to 1000"),
            (
                "the number of parts",
                self.parts.len() as f64,
                1.0..=f64::MAX,
                "1 or more",
            ),
        ];
        match numbers.into_iter().find(|(_, found, range, _)| !range.contains(found)) {
            Some((what, found, _, expected)) => Err(InsertionStudyError::Number { what, found, expected }),
            None => Ok(()),
        }
    }
}

/// Told what is being done and the share that is done, ascending from 0 to 1.
type Progress<'a> = &'a mut (dyn FnMut(&str, f64) + Send);

/// What a part has found out.
#[derive(Default)]
struct Findings {
    about: Vec<(&'static str, String)>,
    tables: Vec<Table>,
    figures: Vec<Figure>,
    notes: Vec<String>,
}

/// Studies insertions. `progress` is told what is being done and the share that is done, ascending from 0 to 1.
///
/// # Errors
/// [`InsertionStudyError`]; memory is checked before anything large is allocated.
pub fn study(
    options: &InsertionOptions,
    progress: &mut (dyn FnMut(&str, f64) + Send),
) -> Result<Study, InsertionStudyError> {
    options.check()?;
    let mut study = Study {
        name: "tradeoff-insertion",
        title: ENTRY.title,
        about: vec![("passes", options.passes.to_string())],
        machine: Machine::here(),
        tables: Vec::new(),
        figures: Vec::new(),
        notes: Vec::new(),
    };
    let total = options.parts.len() as f64;
    for (at, part) in options.parts.iter().enumerate() {
        let mut inner = |text: &str, share: f64| progress(text, (at as f64 + share) / total);
        let found = part.run(options, &mut inner)?;
        study.about.extend(found.about);
        study.tables.extend(found.tables);
        study.figures.extend(found.figures);
        study.notes.extend(found.notes);
    }
    progress("done", 1.0);
    Ok(study)
}
