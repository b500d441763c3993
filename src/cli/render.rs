//! `insonify render`: frames of a scene, and their companion files.

mod coverage;
pub(crate) mod extras;
mod manifest;
pub(crate) mod output;
pub(crate) mod target;

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use extras::Extras;
use nalgebra::Matrix4;
use output::{Output, Shot};
use serde::Serialize;
use serde_json::json;
use target::{Place, Target};

use super::backend::{BackendArgs, Chosen};
use super::input::Input;
use super::output::Force;
use super::terminal;
use super::variants::ranged;
use crate::failure::usage;
use insonify::Error;
use insonify_base::note::Notes;
use insonify_base::parallel;
use insonify_base::read;
use insonify_imaging::quality::Picked;
use insonify_imaging::scene::{Scene, SceneFile};
use insonify_imaging::synth::{FrameState, PassTime, Synthesizer};

const EXAMPLES: &str = "\
Examples:
  insonify render                                      the default scene, to frame.png
  insonify render --labels labels.nii.gz --target kidney   a label file alone, the probe over a kidney
  insonify render my.toml --gain-db 6 --set effects.refraction=false   keys of the scene changed for one run
  insonify render sweep.toml -o frames                 one numbered picture for each pose of the scene
  insonify render sweep.toml --frames 90 -o sweep.mha  an image sequence with the pose of each frame
  insonify render my.toml --layers label-value,depth --sidecar --overview
                                                       ground truth beside the frame, for training
  insonify render set.toml --layers label-value -o set.npy
                                                       arrays for NumPy, set.npy and set_label-value.npy: frames, rows, columns
  insonify render set.toml --frames 500 --layers organ --sidecar -o frames --resume
                                                       500 frames with the parameters that [randomise] draws; if the run
                                                       is cut off, the same command goes on

Layers are 16-bit pictures beside the frame, or beside an image sequence sequences like it: label-value (values of the label file, 0
outside the sector; of a completed body 201 fat, 202 soft tissue, 204 skin, 205 and 212 muscle, structures of organs 206 to 211 and 213,
or the values stated in a note if the file already uses these; `structures = false` under [volume] leaves organs undivided), organ
(values of the label file before anything was drawn: the kidney with its sinus, 0 where the body was completed),
label-index (places in the sidecar's table of labels), sector (1 inside), displacement (0.01 mm), depth (tissue passed along the beam,
0.1 mm), needle (share of the scan plane's thickness, 1/255), loss (two-way, 0.01 dB; 0 outside the sector, 65535 for 655.35 dB and more).
Frames appear in a folder when all are complete, with insonify.json, which lists the files, and manifest.csv and manifest.jsonl, with pose,
parameters, target and doubts of each frame; the next run into it replaces the files listed. Its pictures are compressed for speed: about 5 % larger than a
single frame.png, layers up to three times.
Companion files of a sequence's frames are in a folder of its name; parameters common to many sidecars are in parameters.json.";

/// Renders frames: one to a PNG file, many to a folder or an image sequence
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Render {
    #[command(flatten)]
    input: Input,
    #[command(flatten)]
    backend: BackendArgs,
    /// A PNG file for one frame, a folder for many, an image sequence (.mha, .nrrd), an array (.npy) or an animation
    /// (.gif)
    /// [default: frame.png or frames]
    #[arg(short, long, value_name = "PATH")]
    output: Option<PathBuf>,
    /// Number of frames of the scene's motion [default: that of the scene]
    #[arg(long, value_name = "N", value_parser = frame_count)]
    frames: Option<usize>,
    /// Go on with a run into this folder that was cut off: frames that are whole are kept, the others made. Where there
    /// is none it begins, and if it is cut off, its frames stay for the next
    #[arg(long)]
    resume: bool,
    #[command(flatten)]
    extras: Extras,
    /// Write the labels as imaged, with the body completed: .nii, .nii.gz, .nrrd, .seg.nrrd or .mha
    #[arg(long, value_name = "FILE")]
    save_labels: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
    /// Print one JSON object to standard output
    #[arg(long)]
    json: bool,
}

/// Least number of frames in a batch, whose states are held at a time.
const BATCH: usize = 64;

#[derive(Serialize)]
struct RenderReport {
    backend: &'static str,
    adapter: Option<String>,
    reason: String,
    width: usize,
    height: usize,
    frames: Vec<FrameReport>,
    /// Frames of a run that was cut off.
    #[serde(skip_serializing_if = "is_zero")]
    kept: usize,
    /// Frames rendered and written in a second.
    frames_per_second: f64,
    passes: Vec<PassReport>,
    #[serde(skip_serializing_if = "Option::is_none")]
    quality: Option<Picked>,
    notes: Notes,
    warnings: Vec<String>,
}

#[derive(Serialize)]
struct FrameReport {
    path: String,
    ms: f64,
}

fn is_zero(count: &usize) -> bool {
    *count == 0
}

/// Mean time of a pass over the frames; `None` if the device has no timestamps.
#[derive(Serialize)]
struct PassReport {
    name: &'static str,
    ms: Option<f64>,
}

impl Render {
    pub(crate) fn run(&self) -> Result<(), Error> {
        self.backend.check()?;
        self.extras.check_options()?;
        read::record();
        if let Some(file) = self.output.as_deref().filter(|path| Target::is_file(path)) {
            self.force.check(&[file], &self.input.files())?;
        }
        // A picture is refused for several frames before the body is completed, which takes long.
        let fits = |file: &SceneFile, folder: &Path| {
            let count = self.frames.or_else(|| file.frame_count(folder));
            count.map_or(Ok(()), |count| Target::choose(self.output.as_deref(), count).map(drop))
        };
        let (mut scene, picked) = self.input.visible_scene(&self.backend, fits)?;
        scene.settings.layers = self.extras.layers();
        if let Some(path) = &self.save_labels {
            self.force.check(&[path], &self.input.files())?;
            insonify_anatomy::volume::save(&scene.anatomy.volume, path)?;
        }
        let count = self.frames.unwrap_or_else(|| scene.frames());
        self.extras.check(&scene)?;
        let poses = scene.probe_path().keys().len();
        let is_table = scene.file.motion.as_ref().is_some_and(|motion| motion.csv.is_some());
        if is_table && poses > 1 && count != poses {
            terminal::note(format_args!(
                "{count} frames for {poses} poses: theirs lie between them, at even times; without --frames each pose is a frame"
            ));
        }
        let target = Target::choose(self.output.as_deref(), count)?;
        if let (true, Target::File(path) | Target::Sequence(path, _)) = (self.resume, &target) {
            return Err(usage(
                format!(
                    "--resume keeps frames in files of their own, and {} is one file",
                    path.display()
                ),
                "name a folder, or leave out --resume",
            ));
        }
        let mut place = Place::open(target, &self.extras, self.force, &self.input.files())?;
        place.left().iter().for_each(terminal::warn);
        let several = scene.states(count).next().filter(|_| count > 1).transpose()?;
        let (anatomy, settings) = (scene.anatomy.clone(), scene.settings.clone());
        let mut chosen = self.backend.synthesizer(anatomy, settings, several.as_ref())?;
        let provenance = manifest::provenance(&chosen)?;
        let run = json!({
            "made_by": provenance,
            "scene": scene.file,
            "options": {
                "frames": count,
                "layers": scene.settings.layers,
                "sidecar": self.extras.sidecar,
                "overview": self.extras.overview,
                "overlay": self.extras.overlay,
            },
        });
        if !place.begin(run, self.resume)? {
            terminal::say(format_args!("all {count} frames are in {}", place.path().display()));
            if self.json {
                terminal::emit_json(&json!({ "frames": [], "kept": count }))?;
            }
            return Ok(());
        }
        let output = Output::open(place.inner.clone(), &self.extras, &scene, count)?;
        let output = output.made_by(provenance, &chosen.synth)?;
        chosen.tell();
        chosen.warnings.iter().for_each(terminal::warn);
        let mut report = self.frames(&scene, &mut chosen, output, &place, count)?;
        let path = place.install()?;
        terminal::say(report.summary(&path));
        report.quality = picked;
        if self.json {
            terminal::emit_json(&report)?;
        }
        Ok(())
    }

    fn frames(
        &self,
        scene: &Scene,
        chosen: &mut Chosen,
        output: Output<'_>,
        place: &Place,
        count: usize,
    ) -> Result<RenderReport, Error> {
        let synth = &mut chosen.synth;
        // A GPU makes a timed frame twice: there, one more frame is timed.
        synth.time_passes(self.json && synth.gpu().is_none())?;
        // For a constant pose the scene has already warned.
        let outside_was_reported = scene.probe_path().keys().len() == 1;
        let shared_warnings = synth.plan().warnings.clone();
        let mut passes = Passes::default();
        let mut oddities = FrameWarnings::default();
        let numbers: Vec<usize> = (0..count).filter(|number| !output.has(*number)).collect();
        if numbers.len() < count {
            terminal::say(format_args!(
                "{} of {count} frames are whole and stay; the others are made",
                count - numbers.len()
            ));
        }
        let mut frames = Vec::with_capacity(numbers.len());
        let stage = terminal::frames("rendering", numbers.len());
        let start = Instant::now();
        let size = BATCH.max(4 * parallel::threads());
        for numbers in numbers.chunks(size) {
            let state = |number: &usize| {
                let mut state = FrameState::at(Matrix4::identity());
                scene.state(*number, count, &mut state).map(|()| state)
            };
            let batch: Vec<FrameState> = parallel::try_map(parallel::tasks(numbers), &state)?;
            let take = |index: usize, synth: &Synthesizer, ms: f64| {
                let mut odd = coverage::warnings(synth.tables(), &batch[index].probe_to_world, outside_was_reported);
                if let Some(own) = &batch[index].settings {
                    let of_plan = synth.plan().warnings.iter();
                    odd.extend(of_plan.filter(|warning| !shared_warnings.contains(warning)).cloned());
                    odd.extend(own.warnings.iter().cloned());
                }
                let number = numbers[index];
                let shot = Shot {
                    number,
                    time_s: scene.time_s(number, count),
                    state: &batch[index],
                    clearance_mm: None,
                    warnings: &odd,
                };
                let frame = output.take(synth, &shot);
                Ok((frame, odd, synth.pass_times().to_vec(), ms))
            };
            synth.batch(&batch, take, |index, (frame, odd, times, ms)| {
                let path = place.of(&output.write(frame?)?).to_string_lossy().into_owned();
                passes.add(&times);
                oddities.add(numbers[index], odd);
                frames.push(FrameReport { path, ms });
                stage.frame();
                Ok::<_, Error>(())
            })?;
        }
        output.finish()?;
        drop(stage);
        let frames_per_second = frames.len() as f64 / start.elapsed().as_secs_f64();
        if let (true, Some(_), Some(state)) = (self.json, synth.gpu(), scene.states(count).next()) {
            synth.time_passes(true)?;
            synth.render(&state?)?;
            passes.add(synth.pass_times());
        }

        let mut of_frames = oddities.summary(numbers.len());
        of_frames.extend(repeated(scene, count));
        of_frames.iter().for_each(terminal::warn);
        let mut warnings = scene.warnings.clone();
        warnings.append(&mut chosen.warnings);
        warnings.extend(of_frames);
        let passes = passes.report(&chosen.synth, self.json, &mut warnings);
        let report = RenderReport {
            backend: chosen.synth.backend(),
            adapter: chosen.adapter().map(str::to_owned),
            reason: chosen.reason.clone(),
            width: chosen.synth.frame().width,
            height: chosen.synth.frame().height,
            kept: count - frames.len(),
            frames,
            frames_per_second,
            passes,
            quality: None,
            notes: scene.notes.clone(),
            warnings,
        };
        Ok(report)
    }
}

/// Note about frames that show the same pose.
fn repeated(scene: &Scene, count: usize) -> Option<String> {
    let still = count > 1 && !scene.varies() && scene.time_s(0, count) == scene.time_s(count - 1, count);
    still.then(|| {
        format!(
            "nothing moves in this scene: all {count} frames show the same pose, and only the noise of the receiver differs; \
             [motion] moves the probe"
        )
    })
}

impl RenderReport {
    fn summary(&self, path: &Path) -> String {
        let Self {
            width,
            height,
            frames_per_second,
            ..
        } = self;
        let total: f64 = self.frames.iter().map(|frame| frame.ms).sum();
        let mean = total / self.frames.len().max(1) as f64;
        match self.frames.len() + self.kept {
            1 => format!(
                "wrote {}: {width}x{height} pixels, rendered in {mean:.1} ms",
                path.display()
            ),
            n => format!(
                "wrote {}: {n} frames of {width}x{height} pixels, {frames_per_second:.0} a second in all; a frame takes {mean:.1} ms",
                path.display()
            ),
        }
    }
}

/// Times of passes, summed over frames.
#[derive(Default)]
struct Passes {
    sums: Vec<PassTime>,
    frames: usize,
}

impl Passes {
    fn add(&mut self, times: &[PassTime]) {
        if times.is_empty() {
            return;
        }
        if self.sums.is_empty() {
            self.sums = times.to_vec();
        } else {
            for (sum, time) in self.sums.iter_mut().zip(times) {
                sum.ms += time.ms;
            }
        }
        self.frames += 1;
    }

    fn report(&self, synth: &Synthesizer, wanted: bool, warnings: &mut Vec<String>) -> Vec<PassReport> {
        if wanted && self.sums.is_empty() {
            warnings.push("this adapter does not support timestamps; pass times are unavailable".to_owned());
            let names = synth.plan().passes.iter().map(|planned| planned.pass.name);
            return names.map(|name| PassReport { name, ms: None }).collect();
        }
        let mean = |sum: &PassTime| PassReport {
            name: sum.name,
            ms: Some(sum.ms / self.frames as f64),
        };
        self.sums.iter().map(mean).collect()
    }
}

/// Warnings of single frames, each reported once with the frames concerned.
#[derive(Default)]
struct FrameWarnings(Vec<(String, Vec<usize>)>);

impl FrameWarnings {
    fn add(&mut self, frame: usize, warnings: Vec<String>) {
        for warning in warnings {
            match self.0.iter_mut().find(|(known, _)| *known == warning) {
                Some((_, frames)) => frames.push(frame),
                None => self.0.push((warning, vec![frame])),
            }
        }
    }

    fn summary(self, count: usize) -> Vec<String> {
        let sentence = |(warning, frames): (String, Vec<usize>)| match frames[..] {
            _ if count == 1 => warning,
            [frame] => format!("frame {frame}: {warning}"),
            [first, .., last] if frames.len() == count => format!("frames {first} to {last}: {warning}"),
            _ => format!(
                "{} of {count} frames, first frame {}: {warning}",
                frames.len(),
                frames[0]
            ),
        };
        self.0.into_iter().map(sentence).collect()
    }
}

/// Parses a number of frames.
pub(crate) fn frame_count(text: &str) -> Result<usize, String> {
    ranged(text, 1..=1_000_000, "a whole number from 1 to 1000000")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_warning_of_many_frames_is_told_once() {
        let mut oddities = FrameWarnings::default();
        for frame in 0..4 {
            let mut warnings = vec!["always".to_owned()];
            if frame % 2 == 1 {
                warnings.push("at times".to_owned());
            }
            if frame == 2 {
                warnings.push("once".to_owned());
            }
            oddities.add(frame, warnings);
        }
        let summary = oddities.summary(4);
        assert_eq!(summary[0], "frames 0 to 3: always");
        assert_eq!(summary[1], "2 of 4 frames, first frame 1: at times");
        assert_eq!(summary[2], "frame 2: once");
        let mut single = FrameWarnings::default();
        single.add(0, vec!["odd".to_owned()]);
        assert_eq!(single.summary(1), ["odd"]);
    }

    #[test]
    fn frame_counts_are_whole_and_in_range() {
        assert_eq!(frame_count("1"), Ok(1));
        for wrong in ["0", "-1", "1.5", "", "1000001", "99999999999999999999"] {
            assert!(frame_count(wrong).is_err(), "{wrong}");
        }
    }
}
