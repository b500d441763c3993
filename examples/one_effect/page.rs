//! The page on the effects: what the docs of their sources, the registry and the schema of scene files say of each.

use std::fs;
use std::io;

use insonify::imaging::effects::{Effect, EffectsTable, LISTED};
use insonify_testing::pages::root;
use serde_json::Value;

/// What writes the page and its pictures.
pub(crate) const COMMAND: &str = "cargo run --release --example one_effect -- docs";

/// Length of a line of text.
const COLUMNS: usize = 100;

/// The page.
pub(crate) fn page() -> io::Result<String> {
    let schema = schemars::schema_for!(EffectsTable).to_value();
    let (mut rows, mut sections) = (String::new(), String::new());
    for effect in LISTED {
        let source = fs::read_to_string(root().join(source(effect)))?;
        let docs = docs(&source);
        let summary = docs.first().map_or("", |paragraph| after_the_name(paragraph));
        rows += &format!("| [{0}](#{0}) | {summary} |\n", effect.name);
        sections += &section(effect, &docs, &keys(effect, &source, &schema));
    }
    let lead = folded(
        "What each effect adds to a frame, the keys by which a scene calls for it, and a frame without them, on the left, and \
         with them. Pictures show one effect beside the tone curve, by the keys above them, which exaggerate; here is each, \
         and then all of them together.",
    );
    let origin = folded(&format!(
        "`{COMMAND}` writes this page and its pictures from the docs of the sources, the registry of effects and the \
         schema of scene files (`insonify schema scene`)."
    ));
    Ok(format!(
        "# Effects\n\n{lead}\n![Each effect alone, then all together](effects.png)\n\n| effect | what it does |\n|---|---|\n{rows}\n{origin}{sections}"
    ))
}

/// Source of an effect, below the workspace.
fn source(effect: &Effect) -> String {
    format!("src/imaging/effects/{}.rs", effect.name)
}

/// Paragraphs and tables of the docs at the head of a source, but for its example.
fn docs(source: &str) -> Vec<String> {
    let lines = source.lines().map_while(|line| line.strip_prefix("//!"));
    let lines: Vec<&str> = lines
        .map(str::trim)
        .take_while(|line| !line.starts_with("```"))
        .collect();
    let paragraphs = lines.split(|line| line.is_empty()).filter(|lines| !lines.is_empty());
    paragraphs
        .map(|lines| {
            let is_table = lines[0].starts_with('|');
            without_links(&lines.join(if is_table { "\n" } else { " " }))
        })
        .collect()
}

/// Text in which links to items are their names.
fn without_links(text: &str) -> String {
    let mut parts = text.split("[`");
    let mut plain = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let (path, rest) = part.split_once("`]").unwrap_or((part, ""));
        let name = path.rsplit("::").next().unwrap_or(path);
        plain += &format!("`{name}`{rest}");
    }
    plain
}

/// A first paragraph without the name of the effect before its colon.
fn after_the_name(paragraph: &str) -> &str {
    paragraph.split_once(": ").map_or(paragraph, |(_, rest)| rest)
}

fn section(effect: &Effect, docs: &[String], keys: &str) -> String {
    let mut text = format!("\n## {}\n", effect.name);
    for paragraph in docs {
        text += "\n";
        text += &if paragraph.starts_with('|') {
            format!("{paragraph}\n")
        } else {
            folded(paragraph)
        };
    }
    if effect.remove.is_none() {
        text += "\nEvery frame has it.\n";
    }
    if !effect.example.is_empty() {
        text += &format!(
            "\n```toml\n{}\n```\n\n![A frame without these keys, and with them](effects/{name}.png)\n",
            effect.example,
            name = effect.name
        );
    }
    text + keys + &format!("\n[Source](../{})\n", source(effect))
}

/// The table of an effect's keys; nothing for one without.
fn keys(effect: &Effect, source: &str, schema: &Value) -> String {
    let Some(table) = definition(&schema["properties"][effect.name], schema) else {
        return String::new();
    };
    let mut keys: Vec<(&String, &Value)> = table["properties"].as_object().into_iter().flatten().collect();
    // As in the source: the schema has them by the alphabet.
    keys.sort_by_key(|(key, _)| source.find(&format!("\n        {key}: ")));
    let mut text = "\n".to_owned() + &folded(&format!("Keys of `effects.{}`. {}", effect.name, description(table)));
    text += "\n| key | meaning |\n|---|---|\n";
    for (key, value) in keys {
        text += &format!("| `{key}` | {} |\n", meaning(value, schema).replace('|', "\\|"));
    }
    text
}

/// The definition that a schema refers to, also as the first of several.
fn definition<'a>(part: &Value, schema: &'a Value) -> Option<&'a Value> {
    match part["$ref"].as_str() {
        Some(reference) => schema.pointer(reference.strip_prefix('#')?),
        None => definition(part.get("anyOf")?.get(0)?, schema),
    }
}

fn description(schema: &Value) -> String {
    let words = schema["description"].as_str().unwrap_or_default().split_whitespace();
    without_links(&words.collect::<Vec<_>>().join(" "))
}

/// Description of a key with its choices and its default.
fn meaning(key: &Value, schema: &Value) -> String {
    let mut text = description(key);
    let choices = definition(key, schema).and_then(|choices| choices["oneOf"].as_array());
    for choice in choices.into_iter().flatten() {
        text += &format!(" `{}`: {}", choice["const"], description(choice));
    }
    if !key["default"].is_null() && !text.contains("Default") {
        text += &format!(" Default `{}`.", key["default"]);
    }
    text
}

/// Text in lines. A span in backticks stays in one line.
fn folded(text: &str) -> String {
    let (mut lines, mut word) = (vec![String::new()], String::new());
    for part in text.split_whitespace() {
        if !word.is_empty() {
            word.push(' ');
        }
        word += part;
        if word.matches('`').count() % 2 == 1 {
            continue;
        }
        let line = lines
            .last_mut()
            .filter(|line| line.is_empty() || line.chars().count() + word.chars().count() < COLUMNS);
        match line {
            Some(line) if line.is_empty() => *line = word,
            Some(line) => *line += &format!(" {word}"),
            None => lines.push(word),
        }
        word = String::new();
    }
    lines.join("\n") + "\n"
}
