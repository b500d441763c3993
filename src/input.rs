//! Files that users write, resolved into scenes, insertions, static problems and tests of materials.

#[cfg(feature = "cli")]
pub mod beam_case;
mod error;
#[cfg(feature = "cli")]
pub mod identification;
#[cfg(feature = "cli")]
pub mod material_case;
pub mod scenario;
pub mod scene;
pub mod statics;

pub use error::{Cause, InputError};
