//! Correct tables for misplaced keys.

use schemars::{JsonSchema, SchemaGenerator};
use serde_json::Value;

/// Lists the tables of a file of type `T` that have a key of that name.
pub fn home_of<T: JsonSchema>(key: &str) -> Option<String> {
    let schema = SchemaGenerator::default().into_root_schema_for::<T>().to_value();
    let mut tables = Vec::new();
    collect(&schema, &schema, [""; 2], key, 0, &mut tables);
    (!tables.is_empty()).then(|| format!("`{key}` belongs in {}", tables.join(" or ")))
}

/// Maximum depth of nested tables.
const DEEPEST: usize = 3;

fn collect(schema: &Value, at: &Value, [path, header]: [&str; 2], key: &str, depth: usize, found: &mut Vec<String>) {
    let Some(properties) = at.get("properties").and_then(Value::as_object) else {
        return;
    };
    if !path.is_empty() && properties.contains_key(key) {
        found.push(header.to_owned());
    }
    if depth == DEEPEST {
        return;
    }
    for (name, property) in properties {
        let inner = if path.is_empty() {
            name.clone()
        } else {
            format!("{path}.{name}")
        };
        let (item, header) = match property.get("items") {
            Some(items) => (items, format!("[[{inner}]]")),
            None => (property, format!("[{inner}]")),
        };
        let options = item
            .get("anyOf")
            .and_then(Value::as_array)
            .map_or(std::slice::from_ref(item), Vec::as_slice);
        for option in options {
            let reference = option.get("$ref").and_then(Value::as_str);
            let target = reference.and_then(|reference| schema.pointer(reference.strip_prefix('#')?));
            collect(
                schema,
                target.unwrap_or(option),
                [&inner, &header],
                key,
                depth + 1,
                found,
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::scene::SceneFile;

    #[test]
    fn a_key_in_the_wrong_table_is_sent_home() {
        let home = |key| home_of::<SceneFile>(key).unwrap_or_default();
        assert_eq!(home("frequency_mhz"), "`frequency_mhz` belongs in [probe]");
        assert_eq!(home("dynamic_range_db"), "`dynamic_range_db` belongs in [effects.tone]");
        assert_eq!(home("young_kpa"), "`young_kpa` belongs in [[tissue]]");
        assert_eq!(home("frobnicate"), "");
    }
}
