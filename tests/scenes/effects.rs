//! Which effects a scene file calls for.

use std::collections::BTreeSet;

use insonify_imaging::effects::table::Origin;
use insonify_imaging::effects::{Effect, Effects, EffectsTable, LISTED, Scanner};
use insonify_imaging::plan::{Plan, PlanReport};
use insonify_imaging::scene::Scene;
use insonify_imaging::synth::tables::Tables;
use serde_json::Value;

use super::support::{fault, parse, render, resolve, shrink, synthesizer};

/// Effects that a scene may do without, by the keys of its `[effects]`.
fn effects() -> Vec<&'static Effect> {
    let schema = schemars::schema_for!(EffectsTable).to_value();
    let keys = schema["properties"].as_object().expect("effects");
    let found: Vec<_> = LISTED
        .iter()
        .copied()
        .filter(|effect| keys.contains_key(effect.name) && effect.remove.is_some())
        .collect();
    assert!(found.len() > 10);
    found
}

/// Names of the effects that are on.
fn on(effects: &Effects) -> BTreeSet<String> {
    let table = serde_json::to_value(effects).expect("JSON");
    let keys = table.as_object().expect("a table").iter();
    let on = keys.filter(|(name, value)| *name != "slice" && !value.is_null());
    on.map(|(name, _)| name.clone()).collect()
}

/// Usual effects of a scene with a curvilinear probe.
fn usual() -> Effects {
    Effects::of(Scanner::Clinical)
}

fn listed<'a>(names: impl IntoIterator<Item = &'a String>) -> String {
    let names: Vec<String> = names.into_iter().map(|name| format!("\"{name}\"")).collect();
    format!("[{}]", names.join(", "))
}

/// A small scene that each effect changes, with more text behind it.
fn scene(version: &str, more: &str) -> Scene {
    let text = format!(
        "{version}\nvolume = {{ phantom = \"abdomen\", resolution_mm = 5 }}\n\
         needle = {{ tip_mm = [-52.3, -20.2, -25.1], entry_mm = [-32.0, -79.6, -7.1] }}\n{more}\n"
    );
    let mut file = parse(&text).unwrap_or_else(|error| panic!("{error}\n{text}"));
    shrink(&mut file);
    let volume = file.volume.as_mut().expect("a volume");
    volume.resolution_mm = Some(5.0);
    file.resolve("".as_ref())
        .unwrap_or_else(|error| panic!("{error}\n{text}"))
}

fn plan(scene: &Scene) -> Plan {
    Plan::new(&Tables::new(scene.anatomy.clone(), scene.settings.clone()).expect("tables"))
}

/// Passes, buffers and their sizes.
fn contents(plan: &Plan) -> (Vec<&'static str>, Value) {
    let passes = plan.passes.iter().map(|planned| planned.pass.name).collect();
    (passes, serde_json::to_value(&plan.resources).expect("JSON"))
}

/// Reason for which a plan leaves an effect out.
fn reason<'a>(report: &'a PlanReport, effect: &str) -> Option<&'a str> {
    let omitted = report.without.iter().find(|omitted| omitted.name == effect);
    omitted.map(|omitted| &*omitted.reason)
}

/// An effect that is `false`, and one that `only` does not list: the same plan, buffers and bytes.
#[test]
fn an_effect_that_is_false_is_one_that_only_does_not_list() {
    // Solid textures take seconds to make; they are left out beside every other effect.
    let off = |name: &str| scene("", &format!("[effects]\ntexture = false\n{name} = false"));
    let all = on(&usual());
    for effect in effects() {
        let name = effect.name;
        let excluded = if name == "texture" {
            scene("", "effects.texture = false")
        } else {
            off(name)
        };
        let kept = all.iter().filter(|kept| *kept != name && *kept != "texture");
        let only = scene("", &format!("[effects]\nonly = {}", listed(kept)));
        assert_eq!(excluded.settings, only.settings, "{name}");
        assert!(!on(&excluded.settings.effects).contains(name));
        assert_eq!(contents(&plan(&excluded)), contents(&plan(&only)), "{name}");
        let [first, second] = [&excluded, &only].map(|scene| {
            let mut synthesizer = synthesizer(scene);
            let frame = render(scene, &mut synthesizer, 0, 1);
            (frame.pixels, synthesizer.memory_bytes())
        });
        assert!(first == second, "{name}");
    }
}

#[test]
fn a_list_of_nothing_leaves_what_every_frame_needs() {
    let nothing = scene("", "effects.only = []");
    let plan = plan(&nothing);
    let (passes, _) = contents(&plan);
    assert_eq!(passes, ["geometry", "slice", "tone", "scan_conversion", "quantise"]);
    let bound: BTreeSet<&str> = plan
        .passes
        .iter()
        .flat_map(|planned| planned.pass.bindings)
        .map(|(buffer, _)| buffer.name)
        .collect();
    assert_eq!(
        bound,
        plan.resources.iter().map(|planned| planned.resource.name).collect()
    );
    let synthesizer = synthesizer(&nothing);
    let expected = Effects {
        slice: usual().slice,
        ..Effects::default()
    };
    assert_eq!(nothing.settings.effects, expected);
    let mut bare = nothing.clone();
    bare.settings.effects = expected;
    assert_eq!(
        synthesizer.memory_bytes(),
        super::support::synthesizer(&bare).memory_bytes()
    );
    let report = plan.report(&nothing.origins);
    for pass in &report.passes {
        assert_eq!(pass.origin, "needed by every frame", "{}", pass.name);
    }
    assert_eq!(reason(&report, "speckle"), Some("not in `only`"));
    assert_eq!(
        reason(&report, "warp"),
        Some("no tissue model deforms: world and reference state are the same")
    );
}

/// A key of an effect changes that key, and nothing else.
#[test]
fn keys_change_what_they_name() {
    let plain = scene("", "");
    assert_eq!(plain.settings.effects, usual());
    let louder = scene("", "[effects.tone]\ngain_db = 6");
    let mut expected = usual();
    expected.tone.as_mut().expect("tone").gain_db = 6.0;
    assert_eq!(louder.settings.effects, expected);
    assert_eq!(contents(&plan(&louder)), contents(&plan(&plain)));
    let voted = scene("", "effects.slice.boundary = \"vote\"").settings.effects;
    assert_eq!(voted.slice.beyond, usual().slice.beyond);
    assert!(voted.slice != usual().slice);
    for effect in effects() {
        let name = effect.name;
        let named = scene("", &format!("effects.{name} = true"));
        let mut all = on(&usual());
        all.insert(name.to_owned());
        assert_eq!(on(&named.settings.effects), all);
        assert_eq!(named.origins[name], Origin::Named);
        let keyed = scene("", &format!("effects.{name} = {{}}"));
        assert_eq!(keyed.settings.effects, named.settings.effects, "{name}");
    }
}

/// The scanner follows from the probe, unless the scene states it, or all of its effects.
#[test]
fn the_scanner_decides_on_compounding_and_speckle_reduction() {
    let has = |version: &str, more: &str| {
        let effects = scene(version, more).settings.effects;
        [effects.compound.is_some(), effects.speckle_reduction.is_some()]
    };
    for clinical in [
        "",
        "scanner = \"clinical\"",
        "effects.tone.gain_db = 6",
        "effects.noise = true",
    ] {
        assert_eq!(has("version = 2", clinical), [true; 2], "{clinical}");
    }
    let [linear, phased] = ["linear", "phased"].map(|kind| format!("[probe]\nkind = \"{kind}\""));
    for raw in ["scanner = \"raw\"", &phased, "effects.only = [\"tone\"]"] {
        assert_eq!(has("version = 2", raw), [false; 2], "{raw}");
    }
    assert_eq!(has("version = 1", ""), [false; 2]);
    assert_eq!(has("version = 1", &linear), [false; 2]);
    assert_eq!(has("version = 2\nscanner = \"clinical\"", &phased), [true; 2]);
    assert_eq!(has("version = 2", &linear), [true; 2]);
    // What depends on the probe fills what a table leaves open.
    let strengths = |first: &str, more: &str| {
        let effects = scene(first, more).settings.effects;
        let bandwidth = effects.speckle.expect("speckle").receive_bandwidth;
        (
            bandwidth,
            effects.speckle_reduction.map(|reduction| reduction.strength()),
        )
    };
    let with = |more: &str| format!("{linear}\n{more}");
    assert_eq!(strengths("version = 2", &linear), (Some(0.4), Some(0.25)));
    let stated = "[effects]\nspeckle.lateral_mm = 1.0\nspeckle_reduction.window_cells = 4.0";
    assert_eq!(strengths("version = 2", &with(stated)), (Some(0.4), Some(0.25)));
    let stated = "[effects]\nspeckle.receive_bandwidth = 0.5\nspeckle_reduction.strength = 0.5";
    assert_eq!(strengths("version = 2", &with(stated)), (Some(0.5), Some(0.5)));
    assert_eq!(strengths("version = 2", ""), (None, Some(0.75)));
    assert_eq!(
        strengths(
            "version = 2\nscanner = \"raw\"",
            &with("[effects]\nspeckle_reduction = true")
        ),
        (None, Some(0.75))
    );
    let listed = "[effects]\nonly = [\"speckle\", \"speckle_reduction\"]";
    assert_eq!(strengths("scanner = \"clinical\"", &with(listed)), (None, Some(0.75)));
    // Each number by itself.
    assert_eq!(has("scanner = \"raw\"", "effects.compound = true"), [true, false]);
    assert_eq!(has("", "effects.compound = false"), [false, true]);
    let nine = scene("", "effects.compound.looks = 9");
    assert_eq!(
        nine.settings.effects.compound.as_ref().map(|compound| compound.looks),
        Some(9)
    );
    assert!(nine.settings.effects.speckle_reduction.is_some());

    let plain = scene("", "");
    let report = plan(&plain).report(&plain.origins);
    assert_eq!(report.scanner, ["compound", "speckle_reduction"]);
    assert!(report.to_string().contains("`scanner = \"raw\"`"));
    // The file that a scene writes is the same scene.
    let again = plain.file.clone().resolve(".".as_ref()).expect("the file as filled in");
    assert_eq!(again.settings, plain.settings);
}

/// A scanner that a scene names and that changes nothing is told, and so is compounding that has nothing to compound.
#[test]
fn processing_that_does_nothing_is_told() {
    let only = scene("scanner = \"clinical\"", "effects.only = [\"tone\"]");
    assert!(
        only.notes.iter().any(|note| note.contains("adds nothing")),
        "{:?}",
        only.notes
    );
    let phased = "[probe]\nkind = \"phased\"\n";
    for (first, more, told) in [
        ("version = 2", format!("{phased}[effects]\ncompound = true"), true),
        ("version = 2\nscanner = \"clinical\"", phased.to_owned(), true),
        (
            "version = 2",
            "effects = { compound = true, speckle = false }".to_owned(),
            true,
        ),
        ("version = 2", "effects.speckle = false".to_owned(), false),
        ("version = 2", String::new(), false),
    ] {
        let scene = scene(first, &more);
        let warned = scene
            .warnings
            .iter()
            .any(|warning| warning.contains("`effects.compound` does nothing"));
        assert_eq!(warned, told, "{more}: {:?}", scene.warnings);
    }
}

#[test]
fn naming_excludes_in_version_1() {
    for effect in effects() {
        let name = effect.name;
        let named = scene("version = 1", &format!("[effects.{name}]"));
        assert_eq!(on(&named.settings.effects), BTreeSet::from([name.to_owned()]));
        assert_eq!(named.settings.effects.slice, Effects::default().slice);
    }
    assert_eq!(scene("version = 1", "").settings.effects, Effects::usual());
    assert_eq!(scene("version = 1", "[effects]").settings.effects, Effects::default());
}

/// A file without a version is told the effects that it would have left out, and the keys that leave them out.
#[test]
fn a_file_without_a_version_is_told_what_changed() {
    let told = |scene: &Scene| -> Option<String> {
        let note = scene.notes.iter().find(|note| note.contains("the frame of version 1"));
        note.map(ToString::to_string)
    };
    for effect in effects() {
        let table = format!("{} = {{}}", effect.name);
        let note = told(&scene("", &format!("[effects]\n{table}"))).expect(effect.name);
        let keys = note
            .split('`')
            .filter(|part| part.starts_with("only = ") || part.starts_with("slice.beyond = "));
        let keys = keys.collect::<Vec<_>>().join("\n");
        let now = scene("version = 2", &format!("[effects]\n{table}\n{keys}"));
        let before = scene("version = 1", &format!("[effects]\n{table}"));
        assert_eq!(now.settings, before.settings, "{note}");
        let missing = on(&usual()).into_iter().filter(|name| name != effect.name);
        for name in missing {
            assert!(note.contains(&name), "{name}: {note}");
        }
    }
    // Keys of a table that is there stand in it.
    let table = "[effects.slice]\nboundary = \"nearest\"";
    let note = told(&scene("", table)).expect("a note");
    assert!(note.contains("`beyond = \"void\"` under `effects.slice`"), "{note}");
    let only = note.split('`').find(|part| part.starts_with("only = ")).expect("only");
    let now = scene("version = 2", &format!("[effects]\n{only}\n{table}\nbeyond = \"void\""));
    assert_eq!(now.settings, scene("version = 1", table).settings, "{note}");
    for newer in [
        "",
        "effects.only = [\"tone\"]",
        "effects.tone = false",
        "effects.noise = true",
    ] {
        assert_eq!(told(&scene("", newer)), None, "{newer}");
    }
    for version in ["version = 1", "version = 2"] {
        assert_eq!(told(&scene(version, "[effects.tone]")), None, "{version}");
    }
    // All named, and the continuation, too: nothing has changed.
    let all: Vec<String> = effects()
        .iter()
        .map(|effect| format!("{} = {{}}", effect.name))
        .collect();
    let all = format!("[effects]\nslice.beyond = \"void\"\n{}", all.join("\n"));
    assert_eq!(told(&scene("", &all)), None);
}

#[test]
fn contradictions_name_both_places() {
    let error = fault("version = 2\n[effects]\nonly = [\"tone\"]\ntone = false");
    assert_eq!(error.key(), Some("effects.tone"));
    assert!(error.to_string().contains("\"tone\" in `only` (line 3)"), "{error}");
    for named in ["speckle = true", "speckle = { axial_mm = 1 }"] {
        let error = fault(&format!("[effects]\nonly = []\n{named}"));
        assert_eq!(error.location().map(|(_, line)| line), Some(3), "{error}");
        assert!(
            error.to_string().contains("which `only` (line 2) does not list"),
            "{error}"
        );
    }
    let error = fault("[effects]\nonly = [\"tonne\"]");
    assert!(
        error.help().is_some_and(|help| help.contains("did you mean \"tone\"?")),
        "{error}"
    );
    for text in [
        "effects.slice = false",
        "effects.tone = 3",
        "effects.tone = [6.0]",
        "effects = [\"tone\"]",
    ] {
        let error = fault(text);
        assert!(error.to_string().contains("expected a table"), "{text}: {error}");
    }
}

/// The plan says of each pass how it came into the scene, and of each effect that is left out, why.
#[test]
fn plans_say_where_effects_come_from() {
    let scene = scene("", "[effects]\nspeckle = {}\nblur = false\n");
    let report = plan(&scene).report(&scene.origins);
    let origin = |name: &str| {
        let pass = report.passes.iter().find(|pass| pass.name == name);
        pass.unwrap_or_else(|| panic!("{name}: {report}")).origin.clone()
    };
    assert_eq!(origin("geometry"), "needed by every frame");
    assert_eq!(origin("needle"), "usual");
    assert_eq!(origin("speckle_scatter"), "named");
    assert_eq!(origin("speckle_specular"), "needed by interface");
    assert_eq!(reason(&report, "blur"), Some("left out by `blur = false`"));
    assert_eq!(reason(&report, "noise"), Some("not usual; name it to have it"));
    assert!(report.to_string().contains("usual: "), "{report}");
}

/// Grey levels that are linear are told where other effects were named, and not where that is what the scene says.
#[test]
fn linear_grey_levels_are_told() {
    let told = |version: &str, more: &str| {
        let scene = scene(version, more);
        scene.notes.iter().any(|note| note.contains("grey levels are linear"))
    };
    assert!(told("version = 1", "[effects.speckle]"));
    assert!(told("", "effects.only = [\"speckle\"]"));
    assert!(!told("", "effects.tone = false"));
    assert!(!told("", "effects.only = []"));
    assert!(!told("version = 2", "[effects.speckle]"));
}

/// Keys that a scene leaves open of its probe are those of the usual probe.
#[test]
fn a_probe_is_the_usual_one_but_for_what_is_stated() {
    for phantom in ["abdomen", "prostate", "two-layer"] {
        let resolve = |more: &str| {
            let text = format!("volume = {{ phantom = \"{phantom}\", resolution_mm = 5 }}\n{more}");
            resolve(&text).unwrap_or_else(|error| panic!("{error}"))
        };
        let (usual, deeper) = (resolve(""), resolve("probe.depth_mm = 47"));
        let mut expected = usual.settings.probe;
        expected.depth_mm = 47.0;
        assert_eq!(deeper.settings.probe, expected);
        let told = |scene: &Scene| {
            scene
                .notes
                .iter()
                .filter(|note| note.contains("`[probe]` leaves open"))
                .count()
        };
        assert_eq!((told(&usual), told(&deeper)), (0, 1), "{:?}", deeper.notes);
        let file = toml::to_string(&deeper.file).expect("TOML");
        let again = super::support::resolve(&file).expect("a scene");
        assert_eq!((again.settings.probe, told(&again)), (expected, 0));
    }
}
