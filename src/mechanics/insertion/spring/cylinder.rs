//! Parameters of the mass-spring model, and the cylinder of tetrahedra around the path of the needle.

use crate::insertion::InvalidSetup;
use insonify_base::range::{Ranges, parameters};
use insonify_mesh::TetMesh;
use insonify_mesh::lists::Lists;
use insonify_mesh::quality::Quality;

parameters! {
    /// Masses and springs in a cylinder around the path of the needle (Zhu et al. 2007, section 2.2). Its side and its
    /// far end are fixed; its tissue is a single material, by default like liver.
    #[derive(Copy)]
    #[schemars(rename = "CylinderSpec")]
    pub struct MassSpringParameters {
        /// Young's modulus.
        young_kpa: f64 = 10.0, in 1e-6..=1e12 "kPa";
        /// Density.
        density_kg_per_m3: f64 = 1000.0, in 1e-6..=1e12 "kg/m^3";
        /// Rate at which a free node loses its velocity: damping in proportion to mass.
        damping_per_s: f64 = 200.0, in 0..=1e12 "1/s";
        /// Ratio of a spring's damping to its stiffness. It reduces the stable step.
        spring_damping_s: f64 = 1e-4, in 0..=1e12 "s";
        /// Radius.
        radius_mm: f64 = 25.0, in 1e-6..=1e12 "mm";
        /// Length below the skin. Default: 1.25 times the path of the tip in a scenario, else 100 mm.
        length_mm: Option<f64>, in 1e-6..=1e12 "mm";
        /// Number of rings of nodes around the axis.
        rings: usize = 5, in 1..=64;
        /// Number of nodes of the first ring; ring i has i times as many, so that six give nearly equilateral
        /// triangles.
        sectors: usize = 6, in 3..=12;
        /// Number of layers of elements along the axis. Default: layers as thick as rings are wide.
        layers: Option<usize>, in 2..=1000;
        /// The tip node is penetrated when the far face is nearer than this fraction of its circumference.
        lambda: f64 = 0.05, in 0.005..=0.2;
        /// Maximum number of substeps of a step for the sake of stability. In a step that would need more, less time is
        /// simulated for the tissue: it approaches its equilibrium more slowly.
        most_substeps: usize = 100, in 1..=4096;
    }
}

/// Least dihedral angle that is accepted, degrees. The default mesh has 35.
pub(crate) const MIN_DIHEDRAL_DEG: f64 = 5.0;
/// Maximum number of nodes of a cylinder.
pub const MAX_NODES: usize = 200_000;

impl MassSpringParameters {
    /// Checks every number against its range.
    ///
    /// # Errors
    /// [`InvalidSetup::Number`], [`InvalidSetup::Large`].
    pub fn check(&self) -> Result<(), InvalidSetup> {
        self.check_ranges()?;
        match self.nodes() {
            found if found > MAX_NODES => Err(InvalidSetup::Large { found }),
            _ => Ok(()),
        }
    }

    /// Length of the cylinder below the skin, mm.
    pub fn length_mm(&self) -> f64 {
        self.length_mm.unwrap_or(100.0)
    }

    /// Number of layers of elements along the axis.
    pub fn layers(&self) -> usize {
        let as_wide = (self.length_mm() * self.rings as f64 / self.radius_mm).round();
        self.layers.unwrap_or(as_wide.clamp(2.0, 1000.0) as usize)
    }

    /// Returns the number of nodes of one layer.
    fn nodes_of_layer(&self) -> usize {
        1 + self.sectors * self.rings * (self.rings + 1) / 2
    }

    /// Returns the number of nodes of the cylinder.
    pub fn nodes(&self) -> usize {
        (self.layers() + 1) * self.nodes_of_layer()
    }
}

/// Mesh in its own frame: origin at the entry of the needle, z along the path. Node 0 is the origin.
#[derive(Clone, Debug)]
pub(super) struct Cylinder {
    pub mesh: TetMesh,
    /// Whether each node is fixed: those of the side and of the far end.
    pub fixed: Vec<bool>,
    /// Number of nodes in the skin, which come first.
    pub skin_nodes: usize,
    /// Cap before the skin: elements from it to a second disc, one radius before, whose nodes follow those of the mesh
    /// in the same order. It carries the displacements of images on to rest where the skin of the body is oblique to
    /// the needle, and no force.
    pub cap: Vec<[u32; 4]>,
    pub least_dihedral_deg: f64,
}

impl Cylinder {
    pub(super) fn new(parameters: &MassSpringParameters) -> Result<Cylinder, InvalidSetup> {
        parameters.check()?;
        let layers = parameters.layers();
        let disc = parameters.nodes_of_layer();
        let triangles = triangles(parameters.rings, parameters.sectors);
        let mut nodes = Vec::with_capacity(parameters.nodes());
        let mut fixed = Vec::with_capacity(parameters.nodes());
        for layer in 0..=layers {
            let z = parameters.length_mm() * layer as f64 / layers as f64;
            for (ring, angle) in polar(parameters.rings, parameters.sectors) {
                let r = parameters.radius_mm * ring as f64 / parameters.rings as f64;
                nodes.push([r * angle.cos(), r * angle.sin(), z]);
                fixed.push(ring == parameters.rings || layer == layers);
            }
        }
        let mut elements = Vec::with_capacity(3 * triangles.len() * layers);
        for layer in 0..layers {
            for triangle in &triangles {
                // Each side of a prism is cut from the lower corner with the lower number, as in its neighbour.
                let mut bottom = triangle.map(|corner| (layer * disc + corner) as u32);
                bottom.sort_unstable();
                let [a, b, c] = bottom;
                let [d, e, f] = bottom.map(|corner| corner + disc as u32);
                elements.extend([[a, b, c, f], [a, b, e, f], [a, d, e, f]].map(|corners| upright(corners, &nodes)));
            }
        }
        let before: Vec<[f64; 3]> = nodes[..disc]
            .iter()
            .map(|[x, y, _]| [*x, *y, -parameters.radius_mm])
            .collect();
        let all_nodes = [&nodes[..], &before].concat();
        let after = nodes.len() as u32;
        let mut cap = Vec::with_capacity(3 * triangles.len());
        for triangle in &triangles {
            let mut skin = triangle.map(|corner| corner as u32);
            skin.sort_unstable();
            let [a, b, c] = skin;
            let [d, e, f] = skin.map(|corner| corner + after);
            cap.extend([[a, b, c, f], [a, b, e, f], [a, d, e, f]].map(|corners| upright(corners, &all_nodes)));
        }
        let thin = InvalidSetup::Thin { found_deg: 0.0 };
        let regions = vec![0; elements.len()];
        let mesh = TetMesh::new(nodes, elements, regions).map_err(|_| thin)?;
        let quality = Quality::measure(&mesh, mesh.nodes());
        let found_deg = quality
            .shapes
            .iter()
            .fold(180.0, |least: f64, shape| least.min(shape.min_dihedral_deg));
        if found_deg >= MIN_DIHEDRAL_DEG && quality.inverted.is_empty() {
            Ok(Cylinder {
                mesh,
                fixed,
                skin_nodes: disc,
                cap,
                least_dihedral_deg: found_deg,
            })
        } else {
            Err(InvalidSetup::Thin { found_deg })
        }
    }
}

/// Returns ring and angle of each node of a layer.
fn polar(rings: usize, sectors: usize) -> impl Iterator<Item = (usize, f64)> {
    let on_ring = move |ring: usize| {
        let count = (sectors * ring).max(1);
        (0..count).map(move |index| (ring, std::f64::consts::TAU * index as f64 / count as f64))
    };
    (0..=rings).flat_map(on_ring)
}

/// Returns the triangles of a layer: in each sector, between ring i and i + 1, i + 1 based on the outer ring and i on
/// the inner.
fn triangles(rings: usize, sectors: usize) -> Vec<[usize; 3]> {
    let node = |ring: usize, index: usize| match ring {
        0 => 0,
        _ => 1 + sectors * ring * (ring - 1) / 2 + index % (sectors * ring),
    };
    let mut triangles = Vec::with_capacity(sectors * rings * rings);
    for ring in 0..rings {
        for sector in 0..sectors {
            let inner = |index: usize| node(ring, sector * ring + index);
            let outer = |index: usize| node(ring + 1, sector * (ring + 1) + index);
            triangles.extend((0..=ring).map(|index| [outer(index), outer(index + 1), inner(index)]));
            triangles.extend((0..ring).map(|index| [inner(index), outer(index + 1), inner(index + 1)]));
        }
    }
    triangles
}

/// Returns the same corners in the order that gives a positive volume.
fn upright(corners: [u32; 4], nodes: &[[f64; 3]]) -> [u32; 4] {
    let [a, b, c, d] = corners.map(|corner| nalgebra::Vector3::from(nodes[corner as usize]));
    if (b - a).dot(&(c - a).cross(&(d - a))) < 0.0 {
        [corners[0], corners[1], corners[3], corners[2]]
    } else {
        corners
    }
}

/// Corners of an element's six edges.
const EDGES: [[usize; 2]; 6] = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];

/// Edges, and the adjacency of nodes, edges and elements.
#[derive(Clone, Debug)]
pub(super) struct Topology {
    /// Ends of each edge, lower number first, in ascending order.
    pub edges: Vec<[u32; 2]>,
    pub edges_of_element: Vec<[u32; 6]>,
    pub elements_of_edge: Lists,
    pub elements_of_node: Lists,
    pub edges_of_node: Lists,
}

impl Topology {
    pub(super) fn new(nodes: usize, elements: &[[u32; 4]]) -> Topology {
        let ends = |element: &[u32; 4]| EDGES.map(|[a, b]| [element[a].min(element[b]), element[a].max(element[b])]);
        let mut edges: Vec<[u32; 2]> = elements.iter().flat_map(ends).collect();
        edges.sort_unstable();
        edges.dedup();
        let number = |edge: [u32; 2]| edges.partition_point(|listed| *listed < edge) as u32;
        let edges_of_element: Vec<[u32; 6]> = elements.iter().map(|element| ends(element).map(number)).collect();
        let of_element = (0u32..).zip(&edges_of_element);
        let elements_of_edge = of_element.flat_map(|(element, edges)| edges.map(|edge| (edge, element)));
        let corners = (0u32..).zip(elements);
        let elements_of_node = corners.flat_map(|(element, corners)| corners.map(|corner| (corner, element)));
        let edges_of_node = (0u32..)
            .zip(&edges)
            .flat_map(|(edge, ends)| ends.map(|end| (end, edge)));
        Topology {
            elements_of_edge: Lists::new(edges.len(), elements_of_edge),
            elements_of_node: Lists::new(nodes, elements_of_node),
            edges_of_node: Lists::new(nodes, edges_of_node),
            edges_of_element,
            edges,
        }
    }
}
