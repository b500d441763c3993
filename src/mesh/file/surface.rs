//! Surfaces of triangles from files: STL, PLY, OBJ, and VTK, legacy and XML, of poly-data or of unstructured grids.

use std::collections::HashMap;
use std::path::Path;

use ply_rs_bw::parser::Parser;
use ply_rs_bw::ply::{DefaultElement, Property};

use super::error::{Fault, MeshFileError, quote};
use super::{Cursor, renumber, vtk};
use insonify_base::border;
use insonify_base::foreign::Foreign;
use insonify_base::matrix::FARTHEST_MM;
use insonify_base::read;

/// Endings of the files that [`SurfaceFile::read`] reads.
pub const SURFACES: [&str; 6] = ["stl", "ply", "obj", "vtk", "vtp", "vtu"];

/// A surface of triangles.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SurfaceFile {
    /// Positions, in the unit and the axes of the file.
    pub points: Vec<[f64; 3]>,
    /// Corners of each triangle.
    pub triangles: Vec<[u32; 3]>,
    /// Axes stated by the file, as 3D Slicer does: RAS (true) or LPS (false).
    pub is_ras: Option<bool>,
    /// Whether the triangles are the outer faces of tetrahedra.
    pub is_outside: bool,
    /// Names of the objects of an OBJ file, or without any of its groups, with their first triangles.
    pub objects: Vec<(String, usize)>,
}

impl SurfaceFile {
    /// Reads a surface by the ending of its file, or without a known one by its contents. Polygons become triangles.
    ///
    /// # Errors
    /// [`MeshFileError`], with the line and byte offset where the contents violate the format.
    pub fn read(path: &Path) -> Result<Self, MeshFileError> {
        let bytes = read::bytes(path, read::MESH).map_err(|source| MeshFileError::Read {
            path: path.to_owned(),
            source,
        })?;
        let ending = path
            .extension()
            .map(|ending| ending.to_string_lossy().to_ascii_lowercase());
        Self::parse(&bytes, ending.as_deref().unwrap_or_default()).map_err(|fault| fault.locate(&bytes, path))
    }

    fn parse(bytes: &[u8], ending: &str) -> Result<Self, Fault> {
        let kind = Foreign::of(bytes)
            .filter(|kind| kind.mesh.is_some())
            .map(|kind| kind.name);
        let surface = match (kind, ending) {
            (Some("an STL surface"), _) => stl(bytes),
            (Some("a PLY surface"), _) => ply(bytes),
            (Some("an OBJ surface"), _) => obj(bytes),
            (Some(name), _) => Err(Fault::of_file(name, EXPECTED)),
            (None, "stl") => stl(bytes),
            (None, "ply") => ply(bytes),
            (None, "obj") => obj(bytes),
            (None, _) => {
                vtk::surface(bytes).unwrap_or_else(|| Err(Fault::at(0, quote(&bytes[..bytes.len().min(24)]), EXPECTED)))
            }
        }?;
        // Checked once for all formats: one point that is not finite would spoil every sum.
        let is_far = |point: &[f64; 3]| !point.iter().all(|x| x.abs() <= FARTHEST_MM);
        let mut corners = surface.triangles.as_flattened().iter();
        match surface.points.iter().position(is_far) {
            Some(far) => {
                let found = format!("point {far} at {:?}", surface.points[far]);
                Err(Fault::of_file(
                    found,
                    format!("finite coordinates up to {FARTHEST_MM:e}"),
                ))
            }
            None if surface.points.is_empty() => Err(Fault::of_file("no point", "a surface")),
            None => match corners.find(|corner| **corner as usize >= surface.points.len()) {
                Some(corner) => {
                    let found = format!("a triangle with the point {corner}");
                    Err(Fault::of_file(
                        found,
                        format!("points from 0 to {}", surface.points.len() - 1),
                    ))
                }
                None => Ok(surface.without_inner_points()),
            },
        }
    }

    /// Objects with triangles, by name, if there are several: triangles of one name belong together.
    pub fn parts(&self) -> Vec<(&str, Self)> {
        let mut parts: Vec<(&str, Self)> = Vec::new();
        let ends = self.objects.iter().skip(1).map(|(_, first)| *first);
        let ends = ends.chain([self.triangles.len()]);
        for ((name, first), end) in self.objects.iter().zip(ends) {
            let triangles = &self.triangles[*first..end];
            match parts.iter_mut().find(|(known, _)| known == name) {
                _ if triangles.is_empty() => {}
                Some((_, part)) => part.triangles.extend(triangles),
                None => parts.push((
                    name,
                    Self {
                        triangles: triangles.to_vec(),
                        is_ras: self.is_ras,
                        ..Self::default()
                    },
                )),
            }
        }
        let count: usize = parts.iter().map(|(_, part)| part.triangles.len()).sum();
        if parts.len() < 2 || count < self.triangles.len() {
            return Vec::new();
        }
        for (_, part) in &mut parts {
            let kept = renumber(part.triangles.as_flattened_mut(), self.points.len());
            part.points = kept.iter().map(|point| self.points[*point]).collect();
        }
        parts
    }

    /// Longest side of the box around the points.
    pub fn longest_side(&self) -> f64 {
        let side = |axis: usize| {
            let all = self.points.iter().map(|point| point[axis]);
            let [low, high] = all.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], x| {
                [low.min(x), high.max(x)]
            });
            high - low
        };
        [0, 1, 2].map(side).into_iter().fold(0.0, f64::max)
    }

    /// The surface without the points that lie within its tetrahedra.
    fn without_inner_points(mut self) -> Self {
        if self.is_outside {
            let kept = renumber(self.triangles.as_flattened_mut(), self.points.len());
            self.points = kept.iter().map(|point| self.points[*point]).collect();
        }
        self
    }

    /// Adds a polygon as triangles about its first corner.
    pub(super) fn push_polygon(&mut self, corners: &[u32]) {
        for pair in corners.get(1..).unwrap_or_default().windows(2) {
            self.triangles.push([corners[0], pair[0], pair[1]]);
        }
    }
}

const EXPECTED: &str = "a surface: STL, PLY, OBJ or VTK (.vtk, .vtp, .vtu)";

/// Axes that a title states in the words of 3D Slicer: `SPACE=RAS` or `SPACE=LPS`.
pub(super) fn stated_axes(title: &[u8]) -> Option<bool> {
    let title = String::from_utf8_lossy(title).to_ascii_uppercase();
    let (_, stated) = title.split_once("SPACE=")?;
    match stated.get(..3) {
        Some("RAS") => Some(true),
        Some("LPS") => Some(false),
        _ => None,
    }
}

/// Points that occur once, numbered in the order in which they come.
#[derive(Default)]
struct Points {
    positions: Vec<[f64; 3]>,
    numbers: HashMap<[u64; 3], u32>,
}

impl Points {
    fn number(&mut self, position: [f64; 3]) -> u32 {
        // A negative zero is zero.
        let position = position.map(|x| x + 0.0);
        let next = self.positions.len() as u32;
        let number = *self.numbers.entry(position.map(f64::to_bits)).or_insert(next);
        if number == next {
            self.positions.push(position);
        }
        number
    }
}

/// Bytes of the title of a binary STL file, of its count, and of a triangle.
const TITLE: usize = 80;
const HEAD: usize = TITLE + 4;
const TRIANGLE: usize = 50;

/// Reads STL: binary where the length of the file fits its count, whatever it begins with, else text.
fn stl(bytes: &[u8]) -> Result<SurfaceFile, Fault> {
    let count = bytes.get(TITLE..HEAD).and_then(|count| count.first_chunk()).copied();
    let count = count.map_or(0, u32::from_le_bytes) as usize;
    let length = count.saturating_mul(TRIANGLE).saturating_add(HEAD);
    let is_text = bytes.trim_ascii_start().starts_with(b"solid");
    if length != bytes.len() && is_text {
        return ascii_stl(bytes);
    }
    if bytes.len() < length || bytes.len() < HEAD {
        let found = format!("{} bytes with a count of {count} triangles", bytes.len());
        return Err(Fault::at(
            TITLE.min(bytes.len()),
            found,
            "84 bytes and 50 for each triangle of a binary STL file",
        ));
    }
    let mut points = Points::default();
    let mut triangles = read::room(count, "a surface")?;
    for triangle in bytes[HEAD..length].chunks_exact(TRIANGLE) {
        // The normal comes first.
        let numbers: Vec<f64> = triangle[12..48]
            .as_chunks()
            .0
            .iter()
            .map(|word| f64::from(f32::from_le_bytes(*word)))
            .collect();
        let corner = |n: usize| [numbers[3 * n], numbers[3 * n + 1], numbers[3 * n + 2]];
        triangles.push([0, 1, 2].map(|n| points.number(corner(n))));
    }
    Ok(SurfaceFile {
        points: points.positions,
        triangles,
        is_ras: stated_axes(&bytes[..TITLE]),
        ..SurfaceFile::default()
    })
}

fn ascii_stl(bytes: &[u8]) -> Result<SurfaceFile, Fault> {
    let mut cursor = Cursor::new(bytes);
    let (mut points, mut triangles, mut corners) = (Points::default(), Vec::new(), Vec::new());
    let mut is_ras = None;
    loop {
        let (start, word) = cursor.word();
        match word.to_ascii_lowercase().as_slice() {
            b"" if corners.is_empty() => break,
            b"" => return Err(Fault::at(start, "the end of the file", "`endfacet`")),
            // A name of any words follows.
            b"solid" | b"endsolid" => is_ras = is_ras.or(stated_axes(cursor.line())),
            b"vertex" => {
                let mut position = [0.0; 3];
                for x in &mut position {
                    *x = cursor.number(|| "a coordinate".to_owned())?;
                }
                corners.push(points.number(position));
            }
            b"endfacet" => match corners[..] {
                [a, b, c] => {
                    triangles.push([a, b, c]);
                    corners.clear();
                }
                _ => {
                    return Err(Fault::at(
                        start,
                        format!("a facet of {} vertices", corners.len()),
                        "three",
                    ));
                }
            },
            b"facet" => {
                cursor.line();
            }
            b"outer" | b"loop" | b"endloop" => {}
            _ => {
                return Err(Fault::at(
                    start,
                    quote(word),
                    "a word of STL such as `facet` or `vertex`",
                ));
            }
        }
    }
    Ok(SurfaceFile {
        points: points.positions,
        triangles,
        is_ras,
        ..SurfaceFile::default()
    })
}

fn obj(bytes: &[u8]) -> Result<SurfaceFile, Fault> {
    let mut cursor = Cursor::new(bytes);
    let mut surface = SurfaceFile::default();
    let mut has_objects = false;
    while !cursor.rest().is_empty() {
        let (start, word) = cursor.word();
        match word {
            b"v" => {
                let mut position = [0.0; 3];
                for x in &mut position {
                    *x = cursor.number(|| "a coordinate".to_owned())?;
                }
                surface.points.push(position);
                cursor.line();
            }
            b"f" => {
                let line_start = cursor.at;
                let line = String::from_utf8_lossy(cursor.line());
                let corner = |word: &str| {
                    let number: Option<i64> = word.split('/').next().and_then(|number| number.parse().ok());
                    // Numbers start at 1; negative ones count from the last vertex so far.
                    let number = number.and_then(|number| match number {
                        1.. => usize::try_from(number - 1).ok(),
                        _ => surface
                            .points
                            .len()
                            .checked_sub(usize::try_from(number.unsigned_abs()).ok()?),
                    });
                    let number = number.filter(|number| *number < surface.points.len());
                    let expected = format!("the number of one of the {} vertices before it", surface.points.len());
                    number
                        .map(|number| number as u32)
                        .ok_or_else(|| Fault::at(line_start, quote(word.as_bytes()), expected))
                };
                let corners: Vec<u32> = line.split_whitespace().map(corner).collect::<Result<_, _>>()?;
                if corners.len() < 3 {
                    return Err(Fault::at(
                        start,
                        format!("a face of {} vertices", corners.len()),
                        "three or more",
                    ));
                }
                surface.push_polygon(&corners);
            }
            b"o" | b"g" => {
                let is_object = word == b"o";
                let name = String::from_utf8_lossy(cursor.line()).trim().to_owned();
                if is_object && !has_objects {
                    surface.objects.clear();
                    has_objects = true;
                }
                if is_object == has_objects && !name.is_empty() {
                    surface.objects.push((name, surface.triangles.len()));
                }
            }
            _ => {
                // The word may be the whole line, whose end is then next.
                let rest = cursor.line();
                surface.is_ras = surface.is_ras.or(stated_axes(rest)).or(stated_axes(word));
            }
        }
    }
    Ok(surface)
}

/// Refuses a header with a line that none has: messages of the parser are meant for programmers.
fn check_ply_header(bytes: &[u8]) -> Result<(), Fault> {
    const WORDS: [&[u8]; 6] = [b"ply", b"format", b"comment", b"obj_info", b"element", b"property"];
    let mut cursor = Cursor::new(bytes);
    loop {
        let (start, word) = cursor.word();
        let expected = "a line of a PLY header in UTF-8, such as `element vertex 8`, up to `end_header`";
        if word == b"end_header" {
            return Ok(());
        } else if !WORDS.contains(&word) {
            return Err(Fault::at(start, quote(word), expected));
        } else if std::str::from_utf8(cursor.line()).is_err() {
            return Err(Fault::at(start, "bytes that are no text", expected));
        }
    }
}

fn ply(bytes: &[u8]) -> Result<SurfaceFile, Fault> {
    check_ply_header(bytes)?;
    let wrong = |found: String| Fault::of_file(found, "a PLY surface");
    // An element may have no properties, and then takes memory without a byte of the file.
    let header = bytes
        .split(|byte| *byte == b'\n')
        .take_while(|line| !line.starts_with(b"end_header"));
    let promised = header.filter_map(|line| {
        let line = std::str::from_utf8(line).ok()?.trim().strip_prefix("element")?;
        line.split_whitespace().nth(1)?.parse::<usize>().ok()
    });
    let promised = promised.fold(0, usize::saturating_add);
    if promised > bytes.len() {
        return Err(wrong(format!("{promised} elements in {} bytes", bytes.len())));
    }
    let ply = border::decoded(|| Parser::<DefaultElement>::new().read_ply(&mut &bytes[..])).map_err(wrong)?;
    let elements = |name: &str| ply.payload.get(name).map(Vec::as_slice).unwrap_or_default();
    let points: Option<Vec<[f64; 3]>> = elements("vertex").iter().map(vertex).collect();
    let mut surface = SurfaceFile {
        points: points.ok_or_else(|| wrong("vertices without numbers x, y and z".to_owned()))?,
        is_ras: ply
            .header
            .comments
            .iter()
            .find_map(|comment| stated_axes(comment.as_bytes())),
        ..SurfaceFile::default()
    };
    for face in elements("face") {
        let list = ["vertex_indices", "vertex_index"].iter().find_map(|key| face.get(*key));
        let corners = list.and_then(corners);
        surface.push_polygon(&corners.ok_or_else(|| wrong("faces without `vertex_indices`".to_owned()))?);
    }
    Ok(surface)
}

fn vertex(element: &DefaultElement) -> Option<[f64; 3]> {
    let number = |key: &str| match element.get(key)? {
        Property::Float(x) => Some(f64::from(*x)),
        Property::Double(x) => Some(*x),
        Property::Int(x) => Some(f64::from(*x)),
        Property::Short(x) => Some(f64::from(*x)),
        _ => None,
    };
    Some([number("x")?, number("y")?, number("z")?])
}

fn corners(list: &Property) -> Option<Vec<u32>> {
    match list {
        Property::ListUChar(all) => Some(all.iter().map(|n| u32::from(*n)).collect()),
        Property::ListUShort(all) => Some(all.iter().map(|n| u32::from(*n)).collect()),
        Property::ListUInt(all) => Some(all.clone()),
        Property::ListChar(all) => all.iter().map(|n| u32::try_from(*n).ok()).collect(),
        Property::ListShort(all) => all.iter().map(|n| u32::try_from(*n).ok()).collect(),
        Property::ListInt(all) => all.iter().map(|n| u32::try_from(*n).ok()).collect(),
        _ => None,
    }
}

#[cfg(test)]
mod tests;
