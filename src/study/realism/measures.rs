//! List of measures.

use serde::Serialize;

use super::sector::BLACK;
use super::texture::Texture;
use super::{FrameMeasurements, average};
use insonify_base::statistics::{mean, skewness};

/// Measure of one frame.
#[derive(Debug, Serialize)]
pub struct Measure {
    /// Key in JSON.
    pub key: &'static str,
    /// Name in reports.
    pub name: &'static str,
    /// Unit; empty for a pure number.
    pub unit: &'static str,
    /// Definition in words.
    pub definition: &'static str,
    /// Lower limit of the spread among real frames: frames of one clip differ by less than independent frames do.
    pub floor: f64,
    /// Function that computes the value; returns `None` if the frame does not show it.
    #[serde(skip)]
    pub(super) value: fn(&FrameMeasurements) -> Option<f64>,
}

const fn measure(
    key: &'static str,
    [name, unit, definition]: [&'static str; 3],
    floor: f64,
    value: fn(&FrameMeasurements) -> Option<f64>,
) -> Measure {
    Measure {
        key,
        name,
        unit,
        definition,
        floor,
        value,
    }
}

/// Index of statistics along depth.
const AXIAL: usize = 0;
/// Index of statistics across depth.
const LATERAL: usize = 1;
/// Index of statistics over rings of frequency.
const RADIAL: usize = 2;

fn uniform(parts: &FrameMeasurements, measure: impl Fn(&Texture) -> Option<f64>) -> Option<f64> {
    average(parts.uniform.iter().map(measure))
}

fn dark(parts: &FrameMeasurements, measure: impl Fn(&Texture) -> Option<f64>) -> Option<f64> {
    average(parts.dark.iter().map(measure))
}

fn in_mm(parts: &FrameMeasurements, axis: usize, pixels: Option<f64>) -> Option<f64> {
    Some(parts.mm?[axis] * pixels?)
}

/// All measures, in the order of reports. Uniform windows are 48 x 48 pixels, dark ones 32 x 32, five per frame.
pub(crate) const MEASURES: &[Measure] = &[
    measure(
        "grey_mean",
        [
            "uniform windows: mean",
            "grey",
            "mean grey level of the most uniform windows of 48 x 48 pixels",
        ],
        2.0,
        |p| uniform(p, |g| Some(g.mean)),
    ),
    measure(
        "grey_std",
        [
            "uniform windows: standard deviation",
            "grey",
            "standard deviation of their grey levels, a quadratic trend removed",
        ],
        1.0,
        |p| uniform(p, |g| Some(g.std)),
    ),
    measure(
        "grey_skewness",
        ["uniform windows: skewness", "", "skewness of the same"],
        0.1,
        |p| uniform(p, |g| Some(g.skewness)),
    ),
    measure(
        "snr_log",
        [
            "SNR after log compression",
            "",
            "mean over standard deviation of their grey levels",
        ],
        0.3,
        |p| uniform(p, |g| Some(g.snr_log)),
    ),
    // Pictures do not state their dynamic range: all are taken to have the usual one, so that differences between
    // frames count and absolute values are rough. Rayleigh's distribution has sqrt(pi / (4 - pi)) = 1.91.
    measure(
        "snr_linear",
        [
            "SNR before log compression",
            "",
            "the same of echo amplitudes, 255 grey levels taken for 60 dB; 1.91 in fully developed speckle",
        ],
        0.1,
        |p| uniform(p, |g| Some(g.snr_linear)),
    ),
    measure(
        "nakagami_m",
        [
            "Nakagami m",
            "",
            "squared mean over variance of echo intensities, 255 grey levels taken for 60 dB; 1 in fully developed speckle",
        ],
        0.1,
        |p| uniform(p, |g| Some(g.nakagami)),
    ),
    measure(
        "lag1_axial",
        [
            "lag-1 autocorrelation, axial",
            "",
            "autocorrelation of grey levels one row apart",
        ],
        0.03,
        |p| uniform(p, |g| Some(g.autocorrelation[AXIAL][1])),
    ),
    measure(
        "lag1_lateral",
        [
            "lag-1 autocorrelation, lateral",
            "",
            "autocorrelation of grey levels one column apart",
        ],
        0.03,
        |p| uniform(p, |g| Some(g.autocorrelation[LATERAL][1])),
    ),
    // In pixels, too, as many real frames have no scale.
    measure(
        "fwhm_axial_px",
        [
            "autocorrelation FWHM, axial",
            "px",
            "full width at half maximum of the autocorrelation along columns",
        ],
        0.2,
        |p| uniform(p, |g| g.fwhm[AXIAL]),
    ),
    measure(
        "fwhm_axial_mm",
        ["autocorrelation FWHM, axial", "mm", "the same in millimetres"],
        0.05,
        |p| in_mm(p, AXIAL, uniform(p, |g| g.fwhm[AXIAL])),
    ),
    measure(
        "fwhm_lateral_px",
        [
            "autocorrelation FWHM, lateral",
            "px",
            "full width at half maximum of the autocorrelation along rows",
        ],
        0.2,
        |p| uniform(p, |g| g.fwhm[LATERAL]),
    ),
    measure(
        "fwhm_lateral_mm",
        ["autocorrelation FWHM, lateral", "mm", "the same in millimetres"],
        0.05,
        |p| in_mm(p, LATERAL, uniform(p, |g| g.fwhm[LATERAL])),
    ),
    measure(
        "glcm_contrast_axial",
        [
            "GLCM contrast, axial",
            "",
            "contrast of the grey-level co-occurrence matrix one row apart, 32 levels over 6 standard deviations",
        ],
        1.0,
        |p| uniform(p, |g| Some(g.contrast[AXIAL])),
    ),
    measure(
        "glcm_contrast_lateral",
        ["GLCM contrast, lateral", "", "the same one column apart"],
        1.0,
        |p| uniform(p, |g| Some(g.contrast[LATERAL])),
    ),
    measure(
        "glcm_correlation_axial",
        [
            "GLCM correlation, axial",
            "",
            "correlation of that matrix one row apart",
        ],
        0.03,
        |p| uniform(p, |g| Some(g.correlation[AXIAL])),
    ),
    measure(
        "glcm_correlation_lateral",
        ["GLCM correlation, lateral", "", "the same one column apart"],
        0.03,
        |p| uniform(p, |g| Some(g.correlation[LATERAL])),
    ),
    measure(
        "power_slope_axial",
        [
            "power slope, axial",
            "",
            "slope of log power over log frequency along columns, 0.04 to 0.35 cycles a pixel",
        ],
        0.15,
        |p| uniform(p, |g| Some(g.slopes[AXIAL])),
    ),
    measure(
        "power_slope_lateral",
        ["power slope, lateral", "", "the same along rows"],
        0.15,
        |p| uniform(p, |g| Some(g.slopes[LATERAL])),
    ),
    measure(
        "power_slope_radial",
        ["power slope, radial", "", "the same over rings of frequency"],
        0.15,
        |p| uniform(p, |g| Some(g.slopes[RADIAL])),
    ),
    // Larger than speckle, smaller than organs: what is left of the variation is the structure of the tissue.
    measure(
        "blocks_4mm_db",
        [
            "means of 4 mm blocks",
            "dB",
            "standard deviation of their means in uniform windows of 24 mm, a trend along depth removed, at 60 dB",
        ],
        0.2,
        |p| p.blocks_db[0],
    ),
    measure(
        "blocks_8mm_db",
        ["means of 8 mm blocks", "dB", "the same of blocks of 8 mm"],
        0.2,
        |p| p.blocks_db[1],
    ),
    measure(
        "sector_mean",
        ["sector: mean", "grey", "mean grey level of the sector"],
        2.0,
        |p| Some(mean(&p.sector)),
    ),
    measure(
        "sector_median",
        ["sector: median", "grey", "half of the sector is at most as bright"],
        2.0,
        |p| p.percentile(0.5),
    ),
    measure(
        "sector_p95",
        [
            "sector: 95th percentile",
            "grey",
            "95 % of the sector is at most as bright",
        ],
        4.0,
        |p| p.percentile(0.95),
    ),
    measure(
        "sector_skewness",
        ["sector: skewness", "", "skewness of its grey levels"],
        0.1,
        |p| Some(skewness(&p.sector)),
    ),
    measure(
        "sector_black",
        [
            "sector: share of grey 2 or less",
            "",
            "share of the sector at grey levels 0 to 2",
        ],
        0.01,
        |p| p.share(|grey| grey <= BLACK),
    ),
    measure(
        "sector_white",
        [
            "sector: share of grey 250 or more",
            "",
            "share of the sector at grey levels 250 to 255",
        ],
        0.002,
        |p| p.share(|grey| grey >= 250.0),
    ),
    measure(
        "empty_5mm",
        [
            "empty share below the array",
            "",
            "share of the first 5 mm below the array at grey levels 0 to 2; needs the size of a pixel, and echoes at the array in half of the scanlines",
        ],
        0.02,
        |p| p.empty,
    ),
    // Fluid and shadow show noise, clutter and side lobes, which the uniform windows hide under speckle.
    measure(
        "dark_mean",
        [
            "dark windows: mean",
            "grey",
            "mean grey level of the darkest windows of 32 x 32 pixels that are not constant: fluid and shadow",
        ],
        2.0,
        |p| dark(p, |g| Some(g.mean)),
    ),
    measure(
        "dark_lag1_lateral",
        [
            "dark windows: lag-1 autocorrelation, lateral",
            "",
            "autocorrelation of their grey levels one column apart",
        ],
        0.03,
        |p| dark(p, |g| Some(g.autocorrelation[LATERAL][1])),
    ),
    measure(
        "dark_fwhm_lateral_px",
        [
            "dark windows: FWHM, lateral",
            "px",
            "full width at half maximum of that autocorrelation",
        ],
        0.3,
        |p| dark(p, |g| g.fwhm[LATERAL]),
    ),
    measure(
        "dark_fwhm_lateral_mm",
        ["dark windows: FWHM, lateral", "mm", "the same in millimetres"],
        0.05,
        |p| in_mm(p, LATERAL, dark(p, |g| g.fwhm[LATERAL])),
    ),
    measure(
        "edge_10_90_mm",
        [
            "far edge of a dark region, 10-90 %",
            "mm",
            "length over which the mean profile along depth rises from 10 % to 90 %",
        ],
        0.2,
        |p| in_mm(p, AXIAL, p.edge.as_ref().map(|edge| edge.width)),
    ),
    measure(
        "edge_jaggedness_px",
        [
            "far edge of a dark region, jaggedness",
            "px",
            "mean distance of the boundary in a column from the mean of its two neighbours",
        ],
        0.05,
        |p| p.edge.as_ref()?.jaggedness,
    ),
    measure(
        "frame_correlation_dark",
        [
            "frame-to-frame correlation, dark",
            "",
            "correlation of dark windows with the next frame of a sequence",
        ],
        0.03,
        |p| p.frame_correlation[0],
    ),
    measure(
        "frame_correlation_uniform",
        [
            "frame-to-frame correlation, uniform",
            "",
            "correlation of uniform windows with the next frame of a sequence",
        ],
        0.03,
        |p| p.frame_correlation[1],
    ),
];
