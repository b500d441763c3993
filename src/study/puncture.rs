//! Needle insertion into a slice of liver with a vein: force against travel, and flattening of the vein before its
//! puncture.
//!
//! After figures 11 and 12 of Y. Kobayashi et al., "Development of an integrated needle insertion system with image
//! guidance and deformation simulation", Computerized Medical Imaging and Graphics 34, 2010. For the tissue, Kobayashi
//! et al. 2010 give G = 400 Pa below a shear of 0.35 (in vitro), order 0.1 and 5 mm/s; they say that tissue in vivo is
//! harder and that E0, e0 and a were fitted by hand to a measured force, without stating the values. The modulus, a,
//! the thickness of the slice and the forces of the membranes used here are therefore choices, made for a curve of the
//! shape of figure 12: none is a measurement.

mod draw;
pub mod fit;
mod liver;

use std::ops::ControlFlow;

use serde::Serialize;

use crate::StudyError;
use insonify::Error;
use insonify_base::output::OutputError;
use insonify_base::range::{OutOfRange, check};
use insonify_mechanics::insertion::pushing::{Phase, Pushing};
use insonify_mechanics::tissue::nonlinear::creep::{Creep, Memory};
use insonify_mechanics::tissue::nonlinear::{Scheme, Solver, SolverOptions, Structure};
use insonify_mechanics::tissue::viscoelastic::{Rule, Span};
use insonify_report::plot::{Axis, Plot, Series};
use liver::Liver;

/// Travel of the needle, mm.
const TRAVEL_MM: f64 = 40.0;

/// Parameters of the tissue and the needle.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PunctureOptions {
    /// Young's modulus below the knee, kPa (above 0; kPa s^order where viscous). Default 2.
    pub young_kpa: f64,
    /// Poisson's ratio (above -1, below 0.5). Default 0.45.
    pub poisson: f64,
    /// Relative strain above which the tissue stiffens (0 or more). Default 0.303.
    pub knee_strain: f64,
    /// Rate of stiffening above the knee (0 or more; 0 disables it). Default 60.
    pub stiffening: f64,
    /// Order of the viscosity, 0 (elastic) to 1. Default 0.1.
    pub order: f64,
    /// Thickness of the slice, mm (above 0). Default 20.
    pub thickness_mm: f64,
    /// Speed of the needle, mm/s (above 0). Default 5.
    pub speed_mm_per_s: f64,
    /// Travel per step, mm (above 0). Default 0.2.
    pub step_mm: f64,
    /// Puncture force of the capsule, N (0 or more). Default 0.6.
    pub capsule_n: f64,
    /// Puncture force of the wall of the vein, N (0 or more). Default 0.5.
    pub wall_n: f64,
    /// Cutting force in liver, N (0 or more). Default 0.15.
    pub cutting_n: f64,
    /// Friction of the shaft in liver, N/mm (0 or more). Default 0.006.
    pub friction_n_per_mm: f64,
}

impl Default for PunctureOptions {
    fn default() -> Self {
        PunctureOptions {
            young_kpa: 2.0,
            poisson: 0.45,
            knee_strain: 0.303,
            stiffening: 60.0,
            order: 0.1,
            thickness_mm: 20.0,
            speed_mm_per_s: 5.0,
            step_mm: 0.2,
            capsule_n: 0.6,
            wall_n: 0.5,
            cutting_n: 0.15,
            friction_n_per_mm: 0.006,
        }
    }
}

/// State after one step of the needle.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PunctureStep {
    /// Travel of the needle from the undeformed capsule, mm.
    pub travel_mm: f64,
    /// Time since first contact, s.
    pub time_s: f64,
    /// Force on the needle, N.
    pub force_n: f64,
    /// Part of the force that acts at the tip, N.
    pub tip_n: f64,
    /// Depth of the tip in the undeformed tissue, mm.
    pub depth_mm: f64,
    /// Height of the vein along the needle's path, mm.
    pub vein_mm: f64,
    /// Layer punctured in this step: 0 for the capsule, 1 for the near wall of the vein, 2 for its far wall.
    pub punctured: Option<usize>,
}

/// Result of a puncture simulation.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Puncture {
    /// Options used.
    pub options: PunctureOptions,
    /// State at rest and after each step.
    pub rows: Vec<PunctureStep>,
    /// Pictures of the slice as SVG documents: name and text.
    #[serde(skip)]
    pub pictures: Vec<(String, String)>,
}

/// Names of the punctures that are drawn.
const NAMES: [&str; 3] = ["capsule", "near-wall", "far-wall"];

/// Simulates the insertion. `progress` receives the completed fraction, 0 to 1, after each step, and may say stop.
///
/// # Errors
/// [`Error`] if an option is out of range or a step cannot be solved.
pub fn puncture(
    options: &PunctureOptions,
    progress: &mut dyn FnMut(f64) -> ControlFlow<()>,
) -> Result<Puncture, Error> {
    let step = positive("step_mm", options.step_mm)?;
    let speed = positive("speed_mm_per_s", options.speed_mm_per_s)?;
    let steps = (TRAVEL_MM / step).ceil();
    if steps > 1e5 {
        let expected = "a way of at least 0.00042 mm";
        return Err(OutOfRange::new("step_mm", step, expected).into());
    }
    let (liver, mut needle) = pushing(options, steps, true)?;
    let [near_wall, far_wall] = [1, 2].map(|layer: usize| liver.layers[layer].from_mm);
    let mut rows = vec![PunctureStep {
        travel_mm: 0.0,
        time_s: 0.0,
        force_n: 0.0,
        tip_n: 0.0,
        depth_mm: 0.0,
        vein_mm: far_wall - near_wall,
        punctured: None,
    }];
    let mut states = vec![state("rest", &liver, &needle, 0.0)];
    // The state before each puncture is kept when the step reports that puncture.
    for count in 1..=steps as usize {
        let travel_mm = (count as f64 * step).min(TRAVEL_MM);
        let pushed = needle.step(travel_mm, step / speed);
        let pushed = pushed.map_err(|cause| StudyError::Travel { travel_mm, cause })?;
        if let Some(layer) = pushed.punctured {
            let name = NAMES.get(layer).copied().unwrap_or("layer");
            states.push(state(&format!("before-{name}"), &liver, &needle, travel_mm));
        }
        let [upper, lower] = [near_wall, far_wall].map(|depth| needle.along(depth));
        rows.push(PunctureStep {
            travel_mm,
            time_s: count as f64 * step / speed,
            force_n: pushed.force_n,
            tip_n: pushed.tip_n,
            depth_mm: pushed.depth_mm,
            vein_mm: far_wall + lower - near_wall - upper,
            punctured: pushed.punctured,
        });
        StudyError::unless_stopped(progress(count as f64 / steps))?;
        if pushed.phase == Phase::Free {
            break;
        }
    }
    let travelled = rows[rows.len() - 1].travel_mm;
    states.push(state("end", &liver, &needle, travelled));
    let darkest_kpa = draw::darkest_kpa(&states);
    let picture = |state: draw::SliceState| (state.name.clone(), draw::slice(&liver, &state, darkest_kpa));
    Ok(Puncture {
        options: *options,
        rows,
        pictures: states.into_iter().map(picture).collect(),
    })
}

/// Returns the state of the slice with its stress, which a viscous one has followed.
fn state(name: &str, liver: &Liver, needle: &Pushing<2, 3>, travel_mm: f64) -> draw::SliceState {
    let displacement = needle.structure().displacement().to_vec();
    let stress_kpa = match needle.structure() {
        Structure::Viscous(creep) => liver
            .body
            .von_mises_kpa(creep.displacement(), creep.stress_kpa().unwrap_or_default()),
        Structure::Elastic(_) => {
            let stress_kpa = liver.body.stresses_kpa(&displacement, &displacement);
            liver.body.von_mises_kpa(&displacement, &stress_kpa)
        }
    };
    draw::SliceState {
        name: name.to_owned(),
        displacement,
        stress_kpa,
        travel_mm,
    }
}

/// Creates the slice, and a needle at its surface prepared for the given number of steps; `stress` has a viscous slice
/// follow its stress.
fn pushing(options: &PunctureOptions, steps: f64, stress: bool) -> Result<(Liver, Pushing<2, 3>), Error> {
    let step = positive("step_mm", options.step_mm)?;
    let speed = positive("speed_mm_per_s", options.speed_mm_per_s)?;
    let liver = Liver::new(options)?;
    let solving = SolverOptions {
        scheme: Scheme::MODIFIED,
        tolerance: 1e-6,
        iterations: 400,
    };
    let solver = Solver::new(liver.body.clone(), liver.supports.clone(), solving)?;
    let structure = if options.order == 0.0 {
        Structure::Elastic(Box::new(solver))
    } else {
        // A hundredth of slack keeps steps within the span under rounding.
        let span = Span {
            shortest_s: 0.99 * step / speed,
            longest_s: 1.01 * (steps + 1.0) * step / speed,
            ..Span::default()
        };
        let loads = vec![0.0; solver.supports().all()];
        let rule = Rule::Exponentials(span);
        let creep = Creep::new(solver, Memory::LoadIntegral, options.order, rule, &loads).and_then(|mut creep| {
            if stress {
                creep.follow_stress(options.order, rule)?;
            }
            Ok(creep)
        });
        Structure::Viscous(Box::new(
            creep.map_err(|cause| StudyError::Travel { travel_mm: 0.0, cause })?,
        ))
    };
    let needle = Pushing::new(structure, liver.entry, [0.0, -1.0], liver.layers.clone())?;
    Ok((liver, needle))
}

fn positive(key: &str, value: f64) -> Result<f64, Error> {
    check(key, value, value > 0.0, "a finite number above 0")?;
    Ok(value)
}

impl Puncture {
    /// Returns a CSV table with one row per step.
    pub fn csv(&self) -> String {
        let mut text = "travel_mm,time_s,force_n,tip_n,depth_mm,vein_mm,punctured\n".to_owned();
        for row in &self.rows {
            let punctured = row.punctured.map_or(String::new(), |layer| layer.to_string());
            text += &format!(
                "{},{},{},{},{},{},{punctured}\n",
                row.travel_mm, row.time_s, row.force_n, row.tip_n, row.depth_mm, row.vein_mm
            );
        }
        text
    }

    /// Describes the punctures in words.
    pub fn text(&self) -> String {
        let mut text = String::new();
        for (index, row) in self.rows.iter().enumerate() {
            let Some(layer) = row.punctured else { continue };
            let after = self.rows.get(index + 1).map_or(row.force_n, |row| row.force_n);
            text += &format!(
                "{:<10} punctured at {:>5.1} mm: {:.3} N, then {after:.3} N; the vein is {:.1} mm high\n",
                NAMES.get(layer).copied().unwrap_or("layer"),
                row.travel_mm,
                row.force_n,
                row.vein_mm
            );
        }
        text
    }
}

/// Plots the force against the needle's travel for several runs.
///
/// # Errors
/// [`OutputError`] if the plot cannot be drawn.
pub fn curves(runs: &[(&str, &Puncture)]) -> Result<String, OutputError> {
    let series = runs.iter().enumerate().map(|(colour, (name, run))| {
        let points = run.rows.iter().map(|row| [row.travel_mm, row.force_n]);
        Series::line(*name, colour, points.collect())
    });
    let [x, y] = ["travel of the needle, mm", "force on the needle, N"].map(Axis::linear);
    Plot::new("A needle pushes, punctures and cuts", x, y, series.collect()).svg()
}

#[cfg(test)]
mod tests;
