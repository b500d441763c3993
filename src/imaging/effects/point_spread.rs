//! Point spread of a probe: stated lengths, or those that follow from its pulse, aperture and lens.
//!
//! Lengths are full widths at half maximum of the autocorrelation of the echo intensity; a Gaussian point spread has
//! the same at half of its amplitude.
//!
//! The axial length is that of a pulse with a Gaussian spectrum of the probe's bandwidth. Across the beam, waves of
//! several frequencies from all elements that act at a depth are added up, on the way there and back: an element is as
//! wide as [`Transducer::element_mm`] in a soft baffle (A. R. Selfridge et al., Applied Physics Letters 37 (1980) 35),
//! receivers focus at every depth, weights of the elements reach over the f-number and end with the array. The field
//! is narrower in the correlation of speckle than around a point, out of focus above all; the kernel has one length,
//! in between. Across the plane the same is added up over the height of the elements, with the lens as a fixed focus.

use std::collections::VecDeque;
use std::f64::consts::{LN_2, PI, TAU};
use std::sync::{Arc, Mutex, PoisonError};

use nalgebra::Complex;

use super::speckle::Speckle;
use insonify_base::parallel;
use insonify_tracking::probe::{Apodisation, Probe, Transducer};

/// Distance from the focus at which a stated lateral length has grown by sqrt 2, at 1 MHz, mm: a Rayleigh length, which
/// scales with the wavelength at constant f-number.
const FOCAL_ZONE_MM: f64 = 175.0;

/// Share of the length around a point in that of the kernel, the rest being that of speckle.
const OF_POINT: f64 = 0.6;

/// Axial length in speckle over that around a point: spectra of arrays are flatter than a Gaussian's. In the reference
/// simulation 0.94 of a linear array, 0.92 of a curved one.
const IN_SPECKLE: f64 = 0.94;

/// Depths at which the beam is computed, and points to one side of its axis at each.
const DEPTHS: usize = 40;
const ASIDE: usize = 48;

/// Frequencies of the pulse, and the farthest of them from the centre in standard deviations of the spectrum.
const FREQUENCIES: usize = 5;
const FARTHEST: f64 = 2.0;

/// Distance of the points on an aperture from which waves come, in wavelengths, and their number.
const POINT_WAVELENGTHS: f64 = 0.75;
const POINTS: (f64, f64) = (8.0, 256.0);

/// Number of probes whose beams are kept.
const KEPT: usize = 4;

/// Lengths of the point spread, mm.
#[derive(Clone, Debug, PartialEq)]
pub struct PointSpread {
    /// Axial length.
    pub axial_mm: f64,
    /// Lateral length at the focus.
    pub lateral_mm: f64,
    /// Elevational length: if it is not stated, that at the focus of the lens.
    pub elevational_mm: f64,
    /// Whether it is stated.
    pub is_elevational_stated: bool,
    /// Depth of the transmit focus, mm.
    pub focus_mm: f64,
    /// Distance from the focus at which the lateral length has grown by sqrt 2, mm, if the lateral length is stated.
    focal_zone_mm: Option<f64>,
    beam: Arc<Beam>,
}

impl PointSpread {
    /// Completes the stated lengths by those that follow from a probe.
    pub fn new(speckle: &Speckle, probe: &Probe) -> Self {
        let mut transducer = probe.transducer();
        if let Some(focus_mm) = speckle.focus_mm {
            transducer.transmit_focus_mm = focus_mm;
        }
        let focus_mm = transducer.transmit_focus_mm;
        let is_stated = speckle.lateral_mm.is_some() || speckle.focal_zone_mm.is_some();
        let beam = match (is_stated, speckle.elevational_mm) {
            (true, Some(_)) => Arc::default(),
            _ => Beam::of(&transducer, probe.depth_mm),
        };
        let lateral_mm = speckle.lateral_mm.unwrap_or_else(|| beam.lateral_at(focus_mm));
        let zone_mm = || (FOCAL_ZONE_MM / probe.frequency_mhz).clamp(1.0, 10_000.0);
        Self {
            axial_mm: speckle
                .axial_mm
                .unwrap_or_else(|| pulse_mm(&transducer).clamp(0.05, 10.0)),
            lateral_mm,
            elevational_mm: speckle
                .elevational_mm
                .unwrap_or_else(|| beam.elevational_at(transducer.lens_focus_mm)),
            is_elevational_stated: speckle.elevational_mm.is_some(),
            focus_mm,
            focal_zone_mm: is_stated.then(|| speckle.focal_zone_mm.unwrap_or_else(zone_mm)),
            beam,
        }
    }

    /// Lateral length at a depth, mm: of a stated length that of a Gaussian beam about its focus.
    pub fn lateral_at(&self, depth_mm: f64) -> f64 {
        match self.focal_zone_mm {
            Some(zone_mm) => self.lateral_mm * ((depth_mm - self.focus_mm) / zone_mm).hypot(1.0),
            None => self.beam.lateral_at(depth_mm),
        }
    }
}

/// Length of a pulse in speckle, mm of depth, of a Gaussian amplitude spectrum that is as wide.
fn pulse_mm(transducer: &Transducer) -> f64 {
    IN_SPECKLE * 4.0 * LN_2 / PI * transducer.wavelength_mm / (2.0 * transducer.bandwidth)
}

/// Lengths across the beam, by depth.
#[derive(Clone, Debug, Default, PartialEq)]
struct Beam {
    /// Distance between the depths, mm; the first is that distance.
    step_mm: f64,
    lateral_mm: Vec<f64>,
    elevational_mm: Vec<f64>,
}

impl Beam {
    /// Computes the beam of a transducer, or takes it from those computed last.
    fn of(transducer: &Transducer, depth_mm: f64) -> Arc<Self> {
        type Kept = VecDeque<((Transducer, f64), Arc<Beam>)>;
        static KEPT_BEAMS: Mutex<Kept> = Mutex::new(VecDeque::new());
        let kept = || KEPT_BEAMS.lock().unwrap_or_else(PoisonError::into_inner);
        let key = (*transducer, depth_mm);
        if let Some((_, beam)) = kept().iter().find(|(other, _)| *other == key) {
            return beam.clone();
        }
        let step_mm = depth_mm / DEPTHS as f64;
        let lengths = parallel::map(0..DEPTHS, &|depth| {
            let depth_mm = (depth + 1) as f64 * step_mm;
            [lateral_mm(transducer, depth_mm), elevational_mm(transducer, depth_mm)].map(|mm| mm.clamp(0.05, 20.0))
        });
        let beam = Arc::new(Self {
            step_mm,
            lateral_mm: lengths.iter().map(|[lateral, _]| *lateral).collect(),
            elevational_mm: lengths.iter().map(|[_, elevational]| *elevational).collect(),
        });
        let mut kept = kept();
        kept.truncate(KEPT - 1);
        kept.push_front((key, beam.clone()));
        beam
    }

    fn lateral_at(&self, depth_mm: f64) -> f64 {
        self.between(&self.lateral_mm, depth_mm)
    }

    fn elevational_at(&self, depth_mm: f64) -> f64 {
        self.between(&self.elevational_mm, depth_mm)
    }

    fn between(&self, lengths: &[f64], depth_mm: f64) -> f64 {
        let at = (depth_mm / self.step_mm - 1.0).clamp(0.0, (DEPTHS - 1) as f64);
        let before = (at as usize).min(DEPTHS - 2);
        lengths[before] + (at - before as f64) * (lengths[before + 1] - lengths[before])
    }
}

/// Length across the scanlines at a depth, mm.
fn lateral_mm(transducer: &Transducer, depth_mm: f64) -> f64 {
    let Transducer {
        radius_mm,
        transmit_focus_mm,
        transmit_f_number,
        receive_f_number,
        ..
    } = *transducer;
    let open = |focus_mm: f64, f_number: f64, apodisation: Apodisation| {
        let full_mm = (focus_mm / f_number).max(transducer.element_mm);
        Points::new(
            transducer,
            radius_mm,
            full_mm,
            transducer.aperture_mm,
            focus_mm,
            apodisation,
        )
    };
    let transmit = open(transmit_focus_mm, transmit_f_number, Apodisation::None);
    let receive = open(depth_mm, receive_f_number, transducer.apodisation);
    let length_mm = (depth_mm / receive_f_number).clamp(transducer.element_mm, transducer.aperture_mm);
    let widest_mm = transducer.wavelength_mm * (3.0 * depth_mm / length_mm + 1.0);
    let step_mm = widest_mm / (ASIDE - 1) as f64;
    let fields = (0..ASIDE).map(|aside| {
        let aside_mm = aside as f64 * step_mm;
        let point = match radius_mm {
            None => [aside_mm, depth_mm],
            Some(radius) => {
                let (sine, cosine) = (aside_mm / (radius + depth_mm)).min(PI).sin_cos();
                [(radius + depth_mm) * sine, (radius + depth_mm) * cosine - radius]
            }
        };
        product(transmit.field(point, depth_mm), receive.field(point, depth_mm))
    });
    let fields: Vec<Field> = fields.collect();
    point_width(&fields, step_mm).powf(OF_POINT) * speckle_width(&fields, step_mm).powf(1.0 - OF_POINT)
}

/// Length across the plane at a depth, mm.
fn elevational_mm(transducer: &Transducer, depth_mm: f64) -> f64 {
    let (height_mm, focus_mm) = (transducer.height_mm, transducer.lens_focus_mm);
    let strip = Transducer {
        element_mm: POINT_WAVELENGTHS * transducer.wavelength_mm,
        ..*transducer
    };
    let points = Points::new(&strip, None, height_mm, height_mm, focus_mm, Apodisation::None);
    let widest_mm = 0.75 * height_mm + 1.5 * transducer.wavelength_mm * depth_mm / height_mm;
    let step_mm = widest_mm / (ASIDE - 1) as f64;
    let fields = (0..ASIDE).map(|aside| {
        let field = points.field([aside as f64 * step_mm, depth_mm], depth_mm);
        product(field, field)
    });
    point_width(&fields.collect::<Vec<_>>(), step_mm)
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

/// Full width at half of the amplitude around a point, the root of the energy of its echo.
fn point_width(fields: &[Field], step_mm: f64) -> f64 {
    let energy = |field: &Field| field.iter().map(Complex::norm_sqr).sum::<f64>();
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

#[cfg(test)]
mod tests {
    use super::*;
    use insonify_tracking::probe::{Aperture, Curvilinear, Linear, Phased};

    /// The arrays of the reference simulation by SIMUS (D. Garcia, Computer Methods and Programs in Biomedicine 218
    /// (2022) 106726), with its settings: 128 elements of L11-5v and of C5-2v, pulses of 55 % bandwidth.
    fn simulated(is_curved: bool, apodisation: Apodisation) -> PointSpread {
        let mut probe = if is_curved {
            let shape = Curvilinear {
                radius_mm: 49.57,
                angle_deg: 74.6,
            };
            Probe::new(shape, 145.0).unwrap()
        } else {
            Probe::new(Linear { width_mm: 38.4 }, 45.0).unwrap()
        };
        let (mhz, focus_mm) = if is_curved { (3.57, 75.0) } else { (7.6, 22.0) };
        probe.frequency_mhz = mhz;
        probe.aperture = Aperture {
            bandwidth: Some(0.55),
            transmit_focus_mm: Some(focus_mm),
            apodisation: Some(apodisation),
            ..Aperture::default()
        };
        PointSpread::new(&Speckle::default(), &probe)
    }

    /// Depth, lateral length around a point with Hann weights and with equal ones, elevational length, mm.
    const LINEAR: [[f64; 4]; 6] = [
        [10.0, 0.682, 0.428, 1.583],
        [15.0, 0.748, 0.446, 0.595],
        [20.0, 0.477, 0.350, 0.806],
        [25.0, 0.523, 0.374, 1.039],
        [30.0, 0.671, 0.428, 1.462],
        [40.0, 0.695, 0.425, 2.910],
    ];
    const CURVED: [[f64; 4]; 6] = [
        [30.0, 1.714, 1.080, 5.608],
        [50.0, 1.844, 1.126, 1.523],
        [70.0, 1.277, 0.989, 2.224],
        [90.0, 1.570, 1.187, 3.140],
        [110.0, 2.099, 1.498, 4.667],
        [140.0, 2.182, 1.689, 9.216],
    ];

    #[test]
    fn lengths_are_those_of_a_simulator_of_waves() {
        // Axial lengths in speckle, the means over depth.
        for (is_curved, rows, axial_mm) in [(false, LINEAR, 0.150), (true, CURVED, 0.312)] {
            let [hann, none] = [Apodisation::Hann, Apodisation::None].map(|weights| simulated(is_curved, weights));
            assert!((hann.axial_mm / axial_mm - 1.0).abs() < 0.06, "{}", hann.axial_mm);
            for [depth_mm, of_hann, of_none, elevational] in rows {
                for (length, expected, within) in [
                    (hann.lateral_at(depth_mm), of_hann, 0.12),
                    (none.lateral_at(depth_mm), of_none, 0.15),
                    (hann.beam.elevational_at(depth_mm), elevational, 0.16),
                ] {
                    let off = length / expected - 1.0;
                    assert!(off.abs() < within, "{depth_mm} mm: {length} mm, not {expected}");
                }
            }
        }
    }

    #[test]
    fn stated_lengths_take_precedence() {
        let probe = Probe::new(Linear { width_mm: 40.0 }, 50.0).unwrap();
        let stated = Speckle {
            axial_mm: Some(0.8),
            lateral_mm: Some(3.0),
            focal_zone_mm: Some(10.0),
            ..Speckle::default()
        };
        let spread = PointSpread::new(&stated, &probe);
        assert_eq!((spread.axial_mm, spread.lateral_at(25.0)), (0.8, 3.0));
        assert!((spread.lateral_at(35.0) / 3.0 - 2f64.sqrt()).abs() < 1e-12);
    }

    /// Far beyond its transmit focus an unapodised aperture of 20 mm receives alone: half of the amplitude of sin x / x
    /// lies at 0.603 wavelengths over the aperture to each side.
    #[test]
    fn a_phased_array_is_limited_by_diffraction() {
        let mut probe = Probe::new(Phased { angle_deg: 80.0 }, 160.0).unwrap();
        probe.aperture = Aperture {
            bandwidth: Some(0.05),
            apodisation: Some(Apodisation::None),
            transmit_f_number: Some(20.0),
            ..Aperture::default()
        };
        let spread = PointSpread::new(&Speckle::default(), &probe);
        let receive_alone = 1.207 * 160.0 * 0.616 / 20.0;
        let length = spread.lateral_at(160.0);
        assert!(
            (0.7..1.0).contains(&(length / receive_alone)),
            "{length} mm, {receive_alone} mm"
        );
    }

    #[test]
    fn extremes_have_lengths() {
        for shape in [Linear { width_mm: 1.0 }, Linear { width_mm: 300.0 }] {
            for (bandwidth, f_number, focus_mm) in [(0.05, 0.5, 0.0), (1.5, 20.0, 0.0), (1.5, 0.5, 1000.0)] {
                let mut probe = Probe::new(shape, 50.0).unwrap();
                probe.aperture = Aperture {
                    bandwidth: Some(bandwidth),
                    aperture_mm: Some(0.01),
                    transmit_focus_mm: Some(focus_mm),
                    transmit_f_number: Some(f_number),
                    receive_f_number: Some(f_number),
                    lens_focus_mm: Some(1.0),
                    height_mm: Some(50.0),
                    ..Aperture::default()
                };
                let spread = PointSpread::new(&Speckle::default(), &probe);
                for depth_mm in [0.0, 1.0, 25.0, 50.0] {
                    let lengths = [spread.axial_mm, spread.lateral_at(depth_mm), spread.elevational_mm];
                    assert!(lengths.iter().all(|mm| (0.05..=20.0).contains(mm)), "{lengths:?}");
                }
            }
        }
    }
}
