//! Dimensions of a needle and its bevel.

use nalgebra::Vector3;

use crate::base::range::{OutOfRange, Ranges, check, parameters};

/// The shaft of a needle. The default is a brachytherapy needle: 200 mm long, 0.64 mm in radius (the radius from Goksel et
/// al. 2011, section III-C).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shaft {
    /// Length from base to tip, mm (0.1 to 1000).
    pub length_mm: f64,
    /// Radius, mm (0.025 to 5).
    pub radius_mm: f64,
}

impl Default for Shaft {
    fn default() -> Self {
        Self {
            length_mm: 200.0,
            radius_mm: 0.64,
        }
    }
}

impl Shaft {
    /// Checks both numbers against their ranges.
    ///
    /// # Errors
    /// [`OutOfRange`].
    pub fn check(&self) -> Result<(), OutOfRange> {
        let (length, radius) = (self.length_mm, self.radius_mm);
        check("length_mm", length, (0.1..=1000.0).contains(&length), "0.1 to 1000")?;
        check("radius_mm", radius, (0.025..=5.0).contains(&radius), "0.025 to 5")
    }
}

/// Default length of a bevel, mm: with r = 0.6 mm it deflects the tip by the 10.4 mm of Goksel et al. 2011 (figure 10c) in
/// PVC of 20 kPa, 140 mm deep, on cells of 10 mm (9.4 mm on cells of 5 mm).
pub const BEVEL_MM: f64 = 18.0;

parameters! {
    /// The bevel of a needle's tip, as a tilt of the last part of its centre line (Goksel et al. 2011, section III-C).
    ///
    /// Tissue is cut at the edge of the tip, which lies off the centre line. The cut tissue then slides onto the centre line, so
    /// it is pulled to one side, away from the edge; its elastic response pushes the needle the other way, towards the edge, and
    /// a flexible needle follows. The tip is placed `r_mm` off the centre line towards +x of the frame of the last link, which
    /// is the side to which the needle deflects: roll of the base steers it, for the shaft has no torsion.
    ///
    /// In three dimensions the cut runs around a rim, not through one point, so `r_mm` is not a dimension of the needle but is
    /// fitted: Goksel et al. 2011 find 0.6 mm for a brachytherapy needle of 0.64 mm radius.
    #[derive(Copy)]
    #[schemars(rename = "BevelSpec")]
    pub struct Bevel with required keys {
        /// Distance of the tip from the centre line, less than `length_mm`. With 0 the needle has no bevel.
        r_mm: f64, in 0..=5 "mm";
        /// Length of the tilted part, at most that of the needle. Default 18: fitted to the deflection of 10.4 mm in Goksel et al. 2011, figure 10c.
        #[serde(default = "usual_length")]
        length_mm: f64, above 0 "mm";
    }
}

fn usual_length() -> f64 {
    BEVEL_MM
}

impl Bevel {
    /// Checks both numbers against their ranges, for a needle.
    ///
    /// # Errors
    /// [`OutOfRange`].
    pub fn check(&self, shaft: &Shaft) -> Result<(), OutOfRange> {
        let (r, length) = (self.r_mm, self.length_mm);
        let checked = self
            .check_ranges()
            .and_then(|()| {
                check(
                    "length_mm",
                    length,
                    length <= shaft.length_mm,
                    "at most the length of the needle",
                )
            })
            .and_then(|()| check("r_mm", r, r < length, "less than the length of the bevel"));
        checked.map_err(|error| OutOfRange {
            key: format!("bevel.{}", error.key),
            ..error
        })
    }

    /// Returns the direction of the tilted part in the frame of its link.
    pub(super) fn direction(&self) -> Vector3<f64> {
        let sine = self.r_mm / self.length_mm;
        Vector3::new(sine, 0.0, (1.0 - sine * sine).sqrt())
    }
}
