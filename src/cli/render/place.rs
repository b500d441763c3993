//! Destinations of rendered files, checked before rendering.

use std::path::{Path, PathBuf};

use crate::base::output::folder::{Folder, MANIFEST};
use crate::base::output::png;
use crate::imaging::sidecar::Sidecar;
use crate::imaging::synth::layers::Layer;

use super::extras::Extras;
use super::output::PARAMETERS;
use super::target::Target;
use crate::cli::failure::Failure;
use crate::cli::output::Force;

/// Final and temporary destinations of frames.
pub struct Place {
    /// Requested path.
    path: PathBuf,
    /// Where frames are written until the last is complete.
    pub inner: Target,
    folder: Option<Folder>,
    /// Existing files that match by name, and are not written by this run.
    left: Vec<PathBuf>,
}

impl Place {
    /// Checks that all files can be written.
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
            _ => &Layer::ALL[..],
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

    /// Warnings about old files that remain beside the new ones and seem to belong to them.
    pub fn left(&self) -> Vec<String> {
        let said = |file: &PathBuf| format!("{}: it was there already, and is not of this run", file.display());
        self.left.iter().map(said).collect()
    }

    /// Final path of a written file.
    pub fn of(&self, file: &Path) -> PathBuf {
        self.folder
            .as_ref()
            .map_or(file.to_owned(), |folder| folder.place(file))
    }

    /// Moves the frames to the requested path and returns it.
    pub fn install(self) -> Result<PathBuf, Failure> {
        self.folder.map_or(Ok(()), Folder::install)?;
        Ok(self.path)
    }
}
