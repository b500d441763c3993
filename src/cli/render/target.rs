//! Destination of frames: a file, a folder, or an image sequence.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use serde_json::Value;

use super::extras::Extras;
use super::manifest::MANIFESTS;
use super::output::PARAMETERS;
use crate::failure::{Error, usage};
use crate::output::Force;
use insonify_base::output::folder::{Folder, MANIFEST};
use insonify_base::output::png;
use insonify_imaging::sidecar::Sidecar;
use insonify_imaging::synth::layers::Layer;

/// Extensions of unsupported pictures and films, which are not taken for folders.
const OTHERS: [&str; 13] = [
    "avi", "bmp", "dcm", "gz", "jpeg", "jpg", "mhd", "mkv", "mov", "mp4", "tif", "tiff", "webm",
];

/// Destination of frames.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Target {
    /// A single PNG.
    File(PathBuf),
    /// A folder of numbered PNGs.
    Folder(PathBuf),
    /// An image sequence with the transforms of each frame, or an animated GIF, and a folder for companion files of
    /// single frames.
    Sequence(PathBuf, PathBuf),
}

impl Target {
    /// Interprets `-o` for a number of frames.
    pub(crate) fn choose(output: Option<&Path>, frames: usize) -> Result<Self, Error> {
        let Some(path) = output else {
            return Ok(if frames == 1 {
                Self::File("frame.png".into())
            } else {
                Self::Folder("frames".into())
            });
        };
        if path.as_os_str().is_empty() {
            return Err(usage("-o names no file", "name a file or a folder"));
        }
        let ending = path
            .extension()
            .map(|ending| ending.to_string_lossy().to_ascii_lowercase());
        let shown = path.display();
        match ending.as_deref() {
            Some("mha" | "nrrd" | "npy" | "gif") => Ok(Self::Sequence(path.to_owned(), path.with_extension(""))),
            _ if path.is_dir() || ends_in_separator(path) => Ok(Self::Folder(path.to_owned())),
            Some("png") if frames > 1 => Err(usage(
                format!("-o {shown} is one picture, and there are {frames} frames"),
                "name a folder, a film that ends in .gif, or an image sequence that ends in .mha, .nrrd or .npy",
            )),
            _ if frames > 1 && !ending.as_deref().is_some_and(|ending| OTHERS.contains(&ending)) => {
                Ok(Self::Folder(path.to_owned()))
            }
            Some("png") | None => Ok(Self::File(path.to_owned())),
            Some(extension) => Err(usage(
                format!("-o {shown}: pictures that end in .{extension} are not written"),
                "name a file that ends in .png, .gif, .mha, .nrrd or .npy, or a folder that exists",
            )),
        }
    }

    /// Whether a path names a file, regardless of the number of frames.
    pub(crate) fn is_file(path: &Path) -> bool {
        let ending = path.extension().map(OsStr::to_ascii_lowercase);
        !path.is_dir()
            && ending.is_some_and(|ending| {
                ["png", "gif", "mha", "nrrd", "npy"]
                    .iter()
                    .any(|known| ending == *known)
            })
    }

    /// Requested path.
    pub(crate) fn path(&self) -> &Path {
        match self {
            Self::File(path) | Self::Folder(path) | Self::Sequence(path, _) => path,
        }
    }

    /// Path of the picture of a frame, or its equivalent for a sequence: companion files are named after it.
    pub(crate) fn picture(&self, frame: usize, count: usize) -> PathBuf {
        match self {
            Self::File(path) => path.clone(),
            Self::Folder(folder) | Self::Sequence(_, folder) => png::frame_path(folder, frame, count),
        }
    }
}

fn ends_in_separator(path: &Path) -> bool {
    path.as_os_str().to_string_lossy().ends_with(std::path::is_separator)
}

/// Name of a file, for messages.
pub(crate) fn name_of(path: &Path) -> String {
    path.file_name()
        .unwrap_or(OsStr::new(""))
        .to_string_lossy()
        .into_owned()
}

// Destinations of rendered files, checked before rendering.

/// Final and temporary destinations of frames.
pub(crate) struct Place {
    /// Requested path.
    path: PathBuf,
    /// Temporary path of the frames until the last is complete.
    pub inner: Target,
    folder: Option<Folder>,
    /// Existing files that match by name, and are not written by this run.
    left: Vec<PathBuf>,
}

impl Place {
    /// Checks that all files can be written.
    pub(crate) fn open(target: Target, extras: &Extras, force: Force, inputs: &[PathBuf]) -> Result<Self, Error> {
        let path = target.path().to_owned();
        let layers = extras.layers();
        let (mut files, mut left) = (vec![path.clone()], Vec::new());
        let mut sort = |file: PathBuf, wanted: bool| {
            if wanted {
                files.push(file)
            } else {
                left.extend(file.exists().then_some(file))
            }
        };
        // A folder knows by its manifest which files are its own. Beside a single file, those of layers that
        // are not asked for now may be left from another run, and look as if they belonged to this one.
        let layers_beside = match target {
            Target::Folder(_) => &[],
            _ => &Layer::ALL[..],
        };
        for layer in layers_beside {
            sort(png::layer_path(&path, layer.name()), layers.contains(layer));
        }
        let names = ["frame_", PARAMETERS, MANIFESTS[0], MANIFESTS[1]];
        let folder = |folder: &Path| force.folder_to_begin(folder, "render", &names, inputs);
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
        Ok(Self {
            path,
            inner: target,
            folder,
            left,
        })
    }

    /// Begins the run of a description; with `resume` it goes on with one that was cut off, as [`Folder::begin`] does.
    /// Returns `false` if all frames are there.
    pub(crate) fn begin(&mut self, run: Value, resume: bool) -> Result<bool, Error> {
        let Some(folder) = &mut self.folder else {
            return Ok(true);
        };
        let begins = folder.begin(run, resume)?;
        match &mut self.inner {
            Target::Folder(inner) | Target::Sequence(_, inner) => folder.path().clone_into(inner),
            Target::File(_) => {}
        }
        Ok(begins)
    }

    /// Warnings about old files that remain beside the new ones and seem to belong to them.
    pub(crate) fn left(&self) -> Vec<String> {
        let said = |file: &PathBuf| format!("{}: it was there already, and is not of this run", file.display());
        self.left.iter().map(said).collect()
    }

    /// Final path of a written file.
    pub(crate) fn of(&self, file: &Path) -> PathBuf {
        self.folder
            .as_ref()
            .map_or(file.to_owned(), |folder| folder.place(file))
    }

    /// Requested path.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Moves the frames to the requested path and returns it.
    pub(crate) fn install(self) -> Result<PathBuf, Error> {
        self.folder.map_or(Ok(()), Folder::install)?;
        Ok(self.path)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chosen(output: &str, frames: usize) -> Result<Target, u8> {
        Target::choose(Some(Path::new(output)), frames).map_err(|error| error.exit_status())
    }

    #[test]
    fn one_frame_is_a_file_and_many_are_a_folder() {
        assert_eq!(Target::choose(None, 1).unwrap(), Target::File("frame.png".into()));
        assert_eq!(Target::choose(None, 2).unwrap(), Target::Folder("frames".into()));
        assert_eq!(chosen("a.PNG", 1), Ok(Target::File("a.PNG".into())));
        assert_eq!(chosen("a", 1), Ok(Target::File("a".into())));
        assert_eq!(chosen("a/", 1), Ok(Target::Folder("a/".into())));
        assert_eq!(chosen("a", 2), Ok(Target::Folder("a".into())));
        assert_eq!(chosen("run.v2", 2), Ok(Target::Folder("run.v2".into())));
        assert_eq!(chosen("a.mha", 1), Ok(Target::Sequence("a.mha".into(), "a".into())));
        assert_eq!(chosen("a.npy", 2), Ok(Target::Sequence("a.npy".into(), "a".into())));
        assert_eq!(chosen("a.nrrd", 9), Ok(Target::Sequence("a.nrrd".into(), "a".into())));
        for name in ["a.png", "a.mp4", "a.igs.MHD"] {
            assert_eq!(chosen(name, 2), Err(2), "{name}");
        }
        assert_eq!(chosen("a.jpg", 1), Err(2));
        assert_eq!(chosen("", 1), Err(2));
    }

    #[test]
    fn what_goes_with_a_frame_is_named_after_it() {
        assert_eq!(Target::File("a/b.png".into()).picture(0, 1), Path::new("a/b.png"));
        let frame = |target: Target| target.picture(12, 20);
        assert_eq!(frame(Target::Folder("a".into())), Path::new("a/frame_0012.png"));
        let sequence = Target::choose(Some(Path::new("a/b.mha")), 20).unwrap();
        assert_eq!(frame(sequence), Path::new("a/b/frame_0012.png"));
    }
}
