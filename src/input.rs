//! Files that users write, resolved into scenes, insertions, static problems and tests of materials.

pub mod beam_case;
mod error;
pub mod identification;
pub mod material_case;
pub mod scenario;
pub mod scene;
pub mod statics;

pub use error::{Cause, InputError};
