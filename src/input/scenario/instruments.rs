//! Needle and probe tables of a scenario file.

use std::fmt;

use schemars::JsonSchema;
use serde::de::value::SeqAccessDeserializer;
use serde::de::{Deserializer, SeqAccess, Visitor};
use serde::{Deserialize, Serialize};

use insonify_base::document::RegionName;
use insonify_base::kinds::{CommonKeys, KindTable};
use insonify_base::range::parameters;
use insonify_imaging::scene::{NeedleFrame, NeedleMotionSpec};
use insonify_mechanics::needle::NeedleModel;

parameters! {
    /// The needle. Its motion is that of an undeflected needle: base and direction are what the hand holds.
    #[schemars(rename = "NeedleTable")]
    pub struct CommonNeedleKeys {
        /// Bending model. Default `rigid`.
        model: NeedleModel;
        /// Length from base to tip. Default 150; 200 for `springs` and `beam`.
        length_mm: Option<f64>, in 0.1..=1000 "mm";
        /// Diameter. Default 1.27 (18 gauge); 1.28 for `springs` and `beam`.
        diameter_mm: Option<f64>, in 0.05..=10 "mm (18 gauge: 1.27)";
        /// In place of `motion`: target of a straight insertion and withdrawal, at `plan.speed_mm_s` and with
        /// `plan.pause_s`: the name of a label or tissue, a part of one (the largest matching label counts), or a label
        /// value. The tip goes to the innermost point of it in the image plane. A probe without a pose is placed over
        /// it, and a mesh without `box_mm` is made around the path.
        target: Option<String>;
        /// With `target`: entry point, `"beside the probe"` or a point on the skin (LPS), mm. Beside the probe is in
        /// the image plane, the nearest place 10 to 60 mm from an end of the array from which the path keeps 3 mm from
        /// bone and, if possible, meets no gas or lung. Default `"beside the probe"`.
        entry: Option<EntrySpec>;
        /// Frame of `motion`: `world`, or `probe`, in which case the needle goes where the probe goes. Default `world`.
        frame: Option<NeedleFrame>;
        /// Motion, as in a scene. Tip and direction are those of the undeflected needle. Not with `plan.needle` or
        /// `target`, which move it.
        motion: Option<NeedleMotionSpec>;
        /// Times at which a seed is deposited at the tip, s, ascending. Not with `plan.needle`, whose `seeds_mm` place
        /// the seeds.
        deposit_s: Vec<f64>;
    }
}

impl CommonKeys for CommonNeedleKeys {
    type Kind = NeedleModel;
    const FIELD: &'static str = "model";

    fn kind(&self) -> NeedleModel {
        self.model
    }
}

/// `[needle]`: keys of needles of every model, and those of its model.
pub type NeedleTable = KindTable<CommonNeedleKeys>;

/// Value of `entry` that searches for an entry in the image plane.
pub const BESIDE: &str = "beside the probe";

/// Entry point of a needle.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
#[serde(untagged)]
pub enum EntrySpec {
    /// `"beside the probe"`.
    Named(String),
    /// A point on the skin (LPS), mm.
    At([f64; 3]),
}

impl<'de> Deserialize<'de> for EntrySpec {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Either;
        impl<'de> Visitor<'de> for Either {
            type Value = EntrySpec;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "\"{BESIDE}\" or a point [x, y, z]")
            }

            fn visit_str<E>(self, name: &str) -> Result<Self::Value, E> {
                Ok(EntrySpec::Named(name.to_owned()))
            }

            fn visit_seq<A: SeqAccess<'de>>(self, point: A) -> Result<Self::Value, A::Error> {
                Deserialize::deserialize(SeqAccessDeserializer::new(point)).map(EntrySpec::At)
            }
        }
        deserializer.deserialize_any(Either)
    }
}

parameters! {
    /// The probe as a rigid cylinder in frictionless contact with tissue. It moves with the scene's probe, and tissue
    /// is at rest at its initial pose.
    pub struct ContactProbeSpec with required keys {
        /// Radius of the cylinder.
        radius_mm: f64, above 0..=100 "mm";
        /// Length of the cylinder behind its leading end.
        length_mm: f64, above 0..=1000 "mm";
        /// Direction of the cylinder's axis in the probe frame, towards the leading end; any length. Default `[0, 0,
        /// -1]`.
        axis: Option<[f64; 3]>;
        /// Centre of the leading end in the probe frame, mm. Default: on the axis of a cylinder on whose surface the
        /// centre of the array lies, level with it.
        end_mm: Option<[f64; 3]>;
        /// Restricts contact to nodes of this region on the surface of the mesh. Default: any region.
        surface_of: Option<RegionName>;
        /// Restricts contact to nodes within this distance of the cylinder's surface, anywhere along its motion.
        /// Default 4.
        within_mm: Option<f64>, in 0..=100 "mm";
        /// Takes every n-th ring of these nodes along the axis: fewer contacts, faster and coarser. A ring is about a
        /// node thick. Default 1.
        thinning: Option<u32>, in 1..=1000;
        /// Two points of the axis, mm behind the leading end, that drive the probe: its force is split between them.
        /// Default: all force acts at the end.
        driven_at_mm: Option<[f64; 2]>;
    }
}
