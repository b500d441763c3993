//! `insonify schema`: JSON schemas of input and output files.

use clap::{Args, ValueEnum};
use insonify::input::statics::ProblemFile;
use insonify_imaging::sidecar::Sidecar;
use insonify_study::{beam_case, identification, material_case};
use schemars::schema_for;

use super::terminal;
use insonify::Error;

/// Prints the JSON schema of a file, for editors and for programs that write such files
#[derive(Args)]
pub(crate) struct Schema {
    /// File type
    #[arg(value_enum, default_value = "scene")]
    of: FileKind,
}

#[derive(Clone, Copy, ValueEnum)]
enum FileKind {
    /// A scene, which `render` reads
    Scene,
    /// A scenario, which `insert` reads
    #[value(alias = "scenario")]
    Insert,
    /// A case that `solve` reads
    #[value(alias = "problem")]
    Solve,
    /// A case that `beam` reads
    Beam,
    /// A case that `material` reads
    Material,
    /// A case that `identify` reads
    Identify,
    /// The sidecar of a frame that `render --sidecar` writes
    Sidecar,
}

impl Schema {
    pub(crate) fn run(&self) -> Result<(), Error> {
        terminal::emit_json(&match self.of {
            FileKind::Scene => insonify_imaging::scene::schema(),
            FileKind::Solve => schema_for!(ProblemFile).to_value(),
            FileKind::Material => schema_for!(material_case::CaseFile).to_value(),
            FileKind::Identify => schema_for!(identification::CaseFile).to_value(),
            FileKind::Beam => schema_for!(beam_case::CaseFile).to_value(),
            FileKind::Insert => insonify::input::scenario::schema(),
            FileKind::Sidecar => schema_for!(Sidecar).to_value(),
        })
    }
}
