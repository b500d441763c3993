//! Resolution of a scene file to a renderable scene.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

use nalgebra::{Matrix4, Point3, Vector3};

use super::check::Framing;
use super::deform::Deformation;
use super::file::{PoseTable, SceneFile, TextureSpec, Version, VolumeKind};
use super::motion::Needle;
use super::recording::{CROP, Recording};
use super::target::Body;
use super::{At, Scene, Timeline, doubts};
use crate::effects::slice::Boundary;
use crate::synth::tables::{Anatomy, ImageSize, Settings};
use insonify_anatomy::acoustics::{TissueError, TissueTable, bank};
use insonify_anatomy::phantom::{self, Phantom, PhantomOptions};
use insonify_anatomy::registration::{Quadratic, resample};
use insonify_anatomy::segmentation::{Names, Naming, open_on};
use insonify_anatomy::volume::complete::{CompleteOptions, complete, with_ct};
use insonify_anatomy::volume::texture::{SolidTexture, TextureOptions};
use insonify_anatomy::volume::{LabelVolume, VolumeError, load_scalar, structures};
use insonify_base::document::{InputError, InvalidFile, nearest};
use insonify_base::matrix::Rows;
use insonify_base::note::Notes;
use insonify_base::range::ByKind;
use insonify_base::stage;
use insonify_tracking::pose::Pose;
use insonify_tracking::probe::{BeamGrid, ProbeSpec, Ray, Site};
use insonify_tracking::trajectory::Trajectory;
use insonify_tracking::world::World;

impl SceneFile {
    /// Loads or generates everything that the scene names, fills in defaults and checks it. Relative paths start at
    /// `base_dir`, the folder of the scene file.
    ///
    /// # Errors
    /// [`InputError`] with the key and its place in the file.
    pub fn resolve(&self, base_dir: &Path) -> Result<Scene, InputError> {
        let mut notes: Notes = self.source.iter().flat_map(|source| source.renamed()).collect();
        match self.with_usual_volume(&mut notes) {
            Some(file) => file.resolved(base_dir, notes),
            None => self.resolved(base_dir, notes),
        }
    }

    /// The file with the usual volume, if it names none. `None` if it does, or has keys that belong to another volume.
    fn with_usual_volume(&self, notes: &mut Notes) -> Option<Self> {
        let mut volume = self.volume.clone().unwrap_or_default();
        let is_open = volume.phantom.is_none() && volume.file.is_none();
        if !is_open || volume.misplaced(VolumeKind::Phantom).is_some() {
            return None;
        }
        volume.phantom = Some(Phantom::default());
        notes.push("the scene names no volume: it shows the phantom `abdomen`".to_owned());
        Some(Self {
            volume: Some(volume),
            ..self.clone()
        })
    }

    fn resolved(&self, base_dir: &Path, mut notes: Notes) -> Result<Scene, InputError> {
        let mut warnings = Vec::new();
        let plus = self.plus_config(base_dir)?;
        let mut framing = self.framing(plus.as_ref(), &mut notes, &mut warnings)?;
        let path = self.probe_path(base_dir, plus.as_ref(), &mut notes, &mut warnings)?;
        if path.is_some() && self.pose.as_ref().is_some_and(PoseTable::places) {
            let found = "both `[pose]` and a path in `[motion]`";
            return Err(self.wrong_keys(
                "pose",
                found,
                "one of them, or `pose.target` alone: what the path is to show",
            ));
        }
        let columns = path.as_ref().map_or(&[][..], |path| &path.columns);
        let variation = self.variation(columns, plus.clone(), path.is_none())?;
        let needle = self.needle(base_dir, plus.as_ref(), &mut notes, &mut warnings)?;
        let textures = self.textures(base_dir)?;
        self.check_texture_names(&textures)?;

        // Only now, as reading takes long: contradictions in the file have been refused.
        // What is the same in each run of a file is told last.
        let mut of_volume = Notes::default();
        let volume = self.load_volume(base_dir, &mut of_volume, &mut warnings)?;
        let preset = self.volume()?.preset.unwrap_or_default();
        let (mut tissues, assumed) = TissueTable::resolve(volume.labels(), &self.tissue, preset)
            .map_err(|error| self.fault(self.tissue_key(&error), error))?;
        warnings.extend(assumed);
        if let Some(variation) = &variation {
            let new = variation.doubts.iter().filter(|doubt| !warnings.contains(doubt));
            let new: BTreeSet<String> = new.cloned().collect();
            warnings.extend(new);
            warnings.extend(variation.absent_tissues(&volume, &tissues));
        }
        let body = Body {
            volume: &volume,
            tissues: &tissues,
        };
        if let (Some(_), Some(target)) = (&path, self.pose.as_ref().and_then(|pose| pose.target.as_ref())) {
            body.named(target)
                .ok_or_else(|| self.no_target(target, &body, &warnings))?;
        }
        let mut pose_of_file = self.pose.clone();
        let (mut probe, recorded, mut tracked) = match path {
            Some(path) => (path.trajectory, path.recorded, path.recording),
            None => {
                let pose = stage::during("placing the probe", || {
                    self.fixed_pose(&body, &framing, &mut notes, &mut warnings)
                })?;
                self.deepen(&body, &pose, &mut framing, &mut notes)?;
                pose_of_file = Some(PoseTable {
                    matrix: Some(Rows(*pose.probe_to_world())),
                    ..PoseTable::default()
                });
                (Trajectory::fixed(pose), false, None)
            }
        };
        let at_rest = probe.at(probe.start_s());
        let pressing = self.pressing(
            &body,
            (&at_rest, &framing.probe, &framing.grid),
            &mut notes,
            &mut warnings,
        )?;
        if let Some(pressing) = &pressing {
            probe = Trajectory::fixed(pressing.pose);
        }
        let pressing = pressing.map(|pressing| (pressing.mesh, pressing.motion));
        let deformation = self.deformation(&body, base_dir, pressing, &mut notes, &mut warnings)?;
        let mut file = Self {
            pose: pose_of_file,
            ..self.filled(&framing)
        };
        let needle = self.in_world(needle, &probe)?;
        let image = self.on_grid(framing.image, tracked.as_ref())?;
        settle(&image, &mut file, tracked.as_mut());
        // Beside the volume there is nothing to touch, and which axes were assumed matters less than that nothing is
        // seen.
        let mut blind = outside(&body, &framing.grid, &probe, self.stated_world());
        if let Some(blind) = blind
            .as_mut()
            .filter(|blind| tracked.is_some() && blind.ends_with(" apart"))
        {
            blind.push_str(". `tracker_to_world` under [motion.sequence] says where the tracker is in the world");
        }
        let is_on_skin = framing.probe.shape.kind().site() == Site::Skin;
        if blind.is_none() && is_on_skin && self.stated_world().is_some() {
            warnings.extend(doubts::of_positions(&body, &framing.grid, &probe));
        }
        let slice = &framing.effects.slice;
        if self.volume()?.file.is_some() && slice.boundary == Boundary::Smooth {
            of_volume.extend(doubts::thin_parts(&body));
        }
        if blind.is_none() {
            notes.extend(self.assumed_worlds());
            let contact = framing.effects.contact.as_ref();
            warnings
                .extend(contact.and_then(|contact| without_contact(&volume, &framing.grid, &probe, contact.reach_mm)));
        }
        warnings.extend(blind.clone());
        notes.extend(of_volume);

        let timeline = self.timeline(&probe, recorded, needle.as_ref(), deformation.as_ref());
        let is_file = self.volume()?.file.is_some();
        let states_direction = |name: &str| {
            let mut stated = self.tissue.iter().filter(|tissue| tissue.texture_direction.is_some());
            !is_file || stated.any(|tissue| tissue.name == name)
        };
        let inwards = is_on_skin.then(|| at_rest.axial().into_inner().into());
        tissues.follow(&volume, inwards, states_direction);
        let mut scene = Scene {
            anatomy: Anatomy {
                volume: Arc::new(volume),
                tissues: Arc::new(tissues),
                textures,
                mesh: deformation.as_ref().map(|deformation| Arc::clone(&deformation.mesh)),
            },
            settings: Settings {
                seed: self.seed,
                probe: framing.probe,
                image,
                effects: framing.effects,
                has_needle: needle.is_some(),
                layers: Vec::new(),
            },
            quality: self.quality.unwrap_or_default(),
            open_grid: framing.open_grid,
            origins: framing.origins,
            notes,
            warnings,
            file,
            probe,
            recording: tracked.map_or_else(Vec::new, |tracked| tracked.frames),
            needle,
            deformation,
            timeline,
            variation: variation.map(Arc::new),
            target: self.pose.as_ref().and_then(|pose| pose.target.clone()),
            blind,
        };
        scene.warnings.extend(scene.unseen_needle());
        scene.warnings.extend(scene.idle_compounding(self.scanner.is_some()));
        scene.warnings.extend(self.needle.as_ref().and_then(doubts::of_needle));
        scene.warnings.extend(scene.reversed_needle());
        Ok(scene)
    }

    /// Number of frames, read without the volume; `None` if it depends on more, or the file has faults.
    pub fn frame_count(&self, base_dir: &Path) -> Option<usize> {
        let (mut notes, mut warnings) = (Notes::default(), Vec::new());
        let plus = self.plus_config(base_dir).ok()?;
        let path = self
            .probe_path(base_dir, plus.as_ref(), &mut notes, &mut warnings)
            .ok()?;
        let needle = self.needle(base_dir, plus.as_ref(), &mut notes, &mut warnings).ok()?;
        let still = Trajectory::fixed(Pose::from_matrix(&Matrix4::identity()).ok()?);
        let (probe, recorded) = path.map_or((still, false), |path| (path.trajectory, path.recorded));
        let timeline = self.timeline(&probe, recorded, needle.as_ref(), None);
        (!self.moves_tissue()).then(|| timeline.frames())
    }

    /// Times of frames; `recorded` tells whether each pose of the probe's path is a frame of its own.
    fn timeline(
        &self,
        probe: &Trajectory,
        recorded: bool,
        needle: Option<&Needle>,
        deformation: Option<&Deformation>,
    ) -> Timeline {
        let span = |path: &Trajectory| [path.start_s(), path.end_s()];
        let times = |path: &Trajectory| path.keys().iter().map(|key| key.time_s).collect();
        let mut spans = Vec::new();
        let mut recording: Option<Vec<f64>> = recorded.then(|| times(probe));
        if self.motion.is_some() && probe.keys().len() > 1 {
            spans.push(span(probe));
        }
        if let Some(Needle::Moving { path, recorded }) = needle {
            spans.push(span(path.tip()));
            if *recorded && recording.is_none() && spans.len() == 1 {
                recording = Some(times(path.tip()));
            }
        }
        let [ramp, breath] = deformation.map_or([None; 2], Deformation::spans_s);
        if let Some(ramp) = ramp {
            let start = spans.iter().map(|span| span[0]).reduce(f64::min).unwrap_or(0.0);
            spans.push(ramp.map(|time| start + time.max(0.0)));
        }
        // Where nothing else moves, one breath is rendered, or one beat without breathing.
        if spans.is_empty() {
            spans.extend(breath);
        }
        let stated = self.motion.as_ref().and_then(|motion| motion.frames);
        Timeline::new(recording, &spans, stated.map(|frames| frames as usize))
    }

    fn filled(&self, framing: &Framing) -> Self {
        Self {
            probe: Some(ProbeSpec::from(framing.probe)),
            image: Some(self.image.unwrap_or_default()),
            version: Some(Version::NEWEST),
            scanner: Some(framing.scanner),
            effects: Some((&framing.effects).into()),
            source: None,
            ..self.clone()
        }
    }

    fn load_volume(
        &self,
        base: &Path,
        notes: &mut Notes,
        warnings: &mut Vec<String>,
    ) -> Result<LabelVolume, InputError> {
        let spec = self.volume()?;
        if let Some(kind) = spec.phantom {
            let options = PhantomOptions {
                resolution_mm: spec.resolution_mm,
                seed: spec.seed.unwrap_or_default(),
            };
            return stage::during("making the phantom", || phantom::make(kind, &options))
                .at(self, "volume.resolution_mm");
        }
        let path = base.join(spec.file.as_deref().unwrap_or(Path::new("")));
        let table = spec.names.as_ref().map(|names| Names::read(&base.join(names)));
        let claimed: Vec<i64> = self.tissue.iter().flat_map(|tissue| tissue.labels.clone()).collect();
        let claimed_names: Vec<String> = self
            .tissue
            .iter()
            .flat_map(|tissue| tissue.label_names.clone())
            .collect();
        let naming = Naming {
            names: table.transpose().at(self, "volume.names")?,
            preset: spec.preset.unwrap_or_default(),
            claimed: &claimed,
            claimed_names: &claimed_names,
        };
        let fault = |error: VolumeError| {
            let error = match error {
                // Completion adds labels to those of the file.
                VolumeError::TooManyLabels(_) => error.in_file(&path),
                error => error,
            };
            self.fault(format!("volume.{}", error.key().unwrap_or("file")), error)
        };
        let opened = stage::during("reading labels", || open_on(&path, &naming, spec.resolution_mm)).map_err(fault)?;
        notes.extend(opened.notes);
        warnings.extend(opened.warnings);
        let usual = CompleteOptions::default();
        let options = CompleteOptions {
            mode: spec.unlabelled.unwrap_or(usual.mode),
            muscle_mm: spec.muscle_mm.unwrap_or(usual.muscle_mm),
            fat_mm: spec.fat_mm.unwrap_or(usual.fat_mm),
            skin_mm: spec.skin_mm.unwrap_or(usual.skin_mm),
        };
        let ct = spec
            .ct
            .as_ref()
            .map(|ct| load_scalar(&base.join(ct)).at(self, "volume.ct"));
        let ct = ct.transpose()?;
        let completed = stage::during("completing the body", || match &ct {
            Some(ct) => with_ct(&opened.volume, ct, &options),
            None => complete(&opened.volume, &options),
        })
        .map_err(fault)?;
        notes.push(completed.note);
        // Warned of only where the mode is the default: who states it has chosen.
        if spec.unlabelled.is_none() {
            warnings.extend(completed.warning);
        }
        let mut volume = completed.volume;
        if spec.structures.unwrap_or(true) {
            let structured = stage::during("drawing structures", || structures::add(&volume)).map_err(fault)?;
            notes.extend(structured.note);
            volume = structured.volume;
        }
        let (volume, merged) = volume.by_organ(&opened.volume).map_err(fault)?;
        warnings.extend(merged);
        // Last, so that completed tissue and drawn structures deform with the labels.
        match &spec.registration {
            Some(path) => {
                let map = Quadratic::read(&base.join(path)).at(self, "volume.registration")?;
                stage::during("warping the labels", || resample(&volume, &map)).at(self, "volume.registration")
            }
            None => Ok(volume),
        }
    }

    /// Key of the table that places the probe in the world, and its axes.
    fn stated_world(&self) -> Option<(&'static str, World)> {
        let motion = self.motion.as_ref().filter(|motion| motion.moves_probe());
        let pose = self.pose.as_ref().filter(|pose| pose.is_explicit());
        let motion = motion.map(|motion| ("motion", motion.world.unwrap_or_default()));
        motion.or_else(|| pose.map(|pose| ("pose", pose.world.unwrap_or_default())))
    }

    /// Notes about tracked sequences whose position in the world is left open.
    fn assumed_worlds(&self) -> Vec<String> {
        let probe = self.motion.as_ref().filter(|motion| motion.world.is_none());
        let probe = probe.is_some_and(|motion| motion.sequence.is_some());
        let needle = self.needle.as_ref().filter(|needle| needle.world.is_none());
        let inherits = self.motion.as_ref().is_some_and(|motion| motion.world.is_some());
        let needle = needle.filter(|_| !inherits);
        let needle =
            needle.is_some_and(|needle| needle.motion.as_ref().is_some_and(|motion| motion.sequence.is_some()));
        let open = [("motion", probe), ("needle", needle)];
        let note = |(table, _): (&str, bool)| {
            format!(
                "tracked poses and `tracker_to_world` are taken as LPS; `world = \"ras\"` under [{table}] takes them as RAS, as \
                 3D Slicer does"
            )
        };
        open.into_iter().filter(|(_, open)| *open).map(note).collect()
    }

    fn textures(&self, base: &Path) -> Result<BTreeMap<String, Arc<SolidTexture>>, InputError> {
        let mut textures = BTreeMap::new();
        for (index, spec) in self.texture.iter().enumerate() {
            let key = |key: &str| format!("texture[{index}].{key}");
            if spec.name.trim().is_empty() || textures.contains_key(&spec.name) {
                let found = format!("the name \"{}\"", spec.name);
                return Err(self.wrong_keys(key("name"), found, "a name that no other texture has"));
            }
            let texture = self.texture(spec, base, &key)?;
            textures.insert(spec.name.clone(), Arc::new(texture));
        }
        Ok(textures)
    }

    fn texture(
        &self,
        spec: &TextureSpec,
        base: &Path,
        key: &dyn Fn(&str) -> String,
    ) -> Result<SolidTexture, InputError> {
        let image = load_scalar(&base.join(&spec.file)).at(self, &key("file"))?;
        let options = TextureOptions {
            values: spec.values,
            seam: spec.seam,
        };
        let spacing_mm = spec.spacing_mm.unwrap_or(image.spacing_mm);
        SolidTexture::from_scalar(image.size, spacing_mm, image.data, &options).map_err(|error| {
            let field = match error.key() {
                Some("spacing_mm") if spec.spacing_mm.is_some() => "spacing_mm",
                Some("db_per_unit") => "values",
                Some("share") => "seam",
                _ => "file",
            };
            self.fault(key(field), error)
        })
    }

    pub(super) fn check_texture_names(&self, textures: &BTreeMap<String, Arc<SolidTexture>>) -> Result<(), InputError> {
        let mut known: Vec<&str> = bank::names().collect();
        known.extend(textures.keys().map(String::as_str).chain(["none"]));
        for (index, tissue) in self.tissue.iter().enumerate() {
            if let Some(name) = &tissue.texture
                && !known.contains(&name.as_str())
            {
                let help = nearest(name, known.iter().copied()).map(|meant| format!("did you mean \"{meant}\"?"));
                let wrong = InvalidFile::name(name, &format!("one of {}", known.join(", ")));
                let error = self.fault(format!("tissue[{index}].texture"), wrong);
                return Err(error.with_help(help));
            }
        }
        Ok(())
    }

    fn tissue_key(&self, error: &TissueError) -> String {
        let index = match error {
            TissueError::Unnamed { position } => position.checked_sub(1),
            _ => error
                .tissue()
                .and_then(|name| self.tissue.iter().rposition(|tissue| tissue.name == name)),
        };
        index.map_or_else(
            || "tissue".to_owned(),
            |index| format!("tissue[{index}].{}", error.key()),
        )
    }
}

/// Sets the frame size of the recorded grid; on other grids removes the recorded crop, as their pixels differ.
fn settle(image: &ImageSize, file: &mut SceneFile, recording: Option<&mut Recording>) {
    if image.placed.is_none() {
        for frame in recording.into_iter().flat_map(|recording| &mut recording.frames) {
            frame.transforms.remove(CROP);
        }
    } else if let Some(spec) = &mut file.image {
        (spec.width, spec.height) = (image.width as u32, image.height as u32);
    }
}

/// Units that positions may be in where mm are expected, and their lengths in mm.
pub(super) const UNITS: [(&str, f64); 2] = [("m", 1000.0), ("cm", 10.0)];

/// A pose with its position in another unit.
pub(super) fn scaled(pose: &Pose, factor: f64) -> Option<Pose> {
    let mut matrix = *pose.probe_to_world();
    matrix.fixed_view_mut::<3, 1>(0, 3).scale_mut(factor);
    Pose::from_matrix(&matrix).ok()
}

/// Warning about poses of a path that show nothing of the volume. If the other reading of the axes of `stated` (a table
/// and its axes) shows more, it says what to change.
fn outside(body: &Body<'_>, grid: &BeamGrid, path: &Trajectory, stated: Option<(&str, World)>) -> Option<String> {
    let poses = path.keys().len();
    let blind = |turn: World| {
        let unseen = |pose: &Pose| !sees(body, grid, &pose.in_lps(turn));
        path.keys().iter().filter(|key| unseen(&key.pose)).count()
    };
    let black = blind(World::Lps);
    let mut warning = match (black, poses) {
        (0, _) => return None,
        (1, 1) => "the probe sees nothing of the volume".to_owned(),
        _ => format!("the probe sees nothing of the volume in {black} of {poses} poses"),
    };
    let first = path.keys().iter().find(|key| !sees(body, grid, &key.pose))?;
    let axes = stated.map_or(World::Lps, |(_, world)| world);
    warning.push_str(if poses == 1 {
        ". The"
    } else {
        ". In the first of them the"
    });
    warning.push_str(&beside_volume(body.volume, &first.pose, axes));
    // Lengths in other units come first: axes would then be guessed from nothing.
    let seen_times = |factor: f64| {
        let poses = path.keys().iter().filter_map(|key| scaled(&key.pose, factor));
        poses.filter(|pose| sees(body, grid, pose)).count()
    };
    let units = UNITS.map(|(unit, factor)| (unit, seen_times(factor)));
    if let Some((unit, seen)) = units.into_iter().max_by_key(|(_, seen)| *seen)
        && seen > poses - black
        && seen > poses / 2
    {
        warning.push_str(&format!(
            ". Are the positions in {unit}? In mm as expected it would see the volume in {seen}"
        ));
    } else if let Some((table, world)) = stated {
        // The turn between RAS and LPS undoes itself: applied to poses already read, it gives the other
        // reading, whichever was stated.
        let (other, seen) = (world.other(), poses - blind(World::Ras));
        if seen > poses - black {
            let key = other.to_string().to_lowercase();
            let slicer = if other == World::Ras {
                ", as 3D Slicer has them"
            } else {
                ""
            };
            warning.push_str(&format!(
                ". Read as {other} it sees the volume in {seen}: state `world = \"{key}\"` under [{table}] if the poses are \
                 in {other}{slicer}"
            ));
        }
    }
    Some(warning)
}

/// Describes the positions of an array and of the volume in the axes of `world`, and the distance between them.
fn beside_volume(volume: &LabelVolume, pose: &Pose, world: World) -> String {
    let ends = volume.size().map(|count| [-0.5, count as f64 - 0.5]);
    let [mut low, mut high] = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
    for corner in 0..8 {
        let index = [0, 1, 2].map(|axis| ends[axis][corner >> axis & 1]);
        let corner = volume.index_to_world().transform_point(&Point3::from(index));
        let corner = world.vector(corner.into());
        low = [0, 1, 2].map(|axis| low[axis].min(corner[axis]));
        high = [0, 1, 2].map(|axis| high[axis].max(corner[axis]));
    }
    let centre = world.vector(pose.position_mm().into());
    let gaps = [0, 1, 2].map(|axis| (low[axis] - centre[axis]).max(centre[axis] - high[axis]).max(0.0));
    let distance = Vector3::from(gaps).norm();
    let [centre, low, high] = [centre, low, high].map(|point| {
        let [x, y, z] = point.map(|along| along.round() as i64);
        format!("({x}, {y}, {z})")
    });
    let apart = if distance > 0.0 {
        format!("{distance:.0} mm apart")
    } else {
        "within it, and only air lies before it".to_owned()
    };
    format!(" centre of the array is at {centre} mm and the volume spans {low} to {high} mm ({world}): {apart}")
}

/// Number of scanlines and of depths at which [`sees`] looks first.
const LOOKS: usize = 24;

/// Percentage of the array without contact above which a warning is given.
const MAX_DARK_PERCENT: usize = 25;

/// Warning about poses at which much of the array has no body within reach.
fn without_contact(volume: &LabelVolume, grid: &BeamGrid, path: &Trajectory, reach_mm: f64) -> Option<String> {
    let dark = |pose: &Pose| {
        let is_dark = |ray: &&Ray| {
            let touches = |depth: f64| {
                let [x, y] = [0, 1].map(|axis| ray.origin[axis] + depth * ray.direction[axis]);
                let point = pose.probe_to_world().transform_point(&Point3::new(x, y, 0.0));
                volume.label_index_at(&point).is_some_and(|label| label > 0)
            };
            !(0..=LOOKS).any(|look| touches(reach_mm * look as f64 / LOOKS as f64))
        };
        let step = (grid.lines() / LOOKS).max(1);
        let looked = grid.rays().len().div_ceil(step);
        100 * grid.rays().iter().step_by(step).filter(is_dark).count() / looked
    };
    let worst = path.keys().iter().map(|key| dark(&key.pose)).max()?;
    (worst > MAX_DARK_PERCENT).then(|| {
        format!(
            "{worst} % of the array has no body within {reach_mm} mm (at the worst pose) and is dark: move the probe, \
             or raise `effects.contact.reach_mm`"
        )
    })
}

/// Whether a scanline meets anything but the air around the body.
pub(super) fn sees(body: &Body<'_>, grid: &BeamGrid, pose: &Pose) -> bool {
    let meets = |line_step: usize, looks: usize| {
        let depth_mm = grid.samples() as f64 * grid.sample_spacing_mm();
        grid.rays().iter().step_by(line_step).any(|ray| {
            (0..looks).any(|look| {
                let depth = (look as f64 + 0.5) / looks as f64 * depth_mm;
                let [x, y] = [0, 1].map(|axis| ray.origin[axis] + depth * ray.direction[axis]);
                let point = pose.probe_to_world().transform_point(&Point3::new(x, y, 0.0));
                body.label_at(&point).is_some()
            })
        })
    };
    // What is smaller than the distance of looks is looked for in all samples.
    meets((grid.lines() / LOOKS).max(1), LOOKS) || meets(1, grid.samples())
}
