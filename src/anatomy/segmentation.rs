//! Segmentations: a label file or a folder of masks, with labels named by the file, a table, file names or label
//! values.

mod evidence;
mod extent;
mod folder;
mod info;
mod naming;
mod surfaces;
mod surround;
mod table;

use std::path::{Path, PathBuf};

use crate::acoustics::{Preset, known};
use crate::volume::{self, Label, LabelVolume, Loaded, VolumeError, load};
use extent::Extents;
pub use info::{LabelInfo, SegmentationInfo};
use insonify_base::note::Notes;
pub use table::Names;

/// Name of the description of a data set of nnU-Net.
const DATA_SET: &str = "dataset.json";

/// Key of the resolution in scenes.
const RESOLUTION: &str = "resolution_mm";

/// Sources of label names.
#[derive(Clone, Debug, Default)]
pub struct Naming<'a> {
    /// Names by value, which take precedence over those in the file.
    pub names: Option<Names>,
    /// Numbering used to name labels without names.
    pub preset: Preset,
    /// Values of labels that need no name.
    pub claimed: &'a [i64],
    /// Names of labels that keep them.
    pub claimed_names: &'a [String],
}

/// A label volume with named labels.
#[derive(Clone, Debug)]
pub struct Segmentation {
    /// The volume.
    pub volume: LabelVolume,
    /// Numbering by which labels were named, and the values of these labels.
    pub by_value: Option<(Preset, Vec<i64>)>,
    /// Sources of the names, one sentence each.
    pub notes: Notes,
    /// Warnings, one sentence each.
    pub warnings: Vec<String>,
    /// Whether the labels are closed surfaces, whose files state no unit.
    is_of_surfaces: bool,
}

impl From<LabelVolume> for Segmentation {
    fn from(volume: LabelVolume) -> Self {
        Self {
            volume,
            by_value: None,
            notes: Notes::default(),
            warnings: Vec::new(),
            is_of_surfaces: false,
        }
    }
}

impl From<Loaded> for Segmentation {
    fn from(loaded: Loaded) -> Self {
        Self {
            notes: loaded.notes,
            warnings: loaded.warnings,
            ..loaded.volume.into()
        }
    }
}

/// Name of a volume's file without folder and extension; `None` if the extension is not that of a volume.
pub fn stem(path: &Path) -> Option<String> {
    let name = path.file_name()?.to_string_lossy().into_owned();
    let ending = volume::ending(&name)?;
    Some(name[..name.len() - ending.len()].to_owned())
}

/// Opens a label file, a folder of binary masks or of closed surfaces named by their files, or one closed surface, and
/// names its labels: by `names`, or else by the file, by a table beside it (`liver.csv` for `liver.nii.gz`, or
/// `dataset.json` of nnU-Net), by the name of a file that is a single mask, and by the values of a numbering.
///
/// # Errors
/// [`VolumeError`] as in [`load`], for folders without masks and for masks that are not binary or lie on other
/// grids.
pub fn open(path: &Path, naming: &Naming) -> Result<Segmentation, VolumeError> {
    open_on(path, naming, None)
}

/// Opens labels as [`open`] does; closed surfaces become labels on a grid of cubes of `resolution_mm`.
///
/// # Errors
/// Those of [`open`], and for a resolution of a file that has a grid, or of more voxels than memory holds.
pub fn open_on(path: &Path, naming: &Naming, resolution_mm: Option<f64>) -> Result<Segmentation, VolumeError> {
    let surfaces = surfaces::files(path)?;
    let mut segmentation = if !surfaces.is_empty() {
        surfaces::read(path, &surfaces, resolution_mm)?
    } else if let Some(resolution_mm) = resolution_mm {
        let text = format!(
            "resolution {resolution_mm} mm of {}; expected none: labels keep the grid of their file, closed surfaces have none",
            path.display()
        );
        return Err(VolumeError::option(RESOLUTION, text));
    } else if path.is_dir() {
        folder::read(path)?
    } else {
        load(path)?.into()
    };
    segmentation
        .unlabel_background(naming)
        .map_err(|error| error.in_file(path))?;
    let by_table = match &naming.names {
        Some(names) => {
            segmentation.take_names(names);
            true
        }
        None => segmentation.nameless(naming).next().is_some() && segmentation.take_names_beside(path),
    };
    let stem = stem(path);
    segmentation.name_mask(stem.as_deref());
    let extents = Extents::of(&segmentation.volume);
    // Values missing from a table belong to its own numbering.
    let has_table = by_table && naming.preset == Preset::Auto;
    segmentation.name_body(naming, &extents, has_table);
    if !has_table {
        segmentation
            .warnings
            .extend(segmentation.nameless_mask(stem.as_deref(), naming));
        segmentation.read_values(naming, stem.as_deref(), &extents);
    }
    segmentation.warnings.extend(segmentation.doubts(&extents));
    Ok(segmentation)
}

impl Segmentation {
    /// Indices of unnamed labels that need a name.
    fn nameless<'a>(&'a self, naming: &'a Naming) -> impl Iterator<Item = usize> + 'a {
        let labels = self.volume.labels().iter().enumerate().skip(1);
        labels
            .filter(|(_, label)| label.name.is_none() && !naming.claimed.contains(&label.value))
            .map(|(index, _)| index)
    }

    fn take_names(&mut self, names: &Names) {
        let mut without = Vec::new();
        for index in 1..self.volume.labels().len() {
            let label = &self.volume.labels()[index];
            match names.of(label.value) {
                Some(name) => self.volume.name(index, name.to_owned()),
                None if label.name.is_none() => without.push(label.value),
                None => {}
            }
        }
        let file = names.path().display();
        self.notes.push(format!("labels are named by {file}"));
        if !without.is_empty() {
            self.warnings
                .push(format!("{file} names no label {}", listed(&without)));
        }
    }

    /// Takes the names from the first table beside a label file, and returns whether there is one: an unreadable table
    /// belongs to something else, and so does a data set that names no label of the file.
    fn take_names_beside(&mut self, path: &Path) -> bool {
        for table in tables_beside(path) {
            match Names::read(&table) {
                Ok(names)
                    if table.ends_with(DATA_SET)
                        && self.volume.labels()[1..]
                            .iter()
                            .all(|label| names.of(label.value).is_none()) => {}
                Ok(names) => {
                    self.take_names(&names);
                    return true;
                }
                Err(error) => self.notes.push(format!("not used as label names: {error}")),
            }
        }
        false
    }

    /// Names the only label of a mask after its file, if the name identifies a tissue.
    fn name_mask(&mut self, stem: Option<&str>) {
        if let ([_, Label { name: None, .. }], Some(stem)) = (self.volume.labels(), stem)
            && known(stem).is_some()
        {
            self.notes.push(format!("the only label is named by its file: {stem}"));
            self.volume.name(1, stem.to_owned());
        }
    }

    /// Warning about a mask that nothing names.
    fn nameless_mask(&self, stem: Option<&str>, naming: &Naming) -> Option<String> {
        let ([_, Label { name: None, value, .. }], Some(stem)) = (self.volume.labels(), stem) else {
            return None;
        };
        let is_nameless = naming::is_mask(*value) && naming.preset == Preset::Auto && !naming.claimed.contains(value);
        is_nameless.then(|| {
            format!(
                "the only label, {value}, has no name, and the file name \"{stem}\" names no tissue: name the file after it, such as \
                 kidney_right.nii.gz, or name it with --names FILE"
            )
        })
    }
}

/// Tables that may name the labels of a file: of its stem, and those of nnU-Net's data set, whose labels lie in folders
/// such as `labelsTr`.
fn tables_beside(path: &Path) -> impl Iterator<Item = PathBuf> {
    let beside = |name: String| path.with_file_name(name);
    let stem = stem(path).unwrap_or_default();
    let mut tables = ["csv", "tsv", "ctbl"]
        .map(|ending| beside(format!("{stem}.{ending}")))
        .to_vec();
    tables.push(beside(DATA_SET.to_owned()));
    let folder = path.parent().map(|folder| {
        if folder == Path::new("") {
            Path::new(".")
        } else {
            folder
        }
    });
    let folder = folder.and_then(|folder| folder.canonicalize().ok());
    let is_labels = |name: &std::ffi::OsStr| name.to_string_lossy().starts_with("labels");
    if folder.as_deref().and_then(Path::file_name).is_some_and(is_labels) {
        tables.extend(
            folder
                .as_deref()
                .and_then(Path::parent)
                .map(|parent| parent.join(DATA_SET)),
        );
    }
    tables.into_iter().filter(|table| table.is_file())
}

/// Lists values for a sentence: all if few, otherwise the first ones.
fn listed(values: &[i64]) -> String {
    const SHOWN: usize = 12;
    let shown: Vec<String> = values.iter().take(SHOWN).map(i64::to_string).collect();
    let more = values.len().saturating_sub(SHOWN);
    match more {
        0 => shown.join(", "),
        _ => format!("{} and {more} more", shown.join(", ")),
    }
}

#[cfg(test)]
mod tests;
