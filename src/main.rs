//! The `insonify` command.

fn main() -> std::process::ExitCode {
    quiet_mesa();
    insonify::cli::main()
}

/// Keeps Mesa's device selection layer, loaded by every adapter query, from printing an error where there is no display.
#[allow(unsafe_code, reason = "the environment is set before any other thread runs")]
fn quiet_mesa() {
    if std::env::var_os("NODEVICE_SELECT").is_none() {
        unsafe { std::env::set_var("NODEVICE_SELECT", "1") }
    }
}
