//! Labelled volumes generated from code: anatomy built from smooth solids, byte-identical for the same seed.
//!
//! World coordinates are LPS millimetres with the origin inside the body. Label 0 is the outside; the other labels
//! carry the names of their tissues, so that a tissue table needs no mapping.

mod geometry;
mod paint;
mod vessels;

use nalgebra::{Matrix4, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::volume::{LabelVolume, VolumeError};

/// Finest and coarsest resolution, mm.
const RESOLUTION_RANGE_MM: [f64; 2] = [0.3, 5.0];

/// Maximum number of voxels of a phantom: one byte each, so 256 MiB.
pub(crate) const MAX_VOXELS: usize = 256 << 20;

/// Declaration of a phantom, one in each of their files.
struct Facts {
    /// Voxel edge by default, mm.
    voxel_mm: f64,
    /// Makes it, given the voxel edge in mm and the seed.
    make: fn(f64, u64) -> Result<LabelVolume, VolumeError>,
    /// Default pose of the probe.
    pose: fn() -> Matrix4<f64>,
    /// Probe of that pose.
    probe: UsualProbe,
}

/// Probe of a phantom's default pose, as in the `[probe]` of a scene.
#[derive(Clone, Copy, Debug)]
pub struct UsualProbe {
    /// Name of its kind.
    pub kind: &'static str,
    /// Numbers of the kind, by key.
    pub numbers: &'static [(&'static str, f64)],
    /// Length of its scanlines, mm.
    pub depth_mm: f64,
}

/// Declares the phantoms, each with its module.
macro_rules! phantoms {
    ($($(#[$meta:meta])* $module:ident: $Kind:ident;)+) => {
        $(mod $module;)+

        /// A built-in phantom.
        ///
        /// ```
        /// use insonify_anatomy::phantom::{Phantom, PhantomOptions, default_pose, make, usual_probe};
        /// use nalgebra::Point3;
        ///
        /// let phantom = Phantom::LiverVein;
        /// let volume = make(phantom, &PhantomOptions { resolution_mm: Some(2.0), seed: 7 })?;
        /// assert!(volume.labels().iter().any(|label| label.name.as_deref() == Some("liver")));
        ///
        /// // Its probe looks into the tissue.
        /// let seen = Point3::new(0.0, usual_probe(phantom).depth_mm / 2.0, 0.0);
        /// let label = volume.label_index_at(&default_pose(phantom).transform_point(&seen));
        /// assert!(label.is_some_and(|label| label > 0));
        ///
        /// let names = Phantom::ALL.iter().map(serde_json::to_string).collect::<Result<Vec<_>, _>>()?;
        /// assert!(names.contains(&"\"liver-vein\"".into()));
        /// # Ok::<(), Box<dyn std::error::Error>>(())
        /// ```
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
        #[serde(rename_all = "kebab-case")]
        pub enum Phantom {
            $($(#[$meta])* $Kind,)+
        }

        impl Phantom {
            /// All phantoms.
            pub const ALL: &'static [Self] = &[$(Self::$Kind),+];

            fn facts(self) -> &'static Facts {
                match self {
                    $(Self::$Kind => &$module::PHANTOM,)+
                }
            }
        }

        /// Value and name of each label of a phantom, in order of value from 1. The names are tissue names.
        #[cfg(test)]
        pub fn labels(kind: Phantom) -> &'static [(u8, &'static str)] {
            match kind {
                $(Phantom::$Kind => $module::labels::TABLE,)+
            }
        }
    };
}

phantoms! {
    /// Right upper and middle abdomen of a slim adult: liver with vessels and a lesion, gallbladder, right kidney,
    /// ribs, bowel with gas. 240 x 200 x 228 mm, 1 mm voxels by default.
    #[default]
    abdomen: Abdomen;
    /// Male pelvis around the prostate, with a rectum that holds a transrectal probe in gel. 110 x 110 x 120 mm, 0.6 mm
    /// voxels by default.
    prostate: Prostate;
    /// Lumbar spine L2 to L5 with the muscles behind it. 160 x 130 x 170 mm, 0.8 mm voxels by default.
    spine: Spine;
    /// The inclusion phantom of Dehghan et al. 2008: a harder inclusion in a softer block, with a hole for a probe. 90
    /// x 80 x 90 mm, 0.5 mm voxels by default.
    two_layer: TwoLayer;
    /// An exposed liver, its inferior vena cava across the image, after the experiment of Kobayashi et al. 2010. 110 x
    /// 74 x 48 mm, 0.5 mm voxels by default.
    liver_vein: LiverVein;
    /// Vessels and nerves of a limb or the neck across a linear probe, the region by the seed. 64 x 62 x 20 mm, 0.3 mm
    /// voxels by default.
    limb: Limb;
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
/// ```
/// use insonify_anatomy::phantom::{Phantom, PhantomOptions, make};
/// use insonify_anatomy::volume::{load, save};
///
/// let options = PhantomOptions { resolution_mm: Some(5.0), ..PhantomOptions::default() };
/// let volume = make(Phantom::TwoLayer, &options)?;
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("block.nrrd");
/// save(&volume, &path)?;
/// let loaded = load(&path)?.volume;
/// assert_eq!((loaded.size(), loaded.spacing_mm()), (volume.size(), [5.0; 3]));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// A resolution outside its range, or a volume past `MAX_VOXELS`.
pub fn make(kind: Phantom, options: &PhantomOptions) -> Result<LabelVolume, VolumeError> {
    let facts = kind.facts();
    let resolution_mm = options.resolution_mm.unwrap_or(facts.voxel_mm);
    let [finest, coarsest] = RESOLUTION_RANGE_MM;
    if !(finest..=coarsest).contains(&resolution_mm) {
        let text = format!("resolution {resolution_mm} mm; expected {finest} to {coarsest} mm");
        return Err(VolumeError::option("resolution_mm", text));
    }
    (facts.make)(resolution_mm, options.seed)
}

/// Default pose (probe to world, LPS mm) for a phantom.
pub fn default_pose(kind: Phantom) -> Matrix4<f64> {
    (kind.facts().pose)()
}

/// Probe that a phantom's default pose is meant for.
pub fn usual_probe(kind: Phantom) -> UsualProbe {
    kind.facts().probe
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
