//! Bending constraint of a tracked needle.

use nalgebra::{Point3, Unit, Vector3};

use super::{BendingConstraint, NeedlePose};
use crate::tracking::error::{TrackingError, within};

impl BendingConstraint {
    /// Checks every number against its documented range.
    pub fn validate(&self) -> Result<(), TrackingError> {
        let mut numbers = self.ranges().into_iter();
        numbers.try_for_each(|(key, found, range)| within("needle", key, found, range))
    }

    /// Returns the constrained shape of a needle whose straight measured pose enters at `entry_mm`: from the measured hub to
    /// the entry point, then along the constrained direction for the remaining length. A needle too short to reach the entry
    /// point, or with its hub on it, is left as measured.
    pub fn constrain(
        &self,
        measured: &NeedlePose,
        entry_mm: Point3<f64>,
        entry_direction: &Unit<Vector3<f64>>,
    ) -> NeedlePose {
        let outside = (entry_mm - measured.hub_mm()).norm();
        let inserted = measured.length_mm() - outside;
        let direction = self.direction(entry_direction, &measured.direction(), inserted);
        let nodes = vec![measured.hub_mm(), entry_mm, entry_mm + direction.scale(inserted)];
        if inserted > 0.0 {
            NeedlePose::bent(nodes, measured.diameter_mm()).unwrap_or_else(|_| measured.clone())
        } else {
            measured.clone()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_constrained_shaft_passes_the_entry_point_and_keeps_its_length() {
        let constraint = BendingConstraint::default();
        let measured = NeedlePose::straight(Point3::new(40.0, 100.0, 0.0), Vector3::new(0.4, 1.0, 0.0), 200.0, 1.0);
        let measured = measured.expect("needle");
        let entry = Point3::new(0.0, 0.0, 0.0);
        let bent = constraint.constrain(&measured, entry, &Vector3::y_axis());
        assert_eq!(bent.nodes_mm().len(), 3);
        assert_eq!((bent.hub_mm(), bent.nodes_mm()[1]), (measured.hub_mm(), entry));
        assert!((bent.length_mm() - 200.0).abs() < 1e-9);
        let far = constraint.constrain(&measured, Point3::new(0.0, 500.0, 0.0), &Vector3::y_axis());
        assert_eq!(far, measured);
    }

    #[test]
    fn ranges_are_checked() {
        let read = |text: &str| toml::from_str::<BendingConstraint>(text).expect(text);
        assert_eq!(read(""), BendingConstraint::default());
        assert!(read("max_weight = 1.5").validate().is_err());
        assert!(read("delta_mm = nan").validate().is_err());
        assert!(toml::from_str::<BendingConstraint>("alpha = 60").is_err());
    }
}
