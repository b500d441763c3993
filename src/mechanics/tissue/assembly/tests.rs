use crate::tissue::error::LinearError;
use nalgebra::DMatrix;

use super::*;
use crate::tissue::dofs::NO_DOF;
use crate::tissue::element::{ElementStiffness, element_stiffness};

impl Stiffness {
    /// Reverses all signs, giving a matrix that no mesh has.
    pub(in crate::tissue) fn negate(&mut self) {
        self.values.iter_mut().for_each(|value| *value = -*value);
    }
}

/// Returns a small box with all materials different and some displacements prescribed.
fn example() -> (TetMesh, Vec<Material>, Dofs) {
    let mesh = TetMesh::over_box([0.0; 3], [3.0, 2.0, 2.0], 36).unwrap();
    let materials = (0..mesh.elements().len())
        .map(|e| Material::new(1.0 + e as f64, 0.3).unwrap())
        .collect();
    let dofs = Dofs::new(mesh.nodes().len(), [(0, 0), (0, 1), (0, 2), (5, 1), (17, 2)]);
    (mesh, materials, dofs)
}

/// Assembles all entries, including prescribed ones, element by element.
fn dense(mesh: &TetMesh, materials: &[Material]) -> DMatrix<f64> {
    let size = 3 * mesh.nodes().len();
    let mut matrix = DMatrix::zeros(size, size);
    for (corners, material) in mesh.elements().iter().zip(materials) {
        let positions = corners.map(|node| mesh.nodes()[node as usize]);
        let ElementStiffness(blocks) = element_stiffness(&positions, material).unwrap();
        for (a, b, i, j) in (0..144).map(|n| (n / 36, n / 9 % 4, n / 3 % 3, n % 3)) {
            matrix[(3 * corners[a] as usize + i, 3 * corners[b] as usize + j)] += blocks[a][b][i][j];
        }
    }
    matrix
}

#[test]
fn it_is_the_sum_of_the_elements_over_the_free_degrees() {
    let (mesh, materials, dofs) = example();
    let stiffness = Stiffness::assemble(&mesh, &materials, &dofs).unwrap();
    let expected = dense(&mesh, &materials);
    let full = |dof: usize| {
        let (node, axis) = dofs.node_of(dof as u32);
        3 * node as usize + axis as usize
    };
    let lower = stiffness.lower();
    let mut entries = 0;
    for column in 0..dofs.free() {
        let rows: Vec<usize> = lower.row_idx_of_col(column).collect();
        assert!(rows.is_sorted() && rows[0] == column, "column {column}: {rows:?}");
        for (row, value) in rows.into_iter().zip(lower.val_of_col(column)) {
            // The sums run over the elements in the same order.
            assert_eq!(*value, expected[(full(row), full(column))]);
            entries += 1;
        }
        let below = (column..dofs.free())
            .filter(|row| expected[(full(*row), full(column))] != 0.0)
            .count();
        assert!(lower.row_idx_of_col(column).len() >= below);
    }
    assert_eq!(entries, stiffness.pattern().row_idx().len());
}

#[test]
fn products_are_those_of_the_dense_matrix() {
    let (mesh, materials, dofs) = example();
    let stiffness = Stiffness::assemble(&mesh, &materials, &dofs).unwrap();
    let expected = dense(&mesh, &materials);
    let displacement_mm: Vec<[f64; 3]> = (0..dofs.nodes())
        .map(|n| [0, 1, 2].map(|axis| f64::sin((3 * n + axis) as f64)))
        .collect();
    let product =
        &expected * nalgebra::DVector::from_iterator(3 * dofs.nodes(), displacement_mm.iter().flatten().copied());
    // Sums of at most some hundred products.
    let bound = 500.0 * f64::EPSILON * expected.amax();
    for (force, expected) in stiffness.nodal_forces(&displacement_mm).iter().flatten().zip(&product) {
        assert!((force - expected).abs() < bound);
    }
    let mut free = displacement_mm.clone();
    dofs.prescribed()
        .for_each(|(node, axis)| free[node as usize][axis as usize] = 0.0);
    let mut y = vec![f64::NAN; dofs.free()];
    stiffness.multiply(&dofs.gather(&free), &mut y);
    for (y, force) in y.iter().zip(dofs.gather(&stiffness.nodal_forces(&free))) {
        assert!((y - force).abs() < bound);
    }
    let rows = (0..dofs.nodes() as u32).flat_map(|node| dofs.of(node).map(|dof| (node, dof)));
    let free_rows: Vec<usize> = rows
        .enumerate()
        .filter(|(_, (_, dof))| *dof != NO_DOF)
        .map(|(row, _)| row)
        .collect();
    let sum = |row: &usize| {
        free_rows
            .iter()
            .map(|column| expected[(*row, *column)].abs())
            .sum::<f64>()
    };
    let norm = free_rows.iter().map(sum).fold(0.0, f64::max);
    assert!((stiffness.norm_inf() / norm - 1.0).abs() < 1e-13);
}

#[test]
fn other_positions_keep_the_pattern() {
    let (mesh, materials, dofs) = example();
    let stiffness = Stiffness::assemble(&mesh, &materials, &dofs).unwrap();
    let mut nodes = mesh.nodes().to_vec();
    assert_eq!(stiffness.at_nodes(&nodes).unwrap().values, stiffness.values);
    nodes[20] = nodes[20].map(|x| x + 0.05);
    let moved = stiffness.at_nodes(&nodes).unwrap();
    assert_ne!(moved.values, stiffness.values);
    let mesh = TetMesh::new(nodes.clone(), mesh.elements().to_vec(), mesh.regions().to_vec()).unwrap();
    assert_eq!(
        moved.values,
        Stiffness::assemble(&mesh, &materials, &dofs).unwrap().values
    );
    nodes.pop();
    let error = moved.at_nodes(&nodes).unwrap_err();
    assert!(
        matches!(
            error,
            LinearError::Count {
                found: 35,
                expected: 36,
                ..
            }
        ),
        "{error}"
    );
}

#[test]
fn unusable_elements_are_named() {
    let (mesh, materials, dofs) = example();
    let stiffness = Stiffness::assemble(&mesh, &materials, &dofs).unwrap();
    let element = 7;
    let corners = mesh.elements()[element];
    let mut nodes = mesh.nodes().to_vec();
    // Moved through the opposite face: this element and perhaps its neighbours are inverted.
    let centre: [f64; 3] =
        std::array::from_fn(|k| corners[1..].iter().map(|n| nodes[*n as usize][k]).sum::<f64>() / 3.0);
    let tip = corners[0] as usize;
    nodes[tip] = std::array::from_fn(|k| 2.0 * centre[k] - nodes[tip][k]);
    let inverted: Vec<usize> = mesh
        .volumes(&nodes)
        .enumerate()
        .filter(|(_, v)| *v <= 1e-12)
        .map(|(e, _)| e)
        .collect();
    let error = stiffness.at_nodes(&nodes).unwrap_err();
    let LinearError::Element { element, others, .. } = &error else {
        panic!("{error}")
    };
    assert_eq!(*element, inverted[0]);
    assert_eq!(*others, inverted[1..].iter().copied().take(10).collect::<Vec<_>>());
    assert!(
        error.to_string().contains(&format!("tetrahedron {element} (nodes [")),
        "{error}"
    );
    let few = Stiffness::assemble(&mesh, &materials[1..], &dofs).unwrap_err();
    assert!(matches!(few, LinearError::Count { what: "materials", .. }));
}
