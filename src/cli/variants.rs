//! Values of arguments: numbers within a range, and enums of the library, whose names and descriptions come from the
//! schema of the enum.

use std::ops::RangeInclusive;
use std::str::FromStr;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use schemars::{JsonSchema, Schema, schema_for};
use serde::de::DeserializeOwned;

/// Possible values of an enum without fields, with their descriptions as help.
pub(crate) fn names<T: JsonSchema>() -> Vec<PossibleValue> {
    names_in(&schema_for!(T))
}

/// Possible values that the schema of an enum without fields has.
pub(crate) fn names_in(schema: &Schema) -> Vec<PossibleValue> {
    let variants = schema.get("oneOf").and_then(|variants| variants.as_array());
    let value = |variant: &serde_json::Value| {
        let name = variant["const"].as_str()?.to_owned();
        let about = variant["description"].as_str().unwrap_or_default().replace('\n', " ");
        Some(PossibleValue::new(name).help(about.trim_end_matches('.').to_owned()))
    };
    variants.into_iter().flatten().filter_map(value).collect()
}

/// Value with a name, if there is one.
pub(crate) fn named<T: DeserializeOwned>(name: &str) -> Option<T> {
    serde_json::from_value(name.into()).ok()
}

/// Parser of an enum without fields.
pub(crate) fn variants<T>() -> impl TypedValueParser<Value = T>
where
    T: JsonSchema + DeserializeOwned + Clone + Send + Sync + 'static,
{
    PossibleValuesParser::new(names::<T>()).try_map(|typed| {
        // Where case is ignored, clap passes on what was given.
        let names = names::<T>();
        let name = names
            .iter()
            .map(PossibleValue::get_name)
            .find(|name| name.eq_ignore_ascii_case(&typed));
        serde_json::from_value(name.unwrap_or(&typed).into())
    })
}

/// Parses a number within a range; `expected` describes the range in the error.
pub(crate) fn ranged<T: FromStr + PartialOrd>(
    text: &str,
    range: RangeInclusive<T>,
    expected: &str,
) -> Result<T, String> {
    let number = text.trim().parse().ok().filter(|number| range.contains(number));
    number.ok_or_else(|| format!("expected {expected}"))
}
