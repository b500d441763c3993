//! Straight array.

use insonify_base::range::parameters;

use super::aperture::UsualAperture;
use super::kind::{Kind, Layout, Site};

parameters! {
    /// Straight array, parallel scanlines.
    #[derive(Copy)]
    pub struct Linear with required keys {
        /// Length of the array, mm.
        width_mm: f64, in 1..=300;
    }
}

impl Kind for Linear {
    const NAME: &'static str = "linear";
    const USUAL_MHZ: f64 = 9.0;
    const SITE: Site = Site::Skin;
    // Elements of the L11-5v (D. Garcia 2022, as for `ELEMENT`).
    const APERTURE: UsualAperture = UsualAperture {
        f_numbers: [2.5, 1.5],
        height_mm: 5.0,
        lens_focus_mm: 18.0,
    };
    const USUAL: Self = Self { width_mm: 38.0 };
    const USUAL_DEPTH_MM: f64 = 60.0;
    const EXAMPLE: Self = Self { width_mm: 36.0 };

    fn layout(&self) -> Layout {
        Layout::Parallel { width: self.width_mm }
    }
}
