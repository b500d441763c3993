//! `insonify beam measure` and `compare`: needles in CT, and computed ones beside them.

use std::path::{Path, PathBuf};

use clap::Args;

use crate::failure::{Error, usage};
use crate::output::{self, Force};
use crate::study::Printed;
use crate::terminal;
use insonify_anatomy::volume::{VolumeError, load_scalar};
use insonify_base::number::decimal;
use insonify_base::table::{Cell, Table};
use insonify_mechanics::needle::beam::Base;
use insonify_study::beam::compare::compare;
use insonify_study::beam::measure::{Design, MeasuredNeedle, Scan, Thresholds, measure, scan};
use insonify_study::beam_case::{BeamCase, CaseFile};

/// Slope and straightness (mm) of a needle at rest beyond which a warning is given.
const REST: [f64; 2] = [0.02, 0.3];

const MEASURE_EXAMPLES: &str = "\
The first volume shows the needle at rest. Markers are spheres of two sizes, listed with the columns body,diameter_mm,x_mm,y_mm,z_mm:
  container,3,0,-40,-30    x = 0 is the surface of the tissue, x runs along the needle into it, y along the motion of the base
  stage,2,-12,15,8         the origin of the stage is the base of the needle; at rest its axes are those of the container
At least four markers of each body, and more than half of them, must be found. The design must fit them in only one way.

Examples:
  insonify beam measure rest.nii.gz moved.nii.gz --markers design.csv --case tissue.toml -o moved.toml
  insonify beam measure rest.nrrd moved_*.nrrd --markers design.csv --case tissue.toml -o cases   a case for each
  insonify beam moved.toml -o shape.svg                  the computed needle over the measured one
  insonify beam compare cases -o out                     errors of tip and shape, RCM and COM, with statistics

Algorithm 1 of Wang et al. 2023. JSON: a list of volume, displacement_mm, slope, control_distance_mm, inserted_mm, tip_mm, rcm_mm, com_mm
(null if not defined), markers_rms_mm and markers (container, stage), rest_slope, rest_rms_mm.
Exit status: 0 measured; 2 markers or needle are not found, or a file is wrong; 1 a failure of the machine.";

/// Measures base motion and shape of a needle in CT by markers, and writes cases
#[derive(Args)]
#[command(after_help = MEASURE_EXAMPLES)]
pub(super) struct Measure {
    /// Volumes: the needle at rest, then moved
    #[arg(value_name = "CT", num_args = 2.., required = true)]
    volumes: Vec<PathBuf>,
    /// Design of the markers
    #[arg(long, value_name = "DESIGN.csv")]
    markers: PathBuf,
    /// Case with needle and layers, to which base motion, depth and measured shape are added
    #[arg(long, value_name = "CASE.toml")]
    case: PathBuf,
    /// Grey value from which a voxel is metal
    #[arg(long, value_name = "GREY", default_value_t = 2000.0, allow_negative_numbers = true)]
    threshold: f32,
    /// Grey value from which a voxel is needle [default: --threshold]
    #[arg(long, value_name = "GREY", allow_negative_numbers = true)]
    needle_threshold: Option<f32>,
    /// Case to write; of several moved volumes a folder of cases
    #[arg(short, long, value_name = "CASE.toml|DIR")]
    output: PathBuf,
    #[command(flatten)]
    force: Force,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

impl Measure {
    pub(super) fn run(&self) -> Result<(), Error> {
        let (scan_at_rest, moved) = (&self.volumes[0], &self.volumes[1..]);
        let names: Vec<String> = moved.iter().map(|path| format!("{}.toml", stem(path))).collect();
        if let Some(repeated) = (1..names.len()).find(|index| names[..*index].contains(&names[*index])) {
            let found = format!("two volumes would be written to {}", names[repeated]);
            return Err(usage(found, "give the volumes different names"));
        }
        let mut inputs = self.volumes.clone();
        inputs.extend([self.markers.clone(), self.case.clone()]);
        let folder = match moved.len() {
            1 => {
                self.force.check_ending([&self.output], "toml", "cases", &inputs)?;
                None
            }
            _ => {
                let names: Vec<&str> = names.iter().map(String::as_str).collect();
                Some(self.force.folder(&self.output, "beam measure", &names, &inputs)?)
            }
        };
        let design = Design::read(&self.markers)?;
        let case = CaseFile::read(&self.case)?.resolve()?;
        let at_rest = self.scan(scan_at_rest, &design)?;
        let mut needles = Vec::new();
        for (path, name) in moved.iter().zip(&names) {
            let measured = measure(&at_rest, &self.scan(path, &design)?).map_err(|error| named(path, &error))?;
            let base = Base {
                displacement_mm: measured.displacement_mm,
                slope: Some(measured.slope),
            };
            let lengths = [measured.control_distance_mm, measured.inserted_mm];
            let text = case.with_measured(&base, lengths, &measured.shape_mm)?;
            match &folder {
                Some(folder) => output::text(&folder.path().join(name), &text)?,
                None => output::text(&self.output, &text)?,
            }
            needles.push((path.display().to_string(), measured));
        }
        // Only once every volume is measured: a failure must not leave old cases beside new ones.
        if let Some(folder) = folder {
            folder.install()?;
        }
        self.print(&needles)
    }

    fn scan(&self, path: &Path, design: &Design) -> Result<Scan, Error> {
        let image = load_scalar(path)?;
        let thresholds = Thresholds {
            marker: self.threshold,
            needle: self.needle_threshold.unwrap_or(self.threshold),
        };
        scan(&image, design, &thresholds).map_err(|error| named(path, &error))
    }

    fn print(&self, needles: &[(String, MeasuredNeedle)]) -> Result<(), Error> {
        let Some((_, first)) = needles.first() else {
            return Ok(());
        };
        // All needles are compared with one scan at rest, so that the first tells of it for all.
        if first.rest_slope.abs() > REST[0] || first.rest_rms_mm > REST[1] {
            terminal::warn(format_args!(
                "at rest the needle slopes by {:.3} and lies {:.2} mm (RMS) off a line; the beam expects a straight \
                 needle perpendicular to the surface",
                first.rest_slope, first.rest_rms_mm
            ));
        }
        if self.json {
            let named: Vec<_> = needles
                .iter()
                .map(|(volume, measured)| NamedNeedle { volume, measured })
                .collect();
            return terminal::emit_json(&named);
        }
        let head = [
            "base mm", "slope", "s mm", "l mm", "tip mm", "RCM mm", "COM mm", "markers", "RMS mm",
        ];
        let head = std::iter::once(Cell::from("volume")).chain(head.map(Cell::number));
        let rows = needles.iter().map(|(name, needle)| {
            let depth = |depth: Option<f64>| depth.map_or("-".to_owned(), |depth| decimal(depth, 2));
            let [first, second] = needle.markers_rms_mm.map(|rms| decimal(rms, 2));
            vec![
                name.clone(),
                decimal(needle.displacement_mm, 3),
                decimal(needle.slope, 4),
                decimal(needle.control_distance_mm, 2),
                decimal(needle.inserted_mm, 2),
                decimal(needle.tip_mm, 3),
                depth(needle.rcm_mm),
                depth(needle.com_mm),
                format!("{}+{}", needle.markers[0], needle.markers[1]),
                format!("{first}/{second}"),
            ]
        });
        terminal::emit(&Table::new(head).with(rows).text("  ", &[]))
    }
}

/// A measured volume in JSON.
#[derive(serde::Serialize)]
struct NamedNeedle<'a> {
    volume: &'a str,
    #[serde(flatten)]
    measured: &'a MeasuredNeedle,
}

fn named(path: &Path, error: &VolumeError) -> Error {
    VolumeError::new(format!("{}: {error}", path.display())).into()
}

/// File name without the endings of volumes.
fn stem(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let name = name.strip_suffix(".gz").unwrap_or(&name);
    name.rsplit_once('.').map_or(name, |(stem, _)| stem).to_owned()
}

/// Compares measured needles with computed ones: tip, shape, RCM and COM, and statistics over all
///
/// Errors by tissue and depth: mean, median, largest, variance (Wang et al. 2023, figures 7 and 8), mean centres (Table
/// I). Each needle is computed with the base motion and tissue of its case, and with the layers of every `--tissue`.
#[derive(Args)]
pub(super) struct Compare {
    /// Cases with `measured_mm`, or folders of them
    #[arg(value_name = "CASE.toml|DIR", required = true)]
    cases: Vec<PathBuf>,
    /// Case whose layers are tried too; may be repeated
    #[arg(long, value_name = "CASE.toml")]
    tissue: Vec<PathBuf>,
    #[command(flatten)]
    printed: Printed,
}

impl Compare {
    pub(super) fn run(&self) -> Result<(), Error> {
        self.printed.check()?;
        let mut cases = Vec::new();
        for path in &self.cases {
            if path.is_dir() {
                cases.extend(folder(path)?)
            } else {
                cases.push(read(path)?)
            }
        }
        let path = |path: &PathBuf| path.display().to_string();
        if let Some((name, _)) = cases.iter().find(|(_, case)| case.measured_mm.is_empty()) {
            let found = format!("the case `{name}` has no `measured_mm` under `[needle]`");
            return Err(usage(found, "measure it with `insonify beam measure`"));
        }
        if cases.is_empty() {
            let paths = self.cases.iter().map(path).collect::<Vec<_>>().join(", ");
            let found = format!("{paths}: no case with `measured_mm` under `[needle]`");
            return Err(usage(
                found,
                "name cases that `insonify beam measure` wrote, or their folder",
            ));
        }
        let tissues = self
            .tissue
            .iter()
            .map(|path| read(path))
            .collect::<Result<Vec<_>, _>>()?;
        self.printed.run(|_| Ok(compare(&cases, &tissues)))
    }
}

fn read(path: &Path) -> Result<(String, BeamCase), Error> {
    Ok((stem(path), CaseFile::read(path)?.resolve()?))
}

/// Cases of a folder that have a measured shape, by name. Other files may lie there too.
fn folder(path: &Path) -> Result<Vec<(String, BeamCase)>, Error> {
    let wrong = |error: std::io::Error| usage(format!("{}: {error}", path.display()), "name a folder that can be read");
    let mut files = Vec::new();
    for entry in std::fs::read_dir(path).map_err(wrong)? {
        files.push(entry.map_err(wrong)?.path());
    }
    files.retain(|file| {
        file.extension()
            .is_some_and(|ending| ending.eq_ignore_ascii_case("toml"))
    });
    files.retain(|file| std::fs::read_to_string(file).is_ok_and(|text| text.contains("measured_mm")));
    files.sort();
    let mut cases = files.iter().map(|file| read(file)).collect::<Result<Vec<_>, _>>()?;
    cases.retain(|(_, case)| !case.measured_mm.is_empty());
    Ok(cases)
}
