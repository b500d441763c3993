//! `insonify beam`: what it prints and draws, and that whatever is wrong with a case or with points ends with status 2,
//! the line, and nothing written.

use insonify::input::scenario::EXAMPLES;
use serde_json::Value;

use crate::support::Bench;

const CASE: &str = "\
[needle]
young_gpa = 200.0
diameter_mm = 1.0
[base]
control_distance_mm = 20.0
displacement_mm = 15.0
slope = -0.4
[mesh]
element_mm = 1.0
[[layer]]
thickness_mm = 30.0
model = \"ogden\"
mu_kpa = 3.63
alpha = 8.74
compression = \"UTru\"
initial_length_mm = 50.0
friction = 0.1
[[layer]]
thickness_mm = 30.0
model = \"mooney-rivlin\"
c10_kpa = 3.0
c01_kpa = 1.0
compression = \"CTru\"
initial_length_mm = 50.0
friction = 0.0
";

fn bench() -> Bench {
    let bench = Bench::new();
    bench.write("case.toml", CASE);
    bench
}

fn number(json: &Value, key: &str) -> f64 {
    json[key]
        .as_f64()
        .unwrap_or_else(|| panic!("no number {key} in {json}"))
}

#[test]
fn a_case_is_bent() {
    let bench = bench();
    let run = bench.run("beam case.toml --json -o shape.svg");
    let json = run.json();
    assert_eq!(number(&json, "rcm_mm"), 17.5);
    assert!(number(&json, "residual") < 1e-10 && number(&json, "iterations") >= 1.0);
    let com = number(&json, "com_mm");
    assert!((20.0..60.0).contains(&com), "{com}");
    let shape = json["shape"].as_array().expect("a list");
    assert_eq!(shape.len(), 81);
    let [first, last] = [&shape[0], &shape[80]];
    assert_eq!(
        [number(first, "x"), number(first, "u"), number(first, "slope")],
        [-20.0, 15.0, -0.4]
    );
    assert_eq!((number(first, "reaction"), number(last, "x")), (0.0, 60.0));
    assert_eq!(number(last, "u"), number(&json, "tip_mm"));
    assert!(number(&shape[20], "reaction") > 0.0 && number(last, "reaction") < 0.0);
    assert!(bench.files(".").contains(&"shape.svg".to_owned()));
    assert!(run.stderr.is_empty(), "{run:?}");

    let table = bench.run("beam case.toml");
    assert!(table.text().contains("RCM          17.5000 mm"), "{table:?}");
}

#[test]
fn a_free_base_and_one_that_stays_have_their_centres_or_none() {
    let bench = bench();
    bench.write("free.toml", &CASE.replace("slope = -0.4\n", ""));
    let free = bench.run("beam free.toml --json").json();
    assert!(number(&free, "rcm_mm") > 0.0);
    let still = CASE
        .replace("displacement_mm = 15.0", "displacement_mm = 0")
        .replace("slope = -0.4", "slope = 0");
    bench.write("still.toml", &still);
    let still = bench.run("beam still.toml --json").json();
    assert!(still["com_mm"].is_null() && still["rcm_mm"].is_null());
    assert_eq!(number(&still, "tip_mm"), 0.0);
}

/// Tissue that stiffens a million times within a few elements.
#[test]
fn elements_that_are_too_long_are_told() {
    let bench = bench();
    let steep = CASE.replace("\"UTru\"", "\"CTru\"").replace("= 50.0", "= 20.0");
    let steep = steep.replace("control_distance_mm = 20.0", "control_distance_mm = 0.0");
    bench.write("steep.toml", &steep);
    let run = bench.run("beam steep.toml --json");
    assert!(
        run.json()["tip_mm"].is_number() && run.stderr.contains("use shorter ones"),
        "{run:?}"
    );
    bench.write("fine.toml", &steep.replace("element_mm = 1.0", "element_mm = 0.1"));
    let run = bench.run("beam fine.toml");
    assert!(
        run.text().contains("elements     leave") && !run.stderr.contains("shorter"),
        "{run:?}"
    );
}

#[test]
fn the_example_runs_and_the_schema_knows_its_keys() {
    let bench = Bench::new();
    bench.write("case.toml", bench.run("beam --example").text());
    assert_eq!(number(&bench.run("beam case.toml --json").json(), "rcm_mm"), 17.5);
    let schema = bench.run("schema beam").text().to_owned();
    for key in [
        "young_gpa",
        "inserted_mm",
        "control_distance_mm",
        "initial_length_mm",
        "c20_kpa",
        "neo-hookean",
        "CTru",
    ] {
        assert!(schema.contains(key), "{key}");
    }
}

#[test]
fn bad_cases_are_refused_with_their_line() {
    let bench = bench();
    let before = bench.files(".");
    for (from, to, line, words) in [
        ("alpha = 8.74", "alpha = 0", 14, "found 0"),
        ("alpha = 8.74\n", "", 10, "no `alpha`"),
        ("c01_kpa = 1.0", "c01_kpa = -3.5", 22, "c10_kpa"),
        ("friction = 0.1", "friktion = 0.1", 17, "friktion"),
        ("\"CTru\"", "\"ctrue\"", 23, "ctrue"),
        ("element_mm = 1.0", "element_mm = 1e-9", 9, "100000"),
        ("diameter_mm = 1.0", "diameter_mm = 1.0\ninserted_mm = 99", 4, "60"),
        ("slope = -0.4", "slope = \"steep\"", 7, "steep"),
        (
            "displacement_mm = 15.0\nslope = -0.4",
            "displacement_mm = 1e5",
            15,
            "compressed to nothing",
        ),
    ] {
        bench.write("case.toml", &CASE.replacen(from, to, 1));
        let run = bench.run("beam case.toml --json -o shape.svg");
        run.fails(2, &[words, &format!("case.toml, line {line}")]);
        assert_eq!(bench.files("."), before, "{run:?}");
    }
    bench.run("beam none.toml").fails(2, &["none.toml"]);
    bench.run("beam").fails(2, &["CASE.toml"]);
    bench.write("case.toml", CASE);
    bench.run("beam case.toml -o shape.png").fails(2, &[".svg"]);
}

#[test]
fn base_motions_are_found_for_what_is_wanted() {
    let bench = bench();
    let tip = bench.run("beam inverse case.toml --tip-mm -2 --json").json();
    assert!((number(&tip, "tip_mm") + 2.0).abs() < 1e-8 && (number(&tip, "rcm_mm") - 17.5).abs() < 1e-9);
    let both = bench
        .run("beam inverse case.toml --tip-mm -2 --com-mm 40 --json -o shape.svg")
        .json();
    assert!((number(&both, "tip_mm") + 2.0).abs() < 1e-8 && (number(&both, "com_mm") - 40.0).abs() < 1e-6);
    // The motion that was found does what was wanted.
    let motion = CASE
        .replace(
            "= 15.0\nslope",
            &format!("= {}\nslope", number(&both, "displacement_mm")),
        )
        .replace("-0.4", &number(&both, "slope").to_string());
    bench.write("found.toml", &motion);
    let report = bench.run("beam found.toml --json").json();
    assert!((number(&report, "com_mm") - 40.0).abs() < 1e-6);
    let about = bench
        .run("beam inverse case.toml --tip-mm 1 --rcm-mm 0")
        .text()
        .to_owned();
    assert!(
        about.contains("RCM          0.0000 mm") && about.contains("displacement"),
        "{about}"
    );
    for (arguments, words) in [
        ("", "--tip-mm"),
        ("--com-mm 70", "60"),
        ("--com-mm nan", "--com-mm"),
        ("--tip-mm 1 --rcm-mm -20", "beyond the base"),
    ] {
        bench
            .run(&format!("beam inverse case.toml {arguments}"))
            .fails(2, &[words]);
    }
}

/// Limits of layers refuse a motion with their line; another motion keeps them.
#[test]
fn limits_of_compression_are_kept() {
    let bench = bench();
    let limited = CASE.replacen("friction = 0.1", "friction = 0.1\nmin_compression_ratio = 0.93", 1);
    bench.write("limited.toml", &limited);
    bench
        .run("beam inverse limited.toml --tip-mm -2 -o shape.svg")
        .fails(2, &["limited.toml, line 18", "layer 1", "0.93"]);
    let least = bench
        .run("beam inverse limited.toml --tip-mm -2 --least-compression --json")
        .json();
    assert!((number(&least, "tip_mm") + 2.0).abs() < 1e-8);
    bench.write("tight.toml", &limited.replace("0.93", "0.999"));
    bench
        .run("beam inverse tight.toml --tip-mm -2 --least-compression")
        .fails(2, &["tight.toml, line 18", "by every motion"]);
    bench
        .run("beam inverse case.toml --com-mm 40 --least-compression")
        .fails(2, &["--least-compression"]);

    let axis = CASE.replace("slope = -0.4", "pivot_mm = 40");
    bench.write("axis.toml", &axis);
    let report = bench.run("beam inverse axis.toml --tip-mm -1 --json").json();
    let [base, slope, moved] = ["displacement_mm", "slope", "axis_displacement_mm"].map(|key| number(&report, key));
    assert!((base - (moved + 40.0 * slope)).abs() < 1e-9, "{report}");
}

#[test]
fn a_case_is_studied() {
    let bench = bench();
    let json = bench.run("beam compression case.toml --json -o out").json();
    let layers = json["tables"]["layers"]["rows"].as_array().expect("rows").clone();
    let bent = bench.run("beam case.toml").text().to_owned();
    assert!(bent.contains("layer 2      30.0 to 60.0 mm"), "{bent}");
    assert_eq!((layers.len(), number(&layers[1], "from_mm")), (2, 30.0));
    assert!(bench.files("out").contains(&"depth.csv".to_owned()));

    let json = bench
        .run("beam map case.toml --tip-mm -2,1 --rcm-mm 0,20 --json")
        .json();
    let rows = json["tables"]["map"]["rows"].as_array().expect("rows").clone();
    assert_eq!(rows.len(), 8);
    let ratio = |at: usize| number(&rows[at], "least_ratio");
    assert!((number(&rows[1], "rcm_mm") - 20.0).abs() < 1e-9 && rows[3]["base"] == "least compression");
    assert!(ratio(3) >= ratio(0).max(ratio(1)).max(ratio(2)), "{rows:?}");
    let inverse = bench
        .run("beam inverse case.toml --tip-mm -2 --rcm-mm 20 --json")
        .json();
    assert_eq!(number(&rows[1], "displacement_mm"), number(&inverse, "displacement_mm"));

    let run = "beam sensitivity case.toml --mu-percent 50 --alpha-percent 0 --t0-percent 10 --json";
    let json = bench.run(run).json();
    let rows = json["tables"]["sensitivity"]["rows"].as_array().expect("rows").clone();
    // Three parameters at five values for all layers, and at four for each of two.
    assert_eq!(rows.len(), 39);
    let softer = CASE
        .replace("mu_kpa = 3.63", "mu_kpa = 1.815")
        .replace("= 3.0\n", "= 1.5\n")
        .replace("c01_kpa = 1.0", "c01_kpa = 0.5");
    bench.write("softer.toml", &softer);
    let softer = bench.run("beam softer.toml --json").json();
    assert_eq!(number(&rows[0], "percent"), -50.0);
    assert!((number(&rows[0], "tip_mm") - number(&softer, "tip_mm")).abs() < 1e-12);
    assert_eq!(number(&rows[5], "tip_change_mm"), 0.0);
    let ranges = json["tables"]["ranges"]["rows"][0].clone();
    assert!(
        number(&ranges, "least") <= number(&rows[0], "tip_mm").min(number(&rows[4], "tip_mm")),
        "{ranges}"
    );

    let axes = bench.run("beam table --pivot-mm 0,40 --json").json();
    assert_eq!(axes["tables"]["axis"]["rows"].as_array().map(Vec::len), Some(24));
    for (arguments, words) in [
        ("map case.toml", "--tip-mm"),
        ("map case.toml --tip-mm nan", "--tip-mm"),
        ("sensitivity case.toml --mu-percent 100", "below 100"),
        ("table --pivot-mm=-1", "pivot_mm"),
    ] {
        bench.run(&format!("beam {arguments}")).fails(2, &[words]);
    }
}

#[test]
fn materials_are_fitted_to_points() {
    let bench = bench();
    // Ogden, mu 12.72, alpha -1, engineering stress: as exact as its digits.
    let stress = |l: f64| -2.0 * 12.72 * (l.powf(-2.0) - l.powf(-0.5));
    let rows = (0..=10).map(|at| 1.0 - 0.03 * f64::from(at));
    let rows: Vec<String> = rows.map(|l| format!("{l:.2},{:.9}", stress(l))).collect();
    bench.write(
        "points.csv",
        &format!("# phantom\nstretch,stress_kpa\n{}\n", rows.join("\n")),
    );
    let run = bench.run("beam fit points.csv --json -o fit.svg");
    let json = run.json();
    let model = |name: &str| {
        let models = json["models"].as_array().expect("a list");
        models
            .iter()
            .find(|model| model["model"] == name)
            .unwrap_or_else(|| panic!("no {name}"))
            .clone()
    };
    let ogden = model("ogden");
    assert!((number(&ogden, "mu_kpa") - 12.72).abs() < 1e-3 && (number(&ogden, "alpha") + 1.0).abs() < 1e-3);
    assert!(number(&ogden, "r_squared") > 1.0 - 1e-9);
    for name in ["neo-hookean", "mooney-rivlin", "yeoh"] {
        assert!(number(&model(name), "r_squared") > 0.99, "{name}");
    }
    assert!(
        run.stderr.contains("warning: neo-hookean") && run.stderr.contains("below stretch"),
        "{run:?}"
    );
    let table = bench.run("beam fit points.csv");
    assert!(
        table.text().contains("mooney-rivlin") && table.text().contains("R^2"),
        "{table:?}"
    );

    for (text, words) in [
        ("stretch,stress_kpa\n0.9,-1\n0.8,none\n", ["bad.csv, line 3", "`none`"]),
        ("stretch,stress_kpa\n0.9,-1\n", ["bad.csv", "at least 3"]),
        ("0.9,1\n0.8,2\n0.7,3\n", ["bad.csv", "wrong sign"]),
        ("strain;stress\n", ["bad.csv, line 1", "semicolons"]),
    ] {
        bench.write("bad.csv", text);
        bench.run("beam fit bad.csv --json -o bad.svg").fails(2, &words);
        assert!(!bench.files(".").contains(&"bad.svg".to_owned()));
    }
    bench.run("beam fit none.csv").fails(2, &["none.csv"]);
}

#[test]
fn the_published_table_is_regenerated() {
    let bench = Bench::new();
    let json = bench.run("beam table --json -o out").json();
    let rows = json["tables"]["table-one"]["rows"].as_array().expect("rows");
    assert_eq!(rows.len(), 12);
    for row in rows {
        let near = if row["tissue"] == "PSM" { 1.2 } else { 2.6 };
        assert!(number(row, "difference_mm").abs() < near, "{row}");
        assert!(number(row, "rcm_natural_mm") > 0.0, "{row}");
    }
    assert!(bench.files("out").contains(&"table-one.csv".to_owned()));
    assert!(bench.run("beam table").text().contains("Table I"));
}

/// Springs and beam have keys of their own.
#[test]
fn a_needle_of_a_scenario_may_be_a_beam() {
    let bench = Bench::new();
    let name = "prostate-brachytherapy";
    let (_, text) = EXAMPLES.iter().find(|(known, _)| *known == name).expect(name);
    let beam = text.replace("model = \"springs\"", "model = \"beam\"");
    for (from, to, words) in [
        ("link_mm = 10.0\n", "", "kappa_nmm_per_deg"),
        ("kappa_nmm_per_deg = 10.7\n", "", "link_mm"),
        (
            "kappa_nmm_per_deg = 10.7\nlink_mm = 10.0",
            "element_mm = 0.1",
            "0.5 to 100",
        ),
        (
            "kappa_nmm_per_deg = 10.7\nlink_mm = 10.0",
            "young_gpa = 200.0\nbending_stiffness_nmm2 = 6000.0",
            "one of them",
        ),
    ] {
        let wrong = beam.replace(from, to);
        assert_ne!(wrong, beam, "{from}");
        bench.write("beam.toml", &wrong);
        bench
            .run("insert beam.toml -o out -q")
            .fails(2, &["beam.toml, line ", words]);
    }
}
