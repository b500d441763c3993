//! Device-set configurations of PLUS (XML): calibrations and imaging parameters.

mod encoding;
mod info;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use nalgebra::Matrix4;
use roxmltree::{Document, Node, TextPos};
use serde::Serialize;

use super::TrackingError;
use super::probe::{ProbeKind, ProbeSpec};
use super::sequence::{TrackedTransform, ends};
use insonify_base::matrix::Rows;
use insonify_base::{border, number, read, text};

pub use info::{CalibrationInfo, PlusInfo};

/// Largest asymmetry of a curved array's sector, degrees; beyond it the field of view is ignored.
const LOPSIDED_DEG: f64 = 1.0;

/// A transform between two named frames, from a coordinate definition.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DefinedTransform {
    /// Name of the source frame.
    pub from: String,
    /// Name of the target frame.
    pub to: String,
    /// Matrix on column vectors, mm.
    pub matrix: Rows,
}

/// Straight wire of a calibration phantom.
#[derive(Clone, Debug, PartialEq)]
pub struct Wire {
    /// Name, unique in its phantom.
    pub name: String,
    /// Ends in the phantom's frame, mm.
    pub ends_mm: [[f64; 3]; 2],
}

/// Transforms, transducer and images in a PLUS device-set configuration.
#[derive(Clone, Debug, PartialEq)]
pub struct PlusConfig {
    path: PathBuf,
    transforms: Vec<DefinedTransform>,
    centre_px: Option<[f64; 2]>,
    clip_px: Option<[[f64; 2]; 2]>,
    transducer: Option<String>,
    probe: ProbeSpec,
    image_size: Option<[usize; 2]>,
    pixel_mm: Option<[f64; 2]>,
    wires: Vec<Wire>,
    registration: Option<Matrix4<f64>>,
    warnings: Vec<String>,
}

impl PlusConfig {
    /// Reads a configuration: the `Transform` elements under `CoordinateDefinitions`, the first `ScanConversion`, and
    /// the first `TransducerCenterPixel`, `NumberOfScanLines` and `ClipRectangleOrigin` anywhere in the file.
    pub fn read(path: &Path) -> Result<Self, TrackingError> {
        let no_xml = |contents: String| {
            TrackingError::file(path, format!(": found {contents}; expected a PLUS configuration (XML)"))
        };
        let bytes = read::bytes(path, read::XML).map_err(|source| TrackingError::read(path, source))?;
        let text = encoding::decoded(&bytes).map_err(&no_xml)?;
        let text = text.trim_start();
        if text.starts_with('<') {
            return Self::parse(text, path);
        }
        let is_text = !text.is_empty() && text.chars().take(16).all(|c| c.is_whitespace() || !c.is_control());
        Err(no_xml(match text.chars().take(16).collect::<String>() {
            start if is_text => format!("\"{}\"", text::head(&start, 24)),
            _ if bytes.is_empty() => "an empty file".to_owned(),
            _ => "binary data".to_owned(),
        }))
    }

    /// Parses a configuration as [`PlusConfig::read`] does, from text; `path` is the file name shown in errors.
    pub fn parse(text: &str, path: &Path) -> Result<Self, TrackingError> {
        let document = border::guarded(|| Document::parse(text))
            .map_err(|panicked| TrackingError::file(path, format!(": found {panicked}; expected XML")))?
            .map_err(|error| xml_error(path, error.pos(), &format!("not well-formed XML: {error}")))?;
        let root = Element {
            document: &document,
            path,
            node: document.root(),
        };
        let definitions = root.all("CoordinateDefinitions");
        let transforms = definitions
            .flat_map(|definitions| {
                definitions
                    .node
                    .children()
                    .map(move |node| Element { node, ..definitions })
            })
            .filter(|element| element.node.has_tag_name("Transform"))
            .map(|element| element.transform())
            .collect::<Result<_, _>>()?;
        let scan = root.all("ScanConversion").next();
        // What serves a guess or a check alone is left out where it cannot be read.
        let mut warnings = Vec::new();
        let mut guess = |element: Option<Element<'_>>, key: &str| {
            let pair = element.map_or(Ok(None), |element| element.pair(key));
            pair.unwrap_or_else(|error| {
                warnings.push(format!("{error}: ignored"));
                None
            })
        };
        // Devices of many kinds may have these attributes: the first that has one is taken, whatever its tag.
        let clip = ["ClipRectangleOrigin", "ClipRectangleSize"].map(|key| guess(root.with(key), key));
        let size = guess(scan, "OutputImageSizePixel");
        let pixel_mm = guess(scan, "OutputImageSpacingMmPerPixel");
        let centre = root.with("TransducerCenterPixel");
        let phantom = root.all("PhantomDefinition").next();
        let wires = |phantom: Element<'_>| phantom.all("Wire").map(|wire| wire.wire()).collect::<Result<_, _>>();
        let registration = phantom.and_then(|phantom| phantom.all("Registration").next());
        let size = size.filter(|size| size.iter().all(|side| (1.0..=65_535.0).contains(side)));
        let probe = root.probe(scan, &mut warnings)?;
        Ok(Self {
            path: path.to_owned(),
            transforms,
            centre_px: centre.map_or(Ok(None), |centre| centre.pair("TransducerCenterPixel"))?,
            clip_px: clip[0].zip(clip[1]).map(<[[f64; 2]; 2]>::from),
            transducer: scan.and_then(|scan| scan.node.attribute("TransducerName").map(str::to_owned)),
            probe,
            image_size: size.map(|size| size.map(|side| side as usize)),
            pixel_mm,
            wires: phantom.map_or(Ok(Vec::new()), wires)?,
            registration: registration.map_or(Ok(None), |element| element.matrix("MatrixValue"))?,
            warnings,
        })
    }

    /// Warnings about what was left out, one sentence each.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// Wires of the phantom definition.
    pub fn wires(&self) -> &[Wire] {
        &self.wires
    }

    /// Registration of the phantom definition: from the phantom to the marker on it.
    pub fn registration(&self) -> Option<&Matrix4<f64>> {
        self.registration.as_ref()
    }

    /// Transform from one named frame to another, as defined in the file or as the inverse of a definition.
    pub fn transform(&self, from: &str, to: &str) -> Result<Matrix4<f64>, TrackingError> {
        let defined = |from: &str, to: &str| self.transforms.iter().find(|t| t.from == from && t.to == to);
        defined(from, to)
            .map(|transform| transform.matrix.0)
            .or_else(|| defined(to, from).and_then(|transform| transform.matrix.0.try_inverse()))
            .ok_or_else(|| {
                let names: Vec<String> = self
                    .transforms
                    .iter()
                    .map(|t| format!("{}To{}", t.from, t.to))
                    .collect();
                let names = if names.is_empty() {
                    "none at all".to_owned()
                } else {
                    names.join(", ")
                };
                let has = text::clipped(&names, text::MESSAGE);
                let text = format!(" defines no transform from `{from}` to `{to}`; it has {has}");
                TrackingError::file(&self.path, text)
            })
    }

    /// Transforms defined in the file, by names such as `PhantomToReference`; ambiguous names are left out.
    pub fn definitions(&self) -> BTreeMap<String, TrackedTransform> {
        let named = self.transforms.iter().filter_map(|defined| {
            let name = format!("{}To{}", defined.from, defined.to);
            let readable = ends(&name) == Some((&defined.from, &defined.to));
            let matrix = defined.matrix.0;
            let valid = matrix.iter().all(|number| number.is_finite());
            (readable && valid).then_some((name, TrackedTransform { matrix, valid }))
        });
        named.collect()
    }

    /// Pixel at the centre of the array: from an `Image` to `TransducerOriginPixel` transform, or else from
    /// `TransducerCenterPixel`.
    pub fn array_centre_px(&self) -> Option<[f64; 2]> {
        match self.transform("TransducerOriginPixel", "Image") {
            Ok(matrix) => Some([matrix[(0, 3)], matrix[(1, 3)]]),
            Err(_) => self.centre_px,
        }
    }

    /// Warning if the file has two centres of the array more than a pixel apart.
    pub fn two_centres(&self) -> Option<String> {
        let ([a, b], [c, d]) = (self.array_centre_px()?, self.centre_px?);
        let differ = (a - c).hypot(b - d) > 1.0;
        differ.then(|| {
            format!(
                "`plus_config` has the centre of the array at pixel ({a}, {b}) by the transform between `Image` and \
                 `TransducerOriginPixel`, which is taken, and at ({c}, {d}) by `TransducerCenterPixel`"
            )
        })
    }

    /// Guess of the pixel at the centre of a straight array, and its basis: the middle of the upper edge of the clip
    /// rectangle, or else of the images, whose size may be known from elsewhere.
    pub fn guessed_centre_px(&self, images: Option<[usize; 2]>) -> Option<([f64; 2], &'static str)> {
        let clip = self.clip_px.map(|clip| (clip, "clip rectangle"));
        let whole = images
            .or(self.image_size)
            .map(|size| ([[0.0; 2], size.map(|side| side as f64)], "images"));
        let ([corner, size], grounds) = clip.or(whole)?;
        Some(([corner[0] + size[0] / 2.0, corner[1]], grounds))
    }

    /// Transducer as keys of a probe table, as far as the file describes it.
    pub fn probe(&self) -> &ProbeSpec {
        &self.probe
    }

    /// Name of the transducer.
    pub fn transducer(&self) -> Option<&str> {
        self.transducer.as_deref()
    }

    /// Columns and rows of the images.
    pub fn image_size(&self) -> Option<[usize; 2]> {
        self.image_size
    }

    /// Width and height of a pixel, mm.
    pub fn pixel_mm(&self) -> Option<[f64; 2]> {
        self.pixel_mm
    }
}

fn xml_error(path: &Path, position: TextPos, fault: &str) -> TrackingError {
    let fault = text::clipped(fault, text::MESSAGE);
    TrackingError::file(
        path,
        format!(", line {}, column {}: {fault}", position.row, position.col),
    )
}

/// An XML element with the context for its errors.
#[derive(Clone, Copy)]
struct Element<'a> {
    document: &'a Document<'a>,
    path: &'a Path,
    node: Node<'a, 'a>,
}

impl<'a> Element<'a> {
    fn all(self, tag: &'static str) -> impl Iterator<Item = Self> {
        let nodes = self.node.descendants().filter(move |node| node.has_tag_name(tag));
        nodes.map(move |node| Self { node, ..self })
    }

    /// First element that has an attribute.
    fn with(self, key: &str) -> Option<Self> {
        let node = self.node.descendants().find(|node| node.has_attribute(key))?;
        Some(Self { node, ..self })
    }

    fn fault(self, text: String) -> TrackingError {
        xml_error(self.path, self.document.text_pos_at(self.node.range().start), &text)
    }

    fn numbers<const N: usize>(self, key: &str, expected: &str) -> Result<Option<[f64; N]>, TrackingError> {
        let Some(text) = self.node.attribute(key) else {
            return Ok(None);
        };
        let numbers: Option<Vec<f64>> = text.split_whitespace().map(number::parsed).collect();
        match numbers.and_then(|numbers| <[f64; N]>::try_from(numbers).ok()) {
            Some(numbers) => Ok(Some(numbers)),
            None => Err(self.fault(format!("`{key}` is `{text}`; expected {expected}"))),
        }
    }

    /// Numbers of columns and of rows; one of planes may follow.
    fn pair(self, key: &str) -> Result<Option<[f64; 2]>, TrackingError> {
        const EXPECTED: &str = "two numbers, of columns and of rows, or three with that of planes";
        let pair = self.numbers(key, EXPECTED);
        pair.or_else(|_| {
            Ok(self
                .numbers::<3>(key, EXPECTED)?
                .map(|[columns, rows, _]| [columns, rows]))
        })
    }

    fn number(self, key: &str) -> Result<Option<f64>, TrackingError> {
        Ok(self.numbers::<1>(key, "a number")?.map(|[number]| number))
    }

    fn transform(self) -> Result<DefinedTransform, TrackingError> {
        let attribute = |name: &str| {
            let missing = || {
                self.fault(format!(
                    "`Transform` without `{name}`; expected `From`, `To` and `Matrix`"
                ))
            };
            self.node.attribute(name).ok_or_else(missing)
        };
        attribute("Matrix")?;
        Ok(DefinedTransform {
            from: attribute("From")?.to_owned(),
            to: attribute("To")?.to_owned(),
            matrix: Rows(self.matrix("Matrix")?.unwrap_or_default()),
        })
    }

    fn matrix(self, key: &str) -> Result<Option<Matrix4<f64>>, TrackingError> {
        let fault = |found| self.fault(format!("`{key}` holds {found}; expected 16 numbers row by row"));
        let text = self.node.attribute(key);
        text.map(|text| Rows::parse(text).map(|rows| rows.0).map_err(fault))
            .transpose()
    }

    fn wire(self) -> Result<Wire, TrackingError> {
        let end = |key: &str| {
            let point = self.numbers(key, "three numbers, mm")?;
            point.ok_or_else(|| self.fault(format!("`Wire` without `{key}`")))
        };
        let name = self.node.attribute("Name").or(self.node.attribute("Id"));
        Ok(Wire {
            name: name.unwrap_or_default().to_owned(),
            ends_mm: [end("EndPointFront")?, end("EndPointBack")?],
        })
    }

    /// Keys of a probe table stated by a `ScanConversion`, and the number of scanlines.
    fn probe(self, scan: Option<Self>, warnings: &mut Vec<String>) -> Result<ProbeSpec, TrackingError> {
        let mut spec = ProbeSpec::default();
        for key in ["NumberOfScanLines", "NumberOfScanlines"] {
            match self.with(key).map_or(Ok(None), |element| element.number(key)) {
                Ok(Some(lines)) => spec.sampling.lines = Some(lines as u32),
                Ok(None) => {}
                Err(error) => warnings.push(format!("{error}: ignored")),
            }
        }
        let Some(scan) = scan else { return Ok(spec) };
        let between =
            |start: &str, stop: &str| -> Result<_, TrackingError> { Ok(scan.number(start)?.zip(scan.number(stop)?)) };
        match scan.node.attribute("TransducerGeometry") {
            Some("LINEAR") => {
                spec.kind = Some(ProbeKind::Linear);
                spec.set("width_mm", scan.number("TransducerWidthMm")?);
                spec.sampling.depth_mm = scan.number("ImagingDepthMm")?;
            }
            Some("CURVILINEAR") => {
                spec.kind = Some(ProbeKind::Curvilinear);
                spec.set("radius_mm", scan.number("RadiusStartMm")?);
                spec.sampling.depth_mm = between("RadiusStartMm", "RadiusStopMm")?.map(|(start, stop)| stop - start);
                let angle_deg = between("ThetaStartDeg", "ThetaStopDeg")?
                    .filter(|(start, stop)| (start + stop).abs() <= LOPSIDED_DEG)
                    .map(|(start, stop)| stop - start);
                spec.set("angle_deg", angle_deg);
            }
            _ => {}
        }
        Ok(spec)
    }
}

#[cfg(test)]
mod tests;
