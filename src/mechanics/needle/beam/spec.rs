//! Tables of a case file: needle, base, elements and layers, with the ranges of their numbers.

use super::{Compression, ModelName};
use insonify_base::kinds::{CommonKeys, KindTable};
use insonify_base::range::parameters;

parameters! {
    /// A round rod or tube; its bending stiffness follows from the material and the diameters, or is given.
    pub struct NeedleSpec {
        /// Young's modulus: 200 for steel.
        young_gpa: Option<f64>, in 1e-3..=1e4 "GPa";
        /// Outer diameter.
        diameter_mm: Option<f64>, in 0.01..=10 "mm";
        /// Inner diameter of a hollow needle, mm (0 to below the outer one). Default 0: solid.
        inner_diameter_mm: Option<f64>;
        /// Bending stiffness EI, in place of modulus and diameters.
        bending_stiffness_nmm2: Option<f64>, in 1e-6..=1e12 "N mm^2";
        /// Depth of the tip, mm (0 to the sum of the layers). Default: that sum.
        inserted_mm: Option<f64>;
        /// Measured shape: pairs of position along the undeflected needle and deflection, mm, from base to tip
        /// (`insonify beam measure`). It is drawn, and compared with the computed shape (`insonify beam compare`).
        measured_mm: Option<Vec<[f64; 2]>>;
    }
}

parameters! {
    /// Motion of the base.
    pub struct BaseSpec with required keys {
        /// Distance from the base to the point of entry.
        control_distance_mm: f64, in 0..=1e4 "mm";
        /// Lateral displacement; with `pivot_mm` that of the axis.
        displacement_mm: f64, in -1e6..=1e6 "mm";
        /// Slope du/dx. Default: the base rotates freely, without moment.
        slope: Option<f64>, in -1e6..=1e6;
        /// Without `slope`: distance from the base back to the axis about which it rotates freely. Default 0.
        pivot_mm: Option<f64>, in 0..=1e4 "mm";
    }
}

parameters! {
    /// Discretisation of the needle.
    pub struct MeshSpec {
        /// Longest element.
        element_mm: f64 = 1.0, above 0 "mm";
    }
}

parameters! {
    /// A tissue layer.
    pub struct LayerSpec with required keys {
        /// Thickness.
        thickness_mm: f64, above 0..=1e4 "mm";
        /// Hyperelastic model.
        model: ModelName;
        /// Compression model and stress measure.
        compression: Compression;
        /// Uncompressed length of the tissue beside the needle, mm (above 0); `inf`: it stays linear.
        initial_length_mm: f64;
        /// Friction between needle and tissue. Default 0.
        #[serde(default)]
        friction: f64, in 0..=1;
        /// Compression ratio (length over uncompressed length) below which `insonify beam inverse` rejects a motion of
        /// the base. Default 0: no limit.
        #[serde(default)]
        min_compression_ratio: f64, in 0..1;
    }
}

impl CommonKeys for LayerSpec {
    type Kind = ModelName;
    const FIELD: &'static str = "model";

    fn kind(&self) -> ModelName {
        self.model
    }
}

/// `[[layer]]`: keys of layers of every model, and those of its model.
pub type LayerTable = KindTable<LayerSpec>;
