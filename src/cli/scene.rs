//! `insonify scene`: scenes that come with the program, ready to edit.

use clap::Args;
use clap::builder::PossibleValuesParser;
use insonify::scene::EXAMPLES;

use super::failure::Failure;
use super::terminal;

/// Prints the commented default scene, or another that comes with the program: insonify scene > my.toml
#[derive(Args)]
pub struct Scene {
    /// Which
    #[arg(value_name = "NAME", default_value = "default", value_parser = names())]
    name: String,
}

fn names() -> PossibleValuesParser {
    PossibleValuesParser::new(EXAMPLES.iter().map(|(name, _)| *name))
}

impl Scene {
    pub fn run(&self) -> Result<(), Failure> {
        let text = EXAMPLES.iter().find(|(name, _)| *name == self.name);
        terminal::emit(text.map_or(insonify::scene::DEFAULT, |(_, text)| text))
    }
}
