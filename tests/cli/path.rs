//! `insonify path`: a plan in a coarse mesh, its files, the scenario it writes, and what is refused.

use serde_json::Value;

use crate::support::Bench;

/// The scenario `liver-puncture` with a coarse mesh and a small image.
fn scenario() -> String {
    let text = include_str!("../../assets/liver-puncture.toml");
    let text = text.replace("nodes = 3300", "nodes = 250");
    text.replace(
        "[scene.volume]",
        "[scene.image]\nwidth = 120\nheight = 90\n[scene.volume]",
    )
}

fn numbers<const N: usize>(value: &Value) -> [f64; N] {
    std::array::from_fn(|at| value[at].as_f64().expect("a number"))
}

#[test]
fn a_plan_is_written_and_its_scenario_meets_the_target() {
    let bench = Bench::new();
    bench.write("small.toml", &scenario());
    let run = bench
        .run("path small.toml --target vessel --angles=-30,-23 --candidates 2 -o plan --json --quiet --backend cpu");
    let plan = run.json();
    let target = numbers::<3>(&plan["target_mm"]);
    // The middle of the vein of the phantom, to a voxel.
    assert!((target[0] + 4.0).hypot(target[1] - 28.0) < 1.5, "{plan}");
    let [best, other] = [&plan["lines"][0], &plan["lines"][1]];
    let number = |line: &Value, key: &str| line[key].as_f64().unwrap_or(f64::NAN);
    assert!(
        number(best, "miss_mm") < 0.1 && number(best, "miss_before_mm") > 0.3,
        "{plan}"
    );
    let angles = [best, other].map(|line| number(line, "angle_deg").round());
    assert!(angles.contains(&-30.0) && angles.contains(&-23.0), "{plan}");
    assert_eq!(
        (&plan["excluded"], &plan["warnings"]),
        (&Value::from(serde_json::Map::new()), &Value::from(Vec::<Value>::new()))
    );
    let mut files = [
        "index.html",
        "lines.csv",
        "lines.png",
        "lines.svg",
        "overview.png",
        "scenario.toml",
        "summary.json",
        "target.csv",
        "target.svg",
    ];
    files.sort_unstable();
    assert_eq!(bench.files("plan"), files);
    assert_eq!(bench.read::<Value>("plan/summary.json"), plan);
    assert_eq!(bench.text("plan/lines.csv").lines().count(), 3);
    // The written scenario ends where the plan says, in the deformed tissue and so in the tissue at rest.
    let summary = bench.run("insert plan/scenario.toml -o run --json --quiet").json();
    let met = &summary["targets"][0];
    assert!(number(met, "nearest_tip_mm") < 0.3, "{met}");
    let steps = bench.text("run/steps.csv");
    let [head, last] = [steps.lines().next(), steps.lines().next_back()].map(|line| line.expect("a line"));
    let at = head
        .split(',')
        .position(|column| column == "inserted_mm")
        .expect("inserted_mm");
    let inserted: f64 = last.split(',').nth(at).expect("a cell").parse().expect("a number");
    let depth = number(best, "depth_mm");
    assert!(
        (inserted - depth).abs() < 0.3,
        "{inserted} in place of {depth} mm at the end"
    );
}

#[test]
fn targets_and_conditions_that_leave_no_path_are_told() {
    let bench = Bench::new();
    let bone = "[[scene.tissue]]\nname = \"bone\"\nlabel_names = [\"vessel\"]\n[tissue]\n";
    bench.write("bone.toml", &scenario().replacen("[tissue]\n", bone, 1));
    let before = bench.files(".");
    let fails = |arguments: &str, words: &[&str]| {
        bench
            .run(&format!(
                "path bone.toml --model 2d --candidates 4 --backend cpu --quiet -o plan {arguments}"
            ))
            .fails(2, words);
        assert_eq!(bench.files("."), before, "{arguments}");
    };
    fails(
        "--target -4,28,0",
        &["the target at (-4.0, 28.0, 0.0) mm lies in bone", "soft tissue"],
    );
    fails("--target 0,-5,0", &["outside the body"]);
    fails(
        "--target -4,45,0 --angles=-28,-20 --clearance-mm 5",
        &["no path to the target: of 4 lines", "too near to bone"],
    );
    fails(
        "--target 10,40,0 --angles=-1,1 --entry 30,-1,-2,31,1,2",
        &["two dimensions", "plane"],
    );
    fails("--target spleen", &["no label or tissue is named \"spleen\"", "liver"]);
    fails("--target 10,40,0 --clearance-mm=-1", &["clearance_mm"]);
    fails("--target 10,40,0 --angles=20,-20", &["angles"]);
}
