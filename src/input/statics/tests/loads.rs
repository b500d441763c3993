//! Loads and stresses compared with closed-form solutions on several meshes.

use super::*;
use crate::input::statics::Problem;
use crate::solve::{Report, Solved};

/// Bar of 4 x 4 x 20 mm and 5 kPa without lateral strain, fixed at the bottom.
const BAR: &str = r#"mesh = "bar.vtu"
[[material]]
young_kpa = 5.0
poisson = 0.0
density_kg_per_m3 = 1000.0
[[fix]]
box_mm = [[-inf, -inf, -inf], [inf, inf, 0]]
"#;
const TOP: &str = "[[load]]\nbox_mm = [[-inf, -inf, 20], [inf, inf, inf]]\n";
const HISTORY: &str = "[history]\ntime_s = [0, 1, 3]\nfactor = [0, 1, 0.5]\nstep_s = 0.1\n";

/// Solves the bar with about `nodes` nodes, and with additional keys and tables.
fn bar(nodes: usize, keys: &str, tables: &str) -> (Problem, Solved) {
    let folder = tempfile::tempdir().unwrap();
    let mesh = TetMesh::over_box([0.0; 3], [4.0, 4.0, 20.0], nodes).unwrap();
    write_vtu(&folder.path().join("bar.vtu"), &mesh, None).unwrap();
    let file = ProblemFile::parse(&format!("{keys}\n{BAR}{tables}"), "p.toml").unwrap();
    let problem = file.resolve(folder.path()).unwrap();
    let solved = problem.solve(true).unwrap();
    (problem, solved)
}

/// Largest relative error of the upper end's displacements along z.
fn error((problem, solved): &(Problem, Solved), expected: f64) -> f64 {
    let nodes = problem.mesh.nodes().iter().zip(&solved.solution.displacement_mm);
    let top = nodes.filter(|(node, _)| (node[2] - 20.0).abs() < 1e-9);
    top.map(|(_, u)| (u[2] / expected - 1.0).abs()).fold(0.0, f64::max)
}

#[test]
fn a_pulled_bar_is_as_long_on_any_mesh() {
    // 16 mm^2 under 1 kPa: a strain of 0.2 over 20 mm.
    for load in ["total_force_n = [0, 0, 0.016]\n", "pressure_kpa = -1.0\n"] {
        for nodes in [30, 900] {
            let solved = bar(nodes, "", &format!("{TOP}{load}"));
            assert!(error(&solved, 4.0) < 1e-10, "{load} {nodes}");
            let report = Report::new(&solved.0, &solved.1);
            assert!((report.load_n[0][2] - 0.016).abs() < 1e-15 && (report.load_area_mm2[0] - 16.0).abs() < 1e-12);
            assert!((report.reaction_n[0][2] + 0.016).abs() < 1e-12, "{report:?}");
        }
    }
    // A fixed force per node is a different load on a different mesh.
    let each = format!("{TOP}node_force_n = [0, 0, 0.001]\n");
    let [coarse, fine] = [30, 900].map(|nodes| Report::new(&bar(nodes, "", &each).0, &bar(nodes, "", &each).1));
    assert!(fine.load_n[0][2] > 2.0 * coarse.load_n[0][2] && fine.load_area_mm2 == [0.0]);
}

#[test]
fn a_bar_under_its_own_weight_is_shortened_as_it_should_be() {
    // rho g L^2 / (2 E)
    let expected = -1e-9 * 1000.0 * 9.81 * 20.0 * 20.0 / (2.0 * 5e-3);
    let gravity = "gravity_m_per_s2 = [0, 0, -9.81]";
    let [coarse, fine] = [100, 3000].map(|nodes| bar(nodes, gravity, ""));
    let [far, near] = [&coarse, &fine].map(|solved| error(solved, expected));
    assert!(far < 0.06 && near < 0.01 && near < far, "{far} {near}");
    let report = Report::new(&fine.0, &fine.1);
    let weight = report.weight_n.unwrap()[2];
    // Rounding of the sum over elements.
    assert!((weight / (-320e-9 * 1000.0 * 9.81) - 1.0).abs() < 1e-10, "{weight}");
    assert!((report.reaction_n[0][2] + weight).abs() < 1e-12, "{report:?}");
    let text = report.to_string();
    assert!(text.contains("weight") && text.contains("-0.003139"), "{text}");
}

#[test]
fn stress_and_strain_of_a_pulled_bar_are_uniform_in_every_model() {
    let pull = format!("{TOP}pressure_kpa = -1.0\n");
    let stiff = "knee_strain = 0.05\nstiffening = 20.0\n";
    let rules = ["exponentials", "trapezoid"];
    let viscous = rules.map(|rule| format!("{HISTORY}[viscosity]\norder = 0.3\nrule = \"{rule}\"\n"));
    let rates = viscous.clone().map(|viscous| format!("{viscous}memory = \"rate\"\n"));
    let cases = [("linear", String::new(), 1.0), ("nonlinear", HISTORY.to_owned(), 0.5)];
    let cases = cases.into_iter().chain(
        viscous
            .into_iter()
            .chain(rates)
            .map(|tables| ("viscoelastic", tables, 0.5)),
    );
    for (model, tables, stress) in cases {
        let mut case = BAR.to_owned();
        if model != "linear" {
            case = case.replace("poisson = 0.0\n", &format!("poisson = 0.0\n{stiff}"));
        }
        let folder = tempfile::tempdir().unwrap();
        let mesh = TetMesh::over_box([0.0; 3], [4.0, 4.0, 20.0], 60).unwrap();
        write_vtu(&folder.path().join("bar.vtu"), &mesh, None).unwrap();
        let text = format!("model = \"{model}\"\n{case}{pull}{tables}");
        let problem = ProblemFile::parse(&text, "p.toml")
            .unwrap()
            .resolve(folder.path())
            .unwrap();
        let solved = problem.solve(true).unwrap();
        let fields = solved.fields.as_ref().unwrap();
        let long = solved.solution.displacement_mm.iter().map(|u| u[2]).fold(0.0, f64::max) / 20.0;
        let mises = fields.von_mises_kpa();
        for ((strain, stress_kpa), mises) in fields.strain.iter().zip(&fields.stress_kpa).zip(mises) {
            for component in 0..6 {
                let [strained, stressed] = if component == 2 { [long, stress] } else { [0.0; 2] };
                assert!((strain[component] - strained).abs() < 1e-6 * long, "{text} {strain:?}");
                assert!((stress_kpa[component] - stressed).abs() < 1e-5, "{text} {stress_kpa:?}");
            }
            assert!((mises - stress).abs() < 1e-5);
        }
    }
}

#[test]
fn loads_are_checked() {
    let load = |force: &str| GOOD.replace("nodes = [35]\nnode_force_n = [0, 0, 0.001]", force);
    let refused = |force: &str, key: &str, line, words: &[&str]| super::refused(&load(force), key, line, words);
    refused("nodes = [35]", "load[0]", 8, &["no force", "`total_force_n`"]);
    refused(
        "surface = true\npressure_kpa = 1\nnode_force_n = [0, 0, 1]",
        "load[0]",
        8,
        &["`pressure_kpa` and `node_force_n`"],
    );
    refused(
        "nodes = [35]\npressure_kpa = 1",
        "load[0]",
        8,
        &["no face of the surface"],
    );
    refused("pressure_kpa = 1e308", "load[0].pressure_kpa", 9, &["-1e9 to 1e9 kPa"]);
    refused(
        "total_force_n = [0, inf, 0]",
        "load[0].total_force_n[1]",
        9,
        &["found inf"],
    );
    let gravity = format!("gravity_m_per_s2 = [0, 0, -9.81]\n{GOOD}");
    super::refused(&gravity, "material[0]", 4, &["no `density_kg_per_m3`"]);
    let heavy = gravity.replace("young_kpa", "density_kg_per_m3 = 0.0\nyoung_kpa");
    super::refused(&heavy, "material[0].density_kg_per_m3", 5, &["found 0", "above 0"]);
}

#[test]
fn what_overflows_is_refused_with_the_key() {
    let pushed =
        |displacement: &str| format!("{GOOD}[[fix]]\nnodes = [35]\ndisplacement_mm = [0, 0, {displacement}]\n");
    refused(&pushed("1e308"), "fix[1].displacement_mm[2]", 13, &["1e6 mm"]);
    refused(&pushed("-1e7"), "fix[1].displacement_mm[2]", 13, &["found -10000000"]);
    let soft = GOOD.replace("5.0", "1e-303").replace("0.001]", "1e9]");
    assert!(solve(&soft).is_err());
}

#[test]
fn old_names_are_read_and_noted() {
    let old = GOOD.replace("node_force_n", "force_n");
    let report = solve(&old).unwrap();
    assert_eq!(
        report.warnings,
        ["p.toml, line 10: `force_n` is now called `node_force_n`"]
    );
    assert_eq!(report.displacement_mm, solve(GOOD).unwrap().displacement_mm);
    assert!(solve(&format!("version = 1\n{GOOD}")).is_ok());
    let error = solve(&format!("version = 2\n{GOOD}")).unwrap_err();
    assert_eq!(error.location(), Some(("p.toml", 1)));
    assert!(error.to_string().contains("found version 2"), "{error}");
}

#[test]
fn a_mesh_in_metres_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = TetMesh::over_box([0.0; 3], [0.003, 0.002, 0.002], 36).unwrap();
    write_vtu(&folder.path().join("block.vtu"), &mesh, None).unwrap();
    let resolved = |text: &str| ProblemFile::parse(text, "p.toml").unwrap().resolve(folder.path());
    let small = resolved(&GOOD.replace("[9, 9, 0]", "[9, 9, 0.0001]")).unwrap();
    assert!(small.warnings[0].contains("0.003 mm long") && small.warnings[0].contains("mesh_unit = \"m\""));
    let problem = resolved(&format!("mesh_unit = \"m\"\n{GOOD}")).unwrap();
    assert!(problem.warnings.is_empty(), "{:?}", problem.warnings);
    let displacement_mm = Report::new(&problem, &problem.solve(false).unwrap()).max_displacement_mm;
    let expected = solve(GOOD).unwrap().max_displacement_mm;
    assert!(
        (displacement_mm / expected - 1.0).abs() < 1e-9,
        "{displacement_mm} {expected}"
    );
}
