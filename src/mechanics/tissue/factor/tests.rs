use crate::tissue::error::LinearError;
use faer::Mat;

use super::*;
use crate::tissue::dofs::Dofs;
use crate::tissue::material::Material;
use insonify_mesh::TetMesh;

/// Returns the stiffness of a block of `nodes` nodes, its bottom fixed unless `loose`.
fn block(nodes: usize, loose: bool) -> Stiffness {
    let mesh = TetMesh::over_box([0.0; 3], [30.0, 20.0, 20.0], nodes).unwrap();
    let materials = vec![Material::new(5.0, 0.45).unwrap(); mesh.elements().len()];
    let bottom = (0..mesh.nodes().len() as u32).filter(|node| !loose && mesh.nodes()[*node as usize][2] == 0.0);
    let fixed = bottom.flat_map(|node| [0, 1, 2].map(|axis| (node, axis)));
    Stiffness::assemble(&mesh, &materials, &Dofs::new(mesh.nodes().len(), fixed)).unwrap()
}

fn wave(size: usize, phase: usize) -> Vec<f64> {
    (0..size).map(|i| f64::sin((i * i + phase) as f64)).collect()
}

/// Backward error that Cholesky and one refinement do not exceed (N. J. Higham, "Accuracy and Stability of Numerical
/// Algorithms", chapters 10 and 12): a small multiple of the rounding unit, far below the bound of rows times that.
const SMALL: f64 = 1e-14;

#[test]
fn solutions_solve() {
    for nodes in [30, 1500] {
        let stiffness = block(nodes, false);
        let factor = Factor::new(&stiffness).unwrap();
        let kind = matches!(factor.symbolic.raw(), SymbolicCholeskyRaw::Supernodal(_));
        assert_eq!(kind, nodes == 1500, "one mesh for each kind of factorisation");
        let rhs = wave(factor.size(), 0);
        let (x, residual) = factor.solve_refined(&stiffness, &rhs);
        assert!(residual > 0.0 && residual < SMALL, "{residual}");
        let mut product = vec![0.0; rhs.len()];
        stiffness.multiply(&x, &mut product);
        let largest = x.iter().fold(0.0, |a: f64, x| a.max(x.abs()));
        let bound = SMALL * (stiffness.norm_inf() * largest + 1.0);
        assert!(product.iter().zip(&rhs).all(|(a, b)| (a - b).abs() <= bound));
    }
}

#[test]
fn many_right_hand_sides_are_each_one() {
    let stiffness = block(400, false);
    let factor = Factor::new(&stiffness).unwrap();
    let mut solutions = Mat::from_fn(factor.size(), 5, |i, j| wave(i + 1, j)[i]);
    factor.solve_many_in_place(solutions.as_mut());
    for j in 0..5 {
        let mut solution = wave(factor.size(), j);
        factor.solve_in_place(&mut solution);
        let largest = solution.iter().fold(0.0, |a: f64, x| a.max(x.abs()));
        assert!(
            solution
                .iter()
                .zip(solutions.col(j).iter())
                .all(|(a, b)| (a - b).abs() < 1e-12 * largest)
        );
    }
}

#[test]
fn solves_on_several_threads_give_the_same_bits() {
    let stiffness = block(400, false);
    let factor = Factor::new(&stiffness).unwrap();
    let solve = |phase| {
        let mut rhs = wave(factor.size(), phase);
        factor.solve_in_place(&mut rhs);
        rhs
    };
    let alone: Vec<_> = (0..8).map(solve).collect();
    let together: Vec<_> = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..8).map(|phase| scope.spawn(move || solve(phase))).collect();
        threads.into_iter().map(|thread| thread.join().unwrap()).collect()
    });
    assert_eq!(alone, together);
}

#[test]
fn refactoring_is_factoring() {
    let stiffness = block(200, false);
    let mut factor = Factor::new(&stiffness).unwrap();
    let before = factor.clone();
    let mesh = TetMesh::over_box([0.0; 3], [30.0, 20.0, 20.0], 200).unwrap();
    let mut nodes = mesh.nodes().to_vec();
    let top = nodes.len() - 1;
    nodes[top][2] += 1.0;
    let moved = stiffness.at_nodes(&nodes).unwrap();
    factor.refactor(&moved).unwrap();
    assert_ne!(factor.values, before.values);
    assert_eq!(factor.values, Factor::new(&moved).unwrap().values);
    factor.refactor(&stiffness).unwrap();
    assert_eq!(factor.values, before.values);
    let error = factor.refactor(&block(100, false)).unwrap_err();
    assert!(matches!(error, LinearError::Pattern { .. }), "{error}");
    assert_eq!(factor.values, before.values);
}

#[test]
fn a_matrix_that_is_not_definite_names_a_node() {
    // A node of no element has a row of zeros, and no other pivot can fail.
    for cells in [20, 1500] {
        let mesh = TetMesh::over_box([0.0; 3], [30.0, 20.0, 20.0], cells).unwrap();
        let mut nodes = mesh.nodes().to_vec();
        nodes.insert(7, [1.0; 3]);
        let moved = |node: u32| if node < 7 { node } else { node + 1 };
        let elements = mesh.elements().iter().map(|corners| corners.map(moved)).collect();
        let mesh = TetMesh::new(nodes, elements, mesh.regions().to_vec()).unwrap();
        let materials = vec![Material::new(5.0, 0.45).unwrap(); mesh.elements().len()];
        let bottom = (0..mesh.nodes().len() as u32).filter(|node| mesh.nodes()[*node as usize][2] == 0.0);
        let fixed = bottom
            .flat_map(|node| [0, 1, 2].map(|axis| (node, axis)))
            .chain([(7, 0), (7, 2)]);
        let stiffness = Stiffness::assemble(&mesh, &materials, &Dofs::new(mesh.nodes().len(), fixed)).unwrap();
        let error = Factor::new(&stiffness).unwrap_err();
        assert_eq!(error, LinearError::NotPositiveDefinite { node: 7, axis: 1 });
        assert!(error.to_string().contains("node 7, axis y"), "{error}");
    }
}

#[test]
fn a_failed_refactorisation_leaves_the_factor() {
    let stiffness = block(30, false);
    let mut factor = Factor::new(&stiffness).unwrap();
    let before = factor.values.clone();
    let mut broken = stiffness.clone();
    broken.negate();
    assert!(matches!(
        factor.refactor(&broken),
        Err(LinearError::NotPositiveDefinite { .. })
    ));
    assert_eq!(factor.values, before);
}

#[test]
fn nothing_gives_nothing() {
    let stiffness = block(30, false);
    let factor = Factor::new(&stiffness).unwrap();
    let (x, residual) = factor.solve_refined(&stiffness, &vec![0.0; factor.size()]);
    assert_eq!((x, residual), (vec![0.0; factor.size()], 0.0));
    let mesh = TetMesh::over_box([0.0; 3], [1.0; 3], 8).unwrap();
    let all_fixed = (0..8).flat_map(|node| [0, 1, 2].map(|axis| (node, axis)));
    let materials = vec![Material::new(5.0, 0.45).unwrap(); mesh.elements().len()];
    let none = Stiffness::assemble(&mesh, &materials, &Dofs::new(8, all_fixed)).unwrap();
    let factor = Factor::new(&none).unwrap();
    assert_eq!(factor.solve_refined(&none, &[]), (vec![], 0.0));
}

#[test]
fn what_is_no_number_is_seen_in_the_residual() {
    let stiffness = block(30, false);
    let factor = Factor::new(&stiffness).unwrap();
    let mut rhs = wave(factor.size(), 0);
    rhs[3] = f64::NAN;
    assert!(factor.solve_refined(&stiffness, &rhs).1.is_nan());
}
