//! From a scene file to a scene.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use super::Scene;
use super::check::Framing;
use super::error::{At, Problem, SceneError};
use super::file::{ImageSpec, PoseTable, SceneFile, TextureSpec};
use super::motion::Needle;
use super::target::Body;
use super::timeline::Timeline;
use crate::document::nearest;
use crate::phantom::{self, PhantomOptions};
use crate::segmentation::{Names, Naming, open};
use crate::synth::tables::{Anatomy, Settings};
use crate::tissue::{TissueError, TissueTable, bank};
use crate::tracking::matrix::Rows;
use crate::tracking::pose::Pose;
use crate::tracking::probe::{BeamGrid, ProbeSpec};
use crate::tracking::trajectory::Trajectory;
use crate::volume::complete::{CompleteOptions, CompletionError, complete};
use crate::volume::texture::{InvalidTexture, SolidTexture, TextureOptions};
use crate::volume::{LabelVolume, load_scalar};

impl SceneFile {
    /// Loads or makes everything that the scene names, fills in what it leaves open and checks it all. Relative paths start
    /// at `base_dir`, the folder of the scene file.
    ///
    /// # Errors
    /// [`SceneError`], with the key and its place in the file.
    pub fn resolve(&self, base_dir: &Path) -> Result<Scene, SceneError> {
        let framing = self.framing()?;
        let (mut notes, mut warnings) = (Vec::new(), Vec::new());
        let path = self.probe_path(base_dir, &mut warnings)?;
        if path.is_some() && self.pose.is_some() {
            let found = "both `[pose]` and a path in `[motion]`";
            return Err(self.wrong_keys("pose", found, "one of them"));
        }
        let needle = self.needle(base_dir, &mut warnings)?;
        let textures = self.textures(base_dir)?;
        self.check_texture_names(&textures)?;

        let volume = self.load_volume(base_dir, &mut notes, &mut warnings)?;
        let preset = self.volume()?.preset.unwrap_or_default();
        let (tissues, assumed) = TissueTable::resolve(volume.labels(), &self.tissue, preset)
            .map_err(|error| self.fault(self.tissue_key(&error), error))?;
        warnings.extend(assumed);
        let deformation = self.deformation(&volume, base_dir)?;

        let mut file = self.filled(&framing);
        let (probe, recorded) = match path {
            Some(path) => (path.trajectory, path.recorded),
            None => {
                let body = Body {
                    volume: &volume,
                    tissues: &tissues,
                };
                let pose = self.fixed_pose(&body, &framing.probe, &mut notes, &mut warnings)?;
                file.pose = Some(PoseTable {
                    matrix: Some(Rows(*pose.probe_to_world())),
                    ..PoseTable::default()
                });
                (Trajectory::fixed(pose), false)
            }
        };
        warnings.extend(outside(&volume, &framing.grid, &probe));

        let span = |path: &Trajectory| [path.start_s(), path.end_s()];
        let times = |path: &Trajectory| path.keys().iter().map(|key| key.time_s).collect();
        let mut spans = Vec::new();
        let mut recording: Option<Vec<f64>> = recorded.then(|| times(&probe));
        if self.motion.is_some() && probe.keys().len() > 1 {
            spans.push(span(&probe));
        }
        if let Some(Needle::Moving { path, recorded }) = &needle {
            spans.push(span(path.tip()));
            if *recorded && recording.is_none() && spans.len() == 1 {
                recording = Some(times(path.tip()));
            }
        }
        if let Some(ramp) = deformation.as_ref().and_then(super::Deformation::span_s) {
            let start = spans.iter().map(|span| span[0]).reduce(f64::min).unwrap_or(0.0);
            spans.push(ramp.map(|time| start + time.max(0.0)));
        }
        let stated = self.motion.as_ref().and_then(|motion| motion.frames);

        Ok(Scene {
            anatomy: Anatomy {
                volume: Arc::new(volume),
                tissues: Arc::new(tissues),
                textures,
                mesh: deformation.as_ref().map(|deformation| Arc::clone(&deformation.mesh)),
            },
            settings: Settings {
                seed: self.seed,
                probe: framing.probe,
                image: framing.image,
                effects: framing.effects,
                has_needle: needle.is_some(),
            },
            quality: self.quality.unwrap_or_default(),
            open_grid: [
                self.probe.is_none_or(|probe| probe.lines.is_none()),
                self.probe.is_none_or(|probe| probe.samples.is_none()),
            ],
            notes,
            warnings,
            file,
            probe,
            needle,
            deformation,
            timeline: Timeline::new(recording, &spans, stated.map(|frames| frames as usize)),
        })
    }

    fn filled(&self, framing: &Framing) -> Self {
        Self {
            probe: Some(ProbeSpec::from(framing.probe)),
            image: Some(ImageSpec {
                width: framing.image.width as u32,
                height: framing.image.height as u32,
                margin: framing.image.margin,
                fill: framing.image.fill,
            }),
            effects: Some(framing.effects.clone()),
            source: None,
            ..self.clone()
        }
    }

    fn load_volume(
        &self,
        base: &Path,
        notes: &mut Vec<String>,
        warnings: &mut Vec<String>,
    ) -> Result<LabelVolume, SceneError> {
        let spec = self.volume()?;
        if let Some(kind) = spec.phantom {
            let options = PhantomOptions {
                resolution_mm: spec.resolution_mm,
                seed: spec.seed.unwrap_or_default(),
            };
            return phantom::make(kind, &options).at(self, "volume.resolution_mm");
        }
        let path = base.join(spec.file.as_deref().unwrap_or(Path::new("")));
        let table = spec.names.as_ref().map(|names| Names::read(&base.join(names)));
        let claimed: Vec<i64> = self.tissue.iter().flat_map(|tissue| tissue.labels.clone()).collect();
        let naming = Naming {
            names: table.transpose().at(self, "volume.names")?,
            preset: spec.preset.unwrap_or_default(),
            claimed: &claimed,
        };
        let opened = open(&path, &naming).at(self, "volume.file")?;
        notes.extend(opened.notes);
        warnings.extend(opened.warnings);
        let usual = CompleteOptions::default();
        let options = CompleteOptions {
            mode: spec.unlabelled.unwrap_or(usual.mode),
            muscle_mm: spec.muscle_mm.unwrap_or(usual.muscle_mm),
            fat_mm: spec.fat_mm.unwrap_or(usual.fat_mm),
            skin_mm: spec.skin_mm.unwrap_or(usual.skin_mm),
        };
        let completed = complete(&opened.volume, &options).map_err(|error| {
            let key = match &error {
                CompletionError::Thickness { layer, .. } => format!("volume.{layer}_mm"),
                CompletionError::Volume(_) => "volume.file".to_owned(),
            };
            self.fault(key, error)
        })?;
        notes.push(completed.note);
        Ok(completed.volume)
    }

    fn textures(&self, base: &Path) -> Result<BTreeMap<String, Arc<SolidTexture>>, SceneError> {
        let mut textures = BTreeMap::new();
        for (at, spec) in self.texture.iter().enumerate() {
            let key = |key: &str| format!("texture[{at}].{key}");
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
    ) -> Result<SolidTexture, SceneError> {
        let image = load_scalar(&base.join(&spec.file)).at(self, &key("file"))?;
        let options = TextureOptions {
            values: spec.values,
            seam: spec.seam,
        };
        let spacing_mm = spec.spacing_mm.unwrap_or(image.spacing_mm);
        SolidTexture::from_scalar(image.size, spacing_mm, image.data, &options).map_err(|error| {
            let at = match &error {
                InvalidTexture::Spacing(_) if spec.spacing_mm.is_some() => "spacing_mm",
                InvalidTexture::Option { key: "db_per_unit", .. } => "values",
                InvalidTexture::Option { .. } => "seam",
                _ => "file",
            };
            self.fault(key(at), error)
        })
    }

    fn check_texture_names(&self, textures: &BTreeMap<String, Arc<SolidTexture>>) -> Result<(), SceneError> {
        let mut known: Vec<&str> = bank::names().collect();
        known.extend(textures.keys().map(String::as_str).chain(["none"]));
        for (at, tissue) in self.tissue.iter().enumerate() {
            if let Some(name) = &tissue.texture
                && !known.contains(&name.as_str())
            {
                let help = nearest(name, known.iter().copied()).map(|meant| format!("did you mean \"{meant}\"?"));
                let found = name.clone();
                let expected = format!("one of {}", known.join(", "));
                let error = self.fault(format!("tissue[{at}].texture"), Problem::Name { found, expected });
                return Err(error.with_help(help));
            }
        }
        Ok(())
    }

    fn tissue_key(&self, error: &TissueError) -> String {
        let at = match error {
            TissueError::Unnamed { position } => position.checked_sub(1),
            _ => error
                .tissue()
                .and_then(|name| self.tissue.iter().rposition(|tissue| tissue.name == name)),
        };
        at.map_or_else(|| "tissue".to_owned(), |at| format!("tissue[{at}].{}", error.key()))
    }
}

/// A warning where poses of a path show nothing of the volume.
fn outside(volume: &LabelVolume, grid: &BeamGrid, path: &Trajectory) -> Option<String> {
    let poses = path.keys().len();
    let blind = path.keys().iter().filter(|key| !sees(volume, grid, &key.pose)).count();
    match (blind, poses) {
        (0, _) => None,
        (1, 1) => Some("the probe sees nothing of the volume: the frame will be black".to_owned()),
        _ => Some(format!(
            "the probe sees nothing of the volume in {blind} of {poses} poses"
        )),
    }
}

/// Scanlines and depths at which [`sees`] looks: a volume that slips between them is smaller than a few beam widths.
const LOOKS: usize = 24;

fn sees(volume: &LabelVolume, grid: &BeamGrid, pose: &Pose) -> bool {
    let step = (grid.lines() / LOOKS).max(1);
    let depth_mm = grid.samples() as f64 * grid.sample_spacing_mm();
    grid.rays().iter().step_by(step).any(|ray| {
        (0..LOOKS).any(|at| {
            let depth = (at as f64 + 0.5) / LOOKS as f64 * depth_mm;
            let [x, y] = [0, 1].map(|axis| ray.origin[axis] + depth * ray.direction[axis]);
            let point = pose.probe_to_world().transform_point(&nalgebra::Point3::new(x, y, 0.0));
            volume.label_index_at(&point).is_some()
        })
    })
}
