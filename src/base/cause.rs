//! Who is at fault for an error: the user or the machine.

use super::document::InputError;

/// An error that says whether the user or the machine is at fault.
pub trait Cause: std::error::Error + Send + Sync + 'static {
    /// Whether the machine is at fault rather than the input: an existing file cannot be read, memory is too small, or a device failed.
    fn is_machine(&self) -> bool {
        false
    }

    /// The error of an input file that this error is or carries.
    fn input(&self) -> Option<&InputError> {
        None
    }
}
