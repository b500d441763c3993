//! Transrectal array, sagittal plane.

use insonify_base::range::parameters;

use super::aperture::UsualAperture;
use super::kind::{Kind, Layout, Site};

parameters! {
    /// Transrectal, sagittal plane: a straight array along the probe's side; x runs along the probe's axis.
    #[derive(Copy)]
    pub struct TrusSagittal with required keys {
        /// Length of the array, mm.
        length_mm: f64, in 1..=300;
    }
}

impl Kind for TrusSagittal {
    const NAME: &'static str = "trus-sagittal";
    const USUAL_MHZ: f64 = 7.0;
    const SITE: Site = Site::Rectum;
    // Elements of a linear array of a similar frequency.
    const APERTURE: UsualAperture = UsualAperture {
        f_numbers: [2.5, 1.5],
        height_mm: 5.0,
        lens_focus_mm: 18.0,
    };
    const USUAL: Self = Self { length_mm: 60.0 };
    const USUAL_DEPTH_MM: f64 = 60.0;
    const EXAMPLE: Self = Self { length_mm: 40.0 };

    fn layout(&self) -> Layout {
        Layout::Parallel { width: self.length_mm }
    }
}
