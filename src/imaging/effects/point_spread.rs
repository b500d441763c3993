//! Point spread of a probe: stated lengths, with defaults from its frequency and kind.
//!
//! Lengths are full widths at half maximum of the autocorrelation of the echo intensity and scale with the wavelength:
//! 0.8 x 1.5 mm at 3.5 MHz, 0.3 x 0.5 mm at 10 MHz, as in frames of phantoms and muscle at those frequencies.

use super::speckle::Speckle;
use insonify_tracking::probe::Probe;

/// Lengths at 1 MHz, mm: axial, lateral at the focus, elevational, and from the focus to where the lateral length has
/// grown by sqrt 2 (a Rayleigh length, which scales with the wavelength at constant f-number).
pub const AXIAL_MM: f64 = 2.8;
const LATERAL_MM: f64 = 5.25;
const ELEVATIONAL_MM: f64 = 6.3;
const FOCAL_ZONE_MM: f64 = 175.0;

/// Speed of sound, mm/us.
const SOUND_MM_US: f64 = 1.54;

/// Lengths of the point spread, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointSpread {
    /// Axial length.
    pub axial_mm: f64,
    /// Lateral length at the focus.
    pub lateral_mm: f64,
    /// Elevational length.
    pub elevational_mm: f64,
    /// Depth of the focus, mm.
    pub focus_mm: f64,
    focal_zone_mm: f64,
    /// Minimum lateral length divided by depth: the diffraction of the aperture.
    divergence: f64,
}

impl PointSpread {
    /// Completes the stated lengths with the defaults of a probe.
    pub fn new(speckle: &Speckle, probe: &Probe) -> Self {
        let mhz = probe.frequency_mhz;
        let scaled =
            |stated: Option<f64>, at_1_mhz: f64, largest: f64| stated.unwrap_or((at_1_mhz / mhz).clamp(0.05, largest));
        let aperture_mm = probe.shape.kind().shared_aperture_mm();
        Self {
            axial_mm: scaled(speckle.axial_mm, AXIAL_MM, 10.0),
            lateral_mm: scaled(speckle.lateral_mm, LATERAL_MM, 20.0),
            elevational_mm: scaled(speckle.elevational_mm, ELEVATIONAL_MM, 20.0),
            focus_mm: speckle.focus_mm.unwrap_or(probe.depth_mm / 2.0),
            focal_zone_mm: scaled(speckle.focal_zone_mm, FOCAL_ZONE_MM, 10_000.0).max(1.0),
            divergence: match (aperture_mm, speckle.lateral_mm) {
                (Some(aperture_mm), None) => SOUND_MM_US / mhz / aperture_mm,
                _ => 0.0,
            },
        }
    }

    /// Lateral length at a depth, mm: that of a Gaussian beam about its focus, bounded below by diffraction.
    pub fn lateral_at(&self, depth_mm: f64) -> f64 {
        let away = (depth_mm - self.focus_mm) / self.focal_zone_mm;
        (self.lateral_mm * (1.0 + away * away).sqrt()).max(self.divergence * depth_mm)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insonify_tracking::probe::{Linear, Phased};

    #[test]
    fn lengths_go_with_the_wavelength_unless_stated() {
        let mut probe = Probe::new(Linear { width_mm: 40.0 }, 50.0).unwrap();
        probe.frequency_mhz = 3.5;
        let spread = PointSpread::new(&Speckle::default(), &probe);
        let lengths = [spread.axial_mm, spread.lateral_at(25.0), spread.elevational_mm];
        assert!(
            lengths.iter().zip([0.8, 1.5, 1.8]).all(|(a, b)| (a - b).abs() < 1e-12),
            "{lengths:?}"
        );
        assert!((spread.lateral_at(75.0) / 1.5 - 2f64.sqrt()).abs() < 1e-12);
        probe.frequency_mhz = 10.0;
        let stated = Speckle {
            lateral_mm: Some(3.0),
            ..Speckle::default()
        };
        let spread = PointSpread::new(&stated, &probe);
        assert!((spread.axial_mm - 0.28).abs() < 1e-12 && spread.lateral_at(25.0) == 3.0);
    }

    /// 0.62 mm of wavelength over 20 mm of aperture: 4.9 mm at 160 mm.
    #[test]
    fn a_phased_array_is_limited_by_diffraction() {
        let probe = Probe::new(Phased { angle_deg: 80.0 }, 160.0).unwrap();
        let spread = PointSpread::new(&Speckle::default(), &probe);
        assert!((spread.lateral_at(160.0) - 160.0 * 0.616 / 20.0).abs() < 1e-9);
    }
}
