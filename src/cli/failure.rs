//! Failures of subcommands and their exit status.

use std::fmt;
use std::io;

use crate::anatomy::volume::VolumeError;
use crate::base::output::OutputError;
use crate::base::report::plot::PlotError;
use crate::error::{INPUT, MACHINE};
use crate::gpu::GpuError;
use crate::imaging::synth::SynthError;
use crate::input::beam_case::BeamCaseError;
use crate::input::beam_case::points::PointsError;
use crate::input::material_case::MaterialCaseError;
use crate::input::scenario::ScenarioError;
use crate::input::scene::SceneError;
use crate::input::statics::StaticsError;
use crate::mechanics::insertion::StepError;
use crate::mechanics::mesh::file::MeshFileError;
use crate::mechanics::mesh::generate::GenerateError;
use crate::mechanics::needle::beam::BeamError;
use crate::study::bench::compare::CompareError;
use crate::study::puncture::PunctureError;
use crate::study::tradeoff::RenderError;
use crate::study::tradeoff::image::ImageError;
use crate::study::tradeoff::insertion::InsertionStudyError;
use crate::study::tradeoff::remesh::StudyError;
use crate::study::tradeoff::tissue::TissueError;
use crate::tracking::TrackingError;
use miette::{Diagnostic, LabeledSpan, SourceCode};

/// Why a subcommand failed.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// Error of the library.
    #[error(transparent)]
    Library(Box<crate::error::Error>),
    /// Error of a study, which the user can correct.
    #[error(transparent)]
    Study(Box<dyn std::error::Error + Send + Sync>),
    /// Error of a study, in which the machine failed.
    #[error(transparent)]
    Machine(Box<dyn std::error::Error + Send + Sync>),
    /// Arguments that contradict each other or do not apply to this scene.
    #[error("{found}")]
    Usage {
        /// What was requested.
        found: String,
        /// What to request instead.
        help: String,
    },
    /// Stability cases that failed; they have been printed.
    #[error("{failed} of {cases} hard cases do not hold")]
    Unstable {
        /// Number of failed cases.
        failed: usize,
        /// Number of cases run.
        cases: usize,
    },
    /// A study that failed; the others were completed.
    #[error("the study `{study}` could not be made: {reason}{}", others(*more))]
    Unmeasured {
        /// Name of the study.
        study: String,
        /// Reason of the failure.
        reason: String,
        /// Number of further failed studies.
        more: usize,
    },
    /// Standard output is full, or closed other than by a reader that stopped reading.
    #[error("standard output cannot be written: {0}")]
    Output(io::Error),
}

impl Failure {
    /// Creates an error for invalid arguments: what was requested, and what to request instead.
    pub fn usage(found: impl Into<String>, help: impl Into<String>) -> Self {
        Self::Usage {
            found: found.into(),
            help: help.into(),
        }
    }

    /// Exit status: 2 if the user can correct the request, 1 if the machine failed.
    pub fn status(&self) -> u8 {
        match self {
            Self::Library(error) => error.exit_status(),
            Self::Usage { .. } | Self::Study(_) => INPUT,
            Self::Machine(_) | Self::Unstable { .. } | Self::Unmeasured { .. } | Self::Output(_) => MACHINE,
        }
    }
}

impl Diagnostic for Failure {
    fn help<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        match self {
            Self::Library(error) => error.help(),
            Self::Usage { help, .. } => Some(Box::new(help)),
            _ => None,
        }
    }

    fn source_code(&self) -> Option<&dyn SourceCode> {
        match self {
            Self::Library(error) => error.source_code(),
            _ => None,
        }
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        match self {
            Self::Library(error) => error.labels(),
            _ => None,
        }
    }
}

/// Describes further failures in words.
fn others(more: usize) -> String {
    match more {
        0 => String::new(),
        more => format!("; nor could {more} more"),
    }
}

macro_rules! from_library {
    ($($error:ty),*) => {
        $(impl From<$error> for Failure {
            fn from(error: $error) -> Self {
                Self::Library(Box::new(error.into()))
            }
        })*
    };
}

from_library!(
    crate::error::Error,
    BeamCaseError,
    BeamError,
    GenerateError,
    GpuError,
    MaterialCaseError,
    MeshFileError,
    OutputError,
    PlotError,
    PointsError,
    ScenarioError,
    SceneError,
    StaticsError,
    StepError,
    SynthError,
    TrackingError,
    VolumeError
);

macro_rules! from_study {
    ($($error:ty: $machine:expr),*) => {
        $(impl From<$error> for Failure {
            fn from(error: $error) -> Self {
                let machine: fn(&$error) -> bool = $machine;
                match machine(&error) {
                    true => Self::Machine(error.into()),
                    false => Self::Study(error.into()),
                }
            }
        })*
    };
}

from_study!(
    CompareError: CompareError::is_machine,
    ImageError: ImageError::is_machine,
    InsertionStudyError: |_| false,
    PunctureError: |_| false,
    RenderError: |_| true,
    StudyError: StudyError::is_machine,
    TissueError: |_| false
);
