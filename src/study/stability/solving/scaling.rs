//! Cases of scaled units, doubled loads and empty input.

use faer::Mat;

use super::problem::{Problem, moved};
use crate::mechanics::tissue::factor::Factor;
use crate::mechanics::tissue::inverse::invert;
use crate::mechanics::tissue::symmetric::{Scalar, Symmetric};
use crate::study::stability::record::{Record, Unexpected, relative};

/// Returns the problem with all lengths times `length` and all forces times `force`.
fn scaled(problem: &Problem, length: f64, force: f64) -> Result<Problem, Unexpected> {
    let mut other = problem.clone();
    other.mesh = moved(&problem.mesh, |_, p| p.map(|x| x * length))?;
    other
        .loads
        .iter_mut()
        .for_each(|load| load.force_n = load.force_n.map(|f| f * force));
    Ok(other)
}

/// Returns displacements of the scaled problem in the original units: stiffness is proportional to length.
fn rescaled(problem: &Problem, length: f64, force: f64) -> Result<Vec<f64>, Unexpected> {
    let found = scaled(problem, length, force)?.solve()?.displacement_mm;
    Ok(found.as_flattened().iter().map(|u| u * (length / force)).collect())
}

/// Solves in metres and in micrometres.
pub fn units(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let problem = Problem::block(record, 0.45)?;
    let first = problem.solve()?.displacement_mm;
    for unit in [1e-3, 1e3] {
        // Stresses are unchanged: forces scale with the square of the length.
        let found = rescaled(&problem, unit, unit * unit)?;
        let error = relative(&found, first.as_flattened());
        record.under(format!("difference in {unit:e} times the units"), error, 1e-10);
        let soft = scaled_stiffness(&problem, unit)?;
        record.under(
            format!("difference at {unit:e} times the stiffness"),
            relative(&soft, first.as_flattened()),
            1e-10,
        );
    }
    Ok(())
}

/// Returns displacements with all moduli and forces times `factor`, which should be unchanged.
fn scaled_stiffness(problem: &Problem, factor: f64) -> Result<Vec<f64>, Unexpected> {
    use crate::mechanics::tissue::material::{Material, Materials};
    let mut other = scaled(problem, 1.0, factor)?;
    other.materials = Materials::uniform(Material::new(10.0 * factor, 0.45)?);
    Ok(other.solve()?.displacement_mm.as_flattened().to_vec())
}

/// Scales by powers of four, for which lengths, volumes and the square roots of pivots scale without rounding, and by other factors.
pub fn powers_of_four(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let problem = Problem::block(record, 0.45)?;
    let first = problem.solve()?.displacement_mm;
    for (length, force) in [(4.0, 1.0), (0.25, 4.0), (1024.0, 0.0625), (4f64.powi(-6), 4f64.powi(9))] {
        let found = rescaled(&problem, length, force)?;
        let unequal = found
            .iter()
            .zip(first.as_flattened())
            .filter(|(a, b)| a.to_bits() != b.to_bits())
            .count();
        record.zero(
            format!("values that differ, lengths x {length}, loads x {force}"),
            unequal as f64,
        );
    }
    let limit = 1e-13 * problem.condition()?;
    for (length, force) in [(3.0, 1.0), (0.1, 0.7), (1e3, 1e-5), (1.0 / 7.0, 3.3)] {
        let found = rescaled(&problem, length, force)?;
        let error = relative(&found, first.as_flattened());
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
pub fn nothing_and_twice(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let mut problem = Problem::block(record, 0.45)?;
    let single = problem.solve()?;
    let doubled = scaled(&problem, 1.0, 2.0)?.solve()?;
    let flat =
        |solution: &crate::mechanics::tissue::problem::Solution| solution.displacement_mm.as_flattened().to_vec();
    let twice = flat(&single).into_iter().map(|u| 2.0 * u);
    record.zero(
        "displacements not doubled by twice the load",
        unequal(flat(&doubled), twice),
    );
    problem.loads.clear();
    let still = problem.solve()?;
    let zeros = std::iter::repeat(0.0);
    record.zero(
        "displacements of no load that are not zero",
        unequal(flat(&still), zeros.clone()),
    );
    let reactions = still.reactions.iter().map(|reaction| reaction.force_n);
    record.zero("reactions to no load that are not zero", unequal(reactions, zeros));
    let factor = Factor::new(&problem.stiffness()?)?;
    rank_zero::<f64>(record, "f64", &factor)?;
    rank_zero::<f32>(record, "f32", &factor)
}

/// Tests that updates of rank zero, and by a zero matrix, leave an inverse unchanged.
fn rank_zero<T: Scalar>(record: &mut Record<'_>, precision: &str, factor: &Factor) -> Result<(), Unexpected> {
    let inverse: Symmetric<T> = invert(factor, |_, _| {})?;
    let size = inverse.size();
    for rank in [0, 3] {
        let mut updated = inverse.clone();
        let y = Mat::from_fn(size, rank, |i, j| T::of(record.noise((i * 3 + j) as u64)));
        updated.rank_update(y.as_ref(), Mat::zeros(rank, rank).as_ref())?;
        updated.update_rows(&[0, size - 1], y.as_ref(), Mat::zeros(rank, rank).as_ref())?;
        let what = format!("inverses in {precision} changed by nothing of rank {rank}");
        record.zero(what, f64::from(updated != inverse));
    }
    Ok(())
}
