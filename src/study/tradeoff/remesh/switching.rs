//! Contact switching: pivots in a tableau against refactorisation at every switch.

use std::sync::Arc;
use std::time::Instant;

use super::StudyError;
use super::subject::Subject;
use crate::mechanics::tissue::columns::Columns;
use crate::mechanics::tissue::condensed::{Condensed, Contact};
use crate::mechanics::tissue::dofs::NONE;
use crate::mechanics::tissue::frames::Frame;
use crate::mechanics::tissue::switching::{
    ConstraintSolver, ContactState, PIVOT_LIMIT, Pivots, Prescribed, Refactorised,
};
use crate::random::{hash3, seed_words, unit};
use crate::study::spread::Spread;
use crate::study::stability::record::largest;
use crate::study::tradeoff::{Axis, FORCE_N, Factor, Goal, Table};

/// Numbers of contacts, with three degrees of freedom each.
const CONTACTS: [usize; 3] = [20, 60, 120];
/// Number of switches, after each of which all forces are evaluated.
const SWITCHES: u32 = 300;
/// Range of the prescribed displacements, mm.
const PRESSED_MM: f64 = 1.0;
const PIVOTS: &str = "pivots";
const FACTORED: &str = "factored anew";

const FACTORS: [Factor; 2] = [
    Factor {
        key: "contacts",
        label: "contacts",
    },
    Factor {
        key: "way",
        label: "way",
    },
];

const AXES: [Axis; 4] = [
    Axis::log(
        "median_ms",
        "ms",
        "time of a switch and the forces after it (median), ms",
    ),
    Axis::log(
        "p95_ms",
        "p95 ms",
        "time of a switch and the forces after it (95th percentile), ms",
    ),
    Axis::log("error_n", "err N", "largest error of a contact's force, N"),
    Axis::linear("refused", "refused", "switches refused as dependent on others"),
];

/// Measures both methods on the contacts of one mesh, as many as fit.
pub(super) fn table(subject: &Subject) -> Result<Table, StudyError> {
    let title = format!("Contacts that switch: {SWITCHES} at random, {} nodes", subject.nodes());
    let goal = Goal::new("median_ms", "error_n", FORCE_N).choosing("contacts that switch");
    let mut table = Table::new("switching", title, &FACTORS, &AXES)
        .against("K_DD factored anew at each switch")
        .seeking(goal.each(&["contacts"]).beside(&["p95_ms"]));
    let dofs = subject.mesh.dofs();
    let free = (0..dofs.nodes() as u32).filter(|node| !dofs.of(*node).contains(&NONE));
    let free: Vec<u32> = free.collect();
    for contacts in CONTACTS.into_iter().filter(|count| 2 * count <= free.len()) {
        let chosen = free.iter().step_by(free.len() / contacts).take(contacts);
        let chosen: Vec<Contact> = chosen
            .map(|node| Contact {
                node: *node,
                frame: Frame::WORLD,
            })
            .collect();
        let mut condensed = Condensed::new();
        let mut columns = Columns::new(Arc::clone(&subject.factor), 3 * contacts);
        condensed.add(&mut columns, dofs, &chosen)?;
        let gold = follow(Refactorised::new(&condensed, PIVOT_LIMIT)?)?;
        let pivots = follow(Pivots::new(&condensed, PIVOT_LIMIT)?)?;
        let error = largest(
            pivots
                .forces_n
                .iter()
                .zip(&gold.forces_n)
                .map(|(found, expected)| found - expected),
        );
        let flag = (pivots.refused != gold.refused).then(|| "other switches are refused than expected".to_owned());
        for (way, done, error, flag) in [(FACTORED, gold, None, None), (PIVOTS, pivots, Some(error), flag)] {
            let time = Spread::of(done.times_ms);
            let values = vec![
                time.map(|time| time.median_ms),
                time.map(|time| time.p95_ms),
                error,
                Some(done.refused.len() as f64),
            ];
            table.push(vec![contacts.to_string(), way.to_owned()], values, flag);
        }
    }
    table.mark_gold("way", FACTORED);
    Ok(table)
}

/// Result of one method.
#[derive(Default)]
struct Done {
    times_ms: Vec<f64>,
    /// Forces on all contacts after each switch, N.
    forces_n: Vec<f64>,
    /// Indices of the refused switches.
    refused: Vec<u32>,
}

fn follow(mut solver: impl ConstraintSolver) -> Result<Done, StudyError> {
    let size = solver.prescribed().len();
    let (mut done, mut state) = (Done::default(), ContactState::default());
    let mut values = vec![0.0; size];
    for step in 0..SWITCHES {
        let words = hash3([step as i32, 0, 0], seed_words(1));
        let dof = words[0] as usize % size;
        let now = solver.prescribed()[dof];
        let (to, value) = match now {
            Prescribed::Force => (
                Prescribed::Displacement,
                PRESSED_MM * (2.0 * f64::from(unit(words[1])) - 1.0),
            ),
            Prescribed::Displacement => (Prescribed::Force, 0.0),
        };
        let start = Instant::now();
        let accepted = solver.switch(&[(dof, to)]).is_ok();
        if accepted {
            values[dof] = value;
        } else {
            done.refused.push(step);
        }
        solver.solve_into(&values, &mut state)?;
        done.times_ms.push(start.elapsed().as_secs_f64() * 1e3);
        done.forces_n.extend_from_slice(&state.force_n);
    }
    Ok(done)
}
