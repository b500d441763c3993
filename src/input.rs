//! Files that users write, resolved into insertions and static problems.

mod law;
pub mod scenario;
pub mod statics;
