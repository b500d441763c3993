//! Measures of a simulation of waves, which point spread, speckle and thickness are held to.
//!
//! SIMUS (D. Garcia, Computer Methods and Programs in Biomedicine 218 (2022) 106726) of two arrays of 128 elements:
//! L11-5v, 38.4 mm wide at 7.6 MHz, focused at 22 mm, and C5-2v, of 49.57 mm radius at 3.57 MHz, focused at 75 mm. One
//! focused transmission of 55 % bandwidth per scanline, dynamic receive f-numbers of 1.5 and 1.75. Lengths are full
//! widths at half maximum, mm.

use insonify_tracking::probe::{Aperture, Apodisation, Curvilinear, Linear, Probe, ProbeShape};

/// Depth, lateral length around a point with Hann weights and with equal ones, and elevational length, under the linear
/// array.
#[cfg(test)]
pub(crate) const LINEAR_POINTS: [[f64; 4]; 6] = [
    [10.0, 0.682, 0.428, 1.583],
    [15.0, 0.748, 0.446, 0.595],
    [20.0, 0.477, 0.350, 0.806],
    [25.0, 0.523, 0.374, 1.039],
    [30.0, 0.671, 0.428, 1.462],
    [40.0, 0.695, 0.425, 2.910],
];

/// The same under the curved array.
#[cfg(test)]
pub(crate) const CURVED_POINTS: [[f64; 4]; 6] = [
    [30.0, 1.714, 1.080, 5.608],
    [50.0, 1.844, 1.126, 1.523],
    [70.0, 1.277, 0.989, 2.224],
    [80.0, 1.372, 1.059, 2.587],
    [110.0, 2.099, 1.498, 4.667],
    [140.0, 2.182, 1.689, 9.216],
];

/// Depth, lateral length in speckle with Hann weights and with equal ones, under the linear array.
#[cfg(test)]
pub(crate) const LINEAR_SPECKLE: [[f64; 3]; 5] = [
    [12.0, 0.6821, 0.3335],
    [18.0, 0.5333, 0.3219],
    [24.0, 0.5062, 0.3280],
    [30.0, 0.5777, 0.3458],
    [36.0, 0.6932, 0.3575],
];

/// The same under the curved array.
pub const CURVED_SPECKLE: [[f64; 3]; 7] = [
    [35.0, 1.710, 0.9552],
    [50.0, 1.579, 1.010],
    [65.0, 1.327, 0.9883],
    [80.0, 1.432, 1.058],
    [95.0, 1.597, 1.151],
    [110.0, 1.998, 1.372],
    [122.0, 2.163, 1.536],
];

/// Axial lengths around a point and in speckle, means over the depths, under the linear array and under the curved one.
pub const AXIAL: [[f64; 2]; 2] = [[0.161, 0.150], [0.336, 0.312]];

/// Diameter and depth of spheres without scatterers under the curved array, mm, and echoes within 0.6 radii over those
/// around, dB, less those in cylinders: what reaches in across the plane.
pub const SPHERES: [[f64; 3]; 2] = [[3.0, 40.0, -10.2], [6.0, 65.0, -24.2]];

/// The probe of the simulation, with its samples, and with scanlines as far apart.
pub fn probe(is_curved: bool, apodisation: Apodisation) -> Probe {
    let (shape, mhz, depth_mm, focus_mm, [lines, samples]): (ProbeShape, _, _, _, _) = if is_curved {
        let shape = Curvilinear {
            radius_mm: 49.57,
            angle_deg: 74.6,
        };
        (shape.into(), 3.57, 145.0, 75.0, [326, 2417])
    } else {
        (Linear { width_mm: 38.4 }.into(), 7.6, 45.0, 22.0, [193, 1800])
    };
    Probe {
        shape,
        depth_mm,
        frequency_mhz: mhz,
        lines,
        samples,
        aperture: Aperture {
            bandwidth: Some(0.55),
            transmit_focus_mm: Some(focus_mm),
            apodisation: Some(apodisation),
            ..Aperture::default()
        },
    }
}
