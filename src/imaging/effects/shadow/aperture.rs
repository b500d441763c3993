//! Aperture: what loses more than its surroundings shades a point from only part of the aperture, so that the edges of
//! its shadow widen with depth.
//!
//! [`RAYS`] straight rays run from elements of the array to each point. Each stands for the elements around its own: on
//! reception for their weights over the aperture of the f-number at that depth, on transmission for their share of the
//! aperture of the transmit focus. The echo is multiplied by the mean transmittance on either way, the root of whose
//! product is the one-way transmittance that `penumbra` takes (O. Mattausch and O. Goksel, Eurographics Workshop on
//! Visual Computing for Biology and Medicine, 2016, cast rays over an aperture at random). The angle at which a ray
//! leaves the array does not change with the point, so that the losses down one ray serve all points on it: they are
//! accumulated in one scan per element and angle. Elements beyond the ends of the array are ignored. Rays to a phased
//! array, whose scanlines all begin at one element, are told apart by their distance from it, and counted by where they
//! leave the image. Beside the image tissue is as at its edge.

use std::ops::Range;

use super::{Shadow, Sums, exponent_per_unit, needle_units, one_way, shaded};
use crate::effects::lateral::BLOCK;
use crate::effects::pass::View;
use crate::synth::store::Store;
use insonify_base::parallel::{chunks_mut, for_each};
use insonify_base::real::{Numbers, Real};
use insonify_base::simd::Kernel;
use insonify_tracking::probe::{Apodisation, BeamGrid, Transducer};

/// Number of rays to a point, the middle one down its scanline. With nine, penumbrae of the table in `physics.rs` are
/// within 12 % of those of a continuous aperture, with seven within 22 %.
pub const RAYS: usize = 9;
/// Number of rays to either side.
const SIDE: usize = RAYS / 2;

/// Share of the weights on reception that the rays stand for; those farthest from the middle weigh little.
const SPANNED: f64 = 0.96;

/// Depth of what typically casts shadows, over that of the image: behind it the steps between the shades of
/// neighbouring rays are smoothed out.
const CROSSING: f64 = 0.25;

/// Largest angle between a ray and the surface normal of the array, radians.
const STEEPEST: f64 = 1.2;

/// Rays of the aperture to the points of a grid; empty if shadows do not widen.
#[derive(Clone, Debug, Default)]
pub struct Aperture {
    /// Per distance from the middle ray, a row over the samples: scanlines that a ray crosses down to there.
    pub shifts: Vec<i32>,
    /// Per distance from the middle ray, a row over the samples each for transmission and reception: weight of the ray.
    pub weights: Numbers,
    /// Per sample: scanlines between neighbouring rays that crossed at [`CROSSING`].
    pub apart: Vec<f64>,
    /// Per distance from the middle ray: ranges of samples on which a ray stays on a scanline, none across [`BLOCK`]s.
    runs: Vec<Vec<Range<usize>>>,
}

/// Courses of the rays between the array and a depth.
struct Fan {
    /// Radius of the array, mm: 0 of a phased one, `None` if scanlines are parallel.
    radius_mm: Option<f64>,
}

impl Fan {
    /// Ray from an element: the tangent of its angle; of a curved array the angle, of a phased one the element.
    fn ray(&self, element_mm: f64, depth_mm: f64) -> f64 {
        match self.radius_mm {
            None => element_mm / depth_mm,
            Some(0.0) => element_mm,
            Some(radius_mm) => {
                let (sin, cos) = (element_mm / radius_mm).min(std::f64::consts::PI).sin_cos();
                let apex_mm = radius_mm + depth_mm;
                (apex_mm * sin).atan2(apex_mm * cos - radius_mm).min(STEEPEST)
            }
        }
    }

    /// Element of a ray to a depth: distance along the array from the scanline of the point there, mm.
    fn element_mm(&self, ray: f64, depth_mm: f64) -> f64 {
        match self.radius_mm {
            None => ray * depth_mm,
            Some(0.0) => ray,
            Some(radius_mm) => radius_mm * (ray - (radius_mm * ray.sin() / (radius_mm + depth_mm)).asin()),
        }
    }

    /// Scanlines that a ray has crossed at a depth since it left the array; to a phased one, less those to the end of
    /// the image.
    fn shift(&self, ray: f64, depth_mm: f64, grid: &BeamGrid) -> f64 {
        if self.radius_mm != Some(0.0) {
            return self.element_mm(ray, depth_mm) / grid.lateral_spacing_mm(0.0);
        }
        let angle = |depth_mm: f64| (ray / depth_mm).min(1.0).asin();
        (angle(grid.depth_mm()) - angle(depth_mm)) / grid.lateral_spacing_mm(1.0)
    }
}

/// Share of the weights within a distance from the middle of an aperture, in halves of it.
struct Cumulative(Vec<f64>);

impl Cumulative {
    const STEPS: usize = 256;

    fn new(apodisation: Apodisation) -> Self {
        let step = 1.0 / Self::STEPS as f64;
        let weight = |index: usize| apodisation.weight((index as f64 + 0.5) * step);
        let total: f64 = (0..Self::STEPS).map(weight).sum();
        let sums = (0..Self::STEPS).scan(0.0, |sum, index| {
            *sum += weight(index) / total;
            Some(*sum)
        });
        Self([0.0].into_iter().chain(sums).collect())
    }

    fn within(&self, distance: f64) -> f64 {
        let at = distance.clamp(0.0, 1.0) * Self::STEPS as f64;
        let before = (at as usize).min(Self::STEPS - 1);
        self.0[before] + (at - before as f64) * (self.0[before + 1] - self.0[before])
    }

    fn distance(&self, share: f64) -> f64 {
        self.0.partition_point(|within| *within < share) as f64 / Self::STEPS as f64
    }
}

impl Aperture {
    /// Rays from the aperture of a transducer, with the f-number on reception of the shadow if it states one.
    pub fn new(shadow: &Shadow, transducer: &Transducer, grid: &BeamGrid) -> Self {
        let f_number = shadow.f_number.unwrap_or(transducer.receive_f_number);
        if f_number == 0.0 {
            return Self::default();
        }
        let fan = Fan {
            radius_mm: grid.virtual_apex_mm(),
        };
        let largest = 0.5 * transducer.aperture_mm;
        let half_element = 0.5 * transducer.element_mm;
        let receive = |depth_mm: f64| (0.5 * depth_mm / f_number).max(half_element);
        let transmit_mm = transducer.transmit_focus_mm / transducer.transmit_f_number;
        let transmit = (0.5 * transmit_mm).max(half_element).min(largest);
        let weights = Cumulative::new(transducer.apodisation);
        // Near the array, where shadows are as narrow as what casts them, apertures of every depth would do.
        let spanned = weights.distance(SPANNED);
        let edge = |step: u32| {
            let depth_mm = grid.depth_mm() * f64::from(step) / 32.0;
            fan.ray((spanned * receive(depth_mm)).min(largest), depth_mm)
        };
        let step = (8..=32).map(edge).fold(0.0, f64::max) / (0.5 * RAYS as f64);
        let samples = grid.samples();
        let shifts = (0..=SIDE).flat_map(|ray| {
            let fan = &fan;
            (0..samples)
                .map(move |sample| fan.shift(ray as f64 * step, grid.sample_depth_mm(sample), grid).round() as i32)
        });
        let shifts: Vec<i32> = shifts.collect();
        let mut rows = vec![0.0; 2 * (SIDE + 1) * samples];
        for sample in 0..samples {
            let depth_mm = grid.sample_depth_mm(sample);
            // Weights of the elements up to those halfway to the next ray.
            let up_to = |ray: usize| {
                let element_mm = fan.element_mm((ray as f64 + 0.5) * step, depth_mm).min(largest);
                [
                    element_mm.min(transmit) / transmit,
                    weights.within(element_mm / receive(depth_mm)),
                ]
            };
            let all = up_to(SIDE);
            for ray in 0..=SIDE {
                let (to, from) = (up_to(ray), ray.checked_sub(1).map_or([0.0; 2], up_to));
                for way in 0..2 {
                    let on_either_side = if ray == 0 { 1.0 } else { 0.5 };
                    rows[(2 * ray + way) * samples + sample] = on_either_side * (to[way] - from[way]) / all[way];
                }
            }
        }
        let runs = shifts.chunks(samples).map(|row| {
            let mut runs: Vec<Range<usize>> = Vec::new();
            for (sample, shift) in row.iter().enumerate() {
                match runs.last_mut() {
                    Some(run) if row[run.start] == *shift && sample % BLOCK > 0 => run.end += 1,
                    _ => runs.push(sample..sample + 1),
                }
            }
            runs
        });
        let shift = |depth_mm: f64| fan.shift(step, depth_mm, grid);
        let crossing_mm = CROSSING * grid.depth_mm();
        let apart = |sample: usize| shift(grid.sample_depth_mm(sample).max(crossing_mm)) - shift(crossing_mm);
        Self {
            runs: runs.collect(),
            weights: Numbers::new(rows),
            apart: (0..samples).map(apart).collect(),
            shifts,
        }
    }

    /// Scanline of an element's ray at a sample; beside the image the next in it.
    pub(crate) fn line_at(&self, [ray, element, sample]: [usize; 3], lines: usize) -> usize {
        let line = element as i64 + self.shift(ray, sample);
        line.clamp(0, lines as i64 - 1) as usize
    }

    /// Element whose ray crosses a scanline at a sample; `None` beyond the array.
    pub(crate) fn element_at(&self, [ray, line, sample]: [usize; 3], lines: usize) -> Option<usize> {
        let element = line as i64 - self.shift(ray, sample);
        (0..lines as i64).contains(&element).then_some(element as usize)
    }

    fn shift(&self, ray: usize, sample: usize) -> i64 {
        let samples = self.apart.len();
        let shift = i64::from(self.shifts[ray.abs_diff(SIDE) * samples + sample]);
        if ray < SIDE { -shift } else { shift }
    }

    /// Weights of a ray at the samples, on transmission and on reception.
    pub(crate) fn weights<T: Real>(&self, ray: usize) -> [&[T]; 2] {
        let samples = self.apart.len();
        let rows = &self.weights.of::<T>()[2 * ray.abs_diff(SIDE) * samples..];
        [&rows[..samples], &rows[samples..2 * samples]]
    }

    /// Runs of a ray in the block that begins at a sample.
    fn runs(&self, ray: usize, start: usize) -> impl Iterator<Item = &Range<usize>> {
        let runs = &self.runs[ray.abs_diff(SIDE)];
        let first = runs.partition_point(|run| run.start < start);
        runs[first..].iter().take_while(move |run| run.start < start + BLOCK)
    }
}

/// One-way transmittance of each ray of each element, down to each sample.
pub(super) fn rays<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let (lines, samples) = (tables.lines(), tables.samples());
    let losses = super::losses_of_labels(tables);
    let downshift = tables.effects.shadow.downshift.map(T::of);
    let needle = crate::effects::needle::present(tables).then_some(T::of(f64::from(needle_units(tables))));
    let (labels, mask) = (&store.label, &store.needle_mask);
    let rows = chunks_mut(&mut store.effects.shadow.through, samples);
    for_each((0.., rows), &|(row, through)| {
        T::vectorised(Ray {
            aperture: &tables.effects.shadow.aperture,
            ray_and_element: [row / lines, row % lines],
            lines,
            losses: &losses,
            needle,
            downshift,
            labels,
            mask,
            through,
        });
    });
}

/// A ray of an element.
struct Ray<'a, T> {
    aperture: &'a Aperture,
    ray_and_element: [usize; 2],
    lines: usize,
    losses: &'a [[u32; 2]; 256],
    needle: Option<T>,
    downshift: [T; 2],
    labels: &'a [u8],
    mask: &'a [[T; 2]],
    through: &'a mut [T],
}

impl<T: Real> Kernel for Ray<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let samples = self.through.len();
        let [ray, element] = self.ray_and_element;
        let exponent = T::of(0.5 * exponent_per_unit());
        let mut sums = Sums::default();
        for (block, through) in self.through.chunks_mut(BLOCK).enumerate() {
            let start = block * BLOCK;
            for run in self.aperture.runs(ray, start) {
                let line = self.aperture.line_at([ray, element, run.start], self.lines);
                let place = line * samples + run.start..line * samples + run.end;
                let labels = (run.start - start..).zip(&self.labels[place.clone()]);
                match self.needle {
                    None => labels.for_each(|(i, label)| sums.add(i, self.losses[usize::from(*label)])),
                    Some(units) => labels.zip(&self.mask[place]).for_each(|((i, label), mask)| {
                        let [attenuation, other] = self.losses[usize::from(*label)];
                        sums.add(i, [attenuation, other + shaded(*mask, units)]);
                    }),
                }
            }
            for (i, through) in through.iter_mut().enumerate() {
                *through = one_way(sums.felt(i, self.downshift), exponent);
            }
        }
    }
}

/// One-way transmittance of each sample: the root of the product of the means on the way there and back.
pub(super) fn mean<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let (lines, samples) = (tables.lines(), tables.samples());
    let through = &store.effects.shadow.through;
    let scanlines = chunks_mut(&mut store.amplitude_next[..lines * samples], samples);
    for_each((0.., scanlines), &|(line, left)| {
        T::vectorised(Mean {
            aperture: &tables.effects.shadow.aperture,
            line_and_count: [line, lines],
            through,
            left,
        });
    });
}

/// The means of a scanline.
struct Mean<'a, T> {
    aperture: &'a Aperture,
    line_and_count: [usize; 2],
    through: &'a [T],
    left: &'a mut [T],
}

impl<T: Real> Kernel for Mean<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let samples = self.left.len();
        let [line, lines] = self.line_and_count;
        for (block, left) in self.left.chunks_mut(BLOCK).enumerate() {
            let start = block * BLOCK;
            let mut there = [T::zero(); BLOCK];
            let mut back = [T::zero(); BLOCK];
            let mut missing = [[T::zero(); BLOCK]; 2];
            for ray in 0..RAYS {
                let [transmit, receive] = self.aperture.weights::<T>(ray);
                for run in self.aperture.runs(ray, start) {
                    let (transmit, receive) = (&transmit[run.clone()], &receive[run.clone()]);
                    let first = run.start - start;
                    if let Some(element) = self.aperture.element_at([ray, line, run.start], lines) {
                        let through = &self.through[(ray * lines + element) * samples..][run.clone()];
                        let sums = there[first..].iter_mut().zip(&mut back[first..]);
                        for (((there, back), through), (to, from)) in
                            sums.zip(through).zip(transmit.iter().zip(receive))
                        {
                            *there += *to * *through;
                            *back += *from * *through;
                        }
                    } else {
                        for (missing, weights) in missing.iter_mut().zip([transmit, receive]) {
                            for (missing, weight) in missing[first..].iter_mut().zip(weights) {
                                *missing += *weight;
                            }
                        }
                    }
                }
            }
            for (i, left) in left.iter_mut().enumerate() {
                let present = (T::one() - missing[0][i]) * (T::one() - missing[1][i]);
                *left = (there[i] * back[i] / present).sqrt();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insonify_tracking::probe::{Curvilinear, Linear, Phased, Probe, ProbeShape};

    fn aperture(shape: ProbeShape) -> (Aperture, BeamGrid) {
        let mut probe = Probe::new(shape, 60.0).expect("a probe");
        (probe.lines, probe.samples) = (101, 300);
        let grid = BeamGrid::new(&probe).expect("a grid");
        (Aperture::new(&Shadow::default(), &probe.transducer(), &grid), grid)
    }

    #[test]
    fn rays_lean_by_the_aperture_and_find_their_elements_again() {
        let (aperture, grid) = aperture(ProbeShape::Linear(Linear { width_mm: 50.0 }));
        let lines = grid.lines();
        // At 40 mm 0.705 of the 13.3 mm of f/1.5 to either side, in 4.5 steps; scanlines are half a millimetre apart.
        let sample = 200;
        let element = |ray: usize, line: usize, sample: usize| aperture.element_at([ray, line, sample], lines);
        assert_eq!(element(0, 50, sample), Some(67));
        for ray in 0..RAYS {
            let element = element(ray, 50, sample).expect("an element");
            assert_eq!(aperture.line_at([ray, element, sample], lines), 50);
            assert_eq!(aperture.line_at([ray, element, 0], lines), element);
        }
        assert_eq!([element(0, 95, sample), element(RAYS - 1, 5, sample)], [None; 2]);
        // Every place of a ray's row is in one run, on one scanline.
        for ray in 0..RAYS {
            let runs = (0..300).step_by(BLOCK).flat_map(|start| aperture.runs(ray, start));
            let places: Vec<usize> = runs
                .inspect(|run| assert_eq!(aperture.shift(ray, run.start), aperture.shift(ray, run.end - 1)))
                .flat_map(Clone::clone)
                .collect();
            assert_eq!(places, (0..300).collect::<Vec<_>>());
        }
    }

    /// Distance of the scanlines that a ray crosses from the straight line between its ends.
    #[test]
    fn rays_are_straight_under_every_array() {
        for shape in [
            ProbeShape::Linear(Linear { width_mm: 60.0 }),
            ProbeShape::Curvilinear(Curvilinear {
                radius_mm: 40.0,
                angle_deg: 80.0,
            }),
            ProbeShape::Phased(Phased { angle_deg: 90.0 }),
        ] {
            let (aperture, grid) = aperture(shape);
            let place = |sample: usize| {
                let line = aperture.line_at([RAYS - 2, 50, sample], grid.lines());
                grid.to_plane(line as f64, sample as f64)
            };
            let (start, end) = (100, 299);
            let [a, b] = [start, end].map(place);
            let length = (b[0] - a[0]).hypot(b[1] - a[1]);
            for sample in start..end {
                let p = place(sample);
                let aside = ((p[0] - a[0]) * (b[1] - a[1]) - (p[1] - a[1]) * (b[0] - a[0])) / length;
                // Half a scanline at each of three places.
                let rounded = 1.2 * grid.lateral_spacing_mm(60.0);
                assert!(aside.abs() < rounded, "{shape:?}: {aside} mm aside at sample {sample}");
            }
        }
    }

    #[test]
    fn weights_add_up_and_transmission_takes_fewer_rays_with_depth() {
        let (aperture, grid) = aperture(ProbeShape::Linear(Linear { width_mm: 50.0 }));
        for sample in 0..grid.samples() {
            let sum = |way: usize| {
                (0..RAYS)
                    .map(|ray| aperture.weights::<f64>(ray)[way][sample])
                    .sum::<f64>()
            };
            assert!((sum(0) - 1.0).abs() < 1e-12 && (sum(1) - 1.0).abs() < 1e-12, "{sample}");
        }
        let taken = |sample: usize| {
            (0..RAYS)
                .filter(|ray| aperture.weights::<f64>(*ray)[0][sample] > 0.0)
                .count()
        };
        assert_eq!([taken(20), taken(299)], [RAYS, 5]);
    }
}
