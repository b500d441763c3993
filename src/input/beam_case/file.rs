//! Case file of a beam.

use std::sync::Arc;

use schemars::JsonSchema;
use serde::Deserialize;

use crate::base::document::{self, Source, Version};
use crate::input::Cause;
use crate::mechanics::needle::beam::spec::{BaseSpec, LayerSpec, MeshSpec, NeedleSpec};

/// A needle in layers of tissue whose base is moved sideways. It lies along x, from the base (before 0) through the entry (0) to
/// the tip; u is its lateral deflection.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CaseFile {
    /// Version of the format: 1, which is the default.
    pub version: Option<Version>,
    /// The needle.
    pub needle: NeedleSpec,
    /// Motion of the base.
    pub base: BaseSpec,
    /// Discretisation of the needle.
    #[serde(default)]
    pub mesh: MeshSpec,
    /// Tissue layers, starting at the entry.
    #[serde(default)]
    pub layer: Vec<LayerSpec>,
    /// Source text, for errors that point into it.
    #[serde(skip)]
    pub(super) source: Option<Arc<Source>>,
}

document::input_file!(CaseFile, Cause, in_ranges);
