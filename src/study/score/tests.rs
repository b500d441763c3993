use std::path::Path;

use super::exercise::{Conditions, csv, perform, study};
use super::groups::{compare, holm, mann_whitney, read, welch};
use super::hands::hand;
use super::*;
use insonify::input::scenario::{EXAMPLES, Scenario, ScenarioFile};

/// Table of a straight run: 100 steps from the entry at the origin along z to 99 mm, after one outside, and one after.
fn straight(change: impl Fn(usize, &mut std::collections::BTreeMap<&str, [f64; 3]>)) -> String {
    let vectors: [(&str, &str, [f64; 3]); 12] = [
        ("tip_", "_mm", [0.0; 3]),
        ("base_d", "", [0.0, 0.0, 1.0]),
        ("tip_d", "", [0.0, 0.0, 1.0]),
        ("measured_tip_", "_mm", [0.0; 3]),
        ("array_", "_mm", [0.0, -30.0, 0.0]),
        ("plane_n", "", [1.0, 0.0, 0.0]),
        ("entry_at_rest_", "_mm", [0.0; 3]),
        ("entry_", "_mm", [0.0; 3]),
        ("target_at_rest_", "_mm", [0.0, 0.0, 100.0]),
        ("target_", "_mm", [0.0, 0.0, 100.0]),
        ("base_force_", "_n", [0.0, 3.0, 4.0]),
        ("unused_", "", [0.0; 3]),
    ];
    let names: Vec<String> = vectors
        .iter()
        .flat_map(|(name, unit, _)| ["x", "y", "z"].map(|axis| format!("{name}{axis}{unit}")))
        .collect();
    let mut text = format!("time_s,inserted_mm,target_shown,clearance_mm,{}\n", names.join(","));
    for step in 0..102 {
        let depth = (step as f64 - 1.0).clamp(0.0, 99.0);
        let mut values: std::collections::BTreeMap<&str, [f64; 3]> =
            vectors.iter().map(|(name, _, value)| (*name, *value)).collect();
        values.insert("tip_", [0.0, 0.0, depth]);
        values.insert("measured_tip_", [0.0, 0.0, depth]);
        change(step, &mut values);
        let inserted = if (1..=100).contains(&step) { depth + 1.0 } else { 0.0 };
        let clearance = if step == 50 { "0" } else { "7.5" };
        text += &format!(
            "{},{inserted},{},{clearance}",
            step as f64 * 0.01,
            u8::from(step % 4 == 0)
        );
        for (name, _, _) in &vectors {
            values[name].iter().for_each(|x| text += &format!(",{x}"));
        }
        text += "\n";
    }
    text
}

fn score(text: &str) -> Result<Score, Error> {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("steps.csv"), text).unwrap();
    Score::of(folder.path())
}

fn assert_values(metrics: &Metrics, expected: [f64; COUNT]) {
    for ((value, expected), name) in metrics.0.iter().zip(expected).zip(NAMES) {
        assert!((value - expected).abs() < 1e-9, "{name}: {value}, expected {expected}");
    }
}

#[test]
fn a_perfect_run_scores_zero() {
    let score = score(&straight(|_, _| ())).unwrap();
    assert_values(&score.metrics, [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 25.0, 0.0, 1.0]);
    assert_eq!(score.during_s, [0.01, 1.0]);
    assert!(score.withdrawn && (score.max_force_n - 5.0).abs() < 1e-12);
    assert_eq!((score.critical_entries, score.clearance_mm), (1, Some(0.0)));
    assert!((score.nearest_s - 1.0).abs() < 1e-9);
}

#[test]
fn offsets_and_angles_are_those_of_the_geometry() {
    let (sin, cos) = 10_f64.to_radians().sin_cos();
    let score = score(&straight(|step, values| {
        // 3 mm out of the plane and 4 mm within it; the needle 10 degrees out of the plane; the measured tip 2 mm
        // behind.
        values.get_mut("tip_").unwrap()[0] = 3.0;
        values.get_mut("tip_").unwrap()[1] = 4.0;
        values.insert("tip_d", [sin, 0.0, cos]);
        values.insert("base_d", [sin, 0.0, cos]);
        let tip = values["tip_"];
        values.insert("measured_tip_", [tip[0], tip[1], tip[2] - 2.0]);
        // The array 1 mm aside; the tissue carries the target by 5 mm along x from half-way on.
        values.get_mut("array_").unwrap()[0] = 1.0;
        if step > 50 {
            values.get_mut("target_").unwrap()[0] = 5.0;
        }
    }))
    .unwrap();
    let at_rest = [5.0, 10.0, 2.0, 10.0, 0.0, 2.0, 0.0, 25.0, 1.0, 26_f64.sqrt()];
    assert_values(&score.at_rest, at_rest);
    // Half of the steps have the target 4 mm from the plane.
    assert!((score.metrics.0[8] - 2.5).abs() < 1e-9, "{}", score.metrics.0[8]);
    assert!(
        (score.metrics.0[9] - (4.0_f64 + 16.0 + 1.0).sqrt()).abs() < 1e-9,
        "{}",
        score.metrics.0[9]
    );
    assert!(score.metrics.0[0] < 5.0 && score.metrics.0[1] < 10.0);
}

#[test]
fn turns_of_plane_and_constrained_needle_are_angles() {
    let (sin, cos) = 20_f64.to_radians().sin_cos();
    let score = score(&straight(|step, values| {
        values.insert("tip_d", [0.0, sin, cos]);
        if step > 1 {
            values.insert("plane_n", [cos, sin, 0.0]);
        }
    }))
    .unwrap();
    assert!(
        (score.metrics.0[4] - 20.0 * 0.99).abs() < 1e-9,
        "{}",
        score.metrics.0[4]
    );
    assert!((score.metrics.0[6] - 20.0).abs() < 1e-9 && score.metrics.0[5].abs() < 1e-12);
}

#[test]
fn runs_that_cannot_be_scored_are_told() {
    let refused = |text: &str, words: &str| {
        let error = score(text).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    };
    let text = straight(|_, _| ());
    refused(
        &text.lines().take(2).collect::<Vec<_>>().join("\n"),
        "never has the needle in the body",
    );
    refused(&text.replace("plane_nx", "plane_x"), "without `plane_nx`");
    refused(&text.replace(",0,0,100,0,0,100,", ",,,,,,,"), "has no target");
    assert!(
        Score::of(Path::new("/nowhere"))
            .unwrap_err()
            .to_string()
            .contains("/nowhere")
    );
}

/// Permeability of the human chorioamnion at term and at 12 to 26 weeks (M. Hollander and D. A. Wolfe, Nonparametric
/// Statistical Methods, 1973, p. 69): W = 35; p by scipy 1.10.1, `mannwhitneyu(a, b, method='exact')` and
/// `ttest_ind(a, b, equal_var=False)`.
#[test]
fn tests_agree_with_published_and_computed_values() {
    let term = [0.80, 0.83, 1.89, 1.04, 1.45, 1.38, 1.91, 1.64, 0.73, 1.46];
    let early = [1.15, 0.88, 0.90, 0.74, 1.21];
    let close = |p: Option<f64>, expected: f64| assert!((p.unwrap() - expected).abs() < 1e-9, "{p:?} {expected}");
    close(mann_whitney(&term, &early), 0.2544122544122544);
    close(mann_whitney(&early, &term), 0.2544122544122544);
    close(welch(&term, &early), 0.06210134378107843);
    // The example of scipy's documentation: ages at diagnosis of diabetes.
    close(
        mann_whitney(&[19.0, 22.0, 16.0, 29.0, 24.0], &[20.0, 11.0, 17.0, 12.0]),
        0.1111111111111111,
    );
    // With ties, by the normal approximation (scipy, `method='asymptotic'`).
    let a = [
        27.5, 21.0, 19.0, 23.6, 17.0, 17.9, 16.9, 20.1, 21.9, 22.6, 23.1, 19.6, 19.0, 21.7, 21.4,
    ];
    let b = [
        27.1, 22.0, 20.8, 23.4, 23.4, 23.5, 25.8, 22.0, 24.8, 20.2, 21.9, 22.1, 22.9, 24.4, 24.4,
    ];
    close(mann_whitney(&a, &b), 0.006561321113528006);
    close(welch(&a, &b), 0.009985901268864032);
    assert_eq!((welch(&[1.0], &b), welch(&[1.0, 1.0], &[1.0, 1.0])), (None, None));
    assert_eq!(
        (mann_whitney(&[], &b), mann_whitney(&[1.0; 3], &[1.0; 3])),
        (None, None)
    );
    // 4 x 0.005, 3 x 0.01, 2 x 0.03, and no less for the last.
    let corrected = holm(&[Some(0.01), Some(0.04), None, Some(0.03), Some(0.005)]);
    for (p, expected) in corrected
        .iter()
        .zip([Some(0.03), Some(0.06), None, Some(0.06), Some(0.02)])
    {
        match (p, expected) {
            (Some(p), Some(expected)) => assert!((p - expected).abs() < 1e-12),
            both => assert_eq!(both, (&None, None)),
        }
    }
}

/// A coarse liver biopsy with a target at its deepest point.
fn biopsy() -> (String, Scenario) {
    let text = EXAMPLES.iter().find(|(name, _)| *name == "liver-biopsy").unwrap().1;
    let text = text
        .replace("nodes = 3300", "nodes = 400")
        .replace("dt_ms = 1.0", "dt_ms = 20.0");
    let text = text + "\n[[plan.target]]\nname = \"lesion\"\nat_mm = [-14.5, 1.1, 17.6]\nradius_mm = 5.0\n";
    let file = ScenarioFile::parse(&text, "biopsy.toml").unwrap();
    (text, file.resolve(Path::new(""), |_| ()).unwrap())
}

#[test]
fn simulated_hands_rank_as_their_errors() {
    let (_, scenario) = biopsy();
    let mean = |name: &str, metric: fn(&Metrics) -> f64| {
        let values = (0..4).map(|seed| metric(&perform(&scenario, &hand(name).unwrap(), seed).unwrap().metrics));
        values.sum::<f64>() / 4.0
    };
    let line = |metrics: &Metrics| metrics.0[0];
    let [expert, late, wrong_angle] = ["expert", "late-correction", "wrong-angle"].map(|name| mean(name, line));
    assert!(expert < late && late < wrong_angle, "{expert} {late} {wrong_angle}");
    let angle = |metrics: &Metrics| metrics.0[1];
    assert!(mean("expert", angle) < mean("tremor", angle));
    let miss = |metrics: &Metrics| metrics.0[9];
    assert!(mean("late-correction", miss) < mean("wrong-angle", miss));
}

#[test]
fn tasks_are_within_their_conditions_and_repeatable() {
    let (text, scenario) = biopsy();
    let conditions = Conditions {
        organ: "liver".to_owned(),
        depth_mm: [40.0, 140.0],
        clearance_mm: 5.0,
        window_mm: 20.0,
        margin_mm: 10.0,
        radius_mm: 5.0,
        seed: 3,
    };
    let tasks = conditions.tasks(&scenario, 2).unwrap();
    assert_eq!(tasks, conditions.tasks(&scenario, 2).unwrap());
    assert_ne!(
        tasks,
        Conditions {
            seed: 4,
            ..conditions.clone()
        }
        .tasks(&scenario, 2)
        .unwrap()
    );
    for (index, task) in tasks.iter().enumerate() {
        assert!(
            (40.0..=140.0).contains(&task.depth_mm) && task.bone_mm.is_none_or(|mm| mm >= 5.0),
            "{task:?}"
        );
        let written = task.scenario(&text, &conditions, index + 1).unwrap();
        let file = ScenarioFile::parse(&written, "task.toml").unwrap();
        let resolved = file.resolve(Path::new(""), |_| ()).unwrap();
        assert_eq!(resolved.targets[0].radius_mm, 5.0);
        let steady = super::hands::Hand {
            aim_deg: 0.0,
            entry_mm: 0.0,
            depth_mm: 0.0,
            tremor_mm: 0.0,
            plane_mm: 0.0,
            plane_deg: 0.0,
            drift: 0.0,
            ..hand("expert").unwrap()
        };
        let score = perform(&resolved, &steady, 0).unwrap();
        // The tip meets the target where it lies at rest, in the image plane and in view.
        assert!(
            score.at_rest.0[9] < 0.5 && score.at_rest.0[2] < 1.0 && score.metrics.0[7] > 90.0,
            "{:?}",
            score.at_rest
        );
    }
    let refused = |conditions: Conditions, words: &str| {
        let error = conditions.tasks(&scenario, 1).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    };
    refused(
        Conditions {
            organ: "spleenish".to_owned(),
            ..conditions.clone()
        },
        "no label or tissue is named \"spleenish\"; expected one of skin",
    );
    refused(
        Conditions {
            depth_mm: [400.0, 410.0],
            margin_mm: 0.0,
            ..conditions.clone()
        },
        "not within the depths",
    );
    refused(
        Conditions {
            window_mm: -1.0,
            ..conditions.clone()
        },
        "`window_mm` is -1",
    );
    assert!(
        tasks[0]
            .scenario("scene = \"x.toml\"", &conditions, 1)
            .unwrap_err()
            .contains("names a file")
    );
}

#[test]
fn a_study_gives_the_same_table_again_and_reads_it_back() {
    let (_, scenario) = biopsy();
    let tasks = [("one".to_owned(), scenario)];
    let once = study(&tasks, 2, 1, &|_, _| ()).unwrap();
    let text = csv(&once.sessions);
    assert_eq!(text, csv(&study(&tasks, 2, 1, &|_, _| ()).unwrap().sessions));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sessions.csv");
    std::fs::write(&path, text).unwrap();
    let reread = compare(&read(&path).unwrap());
    assert_eq!((reread.groups.len(), reread.pairs.len()), (3, 30));
    assert_eq!(
        (
            reread.groups[2].name.as_str(),
            reread.groups[2].people,
            reread.groups[2].sessions
        ),
        ("student", 2, 2)
    );
    let page = once.comparison.page("Study", &[]).unwrap();
    assert!(page.contains("consultant - student") && page.contains("m10: least distance"));
    std::fs::write(&path, "group,person,session,m1\na,b,c,1\n").unwrap();
    assert!(read(&path).unwrap_err().to_string().contains("without `m2`"));
}
