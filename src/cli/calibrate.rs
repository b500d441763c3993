//! `insonify calibrate`: calibration of tracked probes and needles.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use clap::Args;
use nalgebra::{Point3, Vector3};
use serde::Serialize;

use insonify_base::csv::Csv;
use insonify_base::range::numbers;
use insonify_study::calibration::Sheet;
use insonify_tracking::TrackingError;
use insonify_tracking::calibrate::points::{Feature, ImageCalibration, Pixel, calibrate, follow};
use insonify_tracking::calibrate::poses::Poses;
use insonify_tracking::calibrate::{direction_between, held_direction, pivot, spin};
use insonify_tracking::plus::PlusConfig;
use insonify_tracking::sequence::{Sequence, TrackedTransform};

use super::failure::{Error, usage};
use super::output::{self, Force};
use super::terminal;

const EXAMPLES: &str = "\
Order: `pivot` finds the tip of a stylus or needle, `direction` or `spin` the axis of its shaft, `points` the plane of a probe's image. Each
prints the lines for a scene and a fragment for PLUS.

Examples:
  insonify calibrate pivot tip.igs.mha --transform NeedleToTracker -o pivot.html
  insonify calibrate direction tip.igs.mha --transform NeedleToTracker --hub hub.igs.mha
  insonify calibrate spin turned.csv --toward 0,0,150
  insonify calibrate points phantom.igs.mha --transform ProbeToReference --plus-config phantom.xml
  insonify calibrate points sweep.igs.mha --transform ProbeToReference --pixels clicked.csv --json

CSV poses have the columns time_s,m00,...,m33: the matrix from the marker to the tracker row by row, mm.";

/// Calibrates tracked probes and needles: tip, shaft axis, image plane
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Calibrate {
    #[command(subcommand)]
    command: Command,
}

commands! {
    enum Command {
        Pivot(PivotArgs),
        Direction(DirectionArgs),
        Spin(SpinArgs),
        Points(Box<PointsArgs>),
    }
}

impl Calibrate {
    pub(crate) fn run(&self) -> Result<(), Error> {
        self.command.run()
    }
}

/// Poses of the marker.
#[derive(Args)]
struct MarkerPoses {
    /// Poses of the marker: a tracked sequence (.igs.mha, .igs.mhd, .igs.nrrd), or CSV with the columns
    /// time_s,m00,...,m33
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Transform from the marker to the tracker or a reference, composed if need be
    /// [default: the only one to the tracker]
    #[arg(long, value_name = "NAME")]
    transform: Option<String>,
    /// Configuration of PLUS with more transforms
    #[arg(long, value_name = "FILE.xml")]
    plus_config: Option<PathBuf>,
}

impl MarkerPoses {
    fn config(&self) -> Result<Option<PlusConfig>, TrackingError> {
        let config = self.plus_config.as_deref().map(PlusConfig::read).transpose()?;
        config.iter().flat_map(PlusConfig::warnings).for_each(terminal::warn);
        Ok(config)
    }

    fn poses(&self) -> Result<Poses, Error> {
        self.poses_in(&self.file, self.config()?.as_ref())
    }

    fn poses_in(&self, file: &Path, config: Option<&PlusConfig>) -> Result<Poses, Error> {
        if is_csv(file) {
            return Ok(Poses::from_csv(file, self.transform.as_deref())?);
        }
        self.poses_of(&Sequence::read_poses(file)?, file, config)
    }

    fn poses_of(&self, sequence: &Sequence, file: &Path, config: Option<&PlusConfig>) -> Result<Poses, Error> {
        sequence.warnings.iter().for_each(terminal::warn);
        let defined: BTreeMap<String, TrackedTransform> = config.map(PlusConfig::definitions).unwrap_or_default();
        let poses = Poses::from_sequence(sequence, file, self.transform.as_deref(), &defined)?;
        if self.transform.is_none() {
            terminal::note(format_args!(
                "the poses are those of {}To{}",
                poses.marker, poses.tracker
            ));
        }
        Ok(poses)
    }
}

fn is_csv(file: &Path) -> bool {
    file.extension()
        .is_some_and(|ending| ending.eq_ignore_ascii_case("csv"))
}

/// Output of a calibration.
#[derive(Args)]
struct SheetOutput {
    /// Write a page with residuals and the lines for a scene and for PLUS
    #[arg(short, long, value_name = "PAGE.html")]
    output: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

impl SheetOutput {
    fn check(&self, inputs: &[Option<&PathBuf>]) -> Result<(), Error> {
        let inputs: Vec<PathBuf> = inputs.iter().flatten().map(|path| (*path).clone()).collect();
        self.force.check_ending(&self.output, "html", "pages", &inputs)
    }

    fn write(&self, result: &impl Serialize, sheet: &Sheet<'_>) -> Result<(), Error> {
        output::requested(&self.output, || sheet.page())?;
        terminal::show(result, self.json, || sheet.text())
    }
}

/// Finds the point that the motion of a marker leaves fixed: the tip of a stylus or needle that is tilted to all sides
/// in a dent
///
/// Poses whose residual is more than 2.5 standard deviations (from the median absolute deviation) above the median are
/// left out.
#[derive(Args)]
struct PivotArgs {
    #[command(flatten)]
    motion: MarkerPoses,
    #[command(flatten)]
    output: SheetOutput,
}

impl PivotArgs {
    fn run(&self) -> Result<(), Error> {
        self.output.check(&[Some(&self.motion.file)])?;
        let poses = self.motion.poses()?;
        let pivot = pivot(&poses)?;
        self.output.write(&pivot, &Sheet::pivot(&pivot, &poses))
    }
}

/// Finds the direction of a shaft or a beam in the frame of its marker
#[derive(Args)]
struct DirectionArgs {
    #[command(flatten)]
    motion: MarkerPoses,
    /// The direction in all poses, in the frame that the transform leads to
    #[arg(long, value_name = "X,Y,Z", value_parser = numbers::<3>, allow_hyphen_values = true)]
    along: Option<[f64; 3]>,
    /// The direction in each pose: CSV with the columns frame,dx,dy,dz; other frames are not used
    #[arg(long, value_name = "FILE.csv", conflicts_with = "along")]
    directions: Option<PathBuf>,
    /// Poses about a second point of the shaft, toward its hub: the direction leads from there to the pivot of FILE
    #[arg(long, value_name = "FILE", conflicts_with_all = ["along", "directions"])]
    hub: Option<PathBuf>,
    #[command(flatten)]
    output: SheetOutput,
}

impl DirectionArgs {
    fn run(&self) -> Result<(), Error> {
        self.output
            .check(&[Some(&self.motion.file), self.directions.as_ref(), self.hub.as_ref()])?;
        let poses = self.motion.poses()?;
        let direction = if let Some(hub) = &self.hub {
            let hub = self.motion.poses_in(hub, self.motion.config()?.as_ref())?;
            direction_between(&pivot(&hub)?, &pivot(&poses)?)?
        } else if let Some(along) = self.along {
            let direction = nonzero(along)?;
            held_direction(&poses.poses.iter().map(|pose| (pose, direction)).collect::<Vec<_>>())?
        } else if let Some(file) = &self.directions {
            let table = Csv::read(file, &["frame", "dx", "dy", "dz"], &[]).map_err(TrackingError::from)?;
            let mut directions = Vec::new();
            for row in table.rows() {
                let direction = row.numbers(["dx", "dy", "dz"]).map_err(TrackingError::from)?;
                let frame = row.count("frame").map_err(TrackingError::from)?;
                directions.extend(
                    poses
                        .get(frame)
                        .map(|pose| nonzero(direction).map(|direction| (pose, direction)))
                        .transpose()?,
                );
            }
            held_direction(&directions)?
        } else {
            let expected = "give --along, --directions or --hub";
            return Err(usage("no direction is known", expected));
        };
        self.output.write(
            &direction,
            &Sheet::direction("Direction of a shaft", &direction, &poses.marker),
        )
    }
}

fn nonzero(direction: [f64; 3]) -> Result<Vector3<f64>, TrackingError> {
    let direction = Vector3::from(direction);
    if direction.norm() > 1e-9 {
        Ok(direction)
    } else {
        Err(TrackingError::new(
            "a direction is 0,0,0; expected a vector with a length",
        ))
    }
}

/// Finds the axis of an instrument that is turned about itself in place
#[derive(Args)]
struct SpinArgs {
    #[command(flatten)]
    motion: MarkerPoses,
    /// Vector in the marker's frame on the side to which the axis points, such as the tip found by `pivot`
    #[arg(long, value_name = "X,Y,Z", value_parser = numbers::<3>, allow_hyphen_values = true)]
    toward: Option<[f64; 3]>,
    #[command(flatten)]
    output: SheetOutput,
}

impl SpinArgs {
    fn run(&self) -> Result<(), Error> {
        self.output.check(&[Some(&self.motion.file)])?;
        let poses = self.motion.poses()?;
        if self.toward.is_none() {
            terminal::note("the sense of the axis is arbitrary without --toward");
        }
        let axis = spin(&poses, &self.toward.unwrap_or([1.0; 3]).into())?;
        self.output
            .write(&axis, &Sheet::direction("Axis of rotation", &axis, &poses.marker))
    }
}

const POINTS: &str = "\
Columns of --pixels: frame,u_px,v_px (column and row from 0, marked side first, transducer up), and where the pixel lies: x_mm,y_mm,z_mm in
the frame that the transform leads to, or wire, the name of a wire of the phantom. Frames count from 0.

Wires come from the phantom definition of --plus-config, placed by its registration. Without --pixels they are sought in the images near where
the configuration's calibration has them; with --follow near where a calibration from --pixels has them: a few frames are then enough.";

/// Calibrates the image of a probe from pixels of known points, or of the wires of a phantom
#[derive(Args)]
#[command(after_help = POINTS)]
struct PointsArgs {
    #[command(flatten)]
    motion: MarkerPoses,
    /// Pixels of known points or wires (CSV)
    #[arg(long, value_name = "FILE.csv")]
    pixels: Option<PathBuf>,
    /// Seek the wires in all images, starting from the given pixels
    #[arg(long)]
    follow: bool,
    #[command(flatten)]
    output: SheetOutput,
}

impl PointsArgs {
    fn run(&self) -> Result<(), Error> {
        self.output.check(&[
            Some(&self.motion.file),
            self.pixels.as_ref(),
            self.motion.plus_config.as_ref(),
        ])?;
        let config = self.motion.config()?;
        let file = &self.motion.file;
        let follows = self.follow || self.pixels.is_none();
        let has_wires = config.as_ref().is_some_and(|config| !config.wires().is_empty());
        if follows && (is_csv(file) || !has_wires) {
            let missing = if has_wires {
                "a table of poses has no images"
            } else {
                "--plus-config with the wires of a phantom is missing"
            };
            return Err(usage(
                format!("no pixels are given, and wires cannot be found: {missing}"),
                "give --pixels, or a sequence with images and the phantom's definition in --plus-config",
            ));
        }
        let sequence = match (is_csv(file), follows) {
            (true, _) => None,
            (false, true) => Some(Sequence::read(file)?),
            (false, false) => Some(Sequence::read_poses(file)?),
        };
        let poses = match &sequence {
            Some(sequence) => self.motion.poses_of(sequence, file, config.as_ref())?,
            None => self.motion.poses_in(file, config.as_ref())?,
        };
        let wires = wires(config.as_ref(), &poses.tracker)?;
        let clicked = self.pixels.as_deref().map(|path| pixels(path, &wires)).transpose()?;
        let clicked = clicked.map(|pixels| calibrate(&pixels, &poses)).transpose()?;
        // The given pixels decide alone, or are where the wires are sought from in all images.
        let calibration: ImageCalibration = match (clicked, &sequence) {
            (Some(calibration), _) if !follows => calibration,
            (clicked, Some(sequence)) => {
                let start = match (&clicked, &config) {
                    (None, Some(config)) => config.transform("Image", &poses.marker)?,
                    (clicked, _) => clicked
                        .as_ref()
                        .map_or_else(Default::default, |calibration| calibration.image_to_probe.0),
                };
                let features: Vec<Feature> = wires.iter().map(|(_, wire)| *wire).collect();
                follow(sequence, &poses, &features, &start)?
            }
            (clicked, None) => clicked.ok_or_else(|| usage("no pixels are given", "give --pixels"))?,
        };
        let centre = config.as_ref().and_then(PlusConfig::array_centre_px);
        let known = config
            .as_ref()
            .and_then(|config| config.transform("Image", &poses.marker).ok());
        if let Some(known) = known {
            let [column, row] = calibration.mean_px;
            let pixel = Point3::new(column, row, 0.0);
            let matrix = &calibration.image_to_probe.0;
            let angle = |column: usize| {
                let [a, b] = [matrix, &known].map(|matrix| matrix.fixed_view::<3, 1>(0, column).into_owned());
                a.angle(&b).to_degrees()
            };
            let distance_mm = (matrix.transform_point(&pixel) - known.transform_point(&pixel)).norm();
            let text = format!(
                "the configuration's own ImageTo{} differs by {distance_mm:.2} mm in the middle of the pixels, rows by {:.1} and \
                 columns by {:.1} degrees",
                poses.marker,
                angle(0),
                angle(1)
            );
            if angle(0).max(angle(1)) > FAR_DEG || distance_mm > FAR_MM {
                terminal::warn(format_args!(
                    "{text}: is the phantom that of the configuration, and did the marker stay where it was?"
                ));
            } else {
                terminal::note(text);
            }
        }
        self.output
            .write(&calibration, &Sheet::image(&calibration, &poses.marker, centre))
    }
}

/// Differences from the calibration of a configuration that are questioned, degrees and mm.
const FAR_DEG: f64 = 5.0;
const FAR_MM: f64 = 3.0;

/// Frame of the marker on the phantom in configurations of PLUS.
const PHANTOM_MARKER: &str = "Reference";

/// Wires of the phantom in the frame that the poses lead to.
fn wires(config: Option<&PlusConfig>, tracker: &str) -> Result<Vec<(String, Feature)>, Error> {
    let Some(config) = config.filter(|config| !config.wires().is_empty()) else {
        return Ok(Vec::new());
    };
    let placed = match config.registration() {
        // PLUS registers the phantom to the marker on it.
        Some(_) if tracker != PHANTOM_MARKER => {
            return Err(usage(
                format!("the poses lead to `{tracker}`, and the phantom is registered to `{PHANTOM_MARKER}`"),
                format!("give a --transform to {PHANTOM_MARKER}, such as ProbeTo{PHANTOM_MARKER}"),
            ));
        }
        Some(registration) => *registration,
        None => config.transform("Phantom", tracker)?,
    };
    let placed = config
        .wires()
        .iter()
        .map(|wire| Ok((wire.name.clone(), Feature::wire(wire, &placed)?)));
    Ok(placed.collect::<Result<_, TrackingError>>()?)
}

fn pixels(path: &Path, wires: &[(String, Feature)]) -> Result<Vec<Pixel>, TrackingError> {
    const PLACE: [&str; 3] = ["x_mm", "y_mm", "z_mm"];
    let table = Csv::read(path, &["frame", "u_px", "v_px"], &["x_mm", "y_mm", "z_mm", "wire"])?;
    let pixel = |row: insonify_base::csv::Row<'_>| {
        let name = row.text("wire");
        let feature = match wires.iter().find(|(wire, _)| wire == name) {
            _ if name.is_empty() => Feature::Point(row.numbers(PLACE)?.into()),
            Some((_, wire)) => *wire,
            None => {
                let names: Vec<String> = wires.iter().map(|(name, _)| name.clone()).collect();
                let names = insonify_base::text::some_of(&names);
                return Err(row.wrong("wire", format!("a wire of --plus-config: {names}")));
            }
        };
        Ok(Pixel {
            frame: row.count("frame")?,
            at: row.numbers(["u_px", "v_px"])?,
            feature,
        })
    };
    Ok(table.rows().map(pixel).collect::<Result<_, _>>()?)
}
