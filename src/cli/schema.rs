//! `insonify schema`: JSON schemas of input and output files.

use crate::imaging::sidecar::Sidecar;
use crate::input::beam_case;
use crate::input::identification;
use crate::input::material_case;
use crate::input::statics::ProblemFile;
use clap::{Args, ValueEnum};
use schemars::schema_for;

use super::failure::Failure;
use super::terminal;

/// Prints the JSON schema of a file, for editors and for programs that write such files
#[derive(Args)]
pub struct Schema {
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
    pub fn run(&self) -> Result<(), Failure> {
        terminal::emit_json(&match self.of {
            Of::Scene => crate::input::scene::schema(),
            Of::Solve => schema_for!(ProblemFile).to_value(),
            Of::Material => schema_for!(material_case::CaseFile).to_value(),
            Of::Identify => schema_for!(identification::CaseFile).to_value(),
            Of::Beam => schema_for!(beam_case::CaseFile).to_value(),
            Of::Insert => crate::input::scenario::schema(),
            Of::Sidecar => schema_for!(Sidecar).to_value(),
        })
    }
}
