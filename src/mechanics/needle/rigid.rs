//! Rigid, straight needles.

use nalgebra::{Isometry3, Vector3};

use super::chain::Chain;
use super::model::Keys;
use super::{Bevel, CentreLine, Entry, Load, Needle, Shaft};
use insonify_base::range::{OutOfRange, parameters};

parameters! {
    /// Keys of a rigid needle.
    #[derive(Copy)]
    pub struct RigidKeys {
        /// Bevelled tip. Without it the needle is symmetric.
        bevel: Option<Bevel>;
    }
}

impl Keys for RigidKeys {
    fn check(&self, shaft: &Shaft) -> Result<(), OutOfRange> {
        self.bevel.map_or(Ok(()), |bevel| bevel.check(shaft))
    }

    fn needle(&self, shaft: Shaft) -> Result<Box<dyn Needle>, OutOfRange> {
        Ok(Box::new(Rigid::new(shaft, self.bevel)?))
    }

    fn is_straight(&self) -> bool {
        self.bevel.is_none()
    }
}

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

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Translation3, UnitQuaternion};

    use super::*;
    use crate::needle::Row;

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
    fn a_shaft_out_of_range_is_named() {
        let shaft = Shaft {
            radius_mm: 6.0,
            ..Shaft::default()
        };
        assert_eq!(Rigid::new(shaft, None).expect_err("too thick").key, "radius_mm");
    }
}
