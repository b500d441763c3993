//! Who may name whom, and which files every effect has.

use std::path::{Path, PathBuf};

use insonify::effects::REGISTRY;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Rust sources below a folder, and the file of the same name beside it.
fn sources(module: &str) -> Vec<PathBuf> {
    let mut found = vec![root().join(format!("src/{module}.rs"))];
    let mut folders = vec![root().join("src").join(module)];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).into_iter().flatten().flatten() {
            let path = entry.path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                found.push(path);
            }
        }
    }
    found.retain(|path| path.exists());
    found
}

/// Lines of the sources of a module that hold one of the words.
fn naming(module: &str, words: &[&str]) -> Vec<String> {
    let sources = sources(module);
    assert!(!sources.is_empty(), "no sources of {module}");
    let mut found = Vec::new();
    for path in sources {
        let text = std::fs::read_to_string(&path).expect("a source");
        for (at, line) in text.lines().enumerate() {
            let mut parts = line.split(|c: char| !c.is_alphanumeric() && c != '_');
            if parts.any(|part| words.contains(&part)) {
                found.push(format!("{}:{}: {line}", path.display(), at + 1));
            }
        }
    }
    found
}

fn assert_free(module: &str, words: &[&str]) {
    let found = naming(module, words);
    assert!(found.is_empty(), "{module} names {words:?}:\n{}", found.join("\n"));
}

#[test]
fn mechanics_name_no_gpu() {
    assert_free("mechanics", &["wgpu", "gpu"]);
}

#[test]
fn the_plan_names_no_gpu() {
    assert_free("plan", &["wgpu", "gpu"]);
}

#[test]
fn the_gpu_layer_knows_no_ultrasound() {
    assert_free(
        "gpu",
        &[
            "effects",
            "synth",
            "plan",
            "tissue",
            "tracking",
            "mechanics",
            "scanline",
            "scanlines",
            "speckle",
        ],
    );
}

#[test]
fn only_the_gpu_layer_and_the_synthesizer_name_wgpu() {
    for module in [
        "effects", "volume", "tissue", "tracking", "phantom", "output", "scene", "random", "real",
    ] {
        assert_free(module, &["wgpu"]);
    }
}

#[test]
fn every_effect_has_its_source_its_shader_and_its_parity_test() {
    for effect in REGISTRY {
        for file in [
            format!("src/effects/{}.rs", effect.name),
            format!("shaders/{}.wgsl", effect.name),
            format!("tests/parity/{}.rs", effect.name),
        ] {
            assert!(root().join(&file).is_file(), "effect `{}` lacks {file}", effect.name);
        }
        let parity = std::fs::read_to_string(root().join("tests/parity/main.rs")).expect("the parity tests");
        assert!(
            parity.contains(&format!("\nmod {};", effect.name)),
            "tests/parity/main.rs leaves out {}",
            effect.name
        );
        let tests = std::fs::read_to_string(root().join(format!("tests/parity/{}.rs", effect.name))).expect("a test");
        assert!(
            tests.contains("#[test]"),
            "tests/parity/{}.rs holds no test",
            effect.name
        );
    }
}

#[test]
fn every_shader_belongs_to_an_effect_or_to_remeshing_or_is_shared() {
    for entry in std::fs::read_dir(root().join("shaders"))
        .expect("the shaders")
        .flatten()
    {
        let path = entry.path();
        if path.is_file() {
            let stem = path.file_stem().and_then(|stem| stem.to_str()).expect("a name");
            assert!(
                stem == "remesh" || REGISTRY.iter().any(|effect| effect.name == stem),
                "no effect is called {stem}"
            );
        }
    }
}
