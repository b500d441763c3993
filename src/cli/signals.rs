//! What an interrupt, a request to end or a limit of the system does to a run.

use std::io;

/// Ends the program on SIGINT, SIGTERM and SIGHUP with the status that shells give them, and nothing left of what is in the making; a
/// file that grows beyond its limit is an error of the write.
#[cfg(unix)]
pub fn watch() -> io::Result<()> {
    use std::sync::Arc;
    use std::thread;

    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGXFSZ};
    use signal_hook::iterator::Signals;
    use signal_hook::{flag, low_level};

    flag::register(SIGXFSZ, Arc::default())?;
    let mut signals = Signals::new([SIGINT, SIGTERM, SIGHUP])?;
    thread::Builder::new().name("signals".to_owned()).spawn(move || {
        if let Some(signal) = signals.forever().next() {
            insonify::output::abandon();
            low_level::exit(128 + signal);
        }
    })?;
    Ok(())
}

/// Elsewhere the next run clears what an interrupt leaves.
#[cfg(not(unix))]
pub fn watch() -> io::Result<()> {
    Ok(())
}
