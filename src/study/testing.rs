//! Small scene and small study for tests.

use std::sync::OnceLock;

use crate::tradeoff::Study;
use crate::tradeoff::insertion::{InsertionOptions, Part, study};

/// Study of insertions into a block of some 300 nodes, made once: levels, thinning, links and elements.
pub fn insertions() -> &'static Study {
    static STUDY: OnceLock<Study> = OnceLock::new();
    STUDY.get_or_init(|| {
        let options = InsertionOptions {
            nodes: 300,
            depth_mm: 12.0,
            bevel_depth_mm: 20.0,
            passes: 1,
            parts: vec![Part::Levels, Part::Thinning, Part::Links, Part::Elements],
            ..InsertionOptions::default()
        };
        study(&options, &mut |_, _| {}).unwrap()
    })
}
