//! Writing of label volumes: each voxel as its original value, in the smallest integer type that holds them all.

use std::io::{self, Write};
use std::path::Path;

use super::element::Element;
use super::error::{At, VolumeError};
use super::{FORMATS, LabelVolume, format};

/// Number of voxels encoded at a time.
const CHUNK: usize = 64 << 10;

/// Saves a label volume in the format that writes files of this ending (see [`written`](super::written)). The write is
/// atomic. NIfTI holds the transform in single precision.
///
/// ```
/// use insonify_anatomy::volume::{Label, LabelVolume, load, save};
/// use nalgebra::Matrix4;
///
/// let label = |value, name: &str| Label { value, name: Some(name.into()), voxels: 0 };
/// let labels = vec![label(0, "background"), label(300, "liver")];
/// let volume = LabelVolume::new([3, 1, 1], vec![0, 1, 1], labels, Matrix4::new_scaling(2.0))?;
/// let folder = tempfile::tempdir()?;
/// for name in ["liver.nrrd", "liver.mha", "liver.nii.gz"] {
///     let path = folder.path().join(name);
///     save(&volume, &path)?;
///     let loaded = load(&path)?.volume;
///     assert_eq!((loaded.voxels(), loaded.labels()[1].value), (volume.voxels(), 300));
/// }
/// assert!(save(&volume, &folder.path().join("liver.stl")).is_err());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
/// # Errors
/// [`VolumeError::Unsupported`] for another extension or a volume that the format cannot hold, [`VolumeError::Write`]
/// if the file cannot be written.
pub fn save(volume: &LabelVolume, path: &Path) -> Result<(), VolumeError> {
    let name = path.to_string_lossy().to_ascii_lowercase();
    let writes = |format: &&&format::Format| format.written.iter().any(|written| name.ends_with(written.ending));
    match FORMATS.iter().find(writes) {
        Some(format) => (format.write)(volume, path),
        None => {
            let endings = format::list(format::written().map(|written| written.ending), "or");
            Err(VolumeError::unsupported(
                path,
                At::Header,
                "writing this kind of file",
                format!("names end in {endings}"),
            ))
        }
    }
}

/// Smallest type that holds every label value.
pub(super) fn element(volume: &LabelVolume) -> Element {
    let values = || volume.labels().iter().map(|label| label.value);
    Element::smallest(values().min().unwrap_or(0), values().max().unwrap_or(0))
}

/// Writes the value of each voxel, little-endian.
pub(super) fn write_voxels(volume: &LabelVolume, element: Element, writer: &mut impl Write) -> io::Result<()> {
    let size = element.bytes();
    let values: Vec<[u8; 8]> = volume.labels().iter().map(|label| label.value.to_le_bytes()).collect();
    let mut bytes = Vec::with_capacity(CHUNK * size);
    for voxels in volume.voxels().chunks(CHUNK) {
        bytes.clear();
        for &voxel in voxels {
            bytes.extend_from_slice(&values[usize::from(voxel)][..size]);
        }
        writer.write_all(&bytes)?;
    }
    Ok(())
}

/// Values and names of the labels that have a name.
pub(super) fn named(volume: &LabelVolume) -> impl Iterator<Item = (i64, &str)> {
    volume
        .labels()
        .iter()
        .filter_map(|label| Some((label.value, label.name.as_deref()?)))
}

/// Appends to a header; writing to a string cannot fail.
macro_rules! line {
    ($text:expr, $($argument:tt)*) => {{
        let _ = writeln!($text, $($argument)*);
    }};
}
pub(super) use line;

#[cfg(test)]
pub(super) mod tests;
