//! Rigid needles.

use nalgebra::{Isometry3, Point3, Unit, Vector3};

use super::chain::Chain;
use super::{Bevel, CentreLine, Entry, Load, Needle, Shaft};
use crate::base::range::{OutOfRange, Ranges, parameters};

/// A straight needle, with or without a bevel.
#[derive(Clone, Debug)]
pub struct Rigid {
    chain: Chain,
    radius_mm: f64,
}

impl Rigid {
    /// Builds a needle of this size.
    ///
    /// # Errors
    /// [`OutOfRange`].
    pub fn new(shaft: Shaft, bevel: Option<Bevel>) -> Result<Self, OutOfRange> {
        shaft.check()?;
        bevel.map_or(Ok(()), |bevel| bevel.check(&shaft))?;
        Ok(Self {
            chain: Chain::new(shaft.length_mm, &[], bevel.as_ref()),
            radius_mm: shaft.radius_mm,
        })
    }
}

impl Needle for Rigid {
    fn length_mm(&self) -> f64 {
        self.chain.length_mm()
    }

    fn radius_mm(&self) -> f64 {
        self.radius_mm
    }

    fn place(&mut self, base: &Isometry3<f64>, _: Option<&Entry>, _: &[Load], _: &[Load], line: &mut CentreLine) {
        self.chain.place(base, line, |_, _| Vector3::zeros());
    }
}

parameters! {
    /// Keeps the inserted part of a needle near the direction in which it entered, as tissue does, while the sensor at its hub
    /// follows the hand.
    ///
    /// The constrained direction is `d_c = w d_e + (1 - w) d_m`, normalised, of the entry direction `d_e` and the measured one
    /// `d_m`, with `w = max_weight / (1 + exp(-alpha (l - delta)))` of the inserted length `l` (section 2.3 of the training
    /// system for ultrasound-guided needle insertion that the imaging model follows). Zhu et al. 2007 give 0.9, 60 and 0.12
    /// without units: they suit a length in metres, so that bending is free at first and constrained from about 120 mm on. Here
    /// lengths are millimetres: `alpha` is 0.06 per mm, `delta` 120 mm.
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

    /// Returns the constrained direction of the inserted part: the entry direction where the two are opposite and cancel.
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

/// A straight needle whose inserted part is kept near the direction in which it entered (Zhu et al. 2007, section 2.3):
/// straight from the base to the entry point, then along the constrained direction for the remaining length. Straight along
/// the base while it is not in the body, or too short to reach the entry point.
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
    use crate::mechanics::needle::Row;

    fn slanted() -> Isometry3<f64> {
        let turn = UnitQuaternion::from_euler_angles(0.4, -1.1, 2.3);
        Isometry3::from_parts(Translation3::new(31.0, -70.0, 12.5), turn)
    }

    #[test]
    fn no_force_bends_a_rigid_needle_and_its_bevel_rolls_with_the_base() {
        let bevel = Bevel {
            r_mm: 0.6,
            length_mm: 3.0,
        };
        let loads = [Load {
            arc_mm: 200.0,
            force_n: Vector3::new(9.0, 0.0, 0.0),
        }];
        let mut needle = Rigid::new(Shaft::default(), Some(bevel)).expect("needle");
        let mut line = CentreLine::default();
        for roll in [0.0, 1.0, std::f64::consts::PI] {
            let base = slanted() * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), roll);
            needle.place(&base, None, &loads, &loads, &mut line);
            assert_eq!(line.nodes().len(), 3);
            let (sine, cosine) = roll.sin_cos();
            let tip = Point3::new(0.6 * cosine, 0.6 * sine, 197.0 + (9.0f64 - 0.36).sqrt());
            assert!((line.tip() - slanted() * tip).norm() < 1e-12);
        }
        let mut out = [0.0];
        let row = Row {
            arc_mm: 100.0,
            direction: Vector3::x(),
        };
        needle.linearise(&line, &loads, &[row], &mut [0.0], &mut out);
        assert_eq!((out[0], needle.is_flexible()), (0.0, false));
    }

    #[test]
    fn a_constrained_needle_passes_its_entry_and_keeps_its_length() {
        let constraint = BendingConstraint::default();
        let mut needle = Constrained::new(Shaft::default(), constraint).expect("needle");
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
        let shaft = Shaft {
            radius_mm: 6.0,
            ..Shaft::default()
        };
        assert_eq!(Rigid::new(shaft, None).expect_err("too thick").key, "radius_mm");
    }

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
