//! Doors: what a crate shows is what others use.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Crates with a door, by their folder in `src/`; embedders may use all of the root, and nobody the command.
const LAYERS: [&str; 9] = [
    "base",
    "report",
    "gpu",
    "mesh",
    "anatomy",
    "tracking",
    "imaging",
    "mechanics",
    "study",
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

/// A source without comments, and without unit tests where they do not count.
fn code(path: &Path, with_tests: bool) -> String {
    let is_test = path.iter().any(|part| part == "tests" || part == "tests.rs");
    let text = std::fs::read_to_string(path).expect("a source");
    let text = match (with_tests, is_test) {
        (true, _) => text.as_str(),
        (false, true) => "",
        (false, false) => text.split("#[cfg(test)]\nmod tests {").next().unwrap_or_default(),
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
    let is_item = [
        "fn", "struct", "enum", "union", "trait", "const", "static", "type", "mod",
    ]
    .contains(&kind);
    is_item.then(|| words(rest).next().unwrap_or_default())
}

/// Declarations at a door, each on one line: signatures, fields, and enumerations and traits whole. Methods of types
/// that the root re-exports belong to embedders.
fn declarations(text: &str, exported: &BTreeSet<&str>) -> Vec<String> {
    let mut declarations: Vec<String> = Vec::new();
    let mut is_exported = false;
    // What ends the declaration that is being read.
    let mut end: Option<fn(&str) -> bool> = None;
    for line in text.lines() {
        if let Some(implemented) = line.strip_prefix("impl") {
            let of = implemented.rsplit(" for ").next().unwrap_or_default();
            is_exported = words(of).any(|word| exported.contains(word));
        }
        if let (Some(ends), Some(last)) = (end, declarations.last_mut()) {
            last.push_str(line);
            end = Some(ends).filter(|ends| !ends(line));
            continue;
        }
        if line.trim_start().starts_with("type ") {
            // An associated type.
            declarations.push(line.to_owned());
            continue;
        }
        let Some(rest) = line.trim_start().strip_prefix("pub ") else {
            continue;
        };
        let ends: fn(&str) -> bool = match rest.split(' ').next() {
            Some("enum" | "trait") => |line| line.starts_with('}') || line.ends_with('}'),
            Some("fn" | "const" | "async") => |line| line.ends_with(['{', ';', '}']),
            _ => |_| true,
        };
        // The name of such a method does not count, the types in it do.
        let belongs_to_embedders = line.starts_with(' ') && is_exported && declared(line).is_some();
        declarations.push(line.replacen("pub ", if belongs_to_embedders { "" } else { "pub " }, 1));
        end = Some(ends).filter(|ends| !ends(line));
    }
    declarations
}

/// Names at the end of paths from `$crate`, which macros write into other crates.
fn written_by_macros(text: &str) -> impl Iterator<Item = &str> {
    let ends = |c: char| !c.is_alphanumeric() && c != '_' && c != ':';
    let paths = text
        .split("$crate::")
        .skip(1)
        .filter_map(move |rest| rest.split(ends).next());
    paths.filter_map(|path| path.trim_end_matches(':').rsplit("::").next())
}

/// Names that `insonify` re-exports, but for globs.
fn at_the_root(lib: &str) -> impl Iterator<Item = &str> {
    let statements = lib.split("\npub use ").skip(1);
    let lists = statements.map(|rest| rest.split_once(';').map_or("", |(list, _)| list));
    let names = lists.flat_map(|list| match list.split_once('{') {
        Some((_, names)) => names.trim_end_matches('}').split(',').collect(),
        None => vec![list],
    });
    let names = names.map(|name| name.trim().rsplit([' ', ':']).next().unwrap_or_default());
    names.filter(|name| !name.is_empty() && !["*", "self"].contains(name))
}

#[test]
fn the_page_of_the_root_lists_its_names() {
    let lib = std::fs::read_to_string(root().join("src/lib.rs")).expect("the root");
    let page: String = lib.lines().filter(|line| line.starts_with("//! |")).collect();
    let crates = ["anatomy", "base", "gpu", "imaging", "mechanics", "mesh", "tracking"];
    let names = at_the_root(&lib).filter(|name| !crates.contains(name));
    let unlisted: Vec<&str> = names.filter(|name| !page.contains(&format!("[`{name}`]"))).collect();
    assert!(unlisted.is_empty(), "not on the page of the crate: {unlisted:?}");
    // Whatever stands there may be imported by that name.
    for hidden in [
        "Wrench",
        "Snapshot",
        "Needs",
        "UnknownHole",
        "MovedTissue",
        "InsertionAnatomy",
    ] {
        assert!(at_the_root(&lib).any(|name| name == hidden), "{hidden}");
    }
}

/// A name counts as used if it stands anywhere in another crate, in a test, a benchmark or an example, or in the
/// declaration of another name at the same door, as the types of its arguments do.
#[test]
fn whatever_a_crate_shows_somebody_else_uses() {
    let lib = std::fs::read_to_string(root().join("src/lib.rs")).expect("the root");
    let mut exported: BTreeSet<&str> = lib.split("pub use ").skip(1).flat_map(words).collect();
    // Registries show the types that they list.
    let registries = [
        ("imaging/effects.rs", "\nregistry! {"),
        ("mechanics/needle.rs", "needle_models! {"),
        ("mechanics/needle/beam/material.rs", "\nmaterials! {"),
    ];
    let listed = registries.map(|(path, start)| {
        let text = std::fs::read_to_string(root().join("src").join(path)).expect("a source");
        let list = text.split(start).nth(1).expect("the registry");
        list.split("\n}\n").next().unwrap_or_default().to_owned()
    });
    exported.extend(listed.iter().flat_map(|list| words(list)));
    // By layer: sources without unit tests, and all that may use the names of others.
    let mut by_layer: BTreeMap<String, Vec<String>> = BTreeMap::new();
    let mut users: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for path in sources(&root().join("src")) {
        let inside = path.strip_prefix(root().join("src")).expect("a source");
        let first = inside.iter().next().expect("a name").to_string_lossy().into_owned();
        by_layer.entry(first.clone()).or_default().push(code(&path, false));
        users.entry(first).or_default().push(code(&path, true));
    }
    for folder in ["tests", "benches", "examples"] {
        let texts = sources(&root().join(folder)).into_iter().map(|path| code(&path, true));
        users.entry(folder.to_owned()).or_default().extend(texts);
    }
    let mut unused: Vec<String> = Vec::new();
    for layer in LAYERS {
        let elsewhere = users.iter().filter(|(other, _)| *other != layer);
        let others: BTreeSet<&str> = elsewhere
            .flat_map(|(_, texts)| texts.iter().flat_map(|text| words(text)))
            .collect();
        let lines: Vec<String> = by_layer[layer]
            .iter()
            .flat_map(|text| declarations(text, &exported))
            .collect();
        for name in lines.iter().filter_map(|line| declared(line)) {
            let beside = |line: &String| declared(line) != Some(name) && words(line).any(|word| word == name);
            let by_macro = || {
                by_layer[layer]
                    .iter()
                    .flat_map(|text| written_by_macros(text))
                    .any(|word| word == name)
            };
            if !others.contains(name) && !exported.contains(name) && !lines.iter().any(beside) && !by_macro() {
                unused.push(format!("{layer}: {name}"));
            }
        }
    }
    assert!(
        unused.is_empty(),
        "{} names that nobody uses: {unused:#?}",
        unused.len()
    );
}

/// Calls of decoders of other crates that take memory by what a file states.
const DECODERS: [&str; 9] = [
    "GzDecoder::new(",
    "ZlibDecoder::new(",
    "DeflateDecoder::new(",
    "BzDecoder::new(",
    "reader.decode()",
    "OpenFileOptions::new()",
    "decode_pixel_data_frame(",
    "read_ply(",
    "Document::parse(",
];

/// A decoder stands behind the border: its call is given to `insonify_base::border` in the same line, or the function
/// that calls it is.
#[test]
fn decoders_of_others_are_called_behind_the_border() {
    // The function below is handed over whole.
    let handed_over = ["decode_pixel_data_frame("];
    let mut found = BTreeSet::new();
    for path in sources(&root().join("src")) {
        for line in code(&path, false).lines() {
            for decoder in DECODERS.iter().filter(|decoder| line.contains(*decoder)) {
                let is_behind = line.contains("border::") || line.contains("Guarded(") || handed_over.contains(decoder);
                assert!(is_behind, "{}: {line}", path.display());
                found.insert(*decoder);
            }
        }
    }
    assert_eq!(found.len(), DECODERS.len(), "{found:?}");
    let dicom = code(&root().join("src/study/realism/picture/dicom.rs"), false);
    assert!(dicom.contains("border::guarded(|| frame(&object"));
    // Whole formats of `image` are opened in one place.
    for word in ["image::open(", "load_from_memory", "PngDecoder", "JpegDecoder"] {
        let others = sources(&root().join("src"))
            .into_iter()
            .filter(|path| code(path, false).contains(word));
        assert_eq!(others.collect::<Vec<_>>(), Vec::<PathBuf>::new(), "{word}");
    }
}
