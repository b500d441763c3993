//! `insonify beam`: a needle with a moved base in stiffening tissue.

mod bend;
mod fit;
mod inverse;
mod table;

use clap::{Args, Subcommand};

use super::failure::Failure;

const EXAMPLES: &str = "\
The case file names the needle, how its base is moved, and layers of tissue from the entry on:
  [needle]
  young_gpa = 200.0            # steel
  diameter_mm = 1.0            # also: inserted_mm, default through all layers
  [base]
  control_distance_mm = 20.0   # from the base to the point of entry
  displacement_mm = 15.0
  slope = -0.4                 # without it the base turns freely
  [mesh]
  element_mm = 1.0
  [[layer]]
  thickness_mm = 60.0
  model = \"ogden\"              # mu_kpa, alpha; also neo-hookean, mooney-rivlin, yeoh
  mu_kpa = 3.63
  alpha = 8.74
  compression = \"UTru\"         # or UEng, CTru
  initial_length_mm = 50.0     # of the tissue before it is compressed
  friction = 0.0

Examples:
  insonify beam --example > case.toml              a file to start from: every key, its unit and default
  insonify beam case.toml                          tip, RCM, COM and the shape as a table
  insonify beam case.toml -o shape.svg             and a plot of it
  insonify beam case.toml --json | jq .com_mm
  insonify beam inverse case.toml --com-mm 40      the base motion that puts the centre of motion there
  insonify beam fit points.csv                     materials from measured stretch and stress
  insonify beam table                              Table I of Wang et al. 2023 beside this program's values
  insonify tradeoff beam                           what elements, friction and the choice of model do to the tip
  insonify schema beam                             every key, as a JSON schema

x runs along the needle from the entry (x = 0) into the tissue, u across it. RCM, the remote centre of motion: where the
tangent at the base meets the undeflected needle. COM, the centre of motion: where the needle first is where it was. Both are
depths below the entry, mm. JSON: tip_mm, rcm_mm, com_mm (null if none), residual (largest moment out of balance over the
largest moment), iterations, shape (list of x mm, u mm, slope, reaction N/mm).
Source: Y. Wang et al., \"Flexible Needle Bending Model for Spinal Injection Procedures\", IEEE Robotics and Automation
Letters 8 (2023) 1343-1350.
Exit status: 0 solved; 2 the case or a file is wrong, or the needle has no shape; 1 what the machine could not do.";

/// Bends a needle in hyperelastic tissue by moving its base
#[derive(Args)]
#[command(after_help = EXAMPLES, args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct Beam {
    #[command(subcommand)]
    task: Option<Task>,
    #[command(flatten)]
    bend: bend::Bend,
}

#[derive(Subcommand)]
enum Task {
    Inverse(inverse::Inverse),
    Fit(fit::Fit),
    Table(table::Table),
}

impl Beam {
    pub fn run(&self) -> Result<(), Failure> {
        match &self.task {
            None => self.bend.run(),
            Some(Task::Inverse(inverse)) => inverse.run(),
            Some(Task::Fit(fit)) => fit.run(),
            Some(Task::Table(table)) => table.run(),
        }
    }
}
