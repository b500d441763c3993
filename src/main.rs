//! The `insonify` command: parse, call, print.

mod cli;

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    match cli::Cli::try_parse() {
        Ok(cli) => cli::exit(cli.run()),
        Err(error) => cli::refuse(&error),
    }
}
