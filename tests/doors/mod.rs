//! Doors: what a crate shows is what others use.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Crates with a door, by their folder in `src/`; the root lets embedders use all of it, and the command nothing.
const LAYERS: [&str; 9] = [
    "base", "report", "gpu", "mesh", "anatomy", "tracking", "imaging", "mechanics", "study",
];

fn root() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
}

/// Rust sources below a folder.
fn sources(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).expect("a folder").flatten() {
        let path = entry.path();
        if path.is_dir() {
            files.extend(sources(&path));
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            files.push(path);
        }
    }
    files
}

/// A source without comments and unit tests.
fn code(path: &Path) -> String {
    let is_test = path.iter().any(|part| part == "tests" || part == "tests.rs");
    let text = std::fs::read_to_string(path).expect("a source");
    let text = match is_test {
        true => "",
        false => text.split("#[cfg(test)]\nmod tests {").next().unwrap_or_default(),
    };
    let lines = text.lines().map(|line| line.split("//").next().unwrap_or_default());
    lines.collect::<Vec<_>>().join("\n")
}

fn words(text: &str) -> impl Iterator<Item = &str> {
    text.split(|c: char| !c.is_alphanumeric() && c != '_')
}

/// Name of an item that a line declares as `pub`.
fn declared(line: &str) -> Option<&str> {
    let mut rest = line.trim_start().strip_prefix("pub ")?;
    for qualifier in ["const ", "async ", "unsafe "] {
        if rest.starts_with("const ") && !rest.starts_with("const fn") {
            break;
        }
        rest = rest.strip_prefix(qualifier).unwrap_or(rest);
    }
    let (kind, rest) = rest.split_once(' ')?;
    let is_item = ["fn", "struct", "enum", "union", "trait", "const", "static", "type", "mod"].contains(&kind);
    is_item.then(|| words(rest).next().unwrap_or_default())
}

/// A name counts as used if it stands anywhere in another crate, in a test, a benchmark or an example, or in the declaration of another name at
/// the same door, as the types of its arguments do.
#[test]
fn whatever_a_crate_shows_somebody_else_uses() {
    let mut by_layer: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for path in sources(&root().join("src")) {
        let inside = path.strip_prefix(root().join("src")).expect("a source");
        let first = inside.iter().next().expect("a name").to_string_lossy().into_owned();
        let layer = match LAYERS.contains(&first.as_str()) || ["cli", "testing"].contains(&first.as_str()) {
            true => first,
            false => "root".to_owned(),
        };
        by_layer.entry(layer).or_default().push(code(&path));
    }
    for folder in ["tests", "benches", "examples"] {
        let text = sources(&root().join(folder)).into_iter().map(|path| std::fs::read_to_string(path).expect("a source"));
        by_layer.entry(folder.to_owned()).or_default().extend(text);
    }
    let mut unused: Vec<String> = Vec::new();
    for layer in LAYERS {
        let others: BTreeSet<&str> = by_layer
            .iter()
            .filter(|(other, _)| *other != layer)
            .flat_map(|(_, texts)| texts.iter().flat_map(|text| words(text)))
            .collect();
        let own = &by_layer[layer];
        let lines: Vec<&str> = own.iter().flat_map(|text| text.lines()).collect();
        for name in lines.iter().filter_map(|line| declared(line)) {
            let is_beside = |line: &&&str| {
                line.trim_start().starts_with("pub ") && declared(line) != Some(name) && words(line).any(|word| word == name)
            };
            if !others.contains(name) && lines.iter().find(is_beside).is_none() {
                unused.push(format!("{layer}: {name}"));
            }
        }
    }
    assert!(unused.is_empty(), "{} names that nobody uses: {unused:#?}", unused.len());
}
