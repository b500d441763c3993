//! Aperture and pulse of a probe: what its data sheet and the scanner's settings say, from which the beam follows.

use insonify_base::range::parameters;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Probe;

/// Speed of sound in soft tissue, mm/us.
const SOUND_MM_US: f64 = 1.54;

/// Width of an element in wavelengths: 1.07 of the C5-2v, 1.33 of the L11-5v (D. Garcia, Computer Methods and Programs
/// in Biomedicine 218 (2022) 106726).
const ELEMENT: f64 = 1.1;

/// Weights of the elements on reception.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[schemars(inline)]
pub enum Apodisation {
    /// Raised cosine that vanishes at the ends of the aperture: the lowest side lobes and the widest beam.
    #[default]
    Hann,
    /// Raised cosine on a pedestal of 8 %.
    Hamming,
    /// Even over half of the aperture, a raised cosine at its sides.
    Tukey,
    /// Equal weights: the narrowest beam and the highest side lobes.
    None,
}

impl Apodisation {
    /// Weight at a distance from the middle of the aperture, in halves of it.
    pub fn weight(self, from_middle: f64) -> f64 {
        let cosine = |phase: f64| (std::f64::consts::PI * phase).cos();
        match self {
            Self::Hann => 0.5 + 0.5 * cosine(from_middle),
            Self::Hamming => 0.54 + 0.46 * cosine(from_middle),
            Self::Tukey => 0.5 + 0.5 * cosine((2.0 * from_middle.abs() - 1.0).max(0.0)),
            Self::None => 1.0,
        }
    }
}

parameters! {
    /// Pulse, aperture and lens of a probe.
    #[derive(Copy)]
    pub struct Aperture {
        /// Bandwidth of the echo of a point over the centre frequency: full width at half maximum of its amplitude
        /// spectrum. It makes the axial length of the point spread. Default 0.6.
        #[serde(skip_serializing_if = "Option::is_none")]
        bandwidth: Option<f64>, in 0.05..=1.5;
        /// Length of the largest active part of the array, mm. Default: that of the array; of a phased one 20 mm.
        #[serde(skip_serializing_if = "Option::is_none")]
        aperture_mm: Option<f64>, in 0.01..=300;
        /// Depth of the transmit focus, mm. Default: half the imaging depth.
        #[serde(skip_serializing_if = "Option::is_none")]
        transmit_focus_mm: Option<f64>, in 0..=1000;
        /// Depth of the transmit focus over the length of the aperture that transmits. Default 2.5, of a curvilinear
        /// array 3.
        #[serde(skip_serializing_if = "Option::is_none")]
        transmit_f_number: Option<f64>, in 0.5..=20;
        /// Depth over the length of the aperture that receives, which grows with depth up to the largest. Default 1.5,
        /// of a curvilinear array 1.75.
        #[serde(skip_serializing_if = "Option::is_none")]
        receive_f_number: Option<f64>, in 0.5..=20;
        /// Weights of the elements on reception. Default `hann`.
        #[serde(skip_serializing_if = "Option::is_none")]
        apodisation: Option<Apodisation>;
        /// Height of the elements, across the image plane, mm. Default: that of the kind.
        #[serde(skip_serializing_if = "Option::is_none")]
        height_mm: Option<f64>, in 0.05..=50;
        /// Depth at which the lens focuses across the image plane, mm. Default: that of the kind.
        #[serde(skip_serializing_if = "Option::is_none")]
        lens_focus_mm: Option<f64>, in 1..=1000;
    }
}

/// Usual values of a kind.
pub(super) struct UsualAperture {
    /// Transmit and receive f-number.
    pub f_numbers: [f64; 2],
    /// Height of the elements, mm.
    pub height_mm: f64,
    /// Focus of the lens, mm.
    pub lens_focus_mm: f64,
}

/// A probe's aperture, complete.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transducer {
    /// Bandwidth over centre frequency.
    pub bandwidth: f64,
    /// Wavelength in soft tissue at the centre frequency, mm.
    pub wavelength_mm: f64,
    /// Radius of the array, mm; `None` if it is flat.
    pub radius_mm: Option<f64>,
    /// Largest active length of the array, mm.
    pub aperture_mm: f64,
    /// Width of an element, mm.
    pub element_mm: f64,
    /// Depth of the transmit focus, mm.
    pub transmit_focus_mm: f64,
    /// Its f-number.
    pub transmit_f_number: f64,
    /// Receive f-number.
    pub receive_f_number: f64,
    /// Weights on reception.
    pub apodisation: Apodisation,
    /// Height of the elements, mm.
    pub height_mm: f64,
    /// Focus of the lens, mm.
    pub lens_focus_mm: f64,
}

impl Probe {
    /// Aperture, pulse and lens: those stated, completed by the usual ones of the kind.
    pub fn transducer(&self) -> Transducer {
        let kind = self.shape.kind();
        let (usual, stated) = (&kind.facts().aperture, &self.aperture);
        let wavelength_mm = SOUND_MM_US / self.frequency_mhz;
        let layout = self.shape.layout();
        let array_mm = kind.shared_aperture_mm().unwrap_or(layout.array_mm());
        let element_mm = ELEMENT * wavelength_mm;
        Transducer {
            bandwidth: stated.bandwidth.unwrap_or(0.6),
            wavelength_mm,
            radius_mm: layout.radius_mm().filter(|radius_mm| *radius_mm > 0.0),
            aperture_mm: stated.aperture_mm.unwrap_or(array_mm).max(element_mm),
            element_mm,
            transmit_focus_mm: stated.transmit_focus_mm.unwrap_or(self.depth_mm / 2.0),
            transmit_f_number: stated.transmit_f_number.unwrap_or(usual.f_numbers[0]),
            receive_f_number: stated.receive_f_number.unwrap_or(usual.f_numbers[1]),
            apodisation: stated.apodisation.unwrap_or_default(),
            height_mm: stated.height_mm.unwrap_or(usual.height_mm),
            lens_focus_mm: stated.lens_focus_mm.unwrap_or(usual.lens_focus_mm),
        }
    }
}
