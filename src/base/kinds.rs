//! Flat tables: keys that all kinds have, one of which states the kind, and the keys of that kind.
//!
//! For kinds that are declared in registries, such as laws of tissue and needle models: each declares its keys in its
//! own file. Where the kinds are few and fixed, and each key is a field of one struct, the table is
//! [`ByKind`](crate::range::ByKind).
//!
//! Keys are read one by one as the file states them, so that an error of any is on its own line; those of kinds are
//! kept apart until all are read, for the kind may be stated last.

use std::borrow::Cow;
use std::fmt;
use std::marker::PhantomData;
use std::ops::{Deref, DerefMut};

use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::de::value::{MapAccessDeserializer, StrDeserializer};
use serde::de::{self, DeserializeSeed, Deserializer, MapAccess, Visitor};
use serde::{Deserialize, Serialize};
pub use toml::Value;

use crate::range::{Kind, OutOfRange, Ranges, describe_keys, either};

/// A kind with keys of its own. Keys of the same name in several kinds have the same type and text.
pub trait KeyedKind: Kind + Serialize {
    /// Its keys as a value.
    type Keys;
    /// All kinds.
    const ALL: &'static [Self];

    /// Keys that only some kinds have, this one among them.
    fn keys(self) -> &'static [&'static str];

    /// Schema of the table of these keys.
    fn schema(self, generator: &mut SchemaGenerator) -> Schema;

    /// Reads these keys.
    ///
    /// # Errors
    /// A key that the kind does not have, one that it needs, or a value of another type.
    fn read<'de, D: Deserializer<'de>>(self, keys: D) -> Result<Self::Keys, D::Error>;

    /// Reads the value of one of these keys as its type.
    ///
    /// # Errors
    /// A value of another type.
    fn value<'de, D: Deserializer<'de>>(self, key: &'static str, value: D) -> Result<Value, D::Error>;
}

/// Keys that all kinds have.
pub trait CommonKeys: Ranges + JsonSchema {
    /// The kind.
    type Kind: KeyedKind;
    /// Key of the kind.
    const FIELD: &'static str;

    /// The stated kind.
    fn kind(&self) -> Self::Kind;
}

/// A flat table of common keys and those of a kind.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct KindTable<C> {
    /// Keys of all kinds.
    pub common: C,
    /// Keys of kinds.
    of_kinds: toml::Table,
}

impl<C> From<C> for KindTable<C> {
    fn from(common: C) -> Self {
        let of_kinds = toml::Table::new();
        Self { common, of_kinds }
    }
}

impl<C> Deref for KindTable<C> {
    type Target = C;

    fn deref(&self) -> &C {
        &self.common
    }
}

impl<C> DerefMut for KindTable<C> {
    fn deref_mut(&mut self) -> &mut C {
        &mut self.common
    }
}

impl<C: CommonKeys> KindTable<C> {
    /// The first key that the kind has and the table does not state.
    pub fn unstated(&self) -> Option<&'static str> {
        let mut keys = self.kind().keys().iter().copied();
        keys.find(|key| self.leaves_open(key))
    }

    /// Whether a key of the kind could be stated and is not.
    pub fn leaves_open(&self, key: &str) -> bool {
        self.kind().keys().contains(&key) && !self.of_kinds.contains_key(key)
    }

    /// States a number of the kind.
    pub fn state(&mut self, key: &str, number: f64) {
        self.of_kinds.insert(key.to_owned(), number.into());
    }

    /// Checks that every stated key of a kind is one of this kind.
    ///
    /// # Errors
    /// [`OutOfRange`] for a key of another kind.
    pub fn check_kind(&self) -> Result<(), OutOfRange> {
        let kind = self.kind();
        match self.of_kinds.keys().find(|key| !kind.keys().contains(&key.as_str())) {
            Some(key) => {
                let found = format!("`{key}` with {}", kind.stated_as());
                Err(OutOfRange::new(key, found, either(&with::<C::Kind>(key))))
            }
            None => Ok(()),
        }
    }

    /// Keys of the kind.
    ///
    /// # Errors
    /// [`OutOfRange`] for a key of another kind.
    pub fn keys(&self) -> Result<<C::Kind as KeyedKind>::Keys, OutOfRange> {
        self.check_kind()?;
        // Each value was read as its type when the file was.
        let keys = self.kind().read(Value::Table(self.of_kinds.clone()));
        keys.map_err(|error| OutOfRange::new(C::FIELD, error.message(), format!("keys of its {}", C::FIELD)))
    }
}

/// Kinds that have a key.
fn with<K: KeyedKind>(key: &str) -> Vec<K> {
    let kinds = K::ALL.iter().copied();
    kinds.filter(|kind| kind.keys().contains(&key)).collect()
}

/// Keys of kinds, each once.
fn of_kinds<K: KeyedKind>() -> Vec<&'static str> {
    let mut keys: Vec<&str> = Vec::new();
    for key in K::ALL.iter().flat_map(|kind| kind.keys()) {
        if !keys.contains(key) {
            keys.push(key);
        }
    }
    keys
}

/// Error of a key that no kind has, as serde words it.
fn unknown<C: CommonKeys, E: de::Error>(key: &str) -> E {
    let known = [C::KEYS, &of_kinds::<C::Kind>()].concat().join("`, `");
    E::custom(format!("unknown field `{key}`, expected one of `{known}`"))
}

impl<'de, C: CommonKeys + Deserialize<'de>> Deserialize<'de> for KindTable<C> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Keys<C>(PhantomData<C>);
        impl<'de, C: CommonKeys + Deserialize<'de>> Visitor<'de> for Keys<C> {
            type Value = KindTable<C>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a table")
            }

            fn visit_map<A: MapAccess<'de>>(self, table: A) -> Result<KindTable<C>, A::Error> {
                let mut of_kinds = toml::Table::new();
                let common = Common::<C, A> {
                    table,
                    of_kinds: &mut of_kinds,
                    keys: PhantomData,
                };
                let common = Deserialize::deserialize(MapAccessDeserializer::new(common))?;
                Ok(KindTable { common, of_kinds })
            }
        }
        deserializer.deserialize_map(Keys(PhantomData))
    }
}

/// The common keys of a table; those of kinds are taken out on the way.
struct Common<'a, C, A> {
    table: A,
    of_kinds: &'a mut toml::Table,
    keys: PhantomData<C>,
}

impl<'de, C: CommonKeys, A: MapAccess<'de>> MapAccess<'de> for Common<'_, C, A> {
    type Error = A::Error;

    fn next_key_seed<S: DeserializeSeed<'de>>(&mut self, mut seed: S) -> Result<Option<S::Value>, A::Error> {
        loop {
            match self.table.next_key_seed(Key::<C, S>(seed, PhantomData))? {
                None => return Ok(None),
                Some(NextKey::Common(key)) => return Ok(Some(key)),
                Some(NextKey::OfKind(kind, key, unused)) => {
                    let value = self.table.next_value_seed(ValueOf(kind, key))?;
                    self.of_kinds.insert(key.to_owned(), value);
                    seed = unused;
                }
            }
        }
    }

    fn next_value_seed<S: DeserializeSeed<'de>>(&mut self, seed: S) -> Result<S::Value, A::Error> {
        self.table.next_value_seed(seed)
    }
}

struct Key<C, S>(S, PhantomData<C>);

enum NextKey<V, K, S> {
    Common(V),
    /// A key of kinds with one of them, and the seed for the next key.
    OfKind(K, &'static str, S),
}

impl<'de, C: CommonKeys, S: DeserializeSeed<'de>> DeserializeSeed<'de> for Key<C, S> {
    type Value = NextKey<S::Value, C::Kind, S>;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Self::Value, D::Error> {
        let name = String::deserialize(deserializer)?;
        for kind in C::Kind::ALL {
            if let Some(key) = kind.keys().iter().find(|key| **key == name) {
                return Ok(NextKey::OfKind(*kind, key, self.0));
            }
        }
        if !C::KEYS.contains(&name.as_str()) {
            return Err(unknown::<C, _>(&name));
        }
        self.0.deserialize(StrDeserializer::new(&name)).map(NextKey::Common)
    }
}

/// Value of a key of a kind.
struct ValueOf<K>(K, &'static str);

impl<'de, K: KeyedKind> DeserializeSeed<'de> for ValueOf<K> {
    type Value = Value;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Value, D::Error> {
        self.0.value(self.1, deserializer)
    }
}

/// Reads the value of a key as the type that a table of keys, none of them required, gives it.
///
/// # Errors
/// A value of another type.
pub fn typed<'de, T: Deserialize<'de> + Serialize, D: Deserializer<'de>>(
    key: &'static str,
    value: D,
) -> Result<Value, D::Error> {
    // Read as its type from the file itself: only there an error knows its line.
    let keys = T::deserialize(MapAccessDeserializer::new(OneKey(Some(key), Some(value))))?;
    let mut table = toml::Table::try_from(keys).map_err(de::Error::custom)?;
    table.remove(key).ok_or_else(|| de::Error::missing_field(key))
}

/// A table of one key, with its value.
struct OneKey<D>(Option<&'static str>, Option<D>);

impl<'de, D: Deserializer<'de>> MapAccess<'de> for OneKey<D> {
    type Error = D::Error;

    fn next_key_seed<S: DeserializeSeed<'de>>(&mut self, seed: S) -> Result<Option<S::Value>, D::Error> {
        let key = self.0.take();
        key.map(|key| seed.deserialize(StrDeserializer::new(key))).transpose()
    }

    fn next_value_seed<S: DeserializeSeed<'de>>(&mut self, seed: S) -> Result<S::Value, D::Error> {
        let value = self.1.take();
        seed.deserialize(value.ok_or_else(|| de::Error::custom("a key without a value"))?)
    }
}

impl<C: CommonKeys> JsonSchema for KindTable<C> {
    fn schema_name() -> Cow<'static, str> {
        C::schema_name()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let mut schema = C::json_schema(generator);
        let properties = &mut schema.ensure_object()["properties"];
        for kind in C::Kind::ALL {
            let of_kind = kind.schema(generator).to_value();
            for key in kind.keys() {
                properties[*key] = of_kind["properties"][*key].clone();
            }
        }
        let keys = of_kinds::<C::Kind>();
        let kinds: Vec<Vec<C::Kind>> = keys.iter().map(|key| with(key)).collect();
        let keys: Vec<(&str, &[C::Kind])> = keys.into_iter().zip(kinds.iter().map(Vec::as_slice)).collect();
        describe_keys(&mut schema, &keys, Some(C::FIELD));
        schema
    }
}
