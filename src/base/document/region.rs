//! Region references by name or number, common to all file types.

use std::fmt;

use schemars::JsonSchema;
use serde::de::{Deserializer, Visitor};
use serde::{Deserialize, Serialize};

use super::nearest;
use crate::blame::Blame;
use crate::text;

/// A region: its name, an unambiguous part of it, or its number, which is a label value.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(untagged)]
pub enum RegionName {
    /// Region number: the value of a label.
    Value(i64),
    /// The name of a label, of a tissue (all labels made of it) or of a mesh's region, or a part of one. Case, spaces,
    /// punctuation and the order of words do not matter.
    Name(String),
}

impl fmt::Display for RegionName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            RegionName::Value(value) => write!(f, "{value}"),
            RegionName::Name(name) => write!(f, "\"{name}\""),
        }
    }
}

impl<'de> Deserialize<'de> for RegionName {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Either;
        impl Visitor<'_> for Either {
            type Value = RegionName;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("the name of a region or its number")
            }

            fn visit_i64<E>(self, value: i64) -> Result<Self::Value, E> {
                Ok(RegionName::Value(value))
            }

            fn visit_str<E>(self, name: &str) -> Result<Self::Value, E> {
                Ok(RegionName::Name(name.to_owned()))
            }
        }
        deserializer.deserialize_any(Either)
    }
}

/// Why a name or number matches no region.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoRegion {
    /// No region has the name or number.
    #[error("there is no region {found}; expected {}", listed(.known))]
    Unknown {
        /// The name or number as written.
        found: RegionName,
        /// Known names; numbers of regions without a name.
        known: Vec<String>,
    },
    /// A part of a name that occurs in the names of several regions.
    #[error("{found} is a part of several names; expected one of {}", .names.join(", "))]
    Ambiguous {
        /// The name as written.
        found: RegionName,
        /// The matching names.
        names: Vec<String>,
    },
}

impl Blame for NoRegion {}

fn listed(known: &[String]) -> String {
    if known.is_empty() {
        "a mesh or volume that has regions".to_owned()
    } else {
        format!("one of {}", text::some_of(known))
    }
}

impl NoRegion {
    /// Suggests a similar name.
    pub fn help(&self) -> Option<String> {
        let NoRegion::Unknown {
            found: RegionName::Name(found),
            known,
        } = self
        else {
            return None;
        };
        nearest(found, known.iter().map(String::as_str)).map(|meant| format!("did you mean \"{meant}\"?"))
    }
}

/// Regions with their numbers and names.
#[derive(Clone, Debug)]
pub struct Names<K>(Vec<(K, i64, Vec<String>)>);

impl<K: Copy + Ord> Names<K> {
    /// Creates the list from `regions`, each with its number and names.
    pub fn new(regions: impl IntoIterator<Item = (K, i64, Vec<String>)>) -> Self {
        Names(regions.into_iter().collect())
    }

    /// Best matching regions and names: by number, else by complete name, else by a part of one.
    fn best(&self, wanted: &RegionName) -> Vec<(K, &str)> {
        let (number, name) = match wanted {
            RegionName::Value(value) => (Some(*value), String::new()),
            RegionName::Name(name) => (name.trim().parse().ok(), plain(name)),
        };
        // A number is exact and a complete name nearly so: parts of names are tried only where neither answers, so that
        // "liver" is not also "liver_vein".
        let numbered = self.0.iter().filter(|(_, region, _)| Some(*region) == number);
        let numbered: Vec<_> = numbered.map(|(key, ..)| (*key, "")).collect();
        if !numbered.is_empty() || name.is_empty() {
            return numbered;
        }
        let all = || {
            self.0
                .iter()
                .flat_map(|(key, _, names)| names.iter().map(|name| (*key, name.as_str())))
        };
        let having =
            |answers: &dyn Fn(&str) -> bool| all().filter(|(_, name)| answers(&plain(name))).collect::<Vec<_>>();
        let wanted = words(&name);
        let whole = having(&|candidate| words(candidate) == wanted);
        let has_words = |candidate: &str| wanted.iter().all(|word| words(candidate).contains(word));
        if whole.is_empty() {
            having(&|candidate| candidate.starts_with(&name) || has_words(candidate))
        } else {
            whole
        }
    }

    /// All regions that a name or number may refer to, ascending.
    pub fn all(&self, wanted: &RegionName) -> Vec<K> {
        let mut keys: Vec<K> = self.best(wanted).into_iter().map(|(key, _)| key).collect();
        keys.sort_unstable();
        keys.dedup();
        keys
    }

    /// Regions that a name or number refers to, ascending: several if they share the name.
    ///
    /// # Errors
    /// [`NoRegion`] if there is none, or if it is a part of the names of several regions.
    pub fn find(&self, wanted: &RegionName) -> Result<Vec<K>, NoRegion> {
        let keys = self.all(wanted);
        let mut names: Vec<String> = self.best(wanted).into_iter().map(|(_, name)| name.to_owned()).collect();
        names.sort();
        names.dedup();
        let found = wanted.clone();
        match (keys.len(), names.len()) {
            (0, _) => Err(NoRegion::Unknown {
                found,
                known: self.known(),
            }),
            (2.., 2..) => Err(NoRegion::Ambiguous { found, names }),
            _ => Ok(keys),
        }
    }

    /// All names; numbers of regions without a name.
    pub fn known(&self) -> Vec<String> {
        let names_of = |(_, number, names): &(K, i64, Vec<String>)| match names[..] {
            [] => vec![number.to_string()],
            _ => names.clone(),
        };
        let mut known: Vec<String> = self.0.iter().flat_map(names_of).collect();
        known.sort();
        known.dedup();
        known
    }
}

/// Words of a plain name, sorted alphabetically.
fn words(plain: &str) -> Vec<&str> {
    let mut words: Vec<&str> = plain.split('_').collect();
    words.sort_unstable();
    words
}

/// Normalises a name: lower case, and every run of other characters than letters and digits as a single underscore.
pub fn plain(name: &str) -> String {
    let lower = name.to_lowercase();
    let words = lower.split(|c: char| !c.is_alphanumeric());
    words.filter(|word| !word.is_empty()).collect::<Vec<_>>().join("_")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn body() -> Names<u8> {
        let label = |key, value, names: &[&str]| (key, value, names.iter().map(|name| (*name).to_owned()).collect());
        Names::new([
            label(1, 5, &["Liver", "liver"]),
            label(2, 2, &["kidney_right", "kidney_cortex"]),
            label(3, 3, &["kidney_left", "kidney_cortex"]),
            label(4, 7, &[]),
        ])
    }

    fn named(name: &str) -> Result<Vec<u8>, NoRegion> {
        body().find(&RegionName::Name(name.to_owned()))
    }

    #[test]
    fn regions_answer_to_numbers_names_and_parts() {
        assert_eq!(body().find(&RegionName::Value(7)), Ok(vec![4]));
        assert_eq!(named("7"), Ok(vec![4]));
        assert_eq!(named("LIVER"), Ok(vec![1]));
        assert_eq!(named("Kidney right"), Ok(vec![2]));
        assert_eq!(named("right kidney"), Ok(vec![2]));
        assert_eq!(named("left"), Ok(vec![3]));
        // A name shared by several regions refers to all of them, and so does a part of that name alone.
        assert_eq!(named("kidney_cortex"), Ok(vec![2, 3]));
        assert_eq!(named("cortex"), Ok(vec![2, 3]));
        assert_eq!(body().all(&RegionName::Name("kidney".to_owned())), [2, 3]);
    }

    #[test]
    fn what_means_no_region_or_several_is_refused_with_the_names() {
        let error = named("kidney").unwrap_err();
        let expected =
            "\"kidney\" is a part of several names; expected one of kidney_cortex, kidney_left, kidney_right";
        assert_eq!((error.to_string().as_str(), error.help()), (expected, None));
        let error = named("kidny_left").unwrap_err();
        assert!(
            error
                .to_string()
                .ends_with("one of 7, Liver, kidney_cortex, kidney_left, kidney_right, liver")
        );
        assert_eq!(error.help().as_deref(), Some("did you mean \"kidney_left\"?"));
        assert!(named("idney").is_err() && named("").is_err() && named("_").is_err());
        assert!(body().find(&RegionName::Value(1)).is_err());
    }
}
