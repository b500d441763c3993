//! Keys of a needle that is a beam.

use super::beam::bending_stiffness_nmm2;
use super::model::{Keys, one_of};
use super::springs::{GOKSEL_MM, goksel_nmm2};
use super::{Bevel, ELEMENT_MM, Flexible, Needle, Shaft, Stiffness};
use insonify_base::range::{OutOfRange, check, parameters};

parameters! {
    /// Keys of a beam of Hermite elements.
    #[derive(Copy)]
    pub struct BeamKeys {
        /// Bevelled tip. Without it the needle is symmetric.
        bevel: Option<Bevel>;
        /// Bending stiffness EI, N mm^2, in place of another key of stiffness. Default 6131, that of a brachytherapy
        /// needle.
        bending_stiffness_nmm2: Option<f64>, above 0..=1e12;
        /// Length of an element, at most that of the needle. Default 5.
        element_mm: Option<f64>, in 0.5..=100 "mm";
        /// In place of `bending_stiffness_nmm2`: Young's modulus of a solid round rod, GPa; 200 for steel.
        young_gpa: Option<f64>, above 0..=1e12;
    }
}

impl BeamKeys {
    fn element_mm(&self, shaft: &Shaft) -> f64 {
        self.element_mm.unwrap_or(ELEMENT_MM.min(shaft.length_mm))
    }
}

impl Keys for BeamKeys {
    fn usual_mm(&self) -> Option<[f64; 2]> {
        Some(GOKSEL_MM)
    }

    fn check(&self, shaft: &Shaft) -> Result<(), OutOfRange> {
        one_of([
            ("young_gpa", self.young_gpa),
            ("bending_stiffness_nmm2", self.bending_stiffness_nmm2),
        ])?;
        let element = self.element_mm(shaft);
        let is_within = element <= shaft.length_mm;
        check("element_mm", element, is_within, "at most the needle's length, mm")?;
        self.bevel.map_or(Ok(()), |bevel| bevel.check(shaft))
    }

    fn needle(&self, shaft: Shaft) -> Result<Box<dyn Needle>, OutOfRange> {
        let of_rod = self.young_gpa;
        let of_rod = of_rod.map(|young| bending_stiffness_nmm2(young, 2.0 * shaft.radius_mm));
        let stiffness = self.bending_stiffness_nmm2.or(of_rod).unwrap_or_else(goksel_nmm2);
        let element = self.element_mm(&shaft);
        let needle = Flexible::beam(shaft, Stiffness::BendingNmm2(stiffness), element, self.bevel)?;
        Ok(Box::new(needle))
    }
}
