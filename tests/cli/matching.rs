//! Probe and effects from a real frame.

use image::{GrayImage, Luma, Rgb, RgbImage};
use insonify::SceneFile;
use serde_json::json;

use crate::support::Bench;

/// A uniform tissue under a linear probe, as a frame of another scanner would show it.
fn bench() -> Bench {
    let bench = Bench::new();
    bench.write(
        "real.toml",
        r#"
version = 2
volume = { phantom = "two-layer", resolution_mm = 3 }
[probe]
kind = "linear"
width_mm = 38
depth_mm = 40
lines = 96
samples = 192
[image]
width = 160
height = 160
[effects]
only = ["speckle", "tone"]
slice.beyond = "void"
tone.auto_gain = 0
"#,
    );
    bench.run("render real.toml --backend cpu --sidecar -o real.png").text();
    bench
}

#[test]
fn a_scene_is_written_that_can_be_rendered() {
    let bench = bench();
    let scene = bench.run("match real.png").text().to_owned();
    assert!(
        scene.contains("[effects.tone]") && scene.contains("# - frequency: "),
        "{scene}"
    );
    let run = bench.run("match real.png -o matched.toml --page page.html");
    assert!(run.text().contains("dynamic_range_db"), "{run:?}");
    assert_eq!(scene, bench.text("matched.toml"));
    let page = bench.text("page.html");
    assert!(page.contains("Autocorrelation across") && page.ends_with("</body></html>\n"));
    bench.run("render matched.toml --backend cpu -o ours.png").text();
    let set = "--set probe.frequency_mhz=5.5 --set volume.resolution_mm=2 --gain-db -7";
    let report = bench.run(&format!("match real.png --json --depth-mm 80 {set}")).json();
    let scene: SceneFile = toml::from_str(report["scene"].as_str().expect("a scene")).expect("TOML");
    let [probe, volume, effects] = [
        serde_json::to_value(&scene.probe),
        serde_json::to_value(&scene.volume),
        serde_json::to_value(&scene.effects),
    ]
    .map(|table| table.expect("JSON"));
    assert_eq!(
        (&probe["frequency_mhz"], &probe["depth_mm"]),
        (&json!(5.5), &json!(80.0))
    );
    assert_eq!(volume["resolution_mm"], json!(2.0));
    assert_eq!(effects["tone"]["gain_db"], json!(-7.0));
    bench
        .run("match real.png --set efects.tone.gain_db=1")
        .fails(2, &["unknown key `efects` (--set efects.tone.gain_db=1)"]);
    // Twice the depth, twice the width.
    let width = report["figures"][0]["value"].as_f64().expect("a width");
    assert!((width / 76.0 - 1.0).abs() < 0.03, "{width}");
    assert!(report["unidentified"].as_array().expect("a list").len() > 4);
}

#[test]
fn overlays_count_for_nothing() {
    let bench = bench();
    let grey = image::open(bench.path("real.png")).expect("a frame").into_luma8();
    let marked = RgbImage::from_fn(160, 160, |x, y| {
        if (x / 6 + y / 6) % 9 == 0 && x > 130 {
            Rgb([0, 255, 40])
        } else {
            Rgb([grey.get_pixel(x, y)[0]; 3])
        }
    });
    marked.save(bench.path("marked.png")).expect("written");
    let [plain, marked] = ["real.png --mm-per-pixel 0.25", "marked.png --mm-per-pixel 0.25"].map(|name| {
        bench.run(&format!("match {name} --json")).json()["figures"][0]["value"]
            .as_f64()
            .expect("a width")
    });
    assert!((plain / marked - 1.0).abs() < 0.02, "{plain} {marked}");
}

#[test]
fn what_cannot_be_matched_is_refused() {
    let bench = bench();
    let grain =
        |x: u32, y: u32| (x.wrapping_mul(0x9e37_79b9) ^ y.wrapping_mul(0x85eb_ca6b)).wrapping_mul(0x2c1b_3c6d) >> 27;
    let save = |name: &str, width: u32, height: u32, grey: &dyn Fn(u32, u32) -> u32| {
        let frame = GrayImage::from_fn(width, height, |x, y| Luma([grey(x, y) as u8]));
        frame.save(bench.path(name)).expect("written");
    };
    save("flat.png", 90, 90, &|_, _| 9);
    save("small.png", 40, 60, &|x, y| grain(x, y) + 80);
    save("dark.png", 160, 160, &|x, y| grain(x, y) / 8);
    // A fan whose array is at the bottom.
    save("fan.png", 240, 240, &|x, y| {
        let (across, up) = (f64::from(x) - 120.0, 230.0 - f64::from(y));
        let inside = (60.0..220.0).contains(&across.hypot(up)) && across.abs() < 0.5 * up;
        u32::from(inside) * (grain(x, y) + 80)
    });
    std::fs::create_dir(bench.path("folder")).expect("a folder");
    std::fs::copy(bench.path("real.png"), bench.path("bare.png")).expect("copied");
    for (arguments, words) in [
        ("match", &["REAL"][..]),
        ("match nowhere.png", &["nowhere.png", "cannot be read"]),
        ("match folder", &["folder", "one frame"]),
        ("match flat.png --mm-per-pixel 0.2", &["flat.png", "no sector"]),
        (
            "match small.png --mm-per-pixel 0.2",
            &["small.png", "40 x 60 pixels", "at least 49 x 49"],
        ),
        (
            "match dark.png --mm-per-pixel 0.2",
            &["dark.png", "no window of speckle", "48 scanlines by 40 samples"],
        ),
        (
            "match bare.png",
            &["bare.png", "--mm-per-pixel", "--depth-mm", "sidecar"],
        ),
        (
            "match bare.png --mm-per-pixel 9",
            &["bare.png", "width_mm", "the size of a pixel"],
        ),
        ("match bare.png --depth-mm 0", &["1 to 1000 mm"]),
        (
            "match bare.png --depth-mm 50 --mm-per-pixel 0.2",
            &["cannot be used with"],
        ),
        ("match real.png -o matched.json", &[".toml"]),
        ("match real.png --page page.pdf", &[".html"]),
        ("match scene.toml", &["scene.toml"]),
    ] {
        bench.run(&format!("{arguments} --json")).fails(2, words);
    }
    bench
        .run("match bare.png -o matched.toml --page page.html")
        .fails(2, &["--depth-mm"]);
    assert!(!bench.path("matched.toml").exists() && !bench.path("page.html").exists());
}
