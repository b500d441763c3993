//! Phased array.

use insonify_base::range::parameters;

use super::aperture::UsualAperture;
use super::kind::{Kind, Layout, Site};

parameters! {
    /// Scanlines that fan out from one point on a small flat array.
    #[derive(Copy)]
    pub struct Phased with required keys {
        /// Field of view, degrees.
        angle_deg: f64, in 1..=120;
    }
}

impl Kind for Phased {
    const NAME: &'static str = "phased";
    const USUAL_MHZ: f64 = 2.5;
    const SITE: Site = Site::Skin;
    // That of adult cardiac probes.
    const SHARED_APERTURE_MM: Option<f64> = Some(20.0);
    // Elements of the P4-2v (D. Garcia 2022, as for `ELEMENT`).
    const APERTURE: UsualAperture = UsualAperture {
        f_numbers: [2.5, 1.5],
        height_mm: 14.0,
        lens_focus_mm: 60.0,
    };
    const USUAL: Self = Self { angle_deg: 80.0 };
    const USUAL_DEPTH_MM: f64 = 160.0;
    const EXAMPLE: Self = Self { angle_deg: 80.0 };

    fn layout(&self) -> Layout {
        Layout::Fan {
            radius: 0.0,
            half: self.angle_deg.to_radians() / 2.0,
        }
    }
}
