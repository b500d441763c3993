use super::MaterialReport;
use super::*;
use insonify_base::blame::Blame;
use insonify_base::document::InputError;

const CREEP: &str = "\
law = \"zener\"
order = 0.5
modulus_kpa = 3.0
modulus_inf_kpa = 1.0
tau_s = 0.7
knee_shear = 0.3
stiffening = 5.0
memory = \"load-integral\"
rule = \"trapezoid\"
[history]
control = \"stress\"
time_s = [0, 1, 2.5]
value = [0.5, 0.5, -0.5]
";

fn run(text: &str) -> Result<MaterialReport, InputError> {
    CaseFile::parse(text, "c.toml")?.resolve()?.run()
}

/// Checks that the case is refused with this key, line and words.
fn refused(text: &str, key: &str, line: usize, words: &[&str]) {
    let error = run(text).unwrap_err();
    assert_eq!(
        (error.key(), error.location()),
        (Some(key), Some(("c.toml", line))),
        "{error}"
    );
    let message = error.to_string();
    assert!(words.iter().all(|word| message.contains(word)), "{message}");
    assert!(!error.is_machine());
}

#[test]
fn a_case_runs_and_its_example_does() {
    let report = run(CREEP).unwrap();
    assert_eq!(report.time_s, [0.0, 1.0, 2.5]);
    assert_eq!(report.stress_kpa, [Some(0.5), Some(0.5), Some(-0.5)]);
    // The start is elastic, below the knee.
    assert!((report.strain[0] - 0.125).abs() < 1e-15 && report.strain[1] > 0.125);
    assert!(report.warnings().is_empty());
    let json = serde_json::to_value(&report).unwrap();
    let keys: Vec<&String> = json.as_object().unwrap().keys().collect();
    assert_eq!(keys, ["strain", "stress_kpa", "time_s"]);
    assert!(run(EXAMPLE).unwrap().warnings().is_empty());
}

#[test]
fn numbers_and_keys_are_checked() {
    refused(
        &CREEP.replace("order = 0.5", "order = 1.5"),
        "order",
        2,
        &["1.5", "0 (a spring) to 1"],
    );
    refused(&CREEP.replace("= 3.0", "= 0"), "modulus_kpa", 3, &["above 0"]);
    refused(&CREEP.replace("= 1.0", "= -1"), "modulus_inf_kpa", 4, &["0 or more"]);
    refused(&CREEP.replace("0.7", "nan"), "tau_s", 5, &["NaN"]);
    refused(&CREEP.replace("0.3", "-0.3"), "knee_shear", 6, &["-0.3"]);
    refused(&CREEP.replace("= 5.0", "= inf"), "stiffening", 7, &["finite"]);
    refused(
        &CREEP.replace("2.5]", "0.5]"),
        "history.time_s[2]",
        12,
        &["after the one before"],
    );
    refused(&CREEP.replace("-0.5]", "inf]"), "history.value[2]", 13, &["finite"]);
    refused(
        &CREEP.replace("0.5, -0.5]", "0.5]"),
        "history.value",
        13,
        &["2 values at 3 times"],
    );
    refused(
        &CREEP.replace("stiffening = 5.0\n", ""),
        "knee_shear",
        6,
        &["without `stiffening`"],
    );
    refused(
        &CREEP.replace("knee_shear = 0.3\n", ""),
        "stiffening",
        6,
        &["without `knee_shear`"],
    );
    refused(&CREEP.replace("tau_s = 0.7\n", ""), "law", 1, &["without `tau_s`"]);
    refused(
        &CREEP.replace("zener", "spring-pot"),
        "modulus_inf_kpa",
        4,
        &["spring-pot", "zener"],
    );
    let uneven = CREEP.replace("trapezoid", "gruenwald-letnikov");
    refused(&uneven, "history.time_s[2]", 12, &["equally far apart"]);
    let huge = CREEP
        .replace("\"stress\"", "\"strain\"")
        .replace("[0.5, 0.5", "[1e300, 0.5");
    refused(&huge, "history.value", 13, &["no finite number"]);
}

#[test]
fn an_infinite_stress_is_null_and_told() {
    let text = "law = \"spring-pot\"\norder = 0.1\nmodulus_kpa = 1\n[history]\ncontrol = \"strain\"\ntime_s = [0, 1]\nvalue = [1, 1]\n";
    let report = run(text).unwrap();
    assert_eq!(report.stress_kpa[0], None);
    assert!((report.stress_kpa[1].unwrap() * libm::tgamma(0.9) - 1.0).abs() < 1e-9);
    assert!(report.warnings()[0].contains("infinite"));
    assert!(report.to_string().contains("infinite"));
    assert_eq!(report.plot().series[0].points.len(), 1);
}

#[test]
fn a_rheometer_finds_what_the_law_says() {
    let case = CaseFile::parse(EXAMPLE, "e.toml").unwrap().resolve().unwrap();
    let rheometer = case.rheometer().unwrap();
    // Figure 7: both moduli rise as the frequency to the order.
    for slope in rheometer.slopes() {
        assert!((slope - 0.1).abs() < 1e-4, "{slope}");
    }
    assert!(rheometer.dynamic_error() < 1e-4);
    // Figure 8: flat up to the knee, the law above it; equation 2 applies the current stiffness to the entire past.
    for point in &rheometer.stiffness {
        let deviation = point.shown_kpa / point.law_kpa - 1.0;
        match point.structure {
            _ if point.strain < 0.35 => assert!(deviation.abs() < 1e-6, "{point:?}"),
            insonify_mechanics::tissue::viscoelastic::point::Structure::LoadIntegral => {
                assert!(deviation.abs() < 1e-6, "{point:?}");
            }
            insonify_mechanics::tissue::viscoelastic::point::Structure::Rate => {
                assert!(deviation < 0.0 && deviation > -0.02, "{point:?}");
            }
        }
    }
    assert_eq!(rheometer.plots().len(), 3);
}
