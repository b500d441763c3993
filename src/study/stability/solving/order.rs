//! Cases of node order, element order and number of threads.

use faer::Mat;

use super::problem::Problem;
use crate::mechanics::mesh::TetMesh;
use crate::mechanics::tissue::factor::Factor;
use crate::mechanics::tissue::inverse::invert;
use crate::mechanics::tissue::symmetric::Symmetric;
use crate::study::stability::record::{Record, Unexpected, relative};

/// Returns the numbers below `count` in a random order.
fn shuffled(record: &Record<'_>, count: usize, salt: u64) -> Vec<usize> {
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by(|a, b| {
        let key = |index: &usize| record.noise(salt << 32 | *index as u64);
        key(a).total_cmp(&key(b))
    });
    order
}

/// Returns the problem with its elements permuted.
fn elements_permuted(problem: &Problem, order: &[usize]) -> Result<Problem, Unexpected> {
    let mesh = &problem.mesh;
    let elements = order.iter().map(|element| mesh.elements()[*element]).collect();
    let regions = order.iter().map(|element| mesh.regions()[*element]).collect();
    Ok(Problem {
        mesh: TetMesh::new(mesh.nodes().to_vec(), elements, regions)?,
        ..problem.clone()
    })
}

/// Returns the problem with its nodes permuted: node k is node `order[k]` of the original.
fn nodes_permuted(problem: &Problem, order: &[usize]) -> Result<Problem, Unexpected> {
    let mesh = &problem.mesh;
    let mut place = vec![0; order.len()];
    order.iter().enumerate().for_each(|(at, node)| place[*node] = at as u32);
    let elements = mesh
        .elements()
        .iter()
        .map(|corners| corners.map(|node| place[node as usize]));
    let nodes = order.iter().map(|node| mesh.nodes()[*node]);
    let mut other = problem.clone();
    other.mesh = TetMesh::new(nodes.collect(), elements.collect(), mesh.regions().to_vec())?;
    other
        .fixes
        .iter_mut()
        .for_each(|fix| fix.node = place[fix.node as usize]);
    other
        .loads
        .iter_mut()
        .for_each(|load| load.node = place[load.node as usize]);
    Ok(other)
}

/// Solves the same problem in other orders and on more threads.
pub fn permuted(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let problem = Problem::block(record, 0.45)?;
    let first = problem.solve()?.displacement_mm;
    for salt in 1..4 {
        let order = shuffled(record, problem.mesh.elements().len(), salt);
        let found = elements_permuted(&problem, &order)?.solve()?.displacement_mm;
        record.under(
            format!("difference, elements in order {salt}"),
            relative(found.as_flattened(), first.as_flattened()),
            1e-12,
        );
        let order = shuffled(record, first.len(), salt);
        let found = nodes_permuted(&problem, &order)?.solve()?.displacement_mm;
        let expected: Vec<[f64; 3]> = order.iter().map(|node| first[*node]).collect();
        record.under(
            format!("difference, nodes in order {salt}"),
            relative(found.as_flattened(), expected.as_flattened()),
            1e-12,
        );
    }
    let alone = on_threads(&problem, 1)?;
    for threads in [2, 3, 8] {
        let several = on_threads(&problem, threads)?;
        record.zero(
            format!("solutions that {threads} threads change"),
            f64::from(several.0 != alone.0),
        );
        record.zero(
            format!("dense inverses that {threads} threads change"),
            f64::from(several.1 != alone.1),
        );
        record.zero(
            format!("updated inverses that {threads} threads change"),
            f64::from(several.2 != alone.2),
        );
    }
    Ok(())
}

/// Returns solution, dense inverse, and the inverse after an update of rank 48, on a number of threads.
fn on_threads(problem: &Problem, threads: usize) -> Result<(Vec<u64>, Symmetric<f64>, Symmetric<f64>), Unexpected> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
    pool.install(|| {
        let solution = problem.solve()?;
        let bits = solution.displacement_mm.as_flattened().iter().map(|u| u.to_bits());
        let inverse: Symmetric<f64> = invert(&Factor::new(&problem.stiffness()?)?, |_, _| {})?;
        let y = Mat::from_fn(inverse.size(), 48, |i, j| inverse.get(i, j));
        let c = Mat::from_fn(48, 48, |i, j| if i == j { 0.01 } else { 0.0 });
        let mut updated = inverse.clone();
        updated.rank_update(y.as_ref(), c.as_ref())?;
        Ok((bits.collect(), inverse, updated))
    })
}
