//! Point spread of a probe: stated lengths, or those that follow from its pulse, aperture and lens.
//!
//! Lengths are full widths at half maximum of the autocorrelation of the echo intensity: what one measures in speckle.
//! Around a point the amplitude has another, as the spectra of arrays have sharper edges than a Gaussian's. A stated
//! length is that of both. Attenuation lowers the frequency of a pulse with depth, and all lengths that follow from the
//! probe grow as its wavelength does.

mod beam;
mod profile;
mod shape;

use std::f64::consts::{LN_2, PI};
use std::sync::Arc;

use beam::Beam;
pub(crate) use profile::Profile;
pub(crate) use shape::Shape;

pub use super::shadow::Attenuation;
use super::speckle::Speckle;
use insonify_tracking::probe::{Probe, Transducer};

/// Distance from the focus at which a stated lateral length has grown by sqrt 2, at 1 MHz, mm: a Rayleigh length, which
/// scales with the wavelength at constant f-number.
const FOCAL_ZONE_MM: f64 = 175.0;

/// Axial length in speckle over that around a point. In the reference simulation 0.94 of a linear array, 0.92 of a
/// curved one.
const IN_SPECKLE: f64 = 0.94;

/// Shortest axial length that samples show, in distances of samples: a shorter one would come out as dashes.
const SHOWN_SAMPLES: f64 = 2.0;

/// Lengths of the point spread, mm.
#[derive(Clone, Debug, PartialEq)]
pub struct PointSpread {
    /// Axial length: if it is not stated, that of the pulse at the array, and no less than two samples.
    pub axial_mm: f64,
    /// Number of samples that would show the pulse, if those of the probe are too few and no axial length is stated.
    pub samples_for_pulse: Option<u32>,
    /// Lateral length at the focus.
    pub lateral_mm: f64,
    /// Elevational length: if it is not stated, that at the focus of the lens.
    pub elevational_mm: f64,
    /// Whether the elevational length is stated.
    pub is_elevational_stated: bool,
    /// Depth of the transmit focus, mm.
    pub focus_mm: f64,
    /// Distance from the focus at which the lateral length has grown by sqrt 2, mm, if the lateral length is stated.
    focal_zone_mm: Option<f64>,
    /// Axial length in speckle at the array, and the least that samples show, mm, if it is not stated.
    pulse_mm: Option<[f64; 2]>,
    attenuation: Attenuation,
    beam: Arc<Beam>,
}

impl PointSpread {
    /// Completes the stated lengths by those that follow from a probe, in tissue of this attenuation.
    pub fn new(speckle: &Speckle, probe: &Probe, attenuation: Attenuation) -> Self {
        let mut transducer = probe.transducer();
        if let Some(focus_mm) = speckle.focus_mm {
            transducer.transmit_focus_mm = focus_mm;
        }
        if let Some(filter) = speckle.receive_bandwidth {
            // Of the product of two Gaussians.
            transducer.bandwidth = (transducer.bandwidth.powi(-2) + filter.powi(-2)).powf(-0.5);
        }
        let focus_mm = transducer.transmit_focus_mm;
        let is_stated = speckle.lateral_mm.is_some() || speckle.focal_zone_mm.is_some();
        let beam = match (speckle.lateral_mm, speckle.elevational_mm) {
            (Some(_), Some(_)) => Arc::default(),
            _ => Beam::of(&transducer, probe.depth_mm, attenuation),
        };
        let pulse_mm = (IN_SPECKLE * pulse_mm(&transducer)).clamp(0.05, 10.0);
        let shown_mm = SHOWN_SAMPLES * probe.depth_mm / f64::from(probe.samples);
        let is_coarse = speckle.axial_mm.is_none() && pulse_mm < shown_mm;
        let axial_mm = speckle.axial_mm.unwrap_or(pulse_mm.max(shown_mm));
        let zone_mm = || (FOCAL_ZONE_MM / probe.frequency_mhz).clamp(1.0, 10_000.0);
        Self {
            axial_mm,
            samples_for_pulse: is_coarse.then(|| (SHOWN_SAMPLES * probe.depth_mm / pulse_mm).ceil() as u32),
            lateral_mm: speckle.lateral_mm.unwrap_or_else(|| beam.at(focus_mm).speckle_mm),
            elevational_mm: speckle
                .elevational_mm
                .unwrap_or_else(|| beam.elevation_at(transducer.lens_focus_mm).length_mm),
            is_elevational_stated: speckle.elevational_mm.is_some(),
            focus_mm,
            focal_zone_mm: is_stated.then(|| speckle.focal_zone_mm.unwrap_or_else(zone_mm)),
            pulse_mm: speckle.axial_mm.is_none().then_some([pulse_mm, shown_mm]),
            attenuation,
            beam,
        }
    }

    /// Axial lengths at a depth, mm: around a point, and in speckle.
    pub(crate) fn axial_lengths(&self, depth_mm: f64) -> [f64; 2] {
        let Some([pulse_mm, shown_mm]) = self.pulse_mm else {
            return [self.axial_mm; 2];
        };
        let axial_mm = (pulse_mm / self.attenuation.centre_at(depth_mm)).max(shown_mm);
        [axial_mm / IN_SPECKLE, axial_mm]
    }

    /// Lateral length at a depth, mm: of a stated length that of a Gaussian beam about its focus.
    pub fn lateral_at(&self, depth_mm: f64) -> f64 {
        self.lateral_lengths(depth_mm)[1]
    }

    /// Lateral lengths at a depth, mm: around a point, and in speckle.
    pub(crate) fn lateral_lengths(&self, depth_mm: f64) -> [f64; 2] {
        match self.focal_zone_mm {
            Some(zone_mm) => [self.lateral_mm * ((depth_mm - self.focus_mm) / zone_mm).hypot(1.0); 2],
            None => {
                let lengths = self.beam.at(depth_mm);
                [lengths.point_mm, lengths.speckle_mm]
            }
        }
    }

    /// Elevational profile at a depth: of a stated length that of a Gaussian beam.
    pub(crate) fn elevation_at(&self, depth_mm: f64) -> Profile {
        if self.is_elevational_stated {
            Profile::gaussian(self.elevational_mm)
        } else {
            self.beam.elevation_at(depth_mm)
        }
    }

    /// Distance at which the side lobes end at a depth, mm; 0 without any.
    pub(crate) fn lobes_mm(&self, depth_mm: f64) -> f64 {
        match self.focal_zone_mm {
            Some(_) => 0.0,
            None => self.beam.lobes_mm(depth_mm),
        }
    }

    /// Lateral kernel at a depth and a distance from the axis, mm, relative to its peak: `shape`, and where the beam is
    /// stronger its side lobes, which alternate from length to length.
    pub(crate) fn across(&self, shape: &Shape, depth_mm: f64, aside_mm: f64) -> f64 {
        let main = shape.weight(aside_mm);
        if self.focal_zone_mm.is_some() {
            return main;
        }
        let lobes = self.beam.lobes_at(depth_mm, aside_mm.abs());
        let beyond = (lobes * lobes - main * main).max(0.0);
        // Its mean square over a length is that of the envelope.
        main + (2.0 * beyond).sqrt() * (PI * aside_mm / self.beam.at(depth_mm).point_mm).cos()
    }
}

/// Length of a pulse around a point, mm of depth, of a Gaussian amplitude spectrum that is as wide.
fn pulse_mm(transducer: &Transducer) -> f64 {
    4.0 * LN_2 / PI * transducer.wavelength_mm / (2.0 * transducer.bandwidth)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulated::{self, AXIAL, CURVED_POINTS, CURVED_SPECKLE, LINEAR_POINTS, LINEAR_SPECKLE};
    use insonify_tracking::probe::{Aperture, Apodisation, Linear, Phased};

    /// Point spread of a probe of the simulation.
    fn simulated(is_curved: bool, apodisation: Apodisation) -> PointSpread {
        let probe = simulated::probe(is_curved, apodisation);
        PointSpread::new(&Speckle::default(), &probe, Attenuation::default())
    }

    #[test]
    fn a_filter_leaves_the_pulse_that_both_pass() {
        let mut probe = Probe::new(Linear { width_mm: 40.0 }, 50.0).unwrap();
        probe.samples = 8192;
        let axial_mm = |bandwidth: f64, filter: Option<f64>| {
            let mut probe = probe;
            probe.aperture.bandwidth = Some(bandwidth);
            let speckle = Speckle {
                receive_bandwidth: filter,
                ..Speckle::default()
            };
            PointSpread::new(&speckle, &probe, Attenuation::default()).axial_mm
        };
        for (bandwidth, filter, both) in [
            (0.6, 0.8, 0.48),
            (0.3, 0.4, 0.24),
            (0.6, 0.25, 0.2308),
            (0.05, 1.5, 0.04997),
        ] {
            let off = axial_mm(bandwidth, Some(filter)) / axial_mm(both, None) - 1.0;
            assert!(off.abs() < 1e-3, "{off} at {bandwidth} through {filter}");
        }
    }

    #[test]
    fn lengths_are_those_of_a_simulator_of_waves() {
        // Axial lengths around a point and in speckle, the means over depth.
        for (is_curved, points, speckle, axial) in [
            (false, &LINEAR_POINTS[..], &LINEAR_SPECKLE[..], AXIAL[0]),
            (true, &CURVED_POINTS, &CURVED_SPECKLE, AXIAL[1]),
        ] {
            let probes = [Apodisation::Hann, Apodisation::None].map(|weights| simulated(is_curved, weights));
            let hann = &probes[0];
            let close = |length: f64, expected: f64, within: f64| {
                let off = length / expected - 1.0;
                assert!(off.abs() < within, "{length} mm, not {expected}");
            };
            (0..2).for_each(|kind| close(hann.axial_lengths(20.0)[kind], axial[kind], 0.06));
            for [depth_mm, lateral @ .., elevational] in points {
                for (probe, lateral) in probes.iter().zip(lateral) {
                    close(probe.lateral_lengths(*depth_mm)[0], *lateral, 0.1);
                }
                close(hann.elevation_at(*depth_mm).length_mm, *elevational, 0.16);
            }
            for [depth_mm, lateral @ ..] in speckle {
                for (probe, lateral) in probes.iter().zip(lateral) {
                    close(probe.lateral_lengths(*depth_mm)[1], *lateral, 0.1);
                }
            }
        }
    }

    /// Side lobes 2 and 4 mm from a point 40 mm deep, or 4 and 8 mm from one 140 mm deep, against the simulation's
    /// highest within a few millimetres of the depth, dB.
    #[test]
    fn equal_weights_leave_side_lobes() {
        for (is_curved, depth_mm, lobes) in [
            (false, 40.0, [(2.0, -31.6), (4.0, -45.1)]),
            (true, 140.0, [(4.0, -33.9), (8.0, -43.9)]),
        ] {
            let [hann, none] = [Apodisation::Hann, Apodisation::None].map(|weights| simulated(is_curved, weights));
            for (aside_mm, db) in lobes {
                let lobe_db = 20.0 * none.beam.lobes_at(depth_mm, aside_mm).log10();
                assert!((lobe_db - db).abs() < 6.0, "{lobe_db} dB {aside_mm} mm aside, not {db}");
                assert!(hann.beam.lobes_at(depth_mm, aside_mm) < 0.01);
                let shape = Shape::new(1.0, 1.0, 0.0);
                let [left, right] = [-aside_mm, aside_mm].map(|mm| none.across(&shape, depth_mm, mm));
                assert!(left == right && left != 0.0, "{left} {right}");
            }
        }
    }

    #[test]
    fn a_pulse_that_samples_do_not_show_is_as_long_as_two_of_them() {
        let mut probe = Probe::new(Linear { width_mm: 40.0 }, 50.0).unwrap();
        let shown = |samples: u32| {
            probe.samples = samples;
            let spread = PointSpread::new(&Speckle::default(), &probe, Attenuation::default());
            (spread.axial_mm, spread.samples_for_pulse)
        };
        let [(coarse_mm, enough), (fine_mm, none)] = [400, 4000].map(shown);
        assert_eq!((coarse_mm, none), (0.25, None));
        // Half a pulse is a sample.
        assert_eq!(enough, Some((100.0 / fine_mm).ceil() as u32));
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
        let spread = PointSpread::new(&stated, &probe, Attenuation::default());
        assert_eq!((spread.axial_mm, spread.lateral_at(25.0)), (0.8, 3.0));
        assert!((spread.lateral_at(35.0) / 3.0 - 2f64.sqrt()).abs() < 1e-12);
        // A zone about the focus of the probe's own beam.
        let zone = Speckle {
            elevational_mm: Some(1.0),
            focal_zone_mm: Some(10.0),
            ..Speckle::default()
        };
        let [usual, about] =
            [Speckle::default(), zone].map(|speckle| PointSpread::new(&speckle, &probe, Attenuation::default()));
        assert_eq!(about.lateral_mm, usual.lateral_mm);
        assert!((about.lateral_at(35.0) / usual.lateral_mm - 2f64.sqrt()).abs() < 1e-12);
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
        let spread = PointSpread::new(&Speckle::default(), &probe, Attenuation::default());
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
                let spread = PointSpread::new(&Speckle::default(), &probe, Attenuation::default());
                for depth_mm in [0.0, 1.0, 25.0, 50.0] {
                    let lengths = [spread.axial_mm, spread.lateral_at(depth_mm), spread.elevational_mm];
                    assert!(lengths.iter().all(|mm| (0.05..=20.0).contains(mm)), "{lengths:?}");
                }
            }
        }
    }
}
