//! Cases of planned paths, of the driven guide, and of parameters found from measurements: of a needle in CT, of a
//! force over depth, of a base.

use std::ops::ControlFlow;

use nalgebra::{Isometry3, Point3, Vector3};

use super::record::{Record, Unexpected, largest};
use super::{Group, HardCase};
use crate::beam::measure::SYNTHETIC_CONTAINER_MM;
use crate::beam::{ELEMENT_MM, TISSUES, problem};
use crate::identify::force::Piecewise;
use crate::path::{DEFORMED_BONE, Entry, Goal, PathOptions, liver, plan};
use insonify::Error;
use insonify_anatomy::registration::markers::place;
use insonify_base::random::{normal, seed_words};
use insonify_mechanics::needle::beam::inverse::{Wanted, find};
use insonify_mechanics::needle::beam::{Base, FoundationBeam, Shape};
use insonify_tracking::manipulator::drive::{Control, Drive, PERIOD_S, follow};
use insonify_tracking::manipulator::{Guide, Posture};

/// Group of cases of plans and measurements.
pub(crate) const GROUP: Group = Group {
    name: "Paths, drives, measured needles",
    cases: &[
        HardCase {
            name: "paths beside bone",
            criterion: "the vein taken for bone: every line that passes nearer than asked is excluded, none that passes farther, and the \
                        clearance of the others is that of the ellipse, all within a voxel; a target in it, beside it or behind it is refused \
                        with the reason",
            covers: &["cpu f64"],
            seed: 131,
            run: beside_bone,
        },
        HardCase {
            name: "dead band under high gains",
            criterion: "rack with a dead band of 0 to 50 mm, gains of 100 to 1000/s and 0 to a quarter of their square, loads of 0 to 20 N: \
                        the insertion rests within 0.15 mm of its command, and is never off by more than the lost motion of a reversal and \
                        what the drive takes to cross it",
            covers: &["cpu f64"],
            seed: 132,
            run: dead_band,
        },
        HardCase {
            name: "base motion for far goals",
            criterion: "tips and centres of 0.01 to 40 mm to both sides, in soft and in stiffening tissue of 15 to 100 mm: met within 1e-6 mm \
                        by the base that is found, mirrored with the goal within 1e-6 mm, or refused; none below 2 mm refused",
            covers: &["cpu f64"],
            seed: 133,
            run: far_goals,
        },
        HardCase {
            name: "forces with noise",
            criterion: "a force of four regions, the narrowest 3 % of the path, with noise of 0 to 2 % of the largest force: slopes and widths \
                        within 24 % (three standard deviations of the narrowest), exact within 1e-4 without noise; noise alone, a line and a falling force are doubted",
            covers: &["cpu f64"],
            seed: 134,
            run: noisy_forces,
        },
        HardCase {
            name: "markers missing and false",
            criterion: "12 markers off by 0.2 mm, 5 of them missing, 6 false ones among them: no false match, and the error of a base 75 mm \
                        away has the root mean square of theory within 25 %",
            covers: &["cpu f64"],
            seed: 135,
            run: markers,
        },
    ],
};

/// Distance of the phantom's vein, an infinite elliptic cylinder, from the segment between two points of the image
/// plane, mm.
fn vein_mm(from: &Point3<f64>, to: &Point3<f64>) -> f64 {
    let ellipse = (0..720).map(|step| {
        let (sin, cos) = (f64::from(step).to_radians() / 2.0).sin_cos();
        Vector3::new(-4.0 + 11.0 * cos, 28.0 + 6.5 * sin, 0.0)
    });
    let segment = to - from;
    let distances = ellipse.map(|rim| {
        let share = (rim - from.coords).dot(&segment) / segment.norm_squared();
        (from.coords + segment * share.clamp(0.0, 1.0) - rim).norm()
    });
    distances.fold(f64::INFINITY, f64::min)
}

fn beside_bone(record: &mut Record<'_>) -> Result<(), Unexpected> {
    const VOXEL_MM: f64 = 1.0;
    let bone = "[scene.volume]\nphantom = \"liver-vein\"\nresolution_mm = 1.0\n[[scene.tissue]]\nname = \"bone\"\nlabel_names = [\"vessel\"]\n";
    let scenario = liver(250, &[("[scene.volume]\nphantom = \"liver-vein\"\n", bone)])?;
    let options = |target: [f64; 3], clearance_mm: f64| PathOptions {
        target: Goal::At(target),
        entry: Entry::Plane(Some([-20.0, 4.0])),
        lines: record.effort().pick(4, 9),
        clearance_mm,
        tolerance_mm: 0.1,
        section_mm: Some(20.0),
        speed_mm_s: None,
    };
    let target = [10.0, 38.0, 0.0];
    let clearance_mm = 5.0;
    let grazing = options(target, clearance_mm);
    for (name, options, reason) in [
        ("target in bone", options([-4.0, 28.0, 0.0], 0.0), "lies in bone"),
        (
            "target 2 mm beside bone, 4 mm asked",
            options([9.0, 28.0, 0.0], 4.0),
            "bone",
        ),
        ("all lines through bone", options([-4.0, 45.0, 0.0], 0.0), "bone"),
    ] {
        let expected = |error: &Error| error.to_string().contains(reason);
        record.refused(
            name,
            plan(&scenario, &options, &|_, _| ControlFlow::Continue(())),
            expected,
        );
    }
    let planned = plan(&scenario, &grazing, &|_, _| ControlFlow::Continue(()))?;
    let (mut errors, mut simulated, mut excluded) = (Vec::new(), 0, 0);
    let (mut too_near, mut far, mut late) = (0, 0, 0);
    for line in &planned.lines {
        let Some(entry) = line.entry_mm else { continue };
        let exact = vein_mm(&entry.into(), &target.into());
        match &line.path {
            Some(path) => {
                simulated += 1;
                too_near += usize::from(exact < clearance_mm - VOXEL_MM);
                // The path that is cut may be nearer or farther than the straight one, by what the tissue moves.
                errors.extend(path.clearance_mm.map(|clearance| (clearance - exact).max(0.0)));
                too_near += usize::from(path.clearance_mm.is_some_and(|clearance| clearance < clearance_mm));
            }
            None => {
                excluded += 1;
                // Before it is simulated, for this reason or for one that does not depend on bone.
                late += usize::from(exact < clearance_mm - VOXEL_MM && line.excluded == Some(DEFORMED_BONE));
                far += usize::from(exact > clearance_mm + VOXEL_MM && line.excluded == Some("too near to bone"));
            }
        }
    }
    record.zero("lines nearer than asked that are planned", too_near as f64);
    record.zero("lines farther than asked that are excluded", far as f64);
    record.zero(
        "lines nearer than asked that are excluded once they have been simulated",
        late as f64,
    );
    record.under("clearance beyond that of the ellipse, mm", largest(errors), VOXEL_MM);
    // One of each at least, or nothing grazes.
    let missing = u8::from(simulated == 0) + u8::from(excluded == 0);
    record.zero(
        "kinds of lines, planned and excluded, of which there is none",
        missing.into(),
    );
    Ok(())
}

/// 20 mm in at 5 mm/s, a second of rest, 10 mm back, and rest.
fn in_and_back() -> Vec<Posture> {
    let insertion = |step: usize| {
        let time = step as f64 * PERIOD_S;
        (5.0 * (time - 1.0)).clamp(0.0, 20.0) - (5.0 * (time - 6.0)).clamp(0.0, 10.0)
    };
    let posture = |step: usize| Posture {
        insertion_mm: insertion(step),
        ..Posture::default()
    };
    (0..=9500).map(posture).collect()
}

fn dead_band(record: &mut Record<'_>) -> Result<(), Unexpected> {
    /// Error at rest: the controller hunts through the band, and creeps across it by its integral.
    const REST_MM: f64 = 0.15;
    let (guide, commands) = (Guide::default(), in_and_back());
    for (index, dead_band_mm) in [0.0, 4.0, 20.0, 50.0].into_iter().enumerate() {
        let (mut rest_mm, mut beyond) = (0.0_f64, 0.0_f64);
        for proportional_per_s in [100.0, 300.0, 1000.0] {
            for share in [0.0, 0.2, 1.0] {
                for load_n in [0.0, 5.0, 20.0] {
                    let drive = Drive {
                        dead_band_mm,
                        proportional_per_s,
                        integral_per_s2: (share * proportional_per_s * proportional_per_s / 4.0).min(1e5),
                        load_n,
                        ..Drive::default()
                    };
                    let driven = follow(&guide, &drive, Control::ClosedLoop, 0.0, &commands)?;
                    let lag = |step: usize| driven[step].posture.insertion_mm - commands[step].insertion_mm;
                    // The ends of both rests, when the controller has had time to settle.
                    rest_mm = largest([rest_mm].into_iter().chain((5800..6000).chain(9000..9500).map(lag)));
                    let whole_lag = largest((0..commands.len()).map(lag));
                    let [push, pull] = drive.lost_mm(load_n).map(|mm| mm * drive.reduction());
                    beyond = beyond.max(whole_lag - (push + pull));
                }
            }
        }
        record.under(
            format!("band of {dead_band_mm} mm: error at rest, mm"),
            rest_mm,
            REST_MM,
        );
        record.under(
            format!("band of {dead_band_mm} mm: error beyond the lost motion, mm"),
            beyond,
            REST_MM,
        );
        record.done((index + 1) as f64 / 4.0);
    }
    Ok(())
}

fn far_goals(record: &mut Record<'_>) -> Result<(), Unexpected> {
    const MET_MM: f64 = 1e-6;
    let lengths: &[f64] = record.effort().pick(&[15.0, 100.0], &[15.0, 30.0, 50.0, 100.0]);
    let sizes: &[f64] = record
        .effort()
        .pick(&[0.01, 1.5, 40.0], &[0.01, 0.5, 1.5, 5.0, 15.0, 40.0]);
    let (mut miss, mut mirrored, mut early) = (0.0, 0.0, 0);
    let (mut goals_met, mut refused) = (0, 0);
    for tissue in TISSUES {
        for initial_length_mm in lengths {
            let mut layered = problem(tissue.material, tissue.compression, 20.0, 40.0, ELEMENT_MM);
            layered.layers[0].initial_length_mm = *initial_length_mm;
            let mut beam = FoundationBeam::new(&layered)?;
            for size in sizes {
                let goals: [fn(f64) -> Wanted; 4] = [
                    |tip_mm| Wanted::TipFree { tip_mm },
                    |tip_mm| Wanted::TipAbout { tip_mm, rcm_mm: 5.0 },
                    |displacement_mm| Wanted::Centre {
                        com_mm: 12.0,
                        displacement_mm,
                    },
                    |tip_mm| Wanted::TipAndCentre { tip_mm, com_mm: 12.0 },
                ];
                for goal in goals {
                    let mirrored_pair = [*size, -size].map(|size| find(&mut beam, &goal(size)));
                    // A goal out of reach may be refused, but then on both sides:
                    // the tissue is the same to either.
                    let [Ok((base, _)), Ok((mirror, _))] = &mirrored_pair else {
                        refused += 1;
                        early += usize::from(*size < 2.0);
                        mirrored = largest([mirrored, f64::from(u8::from(mirrored_pair.iter().any(Result::is_ok)))]);
                        continue;
                    };
                    goals_met += 1;
                    let solved_again = FoundationBeam::new(&layered)?.solve(base)?;
                    miss = largest([miss, miss_mm(&goal(*size), base, &solved_again)]);
                    let slopes = [base, mirror].map(|base| base.slope.unwrap_or(0.0));
                    let sums = [base.displacement_mm + mirror.displacement_mm, slopes[0] + slopes[1]];
                    mirrored = largest(sums.into_iter().chain([mirrored]));
                }
            }
        }
    }
    record.under("goal less what the base found gives, mm", miss, MET_MM);
    record.under("base of a goal and of its mirror image, mm", mirrored, MET_MM);
    record.zero("goals below 2 mm that are refused", early as f64);
    record.report("goals met", f64::from(goals_met));
    record.report("goals refused", f64::from(refused));
    Ok(())
}

/// Distance of a shape from a goal, mm.
fn miss_mm(wanted: &Wanted, base: &Base, shape: &Shape) -> f64 {
    let displacement = |depth: f64| shape.at(depth)[0];
    match *wanted {
        Wanted::TipFree { tip_mm } | Wanted::TipLeast { tip_mm } | Wanted::TipAbout { tip_mm, .. } => {
            shape.tip_mm() - tip_mm
        }
        Wanted::Centre {
            com_mm,
            displacement_mm,
        } => largest([displacement(com_mm), base.displacement_mm - displacement_mm]),
        Wanted::TipAndCentre { tip_mm, com_mm } => largest([displacement(com_mm), shape.tip_mm() - tip_mm]),
    }
}

fn noisy_forces(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let exact = Piecewise {
        breaks_mm: vec![1.8, 20.9, 29.2],
        slopes_n_per_mm: vec![0.3, 0.015, 0.085, 0.03],
        end_mm: 58.0,
        rms_n: 0.0,
    };
    let seed = seed_words(record.seed());
    let depth = |index: i32| 0.2 * f64::from(index);
    let end_n = exact.at(exact.end_mm);
    let noisy = |share: f64, row: i32, curve: &dyn Fn(f64) -> f64| -> Vec<[f64; 2]> {
        let noise = |index: i32| share * end_n * normal([index, row, 0], seed);
        (1..=290)
            .map(|index| [depth(index), curve(depth(index)) + noise(index)])
            .collect()
    };
    let draws = record.effort().pick(2, 8);
    // Errors of a fit grow in proportion to the noise, and so do the limits; 24 % is three standard
    // deviations of the narrowest region.
    for (share, limit) in [(0.0, 1e-4), (0.005, 0.06), (0.02, 0.24)] {
        let mut error = 0.0;
        for row in 0..draws {
            let curve = noisy(share, row, &|depth| exact.at(depth));
            let piecewise = Piecewise::fit(&curve, 4).ok_or_else(|| Unexpected::new("no fit"))?;
            let slopes = piecewise.slopes_n_per_mm.iter().zip(&exact.slopes_n_per_mm);
            let widths = [0, 2].map(|region| piecewise.width(region) / exact.width(region) - 1.0);
            error = largest(
                slopes
                    .map(|(slope, exact)| slope / exact - 1.0)
                    .chain(widths)
                    .chain([error]),
            );
        }
        record.under(
            format!("noise of {} %: slopes and widths off", 100.0 * share),
            error,
            limit,
        );
    }
    // A fit of four regions finds four in any curve: those that have fewer must at least be doubted.
    let curves: [(&str, &dyn Fn(f64) -> f64); 3] = [
        ("noise alone", &|_| 0.0),
        ("a line", &|depth| 0.03 * depth),
        ("a force that falls", &|depth| exact.at(depth) - 0.03 * depth),
    ];
    for (name, force) in curves {
        let curve = noisy(0.02, draws, force);
        let doubted = Piecewise::fit(&curve, 4).is_none_or(|piecewise| piecewise.doubt(&curve).is_some());
        record.zero(format!("{name}: taken for four regions"), u8::from(!doubted).into());
    }
    Ok(())
}

fn markers(record: &mut Record<'_>) -> Result<(), Unexpected> {
    const NOISE_MM: f64 = 0.2;
    const SEEN: usize = 7;
    let design = SYNTHETIC_CONTAINER_MM.map(Point3::from);
    let base = Point3::new(-40.0, 0.0, 0.0);
    let seed = seed_words(record.seed());
    let trials = record.effort().pick(60, 400);
    let (mut false_matches, mut squares, mut theory) = (0, 0.0, 0.0);
    for trial in 0..trials {
        let random = |row: i32| Vector3::from_fn(|axis, _| normal([trial, row, axis as i32], seed));
        let pose = Isometry3::new(300.0 * random(0), random(1));
        // Each trial lacks five other markers.
        let visible: Vec<usize> = (0..SEEN)
            .map(|index| (index * 5 + trial as usize) % design.len())
            .collect();
        let of_design = |index: &usize| pose * (design[*index] + NOISE_MM / 3f64.sqrt() * random(2 + *index as i32));
        let mut centres: Vec<_> = visible.iter().map(of_design).collect();
        centres.extend((20..26).map(|row| pose * Point3::from(Vector3::new(30.0, 0.0, 0.0) + 25.0 * random(row))));
        let placement = place(&design, &centres)?;
        let is_false = |(index, matched): &(usize, &Option<usize>)| {
            matched.is_some_and(|matched| visible.get(matched) != Some(index))
        };
        false_matches += placement.matched.iter().enumerate().filter(is_false).count();
        squares += (placement.pose * base - pose * base).norm_squared();
        let markers: Vec<_> = visible.iter().map(|index| design[*index]).collect();
        theory += target_error_squared(&markers, &base, NOISE_MM);
    }
    record.zero("false matches", false_matches as f64);
    let ratio = (squares / theory).sqrt();
    record.under(
        "root mean square error of the base over that of theory, off 1",
        ratio - 1.0,
        0.25,
    );
    record.under("the same the other way", 1.0 - ratio, 0.25);
    record.report(
        "root mean square error of the base, mm",
        (squares / f64::from(trials)).sqrt(),
    );
    Ok(())
}

/// Expected squared error, mm^2, of a point placed by markers whose own root mean square error is `noise_mm` (J. M.
/// Fitzpatrick, J. B. West and C. R. Maurer, IEEE Transactions on Medical Imaging 17, 1998): the distances d from the
/// principal axes of the markers count against those of the markers, f.
fn target_error_squared(markers: &[Point3<f64>], target: &Point3<f64>, noise_mm: f64) -> f64 {
    let count = markers.len() as f64;
    let centre = markers.iter().map(|marker| marker.coords).sum::<Vector3<f64>>() / count;
    let from_centre = |point: &Point3<f64>| point.coords - centre;
    let spread: nalgebra::Matrix3<f64> = markers
        .iter()
        .map(|marker| from_centre(marker) * from_centre(marker).transpose())
        .sum();
    let axes = spread.symmetric_eigen().eigenvectors;
    let ratios = (0..3).map(|axis| {
        let axis = axes.column(axis).into_owned();
        let from_axis =
            |point: &Point3<f64>| (from_centre(point) - axis * from_centre(point).dot(&axis)).norm_squared();
        from_axis(target) / (markers.iter().map(from_axis).sum::<f64>() / count)
    });
    noise_mm * noise_mm / count * (1.0 + ratios.sum::<f64>() / 3.0)
}
