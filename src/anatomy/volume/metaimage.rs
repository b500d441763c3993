//! MetaImage: `.mha` with its data, `.mhd` with the data in another file. Tags as MetaIO (`metaImage.cxx`,
//! `metaObject.cxx`) reads them; world coordinates are LPS.

mod write;

use std::io::{BufRead, BufReader};
use std::path::Path;

use nalgebra::Vector3;

use super::element::{ByteOrder, Element, Scale};
use super::error::{At, VolumeError, quoted};
use super::format::Format;
use super::header::{Axis, DataPlace, Encoding, Header, Skip};
use super::text::{Field, Lines};
use super::{names, several, unit};
use insonify_base::output::place::Written;
use insonify_base::read;

/// The format.
pub(super) const FORMAT: Format = Format {
    name: "MetaImage",
    endings: &[".mha", ".mhd"],
    data_extensions: &[],
    recognises: is_header,
    read_header,
    written: &[Written {
        ending: ".mha",
        marks: &[b"ObjectType" as &[u8], b"NDims"],
    }],
    write: write::write,
};

/// Tag of the factor from stored numbers to values.
const SLOPE: &str = "ElementToIntensityFunctionSlope";

/// Whether these first bytes of a file are those of a MetaImage header.
fn is_header(start: &[u8]) -> bool {
    let line = start.split(|&byte| byte == b'\n').next().unwrap_or_default();
    let mut parts = line.splitn(2, |&byte| byte == b'=');
    let tag = String::from_utf8_lossy(parts.next().unwrap_or_default());
    parts.next().is_some() && matches!(tag.trim(), "ObjectType" | "NDims" | "Comment" | "ObjectSubType")
}

/// Reads the header of a MetaImage file.
fn read_header(path: &Path) -> Result<Header, VolumeError> {
    let file = read::open(path).map_err(|cause| VolumeError::read(path, cause))?;
    parse(path, BufReader::new(file))
}

/// Tags of a header before assembly.
#[derive(Default)]
struct Tags {
    dimensions: Option<usize>,
    sizes: Option<Vec<usize>>,
    /// `Some(None)` for a file without an image.
    element: Option<Option<Element>>,
    /// Values of a pixel; 0 where the header does not say.
    channels: usize,
    spacing: Option<Vec<f64>>,
    element_size: Option<Vec<f64>>,
    origin: Option<Vec<f64>>,
    directions: Option<Vec<f64>>,
    big_endian: bool,
    text: bool,
    compressed: bool,
    header_size: i64,
    slope: Option<f64>,
    intercept: Option<f64>,
    orientation: Option<[char; 3]>,
    /// Unit of length, if it is known.
    unit: Option<String>,
    /// Names of the data files, and whether they are the remaining lines of the header.
    data_files: Option<Vec<String>>,
    is_list: bool,
    warnings: Vec<String>,
    key_values: Vec<(String, String)>,
}

/// Parses a header up to its `ElementDataFile`.
pub(super) fn parse(path: &Path, reader: impl BufRead) -> Result<Header, VolumeError> {
    let mut lines = Lines::new(reader);
    let mut tags = Tags::default();
    while tags.data_files.is_none() {
        let Some(line) = lines.next().map_err(|cause| VolumeError::read(path, cause))? else {
            let found = format!("the end of the header after {} lines", lines.count());
            return Err(VolumeError::malformed(
                path,
                At::Byte(lines.offset()),
                found,
                "\"ElementDataFile = ...\"",
            ));
        };
        if line.text.trim().is_empty() {
            continue;
        }
        let Some((name, value)) = line.text.split_once('=') else {
            return Err(VolumeError::malformed(
                path,
                At::Line(line.number),
                quoted(&line.text),
                "\"tag = value\"",
            ));
        };
        tags.set(&Field {
            path,
            line: line.number,
            name: name.trim(),
            value: value.trim(),
        })?;
    }
    // It is the last tag of the header, but for a list of files.
    let (header_bytes, header_lines) = (lines.offset(), lines.count());
    while tags.is_list
        && let Some(line) = lines.next().map_err(|cause| VolumeError::read(path, cause))?
    {
        let names = tags.data_files.get_or_insert_default();
        names.extend(Some(line.text.trim().to_owned()).filter(|name| !name.is_empty()));
        several::check(path, At::Line(line.number), names.len())?;
    }
    tags.finish(path, header_bytes, header_lines)
}

/// Parses a flag; the accepted values are those of MetaIO.
fn flag(field: &Field) -> Result<bool, VolumeError> {
    match field.value.as_bytes().first() {
        Some(b'T' | b't' | b'1' | b'Y' | b'y') => Ok(true),
        Some(b'F' | b'f' | b'0' | b'N' | b'n') => Ok(false),
        _ => Err(field.malformed("True or False")),
    }
}

impl Tags {
    fn set(&mut self, field: &Field) -> Result<(), VolumeError> {
        match field.name {
            "ObjectType" if field.value != "Image" => return Err(field.unsupported("only images are read")),
            "NDims" => {
                let dimensions = field.exactly::<usize>(1, "the number of axes")?[0];
                if !(1..=10).contains(&dimensions) {
                    return Err(field.malformed("1 to 10 axes"));
                }
                self.dimensions = Some(dimensions);
            }
            "DimSize" => self.sizes = Some(self.per_axis(field, "sizes, one an axis")?),
            "ElementType" => self.element = Some(element(field)?),
            "ElementNumberOfChannels" => {
                let expected = "the number of values of a pixel, 1 or more";
                self.channels = field.exactly(1, expected)?[0];
                if self.channels == 0 {
                    return Err(field.malformed(expected));
                }
            }
            "ElementSpacing" => self.spacing = Some(self.spacings(field)?),
            "ElementSize" => self.element_size = Some(self.spacings(field)?),
            "Offset" | "Position" | "Origin" => {
                self.origin = Some(self.per_axis(field, "coordinates in mm, one an axis")?);
            }
            "TransformMatrix" | "Orientation" | "Rotation" => {
                let dimensions = self.dimensions(field)?;
                let expected = format!("direction cosines, {dimensions} an axis");
                self.directions = Some(field.exactly(dimensions * dimensions, &expected)?);
            }
            "BinaryData" => self.text = !flag(field)?,
            "BinaryDataByteOrderMSB" | "ElementByteOrderMSB" => self.big_endian = flag(field)?,
            "CompressedData" => self.compressed = flag(field)?,
            "HeaderSize" => {
                let expected = "the number of bytes to skip, or -1 for data at the end of the file";
                self.header_size = field.exactly(1, expected)?[0];
                if self.header_size < -1 {
                    return Err(field.malformed(expected));
                }
            }
            SLOPE => self.slope = Some(field.exactly(1, "a number")?[0]),
            "ElementToIntensityFunctionOffset" => self.intercept = Some(field.exactly(1, "a number")?[0]),
            "ElementDataFile" => {
                if field.value.is_empty() {
                    return Err(field.malformed("LOCAL or the name of a file"));
                }
                self.is_list = several::is_list(field.value);
                self.data_files = Some(if self.is_list {
                    Vec::new()
                } else {
                    several::names(field)?
                });
            }
            "AnatomicalOrientation" => {
                let letters: Vec<char> = field.value.to_ascii_uppercase().chars().collect();
                self.orientation = letters.try_into().ok();
            }
            "DistanceUnits" if !matches!(field.value, "?" | "") => {
                self.unit = unit::millimetres(field.value).map(|_| field.value.to_owned());
                if self.unit.is_none() {
                    let (line, unit) = (field.line, quoted(field.value));
                    self.warnings
                        .push(format!("line {line}: DistanceUnits {unit} taken as mm"));
                }
            }
            "ObjectType" | "ObjectSubType" | "Comment" | "Name" | "ID" | "ParentID" | "Color" | "CenterOfRotation"
            | "CompressedDataSize" | "CompressionLevel" | "ElementMin" | "ElementMax" | "DistanceUnits"
            | "Modality" => {}
            other => self.key_values.push((other.to_owned(), field.value.to_owned())),
        }
        Ok(())
    }

    fn dimensions(&self, field: &Field) -> Result<usize, VolumeError> {
        self.dimensions
            .ok_or_else(|| field.malformed("\"NDims = ...\" on a line before it"))
    }

    fn per_axis<T: std::str::FromStr>(&self, field: &Field, what: &str) -> Result<Vec<T>, VolumeError> {
        field.exactly(self.dimensions(field)?, what)
    }

    fn spacings(&self, field: &Field) -> Result<Vec<f64>, VolumeError> {
        let spacings: Vec<f64> = self.per_axis(field, "spacings in mm, one an axis")?;
        spacings
            .into_iter()
            .map(|spacing| field.check_spacing(spacing))
            .collect()
    }

    fn finish(mut self, path: &Path, header_bytes: u64, header_lines: usize) -> Result<Header, VolumeError> {
        let missing = |name: &str| {
            VolumeError::malformed(
                path,
                At::Header,
                format!("no tag {name:?}"),
                format!("\"{name} = ...\""),
            )
        };
        let dimensions = self.dimensions.ok_or_else(|| missing("NDims"))?;
        let sizes = self.sizes.take().ok_or_else(|| missing("DimSize"))?;
        let element = self.element.ok_or_else(|| missing("ElementType"))?;
        let data_files = self.data_files.take().unwrap_or_default();
        let [data_file, more @ ..] = data_files.as_slice() else {
            return Err(missing("ElementDataFile"));
        };
        let (spacing, directions) = (self.steps(dimensions), self.cosines(dimensions));
        let unit = self.unit.as_deref().and_then(unit::millimetres).unwrap_or(1.0);
        // The values of a pixel lie together: they are the fastest axis.
        let channels = (self.channels > 1).then_some(Axis {
            size: self.channels,
            direction: None,
        });
        let axes = channels
            .into_iter()
            .chain(sizes.iter().enumerate().map(|(axis, &size)| {
                let direction = (axis < 3).then(|| {
                    let mut step = Vector3::zeros();
                    for component in 0..dimensions.min(3) {
                        step[component] = match &directions {
                            Some(cosines) => cosines[axis * dimensions + component],
                            None => f64::from(u8::from(component == axis)),
                        };
                    }
                    step * spacing[axis] * unit
                });
                Axis { size, direction }
            }))
            .collect();
        let mut origin = Vector3::zeros();
        for (component, stated) in origin.iter_mut().zip(self.origin.iter().flatten()) {
            *component = *stated * unit;
        }
        let encoding = match (self.text, self.compressed) {
            (false, false) => Encoding::Raw,
            (false, true) => Encoding::Zlib,
            (true, false) => Encoding::Text,
            (true, true) => {
                let expected = "BinaryData = True where CompressedData = True";
                return Err(VolumeError::malformed(path, At::Header, "compressed text", expected));
            }
        };
        let beside = |name: &String| path.parent().unwrap_or(Path::new("")).join(name);
        let local = matches!(data_file.as_str(), "LOCAL" | "Local" | "local");
        Ok(Header {
            path: path.to_owned(),
            axes,
            origin,
            unit: self.unit,
            element,
            order: if self.big_endian {
                ByteOrder::Big
            } else {
                ByteOrder::Little
            },
            scale: Scale::new(SLOPE, self.slope.unwrap_or(1.0), self.intercept.unwrap_or(0.0)),
            data: DataPlace {
                path: if local { path.to_owned() } else { beside(data_file) },
                more: more.iter().map(beside).collect(),
                named: (!local).then_some(At::Line(header_lines)),
                start: if local { header_bytes } else { 0 },
                skip_lines: 0,
                skip: u64::try_from(self.header_size).map_or(Skip::AllButTheImage, Skip::Bytes),
                encoding,
            },
            names: names::from_keys(&self.key_values),
            key_values: self.key_values,
            warnings: self.warnings,
        })
    }

    /// Distance between samples along each axis.
    fn steps(&mut self, dimensions: usize) -> Vec<f64> {
        let (spacing, size) = (self.spacing.take(), self.element_size.take());
        if let (Some(spacing), Some(size)) = (&spacing, &size) {
            let differing = spacing
                .iter()
                .zip(size)
                .filter(|(spacing, size)| (*size / **spacing - 1.0).abs() > SAME_SIZE);
            // Slices may be thicker or thinner than their distance.
            if differing.count() > 1 {
                let list = |numbers: &[f64]| numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(" x ");
                self.warnings.push(format!(
                    "ElementSpacing is {} and ElementSize {}: the spacing is used; if organs have a wrong size, mend it",
                    list(spacing),
                    list(size)
                ));
            }
        }
        spacing.or(size).unwrap_or_else(|| {
            let warning = "no spacing in the file: taken as 1 mm along every axis";
            self.warnings.push(warning.to_owned());
            vec![1.0; dimensions]
        })
    }

    /// Direction cosines of the axes. AnatomicalOrientation repeats them, and many writers get it wrong: it counts only
    /// where there are none. Its letters name the sides at which the axes start (`MET_ORIENTATION`), so that RAI is
    /// LPS.
    fn cosines(&mut self, dimensions: usize) -> Option<Vec<f64>> {
        let (None, Some(letters), 3) = (&self.directions, self.orientation, dimensions) else {
            return self.directions.take();
        };
        let mut cosines = vec![0.0; 9];
        for (axis, letter) in letters.into_iter().enumerate() {
            let (side, world) = SIDES
                .iter()
                .zip([0, 0, 1, 1, 2, 2])
                .find(|(side, _)| **side == letter)?;
            cosines[3 * axis + world] = if matches!(side, 'R' | 'A' | 'I') { 1.0 } else { -1.0 };
        }
        let worlds = [0, 1, 2].map(|world| (0..3).filter(|axis| cosines[3 * axis + world] != 0.0).count());
        if worlds != [1; 3] || letters == ['R', 'A', 'I'] {
            return None;
        }
        let letters: String = letters.iter().collect();
        self.warnings.push(format!(
            "no TransformMatrix in the file: its axes start at the sides that AnatomicalOrientation names, {letters}"
        ));
        Some(cosines)
    }
}

/// Sides of the body, two for each axis of the world.
const SIDES: [char; 6] = ['R', 'L', 'A', 'P', 'I', 'S'];

/// Relative deviation of the sizes of elements from their distances from which they contradict each other.
const SAME_SIZE: f64 = 0.01;

/// Parses the `MET_` types; sizes as in MetaIO, whose `MET_LONG` has four bytes.
fn element(field: &Field) -> Result<Option<Element>, VolumeError> {
    Ok(Some(match field.value {
        "MET_CHAR" | "MET_ASCII_CHAR" => Element::I8,
        "MET_UCHAR" => Element::U8,
        "MET_SHORT" => Element::I16,
        "MET_USHORT" => Element::U16,
        "MET_INT" | "MET_LONG" => Element::I32,
        "MET_UINT" | "MET_ULONG" => Element::U32,
        "MET_LONG_LONG" => Element::I64,
        "MET_ULONG_LONG" => Element::U64,
        "MET_FLOAT" => Element::F32,
        "MET_DOUBLE" => Element::F64,
        "MET_OTHER" | "MET_NONE" => return Ok(None),
        _ => return Err(field.malformed("a type of MetaImage, such as MET_UCHAR, MET_SHORT or MET_FLOAT")),
    }))
}

#[cfg(test)]
mod tests;
