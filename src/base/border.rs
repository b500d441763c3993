//! The border to decoders of other crates: what a header promises is held against its file and the memory before they
//! are called, and a panic in them is an error.

use std::any::Any;
use std::cell::Cell;
use std::fmt::Display;
use std::io::{self, Read};
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::sync::Once;

use crate::memory;

/// Largest number of bytes that one byte of compressed data stands for: that of deflate (zlib, "An Explanation of the
/// Deflate Algorithm"). Pictures as JPEG and RLE stay below it.
pub const EXPANSION: u64 = 1032;

/// Memory that one decoded picture or data set may take, bytes.
pub const MOST: u64 = 1 << 30;

thread_local! {
    /// Whether this thread is inside a decoder.
    static DECODING: Cell<bool> = const { Cell::new(false) };
}

/// Panic of a decoder, with what it said.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("data at which the decoder fails ({0})")]
pub struct Panicked(String);

impl From<Panicked> for io::Error {
    fn from(panicked: Panicked) -> Self {
        io::Error::new(io::ErrorKind::InvalidData, panicked)
    }
}

/// Runs a decoder of another crate; a panic in it is an error, and prints nothing. The first call installs a panic hook
/// that is silent within decoders and otherwise calls the hook before it.
///
/// # Errors
/// [`Panicked`]; where panics abort the process, it ends as it would without this.
pub fn guarded<T>(decoder: impl FnOnce() -> T) -> Result<T, Panicked> {
    static QUIET: Once = Once::new();
    QUIET.call_once(|| {
        let loud = take_hook();
        set_hook(Box::new(move |panic| {
            if !DECODING.get() {
                loud(panic);
            }
        }));
    });
    let was_decoding = DECODING.replace(true);
    let outcome = catch_unwind(AssertUnwindSafe(decoder));
    DECODING.set(was_decoding);
    outcome.map_err(|payload| Panicked(text_of(payload.as_ref())))
}

/// Runs a decoder as [`guarded`] does; the error says what is wrong with the data.
///
/// # Errors
/// The error of the decoder, or its panic, in words.
pub fn decoded<T, E: Display>(decoder: impl FnOnce() -> Result<T, E>) -> Result<T, String> {
    guarded(decoder)
        .map_err(|panicked| panicked.to_string())?
        .map_err(|error| error.to_string())
}

fn text_of(payload: &(dyn Any + Send)) -> String {
    let text = payload.downcast_ref::<String>().map(String::as_str);
    let text = text.or_else(|| payload.downcast_ref::<&str>().copied());
    text.unwrap_or("for no stated reason")
        .lines()
        .collect::<Vec<_>>()
        .join(" ")
}

/// Reader of a decoder, in which a panic is an error of the data.
#[derive(Debug)]
pub struct Guarded<R>(pub R);

impl<R: Read> Read for Guarded<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        guarded(|| self.0.read(buffer))?
    }
}

/// Checks what a header promises before a decoder takes memory by it: `promised` bytes from `stored` compressed ones.
/// `what` names them.
///
/// # Errors
/// Invalid data if they cannot come from so few bytes or exceed [`MOST`]; out of memory if they exceed what is
/// available.
pub fn check(promised: u64, stored: u64, what: &str) -> io::Result<()> {
    let most = stored.saturating_mul(EXPANSION).min(MOST);
    if promised > most {
        let fault = format!("{what} of {promised} bytes from {stored} compressed ones, where {most} are the most");
        return Err(io::Error::new(io::ErrorKind::InvalidData, fault));
    }
    Ok(memory::check(promised, what)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_an_error_with_its_words_and_others_stay_panics() {
        let found = guarded(|| [1, 2, 3][std::hint::black_box(7)]);
        let text = found.expect_err("a panic").to_string();
        assert!(
            text.starts_with("data at which the decoder fails (index out of bounds"),
            "{text}"
        );
        assert_eq!(
            decoded(|| "x".parse::<u8>()),
            Err("invalid digit found in string".to_owned())
        );
        assert_eq!(decoded(|| "7".parse::<u8>()), Ok(7));
        // Within a decoder of a decoder, and behind it, the state is as before.
        let nested = guarded(|| {
            let inner = guarded(|| panic!("inner {}", 1));
            (inner.is_err(), DECODING.get())
        });
        assert_eq!(nested, Ok((true, true)));
        assert!(!DECODING.get());
    }

    #[test]
    fn a_reader_that_panics_has_invalid_data() {
        struct Broken;
        impl Read for Broken {
            fn read(&mut self, _: &mut [u8]) -> io::Result<usize> {
                panic!("broken\ntable")
            }
        }
        let error = Guarded(Broken).read(&mut [0; 4]).expect_err("a panic");
        assert_eq!(error.kind(), io::ErrorKind::InvalidData);
        assert_eq!(error.to_string(), "data at which the decoder fails (broken table)");
    }

    #[test]
    fn promises_are_held_against_the_file_and_the_memory() {
        assert!(check(1032, 1, "a picture").is_ok());
        for (promised, stored) in [(1033, 1), (1, 0), (MOST + 1, u64::MAX)] {
            let error = check(promised, stored, "a picture").expect_err("too much");
            assert_eq!(error.kind(), io::ErrorKind::InvalidData, "{promised}");
        }
    }
}
