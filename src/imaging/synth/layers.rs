//! Beam-space results of a frame, and its ground-truth layers.

use nalgebra::{Matrix4, Point3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::store::Store;
use super::tables::Tables;
use insonify_anatomy::volume::Label;
use insonify_base::real::Real;

/// Beam-space results: scanline by scanline of the central plane, widened to double precision. Results of omitted
/// passes are empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Beam {
    /// Number of scanlines.
    pub lines: usize,
    /// Number of samples along a scanline.
    pub samples: usize,
    /// Reference position in the world, mm, and the warp's flag. Passes compute it in single precision relative to the
    /// local origin ([`LocalOrigin`](super::LocalOrigin)), and it is converted to the world in double precision: at 1e5
    /// mm it is as accurate as near the origin.
    pub position: Vec<[f64; 4]>,
    /// Mesh element that contains the sample; `u32::MAX` for none.
    pub element: Vec<u32>,
    /// Label index.
    pub label: Vec<u8>,
    /// Echo amplitude; after `tone`, grey level.
    pub amplitude: Vec<f64>,
    /// Fraction of the scan plane's thickness filled by needle and seeds.
    pub needle: Vec<f64>,
    /// Fraction of the beam blocked by needle and seeds.
    pub shade: Vec<f64>,
    /// Two-way loss, in units of [`crate::effects::buffers::UNITS_PER_DB`].
    pub loss: Vec<u32>,
}

impl Beam {
    /// Copies the central plane out of a CPU store, with positions as in the passes: relative to the local origin.
    pub(crate) fn of_store<T: Real>(store: &Store<T>, tables: &Tables) -> Self {
        let count = tables.lines() * tables.samples();
        let wide = |values: &[T]| values.iter().take(count).map(|x| x.wide()).collect();
        Self {
            lines: tables.lines(),
            samples: tables.samples(),
            position: store.position.iter().take(count).map(|p| p.map(Real::wide)).collect(),
            element: numbered(
                store.slab.as_ref().map_or(&[], |slab| &slab.deformed.elements),
                store.element.iter().take(count).copied().collect(),
            ),
            label: store.label.iter().take(count).copied().collect(),
            amplitude: wide(&store.amplitude),
            needle: store.needle_mask.iter().map(|mask| mask[0].wide()).collect(),
            shade: store.needle_mask.iter().map(|mask| mask[1].wide()).collect(),
            loss: store.loss.clone(),
        }
    }
}

/// Replaces slots by the numbers of their elements.
pub fn numbered(elements: &[u32], mut slots: Vec<u32>) -> Vec<u32> {
    for slot in &mut slots {
        *slot = elements.get(*slot as usize).copied().unwrap_or(u32::MAX);
    }
    slots
}

/// Ground-truth layer at the pixels of a frame, for training models: 16 bits a pixel, at the nearest sample, 0 outside
/// the sector.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Layer {
    /// Label value of the volume: 0 outside the sector and where nothing is labelled; in a completed body 201 fat, 202
    /// soft tissue, 204 skin and 205 muscle, or other free values
    LabelValue,
    /// Index of the label in the table of labels, from 0: also valid if values do not fit 16 bits
    LabelIndex,
    /// 1 inside the image sector, 0 outside
    Sector,
    /// 1 where the body is continued beyond the volume, whose labels are invented there
    Beyond,
    /// Length of the tissue's displacement, hundredths of a millimetre
    Displacement,
    /// Tissue passed along the beam down to the pixel (samples that are not background), tenths of a millimetre
    Depth,
    /// Fraction of the scan plane's thickness filled by the needle, 0 to 255
    Needle,
    /// Two-way loss down to the pixel, hundredths of a decibel
    Loss,
    /// Label value of the file before anything was drawn: that of the organ for its vessels and other structures, 0
    /// where the body was completed
    Organ,
}

impl Layer {
    /// Every layer.
    pub const ALL: [Self; 9] = [
        Self::LabelValue,
        Self::LabelIndex,
        Self::Sector,
        Self::Beyond,
        Self::Displacement,
        Self::Depth,
        Self::Needle,
        Self::Loss,
        Self::Organ,
    ];

    /// Name used in file names.
    pub fn name(self) -> &'static str {
        match self {
            Self::LabelValue => "label-value",
            Self::LabelIndex => "label-index",
            Self::Sector => "sector",
            Self::Beyond => "beyond",
            Self::Displacement => "displacement",
            Self::Depth => "depth",
            Self::Needle => "needle",
            Self::Loss => "loss",
            Self::Organ => "organ",
        }
    }

    /// First label whose value does not fit the 16 bits of [`Layer::LabelValue`] and [`Layer::Organ`].
    pub fn unfit(labels: &[Label]) -> Option<&Label> {
        labels.iter().find(|label| u16::try_from(label.value).is_err())
    }
}

/// World position of a sample of the central plane, before any warp.
pub fn world_position(tables: &Tables, probe_to_world: &Matrix4<f64>, line: usize, sample: usize) -> Point3<f64> {
    let [ox, oy, dx, dy] = tables.rays[line];
    let s = tables.grid.sample_depth_mm(sample);
    probe_to_world.transform_point(&Point3::new(ox + dx * s, oy + dy * s, 0.0))
}
