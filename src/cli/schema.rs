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
    of: Of,
}

#[derive(Clone, Copy, ValueEnum)]
enum Of {
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
            Of::Scene => insonify_imaging::scene::schema(),
            Of::Solve => schema_for!(ProblemFile).to_value(),
            Of::Material => schema_for!(material_case::CaseFile).to_value(),
            Of::Identify => schema_for!(identification::CaseFile).to_value(),
            Of::Beam => schema_for!(beam_case::CaseFile).to_value(),
            Of::Insert => insonify::input::scenario::schema(),
            Of::Sidecar => schema_for!(Sidecar).to_value(),
        })
    }
}
