//! Beam of a probe: lengths across it by depth, from the waves of its aperture and lens.
//!
//! Waves of several frequencies from all elements that act at a depth are added up, on the way there and back: an
//! element is as wide as [`Transducer::element_mm`] in a soft baffle (A. R. Selfridge et al., Applied Physics Letters
//! 37 (1980) 35), receivers focus at every depth, weights of the elements reach over the f-number and end with the
//! array. Across the plane the same is added up over the height of the elements, with the lens as a fixed focus.

use std::collections::VecDeque;
use std::f64::consts::{LN_2, PI, TAU};
use std::sync::{Arc, Mutex, PoisonError};

use nalgebra::Complex;

use super::Attenuation;
use super::profile::Profile;
use insonify_base::parallel;
use insonify_tracking::probe::{Apodisation, Transducer};

/// Depths at which the beam is computed, and points to one side of its axis at each.
const DEPTHS: usize = 24;
const ASIDE: usize = 24;

/// Frequencies of the pulse, and the farthest of them from the centre in standard deviations of the spectrum.
const FREQUENCIES: usize = 5;
const FARTHEST: f64 = 2.0;

/// Distance of the points on an aperture from which waves come, in wavelengths, and their number.
const POINT_WAVELENGTHS: f64 = 1.0;
const POINTS: (f64, f64) = (8.0, 256.0);

/// Number of probes whose beams are kept.
const KEPT: usize = 4;

/// Lateral length of speckle in the reference simulation over that of its fields: mean of 24 depths, two arrays and two
/// apodisations, 0.99 to 1.15. Its scatterers are few, and scanlines away from the middle have less of the array.
const IN_SIMULATION: f64 = 1.06;

/// Start of the side lobes, distance of the points of their envelope, and their farthest end, in lengths around a
/// point.
const LOBES: [f64; 3] = [1.25, 0.25, 12.0];

/// Amplitude below which side lobes are left out, relative to the peak: -54 dB.
const LEAST: f64 = 0.002;

/// The beam by depth.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Beam {
    /// Distance between the depths, mm; the first is that distance.
    step_mm: f64,
    sections: Vec<Section>,
}

/// The beam at a depth. Lengths are full widths at half maximum, mm.
#[derive(Debug, PartialEq)]
struct Section {
    lengths: Lengths,
    elevation: Profile,
    /// Envelope of the side lobes, relative to the peak, from the first of [`LOBES`] on.
    lobes: Vec<f64>,
}

/// Lengths across the beam, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Lengths {
    /// Amplitude around a point, across the scanlines.
    pub point_mm: f64,
    /// Correlation of the intensity of speckle, across the scanlines.
    pub speckle_mm: f64,
}

impl Beam {
    /// Computes the beam of a transducer in tissue of this attenuation, or takes it from those computed last.
    pub(super) fn of(transducer: &Transducer, depth_mm: f64, attenuation: Attenuation) -> Arc<Self> {
        type Kept = VecDeque<((Transducer, f64, Attenuation), Arc<Beam>)>;
        static KEPT_BEAMS: Mutex<Kept> = Mutex::new(VecDeque::new());
        let kept = || KEPT_BEAMS.lock().unwrap_or_else(PoisonError::into_inner);
        let key = (*transducer, depth_mm, attenuation);
        if let Some((_, beam)) = kept().iter().find(|(other, _)| *other == key) {
            return beam.clone();
        }
        let step_mm = depth_mm / DEPTHS as f64;
        let sections = parallel::map(0..DEPTHS, &|depth| {
            let depth_mm = (depth + 1) as f64 * step_mm;
            let wavelength_mm = transducer.wavelength_mm / attenuation.centre_at(depth_mm);
            let lowered = Transducer {
                wavelength_mm,
                ..*transducer
            };
            Section::new(&lowered, depth_mm)
        });
        let beam = Arc::new(Self { step_mm, sections });
        let mut kept = kept();
        kept.truncate(KEPT - 1);
        kept.push_front((key, beam.clone()));
        beam
    }

    /// Lengths at a depth.
    pub(super) fn at(&self, depth_mm: f64) -> Lengths {
        let (before, share) = self.before(depth_mm);
        let [a, b] = [before, before + 1].map(|depth| self.sections[depth].lengths);
        let between = |a: f64, b: f64| a + share * (b - a);
        Lengths {
            point_mm: between(a.point_mm, b.point_mm),
            speckle_mm: between(a.speckle_mm, b.speckle_mm),
        }
    }

    /// Elevational profile at a depth.
    pub(super) fn elevation_at(&self, depth_mm: f64) -> Profile {
        let (before, share) = self.before(depth_mm);
        let [a, b] = [before, before + 1].map(|depth| &self.sections[depth].elevation);
        a.towards(b, share)
    }

    /// Envelope of the side lobes at a depth and a distance from the axis, relative to the peak.
    pub(super) fn lobes_at(&self, depth_mm: f64, aside_mm: f64) -> f64 {
        let (before, share) = self.before(depth_mm);
        let [a, b] = [before, before + 1].map(|depth| self.sections[depth].lobes_at(aside_mm));
        a + share * (b - a)
    }

    /// Distance from the axis at which the side lobes end at a depth, mm; 0 without any.
    pub(super) fn lobes_mm(&self, depth_mm: f64) -> f64 {
        let (before, _) = self.before(depth_mm);
        let [a, b] = [before, before + 1].map(|depth| self.sections[depth].lobes_mm());
        a.max(b)
    }

    /// The depth before a depth, and the share of the next.
    fn before(&self, depth_mm: f64) -> (usize, f64) {
        let at = (depth_mm / self.step_mm - 1.0).clamp(0.0, (DEPTHS - 1) as f64);
        let before = (at as usize).min(DEPTHS - 2);
        (before, at - before as f64)
    }
}

impl Section {
    fn new(transducer: &Transducer, depth_mm: f64) -> Self {
        let two_way = TwoWay::new(transducer, depth_mm);
        let Transducer {
            wavelength_mm,
            receive_f_number,
            element_mm,
            aperture_mm,
            ..
        } = *transducer;
        let length_mm = (depth_mm / receive_f_number).clamp(element_mm, aperture_mm);
        let step_mm = wavelength_mm * (3.0 * depth_mm / length_mm + 1.0) / (ASIDE - 1) as f64;
        let fields: Vec<Field> = (0..ASIDE).map(|aside| two_way.field(aside as f64 * step_mm)).collect();
        let point_mm = within(point_width(&fields, step_mm));
        let peak = energy(&fields[0]);
        let [from, step, to] = LOBES.map(|lengths| lengths * point_mm);
        let mut lobes: Vec<f64> = Vec::new();
        // They end where the envelope stays below what is left out, over a length.
        let quiet = (LOBES[1].recip()) as usize;
        for index in 0..((to - from) / step) as usize {
            if lobes.len() >= quiet && lobes[lobes.len() - quiet..].iter().all(|lobe| *lobe < LEAST) {
                break;
            }
            lobes.push((energy(&two_way.field(from + index as f64 * step)) / peak).sqrt());
        }
        lobes.truncate(lobes.iter().rposition(|lobe| *lobe >= LEAST).map_or(0, |last| last + 1));
        Self {
            lengths: Lengths {
                point_mm,
                speckle_mm: within(IN_SIMULATION * speckle_width(&fields, step_mm)),
            },
            elevation: elevation(transducer, depth_mm),
            lobes,
        }
    }

    fn lobes_at(&self, aside_mm: f64) -> f64 {
        let at = (aside_mm / self.lengths.point_mm - LOBES[0]) / LOBES[1];
        if at < 0.0 || self.lobes.is_empty() {
            return 0.0;
        }
        let [a, b] = [0, 1].map(|next| self.lobes.get(at as usize + next).copied().unwrap_or(0.0));
        a + at.fract() * (b - a)
    }

    fn lobes_mm(&self) -> f64 {
        match self.lobes.len() {
            0 => 0.0,
            count => self.lengths.point_mm * (LOBES[0] + LOBES[1] * count as f64),
        }
    }
}

/// A length within what kernels show, mm.
fn within(length_mm: f64) -> f64 {
    length_mm.clamp(0.05, 20.0)
}

/// Waves to and from points at a depth.
struct TwoWay {
    transmit: Points,
    receive: Points,
    radius_mm: Option<f64>,
    depth_mm: f64,
}

impl TwoWay {
    fn new(transducer: &Transducer, depth_mm: f64) -> Self {
        let open = |focus_mm: f64, f_number: f64, apodisation: Apodisation| {
            let full_mm = (focus_mm / f_number).max(transducer.element_mm);
            let Transducer {
                radius_mm, aperture_mm, ..
            } = *transducer;
            Points::new(transducer, radius_mm, full_mm, aperture_mm, focus_mm, apodisation)
        };
        Self {
            transmit: open(
                transducer.transmit_focus_mm,
                transducer.transmit_f_number,
                Apodisation::None,
            ),
            receive: open(depth_mm, transducer.receive_f_number, transducer.apodisation),
            radius_mm: transducer.radius_mm,
            depth_mm,
        }
    }

    /// Wave back from a point at a distance from the axis, along the arc of its depth.
    fn field(&self, aside_mm: f64) -> Field {
        let point = match self.radius_mm {
            None => [aside_mm, self.depth_mm],
            Some(radius) => {
                let (sine, cosine) = (aside_mm / (radius + self.depth_mm)).min(PI).sin_cos();
                [
                    (radius + self.depth_mm) * sine,
                    (radius + self.depth_mm) * cosine - radius,
                ]
            }
        };
        product(
            self.transmit.field(point, self.depth_mm),
            self.receive.field(point, self.depth_mm),
        )
    }
}

/// Beam across the plane at a depth.
fn elevation(transducer: &Transducer, depth_mm: f64) -> Profile {
    let (height_mm, focus_mm) = (transducer.height_mm, transducer.lens_focus_mm);
    let strip = Transducer {
        element_mm: POINT_WAVELENGTHS * transducer.wavelength_mm,
        ..*transducer
    };
    let points = Points::new(&strip, None, height_mm, height_mm, focus_mm, Apodisation::None);
    let widest_mm = 0.75 * height_mm + 1.5 * transducer.wavelength_mm * depth_mm / height_mm;
    let step_mm = widest_mm / (ASIDE - 1) as f64;
    let two_way = |aside_mm: f64| {
        let field = points.field([aside_mm, depth_mm], depth_mm);
        product(field, field)
    };
    let fields: Vec<Field> = (0..ASIDE).map(|aside| two_way(aside as f64 * step_mm)).collect();
    let length_mm = within(point_width(&fields, step_mm));
    Profile::new(length_mm, |lengths| energy(&two_way(lengths * length_mm)))
}

/// A wave at a point, at each frequency of the pulse.
type Field = [Complex<f64>; FREQUENCIES];

fn product(a: Field, b: Field) -> Field {
    std::array::from_fn(|frequency| a[frequency] * b[frequency])
}

/// Points of an aperture from which waves come.
struct Points {
    /// Place, outward normal, distance to the focus, and weight of each.
    points: Vec<([f64; 2], [f64; 2], f64, f64)>,
    focus_mm: f64,
    wavelength_mm: f64,
    element_mm: f64,
    /// Lowest frequency and steps between them over the centre frequency.
    frequencies: [f64; 2],
    /// Root of the amplitude of the two-way pulse at each.
    spectrum: [f64; FREQUENCIES],
}

impl Points {
    /// Lays out an aperture on an array, as much of `full_mm`, over which its weights reach, as `most_mm` leaves.
    fn new(
        transducer: &Transducer,
        radius_mm: Option<f64>,
        full_mm: f64,
        most_mm: f64,
        focus_mm: f64,
        apodisation: Apodisation,
    ) -> Self {
        let wavelength_mm = transducer.wavelength_mm;
        let length_mm = full_mm.min(most_mm);
        let count = (length_mm / (POINT_WAVELENGTHS * wavelength_mm))
            .ceil()
            .clamp(POINTS.0, POINTS.1);
        let point = |index: usize| {
            let along_mm = ((index as f64 + 0.5) / count - 0.5) * length_mm;
            let (place, normal) = match radius_mm {
                None => ([along_mm, 0.0], [0.0, 1.0]),
                Some(radius) => {
                    let (sine, cosine) = (along_mm / radius).sin_cos();
                    ([radius * sine, radius * (cosine - 1.0)], [sine, cosine])
                }
            };
            let to_focus = place[0].hypot(focus_mm - place[1]);
            (place, normal, to_focus, apodisation.weight(2.0 * along_mm / full_mm))
        };
        // A Gaussian's full width at half maximum is 2.35 standard deviations.
        let deviation = transducer.bandwidth / (8.0 * LN_2).sqrt();
        // Below a tenth of the centre frequency there is no pulse.
        let lowest = (1.0 - FARTHEST * deviation).max(0.1);
        let step = 2.0 * (1.0 - lowest) / (FREQUENCIES - 1) as f64;
        let amplitude = |frequency: f64| (-0.25 * ((frequency - 1.0) / deviation).powi(2)).exp();
        Self {
            points: (0..count as usize).map(point).collect(),
            focus_mm,
            wavelength_mm,
            element_mm: transducer.element_mm,
            frequencies: [lowest, step],
            spectrum: std::array::from_fn(|frequency| amplitude(lowest + frequency as f64 * step)),
        }
    }

    /// Wave at a point, all elements being in phase at the focus; phases are those beyond the way along the axis.
    fn field(&self, point: [f64; 2], depth_mm: f64) -> Field {
        let mut sum = Field::default();
        for (place, normal, to_focus, weight) in &self.points {
            let way = [0, 1].map(|axis| point[axis] - place[axis]);
            let distance = way[0].hypot(way[1]).max(1e-6);
            let cosine = (way[0] * normal[0] + way[1] * normal[1]) / distance;
            if cosine <= 0.0 {
                continue;
            }
            let sine = (way[0] * normal[1] - way[1] * normal[0]) / distance;
            let late = PI * self.element_mm / self.wavelength_mm * sine;
            let directivity = if late.abs() < 1e-6 { 1.0 } else { late.sin() / late };
            let periods = (distance - to_focus - (depth_mm - self.focus_mm)) / self.wavelength_mm;
            let [mut wave, step] = self
                .frequencies
                .map(|frequency| Complex::cis(-TAU * frequency * periods));
            wave *= weight * cosine * directivity / distance.sqrt();
            for sum in &mut sum {
                *sum += wave;
                wave *= step;
            }
        }
        std::array::from_fn(|frequency| self.spectrum[frequency] * sum[frequency])
    }
}

/// Energy of an echo.
fn energy(field: &Field) -> f64 {
    field.iter().map(Complex::norm_sqr).sum()
}

/// Full width at half of the amplitude around a point, the root of the energy of its echo.
fn point_width(fields: &[Field], step_mm: f64) -> f64 {
    let first = energy(&fields[0]);
    crossing(|aside| energy(&fields[aside]) / first, 0.25, step_mm)
}

/// Full width at half maximum of the autocorrelation of the intensity of speckle: the square of that of the field.
fn speckle_width(fields: &[Field], step_mm: f64) -> f64 {
    let last = fields.len() as isize - 1;
    let correlation = |lag: usize| {
        let pairs = (-last..=last - lag as isize).map(|aside| {
            let [a, b] = [aside, aside + lag as isize].map(|aside| &fields[aside.unsigned_abs()]);
            a.iter().zip(b).map(|(a, b)| a * b.conj()).sum::<Complex<f64>>()
        });
        pairs.sum::<Complex<f64>>().norm_sqr()
    };
    let first = correlation(0);
    crossing(|lag| correlation(lag) / first, 0.5, step_mm)
}

/// Twice the distance at which a curve, 1 at the start, falls below a level.
fn crossing(curve: impl Fn(usize) -> f64, level: f64, step_mm: f64) -> f64 {
    let mut before = 1.0;
    for index in 1..ASIDE {
        let here = curve(index);
        if here < level {
            return 2.0 * step_mm * (index as f64 - (level - here) / (before - here));
        }
        before = here;
    }
    2.0 * step_mm * (ASIDE - 1) as f64
}
