//! Tests of the built-in liver puncture at coarser resolution, and of the restrictions on stiffening tissue.

use std::path::Path;

use crate::input::scenario::{EXAMPLES, Scenario, ScenarioFile};
use crate::run::{Moment, Observer, Requests, Step, run};
use insonify_base::document::InputError;
use insonify_imaging::synth::{Backend, FrameState, Synthesizer};
use insonify_mechanics::insertion::{EventKind, Model, Saved, Snapshot, StepError};
use insonify_mechanics::tissue::nonlinear::creep::Memory;

fn ready() -> String {
    let (_, text) = EXAMPLES.iter().find(|(name, _)| *name == "liver-puncture").unwrap();
    (*text).to_owned()
}

/// Coarser mesh and voxels, and half the insertion time, to run in seconds.
fn quick() -> String {
    let mut text = ready();
    for (key, replacement) in [
        ("nodes = 3300", "nodes = 500"),
        (
            "phantom = \"liver-vein\"",
            "phantom = \"liver-vein\"\nresolution_mm = 1.5",
        ),
        ("dt_ms = 40.0", "dt_ms = 80.0"),
        ("frame_rate_hz = 12.5", "frame_rate_hz = 4.0"),
    ] {
        assert!(text.contains(key), "{key}");
        text = text.replacen(key, replacement, 1);
    }
    text
}

fn resolved(text: &str) -> Result<Scenario, InputError> {
    ScenarioFile::parse(text, "liver.toml")?.resolve(Path::new("."), |_| {})
}

/// Records steps, events and the states of frames.
#[derive(Default)]
struct Watch {
    force_n: Vec<f64>,
    inserted_mm: Vec<f64>,
    events: Vec<(EventKind, Option<i32>, usize)>,
    frames: Vec<(usize, FrameState)>,
}

impl Observer for Watch {
    type Error = StepError;

    fn step(&mut self, step: &Step<'_>) -> Result<(), StepError> {
        assert!(step.outcome.converged, "{:?}", step.outcome);
        self.force_n.push(step.outcome.on_hand.force_n.norm());
        self.inserted_mm.push(step.outcome.inserted_mm);
        let number = self.force_n.len() - 1;
        let events = step.outcome.events.iter();
        self.events
            .extend(events.map(|event| (event.kind, event.region, number)));
        Ok(())
    }

    fn frame(&mut self, moment: &Moment<'_>) -> Result<(), StepError> {
        self.frames.push((self.force_n.len() - 1, moment.state.clone()));
        Ok(())
    }
}

fn watched(scenario: &Scenario) -> Watch {
    let mut model = scenario.model(|_, _| {}).unwrap();
    let mut watch = Watch::default();
    let requests = Requests {
        frames: true,
        mesh_s: None,
    };
    run(scenario, model.as_mut(), requests, &mut watch).unwrap();
    watch
}

/// Area of the vein in the image plane, mm^2: number of its samples, each as wide as its scanline is there.
fn vein_mm2(synth: &mut Synthesizer, state: &FrameState, vessel: u8) -> f64 {
    let [radius_mm, angle_deg, depth_mm] = [20.0, 75.0, 62.0_f64];
    let beam = synth.render_until("slice", state).unwrap();
    let step = depth_mm / beam.samples as f64;
    let turn = f64::to_radians(angle_deg) / beam.lines as f64;
    let shown = beam.label.iter().enumerate().filter(|(_, label)| **label == vessel);
    shown
        .map(|(sample, _)| step * turn * (radius_mm + step * (sample % beam.samples) as f64))
        .sum()
}

/// Figures 11 and 12 of Kobayashi et al. 2010: force rises faster than linearly and drops at capsule and wall; the vein
/// flattens before.
#[test]
fn a_needle_pushes_into_the_liver_and_flattens_the_vein() {
    let scenario = resolved(&quick()).unwrap();
    let watch = watched(&scenario);
    let region = |name: &str| {
        scenario
            .region_names
            .iter()
            .find(|(_, region_name)| *region_name == name)
            .map(|(region, _)| *region)
    };
    let (liver, vessel) = (region("liver"), region("vessel"));
    let events_of = |kind| {
        let events = watch.events.iter().filter(move |(event, _, _)| *event == kind);
        events.map(|&(_, region, step)| (region, step)).collect::<Vec<_>>()
    };
    let (skin, punctures) = (events_of(EventKind::Skin), events_of(EventKind::Puncture));
    assert!(skin.len() == 1 && skin[0].0 == liver, "{skin:?}");
    assert_eq!(
        punctures.iter().map(|(region, _)| *region).collect::<Vec<_>>(),
        [liver, vessel]
    );
    let [capsule, wall] = [punctures[0].1, punctures[1].1];
    let force = &watch.force_n;
    let touch = skin[0].1;
    // Strength of the membranes, and the increment of a step.
    assert!(force[capsule] > 0.6 && force[capsule] < 0.75, "{force:?}");
    assert!(
        force[capsule + 1] < 0.5 * force[capsule] && force[wall + 1] < 0.5 * force[wall],
        "{force:?}"
    );
    assert!(
        force[touch..=capsule].windows(2).all(|pair| pair[1] > pair[0]),
        "{force:?}"
    );
    // Halfway to the puncture it is less than half: also for a mesh this coarse.
    assert!(
        force[usize::midpoint(touch, capsule)] < 0.45 * force[capsule],
        "{force:?}"
    );
    assert!(watch.inserted_mm[capsule] == 0.0 && watch.inserted_mm[wall] > 18.0);

    let index = scenario
        .scene
        .anatomy
        .volume
        .labels()
        .iter()
        .position(|label| Some(label.value as i32) == vessel);
    let vessel = u8::try_from(index.unwrap()).unwrap();
    let (anatomy, settings) = (scenario.scene.anatomy.clone(), scenario.scene.settings.clone());
    let mut synth = Synthesizer::new(anatomy, settings, Backend::Cpu).unwrap();
    let mut area = |until: usize| {
        let (_, state) = watch.frames.iter().rev().find(|(step, _)| *step <= until).unwrap();
        vein_mm2(&mut synth, state, vessel)
    };
    let [at_rest, pushed, pressed, after] = [touch - 1, capsule, wall, force.len() - 1].map(&mut area);
    // An ellipse of half axes 11 and 6.5 mm, sampled.
    let ellipse = std::f64::consts::PI * 11.0 * 6.5;
    assert!((at_rest / ellipse - 1.0).abs() < 0.05, "{at_rest} for {ellipse}");
    assert!(
        pushed < 0.8 * at_rest && pressed < 0.7 * at_rest,
        "{at_rest} {pushed} {pressed}"
    );
    assert!(after > 1.1 * pressed, "{pressed} {after}");
}

/// The creep parameters of the file take effect: the force on a needle held in liver relaxes.
#[test]
fn creep_is_that_of_the_file() {
    let text = quick().replace("nodes = 500", "nodes = 300");
    let creeping = resolved(&text).unwrap();
    let viscosity = creeping.tissue.nonlinear().unwrap().viscosity.unwrap();
    assert_eq!((viscosity.order, viscosity.memory), (0.1, Memory::LoadIntegral));
    let table = "[tissue.viscosity]\norder = 0.1\nmemory = \"load-integral\"";
    assert!(text.contains(table));
    let elastic = text
        .replacen(table, "", 1)
        .replacen("\"viscoelastic\"", "\"nonlinear\"", 1);
    let elastic = resolved(&elastic).unwrap();
    assert_eq!(elastic.tissue.nonlinear().unwrap().viscosity, None);
    // Halfway to the capsule's puncture, then still: tissue below the knee creeps as t^-0.1, t in seconds.
    let forces_n = |scenario: &Scenario| -> [f64; 2] {
        let mut model = scenario.model(|_, _| {}).unwrap();
        let mut force = |step: u64| {
            let instruments = scenario.instruments(step);
            model
                .step(&instruments, scenario.timing.dt_s)
                .unwrap()
                .on_hand
                .force_n
                .norm()
        };
        (1..=30).for_each(|step| {
            let _ = force(step);
        });
        let first_n = force(30);
        (0..20).for_each(|_| {
            let _ = force(30);
        });
        [first_n, force(30)]
    };
    let [first_n, last_n] = forces_n(&elastic);
    assert!(
        first_n > 0.01 && (last_n / first_n - 1.0).abs() < 1e-2,
        "{first_n} {last_n}"
    );
    let [first_n, last_n] = forces_n(&creeping);
    assert!(first_n > 0.01 && last_n < 0.95 * first_n, "{first_n} {last_n}");
}

#[test]
fn a_run_replays_with_the_same_bits() {
    let scenario = resolved(&quick().replace("nodes = 500", "nodes = 300")).unwrap();
    let steps = |model: &mut dyn Model, from: u64, to: u64| -> Vec<_> {
        (from..to)
            .map(|step| {
                model
                    .step(&scenario.instruments(step), scenario.timing.dt_s)
                    .unwrap()
                    .clone()
            })
            .collect()
    };
    let mut model = scenario.model(|_, _| {}).unwrap();
    steps(model.as_mut(), 1, 40);
    let saved: Saved = serde_json::from_str(&serde_json::to_string(&model.save()).unwrap()).unwrap();
    let expected = steps(model.as_mut(), 40, 60);
    let mut restored = scenario.model(|_, _| {}).unwrap();
    restored.restore(&saved).unwrap();
    assert_eq!(steps(restored.as_mut(), 40, 60), expected);
    let (mut a, mut b) = (Snapshot::default(), Snapshot::default());
    model.snapshot(&mut a);
    restored.snapshot(&mut b);
    assert_eq!(a, b);
}

#[test]
fn what_such_tissue_cannot_have_is_refused_where_it_stands() {
    let text = quick();
    let line = |text: &str, key: &str| {
        1 + text
            .lines()
            .position(|line| line.trim_start().starts_with(key))
            .unwrap()
    };
    let elastic = text.replacen("\"viscoelastic\"", "\"nonlinear\"", 1);
    let linear = text.replacen("\"viscoelastic\"", "\"finite-element\"", 1);
    let with_line = |text: &str, line: &str, added: &str| text.replacen(line, &format!("{line}\n{added}"), 1);
    let needle = "diameter_mm = 1.0";
    let cases = [
        (
            elastic,
            "[tissue.viscosity]",
            "`viscosity` with `model = \"nonlinear\"`",
        ),
        (
            linear.replacen("[tissue.viscosity]\norder = 0.1\nmemory = \"load-integral\"", "", 1),
            "[tissue.solver]",
            "`solver` with `model = \"finite-element\"`",
        ),
        (
            text.replacen("knee_strain = 0.303\n", "", 1),
            "stiffening = 60",
            "`stiffening` is alone",
        ),
        (
            text.replacen("knee_strain = 0.303", "knee_strain = -1", 1),
            "knee_strain = -1",
            "0 or more",
        ),
        (text.replacen("order = 0.1", "order = 1.1", 1), "order = 1.1", "0 to 1"),
        (
            text.replacen("tolerance = 1e-4", "tolerance = 2.0", 1),
            "tolerance = 2.0",
            "above 0, below 1",
        ),
        (
            with_line(&text, "nodes = 500", "level = \"I\""),
            "level",
            "`level` with `model = \"viscoelastic\"`",
        ),
        (
            with_line(&text, needle, "model = \"springs\""),
            "model = \"springs\"",
            "supports straight paths only",
        ),
        (
            with_line(&text, needle, "bevel = { r_mm = 0.6, length_mm = 5.0 }"),
            "bevel",
            "supports straight paths only",
        ),
        (
            with_line(&text, "puncture_n = 0.5", "rigid = true"),
            "[[needle.motion.keyframes]]",
            "meets bone",
        ),
        (
            format!("{text}\n[contact_probe]\nradius_mm = 10\nlength_mm = 30\n"),
            "[contact_probe]",
            "does not support it",
        ),
    ];
    for (wrong, key, words) in cases {
        assert_ne!(wrong, text, "{words}");
        let error = resolved(&wrong).map(drop).expect_err(words);
        assert!(error.to_string().contains(words), "{words}: {error}");
        let Some((_, found)) = error.location() else {
            panic!("{words}: {error:?}")
        };
        // Keyframes have no unique line: the second or third.
        if key.starts_with("[[") {
            assert!(found > line(&wrong, key), "{found}: {error}");
        } else {
            assert_eq!(found, line(&wrong, key), "{key}: {error}");
        }
    }
    // Sideways, in tissue.
    let last_keyframe = text.rfind("[[needle.motion.keyframes]]").unwrap();
    let sideways = format!(
        "{}{}",
        &text[..last_keyframe],
        text[last_keyframe..].replacen("tip_mm = [-", "tip_mm = [-1", 1)
    );
    let error = resolved(&sideways).map(drop).unwrap_err();
    assert!(error.to_string().contains("does not support lateral motion"), "{error}");
    assert!(
        error
            .location()
            .is_some_and(|(_, line)| line > sideways[..last_keyframe].lines().count())
    );
}
