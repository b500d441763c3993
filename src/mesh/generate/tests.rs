//! Meshes of synthetic volumes: invariants of every mesh ([`sound`]), and their agreement with the volume.

mod along;
mod refused;
mod shapes;
mod work;

use std::collections::HashMap;

use nalgebra::{Matrix4, Vector3};

use super::*;
use crate::NO_ELEMENT;

/// Labels on a grid; all but 0 are meshed as regions of ten times their number.
struct Volume {
    labels: Vec<u8>,
    size: [usize; 3],
    index_to_world: Matrix4<f64>,
    regions: Vec<(u8, i32)>,
}

impl Volume {
    /// Builds voxels of `spacing` mm; the label of each is that of its centre, mm from the low corner of the grid.
    fn new(size: [usize; 3], spacing: [f64; 3], label: impl Fn([f64; 3]) -> u8) -> Volume {
        let mut labels = Vec::new();
        for k in 0..size[2] {
            for j in 0..size[1] {
                for i in 0..size[0] {
                    let index = [i, j, k];
                    labels.push(label([0, 1, 2].map(|axis| (index[axis] as f64 + 0.5) * spacing[axis])));
                }
            }
        }
        let mut present: Vec<u8> = labels.iter().copied().filter(|label| *label != 0).collect();
        present.sort_unstable();
        present.dedup();
        let half = Matrix4::new_translation(&(0.5 * Vector3::from(spacing)));
        Volume {
            labels,
            size,
            index_to_world: half * Matrix4::new_nonuniform_scaling(&spacing.into()),
            regions: present.iter().map(|label| (*label, 10 * i32::from(*label))).collect(),
        }
    }

    fn grid(&self) -> LabelGrid<'_> {
        LabelGrid {
            labels: &self.labels,
            size: self.size,
            index_to_world: self.index_to_world,
            regions: &self.regions,
        }
    }

    fn generate(&self, nodes: usize) -> Result<Generated, GenerateError> {
        generate(&self.grid(), nodes, &GenerateOptions::default(), |_| {})
    }

    /// Returns the mesh, checked.
    fn mesh(&self, nodes: usize) -> Generated {
        let generated = self
            .generate(nodes)
            .unwrap_or_else(|error| panic!("{nodes} nodes: {error}"));
        self.check(&generated, nodes, GenerateOptions::default().min_dihedral_deg);
        generated
    }

    /// Checks the invariants of every mesh, recomputed from its nodes and elements alone.
    fn check(&self, generated: &Generated, budget: usize, min_dihedral_deg: f64) {
        let Generated { mesh, report } = generated;
        assert_eq!(report.nodes, mesh.nodes().len());
        assert_eq!(report.elements, mesh.elements().len());
        assert!(report.nodes <= budget, "{} nodes for {budget}", report.nodes);
        let mut used = vec![false; report.nodes];
        mesh.elements()
            .as_flattened()
            .iter()
            .for_each(|node| used[*node as usize] = true);
        assert!(used.iter().all(|used| *used), "a node of no element");

        let mut least = f64::INFINITY;
        let mut volumes: HashMap<i32, f64> = HashMap::new();
        for ((corners, volume), region) in mesh
            .elements()
            .iter()
            .zip(mesh.volumes(mesh.nodes()))
            .zip(mesh.regions())
        {
            assert!(volume > 0.0, "{corners:?} has {volume} mm^3");
            *volumes.entry(*region).or_default() += volume / 1000.0;
            least = least.min(least_angle_deg(mesh, corners));
        }
        // Arc cosine of a value accurate to a few units of rounding.
        assert!(least >= min_dihedral_deg - 1e-6, "{least} degrees");
        assert!((least - report.min_dihedral_deg).abs() < 1e-6, "{least}: {report:?}");
        assert_no_hinge(mesh);

        let voxel_ml = self.index_to_world.fixed_view::<3, 3>(0, 0).determinant().abs() / 1000.0;
        assert!(
            volumes
                .keys()
                .all(|region| report.regions.iter().any(|r| r.region == *region))
        );
        for region in &report.regions {
            let of = |label: u8| self.regions.contains(&(label, region.region));
            let voxels = voxel_ml * self.labels.iter().filter(|label| of(**label)).count() as f64;
            let elements = volumes.get(&region.region).copied().unwrap_or(0.0);
            assert!(
                (region.voxel_ml - voxels).abs() <= 1e-9 * voxels,
                "{region:?}: {voxels} ml"
            );
            assert!(
                (region.mesh_ml - elements).abs() <= 1e-9 * voxels,
                "{region:?}: {elements} ml"
            );
            let percent = 100.0 * (elements / voxels - 1.0);
            assert!((region.error_percent - percent).abs() < 1e-6, "{region:?}: {percent} %");
        }
    }
}

/// Returns the smallest angle between two faces, from their unit normals.
fn least_angle_deg(mesh: &TetMesh, corners: &[u32; 4]) -> f64 {
    let at = corners.map(|node| Vector3::from(mesh.nodes()[node as usize]));
    let outwards = |opposite: usize| {
        let [a, b, c] = FACES[opposite].map(|corner| at[corner]);
        let normal = (b - a).cross(&(c - a)).normalize();
        normal * -normal.dot(&(at[opposite] - a)).signum()
    };
    let normals = [0, 1, 2, 3].map(outwards);
    (0..4)
        .flat_map(|i| (0..i).map(move |j| (i, j)))
        .map(|(i, j)| (-normals[i].dot(&normals[j])).clamp(-1.0, 1.0).acos().to_degrees())
        .fold(f64::INFINITY, f64::min)
}

/// Returns the faces that belong to only one element.
fn surface(mesh: &TetMesh) -> Vec<[u32; 3]> {
    let mut faces: HashMap<[u32; 3], u32> = HashMap::new();
    for corners in mesh.elements() {
        for opposite in 0..4 {
            let mut face = FACES[opposite].map(|corner| corners[corner]);
            face.sort_unstable();
            *faces.entry(face).or_default() += 1;
        }
    }
    assert!(faces.values().all(|count| *count <= 2));
    let free = mesh
        .neighbours()
        .as_flattened()
        .iter()
        .filter(|n| **n == NO_ELEMENT)
        .count();
    let single: Vec<_> = faces.into_iter().filter(|(_, count)| *count == 1).collect();
    assert_eq!(single.len(), free, "neighbours and faces disagree");
    single.into_iter().map(|(face, _)| face).collect()
}

/// Asserts that no elements are attached to others by an edge or a corner only, as by a hinge: those around each node
/// are connected through faces at that node.
fn assert_no_hinge(mesh: &TetMesh) {
    let mut stars: Vec<Vec<u32>> = vec![Vec::new(); mesh.nodes().len()];
    for (element, corners) in mesh.elements().iter().enumerate() {
        corners
            .iter()
            .for_each(|node| stars[*node as usize].push(element as u32));
    }
    for (node, star) in stars.iter().enumerate() {
        let mut reached = vec![star[0]];
        let mut at = 0;
        while at < reached.len() {
            let element = reached[at] as usize;
            at += 1;
            for (corner, other) in mesh.elements()[element].iter().zip(mesh.neighbours()[element]) {
                if *corner as usize != node && other != NO_ELEMENT && !reached.contains(&other) {
                    reached.push(other);
                }
            }
        }
        assert_eq!(reached.len(), star.len(), "node {node} is a hinge");
    }
}

/// Returns nodes minus edges plus faces minus elements: 1 for a ball, 2 for a hollow one, 0 for a ring.
fn euler(mesh: &TetMesh) -> i64 {
    let mut edges: Vec<[u32; 2]> = mesh
        .elements()
        .iter()
        .flat_map(|corners| {
            let pairs = (0..4).flat_map(|a| (0..a).map(move |b| [a, b]));
            pairs.map(|[a, b]| [corners[a].min(corners[b]), corners[a].max(corners[b])])
        })
        .collect();
    edges.sort_unstable();
    edges.dedup();
    let elements = mesh.elements().len();
    // Each element has four faces, of which interior ones count twice.
    let faces = (4 * elements + surface(mesh).len()) / 2;
    mesh.nodes().len() as i64 - edges.len() as i64 + faces as i64 - elements as i64
}

/// Returns the area of the surface, mm^2.
fn area(mesh: &TetMesh) -> f64 {
    let one = |face: [u32; 3]| {
        let [a, b, c] = face.map(|node| Vector3::from(mesh.nodes()[node as usize]));
        0.5 * (b - a).cross(&(c - a)).norm()
    };
    surface(mesh).into_iter().map(one).sum()
}

fn region(generated: &Generated, number: i32) -> RegionVolume {
    let volume = generated.report.regions.iter().find(|region| region.region == number);
    *volume.unwrap_or_else(|| panic!("no region {number}"))
}
