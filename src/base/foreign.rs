//! Files of other programs, told by how they start: named in messages in place of their bytes.

/// What a file holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Holds {
    /// Voxels.
    Volume,
    /// Elements with a volume.
    Mesh,
    /// A surface.
    Surface,
    /// Something else.
    Other,
}

/// A kind of file.
#[derive(Clone, Copy, Debug)]
pub struct Foreign {
    /// Name, with its article.
    pub name: &'static str,
    /// What it holds.
    pub holds: Holds,
    is_start: fn(&[u8]) -> bool,
}

/// Bytes that [`Foreign::of`] looks at.
const START: usize = 4096;

const fn kind(name: &'static str, holds: Holds, is_start: fn(&[u8]) -> bool) -> Foreign {
    Foreign { name, holds, is_start }
}

/// All kinds; the first that recognises a file counts.
const KINDS: &[Foreign] = &[
    kind("an HDF5 file", Holds::Mesh, |start| {
        start.starts_with(b"\x89HDF\r\n\x1a\n")
    }),
    kind("a NetCDF or Exodus file", Holds::Mesh, |start| {
        start.starts_with(b"CDF\x01") || start.starts_with(b"CDF\x02")
    }),
    kind("an XDMF file", Holds::Mesh, |start| has(start, b"<Xdmf")),
    kind("a FEBio file", Holds::Mesh, |start| has(start, b"<febio_spec")),
    kind("an LS-DYNA file", Holds::Mesh, |start| {
        start.starts_with(b"*KEYWORD") || has(start, b"\n*KEYWORD")
    }),
    kind("an Abaqus file", Holds::Mesh, |start| {
        start.starts_with(b"*")
            && start
                .get(1)
                .is_some_and(|next| next.is_ascii_alphabetic() || *next == b'*')
    }),
    kind("a Medit file", Holds::Mesh, |start| {
        start.trim_ascii_start().starts_with(b"MeshVersionFormatted")
    }),
    kind("a TetGen file", Holds::Mesh, is_tetgen),
    kind("a PLY surface", Holds::Surface, |start| {
        start.starts_with(b"ply\n") || start.starts_with(b"ply\r")
    }),
    kind("an OBJ surface", Holds::Surface, is_obj),
    kind("an STL surface", Holds::Surface, is_stl),
    kind("NIfTI labels", Holds::Volume, |start| {
        start.get(344..347) == Some(b"n+1") || start.starts_with(b"\x5c\x01\0\0")
    }),
    kind("NRRD labels", Holds::Volume, |start| start.starts_with(b"NRRD000")),
    kind("MetaImage labels", Holds::Volume, |start| {
        start.starts_with(b"ObjectType") || start.starts_with(b"NDims")
    }),
    kind("a DICOM file", Holds::Volume, |start| {
        start.get(128..132) == Some(b"DICM")
    }),
    kind("a compressed file (gzip)", Holds::Volume, |start| {
        start.starts_with(b"\x1f\x8b")
    }),
    kind("a ZIP archive", Holds::Other, |start| start.starts_with(b"PK\x03\x04")),
    kind("a NumPy array", Holds::Other, |start| start.starts_with(b"\x93NUMPY")),
    kind("a MATLAB file", Holds::Other, |start| start.starts_with(b"MATLAB 5.0")),
    kind("a picture (PNG)", Holds::Other, |start| start.starts_with(b"\x89PNG")),
];

impl Foreign {
    /// Kind of a file by its first bytes, 4096 of them or all.
    pub fn of(start: &[u8]) -> Option<&'static Foreign> {
        let start = &start[..start.len().min(START)];
        KINDS.iter().find(|kind| (kind.is_start)(start))
    }
}

fn has(start: &[u8], words: &[u8]) -> bool {
    start.windows(words.len()).any(|window| window == words)
}

/// Lines of a text that are neither empty nor comments; none where the file is no text.
fn lines(start: &[u8]) -> impl Iterator<Item = &str> {
    let text = std::str::from_utf8(start).unwrap_or_else(|error| {
        // A character may be cut at the end.
        let whole = if error.error_len().is_none() {
            error.valid_up_to()
        } else {
            0
        };
        std::str::from_utf8(&start[..whole]).unwrap_or_default()
    });
    text.lines()
        .map(str::trim)
        .filter(|line| !line.is_empty() && !line.starts_with('#'))
}

/// Two to four counts in the first line, numbers in the second.
fn is_tetgen(start: &[u8]) -> bool {
    let mut lines = lines(start);
    let counts = lines
        .next()
        .unwrap_or_default()
        .split_whitespace()
        .map(str::parse::<u32>);
    let counts: Vec<bool> = counts.map(|count| count.is_ok()).collect();
    let row = lines
        .next()
        .unwrap_or_default()
        .split_whitespace()
        .map(str::parse::<f64>);
    let row: Vec<bool> = row.map(|number| number.is_ok()).collect();
    (2..=4).contains(&counts.len()) && row.len() >= 4 && counts.iter().chain(&row).all(|is_number| *is_number)
}

/// A vertex after comments and names of groups and materials.
fn is_obj(start: &[u8]) -> bool {
    let word = |line: &str| line.split_whitespace().next().unwrap_or_default().to_owned();
    let named = ["mtllib", "o", "g", "usemtl", "s", "vn", "vt"];
    lines(start)
        .map(word)
        .find(|word| !named.contains(&word.as_str()))
        .is_some_and(|word| word == "v")
}

/// `solid` with a facet, or 80 bytes of title and a count of triangles in the bytes of such a file.
fn is_stl(start: &[u8]) -> bool {
    if start.trim_ascii_start().starts_with(b"solid") && has(start, b"facet") {
        return true;
    }
    // The count and the attributes of the first triangle have few values: zeros follow fixed distances.
    let count = start
        .get(80..84)
        .map(|bytes| u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]));
    let coordinates = start.get(84..132).unwrap_or_default().as_chunks::<4>().0;
    let plausible = |word: &[u8; 4]| {
        let x = f32::from_le_bytes(*word).abs();
        x == 0.0 || (1e-30..=1e7).contains(&x)
    };
    count.is_some_and(|count| (1..100_000_000).contains(&count))
        && coordinates.len() == 12
        && coordinates.iter().all(plausible)
        && coordinates.iter().any(|word| f32::from_le_bytes(*word) != 0.0)
        && start.get(132..134) == Some(&[0, 0])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_are_told_apart() {
        let mut stl = vec![b'x'; 80];
        stl.extend(2u32.to_le_bytes());
        stl.extend(
            [0.0f32, 0.0, 1.0, 5.0, -3.0, 2.0, 8.0, 1.0, 0.5, 3.0, 2.0, 1.0]
                .iter()
                .flat_map(|x| x.to_le_bytes()),
        );
        stl.extend([0, 0, 7, 7]);
        for (start, name) in [
            (&b"\x89HDF\r\n\x1a\nrest"[..], "an HDF5 file"),
            (b"<?xml version=\"1.0\"?>\n<Xdmf Version=\"3.0\">", "an XDMF file"),
            (b"*HEADING\nAbaqus", "an Abaqus file"),
            (b"** by hand\n*NODE", "an Abaqus file"),
            (b"$ title\n*KEYWORD\n", "an LS-DYNA file"),
            (b"MeshVersionFormatted 2\n", "a Medit file"),
            (b"# by meshio\n480 4 0\n0 90 76 58 151\n", "a TetGen file"),
            (b"159 3 0 0\n1 0.0 0.5 1e-3\n", "a TetGen file"),
            (b"ply\nformat ascii 1.0\n", "a PLY surface"),
            (b"# made by hand\nmtllib a.mtl\no liver\nv 1 2 3\n", "an OBJ surface"),
            (b" solid skin\n facet normal 0 0 1\n", "an STL surface"),
            (&stl, "an STL surface"),
            (b"NRRD0004\n", "NRRD labels"),
            (b"\x1f\x8b\x08", "a compressed file (gzip)"),
        ] {
            assert_eq!(Foreign::of(start).map(|kind| kind.name), Some(name));
        }
        for start in [
            &b"$MeshFormat\n"[..],
            b"# vtk DataFile Version 4.2\n",
            b"<VTKFile type=",
            b"solid x",
            b"",
            b"1 2\nv",
            b"x_mm,y_mm,z_mm\n1,2,3",
            &[0; 200],
        ] {
            assert_eq!(Foreign::of(start).map(|kind| kind.name), None, "{start:?}");
        }
    }
}
