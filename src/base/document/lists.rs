//! Lists in place of tables: serde reads them by the order of the fields, so that another order would give a file
//! another meaning.

use std::any::TypeId;
use std::collections::BTreeMap;
use std::fmt;
use std::marker::PhantomData;
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

use schemars::JsonSchema;
use serde::de::value::MapAccessDeserializer;
use serde::de::{Deserializer, MapAccess, Visitor};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use toml::Spanned;
use toml::de::DeValue;

use super::renamed::now;

/// A table of a format other than TOML, and no list.
#[derive(Clone, Copy, Debug, Serialize)]
#[serde(transparent)]
pub struct Table<T>(pub T);

impl<'de, T: Deserialize<'de>> Deserialize<'de> for Table<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Keys<T>(PhantomData<T>);
        impl<'de, T: Deserialize<'de>> Visitor<'de> for Keys<T> {
            type Value = Table<T>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a table")
            }

            fn visit_map<A: MapAccess<'de>>(self, keys: A) -> Result<Table<T>, A::Error> {
                T::deserialize(MapAccessDeserializer::new(keys)).map(Table)
            }
        }
        deserializer.deserialize_map(Keys(PhantomData))
    }
}

/// Place of the first list where the type of a file has a table and no list, and its key.
pub(super) fn in_place_of_table<T: JsonSchema + 'static>(
    file: &Spanned<DeValue<'_>>,
) -> Option<(Range<usize>, String)> {
    let schema = schema_of::<T>();
    let (span, mut keys) = find(file, "", &alternatives(&schema, [&*schema]), &schema)?;
    keys.reverse();
    Some((span, keys.join(".")))
}

/// The schema of a type, made once.
pub(super) fn schema_of<T: JsonSchema + 'static>() -> Arc<Value> {
    static SCHEMAS: Mutex<BTreeMap<TypeId, Arc<Value>>> = Mutex::new(BTreeMap::new());
    let mut schemas = SCHEMAS.lock().unwrap_or_else(PoisonError::into_inner);
    let schema = schemas.entry(TypeId::of::<T>());
    Arc::clone(schema.or_insert_with(|| Arc::new(schemars::schema_for!(T).to_value())))
}

/// Schemas that a value may follow: behind references and alternatives.
fn alternatives<'a>(root: &'a Value, nodes: impl IntoIterator<Item = &'a Value>) -> Vec<&'a Value> {
    let mut open: Vec<&Value> = nodes.into_iter().collect();
    let mut all = Vec::new();
    while let Some(node) = open.pop() {
        let reference = node.get("$ref").and_then(Value::as_str);
        open.extend(reference.and_then(|reference| root.pointer(reference.strip_prefix('#')?)));
        for key in ["anyOf", "oneOf"] {
            open.extend(node.get(key).and_then(Value::as_array).into_iter().flatten());
        }
        all.push(node);
    }
    all
}

fn admits(node: &Value, kind: &str) -> bool {
    match node.get("type") {
        Some(Value::String(only)) => only == kind,
        Some(Value::Array(kinds)) => kinds.iter().any(|one| one == kind),
        _ => false,
    }
}

/// The list below a value of a table or list that is called `name`, and its keys, innermost first.
fn find<'a>(
    value: &'a Spanned<DeValue<'_>>,
    name: &str,
    schemas: &[&Value],
    root: &Value,
) -> Option<(Range<usize>, Vec<&'a str>)> {
    match value.get_ref() {
        DeValue::Array(items) => {
            let admit = |kind| schemas.iter().any(|node| admits(node, kind));
            if admit("object") && !admit("array") {
                return Some((value.span(), Vec::new()));
            }
            let schemas = alternatives(root, schemas.iter().filter_map(|node| node.get("items")));
            items.iter().find_map(|item| find(item, name, &schemas, root))
        }
        DeValue::Table(table) => table.iter().find_map(|(key, value)| {
            if !matches!(value.get_ref(), DeValue::Array(_) | DeValue::Table(_)) {
                return None;
            }
            let key: &str = key.get_ref();
            // Schemas have the new names only.
            let new = now(name, key).unwrap_or(key);
            let keyed = schemas.iter().filter_map(|node| {
                let stated = node.get("properties").and_then(|keys| keys.get(new));
                stated.or_else(|| node.get("additionalProperties"))
            });
            let (span, mut keys) = find(value, new, &alternatives(root, keyed), root)?;
            keys.push(key);
            Some((span, keys))
        }),
        _ => None,
    }
}
