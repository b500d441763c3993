//! Ordered registry of effects: the only place where an effect is declared.
//!
//! An effect states when a scene calls for it and which passes it consists of. A pass is declared once: its name, shader,
//! bindings in order, parameters, dispatch size, and the CPU function that is its reference. A frame runs the passes of
//! the enabled effects in the order of [`REGISTRY`].

pub mod blur;
pub mod contact;
pub mod geometry;
pub mod interface;
pub mod lateral;
pub mod needle;
pub mod noise;
pub mod pass;
pub mod point_spread;
pub mod quantise;
pub mod receiver;
pub mod refraction;
pub mod scan_conversion;
pub mod shadow;
pub mod slice;
pub mod speckle;
pub mod texture;
pub mod thickness;
pub mod tone;
pub mod warp;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::effects::pass::Pass;
use crate::synth::tables::Tables;

/// Whether a scene calls for an effect, and why.
pub type Verdict = Result<String, String>;

/// An effect: when it runs and which passes it consists of.
pub struct Effect {
    /// Name, also the stem of its source, shader and parity test.
    pub name: &'static str,
    /// `Ok(reason)` if the scene calls for it, `Err(reason)` if not.
    pub wanted: fn(&Tables) -> Verdict,
    /// Passes of the effect, in order.
    pub passes: fn(&Tables) -> Vec<&'static Pass>,
}

/// All effects, in the order of execution within a frame.
pub static REGISTRY: &[Effect] = &[
    geometry::EFFECT,
    contact::EFFECT,
    warp::EFFECT,
    slice::EFFECT,
    texture::EFFECT,
    thickness::EFFECT,
    interface::EFFECT,
    needle::EFFECT,
    speckle::EFFECT,
    shadow::EFFECT,
    refraction::EFFECT,
    blur::EFFECT,
    receiver::EFFECT,
    tone::EFFECT,
    scan_conversion::EFFECT,
    noise::EFFECT,
    quantise::EFFECT,
];

/// Effects enabled in a scene, with their parameters. An effect that is `None` is not simulated and costs nothing.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Effects {
    /// Skin that conforms to the array.
    pub contact: Option<contact::Contact>,
    /// How labels are read from the volume.
    pub slice: slice::Slice,
    /// Solid textures of the tissues that name one.
    pub texture: Option<texture::Texture>,
    /// Finite elevational thickness of the scan plane.
    pub thickness: Option<thickness::Thickness>,
    /// Fully developed speckle.
    pub speckle: Option<speckle::Speckle>,
    /// Specular echoes where the acoustic impedance changes.
    pub interface: Option<interface::Interface>,
    /// Echo of the needle; needs a needle in the scene.
    pub needle: Option<needle::NeedleEcho>,
    /// Attenuation, and shadows of bone, gas and the needle.
    pub shadow: Option<shadow::Shadow>,
    /// Refraction where the speed of sound changes: dark lines under the edges of cysts, vessels and organs.
    pub refraction: Option<refraction::Refraction>,
    /// Radial blur about the probe's virtual apex.
    pub blur: Option<blur::Blur>,
    /// Electronic noise and acoustic clutter.
    pub receiver: Option<receiver::Receiver>,
    /// Gain, time-gain compensation and log compression; without it the amplitude is shown linearly.
    pub tone: Option<tone::Tone>,
    /// Additive Gaussian noise on grey levels.
    pub noise: Option<noise::Noise>,
}

/// A parameter outside its range.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("`{key}` is {found}; expected {expected}")]
pub struct OutOfRange {
    /// Key path below `effects`, such as `speckle.axial_mm`.
    pub key: String,
    /// Value found.
    pub found: String,
    /// Expected range.
    pub expected: String,
}

/// Checks that `value` is a number within `range`.
pub(crate) fn within(key: &str, value: f64, range: std::ops::RangeInclusive<f64>) -> Result<(), OutOfRange> {
    if range.contains(&value) {
        return Ok(());
    }
    let expected = format!("a number from {} to {}", range.start(), range.end());
    Err(OutOfRange {
        key: key.to_owned(),
        found: value.to_string(),
        expected,
    })
}

impl Effects {
    /// Returns every effect with its default parameters, except additive noise, which duplicates what speckle does
    /// physically.
    pub fn usual() -> Self {
        Self {
            contact: Some(contact::Contact::default()),
            slice: slice::Slice {
                beyond: slice::Beyond::Continue,
                ..slice::Slice::default()
            },
            texture: Some(texture::Texture::default()),
            thickness: None,
            speckle: Some(speckle::Speckle::default()),
            interface: Some(interface::Interface::default()),
            needle: Some(needle::NeedleEcho::default()),
            shadow: Some(shadow::Shadow::default()),
            refraction: Some(refraction::Refraction::default()),
            blur: Some(blur::Blur::default()),
            receiver: Some(receiver::Receiver::default()),
            tone: Some(tone::Tone::default()),
            noise: None,
        }
    }

    /// Checks every parameter against its range.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        self.contact.as_ref().map_or(Ok(()), contact::Contact::validate)?;
        self.thickness.as_ref().map_or(Ok(()), thickness::Thickness::validate)?;
        self.texture.as_ref().map_or(Ok(()), texture::Texture::validate)?;
        self.speckle.as_ref().map_or(Ok(()), speckle::Speckle::validate)?;
        self.interface.as_ref().map_or(Ok(()), interface::Interface::validate)?;
        self.needle.as_ref().map_or(Ok(()), needle::NeedleEcho::validate)?;
        self.shadow.as_ref().map_or(Ok(()), shadow::Shadow::validate)?;
        self.refraction
            .as_ref()
            .map_or(Ok(()), refraction::Refraction::validate)?;
        self.blur.as_ref().map_or(Ok(()), blur::Blur::validate)?;
        self.receiver.as_ref().map_or(Ok(()), receiver::Receiver::validate)?;
        self.tone.as_ref().map_or(Ok(()), tone::Tone::validate)?;
        self.noise.as_ref().map_or(Ok(()), noise::Noise::validate)
    }
}
