//! Live changes: only what depends on a change is rebuilt, and the result is that of a synthesizer made anew.

use std::collections::BTreeSet;
use std::sync::Arc;

use insonify_gpu::Gpu;
use insonify_imaging::effects::pass::Band;
use insonify_imaging::effects::slice::Boundary;
use insonify_imaging::effects::tone::Tone;
use insonify_imaging::effects::{Effects, LISTED};
use insonify_imaging::plan::Plan;
use insonify_imaging::synth::tables::{Anatomy, FrameSettings, Settings, Tables};
use insonify_imaging::synth::{Backend, FrameState, SynthError, Synthesizer};

use serde_json::{Value, json};

use crate::support::gpu::{backend, gpu_or_skip};
use crate::support::scene::synthesizer;
use crate::support::scene::{everything, frame_of};

type Edit = (&'static str, fn(&mut Settings));

/// Edits of a user at the console, each on top of those before.
const EDITS: &[Edit] = &[
    ("gain", |settings| {
        settings.effects.tone = Some(Tone {
            gain_db: 4.0,
            ..Tone::linear()
        })
    }),
    ("depth", |settings| settings.probe.depth_mm = 31.0),
    ("focus", |settings| {
        settings.effects.speckle.as_mut().expect("speckle").focus_mm = Some(9.0)
    }),
    ("no blur", |settings| settings.effects.blur = None),
    ("size", |settings| {
        (settings.image.width, settings.image.height) = (90, 33)
    }),
    ("no needle", |settings| settings.effects.needle = None),
    ("thin", |settings| settings.effects.thickness = None),
    ("fewer lines", |settings| settings.probe.lines = 17),
    ("blur again", |settings| {
        settings.effects.blur = Some(Default::default())
    }),
    ("no speckle", |settings| settings.effects.speckle = None),
    ("seed", |settings| settings.seed = 99),
    ("frequency", |settings| settings.probe.frequency_mhz = 3.0),
    ("needle again", |settings| {
        settings.effects.needle = Some(Default::default())
    }),
    ("needle unannounced", |settings| settings.has_needle = false),
    ("no shadow", |settings| settings.effects.shadow = None),
    ("no receiver", |settings| settings.effects.receiver = None),
    ("nearest", |settings| {
        settings.effects.slice.boundary = Boundary::Nearest
    }),
    ("no texture", |settings| settings.effects.texture = None),
    ("one line", |settings| settings.probe.lines = 1),
    ("no tone", |settings| settings.effects.tone = None),
    ("another probe", |settings| {
        settings.probe = crate::support::scene::probe(crate::support::scene::SHAPES[2].1, 35.0, 30, 70);
    }),
    ("fill", |settings| settings.image.fill = 200),
];

/// Edits of a user, each on top of those before: at the console, then each effect taken out of a scene with all of
/// them, and put back.
fn edits() -> Vec<(String, Settings)> {
    let (anatomy, mut settings, _) = everything();
    let mut edits = Vec::new();
    for (name, edit) in EDITS {
        edit(&mut settings);
        edits.push(((*name).to_owned(), settings.clone()));
    }
    let whole = everything().1;
    edits.push(("all again".into(), whole.clone()));
    for effect in LISTED {
        if let Some(remove) = effect.remove {
            let mut without = whole.clone();
            remove(&mut anatomy.clone(), &mut without);
            edits.push((format!("no {}", effect.name), without));
            edits.push((format!("{} again", effect.name), whole.clone()));
        }
    }
    edits
}

fn follow(make: impl Fn() -> Backend) {
    let (anatomy, settings, _) = everything();
    let mut edited: Synthesizer = synthesizer(&anatomy, &settings, make());
    edited.render(&frame_of(&anatomy, 2)).expect("a frame");
    for (at, (name, settings)) in edits().into_iter().enumerate() {
        edited
            .set(settings.clone())
            .unwrap_or_else(|error| panic!("{name}: {error}"));
        let state = frame_of(&anatomy, at as u64);
        let found = edited
            .render(&state)
            .unwrap_or_else(|error| panic!("{name}: {error}"))
            .clone();
        let mut fresh = synthesizer(&anatomy, &settings, make());
        let expected = fresh.render(&state).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!((found.width, found.height), (expected.width, expected.height), "{name}");
        assert_eq!(found.image_to_world, expected.image_to_world, "{name}");
        assert!(
            found.pixels == expected.pixels,
            "after {name} the frame is not that of a fresh synthesizer"
        );
        assert_eq!(edited.memory_bytes(), fresh.memory_bytes(), "after {name}");
    }
}

/// Every single change of an effect's keys from `effects`: the effect left out, and each key with another value, as
/// JSON.
fn changed_keys(effects: &Effects) -> Vec<(String, Vec<Effects>)> {
    let table = serde_json::to_value(effects).expect("effects as JSON");
    let read = |changed: Value| serde_json::from_value::<Effects>(changed).ok();
    let mut changes = Vec::new();
    for (effect, keys) in table.as_object().expect("a table") {
        let mut without = table.clone();
        without[effect] = Value::Null;
        changes.push((format!("no {effect}"), Vec::from_iter(read(without))));
        for (key, value) in keys.as_object().expect("every effect is there") {
            let others: Vec<Value> = match value {
                Value::Bool(is_on) => vec![json!(!is_on)],
                Value::String(_) => vec![json!("nearest")],
                // Half, double, and numbers within the ranges of most keys.
                _ => {
                    let number = value.as_f64().unwrap_or(0.7);
                    [0.5 * number, 2.0 * number, 0.3, 3.0]
                        .map(|other| json!(other))
                        .to_vec()
                }
            };
            let with = |other: Value| {
                let mut changed = table.clone();
                changed[effect][key] = other;
                read(changed).filter(|changed| changed != effects)
            };
            changes.push((format!("{effect}.{key}"), others.into_iter().filter_map(with).collect()));
        }
    }
    changes
}

/// Checks that a change of settings names every buffer whose contents it changes, and derives what fresh tables hold.
fn assert_rest_is_unchanged(name: &str, anatomy: &Anatomy, settings: &Settings, changed: Settings) {
    let mut tables = Tables::new(anatomy.clone(), settings.clone()).expect("tables");
    let band = Band {
        first_row: 0,
        rows: tables.height() as u32,
    };
    let buffers = Plan::new(&tables).resources.into_iter().map(|planned| planned.resource);
    let filled: Vec<_> = buffers.filter_map(|buffer| Some((buffer, buffer.contents?))).collect();
    let before: Vec<_> = filled
        .iter()
        .map(|(_, contents)| contents.bytes(&tables, band))
        .collect();
    let named = tables.set(changed.clone()).expect("a valid change");
    let fresh = Tables::new(anatomy.clone(), changed).expect("tables");
    assert!(filled.len() >= 10);
    for ((buffer, contents), before) in filled.into_iter().zip(before) {
        let after = contents.bytes(&tables, band);
        assert!(
            after == contents.bytes(&fresh, band),
            "after {name} {buffer:?} is stale"
        );
        assert!(
            named.contains(&buffer) || after == before,
            "after {name} {buffer:?} is filled with something else, which is not said"
        );
    }
}

/// Each effect derives anew what a change of its keys, and of its presence, asks for, and so do the others.
#[test]
fn every_key_of_every_effect_changes_a_frame_as_a_fresh_synthesizer_would() {
    let (anatomy, settings, _) = everything();
    let state = frame_of(&anatomy, 2);
    let mut edited = synthesizer(&anatomy, &settings, Backend::Cpu);
    let mut tried = BTreeSet::new();
    for (name, candidates) in changed_keys(&settings.effects) {
        for effects in candidates {
            let changed = Settings {
                effects,
                ..settings.clone()
            };
            if edited.set(changed.clone()).is_err() {
                continue;
            }
            let found = edited
                .render(&state)
                .unwrap_or_else(|error| panic!("{name}: {error}"))
                .clone();
            let mut fresh = synthesizer(&anatomy, &changed, Backend::Cpu);
            let expected = fresh.render(&state).unwrap_or_else(|error| panic!("{name}: {error}"));
            assert!(
                found.pixels == expected.pixels,
                "after {name} the frame is not that of a fresh synthesizer"
            );
            assert_eq!(edited.memory_bytes(), fresh.memory_bytes(), "after {name}");
            edited.set(settings.clone()).expect("the settings before");
            assert_rest_is_unchanged(&name, &anatomy, &settings, changed);
            tried.insert(
                name.split('.')
                    .next()
                    .expect("an effect")
                    .trim_start_matches("no ")
                    .to_owned(),
            );
        }
    }
    let schema = schemars::schema_for!(Effects).to_value();
    let all: BTreeSet<String> = schema["properties"]
        .as_object()
        .expect("effects")
        .keys()
        .cloned()
        .collect();
    assert_eq!(tried, all, "effects that were changed, and all");
}

#[test]
fn edits_give_the_frames_of_a_fresh_synthesizer_on_the_cpu() {
    follow(|| Backend::Cpu);
    follow(|| Backend::CpuF64);
}

#[test]
fn edits_give_the_frames_of_a_fresh_synthesizer_on_the_gpu() {
    let Some(gpu): Option<Gpu> = gpu_or_skip() else {
        return;
    };
    follow(|| backend(gpu.clone()));
}

/// States with settings and tissues of their own, one by one and in a batch.
fn follow_states(make: impl Fn() -> Backend) {
    let (anatomy, settings, _) = everything();
    let mut others = (*anatomy.tissues).clone();
    for tissue in &mut others.tissues {
        tissue.attenuation_db_cm_mhz *= 0.5;
        tissue.echogenicity_db += 3.0;
        tissue.impedance_mrayl *= 1.05;
        tissue.texture_scale = 1.5;
    }
    let tissues = [Arc::clone(&anatomy.tissues), Arc::new(others)];
    let state = |(index, (_, settings)): (usize, (String, Settings))| FrameState {
        settings: Some(Arc::new(FrameSettings {
            settings,
            tissues: Arc::clone(&tissues[index % 2]),
            warnings: Vec::new(),
        })),
        ..frame_of(&anatomy, index as u64)
    };
    let states: Vec<FrameState> = edits().into_iter().take(EDITS.len()).enumerate().map(state).collect();
    let fresh = |state: &FrameState| {
        let own = state.settings.as_ref().expect("settings");
        let anatomy = Anatomy {
            tissues: Arc::clone(&own.tissues),
            ..anatomy.clone()
        };
        let plain = FrameState {
            settings: None,
            ..state.clone()
        };
        synthesizer(&anatomy, &own.settings, make())
            .render(&plain)
            .expect("a frame")
            .clone()
    };
    let expected: Vec<_> = states.iter().map(fresh).collect();
    let mut one_by_one = synthesizer(&anatomy, &settings, make());
    for (index, (state, expected)) in states.iter().zip(&expected).enumerate() {
        let found = one_by_one.render(state).expect("a frame");
        assert!(found == expected, "after {} the frame is another", EDITS[index].0);
    }
    let mut together = synthesizer(&anatomy, &settings, make());
    let mut found = Vec::new();
    together
        .render_batch(&states, |_, frame| {
            found.push(frame.clone());
            Ok::<_, SynthError>(())
        })
        .expect("a batch");
    assert!(found == expected, "in a batch frames are others");
    // Afterwards it is as after the last of them.
    let last = FrameState {
        settings: None,
        ..states[states.len() - 1].clone()
    };
    assert!(Some(together.render(&last).expect("a frame")) == expected.last());
}

#[test]
fn states_with_settings_of_their_own_are_frames_of_fresh_synthesizers_on_the_cpu() {
    follow_states(|| Backend::Cpu);
}

#[test]
fn states_with_settings_of_their_own_are_frames_of_fresh_synthesizers_on_the_gpu() {
    let Some(gpu): Option<Gpu> = gpu_or_skip() else {
        return;
    };
    follow_states(|| backend(gpu.clone()));
}

#[test]
fn a_change_touches_only_what_depends_on_it() {
    let (anatomy, settings, _) = everything();
    let table: &[(&str, fn(&mut Settings), &[&str])] = &[
        ("nothing", |_| {}, &[]),
        (
            "gain",
            |settings| settings.effects.tone.as_mut().expect("tone").gain_db = 9.0,
            &["Gain"],
        ),
        ("fill", |settings| settings.image.fill = 3, &[]),
        ("size", |settings| settings.image.width = 80, &["ScanMap"]),
        (
            "focus",
            |settings| settings.effects.speckle.as_mut().expect("speckle").focus_mm = Some(5.0),
            &[
                "AxialKernel",
                "LateralKernel",
                "LookPhasors",
                "PenumbraKernel",
                "ApertureShifts",
                "ApertureWeights",
                "Clutter",
                "HazeGains",
                "HazePattern",
                "HazeWeights",
                "LabelRows",
                "LeftOfAverage",
                "SpeckleOffsets",
                "SubPlanes",
            ],
        ),
        (
            "blur",
            |settings| settings.effects.blur.as_mut().expect("blur").width_mm = Some(2.0),
            &["BlurKernel"],
        ),
        (
            "angle of the looks",
            |settings| settings.effects.compound.as_mut().expect("looks").angle_deg = 4.0,
            &[
                "AxialKernel",
                "LateralKernel",
                "LookDirections",
                "LookPhasors",
                "LookShifts",
                "RefractionShifts",
                "PenumbraKernel",
                "ApertureShifts",
                "ApertureWeights",
                "LabelRows",
                "LeftOfAverage",
            ],
        ),
        (
            "window of speckle reduction",
            |settings| {
                let reduction = settings.effects.speckle_reduction.as_mut();
                reduction.expect("speckle reduction").window_cells = 2.0;
            },
            &["SpeckleOffsets"],
        ),
        (
            "clutter",
            |settings| settings.effects.receiver.as_mut().expect("receiver").clutter_db = Some(-30.0),
            &["Clutter"],
        ),
        (
            "mirror",
            |settings| settings.effects.interface.as_mut().expect("interface").mirror_db = 20.0,
            &[],
        ),
        ("noise", |settings| settings.effects.noise = None, &[]),
        ("needle", |settings| settings.has_needle = false, &[]),
        (
            "boundary",
            |settings| settings.effects.slice.boundary = Boundary::Nearest,
            &[],
        ),
        (
            "occlusion",
            |settings| settings.effects.shadow.as_mut().expect("shadow").occlusion = false,
            &[
                "PenumbraKernel",
                "ApertureShifts",
                "ApertureWeights",
                "LabelRows",
                "LeftOfAverage",
            ],
        ),
        (
            "depth",
            |settings| settings.probe.depth_mm = 30.0,
            &[
                "ScanMap",
                "Rays",
                "AxialKernel",
                "LateralKernel",
                "LookDirections",
                "LookPhasors",
                "LookShifts",
                "RefractionShifts",
                "BlurKernel",
                "PenumbraKernel",
                "ApertureShifts",
                "ApertureWeights",
                "Clutter",
                "HazeGains",
                "HazePattern",
                "HazeWeights",
                "Gain",
                "LabelRows",
                "LeftOfAverage",
                "SpeckleOffsets",
                "SubPlanes",
            ],
        ),
    ];
    for (name, edit, expected) in table {
        let mut tables = Tables::new(anatomy.clone(), settings.clone()).expect("tables");
        let mut changed = settings.clone();
        edit(&mut changed);
        let found = tables.set(changed).expect("a valid change");
        let mut found: Vec<&str> = found.iter().map(|buffer| buffer.name).collect();
        let mut expected = expected.to_vec();
        found.sort_unstable();
        expected.sort_unstable();
        assert_eq!(found, expected, "{name}");
    }
}

#[test]
fn a_refused_change_leaves_everything_as_it_was() {
    let (anatomy, settings, state) = everything();
    let gpu = gpu_or_skip();
    for make in std::iter::once(Backend::Cpu).chain(gpu.map(backend)) {
        let mut synthesizer = synthesizer(&anatomy, &settings, make);
        let before = synthesizer.render(&state).expect("a frame").clone();
        let mut bad = settings.clone();
        bad.probe.depth_mm = -1.0;
        bad.image.width = 99;
        assert!(synthesizer.set(bad).is_err());
        let mut bad = settings.clone();
        bad.image.width = 0;
        bad.effects.tone = None;
        assert!(synthesizer.set(bad).is_err());
        assert_eq!(synthesizer.settings(), &settings);
        assert_eq!(synthesizer.render(&state).expect("a frame"), &before);
    }
}

#[test]
fn a_change_over_the_limits_leaves_everything_as_it_was() {
    let Some(gpu) = gpu_or_skip() else {
        return;
    };
    let (anatomy, settings, _) = everything();
    let mut synthesizer = synthesizer(&anatomy, &settings, backend(gpu));
    let state = frame_of(&anatomy, 2);
    let before = synthesizer.render(&state).expect("a frame").pixels.clone();
    let (bytes, plan) = (synthesizer.memory_bytes(), synthesizer.plan().bytes());
    let mut absurd = settings.clone();
    // 8192 x 16384 positions of 16 bytes: 2 GiB, more than any binding holds.
    (absurd.probe.lines, absurd.probe.samples) = (8192, 16_384);
    (absurd.image.width, absurd.image.height) = (640, 480);
    // Without the effects that would need most of a machine's memory first.
    absurd.effects = crate::support::scene::bare();
    let refused = synthesizer.set(absurd).expect_err("over every limit").to_string();
    assert!(refused.contains("max_storage_buffer_binding_size"), "{refused}");
    assert_eq!(synthesizer.settings(), &settings);
    assert_eq!((synthesizer.memory_bytes(), synthesizer.plan().bytes()), (bytes, plan));
    assert_eq!(synthesizer.render(&state).expect("the same frame").pixels, before);
}

#[test]
fn a_large_picture_gives_its_bands_back() {
    let Some(gpu) = gpu_or_skip() else {
        return;
    };
    let (anatomy, settings, _) = everything();
    let mut synthesizer = synthesizer(&anatomy, &settings, backend(gpu));
    let bytes = synthesizer.memory_bytes();
    let mut large = settings.clone();
    (large.image.width, large.image.height) = (5000, 5000);
    synthesizer.set(large).expect("several bands");
    assert!(synthesizer.memory_bytes() > bytes + 5000 * 5000 * 8);
    synthesizer.set(settings).expect("one band");
    assert_eq!(synthesizer.memory_bytes(), bytes);
}
