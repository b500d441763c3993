//! `[needle]` of a scenario: one flat table of the keys of every needle and those of its model.
//!
//! Models are declared in [`insonify_mechanics::needle`]. Keys are read one by one as the file states them, so that an error of any is on its
//! own line; those of models are kept apart until all are read, for the model may be stated last.

use std::borrow::Cow;
use std::fmt;
use std::ops::{Deref, DerefMut};
use std::sync::LazyLock;

use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::Deserialize;
use serde::de::value::{MapAccessDeserializer, StrDeserializer};
use serde::de::{self, DeserializeSeed, Deserializer, MapAccess, Visitor};

use super::instruments::CommonNeedleKeys;
use insonify_base::range::{Kind, OutOfRange, Ranges, describe_keys, either};
use insonify_mechanics::needle::{NeedleKeys, NeedleModel};

/// The needle. Its motion is that of an undeflected needle: base and direction are what the hand holds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NeedleTable {
    /// Keys of needles of every model.
    pub common: CommonNeedleKeys,
    /// Keys of models.
    of_models: toml::Table,
}

impl From<CommonNeedleKeys> for NeedleTable {
    fn from(common: CommonNeedleKeys) -> Self {
        let of_models = toml::Table::new();
        Self { common, of_models }
    }
}

impl Deref for NeedleTable {
    type Target = CommonNeedleKeys;

    fn deref(&self) -> &CommonNeedleKeys {
        &self.common
    }
}

impl DerefMut for NeedleTable {
    fn deref_mut(&mut self) -> &mut CommonNeedleKeys {
        &mut self.common
    }
}

impl NeedleTable {
    /// Whether a key of the model could be stated and is not.
    pub fn leaves_open(&self, key: &str) -> bool {
        self.model.keys().contains(&key) && !self.of_models.contains_key(key)
    }

    /// States a number of the model.
    pub fn state(&mut self, key: &str, number: f64) {
        self.of_models.insert(key.to_owned(), number.into());
    }

    /// Keys of the model.
    ///
    /// # Errors
    /// [`OutOfRange`] for a key of another model.
    pub(crate) fn keys(&self) -> Result<NeedleKeys, OutOfRange> {
        let misplaced = self
            .of_models
            .keys()
            .find(|key| !self.model.keys().contains(&key.as_str()));
        if let Some(key) = misplaced {
            let found = format!("`{key}` with {}", self.model.stated_as());
            return Err(OutOfRange::new(key, found, either(&models_with(key))));
        }
        // Each value was read as its type when the file was.
        let keys = self.model.read(toml::Value::Table(self.of_models.clone()));
        keys.map_err(|error| OutOfRange::new("model", error.message(), "keys of the model"))
    }
}

fn models_with(key: &str) -> Vec<NeedleModel> {
    let models = NeedleModel::ALL.iter().copied();
    models.filter(|model| model.keys().contains(&key)).collect()
}

/// Keys of models, each once.
static OF_MODELS: LazyLock<Vec<&str>> = LazyLock::new(|| {
    let mut keys: Vec<&str> = Vec::new();
    for key in NeedleModel::ALL.iter().flat_map(|model| model.keys()) {
        if !keys.contains(key) {
            keys.push(key);
        }
    }
    keys
});

/// All keys.
static ALL: LazyLock<Vec<&str>> = LazyLock::new(|| [CommonNeedleKeys::KEYS, &OF_MODELS].concat());

impl<'de> Deserialize<'de> for NeedleTable {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Keys;
        impl<'de> Visitor<'de> for Keys {
            type Value = NeedleTable;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a table of a needle")
            }

            fn visit_map<A: MapAccess<'de>>(self, table: A) -> Result<NeedleTable, A::Error> {
                let mut of_models = toml::Table::new();
                let common = CommonKeys {
                    table,
                    of_models: &mut of_models,
                };
                let common = Deserialize::deserialize(MapAccessDeserializer::new(common))?;
                Ok(NeedleTable { common, of_models })
            }
        }
        deserializer.deserialize_map(Keys)
    }
}

/// The common keys of a table; those of models are taken out on the way.
struct CommonKeys<'a, A> {
    table: A,
    of_models: &'a mut toml::Table,
}

impl<'de, A: MapAccess<'de>> MapAccess<'de> for CommonKeys<'_, A> {
    type Error = A::Error;

    fn next_key_seed<S: DeserializeSeed<'de>>(&mut self, mut seed: S) -> Result<Option<S::Value>, A::Error> {
        loop {
            match self.table.next_key_seed(Key(seed))? {
                None => return Ok(None),
                Some(NextKey::Common(key)) => return Ok(Some(key)),
                Some(NextKey::OfModels(key, unused)) => {
                    let value = self.table.next_value_seed(ValueOf(key))?;
                    self.of_models.insert(key.to_owned(), value);
                    seed = unused;
                }
            }
        }
    }

    fn next_value_seed<S: DeserializeSeed<'de>>(&mut self, seed: S) -> Result<S::Value, A::Error> {
        self.table.next_value_seed(seed)
    }
}

struct Key<S>(S);

enum NextKey<V, S> {
    Common(V),
    /// A key of models, and the seed for the next key.
    OfModels(&'static str, S),
}

impl<'de, S: DeserializeSeed<'de>> DeserializeSeed<'de> for Key<S> {
    type Value = NextKey<S::Value, S>;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Self::Value, D::Error> {
        let name = String::deserialize(deserializer)?;
        if let Some(key) = OF_MODELS.iter().find(|key| **key == name) {
            return Ok(NextKey::OfModels(key, self.0));
        }
        if !CommonNeedleKeys::KEYS.contains(&name.as_str()) {
            return Err(de::Error::unknown_field(&name, &ALL));
        }
        self.0.deserialize(StrDeserializer::new(&name)).map(NextKey::Common)
    }
}

/// Value of a key of models, of the type that they give it.
struct ValueOf(&'static str);

impl<'de> DeserializeSeed<'de> for ValueOf {
    type Value = toml::Value;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<toml::Value, D::Error> {
        let key = self.0;
        // Read as its type from the file itself: only there an error knows its line.
        let alone = MapAccessDeserializer::new(OneKey(Some(key), Some(deserializer)));
        let model = models_with(key).into_iter().next();
        let keys = model.ok_or_else(|| de::Error::unknown_field(key, &ALL))?.read(alone)?;
        let mut table = toml::Table::try_from(keys).map_err(de::Error::custom)?;
        table.remove(key).ok_or_else(|| de::Error::missing_field(key))
    }
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

impl JsonSchema for NeedleTable {
    fn schema_name() -> Cow<'static, str> {
        "NeedleTable".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let mut schema = CommonNeedleKeys::json_schema(generator);
        let object = schema.ensure_object();
        let text =
            "The needle. Its motion is that of an undeflected needle: base and direction are what the hand holds.";
        object.insert("description".into(), text.into());
        for model in NeedleModel::ALL {
            let of_model = model.schema(generator).to_value();
            for key in model.keys() {
                object["properties"][*key] = of_model["properties"][*key].clone();
            }
        }
        let keys: Vec<(&str, Vec<NeedleModel>)> = OF_MODELS.iter().map(|key| (*key, models_with(key))).collect();
        let keys: Vec<(&str, &[NeedleModel])> = keys.iter().map(|(key, models)| (*key, &models[..])).collect();
        describe_keys(&mut schema, &keys, Some("model"));
        schema
    }
}
