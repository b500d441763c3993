//! Virtual rheometer, after the measurements of Kobayashi et al. 2010 (section 3.1): a sine at many frequencies (figure
//! 7), creep at many stresses (section 3.1.2), and the stiffness derived from creep against strain (figure 8).

use std::f64::consts::TAU;
use std::fmt;

use super::MaterialCase;
use insonify_base::document::InputError;
use insonify_base::statistics;
use insonify_base::table::{Cell, Table};
use insonify_mechanics::tissue::viscoelastic::HistoryError;
use insonify_mechanics::tissue::viscoelastic::point::{Control, Knee, Loading, Method, Point, Rheology, Structure};
use insonify_report::plot::{Axis, Marker, Plot, Series};

/// Storage and loss modulus at one frequency.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DynamicModuli {
    /// Angular frequency, rad/s.
    pub frequency: f64,
    /// G' and G'' measured from the stress response to a sinusoidal strain, kPa.
    pub measured_kpa: [f64; 2],
    /// G' and G'' of the constitutive law, kPa.
    pub exact_kpa: [f64; 2],
}

/// Strain under a constant stress.
#[derive(Clone, Debug, PartialEq)]
pub struct CreepCurve {
    /// Constant stress, kPa.
    pub stress_kpa: f64,
    /// Curve of time (s) and shear strain.
    pub curve: Vec<[f64; 2]>,
}

/// Stiffness derived from creep: the ratio of the strain to that without a knee.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stiffness {
    /// Position of the stiffness relative to the memory.
    pub structure: Structure,
    /// Shear strain after 100 s.
    pub strain: f64,
    /// G from equation 2 of Kobayashi et al. 2010, kPa.
    pub shown_kpa: f64,
    /// G of the constitutive law at this strain, kPa.
    pub law_kpa: f64,
}

/// All virtual measurements of a material.
#[derive(Clone, Debug, PartialEq)]
pub struct Rheometer {
    /// Moduli at frequencies from 0.1 to 10 rad/s.
    pub dynamic: Vec<DynamicModuli>,
    /// Creep at stresses from below the knee to far above it, with the structure of the case.
    pub creep: Vec<CreepCurve>,
    /// Stiffness at more stresses, with both structures.
    pub stiffness: Vec<Stiffness>,
}

/// Duration of a creep test, s.
const CREEP_S: f64 = 100.0;
/// Amplitude of the sinusoidal strain: 3 %, as in Kobayashi et al. 2010.
const AMPLITUDE: f64 = 0.03;
/// Number of frequencies of the sine, from 0.1 to 10 rad/s.
const FREQUENCIES: usize = 13;
/// Number of periods of a sine: the initial transient has then decayed below 1e-4.
const PERIODS: usize = 20;
/// Number of time steps in a period.
const STEPS_PER_PERIOD: usize = 256;
/// Number of drawn creep curves.
const CREEP_CURVES: usize = 5;
/// Number of stresses at which the stiffness is derived.
const STIFFNESS_STRESSES: usize = 16;

impl MaterialCase {
    /// Measures the material. Creep depends only on its knee and structure; the sine is as small as in Kobayashi et
    /// al. 2010.
    ///
    /// # Errors
    /// [`InputError`] if stress or strain overflows.
    pub fn rheometer(&self) -> Result<Rheometer, InputError> {
        let point = &self.point;
        let measured = || -> Result<Rheometer, HistoryError> {
            Ok(Rheometer {
                dynamic: dynamic(point)?,
                creep: creep(point)?,
                stiffness: stiffness(point)?,
            })
        };
        measured().map_err(|error| self.file.blame(error))
    }
}

fn dynamic(point: &Point) -> Result<Vec<DynamicModuli>, HistoryError> {
    let moduli_at = |step: usize| -> Result<DynamicModuli, HistoryError> {
        let frequency = 10f64.powf(2.0 * step as f64 / (FREQUENCIES - 1) as f64 - 1.0);
        let steps = PERIODS * STEPS_PER_PERIOD;
        let phase = |step: usize| TAU * step as f64 / STEPS_PER_PERIOD as f64;
        let loading = Loading {
            control: Control::Strain,
            time_s: (0..=steps).map(|step| phase(step) / frequency).collect(),
            value: (0..=steps).map(|step| AMPLITUDE * phase(step).sin()).collect(),
        };
        let response = point.respond_in(&loading, Method::Exponentials, 1)?;
        // Projected on sine and cosine over the last period alone, without the transient.
        let mut measured_kpa = [0.0; 2];
        for step in steps - STEPS_PER_PERIOD..steps {
            let (sin, cos) = phase(step).sin_cos();
            let stress = response.stress_kpa[step].unwrap_or(0.0) / AMPLITUDE;
            measured_kpa[0] += stress * sin * 2.0 / STEPS_PER_PERIOD as f64;
            measured_kpa[1] += stress * cos * 2.0 / STEPS_PER_PERIOD as f64;
        }
        Ok(DynamicModuli {
            frequency,
            measured_kpa,
            exact_kpa: point.body.dynamic_kpa(frequency),
        })
    };
    (0..FREQUENCIES).map(moduli_at).collect()
}

/// Strain under a constant stress from the start, at the given times.
fn strain_under(point: &Point, stress_kpa: f64, time_s: &[f64]) -> Result<Vec<f64>, HistoryError> {
    let loading = Loading {
        control: Control::Stress,
        time_s: time_s.to_vec(),
        value: vec![stress_kpa; time_s.len()],
    };
    Ok(point.respond(&loading, Method::Exponentials)?.strain)
}

/// Stress for which the final strain without a knee would be 1.
fn unit_stress(point: &Point) -> Result<f64, HistoryError> {
    let linear = Point {
        knee: Knee::INFINITE,
        ..*point
    };
    Ok(1.0 / strain_under(&linear, 1.0, &[0.0, CREEP_S])?[1])
}

/// A strain well above the knee, or 1 if there is none.
fn above_knee(point: &Point) -> f64 {
    let Knee { strain, stiffening } = point.knee;
    if strain.is_finite() && stiffening > 0.0 {
        3.0 * strain.max(1.0 / stiffening.sqrt())
    } else {
        1.0
    }
}

fn creep(point: &Point) -> Result<Vec<CreepCurve>, HistoryError> {
    let (unit, above_knee) = (unit_stress(point)?, above_knee(point));
    let mut time_s = vec![0.0];
    time_s.extend((0..=40).map(|step| CREEP_S * 10f64.powf(0.1 * f64::from(step) - 4.0)));
    let curve = |curve_at: usize| -> Result<CreepCurve, HistoryError> {
        let stress_kpa = unit * above_knee * (curve_at + 1) as f64 / CREEP_CURVES as f64;
        let strain = strain_under(point, stress_kpa, &time_s)?;
        let curve = time_s
            .iter()
            .zip(&strain)
            .skip(1)
            .map(|(time, strain)| [*time, *strain]);
        let curve = curve.collect();
        Ok(CreepCurve { stress_kpa, curve })
    };
    (0..CREEP_CURVES).map(curve).collect()
}

fn stiffness(point: &Point) -> Result<Vec<Stiffness>, HistoryError> {
    let (unit, above_knee) = (unit_stress(point)?, above_knee(point));
    let modulus_kpa = match point.body {
        Rheology::SpringPot { modulus_kpa, .. } => modulus_kpa,
        Rheology::Zener {
            modulus_kpa,
            modulus_inf_kpa,
            ..
        } => modulus_kpa + modulus_inf_kpa,
    };
    let mut stiffness = Vec::new();
    for structure in [Structure::Rate, Structure::LoadIntegral] {
        let point = Point { structure, ..*point };
        for step in 0..STIFFNESS_STRESSES {
            let linear = above_knee * (step + 1) as f64 / STIFFNESS_STRESSES as f64;
            let strain = strain_under(&point, unit * linear, &[0.0, CREEP_S])?[1];
            stiffness.push(Stiffness {
                structure,
                strain,
                shown_kpa: modulus_kpa * linear / strain,
                law_kpa: modulus_kpa * point.knee.factor(strain),
            });
        }
    }
    Ok(stiffness)
}

/// Least-squares slope of a straight line through points on logarithmic scales.
fn slope(points: &[[f64; 2]]) -> f64 {
    let [x, y] = [0, 1].map(|axis: usize| points.iter().map(|point| point[axis].ln()).collect::<Vec<_>>());
    statistics::slope(&x, &y)
}

impl Rheometer {
    /// Points of G' (`which` = 0) or G'' (1) against frequency.
    fn moduli(&self, part: usize, exact: bool) -> Vec<[f64; 2]> {
        let kpa = |dynamic: &DynamicModuli| if exact { dynamic.exact_kpa } else { dynamic.measured_kpa };
        self.dynamic
            .iter()
            .map(|dynamic| [dynamic.frequency, kpa(dynamic)[part]])
            .collect()
    }

    /// Slopes of G' and G'' against frequency on logarithmic scales: k for a spring-pot.
    pub fn slopes(&self) -> [f64; 2] {
        [0, 1].map(|part| slope(&self.moduli(part, false)))
    }

    /// Largest error of the measured G' and G'' against the constitutive law, relative to |G*|.
    pub(crate) fn dynamic_error(&self) -> f64 {
        let error = |dynamic: &DynamicModuli| {
            let [measured, exact] = [dynamic.measured_kpa, dynamic.exact_kpa];
            (measured[0] - exact[0]).hypot(measured[1] - exact[1]) / exact[0].hypot(exact[1])
        };
        self.dynamic.iter().map(error).fold(0.0, f64::max)
    }

    /// Tables of moduli and creep as a rheometer exports them, each with the stem of its file: `insonify material fit`
    /// reads them.
    pub fn tables(&self) -> [(&'static str, Table); 2] {
        let moduli = self.dynamic.iter().map(|dynamic| {
            let [storage, loss] = dynamic.measured_kpa;
            [dynamic.frequency, storage, loss].map(|x| x.to_string())
        });
        let creep = self.creep.iter().flat_map(|creep| {
            let rows = creep.curve.iter();
            rows.map(|[time, strain]| [creep.stress_kpa, *time, *strain].map(|x| x.to_string()))
        });
        [
            (
                "dynamic-moduli",
                Table::new(["frequency_rad_s", "storage_kpa", "loss_kpa"]).with(moduli),
            ),
            ("creep", Table::new(["stress_kpa", "time_s", "strain"]).with(creep)),
        ]
    }

    /// Plots, each with the stem of its file.
    pub fn plots(&self) -> Vec<(&'static str, Plot)> {
        let points = |name: &str, colour, points| Series::points(name, colour, Marker::Disc, points);
        let names = ["G', storage", "G'', loss"];
        let moduli = [0, 1].into_iter().flat_map(|part| {
            [
                Series::line(names[part], part, self.moduli(part, true)),
                points(names[part], part, self.moduli(part, false)),
            ]
        });
        let creep =
            self.creep.iter().enumerate().map(|(colour, creep)| {
                Series::line(format!("{:.3} kPa", creep.stress_kpa), colour, creep.curve.clone())
            });
        let of_structure = |structure| self.stiffness.iter().filter(move |point| point.structure == structure);
        let points_of = |structure| {
            of_structure(structure)
                .map(|point| [point.strain, point.shown_kpa])
                .collect()
        };
        let mut law: Vec<[f64; 2]> = self
            .stiffness
            .iter()
            .map(|point| [point.strain, point.law_kpa])
            .collect();
        // Each structure begins again at small strains: unsorted, the line would run back across the plot.
        law.sort_by(|a, b| a[0].total_cmp(&b[0]));
        vec![
            (
                "dynamic-moduli",
                Plot::new(
                    "Dynamic moduli: points from a sine of 3 %, lines from the law",
                    Axis::log("angular frequency, rad/s"),
                    Axis::log("modulus, kPa"),
                    moduli.collect(),
                ),
            ),
            (
                "creep",
                Plot::new(
                    "Creep under a stress that is put on and held",
                    Axis::log("time, s"),
                    Axis::log("shear strain"),
                    creep.collect(),
                ),
            ),
            (
                "stiffness",
                Plot::new(
                    "Stiffness that creep shows after 100 s",
                    Axis::linear("shear strain"),
                    Axis::linear("G, kPa"),
                    vec![
                        Series::line("the law", 2, law),
                        points("load-integral", 1, points_of(Structure::LoadIntegral)),
                        Series {
                            marker: Marker::Ring,
                            ..points("rate", 0, points_of(Structure::Rate))
                        },
                    ],
                ),
            ),
        ]
    }
}

impl fmt::Display for Rheometer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "sine of 3 % strain: slopes of G' and G'' on logarithmic scales, and their moduli"
        )?;
        let [storage, loss] = self.slopes();
        writeln!(
            f,
            "slopes {storage:.4} and {loss:.4}; off the law by {:.1e} at most",
            self.dynamic_error()
        )?;
        let rows = self.dynamic.iter().map(|dynamic| {
            let [storage, loss] = dynamic.measured_kpa.map(|kpa| format!("{kpa:.6}"));
            [format!("{:.4}", dynamic.frequency), storage, loss]
        });
        let head = ["rad/s", "G' kPa", "G'' kPa"].map(Cell::number);
        writeln!(f, "\n{}", Table::new(head).with(rows).text(" ", &[12, 14, 14]))?;
        writeln!(
            f,
            "creep after {CREEP_S} s: the stiffness that it shows, and the law's at this strain\n"
        )?;
        let rows = self.stiffness.iter().map(|point| {
            let name = match point.structure {
                Structure::Rate => "rate",
                Structure::LoadIntegral => "load-integral",
            };
            let [strain, shown, law] =
                [point.strain, point.shown_kpa, point.law_kpa].map(|figure| format!("{figure:.6}"));
            [name.to_owned(), strain, shown, law]
        });
        let head = ["structure", "strain", "G shown kPa", "G law kPa"].map(Cell::number);
        f.write_str(&Table::new(head).with(rows).text(" ", &[14, 12, 14, 14]))
    }
}
