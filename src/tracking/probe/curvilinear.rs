//! Convex array.

use insonify_base::range::parameters;

use super::aperture::UsualAperture;
use super::kind::{Kind, Layout, Site};

parameters! {
    /// Convex array, scanlines perpendicular to it.
    #[derive(Copy)]
    pub struct Curvilinear with required keys {
        /// Radius of curvature of the array, mm.
        radius_mm: f64, in 2..=200;
        /// Field of view, degrees.
        angle_deg: f64, in 1..=180;
    }
}

impl Kind for Curvilinear {
    const NAME: &'static str = "curvilinear";
    const USUAL_MHZ: f64 = 3.5;
    const SITE: Site = Site::Skin;
    // Elements of the C5-2v (D. Garcia 2022, as for `ELEMENT`).
    const APERTURE: UsualAperture = UsualAperture {
        f_numbers: [3.0, 1.75],
        height_mm: 13.5,
        lens_focus_mm: 60.0,
    };
    const USUAL: Self = Self {
        radius_mm: 60.0,
        angle_deg: 70.0,
    };
    const USUAL_DEPTH_MM: f64 = 150.0;
    const EXAMPLE: Self = Self {
        radius_mm: 30.0,
        angle_deg: 60.0,
    };

    fn layout(&self) -> Layout {
        Layout::Fan {
            radius: self.radius_mm,
            half: self.angle_deg.to_radians() / 2.0,
        }
    }
}
