use std::path::Path;

use super::BeamCase;
use super::*;
use insonify_base::blame::Blame;
use insonify_base::csv::CsvError;
use insonify_base::document::InputError;
use insonify_mechanics::needle::beam::Base;
use insonify_mechanics::needle::beam::inverse::Wanted;

/// The example with a piece of its text replaced.
fn changed(from: &str, to: &str) -> Result<BeamCase, InputError> {
    let text = EXAMPLE.replacen(from, to, 1);
    assert_ne!(text, EXAMPLE, "{from}");
    CaseFile::parse(&text, "beam.toml").and_then(CaseFile::resolve)
}

fn line_of(text: &str) -> usize {
    1 + EXAMPLE.lines().position(|line| line.starts_with(text)).expect("a line")
}

#[test]
fn the_example_bends() {
    let case = CaseFile::parse(EXAMPLE, "beam.toml")
        .and_then(CaseFile::resolve)
        .expect("a case");
    assert_eq!(case.problem.inserted_mm, 60.0);
    let report = BeamReport::new(&case.solve().expect("a shape"));
    assert_eq!((report.rcm_mm, report.shape.len()), (Some(17.5), 81));
    let json = serde_json::to_value(&report).expect("JSON");
    let keys: Vec<&str> = json
        .as_object()
        .expect("an object")
        .keys()
        .map(String::as_str)
        .collect();
    assert_eq!(keys, ["com_mm", "iterations", "rcm_mm", "residual", "shape", "tip_mm"]);
    let first = json["shape"][0].as_object().expect("an object");
    assert_eq!(first.keys().collect::<Vec<_>>(), ["reaction", "slope", "u", "x"]);
    assert!(report.to_string().contains("17.5000 mm below the entry"));
}

#[test]
fn what_is_wrong_is_shown_with_its_line() {
    let cases = [
        ("young_gpa = 200.0", "young_gpa = -1.0", "young_gpa", "found -1"),
        (
            "displacement_mm = 15.0",
            "displacement_mm = nan",
            "displacement_mm",
            "NaN",
        ),
        ("element_mm = 1.0", "element_mm = 0.0", "element_mm", "above 0"),
        ("alpha = 8.74", "alpha = 0.0", "alpha", "0.001 to 1000"),
        ("mu_kpa = 3.63", "c10_kpa = 3.63", "mu_kpa", "model = \"yeoh\""),
        (
            "compression = \"UTru\"",
            "compression = \"UTrue\"",
            "compression",
            "UTru",
        ),
        ("friction = 0.0", "friction = 2.0", "friction", "0 to 1"),
        (
            "initial_length_mm = 50.0",
            "initial_length_mm = 0.0",
            "initial_length_mm",
            "above 0",
        ),
        ("thickness_mm = 20.0", "thickness_mm = 0.0", "thickness_mm", "above 0"),
        (
            "control_distance_mm = 20.0",
            "control_distance_mm = -20.0",
            "control_distance_mm",
            "0 to",
        ),
        ("# inserted_mm = 60.0 ", "inserted_mm = 61.0 ", "# inserted_mm", "60 mm"),
        ("slope = -0.4", "slop = -0.4", "slope", "slop"),
        (
            "# pivot_mm = 40.0 ",
            "pivot_mm = 40.0 ",
            "# pivot_mm",
            "only a base that rotates freely",
        ),
        (
            "# inner_diameter_mm = 0.7 ",
            "inner_diameter_mm = 1.0 ",
            "# inner",
            "outer diameter, 1 mm",
        ),
        (
            "# bending_stiffness_nmm2",
            "bending_stiffness_nmm2",
            "young_gpa",
            "one of them",
        ),
        (
            "# measured_mm = [[-20",
            "measured_mm = [[70",
            "# measured_mm",
            "positions rising",
        ),
        (
            "# min_compression_ratio = 0.8",
            "min_compression_ratio = 1.0",
            "# min_compression_ratio",
            "below 1",
        ),
    ];
    for (from, to, line, words) in cases {
        let error = changed(from, to).map(drop).expect_err(to);
        assert_eq!(error.location(), Some(("beam.toml", line_of(line))), "{error}");
        assert!(error.to_string().contains(words), "{error}");
        assert!(!error.is_machine());
    }
    let none = CaseFile::parse(EXAMPLE.split("[[layer]]").next().expect("a part"), "x").and_then(CaseFile::resolve);
    assert!(none.map(drop).expect_err("refused").to_string().contains("`[[layer]]`"));
}

/// A tube of 1 and 0.7 mm has the stiffness of its ring: 200 GPa pi (1 - 0.7^4)/64 mm^4.
#[test]
fn hollow_needles_bend_more_and_a_stiffness_may_be_given() {
    let bending = |from: &str, to: &str| changed(from, to).expect(to).problem.bending_nmm2;
    let tube = bending("# inner_diameter_mm = 0.7 ", "inner_diameter_mm = 0.7 ");
    assert!((tube - 9817.477 * (1.0 - 0.2401)).abs() < 1e-3, "{tube}");
    let given = bending(
        "young_gpa = 200.0             # steel\ndiameter_mm = 1.0",
        "bending_stiffness_nmm2 = 5000",
    );
    assert_eq!(given, 5000.0);
    let none = changed("diameter_mm = 1.0", "")
        .map(drop)
        .expect_err("no diameter")
        .to_string();
    assert!(
        none.contains("no `diameter_mm`") && none.contains("bending_stiffness_nmm2"),
        "{none}"
    );
}

/// Solver errors are reported with a key too.
#[test]
fn needles_without_a_shape_are_shown_with_a_line() {
    let mut crushed = changed("control_distance_mm = 20.0", "control_distance_mm = 0.0").expect("a case");
    crushed.base = Base {
        displacement_mm: 60.0,
        slope: Some(0.0),
    };
    let error = crushed.solve().expect_err("crushed");
    assert_eq!(
        error.location(),
        Some(("beam.toml", line_of("initial_length_mm"))),
        "{error}"
    );
    let wanted = Wanted::Centre {
        com_mm: 70.0,
        displacement_mm: 5.0,
    };
    let error = crushed.find(&wanted).map(drop).expect_err("too deep");
    assert_eq!(error.key(), Some("base"), "{error}");
}

#[test]
fn points_come_with_or_without_a_header() {
    let path = Path::new("points.csv");
    let expected = [(0.9, -1.0), (0.8, -2.5)];
    for text in [
        "stretch,stress_kpa\n0.9,-1\n0.8,-2.5\n",
        "# muscle\n stress_kpa , Stretch\n-1,0.9\n-2.5,0.8",
        "0.9, -1.0\n0.8, -2.5\n",
    ] {
        let samples = points::parse(text.as_bytes(), path).expect(text);
        let samples: Vec<_> = samples
            .iter()
            .map(|sample| (sample.stretch, sample.stress_kpa))
            .collect();
        assert_eq!(samples, expected);
    }
    for (text, line, words) in [
        ("stretch,stress_kpa\n0.9,-1\n0.8,x\n", 3, "`x`"),
        ("stretch,stress_kpa\n0.9,-1\n0.8\n", 3, "1 columns"),
        ("length,force\n0.9,-1\n", 1, "length,force"),
        ("0.9,-1\n-0.8,-2\n", 2, "-0.8"),
        ("0.9,-1\n0.8,inf\n", 2, "`inf`"),
    ] {
        let error = points::parse(text.as_bytes(), path).expect_err(text);
        assert!(
            matches!(error, CsvError::Line { line: at_line, .. } if at_line == line),
            "{error}"
        );
        assert!(error.to_string().contains(words) && !error.is_machine(), "{error}");
    }
}
