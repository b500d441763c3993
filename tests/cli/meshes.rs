//! `insonify mesh info`.

use serde_json::json;

use crate::support::Bench;

/// Two tetrahedra on a common face, a third apart, and a triangle of the surface.
const MESH: &str = "\
$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
2
3 1 \"liver\"
3 2 \"kidney\"
$EndPhysicalNames
$Nodes
9
1 0 0 0
2 10 0 0
3 0 10 0
4 0 0 10
5 10 10 10
6 40 0 0
7 50 0 0
8 40 10 0
9 40 0 10
$EndNodes
$Elements
4
1 2 2 7 1 1 2 3
2 4 2 1 1 1 2 3 4
3 4 2 1 1 2 3 4 5
4 4 2 2 2 6 7 8 9
$EndElements
";

#[test]
fn meshes_are_described() {
    let bench = Bench::new();
    bench.write("organs.msh", MESH);
    let info = bench.run("mesh info organs.msh --json").json();
    assert_eq!(
        (&info["nodes"], &info["elements"], &info["skipped_cells"]),
        (&json!(9), &json!(3), &json!(1))
    );
    assert_eq!(info["bounds_mm"], json!([[0.0, 0.0, 0.0], [50.0, 10.0, 10.0]]));
    assert_eq!((&info["parts"], &info["warnings"]), (&json!(2), &json!([])));
    // Of a cube of 10 mm, 1 ml, its corner has a sixth, and what lies between that and the far corner a third.
    let ml = |value: &serde_json::Value| value.as_f64().unwrap();
    let volumes = [
        ml(&info["volume_ml"]),
        ml(&info["regions"][0]["volume_ml"]),
        ml(&info["regions"][1]["volume_ml"]),
    ];
    for (volume, sixths) in volumes.iter().zip([4.0, 3.0, 1.0]) {
        assert!((volume - sixths / 6.0).abs() < 1e-12, "{volumes:?}");
    }
    let region = |place: usize| {
        [
            &info["regions"][place]["value"],
            &info["regions"][place]["name"],
            &info["regions"][place]["elements"],
        ]
    };
    assert_eq!(region(0), [&json!(1), &json!("liver"), &json!(2)]);
    assert_eq!(region(1), [&json!(2), &json!("kidney"), &json!(1)]);
    let quality = &info["quality"];
    assert_eq!(quality["usable"], json!(true));
    for list in [
        "inverted",
        "flat",
        "too_thin",
        "duplicates",
        "isolated_nodes",
        "coincident_nodes",
    ] {
        assert_eq!(quality[list], json!([]), "{list}");
    }
    assert!((ml(&quality["min_volume_mm3"]) - 1000.0 / 6.0).abs() < 1e-9);
    assert!((ml(&quality["max_jacobian_condition"]) - 1.5f64.sqrt()).abs() < 1e-12);
    assert!((ml(&quality["median_max_dihedral_deg"]) - 90.0).abs() < 1e-9);
    let table = bench.run("mesh info organs.msh");
    for words in [
        "9",
        "3 tetrahedra (1 vertices, lines and surfaces left out)",
        "liver",
        "0.50",
        "Jacobian condition",
    ] {
        assert!(table.text().contains(words), "{words} in {table:?}");
    }
}

#[test]
fn regions_are_taken_from_the_named_array() {
    let bench = Bench::new();
    bench.write("organs.msh", &MESH.replace("3 4 2 1 1 2", "3 4 2 1 9 2"));
    let info = bench
        .run("mesh info organs.msh --json --region gmsh:geometrical")
        .json();
    let values: Vec<_> = info["regions"]
        .as_array()
        .unwrap()
        .iter()
        .map(|region| region["value"].clone())
        .collect();
    assert_eq!(values, [1, 2, 9]);
    assert_eq!(info["regions"][0]["name"], json!(null));
    bench
        .run("mesh info organs.msh --region label")
        .fails(2, &["organs.msh", "`label`", "gmsh:physical"]);
}

#[test]
fn bad_elements_are_told_but_can_be_looked_at() {
    let bench = Bench::new();
    // Tetrahedron 1 is turned inside out, 2 lies in a plane, and two nodes are added: one of no tetrahedron, at
    // another's place.
    let text = MESH
        .replace("3 4 2 1 1 2 3 4 5", "3 4 2 1 1 2 4 3 5")
        .replace("9 40 0 10", "9 50 10 0");
    bench.write("bad.msh", &text.replace("$Nodes\n9\n", "$Nodes\n10\n10 40 0 0\n"));
    let info = bench.run("mesh info bad.msh --json").json();
    let quality = &info["quality"];
    assert_eq!((&quality["inverted"], &quality["flat"]), (&json!([1]), &json!([2])));
    assert_eq!(
        (&quality["isolated_nodes"], &quality["coincident_nodes"]),
        (&json!([9]), &json!([[5, 9]]))
    );
    assert_eq!(
        (&quality["usable"], &quality["max_jacobian_condition"]),
        (&json!(false), &json!(null))
    );
    let warnings = info["warnings"].to_string();
    for words in [
        "tetrahedron 1 is inverted",
        "tetrahedron 2 is flat",
        "belong to no tetrahedron",
        "in the place of another",
    ] {
        assert!(warnings.contains(words), "{words} in {warnings}");
    }
    assert!(
        bench
            .run("mesh info bad.msh")
            .text()
            .contains("warning: the mesh cannot be calculated on")
    );
}

#[test]
fn what_is_no_mesh_is_status_2_and_named() {
    let bench = Bench::new();
    bench.run("mesh").fails(2, &["Usage"]);
    bench.run("mesh info none.vtu").fails(2, &["none.vtu", "cannot read"]);
    bench.write("text.msh", "this is no mesh");
    bench
        .run("mesh info text.msh")
        .fails(2, &["text.msh", "line 1", "$MeshFormat"]);
    for (from, to, words) in [
        (
            "2 4 2 1 1 1 2 3 4",
            "2 4 2 1 1 1 2 3 3",
            vec!["tetrahedron 0", "node 2 twice"],
        ),
        ("\n8 40 10 0", "\n8 40 nan 0", vec!["line 18", "NaN", "node 8"]),
        (
            "\n8 40 10 0",
            "\n8 40 1e200 0",
            vec!["bad.msh", "node 7", "up to 1e6 mm"],
        ),
    ] {
        assert!(MESH.contains(from), "{from}");
        bench.write("bad.msh", &MESH.replace(from, to));
        bench.run("mesh info bad.msh").fails(2, &words);
    }
    // An inverted tetrahedron has no condition, and no figure that is none.
    bench.write("inverted.msh", &MESH.replace("2 4 2 1 1 1 2 3 4", "2 4 2 1 1 1 2 4 3"));
    let run = bench.run("mesh info inverted.msh");
    assert!(
        !run.text().contains("inf ") && !run.text().contains("inf\n") && !run.text().contains("NaN"),
        "{run:?}"
    );
    assert!(run.text().contains("infinite"), "{run:?}");
    bench.run("mesh info --help").text();
}
