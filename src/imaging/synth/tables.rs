//! Data that are constant until a scene is edited: geometry, kernels, tissue rows. Computed once in double precision,
//! read by both backends, and recomputed part by part when a setting changes.

use std::collections::BTreeMap;
use std::sync::Arc;

use bytemuck::{Pod, Zeroable};

use super::SynthError;
use super::layers::Layer;
use super::local_origin::LocalOrigin;
use crate::effects::buffers::{Buffer, LABEL_ROWS, RAYS, SCAN_MAP};
use crate::effects::{EffectTables, Effects, REGISTRY};
use insonify_anatomy::acoustics::{TissueError, TissueTable};
use insonify_anatomy::volume::LabelVolume;
use insonify_anatomy::volume::texture::SolidTexture;
use insonify_base::memory;
use insonify_mesh::TetMesh;
use insonify_tracking::probe::{BeamGrid, ImageGrid, OUTSIDE, Probe, scan_map};

/// Contents of frames: labelled voxels, the tissue of each label, textures, and a mesh that moves them; all in the
/// world (LPS, mm). Fixed for the life of a synthesizer, but for the tissues ([`FrameSettings`]).
#[derive(Clone, Debug)]
pub struct Anatomy {
    /// Labelled volume, with unlabelled tissue completed.
    pub volume: Arc<LabelVolume>,
    /// Tissues of its labels.
    pub tissues: Arc<TissueTable>,
    /// Solid textures by name, besides those of the built-in bank, which they override.
    pub textures: BTreeMap<String, Arc<SolidTexture>>,
    /// Mesh whose deformation moves the tissue, if any.
    pub mesh: Option<Arc<TetMesh>>,
}

/// Pixels of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImageSize {
    /// Columns (1 to 16384).
    pub width: usize,
    /// Rows (1 to 16384).
    pub height: usize,
    /// Fraction of the image left free around the sector (0 to 0.45).
    pub margin: f64,
    /// Grey level outside the sector.
    pub fill: u8,
    /// Placement of the pixels of an image of this width and height; if `None` or of another size, the sector is
    /// fitted to the image.
    pub placed: Option<ImageGrid>,
}

/// Settings that can be changed between frames without recreating the synthesizer.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Seed of all random numbers.
    pub seed: u64,
    /// Transducer.
    pub probe: Probe,
    /// Pixels of the frame.
    pub image: ImageSize,
    /// Effects and their parameters.
    pub effects: Effects,
    /// Whether memory and passes for needle and seeds are made at once. Otherwise the first frame with one has them
    /// made and sets this.
    pub has_needle: bool,
    /// Ground-truth layers of each frame ([`super::Frame::layers`]), each once.
    pub layers: Vec<Layer>,
}

impl Settings {
    /// Settings for frames of a width and height (pixels): seed 0, no margin, no needle, no layers.
    pub fn new(probe: Probe, [width, height]: [usize; 2], effects: Effects) -> Self {
        Self {
            seed: 0,
            probe,
            image: ImageSize {
                width,
                height,
                margin: 0.0,
                fill: 0,
                placed: None,
            },
            effects,
            has_needle: false,
            layers: Vec::new(),
        }
    }

    /// Pixels of the frame in the plane of the probe.
    ///
    /// # Errors
    /// [`SynthError`] for a probe or a frame that cannot be.
    pub fn image_grid(&self) -> Result<ImageGrid, SynthError> {
        image_grid(&BeamGrid::new(&self.probe)?, &self.image)
    }
}

/// Settings of a single frame, and its tissues.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameSettings {
    /// Imaging settings.
    pub settings: Settings,
    /// Tissues of the anatomy's labels.
    pub tissues: Arc<TissueTable>,
    /// Suspicious settings, for the user.
    pub warnings: Vec<String>,
}

/// Imaging properties of one label.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct LabelRow {
    /// Mean echo amplitude.
    pub echo: f32,
    /// Acoustic impedance, MRayl.
    pub impedance: f32,
    /// Two-way loss over one sample, in units of [`crate::effects::buffers::UNITS_PER_DB`].
    pub loss: u32,
    /// What of it grows with frequency.
    pub attenuation: u32,
    /// Index of its texture in the atlas plus one; 0 for none.
    pub texture: u32,
    /// Reflection coefficient of its capsule.
    pub capsule: f32,
    /// Phase over one sample, in units that depend on the beam.
    pub phase: u32,
}

impl LabelRow {
    /// Amplitude reflection coefficient of the surface between two labels at perpendicular incidence: that of their
    /// impedances, or of a capsule if it is larger.
    pub(crate) fn reflection(&self, other: &Self) -> f64 {
        let [a, b] = [self, other].map(|row| f64::from(row.impedance));
        let step = if a + b > 0.0 { (a - b).abs() / (a + b) } else { 0.0 };
        step.max(f64::from((self.capsule - other.capsule).abs()))
    }
}

/// All data derived from an [`Anatomy`] and [`Settings`]. Passes use positions relative to the local origin, and never
/// the anatomy itself, which is in the world.
#[derive(Clone, Debug)]
pub struct Tables {
    /// Imaged anatomy in the world.
    pub anatomy: Anatomy,
    /// Local origin of the passes.
    pub origin: LocalOrigin,
    /// Settings from which the tables were derived.
    pub settings: Settings,
    /// Volume of the anatomy, relative to the local origin.
    pub volume: Arc<LabelVolume>,
    /// Mesh of the anatomy, relative to the local origin.
    pub mesh: Option<Arc<TetMesh>>,
    /// Grid of scanlines and samples.
    pub grid: BeamGrid,
    /// Grid of pixels in the probe's plane.
    pub image_grid: ImageGrid,
    /// Origin and direction of each scanline in the probe's plane, mm.
    pub rays: Vec<[f64; 4]>,
    /// Scanline and sample coordinates of each pixel; negative outside the sector.
    pub scan_map: Vec<[f32; 2]>,
    /// One row per label index.
    pub label_rows: Vec<LabelRow>,
    /// Tables of the effects.
    pub effects: EffectTables,
}

impl Tables {
    /// Derives all tables.
    pub fn new(anatomy: Anatomy, settings: Settings) -> Result<Self, SynthError> {
        settings.effects.validate()?;
        check_tissues(&anatomy.tissues, &anatomy)?;
        let grid = BeamGrid::new(&settings.probe)?;
        let image_grid = image_grid(&grid, &settings.image)?;
        check_memory(&grid, &settings, 0)?;
        let origin = LocalOrigin::of(&anatomy.volume);
        let mut tables = Self {
            origin,
            volume: origin.volume(&anatomy.volume)?,
            mesh: anatomy.mesh.as_ref().map(|mesh| origin.mesh(mesh)),
            scan_map: clamped_scan_map(&grid, &image_grid),
            rays: rays(&grid),
            label_rows: Vec::new(),
            effects: EffectTables::new(&anatomy, &settings, &grid)?,
            grid,
            image_grid,
            anatomy,
            settings,
        };
        tables.label_rows = tables.rows();
        Ok(tables)
    }

    /// Changes the settings and returns the buffers whose contents changed. Nothing else is recomputed; on an error the
    /// tables are unchanged.
    pub fn set(&mut self, settings: Settings) -> Result<Vec<&'static Buffer>, SynthError> {
        let tissues = Arc::clone(&self.anatomy.tissues);
        self.set_with_tissues(settings, &tissues)
    }

    /// Changes settings and tissues as [`Tables::set`] does.
    pub(crate) fn set_with_tissues(
        &mut self,
        settings: Settings,
        tissues: &Arc<TissueTable>,
    ) -> Result<Vec<&'static Buffer>, SynthError> {
        // What can fail, before anything is changed.
        settings.effects.validate()?;
        let grid = BeamGrid::new(&settings.probe)?;
        let regrid = grid != self.grid;
        let image_grid = image_grid(&grid, &settings.image)?;
        check_memory(&grid, &settings, frame_bytes(&self.grid, &self.settings))?;
        let retissue = !Arc::ptr_eq(tissues, &self.anatomy.tissues);
        if retissue {
            check_tissues(tissues, &self.anatomy)?;
        }
        let retissued = retissue.then(|| Anatomy {
            tissues: Arc::clone(tissues),
            ..self.anatomy.clone()
        });
        let anatomy = retissued.as_ref().unwrap_or(&self.anatomy);
        let derived = self
            .effects
            .set((&self.anatomy, &self.settings, &self.grid), (anatomy, &settings, &grid))?;
        if let Some(anatomy) = retissued {
            self.anatomy = anatomy;
        }
        let remap = regrid || image_grid != self.image_grid;
        self.settings = settings;
        self.grid = grid;
        self.image_grid = image_grid;
        let mut changed = Vec::new();
        if remap {
            self.scan_map = clamped_scan_map(&self.grid, &self.image_grid);
            changed.push(&SCAN_MAP);
        }
        if regrid {
            self.rays = rays(&self.grid);
            changed.push(&RAYS);
        }
        let mut relabel = false;
        for effect in derived {
            changed.extend(effect.buffers.iter().filter(|buffer| buffer.contents.is_some()));
            relabel |= effect.label_row.is_some();
        }
        if relabel || retissue {
            self.label_rows = self.rows();
            changed.push(&LABEL_ROWS);
        }
        Ok(changed)
    }

    /// Number of scanlines.
    pub fn lines(&self) -> usize {
        self.grid.lines()
    }

    /// Number of samples along a scanline.
    pub fn samples(&self) -> usize {
        self.grid.samples()
    }

    /// Distance between samples, mm.
    pub fn sample_mm(&self) -> f64 {
        self.grid.sample_spacing_mm()
    }

    /// Number of pixels in a row.
    pub fn width(&self) -> usize {
        self.image_grid.width()
    }

    /// Number of rows of pixels.
    pub fn height(&self) -> usize {
        self.image_grid.height()
    }

    /// Number of words of four pixels in a row on the GPU: rows are padded to 256 bytes, as required by copies to
    /// textures.
    pub fn words_per_row(&self) -> usize {
        self.width().div_ceil(256) * 64
    }

    fn rows(&self) -> Vec<LabelRow> {
        let row = |label: usize| {
            let tissue = self.anatomy.tissues.tissue(label as u8);
            let mut row = LabelRow {
                echo: 10f64.powf(tissue.echogenicity_db / 20.0) as f32,
                impedance: tissue.impedance_mrayl as f32,
                capsule: tissue.capsule as f32,
                ..LabelRow::default()
            };
            for write in REGISTRY.iter().filter_map(|effect| effect.label_row) {
                write(&self.anatomy, &self.effects, label, &mut row);
            }
            row
        };
        (0..self.volume.labels().len()).map(row).collect()
    }
}

fn image_grid(grid: &BeamGrid, image: &ImageSize) -> Result<ImageGrid, SynthError> {
    match image.placed {
        Some(placed) if [placed.width(), placed.height()] == [image.width, image.height] => Ok(placed),
        _ => Ok(ImageGrid::fit(grid, image.width, image.height, image.margin)?),
    }
}

/// Memory of a frame, bytes: map, grey levels and bytes of its pixels, the copy that is returned, a position, an
/// amplitude and a label per sample, and what effects need besides their buffers.
fn frame_bytes(grid: &BeamGrid, settings: &Settings) -> u64 {
    let samples = (grid.lines() * grid.samples()) as u64;
    let effects: u64 = REGISTRY
        .iter()
        .map(|effect| (effect.extra_bytes)(settings, samples))
        .sum();
    14 * (settings.image.width * settings.image.height) as u64 + 21 * samples + effects
}

fn check_tissues(tissues: &TissueTable, anatomy: &Anatomy) -> Result<(), TissueError> {
    tissues.check(
        anatomy.volume.labels().len(),
        anatomy.textures.keys().map(String::as_str),
    )
}

/// Refuses a frame that does not fit into memory, before any allocation; one of no more than `taken` bytes is there.
fn check_memory(grid: &BeamGrid, settings: &Settings, taken: u64) -> Result<(), SynthError> {
    let needed = frame_bytes(grid, settings);
    // Asking the system takes longer than setting most parameters of a frame.
    if needed <= taken {
        return Ok(());
    }
    let ImageSize { width, height, .. } = settings.image;
    let what = format!(
        "a frame of {width} x {height} pixels from {} x {} samples",
        grid.lines(),
        grid.samples()
    );
    Ok(memory::check(needed, &what)?)
}

fn rays(grid: &BeamGrid) -> Vec<[f64; 4]> {
    grid.rays()
        .iter()
        .map(|ray| [ray.origin[0], ray.origin[1], ray.direction[0], ray.direction[1]])
        .collect()
}

/// Scan map with coordinates inside the sector clamped to the grid, so that the first and last half sample repeat.
fn clamped_scan_map(grid: &BeamGrid, image: &ImageGrid) -> Vec<[f32; 2]> {
    let mut map = scan_map(grid, image, 0..image.height());
    let last = [grid.lines() as f32 - 1.0, grid.samples() as f32 - 1.0];
    for position in map.iter_mut().filter(|position| **position != OUTSIDE) {
        *position = [position[0].clamp(0.0, last[0]), position[1].clamp(0.0, last[1])];
    }
    map
}
