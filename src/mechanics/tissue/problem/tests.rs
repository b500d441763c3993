use super::*;
use crate::tissue::material::Material;

fn mesh() -> TetMesh {
    TetMesh::over_box([0.0; 3], [3.0, 2.0, 2.0], 36).unwrap()
}

fn problem(mesh: &TetMesh) -> StaticProblem<'_> {
    let bottom = (0..mesh.nodes().len() as u32).filter(|node| mesh.nodes()[*node as usize][2] == 0.0);
    let fix = |node| {
        [0, 1, 2].map(|axis| Fix {
            node,
            axis,
            displacement_mm: 0.0,
        })
    };
    StaticProblem {
        mesh,
        materials: Materials::uniform(Material::new(5.0, 0.4).unwrap()),
        fixes: bottom.flat_map(fix).collect(),
        loads: vec![Load {
            node: 35,
            force_n: [0.0, 1e-3, -2e-3],
        }],
    }
}

#[test]
fn reactions_balance_loads() {
    let mesh = mesh();
    let mut problem = problem(&mesh);
    // A load on a fixed node goes directly into its reaction; two on one node add up.
    problem.loads.extend([
        Load {
            node: 0,
            force_n: [1e-3; 3],
        },
        Load {
            node: 35,
            force_n: [2e-3; 3],
        },
    ]);
    let solution = problem.solve().unwrap();
    assert!(solution.residual < 1e-15);
    assert_eq!(solution.reactions.len(), problem.fixes.len());
    for axis in 0..3 {
        let sum = |values: &mut dyn Iterator<Item = f64>| values.sum::<f64>();
        let reactions = sum(&mut solution
            .reactions
            .iter()
            .filter(|r| r.axis as usize == axis)
            .map(|r| r.force_n));
        let loads = sum(&mut problem.loads.iter().map(|load| load.force_n[axis]));
        assert!((reactions + loads).abs() < 1e-12 * 5e-3, "{axis}: {reactions} {loads}");
    }
}

#[test]
fn prescribed_displacements_are_kept() {
    let mesh = mesh();
    let mut problem = problem(&mesh);
    problem.fixes.push(Fix {
        node: 35,
        axis: 2,
        displacement_mm: -0.25,
    });
    problem.fixes.push(Fix {
        node: 35,
        axis: 2,
        displacement_mm: -0.25,
    });
    let solution = problem.solve().unwrap();
    assert_eq!(solution.displacement_mm[35][2], -0.25);
    assert!(solution.displacement_mm[34][2] < 0.0);
    problem.fixes = (0..36)
        .flat_map(|node| {
            [0, 1, 2].map(|axis| Fix {
                node,
                axis,
                displacement_mm: 0.5,
            })
        })
        .collect();
    let solution = problem.solve().unwrap();
    assert_eq!(solution.displacement_mm, vec![[0.5; 3]; 36]);
}

fn failure(change: impl FnOnce(&mut StaticProblem)) -> String {
    let mesh = mesh();
    let mut problem = problem(&mesh);
    change(&mut problem);
    problem.solve().unwrap_err().to_string()
}

#[test]
fn what_is_wrong_is_named() {
    let fix = |node, axis, displacement_mm| Fix {
        node,
        axis,
        displacement_mm,
    };
    let text = failure(|p| p.fixes.push(fix(36, 0, 0.0)));
    assert_eq!(
        text,
        "a fix names node 36, but there are only 36 nodes (numbered from 0)"
    );
    let text = failure(|p| {
        p.loads.push(Load {
            node: 99,
            force_n: [0.0; 3],
        })
    });
    assert_eq!(
        text,
        "a load names node 99, but there are only 36 nodes (numbered from 0)"
    );
    let text = failure(|p| p.fixes.push(fix(3, 1, 0.5)));
    assert_eq!(text, "node 3 is fixed at both 0 mm and 0.5 mm along y");
    let text = failure(|p| p.fixes.push(fix(3, 3, 0.5)));
    assert_eq!(text, "a fix of node 3 names axis 3; axes are 0, 1 and 2");
    let text = failure(|p| p.fixes.push(fix(30, 1, f64::NAN)));
    assert_eq!(text, "the displacement of node 30 is NaN; expected a finite number");
    let text = failure(|p| {
        p.loads.push(Load {
            node: 9,
            force_n: [0.0, f64::INFINITY, 0.0],
        })
    });
    assert_eq!(text, "the force of node 9 is inf; expected a finite number");
    let text = failure(|p| p.fixes.clear());
    assert!(
        text.contains("rigid motion free") && text.contains("any translation or rotation"),
        "{text}"
    );
    let text = failure(|p| p.materials = Materials::new(None, &[]).unwrap());
    assert!(text.contains("no material for region 0"), "{text}");
    let text = failure(|p| {
        p.loads = vec![Load {
            node: 35,
            force_n: [1e308; 3],
        }]
    });
    assert!(text.contains("no finite numbers"), "{text}");
}

#[test]
fn an_unusable_element_comes_before_the_motion_it_leaves() {
    let nodes = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.5, 0.5, 0.0]];
    let mesh = TetMesh::new(nodes, vec![[0, 1, 2, 3]], vec![0]).unwrap();
    let mut problem = problem(&mesh);
    problem.fixes.clear();
    problem.loads.clear();
    let error = problem.solve().unwrap_err();
    assert!(
        error
            .to_string()
            .starts_with("tetrahedron 0 (nodes [0, 1, 2, 3]): it is flat"),
        "{error}"
    );
}
