//! Where the files of a rendering go, looked at before it.

use std::path::{Path, PathBuf};

use clap::ValueEnum;
use insonify::output::folder::{Folder, MANIFEST};
use insonify::output::png;
use insonify::output::sidecar::Sidecar;
use insonify::synth::layers::Layer;

use super::extras::Extras;
use super::output::PARAMETERS;
use super::target::Target;
use crate::cli::failure::Failure;
use crate::cli::output::Force;

/// Where frames go, and where they are until the last is done.
pub struct Place {
    /// What was asked for.
    path: PathBuf,
    /// Where frames are written.
    pub inner: Target,
    folder: Option<Folder>,
    /// Files that are there, go with it by name, and are not written by this run.
    left: Vec<PathBuf>,
}

impl Place {
    /// Looks whether everything can be written where it is to be.
    pub fn open(target: Target, extras: &Extras, force: Force, inputs: &[PathBuf]) -> Result<Self, Failure> {
        let path = target.path().to_owned();
        let layers = extras.layers();
        let (mut files, mut left) = (vec![path.clone()], Vec::new());
        let mut sort = |file: PathBuf, wanted: bool| match wanted {
            true => files.push(file),
            false => left.extend(file.exists().then_some(file)),
        };
        let layers_beside = match target {
            Target::Folder(_) => &[],
            _ => Layer::value_variants(),
        };
        for layer in layers_beside {
            sort(png::layer_path(&path, layer.name()), layers.contains(layer));
        }
        let folder = |folder: &Path| force.folder(folder, "render", &["frame_", PARAMETERS], inputs);
        let folder = match &target {
            Target::File(file) => {
                sort(png::layer_path(file, "overview"), extras.overview);
                sort(Sidecar::path_for(file), extras.sidecar);
                None
            }
            Target::Folder(beside) => Some(folder(beside)?),
            Target::Sequence(_, beside) if extras.sidecar || extras.overview => Some(folder(beside)?),
            Target::Sequence(_, beside) => {
                sort(beside.join(MANIFEST), false);
                None
            }
        };
        if !matches!(target, Target::Folder(_)) {
            let files: Vec<&Path> = files.iter().map(PathBuf::as_path).collect();
            force.check(&files, inputs)?;
        }
        let inner = match (target, &folder) {
            (Target::Folder(_), Some(folder)) => Target::Folder(folder.path().to_owned()),
            (Target::Sequence(file, _), Some(folder)) => Target::Sequence(file, folder.path().to_owned()),
            (target, _) => target,
        };
        Ok(Self {
            path,
            inner,
            folder,
            left,
        })
    }

    /// Warnings of files that stay beside the new ones and seem to go with them.
    pub fn left(&self) -> Vec<String> {
        let said = |file: &PathBuf| format!("{}: it was there already, and is not of this run", file.display());
        self.left.iter().map(said).collect()
    }

    /// Where a file that was written will be.
    pub fn of(&self, file: &Path) -> PathBuf {
        self.folder
            .as_ref()
            .map_or(file.to_owned(), |folder| folder.place(file))
    }

    /// Moves the frames to where they were asked for; returns that.
    pub fn install(self) -> Result<PathBuf, Failure> {
        self.folder.map_or(Ok(()), Folder::install)?;
        Ok(self.path)
    }
}
