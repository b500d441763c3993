//! Pages of reference, from the docs of sources, the registries and the schemas of files.

mod effects;
mod laws;
mod probes;

use std::error::Error;
use std::fs;
use std::io;

use insonify_testing::pages::root;
use serde_json::{Map, Value};

/// The command that writes the pages and their pictures.
pub(crate) const COMMAND: &str = "cargo run --release --example reference_pages -- docs";

/// Length of a line of text.
const COLUMNS: usize = 100;

/// The pages and their drawings: names below `docs/`, and contents.
pub(crate) fn files() -> Result<Vec<(String, String)>, Box<dyn Error>> {
    let mut files = vec![("effects.md".to_owned(), effects::page()?)];
    files.extend(laws::files()?);
    files.extend(probes::files()?);
    Ok(files)
}

/// A page: what it is about, a table of the things with a summary of each, the origin of its text, and their sections.
fn page(title: &str, lead: &str, [thing, summary]: [&str; 2], entries: &[Entry]) -> String {
    let rows: String = entries
        .iter()
        .map(|entry| format!("| [{0}](#{0}) | {1} |\n", entry.name, entry.summary))
        .collect();
    let sections: String = entries.iter().map(|entry| entry.section.as_str()).collect();
    let origin = folded(&format!(
        "`{COMMAND}` writes this page and its pictures from the docs of the sources, the registry and the schema of files."
    ));
    format!("# {title}\n\n{lead}\n| {thing} | {summary} |\n|---|---|\n{rows}\n{origin}{sections}")
}

/// A thing on a page.
struct Entry {
    name: &'static str,
    summary: String,
    section: String,
}

/// A source, below the workspace.
struct Source {
    path: String,
    text: String,
}

impl Source {
    fn read(path: String) -> io::Result<Self> {
        let text = fs::read_to_string(root().join(&path))?;
        Ok(Self { path, text })
    }

    /// Paragraphs and tables of the docs at its head, but for its example.
    ///
    /// # Errors
    /// A constant that they name without its value.
    fn docs(&self) -> io::Result<Vec<String>> {
        let lines = self.text.lines().map_while(|line| line.strip_prefix("//!"));
        self.paragraphs(lines.take_while(|line| !line.trim().starts_with("```")))
    }

    /// Paragraphs of the docs of its first public structure.
    ///
    /// # Errors
    /// As [`docs`](Self::docs).
    fn docs_of_structure(&self) -> io::Result<Vec<String>> {
        let before = self.text.split("\npub struct ").next().unwrap_or_default();
        let lines = before.lines().rev().skip_while(|line| line.starts_with('#'));
        let mut lines: Vec<&str> = lines.map_while(|line| line.strip_prefix("///")).collect();
        lines.reverse();
        self.paragraphs(lines.into_iter())
    }

    fn paragraphs<'a>(&self, lines: impl Iterator<Item = &'a str>) -> io::Result<Vec<String>> {
        let lines: Vec<&str> = lines.map(str::trim).collect();
        let paragraphs = lines.split(|line| line.is_empty()).filter(|lines| !lines.is_empty());
        let paragraph = |lines: &[&str]| {
            let is_table = lines[0].starts_with('|');
            let text = lines.join(if is_table { "\n" } else { " " });
            self.check_values(&text)?;
            Ok(without_links(&text))
        };
        paragraphs.map(paragraph).collect()
    }

    /// An error unless each constant of the source that a text links to is followed by its value in brackets.
    fn check_values(&self, text: &str) -> io::Result<()> {
        for link in text.split("[`").skip(1) {
            let Some((name, after)) = link.split_once("`]") else {
                continue;
            };
            let declaration = format!("const {name}: ");
            let declared = self
                .text
                .split_once(&declaration)
                .and_then(|(_, rest)| rest.split_once(';'));
            let Some((_, value)) = declared.and_then(|(typed, _)| typed.split_once(" = ")) else {
                continue;
            };
            let stated = after.strip_prefix(" (").is_some_and(|rest| rest.starts_with(value));
            if !stated {
                let wrong = format!("{}: `{name}` in the docs without ({value}) after it", self.path);
                return Err(io::Error::other(wrong));
            }
        }
        Ok(())
    }

    /// A link to the source.
    fn link(&self) -> String {
        format!("\n[Source](../{})\n", self.path)
    }

    /// The table of some keys, in the order in which the source declares them.
    fn key_table(&self, keys: &Map<String, Value>, schema: &Value) -> String {
        let mut keys: Vec<(&String, &Value)> = keys.iter().collect();
        keys.sort_by_key(|(key, _)| self.text.find(&format!("\n        {key}: ")));
        let mut text = "\n| key | meaning |\n|---|---|\n".to_owned();
        for (key, value) in keys {
            text += &format!("| `{key}` | {} |\n", meaning(value, schema).replace('|', "\\|"));
        }
        text
    }
}

/// Text in which links to items are their names, and links to modules lead to their sources.
fn without_links(text: &str) -> String {
    let mut parts = text.split("[`");
    let mut plain = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let (path, rest) = part.split_once("`]").unwrap_or((part, ""));
        let name = path.rsplit("::").next().unwrap_or(path);
        let source = format!(
            "src/imaging/{}.rs",
            path.trim_start_matches("crate::").replace("::", "/")
        );
        plain += &if path.starts_with("crate::") && root().join(&source).exists() {
            format!("[{name}](../{source}){rest}")
        } else {
            format!("`{name}`{rest}")
        };
    }
    plain
}

/// Paragraphs and tables as they stand on a page.
fn shown(docs: &[String]) -> String {
    let shown = |paragraph: &String| {
        if paragraph.starts_with('|') {
            format!("\n{paragraph}\n")
        } else {
            format!("\n{}", folded(paragraph))
        }
    };
    docs.iter().map(shown).collect()
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
