//! How tissue bends a needle that a sensor at its hub tracks.

use nalgebra::{Unit, Vector3};

use crate::range::parameters;

parameters! {
    /// Keeps the inserted part of a needle near the direction in which it entered, as tissue does, while the sensor at
    /// its hub follows the hand.
    ///
    /// The constrained direction is `d_c = w d_e + (1 - w) d_m`, normalised, of the entry direction `d_e` and the
    /// measured one `d_m`, with `w = max_weight / (1 + exp(-alpha (l - delta)))` of the inserted length `l` (section
    /// 2.3 of the training system for ultrasound-guided needle insertion that the imaging model follows). Zhu et al.
    /// 2007 give 0.9, 60 and 0.12 without units: they suit a length in metres, so that bending is free at first and
    /// constrained from about 120 mm on. Here lengths are millimetres: `alpha` is 0.06 per mm, `delta` 120 mm.
    #[derive(Copy)]
    pub struct BendingConstraint {
        /// Largest weight of the entry direction.
        max_weight: f64 = 0.9, in 0..=1;
        /// Steepness of the transition to constrained bending, 1/mm.
        alpha_per_mm: f64 = 0.06, in 0..=10;
        /// Inserted length at which half the weight is reached, mm.
        delta_mm: f64 = 120.0, in 0..=1000;
    }
}

impl BendingConstraint {
    /// Returns the weight of the entry direction at an inserted length, mm.
    pub fn weight(&self, inserted_mm: f64) -> f64 {
        self.max_weight / (1.0 + (-self.alpha_per_mm * (inserted_mm - self.delta_mm)).exp())
    }

    /// Returns the constrained direction of the inserted part: the entry direction where the two are opposite and
    /// cancel.
    pub fn direction(
        &self,
        entry: &Unit<Vector3<f64>>,
        measured: &Unit<Vector3<f64>>,
        inserted_mm: f64,
    ) -> Unit<Vector3<f64>> {
        let weight = self.weight(inserted_mm);
        let blend = entry.scale(weight) + measured.scale(1.0 - weight);
        Unit::try_new(blend, 1e-9).unwrap_or(*entry)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_weight_rises_from_free_to_constrained() {
        let constraint = BendingConstraint::default();
        assert!((constraint.weight(120.0) - 0.45).abs() < 1e-12);
        // The numbers of Zhu et al. in metres: 0.9 / (1 + exp(-60 (0.05 - 0.12))).
        assert!((constraint.weight(50.0) - 0.9 / (1.0 + 4.2f64.exp())).abs() < 1e-12);
        assert!(constraint.weight(0.0) < 1e-3 && constraint.weight(220.0) > 0.89);
    }

    #[test]
    fn the_inserted_part_lies_between_measured_and_entry_direction() {
        let constraint = BendingConstraint::default();
        let entry = Vector3::y_axis();
        let measured = Unit::new_normalize(Vector3::new(0.3, 1.0, 0.0));
        let angle = |inserted| constraint.direction(&entry, &measured, inserted).angle(&entry);
        assert!((angle(0.0) - measured.angle(&entry)).abs() < 1e-3);
        assert!(angle(60.0) > angle(120.0) && angle(120.0) > angle(200.0) && angle(200.0) > 0.0);
        let opposite = BendingConstraint {
            max_weight: 1.0,
            ..constraint
        };
        assert_eq!(opposite.direction(&entry, &-entry, 120.0), entry);
    }
}
