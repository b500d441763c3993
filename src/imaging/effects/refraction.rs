//! Refraction: focusing and defocusing of beams where the speed of sound changes; dark lines under the edges of cysts,
//! vessels and organs.
//!
//! The phase of a straight scanline is advanced by the path `d = sum (n - 1)`, where `n` is the refractive index. The
//! gradient of `d` across the scanlines deflects the beam (paraxial approximation of geometrical optics: M. Born and E.
//! Wolf, Principles of Optics, 1999, chapter 3), and its curvature focuses or defocuses it. With scanlines `h(s)`
//! apart, the factor on the one-way intensity, and so on the amplitude of an echo, is `1 / |1 + sum d''(s) / h(s)^2|`,
//! at most [`MAX`] (1.4). The artefact: M. K. Feldman et al., RadioGraphics 29 (2009) 1179.
//!
//! A beam is wider than a ray. The second difference `d''` is that of averages over half the beam width, side by side
//! from the middle of the array, linearly interpolated between them; how fine the scanlines are does not change them.
//! At a distance `z` below a lens the converging beam of f-number `F` is `z / F` wide at the lens and averages over it,
//! so that the effect of a lens saturates at `F` beam widths: terms of the sum decay exponentially with that length,
//! with `F_NUMBER` (2.0) for `F`.
//!
//! Each look of [`compound`](super::compound) has its own paths: down rays from the middles of half beam widths on the
//! array, of which the curvature is interpolated at each place, 16 steps to half a beam width. The echo, which is the
//! mean of the looks, takes the mean of their factors, as if all looks were as strong there.
//!
//! Speeds are derived from impedances, `c` proportional to the root of `Z`: within 2 % from fat (1.38 MRayl, 1450 m/s)
//! to muscle (1.70 MRayl, 1580 m/s).
//!
//! ```toml
//! effects.refraction = {}
//! ```

#[cfg(any(test, feature = "analysis"))]
pub(crate) mod bound;
#[cfg(test)]
mod parity;
#[cfg(test)]
mod physics;

use super::buffers::{AMPLITUDE, Buffer, LABEL, LABEL_ROWS, bytes_of, columns};
use super::common::spacing;
use super::compound::{Steering, shift_row, steered};
use super::lateral::BLOCK;
use super::pass::{Band, Grid, ParamBlock, Pass, Use::*, View, block, bound, reference};
use super::{
    Effect, Parameters, Stage,
    Wanted::{self, No, Yes},
};
use crate::synth::SynthError;
use crate::synth::store::Store;
use crate::synth::tables::{Anatomy, Settings, Tables};
use insonify_anatomy::acoustics::TissueTable;
use insonify_base::parallel::{chunks_mut, for_each};
use insonify_base::range::parameters;
use insonify_base::real::Real;
use insonify_base::simd::Kernel;
use insonify_tracking::probe::BeamGrid;

parameters! {
    /// Refraction of beams.
    pub struct Refraction {
        /// Beam width over which refraction is averaged, mm.
        beam_mm: f64 = 6.0, in 0.5..=20;
    }
}

impl Parameters for Refraction {}

/// Largest gain of amplitude by focusing, 3 dB: the caustics of geometrical optics do not occur in beams.
pub const MAX: f64 = 1.4;

/// F-number of the beam: an aperture of 25 to 30 mm at a depth of 6 cm.
pub(crate) const F_NUMBER: f64 = 2.0;

/// Impedance of tissue with the speed of sound that scanners assume, 1540 m/s, MRayl.
const REFERENCE_MRAYL: f64 = 1.58;

/// Largest deviation of the index of soft tissue from 1; beyond it lie gas and bone.
const FURTHEST: f64 = 0.15;
/// Impedance whose index is used for gas and bone, MRayl: only their shadows show.
const SOFT_MRAYL: f64 = 1.65;

/// Refractive index of a tissue of an impedance, MRayl.
pub fn index(impedance_mrayl: f64) -> f64 {
    let ratio = |mrayl: f64| (REFERENCE_MRAYL / mrayl).sqrt();
    let index = ratio(impedance_mrayl);
    if (index - 1.0).abs() < FURTHEST {
        index
    } else {
        ratio(SOFT_MRAYL)
    }
}

/// Registry entry.
pub(crate) const EFFECT: Effect = Effect {
    name: "refraction",
    stage: Stage::Beam,
    example: "effects.refraction = {}",
    wanted,
    passes: |tables| match steered(tables) {
        0 => vec![&PHASE, &STRAIGHT],
        _ => vec![&PHASE, &RAYS, &MEAN],
    },
    buffers: &[&REFRACTION_SHIFTS],
    label_row: Some(|_, derived, label, row| row.phase = derived.refraction.phases.get(label).copied().unwrap_or(0)),
    remove: Some(|_, settings| settings.effects.refraction = None),
    ..Effect::PLAIN
};

/// Half beam widths of a grid, and phases; empty without refraction.
#[derive(Clone, Debug, Default)]
pub struct Derived {
    /// Half beam widths side by side, an even number from 4 on; 0 with fewer than four scanlines.
    halves: usize,
    /// Half a beam width at half the depth, at least a scanline and at most a quarter of all, 65,536ths of a scanline.
    half: u32,
    /// Units of phase per sample distance: a power of two with which second differences and sums over half a beam fit
    /// into 31 bits: integers, exact in any order.
    units_per_sample: f64,
    /// Per label index: phase increment of a sample, from 0 on, in these units.
    phases: Vec<u32>,
    /// Per number of steps to the side, from 0 on: scanlines from the element of a look to the sample, a row over the
    /// samples; empty without looks to either side.
    shifts: Vec<i32>,
}

impl Derived {
    /// Edge between half beam widths, 16ths of a scanline from the first side of the grid: symmetric about its middle.
    fn edge(&self, lines: usize, number: usize) -> u32 {
        let first = (lines as u32 * SCANLINE - self.halves as u32 * self.half) / 2;
        (first + number as u32 * self.half + SCANLINE / PARTS / 2) / (SCANLINE / PARTS)
    }

    /// Half a beam width, scanlines.
    fn scanlines(&self) -> f64 {
        f64::from(self.half) / f64::from(SCANLINE)
    }
}

/// Fixed point of half a beam width, per scanline.
const SCANLINE: u32 = 1 << 16;
/// Parts of a scanline by which it belongs to a half beam width.
const PARTS: u32 = 16;

/// Settings on which the tables depend.
pub(crate) type Key<'a> = (Option<&'a Refraction>, &'a BeamGrid, &'a TissueTable, Option<Steering>);

/// Takes parameters, grid, tissues and the directions of looks.
pub(crate) fn key<'a>(tissues: &'a TissueTable, settings: &'a Settings, grid: &'a BeamGrid) -> Key<'a> {
    let refraction = settings.effects.refraction.as_ref();
    (refraction, grid, tissues, Steering::of(settings, grid))
}

/// Fits half a beam width to the grid, and computes the phases.
pub(crate) fn derive(anatomy: &Anatomy, &(refraction, grid, tissues, steering): &Key) -> Result<Derived, SynthError> {
    let Some(refraction) = refraction else {
        return Ok(Derived::default());
    };
    let spacing_mm = grid.lateral_spacing_mm(grid.sample_depth_mm(grid.samples() / 2));
    let lines = grid.lines() as f64;
    if lines < 4.0 {
        return Ok(Derived::default());
    }
    let half = (0.5 * refraction.beam_mm / spacing_mm).max(1.0).min(0.25 * lines);
    let fixed = (half * f64::from(SCANLINE)).floor() as u32;
    let largest = (2 * grid.samples()).max((half + 1.0) as usize * PARTS as usize) as f64;
    let units_per_sample = (f64::from(1u32 << 31) / (2.0 * FURTHEST * largest))
        .log2()
        .floor()
        .exp2();
    let phase = |label: usize| {
        let impedance_mrayl = tissues.tissue(label as u8).impedance_mrayl;
        ((index(impedance_mrayl) - 1.0 + FURTHEST) * units_per_sample).round() as u32
    };
    Ok(Derived {
        halves: 2 * (grid.lines() as u32 * SCANLINE / (2 * fixed)) as usize,
        half: fixed,
        units_per_sample,
        phases: (0..anatomy.volume.labels().len()).map(phase).collect(),
        shifts: steering.map_or_else(Vec::new, |steering| steering.shifts(grid)),
    })
}

/// Per half beam width and sample: average phase down to it (`u32`).
static PHASES: Buffer = Buffer::new(275, "Phases", 4, phases_of_beam);

fn phases_of_beam(tables: &Tables) -> usize {
    tables.effects.refraction.halves * tables.samples()
}

/// Data of [`Derived::shifts`] (`i32`).
static REFRACTION_SHIFTS: Buffer = Buffer::new(274, "RefractionShifts", 4, |tables| {
    tables.effects.refraction.shifts.len()
})
.derived(|_, derived| bytes_of(&derived.refraction.shifts));

/// Per look, the middle one first, half beam width at the array and sample: curvature down to it (`f32`).
static CURVATURES: Buffer = Buffer::new(276, "Curvatures", 4, curvatures_of_beam);

fn curvatures_of_beam(tables: &Tables) -> usize {
    match steered(tables) {
        0 => 0,
        steered => (1 + steered) * phases_of_beam(tables),
    }
}

columns! {
    /// Vectors of refraction.
    pub struct Columns<T> {
        /// Data of `PHASES`.
        phases: [u32; phases_of_beam] = 0, PHASES;
        /// Data of `CURVATURES`.
        curvatures: [T; curvatures_of_beam] = T::zero(), CURVATURES;
    }
}

const PHASE: Pass = Pass {
    name: "refraction_phase",
    shader: SHADER,
    entry: "phase",
    bindings: const { &[(&LABEL, Read), (&LABEL_ROWS, Read), (&PHASES, Write)] },
    params,
    grid: Grid::Workgroups(|tables| [tables.effects.refraction.halves as u32, 1]),
    flips: false,
    cpu: reference!(phases),
    bound: bound!(Covered("by the bound of `refraction`")),
};

/// Without looks to either side.
const STRAIGHT: Pass = Pass {
    name: "refraction",
    entry: "straight",
    bindings: const { &[(&PHASES, Read), (&AMPLITUDE, WriteLine)] },
    grid: Grid::Scanlines,
    cpu: reference!(straight),
    bound: bound!(By(bound::carry)),
    ..PHASE
};

/// Rays of the looks.
const RAYS: Pass = Pass {
    name: "refraction_rays",
    entry: "rays",
    bindings: const { &[(&PHASES, Read), (&REFRACTION_SHIFTS, Read), (&CURVATURES, Write)] },
    grid: Grid::Workgroups(|tables| {
        let looks = 1 + steered(tables);
        [(looks * tables.effects.refraction.halves) as u32, 1]
    }),
    cpu: reference!(rays),
    ..PHASE
};

/// Mean of the looks.
const MEAN: Pass = Pass {
    name: "refraction",
    entry: "mean",
    bindings: const { &[(&CURVATURES, Read), (&REFRACTION_SHIFTS, Read), (&AMPLITUDE, WriteOwn)] },
    grid: Grid::Samples,
    cpu: reference!(mean),
    bound: bound!(By(bound::carry)),
    ..PHASE
};

const SHADER: &str = include_str!("../../../shaders/refraction.wgsl");

fn wanted(tables: &Tables) -> Wanted {
    if tables.settings.effects.refraction.is_none() {
        return No("the scene names no refraction".into());
    }
    if tables.effects.refraction.halves == 0 {
        return No("there are fewer than four scanlines".into());
    }
    let present = tables
        .label_rows
        .iter()
        .enumerate()
        .filter(|(label, _)| tables.volume.holds(*label));
    let mut phases: Vec<u32> = present.map(|(_, row)| row.phase).collect();
    phases.sort_unstable();
    phases.dedup();
    match phases.len() {
        0 | 1 => No("sound is equally fast in all tissues of the volume".into()),
        n => Yes(format!("{n} speeds of sound bend beams")),
    }
}

fn beam_mm(tables: &Tables) -> f64 {
    tables.settings.effects.refraction.clone().unwrap_or_default().beam_mm
}

block! {
    /// Parameter block of `refraction.wgsl`.
    struct RefractionParams {
        /// Scanlines.
        lines: u32,
        /// Samples along a scanline.
        samples: u32,
        /// Half a beam width, 65,536ths of a scanline.
        half: u32,
        /// Phase per unit, sample distances.
        unit: f32,
        /// Distance between scanlines at the array, sample distances.
        spacing: f32,
        /// Growth of the distance between scanlines per sample, sample distances.
        spreading: f32,
        /// Lower limit of the distance in second differences, a quarter of the beam width, sample distances.
        least: f32,
        /// Decay of terms per sample, as log2.
        fading: f32,
        /// Looks besides the middle one.
        steered: u32,
        /// Padding to a multiple of 16 bytes.
        unused: [u32; 3],
    }
}

fn params(view: &View, _: Band) -> ParamBlock {
    let tables = view.tables;
    let derived = &tables.effects.refraction;
    let [spacing, spreading] = spacing(tables).map(|x| x as f32);
    ParamBlock::of(&RefractionParams {
        lines: tables.lines() as u32,
        samples: tables.samples() as u32,
        half: derived.half,
        unit: unit(tables) as f32,
        spacing,
        spreading,
        least: least(tables) as f32,
        fading: fading(tables) as f32,
        steered: steered(tables) as u32,
        unused: [0; 3],
    })
}

fn unit(tables: &Tables) -> f64 {
    1.0 / tables.effects.refraction.units_per_sample
}

fn least(tables: &Tables) -> f64 {
    0.25 * beam_mm(tables) / tables.sample_mm()
}

fn fading(tables: &Tables) -> f64 {
    -tables.sample_mm() / (F_NUMBER * beam_mm(tables)) * std::f64::consts::LOG2_E
}

/// Cumulative phase down to each sample, averaged over the scanlines of each half beam width.
fn phases<T: Real>(view: &View, store: &mut Store<T>) {
    let samples = view.tables.samples();
    let labels = &store.label;
    for_each(
        (0.., chunks_mut(&mut store.effects.refraction.phases, samples)),
        &|(half, phases)| average(view.tables, half, labels, phases),
    );
}

/// Phases of one half beam width.
fn average(tables: &Tables, half: usize, labels: &[u8], phases: &mut [u32]) {
    let derived = &tables.effects.refraction;
    let [start, end] = [half, half + 1].map(|edge| derived.edge(tables.lines(), edge));
    let width = end - start;
    phases.fill(width / 2);
    for line in start / PARTS..end.div_ceil(PARTS) {
        let parts = end.min((line + 1) * PARTS) - start.max(line * PARTS);
        let increments: [u32; 256] =
            std::array::from_fn(|label| tables.label_rows.get(label).map_or(0, |row| parts * row.phase));
        let labels = &labels[line as usize * phases.len()..][..phases.len()];
        for (phase, label) in phases.iter_mut().zip(labels) {
            *phase += increments[usize::from(*label)];
        }
    }
    let mut sum = 0u32;
    for phase in phases {
        sum += *phase / width;
        *phase = sum;
    }
}

fn straight<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let (lines, samples) = (tables.lines(), tables.samples());
    let phases = &store.effects.refraction.phases;
    let spread = Spread::<T>::new(tables);
    for_each(
        (0.., chunks_mut(&mut store.amplitude[..lines * samples], samples)),
        &|(line, amplitudes)| {
            spread.factors(
                line,
                |half| &phases[half * samples..][..samples],
                |sample, _, factor| {
                    amplitudes[sample] *= factor;
                },
            );
        },
    );
}

fn rays<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let spread = Spread::<T>::new(tables);
    let columns = &mut store.effects.refraction;
    let phases = &columns.phases;
    for_each((0.., chunks_mut(&mut columns.curvatures, tables.samples())), &|(
        ray,
        curvatures,
    )| {
        spread.down_ray(tables, ray, phases, |sample, _, sum| curvatures[sample] = sum)
    });
}

fn mean<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let (lines, samples) = (tables.lines(), tables.samples());
    let spread = Spread::<T>::new(tables);
    let curvatures = &store.effects.refraction.curvatures;
    for_each(
        (0.., chunks_mut(&mut store.amplitude[..lines * samples], samples)),
        &|(line, amplitudes)| {
            T::vectorised(Scanline {
                tables,
                spread: &spread,
                curvatures,
                line,
                amplitudes,
            });
        },
    );
}

/// Looks at a scanline, averaged.
struct Scanline<'a, T> {
    tables: &'a Tables,
    spread: &'a Spread<T>,
    curvatures: &'a [T],
    line: usize,
    amplitudes: &'a mut [T],
}

impl<T: Real> Kernel for Scanline<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for (block, amplitudes) in self.amplitudes.chunks_mut(BLOCK).enumerate() {
            let (start, end) = (block * BLOCK, block * BLOCK + amplitudes.len());
            let (mut sum, mut count) = ([T::zero(); BLOCK], [T::zero(); BLOCK]);
            for look in 0..=steered(self.tables) {
                let (side, shifts) = shifts(self.tables, look);
                let (mut curvatures, mut present) = ([T::zero(); BLOCK], [T::zero(); BLOCK]);
                // Shifts change seldom down a scanline: the samples of one element are next to each other in memory.
                let mut from = start;
                while from < end {
                    let shift = shifts.map_or(0, |shifts| shifts[from]);
                    let alike = shifts.map_or(end - from, |shifts| {
                        shifts[from..end].iter().take_while(|other| **other == shift).count()
                    });
                    let element = self.line as i32 - side * shift;
                    if (0..self.tables.lines() as i32).contains(&element) {
                        let (first, after) = self.spread.place(element);
                        let row = |first: usize| {
                            let at = (look * self.spread.halves + first) * self.spread.samples;
                            &self.curvatures[at + from..][..alike]
                        };
                        let rows = row(first).iter().zip(row(first + 1));
                        let run = from - start..from - start + alike;
                        for (curvature, (near, far)) in curvatures[run.clone()].iter_mut().zip(rows) {
                            *curvature = *near + after * (*far - *near);
                        }
                        present[run].fill(T::one());
                    }
                    from += alike;
                }
                for i in 0..BLOCK {
                    sum[i] += present[i] * factor(curvatures[i]);
                    count[i] += present[i];
                }
            }
            for (amplitude, (sum, count)) in amplitudes.iter_mut().zip(sum.iter().zip(&count)) {
                *amplitude *= *sum / *count;
            }
        }
    }
}

/// Side of a look, the middle one first, and scanlines from its element to the samples; `None` of the middle one.
fn shifts(tables: &Tables, look: usize) -> (i32, Option<&[i32]>) {
    match look.checked_sub(1) {
        None => (0, None),
        Some(look) => {
            let (side, row) = shift_row(
                &tables.effects.refraction.shifts,
                tables.samples(),
                look,
                tables.samples(),
            );
            (side, Some(row))
        }
    }
}

/// Focusing and defocusing of the beams of a scene.
struct Spread<T> {
    halves: usize,
    samples: usize,
    /// Scanlines per half beam width.
    half: T,
    /// Position of the middle of the array among the scanlines and among the half beam widths.
    middles: [T; 2],
    unit: T,
    spacing: [T; 2],
    least: T,
    left: T,
}

impl<T: Real> Spread<T> {
    /// Creates the spread from the settings and the probe of a scene.
    fn new(tables: &Tables) -> Self {
        let derived = &tables.effects.refraction;
        Self {
            halves: derived.halves,
            samples: tables.samples(),
            half: T::of(derived.scanlines()),
            middles: [tables.lines(), derived.halves].map(|n| T::of(0.5 * (n as f64 - 1.0))),
            unit: T::of(unit(tables)),
            spacing: spacing(tables).map(T::of),
            least: T::of(least(tables)),
            left: T::of(fading(tables).exp2()),
        }
    }

    /// Calls `each` for every sample of a scanline with its number, a bound of its term of the sum and the factor on
    /// its amplitude. `phases` returns the cumulative phase of a half beam width. Scanlines at the sides use the
    /// nearest defined curvature.
    #[inline(always)]
    fn factors<'a>(&self, line: usize, phases: impl Fn(usize) -> &'a [u32], mut each: impl FnMut(usize, T, T)) {
        let (first, after) = self.place(line as i32);
        let [a, b, c, d] = std::array::from_fn(|point| phases(first + point - 1));
        let curvature = |a, b, c| T::from_signed(curvature(a, b, c));
        let mut sum = T::zero();
        for (sample, (((a, b), c), d)) in a.iter().zip(b).zip(c).zip(d).enumerate() {
            let (near, far) = (curvature(*a, *b, *c), curvature(*b, *c, *d));
            let scale = self.scale(sample);
            sum = sum * self.left + (near + after * (far - near)) * scale;
            each(sample, (near.abs() + far.abs()) * scale, factor(sum));
        }
    }

    /// Half beam width whose middle is before a scanline, and how far the scanline is after it, in half beam widths:
    /// between those with a curvature.
    #[inline(always)]
    fn place(&self, line: i32) -> (usize, T) {
        let position = (T::from_signed(line) - self.middles[0]) / self.half + self.middles[1];
        let first = position.truncate().clamp(1, self.halves as i32 - 3);
        let after = (position - T::from_signed(first)).max(T::zero()).min(T::one());
        (first as usize, after)
    }

    /// Term of the sum per unit of curvature.
    #[inline(always)]
    fn scale(&self, sample: usize) -> T {
        let depth = T::of(sample as f64);
        let distance = (self.half * (self.spacing[0] + self.spacing[1] * depth)).max(self.least);
        self.unit / (distance * distance)
    }

    /// Calls `each` for every sample of a ray with its number, a bound of its term of the sum and the sum. Rays are
    /// those of the half beam widths at the array, look by look; `phases` are those of all half beam widths.
    #[inline(always)]
    fn down_ray(&self, tables: &Tables, ray: usize, phases: &[u32], mut each: impl FnMut(usize, T, T)) {
        let (side, shifts) = shifts(tables, ray / self.halves);
        let per_part = (tables.effects.refraction.half / PARTS) as i32;
        let parts = PARTS as i32;
        let increment = |half: i32, sample: usize| {
            let down = &phases[half as usize * self.samples..];
            down[sample] - sample.checked_sub(1).map_or(0, |above| down[above])
        };
        let mut down_to = 0i32;
        let mut sum = T::zero();
        for sample in 0..self.samples {
            // A sixteenth of half a beam width is the step from place to place.
            let aside = side * shifts.map_or(0, |shifts| shifts[sample]) * SCANLINE as i32 / per_part;
            let position = (ray % self.halves) as i32 * parts + aside;
            let first = (position >> PARTS.ilog2()).clamp(1, self.halves as i32 - 3);
            let after = (position - first * parts).clamp(0, parts);
            let [a, b, c, d] = std::array::from_fn(|point| increment(first + point as i32 - 1, sample));
            let (near, far) = (curvature(a, b, c), curvature(b, c, d));
            down_to = down_to.saturating_add(near + ((far - near) >> PARTS.ilog2()) * after);
            let term = T::from_signed(down_to) * self.scale(sample);
            sum = sum * self.left + term;
            each(sample, term.abs(), sum);
        }
    }

    /// Factor of a look at a sample, from the element that its ray leaves.
    #[cfg(any(test, feature = "analysis"))]
    fn factor(&self, look: usize, element: i32, sample: usize, curvatures: &[T]) -> T {
        let (first, after) = self.place(element);
        let at = (look * self.halves + first) * self.samples + sample;
        let (near, far) = (curvatures[at], curvatures[at + self.samples]);
        factor(near + after * (far - near))
    }
}

/// Second difference of three phases.
#[inline(always)]
fn curvature(a: u32, b: u32, c: u32) -> i32 {
    (a as i32 - b as i32) - (b as i32 - c as i32)
}

/// Factor on the amplitude of an echo.
#[inline(always)]
fn factor<T: Real>(sum: T) -> T {
    (T::one() / (T::one() + sum).abs()).min(T::of(MAX))
}
