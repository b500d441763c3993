//! Effects as a scene file states them.

use std::collections::BTreeMap;
use std::fmt;
use std::marker::PhantomData;

use schemars::JsonSchema;
use serde::de::value::MapAccessDeserializer;
use serde::de::{Deserializer, Error, MapAccess, Visitor};
use serde::{Deserialize, Serialize};

use super::slice::Beyond;
use super::{Effects, EffectsTable, Scanner};
use insonify_tracking::probe::ProbeKind;

/// An effect in a scene file.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
#[serde(untagged)]
#[schemars(inline)]
pub enum Stated<P> {
    /// A table: with these keys, and defaults for the others.
    With(P),
    /// `true`: with all defaults; `false`: left out.
    Switch(bool),
}

impl<'de, P: Deserialize<'de>> Deserialize<'de> for Stated<P> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Either<P>(PhantomData<P>);
        impl<'de, P: Deserialize<'de>> Visitor<'de> for Either<P> {
            type Value = Stated<P>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a table, `true` or `false`")
            }

            fn visit_bool<E: Error>(self, is_on: bool) -> Result<Stated<P>, E> {
                Ok(Stated::Switch(is_on))
            }

            fn visit_map<A: MapAccess<'de>>(self, keys: A) -> Result<Stated<P>, A::Error> {
                P::deserialize(MapAccessDeserializer::new(keys)).map(Stated::With)
            }
        }
        deserializer.deserialize_any(Either(PhantomData))
    }
}

/// Origin of an effect of a scene, or the reason why the scene does not have it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// One of the usual effects.
    Usual,
    /// One of the usual effects of the scene's scanner, but not of every scanner.
    Scanner,
    /// The scene names it.
    Named,
    /// The scene says `false`.
    Off,
    /// `only` does not list it.
    Unlisted,
    /// Not one of the usual effects, and not named by the scene.
    Unusual,
    /// One of the usual effects of another scanner than that of the scene, which does not name it.
    OtherScanner,
    /// A scene of version 1 names others.
    Unnamed,
}

impl Origin {
    /// Whether the effect is in the scene.
    pub(crate) fn is_on(self) -> bool {
        matches!(self, Self::Usual | Self::Scanner | Self::Named)
    }

    /// Reason why an effect is not in a scene; `None` if it is.
    pub(crate) fn absence(self, effect: &str) -> Option<String> {
        match self {
            Self::Usual | Self::Scanner | Self::Named => None,
            Self::Off => Some(format!("left out by `{effect} = false`")),
            Self::Unlisted => Some("not in `only`".to_owned()),
            Self::OtherScanner => Some("not with this `scanner`; name it, or take \"clinical\"".to_owned()),
            Self::Unusual => Some("not usual; name it to have it".to_owned()),
            Self::Unnamed => Some("not named, and with `version = 1` naming others leaves it out".to_owned()),
        }
    }
}

/// Origins of the effects of a scene, by name. Effects of settings made in code, which are not here, count as named.
pub type Origins = BTreeMap<&'static str, Origin>;

/// Error of an effect that a scene file both calls for and leaves out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Contradiction {
    /// Name of the effect.
    pub effect: &'static str,
    /// `true` if `only` lists it and it is `false`; `false` if `only` does not list it and it is named.
    pub is_listed: bool,
}

/// Parameters of an effect in a scene, if it has it, and their origin. `listed` says whether `only`, if the scene has
/// it, lists the effect; `usual` is the scanner whose usual effects it has, with the kind of probe.
///
/// # Errors
/// [`Contradiction`] between what is stated and `only`.
pub(super) fn resolved<P: super::Parameters + Clone>(
    effect: &'static str,
    stated: Option<&Stated<P>>,
    listed: Option<bool>,
    usual: Option<(Scanner, ProbeKind)>,
) -> Result<(Option<P>, Origin), Contradiction> {
    let contradiction = |is_listed| Err(Contradiction { effect, is_listed });
    // A list of all effects is the whole of the processing.
    let open = |mut parameters: P| {
        if let (Some((scanner, kind)), None) = (usual, listed) {
            parameters.fill(scanner, kind);
        }
        parameters
    };
    match (stated, listed) {
        (Some(Stated::Switch(false)), Some(true)) => contradiction(true),
        (Some(Stated::Switch(true) | Stated::With(_)), Some(false)) => contradiction(false),
        (Some(Stated::With(parameters)), _) => Ok((Some(open(parameters.clone())), Origin::Named)),
        (Some(Stated::Switch(true)), _) | (None, Some(true)) => Ok((Some(open(P::default())), Origin::Named)),
        (Some(Stated::Switch(false)), _) => Ok((None, Origin::Off)),
        (None, Some(false)) => Ok((None, Origin::Unlisted)),
        (None, None) => Ok(match usual {
            None => (None, Origin::Unnamed),
            Some(_) if P::USUAL.is_empty() => (None, Origin::Unusual),
            Some((scanner, _)) if !P::USUAL.contains(&scanner) => (None, Origin::OtherScanner),
            Some(_) if P::USUAL == Scanner::ALL => (Some(open(P::default())), Origin::Usual),
            Some(_) => (Some(open(P::default())), Origin::Scanner),
        }),
    }
}

impl EffectsTable {
    /// Note about the change with version 2 for a table without a version: effects that it left out before, and the
    /// keys that leave them out now. `None` if nothing changes, or the table cannot be older.
    pub(crate) fn formerly(&self, usual: (Scanner, ProbeKind)) -> Option<String> {
        let keys = serde_json::to_value(self).ok()?;
        let is_newer = |value: &serde_json::Value| value.is_boolean();
        if self.only.is_some() || keys.as_object()?.values().any(is_newer) {
            return None;
        }
        let [(_, now), (_, before)] = [self.resolve(Some(usual)).ok()?, self.resolve(None).ok()?];
        let having = |origins: &Origins| -> Vec<&'static str> {
            let on = origins.iter().filter(|(_, origin)| origin.is_on());
            on.map(|(name, _)| *name).collect()
        };
        let kept = having(&before);
        let added: Vec<&str> = having(&now).into_iter().filter(|name| !kept.contains(name)).collect();
        let (mut acting, mut keys) = (added.clone(), Vec::new());
        if !added.is_empty() {
            let only: Vec<String> = kept.iter().map(|name| format!("\"{name}\"")).collect();
            keys.push(format!("`only = [{}]` under `effects`", only.join(", ")));
        }
        let void = insonify_base::document::word(&Beyond::Void);
        let beyond = match &self.slice {
            None => Some(format!("`slice.beyond = {void}` under `effects`")),
            // A table that is there takes keys only in its place.
            Some(slice) => (slice.beyond.is_none()).then(|| format!("`beyond = {void}` under `effects.slice`")),
        };
        if let Some(beyond) = beyond {
            acting.push("labels beyond the volume");
            keys.push(beyond);
        }
        (!keys.is_empty()).then(|| {
            format!(
                "beside what `effects` names act {}; for the frame of version 1 write {}; `version = 2` ends this note",
                acting.join(", "),
                keys.join(" and ")
            )
        })
    }
}

impl From<&Effects> for EffectsTable {
    fn from(effects: &Effects) -> Self {
        effects.stated()
    }
}
