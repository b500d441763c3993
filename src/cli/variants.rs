//! Values of arguments that are enums of the library, whose names and descriptions come from the schema of the enum.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use schemars::{JsonSchema, schema_for};
use serde::de::DeserializeOwned;

/// Possible values of an enum without fields, with their descriptions as help.
pub fn names<T: JsonSchema>() -> Vec<PossibleValue> {
    let schema = schema_for!(T);
    let variants = schema.get("oneOf").and_then(|variants| variants.as_array());
    let value = |variant: &serde_json::Value| {
        let name = variant["const"].as_str()?.to_owned();
        let about = variant["description"].as_str().unwrap_or_default().replace('\n', " ");
        Some(PossibleValue::new(name).help(about.trim_end_matches('.').to_owned()))
    };
    variants.into_iter().flatten().filter_map(value).collect()
}

/// Value with a name, if there is one.
pub fn named<T: DeserializeOwned>(name: &str) -> Option<T> {
    serde_json::from_value(name.into()).ok()
}

/// Parser of an enum without fields.
pub fn variants<T>() -> impl TypedValueParser<Value = T>
where
    T: JsonSchema + DeserializeOwned + Clone + Send + Sync + 'static,
{
    PossibleValuesParser::new(names::<T>()).try_map(|name| serde_json::from_value(name.into()))
}
