//! Frames against real frames.

use image::{GrayImage, Luma, Rgb, RgbImage};
use serde_json::Value;

use crate::support::Bench;

/// A grey level of a linear sector of 160 x 120 pixels in a black frame of 200 x 150: coarse speckle about a mean.
fn grey(x: u32, y: u32, mean: u32, seed: u32) -> u8 {
    if !(20..180).contains(&x) || !(15..135).contains(&y) {
        return 0;
    }
    let mut word = (x / 2).wrapping_mul(0x9e37_79b9) ^ y.wrapping_mul(0x85eb_ca6b) ^ seed.wrapping_mul(0xc2b2_ae35);
    word = (word ^ word >> 15).wrapping_mul(0x2c1b_3c6d);
    word = (word ^ word >> 12).wrapping_mul(0x297a_2d39);
    (mean + (word ^ word >> 15) % 41 - 20) as u8
}

fn frame(mean: u32, seed: u32) -> GrayImage {
    GrayImage::from_fn(200, 150, |x, y| Luma([grey(x, y, mean, seed)]))
}

fn bench() -> Bench {
    let bench = Bench::new();
    std::fs::create_dir(bench.path("real")).expect("a folder");
    for (name, mean) in [
        ("a.png", 80),
        ("real/b.png", 82),
        ("real/c.png", 92),
        ("real/d.png", 90),
    ] {
        frame(mean, mean).save(bench.path(name)).expect("written");
    }
    bench
}

fn measure<'a>(report: &'a Value, key: &str) -> &'a Value {
    let rows = report["measures"].as_array().expect("measures");
    rows.iter().find(|row| row["key"] == key).expect("the measure")
}

#[test]
fn folders_files_and_pixel_sizes_are_read() {
    let bench = bench();
    let report = bench
        .run("realism a.png --against real --json --real-mm-per-pixel 0.2")
        .json();
    let mean = measure(&report, "grey_mean");
    let near = |value: &Value, expected: f64| (value.as_f64().expect("a number") - expected).abs() < 1.0;
    assert!(
        near(&mean["frames"]["mean"], 80.0) && near(&mean["real"]["mean"], 88.0),
        "{mean}"
    );
    // Real means of 82, 92 and 90 have a standard deviation of 5.29.
    assert!(
        (mean["difference"].as_f64().expect("known") + 8.0 / 5.29).abs() < 0.2,
        "{mean}"
    );
    assert_eq!(mean["verdict"], "inside");
    let width = measure(&report, "fwhm_lateral_mm");
    assert!(width["frames"].is_null() && width["real"]["mean"].is_f64(), "{width}");
    assert!(
        report["notes"][0].as_str().expect("a note").contains("a.png"),
        "{report}"
    );

    // A sidecar states the size of a pixel, and goes before the option; layers in a folder are no frames.
    std::fs::write(bench.path("real/b.json"), r#"{ "image": { "pixel_mm": 0.1 } }"#).expect("written");
    frame(30, 1).save(bench.path("real/b_depth.png")).expect("written");
    let report = bench
        .run("realism real --against real --json --mm-per-pixel 0.3")
        .json();
    let groups = report["groups"].as_array().expect("groups");
    let sizes: Vec<&Value> = groups.iter().map(|it| &it["frames"][0]["mm_per_pixel"][0]).collect();
    assert_eq!(sizes, [0.1, 0.3, 0.3]);
    assert!(groups[1]["real"][0]["mm_per_pixel"].is_null());
    for row in groups
        .iter()
        .flat_map(|group| group["measures"].as_array().expect("measures"))
    {
        let mean = |side: &str| row[side]["mean"].as_f64();
        let same = mean("frames")
            .zip(mean("real"))
            .is_none_or(|(frames, real)| frames == real);
        assert!(row["difference"].is_null() && same, "{row}");
    }
}

#[test]
fn colour_is_read_as_luminance_and_sequences_frame_by_frame() {
    let bench = bench();
    // Luminance of a grey pixel is its grey level; a red ruler beside the sector is no part of it.
    let tinted = RgbImage::from_fn(200, 150, |x, y| {
        if x > 182 {
            Rgb([220, (y * 40 % 256) as u8 / 8, 0])
        } else {
            Rgb([grey(x, y, 80, 80); 3])
        }
    });
    tinted.save(bench.path("rgb.png")).expect("written");
    let [plain, rgb] =
        ["a.png", "rgb.png"].map(|name| bench.run(&format!("realism {name} --against real --json")).json());
    for key in ["grey_mean", "sector_p95", "lag1_lateral"] {
        assert_eq!(measure(&plain, key)["frames"], measure(&rgb, key)["frames"], "{key}");
    }
    let mut text = "NDims = 3\nDimSize = 200 150 4\nElementSpacing = 0.2 0.1 1\nElementType = MET_UCHAR\n\
        UltrasoundImageOrientation = MF\nElementDataFile = LOCAL\n"
        .as_bytes()
        .to_vec();
    (0..4).for_each(|n| text.extend(frame(80 + n, n).into_raw()));
    std::fs::write(bench.path("clip.igs.mha"), &text).expect("written");
    let report = bench
        .run("realism clip.igs.mha --against real --frames 2 --json")
        .json();
    let frames = report["frames"].as_array().expect("frames");
    let name = |n: usize| frames[n]["name"].as_str().expect("a name");
    assert!(
        frames.len() == 2 && name(0).ends_with("frame 0") && name(1).ends_with("frame 3"),
        "{frames:?}"
    );
    assert_eq!(frames[0]["mm_per_pixel"], serde_json::json!([0.1, 0.2]));
    let still = measure(&report, "frame_correlation_uniform")["frames"]["mean"]
        .as_f64()
        .expect("known");
    assert!(still.abs() < 0.1, "{still}");
}

#[test]
fn frames_of_this_program_are_measured_and_shown() {
    let bench = bench();
    bench
        .run("render scene.toml --size 240x200 --backend cpu --sidecar -o own.png")
        .text();
    let run = bench.run("realism own.png --against real --real-mm-per-pixel 0.2 -o page.html");
    assert!(
        run.text().contains("autocorrelation FWHM, lateral, mm") && run.text().contains("inside"),
        "{run:?}"
    );
    let page = bench.text("page.html");
    assert!(page.contains("own.png") && page.ends_with("</body></html>\n"));
    // The same again, byte for byte.
    bench
        .run("realism own.png --against real --real-mm-per-pixel 0.2 -o again.html")
        .text();
    assert_eq!(page, bench.text("again.html"));
}

#[test]
fn what_is_no_frame_is_refused() {
    let bench = bench();
    bench.write("broken.png", "no picture");
    let whole = std::fs::read(bench.path("a.png")).expect("a picture");
    std::fs::write(bench.path("cut.png"), &whole[..whole.len() / 2]).expect("written");
    std::fs::write(bench.path("us.dcm"), [&[0; 128][..], b"DICM"].concat()).expect("written");
    GrayImage::from_pixel(80, 80, Luma([9]))
        .save(bench.path("flat.png"))
        .expect("written");
    GrayImage::from_fn(40, 60, |x, y| Luma([(x * 37 + y * 91) as u8]))
        .save(bench.path("small.png"))
        .expect("written");
    std::fs::create_dir(bench.path("none")).expect("a folder");
    for (arguments, words) in [
        ("realism --against real", &["FRAMES"][..]),
        ("realism a.png", &["--against"]),
        (
            "realism none --against real",
            &["none, folder", "no PNG, JPEG or DICOM file"],
        ),
        ("realism nowhere.png --against real", &["nowhere.png", "cannot be read"]),
        (
            "realism broken.png --against real",
            &["broken.png", "a PNG or JPEG file, grey or RGB"],
        ),
        ("realism a.png --against cut.png", &["cut.png", "a PNG or JPEG file"]),
        ("realism us.dcm --against real", &["us.dcm", "a DICOM file with images"]),
        ("realism flat.png --against real", &["flat.png", "no sector"]),
        (
            "realism small.png --against real",
            &["small.png", "40 x 60 pixels", "at least 49 x 49"],
        ),
        ("realism scene.toml --against real", &["scene.toml"]),
        ("realism a.png --against real -o page.pdf", &[".html"]),
        ("realism a.png --against real --mm-per-pixel 0", &["0.001 to 10 mm"]),
        ("realism a.png --against real --frames 0", &["--frames"]),
    ] {
        bench.run(&format!("{arguments} --json")).fails(2, words);
    }
    bench
        .run("realism flat.png --against real -o page.html")
        .fails(2, &["no sector"]);
    assert!(!bench.path("page.html").exists());
}
