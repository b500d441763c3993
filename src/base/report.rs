//! Building blocks of reports: tables, pages, plots, numbers, statistics and the choice among variants.
//!
//! | module | contents |
//! |---|---|
//! | [`machine`] | description of the CPU in use |
//! | [`number`] | numbers as text |
//! | [`page`] | self-contained HTML pages |
//! | [`pareto`] | Pareto fronts, and the least error within a cost |
//! | [`plot`] | scatter and line plots as SVG and pixels |
//! | [`statistics`] | moments, correlations and percentiles of samples |
//! | [`table`] | tables as text, Markdown, CSV and HTML |

pub mod machine;
pub mod number;
pub mod page;
pub mod pareto;
#[cfg(feature = "cli")]
pub mod plot;
pub mod statistics;
pub mod table;
