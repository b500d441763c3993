//! Keys of a needle of links and springs.

use super::model::{Keys, one_of};
use super::{Bevel, Flexible, LINK_MM, Needle, Shaft, Stiffness};
use insonify_base::range::{OutOfRange, check, parameters};

/// Length and diameter of the needle of Goksel et al. 2011, mm.
pub(super) const GOKSEL_MM: [f64; 2] = [200.0, 1.28];
/// Stiffness of its joints, N mm per degree.
const KAPPA_NMM_PER_DEG: f64 = 10.7;

parameters! {
    /// Keys of rigid links joined by angular springs.
    #[derive(Copy)]
    pub struct SpringsKeys {
        /// Bevelled tip. Without it the needle is symmetric.
        bevel: Option<Bevel>;
        /// Stiffness of a joint between links of 10 mm, N mm per degree. Default 10.7, that of a brachytherapy needle;
        /// joint stiffness is inversely proportional to the link length.
        kappa_nmm_per_deg: Option<f64>, above 0..=1e12;
        /// Bending stiffness EI, N mm^2, in place of another key of stiffness. Default 6131, that of a brachytherapy
        /// needle.
        bending_stiffness_nmm2: Option<f64>, above 0..=1e12;
        /// Length of a link, at most that of the needle. Default 10.
        link_mm: Option<f64>, in 0.5..=100 "mm";
    }
}

/// Bending stiffness of the needle of Goksel et al. 2011, N mm^2.
pub(super) fn goksel_nmm2() -> f64 {
    KAPPA_NMM_PER_DEG.to_degrees() * LINK_MM
}

impl SpringsKeys {
    fn link_mm(&self) -> f64 {
        self.link_mm.unwrap_or(LINK_MM)
    }
}

impl Keys for SpringsKeys {
    fn usual_mm(&self) -> Option<[f64; 2]> {
        Some(GOKSEL_MM)
    }

    fn check(&self, shaft: &Shaft) -> Result<(), OutOfRange> {
        one_of([
            ("kappa_nmm_per_deg", self.kappa_nmm_per_deg),
            ("bending_stiffness_nmm2", self.bending_stiffness_nmm2),
        ])?;
        let is_within = self.link_mm() <= shaft.length_mm;
        check("link_mm", self.link_mm(), is_within, "at most the needle's length, mm")?;
        self.bevel.map_or(Ok(()), |bevel| bevel.check(shaft))
    }

    fn needle(&self, shaft: Shaft) -> Result<Box<dyn Needle>, OutOfRange> {
        let of_joints = self.kappa_nmm_per_deg.map(|kappa| kappa.to_degrees() * LINK_MM);
        let stiffness = self.bending_stiffness_nmm2.or(of_joints).unwrap_or_else(goksel_nmm2);
        let needle = Flexible::springs(shaft, Stiffness::BendingNmm2(stiffness), self.link_mm(), self.bevel)?;
        Ok(Box::new(needle))
    }
}
