//! Where a key belongs that a scene file has elsewhere.

use std::sync::OnceLock;

use serde_json::Value;

/// The tables of a scene that have a key of that name, in words.
pub(super) fn home_of(key: &str) -> Option<String> {
    let tables = tables_with(key);
    (!tables.is_empty()).then(|| format!("`{key}` belongs in {}", tables.join(" or ")))
}

/// The tables of a scene that have a key of that name, as their headers.
fn tables_with(key: &str) -> Vec<String> {
    static SCHEMA: OnceLock<Value> = OnceLock::new();
    let schema = SCHEMA.get_or_init(super::schema);
    let mut found = Vec::new();
    collect(schema, schema, [""; 2], key, 0, &mut found);
    found
}

/// How deep tables lie within tables in a scene.
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

    #[test]
    fn a_key_in_the_wrong_table_is_sent_home() {
        assert_eq!(
            home_of("frequency_mhz").as_deref(),
            Some("`frequency_mhz` belongs in [probe]")
        );
        assert_eq!(tables_with("dynamic_range_db"), ["[effects.tone]"]);
        assert_eq!(tables_with("young_kpa"), ["[[tissue]]"]);
        assert_eq!(home_of("frobnicate"), None);
    }
}
