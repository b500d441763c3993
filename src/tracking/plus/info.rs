//! Summary of a PLUS configuration, as text and JSON.

use std::fmt;
use std::path::Path;

use serde::Serialize;

use super::{DefinedTransform, PlusConfig};
use crate::TrackingError;
use crate::calibration::Calibration;
use crate::probe::ProbeSpec;
use insonify_base::text;

/// Summary of a device-set configuration of PLUS.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PlusInfo {
    /// Path of the file, as given.
    pub file: String,
    /// Name of the transducer.
    pub transducer: Option<String>,
    /// Probe keys stated by the configuration.
    pub probe: ProbeSpec,
    /// Columns and rows of the images.
    pub image_size: Option<[usize; 2]>,
    /// Width and height of a pixel as stated, mm.
    pub pixel_mm: Option<[f64; 2]>,
    /// Column and row of the pixel at the centre of the array.
    pub array_centre_px: Option<[f64; 2]>,
    /// Calibration of the images.
    pub calibration: Option<CalibrationInfo>,
    /// Coordinate definitions, in order.
    pub transforms: Vec<DefinedTransform>,
    /// Contradictions, and missing information that a scene has to state.
    pub warnings: Vec<String>,
}

/// The calibration of a [`PlusInfo`].
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CalibrationInfo {
    /// Name of the marker's frame to which `Image` is calibrated.
    pub to: String,
    /// Lengths of the columns of its matrix, mm: a pixel's width, its height, and the distance of planes.
    pub lengths_mm: [f64; 3],
    /// Angle between the image axes, degrees.
    pub axes_apart_deg: f64,
}

impl PlusInfo {
    /// Reads a configuration and summarises it.
    ///
    /// # Errors
    /// The errors of [`PlusConfig::read`].
    pub fn read(path: &Path) -> Result<Self, TrackingError> {
        let plus = PlusConfig::read(path)?;
        let (size, centre) = (plus.image_size, plus.array_centre_px());
        let mut warnings: Vec<String> = plus.warnings.iter().cloned().chain(plus.two_centres()).collect();
        // That of the images is told with the calibration.
        let broken = plus
            .transforms
            .iter()
            .filter(|defined| defined.from != "Image" && !is_finite(defined));
        warnings.extend(broken.map(|DefinedTransform { from, to, .. }| {
            format!("the transform from `{from}` to `{to}` has a number that is not finite: it is left out")
        }));
        let images = plus.transforms.iter().filter(|defined| defined.from == "Image");
        let mut markers = images.map(|defined| defined.to.as_str());
        let marker = markers.clone().find(|to| *to == "Probe");
        // A transform to `TransducerOriginPixel` is a shift in pixels: one to a marker holds their size in
        // mm.
        let marker = marker.or_else(|| markers.find(|to| *to != "TransducerOriginPixel"));
        let mut calibration = None;
        if let Some(to) = marker {
            match Calibration::new(&plus.transform("Image", to)?, centre.unwrap_or_default()) {
                Ok(fitted) => {
                    let stated = plus.pixel_mm.and_then(|stated| fitted.other_pixels(stated));
                    let far = centre.and(size).and_then(|size| fitted.far_centre(size));
                    let skewed = fitted.skew_warning(size.unwrap_or([640, 480]));
                    warnings.extend([stated, far, skewed].into_iter().flatten());
                    calibration = Some(CalibrationInfo {
                        to: to.to_owned(),
                        lengths_mm: fitted.lengths_mm(),
                        axes_apart_deg: fitted.axes_apart_deg(),
                    });
                }
                Err(error) => warnings.push(error.to_string()),
            }
        }
        if calibration.is_some() && centre.is_none() {
            warnings.push("no centre of the array: a scene has to state `array_centre_px`".to_owned());
        }
        if calibration.is_none() && plus.transforms.is_empty() && plus.probe == ProbeSpec::default() {
            warnings.push(
                "nothing here describes coordinates or a transducer: is this a configuration of PLUS?".to_owned(),
            );
        }
        Ok(Self {
            file: path.display().to_string(),
            transducer: plus.transducer,
            probe: plus.probe,
            image_size: size,
            pixel_mm: plus.pixel_mm,
            array_centre_px: centre,
            calibration,
            transforms: plus.transforms,
            warnings,
        })
    }
}

fn is_finite(defined: &DefinedTransform) -> bool {
    defined.matrix.0.iter().all(|number| number.is_finite())
}

impl fmt::Display for PlusInfo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let stated = |text: Option<String>| text.unwrap_or_else(|| "not stated".to_owned());
        let name = self
            .transducer
            .as_deref()
            .map(|name| text::head(name, text::WIDEST_NAME));
        // An empty probe that is filled from this one tells which keys the file states.
        let (_, keys) = ProbeSpec::default().filled_from(&self.probe);
        let keys = (!keys.is_empty()).then(|| keys.join(", "));
        let size = self
            .image_size
            .map(|[width, height]| format!("{width} x {height} pixels"));
        let pixel = self.pixel_mm.map(|[width, height]| format!("{width} x {height} mm"));
        let centre = self
            .array_centre_px
            .map(|[column, row]| format!("centre at pixel ({column}, {row})"));
        writeln!(f, "file         {}", self.file)?;
        writeln!(f, "transducer   {}", stated(name))?;
        writeln!(f, "probe        {}", stated(keys))?;
        writeln!(f, "images       {}", stated(size))?;
        writeln!(f, "pixels       {}", stated(pixel))?;
        writeln!(f, "array        {}", stated(centre))?;
        let calibration = self.calibration.as_ref().map(|calibration| {
            let [columns, rows, planes] = calibration.lengths_mm;
            let to = text::head(&calibration.to, text::WIDEST_NAME);
            format!(
                "Image to {to}: columns, rows and planes {columns:.4}, {rows:.4} and {planes:.4} mm, axes {:.2} degrees apart",
                calibration.axes_apart_deg
            )
        });
        writeln!(f, "calibration  {}", stated(calibration))?;
        let names: Vec<String> = self
            .transforms
            .iter()
            .map(|t| format!("{}To{}", t.from, t.to))
            .collect();
        let cells = text::column("transform", names.iter().map(String::as_str));
        let origins = self.transforms.iter().map(|transform| {
            if !is_finite(transform) {
                return "not finite".to_owned();
            }
            let [x, y, z] = [0, 1, 2].map(|row| transform.matrix.0[(row, 3)]);
            format!("{x:.3}, {y:.3}, {z:.3}")
        });
        writeln!(f)?;
        for (cell, origin) in cells.iter().zip(std::iter::once("origin".to_owned()).chain(origins)) {
            writeln!(f, "{cell}  {origin}")?;
        }
        for warning in &self.warnings {
            writeln!(f, "\nwarning: {warning}")?;
        }
        Ok(())
    }
}
