//! `insonify scene`: built-in scenes to edit.

use clap::Args;
use clap::builder::PossibleValuesParser;
use insonify_imaging::scene::EXAMPLES;

use super::terminal;
use insonify::Error;

/// Prints the commented default scene, or another built-in one: insonify scene > my.toml
#[derive(Args)]
pub(crate) struct Scene {
    /// Name of the scene
    #[arg(value_name = "NAME", default_value = "default", value_parser = names())]
    name: String,
}

fn names() -> PossibleValuesParser {
    PossibleValuesParser::new(EXAMPLES.iter().map(|(name, _)| *name))
}

impl Scene {
    pub(crate) fn run(&self) -> Result<(), Error> {
        let text = EXAMPLES.iter().find(|(name, _)| *name == self.name);
        terminal::emit(text.map_or(insonify_imaging::scene::DEFAULT, |(_, text)| text))
    }
}
