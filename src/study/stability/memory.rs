//! Cases of fading memory, and of stiffening at a knee.

mod crossing;
mod history;

use super::case::{Case, Group};

/// Group of fading-memory cases.
pub const GROUP: Group = Group {
    name: "Fading memory",
    cases: &[
        Case {
            name: "equal steps",
            criterion: "k = 0, 1e-3, 0.1, 0.5, 0.999, 1 over 1e5 steps: within 1e-6 of the exact integrals of t^p and of a sine under the \
                        trapezoid and the exponentials, bounded by 1e-3 under the rules of order 1",
            covers: &["cpu f64"],
            seed: 81,
            run: history::equal,
        },
        Case {
            name: "steps from 1e-6 to 1e3 s",
            criterion: "the same orders in one history of 1e5 steps that grow from 1e-6 to 1e3 s: within 1e-6 of the exact integrals",
            covers: &["cpu f64"],
            seed: 82,
            run: history::growing,
        },
        Case {
            name: "steps that jump by 1e9",
            criterion: "1e-6 and 1e3 s in turn and at random: what is linear in time stays within 1e-9 of its exact integral",
            covers: &["cpu f64"],
            seed: 83,
            run: history::jumping,
        },
        Case {
            name: "reversals at every step",
            criterion: "1e5 steps of +1 and -1: the integral never above 1.13 h^k, the derivative never above 4 h^-k: no growth",
            covers: &["cpu f64"],
            seed: 84,
            run: history::reversals,
        },
        Case {
            name: "wrong histories",
            criterion: "orders outside 0 to 1, steps that are none, unequal steps under Gruenwald and Letnikov, values that are not finite, \
                        times outside a span: refused by name, the history as before",
            covers: &["cpu f64"],
            seed: 85,
            run: history::refused,
        },
        Case {
            name: "knee crossed at every step",
            criterion: "both structures, stiffening 0.1 to 1e6: Newton converges within 30 iterations, strains finite, and stresses come \
                        back from them",
            covers: &["cpu f64"],
            seed: 86,
            run: crossing::crossing,
        },
    ],
};
