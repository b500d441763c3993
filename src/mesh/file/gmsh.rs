//! Reader of Gmsh files (`.msh`), versions 2.2 and 4.1, ASCII and binary of either byte order.
//!
//! Formats as in the "MSH file format" chapters of the Gmsh reference manual (C. Geuzaine, J.-F. Remacle). Nodes are
//! numbered in the order of their tags, elements in file order. Vertices, lines and surfaces are counted and ignored;
//! sections other than `$PhysicalNames`, `$Entities`, `$PartitionedEntities`, `$Nodes` and `$Elements` are skipped.
//! Written here because the crate `mshio` reads neither version 2.2 nor the names of physical groups.
//!
//! The region of an element is the first physical group of its volume, whose name is kept, or the volume's own number
//! where it is in none.

mod elements;
mod names;
mod reader;
mod v2;
mod v4;

use super::error::{Fault, quote};
use super::{Cursor, Format, Parts, ReadOptions};
use elements::{Elements, Regions};
use reader::Reader;

/// Contents read so far.
#[derive(Default)]
struct Contents {
    names: Option<names::Names>,
    volumes: v4::Volumes,
    nodes: Option<Nodes>,
    elements: Option<Elements>,
}

#[derive(Clone, Copy, PartialEq)]
enum Version {
    V2,
    V4,
}

/// The format.
pub(super) const FORMAT: Format = Format {
    name: "Gmsh (.msh)",
    start: "`$MeshFormat` (Gmsh)",
    read,
    written: &[],
};

/// Returns the tetrahedra of a Gmsh file, or `None` where the contents are not a Gmsh file.
fn read(bytes: &[u8], options: &ReadOptions) -> Option<Result<Parts, Fault>> {
    let is_section = bytes.trim_ascii_start().first() == Some(&b'$');
    is_section.then(|| {
        let regions = Regions::chosen(options)?;
        let contents = sections(bytes, regions)?;
        parts(contents)
    })
}

fn sections(bytes: &[u8], regions: Regions) -> Result<Contents, Fault> {
    let mut reader = Reader::new(bytes);
    let mut contents = Contents::default();
    let mut version = None;
    loop {
        let (start, word) = reader.cursor.word();
        let Some(name) = word.strip_prefix(b"$") else {
            return match word {
                b"" => Ok(contents),
                _ => Err(Fault::at(start, quote(word), "a section such as $Nodes")),
            };
        };
        let counts = match (name, version) {
            (b"MeshFormat", None) => {
                version = Some(header(&mut reader)?);
                true
            }
            (b"NOD" | b"ELM", None) => return Err(Fault::at(start, "version 1 of the format", VERSIONS)),
            (b"ParametricNodes", _) => {
                return Err(Fault::at(
                    start,
                    "nodes with parameters",
                    "$Nodes, as Gmsh writes with `Mesh.SaveParametric = 0`",
                ));
            }
            // Their layout depends on the version and on the type of the file, which only $MeshFormat tells.
            (b"PhysicalNames" | b"Entities" | b"Nodes" | b"Elements", None) => {
                return Err(Fault::at(start, quote(word), "$MeshFormat before it"));
            }
            (_, None) => false,
            (_, Some(version)) => section(name, start, version, &mut reader, &mut contents, regions)?,
        };
        if !counts {
            skip(&mut reader.cursor, start, word)?;
            continue;
        }
        let (start, word) = reader.cursor.word();
        if word.strip_prefix(b"$End") != Some(name) {
            return Err(Fault::at(
                start,
                quote(word),
                format!("$End{}", String::from_utf8_lossy(name)),
            ));
        }
    }
}

/// Reads a section after its name, which starts at `start`; returns false if it is to be skipped.
fn section(
    name: &[u8],
    start: usize,
    version: Version,
    reader: &mut Reader,
    contents: &mut Contents,
    regions: Regions,
) -> Result<bool, Fault> {
    let once = |repeated: bool| {
        if repeated {
            Err(Fault::at(
                start,
                format!("${}", String::from_utf8_lossy(name)),
                "one of each section, with $Elements as the last of them",
            ))
        } else {
            Ok(())
        }
    };
    match (name, version) {
        (b"PhysicalNames", _) => {
            once(contents.names.is_some())?;
            contents.names = Some(names::read(reader)?);
        }
        (b"Entities" | b"PartitionedEntities", Version::V4) => {
            // Elements look up the volumes of their entities: entities behind them would come too late.
            once(contents.elements.is_some())?;
            match name {
                b"Entities" => v4::entities(reader, &mut contents.volumes)?,
                _ => v4::partitioned(reader, &mut contents.volumes)?,
            }
        }
        (b"Nodes", _) => {
            once(contents.nodes.is_some())?;
            contents.nodes = Some(match version {
                Version::V2 => v2::nodes(reader, start)?,
                Version::V4 => v4::nodes(reader, start)?,
            });
        }
        (b"Elements", _) => {
            once(contents.elements.is_some())?;
            let nodes = contents.nodes.as_ref();
            let nodes = nodes.ok_or_else(|| Fault::at(start, "$Elements", "$Nodes before it"))?;
            contents.elements = Some(match version {
                Version::V2 => v2::elements(reader, nodes, regions)?,
                Version::V4 => v4::elements(reader, nodes, &contents.volumes, regions)?,
            });
        }
        _ => return Ok(false),
    }
    Ok(true)
}

const VERSIONS: &str = "version 2.2 or 4.1 (save again with `gmsh old.msh -save -format msh41 -o new.msh`)";

/// Reads version, file type and data size, and sets up the reader.
fn header(reader: &mut Reader) -> Result<Version, Fault> {
    let (start, word) = reader.cursor.word();
    let version = match word {
        b"2" | b"2.0" | b"2.1" | b"2.2" => Version::V2,
        b"4.1" => Version::V4,
        _ => return Err(Fault::at(start, quote(word), VERSIONS)),
    };
    let (start, word) = reader.cursor.word();
    let binary = match word {
        b"0" => false,
        b"1" => true,
        _ => return Err(Fault::at(start, quote(word), "0 (ASCII) or 1 (binary)")),
    };
    let (start, word) = reader.cursor.word();
    let wide = match (word, version) {
        // Version 2 states the size of its reals, version 4 that of its integers, which may be narrow.
        (b"8", _) => true,
        (b"4", Version::V4) => false,
        _ => return Err(Fault::at(start, quote(word), "a data size of 8 bytes")),
    };
    if binary {
        reader.cursor.line();
        let start = reader.cursor.at;
        let big_endian = match reader.cursor.take(4) {
            Some([1, 0, 0, 0]) => false,
            Some([0, 0, 0, 1]) => true,
            found => {
                return Err(Fault::at(
                    start,
                    quote(found.unwrap_or_default()),
                    "a binary 1 that tells the byte order",
                ));
            }
        };
        reader.set_binary(big_endian, wide);
    }
    Ok(version)
}

/// Skips a section of any contents.
fn skip(cursor: &mut Cursor, start: usize, word: &[u8]) -> Result<(), Fault> {
    let end = [b"$End", &word[1..]].concat();
    let rest = cursor.rest();
    let is_end = |length: &usize| {
        let after = rest[*length..].strip_prefix(end.as_slice());
        after.is_some_and(|after| after.first().is_none_or(u8::is_ascii_whitespace))
    };
    let length = (0..rest.len()).find(is_end);
    let length = length.ok_or_else(|| Fault::at(start, quote(word), "a section of the format, or one that ends"))?;
    cursor.at += length + end.len();
    Ok(())
}

fn parts(contents: Contents) -> Result<Parts, Fault> {
    let Contents {
        names, nodes, elements, ..
    } = contents;
    let (Some(nodes), Some(elements)) = (nodes, elements) else {
        return Err(Fault::of_file(
            "a Gmsh file without a mesh",
            "the sections $Nodes and $Elements",
        ));
    };
    let warnings = elements.warnings();
    Ok(Parts {
        nodes: nodes.positions,
        region_names: names.map_or_else(Default::default, |names| elements.names(names)),
        elements: elements.corners,
        regions: elements.regions,
        displacements: None,
        skipped_cells: elements.skipped,
        region_hint: None,
        is_ras: None,
        curved: elements.curved,
        warnings,
    })
}

/// Nodes in the order of their tags, which need not be consecutive.
struct Nodes {
    tags: Vec<u64>,
    pub positions: Vec<[f64; 3]>,
}

impl Nodes {
    /// Builds the list from tags and positions in any order, which start at `offset`.
    pub(crate) fn new(mut nodes: Vec<(u64, [f64; 3])>, offset: usize) -> Result<Nodes, Fault> {
        nodes.sort_by_key(|node| node.0);
        if let Some(pair) = nodes.windows(2).find(|pair| pair[0].0 == pair[1].0) {
            return Err(Fault::at(
                offset,
                format!("two nodes with the tag {}", pair[0].0),
                "a tag of its own for every node",
            ));
        }
        let (tags, positions) = nodes.into_iter().unzip();
        Ok(Nodes { tags, positions })
    }

    /// Returns the index of a node to which an element at `offset` refers.
    pub(crate) fn index(&self, tag: u64, offset: usize) -> Result<u32, Fault> {
        let first = self.tags.first().copied().unwrap_or_default();
        // Most files number their nodes without gaps.
        let guess = tag.checked_sub(first).and_then(|index| usize::try_from(index).ok());
        let index = guess
            .filter(|index| self.tags.get(*index) == Some(&tag))
            .or_else(|| self.tags.binary_search(&tag).ok());
        index.and_then(|index| u32::try_from(index).ok()).ok_or_else(|| {
            Fault::at(
                offset,
                format!("a tetrahedron with the node {tag}"),
                format!("the tags of {CORNERS} of the {} nodes", self.tags.len()),
            )
        })
    }
}

/// An element type.
struct Kind {
    code: i32,
    dimension: u8,
    /// Number of nodes of an element.
    pub nodes: usize,
    name: &'static str,
}

/// Number of corners of the linear tetrahedron.
const CORNERS: usize = 4;

const fn kind(code: i32, dimension: u8, nodes: usize, name: &'static str) -> Kind {
    Kind {
        code,
        dimension,
        nodes,
        name,
    }
}

const KINDS: [Kind; 33] = [
    kind(1, 1, 2, "line"),
    kind(2, 2, 3, "triangle"),
    kind(3, 2, 4, "quadrangle"),
    kind(4, 3, CORNERS, "tetrahedron"),
    kind(5, 3, 8, "hexahedron"),
    kind(6, 3, 6, "prism"),
    kind(7, 3, 5, "pyramid"),
    kind(8, 1, 3, "second-order line"),
    kind(9, 2, 6, "second-order triangle"),
    kind(10, 2, 9, "second-order quadrangle"),
    kind(11, 3, 10, "second-order tetrahedron"),
    kind(12, 3, 27, "second-order hexahedron"),
    kind(13, 3, 18, "second-order prism"),
    kind(14, 3, 14, "second-order pyramid"),
    kind(15, 0, 1, "vertex"),
    kind(16, 2, 8, "second-order quadrangle"),
    kind(17, 3, 20, "second-order hexahedron"),
    kind(18, 3, 15, "second-order prism"),
    kind(19, 3, 13, "second-order pyramid"),
    kind(20, 2, 9, "third-order triangle"),
    kind(21, 2, 10, "third-order triangle"),
    kind(22, 2, 12, "fourth-order triangle"),
    kind(23, 2, 15, "fourth-order triangle"),
    kind(24, 2, 15, "fifth-order triangle"),
    kind(25, 2, 21, "fifth-order triangle"),
    kind(26, 1, 4, "third-order line"),
    kind(27, 1, 5, "fourth-order line"),
    kind(28, 1, 6, "fifth-order line"),
    kind(29, 3, 20, "third-order tetrahedron"),
    kind(30, 3, 35, "fourth-order tetrahedron"),
    kind(31, 3, 56, "fifth-order tetrahedron"),
    kind(92, 3, 64, "third-order hexahedron"),
    kind(93, 3, 125, "fourth-order hexahedron"),
];

impl Kind {
    /// Returns the type of a number at `offset`, if meshes can contain it: a tetrahedron, or something flat to ignore.
    pub(crate) fn usable(code: i32, offset: usize) -> Result<&'static Kind, Fault> {
        const EXPECTED: &str = "tetrahedra as the only elements with a volume (of Gmsh without `Recombine`; ParaView's filter \
                                Tetrahedralize cuts others)";
        match KINDS.iter().find(|kind| kind.code == code) {
            None => Err(Fault::at(offset, format!("element type {code}"), EXPECTED)),
            Some(kind) if kind.dimension == 3 && !kind.is_tetrahedron() => Err(Fault::at(
                offset,
                format!("a {} (element type {code})", kind.name),
                EXPECTED,
            )),
            Some(kind) => Ok(kind),
        }
    }

    /// Whether it is a tetrahedron, whose corners are the first of its nodes.
    pub(crate) fn is_tetrahedron(&self) -> bool {
        matches!(self.code, 4 | 11 | 29 | 30 | 31)
    }

    /// Number of nodes beside the corners of a tetrahedron.
    pub(crate) fn further_nodes(&self) -> usize {
        self.nodes - CORNERS
    }
}

#[cfg(test)]
mod tests;
