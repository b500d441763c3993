//! Shadow: attenuation and occlusion along the scanlines.
//!
//! Transmittance is a running product down each scanline, stored as a running sum of losses in fixed-point decibels, so
//! that it is the same for any grouping of the samples, on the CPU and in a parallel scan. A tissue contributes its
//! two-way attenuation `2 alpha f` and, if it occludes as bone and gas do, its occlusion per millimetre; the needle
//! contributes `needle_db_mm` where it fills the scan plane. Attenuation grows with frequency, so that a pulse feels
//! less of it the more has been lost (`downshift`). A sample is subject to the loss of everything above it and half its
//! own, so the sum converges to the Beer-Lambert law with the square of the sample distance. In tissues of different
//! losses a point is shaded from part of the aperture, so that edges of shadows widen with depth (`aperture`); they are
//! at least as soft as the beam is wide (`penumbra`), and a needle thinner than the beam shades its fraction of it. In
//! the shadow lie mirror images (`mirror`) and repeats (`reverberation`) of what is above it, and B-lines (`b_lines`).
//! Shadows of bone, air and the needle shaft by casting rays: Zhu et al. 2007, section 2.4.
//!
//! ```toml
//! effects.shadow = {}
//! ```

#[cfg(any(test, feature = "analysis"))]
pub(crate) mod bound;
#[cfg(test)]
mod parity;
#[cfg(test)]
mod physics;

use aperture::Aperture;
pub use downshift::Attenuation;
use downshift::{Downshift, felt};

pub use super::buffers::UNITS_PER_DB;
use super::buffers::{
    AMPLITUDE, AMPLITUDE_NEXT, Buffer, LABEL, LABEL_ROWS, LOSS, NEEDLE_MASK, POSITION, beam, bytes_of, columns,
};
use super::compound::{self, LOOKS_THROUGH, Steering};
use super::lateral::{BLOCK, LateralKernel};
use super::pass::{Band, Grid, ParamBlock, Pass, Use, Use::*, View, block, bound, reference};
use super::point_spread::PointSpread;
use super::tone::auto_gain::AutoGain;
use super::{
    Effect, EffectTables, OutOfRange, Parameters, Stage,
    Wanted::{self, No, Yes},
    common,
};
use crate::synth::SynthError;
use crate::synth::store::Store;
use crate::synth::tables::{Anatomy, Settings, Tables};
use insonify_anatomy::acoustics::{Tissue, TissueTable};
use insonify_base::parallel::{chunks, chunks_mut, for_each};
use insonify_base::range::{check, parameters};
use insonify_base::real::{Numbers, Real};
use insonify_base::simd::Kernel;
use insonify_tracking::probe::{BeamGrid, Transducer};

pub mod aperture;
pub(crate) mod b_lines;
pub mod downshift;
pub mod mirror;
pub mod penumbra;
pub mod reverberation;

parameters! {
    /// Attenuation and shadows.
    pub struct Shadow {
        /// Whether tissues attenuate.
        attenuation: bool = true;
        /// Whether bone, gas and the like occlude.
        occlusion: bool = true;
        /// Two-way loss in a needle as thick as the beam is wide, dB per mm of it along the beam; proportionally less
        /// for a thinner one.
        needle_db_mm: f64 = 8.0, in 0..=100;
        /// Full width at half maximum of the beam, mm, which is the least softness of shadow edges; 0 leaves them
        /// sharp. Default: by depth, the lateral length of the point spread; for the needle 3.
        #[serde(skip_serializing_if = "Option::is_none")]
        beam_mm: Option<f64>, in 0..=20;
        /// F-number on reception, 0.5 or more, by which the edges of shadows widen with depth; 0 casts shadows straight
        /// down the scanlines. Default: `receive_f_number` of the probe.
        #[serde(skip_serializing_if = "Option::is_none")]
        f_number: Option<f64>, in 0..=20;
        /// Amplitude of a repeated echo between the first bone, gas or lung of a scanline and the face of the array
        /// relative to the echo, before attenuation and for a perfect reflector. 0 disables repeats.
        reverberation: f64 = 0.45, in 0..=1;
        /// Share of the surface of lung and gas from which B-lines ring down, which belong to the tissue. 0 disables them.
        b_lines: f64 = 0.0, in 0..=1;
        /// Amplitude of the mirror image beyond gas or lung relative to the echo, before attenuation: two reflections
        /// at a slightly rough surface. Set by eye. 0 disables mirror images.
        mirror: f64 = 0.5, in 0..=1;
    }
}

/// One-way attenuation of average soft tissue, dB/cm/MHz, that scanners compensate for (Szabo, Diagnostic Ultrasound
/// Imaging, 2nd ed., 2014, appendix B).
pub const SOFT_TISSUE_DB_CM_MHZ: f64 = 0.5;

/// Maximum loss per sample, dB: two of them already exceed any dynamic range, and sums of two capped losses fit.
pub const MAX_PER_SAMPLE_DB: f64 = 256.0;

/// Saturation value of the running sum: 2^31 - 1 units, 2,048 dB.
pub(crate) const MAX_UNITS: u32 = 0x7fff_ffff;

/// Loss for an occlusion of 1 per mm, which would be infinite, dB per mm.
const FULL_OCCLUSION_DB_MM: f64 = 200.0;

impl Parameters for Shadow {
    fn check_others(&self) -> Result<(), OutOfRange> {
        let f_number = self.f_number.unwrap_or(0.0);
        let holds = f_number == 0.0 || f_number >= 0.5;
        check("f_number", f_number, holds, "0, or a number from 0.5 to 20")
    }
}

/// Width of the beam across the plane that a needle shades, if it is not stated, mm.
const BEAM_MM: f64 = 3.0;

impl Shadow {
    /// Width of the beam that a needle shades, mm.
    pub(crate) fn needle_beam_mm(&self) -> f64 {
        self.beam_mm.unwrap_or(BEAM_MM)
    }

    /// Two-way losses in a tissue at a frequency in MHz, dB/mm: by attenuation, and by occlusion.
    pub fn db_per_mm(&self, tissue: &Tissue, frequency_mhz: f64) -> [f64; 2] {
        let attenuation = 2.0 * tissue.attenuation_db_cm_mhz * frequency_mhz / 10.0;
        let occlusion = (-20.0 * (1.0 - tissue.occlusion_per_mm).log10()).min(FULL_OCCLUSION_DB_MM);
        [
            f64::from(u8::from(self.attenuation)) * attenuation,
            f64::from(u8::from(self.occlusion)) * occlusion,
        ]
    }
}

/// Loss over one sample in fixed-point units.
pub fn units(db: f64) -> u32 {
    (db.clamp(0.0, MAX_PER_SAMPLE_DB) * UNITS_PER_DB).round() as u32
}

/// Registry entry.
pub(crate) const EFFECT: Effect = Effect {
    name: "shadow",
    stage: Stage::Beam,
    example: "effects.shadow = {}",
    wanted,
    passes: |tables| {
        let [loss, rays] = if super::needle::present(tables) {
            [&TISSUE_AND_NEEDLE, &RAYS_AND_NEEDLE]
        } else {
            [&TISSUE, &RAYS]
        };
        let (mirrors, repeats) = (mirror::mirrors(tables), reverberation::repeats(tables));
        let looks = compound::are_shaded(tables);
        let passes = [
            (true, loss),
            (opens(tables), rays),
            (opens(tables), &APERTURE),
            (true, &PENUMBRA),
            (looks, &APERTURE_OF_LOOKS),
            (looks, &compound::SHADED),
            (finds_reflectors(tables), &FIND_REFLECTORS),
            (mirrors, &MIRROR),
            (repeats, &REVERBERATION),
            (b_lines::ring(tables), &B_LINES),
        ];
        passes
            .into_iter()
            .filter_map(|(runs, pass)| runs.then_some(pass))
            .collect()
    },
    needed_by: |_, pass| compound::needs(pass),
    buffers: &[
        &PENUMBRA_KERNEL,
        &APERTURE_SHIFTS,
        &APERTURE_WEIGHTS,
        &THROUGH,
        &REFLECTORS,
        &LEFT_OF_AVERAGE,
    ],
    label_row: Some(|_, derived, label, row| {
        [row.attenuation, row.loss] = derived.shadow.losses.get(label).copied().unwrap_or_default();
    }),
    // Rays of the aperture.
    extra_bytes: |settings, samples| {
        let shadow = settings.effects.shadow.as_ref();
        let opens = shadow.is_some_and(|shadow| shadow.f_number != Some(0.0));
        if opens {
            4 * (aperture::RAYS as u64 + 3) * samples
        } else {
            0
        }
    },
    remove: Some(|_, settings| settings.effects.shadow = None),
    ..Effect::PLAIN
};

/// Whether anything in the scene casts a shadow.
pub(super) fn runs(tables: &Tables) -> bool {
    tables.settings.effects.shadow.as_ref().is_some_and(|shadow| {
        let (losing, needle) = casting(tables, shadow);
        losing > 0 || needle
    })
}

/// Whether the first opaque sample of each scanline is needed: for repeats, mirror images and B-lines, and for automatic
/// gain, which measures what lies above.
pub(super) fn finds_reflectors(tables: &Tables) -> bool {
    let gained = AutoGain::of(tables).is_some() && reverberation::occludes(tables);
    let shown = mirror::mirrors(tables) || reverberation::repeats(tables) || b_lines::ring(tables);
    runs(tables) && (gained || shown)
}

/// Number of labels that lose, and whether the needle shades.
fn casting(tables: &Tables, shadow: &Shadow) -> (usize, bool) {
    let rows = tables.label_rows.iter().enumerate();
    let losing = rows
        .filter(|&(index, row)| row.loss > 0 && tables.volume.holds(index))
        .count();
    (losing, super::needle::present(tables) && shadow.needle_db_mm > 0.0)
}

/// Tables of the shadow; empty without one.
#[derive(Clone, Debug, Default)]
pub struct Derived {
    /// Per label index: losses over a sample, units: by attenuation, and all.
    pub losses: Vec<[u32; 2]>,
    /// Share of attenuation that is not felt, per unit of it, and units up to which that share grows.
    pub downshift: [f64; 2],
    /// Kernel of the beam.
    pub penumbra: Option<LateralKernel>,
    /// Rays of the aperture.
    pub aperture: Aperture,
    /// Amplitude that average soft tissue leaves, there and back, at each sample depth.
    pub left_of_average: Numbers,
}

/// Settings on which the tables depend.
pub(crate) type Key<'a> = (
    Option<&'a Shadow>,
    f64,
    &'a BeamGrid,
    &'a TissueTable,
    Transducer,
    Option<PointSpread>,
    Option<Steering>,
    Attenuation,
);

/// Takes parameters, frequency (MHz), grid, tissues, aperture, if the width of the beam is not stated the point spread,
/// the directions of the looks, and the attenuation of average soft tissue.
pub(crate) fn key<'a>(tissues: &'a TissueTable, settings: &'a Settings, grid: &'a BeamGrid) -> Key<'a> {
    let probe = &settings.probe;
    let shadow = settings.effects.shadow.as_ref();
    let spread = shadow.filter(|shadow| shadow.beam_mm.is_none()).map(|_| {
        let speckle = settings.effects.speckle.clone().unwrap_or_default();
        PointSpread::new(&speckle, probe, Attenuation::of(tissues, settings))
    });
    let steering = shadow.and_then(|_| Steering::of(settings, grid));
    (
        shadow,
        probe.frequency_mhz,
        grid,
        tissues,
        probe.transducer(),
        spread,
        steering,
        Attenuation::average(settings),
    )
}

/// Makes losses, kernel and aperture.
pub(crate) fn derive(
    anatomy: &Anatomy,
    (shadow, frequency_mhz, grid, tissues, transducer, spread, steering, average): &Key,
) -> Result<Derived, SynthError> {
    let Some(shadow) = shadow else {
        return Ok(Derived::default());
    };
    let loss = |label: usize| {
        let tissue = tissues.tissue(label as u8);
        let [attenuation, occlusion] = shadow.db_per_mm(tissue, *frequency_mhz);
        [attenuation, attenuation + occlusion].map(|db_mm| units(db_mm * grid.sample_spacing_mm()))
    };
    let aperture = Aperture::new(shadow, transducer, grid, steering.as_ref());
    let left = |sample: usize| {
        let lost_db = average.db_at(grid.sample_depth_mm(sample)).min(MAX_PER_SAMPLE_DB);
        10f64.powf(-lost_db / 20.0)
    };
    Ok(Derived {
        left_of_average: Numbers::new((0..grid.samples()).map(left).collect()),
        losses: (0..anatomy.volume.labels().len()).map(loss).collect(),
        penumbra: Some(shadow.kernel(spread.as_ref(), &aperture, grid)),
        downshift: Downshift::new(transducer.bandwidth).in_units(),
        aperture,
    })
}

/// Reach and weights of the beam, each a row over the depths (`f32`).
pub(super) static PENUMBRA_KERNEL: Buffer =
    Buffer::new(210, "PenumbraKernel", 4, |tables| weights(&tables.effects).len())
        .derived(|_, derived| bytes_of(weights(derived)));

fn weights(derived: &EffectTables) -> &[f32] {
    let kernel = derived.shadow.penumbra.as_ref();
    kernel.map_or(&[], |kernel| kernel.rows.of())
}

/// Data of [`Aperture::shifts`] (`i32`).
pub(super) static APERTURE_SHIFTS: Buffer = Buffer::new(250, "ApertureShifts", 4, |tables| {
    tables.effects.shadow.aperture.shifts.len()
})
.derived(|_, derived| bytes_of(&derived.shadow.aperture.shifts));

/// Data of [`Aperture::weights`] (`f32`).
static APERTURE_WEIGHTS: Buffer = Buffer::new(255, "ApertureWeights", 4, |tables| {
    tables.effects.shadow.aperture.weights.of::<f32>().len()
})
.derived(|_, derived| bytes_of(derived.shadow.aperture.weights.of::<f32>()));

/// Per ray, element and sample: one-way transmittance (`f32`).
static THROUGH: Buffer = Buffer::new(260, "Through", 4, rays_of_beam);

/// Per scanline: sample of the first opaque tissue, or the number of samples (`u32`).
pub(super) static REFLECTORS: Buffer = Buffer::new(270, "Reflectors", 4, Tables::lines);

/// Data of [`Derived::left_of_average`] (`f32`).
static LEFT_OF_AVERAGE: Buffer = Buffer::new(275, "LeftOfAverage", 4, |tables| {
    tables.effects.shadow.left_of_average.of::<f32>().len()
})
.derived(|_, derived| bytes_of(derived.shadow.left_of_average.of::<f32>()));

fn rays_of_beam(tables: &Tables) -> usize {
    tables.effects.shadow.aperture.rays() * beam(tables)
}

columns! {
    /// Vectors of the shadow.
    pub struct Columns<T> {
        /// Per ray, sample depth and scanline: what `THROUGH` holds.
        through: [T; rays_of_beam] = T::zero(), THROUGH;
        /// Losses by attenuation, then others, of each sample depth across the scanlines.
        losses: [u32; |tables| 2 * beam(tables)] = 0, THROUGH;
        /// Per ray: losses of the rays of all elements, by attenuation, then others, down to a sample.
        above: [u32; |tables| 2 * tables.effects.shadow.aperture.rays() * tables.lines()] = 0, THROUGH;
        /// Transmittances of each sample depth across the scanlines.
        across: [T; beam] = T::zero(), THROUGH;
        /// Data of `REFLECTORS`.
        reflectors: [u32; Tables::lines] = 0, REFLECTORS;
    }
}

const SHADER: &str = include_str!("../../../shaders/shadow.wgsl");

const TISSUE: Pass = loss_pass(
    "tissue",
    const {
        &[
            (&LABEL, ReadLine),
            (&LABEL_ROWS, Read),
            (&AMPLITUDE_NEXT, WriteLine),
            (&LOSS, WriteLine),
        ]
    },
);

const TISSUE_AND_NEEDLE: Pass = loss_pass(
    "tissue_and_needle",
    const {
        &[
            (&LABEL, ReadLine),
            (&LABEL_ROWS, Read),
            (&AMPLITUDE_NEXT, WriteLine),
            (&LOSS, WriteLine),
            (&NEEDLE_MASK, ReadLine),
        ]
    },
);

const RAYS: Pass = rays_pass(
    "rays",
    const {
        &[
            (&LABEL, Read),
            (&LABEL_ROWS, Read),
            (&APERTURE_SHIFTS, Read),
            (&THROUGH, Write),
        ]
    },
);

const RAYS_AND_NEEDLE: Pass = rays_pass(
    "rays_and_needle",
    const {
        &[
            (&LABEL, Read),
            (&LABEL_ROWS, Read),
            (&APERTURE_SHIFTS, Read),
            (&THROUGH, Write),
            (&NEEDLE_MASK, Read),
        ]
    },
);

/// Pass for the transmittance of the rays of the aperture.
const fn rays_pass(entry: &'static str, bindings: &'static [(&'static Buffer, Use)]) -> Pass {
    Pass {
        name: "shadow_rays",
        shader: SHADER,
        entry,
        bindings,
        params,
        grid: Grid::Workgroups(|tables| [tables.lines() as u32, tables.effects.shadow.aperture.rays() as u32]),
        flips: false,
        cpu: reference!(aperture::rays),
        bound: bound!(Covered("by the bound of `shadow`")),
    }
}

const APERTURE: Pass = Pass {
    name: "shadow_aperture",
    shader: SHADER,
    entry: "aperture",
    bindings: &[
        (&APERTURE_SHIFTS, Read),
        (&THROUGH, Read),
        (&AMPLITUDE_NEXT, WriteOwn),
        (&APERTURE_WEIGHTS, Read),
    ],
    params,
    grid: Grid::Samples,
    flips: false,
    cpu: reference!(aperture::mean),
    bound: bound!(Covered("by the bound of `shadow`")),
};

/// The means of the steered looks of `compound`.
const APERTURE_OF_LOOKS: Pass = Pass {
    name: "compound_aperture",
    entry: "aperture_of_looks",
    bindings: &[
        (&APERTURE_SHIFTS, Read),
        (&THROUGH, Read),
        (&LOOKS_THROUGH, WriteOwn),
        (&APERTURE_WEIGHTS, Read),
    ],
    grid: Grid::Looks(|tables| compound::steered(tables) * tables.lines()),
    cpu: reference!(aperture::means_of_looks),
    bound: bound!(Covered("by the bound of `compound`")),
    ..APERTURE
};

/// Whether shadows widen with depth: the scene has tissues of different losses, or a needle.
pub fn opens(tables: &Tables) -> bool {
    let Some(shadow) = &tables.settings.effects.shadow else {
        return false;
    };
    let mut rows = tables.label_rows.iter().enumerate();
    let mut losses = rows
        .by_ref()
        .filter(|(index, _)| tables.volume.holds(*index))
        .map(|(_, row)| row.loss);
    let differs = losses.next().is_some_and(|first| losses.any(|loss| loss != first));
    let needle = super::needle::present(tables) && shadow.needle_db_mm > 0.0;
    compound::steered(tables) > 0 || shadow.f_number != Some(0.0) && (differs || needle)
}

/// Pass for the loss down each scanline, and its one-way transmittance, which is stored in `AmplitudeNext`.
const fn loss_pass(entry: &'static str, bindings: &'static [(&'static Buffer, Use)]) -> Pass {
    Pass {
        name: "shadow_loss",
        shader: SHADER,
        entry,
        bindings,
        params,
        grid: Grid::Scanlines,
        flips: false,
        cpu: reference!(losses),
        bound: bound!(By(bound::carry_loss)),
    }
}

const PENUMBRA: Pass = Pass {
    name: "shadow",
    shader: SHADER,
    entry: "penumbra",
    bindings: &[
        (&LABEL, ReadOwn),
        (&LABEL_ROWS, Read),
        (&AMPLITUDE_NEXT, Read),
        (&PENUMBRA_KERNEL, Read),
        (&AMPLITUDE, WriteOwn),
    ],
    params,
    grid: Grid::Samples,
    flips: false,
    cpu: reference!(penumbra::run),
    bound: bound!(By(bound::carry)),
};

const FIND_REFLECTORS: Pass = Pass {
    name: "shadow_reflectors",
    shader: SHADER,
    entry: "reflectors",
    bindings: &[(&LABEL, ReadLine), (&LABEL_ROWS, Read), (&REFLECTORS, WriteLine)],
    params,
    grid: Grid::Scanlines,
    flips: false,
    cpu: reference!(reverberation::reflectors),
    bound: bound!(Covered("by the bounds of `shadow_mirror` and `shadow_reverberation`")),
};

const MIRROR: Pass = Pass {
    name: "shadow_mirror",
    shader: SHADER,
    entry: "mirror",
    bindings: &[
        (&REFLECTORS, Read),
        (&LOSS, ReadLine),
        (&AMPLITUDE, Read),
        (&LABEL, ReadLine),
        (&LABEL_ROWS, Read),
        (&AMPLITUDE_NEXT, WriteOwn),
    ],
    params,
    grid: Grid::Samples,
    flips: true,
    cpu: reference!(mirror::run),
    bound: bound!(By(bound::carry_mirror)),
};

const REVERBERATION: Pass = Pass {
    name: "shadow_reverberation",
    shader: SHADER,
    entry: "reverberation",
    bindings: &[
        (&REFLECTORS, Read),
        (&LEFT_OF_AVERAGE, Read),
        (&AMPLITUDE, WriteLine),
        (&LABEL, ReadLine),
        (&LABEL_ROWS, Read),
    ],
    params,
    grid: Grid::Samples,
    flips: false,
    cpu: reference!(reverberation::run),
    bound: bound!(By(bound::carry_reverberation)),
};

const B_LINES: Pass = Pass {
    name: "shadow_b_lines",
    shader: SHADER,
    entry: "b_lines",
    bindings: &[
        (&REFLECTORS, Read),
        (&LEFT_OF_AVERAGE, Read),
        (&AMPLITUDE, WriteOwn),
        (&LABEL, ReadLine),
        (&LABEL_ROWS, Read),
        (&LOSS, ReadLine),
        (&POSITION, ReadLine),
    ],
    params,
    grid: Grid::Samples,
    flips: false,
    cpu: reference!(b_lines::run),
    bound: bound!(By(bound::carry_b_lines)),
};

fn wanted(tables: &Tables) -> Wanted {
    let Some(shadow) = &tables.settings.effects.shadow else {
        return No("the scene names no shadow".into());
    };
    match casting(tables, shadow) {
        (0, false) => No("no tissue of the volume attenuates or occludes, and there is no needle".into()),
        (0, true) => Yes("the needle shades".into()),
        (n, true) => Yes(format!("{n} labels attenuate or occlude, and the needle shades")),
        (n, false) => Yes(format!("{n} labels attenuate or occlude")),
    }
}

block! {
    /// Parameter block of `shadow.wgsl`.
    struct ShadowParams {
        /// Scanlines.
        lines: u32,
        /// Samples along a scanline.
        samples: u32,
        /// Reach of the beam on each side, scanlines.
        reach: u32,
        /// Loss per sample above which a tissue is opaque, units.
        opaque_units: u32,
        /// Loss of a sample where the needle fills plane and beam, units.
        needle_units: f32,
        /// Base-2 exponent of the amplitude per unit of loss, one way; negative.
        exponent: f32,
        /// Amplitude of a repeated echo relative to the echo, before attenuation.
        reverberation: f32,
        /// Distance between scanlines at the array, in sample distances.
        spacing: f32,
        /// Growth of the distance between scanlines per sample, in sample distances.
        spreading: f32,
        /// Amplitude of a mirror image relative to the echo.
        mirror: f32,
        /// Share of attenuation that is not felt, per unit.
        unfelt: f32,
        /// Attenuation up to which that share grows, units.
        least_centre_at: f32,
        /// Number of rays on either side of the middle one of a look.
        side: u32,
        /// Rays from the middle one of a look to that of the next.
        to_next: u32,
        /// Number of rays on either side of the middle one of all.
        outermost: u32,
        /// Scanlines read to either side of one for the depth and tilt of its reflector.
        neighbours: u32,
        /// Seed of the lattice of B-lines.
        seed: [u32; 2],
        /// Points of that lattice per mm.
        per_mm: f32,
        /// Points of the lattice of their ripple per sample.
        per_sample: f32,
        /// Power on the lattice from which B-lines rise.
        threshold: f32,
        /// Strength of B-lines per power above it.
        steepness: f32,
        /// Amplitude of B-lines.
        ring: f32,
        /// Difference of depth up to which neighbours are of the same reflector, samples.
        rise: u32,
        /// Spread of repeats by bone: growth of the divisor of their amplitude per sample of depth.
        spread_per_sample: f32,
        /// Distance between those scanlines.
        apart: u32,
        /// Padding to a multiple of 16 bytes.
        unused: [u32; 2],
    }
}

fn params(view: &View, _: Band) -> ParamBlock {
    let tables = view.tables;
    let [spacing, spreading] = common::spacing(tables).map(|x| x as f32);
    let [unfelt, least_centre_at] = tables.effects.shadow.downshift.map(|number| number as f32);
    let aperture = &tables.effects.shadow.aperture;
    let b_lines = b_lines::BLines::<f32>::of(tables);
    let [neighbours, apart] = reverberation::side(tables);
    ParamBlock::of(&ShadowParams {
        lines: tables.lines() as u32,
        samples: tables.samples() as u32,
        reach: tables
            .effects
            .shadow
            .penumbra
            .as_ref()
            .map_or(0, |kernel| kernel.reach as u32),
        opaque_units: penumbra::opaque_units(tables.sample_mm()),
        needle_units: needle_units(tables),
        exponent: (0.5 * exponent_per_unit()) as f32,
        reverberation: reverberation::share(tables) as f32,
        spacing,
        spreading,
        mirror: mirror::share(tables) as f32,
        unfelt,
        least_centre_at,
        side: aperture.side as u32,
        to_next: aperture.to_next as u32,
        outermost: aperture.outermost as u32,
        neighbours: neighbours as u32,
        seed: b_lines.seed,
        per_mm: b_lines.per_mm,
        per_sample: b_lines.per_sample,
        threshold: b_lines.threshold,
        steepness: b_lines.steepness,
        ring: b_lines.ring,
        rise: reverberation::rise(tables),
        spread_per_sample: reverberation::spreading(tables) as f32,
        apart: apart as u32,
        unused: [0; 2],
    })
}

/// log2 of the amplitude factor of one unit of loss, both ways.
pub(crate) fn exponent_per_unit() -> f64 {
    -(10.0f64.log2()) / 20.0 / UNITS_PER_DB
}

/// Loss of a sample where a needle as thick as the beam is wide fills the scan plane, units. The needle pass computes
/// the fraction of the beam that is shaded.
pub(crate) fn needle_units(tables: &Tables) -> f32 {
    let shadow = tables.settings.effects.shadow.as_ref();
    units(shadow.map_or(0.0, |shadow| shadow.needle_db_mm) * tables.sample_mm()) as f32
}

/// Losses over a sample of each label, units: by attenuation, and others.
fn losses_of_labels(tables: &Tables) -> [[u32; 2]; 256] {
    std::array::from_fn(|label| {
        let row = tables.label_rows.get(label).copied().unwrap_or_default();
        [row.attenuation, row.loss - row.attenuation]
    })
}

fn losses<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let (lines, samples) = (tables.lines(), tables.samples());
    let losses = losses_of_labels(tables);
    let needle = super::needle::present(tables).then_some(T::of(f64::from(needle_units(tables))));
    let downshift = tables.effects.shadow.downshift.map(T::of);
    let mask = &store.needle_mask;
    for_each(
        (
            0..,
            chunks_mut(&mut store.amplitude_next[..lines * samples], samples),
            chunks(&store.label, samples),
            chunks_mut(&mut store.loss, samples),
        ),
        &|(line, through, labels, down_to)| {
            T::vectorised(Scanline {
                losses: &losses,
                needle: needle.map(|units| (units, &mask[line * samples..][..samples])),
                downshift,
                labels,
                down_to,
                through,
            });
        },
    );
}

/// Losses and one-way transmittances down a scanline.
struct Scanline<'a, T> {
    losses: &'a [[u32; 2]; 256],
    /// Units of loss, and share of the beam that is shaded.
    needle: Option<(T, &'a [[T; 2]])>,
    downshift: [T; 2],
    labels: &'a [u8],
    down_to: &'a mut [u32],
    through: &'a mut [T],
}

impl<T: Real> Kernel for Scanline<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let exponent = T::of(0.5 * exponent_per_unit());
        let mut sums = Sums::default();
        let out = self.down_to.chunks_mut(BLOCK).zip(self.through.chunks_mut(BLOCK));
        for (block, (down_to, through)) in out.enumerate() {
            let start = block * BLOCK;
            for (i, label) in self.labels[start..].iter().take(down_to.len()).enumerate() {
                let mut own = self.losses[usize::from(*label)];
                if let Some((units, mask)) = self.needle {
                    own[1] += shaded(mask[start + i], units);
                }
                sums.add(i, own);
            }
            let [attenuation, others] = &sums.down_to;
            for ((down_to, attenuation), other) in down_to.iter_mut().zip(attenuation).zip(others) {
                *down_to = felt([*attenuation, *other], self.downshift);
            }
            for (through, down_to) in through.iter_mut().zip(down_to) {
                *through = one_way(*down_to, exponent);
            }
        }
    }
}

/// Loss of a sample in the needle, units.
#[inline(always)]
fn shaded<T: Real>(mask: [T; 2], units: T) -> u32 {
    (mask[1] * units).to_u32().unwrap_or(0)
}

/// Losses down to the samples of a block: of attenuation, and others.
struct Sums {
    above: [u32; 2],
    down_to: [[u32; BLOCK]; 2],
}

impl Default for Sums {
    fn default() -> Self {
        Self {
            above: [0; 2],
            down_to: [[0; BLOCK]; 2],
        }
    }
}

impl Sums {
    /// Adds a sample's own losses, half of them down to its centre.
    #[inline(always)]
    fn add(&mut self, i: usize, own: [u32; 2]) {
        for kind in 0..2 {
            self.down_to[kind][i] = (self.above[kind] + own[kind] / 2).min(MAX_UNITS);
            self.above[kind] = (self.above[kind] + own[kind]).min(MAX_UNITS);
        }
    }
}

/// One-way transmittance of a loss, at most [`MAX_UNITS`].
#[inline(always)]
fn one_way<T: Real>(units: u32, exponent: T) -> T {
    (T::from_signed(units as i32) * exponent).fraction_of_two()
}

/// Amplitude factor of a loss.
#[inline(always)]
pub fn transmittance<T: Real>(units: u32) -> T {
    (T::of(f64::from(units)) * T::of(exponent_per_unit())).exp2()
}

#[cfg(test)]
mod tests;
