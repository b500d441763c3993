//! Cases of contact, needle and time stepping.

mod anatomy;
mod extremes;
mod motion;

use super::{Group, HardCase};

/// Group of contact cases.
pub(crate) const GROUP: Group = Group {
    name: "Contact, needle, time",
    cases: &[
        HardCase {
            name: "reversal at every step",
            criterion: "1e4 steps: forces inside Coulomb's bound to 4e-7 of it, dissipation never negative, states settle when \
                        motion stops",
            covers: &["finite elements", "masses and springs"],
            seed: 61,
            run: motion::chatter,
        },
        HardCase {
            name: "switches as dt falls",
            criterion: "a needle that swings, dt from 1e-2 to 1e-4 s: each contact changes its state no more often than the needle turns",
            covers: &["finite elements"],
            seed: 62,
            run: motion::switches,
        },
        HardCase {
            name: "a block on a belt",
            criterion: "static over sliding friction above 1: period (Fs - Fd)/(k v), to a step",
            covers: &["finite elements"],
            seed: 63,
            run: motion::period,
        },
        HardCase {
            name: "soft and stiff",
            criterion: "needle 1e3 times stiffer and softer, tissue 0.1 kPa to 1 MPa: converged or reported, no growth over 1e4 steps",
            covers: &["finite elements"],
            seed: 64,
            run: extremes::contrasts,
        },
        HardCase {
            name: "a needle bent by 60 degrees",
            criterion: "converged or reported, finite, back at rest when it is out",
            covers: &["finite elements"],
            seed: 65,
            run: extremes::bent_far,
        },
        HardCase {
            name: "base moved 50 mm in a step",
            criterion: "sub-stepped, converged or reported, no element passed unseen: as many contacts as in small steps, to one",
            covers: &["finite elements", "masses and springs"],
            seed: 66,
            run: extremes::large_step,
        },
        HardCase {
            name: "in and out",
            criterion: "1,000 times: the trace of the last equals that of the second to 1e-6 N; no force, displacement, contact or \
                        memory left",
            covers: &["finite elements", "masses and springs"],
            seed: 67,
            run: motion::many,
        },
        HardCase {
            name: "steps of any length",
            criterion: "1e-5 to 0.1 s, tissue 1e4 times as stiff: bounded, and the limit of explicit steps kept",
            covers: &["masses and springs"],
            seed: 68,
            run: motion::any_length,
        },
        HardCase {
            name: "bone",
            criterion: "hit at 1 mm and 10 mm a step: force at its limit, penetration no deeper than stated",
            covers: &["finite elements", "masses and springs"],
            seed: 69,
            run: anatomy::hit,
        },
        HardCase {
            name: "a probe that crushes tissue",
            criterion: "inverted elements detected and reported, everything finite, undone when it is drawn back",
            covers: &["finite elements"],
            seed: 70,
            run: extremes::crushed,
        },
        HardCase {
            name: "insertions moved far away",
            criterion: "in and partly out 1e5 mm from the origin on each axis: contacts, remeshes and events of the same steps, tip, tissue \
                        and forces off by what rounding of the places adds up to, and, where a step took other iterations, their tolerance",
            covers: &["finite elements", "masses and springs"],
            seed: 71,
            run: extremes::moved_far,
        },
        HardCase {
            name: "a layer of a tenth of an element",
            criterion: "1 mm in cells of 10 mm: broken once, where it lies to 0.15 mm, at its force to 0.1 N",
            covers: &["finite elements"],
            seed: 72,
            run: anatomy::thin_layer,
        },
        HardCase {
            name: "a path along an interface",
            criterion: "0 and 0.5 degrees: no more crossings than one in 0.5 mm, no force beyond that of the tougher side",
            covers: &["finite elements"],
            seed: 73,
            run: anatomy::interface,
        },
        HardCase {
            name: "oblique entry",
            criterion: "30 degrees to the skin: met where it lies, no force beyond puncture and friction",
            covers: &["finite elements", "masses and springs"],
            seed: 74,
            run: anatomy::oblique,
        },
        HardCase {
            name: "bone at a grazing angle",
            criterion: "5 degrees: met once, force at its limit, no deeper than stated",
            covers: &["finite elements", "masses and springs"],
            seed: 75,
            run: anatomy::grazed_bone,
        },
        HardCase {
            name: "a tip that trembles at a border",
            criterion: "0.05 mm, 1,000 steps: nothing crossed or broken again, no force beyond cutting",
            covers: &["finite elements"],
            seed: 76,
            run: anatomy::wandering,
        },
    ],
};
