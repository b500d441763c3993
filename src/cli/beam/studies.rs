//! `insonify beam compression`, `map` and `sensitivity`: studies of a user's own needle.

use std::path::PathBuf;

use clap::Args;

use crate::failure::{Error, usage};
use crate::study::Printed;
use insonify_study::beam::case::{Uncertainty, compression, map, sensitivity};
use insonify_study::beam_case::{BeamCase, CaseFile};

/// Step of the remote centres of motion where none are given, mm.
const STEP_MM: f64 = 5.0;

#[derive(Args)]
struct CaseArgs {
    /// Case file, as `insonify beam` reads it
    #[arg(value_name = "CASE.toml")]
    case: PathBuf,
    #[command(flatten)]
    printed: Printed,
}

impl CaseArgs {
    fn case(&self) -> Result<BeamCase, Error> {
        self.printed.check()?;
        Ok(CaseFile::read(&self.case)?.resolve()?)
    }
}

/// Prints compression of and force on the tissue, by layer and over depth
///
/// Compression ratio: length of the tissue beside the needle over its uncompressed length. A row is flagged if its
/// layer is compressed beyond its `min_compression_ratio`.
#[derive(Args)]
pub(super) struct Compression {
    #[command(flatten)]
    args: CaseArgs,
}

impl Compression {
    pub(super) fn run(&self) -> Result<(), Error> {
        let case = self.args.case()?;
        self.args.printed.run(|_| Ok(compression(&case)?))
    }
}

/// Prints base motion, compression and force by RCM for wanted corrections of the tip
#[derive(Args)]
pub(super) struct Map {
    #[command(flatten)]
    args: CaseArgs,
    /// Wanted deflections of the tip, mm
    #[arg(
        long,
        value_name = "MM,...",
        value_delimiter = ',',
        allow_hyphen_values = true,
        required = true
    )]
    tip_mm: Vec<f64>,
    /// Remote centres of motion, mm below the entry [default: 0 to the inserted depth by 5]
    #[arg(long, value_name = "MM,...", value_delimiter = ',', allow_hyphen_values = true)]
    rcm_mm: Vec<f64>,
}

impl Map {
    pub(super) fn run(&self) -> Result<(), Error> {
        let case = self.args.case()?;
        for (name, values) in [("--tip-mm", &self.tip_mm), ("--rcm-mm", &self.rcm_mm)] {
            if let Some(value) = values.iter().find(|value| !value.is_finite()) {
                return Err(usage(
                    format!("{name} {value} is no length"),
                    "ask for finite numbers of mm",
                ));
            }
        }
        let mut rcms = self.rcm_mm.clone();
        if rcms.is_empty() {
            let steps = (case.problem.inserted_mm / STEP_MM).min(100.0) as usize;
            rcms = (0..=steps).map(|step| step as f64 * STEP_MM).collect();
            // A base at the entry cannot turn about it.
            rcms.retain(|rcm| case.problem.control_distance_mm + rcm > 0.0);
        }
        self.args.printed.run(|_| Ok(map(&case, &self.tip_mm, &rcms)?))
    }
}

/// Prints the effect of uncertain mu, alpha and t0 on tip, COM and RCM
///
/// The base moves as the case says. For materials other than Ogden's, mu stands for all their coefficients, and there
/// is no alpha.
#[derive(Args)]
pub(super) struct Sensitivity {
    #[command(flatten)]
    args: CaseArgs,
    /// Uncertainty of the stiffness, +- percent
    #[arg(long, value_name = "PERCENT", default_value_t = 20.0, value_parser = percent)]
    mu_percent: f64,
    /// Uncertainty of the exponent, +- percent
    #[arg(long, value_name = "PERCENT", default_value_t = 20.0, value_parser = percent)]
    alpha_percent: f64,
    /// Uncertainty of the uncompressed length of the tissue, +- percent
    #[arg(long, value_name = "PERCENT", default_value_t = 20.0, value_parser = percent)]
    t0_percent: f64,
}

fn percent(text: &str) -> Result<f64, String> {
    let value = text.parse::<f64>().ok().filter(|value| (0.0..100.0).contains(value));
    value.ok_or_else(|| "expected 0 to below 100 percent".to_owned())
}

impl Sensitivity {
    pub(super) fn run(&self) -> Result<(), Error> {
        let case = self.args.case()?;
        let uncertainty = Uncertainty {
            mu_percent: self.mu_percent,
            alpha_percent: self.alpha_percent,
            t0_percent: self.t0_percent,
        };
        self.args.printed.run(|_| Ok(sensitivity(&case, &uncertainty)?))
    }
}
