//! What a renderer compiles, which files every effect has, and who may name one.

use std::path::{Path, PathBuf};

use insonify_imaging::effects::REGISTRY;

fn root() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
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
fn the_plan_names_no_gpu() {
    assert_free("imaging/plan", &["wgpu", "gpu"]);
}

#[test]
fn the_gpu_layer_knows_no_ultrasound() {
    assert_free("gpu", &["tissue", "scanline", "scanlines", "speckle"]);
}

#[test]
fn effects_name_no_wgpu() {
    assert_free("imaging/effects", &["wgpu"]);
}

/// Whatever runs in parallel does so through one module.
#[test]
fn rayon_is_named_in_one_file() {
    for module in ["", "../tests", "../benches", "../examples"] {
        for path in sources(module) {
            if !path.ends_with("base/parallel.rs") && !path.ends_with("boundaries/names.rs") {
                let named = words(&code(&path)).any(|word| word == "rayon");
                assert!(!named, "{} names rayon", path.display());
            }
        }
    }
}

#[test]
fn whoever_renders_compiles_no_insertions_no_studies_no_plots_and_no_command() {
    let tree = std::process::Command::new(env!("CARGO"))
        .args([
            "tree",
            "--locked",
            "--offline",
            "-p",
            "insonify-imaging",
            "-e",
            "normal",
            "--prefix",
            "none",
        ])
        .current_dir(root())
        .output()
        .expect("cargo runs");
    let tree = String::from_utf8(tree.stdout).expect("text");
    let crates: Vec<&str> = tree.lines().filter_map(|line| line.split(' ').next()).collect();
    assert!(
        crates.contains(&"insonify-anatomy") && crates.contains(&"wgpu"),
        "{tree}"
    );
    for heavy in [
        "insonify-mechanics",
        "insonify-report",
        "insonify-study",
        "insonify",
        "clap",
        "plotters",
    ] {
        assert!(!crates.contains(&heavy), "insonify-imaging compiles {heavy}");
    }
}

/// Source of an effect.
pub(super) fn source(effect: &str) -> String {
    let path = root().join(format!("src/imaging/effects/{effect}.rs"));
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

#[test]
fn every_effect_has_its_source_its_shader_and_its_parity_test() {
    for effect in REGISTRY {
        let shader = format!("shaders/{}.wgsl", effect.name);
        assert!(
            root().join(&shader).is_file(),
            "effect `{}` lacks {shader}",
            effect.name
        );
        assert!(
            source(effect.name).contains("#[cfg(test)]\nmod parity;"),
            "src/imaging/effects/{}.rs leaves out its parity test",
            effect.name
        );
        let parity = format!("src/imaging/effects/{}/parity.rs", effect.name);
        let tests = std::fs::read_to_string(root().join(&parity)).expect("a test");
        assert!(tests.contains("#[test]"), "{parity} holds no test");
    }
}

#[test]
fn every_shader_belongs_to_an_effect_to_remeshing_or_to_echoes_or_is_shared() {
    for entry in std::fs::read_dir(root().join("shaders"))
        .expect("the shaders")
        .flatten()
    {
        let path = entry.path();
        if path.is_file() {
            let stem = path.file_stem().and_then(|stem| stem.to_str()).expect("a name");
            assert!(
                ["remesh", "remesh_capacitance", "echoes"].contains(&stem)
                    || REGISTRY.iter().any(|effect| effect.name == stem),
                "no effect is called {stem}"
            );
        }
    }
}

/// Places besides its own files, the registry, bounds and tests where an effect may be named, and why.
const NAMED: &[(&str, &[&str], &str)] = &[
    (
        "cli/render/coverage.rs",
        &["slice"],
        "a field of view beyond the volume is black or invented, by the slice",
    ),
    (
        "imaging/scene/target.rs",
        &["contact"],
        "places a probe as far from the skin as contact reaches",
    ),
    (
        "imaging/scene/doubts.rs",
        &["shadow", "slice"],
        "frames deeper than sound carries, and bone that smooth boundaries lose, are doubted",
    ),
    (
        "imaging/scene/resolve.rs",
        &["slice"],
        "whether boundaries are smooth is asked before labels are searched for bone that they lose",
    ),
    (
        "imaging/scene/vary.rs",
        &["needle", "texture"],
        "parameters by frame that change nothing, or make textures anew, are told",
    ),
    (
        "imaging/rf/scatterers.rs",
        &["shadow", "speckle", "texture"],
        "echoes have the beam widths, losses and textures of the scene's effects",
    ),
    (
        "imaging/anatomies.rs",
        &["blur", "noise"],
        "a scene of tests has every usual effect, and noise",
    ),
    (
        "imaging/effects/truth.rs",
        &["needle", "shadow"],
        "their layers have passes where the scene calls for them",
    ),
    (
        "imaging/synth.rs",
        &["needle"],
        "a needle in the state of a frame calls for its pass, and the frame tells what is seen of it",
    ),
    ("imaging/synth/cpu.rs", &["truth"], "returns the layers with the frame"),
    (
        "imaging/synth/gpu/readback.rs",
        &["truth"],
        "returns the layers with the frame",
    ),
    (
        "cli/rf.rs",
        &["shadow", "speckle", "texture"],
        "its help says which effects act on echoes",
    ),
    (
        "input/scenario/guidance.rs",
        &["shadow"],
        "whether an image would show a target, without making one",
    ),
    (
        "imaging/effects/point_spread.rs",
        &["shadow", "speckle"],
        "the point spread is stated with the speckle, and lengthens as pulses are attenuated",
    ),
    (
        "imaging/effects/thickness.rs",
        &["slice", "speckle"],
        "reads labels as they are sliced, as far from the plane as the point spread is wide",
    ),
    (
        "imaging/effects/speckle.rs",
        &["interface", "needle", "compound"],
        "adds their echoes before the point spread, which the looks pass too",
    ),
    (
        "imaging/effects/interface.rs",
        &["slice", "speckle", "compound"],
        "reads labels as they are sliced; writes its echo where the speckle adds it, that of each look by its direction",
    ),
    (
        "imaging/effects/needle.rs",
        &["speckle", "interface", "shadow"],
        "writes its echo where the speckle adds it, after the surfaces; shades a part of the beam",
    ),
    (
        "imaging/effects/needle/segments.rs",
        &["speckle"],
        "the echo of a thick shaft passes its kernels",
    ),
    (
        "imaging/effects/shadow.rs",
        &["needle", "speckle", "compound", "tone"],
        "the needle shades; edges are as soft as the point spread; looks are shaded before mirror images; automatic gain \
         measures what lies above",
    ),
    (
        "imaging/effects/shadow/aperture.rs",
        &["needle", "compound"],
        "the needle shades; looks have apertures of their own",
    ),
    (
        "imaging/effects/compound.rs",
        &["speckle", "shadow"],
        "rotates the phase of the scatterers, and averages what the shadow leaves",
    ),
    (
        "imaging/effects/speckle/tables.rs",
        &["compound"],
        "makes up for what the lattice takes from scatterers with other phases",
    ),
    (
        "imaging/effects/speckle/spread.rs",
        &["compound"],
        "spreads the looks, too",
    ),
    (
        "imaging/effects/refraction.rs",
        &["compound"],
        "follows the rays of the looks",
    ),
    (
        "imaging/effects/table.rs",
        &["slice"],
        "tells that the continuation beyond a volume has another default",
    ),
    (
        "imaging/effects/haze.rs",
        &["receiver", "speckle", "shadow"],
        "its pattern is drawn as clutter is, with the point spread; what occludes throws sound back",
    ),
    (
        "imaging/effects/receiver.rs",
        &["speckle", "shadow"],
        "clutter has the point spread, and attenuates",
    ),
    (
        "imaging/effects/tone.rs",
        &["shadow", "receiver"],
        "compensates for attenuation down to the noise",
    ),
    (
        "imaging/effects/speckle_reduction.rs",
        &["speckle"],
        "windows are as long as the point spread, which is stated with the speckle",
    ),
    (
        "imaging/effects/tone/auto_gain.rs",
        &["receiver", "shadow"],
        "amplifies no noise, and nothing behind bone and gas",
    ),
    (
        "imaging/overlay.rs",
        &["speckle", "tone"],
        "draws the focus and the grey scale",
    ),
    ("input/scenario/scene.rs", &["needle"], "an insertion shows its needle"),
    (
        "imaging/scene/resolve.rs",
        &["contact"],
        "tells of gaps under the array",
    ),
    (
        "imaging/scene/doubts.rs",
        &["compound", "needle"],
        "tells of needles beside the plane, and of looks that have nothing to compound",
    ),
    ("imaging/scene/vary.rs", &["tone"], "an example of a key"),
    ("base/document/setting.rs", &["tone"], "an example of a key"),
    (
        "cli/settings.rs",
        &["refraction", "tone"],
        "examples of keys, and that of `--gain-db`",
    ),
    ("cli/insert.rs", &["refraction"], "an example of a key"),
    ("cli/main.rs", &["refraction"], "an example of a key"),
    ("cli/render.rs", &["refraction"], "an example of a key"),
];

/// The source without comments and unit tests.
fn code(path: &Path) -> String {
    let text = std::fs::read_to_string(path).expect("a source");
    let text = text.split("#[cfg(test)]\nmod tests {").next().unwrap_or_default();
    let lines = text.lines().map(|line| line.split("//").next().unwrap_or_default());
    lines.collect::<Vec<_>>().join("\n")
}

/// Whether a text has a word right after a prefix.
fn has(text: &str, prefix: &str, word: &str) -> bool {
    let found = text.split(prefix).skip(1);
    found.map(words).any(|mut words| words.next() == Some(word))
}

fn words(text: &str) -> impl Iterator<Item = &str> {
    text.split(|c: char| !c.is_alphanumeric() && c != '_')
}

/// Whether a list of imports after a prefix has a word.
fn imports(text: &str, prefix: &str, word: &str) -> bool {
    let lists = text.split(prefix).skip(1).filter_map(|rest| rest.split(';').next());
    lists.into_iter().any(|list| words(list).any(|found| found == word))
}

/// Holds what can be read off the text: paths (`effects::NAME`, `super::NAME` beside the effects, lists of imports) and
/// keys (`effects.NAME`). Names as text, such as those of passes in reports, are not found. Studies, which measure
/// single effects, are exempt, but not their ladder of removals.
#[test]
fn an_effect_is_named_in_its_own_files_and_the_registry_alone() {
    let mut found = Vec::new();
    for path in sources("") {
        let name = path
            .strip_prefix(root().join("src"))
            .expect("a source")
            .to_string_lossy()
            .replace('\\', "/");
        let mut parts = name.split(['/', '.']);
        let is_analysis = parts.any(|part| ["tests", "bound", "parity", "physics"].contains(&part));
        if is_analysis || (name.starts_with("study/") && !name.starts_with("study/bench")) {
            continue;
        }
        let mut text = code(&path);
        if name == "imaging/effects.rs" {
            let start = text.find("\nregistry! {").expect("the registry");
            let end = start + text[start..].find("\n}\n").expect("its end");
            text.replace_range(start..end, "");
        }
        for effect in REGISTRY {
            let is_own = name == format!("imaging/effects/{}.rs", effect.name)
                || name.starts_with(&format!("imaging/effects/{}/", effect.name));
            let beside = name.starts_with("imaging/effects");
            let is_named = has(&text, "effects::", effect.name)
                || has(&text, "effects.", effect.name)
                || imports(&text, "effects::{", effect.name)
                || beside && (has(&text, "super::", effect.name) || imports(&text, "super::{", effect.name));
            if is_named && !is_own {
                found.push((name.clone(), effect.name));
            }
        }
    }
    let mut allowed: Vec<(String, &str)> = Vec::new();
    for (file, effects, _) in NAMED {
        allowed.extend(effects.iter().map(|effect| ((*file).to_owned(), *effect)));
    }
    found.sort();
    allowed.sort();
    assert_eq!(found, allowed);
}
