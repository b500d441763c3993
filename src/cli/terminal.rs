//! Terminal output: results on standard output, everything else on standard error.

mod progress;

use std::borrow::Cow;
use std::env;
use std::fmt::Display;
use std::io::{self, IsTerminal, Write};
use std::sync::atomic::{AtomicBool, Ordering};

use insonify_base::document::InputError;
use insonify_base::note::Note;
use insonify_base::stage::{self, Extent, Stage};
use insonify_base::text::{MESSAGE, clipped, printable};
use serde::Serialize;

use super::excerpt::drawn;
use super::failure::{Error, Failure};
use progress::Shown;
use progress::aside;

/// Writes a result to standard output. A reader that stops reading causes no failure.
pub(crate) fn emit(text: &str) -> Result<(), Error> {
    let mut out = io::stdout().lock();
    let line_end = if text.ends_with('\n') { "" } else { "\n" };
    match aside(|| write!(out, "{}{line_end}", printable(text)).and_then(|()| out.flush())) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => Err(Failure::Output(error).into()),
        _ => Ok(()),
    }
}

/// Writes a result to standard output, as text or as JSON.
pub(crate) fn print(result: &(impl Serialize + ToString), json: bool) -> Result<(), Error> {
    show(result, json, || result.to_string())
}

/// Writes a result to standard output, as JSON or as a text of its own.
pub(crate) fn show(result: &impl Serialize, json: bool, text: impl FnOnce() -> String) -> Result<(), Error> {
    if json { emit_json(result) } else { emit(&text()) }
}

/// A result as indented JSON.
pub(crate) fn pretty(value: &impl Serialize) -> Result<String, Error> {
    Ok(serde_json::to_string_pretty(value).map_err(|error| Failure::Output(error.into()))?)
}

/// Writes a result to standard output as indented JSON.
pub(crate) fn emit_json(value: &impl Serialize) -> Result<(), Error> {
    let text = pretty(value)?;
    // A terminal interprets more characters than JSON has to escape.
    let control = |c: char| c.is_control() && c != '\n';
    let escaped = text
        .split_inclusive(control)
        .map(|part| match part.chars().next_back() {
            Some(c) if control(c) => Cow::Owned(format!("{}\\u{:04x}", part.trim_end_matches(c), u32::from(c))),
            _ => Cow::Borrowed(part),
        });
    emit(&escaped.collect::<String>())
}

/// Set by `--quiet`: only results and errors are printed.
static QUIET: AtomicBool = AtomicBool::new(false);

/// Set by `--verbose`: notes are printed with their details.
static VERBOSE: AtomicBool = AtomicBool::new(false);

/// Suppresses all output except results and errors.
pub(crate) fn quieten() {
    QUIET.store(true, Ordering::Relaxed);
}

/// Adds the details of notes.
pub(crate) fn explain() {
    VERBOSE.store(true, Ordering::Relaxed);
}

fn is_quiet() -> bool {
    QUIET.load(Ordering::Relaxed)
}

/// Shows the progress of a command from now on, unless quiet.
pub(crate) fn watched(command: &str) -> Option<Shown> {
    (!is_quiet()).then(|| progress::show(command))
}

/// Writes to standard error unless quiet; a closed stream causes no failure.
pub(crate) fn say(text: impl Display) {
    if is_quiet() {
        return;
    }
    aside(|| {
        let _ = writeln!(io::stderr().lock(), "{}", printable(&text.to_string()));
    });
}

/// Prints a warning on one line.
pub(crate) fn warn(text: impl Display) {
    say(clipped(&format!("warning: {text}"), MESSAGE));
}

/// Prints a note on one line.
pub(crate) fn note(text: impl Display) {
    say(clipped(&format!("note: {text}"), MESSAGE));
}

/// Prints notes, one line each, and their details if they are asked for.
pub(crate) fn notes(notes: &[Note]) {
    for described in notes {
        note(described.head());
        let details = described.details().filter(|_| VERBOSE.load(Ordering::Relaxed));
        for line in details.into_iter().flat_map(str::lines) {
            say(clipped(&format!("  {line}"), MESSAGE));
        }
    }
}

/// Prints a failure with the lines of the file concerned.
pub(crate) fn report(error: &Error) {
    let message = clipped(&error.to_string(), MESSAGE);
    let help = error.help().map(|help| clipped(help, MESSAGE));
    let excerpt = error.input().and_then(InputError::excerpt);
    let text = drawn(&message, help.as_deref(), excerpt, has_colours());
    // Not through `say`: the colours are intended.
    aside(|| {
        let _ = writeln!(io::stderr().lock(), "{text}");
    });
}

/// Whether standard error is a terminal that shows colours and the user allows them (<https://no-color.org>).
fn has_colours() -> bool {
    let refused = env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty());
    io::stderr().is_terminal() && !refused && env::var_os("TERM").is_none_or(|name| name != "dumb")
}

/// Does work that reports the completed fraction.
pub(crate) fn with_share<T>(name: &str, work: impl FnOnce(&(dyn Fn(f64) + Sync)) -> T) -> T {
    let stage = stage::enter(name, Extent::Share(0.0));
    work(&|share| stage.share(share))
}

/// Begins the frames of a run.
pub(crate) fn frames(name: &str, count: usize) -> Stage {
    stage::enter(name, Extent::Frames(0, count as u64))
}
