//! What the other subcommands print.

use serde_json::{Value, json};

use crate::support::{Bench, SCENE, names};

#[test]
fn plans_list_passes_with_reasons() {
    let bench = Bench::new();
    bench.write("bare.toml", &format!("{SCENE}[effects]\nonly = []\n"));
    let bare = bench.run("plan bare.toml --json").json();
    assert_eq!(
        names(&bare["passes"]),
        ["geometry", "slice", "tone", "scan_conversion", "quantise"]
    );
    let without = names(&bare["without"]);
    for effect in [
        "contact",
        "warp",
        "texture",
        "speckle",
        "needle",
        "shadow",
        "compound",
        "blur",
        "receiver",
        "speckle_reduction",
        "noise",
    ] {
        assert!(without.contains(&effect), "{effect}: {without:?}");
    }
    assert_eq!(bare["passes"][0]["origin"], "needed by every frame");
    assert!(bare["passes"][0]["reason"].is_string() && bare["without"][0]["reason"].is_string());
    // Four numbers of four bytes for each of 64 samples on 32 scanlines; a byte for each of 48 x 40 pixels, in rows of
    // 256.
    let buffers = bare["resources"].as_array().expect("a list");
    let bytes = |name: &str| {
        buffers
            .iter()
            .find(|it| it["resource"] == name)
            .map(|it| it["bytes"].clone())
    };
    assert_eq!(
        (bytes("position"), bytes("pixels")),
        (Some(json!(32_768)), Some(json!(10_240)))
    );
    let all: u64 = buffers.iter().filter_map(|it| it["bytes"].as_u64()).sum();
    assert_eq!(bare["bytes"], all);
    let full = bench.run("plan scene.toml --json").json();
    assert!(full["bytes"].as_u64() > Some(all));
    assert_eq!(full["warnings"], json!([]));
    let table = bench.run("plan scene.toml");
    assert!(
        table.text().contains("speckle_scatter") && table.text().contains("bytes"),
        "{table:?}"
    );
}

#[test]
fn phantoms_are_written_and_described() {
    let bench = Bench::new();
    bench.run("phantom two-layer -o a.nrrd --resolution-mm 3").text();
    bench
        .run("phantom two-layer -o b.mha --resolution-mm 3 --seed 9")
        .text();
    let [a, b] = ["a.nrrd", "b.mha"].map(|name| bench.run(&format!("info {name} --json")).json());
    assert_eq!((&a["size"], &a["spacing_mm"]), (&b["size"], &b["spacing_mm"]));
    let size: u64 = a["size"]
        .as_array()
        .unwrap()
        .iter()
        .map(|n| n.as_u64().unwrap())
        .product();
    let voxels: u64 = a["labels"]
        .as_array()
        .unwrap()
        .iter()
        .map(|label| label["voxels"].as_u64().unwrap())
        .sum();
    assert_eq!(size, voxels);
    assert_eq!(a["spacing_mm"][0], 3.0);
    let inclusion = &a["labels"][2];
    assert_eq!(
        (&inclusion["value"], &inclusion["name"]),
        (&json!(2), &json!("phantom_inclusion"))
    );
    let millilitres = inclusion["voxels"].as_f64().unwrap() * 27.0 / 1000.0;
    assert!((inclusion["millilitres"].as_f64().unwrap() - millilitres).abs() < 1e-9);
    let table = bench.run("info a.nrrd");
    assert!(table.text().contains("phantom_inclusion"), "{table:?}");
}

#[test]
fn a_configuration_is_described() {
    let bench = Bench::new();
    bench.write(
        "plus.xml",
        "<PlusConfiguration><ScanConversion TransducerName='L12' TransducerGeometry='LINEAR' TransducerWidthMm='30' \
         ImagingDepthMm='25' OutputImageSizePixel='80 60' TransducerCenterPixel='40 2'/><CoordinateDefinitions>\
         <Transform From='Image' To='Probe' Matrix='0.1 0 0 5 0 0.1 0 0 0 0 0.1 0 0 0 0 1'/></CoordinateDefinitions></PlusConfiguration>",
    );
    let info = bench.run("info plus.xml --json").json();
    assert_eq!(
        (&info["probe"]["width_mm"], &info["image_size"]),
        (&json!(30.0), &json!([80, 60]))
    );
    assert_eq!(
        (&info["array_centre_px"], &info["warnings"]),
        (&json!([40.0, 2.0]), &json!([]))
    );
    assert_eq!(
        info["calibration"],
        json!({"to": "Probe", "lengths_mm": [0.1, 0.1, 0.1], "axes_apart_deg": 90.0})
    );
    assert_eq!(
        (&info["transforms"][0]["from"], &info["transforms"][0]["matrix"][0][3]),
        (&json!("Image"), &json!(5.0))
    );
    let text = bench.run("info plus.xml");
    assert!(
        text.text().contains("transducer   L12") && text.text().contains("ImageToProbe  5.000, 0.000, 0.000"),
        "{text:?}"
    );
    bench.write("other.xml", "ObjectType = Image\n");
    bench
        .run("info other.xml")
        .fails(2, &["other.xml", "expected a PLUS configuration (XML)"]);
}

#[test]
fn the_default_scene_can_be_edited_and_rendered() {
    let bench = Bench::new();
    let text = bench.run("scene").text().to_owned();
    assert!(text.contains("version = 2"));
    bench.write("mine.toml", &text);
    bench.run("plan mine.toml").text();
    let schema = bench.run("schema").json();
    assert!(schema["properties"]["volume"].is_object(), "{schema}");
    let sidecar = bench.run("schema sidecar").json();
    assert!(sidecar["properties"]["probe_to_world"].is_object(), "{sidecar}");
}

#[test]
fn every_scene_that_comes_along_is_printed() {
    let bench = Bench::new();
    for (name, text) in insonify_imaging::scene::EXAMPLES {
        assert_eq!(bench.run(&format!("scene {name}")).text().trim_end(), text.trim_end());
    }
}

#[test]
fn a_pixel_is_explained() {
    let bench = Bench::new();
    let report = bench.run("inspect scene.toml --at 24,10 --json").json();
    assert_eq!(report["pixel"], json!([24, 10]));
    let sample = &report["sample"];
    assert_eq!(sample["label"]["tissue"], "phantom_top");
    let number = |value: &Value| value.as_f64().unwrap_or_else(|| panic!("{value} in {report}"));
    let near = |value: f64, expected: f64| {
        assert!(
            (value - expected).abs() <= 1e-5 * expected.abs(),
            "{value}, not {expected}: {report}"
        );
    };
    // 64 samples down to 60 mm, each in the middle of its length; sound of 9 MHz goes there and back through 0.5
    // dB/cm/MHz, of which a pulse of 60 % bandwidth feels less.
    let depth_mm = (number(&sample["sample"]) + 0.5) * 60.0 / 64.0;
    near(number(&sample["depth_mm"]), depth_mm);
    let at_centre_db = 2.0 * 0.5 * 9.0 * depth_mm / 10.0;
    let unfelt_per_db = 10f64.ln() / 40.0 * (0.6 / (8.0 * 2f64.ln()).sqrt()).powi(2);
    let loss_db = at_centre_db - unfelt_per_db * at_centre_db * at_centre_db;
    near(number(&sample["shadow"]["loss_db"]), loss_db);
    near(number(&sample["shadow"]["transmittance"]), 10f64.powf(-loss_db / 20.0));
    // The echo of the label, then what each effect makes of it.
    let stage = |pass: &str| {
        let stages = sample["stages"].as_array().expect("a list");
        number(&stages.iter().find(|stage| stage["pass"] == pass).expect(pass)["value"])
    };
    let echo = 10f64.powf(number(&sample["label"]["echogenicity_db"]) / 20.0);
    near(stage("slice"), echo);
    let textured = echo * number(&sample["texture"]["value"]);
    near(stage("texture"), textured);
    near(stage("speckle_lateral"), textured * number(&sample["speckle"]));
    near(stage("shadow"), stage("speckle_lateral") * 10f64.powf(-loss_db / 20.0));
    // The pixel lies between four samples.
    let corners = report["sample"]["interpolation"].as_array().expect("a list");
    let sum = |of: &dyn Fn(&Value) -> f64| corners.iter().map(of).sum::<f64>();
    near(sum(&|corner| number(&corner["weight"])), 1.0);
    let grey = sum(&|corner| number(&corner["weight"]) * number(&corner["grey_level"]));
    assert!((grey - number(&report["grey_level"])).abs() <= 0.5, "{grey}: {report}");
    assert_eq!(report["warnings"], json!([]));
    bench.run("render scene.toml --backend cpu-f64").text();
    let (size, pixels) = crate::support::grey(&bench.path("frame.png"));
    assert_eq!(report["grey_level"], pixels[10 * size.0 as usize + 24]);
    let text = bench.run("inspect scene.toml --at 24,10");
    assert!(
        text.text().contains("phantom_top") && text.text().contains("transmittance"),
        "{text:?}"
    );
    bench.run("inspect scene.toml --at 48,0").fails(2, &["48,0", "48x40"]);
    bench
        .run("inspect scene.toml --at 1,1 --frame 1")
        .fails(2, &["--frame 1"]);
}

#[test]
fn a_benchmark_climbs_down_to_slicing() {
    let bench = Bench::new();
    let report = bench.run("bench scene.toml --backend cpu --frames 2 --json").json();
    let backend = &report["backends"][0];
    assert_eq!(backend["backend"], "cpu");
    let [median_ms, p95_ms, fps] = ["median_ms", "p95_ms", "fps"].map(|key| backend["frame"][key].as_f64().unwrap());
    assert!(0.0 < median_ms && median_ms <= p95_ms && (fps * median_ms / 1000.0 - 1.0).abs() < 1e-9);
    let plan = bench.run("plan scene.toml --json").json();
    assert_eq!(names(&backend["passes"]), names(&plan["passes"]));
    let ladder = backend["ladder"].as_array().unwrap();
    assert_eq!(ladder[0]["without"], json!(null));
    assert_eq!(ladder.last().unwrap()["passes"], 5);
    assert_eq!(report["warnings"], json!([]));
    let table = bench.run_without_gpu("bench scene.toml --frames 1");
    assert!(
        table.text().contains("all effects") && !table.text().contains("gpu"),
        "{table:?}"
    );
}

#[test]
fn the_doctor_says_what_would_be_used() {
    let bench = Bench::new();
    let healthy = bench.run("doctor --json").json();
    assert!(healthy["adapters"].is_array() && healthy["reason"].is_string());
    let cores = std::thread::available_parallelism().expect("cores").get();
    assert_eq!(healthy["machine"]["cores"], cores);
    if let Some(adapter) = healthy["adapters"].get(0) {
        let software = adapter["software"].as_bool().unwrap();
        assert_eq!(healthy["backend"], if software { "cpu" } else { "gpu" });
        assert!(adapter["limits"]["max_storage_buffer_binding_size"].as_u64().unwrap() >= 1 << 27);
    }
    let poor = bench.run_without_gpu("doctor --json").json();
    assert_eq!((&poor["backend"], &poor["adapter"]), (&json!("cpu"), &json!(null)));
    assert!(poor["hints"][0].as_str().unwrap().contains("mesa-vulkan-drivers"));
    assert!(
        bench
            .run_without_gpu("doctor")
            .text()
            .contains("no GPU adapter was found")
    );
}

#[test]
fn help_teaches_and_shells_complete() {
    let bench = Bench::new();
    let help = bench.run("--help");
    for word in ["render", "inspect", "doctor", "Examples:", "Exit status"] {
        assert!(help.text().contains(word), "{word}: {help:?}");
    }
    assert!(bench.run("render --help").text().contains("--layers"));
    assert!(bench.run("--version").text().contains(env!("CARGO_PKG_VERSION")));
    for group in [
        "Images",
        "Tissue and needles",
        "Tracking and training",
        "Studies",
        "Files and setup",
    ] {
        assert_eq!(help.text().matches(&format!("\n{group}:\n")).count(), 1, "{help:?}");
        for shell in ["zsh", "fish"] {
            // zsh escapes colons.
            let script = bench.run(&format!("completions {shell}")).text().replace('\\', "");
            assert!(script.contains(&format!("{group}: ")), "{shell}");
        }
    }
    assert!(bench.run("completions bash").text().contains("insonify"));
}
