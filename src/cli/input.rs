//! Input scene of a subcommand: a scene file, a label file alone, or the default scene.

use std::path::{Path, PathBuf};

use clap::Args;
use insonify_anatomy::segmentation::{Names, Naming, stem};
use insonify_anatomy::volume::VolumeError;
use insonify_base::document::Setting;
use insonify_imaging::quality::Picked;
use insonify_imaging::scene::{self, Scene, SceneFile, Version};
use insonify_tracking::sequence::SequenceInfo;

use super::backend::BackendArgs;
use super::failure::{Error, Failure, usage};
use super::output::inputs;
use super::quality::QualityArgs;
use super::settings::{self, Settings};
use super::terminal::{self, warn};

/// Largest width and height of a frame, pixels.
const LARGEST_SIDE: u32 = 16_384;

/// Argument for a table of label names.
#[derive(Args)]
pub(crate) struct NamesArg {
    /// Table of label names: CSV with columns `value` and `name`, a colour table of 3D Slicer or FreeSurfer, label
    /// descriptions of ITK-SNAP, dataset.json of nnU-Net [default: for labels without names, the file of the same stem
    /// that ends in .csv, .tsv or .ctbl, or dataset.json beside it]
    #[arg(long, value_name = "FILE")]
    names: Option<PathBuf>,
}

impl NamesArg {
    /// Returns the naming of labels from the table, if given.
    pub(crate) fn naming(&self) -> Result<Naming<'static>, VolumeError> {
        Ok(Naming {
            names: self.names.as_deref().map(Names::read).transpose()?,
            ..Naming::default()
        })
    }
}

#[derive(Args)]
pub(crate) struct Input {
    /// Scene file (TOML), or the name of a built-in scene; without one the default scene, or with --labels the label
    /// file alone
    #[arg(value_name = "SCENE.toml")]
    scene: Option<PathBuf>,
    /// Label file to image, or a folder of binary masks or of closed surfaces (.stl, .ply, .obj, .vtk, .vtp) named by
    /// their files; with a scene it replaces the scene's volume
    #[arg(long, value_name = "FILE")]
    labels: Option<PathBuf>,
    /// CT that the labels were made from: unlabelled voxels of the body are gas, fat, muscle, soft tissue or bone by
    /// their grey value
    #[arg(long, value_name = "FILE")]
    ct: Option<PathBuf>,
    #[command(flatten)]
    names: NamesArg,
    /// Place the probe on the skin over this organ: a label or tissue name, or a part of one
    #[arg(long, value_name = "NAME")]
    target: Option<String>,
    /// Size of the frame in pixels
    #[arg(long, value_name = "WxH", value_parser = size)]
    size: Option<[u32; 2]>,
    #[command(flatten)]
    settings: Settings,
    #[command(flatten)]
    quality: QualityArgs,
}

/// Keys of a volume that belong to one that `--labels` replaces.
const REPLACED: [&str; 4] = ["names", "phantom", "resolution_mm", "seed"];

impl Input {
    /// Whether no input is specified, so that the command may choose.
    pub(crate) fn is_default(&self) -> bool {
        self.scene.is_none()
            && self.labels.is_none()
            && self.ct.is_none()
            && self.names.names.is_none()
            && self.target.is_none()
            && self.size.is_none()
            && self.settings.is_empty()
    }

    /// Folder of the paths in the scene.
    fn folder(&self) -> &Path {
        self.scene.as_deref().and_then(Path::parent).unwrap_or(Path::new(""))
    }

    /// Reads the scene's file, with what the options change in it.
    fn read(&self) -> Result<SceneFile, Error> {
        let settings = self.set()?;
        let file = match &self.scene {
            Some(scene) if scene.is_dir() || stem(scene).is_some() => {
                let name = scene.display();
                let labels = format!("labels are given with --labels {name}");
                let (kind, help) = match SequenceInfo::of(scene) {
                    _ if scene.is_dir() => ("a folder", labels),
                    None => ("an image file", labels),
                    Some(_) => (
                        "a recording",
                        format!("`file = '{name}'` under [motion.sequence] of a scene moves the probe by it"),
                    ),
                };
                return Err(usage(format!("{name} is {kind}, not a scene"), help));
            }
            Some(scene) => scene::read_or_bundled(scene, &settings)?,
            None if self.labels.is_some() => SceneFile::parse_with("", "", &settings)?,
            None => SceneFile::parse_with(scene::DEFAULT, "the default scene", &settings)?,
        };
        if self.target.is_some() && file.states("motion") {
            warn("the motion of the scene is left out: --target places the probe, which stays there");
        }
        self.settings.check(&file)?;
        Ok(file)
    }

    /// Lists the files that the command reads.
    pub(crate) fn files(&self) -> Vec<PathBuf> {
        let mut files = self.scene.as_deref().map_or_else(Vec::new, inputs);
        files.extend(
            [&self.labels, &self.ct, &self.names.names]
                .into_iter()
                .flatten()
                .cloned(),
        );
        files.extend(settings::files(&self.settings.of_scene(), self.folder()));
        files
    }

    /// Reads the scene and all files that it names, and prints notes and warnings. If the scene states a time
    /// budget for a frame, its open settings are picked for the backend and returned as the second value.
    pub(crate) fn scene(&self, backend: &BackendArgs) -> Result<(Scene, Option<Picked>), Error> {
        self.told(self.read()?.resolve(self.folder())?, backend)
    }

    /// Reads the scene as [`scene`](Self::scene) does, after a check of its file, and refuses one of which no frame
    /// shows anything of the volume.
    pub(crate) fn visible_scene(
        &self,
        backend: &BackendArgs,
        check: impl FnOnce(&SceneFile, &Path) -> Result<(), Error>,
    ) -> Result<(Scene, Option<Picked>), Error> {
        let (file, folder) = (self.read()?, self.folder());
        check(&file, folder)?;
        let scene = file.resolve(folder)?;
        match scene.blind() {
            Some(reason) => {
                terminal::notes(&scene.notes);
                Err(Failure::Blind(reason.to_owned()).into())
            }
            None => self.told(scene, backend),
        }
    }

    /// Prints notes and warnings, and picks open settings.
    fn told(&self, mut scene: Scene, backend: &BackendArgs) -> Result<(Scene, Option<Picked>), Error> {
        terminal::notes(&scene.notes);
        scene.warnings.iter().for_each(warn);
        let picked = self.quality.frames(&mut scene, backend)?;
        Ok((scene, picked))
    }

    /// Settings of the scene by options, those that name a key last.
    fn set(&self) -> Result<Vec<Setting>, Error> {
        let mut set = Vec::new();
        if let Some(labels) = &self.labels {
            set.extend(REPLACED.map(|key| Setting::removal(&format!("volume.{key}"), &[])));
            set.push(settings::path("volume.file", &here(labels))?);
            if self.scene.is_none() {
                set.push(Setting::new("version", Version::NEWEST.number()));
            }
        }
        for (key, path) in [("volume.ct", &self.ct), ("volume.names", &self.names.names)] {
            if let Some(path) = path {
                set.push(settings::path(key, &here(path))?);
            }
        }
        if let Some(target) = &self.target {
            set.push(Setting::removal("motion", &[]));
            set.push(Setting::removal("pose", &["plane"]));
            set.push(Setting::new("pose.target", target.as_str()));
        }
        if let Some([width, height]) = self.size {
            set.push(Setting::new("image.width", width));
            set.push(Setting::new("image.height", height));
        }
        set.extend(self.settings.of_scene());
        Ok(set)
    }
}

/// A path relative to the working directory, not to the scene's folder.
pub(crate) fn here(path: &Path) -> PathBuf {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned())
}

fn size(text: &str) -> Result<[u32; 2], String> {
    let expected = || format!("expected two whole numbers from 1 to {LARGEST_SIDE} such as 640x480");
    let (width, height) = text.split_once(['x', 'X']).ok_or_else(expected)?;
    let side = |text: &str| match text.parse() {
        Ok(side @ 1..=LARGEST_SIDE) => Ok(side),
        _ => Err(expected()),
    };
    Ok([side(width)?, side(height)?])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_two_numbers_in_range() {
        assert_eq!(size("640x480"), Ok([640, 480]));
        assert_eq!(size("1X16384"), Ok([1, 16_384]));
        for wrong in [
            "",
            "640",
            "0x5",
            "5x0",
            "16385x1",
            "-1x5",
            "640x480x2",
            "6e2x5",
            "99999999999x1",
        ] {
            assert!(size(wrong).is_err(), "{wrong}");
        }
    }
}
