use super::*;
use crate::tissue::error::LinearError;

fn free(mesh: &TetMesh, fixed: &[(u32, u8)]) -> Vec<FreePart> {
    match check(mesh, &Dofs::new(mesh.nodes().len(), fixed.iter().copied())) {
        Ok(()) => Vec::new(),
        Err(LinearError::FreeParts { parts, .. }) => parts,
        Err(error) => panic!("{error}"),
    }
}

fn motions(mesh: &TetMesh, fixed: &[(u32, u8)]) -> Vec<String> {
    free(mesh, fixed)
        .iter()
        .flat_map(|part| &part.motions)
        .map(Motion::to_string)
        .collect()
}

/// Returns every axis of some nodes.
fn all(nodes: &[u32]) -> Vec<(u32, u8)> {
    nodes
        .iter()
        .flat_map(|node| [0, 1, 2].map(|axis| (*node, axis)))
        .collect()
}

/// Returns the unit cube with corners numbered x first, moved by `shift`.
fn cube(shift: f64) -> TetMesh {
    TetMesh::over_box([shift; 3], [shift + 1.0; 3], 8).unwrap()
}

#[test]
fn a_free_body_has_six_motions() {
    let mesh = cube(9.5);
    let parts = free(&mesh, &[]);
    assert_eq!(parts.len(), 1);
    assert_eq!((parts[0].nodes, parts[0].example, &parts[0].regions), (8, 0, &vec![0]));
    let expected = [
        "rotation about the line through (10.00, 10.00, 10.00) along x",
        "rotation about the line through (10.00, 10.00, 10.00) along y",
        "rotation about the line through (10.00, 10.00, 10.00) along z",
        "translation along x",
        "translation along y",
        "translation along z",
    ];
    assert_eq!(motions(&mesh, &[]), expected);
    let error = check(&mesh, &Dofs::new(8, [])).unwrap_err().to_string();
    assert!(
        error.contains(
            "a part of the mesh: region 0 (8 nodes, 0.001 ml, node 0), any translation or rotation; fix nodes of it"
        ),
        "{error}"
    );
}

#[test]
fn one_fixed_node_leaves_three_rotations_about_it() {
    let expected = [
        "rotation about the line through (2.500, 2.000, 2.000) along x",
        "rotation about the line through (3.000, 2.500, 2.000) along y",
        "rotation about the line through (3.000, 2.000, 2.500) along z",
    ];
    assert_eq!(motions(&cube(2.0), &all(&[1])), expected);
}

#[test]
fn fixed_nodes_on_a_line_leave_a_rotation_about_it() {
    assert_eq!(
        motions(&cube(0.0), &all(&[0, 2])),
        ["rotation about the line through (0, 0.5000, 0) along y"]
    );
    let about = motions(&cube(0.0), &all(&[0, 7]));
    assert_eq!(
        about,
        ["rotation about the line through (0.5000, 0.5000, 0.5000) along (0.577, 0.577, 0.577)"]
    );
    let far = motions(&cube(1e5), &all(&[0, 7]));
    assert_eq!(far.len(), 1, "{far:?}");
}

#[test]
fn three_fixed_nodes_or_six_fixed_axes_hold_a_body() {
    assert_eq!(motions(&cube(0.0), &all(&[0, 1, 2])), [""; 0]);
    // Three of one corner, two of a second, one of a third: the minimal support.
    let six = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
    assert_eq!(motions(&cube(0.0), &six), [""; 0]);
    for left_out in 0..6 {
        let mut five = six.to_vec();
        five.remove(left_out);
        assert_eq!(motions(&cube(0.0), &five).len(), 1, "{left_out}");
    }
}

#[test]
fn sliding_bottoms_leave_plane_motion() {
    let bottom: Vec<_> = [0, 1, 2, 3].map(|node| (node, 2)).to_vec();
    let expected = [
        "rotation about the line through (0.5000, 0.5000, 0.5000) along z",
        "translation along x",
        "translation along y",
    ];
    assert_eq!(motions(&cube(0.0), &bottom), expected);
}

/// Returns two cubes of eight nodes, the second moved by `shift`, in regions 1 and 2.
fn pair(shift: [f64; 3]) -> TetMesh {
    let first_cube = cube(0.0);
    let mut nodes = first_cube.nodes().to_vec();
    nodes.extend(
        first_cube
            .nodes()
            .iter()
            .map(|node| -> [f64; 3] { std::array::from_fn(|k| node[k] + shift[k]) }),
    );
    let mut elements = first_cube.elements().to_vec();
    elements.extend(first_cube.elements().iter().map(|corners| corners.map(|node| node + 8)));
    let regions = [vec![1; 6], vec![2; 6]].concat();
    // Coincident nodes are merged; the remaining duplicates belong to no element.
    let merged = |node: u32| {
        nodes
            .iter()
            .position(|position| *position == nodes[node as usize])
            .unwrap() as u32
    };
    let elements = elements.iter().map(|corners| corners.map(merged)).collect();
    TetMesh::new(nodes, elements, regions).unwrap()
}

#[test]
fn a_part_that_floats_is_named() {
    let mesh = pair([5.0, 0.0, 0.0]);
    let parts = free(&mesh, &all(&[0, 1, 2]));
    assert_eq!(parts.len(), 1);
    assert_eq!((parts[0].nodes, parts[0].example, parts[0].motions.len()), (8, 8, 6));
    assert_eq!(parts[0].regions, [2]);
    assert_eq!(free(&mesh, &[]).len(), 2);
    assert!(free(&mesh, &all(&[0, 1, 2, 8, 9, 10])).is_empty());
}

/// Returns the motions of a pair with merged coincident nodes, the given nodes and the duplicates fixed.
fn hinged(shift: [f64; 3], fixed: &[u32]) -> Vec<String> {
    let mesh = pair(shift);
    let used = |node: &u32| mesh.elements().iter().flatten().any(|corner| corner == node);
    let left_over: Vec<u32> = (0..16).filter(|node| !used(node)).collect();
    motions(&mesh, &all(&[fixed, &left_over].concat()))
}

#[test]
fn a_hinge_turns() {
    // Hinged along one edge: nodes 7 and 5 of the first are 8 and 10 of the second.
    let edge = hinged([1.0, 0.0, 1.0], &[0, 1, 2]);
    assert_eq!(edge, ["rotation about the line through (1.000, 0.500, 1.000) along y"]);
    let point = hinged([1.0; 3], &[0, 1, 2]);
    assert_eq!(point.len(), 3);
    assert!(point[0].contains("through (1.500, 1.000, 1.000)"), "{point:?}");
    assert_eq!(
        hinged([1.0, 0.0, 0.0], &[0, 1, 2]),
        [""; 0],
        "a shared face makes one part"
    );
    // Fixing a node beyond the hinge closes it.
    assert_eq!(hinged([1.0, 0.0, 1.0], &[0, 1, 2, 15]), [""; 0]);
}

#[test]
fn hinged_parts_can_hold_each_other() {
    // Each part alone turns about its fixed edge; the hinge between them, in another direction, stops both.
    let mesh = pair([1.0; 3]);
    let left_over = all(&[8]);
    let one_edge_each: Vec<_> = [all(&[0, 2]), all(&[9, 11]), left_over.clone()].concat();
    assert!(free(&mesh, &one_edge_each).is_empty());
    let one_node_each: Vec<_> = [all(&[0, 15]), left_over].concat();
    let parts = free(&mesh, &one_node_each);
    assert_eq!(parts.len(), 2, "{parts:?}");
}

#[test]
fn nodes_of_no_element_are_numbered() {
    let mut nodes = cube(0.0).nodes().to_vec();
    nodes.extend([[4.0; 3]; 12]);
    let mesh = TetMesh::new(nodes, cube(0.0).elements().to_vec(), vec![0; 6]).unwrap();
    let error = check(&mesh, &Dofs::new(20, all(&[0, 1, 2, 9, 11]))).unwrap_err();
    assert_eq!(
        error,
        LinearError::LooseNodes {
            nodes: vec![8, 10, 12, 13, 14, 15, 16, 17, 18, 19]
        }
    );
    let text = error.to_string();
    assert!(text.contains("8, 10, 12, 13, 14, 15, 16, 17, and 2 more"), "{text}");
    let fixed_nodes: Vec<u32> = (8..20).collect();
    assert_eq!(
        check(&mesh, &Dofs::new(20, [all(&[0, 1, 2]), all(&fixed_nodes)].concat())),
        Ok(())
    );
}
