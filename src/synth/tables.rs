//! Data that are constant until a scene is edited: geometry, kernels, tissue rows. Computed once in double precision,
//! read by both backends, and recomputed part by part when a setting changes.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

use bytemuck::{Pod, Zeroable};

use super::SynthError;
use super::local_origin::LocalOrigin;
use crate::effects::lateral::{LateralKernel, MAX_REACH};
use crate::effects::needle::MAX_SEGMENTS;
use crate::effects::pass::Resource;
use crate::effects::point_spread::PointSpread;
use crate::effects::refraction;
use crate::effects::shadow::aperture::{self, RAYS};
use crate::effects::shadow::units;
use crate::effects::speckle::SpeckleTables;
use crate::effects::tone::SOFT_TISSUE_DB_CM_MHZ;
use crate::effects::tone::auto_gain::BANDS;
use crate::effects::{Effects, texture};
use crate::mechanics::mesh::TetMesh;
use crate::mechanics::mesh::pack::WarpCapacities;
use crate::memory;
use crate::real::Numbers;
use crate::tissue::TissueTable;
use crate::tracking::probe::{BeamGrid, ImageGrid, OUTSIDE, Probe, scan_map};
use crate::volume::LabelVolume;
use crate::volume::texture::{Atlas, SolidTexture};

/// Imaged anatomy in the world: fixed for the life of a synthesizer.
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
    /// Whether frames may contain a needle or seeds; without it neither is shown.
    pub has_needle: bool,
}

impl Settings {
    /// Two-way attenuation of average soft tissue, dB/cm; 0 if no attenuation is simulated.
    fn average_attenuation_db_cm(&self) -> f64 {
        let shadow = &self.effects.shadow;
        if shadow.as_ref().is_some_and(|shadow| shadow.attenuation) {
            2.0 * SOFT_TISSUE_DB_CM_MHZ * self.probe.frequency_mhz
        } else {
            0.0
        }
    }
}

/// Imaging properties of one label.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct LabelRow {
    /// Mean echo amplitude.
    pub echo: f32,
    /// Acoustic impedance, MRayl.
    pub impedance: f32,
    /// Two-way loss over one sample, in units of [`crate::effects::shadow::UNITS_PER_DB`].
    pub loss: u32,
    /// Index of its texture in the atlas plus one; 0 for none.
    pub texture: u32,
    /// Reflection coefficient of its capsule.
    pub capsule: f32,
    /// Phase over one sample, in the units of [`crate::effects::refraction`].
    pub phase: u32,
}

impl LabelRow {
    /// Amplitude reflection coefficient of the surface between two labels at perpendicular incidence: that of their impedances, or of a
    /// capsule if it is larger.
    pub fn reflection(&self, other: &Self) -> f64 {
        let [a, b] = [self, other].map(|row| f64::from(row.impedance));
        let step = if a + b > 0.0 { (a - b).abs() / (a + b) } else { 0.0 };
        step.max(f64::from((self.capsule - other.capsule).abs()))
    }
}

/// All data derived from an [`Anatomy`] and [`Settings`]. Passes use positions relative to the local origin, and never the anatomy
/// itself, which is in the world.
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
    /// Solid textures of the tissues.
    pub atlas: Option<Atlas>,
    /// Lattice and kernels of the speckle.
    pub speckle: Option<SpeckleTables>,
    /// Kernel of the beam used for shadows.
    pub penumbra: Option<LateralKernel>,
    /// Scanlines between a point and the elements of the aperture that receive from it; empty if shadows do not
    /// widen.
    pub aperture: Vec<u32>,
    /// Ranges of samples on which the aperture shifts are constant.
    pub aperture_runs: Vec<Range<usize>>,
    /// Kernel of the radial blur.
    pub blur: Option<LateralKernel>,
    /// Power of acoustic clutter and ring-down at each sample; empty without a receiver.
    pub clutter: Vec<f32>,
    /// Linear gain at each sample depth.
    pub gain: Numbers,
    /// Sizes of the buffers of the warp, if a mesh deforms.
    pub warp: Option<WarpCapacities>,
}

impl Tables {
    /// Derives all tables.
    pub fn new(anatomy: Anatomy, settings: Settings) -> Result<Self, SynthError> {
        settings.effects.validate()?;
        let grid = BeamGrid::new(&settings.probe)?;
        let image_grid = image_grid(&grid, &settings.image)?;
        check_memory(&grid, &settings)?;
        let origin = LocalOrigin::of(&anatomy.volume);
        let mut tables = Self {
            origin,
            volume: origin.volume(&anatomy.volume)?,
            mesh: anatomy.mesh.as_ref().map(|mesh| origin.mesh(mesh)),
            scan_map: clamped_scan_map(&grid, &image_grid),
            rays: rays(&grid),
            label_rows: Vec::new(),
            atlas: None,
            speckle: settings
                .effects
                .speckle
                .as_ref()
                .map(|speckle| SpeckleTables::new(PointSpread::new(speckle, &settings.probe), &grid)),
            penumbra: settings.effects.shadow.as_ref().map(|shadow| shadow.kernel(&grid)),
            aperture: settings
                .effects
                .shadow
                .as_ref()
                .map_or(Vec::new(), |shadow| shadow.shifts(&grid)),
            aperture_runs: Vec::new(),
            blur: settings
                .effects
                .blur
                .as_ref()
                .map(|blur| blur.kernel(&grid, settings.probe.frequency_mhz)),
            clutter: Vec::new(),
            gain: Numbers::default(),
            warp: anatomy.mesh.as_ref().map(|mesh| WarpCapacities::of(mesh)),
            grid,
            image_grid,
            anatomy,
            settings,
        };
        tables.clutter = tables.clutter();
        tables.gain = tables.gain_table();
        tables.atlas = texture::atlas(&tables.anatomy, &tables.settings)?;
        tables.label_rows = tables.rows();
        tables.aperture_runs = aperture::runs(&tables.aperture, tables.samples());
        Ok(tables)
    }

    /// Changes the settings and returns the resources whose contents changed. Nothing else is recomputed; on an error the
    /// tables are unchanged.
    pub fn set(&mut self, settings: Settings) -> Result<Vec<Resource>, SynthError> {
        settings.effects.validate()?;
        let (old, new) = (&self.settings, &settings);
        let probe = old.probe != new.probe;
        let grid = if probe {
            BeamGrid::new(&new.probe)?
        } else {
            self.grid.clone()
        };
        let image_grid = image_grid(&grid, &new.image)?;
        check_memory(&grid, new)?;
        let speckle = probe || old.effects.speckle != new.effects.speckle;
        let blur = probe || old.effects.blur != new.effects.blur;
        let shadow = probe || old.effects.shadow != new.effects.shadow;
        let attenuation = old.average_attenuation_db_cm() != new.average_attenuation_db_cm();
        let clutter = attenuation || speckle || old.seed != new.seed || old.effects.receiver != new.effects.receiver;
        let noise_db = |settings: &Settings| settings.effects.receiver.as_ref().map(|receiver| receiver.noise_db);
        let gain = probe || attenuation || old.effects.tone != new.effects.tone || noise_db(old) != noise_db(new);
        let refraction = old.effects.refraction != new.effects.refraction;
        let texture = old.effects.texture != new.effects.texture || old.seed != new.seed;
        let atlas = if texture {
            texture::atlas(&self.anatomy, new)?
        } else {
            None
        };
        let mut changed = Vec::new();
        let remap = probe || image_grid != self.image_grid;

        self.settings = settings;
        self.grid = grid;
        self.image_grid = image_grid;
        if remap {
            self.scan_map = clamped_scan_map(&self.grid, &self.image_grid);
            changed.push(Resource::ScanMap);
        }
        if probe {
            self.rays = rays(&self.grid);
            changed.push(Resource::Rays);
        }
        if speckle {
            self.speckle = self
                .settings
                .effects
                .speckle
                .as_ref()
                .map(|speckle| SpeckleTables::new(PointSpread::new(speckle, &self.settings.probe), &self.grid));
            changed.extend([Resource::AxialKernel, Resource::LateralKernel]);
        }
        if blur {
            let (own, mhz) = (&self.settings.effects.blur, self.settings.probe.frequency_mhz);
            self.blur = own.as_ref().map(|blur| blur.kernel(&self.grid, mhz));
            changed.push(Resource::BlurKernel);
        }
        if shadow {
            let own = &self.settings.effects.shadow;
            self.penumbra = own.as_ref().map(|own| own.kernel(&self.grid));
            self.aperture = own.as_ref().map_or(Vec::new(), |own| own.shifts(&self.grid));
            self.aperture_runs = aperture::runs(&self.aperture, self.samples());
            changed.extend([Resource::PenumbraKernel, Resource::ApertureShifts]);
        }
        if clutter {
            self.clutter = self.clutter();
            changed.push(Resource::Clutter);
        }
        if gain {
            self.gain = self.gain_table();
            changed.push(Resource::Gain);
        }
        if texture {
            self.atlas = atlas;
            changed.extend([Resource::TextureAtlas, Resource::TextureEntries]);
        }
        if texture || shadow || refraction {
            self.label_rows = self.rows();
            changed.push(Resource::LabelRows);
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

    /// Number of elevational sub-planes.
    pub fn planes(&self) -> usize {
        self.settings
            .effects
            .thickness
            .as_ref()
            .map_or(1, |thickness| thickness.planes as usize)
    }

    /// Distance between sub-planes, mm.
    pub fn plane_mm(&self) -> f64 {
        self.settings
            .effects
            .thickness
            .as_ref()
            .map_or(0.0, |thickness| thickness.plane_mm())
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

    /// Size of a resource on the GPU, bytes.
    pub fn bytes(&self, resource: Resource) -> u64 {
        let beam = (self.lines() * self.samples()) as u64;
        let pixels = (self.width() * self.height()) as u64;
        let fine = self
            .speckle
            .as_ref()
            .map_or(0, |speckle| speckle.fine_lines(self.lines()) * self.samples()) as u64;
        let depth_kernel = |reach: usize| ((2 * reach + 1) * self.samples() * 4) as u64;
        match resource {
            Resource::Rays => self.lines() as u64 * 16,
            Resource::Gaps => (self.lines() * self.planes()) as u64 * 4,
            Resource::Position => beam * self.planes() as u64 * 16,
            Resource::Element | Resource::Label | Resource::Amplitude => beam * self.planes() as u64 * 4,
            Resource::ElementMaps => self.warp_items(|warp| warp.frames) * 16,
            Resource::Adjacency => self.warp_items(|warp| warp.neighbours) * 16,
            Resource::CellStarts => self.warp_items(|warp| warp.starts) * 4,
            Resource::CellElements => self.warp_items(|warp| warp.lists) * 4,
            Resource::Voxels => self.volume.voxels().len().div_ceil(4) as u64 * 4,
            Resource::LabelRows => size_of_val(self.label_rows.as_slice()) as u64,
            Resource::TextureEntries => {
                self.atlas
                    .as_ref()
                    .map_or(0, |atlas| size_of_val(atlas.entries.as_slice())) as u64
            }
            Resource::TextureAtlas => self
                .atlas
                .as_ref()
                .map_or(0, |atlas| size_of_val(atlas.data.as_slice())) as u64,
            Resource::AmplitudeNext | Resource::Loss | Resource::Clutter => beam * 4,
            Resource::ApertureShifts => size_of_val(self.aperture.as_slice()) as u64,
            Resource::Reflectors => self.lines() as u64 * 4,
            Resource::Through => beam * 4 * RAYS as u64,
            Resource::NeedleMask | Resource::Specular => beam * 8,
            Resource::Scatter | Resource::ScatterAxial => fine * 8,
            Resource::AxialKernel => self
                .speckle
                .as_ref()
                .map_or(0, |speckle| (speckle.axial.of::<f32>().len() + 2 * self.samples()) * 4)
                as u64,
            Resource::LateralKernel => self.speckle.as_ref().map_or(0, |speckle| {
                depth_kernel(speckle.lateral.reach) + 4 * speckle.edges.of::<f32>().len() as u64
            }),
            Resource::PenumbraKernel => self.penumbra.as_ref().map_or(0, |kernel| depth_kernel(kernel.reach)),
            Resource::BlurKernel => self.blur.as_ref().map_or(0, |kernel| depth_kernel(kernel.reach)),
            Resource::Gain => self.samples() as u64 * 4,
            Resource::AutoGain => 4 * BANDS as u64,
            Resource::Needle => (MAX_SEGMENTS * size_of::<[[f32; 4]; 3]>()) as u64,
            Resource::ScanMap => pixels * 8,
            Resource::Image => pixels * 4,
            Resource::Pixels => (self.words_per_row() * self.height() * 4) as u64,
        }
    }

    /// Deviations of the output from the settings, for the user.
    pub fn warnings(&self) -> Vec<String> {
        let narrowed = |key: &str, share: f64, finer: &str| {
            (share < 0.99).then(|| {
                format!(
                    "{key} comes out at {:.0} % of what is asked where the grid is finest: a kernel reaches {MAX_REACH} \
                     {finer} to each side; fewer of them in the probe reach further",
                    100.0 * share
                )
            })
        };
        let speckle = self.speckle.as_ref();
        [
            speckle.and_then(|speckle| narrowed("effects.speckle.axial_mm", speckle.axial_share, "samples")),
            speckle
                .and_then(|speckle| narrowed("effects.speckle.lateral_mm", speckle.lateral.least_share, "scanlines")),
            self.blur
                .as_ref()
                .and_then(|blur| narrowed("effects.blur.width_mm", blur.least_share, "scanlines")),
        ]
        .into_iter()
        .flatten()
        .collect()
    }

    fn warp_items(&self, pick: fn(&WarpCapacities) -> usize) -> u64 {
        self.warp.as_ref().map_or(0, pick) as u64
    }

    fn clutter(&self) -> Vec<f32> {
        let effects = &self.settings.effects;
        effects.receiver.as_ref().map_or_else(Vec::new, |receiver| {
            receiver.clutter(&self.settings, &self.grid, self.settings.average_attenuation_db_cm())
        })
    }

    fn gain_table(&self) -> Numbers {
        let effects = &self.settings.effects;
        let matched = self.settings.average_attenuation_db_cm();
        let noise_db = effects.receiver.as_ref().map(|receiver| receiver.noise_db);
        let gain = |sample: usize| match &effects.tone {
            Some(tone) => 10f64.powf(tone.gain_at_db(self.grid.sample_depth_mm(sample), matched, noise_db) / 20.0),
            None => 1.0,
        };
        Numbers::new((0..self.samples()).map(gain).collect())
    }

    fn rows(&self) -> Vec<LabelRow> {
        let effects = &self.settings.effects;
        let row = |label: usize| {
            let tissue = self.anatomy.tissues.of(label as u8);
            let db = effects.shadow.as_ref().map_or(0.0, |shadow| {
                shadow.db_per_mm(tissue, self.settings.probe.frequency_mhz) * self.sample_mm()
            });
            LabelRow {
                echo: 10f64.powf(tissue.echogenicity_db / 20.0) as f32,
                impedance: tissue.impedance_mrayl as f32,
                loss: units(db),
                texture: if self.atlas.is_some() {
                    texture::entry_of(&self.anatomy, label as u8)
                } else {
                    0
                },
                capsule: tissue.capsule as f32,
                phase: refraction::units(tissue.impedance_mrayl, self),
            }
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

/// Refuses a frame that does not fit into memory, before any allocation: map, grey levels and bytes of its pixels, the copy
/// that is returned, a position, an amplitude and a label per sample, the clutter during its computation, and the rays of the
/// aperture.
fn check_memory(grid: &BeamGrid, settings: &Settings) -> Result<(), SynthError> {
    let (ImageSize { width, height, .. }, effects) = (settings.image, &settings.effects);
    let planes = effects
        .thickness
        .as_ref()
        .map_or(1, |thickness| u64::from(thickness.planes));
    let samples = (grid.lines() * grid.samples()) as u64;
    let clutter = if effects.receiver.is_some() { 20 * samples } else { 0 };
    let opens = effects.shadow.as_ref().is_some_and(|shadow| shadow.f_number > 0.0);
    let aperture = if opens { 4 * RAYS as u64 * samples } else { 0 };
    let what = format!(
        "a frame of {width} x {height} pixels from {} x {} samples",
        grid.lines(),
        grid.samples()
    );
    Ok(memory::check(
        14 * (width * height) as u64 + 21 * samples * planes + clutter + aperture,
        &what,
    )?)
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
    for at in map.iter_mut().filter(|at| **at != OUTSIDE) {
        *at = [at[0].clamp(0.0, last[0]), at[1].clamp(0.0, last[1])];
    }
    map
}
