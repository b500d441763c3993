//! Point location in meshes that can be searched exhaustively: helpers, and the reports of updates.

mod answers;
mod spoilt;

use crate::InvalidMesh;
use nalgebra::{Matrix3, Matrix4, Vector3};

use super::*;
use crate::Displacement;
use insonify_base::random::{hash3, seed_words, unit};

/// Returns a pseudo-random number in [-1, 1) from integers.
fn noise(a: u64, b: u64, seed: u64) -> f64 {
    2.0 * f64::from(unit(hash3([a as i32, b as i32, 7], seed_words(seed))[0])) - 1.0
}

/// Returns a lattice of `n`^3 cells over [0, n]^3 mm, shifted far from the origin, as scanner coordinates are.
fn lattice(n: usize, shift: f64) -> TetMesh {
    let to_world = Matrix4::new_translation(&Vector3::repeat(shift)) * Matrix4::new_scaling(n as f64);
    TetMesh::lattice([n; 3], &to_world).unwrap()
}

/// Returns the nodes with those inside the box moved by up to `amount` cells; below 0.2 no element folds.
fn jitter(mesh: &TetMesh, amount: f64, seed: u64) -> Vec<[f64; 3]> {
    let [low, high] = mesh.bounds();
    let nodes = mesh.nodes().iter().enumerate().map(|(index, node)| {
        std::array::from_fn(|axis| {
            if node[axis] == low[axis] || node[axis] == high[axis] {
                node[axis]
            } else {
                node[axis] + amount * noise(index as u64, axis as u64, seed)
            }
        })
    });
    nodes.collect()
}

/// Returns barycentric coordinates by ratios of volumes: the oracle.
fn coordinates(mesh: &TetMesh, nodes: &[[f64; 3]], element: usize, p: [f64; 3]) -> [f64; 4] {
    let corners = mesh.elements()[element].map(|node| Vector3::from(nodes[node as usize]));
    let volume = |c: [Vector3<f64>; 4]| Matrix3::from_columns(&[c[1] - c[0], c[2] - c[0], c[3] - c[0]]).determinant();
    let whole = volume(corners);
    std::array::from_fn(|place| {
        let mut replaced = corners;
        replaced[place] = Vector3::from(p);
        volume(replaced) / whole
    })
}

fn depth(mesh: &TetMesh, nodes: &[[f64; 3]], element: usize, p: [f64; 3]) -> f64 {
    coordinates(mesh, nodes, element, p)
        .into_iter()
        .fold(f64::INFINITY, f64::min)
}

fn locator<T: Real>(mesh: &TetMesh, nodes: &[[f64; 3]]) -> (Locator<T>, LocatorReport) {
    let mut locator = Locator::new(mesh);
    let report = locator.update(nodes).unwrap();
    (locator, report)
}

/// Returns the single answer from the grid, from some elements and from some beyond the last.
fn from_all_starts<T: Real>(locator: &Locator<T>, p: [T; 3], seed: u64) -> Hit<T> {
    let hit = locator.locate(p, NO_ELEMENT);
    let count = locator.elements.len() as u64;
    for attempt in 0..12 {
        let start = (hash3([attempt, 0, 0], seed_words(seed))[0] as u64 % (count + 2)) as u32;
        assert_eq!(locator.locate(p, start), hit, "start {start} of {count} at {p:?}");
    }
    hit
}

fn sound(report: LocatorReport) {
    assert_eq!(report, LocatorReport::default());
}

#[test]
fn updates_allocate_nothing_and_return_to_the_same_state() {
    let mesh = TetMesh::over_box([0.0; 3], [100.0, 80.0, 60.0], 1500).unwrap();
    let mut located = Locator::<f32>::new(&mesh);
    let fresh = located.clone();
    let room = |l: &Locator<f32>| (l.grid.starts.capacity(), l.grid.lists.capacity(), l.frames.capacity());
    let before = room(&located);
    let mut nodes = Vec::new();
    for shear in [0.0, 3.0, 500.0, -1e6] {
        let sheared = Displacement::Affine {
            matrix: [
                [1.0, shear, shear, 0.0],
                [0.0, 1.0, shear, 0.0],
                [shear, 0.0, 1.0, 5.0],
                [0.0, 0.0, 0.0, 1.0],
            ],
        };
        sheared.displace(mesh.nodes(), &mut nodes);
        located.update(&nodes).unwrap();
        assert_eq!(room(&located), before, "shear {shear}");
    }
    located.update(mesh.nodes()).unwrap();
    assert_eq!(located.frames, fresh.frames);
    assert_eq!(
        (located.grid.starts, located.grid.lists),
        (fresh.grid.starts, fresh.grid.lists)
    );
}

#[test]
fn a_wrong_number_of_nodes_is_refused() {
    let mesh = lattice(1, 0.0);
    let error = Locator::<f64>::new(&mesh).update(&[[0.0; 3]; 3]).unwrap_err();
    assert_eq!(
        error,
        InvalidMesh::Positions {
            state: "current",
            found: 3,
            expected: 8
        }
    );
}
