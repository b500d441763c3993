//! Models of needles as files state them.

use super::{Needle, Shaft};
use insonify_base::range::OutOfRange;

/// Keys of a model of needles in files, and what is built from them. Keys of the same name in several models have the
/// same type and text.
pub(super) trait Keys {
    /// Length and diameter of a needle that states none, mm. `None`: those of any needle.
    fn usual_mm(&self) -> Option<[f64; 2]> {
        None
    }

    /// Checks the keys against each other and the shaft.
    ///
    /// # Errors
    /// [`OutOfRange`] with the key.
    fn check(&self, _shaft: &Shaft) -> Result<(), OutOfRange> {
        Ok(())
    }

    /// Builds the needle.
    ///
    /// # Errors
    /// [`OutOfRange`] with the key.
    fn needle(&self, shaft: Shaft) -> Result<Box<dyn Needle>, OutOfRange>;

    /// Whether the needle goes straight along its axis through tissue.
    fn is_straight(&self) -> bool {
        false
    }
}

/// Refuses the first of two keys where both are stated.
pub(super) fn one_of([(key, first), (other, second)]: [(&str, Option<f64>); 2]) -> Result<(), OutOfRange> {
    if first.is_some() && second.is_some() {
        Err(OutOfRange::new(
            key,
            format!("both `{key}` and `{other}`"),
            "one of them",
        ))
    } else {
        Ok(())
    }
}

/// Declares the models: the names of files, each with its module, the type of its keys and its description.
macro_rules! needle_models {
    ($($(#[$default:meta])? $name:literal $module:ident: $Model:ident($Keys:ident) = $doc:literal;)+) => {
        $(mod $module; pub use $module::$Keys;)+

        /// Bending model of a needle.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
        pub enum NeedleModel {
            $(
                $(#[$default])?
                #[doc = $doc]
                #[serde(rename = $name)]
                $Model,
            )+
        }

        /// Keys of a needle, by model.
        #[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
        #[serde(untagged)]
        pub enum NeedleKeys {
            $(#[doc = $doc] $Model($Keys),)+
        }

        impl insonify_base::kinds::KeyedKind for NeedleModel {
            type Keys = NeedleKeys;
            const ALL: &'static [Self] = &[$(Self::$Model),+];

            fn keys(self) -> &'static [&'static str] {
                match self {
                    $(Self::$Model => <$Keys as insonify_base::range::Ranges>::KEYS,)+
                }
            }

            fn schema(self, generator: &mut schemars::SchemaGenerator) -> schemars::Schema {
                match self {
                    $(Self::$Model => <$Keys as schemars::JsonSchema>::json_schema(generator),)+
                }
            }

            fn read<'de, D: serde::Deserializer<'de>>(self, keys: D) -> Result<NeedleKeys, D::Error> {
                match self {
                    $(Self::$Model => serde::Deserialize::deserialize(keys).map(NeedleKeys::$Model),)+
                }
            }

            fn value<'de, D: serde::Deserializer<'de>>(
                self,
                key: &'static str,
                value: D,
            ) -> Result<insonify_base::kinds::Value, D::Error> {
                match self {
                    $(Self::$Model => insonify_base::kinds::typed::<$Keys, D>(key, value),)+
                }
            }
        }

        impl NeedleKeys {
            fn model(&self) -> &dyn model::Keys {
                match self {
                    $(Self::$Model(keys) => keys,)+
                }
            }

            /// Length and diameter of a needle that states none, mm. `None`: those of any needle.
            pub fn usual_mm(&self) -> Option<[f64; 2]> {
                self.model().usual_mm()
            }

            /// Whether the needle goes straight along its axis through tissue.
            pub fn is_straight(&self) -> bool {
                self.model().is_straight()
            }

            /// Builds the needle.
            ///
            /// # Errors
            /// [`OutOfRange`] with the key.
            pub fn needle(&self, shaft: Shaft) -> Result<Box<dyn Needle>, OutOfRange> {
                self.model().needle(shaft)
            }

            /// Checks the keys against their ranges, each other and the shaft.
            ///
            /// # Errors
            /// [`OutOfRange`] with the key.
            pub fn check(&self, shaft: &Shaft) -> Result<(), OutOfRange> {
                match self {
                    $(Self::$Model(keys) => keys.check_ranges()?,)+
                }
                self.model().check(shaft)
            }
        }
    };
}
pub(super) use needle_models;
