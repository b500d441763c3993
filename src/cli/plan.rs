//! `insonify plan`: what a frame of a scene is made of.

use clap::Args;
use insonify::plan::PlanReport;
use insonify::synth::tables::Tables;
use serde::Serialize;

use super::failure::Failure;
use super::input::Input;
use super::terminal;

/// Prints the passes that a scene calls for and why, those that it does without, and the bytes of each resource
#[derive(Args)]
pub struct Plan {
    #[command(flatten)]
    input: Input,
    /// Print JSON: `passes`, `without`, `resources`, `bytes`, `warnings`
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Report {
    #[serde(flatten)]
    plan: PlanReport,
    warnings: Vec<String>,
}

impl Plan {
    pub fn run(&self) -> Result<(), Failure> {
        let scene = self.input.scene(self.json)?;
        let tables = Tables::new(scene.anatomy, scene.settings)?;
        let plan = insonify::plan::Plan::new(&tables).report();
        if self.json {
            return terminal::emit_json(&Report {
                plan,
                warnings: scene.warnings,
            });
        }
        terminal::emit(&plan.to_string())
    }
}
