//! Scene of a scenario: located, resolved, and equipped with the needle.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::aim::Aim;
use super::file::{ScenarioFile, SceneSource};
use super::needle::{Moving, NeedleSettings};
use insonify_base::document::{self, InputError, InvalidFile, Setting, Source, nearest};
use insonify_imaging::effects::table::Origin;
use insonify_imaging::scene::{EXAMPLES, PoseTable, Scene, SceneFile, Version};

impl ScenarioFile {
    /// Returns the scene with its needle, the motion of the needle, and its aim if the target is given by name.
    pub(crate) fn scene_with(
        &self,
        needle: &NeedleSettings,
        base_dir: &Path,
    ) -> Result<(Scene, Moving, Option<Aim>), InputError> {
        let (mut file, folder, is_inline) = self.scene_file(base_dir)?;
        // Its own motions are those of the tissue's mesh, which is made from the scene.
        let of_file = file.motion.clone();
        let breathes = file.motion.as_mut().is_some_and(|motion| {
            motion.pulse = None;
            motion.breathing.take().is_some()
        });
        let of_scene = |error| self.of_scene(error, is_inline);
        let (mut scene, moving, aim) = match &self.needle_table()?.target {
            None => {
                let moving = self.moving(needle, None)?;
                file.needle = Some(moving.needle.clone());
                (file.resolve(&folder).map_err(of_scene)?, moving, None)
            }
            Some(_) => {
                let pace = self.pace()?;
                let scene = file.resolve(&folder).map_err(of_scene)?;
                let aim = self.aim(&scene, needle, breathes)?;
                let moving = self.moving(needle, Some(aim.keyframes(pace)))?;
                let mut scene = scene.with_needle(moving.needle.clone()).map_err(of_scene)?;
                scene.notes.extend(self.aimed_in_words(&aim, pace));
                scene.warnings.extend(aim.warnings.iter().cloned());
                (scene, moving, Some(aim))
            }
        };
        scene.file.motion = of_file;
        // A needle beside the image is common where its motion is the subject.
        if let Some(doubt) = scene.unseen_needle() {
            scene.warnings.retain(|warning| *warning != doubt);
            scene.notes.push(doubt);
        }
        if scene.varies() {
            let found = "a scene with parameters by frame: frames of an insertion share theirs";
            return Err(self.wrong_keys(
                "scene",
                found,
                "a scene without [randomise] and columns beside its poses",
            ));
        }
        // With version 1, an inserted needle is shown even if the scene does not name it.
        if scene.origins.get("needle") == Some(&Origin::Unnamed) {
            scene.settings.effects.needle.get_or_insert_default();
        }
        Ok((scene, moving, aim))
    }

    /// The scene's file without needle and deformation, the base folder of its paths, and whether it is inline.
    pub(crate) fn scene_file(&self, base: &Path) -> Result<(SceneFile, PathBuf, bool), InputError> {
        let (mut file, folder, is_inline) = match &self.scene {
            None => {
                return Err(self.wrong_keys(
                    "scene",
                    "no `scene`",
                    "the name of a scene, its path, or a table `[scene]`",
                ));
            }
            Some(SceneSource::Inline(file)) => {
                let mut scene = (**file).clone();
                scene.version = scene.version.or(self.version);
                // Effects that are only set leave out no others, in any version.
                let is_written = |source: &Arc<Source>| source.states("scene.effects");
                if scene.effects.is_some() && !self.source.as_ref().is_none_or(is_written) {
                    scene.version = Some(Version::NEWEST);
                }
                (scene, base.to_owned(), true)
            }
            Some(SceneSource::Named(name)) => {
                let (file, folder) = self.named_scene(name, base)?;
                (file, folder, false)
            }
        };
        let motion = file.motion.as_ref();
        let by_scenario = "a scene without: the scenario moves the needle and the tissue";
        let linear = "`tissue.model = \"finite-element\"`, on which the motion of the body is superposed";
        let is_remeshed = self.tissue.model.is_remeshed();
        let moving = [
            ("needle", file.needle.is_some(), by_scenario),
            ("deform", file.deform.is_some(), by_scenario),
            (
                "motion.press",
                motion.is_some_and(|motion| motion.press.is_some()),
                "a scene without: in a scenario a `[contact_probe]` presses",
            ),
            (
                "motion.breathing",
                !is_remeshed && motion.is_some_and(|motion| motion.breathing.is_some()),
                linear,
            ),
            (
                "motion.pulse",
                !is_remeshed && motion.is_some_and(|motion| motion.pulse.is_some()),
                linear,
            ),
        ];
        if let Some((key, _, expected)) = moving.into_iter().find(|(_, is_refused, _)| *is_refused) {
            let key_in_file = if is_inline {
                format!("scene.{key}")
            } else {
                "scene".to_owned()
            };
            return Err(self.wrong_keys(key_in_file, format!("a scene with `{key}` of its own"), expected));
        }
        let target = self.needle.as_ref().and_then(|needle| needle.target.clone());
        let is_file = file.volume.as_ref().is_some_and(|volume| volume.file.is_some());
        // A phantom has a pose of its own. Over a volume from a file the default is above the largest soft
        // organ, where the target of the needle may be out of view.
        let moves_probe = file.motion.as_ref().is_some_and(|motion| motion.moves_probe());
        if target.is_some() && is_file && file.pose.is_none() && !moves_probe {
            file.pose = Some(PoseTable {
                target,
                ..PoseTable::default()
            });
        }
        file.gets_mesh = true;
        Ok((file, folder, is_inline))
    }

    fn named_scene(&self, name: &str, base: &Path) -> Result<(SceneFile, PathBuf), InputError> {
        let settings = self.source.iter().flat_map(|source| source.settings());
        let settings: Vec<Setting> = settings.filter_map(Setting::within_scene).collect();
        if let Some((_, text)) = EXAMPLES.iter().find(|(known, _)| *known == name) {
            let file = SceneFile::parse_with(text, name, &settings).map_err(|error| self.of_scene(error, false))?;
            return Ok((file, base.to_owned()));
        }
        let path = base.join(name);
        if !name.contains(['.', '/', '\\']) && !path.exists() {
            let known: Vec<&str> = EXAMPLES.iter().map(|(known, _)| *known).collect();
            let help = nearest(name, known.iter().copied()).map(|meant| format!("did you mean \"{meant}\"?"));
            let expected = format!("one of {}, or the path of a scene file", known.join(", "));
            return Err(self.fault("scene", InvalidFile::name(name, &expected)).with_help(help));
        }
        let folder = path.parent().unwrap_or(Path::new("")).to_owned();
        // A missing scene file is an error of the scenario file.
        let text = document::read(&path).map_err(|error| error.at_key("scene", self.source.as_ref()))?;
        let file = SceneFile::parse_with(&text, &path.display().to_string(), &settings);
        Ok((file.map_err(|error| self.of_scene(error, false))?, folder))
    }
}
