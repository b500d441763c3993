//! Gmsh files of a small model, in every version and encoding.

/// Positions by tag: not in order, with gaps.
pub(super) const NODES: [(u64, [f64; 3]); 6] = [
    (10, [0.0, 1.0, 0.0]),
    (3, [0.0, 0.0, 0.0]),
    (7, [1.0, 0.0, 0.0]),
    (400_000, [1.0 / 3.0, 1.0, 1.0]),
    (21, [0.1, 0.0, 1.0]),
    (2_000_000_000, [-2.0, 0.0, 1e-7]),
];
/// Volume and corner tags of each tetrahedron.
const TETRAHEDRA: [(i32, [u64; 4]); 3] = [
    (1, [3, 7, 10, 21]),
    (1, [7, 10, 21, 400_000]),
    (2, [3, 10, 21, 2_000_000_000]),
];
/// Type and node tags of each flat element.
const FLAT: [(i32, &[u64]); 3] = [(15, &[3]), (1, &[3, 7]), (2, &[3, 7, 10])];

/// Variants of the model.
pub(super) struct Model {
    /// Physical groups of volume 1. Volume 2 is in none.
    pub groups: Vec<i32>,
    /// Whether nodes carry parameters (4.1).
    pub parametric: bool,
    /// Whether elements are in parts of the volumes (4.1).
    pub partitioned: bool,
    /// Whether tetrahedra are of second order.
    pub curved: bool,
}

impl Model {
    fn nodes(&self) -> &'static [(u64, [f64; 3])] {
        if self.curved { &ALL_NODES } else { &NODES }
    }

    /// Type of a tetrahedron, and its nodes beside the corners.
    fn tetrahedron(&self) -> (i32, &'static [u64]) {
        if self.curved {
            (11, &[5, 5, 30, 5, 30, 30])
        } else {
            (4, &[])
        }
    }
}

/// The nodes, and two beside the corners.
const ALL_NODES: [(u64, [f64; 3]); 8] = [
    NODES[0],
    (5, [0.5, 0.5, 0.5]),
    NODES[1],
    NODES[2],
    NODES[3],
    (30, [0.25, 0.5, 0.5]),
    NODES[4],
    NODES[5],
];

impl Default for Model {
    fn default() -> Model {
        Model {
            groups: vec![7],
            parametric: false,
            partitioned: false,
            curved: false,
        }
    }
}

/// Version and encoding of a file.
#[derive(Clone, Copy, Debug)]
pub(super) struct Encoding {
    pub version: u8,
    /// Whether big-endian; none in text.
    pub binary: Option<bool>,
    pub wide: bool,
}

pub(super) const fn ascii(version: u8) -> Encoding {
    Encoding {
        version,
        binary: None,
        wide: true,
    }
}

const fn binary(version: u8, big_endian: bool) -> Encoding {
    Encoding {
        version,
        binary: Some(big_endian),
        wide: true,
    }
}

pub(super) const ALL: [Encoding; 6] = [
    ascii(2),
    binary(2, false),
    binary(2, true),
    ascii(4),
    binary(4, false),
    binary(4, true),
];

struct Out {
    encoding: Encoding,
    bytes: Vec<u8>,
}

impl Out {
    fn text(&mut self, text: &str) {
        self.bytes.extend(text.bytes());
    }

    fn put<const N: usize>(&mut self, text: String, little: [u8; N]) {
        match self.encoding.binary {
            None => self.text(&(text + " ")),
            Some(big_endian) => {
                let mut bytes = little;
                if big_endian {
                    bytes.reverse();
                }
                self.bytes.extend(bytes);
            }
        }
    }

    fn ints(&mut self, values: &[i32]) {
        values.iter().for_each(|n| self.put(n.to_string(), n.to_le_bytes()));
    }

    fn sizes(&mut self, values: &[u64]) {
        for n in values {
            if self.encoding.wide {
                self.put(n.to_string(), n.to_le_bytes())
            } else {
                self.put(n.to_string(), (*n as u32).to_le_bytes())
            }
        }
    }

    fn floats(&mut self, values: &[f64]) {
        values.iter().for_each(|x| self.put(format!("{x:?}"), x.to_le_bytes()));
    }

    fn tags(&mut self, tags: &[u64]) {
        tags.iter().for_each(|tag| self.ints(&[*tag as i32]));
    }

    /// Ends a line of text.
    fn end(&mut self) {
        if self.encoding.binary.is_none() {
            self.text("\n");
        }
    }
}

impl Encoding {
    pub(super) fn write(self, model: &Model) -> Vec<u8> {
        let mut out = Out {
            encoding: self,
            bytes: Vec::new(),
        };
        let version = if self.version == 2 { "2.2" } else { "4.1" };
        let (binary, size) = (u8::from(self.binary.is_some()), if self.wide { 8 } else { 4 });
        out.text(&format!("$MeshFormat\n{version} {binary} {size}\n"));
        if self.binary.is_some() {
            out.ints(&[1]);
            out.text("\n");
        }
        out.text("$EndMeshFormat\n$Comments\nany $Nodes of \u{fc}\n$EndComments\n");
        out.text("$PhysicalNames\n3\n2 7 \"skin\"\n3 7 \"left \"half\" & more\"\n3 11 \"unused\"\n$EndPhysicalNames\n");
        match self.version {
            2 => self.version2(&mut out, model),
            _ => self.version4(&mut out, model),
        }
        out.text("$NodeData\n1\n\"x\"\n$EndNodeData\n");
        out.bytes
    }

    fn version2(self, out: &mut Out, model: &Model) {
        out.text(&format!("$Nodes\n{}\n", model.nodes().len()));
        for (tag, position) in model.nodes() {
            out.tags(&[*tag]);
            out.floats(position);
            out.end();
        }
        // An element is written once for every group that contains it.
        let elements = TETRAHEDRA.iter().flat_map(|(volume, corners)| {
            let groups = if *volume == 1 { model.groups.clone() } else { vec![0] };
            groups.into_iter().map(move |group| (group, *volume, corners))
        });
        let elements: Vec<_> = elements.collect();
        out.text(&format!("\n$EndNodes\n$Elements\n{}\n", FLAT.len() + elements.len()));
        let (kind, further) = model.tetrahedron();
        let mut tag = 0;
        for (kind, nodes) in FLAT {
            tag += 1;
            match self.binary {
                None => out.ints(&[tag, kind, 2, 7, 5]),
                Some(_) => out.ints(&[kind, 1, 2, tag, 7, 5]),
            }
            out.tags(nodes);
            out.end();
        }
        if self.binary.is_some() {
            out.ints(&[kind, elements.len() as i32, 3]);
        }
        for (group, volume, corners) in elements {
            tag += 1;
            match self.binary {
                None => out.ints(&[tag, kind, 3, group, volume, 99]),
                Some(_) => out.ints(&[tag, group, volume, 99]),
            }
            out.tags(corners);
            out.tags(further);
            out.end();
        }
        out.text("\n$EndElements\n");
    }

    fn version4(self, out: &mut Out, model: &Model) {
        out.text("$Entities\n");
        out.sizes(&[1, 1, 0, 2]);
        out.end();
        self.entity(out, 0, 1, &[3], |_| ());
        self.entity(out, 1, 1, &[], |_| ());
        self.entity(out, 3, 1, &model.groups, |_| ());
        self.entity(out, 3, 2, &[], |_| ());
        out.text("\n$EndEntities\n");
        // Parts 11 and 12 of the volumes 1 and 2.
        let shift = if model.partitioned { 10 } else { 0 };
        if model.partitioned {
            out.text("$PartitionedEntities\n");
            out.sizes(&[2, 1]);
            out.ints(&[5, 1]);
            out.sizes(&[0, 1, 0, 2]);
            let part = |dimension, parent| {
                move |out: &mut Out| {
                    out.ints(&[dimension, parent]);
                    out.sizes(&[2]);
                    out.ints(&[1, 2]);
                }
            };
            self.entity(out, 1, 9, &[], part(2, 1));
            self.entity(out, 3, 11, &model.groups, part(3, 1));
            self.entity(out, 3, 12, &[], part(3, 2));
            out.text("\n$EndPartitionedEntities\n");
        }
        out.text("$Nodes\n");
        let nodes = model.nodes();
        out.sizes(&[2, nodes.len() as u64, 3, 2_000_000_000]);
        out.end();
        for (dimension, nodes) in [(0, &nodes[..1]), (3, &nodes[1..])] {
            out.ints(&[dimension, 1 + shift, i32::from(model.parametric)]);
            out.sizes(&[nodes.len() as u64]);
            out.end();
            for (tag, _) in nodes {
                out.sizes(&[*tag]);
                out.end();
            }
            for (_, position) in nodes {
                out.floats(position);
                out.floats(if model.parametric {
                    &[0.5; 3][..dimension as usize]
                } else {
                    &[]
                });
                out.end();
            }
        }
        out.text("\n$EndNodes\n$Elements\n");
        out.sizes(&[5, (FLAT.len() + TETRAHEDRA.len()) as u64, 1, 90]);
        out.end();
        let flat = FLAT.iter().enumerate();
        for (dimension, (kind, nodes)) in flat {
            out.ints(&[dimension as i32, 1, *kind]);
            out.sizes(&[1, 80]);
            out.sizes(nodes);
            out.end();
        }
        let (kind, further) = model.tetrahedron();
        for volume in [1, 2] {
            let elements: Vec<_> = TETRAHEDRA.iter().filter(|element| element.0 == volume).collect();
            out.ints(&[3, volume + shift, kind]);
            out.sizes(&[elements.len() as u64]);
            out.end();
            for (_, corners) in elements {
                out.sizes(&[90]);
                out.sizes(corners);
                out.sizes(further);
                out.end();
            }
        }
        out.text("\n$EndElements\n");
    }

    fn entity(self, out: &mut Out, dimension: usize, tag: i32, groups: &[i32], parent: impl Fn(&mut Out)) {
        out.ints(&[tag]);
        parent(out);
        out.floats(if dimension == 0 { &[0.5; 3] } else { &[-1.0; 6] });
        out.sizes(&[groups.len() as u64]);
        out.ints(groups);
        if dimension > 0 {
            out.sizes(&[2]);
            out.ints(&[3, -4]);
        }
        out.end();
    }
}
