//! Whole insertions as they are shipped: only a surface that breaks changes the force on the hand at once, and how far it
//! gives way before that is no matter of the mesh.

use std::error::Error;
use std::path::Path;

use insonify::{Observer, Requests, SCENARIOS, ScenarioFile, Step, run_scenario};
use insonify_mechanics::insertion::EventKind;
use nalgebra::{Point3, Vector3};

/// Change of the force on the hand that nobody takes for a puncture, N, in a millisecond or in a shorter step.
const UNFELT_N: f64 = 0.05;
/// Longest step that is felt as one, ms; in longer ones the mean rate of the second around is no jump.
const FELT_MS: f64 = 2.0;
/// Largest share by which the dent of one surface may differ between meshes.
const SAME_DENT: f64 = 0.15;

/// Forces on the hand and punctures of each step.
#[derive(Default)]
struct Hand {
    forces: Vec<Vector3<f64>>,
    punctured: Vec<bool>,
    touched: Option<Point3<f64>>,
    /// Way from the touch of the skin to its puncture, mm.
    dent_mm: Option<f64>,
}

impl Observer for Hand {
    type Error = Box<dyn Error>;

    fn step(&mut self, step: &Step<'_>) -> Result<(), Self::Error> {
        let events = &step.outcome.events;
        let find = |kind| events.iter().find(|event| event.kind == kind);
        self.touched = self.touched.or(find(EventKind::Skin).map(|event| event.at_mm));
        let puncture = find(EventKind::Puncture);
        if let (None, Some(touched), Some(puncture)) = (self.dent_mm, self.touched, puncture) {
            self.dent_mm = Some((puncture.at_mm - touched).norm());
        }
        self.forces.push(step.outcome.on_hand.force_n);
        self.punctured.push(puncture.is_some());
        Ok(())
    }
}

impl Hand {
    /// Largest change of the force without a puncture, N in a millisecond, with the number of its step.
    fn largest_pop(&self, dt_ms: f64) -> (f64, usize) {
        let (count, half) = (self.forces.len(), (500.0 / dt_ms) as usize);
        // A surface that breaks in one step springs back in the next.
        let breaks = |step: usize| self.punctured[step] || self.punctured[step - 1];
        let pops = (1..count).filter(|step| !breaks(*step)).map(|step| {
            let change = (self.forces[step] - self.forces[step - 1]).norm();
            if dt_ms <= FELT_MS {
                return (change / dt_ms.max(1.0), step);
            }
            let [from, to] = [step.saturating_sub(half), (step + half).min(count - 1)];
            let mean = (self.forces[to] - self.forces[from]).norm() / (to - from) as f64;
            (change - mean, step)
        });
        pops.fold((0.0, 0), |largest, pop| if pop.0 > largest.0 { pop } else { largest })
    }
}

/// Runs a shipped scenario with changes of its text.
fn insert(name: &str, changes: &[(&str, &str)]) -> Hand {
    let text = SCENARIOS.iter().find(|(known, _)| *known == name).expect("shipped").1;
    let text = changes.iter().fold(text.to_owned(), |text, (from, to)| {
        assert!(text.contains(from), "{name}: no {from}");
        text.replace(from, to)
    });
    let file = ScenarioFile::parse(&text, name).expect("a scenario");
    let scenario = file.resolve(Path::new(""), |_| ()).expect("its files");
    let mut model = scenario.model(|_, _| {}).expect("a model");
    let mut hand = Hand::default();
    run_scenario(&scenario, model.as_mut(), Requests::default(), &mut hand).expect("a run");
    hand
}

fn has_no_pop(name: &str, dt_ms: f64, changes: &[(&str, &str)]) {
    let (pop, step) = insert(name, changes).largest_pop(dt_ms);
    assert!(
        pop <= UNFELT_N,
        "{name} {changes:?}: {pop} N in a millisecond at step {step}"
    );
}

fn dents_alike(nodes: &[&str], paths: &[&[(&str, &str)]]) {
    for path in paths {
        let dent = |nodes: &&str| {
            let changes = [*path, &[("nodes = 3300", *nodes)]].concat();
            insert("liver-biopsy", &changes).dent_mm.expect("a puncture")
        };
        let dents: Vec<f64> = nodes.iter().map(dent).collect();
        let [least, most] = [f64::min, f64::max].map(|pick| dents.iter().copied().reduce(pick).expect("meshes"));
        assert!(most <= least * (1.0 + SAME_DENT), "{path:?}: {dents:?} mm");
    }
}

#[test]
fn only_punctures_are_felt_at_once() {
    has_no_pop("two-layer-insertion", 10.0, &[("nodes = 991", "nodes = 400")]);
    has_no_pop(
        "liver-biopsy",
        0.5,
        &[("nodes = 3300", "nodes = 1000"), ("dt_ms = 1.0", "dt_ms = 0.5")],
    );
}

#[test]
fn the_skin_gives_way_alike_in_meshes() {
    dents_alike(&["nodes = 290", "nodes = 1000"], &[&[]]);
}

#[test]
#[ignore = "minutes: `.ci/more forces`"]
fn only_punctures_are_felt_in_whole_runs() {
    has_no_pop("two-layer-insertion", 10.0, &[]);
    for (dt, dt_ms) in [("dt_ms = 0.5", 0.5), ("dt_ms = 1.0", 1.0), ("dt_ms = 2.0", 2.0)] {
        has_no_pop("two-layer-insertion", dt_ms, &[("dt_ms = 10.0", dt)]);
        has_no_pop("liver-biopsy", dt_ms, &[("dt_ms = 1.0", dt)]);
        has_no_pop("prostate-brachytherapy", dt_ms, &[("dt_ms = 1.0", dt)]);
    }
}

#[test]
#[ignore = "minutes: `.ci/more forces`"]
fn the_skin_gives_way_alike_from_400_to_10000_nodes() {
    let other = [
        (
            "tip_mm = [-93.1, -81.3, -73.8]",
            "tip_mm = [-80.0652, -95.7718, 25.2442]",
        ),
        ("tip_mm = [-14.5, 1.1, 17.6]", "tip_mm = [-77.5, -47.5, 41.5]"),
        (
            "direction = [0.538, 0.564, 0.626]",
            "direction = [0.050299, 0.946506, 0.318741]",
        ),
    ];
    let nodes = ["nodes = 400", "nodes = 1000", "nodes = 3300", "nodes = 10000"];
    dents_alike(&nodes, &[&[], &other]);
}
