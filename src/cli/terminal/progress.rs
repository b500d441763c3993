//! Progress of a command on standard error: a bar on a terminal, elsewhere a line now and then.

use std::io::{self, IsTerminal, Write};
use std::sync::OnceLock;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::thread;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};
use insonify_base::stage::{self, Extent, Stage, State};
use insonify_base::text::{head, printable};

/// When progress is shown: for the first time, and then.
struct Pace {
    first: Duration,
    every: Duration,
}

const OF_LINES: Pace = Pace {
    first: Duration::from_secs(2),
    every: Duration::from_secs(10),
};
const OF_BAR: Pace = Pace {
    first: Duration::from_millis(300),
    every: Duration::from_millis(100),
};

/// Width of a bar, and of the text beside it, columns.
const BAR: usize = 24;
const TEXT: usize = 54;

/// Fraction from which the time left is told: earlier it is a guess.
const TOLD_FROM: f64 = 0.02;

/// The line at the bottom of a terminal.
static BOTTOM: OnceLock<ProgressBar> = OnceLock::new();

/// A command whose progress is shown, until it is dropped.
pub(crate) struct Shown {
    _command: Stage,
    _stop: Sender<()>,
}

/// Shows the progress of a command of this name from now on.
pub(crate) fn show(command: &str) -> Shown {
    let (sender, stop) = mpsc::channel();
    if io::stderr().is_terminal() {
        let bar = BOTTOM.get_or_init(|| match ProgressStyle::with_template("{msg}") {
            Ok(style) => ProgressBar::new_spinner().with_style(style),
            Err(_) => ProgressBar::hidden(),
        });
        thread::spawn(move || tick(&OF_BAR, &stop, |state| bar.set_message(with_bar(state))));
    } else {
        thread::spawn(move || {
            tick(&OF_LINES, &stop, |state| {
                let _ = writeln!(io::stderr().lock(), "progress: {}", printable(&line(state)));
            });
        });
    }
    Shown {
        _command: stage::enter(command, Extent::Unknown),
        _stop: sender,
    }
}

impl Drop for Shown {
    fn drop(&mut self) {
        if let Some(bar) = BOTTOM.get() {
            bar.finish_and_clear();
        }
    }
}

/// Prints something while the bar is out of the way.
pub(super) fn aside<T>(print: impl FnOnce() -> T) -> T {
    match BOTTOM.get() {
        Some(bar) => bar.suspend(print),
        None => print(),
    }
}

/// Shows the work under way at a pace, until the other end of `stop` is dropped.
fn tick(pace: &Pace, stop: &Receiver<()>, mut show: impl FnMut(&State)) {
    let mut wait = pace.first;
    while stop.recv_timeout(wait) == Err(RecvTimeoutError::Timeout) {
        if let Some(state) = stage::current() {
            show(&state);
        }
        wait = pace.every;
    }
}

/// Name of the work, its progress, and the time left.
fn line(state: &State) -> String {
    told(state, state.begun.elapsed())
}

fn told(state: &State, elapsed: Duration) -> String {
    let how_far = match state.extent {
        Extent::Unknown => String::new(),
        Extent::Share(share) => format!("{:.0} %, ", 100.0 * share),
        Extent::Frames(done, count) => format!("{done} of {count} frames, "),
    };
    let share = share(state.extent);
    let left = if share >= TOLD_FROM {
        let left_s = elapsed.as_secs_f64() * (1.0 - share) / share;
        format!(", some {} left", duration(left_s))
    } else {
        String::new()
    };
    format!(
        "{}: {how_far}{} so far{left}",
        state.name,
        duration(elapsed.as_secs_f64())
    )
}

fn share(extent: Extent) -> f64 {
    match extent {
        Extent::Unknown => 0.0,
        Extent::Share(share) => share.clamp(0.0, 1.0),
        Extent::Frames(done, count) => (done as f64 / count.max(1) as f64).min(1.0),
    }
}

fn duration(seconds: f64) -> String {
    match seconds {
        seconds if seconds < 120.0 => format!("{seconds:.0} s"),
        seconds if seconds < 7200.0 => format!("{:.0} min", seconds / 60.0),
        seconds => format!("{:.1} h", seconds / 3600.0),
    }
}

fn with_bar(state: &State) -> String {
    let text = head(&line(state), TEXT);
    if state.extent == Extent::Unknown {
        return text;
    }
    let full = (share(state.extent) * BAR as f64) as usize;
    format!("{}{} {text}", "█".repeat(full), "░".repeat(BAR - full))
}

#[cfg(test)]
mod tests {
    use std::time::Instant;

    use super::*;

    fn state(extent: Extent) -> State {
        let stage = stage::enter("rendering", extent);
        let state = stage::current().expect("work under way");
        drop(stage);
        state
    }

    #[test]
    fn a_line_tells_what_how_far_and_how_long() {
        let after = |extent, seconds| told(&state(extent), Duration::from_secs(seconds));
        assert_eq!(after(Extent::Unknown, 12), "rendering: 12 s so far");
        assert_eq!(
            after(Extent::Share(0.25), 100),
            "rendering: 25 %, 100 s so far, some 5 min left"
        );
        assert_eq!(
            after(Extent::Frames(21, 84), 4),
            "rendering: 21 of 84 frames, 4 s so far, some 12 s left"
        );
        assert_eq!(after(Extent::Share(0.0), 4), "rendering: 0 %, 4 s so far");
    }

    #[test]
    fn short_work_says_nothing_and_long_work_says_so_at_its_pace() {
        let pace = |first, every| Pace {
            first: Duration::from_millis(first),
            every: Duration::from_millis(every),
        };
        let _stage = stage::enter("some work", Extent::Unknown);
        let shown_in = |pace: Pace, ms| {
            let (sender, stop) = mpsc::channel::<()>();
            let thread = thread::spawn(move || {
                let mut times = Vec::new();
                tick(&pace, &stop, |_| times.push(Instant::now()));
                times
            });
            thread::sleep(Duration::from_millis(ms));
            drop(sender);
            thread.join().expect("times")
        };
        assert!(shown_in(pace(60_000, 1), 20).is_empty());
        assert_eq!(shown_in(pace(1, 60_000), 200).len(), 1);
        let often = shown_in(pace(1, 20), 400);
        assert!(often.len() > 2, "{often:?}");
        assert!(
            often
                .windows(2)
                .all(|pair| pair[1] - pair[0] >= Duration::from_millis(20))
        );
    }
}
