//! Handling of interrupts, termination requests and system limits.

use std::io;

/// Ends the program on SIGINT, SIGTERM and SIGHUP with the conventional shell status, after removing unfinished output; a file that
/// exceeds the size limit is a write error.
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
            crate::base::output::abandon();
            low_level::exit(128 + signal);
        }
    })?;
    Ok(())
}

/// On other systems, the next run removes what an interrupt leaves.
#[cfg(not(unix))]
pub fn watch() -> io::Result<()> {
    Ok(())
}
