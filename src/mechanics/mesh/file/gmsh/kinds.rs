//! Element types of the Gmsh format.

use super::Fault;

/// An element type.
pub(super) struct Kind {
    code: i32,
    dimension: u8,
    /// Number of nodes of an element.
    pub nodes: usize,
    name: &'static str,
}

/// Number of corners of the linear tetrahedron.
pub(super) const CORNERS: usize = 4;

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
    /// Returns the type of a number at `at`, if meshes can contain it: a linear tetrahedron, or something flat to ignore.
    pub fn usable(code: i32, at: usize) -> Result<&'static Kind, Fault> {
        const EXPECTED: &str = "linear tetrahedra (type 4) as the only elements with a volume";
        match KINDS.iter().find(|kind| kind.code == code) {
            None => Err(Fault::at(at, format!("element type {code}"), EXPECTED)),
            Some(kind) if kind.dimension == 3 && !kind.is_tetrahedron() => Err(Fault::at(
                at,
                format!("a {} (element type {code})", kind.name),
                EXPECTED,
            )),
            Some(kind) => Ok(kind),
        }
    }

    pub fn is_tetrahedron(&self) -> bool {
        self.code == 4
    }
}
