//! From the image that was calibrated to the transducer that is simulated.
//!
//! Trackers report the pose of a marker fixed to the probe, which PLUS calls `Probe`. A spatial calibration gives the `Image`
//! frame (pixels) in that frame, as `ImageToProbe`. The frame that this crate calls the probe frame is PLUS's `Transducer`: the
//! origin at the centre of the array, x towards the marked side, y into the body, mm. In an image of orientation MF its axes run
//! along the columns and the rows, so a calibration and the pixel at which the array's centre lies give the transducer in the
//! marker's frame ([`transducer_to_probe`]). PLUS writes that pixel as `TransducerCenterPixel`, or as an
//! `ImageToTransducerOriginPixel` transform.

use std::io;
use std::path::{Path, PathBuf};

use nalgebra::{Matrix4, Vector3, Vector4};

use super::matrix::{self, NotRigid, Rows};
use crate::read;

/// Largest angle that image axes may be off square by, rad: the worst calibration among the configurations of PlusLibData
/// (`SpinePhantomFreehandReconstructionOnly`) is off by 0.05.
const SKEW: f64 = 0.1;

/// Range of pixel sizes in a calibration, mm.
const PIXEL_MM: [f64; 2] = [1e-4, 100.0];

/// Why a calibration cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum CalibrationError {
    /// The file cannot be read as text.
    #[error("cannot read `{}`: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// The file is not XML.
    #[error("`{}`, line {line}, column {column}: {found}", path.display())]
    Xml {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: u32,
        /// Column, from 1.
        column: u32,
        /// What was found, and what was expected.
        found: String,
    },
    /// A transform that the file does not define.
    #[error("`{}` defines no transform from `{from}` to `{to}`; it has {has}", path.display())]
    NoTransform {
        /// The file.
        path: PathBuf,
        /// Name of the frame to come from.
        from: String,
        /// Name of the frame to go to.
        to: String,
        /// The transforms that are there.
        has: String,
    },
    /// An image-to-probe matrix whose pixels make no sense.
    #[error("image-to-probe calibration: image axis {axis} is {found} mm a pixel; expected {:e} to {}", PIXEL_MM[0], PIXEL_MM[1])]
    PixelSize {
        /// 0 for columns, 1 for rows.
        axis: usize,
        /// Length of the column of the matrix.
        found: f64,
    },
    /// Image axes that are not square to each other.
    #[error("image-to-probe calibration: the image axes are {found:.3} rad off square; expected at most {SKEW}")]
    Skewed {
        /// How far, rad.
        found: f64,
    },
    /// The pixel at the centre of the array is not finite.
    #[error("transducer centre pixel {found:?}; expected finite numbers")]
    Centre {
        /// Column and row.
        found: [f64; 2],
    },
    /// The resulting transform is not rigid.
    #[error("image-to-probe calibration: {0}")]
    NotRigid(#[from] NotRigid),
}

impl CalibrationError {
    /// Whether the machine failed rather than the input.
    pub fn is_machine(&self) -> bool {
        matches!(self, Self::Read { source, .. } if read::is_machine(source))
    }
}

/// The transducer in the frame of the marker on the probe, mm, from an image-to-probe calibration (MF orientation, pixels to
/// mm) and the pixel (column, row) at which the centre of the array lies. The axes are squared symmetrically: neither image
/// axis is preferred. The third column of the calibration is not used, since a planar calibration does not measure it.
pub fn transducer_to_probe(
    image_to_probe: &Matrix4<f64>,
    array_centre_px: [f64; 2],
) -> Result<Matrix4<f64>, CalibrationError> {
    if !array_centre_px.iter().all(|x| x.is_finite()) {
        return Err(CalibrationError::Centre { found: array_centre_px });
    }
    let mut axes = [Vector3::zeros(); 2];
    for (axis, unit) in axes.iter_mut().enumerate() {
        let column = image_to_probe.fixed_view::<3, 1>(0, axis).into_owned();
        let found = column.norm();
        if !(PIXEL_MM[0]..=PIXEL_MM[1]).contains(&found) {
            return Err(CalibrationError::PixelSize { axis, found });
        }
        *unit = column / found;
    }
    let skew = axes[0].dot(&axes[1]).asin().abs();
    if skew > SKEW {
        return Err(CalibrationError::Skewed { found: skew });
    }
    let [sum, difference] = [axes[0] + axes[1], axes[0] - axes[1]].map(|v| v.normalize());
    let (x, y) = ((sum + difference).normalize(), (sum - difference).normalize());
    let z = x.cross(&y);
    let origin = image_to_probe * Vector4::new(array_centre_px[0], array_centre_px[1], 0.0, 1.0);
    let mut transform = Matrix4::identity();
    for (column, axis) in [x, y, z, origin.xyz()].iter().enumerate() {
        transform.fixed_view_mut::<3, 1>(0, column).copy_from(axis);
    }
    Ok(matrix::rigid(&transform)?)
}

/// A transform between two named frames.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedTransform {
    /// Frame that points come from.
    pub from: String,
    /// Frame that points go to.
    pub to: String,
    /// The transform on column vectors.
    pub matrix: Matrix4<f64>,
}

/// What a PLUS device-set configuration says about calibration.
#[derive(Clone, Debug, PartialEq)]
pub struct PlusCalibration {
    path: PathBuf,
    transforms: Vec<NamedTransform>,
    centre_px: Option<[f64; 2]>,
}

impl PlusCalibration {
    /// Reads the `Transform` elements under `CoordinateDefinitions`, and the first `TransducerCenterPixel`, of a PLUS
    /// configuration file (XML).
    pub fn read(path: &Path) -> Result<Self, CalibrationError> {
        let text = read::text(path, read::XML).map_err(|source| CalibrationError::Read {
            path: path.to_owned(),
            source,
        })?;
        Self::parse(&text, path)
    }

    /// As [`PlusCalibration::read`], from text; `path` names it in errors.
    pub fn parse(text: &str, path: &Path) -> Result<Self, CalibrationError> {
        let document = roxmltree::Document::parse(text).map_err(|error| CalibrationError::Xml {
            path: path.to_owned(),
            line: error.pos().row,
            column: error.pos().col,
            found: format!("not well-formed XML: {error}"),
        })?;
        let fault = |node: roxmltree::Node, found: String| {
            let position = document.text_pos_at(node.range().start);
            CalibrationError::Xml {
                path: path.to_owned(),
                line: position.row,
                column: position.col,
                found,
            }
        };
        let attribute = |node: roxmltree::Node, name: &str| {
            node.attribute(name).map(str::to_owned).ok_or_else(|| {
                fault(
                    node,
                    format!("`Transform` without `{name}`; expected `From`, `To` and `Matrix`"),
                )
            })
        };
        let mut transforms = Vec::new();
        let definitions = document
            .descendants()
            .filter(|node| node.has_tag_name("CoordinateDefinitions"));
        for node in definitions
            .flat_map(|node| node.children())
            .filter(|node| node.has_tag_name("Transform"))
        {
            let matrix = Rows::parse(&attribute(node, "Matrix")?)
                .map_err(|found| fault(node, format!("`Matrix` holds {found}; expected 16 numbers row by row")))?;
            transforms.push(NamedTransform {
                from: attribute(node, "From")?,
                to: attribute(node, "To")?,
                matrix: matrix.0,
            });
        }
        let centre = document
            .descendants()
            .find_map(|node| node.attribute("TransducerCenterPixel").map(|text| (node, text)));
        let centre_px = match centre {
            None => None,
            Some((node, text)) => Some(pair(text).ok_or_else(|| {
                fault(
                    node,
                    format!("`TransducerCenterPixel` is `{text}`; expected a column and a row"),
                )
            })?),
        };
        Ok(Self {
            path: path.to_owned(),
            transforms,
            centre_px,
        })
    }

    /// The transforms, in the order of the file.
    pub fn transforms(&self) -> &[NamedTransform] {
        &self.transforms
    }

    /// The transform from one named frame to another, as the file defines it or as the inverse of what it defines.
    pub fn transform(&self, from: &str, to: &str) -> Result<Matrix4<f64>, CalibrationError> {
        let defined = |from: &str, to: &str| self.transforms.iter().find(|t| t.from == from && t.to == to);
        defined(from, to)
            .map(|transform| transform.matrix)
            .or_else(|| defined(to, from).and_then(|transform| transform.matrix.try_inverse()))
            .ok_or_else(|| CalibrationError::NoTransform {
                path: self.path.clone(),
                from: from.to_owned(),
                to: to.to_owned(),
                has: if self.transforms.is_empty() {
                    "none at all".to_owned()
                } else {
                    let names: Vec<_> = self
                        .transforms
                        .iter()
                        .map(|t| format!("{}To{}", t.from, t.to))
                        .collect();
                    names.join(", ")
                },
            })
    }

    /// The pixel at the centre of the array: from an `Image` to `TransducerOriginPixel` transform, or else from
    /// `TransducerCenterPixel`.
    pub fn array_centre_px(&self) -> Option<[f64; 2]> {
        match self.transform("TransducerOriginPixel", "Image") {
            Ok(matrix) => Some([matrix[(0, 3)], matrix[(1, 3)]]),
            Err(_) => self.centre_px,
        }
    }
}

fn pair(text: &str) -> Option<[f64; 2]> {
    let numbers: Vec<f64> = text.split_whitespace().map(str::parse).collect::<Result<_, _>>().ok()?;
    <[f64; 2]>::try_from(numbers)
        .ok()
        .filter(|pair| pair.iter().all(|x| x.is_finite()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn data(name: &str) -> Option<PathBuf> {
        let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data/config")).join(name);
        if path.exists() {
            return Some(path);
        }
        println!("SKIPPED: {} is not there", path.display());
        None
    }

    #[test]
    fn a_tilted_calibration_gives_a_square_transducer() {
        let text = r#"<PlusConfiguration>
          <ScanConversion TransducerCenterPixel="410 0"/>
          <CoordinateDefinitions>
            <Transform From="Image" To="Probe" Matrix="0.000796231 0.0854272 0.000850194 12.74
              -0.0853999 0.000772721 0.00233653 50.76 0.00232863 -0.000871617 0.0853992 -0.5 0 0 0 1"/>
          </CoordinateDefinitions></PlusConfiguration>"#;
        let plus = PlusCalibration::parse(text, Path::new("config.xml")).expect("config");
        let image = plus.transform("Image", "Probe").expect("transform");
        assert_eq!(plus.array_centre_px(), Some([410.0, 0.0]));
        let transducer = transducer_to_probe(&image, [410.0, 0.0]).expect("calibration");
        assert!((transducer[(0, 3)] - (12.74 + 410.0 * 0.000796231)).abs() < 1e-9);
        assert!((transducer[(1, 3)] - (50.76 - 410.0 * 0.0853999)).abs() < 1e-9);
        // A pixel 100 rows down the middle lies 100 pixel sizes along the transducer's y.
        let deep = image * Vector4::new(410.0, 100.0, 0.0, 1.0);
        let y = matrix::inverse_rigid(&transducer) * deep;
        assert!(
            (y.y - 100.0 * 0.0854).abs() < 0.01 && y.x.abs() < 0.02 && y.z.abs() < 0.02,
            "{y}"
        );
        let back = plus.transform("Probe", "Image").expect("inverse");
        assert!((back * image - Matrix4::identity()).amax() < 1e-9);
    }

    #[test]
    fn configurations_of_real_devices_are_read() {
        let expected = [
            ("BoneUltrasound_L14_config.xml", 1, Some([410.0, 0.0])),
            (
                "PlusDeviceSet_NwirePhantomFreehand_vtkVolumeReconstructorTest2.xml",
                2,
                None,
            ),
            (
                "PlusDeviceSet_Server_SimulatedUltrasound_3DSlicer.xml",
                3,
                Some([410.0, -5.0]),
            ),
            ("PlusDeviceSet_SpinePhantomFreehandReconstructionOnly.xml", 2, None),
            (
                "PlusDeviceSet_UsSimulatorAlgoTestCurvilinear.xml",
                3,
                Some([600.0, 34.0]),
            ),
        ];
        for (name, count, centre) in expected {
            let Some(path) = data(name) else { return };
            let plus = PlusCalibration::read(&path).expect(name);
            assert_eq!(
                (plus.transforms().len(), plus.array_centre_px()),
                (count, centre),
                "{name}"
            );
            let image = plus.transform("Image", "Probe").expect(name);
            transducer_to_probe(&image, centre.unwrap_or([410.0, 0.0])).expect(name);
        }
    }

    #[test]
    fn faults_say_where_they_are() {
        let parse = |text: &str| PlusCalibration::parse(text, Path::new("c.xml"));
        let short = "<P>\n <CoordinateDefinitions>\n  <Transform From='A' To='B' Matrix='1 2 3'/>\n </CoordinateDefinitions></P>";
        let error = parse(short).expect_err("short").to_string();
        assert!(
            error.contains("line 3, column 3") && error.contains("3 numbers in place of 16"),
            "{error}"
        );
        assert!(matches!(
            parse("<P><Q></P>"),
            Err(CalibrationError::Xml { line: 1, .. })
        ));
        let nameless = "<P><CoordinateDefinitions><Transform To='B' Matrix='1'/></CoordinateDefinitions></P>";
        assert!(parse(nameless).is_err());
        let empty = parse("<P/>").expect("empty");
        let error = empty.transform("Image", "Probe").expect_err("none").to_string();
        assert!(
            error.contains("no transform from `Image` to `Probe`; it has none"),
            "{error}"
        );
        assert!(parse("<P TransducerCenterPixel='4'/>").is_err());
    }

    #[test]
    fn calibrations_that_make_no_sense_are_refused() {
        let centre = [0.0, 0.0];
        let flat = Matrix4::zeros();
        assert!(matches!(
            transducer_to_probe(&flat, centre),
            Err(CalibrationError::PixelSize { axis: 0, .. })
        ));
        let nan = Matrix4::from_element(f64::NAN);
        assert!(matches!(
            transducer_to_probe(&nan, centre),
            Err(CalibrationError::PixelSize { .. })
        ));
        let mut skewed = Matrix4::new_scaling(0.1);
        skewed[(0, 1)] = 0.05;
        assert!(matches!(
            transducer_to_probe(&skewed, centre),
            Err(CalibrationError::Skewed { .. })
        ));
        let fine = Matrix4::new_scaling(0.1);
        assert!(matches!(
            transducer_to_probe(&fine, [f64::NAN, 0.0]),
            Err(CalibrationError::Centre { .. })
        ));
        assert!(matches!(
            transducer_to_probe(&fine, [1e9, 0.0]),
            Err(CalibrationError::NotRigid(NotRigid::TooFar { .. }))
        ));
    }
}
