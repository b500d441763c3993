//! NRRD: `.nrrd` with its data, `.nhdr` with the data in another file. After the format's definition at
//! teem.sourceforge.net/nrrd/format.html; section names in this file are those of that page.

mod write;

use std::io::{BufRead, BufReader};
use std::path::Path;

use nalgebra::Vector3;

use super::element::{ByteOrder, Element};
use super::error::{At, VolumeError, quoted};
use super::format::Format;
use super::header::{Axis, DataPlace, Encoding, Header, Skip};
use super::text::{Field, Line, Lines};
use super::{names, several, unit};
use insonify_base::number::significant;
use insonify_base::output::place::Written;
use insonify_base::read;

/// Relative deviation of spacings from the steps of the directions from which they contradict each other.
const SAME_STEP: f64 = 0.01;

/// Magic number.
const MAGIC: &[u8] = b"NRRD";

/// The format.
pub(super) const FORMAT: Format = Format {
    name: "NRRD",
    endings: &[".nrrd", ".seg.nrrd", ".nhdr"],
    data_extensions: &[],
    recognises: |start| start.starts_with(MAGIC),
    read_header,
    written: &[
        Written {
            ending: ".nrrd",
            marks: &[MAGIC],
        },
        Written {
            ending: ".seg.nrrd",
            marks: &[MAGIC],
        },
    ],
    write: write::write,
};

/// Reads the header of an NRRD file.
fn read_header(path: &Path) -> Result<Header, VolumeError> {
    let file = read::open(path).map_err(|cause| VolumeError::read(path, cause))?;
    parse(path, BufReader::new(file))
}

/// Fields of a header before assembly.
#[derive(Default)]
struct Fields {
    element: Option<Option<Element>>,
    dimension: Option<usize>,
    sizes: Option<Vec<usize>>,
    encoding: Option<Encoding>,
    order: Option<ByteOrder>,
    space: Option<Space>,
    space_dimension: Option<usize>,
    /// Units along the axes of the space.
    space_units: Units,
    directions: Option<Vec<Option<Vec<f64>>>>,
    origin: Option<Vec<f64>>,
    spacings: Option<Vec<f64>>,
    /// Units along the index axes, where there are no directions.
    units: Units,
    minima: Option<Vec<f64>>,
    maxima: Option<Vec<f64>>,
    /// Whether samples are the nodes of each axis, its ends among them, and not the centres of cells.
    nodes: Option<Vec<bool>>,
    /// Whether each axis is spatial.
    domains: Option<Vec<bool>>,
    spacings_line: usize,
    skip_lines: usize,
    skip_bytes: Option<Skip>,
    /// Names of the data files and the line number of the field.
    data_files: Option<(Vec<String>, usize)>,
    /// Whether the names of data files are the remaining lines.
    is_list: bool,
    key_values: Vec<(String, String)>,
    warnings: Vec<String>,
}

/// Parses a header up to its blank line.
pub(super) fn parse(path: &Path, reader: impl BufRead) -> Result<Header, VolumeError> {
    let mut lines = Lines::new(reader);
    let fail = |cause| VolumeError::read(path, cause);
    let magic = lines.next().map_err(fail)?.map(|line| line.text).unwrap_or_default();
    let version = magic.strip_prefix("NRRD").and_then(|digits| digits.parse::<u32>().ok());
    if !version.is_some_and(|version| (1..=5).contains(&version)) {
        return Err(VolumeError::malformed(
            path,
            At::Line(1),
            quoted(&magic),
            "\"NRRD0001\" to \"NRRD0005\"",
        ));
    }
    let mut fields = Fields::default();
    while let Some(line) = lines.next().map_err(fail)? {
        if fields.is_list {
            fields.take_name(path, &line)?;
            continue;
        }
        if line.text.is_empty() {
            break;
        }
        if line.text.starts_with('#') {
            continue;
        }
        let colon = line
            .text
            .find(": ")
            .or_else(|| line.text.strip_suffix(':').map(str::len));
        // The value of a field may hold ":=", and that of a key ": ": the first of the two divides the line.
        match (line.text.find(":="), colon) {
            (Some(split), colon) if colon.is_none_or(|colon| split < colon) => {
                let (key, value) = (&line.text[..split], &line.text[split + 2..]);
                fields.key_values.push((unescaped(key), unescaped(value)));
            }
            (_, Some(split)) => {
                let field = Field {
                    path,
                    line: line.number,
                    name: line.text[..split].trim(),
                    value: line.text[split + 1..].trim(),
                };
                fields.set(&field)?;
            }
            _ => {
                let expected = "\"field: value\" or \"key:=value\"";
                return Err(VolumeError::malformed(
                    path,
                    At::Line(line.number),
                    quoted(&line.text),
                    expected,
                ));
            }
        }
    }
    fields.finish(path, lines.offset(), lines.count())
}

/// Resolves escapes ("Key/value pairs"): a backslash before n is a line end, and one before itself a backslash.
fn unescaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut characters = text.chars();
    while let Some(character) = characters.next() {
        match character {
            '\\' => match characters.next() {
                Some('n') => out.push('\n'),
                Some(other) => out.push(other),
                None => out.push('\\'),
            },
            other => out.push(other),
        }
    }
    out
}

impl Fields {
    fn set(&mut self, field: &Field) -> Result<(), VolumeError> {
        match field.name.to_ascii_lowercase().as_str() {
            "type" => self.element = Some(element(field)?),
            "dimension" => {
                let dimension = field.exactly::<usize>(1, "the number of axes")?[0];
                if !(1..=16).contains(&dimension) {
                    return Err(field.malformed("1 to 16 axes"));
                }
                self.dimension = Some(dimension);
            }
            "sizes" => self.sizes = Some(field.numbers("whole numbers, one an axis")?),
            "encoding" => self.encoding = Some(encoding(field)?),
            "endian" => {
                self.order = Some(match field.value.to_ascii_lowercase().as_str() {
                    "little" => ByteOrder::Little,
                    "big" => ByteOrder::Big,
                    _ => return Err(field.malformed("little or big")),
                });
            }
            "space" => self.space = Some(Space::parse(field, &mut self.warnings)?),
            "space dimension" => {
                self.space_dimension = Some(field.exactly::<usize>(1, "the number of dimensions of space")?[0]);
            }
            "space units" => self.space_units = Units::parse(field),
            "units" => self.units = Units::parse(field),
            // The definition permits either spelling of some fields, with and without a blank.
            "axis mins" | "axismins" => self.minima = Some(field.numbers("numbers, one an axis")?),
            "axis maxs" | "axismaxs" => self.maxima = Some(field.numbers("numbers, one an axis")?),
            "centers" | "centerings" => {
                let centerings = field.value.to_ascii_lowercase();
                self.nodes = Some(
                    centerings
                        .split_whitespace()
                        .map(|centering| centering == "node")
                        .collect(),
                );
            }
            "space directions" => self.directions = Some(vectors(field)?),
            "space origin" => {
                self.origin = match vectors(field)?.as_slice() {
                    [Some(origin)] => Some(origin.clone()),
                    _ => return Err(field.malformed("one vector")),
                };
            }
            "spacings" => {
                self.spacings = Some(field.numbers("numbers, one an axis, mm")?);
                self.spacings_line = field.line;
            }
            "kinds" => {
                let spatial = |kind: &str| matches!(kind, "domain" | "space" | "???" | "none");
                let kinds = field.value.to_ascii_lowercase();
                self.key_values.push(("Kinds".to_owned(), kinds.clone()));
                self.domains = Some(kinds.split_whitespace().map(spatial).collect());
            }
            "line skip" | "lineskip" => {
                self.skip_lines = field.exactly::<usize>(1, "the number of lines to skip, 0 or more")?[0];
            }
            "byte skip" | "byteskip" => {
                let expected = "the number of bytes to skip, or -1 for data at the end of the file";
                self.skip_bytes = Some(match field.exactly::<i64>(1, expected)?[0] {
                    -1 => Skip::AllButTheImage,
                    bytes => Skip::Bytes(u64::try_from(bytes).map_err(|_| field.malformed(expected))?),
                });
            }
            "data file" | "datafile" => {
                if field.value.is_empty() {
                    return Err(field.malformed("the name of a file"));
                }
                self.is_list = several::is_list(field.value);
                let names = if self.is_list {
                    Vec::new()
                } else {
                    several::names(field)?
                };
                self.data_files = Some((names, field.line));
            }
            // These do not affect the numbers or their position (a measurement frame is for vector data).
            "content" | "block size" | "blocksize" | "number" | "min" | "max" | "old min" | "oldmin" | "old max"
            | "oldmax" | "thicknesses" | "labels" | "sample units" | "sampleunits" | "measurement frame" => {}
            other => self
                .warnings
                .push(format!("line {}: unknown field {} ignored", field.line, quoted(other))),
        }
        Ok(())
    }

    /// Adds a line of a list of data files.
    fn take_name(&mut self, path: &Path, line: &Line) -> Result<(), VolumeError> {
        let name = line.text.trim();
        let (names, _) = self.data_files.get_or_insert_default();
        if !name.is_empty() {
            names.push(name.to_owned());
        }
        several::check(path, At::Line(line.number), names.len())
    }

    fn finish(mut self, path: &Path, header_bytes: u64, header_lines: usize) -> Result<Header, VolumeError> {
        let missing = |name: &str| {
            let found = format!("no field {name:?} in {header_lines} lines");
            VolumeError::malformed(path, At::Header, found, format!("\"{name}: ...\""))
        };
        let Some(element) = self.element else {
            return Err(missing("type"));
        };
        let dimension = self.dimension.ok_or_else(|| missing("dimension"))?;
        let sizes = self.sizes.take().ok_or_else(|| missing("sizes"))?;
        let encoding = self.encoding.ok_or_else(|| missing("encoding"))?;
        let per_axis = |name: &str, found: Option<usize>| match found {
            Some(found) if found != dimension => {
                let found = format!("{found} entries in {name:?}");
                Err(VolumeError::malformed(
                    path,
                    At::Header,
                    found,
                    format!("one for each of {dimension} axes"),
                ))
            }
            _ => Ok(()),
        };
        per_axis("sizes", Some(sizes.len()))?;
        per_axis("space directions", self.directions.as_ref().map(Vec::len))?;
        per_axis("spacings", self.spacings.as_ref().map(Vec::len))?;
        per_axis("axis mins", self.minima.as_ref().map(Vec::len))?;
        per_axis("axis maxs", self.maxima.as_ref().map(Vec::len))?;
        per_axis("kinds", self.domains.as_ref().map(Vec::len))?;
        // Bytes and text have no byte order: their headers may leave it out. Others need it.
        let wide = element.is_some_and(|element| element.bytes() > 1);
        if self.order.is_none() && wide && encoding != Encoding::Text {
            return Err(missing("endian"));
        }
        let (axes, origin) = self.geometry(path, &sizes)?;
        let beside = |name: &String| path.parent().unwrap_or(Path::new("")).join(name);
        let (data, more, start) = match &self.data_files {
            Some((names, _)) => {
                let [first, more @ ..] = names.as_slice() else {
                    return Err(missing("data file"));
                };
                (beside(first), more.iter().map(beside).collect(), 0)
            }
            None if path
                .extension()
                .is_some_and(|extension| extension.eq_ignore_ascii_case("nhdr")) =>
            {
                return Err(missing("data file"));
            }
            None => (path.to_owned(), Vec::new(), header_bytes),
        };
        Ok(Header {
            path: path.to_owned(),
            axes,
            origin,
            unit: self.space_units.known().or_else(|| self.units.known()),
            element,
            order: self.order.unwrap_or(ByteOrder::Little),
            scale: None,
            data: DataPlace {
                path: data,
                more,
                named: self.data_files.map(|(_, line)| At::Line(line)),
                start,
                skip_lines: self.skip_lines,
                skip: self.skip_bytes.unwrap_or(Skip::Bytes(0)),
                encoding,
            },
            names: names::from_keys(&self.key_values),
            key_values: self.key_values,
            warnings: self.warnings,
        })
    }

    /// "Space and orientation information", else "spacings" or the ends of the axes, else steps of 1 mm.
    fn geometry(&mut self, path: &Path, sizes: &[usize]) -> Result<(Vec<Axis>, Vector3<f64>), VolumeError> {
        let signs = self.space.map_or(Vector3::repeat(1.0), |space| space.to_lps);
        let mut doubts = Vec::new();
        let space_units = [0, 1, 2].map(|axis| self.space_units.millimetres(axis, &mut doubts).unwrap_or(1.0));
        let to_lps = signs.component_mul(&Vector3::from(space_units));
        let dimension = self.space.map(|space| space.dimension).or(self.space_dimension);
        let point = |numbers: &[f64]| match dimension {
            Some(dimension) if dimension != numbers.len() => {
                let found = format!("a vector of {} numbers", numbers.len());
                let expected = format!("{dimension}, as the space has dimensions");
                Err(VolumeError::malformed(path, At::Header, found, expected))
            }
            _ => {
                let number = |axis: usize| numbers.get(axis).copied().unwrap_or(0.0);
                Ok(Vector3::new(number(0), number(1), number(2)).component_mul(&to_lps))
            }
        };
        let stated_origin = self.origin.as_deref().map(point).transpose()?;
        let mut origin = stated_origin.unwrap_or_default();
        let spatial = |axis: usize| self.domains.as_ref().is_none_or(|domains| domains[axis]);
        let mut axes = Vec::with_capacity(sizes.len());
        let mut next_direction = 0;
        for (axis, &size) in sizes.iter().enumerate() {
            let direction = match &self.directions {
                Some(directions) => directions[axis].as_deref().map(point).transpose()?,
                // Spatial axes take x, y and z in turn: an axis of colours or of time does not use one up.
                None if spatial(axis) && next_direction < 3 => {
                    let unit = self.units.millimetres(axis, &mut doubts);
                    let unit = unit.unwrap_or(space_units[next_direction]);
                    let (first, spacing) = self.line(path, axis, size)?;
                    if stated_origin.is_none() {
                        origin[next_direction] = first * unit;
                    }
                    let mut step = Vector3::zeros();
                    step[next_direction] = spacing * unit;
                    next_direction += 1;
                    Some(step)
                }
                None => None,
            };
            axes.push(Axis { size, direction });
        }
        self.warnings.append(&mut doubts);
        let ends = self.minima.is_some() && self.maxima.is_some();
        if self.directions.is_none() && self.spacings.is_none() && !ends {
            self.warnings
                .push("no spacing in the file: taken as 1 mm along every axis".to_owned());
        }
        if self.directions.is_none() && signs != Vector3::repeat(1.0) {
            self.warnings.push(
                "no space directions in the file: the axes are taken as those of LPS, not of its space".to_owned(),
            );
        }
        if self.space.is_none() && self.space_dimension != Some(2) {
            let without = match (&self.directions, &self.spacings) {
                (Some(_), _) => Some("no anatomical space in the file"),
                (None, Some(_)) if next_direction == 3 => {
                    Some("no space and no directions in the file: placed by its spacings alone")
                }
                // Pictures have no place, and that there are no spacings, either, is told.
                _ => None,
            };
            self.warnings
                .extend(without.map(|text| format!("{text}, taken as LPS")));
        }
        self.warnings.extend(self.two_spacings(&axes, space_units));
        Ok((axes, origin))
    }

    /// Warning where spacings beside directions contradict them. The format permits only one of both.
    fn two_spacings(&self, axes: &[Axis], space_units: [f64; 3]) -> Option<String> {
        let (_, spacings) = self.directions.as_ref().zip(self.spacings.as_ref())?;
        let pairs = axes.iter().zip(spacings).filter(|(_, spacing)| spacing.is_finite());
        let pairs: Vec<[f64; 2]> = pairs
            .filter_map(|(axis, spacing)| Some([axis.direction?.norm(), *spacing * space_units[0]]))
            .collect();
        let differs = |[step, spacing]: &[f64; 2]| (spacing / step - 1.0).abs() > SAME_STEP;
        let list = |index: usize| {
            let lengths: Vec<String> = pairs.iter().map(|pair| significant(pair[index])).collect();
            lengths.join(" x ")
        };
        pairs.iter().any(differs).then(|| {
            format!(
                "line {}: the space directions have steps of {} mm, and spacings says {} mm: the directions are used; if \
                 organs have a wrong size, mend them",
                self.spacings_line,
                list(0),
                list(1)
            )
        })
    }

    /// Position of the first sample and step of an axis without direction ("axis mins", "axis maxs", "centerings"), in
    /// its unit. Samples are the centres of cells unless the file says that they are nodes.
    fn line(&self, path: &Path, axis: usize, size: usize) -> Result<(f64, f64), VolumeError> {
        let end = |ends: &Option<Vec<f64>>| ends.as_ref().map(|ends| ends[axis]).filter(|end| end.is_finite());
        let is_node = self.nodes.as_ref().and_then(|nodes| nodes.get(axis)) == Some(&true);
        let (minimum, maximum) = (end(&self.minima), end(&self.maxima));
        let intervals = if is_node { size.max(2) - 1 } else { size };
        let between = minimum.zip(maximum).map(|(low, high)| (high - low) / intervals as f64);
        let spacing = match &self.spacings {
            // A spacing that is not known is NaN.
            Some(spacings) if !(spacings[axis].is_nan() && between.is_some()) => {
                let spacing = spacings[axis];
                if !(spacing > 0.0 && spacing.is_finite()) {
                    let found = format!("spacing {spacing} of axis {axis}");
                    let line = At::Line(self.spacings_line);
                    let expected = "spacings above 0 and finite, mm";
                    return Err(VolumeError::malformed(path, line, found, expected));
                }
                spacing.copysign(between.unwrap_or(1.0))
            }
            _ => between.unwrap_or(1.0),
        };
        let half = if is_node { 0.0 } else { spacing / 2.0 };
        Ok((minimum.map_or(0.0, |minimum| minimum + half), spacing))
    }
}

/// Parses "type" in every spelling of the definition.
fn element(field: &Field) -> Result<Option<Element>, VolumeError> {
    Ok(Some(match field.value {
        "signed char" | "int8" | "int8_t" => Element::I8,
        "uchar" | "unsigned char" | "uint8" | "uint8_t" => Element::U8,
        "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => Element::I16,
        "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => Element::U16,
        "int" | "signed int" | "int32" | "int32_t" => Element::I32,
        "uint" | "unsigned int" | "uint32" | "uint32_t" => Element::U32,
        "longlong"
        | "long long"
        | "long long int"
        | "signed long long"
        | "signed long long int"
        | "int64"
        | "int64_t" => Element::I64,
        "ulonglong" | "unsigned long long" | "unsigned long long int" | "uint64" | "uint64_t" => Element::U64,
        "float" => Element::F32,
        "double" => Element::F64,
        "block" => return Ok(None),
        _ => return Err(field.malformed("a type of NRRD, such as \"unsigned char\", int16 or float")),
    }))
}

fn encoding(field: &Field) -> Result<Encoding, VolumeError> {
    Ok(match field.value.to_ascii_lowercase().as_str() {
        "raw" => Encoding::Raw,
        "txt" | "text" | "ascii" => Encoding::Text,
        "gz" | "gzip" => Encoding::Gzip,
        "bz2" | "bzip2" => Encoding::Bzip2,
        "hex" | "zrl" => return Err(field.unsupported("raw, gzip, bzip2 and ascii are read")),
        _ => return Err(field.malformed("raw, gzip, bzip2 or ascii")),
    })
}

/// Units of a field, one an axis.
#[derive(Default)]
struct Units {
    names: Vec<String>,
    field: String,
    line: usize,
}

impl Units {
    fn parse(field: &Field) -> Self {
        let names: Vec<&str> = if field.value.contains('"') {
            field.value.split('"').skip(1).step_by(2).collect()
        } else {
            field.value.split_whitespace().collect()
        };
        Self {
            names: names.into_iter().map(str::to_owned).collect(),
            field: field.name.to_owned(),
            line: field.line,
        }
    }

    /// First unit that is a length.
    fn known(&self) -> Option<String> {
        let mut names = self.names.iter();
        names.find(|name| unit::millimetres(name).is_some()).cloned()
    }

    /// Millimetres of the unit of an axis, that of the last one where fewer are stated; `None` if there is none. One
    /// that is no length is told once and taken as a millimetre.
    fn millimetres(&self, axis: usize, doubts: &mut Vec<String>) -> Option<f64> {
        let name = self.names.get(axis).or(self.names.last())?;
        let known = unit::millimetres(name);
        let doubt = format!("line {}: {} {} taken as mm", self.line, self.field, quoted(name));
        if known.is_none() && !doubts.contains(&doubt) {
            doubts.push(doubt);
        }
        Some(known.unwrap_or(1.0))
    }
}

// Spaces and vectors of an NRRD header.

/// A named space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Space {
    /// Number of components of its vectors.
    pub dimension: usize,
    /// Sign of each of its axes in LPS.
    pub to_lps: Vector3<f64>,
}

impl Space {
    /// Parses a `space` field: three directions by name or letter, or one of the spaces without anatomy, which are
    /// taken as LPS with a warning. A trailing `-time` or `T` adds a dimension.
    pub(super) fn parse(field: &Field, warnings: &mut Vec<String>) -> Result<Self, VolumeError> {
        let name = field.value.to_ascii_lowercase();
        let (name, timed) = match name.strip_suffix("-time") {
            Some(name) => (name, true),
            None if name.len() == 4 && name.ends_with('t') => (&name[..3], true),
            None => (name.as_str(), false),
        };
        let dimension = 3 + usize::from(timed);
        if matches!(name, "scanner-xyz" | "3d-right-handed" | "3d-left-handed") {
            warnings.push(format!("space {:?} names no anatomy: taken as LPS", field.value));
            return Ok(Self {
                dimension,
                to_lps: Vector3::repeat(1.0),
            });
        }
        let words: Vec<&str> = if name.contains('-') {
            name.split('-').collect()
        } else {
            // `get`, since an index within a character beyond ASCII would panic.
            (0..name.len()).filter_map(|index| name.get(index..=index)).collect()
        };
        let to_lps = match words[..] {
            [x, y, z] => [
                ("left", "right", x),
                ("posterior", "anterior", y),
                ("superior", "inferior", z),
            ]
            .map(|(positive, negative, word)| sign(word, positive, negative)),
            _ => [None; 3],
        };
        match to_lps {
            [Some(x), Some(y), Some(z)] => Ok(Self {
                dimension,
                to_lps: Vector3::new(x, y, z),
            }),
            _ => Err(field.malformed("a space such as left-posterior-superior or RAS")),
        }
    }
}

fn sign(word: &str, positive: &str, negative: &str) -> Option<f64> {
    let is = |name: &str| word == name || word == &name[..1];
    if is(positive) {
        Some(1.0)
    } else if is(negative) {
        Some(-1.0)
    } else {
        None
    }
}

/// Parses vectors such as `(1,0,0) (0,1,0) none`.
pub(super) fn vectors(field: &Field) -> Result<Vec<Option<Vec<f64>>>, VolumeError> {
    let expected = "vectors such as (1,0,0), or none";
    let mut rest = field.value;
    let mut out = Vec::new();
    while !rest.is_empty() {
        if let Some(after) = rest.strip_prefix("none") {
            out.push(None);
            rest = after.trim_start();
            continue;
        }
        let (inner, after) = rest
            .strip_prefix('(')
            .and_then(|opened| opened.split_once(')'))
            .ok_or_else(|| field.malformed(expected))?;
        let numbers: Result<Vec<f64>, _> = inner.split(',').map(|number| number.trim().parse()).collect();
        out.push(Some(numbers.map_err(|_| field.malformed(expected))?));
        rest = after.trim_start();
    }
    Ok(out)
}

#[cfg(test)]
mod tests;
