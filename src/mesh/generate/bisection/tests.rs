use std::collections::HashMap;

use super::{Bisection, Lattice};
use crate::generate::{sharpest_cosine, six_volumes};
use insonify_base::random::{hash3, unit};

fn cubes(cells: [usize; 3]) -> Bisection {
    Bisection::new(&Lattice {
        cells,
        low: [-1.0, 0.5, 2.0],
        edges: [2.0; 3],
    })
}

/// Bisects random elements, most of them near the first node, so that the levels differ.
fn refined(seed: u32, halvings: i32) -> Bisection {
    let mut mesh = cubes([2, 3, 2]);
    let mut changed = Vec::new();
    for halving in 0..halvings {
        let [coin, place, _] = hash3([halving, 0, 0], [seed, 0]).map(unit);
        let of = |count: usize| (place * count as f32) as usize;
        let near = mesh.star(0);
        let element = if coin < 0.5 {
            near[of(near.len())]
        } else {
            of(mesh.elements.len()) as u32
        };
        mesh.bisect(element, &mut changed);
    }
    mesh
}

#[test]
fn halves_of_cubes_keep_angles_of_45_degrees_and_conform() {
    for seed in 0..8 {
        let mesh = refined(seed, 60);
        let mut faces: HashMap<[u32; 3], Vec<usize>> = HashMap::new();
        let mut six_fold = 0.0;
        for (element, corners) in mesh.elements.iter().enumerate() {
            let positions = mesh.corners(element as u32);
            six_fold += six_volumes(&positions).abs();
            // Maubach 1995: three shapes of 45 degrees and more.
            assert!(sharpest_cosine(&positions) <= 0.5f64.sqrt() + 1e-12, "{positions:?}");
            for opposite in 0..4 {
                let mut face: Vec<u32> = (0..4).filter(|c| *c != opposite).map(|c| corners[c]).collect();
                face.sort_unstable();
                faces.entry([face[0], face[1], face[2]]).or_default().push(element);
            }
        }
        // Midpoints of multiples of a power of two are exact, and so are the volumes.
        assert_eq!(six_fold, 6.0 * 4.0 * 6.0 * 4.0);
        // A face on one side only lies in the box's surface: with a hanging node it would be inside.
        for (face, elements) in faces {
            let on = face.map(|node| mesh.on_faces(node));
            let outer = (0..3).any(|axis| {
                let first = mesh.nodes[face[0] as usize][axis];
                on.iter().all(|on| on[axis]) && face.iter().all(|node| mesh.nodes[*node as usize][axis] == first)
            });
            assert_eq!(elements.len(), if outer { 1 } else { 2 }, "{face:?} of {elements:?}");
        }
    }
}

#[test]
fn stars_list_the_elements_of_their_node() {
    let mesh = refined(3, 40);
    for node in 0..mesh.nodes.len() as u32 {
        let mut star = mesh.star(node).to_vec();
        star.sort_unstable();
        let with_node = (0..mesh.elements.len() as u32).filter(|e| mesh.elements[*e as usize].contains(&node));
        assert_eq!(star, with_node.collect::<Vec<_>>(), "node {node}");
    }
}

#[test]
fn what_changed_is_told() {
    let mut mesh = cubes([1, 1, 1]);
    let before = mesh.clone();
    let mut changed = Vec::new();
    // The diagonal of the cube belongs to all six.
    mesh.bisect(0, &mut changed);
    changed.sort_unstable();
    changed.dedup();
    assert_eq!(changed, (0..12).collect::<Vec<u32>>());
    assert_eq!((before.nodes.len(), mesh.nodes.len()), (8, 9));
    assert_eq!(mesh.nodes[8], [0.0, 1.5, 3.0]);
}
