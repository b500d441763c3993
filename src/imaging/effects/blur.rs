//! Blur: a lateral Gaussian along arcs of constant depth, radial about the probe's virtual apex (Zhu et al. 2007,
//! section 2.4).
//!
//! In beam space an arc of constant depth is a row of samples, so the blur is an exact lateral convolution. At the
//! edges of the sector the weights are renormalised, so that a constant stays constant. The axial direction is not
//! blurred, and neither is the apex.
//!
//! ```toml
//! effects.blur = { width_mm = 2.5 }
//! ```

#[cfg(any(test, feature = "analysis"))]
pub(crate) mod bound;
#[cfg(test)]
mod parity;
#[cfg(test)]
mod physics;

use super::buffers::{AMPLITUDE, AMPLITUDE_NEXT, Buffer, bytes_of};
use super::lateral::{BLOCK, FWHM_PER_SIGMA, LateralKernel, narrowed};
use super::pass::{Band, Grid, ParamBlock, Pass, Use::*, View, block, bound, reference};
use super::{
    Effect, EffectTables, Parameters, Scanner, Stage,
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
    /// Radial blur.
    pub struct Blur {
        /// Full width at half maximum at the array, mm. Default: 2.1 mm over the frequency in MHz.
        width_mm: Option<f64>, in 0..=20;
        /// Growth of that width with depth, mm per cm. Default: 0.21 mm/cm over the frequency in MHz.
        growth_mm_cm: Option<f64>, in 0..=5;
    }
}

impl Parameters for Blur {
    // What moves the beam sideways is part of the point spread: a mean of envelopes evens speckle out.
    const USUAL: &[Scanner] = &[];
}

impl Blur {
    /// Full width at half maximum at a depth, mm: by default 0.6 mm and 0.06 mm/cm at 3.5 MHz, in proportion to the
    /// wavelength.
    pub fn width_at(&self, depth_mm: f64, frequency_mhz: f64) -> f64 {
        let width = self.width_mm.unwrap_or((2.1 / frequency_mhz).min(20.0));
        width + self.growth_mm_cm.unwrap_or((0.21 / frequency_mhz).min(5.0)) * depth_mm / 10.0
    }

    /// Kernel with the weights at each sample depth.
    pub fn kernel(&self, grid: &BeamGrid, frequency_mhz: f64) -> LateralKernel {
        let sigma_lines = |sample: usize| {
            let depth = grid.sample_depth_mm(sample);
            self.width_at(depth, frequency_mhz) / FWHM_PER_SIGMA / grid.lateral_spacing_mm(depth).max(1e-6)
        };
        LateralKernel::gaussian(grid.samples(), sigma_lines, |_, _| 1.0)
    }
}

/// Registry entry.
pub(crate) const EFFECT: Effect = Effect {
    name: "blur",
    stage: Stage::Beam,
    example: "effects.blur = { width_mm = 2.5 }",
    wanted,
    passes: |_| PASSES.iter().collect(),
    buffers: &[&BLUR_KERNEL],
    warnings: |tables| {
        let kernel = tables.effects.blur.as_ref();
        let share = kernel.map_or(1.0, |kernel| kernel.least_share);
        let settings = &tables.settings;
        let is_stated = settings
            .effects
            .blur
            .as_ref()
            .is_some_and(|blur| blur.width_mm.is_some());
        narrowed("effects.blur.width_mm", is_stated, share, "scanlines", &settings.probe)
            .into_iter()
            .collect()
    },
    remove: Some(|_, settings| settings.effects.blur = None),
    ..Effect::PLAIN
};

/// Kernel of the blur.
pub(crate) type Derived = Option<LateralKernel>;

/// Settings on which the kernel depends.
pub(crate) type Key<'a> = (Option<&'a Blur>, f64, &'a BeamGrid);

/// Takes parameters, frequency (MHz) and grid.
pub(crate) fn key<'a>(_: &TissueTable, settings: &'a Settings, grid: &'a BeamGrid) -> Key<'a> {
    (settings.effects.blur.as_ref(), settings.probe.frequency_mhz, grid)
}

/// Makes the kernel.
pub(crate) fn derive(_: &Anatomy, &(blur, frequency_mhz, grid): &Key) -> Result<Derived, SynthError> {
    Ok(blur.map(|blur| blur.kernel(grid, frequency_mhz)))
}

/// Reach and weights of the blur, each a row over the depths (`f32`).
static BLUR_KERNEL: Buffer = Buffer::new(200, "BlurKernel", 4, |tables| weights(&tables.effects).len())
    .derived(|_, derived| bytes_of(weights(derived)));

fn weights(derived: &EffectTables) -> &[f32] {
    derived.blur.as_ref().map_or(&[], |kernel| kernel.rows.of())
}

static PASSES: &[Pass] = &[Pass {
    name: "blur",
    shader: include_str!("../../../shaders/blur.wgsl"),
    entry: "main",
    bindings: &[(&AMPLITUDE, Read), (&BLUR_KERNEL, Read), (&AMPLITUDE_NEXT, WriteOwn)],
    params,
    grid: Grid::Samples,
    flips: true,
    cpu: reference!(run),
    bound: bound!(By(bound::carry)),
}];

fn wanted(tables: &Tables) -> Wanted {
    match &tables.settings.effects.blur {
        Some(blur) if tables.lines() > 1 => Yes(format!(
            "the scene blurs laterally by {:.2} mm and more with depth",
            blur.width_at(0.0, tables.settings.probe.frequency_mhz)
        )),
        Some(_) => No("one scanline has no neighbours to blur with".into()),
        None => No("the scene names no blur".into()),
    }
}

block! {
    /// Parameter block of `blur.wgsl`.
    struct BlurParams {
        /// Scanlines.
        lines: u32,
        /// Samples along a scanline.
        samples: u32,
        /// Largest reach of the kernel on each side, scanlines.
        reach: u32,
        /// Padding to a multiple of 16 bytes.
        unused: u32,
    }
}

fn params(view: &View, _: Band) -> ParamBlock {
    let tables = view.tables;
    ParamBlock::of(&BlurParams {
        lines: tables.lines() as u32,
        samples: tables.samples() as u32,
        reach: tables.effects.blur.as_ref().map_or(0, |kernel| kernel.reach as u32),
        unused: 0,
    })
}

fn run<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let (lines, samples) = (tables.lines(), tables.samples());
    let Some(kernel) = &tables.effects.blur else { return };
    let input = &store.amplitude[..lines * samples];
    for_each(
        (0.., chunks_mut(&mut store.amplitude_next[..lines * samples], samples)),
        &|(line, output)| {
            T::vectorised(Scanline {
                kernel,
                input,
                line_and_count: [line, lines],
                output,
            });
        },
    );
}

/// A blurred scanline.
struct Scanline<'a, T> {
    kernel: &'a LateralKernel,
    input: &'a [T],
    /// Index of the scanline, and number of scanlines.
    line_and_count: [usize; 2],
    output: &'a mut [T],
}

impl<T: Real> Kernel for Scanline<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for (block, output) in self.output.chunks_mut(BLOCK).enumerate() {
            self.kernel.mean(self.input, self.line_and_count, block * BLOCK, output);
        }
    }
}
