//! Writer of ParaView's time series of files (`.pvd`).

use std::io::Write;
use std::path::Path;

use super::MeshFileError;

use crate::base::output::atomic;
use crate::base::text::escape;

/// Writes a time series: the time of each file (any unit, finite) and its name, relative to the folder of `path`.
///
/// # Errors
/// [`MeshFileError::Time`] for a time that is not finite; [`MeshFileError::Write`].
pub fn write_pvd(path: &Path, files: &[(f64, String)]) -> Result<(), MeshFileError> {
    if let Some((time, file)) = files.iter().find(|(time, _)| !time.is_finite()) {
        return Err(MeshFileError::Time {
            path: path.to_owned(),
            file: file.clone(),
            time: *time,
        });
    }
    atomic::write(path, |out| {
        writeln!(
            out,
            "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"1.0\" byte_order=\"LittleEndian\">\n<Collection>"
        )?;
        for (time, file) in files {
            writeln!(
                out,
                "<DataSet timestep=\"{time:?}\" part=\"0\" file=\"{}\"/>",
                escape(file)
            )?;
        }
        writeln!(out, "</Collection>\n</VTKFile>")
    })?;
    Ok(())
}
