//! `insonify puncture`: needle insertion into a slice of liver with a vein.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use clap::Args;
use insonify_study::puncture::fit::{self, PunctureFit};
use insonify_study::puncture::{self, PunctureOptions, curves, puncture};
use serde::Serialize;

use super::output::{self, Force};
use super::terminal;
use insonify::Error;

const TEACHING: &str = "\
A slice of liver (plane strain, its back held) with a vein of 20 x 12 mm, 20 mm below the capsule. The needle pushes, with a force that
rises faster than its travel; a membrane loaded beyond its strength is punctured; then the tip cuts, with friction along the shaft.
The force drops at the capsule, rises, and drops again at the wall of the vein, which is flattened before it is punctured.

Examples:
  insonify puncture                          the position and the force of each puncture
  insonify puncture -o out                   force.csv, force.svg and pictures of the slice, coloured by von Mises stress
  insonify puncture --compare -o out         linear and elastic tissue in the same plot
  insonify puncture --order 0 --stiffening 0  linear tissue
  insonify puncture --fit measured.csv       modulus, knee and stiffening that fit a measured force, and the puncture with them

Modulus, stiffening, thickness and all forces are assumed, chosen to reproduce the shape of the force curve measured in porcine
liver; only the knee and the order are the measured ones.
Source: Y. Kobayashi et al., \"Development of an integrated needle insertion system with image guidance and deformation
simulation\", Computerized Medical Imaging and Graphics 34 (2010) 9-18.";

/// Pushes a needle into a slice of liver with a vein: force against travel, and the flattening of the vein
#[derive(Args)]
#[command(after_help = TEACHING)]
pub(crate) struct Puncture {
    /// Young's modulus below the knee, kPa
    #[arg(long, value_name = "KPA", default_value_t = PunctureOptions::default().young_kpa, allow_negative_numbers = true)]
    young_kpa: f64,
    /// Relative strain above which tissue stiffens
    #[arg(long, value_name = "E", default_value_t = PunctureOptions::default().knee_strain, allow_negative_numbers = true)]
    knee_strain: f64,
    /// Stiffening coefficient a in E0 (1 + a (e - knee)^2); 0 is linear tissue
    #[arg(long, value_name = "A", default_value_t = PunctureOptions::default().stiffening, allow_negative_numbers = true)]
    stiffening: f64,
    /// Order of the viscosity, 0 (elastic) to 1
    #[arg(long, value_name = "K", default_value_t = PunctureOptions::default().order, allow_negative_numbers = true)]
    order: f64,
    /// Thickness of the slice, mm
    #[arg(long, value_name = "MM", default_value_t = PunctureOptions::default().thickness_mm, allow_negative_numbers = true)]
    thickness_mm: f64,
    /// Speed of the needle, mm/s
    #[arg(long, value_name = "MM/S", default_value_t = PunctureOptions::default().speed_mm_per_s, allow_negative_numbers = true)]
    speed: f64,
    /// Travel of the needle per step, mm
    #[arg(long, value_name = "MM", default_value_t = PunctureOptions::default().step_mm, allow_negative_numbers = true)]
    step_mm: f64,
    /// Strength of the capsule, N
    #[arg(long, value_name = "N", default_value_t = PunctureOptions::default().capsule_n, allow_negative_numbers = true)]
    capsule_n: f64,
    /// Strength of the wall of the vein, N
    #[arg(long, value_name = "N", default_value_t = PunctureOptions::default().wall_n, allow_negative_numbers = true)]
    wall_n: f64,
    /// Add elastic and linear tissue to the plot
    #[arg(long)]
    compare: bool,
    /// CSV file with columns travel_mm and force_n: modulus, knee and stiffening are fitted to its first push, starting
    /// from the given values
    #[arg(long, value_name = "CSV")]
    fit: Option<PathBuf>,
    /// Folder for force.csv, force.svg and pictures of the slice; created if missing
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
    /// Print one JSON object to standard output: `options`, and `rows`, one per step; with --fit also `fit`
    #[arg(long)]
    json: bool,
}

impl Puncture {
    pub(crate) fn run(&self) -> Result<(), Error> {
        let mut options = PunctureOptions {
            young_kpa: self.young_kpa,
            knee_strain: self.knee_strain,
            stiffening: self.stiffening,
            order: self.order,
            thickness_mm: self.thickness_mm,
            speed_mm_per_s: self.speed,
            step_mm: self.step_mm,
            capsule_n: self.capsule_n,
            wall_n: self.wall_n,
            ..PunctureOptions::default()
        };
        let inputs: Vec<PathBuf> = self.fit.iter().cloned().collect();
        let names = ["force.csv", "force.svg"];
        let folder = self.force.requested_folder(&self.output, "puncture", &names, &inputs)?;
        let fitted = self
            .fit
            .as_deref()
            .map(|path| self.fitted(path, &options))
            .transpose()?;
        if let Some(fitted) = &fitted {
            fitted.notes.iter().for_each(terminal::note);
            options = PunctureOptions {
                young_kpa: fitted.young_kpa,
                knee_strain: fitted.knee_strain,
                stiffening: fitted.stiffening,
                ..options
            };
        }
        let mut variants = vec![(name(&options), options)];
        // Each leaves out one more part of the law, first viscosity (order 0), then stiffening: what differs
        // between two neighbours is due to that part alone.
        if self.compare {
            variants.push(("elastic", PunctureOptions { order: 0.0, ..options }));
            variants.push((
                "linear",
                PunctureOptions {
                    order: 0.0,
                    stiffening: 0.0,
                    ..options
                },
            ));
        }
        let count = variants.len() as f64;
        let runs = terminal::with_share("simulating punctures", |progress| {
            let runs = variants.into_iter().enumerate().map(|(index, (name, options))| {
                let run = puncture(&options, &mut |share| {
                    progress((index as f64 + share) / count);
                    ControlFlow::Continue(())
                });
                run.map(|run| (name, run))
            });
            runs.collect::<Result<Vec<_>, _>>()
        })?;
        let requested = &runs[0].1;
        if let Some(folder) = folder {
            let path_of = |name: &str| folder.path().join(name);
            let plot = curves(&runs.iter().map(|(name, run)| (*name, run)).collect::<Vec<_>>())?;
            output::text(&path_of("force.svg"), &plot)?;
            output::text(&path_of("force.csv"), &requested.csv())?;
            for (name, picture) in &requested.pictures {
                output::text(&path_of(&format!("{name}.svg")), picture)?;
            }
            folder.install()?;
        }
        let output = JsonOutput {
            fit: fitted.as_ref(),
            puncture: requested,
        };
        terminal::show(&output, self.json, || {
            output.fit.map(text).unwrap_or_default() + &requested.text()
        })
    }

    fn fitted(&self, path: &Path, options: &PunctureOptions) -> Result<PunctureFit, Error> {
        let samples = fit::read(path)?;
        terminal::with_share("fitting", |share| {
            fit::fit(options, &samples, &mut |done| {
                share(done);
                ControlFlow::Continue(())
            })
        })
    }
}

/// JSON output.
#[derive(Serialize)]
struct JsonOutput<'a> {
    #[serde(skip_serializing_if = "Option::is_none")]
    fit: Option<&'a PunctureFit>,
    #[serde(flatten)]
    puncture: &'a puncture::Puncture,
}

fn text(fitted: &PunctureFit) -> String {
    format!(
        "fitted to {} points: young_kpa {:.3}, knee_strain {:.3}, stiffening {:.2}; R^2 {:.5}, {:.4} N off (root mean square)\n",
        fitted.samples.len(),
        fitted.young_kpa,
        fitted.knee_strain,
        fitted.stiffening,
        fitted.r_squared,
        fitted.rms_n
    )
}

fn name(options: &PunctureOptions) -> &'static str {
    match (options.order > 0.0, options.stiffening > 0.0) {
        (true, _) => "viscoelastic",
        (false, true) => "elastic",
        (false, false) => "linear",
    }
}
