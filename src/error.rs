//! Top-level error type, and whether the user or the machine is at fault.

use crate::simulator::SimulatorError;
use insonify_anatomy::volume::VolumeError;
use insonify_base::cause::Cause;
use insonify_base::csv::CsvError;
use insonify_base::document::InputError;
use insonify_base::output::OutputError;
use insonify_gpu::GpuError;
use insonify_imaging::synth::SynthError;
use insonify_mechanics::insertion::StepError;
use insonify_mechanics::needle::beam::BeamError;
use insonify_mesh::file::MeshFileError;
use insonify_mesh::generate::GenerateError;
use insonify_tracking::TrackingError;

/// Any error between a command and its output.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// An input file cannot be used.
    #[error(transparent)]
    Input(#[from] InputError),
    /// A step of an insertion failed.
    #[error(transparent)]
    Step(#[from] StepError),
    /// The shape of a needle in tissue cannot be computed in a study.
    #[error(transparent)]
    Beam(#[from] BeamError),
    /// A table cannot be read or used.
    #[error(transparent)]
    Csv(#[from] CsvError),
    /// An image file cannot be read or written.
    #[error(transparent)]
    Volume(#[from] VolumeError),
    /// A mesh file cannot be read or written.
    #[error(transparent)]
    Mesh(#[from] MeshFileError),
    /// A mesh cannot be made from a volume.
    #[error(transparent)]
    Generate(#[from] GenerateError),
    /// A frame cannot be synthesised.
    #[error(transparent)]
    Synth(#[from] SynthError),
    /// A configuration of PLUS cannot be read.
    #[error(transparent)]
    Calibration(#[from] TrackingError),
    /// A GPU operation failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// A simulator cannot image its model.
    #[error(transparent)]
    Simulator(#[from] SimulatorError),
    /// An output cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
}

/// Exit status for failures of the machine.
pub const MACHINE: u8 = 1;
/// Exit status for invalid arguments, files or scenes.
pub const INPUT: u8 = 2;

impl Cause for Error {
    fn is_machine(&self) -> bool {
        self.inner().is_machine()
    }

    fn input(&self) -> Option<&InputError> {
        self.inner().input()
    }
}

impl Error {
    fn inner(&self) -> &dyn Cause {
        match self {
            Self::Input(error) => error,
            Self::Step(error) => error,
            Self::Beam(error) => error,
            Self::Csv(error) => error,
            Self::Volume(error) => error,
            Self::Mesh(error) => error,
            Self::Generate(error) => error,
            Self::Synth(error) => error,
            Self::Calibration(error) => error,
            Self::Gpu(error) => error,
            Self::Simulator(error) => error,
            Self::Output(error) => error,
        }
    }

    /// Exit status of the program: [`MACHINE`] or [`INPUT`].
    pub fn exit_status(&self) -> u8 {
        if self.is_machine() { MACHINE } else { INPUT }
    }
}

#[cfg(test)]
mod tests {
    use std::io;
    use std::path::Path;

    use super::*;
    use insonify_imaging::scene::SceneFile;

    #[test]
    fn input_is_told_from_machine() {
        let full = OutputError::write(Path::new("frame.png"), io::Error::from(io::ErrorKind::StorageFull));
        assert_eq!(Error::from(full).exit_status(), MACHINE);
        let missing = insonify_anatomy::volume::load(Path::new("/nowhere/labels.nii"))
            .map(drop)
            .unwrap_err();
        assert_eq!(Error::from(missing).exit_status(), INPUT);
        let scene = SceneFile::parse("version = 2", "x.toml").and_then(|file| file.resolve(Path::new(".")).map(drop));
        let error = Error::from(scene.unwrap_err());
        assert_eq!(error.exit_status(), INPUT);
        assert!(error.input().is_some_and(|error| error.excerpt().is_some()));
    }
}
