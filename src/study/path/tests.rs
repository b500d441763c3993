//! Plans in tissue where the answer is known.

use super::*;
use insonify::input::scenario::reported_points::Displaced;
use insonify::run::{Observer, Requests, Step, run};
use insonify_mechanics::insertion::StepError;

/// The scenario `liver-puncture` with a coarse mesh and other changes.
fn liver(changes: &[(&str, &str)]) -> Scenario {
    super::liver(250, changes).unwrap()
}

fn options(angles: [f64; 2], lines: usize) -> PathOptions {
    PathOptions {
        target: Goal::Named("vessel".to_owned()),
        entry: Entry::Plane(angles),
        lines,
        clearance_mm: 3.0,
        tolerance_mm: 0.1,
        section_mm: None,
    }
}

fn best(plan: &PathPlan) -> &Corrected {
    plan.best().unwrap().1
}

/// Stiffer tissue moves less under the same forces of the needle, here 1000 times less: the path is straight and misses
/// nothing.
#[test]
fn stiff_tissue_gives_a_straight_path() {
    let stiff = [
        ("young_kpa = 2.0", "young_kpa = 2000.0"),
        ("young_kpa = 0.02", "young_kpa = 20.0"),
    ];
    for section_mm in [None, Some(20.0)] {
        let options = PathOptions {
            section_mm,
            ..options([-24.0, -24.0], 1)
        };
        let plan = plan(&liver(&stiff), &options, &|_, _| ControlFlow::Continue(())).unwrap();
        let path = best(&plan);
        assert!(
            path.miss_before_mm < 0.05 && path.runs == 1 && path.turn_deg == 0.0,
            "{path:?}"
        );
    }
}

/// The middle of the vein, which the needle flattens before it breaks its wall: missed by millimetres, then met, in the
/// solid and in its section. The same on one thread and on two.
#[test]
fn the_middle_of_the_vein_is_met() {
    let scenario = liver(&[]);
    for section_mm in [None, Some(20.0)] {
        let options = PathOptions {
            section_mm,
            ..options([-30.0, -23.0], 2)
        };
        let plan_on = |threads: usize| {
            let pool = insonify_base::parallel::Pool::new(threads).unwrap();
            pool.install(|| plan(&scenario, &options, &|_, _| ControlFlow::Continue(())).unwrap())
        };
        let two_threads = plan_on(2);
        let path = best(&two_threads);
        assert!(path.miss_mm < 0.1 && path.miss_before_mm > 0.3, "{path:?}");
        assert!(path.punctures >= 1);
        // A line that misses by more than the tolerance ranks behind one that does not.
        let mut worse = two_threads.lines[0].clone();
        worse.path.as_mut().unwrap().miss_mm = 0.5;
        assert_eq!(rank(&worse, &two_threads.lines[1], 0.1), Ordering::Greater);
        if section_mm.is_some() {
            let one_thread = plan_on(1);
            assert_eq!(
                serde_json::to_string(&two_threads).unwrap(),
                serde_json::to_string(&one_thread).unwrap()
            );
            assert_eq!(two_threads.series(), one_thread.series());
        }
        // The written scenario repeats it.
        let text = two_threads.scenario(
            EXAMPLES.iter().find(|(name, _)| *name == "liver-puncture").unwrap().1,
            &scenario,
        );
        let text = text.unwrap().replace("nodes = 3300", "nodes = 250");
        if section_mm.is_none() {
            let target = two_threads.target_mm;
            let text = format!("{text}\n[[report]]\nname = \"target\"\nat_mm = {target:?}\n");
            let planned = ScenarioFile::parse(&text, "plan.toml").unwrap();
            let planned = planned.resolve(Path::new(""), |_| ()).unwrap();
            let mut model = planned.model(|_, _| ()).unwrap();
            let mut outcome = Last::default();
            run(&planned, model.as_mut(), Requests::default(), &mut outcome).unwrap();
            let [x, y, z, ..] = outcome.target;
            let target_mm = Point3::from(target) + Vector3::new(x, y, z);
            assert!((target_mm - outcome.tip).norm() < 0.15, "{outcome:?}");
        }
    }
}

/// Last position of the tip and displacement of the target, mm.
#[derive(Debug, Default)]
struct Last {
    tip: Point3<f64>,
    target: [f64; 6],
}

impl Observer for Last {
    type Error = StepError;

    fn step(&mut self, step: &Step<'_>) -> Result<(), StepError> {
        self.tip = step.outcome.tip_mm;
        Ok(())
    }

    fn points(&mut self, displaced: &Displaced<'_>) -> Result<(), StepError> {
        self.target = displaced.displacement_mm[0];
        Ok(())
    }
}

/// Linear homogeneous tissue, its sides held alike, with the needle on the axis of symmetry: the target moves along the
/// needle, and the correction is one of depth alone.
#[test]
fn symmetry_leaves_the_direction() {
    let changes = [
        ("model = \"viscoelastic\"", "model = \"nonlinear\""),
        ("[tissue.viscosity]\norder = 0.1\nmemory = \"load-integral\"\n", ""),
        ("knee_strain = 0.303\nstiffening = 60.0\n", ""),
        (
            "young_kpa = 0.02\npoisson = 0.0\nknee_strain = 0.7\nstiffening = 4000.0\n",
            "young_kpa = 2.0\npoisson = 0.45\n",
        ),
        ("puncture_n = 0.6", "puncture_n = 0.0"),
        ("puncture_n = 0.5", "puncture_n = 0.0"),
        (
            "[[-42.0, 0.0, -24.0], [34.0, 58.0, 24.0]]",
            "[[-40.0, 0.0, -24.0], [40.0, 58.0, 24.0]]",
        ),
        ("[-41.0, inf, inf]", "[-39.0, inf, inf]"),
        ("[[33.0,", "[[39.0,"),
        (
            "phantom = \"liver-vein\"",
            "phantom = \"liver-vein\"\n[scene.pose]\nposition_mm = [-30.0, -0.5, 0.0]\ndirection = [0.0, 1.0, 0.0]",
        ),
    ];
    let scenario = liver(&changes);
    let options = PathOptions {
        target: Goal::At([0.0, 30.0, 0.0]),
        section_mm: Some(20.0),
        ..options([0.0, 0.0], 1)
    };
    let plan = plan(&scenario, &options, &|_, _| ControlFlow::Continue(())).unwrap();
    let path = best(&plan);
    let [along_mm, aside_mm] = path.displacement_mm;
    assert!(path.miss_before_mm > 0.2 && path.miss_mm < 0.1, "{path:?}");
    assert!(along_mm > 0.2 && aside_mm < 0.1 * along_mm, "{path:?}");
    assert!(path.turn_deg < 0.1 && path.insertion_mm > 30.2, "{path:?}");
}

/// Linear tissue in three dimensions, in which a needle may bend.
const LINEAR: [(&str, &str); 6] = [
    (
        "model = \"viscoelastic\"",
        "model = \"finite-element\"\nalong_path = false",
    ),
    ("[tissue.solver]\ntolerance = 1e-4\n", ""),
    ("[tissue.viscosity]\norder = 0.1\nmemory = \"load-integral\"\n", ""),
    ("knee_strain = 0.303\nstiffening = 60.0\n", ""),
    (
        "young_kpa = 0.02\npoisson = 0.0\nknee_strain = 0.7\nstiffening = 4000.0\n",
        "young_kpa = 1.0\npoisson = 0.45\n",
    ),
    ("cutting_n = 0.15", "cutting_n = 0.3"),
];

/// A needle that bends, and one whose bevel takes it aside by millimetres, are turned until they meet the target; so is
/// one that does both.
#[test]
fn needles_that_bend_meet_the_target() {
    for (needle, turn_deg) in [
        ("model = \"springs\"\nkappa_nmm_per_deg = 2.0\n", 0.5),
        ("bevel = { r_mm = 0.6 }\n", 0.5),
        ("model = \"beam\"\nbevel = { r_mm = 0.6 }\n", 0.5),
    ] {
        let needle = format!("[needle]\n{needle}");
        let changes = [&LINEAR[..], &[("[needle]\n", needle.as_str())]].concat();
        let options = PathOptions {
            target: Goal::At([-4.0, 28.0, 0.0]),
            clearance_mm: 0.0,
            ..options([-24.0, -24.0], 1)
        };
        let plan = plan(&liver(&changes), &options, &|_, _| ControlFlow::Continue(())).unwrap();
        let path = best(&plan);
        assert!(
            path.miss_before_mm > 1.0 && path.miss_mm < 0.1 && path.turn_deg > turn_deg,
            "{needle}: {} then {} mm, turned by {} degrees in {} runs",
            path.miss_before_mm,
            path.miss_mm,
            path.turn_deg,
            path.runs
        );
        // By Gauss-Newton: two runs for its derivatives, and few steps.
        assert!(path.runs <= 10, "{needle}: {} runs", path.runs);
        assert!(plan.warnings.is_empty(), "{:?}", plan.warnings);
    }
}

#[test]
fn targets_and_lines_that_cannot_be_are_refused() {
    let scenario = liver(&[(
        "young_kpa = 0.02\npoisson = 0.0",
        "critical = true\nyoung_kpa = 0.02\npoisson = 0.0",
    )]);
    let refused = |options: PathOptions| {
        plan(&scenario, &options, &|_, _| ControlFlow::Continue(()))
            .unwrap_err()
            .to_string()
    };
    let aimed_at = |target: [f64; 3]| PathOptions {
        target: Goal::At(target),
        ..options([-60.0, 60.0], 3)
    };
    assert!(refused(aimed_at([0.0, -5.0, 0.0])).contains("outside the body"));
    assert!(refused(options([-60.0, 60.0], 3)).contains("critical"));
    let unknown = PathOptions {
        target: Goal::Named("spleen".to_owned()),
        ..options([-60.0, 60.0], 3)
    };
    assert!(refused(unknown).contains("liver"));
    assert!(refused(options([-60.0, 60.0], 0)).contains("candidates"));
    assert!(refused(options([60.0, -60.0], 3)).contains("angles"));
    // Below the vein: both lines pass it.
    let message = refused(PathOptions {
        target: Goal::At([-4.0, 45.0, 0.0]),
        clearance_mm: 25.0,
        ..options([-30.0, -20.0], 2)
    });
    assert!(
        message.contains("no path") && message.contains("critical structure"),
        "{message}"
    );
    let section = PathOptions {
        section_mm: Some(20.0),
        ..aimed_at([-30.0, 30.0, 4.0])
    };
    assert!(refused(section).contains("4.0 mm beside the image plane"));
}

#[test]
fn the_callback_stops_before_the_first_line() {
    let stopped = plan(&liver(&LINEAR), &options([-30.0, 30.0], 4), &|_, _| {
        ControlFlow::Break(())
    });
    assert_eq!(stopped.unwrap_err().to_string(), "stopped before the end");
}
