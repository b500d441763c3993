//! What a subcommand can fail of, and the exit status it ends with.

use std::fmt;
use std::io;

use insonify::beam_case::BeamCaseError;
use insonify::beam_case::points::PointsError;
use insonify::error::{INPUT, MACHINE};
use insonify::gpu::GpuError;
use insonify::material_case::MaterialCaseError;
use insonify::mechanics::insertion::StepError;
use insonify::mechanics::mesh::file::MeshFileError;
use insonify::mechanics::mesh::generate::GenerateError;
use insonify::mechanics::needle::beam::BeamError;
use insonify::output::atomic::WriteError;
use insonify::output::place::PlaceError;
use insonify::output::png::PngError;
use insonify::output::sequence::SequenceError;
use insonify::phantom::PhantomError;
use insonify::scenario::ScenarioError;
use insonify::scene::SceneError;
use insonify::statics::StaticsError;
use insonify::study::bench::compare::CompareError;
use insonify::study::plot::PlotError;
use insonify::study::puncture::PunctureError;
use insonify::study::tradeoff::RenderError;
use insonify::study::tradeoff::image::ImageError;
use insonify::study::tradeoff::insertion::InsertionStudyError;
use insonify::study::tradeoff::remesh::StudyError;
use insonify::study::tradeoff::tissue::TissueError;
use insonify::synth::SynthError;
use insonify::tracking::calibration::CalibrationError;
use insonify::volume::VolumeError;
use insonify::volume::complete::CompletionError;
use miette::{Diagnostic, LabeledSpan, SourceCode};

/// Why a subcommand ends without having done what was asked.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// The library says so.
    #[error(transparent)]
    Library(Box<insonify::error::Error>),
    /// Arguments that make no sense together, or for this scene.
    #[error("{found}")]
    Usage {
        /// What was asked.
        found: String,
        /// What to ask.
        help: String,
    },
    /// Hard cases that do not hold; they have been shown.
    #[error("{failed} of {cases} hard cases do not hold")]
    Unstable {
        /// How many do not.
        failed: usize,
        /// How many were run.
        cases: usize,
    },
    /// A study that could not be made; the others were.
    #[error("the study `{study}` could not be made: {reason}{}", others(*more))]
    Unmeasured {
        /// Which.
        study: String,
        /// Why.
        reason: String,
        /// How many more could not.
        more: usize,
    },
    /// Standard output is full or closed other than by a reader that had enough.
    #[error("standard output cannot be written: {0}")]
    Output(io::Error),
}

impl Failure {
    /// Arguments that make no sense: what was asked, and what to ask instead.
    pub fn usage(found: impl Into<String>, help: impl Into<String>) -> Self {
        Self::Usage {
            found: found.into(),
            help: help.into(),
        }
    }

    /// The exit status: 2 where the user can put it right by asking otherwise, 1 where the machine failed.
    pub fn status(&self) -> u8 {
        match self {
            Self::Library(error) => error.exit_status(),
            Self::Usage { .. } => INPUT,
            Self::Unstable { .. } | Self::Unmeasured { .. } | Self::Output(_) => MACHINE,
        }
    }
}

impl Diagnostic for Failure {
    fn help<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        match self {
            Self::Library(error) => error.help(),
            Self::Usage { help, .. } => Some(Box::new(help)),
            Self::Unstable { .. } | Self::Unmeasured { .. } | Self::Output(_) => None,
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

/// What else failed, in words.
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
    insonify::error::Error,
    BeamCaseError,
    BeamError,
    CalibrationError,
    CompareError,
    CompletionError,
    GenerateError,
    GpuError,
    ImageError,
    InsertionStudyError,
    MaterialCaseError,
    MeshFileError,
    PhantomError,
    PlaceError,
    PlotError,
    PngError,
    PointsError,
    PunctureError,
    RenderError,
    ScenarioError,
    SceneError,
    SequenceError,
    StaticsError,
    StepError,
    StudyError,
    SynthError,
    TissueError,
    VolumeError,
    WriteError
);
