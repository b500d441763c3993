mod shapes;

use super::*;
use crate::TetMesh;

const CORNER: [[f64; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

fn mesh(nodes: &[[f64; 3]], elements: &[[u32; 4]]) -> TetMesh {
    let regions = (0..elements.len() as i32).collect();
    TetMesh::new(nodes.to_vec(), elements.to_vec(), regions).unwrap()
}

fn moved(by: [f64; 3]) -> [[f64; 3]; 4] {
    CORNER.map(|corner| [corner[0] + by[0], corner[1] + by[1], corner[2] + by[2]])
}

#[test]
fn a_sound_mesh_is_usable() {
    let lattice = TetMesh::over_box([0.0; 3], [40.0, 30.0, 20.0], 500).unwrap();
    let quality = Quality::measure(&lattice, lattice.nodes());
    assert_eq!(quality.usable(), Ok(()));
    assert!((quality.volume_ml() - 24.0).abs() < 1e-12, "{}", quality.volume_ml());
    let [part] = quality.parts[..] else {
        panic!("{:?}", quality.parts)
    };
    let elements = lattice.elements().len();
    assert_eq!((part.first, part.elements, quality.face_parts), (0, elements, 1));
    assert!((part.volume_ml - 24.0).abs() < 1e-12);
    assert!(quality.isolated_nodes.is_empty() && quality.coincident_nodes.is_empty() && quality.duplicates.is_empty());
    for spread in [
        &quality.volume_mm3,
        &quality.min_dihedral_deg,
        &quality.max_dihedral_deg,
        &quality.condition,
    ] {
        assert!(spread.min <= spread.median && spread.median <= spread.max, "{spread:?}");
        assert_eq!(spread.histogram.iter().map(|bin| bin.count).sum::<usize>(), elements);
    }
}

#[test]
fn faults_are_listed_by_element() {
    let mut nodes: Vec<[f64; 3]> = (0..5).flat_map(|n| moved([10.0 * f64::from(n), 0.0, 0.0])).collect();
    nodes[4 + 3][2] = -1.0; // element 1 is inverted
    nodes[8 + 3][2] = 0.0; // element 2 is flat
    nodes[12 + 3][2] = 1e-9; // element 3 is a sliver
    let elements: Vec<[u32; 4]> = (0..5).map(|n| [4 * n, 4 * n + 1, 4 * n + 2, 4 * n + 3]).collect();
    let reference = mesh(&nodes, &elements);
    nodes[16][1] = f64::NAN;
    let quality = Quality::measure(&reference, &nodes);
    assert_eq!(quality.inverted, [1]);
    assert_eq!(quality.flat, [2]);
    assert_eq!(quality.slivers, [3]);
    assert_eq!(quality.not_finite, [4]);
    assert_eq!((quality.parts.len(), quality.face_parts), (5, 5));
    let error = quality.usable().unwrap_err().to_string();
    assert_eq!(
        error,
        "the mesh cannot be calculated on: tetrahedron 1 is inverted; tetrahedron 2 is flat; tetrahedron 4 is not finite at a \
         corner; tetrahedron 3 is too thin (a Jacobian condition beyond 6.7e7); tetrahedra are numbered from 0"
    );
    assert_eq!(quality.condition.max, f64::INFINITY);
    assert!((quality.volume_mm3.min + 1.0 / 6.0).abs() < 1e-15);
    assert_eq!(quality.volume_mm3.histogram[0].count, 1);
}

#[test]
fn long_lists_are_cut() {
    let nodes: Vec<[f64; 3]> = (0..13).flat_map(|n| moved([2.0 * f64::from(n), 0.0, 0.0])).collect();
    let elements: Vec<[u32; 4]> = (0..13).map(|n| [4 * n, 4 * n + 1, 4 * n + 2, 4 * n + 3]).collect();
    let reference = mesh(&nodes, &elements);
    let mirrored: Vec<[f64; 3]> = nodes.iter().map(|n| [n[0], n[1], -n[2]]).collect();
    let error = Quality::measure(&reference, &mirrored)
        .usable()
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("tetrahedra 0, 1, 2, 3, 4, 5, 6, 7, 8, 9 and 3 more are inverted"),
        "{error}"
    );
}

#[test]
fn elements_that_are_there_twice_are_found_in_any_order_of_corners() {
    let reference = mesh(
        &[CORNER, moved([5.0; 3])].concat(),
        &[[0, 1, 2, 3], [4, 5, 6, 7], [1, 2, 0, 3]],
    );
    let quality = Quality::measure(&reference, reference.nodes());
    assert_eq!(quality.duplicates, [[0, 2]]);
    assert!(
        quality
            .usable()
            .unwrap_err()
            .to_string()
            .contains("tetrahedron 2 is there a second time")
    );
}

#[test]
fn nodes_of_no_element_and_nodes_in_one_place_are_found() {
    let mut nodes = CORNER.to_vec();
    nodes.extend([[0.5; 3], [1.0, 0.0, 1e-10], [1.0, 0.0, 1e-7], CORNER[2]]);
    nodes.extend(moved([-3.0, 2.0, 1.0]));
    let reference = mesh(&nodes, &[[0, 1, 2, 3], [8, 9, 10, 11]]);
    let quality = Quality::measure(&reference, reference.nodes());
    assert_eq!(quality.isolated_nodes, [4, 5, 6, 7]);
    assert_eq!(quality.coincident_nodes, [[1, 5], [2, 7]]);
    assert_eq!(quality.usable(), Ok(()));
    // Neighbours across the cells into which the search sorts nodes.
    for n in 0..200 {
        let x = f64::from(n) * 0.3e-9;
        let close = [
            [0.0; 3],
            [x, x, 1.0 - x],
            [x + 3e-10, x - 3e-10, 1.0 - x],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
        ];
        assert_eq!(coincident(&close), [[1, 2]], "{n}");
    }
    assert_eq!(
        coincident(&[[2.0; 3], [2.0; 3], [f64::NAN; 3], [2.0; 3]]),
        [[0, 1], [0, 3]]
    );
    assert!(coincident(&[[-1e300; 3], [1e300; 3]]).is_empty());
    assert!(coincident(&[[f64::INFINITY; 3]; 2]).is_empty());
}

#[test]
fn parts_on_a_hinge_are_told_from_parts_on_a_face() {
    // Two share a face, a third is attached by an edge, a fourth by a node; a fifth is separate.
    let mut nodes = CORNER.to_vec();
    nodes.extend([
        [1.0; 3],
        [0.0, -1.0, -1.0],
        [0.0, -1.0, -2.0],
        [-1.0, 2.0, 0.0],
        [-1.0, 2.0, 1.0],
        [0.0, 3.0, 0.0],
    ]);
    nodes.extend(moved([9.0; 3]));
    let elements = [[0, 1, 2, 3], [1, 2, 3, 4], [0, 1, 5, 6], [2, 7, 8, 9], [10, 11, 12, 13]];
    let reference = mesh(&nodes, &elements);
    let quality = Quality::measure(&reference, reference.nodes());
    let parts: Vec<_> = quality.parts.iter().map(|part| (part.first, part.elements)).collect();
    assert_eq!(parts, [(0, 4), (4, 1)]);
    assert_eq!(quality.face_parts, 4);
}

#[test]
fn regions_share_the_volume() {
    let lattice = TetMesh::over_box([0.0; 3], [10.0; 3], 60).unwrap();
    let count = lattice.elements().len();
    let regions: Vec<i32> = (0..count as i32).map(|n| [9, -4][n as usize % 2]).collect();
    let lattice = TetMesh::new(lattice.nodes().to_vec(), lattice.elements().to_vec(), regions).unwrap();
    let current: Vec<[f64; 3]> = lattice.nodes().iter().map(|n| [n[0], 2.0 * n[1], n[2]]).collect();
    let quality = Quality::measure(&lattice, &current);
    let values: Vec<i32> = quality.regions.iter().map(|region| region.value).collect();
    assert_eq!(values, [-4, 9]);
    assert_eq!(
        quality.regions.iter().map(|region| region.elements).sum::<usize>(),
        count
    );
    assert!((quality.volume_ml() - 2.0).abs() < 1e-13);
}

#[test]
fn spreads_count_what_lies_where() {
    let values = [3.0, f64::NAN, 0.5, 1.0, f64::INFINITY, -2.0];
    let spread = Spread::of(values.into_iter(), &[0.0, 1.0, 2.0, 3.0]);
    assert_eq!((spread.min, spread.median, spread.max), (-2.0, 1.0, f64::INFINITY));
    assert_eq!(
        spread.histogram.iter().map(|bin| bin.count).collect::<Vec<_>>(),
        [2, 1, 2]
    );
    assert_eq!(Spread::of([1.0, 4.0].into_iter(), &[0.0, 9.0]).median, 2.5);
    let none = Spread::of([f64::NAN].into_iter(), &[0.0, 1.0]);
    assert!(none.min.is_nan() && none.median.is_nan() && none.max.is_nan() && none.histogram[0].count == 0);
}
