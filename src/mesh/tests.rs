use nalgebra::Matrix4;

use super::*;

const CORNERS: [[f64; 3]; 4] = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

fn with_point(point: [f64; 3]) -> Vec<[f64; 3]> {
    CORNERS.iter().copied().chain([point]).collect()
}

#[test]
fn a_mesh_of_two_elements_knows_its_neighbours_and_volumes() {
    let mesh = TetMesh::new(with_point([1.0; 3]), vec![[0, 1, 2, 3], [4, 3, 2, 1]], vec![7, 8]).unwrap();
    assert_eq!(
        mesh.neighbours(),
        [
            [1, NO_ELEMENT, NO_ELEMENT, NO_ELEMENT],
            [0, NO_ELEMENT, NO_ELEMENT, NO_ELEMENT]
        ]
    );
    let volumes: Vec<f64> = mesh.volumes(mesh.nodes()).collect();
    assert!(
        (volumes[0] - 1.0 / 6.0).abs() < 1e-15 && (volumes[1] - 1.0 / 3.0).abs() < 1e-15,
        "{volumes:?}"
    );
    assert_eq!(mesh.regions(), [7, 8]);
    assert_eq!(mesh.bounds(), [[0.0; 3], [1.0; 3]]);
}

#[test]
fn a_mesh_of_the_other_orientation_is_turned_round_but_single_inverted_elements_stay() {
    let turned = TetMesh::new(CORNERS.to_vec(), vec![[0, 2, 1, 3]], vec![0]).unwrap();
    assert!(turned.volumes(turned.nodes()).all(|v| v > 0.0));
    let mixed = TetMesh::new(with_point([1.0; 3]), vec![[0, 1, 2, 3], [4, 2, 3, 1]], vec![0, 0]).unwrap();
    assert_eq!(
        mixed.volumes(mixed.nodes()).map(f64::signum).collect::<Vec<_>>(),
        [1.0, -1.0]
    );
}

#[test]
fn broken_parts_are_refused_with_their_place() {
    let new = |nodes: Vec<[f64; 3]>, elements: Vec<[u32; 4]>| {
        let regions = vec![0; elements.len()];
        TetMesh::new(nodes, elements, regions).unwrap_err()
    };
    let good = [0, 1, 2, 3];
    assert_eq!(new(CORNERS.to_vec(), vec![]), InvalidMesh::Empty);
    assert_eq!(
        new(CORNERS.to_vec(), vec![good, [0, 1, 2, 4]]),
        InvalidMesh::Node {
            element: 1,
            node: 4,
            nodes: 4
        }
    );
    assert_eq!(
        new(CORNERS.to_vec(), vec![[0, 1, 2, 1]]),
        InvalidMesh::RepeatedNode {
            element: 0,
            node: 1,
            corners: [0, 1, 2, 1]
        }
    );
    assert!(matches!(
        new(with_point([0.0, f64::NAN, 0.0]), vec![good]),
        InvalidMesh::Coordinate { node: 4, .. }
    ));
    assert_eq!(
        new(with_point([1.0; 3]), vec![good, [1, 2, 3, 4], [3, 1, 0, 2]]),
        InvalidMesh::Repeated {
            corners: [0, 1, 2, 3],
            elements: [0, 2]
        }
    );
    let three = vec![good, [1, 2, 3, 4], [3, 2, 1, 5]];
    let nodes = with_point([1.0; 3]).into_iter().chain([[2.0; 3]]).collect();
    assert_eq!(
        new(nodes, three),
        InvalidMesh::SharedFace {
            face: [1, 2, 3],
            elements: [0, 1, 2]
        }
    );
    assert_eq!(
        TetMesh::new(CORNERS.to_vec(), vec![good], vec![]).unwrap_err(),
        InvalidMesh::Regions { found: 0, expected: 1 }
    );
}

#[test]
fn a_mesh_over_a_box_fills_it_and_conforms() {
    for (max, target) in [
        ([10.0, 20.0, 30.0], 5000),
        ([1.0, 1.0, 1.0], 8),
        ([300.0, 4.0, 50.0], 900),
        ([5.0; 3], 0),
    ] {
        let mesh = TetMesh::over_box([0.0; 3], max, target).unwrap();
        let volume: f64 = mesh.volumes(mesh.nodes()).inspect(|v| assert!(*v > 0.0)).sum();
        let whole = max[0] * max[1] * max[2];
        assert!((volume - whole).abs() < 1e-9 * whole, "{volume} of {whole}");
        let target = target.max(8) as f64;
        let nodes = mesh.nodes().len() as f64;
        assert!((nodes / target - 1.0).abs() < 0.3, "{nodes} nodes for {target}");
        // Every face without a neighbour lies on the surface of the box.
        for (element, neighbours) in mesh.neighbours().iter().enumerate() {
            for (opposite, _) in neighbours.iter().enumerate().filter(|(_, n)| **n == NO_ELEMENT) {
                let face: Vec<[f64; 3]> = (0..4)
                    .filter(|corner| *corner != opposite)
                    .map(|corner| mesh.nodes()[mesh.elements()[element][corner] as usize])
                    .collect();
                let on_side = (0..3)
                    .any(|a| face.iter().all(|n| n[a] == 0.0) || face.iter().all(|n| (n[a] - max[a]).abs() < 1e-9));
                assert!(on_side, "hole at element {element}");
            }
        }
    }
}

#[test]
fn a_mesh_over_an_oblique_or_mirrored_box_has_positive_volume() {
    for mirror in [1.0, -1.0] {
        let to_world = Matrix4::new(
            3.0 * mirror,
            1.0,
            0.0,
            5.0,
            0.0,
            2.0,
            0.5,
            6.0,
            0.2,
            0.0,
            4.0,
            7.0,
            0.0,
            0.0,
            0.0,
            1.0,
        );
        let mesh = TetMesh::over_affine_box(&to_world, 100).unwrap();
        let volume: f64 = mesh.volumes(mesh.nodes()).inspect(|v| assert!(*v > 0.0)).sum();
        let whole = to_world.fixed_view::<3, 3>(0, 0).determinant().abs();
        assert!((volume - whole).abs() < 1e-9 * whole);
    }
}

#[test]
fn impossible_boxes_are_refused() {
    let flat = TetMesh::over_box([0.0; 3], [1.0, 0.0, 1.0], 10).unwrap_err();
    assert!(matches!(flat, InvalidMesh::Box { .. }), "{flat}");
    assert!(matches!(
        TetMesh::over_box([0.0; 3], [f64::NAN, 1.0, 1.0], 10),
        Err(InvalidMesh::Box { .. })
    ));
    assert!(matches!(
        TetMesh::lattice([1, 0, 1], &Matrix4::identity()),
        Err(InvalidMesh::Cells(_))
    ));
    assert!(matches!(
        TetMesh::lattice([usize::MAX, 2, 2], &Matrix4::identity()),
        Err(InvalidMesh::TooMany { what: "nodes", .. })
    ));
}

/// Reflected in a plane between cells, a mirrored lattice is itself: as many tetrahedra, all of the box, over the same
/// nodes.
#[test]
fn a_mirrored_lattice_is_its_own_mirror_image() {
    let to_world = Matrix4::new_nonuniform_scaling(&nalgebra::Vector3::new(4.0, 2.0, 2.0));
    let sorted = |mesh: &TetMesh, of: &dyn Fn([f64; 3]) -> [f64; 3]| {
        let element = |corners: &[u32; 4]| {
            let mut corners = corners.map(|node| of(mesh.nodes()[node as usize]).map(|x| x.round() as i32));
            corners.sort_unstable();
            corners
        };
        let mut elements: Vec<_> = mesh.elements().iter().map(element).collect();
        elements.sort_unstable();
        elements
    };
    let mirrored = TetMesh::mirrored_lattice([4, 2, 2], &to_world).unwrap();
    let plain = TetMesh::lattice([4, 2, 2], &to_world).unwrap();
    let reflect = |p: [f64; 3]| [4.0 - p[0], p[1], p[2]];
    assert_eq!(sorted(&mirrored, &|p| p), sorted(&mirrored, &reflect));
    assert_ne!(sorted(&plain, &|p| p), sorted(&plain, &reflect));
    assert!(
        mirrored
            .volumes(mirrored.nodes())
            .all(|volume| (volume - 1.0 / 6.0).abs() < 1e-12)
    );
    assert_eq!(mirrored.nodes(), plain.nodes());
}
