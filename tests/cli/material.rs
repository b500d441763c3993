//! `insonify material`: what it prints and writes, and that a wrong case ends with status 2, its line, and nothing
//! written.

use crate::support::Bench;

const CREEP: &str = "\
law = \"spring-pot\"
order = 0.5
modulus_kpa = 4.0
rule = \"trapezoid\"
[history]
control = \"stress\"
time_s = [0, 1, 4]
value = [2, 2, 2]
";

/// Checks that the case is refused with its line, that all words are said, and that nothing is written.
fn refused(case: &str, line: usize, words: &[&str]) {
    let bench = Bench::new();
    bench.write("c.toml", case);
    let before = bench.files(".");
    let run = bench.run("material c.toml --json -o c.svg");
    let place = format!("c.toml, line {line}");
    run.fails(2, &[words, &[place.as_str()]].concat());
    assert_eq!(bench.files("."), before, "{run:?}");
}

#[test]
fn a_spring_pot_creeps() {
    let bench = Bench::new();
    bench.write("c.toml", CREEP);
    for rule in ["rectangle", "time-scaled-trapezoid", "trapezoid", "exponentials"] {
        bench.write("c.toml", &CREEP.replace("trapezoid", rule));
        let report = bench.run("material c.toml --json -o c.svg").json();
        assert_eq!(report["time_s"], serde_json::json!([0.0, 1.0, 4.0]));
        assert_eq!(report["stress_kpa"], serde_json::json!([2.0, 2.0, 2.0]));
        assert_eq!(report["strain"][0], 0.0);
        assert_eq!(report.as_object().unwrap().len(), 3);
        // t^k / (G Gamma(1 + k)), and Gamma(1.5) = sqrt(pi) / 2.
        let unit = 1.0 / std::f64::consts::PI.sqrt();
        for (at, exact) in [(1, unit), (2, 2.0 * unit)] {
            assert!(
                (report["strain"][at].as_f64().unwrap() / exact - 1.0).abs() < 1e-9,
                "{rule}: {report}"
            );
        }
        let plot = bench.text("c.svg");
        assert!(plot.starts_with("<svg") && plot.contains("shear strain"));
    }
    let table = bench.run("material c.toml");
    assert!(table.text().contains("strain") && table.stderr.is_empty(), "{table:?}");
}

#[test]
fn relaxation_from_a_jump_begins_with_an_infinite_stress() {
    let bench = Bench::new();
    let case = CREEP
        .replace("\"stress\"", "\"strain\"")
        .replace("[0, 1, 4]", "[0, 1, 2]");
    for rule in ["rectangle", "trapezoid", "exponentials", "gruenwald-letnikov"] {
        bench.write("c.toml", &case.replace("trapezoid", rule));
        let run = bench.run("material c.toml --json");
        let report = run.json();
        assert!(
            report["stress_kpa"][0].is_null() && run.stderr.contains("infinite"),
            "{run:?}"
        );
        // 2 G t^-k / Gamma(1 - k), and Gamma(0.5) = sqrt(pi).
        let exact = 8.0 / (2.0 * std::f64::consts::PI).sqrt();
        assert!(
            (report["stress_kpa"][2].as_f64().unwrap() / exact - 1.0).abs() < 1e-8,
            "{rule}: {report}"
        );
    }
}

#[test]
fn the_example_and_its_measurements_run() {
    let bench = Bench::new();
    bench.write("e.toml", bench.run("material --example").text());
    let report = bench.run("material e.toml --json").json();
    let strain: Vec<f64> = report["strain"]
        .as_array()
        .unwrap()
        .iter()
        .map(|x| x.as_f64().unwrap())
        .collect();
    assert!(strain.windows(2).all(|pair| pair[0] < pair[1]), "{strain:?}");
    let run = bench.run("material e.toml --rheometer tests");
    assert!(run.text().contains("slopes 0.1000 and 0.1000"), "{run:?}");
    assert_eq!(
        bench.files("tests"),
        [
            "creep.csv",
            "creep.svg",
            "dynamic-moduli.csv",
            "dynamic-moduli.svg",
            "stiffness.svg"
        ]
    );
}

#[test]
fn parameters_return_from_measurements() {
    let bench = Bench::new();
    bench.write("e.toml", bench.run("material --example").text());
    bench.run("material e.toml --rheometer tests");
    let run = bench.run("material fit tests/dynamic-moduli.csv tests/creep.csv --memory rate --json -o plots");
    let report = run.json();
    for (path, exact) in [
        ("/dynamic/order/value", 0.1),
        ("/dynamic/modulus_kpa/value", 0.4),
        ("/creep/modulus_kpa/value", 0.4),
        ("/creep/knee_shear/value", 0.35),
    ] {
        let value = report.pointer(path).unwrap().as_f64().unwrap();
        assert!((value / exact - 1.0).abs() < 5e-3, "{path}: {value}");
    }
    assert!(
        run.stderr.is_empty() && bench.files("plots").contains(&"stiffness.svg".to_owned()),
        "{run:?}"
    );
    let run = bench.run("material fit tests/creep.csv --order 0.1");
    assert!(
        run.text().contains("knee_shear = 0.3") && run.text().contains("shear_kpa = 0."),
        "{run:?}"
    );
    // What it prints is a case.
    let lines: String = run
        .text()
        .lines()
        .skip_while(|line| !line.starts_with("law"))
        .take(6)
        .map(|line| line.to_owned() + "\n")
        .collect();
    bench.write(
        "f.toml",
        &format!("{lines}[history]\ncontrol = \"stress\"\ntime_s = [0, 1]\nvalue = [0.1, 0.1]\n"),
    );
    assert!(
        bench.run("material f.toml --json").json()["strain"][1]
            .as_f64()
            .unwrap()
            > 0.2
    );
    bench.write("m.csv", "frequency_rad_s,storage_kpa,loss_kpa\n1,0.4,0.06\n2,0.41,x\n");
    bench.run("material fit m.csv").fails(2, &["m.csv, line 3", "loss_kpa"]);
    bench
        .run("material fit tests/creep.csv --order 1")
        .fails(2, &["above 0 and below 1"]);
    bench.run("material fit").fails(2, &["FILE.csv"]);
}

#[test]
fn wrong_cases_are_refused() {
    refused(
        &CREEP.replace("0.5", "1.5"),
        2,
        &["order", "1.5", "0 (a spring) to 1 (a dashpot)"],
    );
    refused(&CREEP.replace("4.0", "-4"), 3, &["modulus_kpa", "above 0"]);
    refused(&CREEP.replace("order", "oder"), 2, &["unknown key `oder`", "`order`"]);
    refused(
        &CREEP.replace("spring-pot", "spring-pod"),
        1,
        &["spring-pod", "spring-pot"],
    );
    refused(
        &CREEP.replace("trapezoid", "simpson"),
        4,
        &["simpson", "gruenwald-letnikov"],
    );
    refused(
        &CREEP.replace("trapezoid", "gruenwald-letnikov"),
        7,
        &["time_s[2]", "equally far apart"],
    );
    refused(
        &CREEP.replace("[0, 1, 4]", "[0, 1, 1]"),
        7,
        &["time_s[2]", "after the one before"],
    );
    refused(&CREEP.replace("[2, 2, 2]", "[2, 2]"), 8, &["2 values at 3 times"]);
    refused(&CREEP.replace("[2, 2, 2]", "[2, nan, 2]"), 8, &["value[1]", "finite"]);
    refused(&CREEP.replace("spring-pot", "zener"), 1, &["without `modulus_inf_kpa`"]);
    refused(&CREEP.replace("\"stress\"", "\"load\""), 6, &["load", "stress"]);
    refused(
        &CREEP.replace("[history]", "knee_shear = 0.3\n[history]"),
        5,
        &["without `stiffening`"],
    );
}

#[test]
fn wrong_arguments_are_status_2() {
    let bench = Bench::new();
    bench.write("c.toml", CREEP);
    bench.run("material").fails(2, &["CASE.toml"]);
    bench.run("material none.toml").fails(2, &["none.toml"]);
    bench.run("material c.toml -o c.png").fails(2, &["c.png", ".svg"]);
    bench.run("material c.toml --example").fails(2, &["--example"]);
    bench
        .run("material c.toml --json --rheometer d")
        .fails(2, &["--rheometer"]);
    bench.run("material c.toml -o none/c.svg").fails(2, &["none/c.svg"]);
    bench
        .run("tradeoff history --order 2")
        .fails(2, &["--order", "0 (a spring)"]);
    bench
        .run("tradeoff history --steps 5")
        .fails(2, &["--steps", "from 10"]);
}

#[test]
fn the_schema_names_every_key() {
    let schema = Bench::new().run("schema material").json();
    let keys = "law order modulus_kpa modulus_inf_kpa tau_s knee_shear stiffening memory rule history";
    for key in keys.split(' ') {
        assert!(schema["properties"][key].is_object(), "{key}");
    }
}

#[test]
fn rules_are_traded_off() {
    let bench = Bench::new();
    let report = bench.run("tradeoff history --steps 100 --quiet --json -o study").json();
    let rows = report["tables"]["history"]["rows"].as_array().unwrap();
    assert!(
        rows.len() == 13 && rows.iter().all(|row| row["flag"].is_null()),
        "{report}"
    );
    assert!(bench.files("study").contains(&"history-error-time.svg".to_owned()));
}
