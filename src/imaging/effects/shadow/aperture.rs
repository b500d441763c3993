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
//!
//! The steered looks of `compound` have the same aperture about other elements, and so rays at angles farther out.

use std::ops::Range;

use super::downshift::felt;
use super::{Columns, MAX_UNITS, Shadow, exponent_per_unit, needle_units, one_way, shaded};
use crate::effects::compound::{Steering, steered, steps};
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
/// Number of them to either side.
const SIDE: usize = RAYS / 2;

/// Share of the weights on reception that the rays stand for; those farthest from the middle weigh little.
const SPANNED: f64 = 0.96;

/// Depth of what typically casts shadows, over that of the image: behind it the steps between the shades of
/// neighbouring rays are smoothed out.
const CROSSING: f64 = 0.25;

/// Least product of the weights that are present by which is divided.
pub(crate) const LEAST_PRESENT: f64 = 1e-12;

/// Largest angle between a ray and the surface normal of the array, radians.
const STEEPEST: f64 = 1.2;

/// Rays of the aperture to the points of a grid; empty if shadows do not widen.
#[derive(Clone, Debug, Default)]
pub struct Aperture {
    /// Number of rays on either side of the middle one of a look.
    pub side: usize,
    /// Rays from the middle one of a look to that of the next.
    pub to_next: usize,
    /// Number of rays on either side of the middle one of all.
    pub outermost: usize,
    /// Per distance from the middle ray, a row over the samples: scanlines that a ray crosses down to there.
    pub shifts: Vec<i32>,
    /// Per distance from the middle ray, a row over the samples each for transmission and reception: weight of the ray.
    pub weights: Numbers,
    /// Per sample: scanlines between neighbouring rays of a look that crossed at a quarter of the depth of the image; 0
    /// of a look of one ray.
    pub apart: Vec<f64>,
}

/// Courses of the rays between the array and a depth.
pub(crate) struct Fan {
    /// Radius of the array, mm: 0 of a phased one, `None` if scanlines are parallel.
    radius_mm: Option<f64>,
}

impl Fan {
    /// That of a grid.
    pub(crate) fn of(grid: &BeamGrid) -> Self {
        Self {
            radius_mm: grid.virtual_apex_mm(),
        }
    }

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
            Some(radius_mm) => radius_mm * (ray - self.angle(ray, depth_mm)),
        }
    }

    /// Angle between a ray of a flat or curved array and the scanline at a depth, radians.
    pub(crate) fn angle(&self, ray: f64, depth_mm: f64) -> f64 {
        match self.radius_mm {
            None => ray.atan(),
            Some(radius_mm) => (radius_mm * ray.sin() / (radius_mm + depth_mm)).asin(),
        }
    }

    /// Scanlines that a ray has crossed at a depth since it left the array; to a phased one, less those to the end of
    /// the image.
    pub(crate) fn shift(&self, ray: f64, depth_mm: f64, grid: &BeamGrid) -> f64 {
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
    /// Rays from the aperture of a transducer, with the f-number on reception of the shadow if it states one, for the
    /// looks of compounding.
    pub(crate) fn new(shadow: &Shadow, transducer: &Transducer, grid: &BeamGrid, steering: Option<&Steering>) -> Self {
        let f_number = shadow.f_number.unwrap_or(transducer.receive_f_number);
        if f_number == 0.0 && steering.is_none() {
            return Self::default();
        }
        let fan = Fan::of(grid);
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
        let spread = (8..=32).map(edge).fold(0.0, f64::max);
        let step = spread / (0.5 * RAYS as f64);
        // Looks are whole numbers of rays apart, which lie no farther apart for it; one ray casts straight shadows.
        let (step, side, to_next) = match steering {
            None => (step, SIDE, 0),
            Some(steering) if f_number == 0.0 => (steering.step, 0, 1),
            Some(steering) => {
                let to_next = (steering.step / step).ceil();
                let step = steering.step / to_next;
                (step, (spread / step - 0.5).ceil() as usize, to_next as usize)
            }
        };
        let outermost = side + to_next * steering.map_or(0, |steering| steering.on_side);
        let samples = grid.samples();
        let shifts = (0..=outermost).flat_map(|ray| {
            let fan = &fan;
            (0..samples)
                .map(move |sample| fan.shift(ray as f64 * step, grid.sample_depth_mm(sample), grid).round() as i32)
        });
        let shifts: Vec<i32> = shifts.collect();
        let mut rows = vec![0.0; 2 * (side + 1) * samples];
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
            let all = up_to(side);
            for ray in 0..=side {
                let (to, from) = (up_to(ray), ray.checked_sub(1).map_or([0.0; 2], up_to));
                for way in 0..2 {
                    let on_either_side = if ray == 0 { 1.0 } else { 0.5 };
                    let share = if side == 0 {
                        1.0
                    } else {
                        (to[way] - from[way]) / all[way]
                    };
                    rows[(2 * ray + way) * samples + sample] = on_either_side * share;
                }
            }
        }
        let shift = |depth_mm: f64| fan.shift(step, depth_mm, grid);
        let crossing_mm = CROSSING * grid.depth_mm();
        let apart = |sample: usize| match side {
            0 => 0.0,
            _ => shift(grid.sample_depth_mm(sample).max(crossing_mm)) - shift(crossing_mm),
        };
        Self {
            side,
            to_next,
            outermost,
            weights: Numbers::new(rows),
            apart: (0..samples).map(apart).collect(),
            shifts,
        }
    }

    /// Scanline of an element's ray at a sample; beside the image the next in it.
    #[cfg(any(test, feature = "analysis"))]
    pub(crate) fn line_at(&self, [ray, element, sample]: [usize; 3], lines: usize) -> usize {
        let line = element as i64 + self.shift(ray, sample);
        line.clamp(0, lines as i64 - 1) as usize
    }

    /// Element whose ray crosses a scanline at a sample; `None` beyond the array.
    #[cfg(any(test, feature = "analysis"))]
    pub(crate) fn element_at(&self, [ray, line, sample]: [usize; 3], lines: usize) -> Option<usize> {
        let element = line as i64 - self.shift(ray, sample);
        (0..lines as i64).contains(&element).then_some(element as usize)
    }

    /// Number of rays.
    pub(crate) fn rays(&self) -> usize {
        2 * self.outermost + 1
    }

    /// Rays of a look, by the steps of its middle one to the side.
    pub(crate) fn rays_of(&self, steps: i32) -> Range<usize> {
        let middle = (self.outermost as i32 + steps * self.to_next as i32) as usize;
        middle - self.side..middle + self.side + 1
    }

    fn shift(&self, ray: usize, sample: usize) -> i64 {
        let samples = self.apart.len();
        let shift = i64::from(self.shifts[ray.abs_diff(self.outermost) * samples + sample]);
        if ray < self.outermost { -shift } else { shift }
    }

    /// Weights of a ray of a look at the samples, on transmission and on reception.
    pub(crate) fn weights<T: Real>(&self, of_look: usize) -> [&[T]; 2] {
        let samples = self.apart.len();
        let rows = &self.weights.of::<T>()[2 * of_look.abs_diff(self.side) * samples..];
        [&rows[..samples], &rows[samples..2 * samples]]
    }

    /// Scanlines on which rays of elements are at a sample.
    fn inside(&self, [ray, sample]: [usize; 2], lines: usize) -> Range<usize> {
        let shift = self.shift(ray, sample);
        let ends = [shift, lines as i64 + shift].map(|line| line.clamp(0, lines as i64) as usize);
        ends[0]..ends[1]
    }

    /// First element whose ray is on these scanlines, and the one past the last.
    fn elements(&self, [ray, sample]: [usize; 2], inside: &Range<usize>, lines: usize) -> [usize; 2] {
        let shift = self.shift(ray, sample);
        [inside.start, inside.end].map(|line| (line as i64 - shift).clamp(0, lines as i64) as usize)
    }
}

/// Losses of the samples, by attenuation and others, each sample depth across the scanlines: the rays of all elements
/// cross them side by side.
fn across<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let (lines, samples) = (tables.lines(), tables.samples());
    let losses = super::losses_of_labels(tables);
    let needle = crate::effects::needle::present(tables).then_some(T::of(f64::from(needle_units(tables))));
    let (labels, mask) = (&store.label, &store.needle_mask);
    let (attenuation, others) = store.effects.shadow.losses.split_at_mut(lines * samples);
    let rows = (0.., chunks_mut(attenuation, lines), chunks_mut(others, lines));
    for_each(rows, &|(sample, attenuation, others)| {
        for line in 0..lines {
            let index = line * samples + sample;
            let [by_attenuation, other] = losses[usize::from(labels[index])];
            attenuation[line] = by_attenuation;
            others[line] = other + needle.map_or(0, |units| shaded(mask[index], units));
        }
    });
}

/// One-way transmittance of each ray of each element, down to each sample.
pub(super) fn rays<T: Real>(view: &View, store: &mut Store<T>) {
    across(view, store);
    let tables = view.tables;
    let (lines, samples) = (tables.lines(), tables.samples());
    let downshift = tables.effects.shadow.downshift.map(T::of);
    let columns = &mut store.effects.shadow;
    let losses = columns.losses.split_at(lines * samples);
    let rays = (
        0..,
        chunks_mut(&mut columns.through, lines * samples),
        chunks_mut(&mut columns.above, 2 * lines),
    );
    for_each(rays, &|(ray, through, above)| {
        above.fill(0);
        T::vectorised(Ray {
            aperture: &tables.effects.shadow.aperture,
            ray,
            downshift,
            losses,
            above: above.split_at_mut(lines),
            through,
        });
    });
}

/// A ray of every element.
struct Ray<'a, T> {
    aperture: &'a Aperture,
    ray: usize,
    downshift: [T; 2],
    /// By attenuation and others, each sample depth across the scanlines.
    losses: (&'a [u32], &'a [u32]),
    /// Sums of each element down to the sample.
    above: (&'a mut [u32], &'a mut [u32]),
    /// Each sample depth across the scanlines where the rays are; other places are left as they are.
    through: &'a mut [T],
}

impl<T: Real> Kernel for Ray<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let exponent = T::of(0.5 * exponent_per_unit());
        let lines = self.above.0.len();
        let rows = self.losses.0.chunks(lines).zip(self.losses.1.chunks(lines));
        for (sample, ((attenuation, others), through)) in rows.zip(self.through.chunks_mut(lines)).enumerate() {
            let inside = self.aperture.inside([self.ray, sample], lines);
            let [first, last] = self.aperture.elements([self.ray, sample], &inside, lines);
            // Rays beside the image have the losses of its next scanline.
            for (elements, line) in [(0..first, 0), (last..lines, lines - 1)] {
                for element in elements {
                    add(&mut self.above.0[element], attenuation[line]);
                    add(&mut self.above.1[element], others[line]);
                }
            }
            let above = self.above.0[first..last].iter_mut().zip(&mut self.above.1[first..last]);
            let own = attenuation[inside.clone()].iter().zip(&others[inside.clone()]);
            for (((above, above_others), (own, other)), through) in above.zip(own).zip(&mut through[inside]) {
                let down_to = [
                    (*above + *own / 2).min(MAX_UNITS),
                    (*above_others + *other / 2).min(MAX_UNITS),
                ];
                *through = one_way(felt(down_to, self.downshift), exponent);
                add(above, *own);
                add(above_others, *other);
            }
        }
    }
}

#[inline(always)]
fn add(sum: &mut u32, own: u32) {
    *sum = (*sum + own).min(MAX_UNITS);
}

/// One-way transmittance of each sample: the root of the product of the means on the way there and back.
pub(super) fn mean<T: Real>(view: &View, store: &mut Store<T>) {
    let beam = view.tables.lines() * view.tables.samples();
    mean_of(view, 0, &mut store.effects.shadow, &mut store.amplitude_next[..beam]);
}

/// The same for each steered look.
pub(super) fn means_of_looks<T: Real>(view: &View, store: &mut Store<T>) {
    let beam = view.tables.lines() * view.tables.samples();
    let columns = &mut store.effects.shadow;
    for (look, left) in (0..steered(view.tables)).zip(store.effects.compound.through.chunks_mut(beam)) {
        mean_of(view, steps(look), columns, left);
    }
}

fn mean_of<T: Real>(view: &View, steps: i32, columns: &mut Columns<T>, left: &mut [T]) {
    let tables = view.tables;
    let (lines, samples) = (tables.lines(), tables.samples());
    let Columns { through, across, .. } = columns;
    for_each((0.., chunks_mut(across, lines)), &|(sample, left)| {
        T::vectorised(Mean {
            aperture: &tables.effects.shadow.aperture,
            steps,
            sample,
            through,
            left,
        });
    });
    for_each((0.., chunks_mut(left, samples)), &|(line, left)| {
        for (sample, left) in left.iter_mut().enumerate() {
            *left = across[sample * lines + line];
        }
    });
}

/// The means of a sample depth.
struct Mean<'a, T> {
    aperture: &'a Aperture,
    /// Of the look to the side.
    steps: i32,
    sample: usize,
    through: &'a [T],
    /// Across the scanlines.
    left: &'a mut [T],
}

impl<T: Real> Kernel for Mean<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let lines = self.left.len();
        let samples = self.through.len() / (self.aperture.rays() * lines);
        for (block, left) in self.left.chunks_mut(BLOCK).enumerate() {
            let start = block * BLOCK;
            let end = start + left.len();
            let mut there = [T::zero(); BLOCK];
            let mut back = [T::zero(); BLOCK];
            let mut present = [[T::zero(); BLOCK]; 2];
            for (of_look, ray) in self.aperture.rays_of(self.steps).enumerate() {
                let [to, from] = self.aperture.weights::<T>(of_look).map(|weights| weights[self.sample]);
                let inside = self.aperture.inside([ray, self.sample], lines);
                let (first, last) = (inside.start.clamp(start, end), inside.end.clamp(start, end));
                let through = &self.through[(ray * samples + self.sample) * lines..][first..last];
                for (i, through) in (first - start..).zip(through) {
                    there[i] += to * *through;
                    back[i] += from * *through;
                    present[0][i] += to;
                    present[1][i] += from;
                }
            }
            for (i, left) in left.iter_mut().enumerate() {
                // Of a look from far beyond the array no ray is present.
                let all = (present[0][i] * present[1][i]).max(T::of(LEAST_PRESENT));
                *left = (there[i] * back[i] / all).sqrt();
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
        (
            Aperture::new(&Shadow::default(), &probe.transducer(), &grid, None),
            grid,
        )
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
        // Scanlines with a ray are those of an element.
        for (ray, sample) in (0..RAYS).flat_map(|ray| (0..300).map(move |sample| (ray, sample))) {
            let inside = aperture.inside([ray, sample], lines);
            let [first, last] = aperture.elements([ray, sample], &inside, lines);
            assert_eq!(inside.len(), last - first);
            for line in 0..lines {
                let expected = inside.contains(&line).then(|| first + line - inside.start);
                assert_eq!(element(ray, line, sample), expected, "ray {ray} at {sample}, {line}");
            }
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
