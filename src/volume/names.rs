//! Label names as user-defined keys `LabelName_<value>`.

use std::collections::BTreeMap;

const PREFIX: &str = "LabelName_";

/// Key of the name of a label value.
pub(crate) fn key(value: i64) -> String {
    format!("{PREFIX}{value}")
}

/// Parses the label names among the keys of a file.
pub(crate) fn from_keys(key_values: &[(String, String)]) -> BTreeMap<i64, String> {
    key_values
        .iter()
        .filter_map(|(key, name)| Some((key.strip_prefix(PREFIX)?.parse().ok()?, name.clone())))
        .collect()
}
