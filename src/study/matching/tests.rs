use nalgebra::Matrix4;

use super::*;
use insonify_imaging::anatomies::{self, Acoustics, Frame, SILENT};
use insonify_imaging::effects::receiver::Receiver;
use insonify_imaging::effects::shadow::SOFT_TISSUE_DB_CM_MHZ;
use insonify_imaging::effects::shadow::downshift::Downshift;
use insonify_imaging::effects::speckle::Speckle;
use insonify_imaging::effects::table::Stated;
use insonify_imaging::effects::tone::Tone;
use insonify_imaging::scene::SceneFile;
use insonify_imaging::synth::tables::{Anatomy, Settings};
use insonify_imaging::synth::{Backend, FrameState, Synthesizer};
use insonify_tracking::probe::{Curvilinear, Linear, Phased, Probe, ProbeShape};

const CURVED: ProbeShape = ProbeShape::Curvilinear(Curvilinear {
    radius_mm: 60.0,
    angle_deg: 66.0,
});
const STRAIGHT: ProbeShape = ProbeShape::Linear(Linear { width_mm: 38.0 });

/// Settings that the match should recover.
#[derive(Clone, Copy, Debug)]
struct Known {
    shape: ProbeShape,
    depth_mm: f64,
    size: [usize; 2],
    axial_mm: f64,
    lateral_mm: f64,
    focus_mm: Option<f64>,
    focal_zone_mm: f64,
    range_db: f64,
    gain_db: f64,
    /// Gain in dB per cm beyond the compensation of average tissue, about the middle depth.
    slope_db_cm: f64,
}

const KNOWN: Known = Known {
    shape: CURVED,
    depth_mm: 140.0,
    size: [390, 300],
    axial_mm: 0.85,
    lateral_mm: 1.5,
    focus_mm: None,
    focal_zone_mm: 140.0,
    range_db: 60.0,
    gain_db: 0.0,
    slope_db_cm: 0.0,
};

impl Known {
    fn effects(&self) -> Effects {
        let slope = self.slope_db_cm * self.depth_mm / 20.0;
        Effects {
            speckle: Some(Speckle {
                axial_mm: Some(self.axial_mm),
                lateral_mm: Some(self.lateral_mm),
                focus_mm: self.focus_mm,
                focal_zone_mm: Some(self.focal_zone_mm),
                ..Speckle::default()
            }),
            tone: Some(Tone {
                gain_db: self.gain_db,
                tgc_points: vec![[0.0, -slope], [self.depth_mm, slope]],
                dynamic_range_db: self.range_db,
                ..Tone::linear()
            }),
            haze: None,
            ..Effects::usual()
        }
    }

    /// Renders a frame on a grid which differs from that of a match, with scanlines within half of the beam.
    fn frame(&self, anatomy: Anatomy, effects: Effects) -> Picture {
        let probe = Probe {
            lines: 384,
            ..Probe::new(self.shape, self.depth_mm).unwrap()
        };
        let mut settings = Settings::new(probe, self.size, effects);
        settings.seed = 77;
        settings.image.margin = 0.03;
        let mut synth = Synthesizer::new(anatomy, settings, Backend::Cpu).unwrap();
        let frame = synth.render(&FrameState::at(Matrix4::identity())).unwrap();
        Picture {
            name: "real.png".to_owned(),
            width: frame.width,
            height: frame.height,
            grey: frame.pixels.iter().map(|&grey| f64::from(grey)).collect(),
            mm: Some([frame.pixel_mm; 2]),
            ..Picture::default()
        }
    }

    fn uniform(&self) -> Picture {
        let tissue = Acoustics {
            attenuation_db_cm_mhz: SOFT_TISSUE_DB_CM_MHZ,
            ..PLAIN
        };
        self.frame(anatomies::uniform(tissue), self.effects())
    }
}

fn value(result: &Match, key: &str) -> f64 {
    let figure = result.figures.iter().find(|figure| figure.key.ends_with(key));
    figure.unwrap_or_else(|| panic!("{key}: {:?}", result.figures)).value
}

fn near(what: &str, result: f64, expected: f64, tolerance: f64) {
    assert!(
        (result - expected).abs() <= tolerance,
        "{what}: {result}, not {expected} +- {tolerance}"
    );
}

fn result(case: &Known) -> Match {
    fit(&case.uniform(), None, None, 0).unwrap()
}

fn is_identified(result: &Match, parameter: &str) -> bool {
    !result.unidentified.iter().any(|reason| reason.what == parameter)
}

/// Returns the lateral length in the scene found, mm.
fn lateral_at(result: &Match, depth_mm: f64) -> f64 {
    let zones = (depth_mm - value(result, "focus_mm")) / value(result, "focal_zone_mm");
    value(result, ".lateral_mm") * zones.hypot(1.0)
}

/// Returns the gain at a depth in the scene found, without what compensates for average tissue, dB.
fn gain_at(result: &Match, depth_mm: f64) -> f64 {
    let scene: SceneFile = toml::from_str(&result.scene).unwrap();
    let Some(Stated::With(tone)) = scene.effects.unwrap().tone else {
        panic!("{}", result.scene);
    };
    let mhz = scene.probe.unwrap().sampling.frequency_mhz.unwrap();
    let lost_db = Downshift::new(0.6).felt_db(2.0 * SOFT_TISSUE_DB_CM_MHZ * mhz * depth_mm / 10.0);
    tone.gain_at_db(depth_mm, 0.0, None) - lost_db
}

/// Returns the relative errors of dynamic range, axial length and lateral length, and the error of the gain in dB; the
/// last two are the worst of three depths.
fn errors(case: &Known, result: &Match) -> [f64; 4] {
    let depths = [0.2, 0.5, 0.8].map(|share| share * case.depth_mm);
    let worst = |error: &dyn Fn(f64) -> f64| {
        depths
            .into_iter()
            .map(error)
            .fold(0.0, |a: f64, b| if b.abs() > a.abs() { b } else { a })
    };
    let lateral = |depth: f64| {
        let focus = case.focus_mm.unwrap_or(case.depth_mm / 2.0);
        case.lateral_mm * ((depth - focus) / case.focal_zone_mm).hypot(1.0)
    };
    let gain = |depth: f64| case.gain_db + case.slope_db_cm * (depth - case.depth_mm / 2.0) / 10.0;
    [
        value(result, "dynamic_range_db") / case.range_db - 1.0,
        value(result, "axial_mm") / case.axial_mm - 1.0,
        worst(&|depth| lateral_at(result, depth) / lateral(depth) - 1.0),
        worst(&|depth| gain_at(result, depth) - gain(depth)),
    ]
}

/// The frames are not blurred, as the match assumes.
#[test]
fn known_settings_are_found_again() {
    let phased = ProbeShape::Phased(Phased { angle_deg: 84.0 });
    let straight = Known {
        shape: STRAIGHT,
        depth_mm: 50.0,
        axial_mm: 0.33,
        lateral_mm: 0.6,
        focal_zone_mm: 1000.0,
        ..KNOWN
    };
    let cases = [
        KNOWN,
        Known {
            range_db: 45.0,
            gain_db: -4.0,
            ..KNOWN
        },
        Known {
            range_db: 70.0,
            gain_db: 4.0,
            slope_db_cm: 0.6,
            ..KNOWN
        },
        Known { axial_mm: 1.2, ..KNOWN },
        Known {
            shape: phased,
            axial_mm: 1.12,
            lateral_mm: 2.1,
            ..KNOWN
        },
        straight,
        Known {
            range_db: 70.0,
            gain_db: 3.0,
            slope_db_cm: -2.0,
            ..straight
        },
    ];
    for case in cases {
        let result = result(&case);
        let case_errors = errors(&case, &result);
        for (key, expected) in [
            (
                "radius_mm",
                match case.shape {
                    ProbeShape::Curvilinear(Curvilinear { radius_mm, .. }) => Some(radius_mm),
                    _ => None,
                },
            ),
            (
                "angle_deg",
                match case.shape {
                    ProbeShape::Curvilinear(Curvilinear { angle_deg, .. })
                    | ProbeShape::Phased(Phased { angle_deg }) => Some(angle_deg),
                    _ => None,
                },
            ),
            (
                "width_mm",
                match case.shape {
                    ProbeShape::Linear(Linear { width_mm }) => Some(width_mm),
                    _ => None,
                },
            ),
            ("depth_mm", Some(case.depth_mm)),
        ] {
            let figure = result
                .figures
                .iter()
                .find(|figure| figure.key.ends_with(&format!("probe.{key}")));
            assert_eq!(figure.is_some(), expected.is_some(), "{key} of {:?}", case.shape);
            if let (Some(figure), Some(expected)) = (figure, expected) {
                near(key, figure.value, expected, 0.02 * expected);
            }
        }
        for (what, error, tolerance) in [
            ("range", case_errors[0], 0.1),
            ("axial", case_errors[1], 0.15),
            ("lateral", case_errors[2], 0.15),
            ("gain", case_errors[3], 1.0),
        ] {
            assert!(error.abs() <= tolerance, "{what} of {case:?}: {error} > {tolerance}");
        }
        // Where tone is that of the default scene, so nearly are the grey levels of its windows.
        let is_usual = (case.range_db, case.gain_db, case.slope_db_cm) == (60.0, 0.0, 0.0);
        let nearer = if is_usual { 1.0 } else { 2.0 };
        assert!(
            result.score.windows < 2.0 && nearer * result.score.windows < result.default_score.windows,
            "{:?} {:?}",
            result.score,
            result.default_score
        );
    }
}

/// A different blur biases the estimated range and lengths through its effect on the texture: they are the least
/// certain results.
#[test]
fn an_unknown_blur_shifts_range_and_lengths() {
    let case = Known {
        lateral_mm: 2.4,
        ..KNOWN
    };
    let case_errors = errors(&case, &result(&case));
    assert!(
        case_errors[0].abs() < 0.25 && case_errors[1].abs() < 0.2 && case_errors[2].abs() < 0.2,
        "{case_errors:?}"
    );
}

#[test]
fn a_focus_is_told_where_it_is_seen() {
    let case = Known {
        focus_mm: Some(60.0),
        focal_zone_mm: 30.0,
        ..KNOWN
    };
    let focused = result(&case);
    assert!(is_identified(&focused, "focus"));
    near("focus", value(&focused, "focus_mm"), 60.0, 10.0);
    assert!(!is_identified(&result(&KNOWN), "focus"));
}

#[test]
fn clutter_and_noise_are_told_by_dark_tissue() {
    let tissue = Acoustics {
        attenuation_db_cm_mhz: SOFT_TISSUE_DB_CM_MHZ,
        ..PLAIN
    };
    let fluid = Acoustics {
        echo_db: SILENT.echo_db,
        ..tissue
    };
    let box_ = Frame::around([0.0, 80.0, 0.0], [110, 110, 30], 2.0);
    let picture = |noise_db: f64, clutter_db: f64, decay: f64, depth: f64| {
        let mut effects = KNOWN.effects();
        effects.receiver = Some(Receiver {
            noise_db,
            clutter_db: Some(clutter_db),
            clutter_decay_db_cm: decay,
            ..Receiver::default()
        });
        let anatomy = anatomies::ball(box_, [0.0, depth, 0.0], 35.0, &[SILENT, tissue, fluid]);
        fit(&KNOWN.frame(anatomy, effects), None, None, 0).unwrap()
    };
    let cluttered = picture(-200.0, -14.0, 0.5, 70.0);
    assert!(is_identified(&cluttered, "clutter") && !is_identified(&cluttered, "noise"));
    // Compared at the depth of the fluid; the decay there is less well determined.
    let level = value(&cluttered, "clutter_db") - 7.0 * value(&cluttered, "decay_db_cm");
    near("clutter", level, -17.5, 3.0);
    let noisy = picture(-52.0, -200.0, 4.0, 95.0);
    assert!(
        is_identified(&noisy, "noise") && !is_identified(&noisy, "clutter"),
        "{noisy}"
    );
    // Compared where it is visible: before gain, it depends on the frequency chosen for the scene.
    let scene: SceneFile = toml::from_str(&noisy.scene).unwrap();
    let compensation = 9.5 * scene.probe.unwrap().sampling.frequency_mhz.unwrap();
    near(
        "noise",
        value(&noisy, "noise_db") + compensation,
        -52.0 + 9.5 * 3.5,
        3.0,
    );
}

/// Parts cropped or dark at the edge of a frame do not move the outline.
#[test]
fn an_outline_is_found_in_part() {
    let complete = KNOWN.uniform();
    let outline = |picture: &Picture| Outline::of(&sector_of(picture).unwrap(), picture.width).unwrap();
    let masked = |keep: &dyn Fn(usize, usize) -> bool| {
        let mut picture = complete.clone();
        for (pixel, grey) in picture.grey.iter_mut().enumerate() {
            if !keep(pixel % complete.width, pixel / complete.width) {
                *grey = 0.0;
            }
        }
        picture
    };
    let fan = |outline: Outline| match outline.shape {
        Shape::Fan { apex, radii, half } => [apex[0], apex[1], radii[0], radii[1], half],
        Shape::Rectangle { .. } => panic!("{outline:?}"),
    };
    let expected = fan(outline(&complete));
    // A shadow on one side and a dark corner, whose edges are arcs and lines too.
    let shadowed = outline(&masked(&|x, y| {
        let (across, down) = (x as f64 - expected[0], y as f64 - expected[1]);
        let shadow = across.atan2(down) < -0.3 && across.hypot(down) > 130.0;
        !(shadow || x > 220 && y > 200)
    }));
    for (result, expected) in fan(shadowed).iter().zip(expected) {
        near("of a shadowed sector", *result, expected, 0.02 * expected.abs());
    }
    // Only the middle of the frame, as on a narrow screen.
    let [left, width, height] = [80, 220, 240];
    let cropped = Picture {
        width,
        height,
        grey: (0..width * height)
            .map(|pixel| complete.grey[pixel / width * complete.width + pixel % width + left])
            .collect(),
        ..complete.clone()
    };
    let cropped = outline(&cropped);
    assert_eq!(cropped.seen, [true, false, true]);
    let result = fan(cropped);
    for (index, expected) in [
        (0, expected[0] - left as f64),
        (1, expected[1]),
        (2, expected[2]),
        (4, expected[4]),
    ] {
        near("of a cropped sector", result[index], expected, 0.03 * expected.abs());
    }
    // Array at the bottom.
    let mut turned = complete.clone();
    turned.grey.reverse();
    assert_eq!(Outline::of(&sector_of(&turned).unwrap(), turned.width), None);
}

/// Speckle of a scanner that averages it, as many looks do: no dynamic range makes it as even. A stated range holds.
#[test]
fn a_dynamic_range_that_smoothing_hides_is_told_and_can_be_stated() {
    let speckle = KNOWN.uniform();
    let mut smoothed = speckle.clone();
    let sector = sector_of(&speckle).unwrap();
    let inside = || speckle.grey.iter().zip(&sector).filter(|(_, inside)| **inside);
    let middle = inside().map(|(grey, _)| grey).sum::<f64>() / inside().count() as f64;
    // A quarter of the spread is that of 240 dB.
    for (grey, _) in smoothed.grey.iter_mut().zip(&sector).filter(|(_, inside)| **inside) {
        *grey = (middle + 0.25 * (*grey - middle)).round();
    }
    let note = |result: &Match| {
        let notes: Vec<&String> = result
            .notes
            .iter()
            .filter(|note| note.contains("cannot be known"))
            .collect();
        notes.first().map(|note| note.to_string())
    };
    let unknown = fit(&smoothed, None, None, 0).unwrap();
    let text = note(&unknown).unwrap_or_else(|| panic!("{unknown}"));
    for word in ["120 dB", "smoothed", "60 dB", "--set effects.tone.dynamic_range_db"] {
        assert!(text.contains(word), "{text}");
    }
    assert_eq!(value(&unknown, "dynamic_range_db"), 60.0);
    assert!(
        unknown.scene.contains("cannot be known") && unknown.residual < 0.1,
        "{unknown}"
    );
    // Means are those of the frame all the same.
    let greys = |measured: &WindowMeasurements| measured.depths.iter().map(|depth| depth.grey).sum::<f64>() / 5.0;
    near("grey", greys(&unknown.matched), greys(&unknown.real), 3.0);
    let stated = fit(&smoothed, None, Some(90.0), 0).unwrap();
    assert_eq!((value(&stated, "dynamic_range_db"), note(&stated)), (90.0, None));
    near("grey", greys(&stated.matched), greys(&stated.real), 3.0);
    assert!(!is_identified(&result(&KNOWN), "dynamic range by itself") && note(&result(&KNOWN)).is_none());
}

/// A linear frame that is cut by the picture at both sides, and black in its lower third.
#[test]
fn a_real_frame_with_a_black_lower_third_has_an_outline() {
    let Some(path) = insonify_testing::shared("real/frames/carotid_trans_03.png") else {
        return;
    };
    let frame = &crate::realism::picture::read(&[path], 1, None).unwrap()[0];
    let outline = Outline::of(&sector_of(frame).unwrap(), frame.width).unwrap();
    let Shape::Rectangle { columns, rows } = outline.shape else {
        panic!("{outline:?}");
    };
    // By eye: echoes from row 8 and column 0 to 647.
    near("left", columns[0], 0.0, 3.0);
    near("right", columns[1], 646.5, 3.0);
    near("top", rows[0], 8.0, 3.0);
    assert!(outline.seen[0] && !outline.seen[1], "{outline:?}");
}

#[test]
fn distances_of_histograms_are_shifts() {
    let shares = |greys: &[f64]| bench::histogram(greys);
    near(
        "a shift",
        distance(&shares(&[10.0, 20.0, 30.0]), &shares(&[17.0, 27.0, 37.0])),
        7.0,
        1e-12,
    );
    near(
        "half of it moved",
        distance(&shares(&[0.0, 10.0]), &shares(&[0.0, 30.0])),
        10.0,
        1e-12,
    );
}
