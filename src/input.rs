//! Files that users write, resolved into insertions and static problems.

pub mod scenario;
pub mod statics;
