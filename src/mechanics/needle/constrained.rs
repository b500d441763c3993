//! Needles bent by a constraint.

use nalgebra::{Isometry3, Point3, Unit, Vector3};

use super::model::Keys;
use super::{CentreLine, Entry, Load, Needle, Shaft};
use insonify_base::bending::BendingConstraint;
use insonify_base::range::{OutOfRange, Ranges, parameters};

parameters! {
    /// Keys of a needle bent by a constraint.
    #[derive(Copy)]
    pub struct ConstrainedKeys {
        /// Limits of bending.
        bending: Option<BendingConstraint>;
    }
}

impl Keys for ConstrainedKeys {
    fn check(&self, _: &Shaft) -> Result<(), OutOfRange> {
        let checked = self.bending.unwrap_or_default().check_ranges();
        checked.map_err(|error| OutOfRange {
            key: format!("bending.{}", error.key),
            ..error
        })
    }

    fn needle(&self, shaft: Shaft) -> Result<Box<dyn Needle>, OutOfRange> {
        Ok(Box::new(Constrained::new(shaft, self.bending.unwrap_or_default())?))
    }
}

/// A straight needle whose inserted part is kept near the direction in which it entered (Zhu et al. 2007, section 2.3):
/// straight from the base to the entry point, then along the constrained direction for the remaining length. Straight
/// along the base while it is not in the body, or too short to reach the entry point.
#[derive(Clone, Debug)]
pub struct Constrained {
    shaft: Shaft,
    constraint: BendingConstraint,
}

impl Constrained {
    /// Builds a needle of this size with this constraint.
    ///
    /// # Errors
    /// [`OutOfRange`].
    pub fn new(shaft: Shaft, constraint: BendingConstraint) -> Result<Self, OutOfRange> {
        shaft.check()?;
        constraint.check_ranges()?;
        Ok(Self { shaft, constraint })
    }
}

impl Needle for Constrained {
    fn length_mm(&self) -> f64 {
        self.shaft.length_mm
    }

    fn radius_mm(&self) -> f64 {
        self.shaft.radius_mm
    }

    fn place(&mut self, base: &Isometry3<f64>, entry: Option<&Entry>, _: &[Load], _: &[Load], line: &mut CentreLine) {
        let (hub, length) = (Point3::from(base.translation.vector), self.shaft.length_mm);
        let measured = Unit::new_normalize(base.rotation * Vector3::z());
        let outside = entry.map_or(0.0, |entry| (entry.point_mm - hub).norm());
        let inserted = length - outside;
        match entry {
            // Otherwise nodes would coincide.
            Some(entry) if outside > MIN_MM && inserted > MIN_MM => {
                let constrained = self.constraint.direction(&entry.direction, &measured, inserted);
                let tip = entry.point_mm + constrained.scale(inserted);
                line.set([(0.0, hub), (outside, entry.point_mm), (length, tip)]);
            }
            _ => line.set([(0.0, hub), (length, hub + measured.scale(length))]),
        }
    }
}

/// Length below which a part of the shaft has no direction, mm.
const MIN_MM: f64 = 1e-6;

#[cfg(test)]
mod tests {
    use nalgebra::{Translation3, UnitQuaternion};

    use super::*;

    fn slanted() -> Isometry3<f64> {
        let turn = UnitQuaternion::from_euler_angles(0.4, -1.1, 2.3);
        Isometry3::from_parts(Translation3::new(31.0, -70.0, 12.5), turn)
    }

    #[test]
    fn a_constrained_needle_passes_its_entry_and_keeps_its_length() {
        let constraint = BendingConstraint::default();
        let mut needle = Constrained::new(Shaft::default(), constraint).expect("needle");
        let shaft = Shaft::default();
        assert_eq!(
            [needle.length_mm(), needle.radius_mm()],
            [shaft.length_mm, shaft.radius_mm]
        );
        let (base, mut line) = (slanted(), CentreLine::default());
        let measured = Unit::new_normalize(base.rotation * Vector3::z());
        needle.place(&base, None, &[], &[], &mut line);
        assert!((line.tip() - base * Point3::new(0.0, 0.0, 200.0)).norm() < 1e-12);
        let entry = Entry {
            point_mm: base * Point3::new(6.0, 0.0, 40.0),
            direction: Unit::new_normalize(base.rotation * Vector3::new(0.2, 0.0, 1.0)),
        };
        needle.place(&base, Some(&entry), &[], &[], &mut line);
        let outside = 6.0f64.hypot(40.0);
        let (arc, middle) = line.nodes()[1];
        assert!((arc - outside).abs() < 1e-12 && middle == entry.point_mm);
        let constrained = constraint.direction(&entry.direction, &measured, 200.0 - outside);
        assert!((line.tip() - (entry.point_mm + constrained.scale(200.0 - outside))).norm() < 1e-12);
        assert!(constrained.angle(&entry.direction) < constrained.angle(&measured));
        // Too short, or with its base at the entry: straight.
        for point in [Point3::new(0.0, 0.0, 200.0), Point3::origin()] {
            let entry = Entry {
                point_mm: base * point,
                ..entry
            };
            needle.place(&base, Some(&entry), &[], &[], &mut line);
            assert_eq!(line.nodes().len(), 2);
        }
    }

    #[test]
    fn a_constraint_out_of_range_is_named() {
        let constraint = BendingConstraint {
            delta_mm: f64::NAN,
            ..BendingConstraint::default()
        };
        let error = Constrained::new(Shaft::default(), constraint).expect_err("no number");
        assert_eq!(error, OutOfRange::new("delta_mm", f64::NAN, "0 to 1000"));
    }
}
