//! Cases without a unique solution.

use super::problem::{Problem, lattice, two_parts};
use crate::mechanics::mesh::TetMesh;
use crate::mechanics::tissue::error::LinearError;
use crate::mechanics::tissue::material::Material;
use crate::mechanics::tissue::rigid::Motion;
use crate::study::stability::record::{Record, Unexpected};

/// Returns the free motions of the part with the lowest node `example`; empty if the error does not list them.
fn motions(error: &LinearError, example: u32) -> Vec<Motion> {
    match error {
        LinearError::FreeParts { parts, .. } => {
            let part = parts.iter().find(|part| part.example == example);
            part.map_or_else(Vec::new, |part| part.motions.clone())
        }
        _ => Vec::new(),
    }
}

/// Returns the numbers of translations and rotations.
fn counts(motions: &[Motion]) -> [usize; 2] {
    let rotations = motions
        .iter()
        .filter(|motion| matches!(motion, Motion::Rotation { .. }))
        .count();
    [motions.len() - rotations, rotations]
}

/// Returns whether the text of an error contains all words.
fn says(error: &LinearError, words: &[&str]) -> bool {
    let text = error.to_string();
    words.iter().all(|word| text.contains(word))
}

/// Tests bodies with too few supports.
pub fn refused(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let material = Material::new(10.0, 0.45)?;
    let block = |fixed: &dyn Fn(&[f64; 3]) -> bool| -> Result<Problem, Unexpected> {
        let mut problem = Problem::new(lattice([3, 3, 3], [10.0; 3])?, material);
        problem.fix(&[0, 1, 2], fixed, |_| [0.0; 3]);
        problem.load_all(6);
        Ok(problem)
    };
    let freedom: [(&str, &dyn Fn(&[f64; 3]) -> bool, [usize; 2]); 3] = [
        ("no fixed node", &|_| false, [3, 3]),
        ("one fixed node", &|p| *p == [0.0; 3], [0, 3]),
        ("fixed nodes on a line", &|p| p[1..] == [0.0; 2], [0, 1]),
    ];
    for (name, fixed, expected) in freedom {
        record.refused(name, block(fixed)?.solve(), |error| {
            counts(&motions(error, 0)) == expected && says(error, &["node 0", "rotation"])
        });
    }
    let mut sliding = block(&|_| false)?;
    sliding.fix(&[2], |p| p[2] == 0.0, |_| [0.0; 3]);
    record.refused("a floor without friction", sliding.solve(), |error| {
        counts(&motions(error, 0)) == [2, 1] && says(error, &["translation along x", "translation along y"])
    });
    let (mesh, second) = two_parts()?;
    let mut apart = Problem::new(mesh, material);
    apart.fix(&[0, 1, 2], |p| p[2] == 0.0 && p[0] <= 10.0, |_| [0.0; 3]);
    record.refused("a disconnected part", apart.solve(), |error| {
        let held = motions(error, 0).is_empty();
        held && counts(&motions(error, second)) == [3, 3] && says(error, &[&format!("node {second}"), "region 2"])
    });
    let count = apart.mesh.nodes().len() as u32;
    let nodes = [apart.mesh.nodes(), &[[50.0; 3]]].concat();
    let loose = TetMesh::new(nodes, apart.mesh.elements().to_vec(), apart.mesh.regions().to_vec())?;
    let mut loose = Problem::new(loose, material);
    loose.fix(&[0, 1, 2], |p| p[2] == 0.0, |_| [0.0; 3]);
    record.refused(
        "a node of no element",
        loose.solve(),
        |error| matches!(error, LinearError::LooseNodes { nodes } if *nodes == [count]),
    );
    Ok(())
}
