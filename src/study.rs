//! Measurements that the program makes of itself, and what it can say of its own frames.
//!
//! | file | what it holds |
//! |---|---|
//! | [`mod@bench`] | times of frames, of passes, and of frames from which effects are taken away |
//! | [`mod@inspect`] | what made one pixel |
//! | [`machine`] | what the CPU backend runs on |

pub mod bench;
pub mod inspect;
pub mod machine;
pub mod plot;
#[cfg(test)]
pub(crate) mod testing;
