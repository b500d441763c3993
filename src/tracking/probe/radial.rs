//! Radial probe.

use std::f64::consts::PI;

use insonify_base::range::parameters;

use super::aperture::UsualAperture;
use super::kind::{Kind, Layout, OVERLAP, Site};

parameters! {
    /// A full circle around the probe's axis (z): catheters in vessels (IVUS), radial probes in airways and the
    /// oesophagus (EBUS, EUS).
    #[derive(Copy)]
    pub struct Radial with required keys {
        /// Radius of the probe, mm.
        radius_mm: f64, in 0.2..=20;
    }
}

impl Kind for Radial {
    const NAME: &'static str = "radial";
    const USUAL_MHZ: f64 = 20.0;
    const SITE: Site = Site::Lumen;
    // Elements of a catheter at 20 MHz, without a lens: focused far beyond the image.
    const APERTURE: UsualAperture = UsualAperture {
        f_numbers: [2.5, 1.5],
        height_mm: 0.7,
        lens_focus_mm: 1000.0,
    };
    const USUAL: Self = Self { radius_mm: 1.0 };
    const USUAL_DEPTH_MM: f64 = 20.0;
    const EXAMPLE: Self = Self { radius_mm: 2.0 };

    fn layout(&self) -> Layout {
        Layout::Fan {
            radius: self.radius_mm,
            half: PI + OVERLAP,
        }
    }
}
