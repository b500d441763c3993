//! The `insonify` command from outside: what others script against.

mod bad_input;
mod frames;
mod reports;
mod support;
