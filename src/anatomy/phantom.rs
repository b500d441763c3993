//! Labelled volumes generated from code: anatomy built from smooth solids, byte-identical for the same seed.
//!
//! World coordinates are LPS millimetres with the origin inside the body. Label 0 is the outside; the other labels carry
//! the names of their tissues, so that a tissue table needs no mapping.

mod abdomen;
mod geometry;
mod liver_vein;
mod paint;
mod prostate;
mod spine;
mod two_layer;
mod vessels;

use nalgebra::{Matrix4, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::volume::{LabelVolume, VolumeError};

/// Finest and coarsest resolution, mm.
const RESOLUTION_RANGE_MM: [f64; 2] = [0.3, 5.0];

/// Maximum number of voxels of a phantom: one byte each, so 256 MiB.
pub(crate) const MAX_VOXELS: usize = 256 << 20;

/// A built-in phantom.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Phantom {
    /// Right upper and middle abdomen of a slim adult: liver with vessels and a lesion, gallbladder, right kidney, ribs,
    /// bowel with gas. 240 x 200 x 228 mm, 1 mm voxels by default.
    #[default]
    Abdomen,
    /// Male pelvis around the prostate, with a rectum that holds a transrectal probe in gel. 110 x 110 x 120 mm, 0.6 mm
    /// voxels by default.
    Prostate,
    /// Lumbar spine L2 to L5 with the muscles behind it. 160 x 130 x 170 mm, 0.8 mm voxels by default.
    Spine,
    /// The inclusion phantom of Dehghan et al. 2008: a harder inclusion in a softer block, with a hole for a probe. 90 x 80 x 90 mm,
    /// 0.5 mm voxels by default.
    TwoLayer,
    /// An exposed liver, its inferior vena cava across the image, after the experiment of Kobayashi et al. 2010. 110 x
    /// 74 x 48 mm, 0.5 mm voxels by default.
    LiverVein,
}

/// Options for generating a phantom.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PhantomOptions {
    /// Voxel edge, mm (0.3 to 5); `None` uses the phantom's default.
    pub resolution_mm: Option<f64>,
    /// Seed of all irregularity: organ surfaces, the course of vessels, bowel gas.
    pub seed: u64,
}

/// Generates a phantom. The same kind, resolution and seed give the same bytes at any thread count.
///
/// # Errors
/// A resolution outside its range, or a volume past [`MAX_VOXELS`].
pub fn make(kind: Phantom, options: &PhantomOptions) -> Result<LabelVolume, VolumeError> {
    let resolution_mm = options.resolution_mm.unwrap_or(match kind {
        Phantom::Abdomen => 1.0,
        Phantom::Prostate => 0.6,
        Phantom::Spine => 0.8,
        Phantom::TwoLayer | Phantom::LiverVein => 0.5,
    });
    let [finest, coarsest] = RESOLUTION_RANGE_MM;
    if !(finest..=coarsest).contains(&resolution_mm) {
        let text = format!("resolution {resolution_mm} mm; expected {finest} to {coarsest} mm");
        return Err(VolumeError::option("resolution_mm", text));
    }
    match kind {
        Phantom::Abdomen => abdomen::make(resolution_mm, options.seed),
        Phantom::Prostate => prostate::make(resolution_mm, options.seed),
        Phantom::Spine => spine::make(resolution_mm, options.seed),
        Phantom::TwoLayer => two_layer::make(resolution_mm),
        Phantom::LiverVein => liver_vein::make(resolution_mm),
    }
}

/// Value and name of each label of a phantom, in order of value from 1. The names are tissue names.
#[cfg(test)]
pub fn labels(kind: Phantom) -> &'static [(u8, &'static str)] {
    match kind {
        Phantom::Abdomen => abdomen::labels::TABLE,
        Phantom::Prostate => prostate::labels::TABLE,
        Phantom::Spine => spine::labels::TABLE,
        Phantom::TwoLayer => two_layer::labels::TABLE,
        Phantom::LiverVein => liver_vein::labels::TABLE,
    }
}

/// Default pose (probe to world, LPS mm) for a phantom:
///
/// - abdomen: curvilinear, radius 60 mm, 70 degrees, depth 150 mm, right subcostal and oblique to the sagittal plane, feet
///   on the right of the image: liver with its vessels, gallbladder and right kidney, a rib's shadow at the left edge.
///   The skin bears the dent of this probe.
/// - prostate: transrectal, transverse, radius 10 mm, in the middle of the gland.
/// - spine: curvilinear, radius 60 mm, 60 degrees, depth 100 mm, sagittal over the laminae, from behind, feet on the right.
///   The skin bears the dent of this probe.
/// - two-layer: linear, 38 mm wide, depth 75 mm, on the face opposite to that where the needle enters (Dehghan et al. 2008, "Experimental
///   setup").
/// - liver-vein: curvilinear, radius 20 mm, 75 degrees, depth 62 mm, on the capsule, the vein across the image.
pub fn default_pose(kind: Phantom) -> Matrix4<f64> {
    match kind {
        Phantom::Abdomen => abdomen::pose(),
        Phantom::Prostate => prostate::pose(),
        Phantom::Spine => spine::pose(),
        Phantom::TwoLayer => two_layer::pose(),
        Phantom::LiverVein => liver_vein::pose(),
    }
}

/// Probe-to-world matrix from the array's centre, the direction into the body and a direction towards the marked side
/// (orthogonalised to it).
fn pose_at(origin: Vector3<f64>, axial: Vector3<f64>, towards_mark: Vector3<f64>) -> Matrix4<f64> {
    let [y, x, minus_z] = geometry::frame(axial, towards_mark);
    let z = -minus_z;
    Matrix4::new(
        x.x, y.x, z.x, origin.x, //
        x.y, y.y, z.y, origin.y, //
        x.z, y.z, z.z, origin.z, //
        0.0, 0.0, 0.0, 1.0,
    )
}

/// Declares the named label values of a phantom and their table.
macro_rules! label_table {
    ($($label:ident = $value:literal $name:literal,)*) => {
        $(pub(in crate::phantom) const $label: u8 = $value;)*
        /// Value and name of each label.
        pub(in crate::phantom) const TABLE: &[(u8, &str)] = &[$(($value, $name)),*];
    };
}
use label_table;

#[cfg(test)]
mod tests;
