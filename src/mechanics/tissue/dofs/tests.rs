use super::*;

#[test]
fn free_degrees_are_numbered_by_node_and_axis() {
    let dofs = Dofs::new(3, [(1, 0), (1, 2), (0, 1), (1, 0)]);
    assert_eq!((dofs.nodes(), dofs.free()), (3, 6));
    assert_eq!(dofs.of(0), [0, NO_DOF, 1]);
    assert_eq!(dofs.of(1), [NO_DOF, 2, NO_DOF]);
    assert_eq!(dofs.of(2), [3, 4, 5]);
    for dof in 0..6 {
        let (node, axis) = dofs.node_of(dof);
        assert_eq!(dofs.of(node)[axis as usize], dof);
    }
    assert_eq!(dofs.prescribed().collect::<Vec<_>>(), [(0, 1), (1, 0), (1, 2)]);
}

#[test]
fn scattering_undoes_gathering() {
    let dofs = Dofs::new(2, [(0, 0), (1, 1)]);
    let nodal = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]];
    assert_eq!(dofs.gather(&nodal), [2.0, 3.0, 4.0, 6.0]);
    let mut back = [[0.5; 3]; 2];
    dofs.scatter(&dofs.gather(&nodal), &mut back);
    assert_eq!(back, [[0.5, 2.0, 3.0], [4.0, 0.5, 6.0]]);
}
