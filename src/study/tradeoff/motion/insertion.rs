//! Motion around a needle in the two-layer phantom, as in figure 9 of Dehghan et al. 2008: the probe at the back, the
//! needle along the beam and 5 mm out of the image plane.

use super::validation::Course;
use crate::stability::Effort;
use crate::tradeoff::{Axis, Choice, Column, Factor, Figure, Table};
use insonify::Error;
use insonify::input::scenario::ScenarioFile;
use insonify::run::{Moment, Observer, Requests, Step, run};
use insonify_imaging::rf::motion::{Options, Tracker};
use insonify_imaging::rf::scatterers::RfSynthesizer;
use insonify_imaging::rf::truth::{self, Followed};
use insonify_imaging::rf::{Acquisition, medium};

/// Description of the insertion, in words.
pub(crate) const ABOUT: &str = "two-layer phantom, 991 nodes, viscoelastic, needle 5 mm out of the plane, in to 40 mm, half out and in again, out; 75 mm, 10 frames a \
                         second";

const SCENARIO: &str = r#"
[run]
dt_ms = 20
[scene]
seed = 3
[scene.volume]
phantom = "two-layer"
resolution_mm = 1.5
[scene.probe]
kind = "linear"
depth_mm = 75
frequency_mhz = 5
[scene.effects]
only = ["needle"]
slice.beyond = "void"
[tissue]
nodes = 991
model = "viscoelastic"
# The back, where the probe is, and the base.
[[tissue.fix]]
box_mm = [[-inf, -inf, 44], [inf, inf, inf]]
[[tissue.fix]]
box_mm = [[-inf, -inf, -inf], [inf, -39, inf]]
[[tissue.material]]
region = "phantom_top"
friction_n_per_mm = 0.02
cutting_n = 0.5
[[tissue.material]]
region = "phantom_inclusion"
friction_n_per_mm = 0.03
cutting_n = 1.0
# The order is that of liver (Kobayashi et al. 2010); the article has none of its phantom.
[tissue.viscosity]
order = 0.1
memory = "load-integral"
[needle]
length_mm = 120
diameter_mm = 1.27
"#;

/// Times (s) and depths of the tip below the face (mm) of the needle's motion.
const KEYFRAMES: [[f64; 2]; 6] = [
    [0.0, -1.0],
    [4.1, 40.0],
    [4.6, 40.0],
    [6.6, 20.0],
    [8.6, 40.0],
    [12.7, -1.0],
];

const SHORT: [[f64; 2]; 2] = [[0.0, -1.0], [2.1, 20.0]];

fn scenario(effort: Effort) -> String {
    let (lines, rate, keyframes) = effort.pick((16, 5, &SHORT[..]), (96, 10, &KEYFRAMES[..]));
    let width_mm = f64::from(lines - 1) * medium::PITCH_MM;
    let mut text = SCENARIO
        .replace("[run]", &format!("[run]\nframe_rate_hz = {rate}"))
        .replace(
            "[scene.probe]",
            &format!("[scene.probe]\nlines = {lines}\nwidth_mm = {width_mm}"),
        );
    for [time_s, depth_mm] in keyframes {
        let z = depth_mm - 45.0;
        text +=
            &format!("[[needle.motion.keyframes]]\ntime_s = {time_s}\ntip_mm = [0, 5, {z}]\ndirection = [0, 0, 1]\n");
    }
    text
}

/// The needle at a frame.
struct NeedleRow {
    time_s: f64,
    /// Length in the tissue, mm.
    inserted_mm: f64,
    /// Force on the needle, N.
    force_n: f64,
}

const CHOICES: [Choice<NeedleRow>; 1] = [Factor::new("part", "part").of(|_| "needle".to_owned())];

const COLUMNS: [Column<NeedleRow>; 3] = [
    Axis::linear("time_s", "time s", "time, s").of(|row| Some(row.time_s)),
    Axis::linear("inserted_mm", "inserted mm", "length in the tissue, mm").of(|row| Some(row.inserted_mm)),
    Axis::linear("force_n", "force N", "force on the needle, N").of(|row| Some(row.force_n)),
];

struct Watch<'a> {
    course: &'a mut Course,
    synthesizer: RfSynthesizer,
    tracker: Option<Tracker>,
    options: Options,
    followed: Vec<Followed>,
    scene: &'a insonify_imaging::scene::Scene,
    needle: Vec<NeedleRow>,
    /// Depth of the tip (mm) and force on the hand (N) in the last step.
    last: [f64; 2],
    frames: f64,
    progress: &'a mut dyn FnMut(f64),
}

/// Name of the motion in the tables.
const NAME: &str = "insertion";

impl Observer for Watch<'_> {
    type Error = Error;

    fn step(&mut self, step: &Step<'_>) -> Result<(), Error> {
        let outcome = step.outcome;
        self.last = [outcome.inserted_mm, -outcome.on_hand.force_n.z];
        Ok(())
    }

    fn frame(&mut self, moment: &Moment<'_>) -> Result<(), Error> {
        let echoes = self.synthesizer.render(moment.state)?;
        let pose = &moment.state.probe_to_world;
        let [inserted_mm, force_n] = self.last;
        self.needle.push(NeedleRow {
            time_s: moment.time_s,
            inserted_mm,
            force_n,
        });
        (self.progress)(moment.number as f64 / self.frames);
        let Some(tracker) = &mut self.tracker else {
            let depths = self.options.centres_mm(self.synthesizer.samples());
            let mesh = self.scene.anatomy.mesh.as_deref();
            self.followed = truth::windows(&self.synthesizer, mesh, pose, &depths);
            self.tracker = Some(Tracker::new(self.options, self.synthesizer.lines(), &echoes));
            return Ok(());
        };
        let estimates = tracker.next(&echoes);
        let displacement = |point: &Followed| {
            let [axial, lateral, _] = point.motion_um(&self.synthesizer, pose);
            [axial, lateral]
        };
        let truth: Vec<[f64; 2]> = self.followed.iter().map(displacement).collect();
        self.course.push(NAME, moment.time_s, &estimates, &truth);
        self.course.push_places(moment.time_s, &estimates, &truth);
        Ok(())
    }
}

/// Runs the insertion into the tables of a course; returns the table of the needle.
pub(super) fn run_into(effort: Effort, course: &mut Course, progress: &mut dyn FnMut(f64)) -> Result<Table, Error> {
    let scenario = ScenarioFile::parse(&scenario(effort), "two-layer phantom")?.resolve("".as_ref(), |_| {})?;
    let scene = &scenario.scene;
    let acquisition = Acquisition::new(scene.settings.probe.frequency_mhz);
    let synthesizer = RfSynthesizer::new(scene.anatomy.clone(), scene.settings.clone(), acquisition)?;
    let options = Options::new(acquisition.sampling_mhz, medium::PITCH_MM);
    course.over(options, synthesizer.lines(), synthesizer.samples());
    let mut watch = Watch {
        course,
        tracker: None,
        options,
        followed: Vec::new(),
        scene,
        needle: Vec::new(),
        last: [0.0; 2],
        frames: scenario.timing.moments(scenario.timing.frame_s) as f64,
        synthesizer,
        progress,
    };
    let mut model = scenario.model(|_, _| {})?;
    let requests = Requests {
        frames: true,
        mesh_s: None,
    };
    run(&scenario, model.as_mut(), requests, &mut watch)?;
    let switches = watch.tracker.map_or(0.0, |tracker| tracker.references());
    watch.course.end(NAME, switches);
    let title = "Figure 9 a, b: the needle";
    Ok(Table::of("needle", title, &CHOICES, &COLUMNS, &watch.needle).unlisted())
}

/// Figures of the needle.
pub(super) fn figures() -> [Figure; 2] {
    let figure = |file: &str, title: &str, y| Figure {
        marked: false,
        ..Figure::new(file, title, "needle", ["time_s", y], "part")
    };
    [
        figure(
            "figure-9a",
            "Figure 9 a: length of the needle in the tissue",
            "inserted_mm",
        ),
        figure("figure-9b", "Figure 9 b: force on the needle", "force_n"),
    ]
}
