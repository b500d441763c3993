//! Transrectal array, transverse plane.

use insonify_base::range::parameters;

use super::aperture::UsualAperture;
use super::kind::{Kind, Layout, Site};

parameters! {
    /// Transrectal, transverse plane: an end ring of elements around the probe's axis (z), looking outwards.
    #[derive(Copy)]
    pub struct TrusTransverse with required keys {
        /// Radius of the probe, mm.
        radius_mm: f64, in 2..=50;
        /// Field of view, degrees.
        angle_deg: f64, in 1..=270;
    }
}

impl Kind for TrusTransverse {
    const NAME: &'static str = "trus-transverse";
    const USUAL_MHZ: f64 = 7.0;
    const SITE: Site = Site::Rectum;
    // Elements of a linear array of a similar frequency.
    const APERTURE: UsualAperture = UsualAperture {
        f_numbers: [2.5, 1.5],
        height_mm: 5.0,
        lens_focus_mm: 18.0,
    };
    const USUAL: Self = Self {
        radius_mm: 10.0,
        angle_deg: 160.0,
    };
    const USUAL_DEPTH_MM: f64 = 60.0;
    const EXAMPLE: Self = Self {
        radius_mm: 9.0,
        angle_deg: 200.0,
    };

    fn layout(&self) -> Layout {
        Layout::Fan {
            radius: self.radius_mm,
            half: self.angle_deg.to_radians() / 2.0,
        }
    }
}
