//! `insonify plan`: passes and resources of a frame.

use clap::Args;
use insonify_imaging::synth::tables::Tables;

use super::backend::BackendArgs;
use super::input::Input;
use super::terminal;
use insonify::Error;

/// Prints the passes that a scene needs and why, those that it does not use, and the size of each resource
#[derive(Args)]
pub(crate) struct Plan {
    #[command(flatten)]
    input: Input,
    #[command(flatten)]
    backend: BackendArgs,
    /// Print JSON: `passes`, `clinical`, `dispatches`, `without`, `resources`, `bytes`, `warnings`, and `quality` if the scene
    /// states a budget
    #[arg(long)]
    json: bool,
}

impl Plan {
    pub(crate) fn run(&self) -> Result<(), Error> {
        let (scene, picked) = self.input.scene(&self.backend)?;
        let tables = Tables::new(scene.anatomy, scene.settings)?;
        let mut plan = insonify_imaging::plan::Plan::new(&tables).report(&scene.origins);
        plan.quality = picked;
        plan.warnings.iter().for_each(terminal::warn);
        if self.json {
            plan.warnings.splice(0..0, scene.warnings);
            return terminal::emit_json(&plan);
        }
        terminal::emit(&plan.to_string())
    }
}
