//! Needle insertions: cost and error of each computational choice.
//!
//! Every part drives several models along one insertion and compares what hand and image receive. Steps are computed several times, the
//! contenders of a part in turn; the time of a step is the minimum, since other load on the machine only adds to it.
//!
//! | module | comparison |
//! |---|---|
//! | `levels` | remeshing levels, with a probe moved sideways midway (Goksel et al. 2011, figures 13c and 14) |
//! | `bevel` | bevels and meshes in a block of PVC: deflection against depth (Goksel et al. 2011, section VI-A) |
//! | `thinning` | every n-th probe candidate |
//! | `pieces` | link lengths of an angular-spring needle, and element lengths of a beam |
//! | `mesh` | number of mesh nodes |
//! | `masses` | masses and springs against finite elements |
//!
//! `course` moves the instruments and times the steps; `columns` contains the columns common to the tables.

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
use crate::base::report::machine::Machine;
use crate::study::stability::Effort;

/// Part of the study.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// Remeshing levels.
    Levels,
    /// Bevels.
    Bevel,
    /// Masses and springs against finite elements.
    Masses,
    /// Thinning of the probe candidates.
    Thinning,
    /// Link length of an angular-spring needle.
    Links,
    /// Element length of a beam needle.
    Elements,
    /// Number of mesh nodes.
    Mesh,
}

impl Part {
    /// All parts.
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

/// Options of the study.
#[derive(Clone, Debug, PartialEq)]
pub struct InsertionOptions {
    /// Approximate number of nodes of the block (default 3,300: the detailed model of Goksel et al. 2011).
    pub nodes: usize,
    /// Insertion depth, mm (10 to 80, default 60).
    pub depth_mm: f64,
    /// Insertion depth in the block of PVC, mm (10 to 140, default 140).
    pub bevel_depth_mm: f64,
    /// Whether bevels of half and one and a half times the default length and finer meshes are compared too (default true).
    pub bevel_sweep: bool,
    /// Number of times that every step is computed and timed (default 3).
    pub passes: usize,
    /// Parts to run (default all).
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

/// Registration of this study.
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
    /// Returns the options for an effort: the default, or a small block and short insertions.
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

/// Callback that receives the current task and the completed fraction, increasing from 0 to 1.
type Progress<'a> = &'a mut (dyn FnMut(&str, f64) + Send);

/// Results of a part.
#[derive(Default)]
struct Findings {
    about: Vec<(&'static str, String)>,
    tables: Vec<Table>,
    figures: Vec<Figure>,
    notes: Vec<String>,
}

/// Studies insertions. `progress` receives the current task and the completed fraction, increasing from 0 to 1.
///
/// # Errors
/// [`InsertionStudyError`]; memory is checked before any large allocation.
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
