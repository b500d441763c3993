//! `insonify solve`: what it prints and writes, and that whatever is wrong with a problem or its mesh ends with status
//! 2, the line, and nothing written.

use std::path::PathBuf;

use insonify_mesh::file::{ReadOptions, read_mesh};

use crate::support::Bench;

/// Two tetrahedra on the triangle of nodes 0, 1 and 2, and on that of 1, 2 and 3.
const CORNERS: [[f64; 3]; 5] = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0; 3]];
const TWO: [[usize; 4]; 2] = [[0, 1, 2, 3], [1, 2, 3, 4]];

const PROBLEM: &str = "\
mesh = \"m.msh\"
report_nodes = [4, 0]
[[material]]
young_kpa = 5.0
poisson = 0.3
[[fix]]
nodes = [0, 1, 2]
[[load]]
nodes = [4]
node_force_n = [0, 0, 1e-5]
";

/// A Gmsh file (2.2, text) of tetrahedra; nodes are counted from 1 there.
fn gmsh(nodes: &[[f64; 3]], elements: &[[usize; 4]]) -> String {
    let mut text = format!("$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{}\n", nodes.len());
    for (number, [x, y, z]) in (1..).zip(nodes) {
        text += &format!("{number} {x} {y} {z}\n");
    }
    text += &format!("$EndNodes\n$Elements\n{}\n", elements.len());
    for (number, corners) in (1..).zip(elements) {
        let [a, b, c, d] = corners.map(|node| node + 1);
        text += &format!("{number} 4 2 1 1 {a} {b} {c} {d}\n");
    }
    text + "$EndElements\n"
}

/// A folder with the two tetrahedra and their problem.
fn bench() -> Bench {
    let bench = Bench::new();
    bench.write("m.msh", &gmsh(&CORNERS, &TWO));
    bench.write("p.toml", PROBLEM);
    bench
}

/// Checks that the problem is refused with its line, that all `words` are said, and that nothing is written.
fn refused(bench: &Bench, problem: &str, line: usize, words: &[&str]) {
    bench.write("p.toml", problem);
    let before = bench.files(".");
    let run = bench.run("solve p.toml --json -o out.vtu");
    let place = format!("p.toml, line {line}");
    run.fails(2, &[words, &[place.as_str()]].concat());
    assert_eq!(bench.files("."), before, "{run:?}");
}

/// As [`refused`], of the mesh that line 1 names.
fn unusable(nodes: &[[f64; 3]], elements: &[[usize; 4]], words: &[&str]) {
    let bench = bench();
    bench.write("m.msh", &gmsh(nodes, elements));
    refused(&bench, PROBLEM, 1, words);
}

#[test]
fn a_problem_is_solved() {
    let bench = bench();
    let report = bench.run("solve p.toml --json -o out.vtu").json();
    assert_eq!((&report["nodes"], &report["elements"]), (&5.into(), &2.into()));
    // A direct solution leaves a backward error of some rounding units.
    assert!(report["residual"].as_f64().unwrap() < 1e-14);
    let moved = &report["displacement_mm"];
    assert_eq!(moved.as_array().unwrap().len(), 2);
    assert_eq!(moved[1], serde_json::json!([0.0, 0.0, 0.0]));
    assert!(moved[0][2].as_f64().unwrap() > 0.0);
    assert!(report["max_displacement_mm"].as_f64().unwrap() >= moved[0][2].as_f64().unwrap());
    for phase in ["read", "check", "assembly", "factor", "solve", "total"] {
        assert!(report["seconds"][phase].as_f64().unwrap() >= 0.0, "{phase}");
    }
    let written = read_mesh(&bench.path("out.vtu"), &ReadOptions::default()).unwrap();
    let written = written.displacements.unwrap();
    for (axis, &written) in written[4].iter().enumerate() {
        // Numbers in JSON are read to within a rounding unit.
        let reported = moved[0][axis].as_f64().unwrap();
        assert!(
            (reported - written).abs() <= f64::EPSILON * written.abs(),
            "{reported} {written}"
        );
    }

    let table = bench.run("solve p.toml");
    assert!(table.text().contains("5 nodes, 2 tetrahedra"), "{table:?}");
    assert_eq!(table.stderr.trim_end(), "note: fix[0] holds 3 nodes", "{table:?}");
}

#[test]
fn the_example_runs_as_it_says() {
    let bench = Bench::new();
    let example = bench.run("solve --example").text().to_owned();
    bench.write("press.toml", &example);
    let commands = example.lines().filter_map(|line| line.strip_prefix("#   insonify "));
    let mut runs = 0;
    for command in commands {
        bench.run(command).text();
        runs += 1;
    }
    assert_eq!(runs, 2, "{example}");
    let report = bench.run("solve press.toml --json -o pressed.vtu").json();
    assert_eq!(report["warnings"], serde_json::json!([]));
    // The plate goes 6 mm down, and nothing much farther.
    let farthest = report["max_displacement_mm"].as_f64().unwrap();
    assert!((6.0..7.0).contains(&farthest), "{report}");
    let [table, plate] = [0, 1].map(|fix| report["reaction_n"][fix][1].as_f64().unwrap());
    assert!(plate > 0.0 && table < 0.0, "{report}");
    assert!(read_mesh(&bench.path("pressed.vtu"), &ReadOptions::default()).is_ok());
}

/// What follows a table of the problem: tissue that stiffens, pulled up and held.
const HISTORY: &str = "\
[history]
time_s = [0, 1, 3]
factor = [0, 1, 1]
step_s = 0.25
[viscosity]
order = 0.5
rule = \"trapezoid\"
";

fn creeping() -> String {
    let stiff = PROBLEM.replace(
        "poisson = 0.3\n",
        "poisson = 0.3\nknee_strain = 0.001\nstiffening = 100.0\n",
    );
    format!("model = \"viscoelastic\"\n{stiff}{HISTORY}")
}

#[test]
fn tissue_creeps_over_time() {
    let bench = bench();
    let elastic = bench.run("solve p.toml --json").json();
    assert_eq!(
        (&elastic["model"], &elastic["history"]),
        (&"linear".into(), &serde_json::Value::Null)
    );
    bench.write("p.toml", &creeping());
    let report = bench.run("solve p.toml --json -o out.vtu --history out.csv").json();
    let history = &report["history"];
    let times: Vec<f64> = serde_json::from_value(history["time_s"].clone()).unwrap();
    assert_eq!(times.len(), 13);
    assert_eq!((times[0], times[4], times[12]), (0.0, 1.0, 3.0));
    let moved = |at: usize| history["displacement_mm"][at][0][2].as_f64().unwrap();
    assert!(
        moved(0) == 0.0 && moved(4) > 0.0 && moved(12) > 1.1 * moved(4),
        "{history}"
    );
    assert_eq!(report["displacement_mm"][0], history["displacement_mm"][12][0]);
    // The one fix holds the load, all the time.
    for at in 4..13 {
        let reaction = history["reaction_n"][at][0][2].as_f64().unwrap();
        assert!((reaction + 1e-5).abs() < 1e-11, "{reaction} at {at}");
    }
    let table = bench.text("out.csv");
    let mut lines = table.lines();
    let heading = "time_s,iterations,factorisations,residual,node4_x_mm,node4_y_mm,node4_z_mm,node0_x_mm,node0_y_mm,node0_z_mm,\
                   fix0_x_n,fix0_y_n,fix0_z_n";
    assert_eq!((lines.next(), lines.count()), (Some(heading), 13));
    let text = bench.run("solve p.toml").text().to_owned();
    assert!(text.contains("12 steps to 3 s"), "{text}");
    // Below the knee, and elastic, it is the linear body at the end.
    let soft = creeping()
        .replace("0.001", "1.0")
        .replace("viscoelastic\"", "nonlinear\"");
    bench.write("p.toml", soft.split("[viscosity]").next().unwrap());
    let report = bench.run("solve p.toml --json").json();
    let [a, b] = [&report, &elastic].map(|run| run["displacement_mm"][0][2].as_f64().unwrap());
    assert!((a / b - 1.0).abs() < 1e-9, "{a} {b}");
}

#[test]
fn what_a_history_says_is_checked() {
    let bench = bench();
    let with = |from: &str, to: &str| creeping().replace(from, to);
    refused(
        &bench,
        &with("[0, 1, 3]", "[0, 3, 1]"),
        15,
        &["history.time_s[2]", "found 1", "ascending"],
    );
    refused(
        &bench,
        &with("[0, 1, 1]", "[0, 1]"),
        16,
        &["2 factors", "one for each of the 3 times"],
    );
    refused(
        &bench,
        &with("step_s = 0.25", "step_s = 0.0"),
        17,
        &["history.step_s", "above 0"],
    );
    refused(
        &bench,
        &with("order = 0.5", "order = 1.5"),
        19,
        &["viscosity.order", "found 1.5"],
    );
    refused(
        &bench,
        &with("model = \"viscoelastic\"\n", ""),
        13,
        &["`history` with", "model = \"linear\""],
    );
    let stiff = PROBLEM.replace("poisson = 0.3\n", "poisson = 0.3\nknee_strain = 0.1\n");
    refused(&bench, &stiff, 6, &["knee_strain", "model = \"linear\""]);
    refused(
        &bench,
        &with("model = \"viscoelastic\"", "model = \"nonlinear\""),
        18,
        &["`viscosity` with", "expected `model = \"viscoelastic\"`"],
    );
    refused(
        &bench,
        &with("stiffening = 100.0\n", ""),
        7,
        &["`knee_strain` is alone"],
    );
    refused(
        &bench,
        &with("stiffening = 100.0", "stiffening = -1.0"),
        8,
        &["material[0].stiffening", "0 or more"],
    );
    let jump = with(
        "nodes = [0, 1, 2]\n",
        "nodes = [0, 1, 2]\ndisplacement_mm = [0.1, 0, 0]\nfactor = [1, 1, 1]\n",
    );
    refused(&bench, &jump, 9, &["0.1 mm at the start", "infinite force"]);
    let uneven = with("\"trapezoid\"", "\"gruenwald-letnikov\"").replace("[0, 1, 3]", "[0, 1, 3.1]");
    refused(&bench, &uneven, 20, &["equal steps only"]);
    let few = format!("{}[solver]\niterations = 1\ntolerance = 1e-12\n", creeping());
    refused(&bench, &few, 21, &["at ", "do not balance after 1 iterations"]);
    let none = creeping();
    refused(
        &bench,
        none.split("[history]").next().unwrap(),
        1,
        &["without a history"],
    );
    bench.write("p.toml", PROBLEM);
    bench
        .run("solve p.toml --history out.csv")
        .fails(2, &["--history", "linear"]);
}

#[test]
fn the_creeping_example_runs_as_it_says() {
    let bench = Bench::new();
    let example = bench.run("solve --example=viscoelastic").text().to_owned();
    bench.write("creep.toml", &example);
    let commands: Vec<&str> = example
        .lines()
        .filter_map(|line| line.strip_prefix("#   insonify "))
        .collect();
    commands
        .iter()
        .for_each(|command| drop(bench.run(command).text().to_owned()));
    assert_eq!(commands.len(), 2);
    let report = bench.run("solve creep.toml --json").json();
    let force = |at: usize| report["history"]["reaction_n"][at][1][1].as_f64().unwrap();
    // The plate arrives after ten steps; faster than in proportion; then the force fades.
    assert!(
        force(10) > 2.0 * force(5) && force(50) < 0.95 * force(10) && force(50) > 0.0,
        "{report}"
    );
}

#[test]
fn the_schema_names_every_key() {
    let bench = Bench::new();
    let schema = bench.run("schema solve").json();
    assert_eq!(schema, bench.run("schema problem").json());
    for key in [
        "mesh",
        "mesh_unit",
        "region_array",
        "report_nodes",
        "material",
        "fix",
        "load",
        "model",
        "history",
        "viscosity",
        "solver",
    ] {
        assert!(schema["properties"][key].is_object(), "{key}");
    }
}

#[test]
fn wrong_arguments_are_status_2() {
    let bench = bench();
    bench.run("solve").fails(2, &["CASE.toml"]);
    bench.run("solve none.toml").fails(2, &["none.toml"]);
    bench.run("solve p.toml -o out.vtk").fails(2, &["out.vtk", ".vtu"]);
    bench.run("solve p.toml --example").fails(2, &["--example"]);
    bench.run("solve p.toml -o none/out.vtu").fails(2, &["none/out.vtu"]);
    assert_eq!(bench.files("."), ["m.msh", "p.toml", "scene.toml"]);
}

#[test]
fn unusable_meshes_are_refused() {
    unusable(&CORNERS, &[TWO[0], [1, 2, 4, 3]], &["tetrahedron 1 is inverted"]);
    let mut flat = CORNERS;
    flat[4] = [0.5, 0.5, 0.0];
    unusable(&flat, &TWO, &["tetrahedron 1 is flat"]);
    unusable(&CORNERS, &[TWO[0], TWO[1], [4, 3, 2, 1]], &["2", "1, 2, 3"]);
    unusable(&CORNERS, &[TWO[0], [4, 3, 3, 1]], &["tetrahedron 1", "node 3 twice"]);
    let twice = [[0, 1, 2, 3], [0, 1, 2, 3]];
    unusable(&CORNERS[..4], &twice, &["tetrahedron 1 is there a second time"]);
    let mut nan = CORNERS;
    nan[3][1] = f64::NAN;
    unusable(&nan, &TWO, &["m.msh", "NaN"]);
    let spare = [&CORNERS[..], &[[5.0; 3]]].concat();
    unusable(&spare, &TWO, &["a free node that belongs to no tetrahedron", ": 5;"]);
    unusable(&CORNERS, &[TWO[0], [1, 2, 3, 7]], &["m.msh"]);
}

#[test]
fn an_isolated_element_moves_freely_unless_held() {
    let bench = bench();
    let away = CORNERS[..4].iter().map(|p| p.map(|x| x + 3.0));
    let nodes: Vec<_> = CORNERS.iter().copied().chain(away).collect();
    bench.write("m.msh", &gmsh(&nodes, &[TWO[0], TWO[1], [5, 6, 7, 8]]));
    refused(
        &bench,
        PROBLEM,
        6,
        &["in a part of the mesh: region 1 (4 nodes, 0.000 ml, node 5), any translation or rotation"],
    );
    bench.write("p.toml", &PROBLEM.replace("[0, 1, 2]", "[0, 1, 2, 5, 6, 7]"));
    let run = bench.run("solve p.toml");
    run.text();
    assert!(run.stderr.contains("2 parts that do not touch"), "{run:?}");
}

/// Three tetrahedra apart, each a region with a name.
fn organs() -> String {
    let corners = [0.0, 3.0, 6.0]
        .map(|by| [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|p| p.map(|x| x + by)));
    let mesh = gmsh(corners.as_flattened(), &[[0, 1, 2, 3], [4, 5, 6, 7], [8, 9, 10, 11]]);
    let regions = [(2, 2), (3, 3)];
    let mesh = regions.iter().fold(mesh, |text, (element, region)| {
        text.replace(
            &format!("\n{element} 4 2 1 1 "),
            &format!("\n{element} 4 2 {region} {region} "),
        )
    });
    let names = "$PhysicalNames\n3\n3 1 \"liver\"\n3 2 \"kidney_left\"\n3 3 \"kidney_right\"\n$EndPhysicalNames\n";
    mesh.replace("$Nodes\n", &format!("{names}$Nodes\n"))
}

#[test]
fn regions_go_by_name_everywhere() {
    let bench = Bench::new();
    bench.write("m.msh", &organs());
    let material = "[[material]]\nregion = \"liver\"\nyoung_kpa = 2.0\npoisson = 0.3\n";
    let problem = PROBLEM.replace("[[fix]]\nnodes = [0, 1, 2]\n", &format!("{material}[[fix]]\nREGION\n"));
    // Every part that can move is named at once.
    refused(
        &bench,
        &problem.replace("REGION", "region = \"Liver\""),
        10,
        &[
            "2 parts of the mesh",
            "region 2 \"kidney_left\" (4 nodes, 0.000 ml, node 4), any translation or rotation",
            "region 3 \"kidney_right\" (4 nodes",
            "region = \"NAME\"",
        ],
    );
    refused(
        &bench,
        &problem.replace("REGION", "region = \"kidney\""),
        11,
        &["\"kidney\" is a part of several names", "kidney_left, kidney_right"],
    );
    refused(
        &bench,
        &problem.replace("REGION", "region = \"kidny_left\""),
        11,
        &["there is no region \"kidny_left\"", "did you mean \"kidney_left\"?"],
    );
    let fixed = "region = \"left\"\n[[fix]]\nregion = 3\nsurface = true\n[[fix]]\nnodes = [0, 1, 2]";
    let load = "[[load]]\nregion = \"liver\"\ntotal_force_n = [0, 0, 1e-5]";
    let problem = problem.replace("[[load]]\nnodes = [4]\nnode_force_n = [0, 0, 1e-5]", load);
    bench.write("p.toml", &problem.replace("REGION", fixed).replace("[4, 0]", "[3, 4]"));
    let report = bench.run("solve p.toml --json -o out.vtu").json();
    assert!(report["displacement_mm"][0][2].as_f64().unwrap() > 0.0, "{report}");
    assert_eq!(report["displacement_mm"][1], serde_json::json!([0.0, 0.0, 0.0]));
    let written = bench.text("out.vtu");
    for array in ["displacement", "reaction_n", "strain", "stress_kpa", "von_mises_kpa"] {
        assert!(written.contains(&format!("Name=\"{array}\"")), "{array}");
    }
    assert!(written.contains("ComponentName3=\"xy\""));
}

#[test]
fn a_mesh_is_no_volume() {
    let bench = bench();
    let words = ["m.msh", "a mesh is not supported", "insonify mesh info"];
    bench.run("mesh make m.msh --nodes 100 -o out.vtu").fails(2, &words);
    bench.run("render --labels m.msh").fails(2, &words);
}

#[test]
fn a_failed_run_leaves_an_older_output() {
    let bench = bench();
    bench.write("out.vtu", "older");
    bench.write("p.toml", &PROBLEM.replace("[0, 1, 2]", "[0]"));
    bench.run("solve p.toml -o out.vtu --force").fails(2, &["rotation"]);
    assert_eq!(bench.text("out.vtu"), "older");
}

/// A file of the shared data, if it is there.
fn data(name: &str) -> Option<PathBuf> {
    insonify_testing::shared(&format!("meshes/{name}"))
}

/// Liver, kidney and gallbladder of their own materials, held from behind and pressed on: the same answer from every
/// format.
#[test]
fn real_organs_deform_alike_from_every_format() {
    let names = ["DERIVED_s0328_3organ_tet.vtu", "DERIVED_s0328_3organ_tet_v41_ascii.msh"];
    let mut answers = Vec::new();
    for name in names {
        let Some(path) = data(name) else { return };
        let mesh = read_mesh(&path, &ReadOptions::default()).unwrap().mesh;
        let [low, high] = mesh.bounds();
        let third = low[1] + 0.4 * (high[1] - low[1]);
        let region = |region: i32, young: f64, poisson: f64| {
            format!("[[material]]\nregion = {region}\nyoung_kpa = {young}\npoisson = {poisson}\n")
        };
        let problem = format!(
            "mesh = '{}'\n{}{}{}[[fix]]\nbox_mm = [[-inf, {third}, -inf], [inf, inf, inf]]\n\
             [[load]]\nbox_mm = [[-inf, -inf, -inf], [inf, {third}, inf]]\nnode_force_n = [0, 1e-4, 0]\n",
            path.display(),
            region(5, 6.0, 0.45),
            region(2, 10.0, 0.49),
            region(4, 1.0, 0.3),
        );
        let bench = Bench::new();
        bench.write("organs.toml", &problem);
        let report = bench.run("solve organs.toml --json -o organs.vtu").json();
        assert_eq!((&report["nodes"], &report["elements"]), (&5430.into(), &21727.into()));
        assert!(report["residual"].as_f64().unwrap() < 1e-12, "{}", report["residual"]);
        let written = read_mesh(&bench.path("organs.vtu"), &ReadOptions::default()).unwrap();
        assert_eq!(written.mesh.nodes(), mesh.nodes());
        // The reactions balance the load, node by node of the box.
        let loaded = mesh.nodes().iter().filter(|p| p[1] <= third).count() as f64 * 1e-4;
        let reaction = report["reaction_n"][0][1].as_f64().unwrap();
        assert!((reaction + loaded).abs() < 1e-9 * loaded, "{reaction} {loaded}");
        let farthest = report["max_displacement_mm"].as_f64().unwrap();
        assert!(farthest > 0.0 && farthest.is_finite());
        answers.push(farthest);
    }
    assert!((answers[0] / answers[1] - 1.0).abs() < 1e-6, "{answers:?}");
}
