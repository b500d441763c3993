//! Seeds and targets of an insertion: where they are in the anatomy at rest, with every model of tissue.

use serde_json::Value;

use crate::insert::BLOCK;
use crate::support::Bench;

const MODELS: [&str; 3] = ["finite-element", "nonlinear", "mass-spring"];

/// The block with a model of tissue and what else `[needle]` and the end of the file say.
fn block(model: &str, needle: &str, end: &str) -> String {
    let text = BLOCK.replace("length_mm = 100\n", &format!("length_mm = 100\n{needle}\n"));
    let text = match model {
        "mass-spring" => {
            let from = text.find("[tissue]").expect("tissue");
            let to = text.find("[needle]").expect("a needle");
            format!("{}[tissue]\nmodel = \"mass-spring\"\n{}", &text[..from], &text[to..])
        }
        _ => text.replace("[tissue]\n", &format!("[tissue]\nmodel = \"{model}\"\n")),
    };
    text + end
}

fn run(bench: &Bench, text: &str) -> Value {
    bench.write("seeds.toml", text);
    bench.run("insert seeds.toml -o out --json").json()
}

fn place(value: &Value) -> [f64; 3] {
    serde_json::from_value(value.clone()).expect("a place")
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum::<f64>().sqrt()
}

/// The first is left 2 mm above the skin.
#[test]
fn a_seed_in_the_air_is_no_seed_in_tissue() {
    for model in MODELS {
        let summary = run(&Bench::new(), &block(model, "deposit_s = [0.005, 0.4]", ""));
        let seeds = summary["seeds"].as_array().expect("seeds");
        assert_eq!(seeds.len(), 2);
        assert_eq!(seeds[0]["deposited_mm"], Value::Null, "{model}: {}", seeds[0]);
        assert!(place(&seeds[1]["deposited_mm"])[2] > -45.0, "{model}: {}", seeds[1]);
        let warnings = summary["warnings"].to_string();
        assert!(
            warnings.contains("1 of 2 seeds were left outside the tissue"),
            "{model}: {warnings}"
        );
    }
}

/// A target in the tissue at the tip is where the tip comes to, however the tissue gives way.
#[test]
fn targets_are_neared_in_the_anatomy_at_rest() {
    for model in MODELS {
        let bench = Bench::new();
        let needle = "deposit_s = [0.4]";
        let first = run(&bench, &block(model, needle, ""));
        let [left, at_rest] = ["left_at_mm", "deposited_mm"].map(|key| place(&first["seeds"][0][key]));
        assert!(
            distance(left, at_rest) > 0.05,
            "{model}: tissue gives way, {left:?} {at_rest:?}"
        );
        let target = format!("[[plan.target]]\nname = \"node\"\nat_mm = {at_rest:?}\n");
        let second = run(&bench, &block(model, needle, &target));
        let reached = &second["targets"][0];
        for key in ["nearest_tip_mm", "nearest_seed_mm"] {
            assert!(reached[key].as_f64().expect("mm") < 1e-9, "{model}: {reached}");
        }
    }
}

/// What a plan says is checked, whether a needle follows it or not.
#[test]
fn a_plan_without_needles_is_checked() {
    for (wrong, words) in [
        ("pause_s = 5000", ["plan.pause_s", "0.01 to 1000 s"]),
        ("pause_s = -1", ["plan.pause_s", "0.01 to 1000 s"]),
        ("start_s = nan", ["plan.start_s", "0 to 1e6 s"]),
        ("speed_mm_s = 0", ["plan.speed_mm_s", "above 0"]),
    ] {
        let bench = Bench::new();
        bench.write(
            "seeds.toml",
            &block("finite-element", "", &format!("[plan]\n{wrong}\n")),
        );
        let run = bench.run("insert seeds.toml -o out");
        run.fails(2, &[&words[..], &["seeds.toml, line 34"]].concat());
    }
}
