//! Downshift: tissue takes more of the higher frequencies of a pulse than of the lower ones, so that its centre sinks
//! with depth and less is lost than at the frequency of the probe.
//!
//! Of a Gaussian amplitude spectrum of fractional bandwidth `B` at half maximum, attenuation in proportion to frequency
//! that takes `A` dB at the probe's frequency leaves a Gaussian as wide about `1 - 2 c A` of that frequency, and takes
//! `A - c A^2` dB of the pulse, with `c = ln 10 / 40 (B / 2.355)^2` (K. A. Dines and A. C. Kak, Ultrasonic Imaging 1
//! (1979) 16). Occlusion and needles, which are losses at any frequency, are felt in full.

use super::{MAX_UNITS, SOFT_TISSUE_DB_CM_MHZ};
use crate::effects::buffers::UNITS_PER_DB;
use crate::effects::lateral::FWHM_PER_SIGMA;
use crate::synth::tables::Settings;
use insonify_anatomy::acoustics::TissueTable;
use insonify_base::real::Real;

/// One-way attenuation of fluids, dB/cm/MHz, at most: blood has 0.2, bile and urine less than 0.1 (Szabo, Diagnostic
/// Ultrasound Imaging, 2nd ed., 2014, appendix B).
const FLUID_DB_CM_MHZ: f64 = 0.2;

/// Least centre of a pulse over the frequency of the probe: elements hardly send below half of it.
const LEAST_CENTRE: f64 = 0.5;

/// What attenuation does to the pulses of a probe; by default nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Downshift {
    /// Share of a loss that is not felt, per dB of it.
    per_db: f64,
    /// Loss at the frequency of the probe that brings the centre to [`LEAST_CENTRE`], dB.
    least_at_db: f64,
}

impl Downshift {
    /// That of pulses of a fractional bandwidth at half maximum of the amplitude.
    pub fn new(bandwidth: f64) -> Self {
        let per_db = std::f64::consts::LN_10 / 40.0 * (bandwidth / FWHM_PER_SIGMA).powi(2);
        Self {
            per_db,
            least_at_db: (1.0 - LEAST_CENTRE) / (2.0 * per_db),
        }
    }

    /// Centre of a pulse over the frequency of the probe, after attenuation that takes `db` there.
    pub fn centre(&self, db: f64) -> f64 {
        1.0 - 2.0 * self.per_db * db.min(self.least_at_db)
    }

    /// What attenuation that takes `db` at the frequency of the probe takes of a pulse, dB. Beyond the least centre it
    /// takes as much as at that frequency.
    pub fn felt_db(&self, db: f64) -> f64 {
        let shifting = db.min(self.least_at_db);
        db - self.per_db * shifting * (2.0 * db - shifting)
    }

    /// The same in units of fixed point: what is not felt per unit, and units up to the least centre.
    pub(crate) fn in_units(&self) -> [f64; 2] {
        [self.per_db / UNITS_PER_DB, self.least_at_db * UNITS_PER_DB]
    }
}

/// Two-way attenuation with depth in one tissue; by default none.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Attenuation {
    /// At the frequency of the probe.
    db_mm: f64,
    downshift: Downshift,
}

impl Attenuation {
    /// That of average soft tissue, which receivers compensate for; none if no attenuation is simulated.
    pub(crate) fn average(settings: &Settings) -> Self {
        Self::new(SOFT_TISSUE_DB_CM_MHZ, settings)
    }

    /// That of the tissues of an anatomy: of those that attenuate and do not occlude the middle one, and of two in the
    /// middle the lower.
    pub(crate) fn of(tissues: &TissueTable, settings: &Settings) -> Self {
        let present = tissues
            .of_label
            .iter()
            .skip(1)
            .map(|tissue| &tissues.tissues[usize::from(*tissue)]);
        let mut rates: Vec<f64> = present
            .filter(|tissue| !tissue.is_occluder() && tissue.attenuation_db_cm_mhz > FLUID_DB_CM_MHZ)
            .map(|tissue| tissue.attenuation_db_cm_mhz)
            .collect();
        rates.sort_by(f64::total_cmp);
        let middle = rates.get(rates.len().saturating_sub(1) / 2);
        Self::new(middle.copied().unwrap_or(0.0), settings)
    }

    fn new(db_cm_mhz: f64, settings: &Settings) -> Self {
        let probe = &settings.probe;
        let shadow = settings.effects.shadow.as_ref();
        if !shadow.is_some_and(|shadow| shadow.attenuation) {
            return Self::default();
        }
        Self {
            db_mm: 2.0 * db_cm_mhz * probe.frequency_mhz / 10.0,
            downshift: Downshift::new(probe.transducer().bandwidth),
        }
    }

    /// What it takes of a pulse from a depth, dB.
    pub(crate) fn db_at(&self, depth_mm: f64) -> f64 {
        self.downshift.felt_db(self.db_mm * depth_mm)
    }

    /// Centre of a pulse from a depth over the frequency of the probe.
    pub(crate) fn centre_at(&self, depth_mm: f64) -> f64 {
        self.downshift.centre(self.db_mm * depth_mm)
    }
}

/// What a pulse feels of attenuation and of other losses, both sums of at most [`MAX_UNITS`], by
/// [`Downshift::in_units`].
#[inline(always)]
pub(super) fn felt<T: Real>([attenuation, other]: [u32; 2], [per_unit, least_at]: [T; 2]) -> u32 {
    let units = T::from_signed(attenuation as i32);
    let shifting = units.min(least_at);
    let unfelt = per_unit * shifting * (units + units - shifting);
    (attenuation - unfelt.natural() + other).min(MAX_UNITS)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Depth, energy lost and axial length at 0.5 dB/cm/MHz, of pulses from a linear array of 7.6 MHz and a curved one
    /// of 3.57 MHz: closed form of the spectra of SIMUS (D. Garcia, Computer Methods and Programs in Biomedicine 218
    /// (2022) 106726).
    const SIMULATED: [(f64, [[f64; 3]; 4]); 2] = [
        (
            7.6,
            [
                [10.0, 7.09, 0.165],
                [20.0, 13.74, 0.173],
                [30.0, 20.02, 0.185],
                [40.0, 26.00, 0.201],
            ],
        ),
        (
            3.57,
            [
                [15.0, 5.03, 0.341],
                [60.0, 18.80, 0.384],
                [105.0, 31.11, 0.463],
                [135.0, 38.78, 0.526],
            ],
        ),
    ];

    /// Losses within 1 dB and lengths within 5 %, from the first depth on.
    #[test]
    fn losses_and_lengths_are_those_of_a_simulator_of_waves() {
        for (mhz, rows) in SIMULATED {
            let downshift = Downshift::new(0.6);
            let at_centre = |depth_mm: f64| 2.0 * 0.5 * mhz * depth_mm / 10.0;
            let [first_mm, first_db, first_length] = rows[0];
            for [depth_mm, lost_db, length] in rows {
                let felt_db = downshift.felt_db(at_centre(depth_mm)) - downshift.felt_db(at_centre(first_mm));
                assert!(
                    (felt_db - (lost_db - first_db)).abs() < 1.0,
                    "{felt_db} dB down to {depth_mm} mm"
                );
                let longer = downshift.centre(at_centre(first_mm)) / downshift.centre(at_centre(depth_mm));
                let off = longer * first_length / length - 1.0;
                assert!(
                    off.abs() < 0.05,
                    "{longer} times as long at {depth_mm} mm, off by {off}"
                );
            }
        }
    }

    /// Energy of a spectrum summed frequency by frequency.
    #[test]
    fn the_closed_form_is_the_sum_over_the_spectrum() {
        for bandwidth in [0.1, 0.4, 0.6] {
            let downshift = Downshift::new(bandwidth);
            let energy = |db: f64| {
                let amplitude = |step: i32| {
                    let frequency = f64::from(step) / 1000.0;
                    let off = (frequency - 1.0) * FWHM_PER_SIGMA / bandwidth;
                    (-0.5 * off * off).exp() * 10f64.powf(-db * frequency / 20.0)
                };
                (-2000..4000).map(|step| amplitude(step).powi(2)).sum::<f64>()
            };
            for db in [0.0, 10.0, 40.0] {
                let summed_db = -10.0 * (energy(db) / energy(0.0)).log10();
                let felt_db = downshift.felt_db(db);
                assert!(
                    (felt_db - summed_db).abs() < 1e-6,
                    "{felt_db}, not {summed_db} of {db} dB at {bandwidth}"
                );
                let in_units = downshift.in_units();
                let units = felt([(db * UNITS_PER_DB) as u32, 7], in_units);
                assert!((f64::from(units - 7) / UNITS_PER_DB - felt_db).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn the_loss_grows_with_every_unit_at_any_bandwidth() {
        for bandwidth in [0.05, 0.6, 1.5] {
            let downshift = Downshift::new(bandwidth);
            let mut before = -1.0;
            for step in 0..4000 {
                let felt_db = downshift.felt_db(0.5 * f64::from(step));
                assert!(felt_db > before, "{felt_db} dB after {before} at {bandwidth}");
                before = felt_db;
            }
            let units = |sum: u32| felt([sum, MAX_UNITS], downshift.in_units());
            assert_eq!(units(MAX_UNITS), MAX_UNITS);
            assert!((0.5..=1.0).contains(&downshift.centre(1e4)));
        }
    }
}
