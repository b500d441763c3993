//! Complex echoes of the scatterers around each sample, gathered across the plane.

use super::BLOCK;
use super::tables::MAX_PLANES;
use crate::effects::common::{elevation, scatterers};
use crate::effects::pass::View;
use crate::synth::store::Store;
use insonify_base::parallel::{chunks_mut, for_each};
use insonify_base::random::seed_words;
use insonify_base::real::Real;
use insonify_base::simd::{Kernel, map};
use insonify_mesh::NO_ELEMENT;
use insonify_mesh::element::Carry;

pub(super) fn scatter<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let Some(speckle) = &tables.effects.speckle else { return };
    let (lines, samples) = (tables.lines(), tables.samples());
    let step = elevation(view.state).map(|x: T| x * T::of(speckle.plane_mm));
    let lattice = Lattice {
        seed: seed_words(tables.settings.seed),
        per_mm: T::of(1.0 / speckle.lattice_mm),
        planes: std::array::from_fn(|plane| T::of(speckle.planes.get(plane).copied().unwrap_or(0.0))),
        count: speckle.planes.len(),
    };
    let positions = &store.position[..lines * samples];
    let amplitudes = &store.amplitude[..lines * samples];
    let deformed = store
        .slab
        .as_ref()
        .map(|slab| (&slab.deformed.carries[..], &store.element[..]));
    // A fine scanline stores its real parts, then its imaginary parts.
    for_each(
        (0.., chunks_mut(&mut store.effects.speckle.scatter, 2 * samples)),
        &|(fine, echoes)| {
            let line = fine / speckle.oversampling;
            let part = T::of((fine % speckle.oversampling) as f64 / speckle.oversampling as f64);
            let next = (line + 1).min(lines - 1);
            // Amplitudes and elements change abruptly with the label: they are those of the nearer scanline, not
            // interpolated.
            let nearest = (line
                + usize::from(
                    2 * (fine % speckle.oversampling) >= speckle.oversampling && fine % speckle.oversampling > 0,
                ))
            .min(lines - 1);
            let (a, b) = (
                &positions[line * samples..][..samples],
                &positions[next * samples..][..samples],
            );
            let amplitudes = &amplitudes[nearest * samples..][..samples];
            let deformed = deformed.map(|(carries, elements)| (carries, &elements[nearest * samples..][..samples]));
            T::vectorised(FineScanline {
                lattice: &lattice,
                between: [a, b],
                part,
                step,
                deformed,
                amplitudes,
                echoes,
            });
        },
    );
}

/// Adds the echoes of surfaces and needles, interpolated linearly between scanlines and scaled to preserve those of
/// surfaces.
pub(super) fn add_specular<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let Some(speckle) = &tables.effects.speckle else { return };
    let (lines, samples) = (tables.lines(), tables.samples());
    let factors = speckle.specular.of::<T>();
    let specular = &store.specular;
    for_each(
        (0.., chunks_mut(&mut store.effects.speckle.scatter, 2 * samples)),
        &|(fine, echoes)| {
            let line = fine / speckle.oversampling;
            let part = T::of((fine % speckle.oversampling) as f64 / speckle.oversampling as f64);
            let row = |line: usize| &specular[line * samples..][..samples];
            let (re, im) = echoes.split_at_mut(samples);
            let between = row(line).iter().zip(row((line + 1).min(lines - 1)));
            for (i, (a, b)) in between.enumerate() {
                re[i] += factors[i] * (a[0] + part * (b[0] - a[0]));
                im[i] += factors[i] * (a[1] + part * (b[1] - a[1]));
            }
        },
    );
}

/// Echoes of one fine scanline between two scanlines: its real parts, then its imaginary parts.
struct FineScanline<'a, T> {
    lattice: &'a Lattice<T>,
    between: [&'a [[T; 4]]; 2],
    part: T,
    /// Step from one sub-plane to the next in the world, mm.
    step: [T; 3],
    /// Maps of the deformed elements to the reference state, and the slot of each sample of the nearest scanline.
    deformed: Option<(&'a [Carry<T>], &'a [u32])>,
    amplitudes: &'a [T],
    echoes: &'a mut [T],
}

impl<T: Real> Kernel for FineScanline<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self {
            lattice,
            between: [a, b],
            part,
            step,
            deformed,
            amplitudes,
            echoes,
        } = self;
        let samples = amplitudes.len();
        let (re, im) = echoes.split_at_mut(samples);
        for start in (0..samples).step_by(BLOCK) {
            let end = (start + BLOCK).min(samples);
            let mut middle = [[T::zero(); BLOCK]; 3];
            for axis in 0..3 {
                for i in start..end {
                    middle[axis][i - start] = a[i][axis] + part * (b[i][axis] - a[i][axis]);
                }
            }
            let mut steps = map(step, |step| [step; BLOCK]);
            // Sub-planes bend with the tissue: the step between them is that of the element in the reference state.
            if let Some((carries, elements)) = deformed {
                for (i, &slot) in elements[start..end]
                    .iter()
                    .enumerate()
                    .filter(|&(_, &slot)| slot != NO_ELEMENT)
                {
                    let [x, y, z] = step;
                    for (steps, row) in steps.iter_mut().zip(&carries[slot as usize]) {
                        steps[i] = row[0] * x + row[1] * y + row[2] * z;
                    }
                }
            }
            lattice.block(
                &middle,
                &steps,
                &amplitudes[start..end],
                &mut re[start..end],
                &mut im[start..end],
            );
        }
    }
}

/// Lattice of scatterers, gathered across the plane.
pub(super) struct Lattice<T> {
    /// Seed.
    pub seed: [u32; 2],
    /// Lattice points per mm.
    pub per_mm: T,
    /// Weights of the sub-planes.
    pub planes: [T; MAX_PLANES],
    /// Number of sub-planes.
    pub count: usize,
}

impl<T: Real> Lattice<T> {
    /// Complex echoes at up to [`BLOCK`] reference `positions` (mm), with `steps` (mm) from one sub-plane to the next.
    #[inline(always)]
    fn block(
        &self,
        positions: &[[T; BLOCK]; 3],
        steps: &[[T; BLOCK]; 3],
        amplitudes: &[T],
        re: &mut [T],
        im: &mut [T],
    ) {
        let (mut sum_re, mut sum_im) = ([T::zero(); BLOCK], [T::zero(); BLOCK]);
        let middle = T::of((self.count - 1) as f64 / 2.0);
        for plane in 0..self.count {
            let away = T::of(plane as f64) - middle;
            let mut p = [[T::zero(); BLOCK]; 3];
            for axis in 0..3 {
                for i in 0..BLOCK {
                    p[axis][i] = (positions[axis][i] + steps[axis][i] * away) * self.per_mm;
                }
            }
            let (a, b) = scatterers(&p, self.seed);
            for i in 0..BLOCK {
                sum_re[i] += self.planes[plane] * a[i];
                sum_im[i] += self.planes[plane] * b[i];
            }
        }
        for i in 0..amplitudes.len() {
            re[i] = amplitudes[i] * sum_re[i];
            im[i] = amplitudes[i] * sum_im[i];
        }
    }
}
