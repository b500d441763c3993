//! Writing of frames with their requested companion files.

use std::collections::BTreeMap;
use std::fs;
use std::io::Write;
use std::num::NonZero;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::available_parallelism;

use nalgebra::Matrix4;

use insonify_base::matrix::Rows;
use insonify_base::output::png::{self, Compression};
use insonify_base::output::queue::{Job, Queue};
use insonify_base::output::{OutputError, atomic};
use insonify_imaging::overlay;
use insonify_imaging::scene::Scene;
use insonify_imaging::sequence::{FrameInfo, SequenceWriter, transforms};
use insonify_imaging::sidecar::{self, Files, ImagePlace, LayerFile, NeedlePlace, Provenance, Sidecar};
use insonify_imaging::synth::layers::Layer;
use insonify_imaging::synth::{FrameState, Synthesizer};
use insonify_report::gif::Gif;
use insonify_tracking::needle::{MAX_NODES, NeedlePose};
use insonify_tracking::pose::Pose;

use super::coverage;
use super::extras::{self, Extras};
use super::manifest::{Manifest, Row};
use super::target::{Target, name_of};
use crate::failure::{Error, usage};

/// File of the parameters shared by many frames.
pub(crate) const PARAMETERS: &str = "parameters.json";

/// Interval of frames in a film of a scene without time, s.
const USUAL_FRAME_S: f64 = 0.04;

/// Largest number of threads that write pictures.
const MAX_WRITERS: usize = 16;

/// Writer of frames. Files are compressed and written on other threads.
pub(crate) struct Output<'a> {
    target: Target,
    extras: Extras,
    layers: Vec<Layer>,
    scene: &'a Scene,
    /// Number of expected frames.
    frames: usize,
    /// Compression of pictures.
    compression: Compression,
    pictures: Queue,
    /// Output sequences: the frames, then each layer; empty if they are written as single files.
    sequences: Vec<Stream>,
    /// Whether the shared parameters have been written.
    shared: AtomicBool,
    provenance: Option<Provenance>,
    /// Rows of the frames, if the run has a manifest.
    manifest: Mutex<Option<Manifest>>,
}

/// A file of many frames.
enum Film {
    Sequence(SequenceWriter),
    Gif(Gif),
}

impl Film {
    fn push(&mut self, pixels: &[u8], info: &FrameInfo<'_>) -> Result<(), OutputError> {
        match self {
            Self::Sequence(writer) => writer.push(pixels, info),
            Self::Gif(writer) => writer.push(pixels),
        }
    }

    fn finish(self) -> Result<(), OutputError> {
        match self {
            Self::Sequence(writer) => writer.finish(),
            Self::Gif(writer) => writer.finish(),
        }
    }
}

/// A film and the thread that writes it; `None` once it is finished.
struct Stream {
    writer: Arc<Mutex<Option<Film>>>,
    queue: Queue,
}

/// All that is to be written of a frame.
pub(crate) struct Taken {
    path: PathBuf,
    row: Row,
    /// Parts of the sequences, in their order.
    parts: Vec<Job>,
    pictures: Vec<Job>,
}

/// The last rendered frame.
pub(crate) struct Shot<'a> {
    /// Frame number, from 0.
    pub number: usize,
    /// Time of the frame, s.
    pub time_s: f64,
    /// State from which the frame was rendered.
    pub state: &'a FrameState,
    /// Distance of the needle's tip from the nearest critical structure, mm, if there is one near.
    pub clearance_mm: Option<f64>,
    /// Warnings about the frame.
    pub warnings: &'a [String],
}

impl<'a> Output<'a> {
    /// Creates the folder for numbered files, and starts the sequences if frames go to one.
    pub(crate) fn open(target: Target, extras: &Extras, scene: &'a Scene, frames: usize) -> Result<Self, Error> {
        let is_gif = matches!(&target, Target::Sequence(path, _) if is_gif(path));
        let layers = extras.layers();
        if is_gif && (extras.uncompressed || !layers.is_empty()) {
            let option = if extras.uncompressed {
                "--uncompressed"
            } else {
                "--layers"
            };
            return Err(usage(
                format!("{option} is not for animated pictures (.gif)"),
                "write .mha, .nrrd or .npy, or leave it out",
            ));
        }
        if let (Target::Sequence(path, _), true) = (&target, extras.overlay && !is_gif) {
            return Err(usage(
                format!(
                    "--overlay draws into pictures, and {} is an image sequence",
                    path.display()
                ),
                "write PNG files, or leave out --overlay",
            ));
        }
        if !matches!(target, Target::Sequence(..)) && extras.uncompressed {
            return Err(usage(
                "--uncompressed is for image sequences, and the frames go to PNG files",
                "write .mha or .nrrd, or leave out --uncompressed",
            ));
        }
        let size = scene.settings.image;
        let folder = match &target {
            Target::Folder(folder) => Some(folder),
            Target::Sequence(_, folder) if extras.sidecar || extras.overview => Some(folder),
            _ => None,
        };
        if let Some(folder) = folder {
            fs::create_dir_all(folder).map_err(|cause| OutputError::write(folder, cause))?;
        }
        let mut sequences = Vec::new();
        let mut films = Vec::new();
        if let (Target::Sequence(path, _), true) = (&target, is_gif) {
            let span_s = scene.time_s(frames.saturating_sub(1), frames) - scene.time_s(0, frames);
            let frame_s = if span_s > 0.0 {
                span_s / (frames - 1) as f64
            } else {
                USUAL_FRAME_S
            };
            films.push(Film::Gif(Gif::create(path, size.width, size.height, frame_s)?));
        } else if let Target::Sequence(path, _) = &target {
            sequences.push(SequenceWriter::create(path, size.width, size.height)?);
            for layer in &layers {
                let path = png::layer_path(path, layer.name());
                sequences.push(SequenceWriter::create_layer(&path, size.width, size.height)?);
            }
        }
        let synthetic = format!("insonify {} seed {}", insonify_base::VERSION, scene.settings.seed);
        let described = |mut writer: SequenceWriter| {
            if extras.uncompressed {
                writer = writer.uncompressed()?;
            }
            writer.field("WorldAxes", &scene.motion_world().to_string());
            writer.field("Simulated", &synthetic);
            Ok::<_, OutputError>(Film::Sequence(writer))
        };
        for sequence in sequences {
            films.push(described(sequence)?);
        }
        // One thread a film, as its frames are appended in order.
        let stream = |film: Film| Stream {
            writer: Arc::new(Mutex::new(Some(film))),
            queue: Queue::new(1),
        };
        // Many frames are compressed less, and on threads, so that rendering does not wait for the writing.
        let (compression, writers) = match &target {
            Target::File(_) => (Compression::Usual, 0),
            _ => {
                let cores = available_parallelism().map_or(1, NonZero::get);
                (Compression::Fast, cores.min(MAX_WRITERS))
            }
        };
        Ok(Self {
            target,
            extras: extras.clone(),
            layers,
            scene,
            frames,
            compression,
            pictures: Queue::new(writers),
            sequences: films.into_iter().map(stream).collect(),
            shared: AtomicBool::new(false),
            provenance: None,
            manifest: Mutex::new(None),
        })
    }

    /// The same for frames of the synthesizer `chosen`, whose sidecars say what made them and, in a folder, whose
    /// manifest lists them.
    pub(crate) fn made_by(mut self, provenance: Provenance, synth: &Synthesizer) -> Result<Self, Error> {
        let folder = match &self.target {
            Target::Folder(folder) => Some(folder),
            Target::Sequence(_, folder) => Some(folder).filter(|_| self.extras.sidecar || self.extras.overview),
            Target::File(_) => None,
        };
        if let Some(folder) = folder {
            self.manifest = Mutex::new(Some(Manifest::open(folder, provenance.clone())?));
            // Now, as frames may have settings of their own.
            if self.extras.sidecar {
                self.share(synth, &self.target.picture(0, self.frames))?;
            }
        }
        self.provenance = Some(provenance);
        Ok(self)
    }

    /// Whether a run that was cut off has made a frame.
    pub(crate) fn has(&self, frame: usize) -> bool {
        lock(&self.manifest)
            .as_ref()
            .is_some_and(|manifest| manifest.has(frame))
    }

    /// Writes the parameters that frames share, once.
    fn share(&self, synth: &Synthesizer, picture: &Path) -> Result<(), OutputError> {
        if self.shared.swap(true, Ordering::Relaxed) {
            return Ok(());
        }
        let parameters = extras::parameters(self.scene, synth);
        let path = picture.with_file_name(PARAMETERS);
        self.pictures.put(Box::new(move || {
            atomic::write(&path, |file| writeln!(file, "{parameters:#}"))
        }))
    }

    /// Takes what is to be written of the last frame of a synthesizer, on any thread.
    pub(crate) fn take(&self, synth: &Synthesizer, shot: &Shot<'_>) -> Result<Taken, Error> {
        let frame = synth.frame();
        let picture = self.target.picture(shot.number, self.frames);
        let mut pixels = frame.pixels.clone();
        if self.extras.overlay {
            overlay::draw(&mut pixels, synth.tables());
        }
        let layers = frame.layers.clone();
        let mut files = BTreeMap::from([("image".to_owned(), name_of(&picture))]);
        if !self.sequences.is_empty() {
            files.clear();
        }
        let mut taken = Taken {
            path: picture.clone(),
            row: self.row(synth, shot, files)?,
            parts: Vec::new(),
            pictures: Vec::new(),
        };
        let names: Vec<String> = if self.sequences.is_empty() {
            let (compression, size) = (self.compression, [frame.width, frame.height]);
            let path = picture.clone();
            taken.put(move || png::write_grey_with(compression, &path, size, &pixels));
            let paths = self.layers.iter().map(|layer| png::layer_path(&picture, layer.name()));
            let paths: Vec<PathBuf> = paths.collect();
            for (path, values) in paths.iter().cloned().zip(layers) {
                taken.put(move || png::write_grey16(compression, &path, size, &values));
            }
            paths.iter().map(|path| name_of(path)).collect()
        } else {
            taken.path = self.target.path().to_owned();
            taken.parts = self.parts(synth, shot, pixels, layers);
            // Companions of a sequence lie in a folder beside it: its files are one level up.
            let path = |layer: &Layer| png::layer_path(&taken.path, layer.name());
            let paths = self.layers.iter().map(path);
            paths.map(|path| format!("../{}", name_of(&path))).collect()
        };
        if self.sequences.is_empty() {
            let layers = self.layers.iter().map(|layer| layer.name().to_owned());
            taken.row.files.extend(layers.zip(names.iter().cloned()));
        }
        if self.extras.overview || self.extras.sidecar {
            self.take_companions(synth, shot, &picture, names, &mut taken)?;
        }
        Ok(taken)
    }

    fn row(&self, synth: &Synthesizer, shot: &Shot<'_>, files: BTreeMap<String, String>) -> Result<Row, Error> {
        // As in the sidecar.
        let stated = shot.state.probe_to_world;
        let pose = Pose::from_matrix(&stated).map_or(stated, |pose| *pose.probe_to_world());
        let frame_parameters = self.scene.parameters(shot.number, self.frames)?;
        let drawn_target = frame_parameters.get("pose.target").and_then(serde_json::Value::as_str);
        let target = drawn_target.map(str::to_owned).or_else(|| self.scene.target.clone());
        let label = target.as_deref().and_then(|target| self.scene.body().named(target));
        let share = label.map(|label| coverage::share(synth.tables(), &pose, label));
        Ok(Row {
            frame: shot.number,
            files,
            time_s: shot.time_s,
            probe_to_world: Rows(pose),
            target,
            target_share: share.map(|share| (1e4 * share).round() / 1e4),
            seed: synth.settings().seed,
            frame_parameters,
            warnings: shot.warnings.to_vec(),
        })
    }

    /// Frame and layers as parts of the sequences.
    fn parts(&self, synth: &Synthesizer, shot: &Shot<'_>, pixels: Vec<u8>, layers: Vec<Vec<u16>>) -> Vec<Job> {
        let world = self.scene.motion_world();
        let places = [synth.frame().image_to_world, shot.state.probe_to_world].map(|pose| world.transform(pose));
        let transforms = transforms(places, self.scene.recorded(shot.number, self.frames));
        let owned = transforms
            .iter()
            .map(|&(name, matrix, valid)| (name.to_owned(), matrix, valid));
        let owned: Arc<[(String, Matrix4<f64>, bool)]> = owned.collect();
        let bytes = layers
            .into_iter()
            .map(|values| values.iter().flat_map(|value| value.to_le_bytes()).collect());
        let buffers = [pixels].into_iter().chain(bytes).zip(&self.sequences);
        let time_s = shot.time_s;
        let part = |(pixels, stream): (Vec<u8>, &Stream)| {
            let (writer, owned) = (Arc::clone(&stream.writer), Arc::clone(&owned));
            let job = move || {
                let transforms: Vec<_> = owned
                    .iter()
                    .map(|(name, matrix, valid)| (&**name, *matrix, *valid))
                    .collect();
                let info = FrameInfo {
                    timestamp: time_s,
                    transforms: &transforms,
                    image_valid: true,
                };
                match &mut *lock(&writer) {
                    Some(writer) => writer.push(&pixels, &info),
                    None => Ok(()),
                }
            };
            Box::new(job) as Job
        };
        buffers.map(part).collect()
    }

    fn take_companions(
        &self,
        synth: &Synthesizer,
        shot: &Shot<'_>,
        picture: &Path,
        layers: Vec<String>,
        taken: &mut Taken,
    ) -> Result<(), Error> {
        let pose = Pose::from_matrix(&shot.state.probe_to_world)
            .map_err(|error| usage(error.to_string(), "give a pose that neither stretches nor shears"))?;
        let needle = needle(shot.state);
        if self.extras.overview {
            let path = png::layer_path(picture, "overview");
            taken.row.files.insert("overview".to_owned(), name_of(&path));
            let image = extras::overview_of(synth, &pose, needle.as_ref());
            let (width, height) = (image.width() as usize, image.height() as usize);
            taken.put(move || png::write_rgb(&path, width, height, image.as_raw()));
        }
        if self.extras.sidecar {
            let single = matches!(self.target, Target::File(_));
            if !single {
                self.share(synth, picture)?;
            }
            let sidecar = self.sidecar(synth, shot, (&pose, needle.as_ref()), picture, layers)?;
            let path = Sidecar::path_for(picture);
            taken.row.files.insert("sidecar".to_owned(), name_of(&path));
            taken.put(move || sidecar.write(&path));
        }
        Ok(())
    }

    fn sidecar(
        &self,
        synth: &Synthesizer,
        shot: &Shot<'_>,
        (pose, needle): (&Pose, Option<&NeedlePose>),
        picture: &Path,
        layers: Vec<String>,
    ) -> Result<Sidecar, Error> {
        let grid = &synth.tables().image_grid;
        // Parameters are those of all frames: beside more than one picture they are written once, in a file.
        let single = matches!(self.target, Target::File(_));
        let layers = self.layers.iter().zip(layers).map(|(layer, path)| LayerFile {
            name: layer.name().to_owned(),
            path,
        });
        Ok(Sidecar {
            version: sidecar::VERSION,
            frame: shot.number,
            time_s: shot.time_s,
            seed: synth.settings().seed,
            frame_parameters: self.scene.parameters(shot.number, self.frames)?,
            files: Files {
                image: self.sequences.is_empty().then(|| name_of(picture)),
                layers: layers.collect(),
                overlay: self.extras.overlay,
            },
            image: ImagePlace::new(grid, pose),
            probe_to_world: Rows(*pose.probe_to_world()),
            needle: needle.map(|needle| NeedlePlace {
                clearance_mm: shot.clearance_mm,
                ..NeedlePlace::new(needle, grid, pose)
            }),
            parameters: single.then(|| extras::parameters(self.scene, synth)),
            parameters_file: (!single).then(|| PARAMETERS.to_owned()),
            warnings: self.scene.warnings.iter().chain(shot.warnings).cloned().collect(),
            made_by: self.provenance.clone(),
        })
    }

    /// Hands a frame to the threads that write; returns its path. Frames of sequences are written in the order of the
    /// calls.
    pub(crate) fn write(&self, taken: Taken) -> Result<PathBuf, Error> {
        for (stream, part) in self.sequences.iter().zip(taken.parts) {
            stream.queue.put(part)?;
        }
        taken.pictures.into_iter().try_for_each(|job| self.pictures.put(job))?;
        if let Some(manifest) = &mut *lock(&self.manifest) {
            manifest.add(taken.row)?;
        }
        Ok(taken.path)
    }

    /// Waits until all files are written, and finishes the sequences, that of the frames last.
    pub(crate) fn finish(self) -> Result<(), Error> {
        self.pictures.finish()?;
        lock(&self.manifest).take().map_or(Ok(()), Manifest::finish)?;
        for Stream { writer, queue } in self.sequences.into_iter().rev() {
            let end = move || lock(&writer).take().map_or(Ok(()), Film::finish);
            queue.put(Box::new(end))?;
            queue.finish()?;
        }
        Ok(())
    }
}

impl Taken {
    fn put(&mut self, job: impl FnOnce() -> Result<(), OutputError> + Send + 'static) {
        self.pictures.push(Box::new(job));
    }
}

/// Whether a path is that of an animated picture.
fn is_gif(path: &Path) -> bool {
    path.extension()
        .is_some_and(|ending| ending.eq_ignore_ascii_case("gif"))
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Needle of a frame: the displayed part towards the tip.
fn needle(state: &FrameState) -> Option<NeedlePose> {
    let shaft = state.needle.as_ref()?;
    let nodes = &shaft.nodes[shaft.nodes.len().saturating_sub(MAX_NODES)..];
    NeedlePose::bent(nodes.to_vec(), shaft.diameter_mm).ok()
}
