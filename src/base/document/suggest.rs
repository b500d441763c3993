//! Suggestions for misspelt words and misplaced keys of a file.

use schemars::JsonSchema;
use serde_json::Value;

use super::lists::schema_of;

/// Minimum similarity (Jaro-Winkler, 0 to 1) at which a word is suggested: letters swapped, one wrong or an ending left
/// out.
const SIMILAR: f64 = 0.8;

/// Returns the candidate most similar to a word, if any is similar enough.
pub fn nearest<'a>(word: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    // Similarity takes time proportional to the product of the lengths: no key is as long as what a broken file may
    // contain.
    let short: String = word.chars().take(60).collect();
    let scored = candidates.into_iter().map(|candidate| {
        (
            strsim::jaro_winkler(&short.to_lowercase(), &candidate.to_lowercase()),
            candidate,
        )
    });
    scored
        .filter(|(score, _)| *score >= SIMILAR)
        .reduce(|best, next| if next.0 > best.0 { next } else { best })
        .map(|(_, candidate)| candidate)
}

/// Extracts the key and the known keys from serde's message about an unknown field.
pub(super) fn unknown_field(message: &str) -> Option<(String, Vec<String>)> {
    unknown(message, "unknown field `")
}

/// Suggests a name for serde's message about an unknown variant.
pub(super) fn unknown_variant(message: &str) -> Option<String> {
    let (value, known) = unknown(message, "unknown variant `")?;
    nearest(&value, known.iter().map(String::as_str)).map(|meant| format!("did you mean \"{meant}\"?"))
}

fn unknown(message: &str, start: &str) -> Option<(String, Vec<String>)> {
    let rest = message.strip_prefix(start)?;
    let end = rest.find("`, ")?;
    let known = rest[end + 3..]
        .split('`')
        .skip(1)
        .step_by(2)
        .map(str::to_owned)
        .collect();
    Some((rest[..end].to_owned(), known))
}

/// Help for an unknown key: a similar key of the same table, the table where a key of that name belongs, or all
/// known keys.
pub(super) fn for_key(key: &str, known: &[String], home: impl FnOnce() -> Option<String>) -> Option<String> {
    let similar = nearest(key, known.iter().map(String::as_str)).map(|meant| format!("did you mean `{meant}`?"));
    let all = || (!known.is_empty()).then(|| format!("known here: {}", known.join(", ")));
    similar.or_else(home).or_else(all)
}

/// Where in a file of type `T` a key of that name belongs: in which tables, or before them.
pub(super) fn home_of<T: JsonSchema + 'static>(key: &str) -> Option<String> {
    let schema = schema_of::<T>();
    let mut tables = Vec::new();
    collect(&schema, &schema, [""; 2], key, 0, &mut tables);
    let in_tables = (!tables.is_empty()).then(|| format!("in {}", tables.join(" or ")));
    let is_table = |option: &Value| {
        let reference = option.get("$ref").and_then(Value::as_str);
        let target = reference.and_then(|reference| schema.pointer(reference.strip_prefix('#')?));
        let option = target.unwrap_or(option);
        option.get("properties").is_some() || option.get("items").is_some()
    };
    let top = schema.get("properties").and_then(|properties| properties.get(key));
    let is_value = top.is_some_and(|property| !options(property).into_iter().any(is_table));
    let places = is_value
        .then(|| "before all tables".to_owned())
        .into_iter()
        .chain(in_tables);
    let places: Vec<String> = places.collect();
    (!places.is_empty()).then(|| format!("`{key}` belongs {}", places.join(" or ")))
}

/// Paths of all keys of a file of type `T`, tables included; those of a table in a list follow `name[]`.
pub fn paths<T: JsonSchema + 'static>() -> Vec<String> {
    let schema = schema_of::<T>();
    let mut paths = Vec::new();
    let mut open = vec![(String::new(), &*schema, 0)];
    while let Some((path, part, depth)) = open.pop() {
        for option in options(part) {
            let reference = option.get("$ref").and_then(Value::as_str);
            let table = reference.and_then(|reference| schema.pointer(reference.strip_prefix('#')?));
            let table = table.unwrap_or(option);
            if let (Some(items), true) = (table.get("items"), depth < DEEPEST) {
                open.push((format!("{path}[]"), items, depth));
            }
            for (name, property) in table.get("properties").and_then(Value::as_object).into_iter().flatten() {
                let inner = if path.is_empty() {
                    name.clone()
                } else {
                    format!("{path}.{name}")
                };
                paths.push(inner.clone());
                if depth < DEEPEST {
                    open.push((inner, property, depth + 1));
                }
            }
        }
    }
    paths.sort_unstable();
    paths.dedup();
    paths
}

/// Maximum depth of nested tables.
const DEEPEST: usize = 3;

/// Adds the headers of the tables within `schema_part`, the one at `path`, that have a key.
fn collect(
    schema: &Value,
    schema_part: &Value,
    [path, header]: [&str; 2],
    key: &str,
    depth: usize,
    tables: &mut Vec<String>,
) {
    let Some(properties) = schema_part.get("properties").and_then(Value::as_object) else {
        return;
    };
    if !path.is_empty() && properties.contains_key(key) {
        tables.push(header.to_owned());
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
        // An optional table is `anyOf` the table and null, also one that may be `true` or `false`, and a table of a
        // named type a `$ref`: keys lie behind all of them.
        for option in options(item) {
            let reference = option.get("$ref").and_then(Value::as_str);
            let target = reference.and_then(|reference| schema.pointer(reference.strip_prefix('#')?));
            collect(
                schema,
                target.unwrap_or(option),
                [&inner, &header],
                key,
                depth + 1,
                tables,
            );
        }
    }
}

/// A schema, or those that it is any of.
fn options(item: &Value) -> Vec<&Value> {
    match item.get("anyOf").and_then(Value::as_array) {
        Some(several) => several.iter().flat_map(options).collect(),
        None => vec![item],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slips_are_recognised_and_strangers_are_not() {
        let keys = ["depth_mm", "width_mm", "frequency_mhz"];
        assert_eq!(nearest("depht_mm", keys), Some("depth_mm"));
        assert_eq!(nearest("frequency", keys), Some("frequency_mhz"));
        assert_eq!(nearest("Width_mm", keys), Some("width_mm"));
        assert_eq!(nearest("colour", keys), None);
    }

    #[test]
    fn messages_of_serde_are_understood() {
        let found = unknown_field("unknown field `a`, expected one of `b`, `c`, `d`");
        assert_eq!(found, Some(("a".into(), vec!["b".into(), "c".into(), "d".into()])));
        assert_eq!(
            unknown_field("unknown field `a`, expected `b` or `c`").map(|f| f.1.len()),
            Some(2)
        );
        assert_eq!(unknown_field("missing field `a`"), None);
    }

    #[test]
    fn an_unknown_key_is_corrected_or_sent_home_or_told_what_is_known() {
        let help = |key, home: Option<&str>| for_key(key, &["width".into()], || home.map(str::to_owned));
        assert_eq!(help("widht", Some("there")).as_deref(), Some("did you mean `width`?"));
        assert_eq!(help("depth", Some("there")).as_deref(), Some("there"));
        assert_eq!(help("depth", None).as_deref(), Some("known here: width"));
    }

    #[test]
    fn a_key_in_the_wrong_table_is_sent_home() {
        #[derive(JsonSchema)]
        #[allow(dead_code, reason = "read by its schema alone")]
        struct Tone {
            dynamic_range_db: f64,
        }
        #[derive(JsonSchema)]
        #[allow(dead_code, reason = "read by its schema alone")]
        struct Effects {
            tone: Option<Tone>,
        }
        #[derive(JsonSchema)]
        #[allow(dead_code, reason = "read by its schema alone")]
        struct Probe {
            frequency_mhz: f64,
        }
        #[derive(JsonSchema)]
        #[allow(dead_code, reason = "read by its schema alone")]
        struct Tissue {
            young_kpa: f64,
        }
        #[derive(JsonSchema)]
        #[allow(dead_code, reason = "read by its schema alone")]
        struct File {
            seed: Option<u64>,
            probe: Probe,
            effects: Option<Effects>,
            tissue: Vec<Tissue>,
        }
        let home = |key| home_of::<File>(key).unwrap_or_default();
        assert_eq!(home("frequency_mhz"), "`frequency_mhz` belongs in [probe]");
        assert_eq!(home("dynamic_range_db"), "`dynamic_range_db` belongs in [effects.tone]");
        assert_eq!(home("young_kpa"), "`young_kpa` belongs in [[tissue]]");
        assert_eq!(home("seed"), "`seed` belongs before all tables");
        assert_eq!(home("probe"), "");
        assert_eq!(home("frobnicate"), "");
    }
}
