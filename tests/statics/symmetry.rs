//! Symmetric problems have symmetric answers, and turned problems turned ones.

use insonify_mechanics::tissue::problem::Load;
use insonify_mesh::TetMesh;
use nalgebra::{Rotation3, Vector3};

use super::case::{Case, distance, lattice, material, noise, shaken};

/// The lattice looks the same with two axes exchanged: so must what a press along their bisector does.
#[test]
fn exchanged_axes_exchange_the_answer() {
    let cells = 5;
    let mut case = Case::new(lattice([cells; 3], [10.0; 3]), material(5.0, 0.45));
    case.fix(&[0, 1, 2], |p| p[2] == 0.0, |_| [0.0; 3]);
    let at = |i: usize, j: usize, k: usize| {
        let place = [i, j, k].map(|i| 10.0 * i as f64 / cells as f64);
        let near = |p: &[f64; 3]| (0..3).all(|axis| (p[axis] - place[axis]).abs() < 1e-9);
        case.mesh.nodes().iter().position(near).unwrap()
    };
    let mirrored: Vec<usize> = case
        .mesh
        .nodes()
        .iter()
        .map(|p| {
            let [i, j, k] = p.map(|x| (x * cells as f64 / 10.0).round() as usize);
            at(j, i, k)
        })
        .collect();
    let load = |node: usize, force_n| Load {
        node: node as u32,
        force_n,
    };
    let loads = vec![
        load(at(3, 3, cells), [1e-3, 1e-3, -4e-3]),
        load(at(1, 4, cells), [2e-3, -1e-3, 3e-3]),
        load(at(4, 1, cells), [-1e-3, 2e-3, 3e-3]),
    ];
    case.loads = loads;
    let displacements = case.solve().displacement_mm;
    let turned: Vec<_> = mirrored
        .iter()
        .map(|&node| [displacements[node][1], displacements[node][0], displacements[node][2]])
        .collect();
    let error = distance(&displacements, &turned);
    assert!(error < case.tolerance(), "{error:.2e}");
}

#[test]
fn a_turned_problem_has_the_turned_answer() {
    let turn = Rotation3::from_scaled_axis(Vector3::new(0.7, -1.1, 0.4));
    let shift = Vector3::new(30.0, -20.0, 50.0);
    let mesh = shaken([4, 5, 4], [9.0, 10.0, 8.0], 0.15, 2);
    let bottom: Vec<u32> = (0..)
        .zip(mesh.nodes())
        .filter(|(_, p)| p[2] == 0.0)
        .map(|(node, _)| node)
        .collect();
    let solved = |place: &dyn Fn(Vector3<f64>) -> Vector3<f64>, direct: &dyn Fn(Vector3<f64>) -> Vector3<f64>| {
        let nodes = mesh.nodes().iter().map(|p| place(Vector3::from(*p)).into()).collect();
        let mesh = TetMesh::new(nodes, mesh.elements().to_vec(), mesh.regions().to_vec()).unwrap();
        let mut case = Case::new(mesh, material(5.0, 0.45));
        for &node in &bottom {
            case.fixes
                .extend([0, 1, 2].map(|axis| insonify_mechanics::tissue::problem::Fix {
                    node,
                    axis,
                    displacement_mm: 0.0,
                }));
        }
        case.loads = (0..case.mesh.nodes().len() as u32)
            .map(|node| Load {
                node,
                force_n: direct(Vector3::from_fn(|axis, _| 1e-3 * noise(9, 3 * node as usize + axis))).into(),
            })
            .collect();
        (case.solve().displacement_mm, case.tolerance())
    };
    let (displacements, tolerance) = solved(&|p| p, &|f| f);
    let (turned, _) = solved(&|p| turn * p + shift, &|f| turn * f);
    let expected: Vec<_> = displacements
        .iter()
        .map(|u| (turn * Vector3::from(*u)).into())
        .collect();
    // Positions are rounded once more in turning, to the rounding unit of the largest coordinate.
    let error = distance(&turned, &expected);
    assert!(error < 10.0 * tolerance, "{error:.2e} {tolerance:.2e}");
}
