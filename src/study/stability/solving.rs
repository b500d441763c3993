//! Cases of elements, solvers and the dense inverse.

mod elements;
mod inverse;
mod manufactured;

use super::{Group, HardCase};

/// Group of solver cases.
pub(crate) const GROUP: Group = Group {
    name: "Elements, solvers, inverse",
    cases: &[
        HardCase {
            name: "patch test",
            criterion: "a linear field on irregular meshes, Jacobian condition 1 to 1e6: relative error under 100 eps x condition of K",
            covers: &["cpu f64"],
            seed: 1,
            run: elements::patch,
        },
        HardCase {
            name: "slivers",
            criterion: "a vertex moved to within 1e-1 to 1e-8 of the opposite face: backward error under 1e-12; below the quality limit \
                        refused by name",
            covers: &["cpu f64"],
            seed: 2,
            run: elements::slivers,
        },
        HardCase {
            name: "near incompressibility",
            criterion: "nu 0.49 to 0.49999: backward error under 1e-12; locking measured against the exact solution; Cholesky succeeds",
            covers: &["cpu f64"],
            seed: 3,
            run: elements::near_incompressible,
        },
        HardCase {
            name: "stiffness contrast",
            criterion: "1:1e4 and 1:1e8: backward error under 1e-12, K^-1 symmetric, global equilibrium to 1e-10, two-material bar exact \
                        to 100 eps x condition",
            covers: &["cpu f64"],
            seed: 4,
            run: elements::contrast,
        },
        HardCase {
            name: "units",
            criterion: "the same problem in 1e-3 and 1e3 times the units: results scale to 1e-10",
            covers: &["cpu f64"],
            seed: 5,
            run: inverse::units,
        },
        HardCase {
            name: "singular problems",
            criterion: "no fixed node, one, nodes on a line, a disconnected part: refused, naming the free motion and the part",
            covers: &["cpu f64"],
            seed: 6,
            run: inverse::refused,
        },
        HardCase {
            name: "order and threads",
            criterion: "nodes and elements permuted: equal to 1e-12; the same order on any number of threads: equal to the bit",
            covers: &["cpu f64"],
            seed: 7,
            run: manufactured::permuted,
        },
        HardCase {
            name: "nothing, and twice as much",
            criterion: "zero load, zero rank, no contact: exactly zero, exactly unchanged; f(2x) = 2 f(x) to the bit",
            covers: &["cpu f64", "cpu f32"],
            seed: 8,
            run: inverse::nothing_and_twice,
        },
        HardCase {
            name: "powers of four",
            criterion: "lengths and loads scaled by powers of four: equal to the bit after rescaling; by other factors to 1e-13 x condition",
            covers: &["cpu f64"],
            seed: 9,
            run: inverse::powers_of_four,
        },
        HardCase {
            name: "manufactured solution",
            criterion: "on five meshes: orders 2 in L2 and 1 in H1 within 0.15",
            covers: &["cpu f64"],
            seed: 10,
            run: manufactured::orders,
        },
        HardCase {
            name: "rigid motions",
            criterion: "norm of K r under 10 eps norm(K) norm(r)",
            covers: &["cpu f64"],
            seed: 11,
            run: elements::rigid_motions,
        },
        HardCase {
            name: "definite inverse",
            criterion: "K^-1 positive definite, its asymmetry exactly zero; smallest pivot reported",
            covers: &["cpu f64", "cpu f32"],
            seed: 12,
            run: inverse::definite,
        },
    ],
};

#[cfg(test)]
mod tests;
