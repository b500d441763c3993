//! Building blocks of reports.
//!
//! | module | contents |
//! |---|---|
//! | [`gif`] | animated pictures |
//! | [`page`] | self-contained HTML pages |
//! | [`plot`] | scatter and line plots as SVG and pixels |

pub mod gif;
pub mod page;
pub mod plot;
