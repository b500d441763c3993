//! `insonify register`: anatomy fitted to a physical surface.

use std::path::{Path, PathBuf};

use clap::Args;
use nalgebra::{Point3, Vector3};

use insonify_anatomy::registration::skin::Skin;
use insonify_anatomy::registration::surface::{landmarks, read};
use insonify_anatomy::registration::{
    Known, LANDMARK_MM, Quadratic, Registration, corners, register, resample, unit_doubt,
};
use insonify_anatomy::segmentation;
use insonify_anatomy::volume::complete::{CompleteOptions, complete};
use insonify_anatomy::volume::{Label, LabelVolume, save};
use insonify_base::note::Note;
use insonify_base::range::numbers;
use insonify_base::stage;
use insonify_base::text::some_of;
use insonify_mesh::TetMesh;
use insonify_mesh::file::{MeshFileError, ReadOptions, SURFACES, Unit, read_mesh, write_vtu_with};
use insonify_tracking::calibrate::poses::Poses;
use insonify_tracking::sequence::Sequence;
use insonify_tracking::world::World;

use super::failure::{Error, usage};
use super::input::NamesArg;
use super::output::{self, Force};
use super::terminal;
use super::variants::{ranged, variants};

const TEACHING: &str = "\
Stage 1 is rigid: by landmarks if given, else from the principal axes; then each surface point is drawn to the skin. Stage 2 adds a quadratic
deformation, which also meets the landmarks within --landmark-mm. The map leads from the world, the frame of the surface, to the volume.
The report has the error that is expected at each organ. A fit that stays more than 3 mm (RMS) from the skin is refused without --force.

--surface is a table of touched points (.csv with x_mm,y_mm,z_mm; .fcsv or .mrk.json of 3D Slicer), a scan of the mannequin (.stl, .ply, .obj,
.vtk, .vtp), another segmentation, whose skin is taken, or a tracked sequence of a stylus (.igs.mha) with --transform and --tip.

Examples:
  insonify register labels.nii.gz --surface touched.csv --landmarks marks.csv -o fitted.nrrd --page fit.html
  insonify register labels.nii.gz --surface mannequin.stl --world ras --fit fit.toml
  insonify register labels.nii.gz --surface stylus.igs.mha --transform StylusToReference --tip 0.1,-2.3,148.2 --fit fit.toml
A scene that says `volume.registration = \"fit.toml\"` beside its file applies the registration when it is loaded.";

/// Share of the skin below which a start without landmarks is questioned.
const MIN_COVERED: f64 = 0.3;
/// Number of surface points above which the quadratic map is well determined: at 30 of 1 mm noise it errs by more than
/// the rigid one.
const ENOUGH: usize = 100;
/// Distance of the surface from the skin above which a fit is doubtful, mm RMS.
const MAX_RMS_MM: f64 = 3.0;
/// Distance at which a landmark is doubtful, mm.
const FAR_MM: f64 = 5.0;
/// Rotation above which the axes of the surface, or the start of the fit, are questioned, degrees.
const TURNED_DEG: f64 = 120.0;
/// Least determinant of the Jacobian below which the fit is questioned: people of one build differ by less.
const MIN_JACOBIAN: f64 = 0.6;

/// Fits anatomy to a physical surface: rigid, then quadratic
#[derive(Args)]
#[command(after_help = TEACHING)]
pub(crate) struct Register {
    /// Label file, or a folder of binary masks named by their files
    #[arg(value_name = "VOLUME")]
    volume: PathBuf,
    #[command(flatten)]
    names: NamesArg,
    /// Points of the physical surface: .csv, .fcsv, .mrk.json, .stl, .ply, .obj, .vtk, .vtp, a segmentation, or a
    /// tracked sequence of a stylus
    #[arg(long, value_name = "FILE")]
    surface: PathBuf,
    /// Points known on both sides: CSV with
    /// name,volume_x_mm,volume_y_mm,volume_z_mm,surface_x_mm,surface_y_mm,surface_z_mm
    #[arg(long, value_name = "FILE.csv")]
    landmarks: Option<PathBuf>,
    /// Accuracy of the landmarks: standard deviation of each coordinate
    #[arg(long, value_name = "MM", default_value_t = LANDMARK_MM, value_parser = |text: &str| ranged(text, 0.01..=100.0, "a length in mm from 0.01 to 100"), requires = "landmarks")]
    landmark_mm: f64,
    /// Axes of the surface and of the landmarks' surface_*_mm [default: those that its file states, or lps]
    #[arg(long, value_parser = variants::<World>())]
    world: Option<World>,
    /// Length unit of a surface of triangles; points are in mm
    #[arg(long, value_parser = variants::<Unit>(), default_value = "mm")]
    unit: Unit,
    /// Tracked sequence: transform from the stylus to the reference
    #[arg(long, value_name = "NAME", requires = "tip")]
    transform: Option<String>,
    /// Tracked sequence: tip in the frame of the stylus, mm, from `calibrate pivot`
    #[arg(long, value_name = "X,Y,Z", value_parser = numbers::<3>, allow_hyphen_values = true)]
    tip: Option<[f64; 3]>,
    /// Use the labels as they are, without completing the body around them
    #[arg(long)]
    no_complete: bool,
    /// Write the labels in the world (.nrrd, .nii.gz, .mha)
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Write the map for `volume.registration` of a scene
    #[arg(long, value_name = "FILE.toml")]
    fit: Option<PathBuf>,
    /// Tetrahedral mesh in the volume's frame to carry along; needs --mesh-output
    #[arg(long, value_name = "FILE", requires = "mesh_output")]
    mesh: Option<PathBuf>,
    /// Write the mesh in the world (.vtu)
    #[arg(long, value_name = "FILE.vtu", requires = "mesh")]
    mesh_output: Option<PathBuf>,
    /// Write a page with distances and a picture of both surfaces
    #[arg(long, value_name = "PAGE.html")]
    page: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
    /// Print JSON: `rigid`, `quadratic`, `covered` (share of the skin near surface points), `beyond`, `landmarks_mm`,
    /// `targets_mm` (error expected at each organ)
    #[arg(long)]
    json: bool,
}

impl Register {
    pub(crate) fn run(&self) -> Result<(), Error> {
        let inputs = [
            Some(&self.volume),
            Some(&self.surface),
            self.landmarks.as_ref(),
            self.mesh.as_ref(),
        ];
        let inputs: Vec<PathBuf> = inputs.into_iter().flatten().cloned().collect();
        let force = self.force;
        force.check_ending(&self.page, "html", "pages", &inputs)?;
        force.check_ending(&self.fit, "toml", "registrations", &inputs)?;
        force.check_ending(&self.mesh_output, "vtu", "meshes", &inputs)?;
        if let Some(output) = &self.output {
            force.check(&[output.as_path()], &inputs)?;
        }
        // Before the volume, which takes long to complete.
        let (surface, world) = self.points()?;
        let (volume, labels) = self.open(&self.volume)?;
        let skin = skin_of(&volume)?;
        let mut known = self
            .landmarks
            .as_deref()
            .map(landmarks)
            .transpose()?
            .unwrap_or_default();
        known
            .iter_mut()
            .for_each(|landmark| landmark.surface_mm = in_lps(world, &landmark.surface_mm));
        let known = Known {
            landmarks: &known,
            accuracy_mm: self.landmark_mm,
        };
        let targets = centres(&volume, labels);
        let registration = stage::during("registering", || {
            register(&surface, &skin, &corners(&volume), known, &targets)
        });
        let unit = unit_doubt(&surface, &skin).map(|(doubt, unit)| {
            let remedy = match unit.filter(|_| self.has_triangles()) {
                Some(unit) => format!("state its unit with --unit {unit}"),
                None => "write it in mm".to_owned(),
            };
            (doubt, remedy)
        });
        // Before the volume is resampled, which takes long and is useless under a wrong map.
        let registration = match (registration, unit) {
            (registration, None) => {
                let registration = registration?;
                doubt(&registration, surface.len(), self.force)?;
                self.doubt_axes(&registration, world);
                registration
            }
            // In a wrong unit nothing else fits either.
            (Ok(registration), Some((doubt, remedy))) if fits(&registration) || self.force.is_given() => {
                terminal::warn(format_args!("{doubt}: {remedy}"));
                registration
            }
            (_, Some((doubt, remedy))) => return Err(usage(doubt, remedy)),
        };
        let map = &registration.quadratic.map;
        if let Some(output) = &self.output {
            let resampled = stage::during("warping the labels", || resample(&volume, map))?;
            if let Some(note) = cubes(&volume, &resampled) {
                terminal::note(format_args!("{}: {note}", output.display()));
            }
            save(&resampled, output)?;
        }
        output::requested(&self.fit, || Ok::<_, Error>(map.toml()))?;
        if let (Some(mesh), Some(output)) = (&self.mesh, &self.mesh_output) {
            carry(mesh, output, map)?;
        }
        output::requested(&self.page, || insonify_study::registration::page(&registration, &skin))?;
        terminal::print(&registration, self.json)
    }

    /// Reads a label volume, and closes the body around it unless told not to. Also the number of labels of the file.
    fn open(&self, path: &Path) -> Result<(LabelVolume, usize), Error> {
        let opened = segmentation::open(path, &self.names.naming()?)?;
        let name = path.display();
        let about_file = |note: &Note| terminal::notes(&[note.about(&name)]);
        opened.notes.iter().for_each(about_file);
        opened.warnings.iter().for_each(terminal::warn);
        let labels = opened.volume.labels().len();
        if self.no_complete {
            return Ok((opened.volume, labels));
        }
        let completed = complete(&opened.volume, &CompleteOptions::default());
        let completed = completed.map_err(|error| error.in_file(&self.volume))?;
        about_file(&completed.note);
        completed.warning.iter().for_each(terminal::warn);
        Ok((completed.volume.undivided().clone(), labels))
    }

    fn is_segmentation(&self) -> bool {
        segmentation::stem(&self.surface).is_some() || self.surface.is_dir()
    }

    fn has_triangles(&self) -> bool {
        let ending = self.surface.extension().unwrap_or_default().to_ascii_lowercase();
        self.tip.is_none() && !self.is_segmentation() && SURFACES.iter().any(|known| ending == *known)
    }

    /// Questions a fit that turns a body about its long axis, as wrong axes do, or upside down. Trackers have axes of
    /// any direction, segmentations state theirs.
    fn doubt_axes(&self, registration: &Registration, world: World) {
        if self.tip.is_some() || self.is_segmentation() || !registration.landmarks_mm.is_empty() {
            return;
        }
        let [turn, angle] = [registration.rigid.turn_deg(), registration.rigid.angle_deg()];
        if turn > TURNED_DEG {
            terminal::warn(format_args!(
                "the fit turns the surface by {turn:.0} degrees about the body's long axis, taken as {world}: if its axes are {}, give --world {}",
                world.other(),
                world.other().to_string().to_lowercase()
            ));
        } else if angle > TURNED_DEG {
            terminal::warn(format_args!(
                "the fit turns the surface by {angle:.0} degrees, taken as {world}: head and feet may be exchanged; look at \
                 the page, and give --landmarks"
            ));
        }
    }

    /// Axes of a surface: those stated by the user, or by its file, or RAS where that is the guess for its kind.
    fn axes(&self, is_ras: Option<bool>, guessed_ras: bool) -> World {
        let in_file = is_ras.map(|is_ras| if is_ras { World::Ras } else { World::Lps });
        let name = self.surface.display();
        match (self.world, in_file) {
            (Some(stated), Some(in_file)) if stated != in_file => {
                terminal::warn(format_args!(
                    "{name} states its axes as {in_file}, and --world is {stated}, which is taken"
                ));
            }
            (None, Some(World::Ras)) => {
                terminal::note(format_args!(
                    "{name} states its axes as RAS: taken so, and those of landmarks, too"
                ));
            }
            (None, None) if guessed_ras => {
                terminal::note(format_args!(
                    "{name} does not state its axes: guessed as RAS, which 3D Slicer before 5 wrote, and those of landmarks, too; \
                     give --world lps if they are LPS"
                ));
                return World::Ras;
            }
            _ => {}
        }
        self.world.or(in_file).unwrap_or_default()
    }

    /// Points of the surface, LPS, mm, and its axes.
    fn points(&self) -> Result<(Vec<Point3<f64>>, World), Error> {
        if self.unit != Unit::Mm && !self.has_triangles() {
            let expected = "leave it out: points and recordings are in mm, and segmentations state their unit";
            return Err(usage("--unit without a surface of triangles", expected));
        }
        let world = self.axes(None, false);
        if let Some(tip) = self.tip {
            let sequence = Sequence::read_poses(&self.surface)?;
            let poses = Poses::from_sequence(&sequence, &self.surface, self.transform.as_deref(), &Default::default())?;
            if poses.skipped > 0 {
                terminal::note(format_args!(
                    "{} frames without a valid pose are left out",
                    poses.skipped
                ));
            }
            let touched = poses
                .poses
                .iter()
                .map(|pose| Point3::from(pose.rotation * Vector3::from(tip) + pose.position));
            return Ok((touched.map(|point| in_lps(world, &point)).collect(), world));
        }
        if self.is_segmentation() {
            let skin = skin_of(&self.open(&self.surface)?.0)?;
            return Ok((skin.points().to_vec(), world));
        }
        let read = read(&self.surface, self.unit)?;
        let world = self.axes(read.is_ras, read.guessed_ras);
        if !read.left_out.is_empty() {
            let (name, kinds) = (self.surface.display(), some_of(&read.left_out));
            terminal::note(format_args!(
                "{name}: points and curves are read, markups of other kinds left out: {kinds}"
            ));
        }
        Ok((read.points.iter().map(|point| in_lps(world, point)).collect(), world))
    }
}

fn in_lps(world: World, point: &Point3<f64>) -> Point3<f64> {
    world.vector((*point).into()).into()
}

/// Names and centres of the first labels of a volume, but label 0, mm.
fn centres(volume: &LabelVolume, labels: usize) -> Vec<(String, Point3<f64>)> {
    let mut sums = vec![(Vector3::zeros(), 0.0); volume.labels().len()];
    let [columns, rows, _] = volume.size();
    for (offset, label) in volume.voxels().iter().enumerate() {
        let voxel = [offset % columns, offset / columns % rows, offset / columns / rows];
        let (sum, count) = &mut sums[usize::from(*label)];
        *sum += Vector3::from(voxel.map(|index| index as f64));
        *count += 1.0;
    }
    let labels = volume.labels()[..labels].iter().zip(sums).skip(1);
    let centre = |(label, (sum, count)): (&Label, (Vector3<f64>, f64))| {
        let centre = volume.index_to_world().transform_point(&Point3::from(sum / count));
        let name = label.name.clone().unwrap_or_else(|| format!("label {}", label.value));
        (count > 0.0).then_some((name, centre))
    };
    labels.filter_map(centre).collect()
}

/// Note about the voxels of a resampled volume, where those before were no cubes.
fn cubes(volume: &LabelVolume, resampled: &LabelVolume) -> Option<String> {
    let edges_mm =
        |volume: &LabelVolume| [0, 1, 2].map(|axis| volume.index_to_world().fixed_view::<3, 1>(0, axis).norm());
    let ([x, y, z], [edge_mm, ..]) = (edges_mm(volume), edges_mm(resampled));
    let [columns, rows, slices] = resampled.size();
    let is_cube = [x, y, z].iter().all(|mm| (mm / edge_mm - 1.0).abs() < 0.01);
    (!is_cube).then(|| {
        format!(
            "{columns} x {rows} x {slices} cubes of {edge_mm:.2} mm, which have the volume of the voxels of {x:.2} x {y:.2} x {z:.2} mm \
             in the file"
        )
    })
}

/// Returns whether the surface comes near enough to the skin.
fn fits(registration: &Registration) -> bool {
    registration.quadratic.rms_mm <= MAX_RMS_MM
}

/// Tells what makes a registration of `count` surface points doubtful, and refuses it if it is wrong.
fn doubt(registration: &Registration, count: usize, force: Force) -> Result<(), Error> {
    // A part of the skin resembles others, so that its shape alone may lead the start to the wrong place.
    if registration.covered < MIN_COVERED && registration.landmarks_mm.is_empty() {
        terminal::warn(format_args!(
            "the surface covers {:.0} % of the skin, and the start was found from its shape alone: look at the page, and give --landmarks",
            100.0 * registration.covered
        ));
    }
    if registration.beyond > 0 {
        terminal::note(format_args!(
            "{} of {} surface points lie beyond the end of the skin and are not used",
            registration.beyond, count
        ));
    }
    if count < ENOUGH {
        terminal::warn(format_args!(
            "{} surface points determine the quadratic map poorly: touch {ENOUGH} or more on all sides",
            count
        ));
    }
    let rms_mm = registration.quadratic.rms_mm;
    if !fits(registration) {
        let text = format!("the surface remains {rms_mm:.1} mm (RMS) from the skin: a different body, or a poor start");
        if !force.is_given() {
            let help = format!(
                "give --landmarks, or --world; expected at most {MAX_RMS_MM} mm; --force writes this fit, whose --page shows it"
            );
            return Err(usage(text, help));
        }
        terminal::warn(format_args!("{text}; look at the page, and give --landmarks"));
    }
    if let Some(worst) = registration.worst_target().filter(|worst| worst.expected_mm > FAR_MM) {
        terminal::warn(format_args!(
            "{} is known to {:.1} mm only: touch more points on its side of the body, or give landmarks near it",
            worst.name, worst.expected_mm
        ));
    }
    for landmark in registration
        .landmarks_mm
        .iter()
        .filter(|landmark| landmark.quadratic_mm > FAR_MM)
    {
        terminal::warn(format_args!(
            "landmark {:?} remains {:.1} mm away",
            landmark.name, landmark.quadratic_mm
        ));
    }
    if registration.quadratic.jacobian_min < MIN_JACOBIAN {
        terminal::warn(format_args!(
            "the quadratic map shrinks parts of the volume to {:.2} of their size: is it the surface of this body?",
            registration.quadratic.jacobian_min
        ));
    }
    Ok(())
}

fn skin_of(volume: &LabelVolume) -> Result<Skin, Error> {
    Ok(Skin::of(volume, |label| label > 0)?)
}

/// Writes a mesh of the volume's frame in the world.
fn carry(path: &Path, output: &Path, map: &Quadratic) -> Result<(), Error> {
    let file = read_mesh(path, &ReadOptions::default())?;
    let nodes: Option<Vec<[f64; 3]>> = file
        .mesh
        .nodes()
        .iter()
        .map(|node| map.inverse(&Point3::from(*node)).map(Into::into))
        .collect();
    let Some(nodes) = nodes else {
        let found = format!(
            "{}: the registration cannot be inverted at all of its nodes",
            path.display()
        );
        return Err(usage(found, "carry a mesh of the registered volume"));
    };
    let moved = TetMesh::new(nodes, file.mesh.elements().to_vec(), file.mesh.regions().to_vec());
    let moved = moved.map_err(|source| MeshFileError::Mesh {
        path: path.to_owned(),
        source,
    })?;
    Ok(write_vtu_with(output, &moved, &file.region_names, &[], &[])?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn voxels_that_become_cubes_are_told() {
        let volume = |spacing_mm: [f64; 3]| {
            let background = Label {
                value: 0,
                name: None,
                voxels: 8,
            };
            let index_to_world = nalgebra::Matrix4::new_nonuniform_scaling(&spacing_mm.into());
            LabelVolume::new([2; 3], vec![0; 8], vec![background], index_to_world).expect("a volume")
        };
        let resampled = volume([2.0; 3]);
        assert_eq!(
            cubes(&volume([1.0, 1.0, 8.0]), &resampled).as_deref(),
            Some(
                "2 x 2 x 2 cubes of 2.00 mm, which have the volume of the voxels of 1.00 x 1.00 x 8.00 mm in the file"
            )
        );
        assert_eq!(cubes(&volume([2.0, 2.001, 2.0]), &resampled), None);
    }
}
