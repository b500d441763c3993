//! `insonify beam`: a needle with a moved base in stiffening tissue.

mod fit;
mod measure;
mod studies;

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use crate::failure::{Error, Failure, usage};
use crate::output::{self, Force};
use crate::study::Printed;
use crate::terminal;
use insonify_mechanics::needle::beam::inverse::Wanted;
use insonify_study::beam::table_one;
use insonify_study::beam_case::{self, BeamReport, CaseFile, plot};

const EXAMPLES: &str = "\
The case file names the needle, how its base is moved, and layers of tissue from the entry on:
  [needle]
  young_gpa = 200.0            # steel
  diameter_mm = 1.0            # also: inner_diameter_mm; inserted_mm, default through all layers
  [base]
  control_distance_mm = 20.0   # from the base to the point of entry
  displacement_mm = 15.0
  slope = -0.4                 # without it the base turns freely, about an axis pivot_mm behind it (default 0)
  [mesh]
  element_mm = 1.0
  [[layer]]
  thickness_mm = 60.0
  model = \"ogden\"              # its keys: mu_kpa, alpha; other models: insonify beam --example
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
  insonify beam compression case.toml -o out       compression of the tissue by layer and over depth
  insonify beam map case.toml --tip-mm -2,-1       which RCM for a correction of the tip: base motion, compression, force
  insonify beam sensitivity case.toml              effect of uncertain mu, alpha and t0 on tip, COM and RCM
  insonify beam measure rest.nii.gz moved.nii.gz --markers design.csv --case case.toml -o moved.toml   a needle in CT
  insonify beam compare moved.toml                 measured against computed: tip, shape, RCM, COM
  insonify beam fit points.csv                     materials from measured stretch and stress
  insonify beam table                              Table I of Wang et al. 2023 beside this program's values
  insonify tradeoff beam                           effect of element length, friction and material model on the tip
  insonify schema beam                             every key, as a JSON schema

x runs along the needle from the entry (x = 0) into the tissue, u across it. RCM, the remote centre of motion: where the
tangent at the base meets the undeflected needle. COM, the centre of motion: the first point of the needle with zero deflection. Both are
depths below the entry, mm. JSON: tip_mm, rcm_mm, com_mm (null if none), residual (largest moment out of balance over the
largest moment), iterations, shape (list of x mm, u mm, slope, reaction N/mm).
Source: Y. Wang et al., \"Flexible Needle Bending Model for Spinal Injection Procedures\", IEEE Robotics and Automation
Letters 8 (2023) 1343-1350.
Exit status: 0 solved; 2 the case or a file is wrong, or no equilibrium shape is found; 1 a failure of the machine.";

/// Bends a needle in hyperelastic tissue by moving its base
#[derive(Args)]
#[command(after_help = EXAMPLES, args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub(crate) struct Beam {
    #[command(subcommand)]
    task: Option<Task>,
    #[command(flatten)]
    bend: Bend,
}

commands! {
    enum Task {
        Inverse(Inverse),
        Measure(measure::Measure),
        Compare(measure::Compare),
        Compression(studies::Compression),
        Map(studies::Map),
        Sensitivity(studies::Sensitivity),
        Fit(fit::Fit),
        Table(Table),
    }
}

impl Beam {
    pub(crate) fn run(&self) -> Result<(), Error> {
        match &self.task {
            None => self.bend.run(),
            Some(task) => task.run(),
        }
    }
}

// `insonify beam CASE.toml`: shape of a needle.

/// Discretisation error above which the elements are too long, mm.
const COARSE_MM: f64 = 1e-3;

/// Compressed length relative to the initial length below which tissue is outside the range that its models were
/// fitted to.
const FAR: f64 = 0.3;

#[derive(Args)]
pub(crate) struct Bend {
    /// Case file: needle, base motion, elements and layers of tissue
    #[arg(value_name = "CASE.toml", required_unless_present = "example")]
    case: Option<PathBuf>,
    /// Print an example case file
    #[arg(long, conflicts_with_all = ["case", "json", "output"])]
    example: bool,
    /// Print one JSON object: `tip_mm`, `rcm_mm`, `com_mm`, `residual`, `iterations`, `shape`
    #[arg(long)]
    json: bool,
    /// Draw the needle in its tissue
    #[arg(short, long, value_name = "PLOT.svg")]
    output: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
}

impl Bend {
    pub(crate) fn run(&self) -> Result<(), Error> {
        let Some(path) = self.case.as_deref().filter(|_| !self.example) else {
            return terminal::emit(beam_case::EXAMPLE);
        };
        let inputs = output::inputs(path);
        self.force.check_ending(&self.output, "svg", "plots", &inputs)?;
        let case = CaseFile::read(path)?.resolve()?;
        let shape = case.solve()?;
        if shape.least_ratio < FAR {
            let ratio = shape.least_ratio;
            terminal::warn(format_args!(
                "tissue is compressed to {ratio:.3} of its length: materials are seldom measured there"
            ));
        }
        let error_mm = case.element_error_mm(&shape);
        if let Some(error) = error_mm.filter(|error| *error > COARSE_MM) {
            let element = case.problem.element_mm;
            terminal::warn(format_args!(
                "elements of {element} mm leave {error:.1e} mm (elements of half the length differ by that): use shorter ones"
            ));
        }
        output::requested(&self.output, || plot(&case, &shape).svg())?;
        let report = BeamReport::new(&shape);
        let left = error_mm.map_or(String::new(), |error| format!("elements     leave {error:.1e} mm\n"));
        terminal::show(&report, self.json, || left + &report.to_string())
    }
}

// `insonify beam inverse`: base motion for a wanted result.

const INVERSE_EXAMPLES: &str = "\
Examples:
  insonify beam inverse case.toml --tip-mm -2             the base turns as the case says: about its RCM, or freely
  insonify beam inverse case.toml --tip-mm -2 --rcm-mm 0  the base turns about the point of entry
  insonify beam inverse case.toml --com-mm 40             the displacement of the case; which slope, so which RCM?
  insonify beam inverse case.toml --tip-mm -2 --com-mm 40  both displacement and slope are found
  insonify beam inverse case.toml --tip-mm -2 --least-compression   about the RCM that compresses the tissue least

A layer with `min_compression_ratio` must not be compressed beyond it: motions that do so are refused. --least-compression finds the motion
that minimises the largest compression of any layer relative to its limit.

JSON: displacement_mm, slope (with `pivot_mm` also axis_displacement_mm), and what `insonify beam CASE.toml --json` prints of the needle then.
Exit status: 0 found; 2 there is no such motion, or a file is wrong.";

/// Finds the base motion for a wanted deflection of the tip or a wanted centre of motion
#[derive(Args)]
#[command(after_help = INVERSE_EXAMPLES)]
pub(crate) struct Inverse {
    /// Case file, as `insonify beam` reads it
    #[arg(value_name = "CASE.toml")]
    case: PathBuf,
    /// Wanted deflection of the tip, mm
    #[arg(
        long,
        value_name = "MM",
        allow_negative_numbers = true,
        required_unless_present = "com_mm"
    )]
    tip_mm: Option<f64>,
    /// Wanted centre of motion of the needle, mm below the entry
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    com_mm: Option<f64>,
    /// With --tip-mm: the base rotates about this point, mm below the entry
    #[arg(long, value_name = "MM", allow_negative_numbers = true, conflicts_with = "com_mm")]
    rcm_mm: Option<f64>,
    /// With --tip-mm: the base moves so that the tissue is compressed least
    #[arg(long, conflicts_with_all = ["com_mm", "rcm_mm"])]
    least_compression: bool,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
    /// Draw the resulting needle
    #[arg(short, long, value_name = "PLOT.svg")]
    output: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
}

impl Inverse {
    pub(crate) fn run(&self) -> Result<(), Error> {
        let inputs = output::inputs(&self.case);
        self.force.check_ending(&self.output, "svg", "plots", &inputs)?;
        let case = CaseFile::read(&self.case)?.resolve()?;
        for (name, value) in [
            ("--tip-mm", self.tip_mm),
            ("--com-mm", self.com_mm),
            ("--rcm-mm", self.rcm_mm),
        ] {
            if let Some(value) = value.filter(|value| !value.is_finite()) {
                return Err(usage(
                    format!("{name} {value} is no length"),
                    "ask for a finite number of mm",
                ));
            }
        }
        let base = &case.base;
        // The base is a straight line: it turns where this line crosses the axis at rest, and one of slope 0
        // does not cross it.
        let rcm_of_case = || match base.slope {
            None => Ok(None),
            Some(slope) if slope != 0.0 && base.displacement_mm != 0.0 => {
                Ok(Some(-case.problem.control_distance_mm - base.displacement_mm / slope))
            }
            Some(_) => Err(usage(
                "the base of the case does not turn about a point",
                "say --rcm-mm, or leave `slope` out for a base that turns freely",
            )),
        };
        let wanted = match (self.tip_mm, self.com_mm) {
            (Some(tip_mm), Some(com_mm)) => Wanted::TipAndCentre { tip_mm, com_mm },
            (Some(tip_mm), None) if self.least_compression => Wanted::TipLeast { tip_mm },
            (Some(tip_mm), None) => match self.rcm_mm.map_or_else(rcm_of_case, |rcm| Ok(Some(rcm)))? {
                Some(rcm_mm) => Wanted::TipAbout { tip_mm, rcm_mm },
                None => Wanted::TipFree { tip_mm },
            },
            (None, Some(com_mm)) => Wanted::Centre {
                com_mm,
                displacement_mm: base.displacement_mm,
            },
            (None, None) => return Err(usage("no goal is given", "give --tip-mm, --com-mm or both")),
        };
        let (driven, shape) = case.find(&wanted)?;
        output::requested(&self.output, || plot(&case, &shape).svg())?;
        let (base, report) = (&shape.points[0], BeamReport::new(&shape));
        if self.json {
            let mut printed = json!({ "displacement_mm": base.u_mm, "slope": base.slope });
            // A free base is driven by an axis behind it, which moves by another distance than it does.
            if driven.slope.is_none() && case.problem.pivot_mm > 0.0 {
                printed["axis_displacement_mm"] = json!(driven.displacement_mm);
            }
            let printed_report = serde_json::to_value(&report).map_err(|error| Failure::Output(error.into()))?;
            if let (Some(printed), Some(printed_report)) = (printed.as_object_mut(), printed_report.as_object()) {
                printed.extend(printed_report.clone());
            }
            return terminal::emit_json(&printed);
        }
        let mut motion = format!("displacement {:.6} mm\nslope        {:.6}\n", base.u_mm, base.slope);
        if driven.slope.is_none() && case.problem.pivot_mm > 0.0 {
            motion += &format!("axis         displaced by {:.6} mm\n", driven.displacement_mm);
        }
        terminal::emit(&(motion + &report.to_string()))
    }
}

// `insonify beam table`: Table I of Wang et al. 2023.

const SOURCE: &str = "Source: Y. Wang et al., \"Flexible Needle Bending Model for Spinal Injection Procedures\", IEEE Robotics and Automation\n\
Letters 8 (2023) 1343-1350.";

/// Prints Table I of Wang et al. 2023 (centres of motion) beside the values computed by this program
#[derive(Args)]
#[command(after_help = SOURCE)]
pub(crate) struct Table {
    /// Also compute the RCM of a free base whose rotary axis lies this far behind it, mm
    #[arg(long, value_name = "MM,...", value_delimiter = ',')]
    pivot_mm: Vec<f64>,
    #[command(flatten)]
    printed: Printed,
}

impl Table {
    pub(crate) fn run(&self) -> Result<(), Error> {
        self.printed.run(|_| Ok(table_one(&self.pivot_mm)?))
    }
}
