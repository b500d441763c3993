//! Registry of effects in order of execution.
//!
//! An effect states when a scene calls for it and which passes it consists of. A pass is declared once: its name,
//! shader, bindings in order, parameters, dispatch size, and the CPU function that is its reference. A frame runs the
//! passes of the enabled effects in the order of [`REGISTRY`].
//!
//! An effect owns its data: its parameters ([`Parameters`]), the tables that it derives from anatomy and settings
//! (`Derived`, `Key`, `derive`), its buffers ([`Buffer`]) and its vectors on the CPU (`Columns`). `registry!` lists the
//! effects and what each has of these. `docs/effects.md` shows what each does to a frame.

pub mod buffers;
pub mod common;
#[cfg(feature = "gpu")]
mod imports;
pub mod lateral;
pub mod pass;
pub mod point_spread;
pub mod table;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::effects::buffers::Buffer;
use crate::effects::pass::Pass;
use crate::effects::table::{Contradiction, Origin, Origins, Stated};
use crate::plan::Plan;
use crate::synth::tables::{Anatomy, LabelRow, Settings, Tables};
use crate::synth::{FrameState, SynthError};
use insonify_base::range::{OutOfRange, Ranges};
use insonify_base::real::Real;
use insonify_tracking::probe::{BeamGrid, ProbeKind};

/// Whether a scene calls for an effect, and why.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Wanted {
    /// It runs, for this reason.
    Yes(String),
    /// It does not, for this reason.
    No(String),
}

/// Name, in reports on what needs a pass, of what all frames have in common.
pub(crate) const EVERY_FRAME: &str = "every frame";

/// Part of a frame. Its effects run before those of the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Stage {
    /// Places and labels of the samples, and the echoes of their tissues.
    Tissue,
    /// Echoes of surfaces and needles.
    Echoes,
    /// Scatterers and the point spread.
    Speckle,
    /// Losses, artefacts and noise along the beam.
    Beam,
    /// Grey levels and pixels.
    Display,
}

impl Stage {
    /// All stages, in order.
    pub const ALL: [Self; 5] = [Self::Tissue, Self::Echoes, Self::Speckle, Self::Beam, Self::Display];

    /// Name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Tissue => "tissue",
            Self::Echoes => "echoes",
            Self::Speckle => "speckle",
            Self::Beam => "beam",
            Self::Display => "display",
        }
    }
}

/// An effect: when it runs, which passes it consists of, and what else depends on it.
pub struct Effect {
    /// Name, also the stem of its source, shader and parity test.
    pub name: &'static str,
    /// Part of the frame in which it runs.
    pub stage: Stage,
    /// Keys of a scene file that call for it; empty if every frame has it, or no key asks for it.
    pub example: &'static str,
    /// Whether the scene calls for it.
    pub wanted: fn(&Tables) -> Wanted,
    /// Passes of the effect, in order.
    pub passes: fn(&Tables) -> Vec<&'static Pass>,
    /// Buffers of the effect alone. Those with contents are filled again when what it derives changes.
    pub buffers: &'static [&'static Buffer],
    /// Writes what it needs to know of a label index, from what it derives.
    pub label_row: Option<fn(&Anatomy, &EffectTables, usize, &mut LabelRow)>,
    /// Deviations of the output from the settings, for the user.
    pub warnings: fn(&Tables) -> Vec<String>,
    /// Number of things in a frame that it does not show because there are too many.
    pub left_out: fn(&Tables, &FrameState) -> usize,
    /// Bytes besides the buffers for a number of samples.
    pub extra_bytes: fn(settings: &Settings, samples: u64) -> u64,
    /// Takes it out of a scene; `None` if every frame needs it.
    pub remove: Option<fn(&mut Anatomy, &mut Settings)>,
    /// Name of what needs a pass of it, if that is not the effect itself.
    pub needed_by: fn(&Tables, &Pass) -> Option<&'static str>,
}

impl Effect {
    /// An effect without data of its own.
    const PLAIN: Self = Self {
        name: "",
        stage: Stage::Echoes,
        example: "",
        wanted: |_| Wanted::No(String::new()),
        passes: |_| Vec::new(),
        buffers: &[],
        label_row: None,
        warnings: |_| Vec::new(),
        left_out: |_, _| 0,
        extra_bytes: |_, _| 0,
        remove: None,
        needed_by: |_, _| None,
    };
}

/// What a scanner does to an image beside log compression. It decides which effects are usual.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Scanner {
    /// Nothing: frames of one look.
    #[default]
    Raw,
    /// What those in clinics do: spatial compounding and speckle reduction, which is lighter under linear probes, where
    /// the received pulse is filtered.
    Clinical,
}

impl Scanner {
    const ALL: &[Self] = &[Self::Raw, Self::Clinical];
}

/// Parameters of an effect that a scene may do without.
pub trait Parameters: Default + Ranges {
    /// Scanners that have it among their usual effects.
    const USUAL: &[Scanner] = Scanner::ALL;

    /// Fills what is left open and depends on the scanner and the kind of probe.
    fn fill(&mut self, _: Scanner, _: ProbeKind) {}

    /// Checks what the ranges of single numbers do not say.
    fn check_others(&self) -> Result<(), OutOfRange> {
        Ok(())
    }
}

/// A key of [`Effects`].
pub(crate) trait Setting: Default {
    /// Its form in a scene file.
    type Stated;

    /// Its value in a scene, and its origin unless every frame needs it: see [`table::resolved`].
    fn resolved(
        effect: &'static str,
        stated: Option<&Self::Stated>,
        listed: Option<bool>,
        usual: Option<(Scanner, ProbeKind)>,
    ) -> Result<(Self, Option<Origin>), Contradiction>;

    /// Form of this value in a scene file; `None` if the file need not state it.
    fn stated(&self) -> Option<Self::Stated>;

    /// Its value among the usual effects of a scanner.
    fn usual(scanner: Scanner) -> Self;

    /// Its value among all effects.
    fn all() -> Self;

    /// Checks the ranges.
    fn validate(&self) -> Result<(), OutOfRange> {
        Ok(())
    }
}

impl<P: Parameters + Clone> Setting for Option<P> {
    type Stated = Stated<P>;

    fn resolved(
        effect: &'static str,
        stated: Option<&Stated<P>>,
        listed: Option<bool>,
        usual: Option<(Scanner, ProbeKind)>,
    ) -> Result<(Self, Option<Origin>), Contradiction> {
        let (parameters, origin) = table::resolved(effect, stated, listed, usual)?;
        Ok((parameters, Some(origin)))
    }

    fn stated(&self) -> Option<Stated<P>> {
        match self {
            Some(parameters) => Some(Stated::With(parameters.clone())),
            None => (!P::USUAL.is_empty()).then_some(Stated::Switch(false)),
        }
    }

    fn usual(scanner: Scanner) -> Self {
        P::USUAL.contains(&scanner).then(P::default)
    }

    fn all() -> Self {
        Some(P::default())
    }

    fn validate(&self) -> Result<(), OutOfRange> {
        let Some(parameters) = self else { return Ok(()) };
        parameters.check_ranges().map_err(|error| OutOfRange {
            expected: format!("a number from {}", error.expected),
            ..error
        })?;
        parameters.check_others()
    }
}

/// Declares the effects. A line holds the name; the key of a scene, with its type, a type of its parameters and a
/// description; the tables; and the vectors on the CPU.
///
/// Tables are made by `derive(&Anatomy, &Key)`. The function uses no settings and tissues but those in the key, which
/// `key(&TissueTable, &Settings, &BeamGrid)` takes, so that tables are derived again whenever they may differ.
macro_rules! registry {
    ($(
        $name:ident $(: $key:ident $(<$parameters:ident>)? $(with $other:ident)? = $doc:literal)?
        $(, derives $derived:ty)? $(, columns $columns:ty)?;
    )+) => {
        $(pub mod $name;)+

        /// All effects, in the order of this list.
        pub const LISTED: &[&Effect] = &[$(&$name::EFFECT),+];

        /// Types of the keys of [`Effects`].
        pub mod parameters {
            $(
                $(registry!(@parameters $name $key $(<$parameters>)?);)?
                $($(pub use super::$name::$other;)?)?
            )+
        }

        registry!(@effects $($([$name: $key $(<$parameters>)? = $doc])?)+);
        registry!(@tables $($([$name: $derived])?)+);
        registry!(@columns $($([$name: $columns])?)+);
    };
    (@parameters $name:ident Option<$parameters:ident>) => { pub use super::$name::$parameters; };
    (@parameters $name:ident $parameters:ident) => { pub use super::$name::$parameters; };
    (@stated $name:ident Option<$parameters:ident>) => { Stated<$parameters> };
    (@stated $name:ident $parameters:ident) => { $name::Table };
    (@effects $([$name:ident: $key:ident $(<$parameters:ident>)? = $doc:literal])+) => {
        /// Effects enabled in a scene, with their parameters. An effect that is `None` is not simulated and costs
        /// nothing.
        ///
        /// ```
        /// use insonify_imaging::effects::Effects;
        /// use insonify_imaging::effects::parameters::{Noise, Shadow};
        ///
        /// let mut effects = Effects::usual();
        /// effects.refraction = None;
        /// effects.shadow = Some(Shadow { mirror: 0.0, ..Shadow::default() });
        /// effects.noise = Some(Noise { std_grey: 4.0 });
        /// effects.validate()?;
        ///
        /// effects.noise = Some(Noise { std_grey: -4.0 });
        /// assert_eq!(effects.validate().unwrap_err().key, "noise.std_grey");
        /// # Ok::<(), insonify_base::range::OutOfRange>(())
        /// ```
        #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
        #[serde(deny_unknown_fields, default)]
        pub struct Effects {
            $(#[doc = $doc] pub $name: $key $(<$parameters>)?,)+
        }

        /// Name of an effect that a scene file may state.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
        #[expect(non_camel_case_types, reason = "they are the keys of files")]
        #[schemars(inline)]
        pub enum EffectName {
            $(#[doc = $doc] $name,)+
        }

        /// Effects of a scene file: the usual ones, and those with `true` or a table, without those with `false`.
        #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
        #[serde(deny_unknown_fields, default)]
        pub struct EffectsTable {
            /// Exactly these effects, besides what every frame needs. Default: the usual ones and those named, and
            /// with `version = 1` those that have a table.
            #[serde(skip_serializing_if = "Option::is_none")]
            pub only: Option<Vec<EffectName>>,
            $(
                #[doc = $doc]
                #[serde(skip_serializing_if = "Option::is_none")]
                pub $name: Option<registry!(@stated $name $key $(<$parameters>)?)>,
            )+
        }

        impl EffectsTable {
            /// Effects that the table calls for, and their origins: beside those that it names the usual ones of a
            /// scanner with a kind of probe, or with `None` no others.
            ///
            /// # Errors
            /// An effect that it both calls for and leaves out.
            pub(crate) fn resolve(&self, usual: Option<(Scanner, ProbeKind)>) -> Result<(Effects, Origins), Contradiction> {
                let mut origins = Origins::new();
                let effects = Effects {
                    $($name: {
                        let effect = stringify!($name);
                        let listed = self.only.as_ref().map(|only| only.contains(&EffectName::$name));
                        let (setting, origin) = <$key $(<$parameters>)? as Setting>::resolved(
                            effect,
                            self.$name.as_ref(),
                            listed,
                            usual,
                        )?;
                        origins.extend(origin.map(|origin| (effect, origin)));
                        setting
                    },)+
                };
                Ok((effects, origins))
            }
        }

        impl Effects {
            /// The table of a scene file that has these effects.
            fn stated(&self) -> EffectsTable {
                EffectsTable {
                    only: None,
                    $($name: Setting::stated(&self.$name),)+
                }
            }

            /// Returns the usual effects of a scanner with their default parameters: all but additive noise, which
            /// duplicates what speckle does physically, and blur; of a raw one neither compounding nor speckle
            /// reduction.
            pub fn of(scanner: Scanner) -> Self {
                Self {
                    $($name: Setting::usual(scanner),)+
                }
            }

            /// Returns the usual effects of every scanner: those of a raw one.
            pub fn usual() -> Self {
                Self::of(Scanner::Raw)
            }

            /// Returns every effect with its default parameters.
            pub fn all() -> Self {
                Self {
                    $($name: Setting::all(),)+
                }
            }

            /// Checks every parameter against its range.
            pub fn validate(&self) -> Result<(), OutOfRange> {
                $(
                    Setting::validate(&self.$name).map_err(|error| OutOfRange {
                        key: format!("{}.{}", stringify!($name), error.key),
                        ..error
                    })?;
                )+
                Ok(())
            }
        }
    };
    (@tables $([$name:ident: $derived:ty])+) => {
        /// Tables of the effects.
        #[derive(Clone, Debug)]
        pub struct EffectTables {
            $(#[doc = concat!("Tables of `", stringify!($name), "`.")] pub $name: $derived,)+
        }

        impl EffectTables {
            /// Derives all tables.
            pub fn new(anatomy: &Anatomy, settings: &Settings, grid: &BeamGrid) -> Result<Self, SynthError> {
                Ok(Self {
                    $($name: $name::derive(anatomy, &$name::key(&anatomy.tissues, settings, grid))?,)+
                })
            }

            /// Derives the tables whose key differs from that of `old` settings and tissues, and returns their effects;
            /// unchanged on an error.
            pub fn set(
                &mut self,
                old: (&Anatomy, &Settings, &BeamGrid),
                new: (&Anatomy, &Settings, &BeamGrid),
            ) -> Result<Vec<&'static Effect>, SynthError> {
                $(
                    let key = $name::key(&new.0.tissues, new.1, new.2);
                    let differs = $name::key(&old.0.tissues, old.1, old.2) != key;
                    let $name = differs.then(|| $name::derive(new.0, &key)).transpose()?;
                )+
                let mut derived = Vec::new();
                $(
                    if let Some(tables) = $name {
                        self.$name = tables;
                        derived.push(&$name::EFFECT);
                    }
                )+
                Ok(derived)
            }
        }
    };
    (@columns $([$name:ident: $columns:ty])+) => {
        /// Vectors of the effects on the CPU.
        #[derive(Debug, Default)]
        pub struct EffectColumns<T> {
            $(#[doc = concat!("Vectors of `", stringify!($name), "`.")] pub $name: $columns,)+
        }

        impl<T: Real> EffectColumns<T> {
            /// Allocates what a plan uses and frees the rest.
            pub fn fit(&mut self, plan: &Plan, tables: &Tables) {
                $(self.$name.fit(plan, tables);)+
            }

            /// Memory in use, bytes.
            pub fn bytes(&self) -> usize {
                0 $(+ self.$name.bytes())+
            }
        }
    };
}

use parameters::*;

registry! {
    geometry;
    contact: Option<Contact> = "Skin that conforms to the array.",
        columns contact::Columns;
    warp;
    slice: Slice with Boundary = "How labels are read from the volume.";
    texture: Option<Texture> = "Solid textures of the tissues that name one.",
        derives texture::Derived;
    thickness: Option<Thickness> = "Finite elevational thickness of the scan plane.",
        derives thickness::Derived;
    speckle: Option<Speckle> = "Fully developed speckle.",
        derives speckle::Derived, columns speckle::Columns<T>;
    interface: Option<Interface> = "Specular echoes where the acoustic impedance changes.",
        derives interface::Derived;
    needle: Option<NeedleEcho> = "Echo of the needle; needs a needle in the scene.",
        columns needle::Columns;
    compound: Option<Compound> = "Spatial compounding: the mean of looks steered to either side.",
        derives compound::Derived, columns compound::Columns<T>;
    shadow: Option<Shadow> = "Attenuation, and shadows of bone, gas and the needle.",
        derives shadow::Derived, columns shadow::Columns<T>;
    refraction: Option<Refraction>
        = "Refraction where the speed of sound changes: dark lines under the edges of cysts, vessels and organs.",
        derives refraction::Derived, columns refraction::Columns<T>;
    blur: Option<Blur> = "Radial blur about the probe's virtual apex.",
        derives blur::Derived;
    haze: Option<Haze> = "Diffuse echoes that reach the array by other paths than the beam: what is dark beside tissue is not black.",
        derives haze::Derived, columns haze::Columns<T>;
    receiver: Option<Receiver> = "Electronic noise and acoustic clutter.",
        derives receiver::Derived;
    speckle_reduction: Option<SpeckleReduction> = "Edge-keeping smoothing of speckle, as scanners have.",
        derives speckle_reduction::Derived;
    tone: Option<Tone> with Curve
        = "Gain, time-gain compensation and log compression; without it the amplitude is shown linearly.",
        derives tone::Derived, columns tone::Columns<T>;
    scan_conversion;
    noise: Option<Noise> = "Additive Gaussian noise on grey levels.";
    quantise;
    truth, columns truth::Columns;
}

/// All effects, in the order of execution within a frame: by stage, then as listed.
pub static REGISTRY: &[&Effect] = &in_order();

const fn in_order() -> [&'static Effect; LISTED.len()] {
    let mut order = [LISTED[0]; LISTED.len()];
    let (mut stage, mut placed) = (0, 0);
    while placed < LISTED.len() {
        let mut index = 0;
        while index < LISTED.len() {
            if LISTED[index].stage as usize == stage {
                order[placed] = LISTED[index];
                placed += 1;
            }
            index += 1;
        }
        stage += 1;
    }
    order
}
