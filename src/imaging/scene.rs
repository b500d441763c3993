//! Scene files, validated: a TOML file becomes a [`Scene`], in which every effect and model is optional.
//!
//! [`SceneFile`] is the file as written; [`SceneFile::resolve`] loads the files that it names, fills in defaults,
//! checks every number against its range and reports its assumptions. The format is explained by the commented default
//! scene, [`DEFAULT`], and described by [`schema`].
//!
//! ```
//! use insonify_imaging::scene::SceneFile;
//!
//! let file = SceneFile::parse("[volume]\nphantom = \"abdomen\"\nresolution_mm = 4\n", "mine.toml")?;
//! let scene = file.resolve(".".as_ref())?;
//! assert_eq!(scene.frames(), 1);
//!
//! let error = SceneFile::parse("[volume]\nphanton = \"abdomen\"\n", "mine.toml").unwrap_err();
//! assert_eq!(error.location(), Some(("mine.toml", 2)));
//! # Ok::<(), insonify_base::document::InputError>(())
//! ```

mod breathing;
mod check;
pub mod deform;
mod doubts;
mod file;
mod motion;
pub mod paths;
mod press;
mod pulse;
mod recording;
mod resolve;
mod stiffness;
mod target;
mod vary;

pub use file::{PoseTable, SceneFile, TextureSpec, Version, VolumeKind, VolumeSpec};
pub use insonify_tracking::probe::ImageSpec;
pub use paths::{NeedleFrame, NeedleKeyframe, NeedleMotionSpec, NeedleTable};
pub use target::Body;
pub use vary::{Parameters, Randomise};

use std::path::Path;
use std::sync::Arc;

use nalgebra::{Matrix4, Point3};

use crate::effects::table::Origins;
use crate::quality::QualitySpec;
use crate::synth::tables::{Anatomy, Settings};
use crate::synth::{Backend, FrameState, NeedleShaft, SynthError, Synthesizer};
use deform::Deformation;
use insonify_base::blame::Blame;
use insonify_base::document::{self, InputError, InvalidFile, Setting};
use insonify_base::note::Notes;
use insonify_tracking::needle::{NeedlePath, NeedlePose};
use insonify_tracking::pose::Pose;
use insonify_tracking::sequence::SequenceFrame;
use insonify_tracking::trajectory::Trajectory;
use insonify_tracking::world::World;
use motion::Needle;
use vary::Variation;

/// Default scene, with every key explained.
pub const DEFAULT: &str = include_str!("../../assets/default.toml");

/// Built-in scenes, by name: an example of one feature each.
pub const EXAMPLES: &[(&str, &str)] = &[
    ("default", DEFAULT),
    ("liver-needle", include_str!("../../assets/liver-needle.toml")),
    ("prostate-trus", include_str!("../../assets/prostate-trus.toml")),
    ("spine-linear", include_str!("../../assets/spine-linear.toml")),
    ("sweep", include_str!("../../assets/sweep.toml")),
];

/// Reads a scene file in which these keys are set, or the built-in scene of that name where there is no such file.
pub fn read_or_bundled(path: &Path, settings: &[Setting]) -> Result<SceneFile, InputError> {
    match document::bundled(EXAMPLES, path) {
        Some((name, text)) => SceneFile::parse_with(text, name, settings),
        None => SceneFile::parse_with(&document::read(path)?, &path.display().to_string(), settings),
    }
}

/// The JSON schema of a scene file.
pub fn schema() -> serde_json::Value {
    schemars::schema_for!(SceneFile).to_value()
}

/// A scene ready to render: every number in its range, every file read.
///
/// It provides the inputs of a [`Synthesizer`] and the poses of each frame.
///
/// ```
/// use insonify_imaging::scene::SceneFile;
/// use insonify_imaging::synth::FrameState;
///
/// let text = r#"
/// volume = { phantom = "abdomen", resolution_mm = 5 }
/// motion.frames = 5
/// [[needle.motion.keyframes]]
/// time_s = 0
/// tip_mm = [-32.0, -79.6, -7.1]
/// direction = [-20.3, 59.4, -18.0]
/// [[needle.motion.keyframes]]
/// time_s = 1
/// tip_mm = [-52.3, -20.2, -25.1]
/// direction = [-20.3, 59.4, -18.0]
/// "#;
/// let scene = SceneFile::parse(text, "insertion.toml")?.resolve(".".as_ref())?;
/// assert!(scene.settings.has_needle);
///
/// let of = scene.frames();
/// assert_eq!(of, 5);
/// let mut state = FrameState::at(*scene.probe_pose(0, of).probe_to_world());
/// for frame in 0..of {
///     scene.state(frame, of, &mut state)?;
///     let tip = state.needle.as_ref().and_then(|needle| needle.nodes.last());
///     println!("{:.2} s: tip at {tip:?}", scene.time_s(frame, of));
/// }
/// assert!(scene.state(of, of, &mut state).is_err());
/// # Ok::<(), insonify_base::document::InputError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Scene {
    /// Imaged anatomy.
    pub anatomy: Anatomy,
    /// Imaging settings.
    pub settings: Settings,
    /// Time budgets of frames and steps; empty where the scene states none.
    pub quality: QualitySpec,
    /// Whether the scene leaves the numbers of scanlines and samples open.
    pub open_grid: [bool; 2],
    /// Origins of the effects in the scene, and the reasons why it does not have the others.
    pub origins: Origins,
    /// Assumptions made, for the user.
    pub notes: Notes,
    /// Suspicious settings, for the user.
    pub warnings: Vec<String>,
    /// The scene file with probe, image, effects and a constant pose filled in.
    pub file: SceneFile,
    probe: Trajectory,
    recording: Vec<SequenceFrame>,
    needle: Option<Needle>,
    deformation: Option<Deformation>,
    timeline: Timeline,
    /// Warning about poses that see nothing of the volume.
    blind: Option<String>,
    variation: Option<Arc<Variation>>,
    /// Target that the probe is placed over, if the scene file names one.
    pub target: Option<String>,
}

impl Scene {
    /// Number of frames: the stated number, or else one for each pose of a recording, 25 per second of any other
    /// motion, and 1 where nothing moves.
    pub fn frames(&self) -> usize {
        self.timeline.frames()
    }

    /// Time of frame `frame` of `frames`, s. If there are as many frames as recorded poses, recorded times are used;
    /// otherwise frames are evenly spaced.
    pub fn time_s(&self, frame: usize, frames: usize) -> f64 {
        self.timeline.time_s(frame, frames)
    }

    /// Pose of the probe in frame `frame` of `frames`.
    pub fn probe_pose(&self, frame: usize, frames: usize) -> Pose {
        self.probe.at(self.time_s(frame, frames))
    }

    /// Recorded data for frame `frame` of `frames` from the tracked sequence that moves the probe; `None` if the number
    /// of frames differs from that of recorded poses.
    pub fn recorded(&self, frame: usize, frames: usize) -> Option<&SequenceFrame> {
        let keys = self.probe.keys();
        let key = keys.get(frame).filter(|_| keys.len() == frames)?;
        self.recording.get(key.source)
    }

    /// World axes in which the scene states the motion of the probe.
    pub fn motion_world(&self) -> World {
        let motion = self.file.motion.as_ref();
        motion.and_then(|motion| motion.world).unwrap_or_default()
    }

    /// Pose of the needle in frame `frame` of `frames`, if the scene has one.
    pub fn needle_pose(&self, frame: usize, frames: usize) -> Option<NeedlePose> {
        match self.needle.as_ref()? {
            Needle::Still(pose) => Some(pose.clone()),
            Needle::Moving { path, .. } => Some(path.at(self.time_s(frame, frames))),
        }
    }

    /// Labels and their tissues.
    pub fn body(&self) -> Body<'_> {
        Body {
            volume: &self.anatomy.volume,
            tissues: &self.anatomy.tissues,
        }
    }

    /// Returns the scene with a needle that moves as `table` states.
    pub fn with_needle(mut self, table: NeedleTable) -> Result<Self, InputError> {
        self.file.needle = Some(table);
        self.needle = self
            .file
            .needle(Path::new(""), None, &mut self.notes, &mut self.warnings)?;
        self.settings.has_needle = true;
        Ok(self)
    }

    /// Path of the probe.
    pub fn probe_path(&self) -> &Trajectory {
        &self.probe
    }

    /// Replaces the path of the probe.
    pub fn move_probe(&mut self, probe: Trajectory) {
        self.probe = probe;
    }

    /// Path of the needle tip, if the scene has a needle that moves.
    pub fn needle_path(&self) -> Option<&NeedlePath> {
        match self.needle.as_ref()? {
            Needle::Still(_) => None,
            Needle::Moving { path, .. } => Some(path),
        }
    }

    /// Fills in the state of frame `frame` of `frames`, reusing what `into` already holds.
    ///
    /// # Errors
    /// [`InvalidFile::Unknown`] if there is no such frame.
    pub fn state(&self, frame: usize, frames: usize, into: &mut FrameState) -> Result<(), InputError> {
        if frame >= frames {
            let wrong = format!("frame {frame} of {frames}; frames count from 0");
            return Err(InputError::new(InvalidFile::Unknown(wrong)));
        }
        self.fill(frame, frames, into)
    }

    /// States of so many frames, in order; [`frames`](Self::frames) are what the scene asks for. Errors are those of
    /// parameters that the scene states by frame.
    pub fn states(&self, frames: usize) -> impl ExactSizeIterator<Item = Result<FrameState, InputError>> + '_ {
        (0..frames).map(move |frame| {
            let mut state = FrameState::at(Matrix4::identity());
            self.fill(frame, frames, &mut state)?;
            Ok(state)
        })
    }

    /// Whether frames have parameters of their own: by columns beside the poses of the probe, or by `[randomise]`.
    pub fn varies(&self) -> bool {
        self.variation.is_some()
    }

    /// Parameters of frame `frame` of `frames` alone, by the path of their keys. A scene that states these values makes
    /// the same frame.
    ///
    /// # Errors
    /// A table of parameters with another number of rows.
    pub fn parameters(&self, frame: usize, frames: usize) -> Result<Parameters, InputError> {
        let variation = self.variation.as_ref();
        variation.map_or_else(
            || Ok(Parameters::new()),
            |variation| variation.parameters(frame, frames),
        )
    }

    /// Prepares the synthesis of the scene's frames.
    ///
    /// # Errors
    /// The errors of [`Synthesizer::new`].
    pub fn synthesizer(&self, backend: Backend) -> Result<Synthesizer, SynthError> {
        Synthesizer::new(self.anatomy.clone(), self.settings.clone(), backend)
    }

    fn fill(&self, frame: usize, frames: usize, into: &mut FrameState) -> Result<(), InputError> {
        let time_s = self.time_s(frame, frames);
        into.frame = frame as u64;
        into.probe_to_world = *self.probe.at(time_s).probe_to_world();
        match &self.needle {
            None => into.needle = None,
            Some(Needle::Still(pose)) => show(pose, &mut into.needle),
            Some(Needle::Moving { path, .. }) => show(&path.at(time_s), &mut into.needle),
        }
        into.seeds.clear();
        into.reference = None;
        match &self.deformation {
            None => into.nodes = None,
            Some(deformation) => {
                let time_s = time_s - self.timeline.start_s();
                deformation.nodes_at(time_s, into.nodes.get_or_insert_default());
            }
        }
        into.settings = None;
        if let Some(variation) = &self.variation {
            let parameters = variation.parameters(frame, frames)?;
            let shared = (&self.settings, &self.anatomy.tissues);
            let check = |file: &SceneFile| file.check_texture_names(&self.anatomy.textures);
            let (settings, pose) = variation
                .frame(&parameters, &self.anatomy.volume, shared, check)
                .map_err(|error| vary::of_frame(error, frame, &parameters))?;
            // A scene of its own: noise is that of its first frame.
            into.frame = 0;
            into.settings = Some(Arc::new(settings));
            if let Some(pose) = pose {
                into.probe_to_world = *pose.probe_to_world();
            }
        }
        Ok(())
    }
}

fn show(pose: &NeedlePose, shaft: &mut Option<NeedleShaft>) {
    let shaft = shaft.get_or_insert_with(|| NeedleShaft {
        nodes: Vec::new(),
        diameter_mm: 0.0,
    });
    let nodes: &[Point3<f64>] = pose.nodes_mm();
    shaft.nodes.clear();
    shaft.nodes.extend_from_slice(nodes);
    shaft.diameter_mm = pose.diameter_mm();
}

/// Attaches an error to a key of a scene file.
trait At<T> {
    fn at(self, file: &SceneFile, key: &str) -> Result<T, InputError>;
}

impl<T, E: Blame> At<T> for Result<T, E> {
    fn at(self, file: &SceneFile, key: &str) -> Result<T, InputError> {
        self.map_err(|cause| file.fault(key, cause))
    }
}

/// Default number of frames per second of a motion.
const PER_SECOND: f64 = 25.0;
/// Maximum default number of frames.
const MAX: f64 = 1000.0;

#[derive(Clone, Debug, PartialEq)]
enum Times {
    /// A scene without motion.
    Still,
    /// Times of recorded poses, s.
    Recorded(Vec<f64>),
    /// First and last time of a motion, s.
    Span([f64; 2]),
}

/// Frame times of a scene.
#[derive(Clone, Debug, PartialEq)]
struct Timeline {
    times: Times,
    stated: Option<usize>,
}

impl Timeline {
    /// Creates the timeline from the times of a recording that moves probe or needle, or else from the union of all
    /// spans (first and last time, s).
    pub(crate) fn new(recorded: Option<Vec<f64>>, spans: &[[f64; 2]], stated: Option<usize>) -> Self {
        let cover = |covered: [f64; 2], span: [f64; 2]| [covered[0].min(span[0]), covered[1].max(span[1])];
        let times = match (recorded, spans.iter().copied().reduce(cover)) {
            (Some(times), _) => Times::Recorded(times),
            (None, Some(span)) if span[1] > span[0] => Times::Span(span),
            _ => Times::Still,
        };
        Self { times, stated }
    }

    /// Number of frames.
    pub(crate) fn frames(&self) -> usize {
        self.stated.unwrap_or_else(|| match &self.times {
            Times::Still => 1,
            Times::Recorded(times) => times.len(),
            Times::Span([start, end]) => ((end - start) * PER_SECOND).ceil().clamp(1.0, MAX - 1.0) as usize + 1,
        })
    }

    /// Time of the first frame, s.
    pub(crate) fn start_s(&self) -> f64 {
        match &self.times {
            Times::Still => 0.0,
            Times::Recorded(times) => times.first().copied().unwrap_or_default(),
            Times::Span([start, _]) => *start,
        }
    }

    /// Time of frame `frame` of `frames`, s.
    pub(crate) fn time_s(&self, frame: usize, frames: usize) -> f64 {
        let [start, end] = match &self.times {
            Times::Still => return 0.0,
            Times::Recorded(times) if times.len() == frames => return times[frame.min(frames - 1)],
            Times::Recorded(times) => [self.start_s(), times.last().copied().unwrap_or_default()],
            Times::Span(span) => *span,
        };
        let share = (frame as f64 / frames.saturating_sub(1).max(1) as f64).min(1.0);
        start * (1.0 - share) + end * share
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recordings_keep_their_times_and_motions_are_spread() {
        let recorded = Timeline::new(Some(vec![5.0, 5.1, 7.0]), &[[0.0, 99.0]], None);
        assert_eq!(recorded.frames(), 3);
        assert_eq!([0, 1, 2].map(|frame| recorded.time_s(frame, 3)), [5.0, 5.1, 7.0]);
        assert_eq!([0, 1].map(|frame| recorded.time_s(frame, 2)), [5.0, 7.0]);
        let span = Timeline::new(None, &[[1.0, 2.0], [0.0, 1.5]], None);
        assert_eq!((span.frames(), span.start_s()), (51, 0.0));
        assert_eq!([0, 1, 2].map(|frame| span.time_s(frame, 3)), [0.0, 1.0, 2.0]);
        assert_eq!(Timeline::new(None, &[[0.0, 1e9]], None).frames(), 1000);
    }

    #[test]
    fn nothing_moves_at_time_nought() {
        let still = Timeline::new(None, &[[3.0, 3.0]], Some(4));
        assert_eq!((still.frames(), still.time_s(3, 4), still.start_s()), (4, 0.0, 0.0));
        assert_eq!(Timeline::new(None, &[], None).frames(), 1);
    }
}
