//! What the test binaries share: small analytic anatomies, scene settings, a GPU or a visible skip, image comparison.
#![allow(
    dead_code,
    unused_imports,
    reason = "each test binary uses its own part of what is shared"
)]

pub(crate) use insonify_imaging::anatomies as anatomy;
pub(crate) mod gpu;
pub(crate) mod image;
pub(crate) mod scene;
pub(crate) mod stats;
