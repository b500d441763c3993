//! Files that users write, resolved into insertions and static problems.

mod material;
pub mod scenario;
pub mod selection;
pub mod statics;
