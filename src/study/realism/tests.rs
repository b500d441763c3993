use std::f64::consts::{LN_2, PI, TAU};

use super::texture::RANGE_DB;
use super::*;
use insonify_base::random::{hash3, unit};

/// Two independent normal deviates per position (G. E. P. Box and M. E. Muller 1958).
fn normal(x: usize, y: usize, seed: u32) -> [f64; 2] {
    let [a, b, _] = hash3([x as i32, y as i32, 7], [seed, 11]).map(|word| f64::from(unit(word)));
    let radius = (-2.0 * (1.0 - a).ln()).sqrt();
    [radius * (TAU * b).cos(), radius * (TAU * b).sin()]
}

/// Normal deviates of variance 1, filtered by a Gaussian kernel of standard deviations `sigma` (across, down; 0: none).
fn blurred(width: usize, height: usize, sigma: [f64; 2], seed: u32) -> [Vec<f64>; 2] {
    let kernel = |sigma: f64| -> Vec<f64> {
        let reach = (4.0 * sigma).ceil() as i32;
        let weight = |n: i32| {
            if sigma > 0.0 {
                (-0.5 * (f64::from(n) / sigma).powi(2)).exp()
            } else {
                1.0
            }
        };
        let weights: Vec<f64> = (-reach..=reach).map(weight).collect();
        let power = weights.iter().map(|w| w * w).sum::<f64>().sqrt();
        weights.iter().map(|w| w / power).collect()
    };
    let [across, down] = sigma.map(kernel);
    [0, 1].map(|component| {
        let rows: Vec<f64> = (0..height + down.len() - 1)
            .flat_map(|y| (0..width).map(move |x| (x, y)))
            .map(|(x, y)| {
                across
                    .iter()
                    .enumerate()
                    .map(|(n, w)| w * normal(x + n, y, seed)[component])
                    .sum()
            })
            .collect();
        let columns = |pixel: usize| down.iter().enumerate().map(|(n, w)| w * rows[pixel + n * width]).sum();
        (0..width * height).map(columns).collect()
    })
}

/// Log-compressed Rayleigh speckle of a Gaussian point spread.
fn speckle(width: usize, height: usize, sigma: [f64; 2], seed: u32) -> Vec<f64> {
    let [re, im] = blurred(width, height, sigma, seed);
    let grey = |(re, im): (&f64, &f64)| 150.0 + 20.0 * re.hypot(*im).log10() * 255.0 / RANGE_DB;
    re.iter().zip(&im).map(grey).collect()
}

fn patch(width: usize, height: usize, values: Vec<f64>) -> Patch {
    Patch { width, height, values }
}

fn picture(width: usize, height: usize, grey: impl Fn(usize, usize) -> f64) -> Picture {
    let places = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    Picture {
        name: "a.png".to_owned(),
        group: "liver".to_owned(),
        width,
        height,
        grey: places.map(|(x, y)| grey(x, y).round().clamp(0.0, 255.0)).collect(),
        overlay: Vec::new(),
        mm: Some([0.5; 2]),
        neighbour: None,
    }
}

/// Linear sector of even texture, with a margin of constant black.
fn even(mean: f64, seed: u32) -> Picture {
    let noise = blurred(200, 160, [2.0, 1.0], seed);
    picture(200, 160, |x, y| {
        if (10..190).contains(&x) && (8..150).contains(&y) {
            mean + 12.0 * noise[0][y * 200 + x]
        } else {
            0.0
        }
    })
}

fn near(what: &str, value: f64, expected: f64, tolerance: f64) {
    assert!(
        (value - expected).abs() <= tolerance,
        "{what}: {value}, not {expected} +- {tolerance}"
    );
}

#[test]
fn rayleigh_speckle_has_its_moments_and_widths() {
    let (side, sigma) = (128, [3.0, 1.5]);
    let textures: Vec<Texture> = (0..8)
        .map(|seed| patch(side, side, speckle(side, side, sigma, seed)).texture())
        .collect();
    let average = |measure: &dyn Fn(&Texture) -> f64| mean(&textures.iter().map(measure).collect::<Vec<f64>>());
    // A speckle cell has 4 pi sigma sigma pixels, so there are 8 * 128^2 / 56 = 2300: the standard error of the first
    // is 0.028.
    near(
        "SNR before log",
        average(&|g| g.snr_linear),
        (PI / (4.0 - PI)).sqrt(),
        0.06,
    );
    near("Nakagami m", average(&|g| g.nakagami), 1.0, 0.06);
    near("log std, dB", average(&|g| g.std) * RANGE_DB / 255.0, 5.57, 0.15);
    near("log skewness", average(&|g| g.skewness), -1.14, 0.1);
    // The correlation of log intensity is Li2(rho^2) / Li2(1), where rho = exp(-lag^2 / (4 sigma^2)) is that of the
    // field.
    let li2 = |x: f64| (1..400).map(|k| x.powi(k) / f64::from(k * k)).sum::<f64>();
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if li2(middle) < PI * PI / 12.0 {
            low = middle
        } else {
            high = middle
        }
    }
    for (axis, sigma) in [(0, sigma[1]), (1, sigma[0])] {
        let width = 2.0 * sigma * (-2.0 * f64::ln(low)).sqrt();
        // Linear interpolation of a convex curve overestimates by a few hundredths of a pixel.
        near(
            "FWHM",
            average(&|g| g.fwhm[axis].expect("a width")),
            width,
            0.04 * width,
        );
        let lag1 = li2((-0.5 / (sigma * sigma)).exp()) * 6.0 / (PI * PI);
        near("lag-1", average(&|g| g.autocorrelation[axis][1]), lag1, 0.02);
    }
}

#[test]
fn white_noise_is_uncorrelated_and_flat() {
    let texture = patch(
        160,
        160,
        blurred(160, 160, [0.0; 2], 5)[0]
            .iter()
            .map(|n| 100.0 + 10.0 * n)
            .collect(),
    )
    .texture();
    // The standard error of a correlation of 160^2 pairs is 1/160.
    for axis in [0, 1] {
        near("lag-1", texture.autocorrelation[axis][1], 0.0, 4.0 / 160.0);
        near("GLCM correlation", texture.correlation[axis], 0.0, 4.0 / 160.0);
        near("FWHM", texture.fwhm[axis].expect("a width"), 1.0, 0.05);
        // Differences of levels of 6/32 deviations have the variance 2 (32/6)^2, and each is rounded.
        near(
            "GLCM contrast",
            texture.contrast[axis],
            2.0 * (32.0f64 / 6.0).powi(2) + 1.0 / 6.0,
            1.5,
        );
    }
    for slope in texture.slopes {
        near("slope", slope, 0.0, 0.15);
    }
    near("std", texture.std, 10.0, 0.2);
    near("skewness", texture.skewness, 0.0, 0.07);
    near("SNR after log", texture.snr_log, 10.0, 0.2);
    // Before log compression, amplitudes are log-normal with this standard deviation of their natural logarithm.
    let s = 10.0 * RANGE_DB / 255.0 / 20.0 * 10f64.ln();
    near("SNR before log", texture.snr_linear, 1.0 / (s * s).exp_m1().sqrt(), 0.1);
    near("Nakagami m", texture.nakagami, 1.0 / (4.0 * s * s).exp_m1(), 0.12);
}

#[test]
fn blurred_noise_has_the_correlation_of_its_kernel() {
    let (sigma, side) = ([2.5, 1.2], 192);
    let texture = patch(side, side, blurred(side, side, sigma, 3)[0].clone()).texture();
    for (axis, sigma) in [(0, sigma[1]), (1, sigma[0])] {
        near(
            "lag-1",
            texture.autocorrelation[axis][1],
            (-0.25 / (sigma * sigma)).exp(),
            0.02,
        );
        let width = 4.0 * sigma * LN_2.sqrt();
        near("FWHM", texture.fwhm[axis].expect("a width"), width, 0.06 * width);
    }
    // The power along an axis is that of the kernel, exp(-(2 pi f sigma)^2); the Hann window prevents leakage.
    let frequencies: Vec<f64> = (1..side).map(|n| n as f64 / side as f64).collect();
    let inside = frequencies.iter().filter(|f| (0.04..0.35).contains(*f));
    let (x, y): (Vec<f64>, Vec<f64>) = inside
        .map(|f| (f.log10(), -(TAU * f * sigma[1]).powi(2) / 10f64.ln()))
        .unzip();
    near(
        "slope",
        texture.slopes[0],
        insonify_base::statistics::slope(&x, &y),
        0.15,
    );
    assert!(texture.slopes[1] < texture.slopes[0] - 1.0, "{:?}", texture.slopes);
}

#[test]
fn a_ramp_is_trend_and_no_texture() {
    let ramp = patch(
        48,
        48,
        (0..48 * 48)
            .map(|pixel| 60.0 + (pixel % 48) as f64 + 0.02 * ((pixel / 48) as f64).powi(2))
            .collect(),
    );
    let detrended = ramp.detrended();
    assert!(std(&detrended.values) < 1e-9, "{}", std(&detrended.values));
    near("mean", mean(&detrended.values), mean(&ramp.values), 1e-9);
    // A ramp along depth is a trend; across, blocks of 8 columns differ by 8 grey levels: spread of 0, 8, ..., 40.
    let across = patch(48, 48, (0..48 * 48).map(|pixel| (pixel % 48) as f64).collect());
    let down = patch(48, 48, (0..48 * 48).map(|pixel| (pixel / 48) as f64).collect());
    near("down", down.block_spread_db(6), 0.0, 1e-9);
    let six: Vec<f64> = (0..36).map(|n| f64::from(n % 6) * 8.0 * RANGE_DB / 255.0).collect();
    near("across", across.block_spread_db(6), std(&six), 1e-9);
}

#[test]
fn the_sector_is_the_largest_varying_region_without_overlay() {
    let within = |x: usize, y: usize| (x as f64 - 100.0).hypot(y as f64 - 80.0) < 60.0;
    let hole = |x: usize, y: usize| (90..110).contains(&x) && (70..90).contains(&y);
    let mut frame = picture(200, 160, |x, y| match (within(x, y), hole(x, y), x < 30 && y < 20) {
        (true, true, _) => 1.0,
        (true, false, _) => 90.0 + 30.0 * normal(x, y, 1)[0],
        (_, _, true) => 255.0 * f64::from((x / 2 % 2) as u8),
        _ => 7.0,
    });
    let mask = sector::sector(&frame).expect("a sector");
    let is_inside = |x: usize, y: usize| mask[y * 200 + x];
    for (y, x) in (0..160).flat_map(|y| (0..200).map(move |x| (y, x))) {
        let distance = (x as f64 - 100.0).hypot(y as f64 - 80.0);
        assert!(
            is_inside(x, y) == within(x, y) || (distance - 60.0).abs() < 2.5,
            "({x}, {y})"
        );
    }
    // Coloured pixels across the middle divide it.
    frame.overlay = (0..frame.grey.len())
        .map(|pixel| (60..70).contains(&(pixel / 200)))
        .collect();
    let upper = sector::sector(&frame).expect("a sector");
    assert!(!upper[65 * 200 + 60] && !upper[40 * 200 + 100] && upper[110 * 200 + 100]);
    let constant = picture(200, 160, |_, _| 9.0);
    assert_eq!(sector::sector(&constant), None);
}

#[test]
fn emptiness_below_the_array_is_counted() {
    // Curved array of 60 mm radius and 60 degrees, 50 mm deep, at 0.5 mm per pixel; left of the first angle the first 4
    // mm are empty, left of the second a stand-off of 2.5 mm lies below a line of 1 mm.
    let frame = |empty_deg: f64, standoff_deg: f64| {
        picture(240, 140, |x, y| {
            let (dx, dy) = (0.5 * (x as f64 - 120.0), 0.5 * y as f64 + 52.0 - 5.0);
            let (radius, angle) = (dx.hypot(dy), dx.atan2(dy).to_degrees());
            let nearest_mm = if angle < empty_deg { 64.0 } else { 60.0 };
            let noise = normal(x, y, 2)[0];
            if angle.abs() >= 30.0 || !(nearest_mm..110.0).contains(&radius) {
                0.0
            } else if angle < standoff_deg && (61.0..63.5).contains(&radius) {
                0.5 + noise
            } else {
                90.0 + 20.0 * noise
            }
        })
    };
    let none = -30.0;
    for (empty_deg, standoff_deg, expected) in [
        (none, none, Some(0.0)),
        (-12.0, none, Some(0.3 * 0.8)),
        (none, -12.0, Some(0.3 * 0.5)),
        (none, 12.0, None),
        (none, 30.0, None),
    ] {
        let frame = frame(empty_deg, standoff_deg);
        let mask = sector::sector(&frame).expect("a sector");
        let share = sector::empty_share(&frame, &mask, 5.0);
        assert_eq!(share.is_some(), expected.is_some(), "{standoff_deg}: {share:?}");
        near("empty share", share.unwrap_or(0.0), expected.unwrap_or(0.0), 0.06);
        assert_eq!(sector::empty_share(&Picture { mm: None, ..frame }, &mask, 5.0), None);
    }
}

/// Real frames whose array is in view, and those with a dark stand-off or cut by the picture.
#[test]
fn contact_of_real_frames_is_known_where_the_array_is_in_view() {
    let Some(folder) = insonify_testing::shared("real/frames") else {
        return;
    };
    for (name, is_known) in [
        ("carotid_long_03", true),
        ("epigastrium_pancreas_01", true),
        ("muscle_gl_01", true),
        ("muscle_gm_02", true),
        ("gallbladder_01", false),
        ("liver_kidney_01", false),
        ("lung_linear_01", false),
        ("spine_lumbar_01", false),
    ] {
        let frames = picture::read(&[folder.join(format!("{name}.png"))], 1, None).expect("a frame");
        let parts = FrameMeasurements::of(&frames[0]).expect("parts");
        assert_eq!(parts.empty.is_some(), is_known, "{name}: {:?}", parts.empty);
        assert!(parts.empty.is_none_or(|share| share < 0.1), "{name}: {:?}", parts.empty);
    }
}

#[test]
fn the_far_edge_of_a_dark_region_has_its_width() {
    // In the last case, half the mean of the sector, where the boundary is found, lies above a tenth of the rise.
    for (sigma, beyond, elsewhere) in [(1.5, 120.0, 120.0), (3.0, 120.0, 120.0), (2.0, 240.0, 60.0)] {
        // Dark from row 60 to the boundary at row 120, which a Gaussian blurs: 10 to 90 % over 2.563 standard
        // deviations.
        let rise = |y: f64| 0.5 * (1.0 + libm::erf((y - 120.0) / (sigma * 2f64.sqrt())));
        let frame = picture(200, 200, |x, y| {
            let dark = (60..150).contains(&y) && (50..150).contains(&x);
            let level = if dark {
                20.0 + (beyond - 20.0) * rise(y as f64)
            } else {
                elsewhere
            };
            level + 3.0 * normal(x, y, 4)[0]
        });
        let mask = sector::sector(&frame).expect("a sector");
        let edge = sector::edge(&frame, &mask).expect("an edge");
        near("10-90 %", edge.width, 2.563 * sigma, 0.1 * 2.563 * sigma);
        assert!(edge.jaggedness.expect("neighbours") < 0.15);
    }
    // Teeth of one pixel in every other column, of which the mean over 3 x 3 leaves a third, to either side of the
    // mean.
    let teeth = picture(200, 200, |x, y| {
        if (60..120 + x % 2).contains(&y) && (50..150).contains(&x) {
            20.0 + normal(x, y, 4)[0]
        } else {
            120.0 + 3.0 * normal(x, y, 4)[0]
        }
    });
    let mask = sector::sector(&teeth).expect("a sector");
    let edge = sector::edge(&teeth, &mask).expect("an edge");
    near("jaggedness", edge.jaggedness.expect("neighbours"), 1.0 / 3.0, 0.1);
    let plain = even(90.0, 1);
    let mask = sector::sector(&plain).expect("a sector");
    assert!(sector::edge(&plain, &mask).is_none());
}

#[test]
fn dark_windows_are_found_in_fluid() {
    let noise = blurred(240, 200, [3.0, 1.0], 8);
    let frame = picture(240, 200, |x, y| {
        let n = noise[0][y * 240 + x];
        match ((20..110).contains(&x), (60..140).contains(&y)) {
            (true, true) => 12.0 + 4.0 * n,
            // Sparse specks on black (30 % of the pixels) do not count as texture.
            (false, true) if (130..220).contains(&x) => 8.0 * f64::from(u8::from(normal(x, y, 9)[0] > 0.5244)),
            _ => 110.0 + 15.0 * n,
        }
    });
    let parts = FrameMeasurements::of(&frame).expect("parts");
    assert!(parts.dark.len() >= 2);
    for texture in &parts.dark {
        near("dark mean", texture.mean, 12.0, 2.0);
        near(
            "lag-1 lateral",
            texture.autocorrelation[1][1],
            (-0.25f64 / 9.0).exp(),
            0.05,
        );
    }
    let black = 0.7 * 90.0 * 80.0 / (240.0 * 200.0);
    near(
        "black share",
        parts.share(|grey| grey <= 2.0).expect("a share"),
        black,
        0.02,
    );
}

fn row<'a>(report: &'a LikenessReport, key: &str) -> &'a MeasureComparison {
    report.groups[0]
        .measures
        .iter()
        .find(|row| row.measure.key == key)
        .expect("a measure")
}

#[test]
fn differences_are_in_spreads_of_the_real_frames() {
    let real = [even(80.0, 1), even(92.0, 2), even(86.0, 3)];
    let comparison = compare(&real, &real).expect("a report");
    for row in &comparison.groups[0].measures {
        assert!(
            row.difference.is_none_or(|d| d == 0.0) && row.verdict != Some(LikenessVerdict::Outside),
            "{row:?}"
        );
    }
    assert!(
        comparison.groups[0]
            .measures
            .iter()
            .filter(|row| row.verdict == Some(LikenessVerdict::Inside))
            .count()
            > 25
    );
    let report = compare(&[even(116.0, 4)], &real).expect("a report");
    let grey = row(&report, "grey_mean");
    // Means of 80, 86 and 92: 86 +- 6.
    near("difference", grey.difference.expect("known"), 5.0, 0.4);
    assert_eq!(grey.verdict, Some(LikenessVerdict::Outside));
    assert_eq!(row(&report, "lag1_lateral").verdict, Some(LikenessVerdict::Inside));
    // The standard deviations of the three differ by less than a grey level: the floor applies.
    let std = row(&report, "grey_std");
    let (ours, real_std) = (
        std.frames.as_ref().expect("ours").mean,
        std.real.as_ref().expect("real"),
    );
    assert!(real_std.spread.expect("three frames") < std.measure.floor);
    near(
        "floor",
        std.difference.expect("known"),
        (ours - real_std.mean) / std.measure.floor,
        1e-12,
    );
    // Two are no distribution: values, and the spread of two, without a verdict.
    let two = compare(&real, &real[..2]).expect("a report");
    let rows = &two.groups[0].measures;
    assert!(rows.iter().all(|row| row.difference.is_none() && row.verdict.is_none()));
    assert!(
        row(&two, "grey_mean")
            .real
            .as_ref()
            .is_some_and(|real| real.spread.is_some())
    );
    assert!(
        two.notes.iter().any(|note| note.contains("no distribution (liver)")),
        "{:?}",
        two.notes
    );
    assert!(
        two.to_string().contains("liver: no verdict (3 frames against 2)"),
        "{two}"
    );
}

/// Frames of a group whose means rise by 6 grey levels.
fn group(name: &str, count: u32, mean: f64) -> Vec<Picture> {
    let frame = |n: u32| Picture {
        name: format!("{name}_{n}.png"),
        group: name.to_owned(),
        ..even(mean + 6.0 * f64::from(n), n)
    };
    (0..count).map(frame).collect()
}

#[test]
fn groups_are_compared_with_those_of_their_name() {
    let real = [
        group("heart", 2, 60.0),
        group("kidney", 3, 110.0),
        group("liver", 3, 80.0),
    ]
    .concat();
    // Within the spread of all real frames, and outside that of the liver's.
    let ours = [group("liver", 2, 110.0), group("lung", 1, 90.0)].concat();
    let report = compare(&ours, &real).expect("a report");
    let names =
        |report: &LikenessReport| -> Vec<String> { report.groups.iter().map(|group| group.group.clone()).collect() };
    assert_eq!(names(&report), ["liver"]);
    assert_eq!((report.groups[0].frames.len(), report.groups[0].real.len()), (2, 3));
    assert_eq!(row(&report, "grey_mean").verdict, Some(LikenessVerdict::Outside));
    let notes = report.notes.join("\n");
    for note in [
        "groups are sub-folders, else files",
        "frames without real frames of their group are left out: lung",
        "real frames without frames of their group are left out: heart, kidney",
    ] {
        assert!(notes.contains(note), "{notes}");
    }
    // A single group without its like is compared with each, on either side.
    let frame = group("frame", 3, 90.0);
    let each = compare(&frame, &real).expect("a report");
    assert_eq!(
        names(&each),
        ["frame against heart", "frame against kidney", "frame against liver"]
    );
    assert!(each.groups[0].measures.iter().all(|row| row.verdict.is_none()));
    assert!(
        each.notes.iter().any(|note| note.contains("no distribution (heart)")),
        "{:?}",
        each.notes
    );
    let text = each.to_string();
    assert!(
        text.contains("frame against heart: no verdict") && text.contains("frame against liver: "),
        "{text}"
    );
    let page = each.page(&frame, &real).expect("a page");
    assert!(page.contains("<h2>frame against kidney</h2>") && page.matches("data:image/png;base64,").count() == 6);
    let json = serde_json::to_value(&each).expect("JSON");
    assert!(
        json["groups"].as_array().map(Vec::len) == Some(3) && json["measures"].is_null(),
        "{json}"
    );
    assert_eq!(
        names(&compare(&real, &frame).expect("a report"))[2],
        "liver against frame"
    );
    // Real frames that share no name are one group.
    let named = |name: &str, mean: f64| group(name, 1, mean);
    let mixed = [named("x", 80.0), named("y", 84.0), named("z", 88.0)].concat();
    let pooled = compare(&frame, &mixed).expect("a report");
    assert_eq!(names(&pooled), ["frame against real frames"]);
    assert_eq!(pooled.groups[0].real.len(), 3);
    let error = compare(&[group("lung", 1, 90.0), frame].concat(), &real)
        .unwrap_err()
        .to_string();
    for word in ["frame, lung", "heart, kidney, liver", "liver_01.png", "a single group"] {
        assert!(error.contains(word), "{error}");
    }
}

#[test]
fn frames_of_unknown_scale_lack_millimetres_alone() {
    let unknown = Picture {
        mm: None,
        ..even(80.0, 1)
    };
    let report = compare(&[unknown], &[even(80.0, 2), even(82.0, 3)]).expect("a report");
    for row in &report.groups[0].measures {
        let needs =
            row.measure.unit == "mm" || ["empty_5mm", "blocks_4mm_db", "blocks_8mm_db"].contains(&row.measure.key);
        assert!(!needs || row.frames.is_none(), "{}", row.measure.key);
    }
    assert!(row(&report, "fwhm_lateral_px").frames.is_some() && row(&report, "fwhm_lateral_mm").real.is_some());
    assert!(report.notes[0].contains("a.png"), "{:?}", report.notes);
}

#[test]
fn neighbours_of_a_sequence_are_correlated() {
    for (seed, expected) in [(1, 1.0), (2, 0.0)] {
        let frame = Picture {
            neighbour: Some(even(80.0, seed).grey),
            ..even(80.0, 1)
        };
        let correlations = FrameMeasurements::of(&frame).expect("parts").frame_correlation;
        near("uniform", correlations[1].expect("windows"), expected, 0.1);
        assert_eq!(correlations[0], None);
    }
}

#[test]
fn frames_without_a_window_or_a_sector_are_refused() {
    let message = |picture: &Picture| FrameMeasurements::of(picture).err().expect("an error").to_string();
    let small = message(&picture(48, 200, |x, y| normal(x, y, 1)[0] * 30.0 + 100.0));
    assert!(
        small.contains("48 x 200 pixels") && small.contains("at least 49 x 49"),
        "{small}"
    );
    for frame in [
        picture(100, 100, |_, _| 40.0),
        picture(100, 100, |x, y| {
            if x < 30 && y < 30 {
                50.0 * normal(x, y, 1)[0].abs()
            } else {
                0.0
            }
        }),
    ] {
        let text = message(&frame);
        assert!(text.contains("a.png") && text.contains("no sector"), "{text}");
    }
}

#[test]
fn text_page_and_json_say_the_same() {
    let (ours, real) = ([even(90.0, 4)], [even(80.0, 1), even(84.0, 2), even(82.0, 3)]);
    let report = compare(&ours, &real).expect("a report");
    let (text, page) = (report.to_string(), report.page(&ours, &real).expect("a page"));
    let json = serde_json::to_value(&report).expect("JSON");
    assert_eq!(json["measures"].as_array().map(Vec::len), Some(MEASURES.len()));
    let rows = &report.groups[0].measures;
    for (row, json) in rows.iter().zip(json["measures"].as_array().expect("measures")) {
        assert_eq!(
            (&json["key"], &json["unit"]),
            (&row.measure.key.into(), &row.measure.unit.into())
        );
        assert!(
            text.contains(row.measure.name) && page.contains(row.measure.name),
            "{}",
            row.measure.key
        );
    }
    assert!(page.matches("data:image/png;base64,").count() == 2 && page.matches("<svg").count() == 3);
    let inside = rows
        .iter()
        .filter(|row| row.verdict == Some(LikenessVerdict::Inside))
        .count();
    assert_eq!(page.matches("<span class=\"tag good\">inside</span>").count(), inside);
    let mut keys: Vec<&str> = MEASURES.iter().map(|measure| measure.key).collect();
    keys.sort_unstable();
    keys.dedup();
    assert_eq!(keys.len(), MEASURES.len());
}
