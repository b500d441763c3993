//! Words to the user: results on standard output, everything else on standard error.

use std::fmt::Display;
use std::io::{self, IsTerminal, Write};

use indicatif::{ProgressBar, ProgressStyle};
use miette::MietteHandlerOpts;
use serde::Serialize;

use super::failure::Failure;

/// Writes a result to standard output. A reader that has had enough is no failure.
pub fn emit(text: &str) -> Result<(), Failure> {
    let mut out = io::stdout().lock();
    let line_end = if text.ends_with('\n') { "" } else { "\n" };
    match write!(out, "{text}{line_end}").and_then(|()| out.flush()) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => Err(Failure::Output(error)),
        _ => Ok(()),
    }
}

/// Writes a result to standard output as indented JSON.
pub fn emit_json(value: &impl Serialize) -> Result<(), Failure> {
    let text = serde_json::to_string_pretty(value).map_err(|error| Failure::Output(error.into()))?;
    emit(&text)
}

/// Says something to the user on standard error; a closed one is no failure.
pub fn say(text: impl Display) {
    let _ = writeln!(io::stderr().lock(), "{text}");
}

/// Warns the user.
pub fn warn(text: impl Display) {
    say(format_args!("warning: {text}"));
}

/// Tells of a failure, with the lines of the file that it is about. Lines are wrapped for people, not for programs.
pub fn report(failure: Failure) {
    const UNWRAPPED: usize = 100_000;
    let mut options = MietteHandlerOpts::new();
    if !io::stderr().is_terminal() {
        options = options.width(UNWRAPPED);
    }
    // Fails only where a hook is set already, which serves as well.
    let _ = miette::set_hook(Box::new(move |_| Box::new(options.clone().build())));
    say(format_args!("{:?}", miette::Report::new(failure)));
}

/// Steps of the bar that [`share`] makes.
pub const SHARES: u64 = 1000;

/// A bar over one piece of work; hidden where standard error is no terminal, and on request.
pub fn share(quiet: bool) -> ProgressBar {
    if quiet {
        return ProgressBar::hidden();
    }
    styled(ProgressBar::new(SHARES), "{bar:40} {percent} %, {eta} left  {msg}")
}

/// A bar over the frames of a run; hidden where standard error is no terminal, for a single frame, and on request.
pub fn progress(frames: usize, quiet: bool) -> ProgressBar {
    if quiet || frames < 2 {
        return ProgressBar::hidden();
    }
    // Hides itself where standard error is no terminal.
    styled(
        ProgressBar::new(frames as u64),
        "{bar:40} {pos}/{len} frames, {eta} left",
    )
}

fn styled(bar: ProgressBar, template: &str) -> ProgressBar {
    match ProgressStyle::with_template(template) {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}
