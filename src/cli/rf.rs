//! `insonify rf`: radio-frequency echoes of scenes, and B-mode frames from echoes.

use std::fmt::Write as _;
use std::io::Write;
use std::path::{Path, PathBuf};

use clap::Args;
use image::GrayImage;
use serde::Serialize;

use insonify::input::scenario::{self, ScenarioFile};
use insonify::run::{Moment, Observer, Requests, Step, run};
use insonify_base::output::atomic::folder_of;
use insonify_base::output::staged::StagedFile;
use insonify_base::output::{OutputError, png};
use insonify_base::stage::Stage;
use insonify_imaging::rf::bmode::{RANGE_DB, envelope, grey, scan_converted, white};
use insonify_imaging::rf::file::{Echoes, FIELDS};
use insonify_imaging::rf::motion::Options;
use insonify_imaging::rf::scatterers::RfSynthesizer;
use insonify_imaging::rf::truth::{self, Followed};
use insonify_imaging::rf::{Acquisition, SPEED_M_S};
use insonify_imaging::scene::{self, Scene, SceneFile};
use insonify_imaging::sequence::{FrameInfo, SequenceWriter};
use insonify_imaging::synth::{Backend, FrameState};
use insonify_tracking::probe::{BeamGrid, ImageGrid, Linear, Probe, ProbeShape};

use super::backend::{BackendArgs, BackendName};
use super::failure::{Error, usage};
use super::insert::{prepared, resolve};
use super::output::{Force, inputs};
use super::render::frame_count;
use super::terminal;

/// Counts of the RMS of normal liver at the focus: echoes 30 dB above it fit into 16 bits.
const COUNTS: f64 = 1000.0;
/// Largest gain over depth: far beyond the loss of tissue, 0.5 to 1 dB/cm/MHz each way.
const MAX_TGC_DB_CM: f64 = 30.0;

const EXAMPLES: &str = "\
Scatterers are fixed to the tissue at rest and move with its mesh, so that the phase of the echoes follows the motion. The pulse has a
Gaussian envelope; losses are those of effects.shadow, textures those of effects.texture, and lines, depth, centre frequency, bandwidth and
beam widths those of the probe, with widths and focus that effects.speckle states. Other effects do not act on echoes.

Examples:
  insonify rf scene.toml -o rf.igs.mha --frames 20                 echoes of a scene, 16 bits, as PLUS reads them (RF_REAL)
  insonify rf two-layer-insertion -o rf.igs.mha --truth truth.csv  of a scenario at its frame rate, with the true motion
  insonify rf rf.igs.mha --bmode -o frame.png                      the first frame as B-mode
  insonify rf mouse.mha --bmode -o frame.png --pitch-mm 0.1        of a scanner's linear array
  insonify rf rf.igs.mha --bmode -o frame.png --tgc-db-cm 5        with gain over depth
  insonify rf bk.igs.mhd --bmode -o frame.png --depth-mm 80 --radius-mm 10 --angle-deg 150
  insonify motion rf.igs.mha -o u.csv                              motion of the tissue

docs/motion.md has the models.";

/// Synthesises radio-frequency echoes of a scene or scenario, or makes B-mode frames of echoes
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Rf {
    /// Scene or scenario (TOML), or the name of a built-in scenario; with --bmode a sequence of echoes
    #[arg(value_name = "FILE", required_unless_present = "example")]
    input: Option<PathBuf>,
    /// Take the built-in default scene
    #[arg(long, conflicts_with = "input")]
    example: bool,
    /// File to write: .igs.mha or .igs.nrrd; with --bmode .png
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Number of frames of a scene [default: as the scene asks for]
    #[arg(long, value_name = "N", value_parser = frame_count)]
    frames: Option<usize>,
    /// Centre frequency [default: that of the probe]
    #[arg(long, value_name = "MHZ")]
    frequency_mhz: Option<f64>,
    /// Fractional bandwidth of the pulse at half maximum [default: that of the probe]
    #[arg(long, value_name = "SHARE")]
    bandwidth: Option<f64>,
    /// Sampling rate [default: 8 samples a period, or as the file states]
    #[arg(long, value_name = "MHZ")]
    sampling_mhz: Option<f64>,
    /// Echoes of normal liver over electronic noise, dB
    #[arg(long, value_name = "DB", default_value_t = 40.0)]
    snr_db: f64,
    /// Scatterers per resolution cell
    #[arg(long, value_name = "N", default_value_t = 10.0)]
    scatterers: f64,
    /// Write 32-bit floating-point samples on the same scale: neither rounded nor cut off
    #[arg(long, conflicts_with = "bmode")]
    float: bool,
    #[command(flatten)]
    backend: BackendArgs,
    /// Write the true motion at the centres of windows: frame,line,window,depth_mm,axial_um,lateral_um,elevational_um
    #[arg(long, value_name = "FILE.csv")]
    truth: Option<PathBuf>,
    /// Write the true motion of the mesh's nodes: frame,node,axial_um,lateral_um,elevational_um
    #[arg(long, value_name = "FILE.csv")]
    node_truth: Option<PathBuf>,
    /// Windows of --truth along a line
    #[arg(long, value_name = "N", default_value = "120", value_parser = clap::value_parser!(u16).range(1..=10_000))]
    windows: u16,
    /// Length of the windows of --truth, mm
    #[arg(long, value_name = "MM", default_value_t = 1.0)]
    window_mm: f64,
    /// Make a B-mode frame from echoes
    #[arg(long, conflicts_with_all = ["frames", "truth", "node_truth", "frequency_mhz", "example"])]
    bmode: bool,
    #[command(flatten)]
    geometry: Geometry,
    /// With --bmode: number of the frame, from 0
    #[arg(long, value_name = "N", default_value_t = 0, requires = "bmode")]
    frame: usize,
    /// With --bmode: decibels from black to white
    #[arg(long, value_name = "DB", default_value_t = 60.0, requires = "bmode")]
    range_db: f64,
    /// With --bmode: gain over depth (time gain compensation), dB/cm
    #[arg(long, value_name = "DB_CM", default_value_t = 0.0, requires = "bmode")]
    tgc_db_cm: f64,
    #[command(flatten)]
    force: Force,
    /// Print JSON: `lines`, `samples`, `frames`, `sampling_mhz`, `saturated`
    #[arg(long)]
    json: bool,
}

/// Geometry of echoes, where their file does not state it.
#[derive(Args)]
pub(crate) struct Geometry {
    /// Linear array: distance between lines
    #[arg(long, value_name = "MM", conflicts_with_all = ["radius_mm", "angle_deg"])]
    pub pitch_mm: Option<f64>,
    /// Curved array: radius
    #[arg(long, value_name = "MM", requires = "angle_deg")]
    pub radius_mm: Option<f64>,
    /// Curved array: field of view
    #[arg(long, value_name = "DEG", requires = "radius_mm")]
    pub angle_deg: Option<f64>,
    /// Length of the lines [default: from the sampling rate and the speed of sound, 1540 m/s]
    #[arg(long, value_name = "MM")]
    pub depth_mm: Option<f64>,
}

impl Geometry {
    /// Probe of echoes; `None` if neither the file nor the options tell its shape and depth.
    pub(crate) fn probe(
        &self,
        echoes: &Echoes,
        sampling_mhz: Option<f64>,
        speed_m_s: f64,
    ) -> Result<Option<Probe>, Error> {
        let sampled = sampling_mhz.or(echoes.stated[0]);
        let depth = self
            .depth_mm
            .or(sampled.map(|mhz| echoes.samples as f64 * speed_m_s * 1e-3 / (2.0 * mhz)));
        let curved = self
            .radius_mm
            .zip(self.angle_deg)
            .or(echoes.stated[2].zip(echoes.stated[3]));
        let pitch = self.pitch_mm.or(echoes.stated[1]);
        let shape = match (self.pitch_mm, curved, pitch) {
            (None, Some((radius_mm, angle_deg)), _) => ProbeShape::sector(radius_mm, angle_deg),
            (_, _, Some(pitch)) => ProbeShape::Linear(Linear {
                width_mm: pitch * (echoes.lines - 1) as f64,
            }),
            _ => return Ok(None),
        };
        let Some(depth_mm) = depth else { return Ok(None) };
        let mut probe = Probe::new(shape, depth_mm)?;
        (probe.lines, probe.samples) = (echoes.lines as u32, echoes.samples as u32);
        probe.validate()?;
        Ok(Some(probe))
    }
}

#[derive(Serialize)]
struct RfReport {
    lines: usize,
    samples: usize,
    frames: usize,
    sampling_mhz: f64,
    /// Share of the samples beyond 16 bits.
    saturated: f64,
}

impl Rf {
    pub(crate) fn run(&self) -> Result<(), Error> {
        match &self.input {
            Some(input) if self.bmode => self.frame(input),
            _ => self.synthesise(),
        }
    }

    fn frame(&self, input: &Path) -> Result<(), Error> {
        self.force
            .check_ending([&self.output], "png", "frames", &[input.to_owned()])?;
        if !RANGE_DB.contains(&self.range_db) {
            return Err(usage(format!("--range-db {}", self.range_db), "give 10 to 200 dB"));
        }
        if !(0.0..=MAX_TGC_DB_CM).contains(&self.tgc_db_cm) {
            let expected = format!("give 0 to {MAX_TGC_DB_CM} dB/cm");
            return Err(usage(format!("--tgc-db-cm {}", self.tgc_db_cm), expected));
        }
        let echoes = Echoes::read(input)?;
        terminal::notes(&echoes.notes);
        if self.frame >= echoes.frames.len() {
            let found = format!("--frame {} of {} frames", self.frame, echoes.frames.len());
            return Err(usage(found, "frames count from 0"));
        }
        let picture = picture(
            &echoes,
            self.frame,
            self.geometry.probe(&echoes, self.sampling_mhz, SPEED_M_S)?,
            self.range_db,
            self.tgc_db_cm,
        )?;
        let (width, height) = (picture.width() as usize, picture.height() as usize);
        png::write_grey(&self.output, width, height, &picture)?;
        let output = self.output.display();
        terminal::say(format_args!(
            "wrote {output}: frame {}, {width}x{height} pixels",
            self.frame
        ));
        Ok(())
    }

    fn synthesise(&self) -> Result<(), Error> {
        let source = EchoSource::open(self.input.as_deref(), self.frames)?;
        let scene = source.scene();
        let probe = &scene.settings.probe;
        let acquisition = self.acquisition(probe);
        let files = self.input.as_deref().map_or_else(Vec::new, inputs);
        let outputs = [Some(&self.output), self.truth.as_ref(), self.node_truth.as_ref()];
        let outputs: Vec<&Path> = outputs.into_iter().flatten().map(PathBuf::as_path).collect();
        self.force.check(&outputs, &files)?;
        if !(0.05..=probe.depth_mm / 2.0).contains(&self.window_mm) {
            let expected = format!("give 0.05 to {} mm, half of the depth", probe.depth_mm / 2.0);
            return Err(usage(format!("--window-mm {}", self.window_mm), expected));
        }
        self.backend.check()?;
        if let EchoSource::Scene(scene) = &source
            && scene.varies()
        {
            return Err(usage(
                "parameters by frame: echoes are those of one acquisition",
                "leave out [randomise] and columns beside the poses; `insonify render` has them",
            ));
        }
        let synthesizer = RfSynthesizer::new(scene.anatomy.clone(), scene.settings.clone(), acquisition)?;
        // An adapter that is named is wanted in any case: only without a name does `auto` choose.
        let synthesizer = synthesizer.on(match self.backend.backend {
            BackendName::Cpu => Backend::Cpu,
            BackendName::CpuF64 => Backend::CpuF64,
            BackendName::Auto if self.backend.choice().name.is_none() => Backend::Auto,
            BackendName::Auto | BackendName::Gpu => Backend::Adapter(self.backend.choice()),
        })?;
        let mut recorder = Recorder::new(self, synthesizer, &acquisition)?;
        let count = match &source {
            EchoSource::Scene(scene) => self.frames.unwrap_or_else(|| scene.frames()),
            EchoSource::Scenario(scenario) => scenario.timing.moments(scenario.timing.frame_s) as usize,
        };
        let stage = terminal::frames("making echoes", count);
        match &source {
            EchoSource::Scene(scene) => {
                for (index, state) in scene.states(count).enumerate() {
                    recorder.push(scene, &state?, scene.time_s(index, count))?;
                    stage.frame();
                }
            }
            EchoSource::Scenario(scenario) => {
                let mut model = prepared(scenario)?;
                let requests = Requests {
                    frames: true,
                    mesh_s: None,
                };
                let mut frames = Frames {
                    recorder: &mut recorder,
                    scene: &scenario.scene,
                    stage: &stage,
                };
                run(scenario, model.as_mut(), requests, &mut frames)?;
            }
        }
        drop(stage);
        let report = recorder.finish()?;
        self.tell(&report)
    }

    fn acquisition(&self, probe: &Probe) -> Acquisition {
        let usual = Acquisition::new(self.frequency_mhz.unwrap_or(probe.frequency_mhz));
        Acquisition {
            bandwidth: self.bandwidth.unwrap_or(probe.transducer().bandwidth),
            snr_db: self.snr_db,
            per_cell: self.scatterers,
            sampling_mhz: self.sampling_mhz.unwrap_or(usual.sampling_mhz),
            ..usual
        }
    }

    fn tell(&self, report: &RfReport) -> Result<(), Error> {
        if report.saturated > 0.0 {
            terminal::warn(format_args!(
                "{:.3} % of the samples exceed 16 bits and are cut off",
                100.0 * report.saturated
            ));
        }
        if self.json {
            return terminal::emit_json(report);
        }
        let RfReport {
            lines,
            samples,
            frames,
            sampling_mhz,
            ..
        } = report;
        terminal::say(format_args!(
            "wrote {}: {frames} frames of {lines} lines x {samples} samples at {sampling_mhz} MHz",
            self.output.display()
        ));
        Ok(())
    }
}

/// B-mode picture of a frame; in beam space if the geometry is unknown.
fn picture(
    echoes: &Echoes,
    frame: usize,
    probe: Option<Probe>,
    range_db: f64,
    tgc_db_cm: f64,
) -> Result<GrayImage, Error> {
    let mut envelope = envelope(echoes, frame);
    if tgc_db_cm > 0.0 {
        let Some(probe) = &probe else {
            let expected = "give --pitch-mm, or --radius-mm and --angle-deg, and --sampling-mhz or --depth-mm";
            return Err(usage("--tgc-db-cm needs the geometry of the lines", expected));
        };
        let per_sample_db = tgc_db_cm * probe.depth_mm / 10.0 / echoes.samples as f64;
        for line in envelope.chunks_mut(echoes.samples) {
            for (sample, value) in line.iter_mut().enumerate() {
                *value *= 10_f64.powf(per_sample_db * sample as f64 / 20.0) as f32;
            }
        }
    }
    let grey = grey(&envelope, white(&envelope), range_db);
    let Some(probe) = probe else {
        terminal::note(
            "the geometry of the lines is not known: columns are lines, and rows are means of samples; give \
             --pitch-mm, or --radius-mm and --angle-deg, and --sampling-mhz or --depth-mm",
        );
        let wide = (echoes.samples / 512).max(1);
        let rows = echoes.samples / wide;
        let mean = |x: u32, y: u32| {
            let start = x as usize * echoes.samples + y as usize * wide;
            image::Luma([(grey[start..start + wide].iter().sum::<f32>() / wide as f32).round() as u8])
        };
        return Ok(GrayImage::from_fn(echoes.lines as u32, rows as u32, mean));
    };
    let (beam, image) = laid_out(&probe)?;
    let pixels = scan_converted(&grey, &beam, &image, 0);
    let (width, height) = (image.width() as u32, image.height() as u32);
    Ok(GrayImage::from_raw(width, height, pixels).unwrap_or_default())
}

/// Scanlines of a probe, and a picture that shows all of them.
pub(crate) fn laid_out(probe: &Probe) -> Result<(BeamGrid, ImageGrid), Error> {
    /// Largest side of a picture, pixels.
    const SIDE: f64 = 640.0;
    let beam = BeamGrid::new(probe)?;
    let bounds = beam.bounds_mm();
    let [width, height] = [0, 1].map(|axis| bounds.max[axis] - bounds.min[axis]);
    let scale = SIDE / width.max(height);
    let [width, height] = [width, height].map(|mm| ((mm * scale).round() as usize).max(16));
    let image = ImageGrid::fit(&beam, width, height, 0.0)?;
    Ok((beam, image))
}

enum EchoSource {
    Scene(Box<Scene>),
    Scenario(Box<scenario::Scenario>),
}

impl EchoSource {
    fn open(path: Option<&Path>, frames: Option<usize>) -> Result<Self, Error> {
        let Some(path) = path else {
            let scene = SceneFile::parse(scene::DEFAULT, "the default scene")?.resolve(Path::new(""))?;
            return Ok(Self::Scene(Box::new(scene)));
        };
        let base = path.parent().unwrap_or(Path::new(""));
        let table: Option<toml::Table> = std::fs::read_to_string(path).ok().and_then(|text| text.parse().ok());
        let is_scenario = table.is_some_and(|table| table.contains_key("scene"));
        let scenario = match scenario::bundled(path) {
            Some((name, text)) => Some(ScenarioFile::parse(text, name)?),
            None if is_scenario => Some(ScenarioFile::read(path)?),
            None => None,
        };
        let (source, notes, warnings) = match (scenario, frames) {
            (Some(_), Some(frames)) => {
                return Err(usage(
                    format!("--frames {frames} of a scenario, which states its frames"),
                    "state `frame_rate_hz` under [run] instead",
                ));
            }
            (Some(file), None) => {
                let scenario = resolve(&file, base)?;
                let (notes, warnings) = (scenario.notes.clone(), scenario.warnings.clone());
                (Self::Scenario(Box::new(scenario)), notes, warnings)
            }
            (None, _) => {
                let scene = scene::read_or_bundled(path, &[])?.resolve(base)?;
                let (notes, warnings) = (scene.notes.clone(), scene.warnings.clone());
                (Self::Scene(Box::new(scene)), notes, warnings)
            }
        };
        terminal::notes(&notes);
        warnings.iter().for_each(terminal::warn);
        Ok(source)
    }

    fn scene(&self) -> &Scene {
        match self {
            Self::Scene(scene) => scene,
            Self::Scenario(scenario) => &scenario.scene,
        }
    }
}

/// Writes echoes and true motion frame by frame; tables appear under their names at the end.
struct Recorder {
    synthesizer: RfSynthesizer,
    writer: SequenceWriter,
    truth: Option<RowWriter>,
    /// Depths of the windows of the table, mm.
    depths_mm: Vec<f64>,
    nodes: Option<RowWriter>,
    followed: Vec<Followed>,
    frames: usize,
    float: bool,
    saturated: usize,
    sampling_mhz: f64,
}

/// A table that appears under its name when it is complete.
struct RowWriter {
    path: PathBuf,
    staged: StagedFile,
    rows: String,
}

impl RowWriter {
    /// Size at which rows are written, bytes.
    const BUFFER: usize = 1 << 20;

    fn create(path: &Path, head: &str) -> Result<Self, OutputError> {
        Ok(Self {
            staged: StagedFile::within(folder_of(path)).map_err(|cause| OutputError::write(path, cause))?,
            path: path.to_owned(),
            rows: format!("{head}\n"),
        })
    }

    fn row(&mut self, text: std::fmt::Arguments<'_>) -> Result<(), OutputError> {
        // Writing to a string does not fail.
        let _ = writeln!(self.rows, "{text}");
        if self.rows.len() > Self::BUFFER {
            self.flush()
        } else {
            Ok(())
        }
    }

    fn flush(&mut self) -> Result<(), OutputError> {
        let written = self.staged.file.write_all(self.rows.as_bytes());
        self.rows.clear();
        written.map_err(|cause| OutputError::write(&self.path, cause))
    }

    fn finish(mut self) -> Result<(), OutputError> {
        self.flush()?;
        let Self { path, staged, .. } = self;
        staged.persist(&path).map_err(|cause| OutputError::write(&path, cause))
    }
}

impl Recorder {
    fn new(options: &Rf, synthesizer: RfSynthesizer, acquisition: &Acquisition) -> Result<Self, Error> {
        let grid = synthesizer.grid();
        let mut writer = SequenceWriter::create_echoes(
            &options.output,
            synthesizer.samples(),
            synthesizer.lines(),
            options.float,
        )?;
        let angle = grid.angular_spacing() * (grid.lines() - 1) as f64;
        let radius = grid.virtual_apex_mm();
        // Lines of a curved array diverge: a radius and an angle describe them, and a pitch only at one
        // depth.
        let pitch = radius.is_none().then(|| grid.lateral_spacing_mm(0.0));
        let values = [
            Some(acquisition.sampling_mhz),
            pitch,
            radius,
            radius.map(|_| angle.to_degrees()),
        ];
        for (name, value) in FIELDS.iter().zip(values) {
            if let Some(value) = value {
                writer.field(name, &value.to_string());
            }
        }
        let table =
            |path: &Option<PathBuf>, head: &str| path.as_deref().map(|path| RowWriter::create(path, head)).transpose();
        // Depths of windows do not depend on the pitch, for which any number does.
        let windows = Options {
            windows: usize::from(options.windows),
            window_mm: options.window_mm,
            ..Options::new(acquisition.sampling_mhz, 1.0)
        };
        let head = "frame,line,window,depth_mm,axial_um,lateral_um,elevational_um";
        Ok(Self {
            truth: table(&options.truth, head)?,
            depths_mm: windows.centres_mm(synthesizer.samples()),
            nodes: table(&options.node_truth, "frame,node,axial_um,lateral_um,elevational_um")?,
            synthesizer,
            writer,
            followed: Vec::new(),
            frames: 0,
            float: options.float,
            saturated: 0,
            sampling_mhz: acquisition.sampling_mhz,
        })
    }

    fn push(&mut self, scene: &Scene, state: &FrameState, time_s: f64) -> Result<(), Error> {
        let echoes = self.synthesizer.render(state)?;
        let full_scale = f64::from(i16::MAX);
        let counts = echoes.iter().map(|value| f64::from(*value) * COUNTS);
        let bytes: Vec<u8> = if self.float {
            counts.flat_map(|count| (count as f32).to_le_bytes()).collect()
        } else {
            self.saturated += counts.clone().filter(|count| count.abs() > full_scale).count();
            let rounded = counts.map(|count| count.clamp(-full_scale, full_scale).round() as i16);
            rounded.flat_map(i16::to_le_bytes).collect()
        };
        let info = FrameInfo {
            timestamp: time_s,
            transforms: &[("TransducerToWorld", state.probe_to_world, true)],
            image_valid: true,
        };
        self.writer.push(&bytes, &info)?;
        let (frame, pose) = (self.frames, &state.probe_to_world);
        if let Some(table) = &mut self.truth {
            // Windows are laid out in the first frame, and followed as points of the tissue: motion is
            // against that frame.
            if frame == 0 {
                let mesh = scene.anatomy.mesh.as_deref();
                self.followed = truth::windows(&self.synthesizer, mesh, pose, &self.depths_mm);
            }
            for point in &self.followed {
                let [axial, lateral, elevational] = point.motion_um(&self.synthesizer, pose);
                table.row(format_args!(
                    "{frame},{},{},{:.4},{axial:.4},{lateral:.4},{elevational:.4}",
                    point.line, point.window, point.depth_mm
                ))?;
            }
        }
        if let Some(table) = &mut self.nodes {
            for (node, [axial, lateral, elevational]) in truth::nodes(&self.synthesizer, pose).enumerate() {
                table.row(format_args!("{frame},{node},{axial:.4},{lateral:.4},{elevational:.4}"))?;
            }
        }
        self.frames += 1;
        Ok(())
    }

    fn finish(self) -> Result<RfReport, Error> {
        let (lines, samples) = (self.synthesizer.lines(), self.synthesizer.samples());
        self.writer.finish()?;
        for table in self.truth.into_iter().chain(self.nodes) {
            table.finish()?;
        }
        Ok(RfReport {
            lines,
            samples,
            frames: self.frames,
            sampling_mhz: self.sampling_mhz,
            saturated: self.saturated as f64 / (self.frames * lines * samples).max(1) as f64,
        })
    }
}

/// Observer of a scenario's run.
struct Frames<'a> {
    recorder: &'a mut Recorder,
    scene: &'a Scene,
    stage: &'a Stage,
}

impl Observer for Frames<'_> {
    type Error = Error;

    fn step(&mut self, _: &Step<'_>) -> Result<(), Error> {
        Ok(())
    }

    fn frame(&mut self, moment: &Moment<'_>) -> Result<(), Error> {
        self.recorder.push(self.scene, moment.state, moment.time_s)?;
        self.stage.frame();
        Ok(())
    }
}
