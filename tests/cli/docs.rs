//! The commands, tables and links of README.md and the pages of `docs/`.
//!
//! The commands of a page run in order in a folder of its own. A file that they name is made by a command before, is a
//! block of the page after a line that ends in its name and a colon, or is one that a reader brings (`bring`). Nothing
//! is run for a NAME in capitals. What is [`SLOW`], and what reads its output, runs by `.ci/more docs`; here its files
//! are looked for. The unit tests of the command parse all commands.

use std::collections::BTreeSet;
use std::path::Path;
use std::process::Stdio;
use std::time::Instant;

use insonify::input::statics::ProblemFile;
use insonify::{ScenarioFile, SceneFile};
use insonify_base::document::InputError;
use insonify_study::{beam_case, identification, material_case};
use insonify_testing::pages::{Page, invocations, pages, root, sources, texts};
use insonify_testing::shared;
use serde_json::Value;

#[path = "../../examples/reference_pages/pages/mod.rs"]
mod reference_pages;

use crate::beam_measure;
use crate::support::{Bench, Run};

/// Commands that take more than two seconds of processor time in `dev`: a subcommand, and words that the command must
/// have.
const SLOW: [&str; 19] = [
    "tradeoff",
    "stability",
    "bench",
    "insert -o",
    "path -o",
    "identify -o",
    "rf two-layer-insertion",
    "motion",
    "beam measure",
    "exercise",
    "register",
    "realism --against",
    "render --frames",
    "plan mine.toml",
    "puncture",
    "match",
    "texture",
    "manipulator workspace",
    "mesh make 3300",
];

/// Options whose value is written; `>` is the shell's.
const WRITTEN: [&str; 8] = [
    "-o",
    ">",
    "--fit",
    "--page",
    "--truth",
    "--strain",
    "--history",
    "--rheometer",
];

/// Files that a reader brings, from the real data.
const REAL: [(&str, &str); 12] = [
    ("labels.nii.gz", "volumes/ts_example_seg_full.nii.gz"),
    ("ct.nii.gz", "volumes/ts_example_ct.nii.gz"),
    ("recording.igs.mha", "tracked/BoneUltrasound_L14.igs.mha"),
    ("config.xml", "config/BoneUltrasound_L14_config.xml"),
    ("phantom.seg.nrrd", "volumes/Segmentation.seg.nrrd"),
    ("phantom.igs.mha", "tracked/NwirePhantomFreehand.igs.mha"),
    (
        "phantom.xml",
        "config/PlusDeviceSet_NwirePhantomFreehand_vtkVolumeReconstructorTest2.xml",
    ),
    ("real", "real/frames"),
    ("real.png", "real/frames/liver_01.png"),
    ("liver.png", "real/frames/liver_01.png"),
    ("muscle-long.png", "real/frames/muscle_gl_01.png"),
    ("muscle-cross.png", "real/frames/muscle_gm_01.png"),
];

/// Puts a file that a reader brings into the folder, if it is to be read. False if there is no such file.
fn bring(bench: &Bench, name: &str, is_read: bool) -> bool {
    let name = name.trim_end_matches('/');
    let path = root().join("tests/data/reader").join(name);
    let real = REAL.iter().find(|(known, _)| *known == name);
    let source = match real {
        _ if path.exists() => Some(path),
        Some((_, path)) => shared(path),
        None => return beam_measure::bring(bench, name, is_read),
    };
    if let Some(source) = source.filter(|_| is_read && !bench.path(name).exists()) {
        std::os::unix::fs::symlink(source, bench.path(name)).expect("a link");
    }
    true
}

/// Whether a word of a command is the name of a file: neither option, number nor NAME.
fn is_file(word: &str) -> bool {
    let number = |word: &str| {
        word.chars()
            .all(|letter| letter.is_ascii_digit() || ".,-e".contains(letter))
    };
    word.contains(['.', '/']) && !word.starts_with('-') && !word.contains('=') && !number(word)
}

/// Whether a word stands for one of the reader's choice.
fn is_placeholder(word: &str) -> bool {
    let stem = word.split('.').next().unwrap_or(word);
    stem.len() > 1 && stem.chars().all(|letter| letter.is_ascii_uppercase() || letter == ',')
}

/// Runs the commands of a page, and says which fail.
fn run(page: &Page, all: bool) -> Vec<String> {
    let bench = Bench::new();
    let mut faults = Vec::new();
    // Files that are not here: of commands that are not run, and of real data that is missing.
    let mut awaited: BTreeSet<String> = BTreeSet::new();
    for block in page.blocks() {
        let Some(file) = block.file else { continue };
        bench.write(file, &block.text);
        let named: Vec<&str> = block.text.split('"').filter(|text| is_file(text)).collect();
        if named
            .iter()
            .any(|name| bring(&bench, name, true) && !bench.path(name).exists())
        {
            awaited.insert(file.to_owned());
        }
    }
    for (line, command) in page.commands() {
        let command = command.replace("cargo run --release -- ", "insonify ");
        let words: Vec<&str> = command.split_whitespace().collect();
        if invocations(&command).is_empty() || words.iter().any(|word| is_placeholder(word)) {
            continue;
        }
        let written: Vec<&str> = words
            .windows(2)
            .filter(|pair| WRITTEN.contains(&pair[0]))
            .map(|pair| pair[1])
            .collect();
        let is_awaited = |word: &str| awaited.iter().any(|file| Path::new(word).starts_with(file));
        let is_slow = |entry: &&str| {
            let (subcommand, rest) = entry.split_once(' ').unwrap_or((entry, ""));
            words.get(1) == Some(&subcommand) && rest.split_whitespace().all(|word| words.contains(&word))
        };
        let slow = !all && SLOW.iter().any(is_slow);
        let read = words.iter().filter(|word| !written.contains(word));
        let mut waits = slow;
        let mut missing = Vec::new();
        for word in read {
            if is_awaited(word) {
                waits = true;
            } else if !bench.path(word).exists() {
                if bring(&bench, word, !slow) {
                    waits |= !bench.path(word).exists();
                } else if is_file(word) && !word.contains('*') {
                    missing.push(*word);
                }
            }
        }
        if waits {
            awaited.extend(written.iter().map(|file| (*file).to_owned()));
            if !missing.is_empty() {
                faults.push(format!("{}:{line}: {command}\nno {}", page.name, missing.join(", ")));
            }
            continue;
        }
        let start = Instant::now();
        let mut shell = bench.shell(&command);
        shell.stdin(Stdio::null());
        let run = Run::of(shell, command.trim_start_matches("insonify "));
        if all {
            println!(
                "{:7.1} s  {}:{line}: {command}",
                start.elapsed().as_secs_f64(),
                page.name
            );
        }
        if run.status != Some(0) {
            faults.push(format!("{}:{line}: {run:?}", page.name));
        }
    }
    faults
}

/// Runs the commands of all pages on some threads, a page at a time.
fn run_all(threads: usize, all: bool) {
    let pages = std::sync::Mutex::new(pages());
    let work = || {
        let mut faults = Vec::new();
        loop {
            // The lock is held for this line only.
            let page = pages.lock().expect("pages").pop();
            let Some(page) = page else { return faults };
            faults.extend(run(&page, all));
        }
    };
    let faults: Vec<String> = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..threads).map(|_| scope.spawn(work)).collect();
        threads
            .into_iter()
            .flat_map(|thread| thread.join().expect("no panic"))
            .collect()
    });
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn quick_commands_of_the_pages_run() {
    run_all(2, false);
}

#[test]
#[ignore = "an hour: `.ci/more docs`"]
fn all_commands_of_the_pages_run() {
    run_all(1, true);
}

/// A kind of file, what a part of one lacks, and its parser.
type Kind = (&'static str, &'static str, fn(&str) -> Result<(), InputError>);

const KINDS: [Kind; 6] = [
    ("scene", "", |text| SceneFile::parse(text, "block").map(drop)),
    ("insert", "scene = \"default\"\n[needle]", |text| {
        ScenarioFile::parse(text, "block").map(drop)
    }),
    ("solve", "mesh = \"m.vtu\"", |text| {
        ProblemFile::parse(text, "block").map(drop)
    }),
    ("beam", "", |text| beam_case::CaseFile::parse(text, "block").map(drop)),
    ("material", "", |text| {
        material_case::CaseFile::parse(text, "block").map(drop)
    }),
    ("identify", "", |text| {
        identification::CaseFile::parse(text, "block").map(drop)
    }),
];

#[test]
fn tables_of_the_pages_are_parts_of_files() {
    let mut faults = Vec::new();
    for page in pages() {
        for block in page.blocks().iter().filter(|block| block.language == "toml") {
            let part: toml::Table = match block.text.parse() {
                Ok(part) => part,
                Err(error) => {
                    faults.push(format!("{}:{}: {error}", page.name, block.line));
                    continue;
                }
            };
            let parse = |(kind, rest, parse): &Kind| {
                let mut file: toml::Table = rest.parse().expect("TOML");
                file.extend(part.clone());
                let error = parse(&toml::to_string(&file).expect("TOML")).err()?;
                Some(format!("  as a file of {kind}: {error}"))
            };
            let errors: Vec<Option<String>> = KINDS.iter().map(parse).collect();
            if errors.iter().all(Option::is_some) {
                let errors: Vec<String> = errors.into_iter().flatten().collect();
                faults.push(format!("{}:{}:\n{}", page.name, block.line, errors.join("\n")));
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

/// The anchor of a heading, as GitHub makes it.
fn anchor(heading: &str) -> String {
    let kept = heading.trim_start_matches('#').trim().to_lowercase();
    let kept = kept
        .chars()
        .filter(|letter| letter.is_alphanumeric() || " -_".contains(*letter));
    kept.map(|letter| if letter == ' ' { '-' } else { letter }).collect()
}

#[test]
fn links_of_the_pages_lead_somewhere() {
    let mut faults = Vec::new();
    let mut others = pages();
    others.extend(["ARCHITECTURE.md", "CHANGELOG.md"].map(|name| Page {
        name: name.to_owned(),
        text: std::fs::read_to_string(root().join(name)).expect("a file"),
    }));
    for page in &others {
        let folder = root().join(&page.name);
        let folder = folder.parent().expect("a folder");
        for target in page.text.split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
            let (path, part) = target.split_once('#').unwrap_or((target, ""));
            let path = if path.is_empty() {
                page.name.rsplit('/').next().unwrap_or(path)
            } else {
                path
            };
            let fine = target.starts_with("http")
                || match std::fs::read_to_string(folder.join(path)) {
                    Ok(text) => {
                        part.is_empty() || text.lines().any(|line| line.starts_with('#') && anchor(line) == part)
                    }
                    Err(_) => part.is_empty() && folder.join(path).exists(),
                };
            if !fine {
                faults.push(format!("{}: {target}", page.name));
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

/// Whether Rust sources declare an item or give it a name.
fn is_declared(sources: &str, name: &str) -> bool {
    ["fn", "struct", "enum", "trait", "mod", "type", "const", "as"]
        .iter()
        .any(|keyword| {
            let declaration = format!("{keyword} {name}");
            sources.match_indices(&declaration).any(|(at, _)| {
                let next = sources[at + declaration.len()..].chars().next();
                next.is_none_or(|next| !next.is_alphanumeric() && next != '_')
            })
        })
}

/// Whether the targets that a command of Cargo names exist: `--example`, `--bench` and `--test` with a name.
fn targets_exist(command: &str) -> bool {
    let words: Vec<&str> = command.split_whitespace().collect();
    let exists = |pair: &[&str]| {
        let folder = match pair[0] {
            "--example" => "examples",
            "--bench" => "benches",
            "--test" => "tests",
            _ => return true,
        };
        let folder = root().join(folder);
        let file = format!("{}.rs", pair[1]);
        folder.join(&file).exists() || folder.join(pair[1]).is_dir() || folder.join("study").join(&file).exists()
    };
    !words.contains(&"cargo") || words.windows(2).all(exists)
}

#[test]
fn items_and_sources_that_the_pages_name_exist() {
    let sources = sources();
    let within = |folder: &str| -> String {
        let files = sources.iter().filter(|source| source.name.starts_with(folder));
        files.map(|source| source.text.as_str()).collect()
    };
    let (all, door) = (within("src/"), within("src/lib.rs"));
    let mut faults = Vec::new();
    for page in pages() {
        for (line, span) in page.spans().into_iter().chain(page.commands()) {
            let span = span.trim();
            let exists = if span.starts_with("insonify") && span.contains("::") && !span.contains(' ') {
                let mut parts = span.split("::");
                let package = parts.next().unwrap_or_default();
                let first = parts.next().unwrap_or_default();
                let at_the_door = match package.strip_prefix("insonify_") {
                    Some(layer) => is_declared(&within(&format!("src/{layer}/")), first),
                    None => door
                        .split(|letter: char| !letter.is_alphanumeric() && letter != '_')
                        .any(|word| word == first),
                };
                at_the_door && parts.all(|part| is_declared(&all, part) || all.contains(&format!("    {part},")))
            } else if span.contains("cargo ") {
                targets_exist(span)
            } else if span.ends_with(".rs") {
                sources.iter().any(|source| Path::new(&source.name).ends_with(span)) || root().join(span).exists()
            } else if span.starts_with("assets/") || span.starts_with("examples/") {
                root().join(span).exists()
            } else {
                true
            };
            if !exists {
                faults.push(format!("{}:{line}: no {span}", page.name));
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

/// The choices of a JSON schema: values of a key and kinds of a table.
fn choices(schema: &Value, lists: &mut BTreeSet<Vec<String>>) {
    let strings = |values: &[Value]| -> Option<Vec<String>> {
        let texts = values.iter().map(|value| value.as_str().map(str::to_owned));
        texts.collect()
    };
    match schema {
        Value::Object(object) => {
            lists.extend(
                object
                    .get("enum")
                    .and_then(Value::as_array)
                    .and_then(|values| strings(values)),
            );
            if let Some(of) = object.get("oneOf").and_then(Value::as_array) {
                let constant = |one: &Value| {
                    one.get("const")
                        .or_else(|| one.pointer("/properties/kind/const"))
                        .cloned()
                };
                lists.extend(
                    of.iter()
                        .map(constant)
                        .collect::<Option<Vec<_>>>()
                        .and_then(|values| strings(&values)),
                );
            }
            object.values().for_each(|inner| choices(inner, lists));
        }
        Value::Array(array) => array.iter().for_each(|inner| choices(inner, lists)),
        _ => {}
    }
}

#[test]
fn lists_of_choices_are_complete() {
    let mut lists = BTreeSet::new();
    for schema in [
        insonify_imaging::scene::schema(),
        insonify::input::scenario::schema(),
        schemars::schema_for!(ProblemFile).to_value(),
        schemars::schema_for!(beam_case::CaseFile).to_value(),
        schemars::schema_for!(material_case::CaseFile).to_value(),
    ] {
        choices(&schema, &mut lists);
    }
    assert!(
        lists.iter().any(|list| list.iter().any(|name| name == "radial")),
        "{lists:?}"
    );
    let texts = texts();
    let faults: Vec<String> = lists
        .iter()
        .flat_map(|list| texts.iter().flat_map(|page| page.incomplete(list)))
        .collect();
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn reference_pages_are_those_of_the_registries() {
    for (name, expected) in reference_pages::files().expect("pages of reference") {
        let found = std::fs::read_to_string(root().join("docs").join(&name)).unwrap_or_default();
        let lines = expected.lines().zip(found.lines());
        let line = lines.take_while(|(one, other)| one == other).count();
        let nth = |text: &str| text.lines().nth(line).unwrap_or_default().to_owned();
        assert!(
            found == expected,
            "docs/{name}:{}: `{}`, expected `{}`: write the pages anew by `{}`",
            line + 1,
            nth(&found),
            nth(&expected),
            reference_pages::COMMAND
        );
    }
}
