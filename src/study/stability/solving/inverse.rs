//! Cases of the dense inverse, of scaling, and of singular systems.

use faer::Mat;

use crate::stability::fixtures::{Problem, lattice, moved, two_parts};
use crate::stability::record::{Record, Unexpected, largest, relative};
use insonify_mechanics::tissue::error::LinearError;
use insonify_mechanics::tissue::factor::{Factor, pivots};
use insonify_mechanics::tissue::inverse::{invert, sampled_residual};
use insonify_mechanics::tissue::material::Material;
use insonify_mechanics::tissue::rigid::Motion;
use insonify_mechanics::tissue::symmetric::{Scalar, Symmetric};
use insonify_mesh::TetMesh;

/// Tests definiteness and symmetry of K^-1 in both precisions.
pub(super) fn definite(record: &mut Record<'_>) -> Result<(), Unexpected> {
    for poisson in [0.45, 0.499, 0.4999] {
        let problem = Problem::block(record, poisson)?;
        let stiffness = problem.stiffness()?;
        let factor = Factor::new(&stiffness)?;
        let mut double: Symmetric<f64> = invert(&factor, &mut |_, _| {})?;
        measure(record, &format!("f64, nu {poisson}"), &double);
        let size = double.size();
        let residual = sampled_residual(&stiffness, &mut double, &[0, size / 2, size - 1])?;
        record.report(format!("|K X e - e|, nu {poisson}"), residual);
        let single: Symmetric<f32> = invert(&factor, &mut |_, _| {})?;
        measure(record, &format!("f32, nu {poisson}"), &single);
    }
    Ok(())
}

fn measure<T: Scalar>(record: &mut Record<'_>, subject: &str, inverse: &Symmetric<T>) {
    let size = inverse.size();
    let mut columns = vec![vec![T::of(0.0); size]; size];
    let unread = columns
        .iter_mut()
        .enumerate()
        .filter_map(|(j, column)| inverse.column_into(j, column).err());
    record.zero(format!("columns that cannot be read, {subject}"), unread.count() as f64);
    let pairs = (0..size).flat_map(|i| (0..i).map(move |j| (i, j)));
    let asymmetry = largest(pairs.map(|(i, j)| columns[i][j].wide() - columns[j][i].wide()));
    record.zero(format!("asymmetry, {subject}"), asymmetry);
    // Stored entries, factorised in f64.
    let entries = Mat::from_fn(size, size, |i, j| inverse.get(i, j).wide());
    let pivots = pivots(entries.as_ref());
    record.zero(format!("not positive definite, {subject}"), f64::from(pivots.is_none()));
    if let Some(pivots) = pivots {
        let smallest = pivots.into_iter().fold(f64::INFINITY, f64::min);
        record.report(format!("smallest pivot (mm/N), {subject}"), smallest);
        record.report(
            format!("smallest pivot over the largest entry, {subject}"),
            smallest / largest(entries.col_iter().flat_map(|column| column.iter().copied())),
        );
    }
}

/// Returns the problem with all lengths times `length` and all forces times `force`.
fn scaled(problem: &Problem, length: f64, force: f64) -> Result<Problem, Unexpected> {
    let mut scaled = problem.clone();
    scaled.mesh = moved(&problem.mesh, |_, p| p.map(|x| x * length))?;
    scaled
        .loads
        .iter_mut()
        .for_each(|load| load.force_n = load.force_n.map(|f| f * force));
    Ok(scaled)
}

/// Returns displacements of the scaled problem in the original units: stiffness is proportional to length.
fn rescaled(problem: &Problem, length: f64, force: f64) -> Result<Vec<f64>, Unexpected> {
    let displacements = scaled(problem, length, force)?.solve()?.displacement_mm;
    Ok(displacements
        .as_flattened()
        .iter()
        .map(|u| u * (length / force))
        .collect())
}

/// Solves in metres and in micrometres.
pub(super) fn units(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let problem = Problem::block(record, 0.45)?;
    let exact = problem.solve()?.displacement_mm;
    for unit in [1e-3, 1e3] {
        // Stresses are unchanged: forces scale with the square of the length.
        let displacements = rescaled(&problem, unit, unit * unit)?;
        let error = relative(&displacements, exact.as_flattened());
        record.under(format!("difference in {unit:e} times the units"), error, 1e-10);
        let soft = scaled_stiffness(&problem, unit)?;
        record.under(
            format!("difference at {unit:e} times the stiffness"),
            relative(&soft, exact.as_flattened()),
            1e-10,
        );
    }
    Ok(())
}

/// Returns displacements with all moduli and forces times `factor`, which should be unchanged.
fn scaled_stiffness(problem: &Problem, factor: f64) -> Result<Vec<f64>, Unexpected> {
    use insonify_mechanics::tissue::material::{Material, Materials};
    let mut stiffer = scaled(problem, 1.0, factor)?;
    stiffer.materials = Materials::uniform(Material::new(10.0 * factor, 0.45)?);
    Ok(stiffer.solve()?.displacement_mm.as_flattened().to_vec())
}

/// Scales by powers of four, for which lengths, volumes and the square roots of pivots scale without rounding, and by
/// other factors.
pub(crate) fn powers_of_four(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let problem = Problem::block(record, 0.45)?;
    let exact = problem.solve()?.displacement_mm;
    for (length, force) in [(4.0, 1.0), (0.25, 4.0), (1024.0, 0.0625), (4f64.powi(-6), 4f64.powi(9))] {
        let displacements = rescaled(&problem, length, force)?;
        let unequal = displacements
            .iter()
            .zip(exact.as_flattened())
            .filter(|(a, b)| a.to_bits() != b.to_bits())
            .count();
        record.zero(
            format!("values that differ, lengths x {length}, loads x {force}"),
            unequal as f64,
        );
    }
    let limit = 1e-13 * problem.condition()?;
    for (length, force) in [(3.0, 1.0), (0.1, 0.7), (1e3, 1e-5), (1.0 / 7.0, 3.3)] {
        let displacements = rescaled(&problem, length, force)?;
        let error = relative(&displacements, exact.as_flattened());
        record.under(
            format!("difference, lengths x {length:.3}, loads x {force:e}"),
            error,
            limit,
        );
    }
    Ok(())
}

/// Counts the unequal values; zeros of either sign are equal.
fn unequal(a: impl IntoIterator<Item = f64>, b: impl IntoIterator<Item = f64>) -> f64 {
    a.into_iter().zip(b).filter(|(a, b)| a != b).count() as f64
}

/// Tests no load, rank zero, and doubled input.
pub(crate) fn nothing_and_twice(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let mut problem = Problem::block(record, 0.45)?;
    let single = problem.solve()?;
    let doubled = scaled(&problem, 1.0, 2.0)?.solve()?;
    let flat =
        |solution: &insonify_mechanics::tissue::problem::Solution| solution.displacement_mm.as_flattened().to_vec();
    let twice = flat(&single).into_iter().map(|u| 2.0 * u);
    record.zero(
        "displacements not doubled by twice the load",
        unequal(flat(&doubled), twice),
    );
    problem.loads.clear();
    let unloaded = problem.solve()?;
    let zeros = std::iter::repeat(0.0);
    record.zero(
        "displacements of no load that are not zero",
        unequal(flat(&unloaded), zeros.clone()),
    );
    let reactions = unloaded.reactions.iter().map(|reaction| reaction.force_n);
    record.zero("reactions to no load that are not zero", unequal(reactions, zeros));
    let factor = Factor::new(&problem.stiffness()?)?;
    rank_zero::<f64>(record, "f64", &factor)?;
    rank_zero::<f32>(record, "f32", &factor)
}

/// Tests that updates of rank zero, and by a zero matrix, leave an inverse unchanged.
fn rank_zero<T: Scalar>(record: &mut Record<'_>, precision: &str, factor: &Factor) -> Result<(), Unexpected> {
    let inverse: Symmetric<T> = invert(factor, &mut |_, _| {})?;
    let size = inverse.size();
    for rank in [0, 3] {
        let mut updated = inverse.clone();
        let y = Mat::from_fn(size, rank, |i, j| T::of(record.noise((i * 3 + j) as u64)));
        updated.rank_update(y.as_ref(), Mat::zeros(rank, rank).as_ref())?;
        updated.update_rows(&[0, size - 1], y.as_ref(), Mat::zeros(rank, rank).as_ref())?;
        let subject = format!("inverses in {precision} changed by nothing of rank {rank}");
        record.zero(subject, f64::from(updated != inverse));
    }
    Ok(())
}

/// Returns the free motions of the part with the lowest node `example`; empty if the error does not list them.
fn motions(error: &LinearError, example: u32) -> Vec<Motion> {
    match error {
        LinearError::FreeParts { parts, .. } => {
            let example_part = parts.iter().find(|example_part| example_part.example == example);
            example_part.map_or_else(Vec::new, |example_part| example_part.motions.clone())
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
pub(super) fn refused(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let material = Material::new(10.0, 0.45)?;
    let block = |is_fixed: &dyn Fn(&[f64; 3]) -> bool| -> Result<Problem, Unexpected> {
        let mut problem = Problem::new(lattice([3, 3, 3], [10.0; 3])?, material);
        problem.fix(&[0, 1, 2], is_fixed, |_| [0.0; 3]);
        problem.load_all(6);
        Ok(problem)
    };
    // Translations and rotations that supports leave to a rigid body: a fixed point leaves the three
    // rotations, a fixed line the one about itself.
    let freedom: [(&str, &dyn Fn(&[f64; 3]) -> bool, [usize; 2]); 3] = [
        ("no fixed node", &|_| false, [3, 3]),
        ("one fixed node", &|p| *p == [0.0; 3], [0, 3]),
        ("fixed nodes on a line", &|p| p[1..] == [0.0; 2], [0, 1]),
    ];
    for (name, is_fixed, expected) in freedom {
        record.refused(name, block(is_fixed)?.solve(), |error| {
            counts(&motions(error, 0)) == expected && says(error, &["node 0", "rotation"])
        });
    }
    let mut sliding = block(&|_| false)?;
    sliding.fix(&[2], |p| p[2] == 0.0, |_| [0.0; 3]);
    record.refused("a floor without friction", sliding.solve(), |error| {
        counts(&motions(error, 0)) == [2, 1] && says(error, &["translation along x", "translation along y"])
    });
    let (mesh, second) = two_parts()?;
    let mut two_parts = Problem::new(mesh, material);
    two_parts.fix(&[0, 1, 2], |p| p[2] == 0.0 && p[0] <= 10.0, |_| [0.0; 3]);
    record.refused("a disconnected part", two_parts.solve(), |error| {
        let is_first_held = motions(error, 0).is_empty();
        is_first_held
            && counts(&motions(error, second)) == [3, 3]
            && says(error, &[&format!("node {second}"), "region 2"])
    });
    let count = two_parts.mesh.nodes().len() as u32;
    let nodes = [two_parts.mesh.nodes(), &[[50.0; 3]]].concat();
    let loose = TetMesh::new(
        nodes,
        two_parts.mesh.elements().to_vec(),
        two_parts.mesh.regions().to_vec(),
    )?;
    let mut loose = Problem::new(loose, material);
    loose.fix(&[0, 1, 2], |p| p[2] == 0.0, |_| [0.0; 3]);
    record.refused(
        "a node of no element",
        loose.solve(),
        |error| matches!(error, LinearError::LooseNodes { nodes } if *nodes == [count]),
    );
    Ok(())
}
