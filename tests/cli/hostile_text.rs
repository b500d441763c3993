//! Text from files never steers the terminal, forges a line or floods it; nor does its length make anything fail.

use crate::support::{Bench, Run};

/// Labels 1 and 2 with these names, as NRRD writes them.
fn segments(first: &str, second: &str) -> String {
    let voxels: String = (0..216).map(|n| if n % 6 < 3 { '\u{1}' } else { '\u{2}' }).collect();
    format!(
        "NRRD0005\ntype: uint8\ndimension: 3\nspace: left-posterior-superior\nsizes: 6 6 6\n\
         space directions: (15,0,0) (0,15,0) (0,0,15)\nkinds: domain domain domain\nencoding: raw\nspace origin: (0,0,0)\n\
         Segment0_ID:=Segment_1\nSegment0_LabelValue:=1\nSegment0_Layer:=0\nSegment0_Name:={first}\n\
         Segment1_ID:=Segment_2\nSegment1_LabelValue:=2\nSegment1_Layer:=0\nSegment1_Name:={second}\n\n{voxels}"
    )
}

/// One tetrahedron in a region of that name.
fn tetrahedron(region: &str) -> String {
    format!(
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n1\n3 1 \"{region}\"\n$EndPhysicalNames\n\
         $Nodes\n4\n1 0 0 0\n2 10 0 0\n3 0 10 0\n4 0 0 10\n$EndNodes\n$Elements\n1\n1 4 2 1 1 1 2 3 4\n$EndElements\n"
    )
}

/// Checks that all it printed is text without control characters, in lines that are not endless.
fn harmless(run: &Run) {
    for text in [&run.stdout, &run.stderr] {
        assert!(!text.contains(|c: char| c.is_control() && c != '\n'), "{text:?}");
        assert!(text.len() < 20_000, "{} bytes", text.len());
        let forged = text.lines().any(|line| line.starts_with("error: forged"));
        assert!(!forged, "{text}");
    }
}

#[test]
fn a_fault_far_along_a_line_is_shown_with_what_is_around_it() {
    let bench = Bench::new();
    bench.write("block.msh", &tetrahedron("all"));
    let nodes = format!("nodes = [{}99]", "1, ".repeat(22_000));
    bench.write(
        "problem.toml",
        &format!(
            "mesh = \"block.msh\"\n[[material]]\nyoung_kpa = 5.0\npoisson = 0.45\n[[load]]\nforce_n = [0, 0, 0.1]\n{nodes}\n\
             [[fix]]\nbox_mm = [[-inf, -inf, -inf], [inf, inf, inf]]\n"
        ),
    );
    let run = bench.run("solve problem.toml");
    run.fails(2, &["99", "problem.toml:7:"]);
    harmless(&run);

    bench.write(
        "wide.toml",
        &format!("version = 1\na = \"{}\"\n", "x".repeat(5_000_000)),
    );
    let run = bench.run("plan wide.toml");
    run.fails(2, &["unknown key `a`", "wide.toml:2:1"]);
    harmless(&run);
    bench.write("wide.toml", &format!("version = 1 # {}\u{1b}[2J\n", "x".repeat(70_000)));
    let run = bench.run("plan wide.toml");
    run.fails(2, &["wide.toml:1:70015", "\\u{1b}[2J"]);
    harmless(&run);
    let key = "y".repeat(70_000);
    bench.write(
        "wide.toml",
        &format!("version = 1\nseed = \"\\u001B[31m{key}\" # {key}\n"),
    );
    let run = bench.run("plan wide.toml");
    run.fails(2, &["wide.toml:2:8", "\\u{1b}[31m", "…"]);
    harmless(&run);
    bench.write("wide.toml", &format!("version = 1\nseed = {}@\n", " ".repeat(70_000)));
    let run = bench.run("plan wide.toml");
    run.fails(2, &["wide.toml:2:70008"]);
    harmless(&run);
}

#[test]
fn long_names_are_cut_in_tables_and_whole_in_json() {
    let bench = Bench::new();
    let name = "n".repeat(70_000);
    bench.write("labels.seg.nrrd", &segments(&name, "liver"));
    let run = bench.run("info labels.seg.nrrd");
    assert!(run.text().contains("nnn…  "), "{}", run.stdout);
    assert!(run.text().contains("liver  "), "{}", run.stdout);
    harmless(&run);
    assert_eq!(
        bench.run("info labels.seg.nrrd --json").json()["labels"][1]["name"],
        name.as_str()
    );

    bench.write("mesh.msh", &tetrahedron(&name));
    let run = bench.run("mesh info mesh.msh");
    assert!(run.text().contains("nnn…  "), "{}", run.stdout);
    harmless(&run);
    let run = bench.run("mesh make labels.seg.nrrd --nodes 100 --no-complete -o made.vtu");
    assert!(run.text().contains("nnn…  "), "{}", run.stdout);
    harmless(&run);
    // The name is in warnings of tissues that were assumed.
    let run = bench.run("plan --labels labels.seg.nrrd");
    harmless(&run);
}

#[test]
fn control_characters_of_files_are_escaped_outside_json() {
    let bench = Bench::new();
    let name = "\u{1b}[2J\u{1b}]0;title\u{7}\u{9b}31m\\nerror: forged\u{7f}";
    bench.write("labels.seg.nrrd", &segments(name, "liver"));
    let plain = "\u{1b}[2J\u{1b}]0;title\u{7}\u{9b}31m\nerror: forged\u{7f}";
    let run = bench.run("info labels.seg.nrrd");
    assert!(run.text().contains("\\u{1b}[2J"), "{}", run.stdout);
    harmless(&run);
    let run = bench.run("info labels.seg.nrrd --json");
    assert_eq!(run.json()["labels"][1]["name"], plain);
    harmless(&run);
    bench.write("mesh.msh", &tetrahedron(&name.replace("\\n", "")));
    for command in [
        "mesh info mesh.msh",
        "mesh make labels.seg.nrrd --nodes 100 --no-complete -o made.vtu",
        "plan --labels labels.seg.nrrd",
        "inspect --labels labels.seg.nrrd --at 320,240 --backend cpu",
        "render --labels labels.seg.nrrd --size 32x32 --backend cpu",
        "render --labels labels.seg.nrrd --target spleen --size 32x32 --backend cpu",
    ] {
        harmless(&bench.run(command));
    }
    bench.write("table.msh", "$MeshFormat\n\u{1b}[2Jerror: forged\n");
    bench.write("points.csv", "stretch,stress_kpa\n1.1,\u{1b}[31m\n");
    bench.run("mesh info table.msh").fails(2, &["binary data"]);
    for command in ["mesh info table.msh", "beam fit points.csv"] {
        harmless(&bench.run(command));
    }
}
