//! Point scatterers of an anatomy: hashed into its reference state, moved with its mesh, seen by a probe.

use std::f64::consts::{PI, TAU};

use nalgebra::{Matrix4, Point3};

use super::Acquisition;
use super::device::Device;
use super::echoes::{Pulse, Scatterer, echoes};
use crate::effects::point_spread::PointSpread;
use crate::effects::shadow::downshift::Downshift;
use crate::effects::shadow::{Attenuation, Shadow};
use crate::effects::texture;
use crate::synth::tables::{Anatomy, Settings};
use crate::synth::{Backend, FrameState, SynthError};
use insonify_base::blame::Blame;
use insonify_base::matrix::{inverse_rigid, rigid};
use insonify_base::memory;
use insonify_base::parallel::{self, chunks_mut, for_each};
use insonify_base::random::{hash3, seed_words, unit};
use insonify_gpu::adapter::{self, hardware};
use insonify_gpu::{AdapterChoice, Gpu, Needs};
use insonify_mesh::locator::{Locator, NO_ELEMENT};
use insonify_tracking::probe::BeamGrid;

/// Full width at half maximum of a Gaussian in standard deviations.
const FWHM: f64 = 2.354_820_045;
/// Reach of the elevational profile, standard deviations.
const REACH: f64 = 3.0;
/// Least margin of the region in which scatterers are kept beyond the motion so far, mm.
const MARGIN_MM: f64 = 2.0;
/// Interval of the losses along a line, mm.
const LOSS_MM: f64 = 0.5;
/// Bytes of a sample of a frame: of both precisions, with noise, and written.
const BYTES_A_SAMPLE: usize = 24;
/// Streams of random numbers beside that of positions.
const AMPLITUDES: u64 = 0x5ca7;
const NOISE: u64 = 0x201e;

/// A scatterer in the reference state.
#[derive(Clone, Copy)]
struct Point {
    at: [f64; 3],
    amplitude: f32,
    element: u32,
}

/// Region around the image for which scatterers were made.
struct Region {
    probe_to_world: Matrix4<f64>,
    margin_mm: f64,
}

/// Backend that sums the echoes.
enum Means {
    /// The CPU in single precision.
    Single,
    /// The CPU in double precision.
    Double,
    Gpu(Box<Device>),
}

/// Synthesises the echoes of an anatomy frame by frame.
pub struct RfSynthesizer {
    anatomy: Anatomy,
    settings: Settings,
    acquisition: Acquisition,
    grid: BeamGrid,
    spread: PointSpread,
    pulse: Pulse,
    atlas: texture::Derived,
    /// Entry of each label in the atlas, from 1; 0 for none.
    entries: Vec<u32>,
    /// From the reference to the current state.
    locator: Option<Locator<f64>>,
    reference: Vec<[f64; 3]>,
    current: Vec<[f64; 3]>,
    region: Option<Region>,
    points: Vec<Point>,
    samples: usize,
    means: Means,
}

impl RfSynthesizer {
    /// Prepares the synthesis: beam widths and focus are those of `effects.speckle`, losses those of `effects.shadow`,
    /// textures those of `effects.texture`; other effects do not act on echoes.
    ///
    /// # Errors
    /// [`SynthError`] for a probe or an acquisition out of range.
    pub fn new(anatomy: Anatomy, settings: Settings, acquisition: Acquisition) -> Result<Self, SynthError> {
        acquisition.validate()?;
        let grid = BeamGrid::new(&settings.probe).map_err(SynthError::from)?;
        if grid.has_overlap() {
            let kind = settings.probe.shape.kind();
            let text = format!(
                "echoes of a {kind} probe, whose scanlines overlap, are not synthesised; expected another kind"
            );
            return Err(insonify_tracking::TrackingError::at("kind", text).into());
        }
        let speckle = settings.effects.speckle.clone().unwrap_or_default();
        let atlas = match settings.effects.texture {
            Some(_) => texture::derive(&anatomy, &texture::key(&anatomy.tissues, &settings, &grid))?,
            None => None,
        };
        let nodes = anatomy.mesh.as_ref().map_or(Vec::new(), |mesh| mesh.nodes().to_vec());
        let labels = anatomy.volume.labels().len();
        // The acquisition sets the sampling of echoes, not the probe's number of samples.
        let samples = (grid.depth_mm() / acquisition.sample_mm()).round() as usize;
        let what = format!("echoes of {} lines x {samples} samples", grid.lines());
        memory::check((BYTES_A_SAMPLE * grid.lines() * samples) as u64, &what)?;
        Ok(Self {
            entries: (0..labels)
                .map(|label| texture::entry_of(&anatomy, label as u8))
                .collect(),
            spread: PointSpread::new(&speckle, &settings.probe, Attenuation::of(&anatomy.tissues, &settings)),
            pulse: Pulse::new(&acquisition, lowest_centre(&anatomy, &settings, &acquisition)),
            locator: anatomy.mesh.as_ref().map(|mesh| Locator::new(mesh)),
            reference: nodes.clone(),
            current: nodes,
            samples,
            region: None,
            points: Vec::new(),
            means: Means::Single,
            atlas,
            anatomy,
            settings,
            acquisition,
            grid,
        })
    }

    /// Adds up echoes on a backend; without this, on the CPU in single precision. Scatterers are carried and noise is
    /// added on the CPU.
    ///
    /// # Errors
    /// [`SynthError`] where the GPU cannot be opened, or the echoes exceed its limits.
    pub fn on(mut self, backend: Backend) -> Result<Self, SynthError> {
        let open = |choice: &AdapterChoice| Gpu::open(choice, &Needs::default());
        let gpu = match backend {
            Backend::Cpu => None,
            Backend::CpuF64 => {
                self.means = Means::Double;
                return Ok(self);
            }
            Backend::Auto if hardware(&adapter::list()).is_err() => None,
            Backend::Auto => match open(&AdapterChoice::default()) {
                Err(error) if error.is_machine() => None,
                opened => Some(opened?),
            },
            Backend::Adapter(choice) => Some(open(&choice)?),
            Backend::Host(lent) => {
                let (device, queue) = *lent;
                Some(Gpu::from_host(device, queue, &Needs::default())?)
            }
            Backend::Gpu(gpu) => Some(*gpu),
        };
        self.means = match gpu {
            None => Means::Single,
            Some(gpu) => Means::Gpu(Box::new(Device::new(&gpu, &self.pulse, self.lines(), self.samples)?)),
        };
        Ok(self)
    }

    /// Number of lines.
    pub fn lines(&self) -> usize {
        self.grid.lines()
    }

    /// Number of samples of a line; sample 0 is the echo at the array.
    pub fn samples(&self) -> usize {
        self.samples
    }

    /// Scanlines of the probe.
    pub fn grid(&self) -> &BeamGrid {
        &self.grid
    }

    /// Volume of a resolution cell at the focus, mm^3.
    fn cell_mm3(&self) -> f64 {
        let axial_mm = FWHM * self.acquisition.sigma_us() * super::SPEED_M_S * 1e-3 / 2.0;
        axial_mm * self.spread.lateral_mm * self.spread.elevational_mm
    }

    /// Echoes of a frame, line by line, in units of the RMS of normal liver at the focus without attenuation.
    ///
    /// # Errors
    /// [`SynthError`] if the pose is not rigid, or the state has another number of nodes than the mesh.
    pub fn render(&mut self, state: &FrameState) -> Result<Vec<f32>, SynthError> {
        let probe_to_world = rigid(&state.probe_to_world).map_err(SynthError::Pose)?;
        self.set(state)?;
        self.cover(&probe_to_world)?;
        let to_probe = inverse_rigid(&probe_to_world);
        let losses = self.losses(&probe_to_world);
        let steps = losses.len() / self.lines();
        // Independent scatterers add in power: the mean square is their density times the energy of one.
        let sigma_mm = self.spread.elevational_mm / FWHM;
        let energy = self.pulse.energy() * self.acquisition.sample_mm() * PI * sigma_mm * self.spread.lateral_mm / FWHM;
        let density = self.acquisition.per_cell / self.cell_mm3();
        let unit_echo = (density * energy).sqrt().recip();
        let (grid, locator, spread) = (&self.grid, self.locator.as_ref(), &self.spread);
        let (sample_mm, last) = (self.acquisition.sample_mm(), self.lines() - 1);
        let mut seen: Vec<Scatterer> = parallel::filter_map(&mut self.points[..], &|point| {
            let position_mm = locator.map_or(point.at, |locator| locator.carry(point.at, &mut point.element));
            let point_mm = to_probe.transform_point(&position_mm.into());
            let (line, depth_mm) = grid.to_line_and_depth(point_mm.x, point_mm.y);
            let beyond = point_mm.z / sigma_mm;
            if beyond.abs() > REACH || depth_mm <= 0.0 || depth_mm > grid.depth_mm() + 1.0 {
                return None;
            }
            let nearest = line.round().clamp(0.0, last as f64) as usize;
            let [left, centre] = losses[nearest * steps + ((depth_mm / LOSS_MM) as usize).min(steps - 1)];
            Some(Scatterer {
                line: line as f32,
                sample: depth_mm / sample_mm,
                amplitude: (unit_echo * f64::from(point.amplitude) * (-0.5 * beyond * beyond).exp()) as f32 * left,
                sigma: (spread.lateral_at(depth_mm) / FWHM / grid.lateral_spacing_mm(depth_mm)) as f32,
                centre,
            })
        });
        let (lines, samples) = (self.lines(), self.samples);
        let mut out = match &mut self.means {
            Means::Single => echoes(&mut seen, &self.pulse, lines, samples),
            Means::Double => {
                let out: Vec<f64> = echoes(&mut seen, &self.pulse, lines, samples);
                out.into_iter().map(|value| value as f32).collect()
            }
            Means::Gpu(device) => device.echoes(&seen)?,
        };
        self.add_noise(&mut out, state.frame);
        Ok(out)
    }

    /// Position in the current state of a point of the reference state (mm); one outside the mesh stays.
    pub fn carry(&self, reference: &Point3<f64>) -> Point3<f64> {
        let locator = self.locator.as_ref();
        locator.map_or(*reference, |locator| {
            locator.carry((*reference).into(), &mut { NO_ELEMENT }).into()
        })
    }

    /// Reference and current nodes, mm.
    pub fn nodes(&self) -> [&[[f64; 3]]; 2] {
        [&self.reference, &self.current]
    }

    fn set(&mut self, state: &FrameState) -> Result<(), SynthError> {
        let (reference, current) = (state.reference.as_deref(), state.nodes.as_deref());
        if let Some(locator) = self
            .locator
            .as_mut()
            .filter(|_| reference.is_some() || current.is_some())
        {
            locator.update_states(reference, current).map_err(SynthError::from)?;
            self.reference = reference.map_or_else(|| std::mem::take(&mut self.reference), <[_]>::to_vec);
            self.current = current.map_or_else(|| std::mem::take(&mut self.current), <[_]>::to_vec);
        }
        Ok(())
    }

    /// Recreates the scatterers when the image or the tissue has moved out of their region.
    fn cover(&mut self, probe_to_world: &Matrix4<f64>) -> Result<(), SynthError> {
        let moved = |(a, b): (&[f64; 3], &[f64; 3])| (Point3::from(*a) - Point3::from(*b)).norm();
        let strain = self.reference.iter().zip(&self.current).map(moved).fold(0.0, f64::max);
        let corners = self.corners(0.0);
        let shift = self.region.as_ref().map_or(0.0, |region| {
            let distance = |corner: &Point3<f64>| {
                (probe_to_world.transform_point(corner) - region.probe_to_world.transform_point(corner)).norm()
            };
            corners.iter().map(distance).fold(0.0, f64::max)
        });
        if self
            .region
            .as_ref()
            .is_some_and(|region| strain + shift <= region.margin_mm)
        {
            return Ok(());
        }
        let region = Region {
            probe_to_world: *probe_to_world,
            margin_mm: 1.5 * strain + MARGIN_MM,
        };
        let corners = self.corners(region.margin_mm);
        let box_mm3: f64 = (corners[7] - corners[0]).iter().product();
        let volume = &self.anatomy.volume;
        let volume_mm3 = volume.voxels().len() as f64 * volume.voxel_mm3();
        let count = box_mm3.min(volume_mm3) * self.acquisition.per_cell / self.cell_mm3();
        // Slices of points, all of them, and what is seen of them.
        let each = 2 * size_of::<Point>() + size_of::<Scatterer>();
        memory::check((count * each as f64) as u64, &format!("{count:.1e} scatterers"))?;
        self.points = self.scatter(&region);
        self.region = Some(region);
        Ok(())
    }

    /// Corners of the box of the image and its slab, grown by a margin, probe frame, mm.
    fn corners(&self, margin_mm: f64) -> Vec<Point3<f64>> {
        let bounds = self.grid.bounds_mm();
        let beyond = REACH * self.spread.elevational_mm / FWHM + margin_mm;
        let aside = REACH * self.spread.lateral_mm / FWHM + margin_mm;
        let x = [bounds.min[0] - aside, bounds.max[0] + aside];
        let y = [bounds.min[1] - margin_mm, bounds.max[1] + margin_mm];
        let corner = |number: usize| Point3::new(x[number & 1], y[number >> 1 & 1], [-beyond, beyond][number >> 2]);
        (0..8).map(corner).collect()
    }

    /// One scatterer in each cell of a lattice, at a random place in it and of random sign.
    fn scatter(&self, region: &Region) -> Vec<Point> {
        let side = (self.cell_mm3() / self.acquisition.per_cell).cbrt();
        let corners = self.corners(region.margin_mm);
        let (low, high) = (corners[0], corners[7]);
        let world: Vec<_> = corners
            .iter()
            .map(|corner| region.probe_to_world.transform_point(corner))
            .collect();
        let range = |axis: usize| {
            let along = || world.iter().map(|corner| corner[axis] / side);
            let (from, to) = (
                along().fold(f64::INFINITY, f64::min),
                along().fold(f64::NEG_INFINITY, f64::max),
            );
            from.floor() as i32..to.ceil() as i32
        };
        let to_probe = inverse_rigid(&region.probe_to_world);
        let seed = seed_words(self.settings.seed);
        let sign_seed = seed_words(self.settings.seed ^ AMPLITUDES);
        let volume = &self.anatomy.volume;
        let tissues = &self.anatomy.tissues;
        let strength = self
            .settings
            .effects
            .texture
            .as_ref()
            .map_or(0.0, |texture| texture.strength);
        let point = |cell: [i32; 3]| {
            let words = hash3(cell, seed);
            let position = [0, 1, 2].map(|axis| (f64::from(cell[axis]) + f64::from(unit(words[axis]))) * side);
            let seen = to_probe.transform_point(&Point3::from(position));
            if (0..3).any(|axis| !(low[axis]..=high[axis]).contains(&seen[axis])) {
                return None;
            }
            let label = volume.label_index_at(&Point3::from(position))?;
            let tissue = tissues.tissue(label);
            let mut amplitude = 10_f64.powf(tissue.echogenicity_db / 20.0);
            let entry = self.entries[usize::from(label)] as usize;
            if let (Some(atlas), true) = (&self.atlas, entry > 0) {
                amplitude *= 1.0 + strength * (atlas.sample(entry - 1, position) - 1.0);
            }
            // Equal magnitudes need fewest scatterers for fully developed speckle.
            let amplitude = if hash3(cell, sign_seed)[0] & 1 == 0 {
                amplitude
            } else {
                -amplitude
            } as f32;
            (amplitude != 0.0).then_some(Point {
                at: position,
                amplitude,
                element: NO_ELEMENT,
            })
        };
        let slices: Vec<i32> = range(2).collect();
        let points = parallel::map(&slices[..], &|&k| {
            let cells = range(1).flat_map(|j| range(0).map(move |i| [i, j, k]));
            cells.filter_map(point).collect::<Vec<_>>()
        });
        points.into_iter().flatten().collect()
    }

    /// Amplitude left and centre of the pulse over the frequency of the probe at every half millimetre of each line,
    /// through the anatomy at rest.
    fn losses(&self, probe_to_world: &Matrix4<f64>) -> Vec<[f32; 2]> {
        let steps = (self.grid.depth_mm() / LOSS_MM).ceil() as usize + 1;
        let Some(shadow) = &self.settings.effects.shadow else {
            return vec![[1.0; 2]; steps * self.lines()];
        };
        let downshift = Downshift::new(self.acquisition.bandwidth);
        let lost = |line: usize| -> Vec<[f32; 2]> {
            let ray = self.grid.rays()[line];
            let mut sums = [0.0; 2];
            let left = |step: usize| {
                let along = (step as f64 + 0.5) * LOSS_MM;
                let [x, y] = [0, 1].map(|axis| ray.origin[axis] + along * ray.direction[axis]);
                let point = probe_to_world.transform_point(&Point3::new(x, y, 0.0));
                let db = self.db_per_mm(shadow, &point).map(|db_mm| db_mm * LOSS_MM);
                let [attenuation, occlusion] = [0, 1].map(|kind| sums[kind] + 0.5 * db[kind]);
                (0..2).for_each(|kind| sums[kind] += db[kind]);
                let left = 10_f64.powf(-(downshift.felt_db(attenuation) + occlusion) / 20.0);
                [left, downshift.centre(attenuation)].map(|value| value as f32)
            };
            (0..steps).map(left).collect()
        };
        parallel::map(0..self.lines(), &lost).concat()
    }

    fn db_per_mm(&self, shadow: &Shadow, position: &Point3<f64>) -> [f64; 2] {
        let label = self.anatomy.volume.label_index_at(position);
        label.map_or([0.0; 2], |label| {
            shadow.db_per_mm(self.anatomy.tissues.tissue(label), self.acquisition.frequency_mhz)
        })
    }

    fn add_noise(&self, echoes: &mut [f32], frame: u64) {
        let level = 10_f64.powf(-self.acquisition.snr_db / 20.0);
        let seed = seed_words(self.settings.seed ^ NOISE ^ frame << 16);
        for_each((0.., chunks_mut(echoes, self.samples)), &|(line, row)| {
            for (pair, values) in row.chunks_mut(2).enumerate() {
                let [a, b, _] = hash3([line as i32, pair as i32, 0], seed).map(|word| f64::from(unit(word)));
                let radius = level * (-2.0 * (1.0 - a).ln()).sqrt();
                let both = [(TAU * b).cos(), (TAU * b).sin()];
                values
                    .iter_mut()
                    .zip(both)
                    .for_each(|(value, part)| *value += (radius * part) as f32);
            }
        });
    }
}

/// Lowest centre of a pulse in an image over the frequency of the probe: behind the tissue that attenuates most.
fn lowest_centre(anatomy: &Anatomy, settings: &Settings, acquisition: &Acquisition) -> f64 {
    let Some(shadow) = &settings.effects.shadow else {
        return 1.0;
    };
    let labels = 0..anatomy.volume.labels().len();
    let db_mm = labels.map(|label| shadow.db_per_mm(anatomy.tissues.tissue(label as u8), acquisition.frequency_mhz)[0]);
    Downshift::new(acquisition.bandwidth).centre(db_mm.fold(0.0, f64::max) * settings.probe.depth_mm)
}
