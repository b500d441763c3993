//! `insonify completions`: completion scripts for shells.

use clap::{Args, CommandFactory};
use clap_complete::Shell;

use super::{Cli, Command, groups, limited, terminal};
use insonify::Error;

/// Prints the completion script of a shell
///
/// insonify completions bash > ~/.local/share/bash-completion/completions/insonify
#[derive(Args)]
pub(crate) struct Completions {
    /// Name of the shell
    #[arg(value_enum)]
    shell: Shell,
}

impl Completions {
    pub(crate) fn run(&self) -> Result<(), Error> {
        let mut script = Vec::new();
        let mut command = limited(groups::prefixed(Cli::command(), Command::GROUPS));
        clap_complete::generate(self.shell, &mut command, "insonify", &mut script);
        terminal::emit(&String::from_utf8_lossy(&script))
    }
}
