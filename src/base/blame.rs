//! Who is at fault for an error: the user or the machine.

use std::fmt;

use super::document::InputError;

/// An error that says who is at fault: the user, unless it says otherwise.
/// ```
/// use insonify_base::blame::{Blame, Error};
///
/// #[derive(Debug, thiserror::Error)]
/// enum Trial {
///     #[error("trial {0} is not among the ten")]
///     Number(usize),
///     #[error("the device is gone")]
///     Device,
/// }
///
/// impl Blame for Trial {
///     fn is_machine(&self) -> bool {
///         matches!(self, Self::Device)
///     }
/// }
///
/// fn trial(number: usize) -> Result<usize, Error> {
///     match number {
///         0..10 => Ok(number),
///         10 => Err(Trial::Device.into()),
///         _ => Err(Trial::Number(number).into()),
///     }
/// }
///
/// assert_eq!(trial(10).unwrap_err().exit_status(), 1);
/// let error = trial(12).unwrap_err();
/// assert_eq!(error.exit_status(), 2);
/// assert!(matches!(error.downcast_ref(), Some(Trial::Number(12))));
/// ```
pub trait Blame: std::error::Error + Send + Sync + 'static {
    /// Whether the machine is at fault rather than the input: an existing file cannot be read, memory is too small, or
    /// a device failed.
    fn is_machine(&self) -> bool {
        false
    }

    /// The error of an input file that this error is or carries.
    fn input(&self) -> Option<&InputError> {
        None
    }

    /// What to do instead, if it is known.
    fn help(&self) -> Option<&str> {
        self.input()?.help()
    }
}

/// Any error that says who is at fault: what `?` makes of the errors of all parts.
pub struct Error(Box<dyn Blame>);

impl<E: Blame> From<E> for Error {
    fn from(error: E) -> Self {
        Self(Box::new(error))
    }
}

impl Error {
    /// The error itself, if it has this type.
    pub fn downcast_ref<E: Blame>(&self) -> Option<&E> {
        let error: &(dyn std::error::Error + 'static) = &*self.0;
        error.downcast_ref()
    }

    /// The error of an input file that this error is or carries.
    pub fn input(&self) -> Option<&InputError> {
        self.0.input()
    }

    /// What to do instead, if it is known.
    pub fn help(&self) -> Option<&str> {
        self.0.help()
    }

    /// Exit status of the program: 1 if the machine is at fault, 2 if the user can correct the request.
    pub fn exit_status(&self) -> u8 {
        if self.0.is_machine() { 1 } else { 2 }
    }
}

impl fmt::Debug for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(&self.0, f)
    }
}

// Not `Blame`: `From` of every error that is would then contradict `From` of `Error` itself.
impl std::error::Error for Error {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        self.0.source()
    }
}

#[cfg(test)]
mod tests {
    use std::io;
    use std::path::Path;

    use super::*;
    use crate::document::{self, InvalidFile};
    use crate::output::OutputError;

    #[test]
    fn input_is_told_from_machine() {
        let full = OutputError::write(Path::new("frame.png"), io::Error::from(io::ErrorKind::StorageFull));
        assert_eq!(Error::from(full).exit_status(), 1);
        let missing = Error::from(document::read(Path::new("/nowhere/scene.toml")).unwrap_err());
        assert_eq!(missing.exit_status(), 2);
        assert!(missing.input().is_some() && missing.downcast_ref::<InputError>().is_some());
        assert!(missing.downcast_ref::<InvalidFile>().is_none());
    }

    #[test]
    fn errors_of_files_carry_their_help() {
        let wrong = InputError::new(InvalidFile::name("a", "b")).with_help(Some("write b".to_owned()));
        let (text, error) = (wrong.to_string(), Error::from(wrong));
        assert_eq!((error.to_string(), error.help()), (text, Some("write b")));
    }
}
