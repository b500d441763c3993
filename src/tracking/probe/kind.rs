//! What makes a kind of probe.

use std::f64::consts::PI;

use insonify_base::range::Ranges;
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::aperture::UsualAperture;

/// Place of the array of a probe.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Site {
    /// On the skin.
    Skin,
    /// In the rectum.
    Rectum,
    /// In the middle of a vessel, an airway or a duct, whose axis is that of the probe.
    Lumen,
}

/// Arrangement of the scanlines in the probe's plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Layout {
    /// Parallel scanlines from a straight array.
    Parallel {
        /// Length of the array, mm.
        width: f64,
    },
    /// Scanlines along the radii of a circle about `(0, -radius)`.
    Fan {
        /// Radius of the array, mm; 0 where all scanlines start from one point.
        radius: f64,
        /// Half the field of view, radians. Above pi the first and last scanlines overlap.
        half: f64,
    },
}

impl Layout {
    /// Length of the array, mm.
    pub(super) fn array_mm(self) -> f64 {
        match self {
            Self::Parallel { width } => width,
            Self::Fan { radius, half } => 2.0 * half * radius,
        }
    }

    /// Radius of the array, mm; `None` of a straight one.
    pub(super) fn radius_mm(self) -> Option<f64> {
        match self {
            Self::Parallel { .. } => None,
            Self::Fan { radius, .. } => Some(radius),
        }
    }
}

/// Angle on either side of half a turn by which the scanlines of a full circle overlap, radians: what spreads from
/// scanline to scanline, as speckle and blur do, meets itself without a seam. Acoustic clutter, drawn scanline by
/// scanline, has one.
pub(super) const OVERLAP: f64 = 0.05 * PI;

/// A kind of probe: a table of numbers, each with a range, its scanlines, and the properties in which kinds differ
/// elsewhere.
pub(super) trait Kind: Ranges + Copy + Serialize + DeserializeOwned + schemars::JsonSchema {
    /// Name in files.
    const NAME: &'static str;
    /// A centre frequency common for the kind, MHz.
    const USUAL_MHZ: f64;
    /// Place of the array.
    const SITE: Site;
    /// See [`ProbeKind::shared_aperture_mm`](super::ProbeKind::shared_aperture_mm).
    const SHARED_APERTURE_MM: Option<f64> = None;
    /// Usual f-numbers and lens. F-numbers are those at which elements as wide as [`Transducer::element_mm`]
    /// (super::Transducer::element_mm) still receive well (V. Perrot et al., Ultrasonics 111 (2021) 106309), and
    /// twice as large on transmission, for depth of field.
    const APERTURE: UsualAperture;
    /// A usual probe of the kind.
    const USUAL: Self;
    /// Its usual imaging depth, mm.
    const USUAL_DEPTH_MM: f64;
    /// A probe of the kind with a field of view of some 40 mm.
    const EXAMPLE: Self;

    /// Arrangement of the scanlines.
    fn layout(&self) -> Layout;
}

/// A kind without its numbers.
pub(super) struct Facts {
    pub name: &'static str,
    pub usual_mhz: f64,
    pub usual_depth_mm: f64,
    pub site: Site,
    pub shared_aperture_mm: Option<f64>,
    pub aperture: UsualAperture,
    pub keys: fn() -> Vec<&'static str>,
    pub read: fn(&Numbers) -> Result<super::ProbeShape, serde::de::value::Error>,
    pub schema: fn() -> schemars::Schema,
}

/// Numbers of a kind by key, in the order of its table.
pub(super) type Numbers = Vec<(&'static str, f64)>;

impl Facts {
    pub(super) const fn of<K: Kind + Into<super::ProbeShape>>() -> Self {
        Self {
            name: K::NAME,
            usual_mhz: K::USUAL_MHZ,
            usual_depth_mm: K::USUAL_DEPTH_MM,
            site: K::SITE,
            shared_aperture_mm: K::SHARED_APERTURE_MM,
            aperture: K::APERTURE,
            keys: || K::RANGES.iter().map(|range| range.key).collect(),
            read: |numbers| {
                let table = numbers.iter().copied();
                K::deserialize(serde::de::value::MapDeserializer::new(table)).map(Into::into)
            },
            schema: || schemars::schema_for!(K),
        }
    }
}

pub(super) fn numbers<K: Kind>(kind: &K) -> Numbers {
    let numbers = K::RANGES.iter();
    numbers
        .filter_map(|range| Some((range.key, (range.stated)(kind)?)))
        .collect()
}

/// Declares the kinds of probes, each with its module: the types of shapes and of kinds, and what follows from
/// [`Kind`].
macro_rules! kinds {
    ($($module:ident: $Kind:ident;)+) => {
        $(mod $module; pub use $module::$Kind;)+

        /// Shape of a transducer's field of view, by kind.
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub enum ProbeShape {
            $(#[doc = concat!("See [`", stringify!($Kind), "`].")] $Kind($Kind),)+
        }

        /// Kind of probe.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum ProbeKind {
            $(#[doc = concat!("See [`", stringify!($Kind), "`].")] $Kind,)+
        }

        $(impl From<$Kind> for ProbeShape {
            fn from(shape: $Kind) -> Self {
                Self::$Kind(shape)
            }
        })+

        impl ProbeKind {
            /// All kinds.
            pub const ALL: &'static [Self] = &[$(Self::$Kind),+];

            fn facts(self) -> &'static kind::Facts {
                match self {
                    $(Self::$Kind => const { &kind::Facts::of::<$Kind>() },)+
                }
            }
        }

        impl ProbeShape {
            /// A shape of each kind, with its name.
            pub const EXAMPLES: [(&'static str, Self); Self::KINDS] = [$((<$Kind as Kind>::NAME, Self::$Kind(<$Kind as Kind>::EXAMPLE)),)+];
            const KINDS: usize = ProbeKind::ALL.len();

            fn usual(kind: ProbeKind) -> Self {
                match kind {
                    $(ProbeKind::$Kind => Self::$Kind(<$Kind as Kind>::USUAL),)+
                }
            }

            /// Kind of probe.
            pub fn kind(&self) -> ProbeKind {
                match self {
                    $(Self::$Kind(_) => ProbeKind::$Kind,)+
                }
            }

            /// Numbers of the shape by key.
            pub fn numbers(&self) -> Vec<(&'static str, f64)> {
                match self {
                    $(Self::$Kind(shape) => kind::numbers(shape),)+
                }
            }

            fn layout(&self) -> kind::Layout {
                match self {
                    $(Self::$Kind(shape) => shape.layout(),)+
                }
            }

            fn check(&self) -> Result<(), TrackingError> {
                match self {
                    $(Self::$Kind(shape) => in_ranges("probe", shape),)+
                }
            }
        }
    };
}
pub(super) use kinds;
