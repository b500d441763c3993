use std::path::Path;

use super::file::MaterialSpec;
use super::*;
use crate::solve::Report;
use insonify_base::blame::Blame;
use insonify_base::document::{InputError, RegionName};
use insonify_mesh::TetMesh;
use insonify_mesh::file::write_vtu;

mod loads;

const GOOD: &str = r#"mesh = "block.vtu"
report_nodes = [35, 0]
[[material]]
young_kpa = 5.0
poisson = 0.45
[[fix]]
box_mm = [[-1, -1, 0], [9, 9, 0]]
[[load]]
nodes = [35]
node_force_n = [0, 0, 0.001]
"#;

/// Folder with a block of 36 nodes in region 0, over 3 x 2 x 2 mm.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let mesh = TetMesh::over_box([0.0; 3], [3.0, 2.0, 2.0], 36).unwrap();
    write_vtu(&folder.path().join("block.vtu"), &mesh, None).unwrap();
    folder
}

fn solve(text: &str) -> Result<Report, InputError> {
    let folder = folder();
    let problem = ProblemFile::parse(text, "p.toml")?.resolve(folder.path())?;
    let solution = problem.solve(false)?;
    Ok(Report::new(&problem, &solution))
}

/// Key, line and text of an error.
fn failure(text: &str) -> (Option<String>, Option<usize>, String) {
    let error = solve(text).unwrap_err();
    assert!(!error.is_machine(), "{error}");
    let line = error.location().map(|(_, line)| line);
    (error.key().map(str::to_owned), line, error.to_string())
}

fn refused(text: &str, key: &str, line: usize, words: &[&str]) {
    let refusal = failure(text);
    assert_eq!(
        (refusal.0.as_deref(), refusal.1),
        (Some(key), Some(line)),
        "{}",
        refusal.2
    );
    for word in words {
        assert!(refusal.2.contains(word), "no {word:?} in {}", refusal.2);
    }
}

#[test]
fn a_problem_is_solved() {
    let report = solve(GOOD).unwrap();
    assert_eq!((report.nodes, report.elements), (36, 72));
    assert_eq!(report.warnings, [""; 0]);
    assert_eq!(report.displacement_mm[1], [0.0; 3]);
    let top = report.displacement_mm[0];
    assert!(top[2] > 0.0 && report.max_displacement_mm >= top[2]);
    let text = report.to_string();
    assert!(text.contains("36 nodes, 72 tetrahedra"), "{text}");
    assert!(
        text.contains("fix[0]       0.000000       0.000000      -0.001000"),
        "{text}"
    );
}

#[test]
fn a_shear_modulus_stands_for_youngs() {
    let moved = |text: &str| solve(text).unwrap().displacement_mm;
    let nu = 0.45;
    let shear = GOOD.replace("young_kpa = 5.0", &format!("shear_kpa = {}", 5.0 / (2.0 * (1.0 + nu))));
    for (a, b) in moved(&shear).iter().flatten().zip(moved(GOOD).iter().flatten()) {
        assert!((a - b).abs() < 1e-12);
    }
    let both = GOOD.replace("young_kpa = 5.0", "young_kpa = 5.0\nshear_kpa = 2.0");
    refused(
        &both,
        "material[0].shear_kpa",
        5,
        &["2 beside `young_kpa`", "one of the two"],
    );
    let neither = GOOD.replace("young_kpa = 5.0\n", "");
    refused(
        &neither,
        "material[0].young_kpa",
        3,
        &["neither `young_kpa` nor `shear_kpa`"],
    );
}

#[test]
fn the_example_has_every_key() {
    let file = ProblemFile::parse(EXAMPLE, "press.toml").unwrap();
    let material = |region, young_kpa| MaterialSpec {
        region,
        young_kpa: Some(young_kpa),
        poisson: 0.45,
        ..MaterialSpec::default()
    };
    let lump = RegionName::Value(2);
    assert_eq!(file.material, [material(None, 5.0), material(Some(lump), 30.0)]);
    assert_eq!((file.fix.len(), file.load.len()), (2, 1));
    for key in [
        "nodes = [",
        "box_mm",
        "axes",
        "displacement_mm",
        "total_force_n",
        "pressure_kpa",
        "node_force_n",
        "gravity_m_per_s2",
        "density_kg_per_m3",
        "mesh_unit",
        "surface",
        "region",
        "report_nodes",
    ] {
        assert!(EXAMPLE.contains(key), "{key}");
    }
}

#[test]
fn reactions_are_those_of_each_fix() {
    let pushed = format!("{GOOD}[[fix]]\nnodes = [34]\naxes = \"z\"\ndisplacement_mm = [0, 0, -0.5]\n");
    let report = solve(&pushed).unwrap();
    let [floor, tip] = report.reaction_n[..] else {
        panic!("{report:?}")
    };
    assert!(tip[2] < 0.0 && (tip[0], tip[1]) == (0.0, 0.0));
    assert!((floor[2] + tip[2] + 0.001).abs() < 1e-12, "{report:?}");
    // A second fix of the same nodes adds nothing.
    let fixed_twice = format!("{GOOD}[[fix]]\nbox_mm = [[-1, -1, 0], [9, 9, 0]]\n");
    assert_eq!(solve(&fixed_twice).unwrap().reaction_n[1], [0.0; 3]);
}

#[test]
fn nothing_given_moves_nothing() {
    let report = solve(&GOOD.replace("0.001]", "0]")).unwrap();
    assert_eq!(
        report.warnings,
        ["no force and no displacement is given: nothing moves"]
    );
    assert_eq!((report.max_displacement_mm, report.residual), (0.0, 0.0));
}

#[test]
fn nodes_and_boxes_pick_the_same() {
    let bottom: Vec<String> = (0..12).map(|node| node.to_string()).collect();
    let numbered = GOOD.replace(
        "box_mm = [[-1, -1, 0], [9, 9, 0]]",
        &format!("nodes = [{}]", bottom.join(", ")),
    );
    let turned = GOOD.replace("[[-1, -1, 0], [9, 9, 0]]", "[[9, inf, 0], [-1, -inf, -inf]]");
    let expected = solve(GOOD).unwrap().displacement_mm;
    assert_eq!(solve(&numbered).unwrap().displacement_mm, expected);
    assert_eq!(solve(&turned).unwrap().displacement_mm, expected);
}

#[test]
fn axes_choose_what_is_fixed() {
    let text = format!("{GOOD}[[fix]]\nnodes = [34]\naxes = \"zx\"\ndisplacement_mm = [0.25, 0, -0.5]\n");
    let report = solve(&text.replace("[35, 0]", "[34]")).unwrap();
    let [x, y, z] = report.displacement_mm[0];
    assert_eq!((x, z), (0.25, -0.5));
    assert!(y != 0.0 && report.warnings.is_empty());
    let report = solve(&text.replace("[0.25, 0, -0.5]", "[0.25, 7, -0.5]")).unwrap();
    assert_eq!(
        report.warnings,
        ["fix[1]: displacement_mm gives 7 mm along y, but `axes = \"zx\"` leaves y free"]
    );
}

#[test]
fn selections_are_checked() {
    let fix = |selection: &str| GOOD.replace("box_mm = [[-1, -1, 0], [9, 9, 0]]", selection);
    refused(
        &fix("nodes = [0, 1, 36]"),
        "fix[0].nodes[2]",
        7,
        &["found node 36", "36 nodes, numbered from 0"],
    );
    refused(&fix("nodes = [0, -1]"), "fix[0].nodes[1]", 7, &["found node -1"]);
    refused(
        &fix("nodes = [9999999999]"),
        "fix[0].nodes[0]",
        7,
        &["found node 9999999999"],
    );
    refused(&fix("nodes = []"), "fix[0].nodes", 7, &["no nodes"]);
    refused(&fix("axes = \"x\""), "fix[0]", 6, &["no choice of nodes", "`region`"]);
    let both = "nodes = [1]\nbox_mm = [[0, 0, 0], [1, 1, 1]]";
    refused(&fix(both), "fix[0]", 6, &["`nodes` beside another choice"]);
    let away = "box_mm = [[5, 5, 5], [6, 6, 6]]";
    refused(
        &fix(away),
        "fix[0].box_mm",
        7,
        &["no node in this box", "0 to 3 mm along x"],
    );
    refused(
        &fix("box_mm = [[0, nan, 0], [1, 1, 1]]"),
        "fix[0].box_mm[0][1]",
        7,
        &["found NaN"],
    );
    for axes in ["", "xw", "xx", "xyzz", "XY"] {
        let text = fix(&format!("nodes = [1]\naxes = \"{axes}\""));
        refused(&text, "fix[0].axes", 8, &[&format!("\"{axes}\""), "x, y and z"]);
    }
    refused(
        &GOOD.replace("nodes = [35]", "nodes = [35, 77]"),
        "load[0].nodes[1]",
        9,
        &["found node 77"],
    );
    refused(
        &GOOD.replace("[35, 0]", "[35, 88]"),
        "report_nodes[1]",
        2,
        &["found node 88"],
    );
}

#[test]
fn numbers_are_checked() {
    refused(
        &GOOD.replace("0.45", "0.5"),
        "material[0].poisson",
        5,
        &["0.5", "above -1 and below 0.5"],
    );
    for poisson in ["-1.0", "0.7", "nan", "-3"] {
        refused(&GOOD.replace("0.45", poisson), "material[0].poisson", 5, &["above -1"]);
    }
    for poisson in ["0", "-0.3", "0.4999"] {
        assert!(solve(&GOOD.replace("0.45", poisson)).is_ok(), "{poisson}");
    }
    for young in ["0", "-2.0", "nan", "inf"] {
        refused(&GOOD.replace("5.0", young), "material[0].young_kpa", 4, &["above 0"]);
        let shear = GOOD.replace("young_kpa = 5.0", &format!("shear_kpa = {young}"));
        refused(&shear, "material[0].shear_kpa", 4, &["above 0"]);
    }
    refused(
        &GOOD.replace("0.001]", "nan]"),
        "load[0].node_force_n[2]",
        10,
        &["found NaN"],
    );
    let fix = GOOD.replace("[[load]]", "displacement_mm = [inf, 0, 0]\n[[load]]");
    refused(&fix, "fix[0].displacement_mm[0]", 8, &["found inf", "finite"]);
}

#[test]
fn materials_cover_the_mesh_once() {
    let material = "[[material]]\nyoung_kpa = 5.0\npoisson = 0.45\n";
    refused(
        &GOOD.replace(material, &material.repeat(2)),
        "material[1]",
        6,
        &["second material without `region`"],
    );
    let twice = format!("{material}region = 0\n").repeat(2);
    refused(
        &GOOD.replace(material, &twice),
        "material[1].region",
        10,
        &["a second material for region 0"],
    );
    let unknown_region = format!("{material}region = 3\n");
    let words = ["there is no region 3", "expected one of 0"];
    refused(
        &GOOD.replace(material, &unknown_region),
        "material[0].region",
        6,
        &words,
    );
    let message = failure(&GOOD.replace(material, "")).2;
    assert!(
        message.contains("no `[[material]]`") && message.contains("(p.toml)"),
        "{message}"
    );
}

#[test]
fn contradictions_name_the_later_table() {
    let contradiction = format!("{GOOD}[[fix]]\nnodes = [3]\naxes = \"y\"\ndisplacement_mm = [0, 0.5, 0]\n");
    refused(
        &contradiction,
        "fix[1]",
        11,
        &["node 3 is fixed at both 0 mm and 0.5 mm along y"],
    );
    assert!(solve(&contradiction.replace("0.5", "0.0")).is_ok());
}

#[test]
fn free_motion_points_at_the_fixes() {
    let fix = |selection: &str| GOOD.replace("box_mm = [[-1, -1, 0], [9, 9, 0]]", selection);
    refused(
        &fix("nodes = [0]"),
        "fix",
        6,
        &[
            "rigid motion",
            "rotation about the line through",
            "region 0 (36 nodes, 0.012 ml, node 0)",
        ],
    );
    refused(&fix("nodes = [0, 1, 2]"), "fix", 6, &["along x"]);
    let none = GOOD.replace("[[fix]]\nbox_mm = [[-1, -1, 0], [9, 9, 0]]\n", "");
    let message = failure(&none).2;
    assert!(
        message.contains("any translation or rotation") && message.contains("(p.toml)"),
        "{message}"
    );
}

#[test]
fn keys_are_known() {
    let error = solve(&GOOD.replace("poisson", "poison")).unwrap_err();
    assert_eq!(error.location(), Some(("p.toml", 5)));
    let help = |error: &InputError| error.help().map(str::to_owned);
    assert_eq!(help(&error).as_deref(), Some("did you mean `poisson`?"));
    let error = solve(&format!("node_force_n = [0, 0, 1]\n{GOOD}")).unwrap_err();
    assert_eq!(help(&error).as_deref(), Some("`node_force_n` belongs in [[load]]"));
    let text = solve("[[material]]\n").unwrap_err().to_string();
    assert!(text.contains("missing key"), "{text}");
    let error = ProblemFile::read(Path::new("/nowhere/p.toml")).unwrap_err();
    assert!(!error.is_machine() && error.to_string().contains("/nowhere/p.toml"));
}

#[test]
fn meshes_that_cannot_be_read_are_named() {
    let refusal = failure(&GOOD.replace("block.vtu", "none.vtu"));
    assert_eq!((refusal.0.as_deref(), refusal.1), (Some("mesh"), Some(1)));
    assert!(refusal.2.contains("none.vtu"), "{}", refusal.2);
    let refusal = failure(&format!("region_array = \"organ\"\n{GOOD}"));
    assert!(refusal.2.contains("organ"), "{}", refusal.2);
}
