//! Terminal output: results on standard output, everything else on standard error.

use std::borrow::Cow;
use std::env;
use std::fmt::{self, Display};
use std::io::{self, IsTerminal, Write};
use std::sync::atomic::{AtomicBool, Ordering};

use indicatif::{ProgressBar, ProgressState, ProgressStyle};
use insonify_base::document::InputError;
use insonify_base::text::{MESSAGE, clipped, printable};
use serde::Serialize;

use super::excerpt::drawn;
use super::failure::{Error, Failure};

/// Writes a result to standard output. A reader that stops reading causes no failure.
pub(crate) fn emit(text: &str) -> Result<(), Error> {
    let mut out = io::stdout().lock();
    let line_end = if text.ends_with('\n') { "" } else { "\n" };
    match write!(out, "{}{line_end}", printable(text)).and_then(|()| out.flush()) {
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

/// Suppresses all output except results and errors.
pub(crate) fn quieten() {
    QUIET.store(true, Ordering::Relaxed);
}

fn is_quiet() -> bool {
    QUIET.load(Ordering::Relaxed)
}

/// Writes to standard error unless quiet; a closed stream causes no failure.
pub(crate) fn say(text: impl Display) {
    if is_quiet() {
        return;
    }
    let _ = writeln!(io::stderr().lock(), "{}", printable(&text.to_string()));
}

/// Prints a warning on one line.
pub(crate) fn warn(text: impl Display) {
    say(clipped(&format!("warning: {text}"), MESSAGE));
}

/// Prints a note on one line.
pub(crate) fn note(text: impl Display) {
    say(clipped(&format!("note: {text}"), MESSAGE));
}

/// Prints a failure with the lines of the file concerned.
pub(crate) fn report(error: &Error) {
    let message = clipped(&error.to_string(), MESSAGE);
    let help = error.help().map(|help| clipped(help, MESSAGE));
    let excerpt = error.input().and_then(InputError::excerpt);
    let text = drawn(&message, help.as_deref(), excerpt, has_colours());
    // Not through `say`: the colours are intended.
    let _ = writeln!(io::stderr().lock(), "{text}");
}

/// Whether standard error is a terminal that shows colours and the user allows them (<https://no-color.org>).
fn has_colours() -> bool {
    let refused = env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty());
    io::stderr().is_terminal() && !refused && env::var_os("TERM").is_none_or(|name| name != "dumb")
}

/// Number of steps of the bar created by [`share`].
pub(crate) const SHARES: u64 = 1000;

/// Progress bar of a single task; hidden where standard error is not a terminal, and on request.
pub(crate) fn share() -> ProgressBar {
    if is_quiet() {
        return ProgressBar::hidden();
    }
    styled(ProgressBar::new(SHARES), "{bar:40} {percent} %, {eta} left  {msg}")
}

/// Shows a progress bar with a message during `work`, which reports the completed fraction.
pub(crate) fn with_bar<T>(message: &'static str, work: impl FnOnce(&(dyn Fn(f64) + Sync)) -> T) -> T {
    let bar = share();
    bar.set_message(message);
    let result = work(&|share| bar.set_position((share * SHARES as f64) as u64));
    bar.finish_and_clear();
    result
}

/// Progress bar over the frames of a run; hidden where standard error is not a terminal, for a single frame, and on
/// request.
pub(crate) fn progress(frames: usize) -> ProgressBar {
    if is_quiet() || frames < 2 {
        return ProgressBar::hidden();
    }
    // Hides itself where standard error is not a terminal.
    styled(
        ProgressBar::new(frames as u64),
        "{bar:40} {pos}/{len} frames, {rate} a second, {eta} left",
    )
}

/// Steps a second, as a whole number.
fn rate(state: &ProgressState, text: &mut dyn fmt::Write) {
    let _ = write!(text, "{:.0}", state.per_sec());
}

fn styled(bar: ProgressBar, template: &str) -> ProgressBar {
    match ProgressStyle::with_template(template) {
        Ok(style) => bar.with_style(style.with_key("rate", rate)),
        Err(_) => bar,
    }
}
