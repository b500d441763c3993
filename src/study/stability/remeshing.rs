//! Cases of remeshing.

mod accuracy;
mod moves;

use super::{Group, HardCase};

/// Group of remeshing cases.
pub(crate) const GROUP: Group = Group {
    name: "Remeshing",
    cases: &[
        HardCase {
            name: "many remeshes, exact level",
            criterion: "1 to 5,000 remeshes, nu 0.45, 0.499, 0.4999: error under 1e-11 (in f32: as many roundings) of a rebuilt K^-1, \
                        scaled by condition",
            covers: &["cpu f64", "cpu f32"],
            seed: 21,
            run: accuracy::exact,
        },
        HardCase {
            name: "many remeshes, level I",
            criterion: "1 to 5,000 remeshes: error under 1e-11, scaled as for the exact level; the sampled residual triggers a \
                        refresh before it passes its tolerance, and is reported where a refresh cannot meet the tolerance",
            covers: &["cpu f64", "cpu f32"],
            seed: 22,
            run: accuracy::first,
        },
        HardCase {
            name: "many remeshes, levels II, III",
            criterion: "1 to 5,000 remeshes: error of K^c bounded and reported, K^c stays positive definite or is refreshed, never NaN",
            covers: &["cpu f64", "cpu f32"],
            seed: 23,
            run: accuracy::lower,
        },
        HardCase {
            name: "levels on every GPU",
            criterion: "10 moves: K^c within condition x f32 epsilon of the same level in f64; 1,000 moves: never NaN",
            covers: &["every GPU, f32"],
            seed: 32,
            run: accuracy::all,
        },
        HardCase {
            name: "out and back",
            criterion: "1,000 times: exact level back bit for bit with |S| = 0; level I within 1e-11 at nu 0.45 in f64, scaled by \
                        condition and rounding elsewhere",
            covers: &["cpu f64", "cpu f32"],
            seed: 24,
            run: moves::out_and_back,
        },
        HardCase {
            name: "moves that spoil an element",
            criterion: "inverted or flattened: refused, another corner taken, or an error; state unchanged",
            covers: &["cpu f64", "cpu f32"],
            seed: 25,
            run: moves::spoiling,
        },
        HardCase {
            name: "near singular capacitance",
            criterion: "a node moved almost onto a face: condition estimated, refused past a stated limit, no silent loss",
            covers: &["cpu f64"],
            seed: 26,
            run: moves::near_singular,
        },
        HardCase {
            name: "f32 against f64",
            criterion: "agree to condition x f32 epsilon; a level that cannot is refused with the reason",
            covers: &["cpu f64", "cpu f32"],
            seed: 27,
            run: accuracy::single_and_double,
        },
        HardCase {
            name: "where the tip is",
            criterion: "on a vertex, an edge, a face, outside, in a gap between parts: a defined choice, the same every time",
            covers: &["cpu f64", "cpu f32"],
            seed: 28,
            run: moves::places,
        },
        HardCase {
            name: "moves that overlap",
            criterion: "two neighbouring nodes, the same node twice, every node of an element: equal to a rebuilt inverse",
            covers: &["cpu f64", "cpu f32"],
            seed: 29,
            run: moves::overlapping,
        },
    ],
};
