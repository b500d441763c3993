//! Where frames go: a file, a folder, or an image sequence.

use std::fs;
use std::path::{Path, PathBuf};

use insonify::output::atomic::WriteError;
use insonify::output::png;
use insonify::output::sequence::{FrameInfo, SequenceWriter};
use insonify::synth::Frame;
use nalgebra::Matrix4;

use crate::cli::failure::Failure;

/// Where frames go.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Target {
    /// One PNG.
    File(PathBuf),
    /// Numbered PNGs.
    Folder(PathBuf),
    /// An image sequence with the transforms of each frame.
    Sequence(PathBuf),
}

impl Target {
    /// What `-o` means for a number of frames.
    pub fn choose(output: Option<&Path>, frames: usize) -> Result<Self, Failure> {
        let Some(path) = output else {
            return Ok(if frames == 1 {
                Self::File("frame.png".into())
            } else {
                Self::Folder("frames".into())
            });
        };
        if path.as_os_str().is_empty() {
            return Err(Failure::usage("-o names no file", "name a file or a folder"));
        }
        let ending = path
            .extension()
            .map(|ending| ending.to_string_lossy().to_ascii_lowercase());
        let shown = path.display();
        match ending.as_deref() {
            Some("mha" | "nrrd") => Ok(Self::Sequence(path.to_owned())),
            _ if path.is_dir() || ends_in_separator(path) => Ok(Self::Folder(path.to_owned())),
            Some("png") if frames > 1 => Err(Failure::usage(
                format!("-o {shown} is one picture, and there are {frames} frames"),
                "name a folder, or an image sequence that ends in .mha or .nrrd",
            )),
            _ if frames > 1 => Ok(Self::Folder(path.to_owned())),
            Some("png") | None => Ok(Self::File(path.to_owned())),
            Some(other) => Err(Failure::usage(
                format!("-o {shown}: pictures that end in .{other} are not written"),
                "name a file that ends in .png, .mha or .nrrd, or a folder that exists",
            )),
        }
    }

    /// The path that was asked for.
    pub fn path(&self) -> &Path {
        match self {
            Self::File(path) | Self::Folder(path) | Self::Sequence(path) => path,
        }
    }

    /// The picture of a frame, or where it would be if the sequence were pictures: what lies beside it is named after it.
    pub fn picture(&self, frame: usize) -> PathBuf {
        match self {
            Self::File(path) => path.clone(),
            Self::Folder(folder) => png::frame_path(folder, frame),
            Self::Sequence(path) => {
                let stem = path.file_stem().unwrap_or_default().to_string_lossy();
                path.with_file_name(format!("{stem}_{frame:04}.png"))
            }
        }
    }
}

fn ends_in_separator(path: &Path) -> bool {
    path.as_os_str().to_string_lossy().ends_with(std::path::is_separator)
}

/// A target being written.
pub struct Output {
    pub target: Target,
    sequence: Option<SequenceWriter>,
}

impl Output {
    /// Makes the folder, starts the sequence, or looks for the folder of the file, so that what cannot be written shows
    /// before anything is rendered.
    pub fn open(target: Target, width: usize, height: usize) -> Result<Self, Failure> {
        let sequence = match &target {
            Target::File(path) => {
                let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
                if let Some(Err(cause)) = folder.map(fs::metadata) {
                    return Err(WriteError::new(path, cause).into());
                }
                None
            }
            Target::Folder(folder) => {
                fs::create_dir_all(folder).map_err(|cause| Failure::Folder {
                    path: folder.clone(),
                    cause,
                })?;
                None
            }
            Target::Sequence(path) => Some(SequenceWriter::create(path, width, height)?),
        };
        Ok(Self { target, sequence })
    }

    /// Writes a frame and returns the file that it went to.
    pub fn write(
        &mut self,
        frame: &Frame,
        number: usize,
        time_s: f64,
        probe_to_world: &Matrix4<f64>,
    ) -> Result<PathBuf, Failure> {
        if let Some(sequence) = &mut self.sequence {
            let info = FrameInfo {
                timestamp: time_s,
                transforms: &[
                    ("ImageToWorld", frame.image_to_world, true),
                    ("ProbeToWorld", *probe_to_world, true),
                ],
                image_valid: true,
            };
            sequence.push(&frame.pixels, &info)?;
            return Ok(self.target.path().to_owned());
        }
        let path = self.target.picture(number);
        png::write_grey(&path, frame.width, frame.height, &frame.pixels)?;
        Ok(path)
    }

    /// Finishes the sequence.
    pub fn finish(self) -> Result<(), Failure> {
        match self.sequence {
            Some(sequence) => Ok(sequence.finish()?),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chosen(output: &str, frames: usize) -> Result<Target, u8> {
        Target::choose(Some(Path::new(output)), frames).map_err(|failure| failure.status())
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
        assert_eq!(chosen("a.mha", 1), Ok(Target::Sequence("a.mha".into())));
        assert_eq!(chosen("a.nrrd", 9), Ok(Target::Sequence("a.nrrd".into())));
        assert_eq!(chosen("a.png", 2), Err(2));
        assert_eq!(chosen("a.jpg", 1), Err(2));
        assert_eq!(chosen("", 1), Err(2));
    }

    #[test]
    fn what_goes_with_a_frame_is_named_after_it() {
        assert_eq!(Target::File("a/b.png".into()).picture(0), Path::new("a/b.png"));
        assert_eq!(Target::Folder("a".into()).picture(12), Path::new("a/frame_0012.png"));
        assert_eq!(Target::Sequence("a/b.mha".into()).picture(3), Path::new("a/b_0003.png"));
    }
}
