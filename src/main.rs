//! The `insonify` command: parse, call, print.

mod cli;

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    quiet_mesa();
    match cli::Cli::try_parse() {
        Ok(cli) => cli::exit(cli.run()),
        Err(error) => cli::refuse(&error),
    }
}

/// Keeps Mesa's device selection layer, which every adapter query loads, from printing an error where there is no display.
#[allow(unsafe_code, reason = "the environment is set before any other thread runs")]
fn quiet_mesa() {
    if std::env::var_os("NODEVICE_SELECT").is_none() {
        unsafe { std::env::set_var("NODEVICE_SELECT", "1") }
    }
}
