//! Compound: spatial compounding, frames of looks steered to either side and averaged after detection.
//!
//! The looks leave the array at angles evenly spaced from one outermost to the other; the middle one is the frame
//! without compounding. Scatterers are the same in all of them, met by waves of another direction: in a look at an
//! angle `a` their phase advances by `4 pi / lambda sin a` per mm along the array, before the point spread is applied. So
//! the speckle of two looks correlates as the closed form says, `|sum w^2 exp(i dk x)|^2` over the lateral kernel `w`
//! with the difference `dk` of the two rates (R. F. Wagner et al., IEEE Transactions on Ultrasonics, Ferroelectrics and
//! Frequency Control 35 (1988) 34), and the mean over standard deviation of their average grows with it (G. E. Trahey
//! et al., ibid. 33 (1986) 257). Losses are those of an aperture about the element from which the look comes: full
//! shadows end as triangles, and beyond them the share of looks counts that pass. Where a look's element lies beyond
//! the array, the others are averaged. Surfaces are met at the angle of the look: a plate tilted by the angle of a look
//! is brightest there.
//!
//! This takes less than to render every look whole: places, tissues and needles, the direction of speckle, mirror
//! images and repeats are those of the middle look, and paths as long as its. Behind an absorber and about a tilted
//! surface the mean amplitude is within 0.6 dB of that of looks rendered whole; without looks it is 2 dB off
//! (`tradeoff image`).
//!
//! ```toml
//! effects.compound = { looks = 5 }
//! ```

#[cfg(any(test, feature = "analysis"))]
pub(crate) mod bound;
#[cfg(test)]
mod parity;
#[cfg(test)]
mod physics;

use std::f64::consts::{PI, TAU};

use super::buffers::{AMPLITUDE, Buffer, LABEL, LABEL_ROWS, SPECULAR, beam, bytes_of, columns};
use super::lateral::BLOCK;
use super::pass::{Band, Grid, ParamBlock, Pass, Use, Use::*, View, block, bound, reference};
use super::shadow::aperture::Fan;
use super::shadow::penumbra::{are_opaque, cap_opaque, opaque_units};
use super::shadow::{self, APERTURE_SHIFTS, PENUMBRA_KERNEL};
use super::speckle::{AXIAL_KERNEL, SCATTER};
use super::{
    Effect, EffectTables, OutOfRange, Parameters, Scanner, Stage,
    Wanted::{self, No, Yes},
};
use crate::synth::SynthError;
use crate::synth::store::Store;
use crate::synth::tables::{Anatomy, Settings, Tables};
use insonify_anatomy::acoustics::TissueTable;
use insonify_base::parallel::{chunks, chunks_mut, for_each};
use insonify_base::range::{check, parameters};
use insonify_base::real::{Numbers, Real};
use insonify_base::simd::Kernel;
use insonify_tracking::probe::BeamGrid;

parameters! {
    /// Spatial compounding.
    pub struct Compound {
        /// Number of looks, odd.
        looks: u32 = 5, in 3..=9;
        /// Angle at which the outermost looks leave the array, degrees from its normal.
        angle_deg: f64 = 8.0, in 1..=20;
    }
}

impl Parameters for Compound {
    const USUAL: &[Scanner] = &[Scanner::Clinical];

    fn check_others(&self) -> Result<(), OutOfRange> {
        let holds = self.looks % 2 == 1;
        check("looks", f64::from(self.looks), holds, "an odd number from 3 to 9")
    }
}

/// Number of samples of a block of [`Columns::specular`].
pub(super) const SPECULAR_BLOCK: usize = 16;

/// Largest number of looks besides the middle one.
pub(crate) const MOST_STEERED: usize = 8;

/// Directions of the looks of a scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Steering {
    /// Number of looks on either side of the middle one.
    pub on_side: usize,
    /// Step from one look to the next along the array's fan: see [`Fan::ray`].
    pub step: f64,
    /// Phase that waves straight along the array gain between neighbouring scanlines, there and back, radians.
    along: f64,
    is_curved: bool,
}

impl Steering {
    /// Directions of the looks; `None` without compounding or if there is nothing to compound.
    pub(crate) fn of(settings: &Settings, grid: &BeamGrid) -> Option<Self> {
        let compound = settings
            .effects
            .compound
            .as_ref()
            .filter(|_| obstacle(settings, grid).is_none())?;
        let on_side = compound.looks as usize / 2;
        let angle = compound.angle_deg.to_radians();
        let is_curved = grid.virtual_apex_mm().is_some();
        let outermost = if is_curved { angle } else { angle.tan() };
        Some(Self {
            on_side,
            step: outermost / on_side as f64,
            along: 4.0 * PI / settings.probe.transducer().wavelength_mm * grid.lateral_spacing_mm(0.0),
            is_curved,
        })
    }

    /// Number of looks besides the middle one.
    pub(crate) fn steered(&self) -> usize {
        2 * self.on_side
    }

    /// Per number of steps to the side, from 0 on: scanlines from the element of a look to the sample, a row over the
    /// samples.
    pub(crate) fn shifts(&self, grid: &BeamGrid) -> Vec<i32> {
        let fan = Fan::of(grid);
        // Farther than the array is wide, no look comes from it.
        let widest = grid.lines() as f64;
        let row = |steps: usize| {
            let fan = &fan;
            let ray = steps as f64 * self.step;
            (0..grid.samples())
                .map(move |sample| fan.shift(ray, grid.sample_depth_mm(sample), grid).min(widest).round() as i32)
        };
        (0..=self.on_side).flat_map(row).collect()
    }

    /// Per number of steps to the side, from 1 on: cosine and sine of the angle between a look and the scanline at the
    /// sample, a row over the samples.
    pub(crate) fn directions(&self, grid: &BeamGrid) -> Vec<f64> {
        let fan = Fan::of(grid);
        let row = |steps: usize| {
            let fan = &fan;
            let ray = steps as f64 * self.step;
            (0..grid.samples()).flat_map(move |sample| {
                let (sine, cosine) = fan.angle(ray, grid.sample_depth_mm(sample)).sin_cos();
                [cosine, sine]
            })
        };
        (1..=self.on_side).flat_map(row).collect()
    }

    /// Phase that the scatterers of a look gain from one scanline to the next, of `oversampling` to a scanline,
    /// radians. Where scanlines are too far apart to tell the looks from one another, their phases are spread evenly.
    pub(crate) fn phase(&self, number: i32, oversampling: usize) -> f64 {
        let phase = |number: f64| {
            let ray = number * self.step;
            let sine = if self.is_curved { ray.sin() } else { ray.atan().sin() };
            self.along * sine / oversampling as f64
        };
        let apart = phase(self.on_side as f64) / self.on_side as f64;
        let even = TAU / (1 + self.steered()) as f64;
        phase(f64::from(number)) * (even / apart).min(1.0)
    }
}

/// Steps to the side of a look, given its index among those besides the middle one.
pub(crate) fn steps(look: usize) -> i32 {
    let away = (look / 2 + 1) as i32;
    if look.is_multiple_of(2) { -away } else { away }
}

/// Why a scene with compounding has nothing to compound.
pub(crate) fn obstacle(settings: &Settings, grid: &BeamGrid) -> Option<&'static str> {
    if settings.effects.speckle.is_none() {
        Some("the scene names no speckle")
    } else if grid.virtual_apex_mm() == Some(0.0) || grid.lines() == 1 {
        Some("all scanlines begin at one place, from which no other look comes")
    } else if grid.has_overlap() {
        Some("the scanlines go full circle")
    } else {
        None
    }
}

/// Registry entry.
pub(crate) const EFFECT: Effect = Effect {
    name: "compound",
    stage: Stage::Beam,
    example: "effects.compound = { looks = 5 }",
    wanted,
    passes: |tables| {
        if shadow::runs(tables) {
            // `shadow` has its pass, as mirror images and repeats follow.
            Vec::new()
        } else {
            vec![&UNSHADED]
        }
    },
    buffers: &[&LOOK_SHIFTS],
    remove: Some(|_, settings| settings.effects.compound = None),
    ..Effect::PLAIN
};

/// Tables of the looks; empty without compounding.
#[derive(Clone, Debug, Default)]
pub struct Derived {
    /// Number of looks besides the middle one.
    pub steered: usize,
    /// Per number of steps to the side, from 0 on: scanlines from the element of a look to the sample, a row over the
    /// samples.
    pub shifts: Vec<i32>,
}

/// Settings on which the looks depend.
pub(crate) type Key<'a> = (Option<Steering>, &'a BeamGrid);

/// Takes the directions and the grid.
pub(crate) fn key<'a>(_: &TissueTable, settings: &Settings, grid: &'a BeamGrid) -> Key<'a> {
    (Steering::of(settings, grid), grid)
}

/// Follows the middle of each look.
pub(crate) fn derive(_: &Anatomy, (steering, grid): &Key) -> Result<Derived, SynthError> {
    let Some(steering) = steering else {
        return Ok(Derived::default());
    };
    Ok(Derived {
        steered: steering.steered(),
        shifts: steering.shifts(grid),
    })
}

/// Whether the looks are shaded.
pub(super) fn are_shaded(tables: &Tables) -> bool {
    steered(tables) > 0 && shadow::runs(tables)
}

/// Side of a look, and scanlines from its element to the samples.
fn shifts(tables: &Tables, is_shaded: bool, look: usize) -> (i32, &[i32]) {
    let effects = &tables.effects;
    let (rows, to_next) = if is_shaded {
        (&effects.shadow.aperture.shifts, effects.shadow.aperture.to_next)
    } else {
        (&effects.compound.shifts, 1)
    };
    let samples = tables.samples();
    shift_row(&rows[..], to_next * samples, look, samples)
}

/// Side of a look, given its index among those besides the middle one, and its row of shifts: rows are `apart` from
/// look to look.
pub(super) fn shift_row(shifts: &[i32], apart: usize, look: usize, samples: usize) -> (i32, &[i32]) {
    let steps = steps(look);
    let row = steps.unsigned_abs() as usize * apart;
    (steps.signum(), &shifts[row..][..samples])
}

/// Whether the element of a look to a sample lies on the array.
#[cfg(any(test, feature = "analysis"))]
pub(crate) fn is_present(tables: &Tables, look: usize, [line, sample]: [usize; 2]) -> bool {
    let (side, shifts) = shifts(tables, are_shaded(tables), look);
    (0..tables.lines() as i32).contains(&(line as i32 - side * shifts[sample]))
}

/// Whether a pass among those of `speckle` and `shadow` is for the looks.
pub(super) fn needs(pass: &Pass) -> Option<&'static str> {
    pass.name.starts_with(EFFECT.name).then_some(EFFECT.name)
}

/// Number of looks besides the middle one.
pub(crate) fn steered(tables: &Tables) -> usize {
    tables.effects.compound.steered
}

fn fine_samples(tables: &Tables) -> usize {
    steered(tables) * super::speckle::fine_samples(tables)
}

fn beams(tables: &Tables) -> usize {
    steered(tables) * beam(tables)
}

/// Per look: its gains, a row over the samples; then per look and fine scanline cosine and sine of its phase (`f32`).
pub(super) static LOOK_PHASORS: Buffer = Buffer::new(163, "LookPhasors", 4, |tables| phasors(&tables.effects).len())
    .derived(|_, derived| bytes_of(phasors(derived)));

fn phasors(derived: &EffectTables) -> &[f32] {
    derived.speckle.as_ref().map_or(&[], |speckle| speckle.phasors.of())
}

/// Data of [`Derived::shifts`] (`i32`).
static LOOK_SHIFTS: Buffer = Buffer::new(264, "LookShifts", 4, |tables| tables.effects.compound.shifts.len())
    .derived(|_, derived| bytes_of(&derived.compound.shifts));

/// Per scanline, look and sample: by how much the complex echo of surfaces exceeds that of the middle look
/// (`vec2<f32>`).
pub(super) static LOOK_SPECULAR: Buffer = Buffer::new(153, "LookSpecular", 8, beams);

/// Per look, fine scanline and sample: complex echo (`vec2<f32>`).
pub(super) static LOOKS: Buffer = Buffer::new(161, "Looks", 8, fine_samples);

/// The same after the axial point spread (`vec2<f32>`).
pub(super) static LOOKS_AXIAL: Buffer = Buffer::new(171, "LooksAxial", 8, fine_samples);

/// Per look, scanline and sample: envelope (`f32`).
pub(super) static LOOK_ENVELOPES: Buffer = Buffer::new(191, "LookEnvelopes", 4, beams);

/// Per look, scanline and sample: one-way transmittance of the aperture (`f32`).
pub(super) static LOOKS_THROUGH: Buffer = Buffer::new(262, "LooksThrough", 4, beams);

columns! {
    /// Vectors of the looks.
    pub struct Columns<T> {
        /// Data of `LOOKS`: for each look and fine scanline its real parts, then its imaginary parts.
        looks: [T; |tables| 2 * fine_samples(tables)] = T::zero(), LOOKS;
        /// Data of `LOOKS_AXIAL`, likewise.
        axial: [T; |tables| 2 * fine_samples(tables)] = T::zero(), LOOKS_AXIAL;
        /// Data of `LOOK_SPECULAR` in the blocks of samples that have some.
        specular: [[T; 2]; beams] = [T::zero(); 2], LOOK_SPECULAR;
        /// Per scanline and block: whether `specular` holds data.
        has_specular: [bool; |tables| tables.lines() * tables.samples().div_ceil(SPECULAR_BLOCK)] = false, LOOK_SPECULAR;
        /// Data of `LOOK_ENVELOPES`.
        envelopes: [T; beams] = T::zero(), LOOK_ENVELOPES;
        /// Data of `LOOKS_THROUGH`.
        through: [T; beams] = T::zero(), LOOKS_THROUGH;
    }
}

const SHADER: &str = include_str!("../../../shaders/compound.wgsl");

/// Turns the scatterers of the steered looks.
pub(super) const ROTATE: Pass = rotation(
    "rotate",
    const { &[(&SCATTER, Read), (&LOOK_PHASORS, Read), (&LOOKS, WriteOwn)] },
);

/// The same with the echoes of needles.
pub(super) const ROTATE_SPECULAR: Pass = rotation(
    "rotate_specular",
    const {
        &[
            (&SCATTER, Read),
            (&LOOK_PHASORS, Read),
            (&LOOKS, WriteOwn),
            (&SPECULAR, Read),
            (&AXIAL_KERNEL, Read),
        ]
    },
);

/// The same with the echoes of surfaces, which each look meets at an angle of its own, and of needles.
pub(super) const ROTATE_SURFACES: Pass = rotation(
    "rotate_surfaces",
    const {
        &[
            (&SCATTER, Read),
            (&LOOK_PHASORS, Read),
            (&LOOKS, WriteOwn),
            (&SPECULAR, Read),
            (&AXIAL_KERNEL, Read),
            (&LOOK_SPECULAR, Read),
        ]
    },
);

const fn rotation(entry: &'static str, bindings: &'static [(&'static Buffer, Use)]) -> Pass {
    Pass {
        name: "compound_phase",
        shader: SHADER,
        entry,
        bindings,
        params,
        grid: Grid::FineLooks(|tables| steered(tables) * super::speckle::fine_lines(tables)),
        flips: false,
        cpu: reference!(rotate),
        bound: bound!(Covered("by the bound of `compound_lateral`")),
    }
}

/// Averages the looks, shaded.
pub(super) const SHADED: Pass = average(
    "shaded",
    const {
        &[
            (&LOOK_ENVELOPES, Read),
            (&APERTURE_SHIFTS, Read),
            (&AMPLITUDE, WriteOwn),
            (&LOOKS_THROUGH, Read),
            (&PENUMBRA_KERNEL, Read),
            (&LABEL, ReadOwn),
            (&LABEL_ROWS, Read),
        ]
    },
);

const UNSHADED: Pass = average(
    "unshaded",
    const { &[(&LOOK_ENVELOPES, Read), (&LOOK_SHIFTS, Read), (&AMPLITUDE, WriteOwn)] },
);

const fn average(entry: &'static str, bindings: &'static [(&'static Buffer, Use)]) -> Pass {
    Pass {
        name: "compound",
        shader: SHADER,
        entry,
        bindings,
        params,
        grid: Grid::Samples,
        flips: false,
        cpu: reference!(mean),
        bound: bound!(By(bound::carry)),
    }
}

fn wanted(tables: &Tables) -> Wanted {
    let Some(compound) = &tables.settings.effects.compound else {
        return No("the scene names no compounding".into());
    };
    match obstacle(&tables.settings, &tables.grid) {
        Some(obstacle) => No(obstacle.into()),
        None => Yes(format!(
            "{} looks up to {} degrees to either side are averaged",
            compound.looks, compound.angle_deg
        )),
    }
}

block! {
    /// Parameter block of `compound.wgsl`.
    struct CompoundParams {
        /// Scanlines.
        lines: u32,
        /// Samples along a scanline.
        samples: u32,
        /// Looks besides the middle one.
        steered: u32,
        /// Number of fine scanlines per scanline.
        oversampling: u32,
        /// Offset of the factors of surfaces in the axial kernel.
        specular_at: u32,
        /// Reach of the beam on each side, scanlines.
        reach: u32,
        /// Loss per sample above which a tissue is opaque, units.
        opaque_units: u32,
        /// Rows of the shifts from a look to the next.
        to_next: u32,
    }
}

fn params(view: &View, _: Band) -> ParamBlock {
    let tables = view.tables;
    let speckle = tables.effects.speckle.as_ref();
    let shadow::Derived { penumbra, aperture, .. } = &tables.effects.shadow;
    ParamBlock::of(&CompoundParams {
        lines: tables.lines() as u32,
        samples: tables.samples() as u32,
        steered: steered(tables) as u32,
        oversampling: speckle.map_or(1, |speckle| speckle.oversampling as u32),
        specular_at: speckle.map_or(0, |speckle| speckle.specular_at() as u32),
        reach: penumbra.as_ref().map_or(0, |kernel| kernel.reach as u32),
        opaque_units: opaque_units(tables.sample_mm()),
        to_next: if are_shaded(tables) { aperture.to_next as u32 } else { 1 },
    })
}

fn rotate<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let Some(speckle) = &tables.effects.speckle else { return };
    let (lines, samples) = (tables.lines(), tables.samples());
    let fine_lines = speckle.fine_lines(lines);
    let looks = steered(tables);
    let (gains, phasors) = speckle.phasors.of::<T>().split_at(looks * samples);
    let factors = speckle.specular.of::<T>();
    let specular = super::speckle::has_specular(tables).then_some(&store.specular);
    let scatter = &store.effects.speckle.scatter;
    let Columns {
        looks: rotated,
        specular: of_looks,
        has_specular,
        ..
    } = &mut store.effects.compound;
    let blocks = samples.div_ceil(SPECULAR_BLOCK);
    let nothing = [[T::zero(); 2]; SPECULAR_BLOCK];
    for_each((0.., chunks_mut(rotated, 2 * samples)), &|(row, echoes)| {
        let (look, fine) = (row / fine_lines, row % fine_lines);
        let [cosine, sine] = [phasors[2 * row], phasors[2 * row + 1]];
        let (re, im) = scatter[2 * fine * samples..][..2 * samples].split_at(samples);
        let (rotated_re, rotated_im) = echoes.split_at_mut(samples);
        let gains = &gains[look * samples..][..samples];
        let out = rotated_re.iter_mut().zip(rotated_im.iter_mut()).zip(gains);
        for (((rotated_re, rotated_im), gain), (re, im)) in out.zip(re.iter().zip(im)) {
            *rotated_re = *gain * (cosine * *re - sine * *im);
            *rotated_im = *gain * (sine * *re + cosine * *im);
        }
        let line = fine / speckle.oversampling;
        let next = (line + 1).min(lines - 1);
        let part = T::of((fine % speckle.oversampling) as f64 / speckle.oversampling as f64);
        let mut add = |start: usize, a: &[[T; 2]], b: &[[T; 2]]| {
            let out = rotated_re[start..].iter_mut().zip(&mut rotated_im[start..]);
            for (((re, im), factor), (a, b)) in out.zip(&factors[start..]).zip(a.iter().zip(b)) {
                *re += *factor * (a[0] + part * (b[0] - a[0]));
                *im += *factor * (a[1] + part * (b[1] - a[1]));
            }
        };
        if let Some(specular) = specular {
            let [a, b] = [line, next].map(|line| &specular[line * samples..][..samples]);
            add(0, a, b);
        }
        // Empty without surfaces.
        if of_looks.is_empty() {
            return;
        }
        for block in 0..blocks {
            let start = block * SPECULAR_BLOCK;
            let on_line = |line: usize| {
                let row = &of_looks[(line * looks + look) * samples..][..samples];
                has_specular[line * blocks + block].then(|| &row[start..samples.min(start + SPECULAR_BLOCK)])
            };
            match [line, next].map(on_line) {
                [None, None] => {}
                [a, b] => add(start, a.unwrap_or(&nothing), b.unwrap_or(&nothing)),
            }
        }
    });
}

fn mean<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let (lines, samples) = (tables.lines(), tables.samples());
    let is_opaque = are_opaque(tables);
    let columns = &store.effects.compound;
    let is_shaded = are_shaded(tables);
    for_each(
        (
            0..,
            chunks_mut(&mut store.amplitude[..lines * samples], samples),
            chunks(&store.label, samples),
        ),
        &|(line, amplitudes, labels)| {
            T::vectorised(Scanline {
                tables,
                columns,
                is_shaded,
                line,
                is_opaque: &is_opaque,
                labels,
                amplitudes,
            });
        },
    );
}

/// Looks at a scanline, averaged.
struct Scanline<'a, T> {
    tables: &'a Tables,
    columns: &'a Columns<T>,
    is_shaded: bool,
    line: usize,
    is_opaque: &'a [bool; 256],
    labels: &'a [u8],
    /// Of the middle look.
    amplitudes: &'a mut [T],
}

impl<T: Real> Kernel for Scanline<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let (lines, samples) = (self.tables.lines(), self.tables.samples());
        let penumbra = self.tables.effects.shadow.penumbra.as_ref();
        let penumbra = penumbra.filter(|_| self.is_shaded);
        for (block, amplitudes) in self.amplitudes.chunks_mut(BLOCK).enumerate() {
            let start = block * BLOCK;
            let mut sum = [T::zero(); BLOCK];
            let mut count = [T::one(); BLOCK];
            sum[..amplitudes.len()].copy_from_slice(amplitudes);
            for look in 0..steered(self.tables) {
                let (side, shifts) = shifts(self.tables, self.is_shaded, look);
                let place = look * lines * samples;
                let envelopes = &self.columns.envelopes[place + self.line * samples + start..][..amplitudes.len()];
                let mut left = [T::one(); BLOCK];
                if let Some(kernel) = penumbra {
                    let through = &self.columns.through[place..][..lines * samples];
                    let left = &mut left[..amplitudes.len()];
                    kernel.mean(through, [self.line, lines], start, left);
                    let on_line = &through[self.line * samples + start..];
                    cap_opaque(self.is_opaque, &self.labels[start..], on_line, left);
                }
                for (i, (envelope, shift)) in envelopes.iter().zip(&shifts[start..]).enumerate() {
                    let element = self.line as i32 - side * shift;
                    let is_present = (element >= 0) & (element < lines as i32);
                    sum[i] += if is_present {
                        *envelope * left[i] * left[i]
                    } else {
                        T::zero()
                    };
                    count[i] += if is_present { T::one() } else { T::zero() };
                }
            }
            for (amplitude, (sum, count)) in amplitudes.iter_mut().zip(sum.iter().zip(&count)) {
                *amplitude = *sum / *count;
            }
        }
    }
}

/// Gains of the looks and cosines and sines of their phases, from the mean power of a look at a sample relative to the middle one.
pub(super) fn gains_and_phasors(
    steering: &Steering,
    [samples, fine_lines, oversampling]: [usize; 3],
    power: impl Fn(usize, f64) -> f64,
) -> Numbers {
    let phase = |look: usize| steering.phase(steps(look), oversampling);
    let looks = || 0..steering.steered();
    let gains = looks().flat_map(|look| {
        let power = &power;
        (0..samples).map(move |sample| power(sample, phase(look)).max(LEAST_POWER).powf(-0.5))
    });
    let phasors = looks().flat_map(|look| {
        (0..fine_lines).flat_map(move |fine| {
            let (sine, cosine) = (phase(look) * fine as f64).sin_cos();
            [cosine, sine]
        })
    });
    Numbers::new(gains.chain(phasors).collect())
}

/// Least power of a look that is made up for: less is left of the scatterers, on a lattice too coarse for its waves.
const LEAST_POWER: f64 = 0.01;
