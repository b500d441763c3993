//! Parameters to estimate, and the effects built from them.

use insonify_base::statistics::mean;
use insonify_imaging::effects::point_spread::PointSpread;
use insonify_imaging::effects::receiver::{CLUTTER_DB, Receiver};
use insonify_imaging::effects::shadow::{Attenuation, SOFT_TISSUE_DB_CM_MHZ};
use insonify_imaging::effects::tone::{MID_GREY, Tone};
use insonify_imaging::effects::{Effects, speckle::Speckle};
use insonify_tracking::probe::Probe;

/// Axial length in frames of scanners, whose filters leave less than the bandwidth of the probe, at 1 MHz, mm: 0.8 mm
/// at 3.5 MHz, 0.3 mm at 10 MHz, in phantoms and muscle.
const AXIAL_MM: f64 = 2.8;
/// Relative spread of lateral widths over depth below which they count as constant.
const CONSTANT: f64 = 0.05;

/// Parameters to estimate.
#[derive(Clone, Debug)]
pub(super) struct Model {
    pub axial_mm: f64,
    pub lateral_mm: f64,
    pub focus_mm: f64,
    pub focal_zone_mm: f64,
    pub tone: Tone,
    pub receiver: Receiver,
}

/// Rounds a value to four significant digits, as written to files.
pub(super) fn rounded(value: f64) -> f64 {
    let digits = (3.0 - value.abs().max(1e-3).log10().floor()) as i32;
    let scale = 10f64.powi(digits);
    (value * scale).round() / scale
}

impl Model {
    /// Returns the default effects under a probe, except for automatic gain and the curve.
    pub(super) fn start(probe: &Probe) -> Self {
        let spread = PointSpread::new(&Speckle::default(), probe, Attenuation::default());
        Self {
            axial_mm: AXIAL_MM / probe.frequency_mhz,
            lateral_mm: spread.lateral_mm,
            focus_mm: spread.focus_mm,
            focal_zone_mm: 1e4,
            tone: Tone::linear(),
            receiver: Receiver {
                clutter_db: Some(CLUTTER_DB),
                ..Receiver::default()
            },
        }
    }

    /// Returns the frequency at which frames of scanners have this axial length, MHz, limited to the range of clinical
    /// probes.
    fn frequency_mhz(&self) -> f64 {
        rounded((AXIAL_MM / self.axial_mm).clamp(1.0, 20.0))
    }

    pub(super) fn tgc_db_cm(&self) -> f64 {
        2.0 * SOFT_TISSUE_DB_CM_MHZ * self.frequency_mhz()
    }

    pub(super) fn probe(&self, probe: Probe) -> Probe {
        let frequency_mhz = self.frequency_mhz();
        Probe { frequency_mhz, ..probe }
    }

    /// Returns the default effects with these parameters, rounded as they are written.
    pub(super) fn effects(&self) -> Effects {
        let [lateral, axial] = [self.lateral_mm, self.axial_mm].map(rounded);
        let tone = Tone {
            gain_db: rounded(self.tone.gain_db),
            tgc_db_cm: Some(self.tgc_db_cm()),
            tgc_points: self.tone.tgc_points.iter().map(|point| point.map(rounded)).collect(),
            dynamic_range_db: rounded(self.tone.dynamic_range_db),
            ..self.tone.clone()
        };
        Effects {
            speckle: Some(Speckle {
                receive_bandwidth: None,
                axial_mm: Some(axial),
                lateral_mm: Some(lateral),
                // One plane does not show it: it follows the frequency.
                elevational_mm: None,
                focus_mm: Some(rounded(self.focus_mm)),
                focal_zone_mm: Some(rounded(self.focal_zone_mm)),
            }),
            receiver: Some(Receiver {
                noise_db: rounded(self.receiver.noise_db),
                clutter_db: self.receiver.clutter_db.map(rounded),
                clutter_decay_db_cm: rounded(self.receiver.clutter_decay_db_cm),
                ..self.receiver
            }),
            tone: Some(tone),
            // What it would add is estimated as clutter.
            haze: None,
            ..Effects::usual()
        }
    }

    pub(super) fn spread(&self, probe: &Probe) -> PointSpread {
        PointSpread::new(
            &self.effects().speckle.unwrap_or_default(),
            probe,
            Attenuation::default(),
        )
    }

    /// Returns gain plus compensation at a depth, dB.
    pub(super) fn gain_db(&self, depth_mm: f64) -> f64 {
        self.effects()
            .tone
            .map_or(0.0, |tone| tone.gain_at_db(depth_mm, 0.0, None))
    }

    /// Returns the level of a grey before gain, dB relative to the echo of liver at the array.
    pub(super) fn level_db(&self, grey: f64, depth_mm: f64) -> f64 {
        self.shown_db(grey) - self.gain_db(depth_mm)
    }

    /// Returns the level of a grey after gain, dB.
    pub(super) fn shown_db(&self, grey: f64) -> f64 {
        (grey / 255.0 - MID_GREY) * self.tone.dynamic_range_db
    }

    /// Fits a Gaussian beam about its focus to lateral lengths at some depths, by least squares of their logarithms.
    pub(super) fn focus(&mut self, depths: &[[f64; 2]], depth_mm: f64) {
        let fit = |focus: f64, zone: f64| {
            let shape = |depth: f64| (1.0 + ((depth - focus) / zone).powi(2)).sqrt().ln();
            let residuals: Vec<f64> = depths.iter().map(|[depth, width]| width.ln() - shape(*depth)).collect();
            let middle = mean(&residuals);
            (
                residuals.iter().map(|r| (r - middle).powi(2)).sum::<f64>(),
                middle.exp(),
                focus,
                zone,
            )
        };
        let mut best = fit(depth_mm / 2.0, 1e4);
        if best.0 > depths.len() as f64 * CONSTANT * CONSTANT && depths.len() > 2 {
            for focus in (0..=40).map(|n| f64::from(n) / 40.0 * depth_mm) {
                // From a tenth of the depth to twice the depth: shorter zones fit structure.
                for zone in (0..=30).map(|n| 0.1 * 20f64.powf(f64::from(n) / 30.0) * depth_mm) {
                    let tried = fit(focus, zone.max(1.0));
                    if tried.0 < best.0 {
                        best = tried;
                    }
                }
            }
        }
        (self.lateral_mm, self.focus_mm, self.focal_zone_mm) = (best.1.clamp(0.05, 20.0), best.2, best.3);
    }
}
