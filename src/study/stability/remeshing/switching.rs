//! Cases of constraint switching.

use std::sync::Arc;

use crate::mechanics::tissue::columns::Columns;
use crate::mechanics::tissue::condensed::{Condensed, CondensedError, Contact};
use crate::mechanics::tissue::dofs::{Dofs, NONE};
use crate::mechanics::tissue::factor::Factor;
use crate::mechanics::tissue::frames::Frame;
use crate::mechanics::tissue::switching::{
    ConstraintSolver, PIVOT_LIMIT, Pivots, Prescribed, Refactorised, SwitchError,
};
use crate::mechanics::tissue::symmetric::Symmetric;
use crate::study::stability::record::{Record, Unexpected, largest, relative};
use crate::study::stability::solving::problem::Problem;

/// Returns K^c of contacts spread over a block, each with its own frame of axes.
fn tissue(record: &Record<'_>, contacts: usize, poisson: f64) -> Result<Condensed, Unexpected> {
    let problem = Problem::block(record, poisson)?;
    let dofs = problem.dofs();
    let free: Vec<u32> = (0..dofs.nodes() as u32)
        .filter(|node| !dofs.of(*node).contains(&NONE))
        .collect();
    let contact = |&node: &u32| -> Result<Contact, Unexpected> {
        let direction = std::array::from_fn(|axis| record.noise(u64::from(node) * 3 + axis as u64));
        Ok(Contact {
            node,
            frame: Frame::along(direction)?,
        })
    };
    let chosen = free.iter().step_by(free.len() / contacts).take(contacts);
    let chosen: Vec<Contact> = chosen.map(contact).collect::<Result<_, _>>()?;
    let factor = Arc::new(Factor::new(&problem.stiffness()?)?);
    let mut condensed = Condensed::new();
    condensed.add(&mut Columns::new(factor, 3 * contacts), &dofs, &chosen)?;
    Ok(condensed)
}

/// Switches constraints at random and periodically compares with a factorisation of K_DD.
pub fn many(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let (count, every) = record.effort().pick((1000, 50), (10_000, 100));
    for (at, poisson) in [0.45, 0.499, 0.4999].into_iter().enumerate() {
        record.done(at as f64 / 3.0);
        let condensed = tissue(record, 20, poisson)?;
        let size = condensed.size();
        let mut pivots = Pivots::new(&condensed, PIVOT_LIMIT)?;
        let mut fresh = Refactorised::new(&condensed, PIVOT_LIMIT)?;
        let (mut errors, mut refused, mut different) = (Vec::new(), 0, 0);
        for step in 0..count {
            let dof = ((record.noise(step) + 1.0) * 0.5 * size as f64) as usize % size;
            let to = match pivots.prescribed()[dof] {
                Prescribed::Force => Prescribed::Displacement,
                Prescribed::Displacement => Prescribed::Force,
            };
            let answers = [pivots.switch(&[(dof, to)]), fresh.switch(&[(dof, to)])].map(|answer| answer.is_ok());
            refused += usize::from(!answers[0]);
            different += usize::from(answers[0] != answers[1]);
            if step % every == every - 1 {
                let given: Vec<f64> = (0..size as u64).map(|i| record.noise(step << 16 | i)).collect();
                let (found, expected) = (pivots.solve(&given)?, fresh.solve(&given)?);
                errors.push(relative(&found.force_n, &expected.force_n));
                errors.push(relative(&found.displacement_mm, &expected.displacement_mm));
            }
        }
        let what = format!("{count} switches, nu {poisson}");
        record.under(
            format!("difference to a fresh factorisation, {what}"),
            largest(errors),
            1e-9,
        );
        record.zero(
            format!("switches that one way refuses and the other does not, {what}"),
            f64::from(different as u32),
        );
        record.report(format!("switches refused, {what}"), f64::from(refused as u32));
        record.report(
            format!("times the tableau was made anew, {what}"),
            pivots.refreshes() as f64,
        );
    }
    Ok(())
}

/// Returns K^c of two contacts whose first axes have the correlation 1 - gap; everything else is independent.
fn pair(gap: f64) -> Result<Condensed, Unexpected> {
    let contact = |node| Contact {
        node,
        frame: Frame::WORLD,
    };
    let mut compliance = Symmetric::<f64>::from_fn(6, |i, j| match (i, j) {
        _ if i == j => 2.0,
        (3, 0) => 2.0 * (1.0 - gap),
        _ => 0.0,
    });
    let mut condensed = Condensed::new();
    condensed.add(&mut compliance, &Dofs::new(2, []), &[contact(0), contact(1)])?;
    Ok(condensed)
}

fn ways(condensed: &Condensed) -> Result<[(&'static str, Box<dyn ConstraintSolver>); 2], Unexpected> {
    Ok([
        ("pivots", Box::new(Pivots::new(condensed, PIVOT_LIMIT)?)),
        ("a factorisation", Box::new(Refactorised::new(condensed, PIVOT_LIMIT)?)),
    ])
}

/// Prescribes displacements that are nearly or fully dependent.
pub fn dependent(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let names = |error: &SwitchError, wanted: u32, along: usize| matches!(error, SwitchError::Dependent { node, axis, .. } if (*node, *axis) == (wanted, along));
    for gap in [1e-1, 1e-3, 1e-5, 1e-6, 1e-7, 1e-9, 1e-12, 0.0] {
        // Compliance that remains beside its neighbour: 1 - (1 - gap)^2.
        let left = gap * (2.0 - gap);
        for (way, mut solver) in ways(&pair(gap)?)? {
            let what = format!("dependent to {gap:e}, by {way}");
            solver.switch(&[(0, Prescribed::Displacement)])?;
            let second = solver.switch(&[(3, Prescribed::Displacement)]);
            if left <= PIVOT_LIMIT {
                record.refused(what, second, |error| names(error, 1, 0));
                continue;
            }
            second?;
            let state = solver.solve(&[1.0, 0.0, 0.0, 1.1, 0.0, 0.0])?;
            // Closed-form solution of [2, 2r; 2r, 2] f = (1, 1.1).
            let r = 1.0 - gap;
            let expected = [(1.0 - r * 1.1) / (2.0 * left), (1.1 - r) / (2.0 * left)];
            record.report(
                format!("largest force (N), {what}"),
                largest(state.force_n.iter().copied()),
            );
            let error = relative(&[state.force_n[0], state.force_n[3]], &expected);
            // Each entry is rounded once; the condition number of the pair, below 2 / left, amplifies this.
            record.under(format!("error of the forces, {what}"), error, 4.0 * f64::EPSILON / left);
        }
    }
    fixed(record, names)
}

/// Places contacts on nodes that are fixed along all axes or one.
fn fixed(record: &mut Record<'_>, names: impl Fn(&SwitchError, u32, usize) -> bool) -> Result<(), Unexpected> {
    let mut problem = Problem::block(record, 0.45)?;
    problem.fix(&[2], |p| p[0] == 20.0, |_| [0.0; 3]);
    let dofs = problem.dofs();
    let factor = Arc::new(Factor::new(&problem.stiffness()?)?);
    let mut columns = Columns::new(factor, 10);
    let contact = |node| Contact {
        node,
        frame: Frame::WORLD,
    };
    let node_where = |wanted: &dyn Fn([u32; 3]) -> bool| {
        let node = (0..dofs.nodes() as u32).find(|node| wanted(dofs.of(*node)));
        node.ok_or_else(|| Unexpected::new("no such node"))
    };
    let held = node_where(&|of| of == [NONE; 3])?;
    let sliding = node_where(&|of| of[2] == NONE && of[0] != NONE)?;
    let refused = Condensed::new().add(&mut columns, &dofs, &[contact(held)]);
    record.refused(
        "a contact on a fixed node",
        refused,
        |error| matches!(error, CondensedError::Fixed { node } if *node == held),
    );
    let mut condensed = Condensed::new();
    condensed.add(&mut columns, &dofs, &[contact(sliding)])?;
    for (way, mut solver) in ways(&condensed)? {
        let answer = solver.switch(&[(2, Prescribed::Displacement)]);
        record.refused(
            format!("a displacement along a fixed axis, by {way}"),
            answer,
            |error| names(error, sliding, 2),
        );
        let state = solver.solve(&[0.1, -0.2, 5.0])?;
        record.zero(
            format!("yielding along a fixed axis (mm), by {way}"),
            state.displacement_mm[2],
        );
        let values = state.force_n.iter().chain(&state.displacement_mm).copied();
        record.report(
            format!("largest value under a press on a fixed axis, by {way}"),
            largest(values),
        );
    }
    Ok(())
}
