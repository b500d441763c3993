//! Labelled volumes made from code.
