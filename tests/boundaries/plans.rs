//! Only what a scene calls for is there: passes, resources, pipelines, memory.

use std::collections::BTreeSet;

use insonify_imaging::effects::buffers::{IMAGE, PIXELS, SCAN_MAP};
use insonify_imaging::effects::pass::Pass;
use insonify_imaging::effects::shadow::Shadow;
use insonify_imaging::effects::speckle_reduction::SpeckleReduction;
use insonify_imaging::effects::{Effect, Effects, LISTED, REGISTRY, Wanted};
use insonify_imaging::plan::Plan;
use insonify_imaging::scene::SceneFile;
use insonify_imaging::synth::layers::Layer;
use insonify_imaging::synth::tables::{Anatomy, Settings, Tables};
use insonify_imaging::synth::{Backend, Synthesizer};

use super::shaders::tables;
use crate::support::anatomy::{self, Acoustics, Frame, PLAIN, SILENT};
use crate::support::gpu::{backend, gpu_or_skip};
use crate::support::scene;

/// A scene, and the passes that its plan must hold beyond those that every frame needs; `None` if it must hold all that
/// effects list.
pub(super) struct Scene {
    pub name: &'static str,
    pub anatomy: Anatomy,
    pub settings: Settings,
    passes: Option<&'static [&'static str]>,
}

/// Every frame: where its samples lie, their labels, grey levels, pixels, bytes.
const ALWAYS: &[&str] = &["geometry", "slice", "tone", "scan_conversion", "quantise"];

fn lossy() -> Acoustics {
    Acoustics {
        attenuation_db_cm_mhz: 0.5,
        texture: Some("liver"),
        ..PLAIN
    }
}

fn lossless() -> Acoustics {
    Acoustics {
        texture: Some("liver"),
        ..PLAIN
    }
}

fn box_of(tissue: Acoustics) -> Anatomy {
    anatomy::anatomy_from(Frame::around([0.0, 20.0, 0.0], [20; 3], 2.0), &[SILENT, tissue], |_| 1)
}

fn two_tissues() -> Anatomy {
    let other = Acoustics {
        impedance_mrayl: 1.7,
        ..lossy()
    };
    let frame = Frame::around([0.0, 20.0, 0.0], [20; 3], 2.0);
    anatomy::layers(frame, &[-30.0, 20.0], &[SILENT, lossy(), other])
}

fn two_losses() -> Anatomy {
    let frame = Frame::around([0.0, 20.0, 0.0], [20; 3], 2.0);
    anatomy::layers(frame, &[-30.0, 20.0], &[SILENT, PLAIN, lossy()])
}

fn scene(name: &'static str, anatomy: Anatomy, edit: impl Fn(&mut Settings), passes: &'static [&'static str]) -> Scene {
    let mut settings = scene::settings(scene::small_probe(), scene::bare());
    edit(&mut settings);
    Scene {
        name,
        anatomy,
        settings,
        passes: Some(passes),
    }
}

/// All effects, on deforming, attenuating, textured tissue of two impedances with a needle.
pub(super) fn everything() -> Scene {
    let mesh = [[-12.0, 2.0, -12.0], [12.0, 36.0, 12.0]];
    let everything = scene(
        "everything",
        anatomy::with_mesh(two_tissues(), mesh, 60),
        |settings| {
            settings.effects = Effects::all();
            settings.has_needle = true;
            settings.layers = vec![Layer::LabelValue];
        },
        &[],
    );
    Scene {
        passes: None,
        ..everything
    }
}

pub(super) fn scenes() -> Vec<Scene> {
    let mesh = [[-12.0, 2.0, -12.0], [12.0, 36.0, 12.0]];
    vec![
        scene("nothing named", box_of(lossy()), |_| {}, &[]),
        scene(
            "only speckle",
            box_of(lossy()),
            |s| s.effects.speckle = Some(Default::default()),
            &["speckle_scatter", "speckle_axial", "speckle_lateral"],
        ),
        scene(
            "a needle without a needle effect",
            box_of(lossy()),
            |s| s.has_needle = true,
            &[],
        ),
        scene(
            "a needle effect without a needle",
            box_of(lossy()),
            |s| s.effects.needle = Some(Default::default()),
            &[],
        ),
        scene(
            "a needle",
            box_of(lossy()),
            |s| {
                s.effects.needle = Some(Default::default());
                s.has_needle = true;
            },
            &["needle"],
        ),
        scene(
            "shadow without an attenuating tissue",
            box_of(lossless()),
            |s| s.effects.shadow = Some(Default::default()),
            &[],
        ),
        scene(
            "shadow of attenuating tissue",
            box_of(lossy()),
            |s| s.effects.shadow = Some(Default::default()),
            &["shadow_loss", "shadow"],
        ),
        scene(
            "shadow of bone",
            box_of(Acoustics {
                occlusion_per_mm: 0.9,
                ..lossy()
            }),
            |s| s.effects.shadow = Some(Default::default()),
            &["shadow_loss", "shadow", "shadow_reflectors", "shadow_reverberation"],
        ),
        scene(
            "shadows of tissues that lose more than others",
            two_losses(),
            |s| s.effects.shadow = Some(Default::default()),
            &["shadow_loss", "shadow_rays", "shadow_aperture", "shadow"],
        ),
        scene(
            "mirror images of gas alone",
            box_of(Acoustics {
                occlusion_per_mm: 0.9,
                impedance_mrayl: 0.0004,
                ..lossy()
            }),
            |s| {
                s.effects.shadow = Some(Shadow {
                    f_number: Some(0.0),
                    reverberation: 0.0,
                    ..Default::default()
                });
            },
            &["shadow_loss", "shadow", "shadow_reflectors", "shadow_mirror"],
        ),
        scene(
            "refraction in one tissue",
            box_of(lossy()),
            |s| s.effects.refraction = Some(Default::default()),
            &[],
        ),
        scene(
            "refraction between two",
            two_tissues(),
            |s| s.effects.refraction = Some(Default::default()),
            &["refraction_phase", "refraction"],
        ),
        scene(
            "ground truth",
            box_of(lossy()),
            |s| {
                s.effects.needle = Some(Default::default());
                s.effects.shadow = Some(Shadow {
                    f_number: Some(0.0),
                    ..Default::default()
                });
                s.has_needle = true;
                s.layers = Layer::ALL.to_vec();
            },
            &[
                "needle",
                "shadow_loss",
                "shadow",
                "truth_label_value",
                "truth_label_index",
                "truth_beyond",
                "truth_displacement",
                "truth_depth",
                "truth_needle",
                "truth_loss",
                "truth_organ",
            ],
        ),
        scene(
            "ground truth that needs no pass",
            box_of(lossy()),
            |s| s.layers = vec![Layer::Sector, Layer::Needle, Layer::Loss],
            &[],
        ),
        scene(
            "shadow of a needle alone",
            box_of(lossless()),
            |s| {
                s.effects.shadow = Some(Default::default());
                s.effects.needle = Some(Default::default());
                s.has_needle = true;
            },
            &["needle", "shadow_loss", "shadow_rays", "shadow_aperture", "shadow"],
        ),
        scene(
            "shadow switched off in all its parts",
            box_of(lossy()),
            |s| {
                s.effects.shadow = Some(insonify_imaging::effects::shadow::Shadow {
                    attenuation: false,
                    occlusion: false,
                    needle_db_mm: 0.0,
                    ..Default::default()
                });
            },
            &[],
        ),
        scene(
            "textures of tissues without any",
            box_of(PLAIN),
            |s| s.effects.texture = Some(Default::default()),
            &[],
        ),
        scene(
            "textures",
            box_of(lossy()),
            |s| s.effects.texture = Some(Default::default()),
            &["texture"],
        ),
        scene(
            "a deforming mesh",
            anatomy::with_mesh(box_of(lossy()), mesh, 60),
            |_| {},
            &["warp_raster", "warp"],
        ),
        scene(
            "blur",
            box_of(lossy()),
            |s| s.effects.blur = Some(Default::default()),
            &["blur"],
        ),
        scene(
            "blur of one scanline",
            box_of(lossy()),
            |s| {
                s.effects.blur = Some(Default::default());
                s.probe.lines = 1;
            },
            &[],
        ),
        scene(
            "looks of speckle",
            box_of(lossy()),
            |s| {
                s.effects.speckle = Some(Default::default());
                s.effects.compound = Some(Default::default());
            },
            &[
                "speckle_scatter",
                "compound_phase",
                "compound_axial",
                "compound_lateral",
                "speckle_axial",
                "speckle_lateral",
                "compound",
            ],
        ),
        scene(
            "looks without speckle",
            box_of(lossy()),
            |s| s.effects.compound = Some(Default::default()),
            &[],
        ),
        scene(
            "speckle reduction",
            box_of(lossy()),
            |s| s.effects.speckle_reduction = Some(Default::default()),
            &["speckle_reduction"],
        ),
        scene(
            "speckle reduction of strength 0",
            box_of(lossy()),
            |s| {
                s.effects.speckle_reduction = Some(SpeckleReduction {
                    strength: Some(0.0),
                    ..Default::default()
                });
            },
            &[],
        ),
        scene(
            "interfaces",
            box_of(lossy()),
            |s| s.effects.interface = Some(Default::default()),
            &["interface"],
        ),
        scene(
            "interfaces in speckle",
            box_of(lossy()),
            |s| {
                s.effects.speckle = Some(Default::default());
                s.effects.interface = Some(Default::default());
            },
            &[
                "interface",
                "speckle_scatter",
                "speckle_specular",
                "speckle_axial",
                "speckle_lateral",
            ],
        ),
        scene(
            "thickness",
            box_of(lossy()),
            |s| s.effects.thickness = Some(Default::default()),
            &["thickness"],
        ),
        scene(
            "contact",
            box_of(lossy()),
            |s| s.effects.contact = Some(Default::default()),
            &["contact"],
        ),
        scene(
            "noise",
            box_of(lossy()),
            |s| s.effects.noise = Some(Default::default()),
            &["noise"],
        ),
        scene(
            "haze",
            box_of(lossy()),
            |s| s.effects.haze = Some(Default::default()),
            &["haze_reflectors", "haze_means", "haze"],
        ),
        scene(
            "receiver",
            box_of(lossy()),
            |s| s.effects.receiver = Some(Default::default()),
            &["receiver"],
        ),
        scene(
            "tone",
            box_of(lossy()),
            |s| s.effects.tone = Some(insonify_imaging::effects::tone::Tone::linear()),
            &[],
        ),
        scene(
            "automatic gain",
            box_of(lossy()),
            |s| s.effects.tone = Some(Default::default()),
            &["tone_auto_gain"],
        ),
        everything(),
    ]
}

/// Passes called for, in the order of the registry, which is that of a frame.
fn expected_passes(scene: &Scene) -> Vec<&'static Pass> {
    let tables = tables(scene);
    let all = REGISTRY.iter().flat_map(|effect| (effect.passes)(&tables));
    let Some(named) = scene.passes else {
        return all.collect();
    };
    let is_expected = |pass: &&Pass| ALWAYS.contains(&pass.name) || named.contains(&pass.name);
    let expected: Vec<_> = all.filter(is_expected).collect();
    assert_eq!(
        expected.len(),
        ALWAYS.len() + named.len(),
        "{}: names of passes",
        scene.name
    );
    expected
}

/// The block of TOML in the docs of a source.
fn documented(source: &str) -> String {
    let docs = source.lines().map_while(|line| line.strip_prefix("//!"));
    let block = docs.map(str::trim).skip_while(|line| *line != "```toml").skip(1);
    block.take_while(|line| *line != "```").collect::<Vec<_>>().join("\n")
}

/// Whether a scene calls for an effect, and why.
fn wanted(effect: &Effect, anatomy: &Anatomy, settings: &Settings) -> Wanted {
    let tables = Tables::new(anatomy.clone(), settings.clone()).expect("tables");
    (effect.wanted)(&tables)
}

#[test]
fn the_example_of_an_effect_stands_in_its_docs_and_calls_for_it() {
    let schema = schemars::schema_for!(Effects).to_value();
    let keys = schema["properties"].as_object().expect("effects");
    for effect in REGISTRY {
        assert_eq!(
            documented(&super::names::source(effect.name)),
            effect.example,
            "docs of {}",
            effect.name
        );
        if effect.example.is_empty() {
            assert!(!keys.contains_key(effect.name), "{} has no example", effect.name);
            continue;
        }
        let text = format!(
            "volume = {{ phantom = \"abdomen\", resolution_mm = 5 }}\n{}",
            effect.example
        );
        let file = SceneFile::parse(&text, effect.name).unwrap_or_else(|error| panic!("{error}"));
        let scene = file.resolve(".".as_ref()).unwrap_or_else(|error| panic!("{error}"));
        let (mut anatomy, mut settings) = (scene.anatomy, scene.settings);
        let with = wanted(effect, &anatomy, &settings);
        assert!(matches!(with, Wanted::Yes(_)), "{}: {with:?}", effect.name);
        if let Some(remove) = effect.remove {
            remove(&mut anatomy, &mut settings);
            assert_ne!(wanted(effect, &anatomy, &settings), with, "{} is removed", effect.name);
        }
    }
}

fn names(passes: &[&'static Pass]) -> Vec<&'static str> {
    passes.iter().map(|pass| pass.name).collect()
}

#[test]
fn plans_list_the_passes_called_for_and_no_other() {
    for scene in scenes() {
        let plan = Plan::new(&tables(&scene));
        let found: Vec<&str> = plan.passes.iter().map(|planned| planned.pass.name).collect();
        let expected = expected_passes(&scene);
        assert_eq!(found, names(&expected), "{}", scene.name);
        // What those passes bind, once each, and nothing else.
        let resources: BTreeSet<&str> = plan.resources.iter().map(|planned| planned.resource.name).collect();
        let bound = expected.iter().flat_map(|pass| pass.bindings);
        assert_eq!(
            resources,
            bound.map(|(buffer, _)| buffer.name).collect(),
            "{}",
            scene.name
        );
        assert_eq!(resources.len(), plan.resources.len(), "{}", scene.name);
        // Every effect either runs, perhaps among the passes of others, or is left out, and says why.
        let of_others = plan.passes.iter().filter_map(|planned| planned.needed_by);
        let of_others = of_others.filter(|name| REGISTRY.iter().any(|effect| effect.name == *name));
        let effects: BTreeSet<&str> = plan
            .passes
            .iter()
            .map(|planned| planned.effect)
            .chain(of_others)
            .collect();
        assert_eq!(effects.len() + plan.without.len(), REGISTRY.len(), "{}", scene.name);
        for omitted in &plan.without {
            assert!(!effects.contains(omitted.name), "{}: {}", scene.name, omitted.name);
            assert!(!omitted.reason.is_empty());
        }
        assert!(plan.passes.iter().all(|planned| !planned.reason.is_empty()));
    }
}

#[test]
fn reports_add_up() {
    for scene in scenes() {
        let plan = Plan::new(&tables(&scene));
        let report = plan.report(&Default::default());
        assert_eq!(
            report.bytes,
            report.resources.iter().map(|resource| resource.bytes).sum::<u64>()
        );
        assert!(
            report.resources.iter().all(|resource| resource.bytes > 0),
            "{}: {report}",
            scene.name
        );
        let text = report.to_string();
        for pass in &report.passes {
            assert!(text.contains(pass.name), "{text}");
        }
        let json = serde_json::to_value(&report).expect("JSON");
        assert_eq!(json["passes"].as_array().map(Vec::len), Some(plan.passes.len()));
    }
}

#[test]
fn pipelines_and_buffers_are_those_of_the_plan() {
    let Some(gpu) = gpu_or_skip() else {
        return;
    };
    for scene in scenes() {
        let synthesizer = Synthesizer::new(scene.anatomy.clone(), scene.settings.clone(), backend(gpu.clone()))
            .expect("a synthesizer");
        let mut found = synthesizer.pipelines();
        found.sort_unstable();
        let mut expected = names(&expected_passes(&scene));
        expected.sort_unstable();
        assert_eq!(found, expected, "{}", scene.name);
        assert_eq!(synthesizer.memory_bytes(), synthesizer.plan().bytes(), "{}", scene.name);
    }
}

#[test]
fn effects_taken_away_take_their_pipelines_and_memory_along() {
    let gpu = gpu_or_skip();
    let all = everything();
    for make in [Backend::Cpu, Backend::CpuF64].into_iter().chain(gpu.map(backend)) {
        let mut synthesizer =
            Synthesizer::new(all.anatomy.clone(), all.settings.clone(), make.clone()).expect("a synthesizer");
        let mut settings = all.settings.clone();
        for effect in LISTED.iter().rev() {
            let passes = synthesizer.plan().passes.len();
            let before = settings.clone();
            if let Some(remove) = effect.remove {
                remove(&mut all.anatomy.clone(), &mut settings);
            }
            // The mesh of the anatomy is fixed on creation.
            if settings == before {
                continue;
            }
            synthesizer.set(settings.clone()).expect("fewer effects");
            assert!(
                synthesizer.plan().passes.len() < passes,
                "{} leaves its passes",
                effect.name
            );
            let fresh = Synthesizer::new(all.anatomy.clone(), settings.clone(), make.clone()).expect("a synthesizer");
            let place = format!("without {} on {}", effect.name, synthesizer.backend());
            assert_eq!(synthesizer.memory_bytes(), fresh.memory_bytes(), "memory {place}");
            let pipelines = [&synthesizer, &fresh].map(|synthesizer| {
                let mut names = synthesizer.pipelines();
                names.sort_unstable();
                names
            });
            assert_eq!(pipelines[0], pipelines[1], "pipelines {place}");
        }
    }
}

#[test]
fn bands_cover_every_row_once_and_fit_the_limit() {
    let mut scene = everything();
    (scene.settings.image.width, scene.settings.image.height) = (129, 77);
    let tables = tables(&scene);
    let plan = Plan::new(&tables);
    let row = SCAN_MAP.bytes(&tables) / 77;
    let largest = [&SCAN_MAP, &IMAGE, &PIXELS]
        .map(|buffer| buffer.bytes(&tables) / 77)
        .into_iter()
        .max()
        .expect("three");
    assert_eq!(largest, row, "the scan map is the largest");
    for (limit, bands) in [
        (u64::MAX, 1),
        (row * 77, 1),
        (row * 77 - 1, 2),
        (row * 10, 8),
        (row, 77),
        (1, 77),
    ] {
        let found = plan.bands(&tables, limit);
        assert_eq!(found.len(), bands, "{limit} bytes a binding");
        let mut next = 0;
        for band in found {
            assert_eq!(band.first_row, next);
            assert!(band.rows >= 1 && (band.rows == 1 || u64::from(band.rows) * row <= limit));
            next += band.rows;
        }
        assert_eq!(next, 77);
    }
}

#[test]
fn lengths_that_a_grid_cannot_have_are_told() {
    let settings = |samples: u32, axial_mm: f64, blur_mm: f64| {
        let probe = scene::probe(scene::SHAPES[0].1, 150.0, 128, samples);
        let mut settings = scene::settings(probe, scene::bare());
        settings.effects.speckle = Some(insonify_imaging::effects::speckle::Speckle {
            axial_mm: Some(axial_mm),
            ..Default::default()
        });
        settings.effects.blur = Some(insonify_imaging::effects::blur::Blur {
            width_mm: Some(blur_mm),
            growth_mm_cm: Some(0.0),
        });
        settings
    };
    let warnings = |settings| Plan::new(&Tables::new(box_of(PLAIN), settings).expect("tables")).warnings;
    assert_eq!(warnings(settings(512, 0.8, 0.6)), [""; 0]);
    let found = warnings(settings(8192, 3.0, 0.6));
    assert!(
        found.len() == 1 && found[0].contains("effects.speckle.axial_mm"),
        "{found:?}"
    );
    let found = warnings(settings(512, 0.8, 20.0));
    assert!(
        found.len() == 1 && found[0].contains("effects.blur.width_mm"),
        "{found:?}"
    );
}
