//! Speckle: fully developed, anchored in the tissue.
//!
//! Space is filled with a cubic lattice of scatterers in the tissue's *reference* state, starting at the local origin
//! ([`crate::synth::LocalOrigin`]), each a complex random number from a hash of its lattice point. A sample
//! interpolates the eight around its reference position, weighted by its echo amplitude; the point spread of the probe
//! is then applied in the beam frame as a separable convolution: across the plane (sub-planes of the same sample),
//! along the beam, and across scanlines with a width that follows the focus. The envelope is the modulus. Sums of
//! independent complex numbers make the amplitude Rayleigh distributed (mean over standard deviation 1.91; Wagner et
//! al., IEEE Trans. Sonics Ultrason. 30(3), 1983), and since the lattice lies in the reference state the pattern moves
//! with the tissue. Zhu et al. 2007 approximate this speckle model by noise.
//!
//! Kernels are scaled so that the mean power of an echo is the square of its amplitude.
//!
//! ```toml
//! effects.speckle = {}
//! ```

#[cfg(any(test, feature = "analysis"))]
pub(crate) mod bound;
mod elevation;
#[cfg(test)]
mod parity;
#[cfg(test)]
mod physics;
mod power;
mod scatter;
mod spread;
mod tables;

use glam::Vec4;

use scatter::{add_specular, scatter};
use spread::{axial, axial_of_looks, lateral, lateral_of_looks};
pub use tables::SpeckleTables;

use super::buffers::{AMPLITUDE, Buffer, ELEMENT, ELEMENT_MAPS, POSITION, SPECULAR, bytes_of, columns};
use super::common::elevation;
use super::compound::{self, LOOK_ENVELOPES, LOOK_PHASORS, LOOKS, LOOKS_AXIAL, Steering};
use super::lateral::narrowed;
use super::pass::{Band, Grid, ParamBlock, Pass, Use, Use::*, View, block, bound, reference};
use super::point_spread::{Attenuation, PointSpread};
use super::{
    Effect, EffectTables, Parameters, Scanner, Stage,
    Wanted::{self, No, Yes},
    needle,
};
use crate::synth::SynthError;
use crate::synth::tables::{Anatomy, Settings, Tables};
use insonify_anatomy::acoustics::TissueTable;
use insonify_base::random::seed_words;
use insonify_base::range::parameters;
use insonify_tracking::probe::{BeamGrid, ProbeKind};

parameters! {
    /// Fully developed speckle. Lengths are full widths at half maximum of the autocorrelation of the echo intensity,
    /// as measured on a frame. Defaults depend on the probe ([`super::point_spread`]).
    pub struct Speckle {
        /// Axial length, mm. Default: that of the received pulse, 0.64 mm over bandwidth and frequency in MHz, and no
        /// less than two samples.
        axial_mm: Option<f64>, in 0.05..=10;
        /// Share of the centre frequency that the receiver's filter passes: full width at half maximum of its amplitude.
        /// Default: 0.4 with `scanner = "clinical"` and a linear probe, otherwise no filter.
        receive_bandwidth: Option<f64>, in 0.05..=1.5;
        /// Lateral length at the focus, mm. Default: at every depth the length that follows from the apertures of the
        /// probe.
        lateral_mm: Option<f64>, in 0.05..=20;
        /// Elevational length, mm, at most 4 times the shortest of the three lengths. Default: that of the probe at the
        /// focus of its lens, at most 1.8 times the shortest.
        elevational_mm: Option<f64>, in 0.05..=20;
        /// Depth of the lateral focus, mm. Default: the transmit focus of the probe.
        focus_mm: Option<f64>, in 0..=1000;
        /// Distance from the focus at which the lateral length has grown by sqrt 2, mm: the Rayleigh length of a
        /// Gaussian beam. Default, where `lateral_mm` is stated: 175 mm over the frequency in MHz.
        focal_zone_mm: Option<f64>, in 1..=10000;
    }
}

/// Filter of scanners: with it and speckle reduction the axial length is that of frames of muscle and vessels.
const RECEIVE_BANDWIDTH: f64 = 0.4;

impl Parameters for Speckle {
    fn fill(&mut self, scanner: Scanner, kind: ProbeKind) {
        if (scanner, kind) == (Scanner::Clinical, ProbeKind::Linear) {
            self.receive_bandwidth.get_or_insert(RECEIVE_BANDWIDTH);
        }
    }
}

/// Registry entry.
pub(crate) const EFFECT: Effect = Effect {
    name: "speckle",
    stage: Stage::Speckle,
    example: "effects.speckle = {}",
    wanted,
    passes: |tables| {
        let (is_specular, looks) = (has_specular(tables), compound::steered(tables) > 0);
        let has_surfaces = tables.settings.effects.interface.is_some();
        let passes = [
            (tables.anatomy.mesh.is_none(), &GATHER),
            (tables.anatomy.mesh.is_some(), &GATHER_WARPED),
            (looks && !is_specular, &compound::ROTATE),
            (looks && is_specular && !has_surfaces, &compound::ROTATE_SPECULAR),
            (looks && has_surfaces, &compound::ROTATE_SURFACES),
            (looks, &AXIAL_OF_LOOKS),
            (looks, &LATERAL_OF_LOOKS),
            (is_specular, &ADD_SPECULAR),
            (true, &AXIAL),
            (true, &LATERAL),
        ];
        passes
            .into_iter()
            .filter_map(|(runs, pass)| runs.then_some(pass))
            .collect()
    },
    needed_by: |tables, pass| {
        let has_surfaces = tables.settings.effects.interface.is_some();
        let specular = if has_surfaces { "interface" } else { "needle" };
        let is_specular = pass.name == ADD_SPECULAR.name;
        is_specular.then_some(specular).or_else(|| compound::needs(pass))
    },
    buffers: &[&SCATTER, &SCATTER_AXIAL, &AXIAL_KERNEL, &LATERAL_KERNEL, &LOOK_PHASORS],
    warnings: |tables| {
        let Some(speckle) = &tables.effects.speckle else {
            return Vec::new();
        };
        let stated = tables.settings.effects.speckle.as_ref();
        let [axial, lateral] = [
            (
                "axial_mm",
                stated.and_then(|stated| stated.axial_mm),
                speckle.axial_share,
                "samples",
            ),
            (
                "lateral_mm",
                stated.and_then(|stated| stated.lateral_mm),
                speckle.lateral.least_share,
                "scanlines",
            ),
        ]
        .map(|(key, length, share, finer)| {
            let key = format!("effects.speckle.{key}");
            narrowed(&key, length.is_some(), share, finer, &tables.settings.probe)
        });
        axial.into_iter().chain(lateral).collect()
    },
    remove: Some(|_, settings| settings.effects.speckle = None),
    ..Effect::PLAIN
};

/// Lattice and kernels of the speckle.
pub(crate) type Derived = Option<SpeckleTables>;

/// Settings on which lattice and kernels depend.
pub(crate) type Key<'a> = (Option<PointSpread>, &'a BeamGrid, Option<Steering>);

/// Takes point spread, grid and the directions of the looks.
pub(crate) fn key<'a>(tissues: &TissueTable, settings: &Settings, grid: &'a BeamGrid) -> Key<'a> {
    let speckle = settings.effects.speckle.as_ref();
    let attenuation = || Attenuation::of(tissues, settings);
    (
        speckle.map(|speckle| PointSpread::new(speckle, &settings.probe, attenuation())),
        grid,
        Steering::of(settings, grid),
    )
}

/// Makes the lattice and the kernels.
pub(crate) fn derive(_: &Anatomy, (spread, grid, steering): &Key) -> Result<Derived, SynthError> {
    let speckle = spread
        .clone()
        .map(|spread| SpeckleTables::new(spread, grid, steering.as_ref()));
    Ok(speckle)
}

/// Per fine scanline and sample: complex echo (`vec2<f32>`).
pub(super) static SCATTER: Buffer = Buffer::new(160, "Scatter", 8, fine_samples);

/// Complex echo after the axial point spread (`vec2<f32>`).
static SCATTER_AXIAL: Buffer = Buffer::new(170, "ScatterAxial", 8, fine_samples);

/// Weights of the axial point spread, a row for each band of depth, then two factors per sample (`f32`).
pub(super) static AXIAL_KERNEL: Buffer =
    Buffer::new(180, "AxialKernel", 4, |tables| axial_kernel(&tables.effects).len())
        .derived(|_, derived| bytes_of(&axial_kernel(derived)));

/// Reach and weights of the lateral point spread, each a row over the depths, then factors of the outermost scanlines
/// (`f32`).
static LATERAL_KERNEL: Buffer = Buffer::new(190, "LateralKernel", 4, |tables| lateral_kernel(&tables.effects).len())
    .derived(|_, derived| bytes_of(&lateral_kernel(derived)));

fn axial_kernel(derived: &EffectTables) -> Vec<f32> {
    derived.speckle.as_ref().map_or(Vec::new(), |speckle| {
        [speckle.axial.of::<f32>(), speckle.ends.of(), speckle.specular.of()].concat()
    })
}

fn lateral_kernel(derived: &EffectTables) -> Vec<f32> {
    derived.speckle.as_ref().map_or(Vec::new(), |speckle| {
        [speckle.lateral.rows.of::<f32>(), speckle.edges.of()].concat()
    })
}

pub(super) fn fine_samples(tables: &Tables) -> usize {
    fine_lines(tables) * tables.samples()
}

columns! {
    /// Vectors of the speckle.
    pub struct Columns<T> {
        /// Data of `SCATTER`: for each fine scanline its real parts, then its imaginary parts.
        scatter: [T; |tables| 2 * fine_samples(tables)] = T::zero(), SCATTER;
        /// Data of `SCATTER_AXIAL`: for each fine scanline its real parts, then its imaginary parts.
        scatter_axial: [T; |tables| 2 * fine_samples(tables)] = T::zero(), SCATTER_AXIAL;
    }
}

const SHADER: &str = include_str!("../../../shaders/speckle.wgsl");

/// Whether the scene has echoes of surfaces or needles.
pub(super) fn has_specular(tables: &Tables) -> bool {
    tables.settings.effects.interface.is_some() || needle::present(tables)
}

const GATHER: Pass = scatter_pass(
    "scatter_pass",
    const { &[(&POSITION, Read), (&AMPLITUDE, Read), (&SCATTER, WriteOwn)] },
);

/// Scatter pass for a deforming mesh, whose sub-planes bend with the tissue.
const GATHER_WARPED: Pass = scatter_pass(
    "warped_scatter_pass",
    const {
        &[
            (&POSITION, Read),
            (&AMPLITUDE, Read),
            (&SCATTER, WriteOwn),
            (&ELEMENT, Read),
            (&ELEMENT_MAPS, Read),
        ]
    },
);

const fn scatter_pass(entry: &'static str, bindings: &'static [(&'static Buffer, Use)]) -> Pass {
    Pass {
        name: "speckle_scatter",
        shader: SHADER,
        entry,
        bindings,
        params,
        grid: Grid::FineSamples(fine_lines),
        flips: false,
        cpu: reference!(scatter),
        bound: bound!(Covered("by the bound of `speckle_lateral`")),
    }
}

/// Adds the echoes of surfaces and needles to those of the scatterers.
const ADD_SPECULAR: Pass = Pass {
    name: "speckle_specular",
    shader: SHADER,
    entry: "specular_pass",
    bindings: &[(&SPECULAR, Read), (&AXIAL_KERNEL, Read), (&SCATTER, WriteOwn)],
    params,
    grid: Grid::FineSamples(fine_lines),
    flips: false,
    cpu: reference!(add_specular),
    bound: bound!(Covered("by the bound of `speckle_lateral`")),
};

const AXIAL: Pass = Pass {
    name: "speckle_axial",
    shader: SHADER,
    entry: "axial_pass",
    bindings: &[(&SCATTER, ReadLine), (&AXIAL_KERNEL, Read), (&SCATTER_AXIAL, WriteOwn)],
    params,
    grid: Grid::FineSamples(fine_lines),
    flips: false,
    cpu: reference!(axial),
    bound: bound!(Covered("by the bound of `speckle_lateral`")),
};

/// The axial point spread of the steered looks.
const AXIAL_OF_LOOKS: Pass = Pass {
    name: "compound_axial",
    bindings: &[(&LOOKS, ReadLine), (&AXIAL_KERNEL, Read), (&LOOKS_AXIAL, WriteOwn)],
    grid: Grid::FineLooks(|tables| compound::steered(tables) * fine_lines(tables)),
    cpu: reference!(axial_of_looks),
    bound: bound!(Covered("by the bound of `compound_lateral`")),
    ..AXIAL
};

/// Their lateral point spread and envelopes.
const LATERAL_OF_LOOKS: Pass = Pass {
    name: "compound_lateral",
    bindings: &[
        (&LOOKS_AXIAL, Read),
        (&LATERAL_KERNEL, Read),
        (&LOOK_ENVELOPES, WriteOwn),
    ],
    grid: Grid::Looks(|tables| compound::steered(tables) * tables.lines()),
    cpu: reference!(lateral_of_looks),
    bound: bound!(By(bound::carry_looks)),
    ..LATERAL
};

const LATERAL: Pass = Pass {
    name: "speckle_lateral",
    shader: SHADER,
    entry: "lateral_pass",
    bindings: &[(&SCATTER_AXIAL, Read), (&LATERAL_KERNEL, Read), (&AMPLITUDE, WriteOwn)],
    params,
    grid: Grid::Samples,
    flips: false,
    cpu: reference!(lateral),
    bound: bound!(By(bound::carry)),
};

pub(super) fn fine_lines(tables: &Tables) -> usize {
    tables
        .effects
        .speckle
        .as_ref()
        .map_or(1, |speckle| speckle.fine_lines(tables.lines()))
}

fn wanted(tables: &Tables) -> Wanted {
    match (&tables.settings.effects.speckle, &tables.effects.speckle) {
        (Some(_), Some(derived)) => {
            let spread = &derived.spread;
            let longer = spread.samples_for_pulse.map(|samples| {
                format!(" (a sample is longer than half of the pulse; probe.samples = {samples} shows it whole)")
            });
            let grid = &tables.grid;
            let apart = (0..tables.samples())
                .map(|sample| grid.sample_depth_mm(sample))
                .map(|depth_mm| grid.lateral_spacing_mm(depth_mm) / spread.lateral_at(depth_mm))
                .fold(0.0, f64::max);
            let wider = (apart > 0.5).then(|| {
                let lines = (2.0 * apart * (tables.lines() - 1) as f64).ceil() + 1.0;
                format!(" (scanlines are more than half of the beam apart; probe.lines = {lines} shows it whole)")
            });
            Yes(format!(
                "speckle of {:.2} by {:.2} by {:.2} mm{}{}: lattice {:.2} mm, {} sub-planes, {} fine scanlines to one",
                spread.axial_mm,
                spread.lateral_mm,
                spread.elevational_mm,
                longer.unwrap_or_default(),
                wider.unwrap_or_default(),
                derived.lattice_mm,
                derived.planes.len(),
                derived.oversampling
            ))
        }
        _ => No("the scene names no speckle".into()),
    }
}

block! {
    /// Parameter block of `speckle.wgsl`.
    struct SpeckleParams {
        /// Out-of-plane direction in the world; the fourth component is unused.
        elevation: Vec4,
        /// Weights of the sub-planes.
        planes: [Vec4; 2],
        /// Seed.
        seed: [u32; 2],
        /// Scanlines.
        lines: u32,
        /// Samples along a scanline.
        samples: u32,
        /// Number of fine scanlines per scanline.
        oversampling: u32,
        /// Number of sub-planes.
        plane_count: u32,
        /// Distance between sub-planes, mm.
        plane_mm: f32,
        /// Lattice points per mm.
        per_mm: f32,
        /// Reach of the axial kernel on each side, samples.
        axial_reach: u32,
        /// Largest reach of the lateral kernel on each side, fine scanlines.
        lateral_reach: u32,
        /// Offset of the world-to-reference maps of the deformed elements, in vec4.
        carries_at: u32,
        /// Number of bands of depth, each with its own row of axial weights.
        bands: u32,
    }
}

fn params(view: &View, _: Band) -> ParamBlock {
    let tables = view.tables;
    let Some(speckle) = &tables.effects.speckle else {
        return ParamBlock::of::<SpeckleParams>(&bytemuck::Zeroable::zeroed());
    };
    let [x, y, z] = elevation::<f32>(view.state);
    let plane = |i: usize| speckle.planes.get(i).map_or(0.0, |&weight| weight as f32);
    ParamBlock::of(&SpeckleParams {
        elevation: Vec4::new(x, y, z, 0.0),
        planes: [0, 4].map(|first| Vec4::new(plane(first), plane(first + 1), plane(first + 2), plane(first + 3))),
        seed: seed_words(tables.settings.seed),
        lines: tables.lines() as u32,
        samples: tables.samples() as u32,
        oversampling: speckle.oversampling as u32,
        plane_count: speckle.planes.len() as u32,
        plane_mm: speckle.plane_mm as f32,
        per_mm: (1.0 / speckle.lattice_mm) as f32,
        axial_reach: speckle.axial_reach() as u32,
        lateral_reach: speckle.lateral.reach as u32,
        carries_at: view.slab.map_or(0, |slab| slab.maps_at[2]),
        bands: speckle.bands as u32,
    })
}

/// Number of samples processed together, so that the inner loops run in vector registers.
const BLOCK: usize = 64;
