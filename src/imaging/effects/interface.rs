//! Interface: specular echoes where the label changes along a scanline, strongest at perpendicular incidence.
//!
//! The echo of a surface is `mirror R cos^n(theta) m`. `R` is the reflection coefficient `|Z1 - Z2| / (Z1 + Z2)` of the
//! impedances on either side, or that of a capsule between them if that is larger (Cobbold, Foundations of Biomedical
//! Ultrasound, 2007, section 1.8). `theta` is the angle of incidence in the tissue at rest, relative to the normal of
//! the labels' boundary in three dimensions; the exponent represents the aperture of the probe and the roughness of the
//! surface: 4 fits the ridge of bone in 3,740 columns of frames of a linear probe from 0 to 75 degrees. `m` is a
//! complex number of unit mean power, smooth over `ROUGHNESS_MM` (6.0 mm) and anchored in the tissue: a constant part
//! and a diffuse one (Beckmann and Spizzichino, The Scattering of Electromagnetic Waves from Rough Surfaces, 1963),
//! whose amplitude is Rice distributed.
//!
//! With speckle the echoes are added to those of the scatterers before the point spread is applied, and interfere with
//! them; without, their moduli are added to the amplitude. Each of the two samples beside a step of labels has one half
//! of its echo. The steered looks of `compound` meet a surface at angles of their own.
//!
//! ```toml
//! effects.interface = { mirror_db = 44.0 }
//! ```

#[cfg(any(test, feature = "analysis"))]
pub(crate) mod bound;
#[cfg(test)]
mod parity;
#[cfg(test)]
mod physics;

use glam::Vec4;

use super::buffers::{AMPLITUDE, Buffer, LABEL, LABEL_ROWS, POSITION, SPECULAR, VOXELS, bytes_of};
use super::common::{elevation, rows, scatterers};
use super::compound::{LOOK_SPECULAR, MOST_STEERED, SPECULAR_BLOCK, Steering, steered, steps};
use super::pass::{Band, Grid, ParamBlock, Pass, Use, Use::*, View, block, bound, reference};
use super::slice::{Beyond, LabelReader};
use super::{
    Effect, Parameters, Stage,
    Wanted::{self, No, Yes},
};
use crate::synth::SynthError;
use crate::synth::store::Store;
use crate::synth::tables::{Anatomy, Settings, Tables};
use insonify_anatomy::acoustics::TissueTable;
use insonify_base::parallel::{chunks_mut, for_each};
use insonify_base::random::seed_words;
use insonify_base::range::parameters;
use insonify_base::real::{Numbers, Real};
use insonify_base::simd::{Kernel, map, vectorised};
use insonify_tracking::probe::BeamGrid;

/// Correlation length of the echo along a rough surface, mm: of the order at which bright lines break up in clinical
/// frames (strands of median 4 mm and up to 36 mm between breaks).
pub(crate) const ROUGHNESS_MM: f64 = 6.0;

/// Spacing of the voxels used for normals, mm; finer voxels are subsampled.
pub const NORMAL_MM: f64 = 0.75;

parameters! {
    /// Specular echoes.
    pub struct Interface {
        /// Echo of a perfect mirror at perpendicular incidence, dB relative to liver.
        mirror_db: f64 = 34.0, in -40..=80;
        /// Exponent of the cosine of the angle of incidence.
        directivity: f64 = 4.0, in 0..=64;
        /// Diffuse fraction of the power of the echo: 0 is smooth; 0.25 has a standard deviation of 3.7 dB along the
        /// surface, 1 of 5.2.
        roughness: f64 = 0.5, in 0..=1;
    }
}

impl Parameters for Interface {}

/// Registry entry.
pub(crate) const EFFECT: Effect = Effect {
    name: "interface",
    stage: Stage::Echoes,
    example: "effects.interface = { mirror_db = 44.0 }",
    wanted,
    passes: |tables| match tables.effects.speckle {
        Some(_) if steered(tables) > 0 => vec![&OF_LOOKS],
        Some(_) => vec![&BEFORE_SPECKLE],
        None => vec![&ALONE],
    },
    buffers: &[&LOOK_DIRECTIONS],
    remove: Some(|_, settings| settings.effects.interface = None),
    ..Effect::PLAIN
};

/// Directions of the steered looks; empty without them.
#[derive(Clone, Debug, Default)]
pub struct Derived {
    /// Per number of steps to the side, from 1 on: cosine and sine of the angle between a look and the scanline at the
    /// sample, a row over the samples.
    directions: Numbers,
}

/// Settings on which the directions depend.
pub(crate) type Key<'a> = Option<(Steering, &'a BeamGrid)>;

/// Takes the looks and the grid.
pub(crate) fn key<'a>(_: &TissueTable, settings: &Settings, grid: &'a BeamGrid) -> Key<'a> {
    settings.effects.interface.as_ref()?;
    Some((Steering::of(settings, grid)?, grid))
}

/// Follows the looks.
pub(crate) fn derive(_: &Anatomy, key: &Key) -> Result<Derived, SynthError> {
    let directions = key
        .as_ref()
        .map_or(Vec::new(), |(steering, grid)| steering.directions(grid));
    Ok(Derived {
        directions: Numbers::new(directions),
    })
}

/// Cosine and sine of the angle between a look and the scanline at a sample.
#[inline(always)]
fn direction<T: Real>(tables: &Tables, look: usize, sample: usize) -> [T; 2] {
    let row = look / 2 * tables.samples() + sample;
    let directions = tables.effects.interface.directions.of::<T>();
    let [cosine, sine] = [directions[2 * row], directions[2 * row + 1]];
    [cosine, if steps(look) < 0 { -sine } else { sine }]
}

/// Data of [`Derived::directions`] (`vec2<f32>`).
static LOOK_DIRECTIONS: Buffer = Buffer::new(152, "LookDirections", 8, |tables| {
    tables.effects.interface.directions.of::<f32>().len() / 2
})
.derived(|_, derived| bytes_of(derived.interface.directions.of::<f32>()));

const ALONE: Pass = interface_pass(
    "main",
    const {
        &[
            (&POSITION, ReadLine),
            (&LABEL, ReadLine),
            (&LABEL_ROWS, Read),
            (&VOXELS, Read),
            (&AMPLITUDE, WriteOwn),
        ]
    },
);

const BEFORE_SPECKLE: Pass = interface_pass(
    "before_speckle",
    const {
        &[
            (&POSITION, ReadLine),
            (&LABEL, ReadLine),
            (&LABEL_ROWS, Read),
            (&VOXELS, Read),
            (&SPECULAR, WriteOwn),
        ]
    },
);

const OF_LOOKS: Pass = interface_pass(
    "of_looks",
    const {
        &[
            (&POSITION, ReadLine),
            (&LABEL, ReadLine),
            (&LABEL_ROWS, Read),
            (&VOXELS, Read),
            (&SPECULAR, WriteOwn),
            (&LOOK_DIRECTIONS, Read),
            (&LOOK_SPECULAR, WriteOwn),
        ]
    },
);

const fn interface_pass(entry: &'static str, bindings: &'static [(&'static Buffer, Use)]) -> Pass {
    Pass {
        name: "interface",
        shader: include_str!("../../../shaders/interface.wgsl"),
        entry,
        bindings,
        params,
        grid: Grid::Samples,
        flips: false,
        cpu: reference!(run),
        bound: bound!(By(bound::carry)),
    }
}

fn wanted(tables: &Tables) -> Wanted {
    match &tables.settings.effects.interface {
        Some(_) => Yes("boundaries between tissues of different impedance, and capsules, reflect".into()),
        None => No("the scene names no interface echoes".into()),
    }
}

block! {
    /// Parameter block of `interface.wgsl`.
    struct InterfaceParams {
        /// First three rows of the world-to-index transform.
        world_to_index: [Vec4; 3],
        /// Voxels along each axis.
        size: [u32; 3],
        /// 1 to continue the body beyond the volume.
        mirrored: u32,
        /// Stride of the voxels used for normals.
        stride: [u32; 3],
        /// Samples along a scanline.
        samples: u32,
        /// Seed of the roughness.
        seed: [u32; 2],
        /// Amplitude of a perfect mirror at perpendicular incidence.
        mirror: f32,
        /// Exponent of the cosine of the angle of incidence.
        directivity: f32,
        /// Amplitude of the constant part.
        steady: f32,
        /// Amplitude of the diffuse part.
        diffuse: f32,
        /// Lattice points of the roughness per mm.
        per_mm: f32,
        /// Looks besides the middle one.
        steered: u32,
        /// Out-of-plane direction in the world; the fourth component is unused.
        elevation: Vec4,
    }
}

fn params(view: &View, _: Band) -> ParamBlock {
    let tables = view.tables;
    let interface = tables.settings.effects.interface.clone().unwrap_or_default();
    let [x, y, z] = elevation::<f32>(view.state);
    ParamBlock::of(&InterfaceParams {
        world_to_index: rows::<f32>(tables.volume.world_to_index()).map(Vec4::from),
        size: tables.volume.size().map(|n| n as u32),
        mirrored: u32::from(tables.settings.effects.slice.beyond == Beyond::Continue),
        stride: strides(tables).map(|n| n as u32),
        samples: tables.samples() as u32,
        seed: roughness_seed(tables),
        mirror: 10f64.powf(interface.mirror_db / 20.0) as f32,
        directivity: interface.directivity as f32,
        steady: (1.0 - interface.roughness).sqrt() as f32,
        diffuse: interface.roughness.sqrt() as f32,
        per_mm: (1.0 / ROUGHNESS_MM) as f32,
        steered: steered(tables) as u32,
        elevation: Vec4::new(x, y, z, 0.0),
    })
}

/// Stride of the voxels used for normals, along each axis.
fn strides(tables: &Tables) -> [i32; 3] {
    tables
        .volume
        .spacing_mm()
        .map(|spacing| ((NORMAL_MM / spacing).round() as i32).max(1))
}

/// Seed of a lattice different from that of the speckle.
fn roughness_seed(tables: &Tables) -> [u32; 2] {
    seed_words(!tables.settings.seed)
}

fn run<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let (lines, samples) = (tables.lines(), tables.samples());
    let surfaces = Surfaces::<T>::new(tables, elevation(view.state));
    let (labels, positions) = (&store.label[..lines * samples], &store.position[..lines * samples]);
    let echoes = |line: usize, add: &mut dyn FnMut(usize, &Echoes<T>)| {
        let labels = &labels[line * samples..][..samples];
        let positions = &positions[line * samples..][..samples];
        for start in (1..samples).step_by(BLOCK) {
            let end = (start + BLOCK).min(samples);
            // With the label above the block, so that no pair across its border is missed. Most blocks lie in
            // one tissue and are passed over whole.
            if vectorised(Uniform(&labels[start - 1..end])) {
                continue;
            }
            for below in start..end {
                let between = [below - 1, below];
                if labels[below - 1] == labels[below] {
                    continue;
                }
                let echoes = T::vectorised(Step {
                    surfaces: &surfaces,
                    tables,
                    labels: between.map(|index| labels[index]),
                    positions: between.map(|index| positions[index]),
                    below,
                });
                if let Some(echoes) = echoes {
                    between.into_iter().for_each(|index| add(index, &echoes));
                }
            }
        }
    };
    // Echoes interfere with speckle, so that both parts are kept for it; without speckle only their size
    // counts.
    let sum = |sum: &mut [T; 2], echo: [T; 2]| *sum = [sum[0] + echo[0], sum[1] + echo[1]];
    let steered = steered(tables);
    if tables.effects.speckle.is_some() && steered > 0 {
        let compound = &mut store.effects.compound;
        let rows = (
            (0.., chunks_mut(&mut store.specular, samples)),
            chunks_mut(&mut compound.specular, steered * samples),
            chunks_mut(&mut compound.has_specular, samples.div_ceil(SPECULAR_BLOCK)),
        );
        for_each(rows, &|((line, out), of_looks, has_specular)| {
            out.fill([T::zero(); 2]);
            has_specular.fill(false);
            echoes(line, &mut |i, (middle, more)| {
                sum(&mut out[i], *middle);
                let block = i / SPECULAR_BLOCK;
                let is_first = !std::mem::replace(&mut has_specular[block], true);
                for (row, more) in of_looks.chunks_mut(samples).zip(more) {
                    if is_first {
                        let end = samples.min((block + 1) * SPECULAR_BLOCK);
                        row[block * SPECULAR_BLOCK..end].fill([T::zero(); 2]);
                    }
                    sum(&mut row[i], *more);
                }
            });
        });
    } else if tables.effects.speckle.is_some() {
        for_each((0.., chunks_mut(&mut store.specular, samples)), &|(line, out)| {
            out.fill([T::zero(); 2]);
            echoes(line, &mut |i, (middle, _)| sum(&mut out[i], *middle));
        });
    } else {
        let amplitude = &mut store.amplitude[..lines * samples];
        for_each((0.., chunks_mut(amplitude, samples)), &|(line, out)| {
            echoes(line, &mut |i, ([re, im], _)| out[i] += (*re * *re + *im * *im).sqrt());
        });
    }
}

/// Number of samples tested together for a boundary between them.
const BLOCK: usize = 32;

/// Half the echo between two samples, and by how much that of each steered look exceeds it.
type Echoes<T> = ([T; 2], [[T; 2]; MOST_STEERED]);

/// Half the echoes between two samples.
struct Step<'a, T> {
    surfaces: &'a Surfaces<'a, T>,
    tables: &'a Tables,
    labels: [u8; 2],
    positions: [[T; 4]; 2],
    /// The second of the samples.
    below: usize,
}

impl<T: Real> Kernel for Step<'_, T> {
    type Output = Option<Echoes<T>>;

    #[inline(always)]
    fn run(self) -> Option<Echoes<T>> {
        let surface = self.surfaces.surface(self.labels, self.positions)?;
        let middle = self.surfaces.echo(&surface, [T::one(), T::zero()]);
        let mut more = [[T::zero(); 2]; MOST_STEERED];
        for (look, more) in more.iter_mut().enumerate().take(steered(self.tables)) {
            let echo = self.surfaces.echo(&surface, direction(self.tables, look, self.below));
            *more = [echo[0] - middle[0], echo[1] - middle[1]];
        }
        Some((middle, more))
    }
}

/// Whether all labels are the same.
struct Uniform<'a>(&'a [u8]);

impl Kernel for Uniform<'_> {
    type Output = bool;

    #[inline(always)]
    fn run(self) -> bool {
        let first = self.0[0];
        self.0.iter().fold(0u8, |differing, label| differing | (label ^ first)) == 0
    }
}

#[inline(always)]
fn cross<T: Real>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

/// Half the number of voxels along each axis used for a normal: the weights `(1 - (x / 3)^2)^2` vanish there. On random
/// planes they give the normal to 3 degrees, compared with 12 for a cubic B-spline.
pub const REACH: i32 = 3;

/// Number of taps of a normal along an axis, padded to vector registers.
const LANES: usize = 8;

/// A surface between two samples of a scanline.
pub(crate) struct Surface<T> {
    /// Half the echo at perpendicular incidence.
    size: T,
    /// Complex multiplier of the echo.
    roughness: [T; 2],
    /// Cosines of the angles of its normal with the scanline, and with the direction across it in the scan plane.
    incidence: [T; 2],
}

/// Surfaces of a volume.
pub(crate) struct Surfaces<'a, T> {
    elevation: [T; 3],
    reader: LabelReader<'a, T>,
    impedance: [T; 256],
    capsule: [T; 256],
    stride: [i32; 3],
    seed: [u32; 2],
    mirror: T,
    directivity: T,
    steady: T,
    diffuse: T,
}

impl<'a, T: Real> Surfaces<'a, T> {
    /// Creates the surfaces of a scene, given the out-of-plane direction.
    pub(crate) fn new(tables: &'a Tables, elevation: [T; 3]) -> Self {
        let interface = tables.settings.effects.interface.clone().unwrap_or_default();
        let row = |label: usize| tables.label_rows.get(label);
        Self {
            elevation,
            reader: LabelReader::new(tables),
            impedance: std::array::from_fn(|label| T::of(row(label).map_or(0.0, |row| f64::from(row.impedance)))),
            capsule: std::array::from_fn(|label| T::of(row(label).map_or(0.0, |row| f64::from(row.capsule)))),
            stride: strides(tables),
            seed: roughness_seed(tables),
            mirror: T::of(10f64.powf(interface.mirror_db / 20.0)),
            directivity: T::of(interface.directivity),
            steady: T::of((1.0 - interface.roughness).sqrt()),
            diffuse: T::of(interface.roughness.sqrt()),
        }
    }

    /// Stride of the voxels used for normals, along each axis.
    #[cfg(any(test, feature = "analysis"))]
    pub(crate) fn stride(&self) -> [f64; 3] {
        self.stride.map(f64::from)
    }

    /// Reflection coefficient between two labels.
    #[inline(always)]
    pub(crate) fn coefficient(&self, [near, far]: [u8; 2]) -> T {
        let [a, b] = map([near, far], |label| self.impedance[usize::from(label)]);
        let [c, d] = map([near, far], |label| self.capsule[usize::from(label)]);
        let step = if a + b > T::zero() {
            (a - b).abs() / (a + b)
        } else {
            T::zero()
        };
        step.max((c - d).abs())
    }

    /// The surface between two samples of a scanline, from their labels and reference positions (mm); `None` if the
    /// labels are the same or reflect nothing. Each of the two samples has one half of its echo.
    #[inline(always)]
    pub(crate) fn surface(&self, labels: [u8; 2], positions: [[T; 4]; 2]) -> Option<Surface<T>> {
        if labels[0] == labels[1] {
            return None;
        }
        let reflected = self.coefficient(labels);
        if reflected == T::zero() {
            return None;
        }
        let [above, below] = map(positions, |[x, y, z, _]| [x, y, z]);
        Some(Surface {
            size: T::of(0.5) * self.mirror * reflected,
            roughness: self.roughness(below),
            incidence: self.incidence(labels, [above, below]),
        })
    }

    /// Half the echo of a surface met by waves along a direction: cosine and sine of its angle with the scanline.
    #[inline(always)]
    pub(crate) fn echo(&self, surface: &Surface<T>, [cosine, sine]: [T; 2]) -> [T; 2] {
        let [along, across] = surface.incidence;
        let square = (along * cosine + across * sine).abs().min(T::one());
        let size = surface.size * square.powf(self.directivity);
        map(surface.roughness, |part| size * part)
    }

    /// Complex multiplier of the echo of a surface at a reference position, mm.
    #[inline(always)]
    pub(crate) fn roughness(&self, position: [T; 3]) -> [T; 2] {
        let ([re], [im]) = scatterers(&map(position, |x| [x * T::of(1.0 / ROUGHNESS_MM)]), self.seed);
        [self.steady + self.diffuse * re, self.diffuse * im]
    }

    /// Cosines of the angles of the normal of the boundary of two labels, at the second of two reference positions (mm),
    /// with the line between them and with the direction across it in the scan plane; 0 if there is no normal.
    #[inline(always)]
    pub(crate) fn incidence(&self, labels: [u8; 2], [before, after]: [[T; 3]; 2]) -> [T; 2] {
        let Some(gradient) = self.gradient(labels, after) else {
            return [T::zero(); 2];
        };
        let [from, to] = map([before, after], |position| self.reader.index(position));
        let rows = self.reader.rows();
        let mut along = T::zero();
        let (mut steep, mut long) = (T::zero(), T::zero());
        let (mut normal, mut step) = ([T::zero(); 3], [T::zero(); 3]);
        for axis in 0..3 {
            along += gradient[axis] * (to[axis] - from[axis]);
            normal[axis] = rows[0][axis] * gradient[0] + rows[1][axis] * gradient[1] + rows[2][axis] * gradient[2];
            steep += normal[axis] * normal[axis];
            step[axis] = after[axis] - before[axis];
            long += step[axis] * step[axis];
        }
        let across = cross(step, self.elevation);
        let across = normal[0] * across[0] + normal[1] * across[1] + normal[2] * across[2];
        let product = (steep * long).sqrt();
        if product > T::zero() {
            [along / product, across / product]
        } else {
            [T::zero(); 2]
        }
    }

    /// Gradient, in voxels and up to a factor, of the weight of the second of two labels relative to the first around a
    /// reference position (mm); `None` outside the volume.
    #[inline(always)]
    pub(crate) fn gradient(&self, [near, far]: [u8; 2], position: [T; 3]) -> Option<[T; 3]> {
        const TAPS: usize = 2 * REACH as usize;
        let half = T::of(0.5);
        let (shifted, mirrored) = self.reader.within(map(self.reader.index(position), |x| x + half))?;
        let mut base = [0i32; 3];
        // Lanes past the taps have zero weight.
        let (mut weights, mut slopes) = ([[T::zero(); LANES]; 3], [[T::zero(); LANES]; 3]);
        for axis in 0..3 {
            let steps = (shifted[axis] - half) / T::from_signed(self.stride[axis]);
            // Shifting by one keeps the truncation a floor: indices start at -0.5.
            base[axis] = (steps + T::one()).trunc().integer() - 1;
            let fraction = steps - T::from_signed(base[axis]);
            for tap in 0..TAPS {
                let x = T::from_signed(tap as i32 + 1 - REACH) - fraction;
                let closeness = T::one() - x * x * T::of(1.0 / f64::from(REACH * REACH));
                weights[axis][tap] = closeness * closeness;
                slopes[axis][tap] = x * closeness;
            }
        }
        let mut offsets = [[0; LANES]; 3];
        for (axis, offsets) in offsets.iter_mut().enumerate() {
            let stride = self.stride[axis];
            *offsets = self.reader.offsets(axis, (base[axis] + 1 - REACH) * stride, stride);
        }
        let [columns, rows, slabs] = &offsets;
        let mut labels = [[0; LANES]; TAPS * TAPS];
        for (row, labels) in labels.iter_mut().enumerate() {
            *labels = self.reader.row(columns, rows[row % TAPS] + slabs[row / TAPS]);
        }
        // 1 for the second label, -1 for the first: all at once, as each step fills vector registers.
        let mut signs = [[T::zero(); LANES]; TAPS * TAPS];
        let (all_signs, labels) = (signs.as_flattened_mut(), labels.as_flattened());
        for voxel in 0..LANES * TAPS * TAPS {
            all_signs[voxel] = T::from_signed(i32::from(
                i8::from(labels[voxel] == far) - i8::from(labels[voxel] == near),
            ));
        }
        let mut sums = [[T::zero(); LANES]; 3];
        for (row, signs) in signs.iter().enumerate() {
            let (j, k) = (row % TAPS, row / TAPS);
            let factors = [
                weights[1][j] * weights[2][k],
                slopes[1][j] * weights[2][k],
                weights[1][j] * slopes[2][k],
            ];
            for axis in 0..3 {
                for lane in 0..LANES {
                    sums[axis][lane] += factors[axis] * signs[lane];
                }
            }
        }
        let mut gradient = [T::zero(); 3];
        for (axis, along) in [&slopes[0], &weights[0], &weights[0]].into_iter().enumerate() {
            for lane in 0..LANES {
                gradient[axis] += along[lane] * sums[axis][lane];
            }
            gradient[axis] /= T::from_signed(self.stride[axis]);
            if mirrored[axis] {
                gradient[axis] = -gradient[axis];
            }
        }
        Some(gradient)
    }
}

#[cfg(test)]
mod tests;
