//! Errors after one remesh and after many.

use insonify::mechanics::tissue::remesh::{Adaptation, AdaptedMesh, Level, Options, Precision};

use super::support::{contacts, error, free_nodes, gold, mesh, nth_move, part, rounding, single, source};

fn follow(mesh: AdaptedMesh, level: Level, options: Options) -> Adaptation {
    let source = source(&mesh);
    let contacts = contacts(&mesh);
    let mut adaptation = Adaptation::new(mesh, source, level, Precision::Double, options).unwrap();
    adaptation.parts().1.set_contacts(&contacts).unwrap();
    adaptation
}

fn go(adaptation: &mut Adaptation, nodes: &[u32], from: u64, to: u64) {
    for n in from..to {
        let (node, position) = nth_move(adaptation.mesh(), nodes, n);
        // Now and then a move would spoil an element.
        if adaptation.mesh().assess(node, position).is_ok() {
            adaptation.move_node(node, position).unwrap();
        }
    }
}

#[test]
fn explore() {
    for poisson in [0.45, 0.499, 0.4999] {
        for (name, every) in [("all", 1), ("track", 12)] {
            let m = mesh(poisson);
            let nodes: Vec<u32> = free_nodes(&m).into_iter().step_by(every).collect();
            for rebuild_always in [false, true] {
                let mut a = follow(
                    m.clone(),
                    Level::Exact,
                    Options {
                        rebuild_always,
                        check_every: 1,
                        rebuild_every: 0,
                        rounding_slack: 1e99,
                        ..Options::default()
                    },
                );
                let mut at = 0;
                for count in [1, 10, 100, 1000] {
                    if rebuild_always && count > 100 {
                        break;
                    }
                    go(&mut a, &nodes, at, count);
                    at = count;
                    let g = gold(a.mesh());
                    let kc = part(g.as_ref(), &contacts(a.mesh()), &contacts(a.mesh()));
                    let r = rounding(a.mesh(), g.as_ref());
                    let (me, re) = a.parts();
                    let res = re.residual(me, &[5, 300]).unwrap();
                    println!(
                        "nu {poisson} {name} rebuild {rebuild_always} n {count} away {} err {:.1e} rounding {:.1e} resid {res:.1e}",
                        me.away().len(),
                        error(re.condensed(), kc.as_ref()),
                        r
                    );
                }
            }
            for (level, prec) in [
                (Level::I, Precision::Double),
                (Level::I, Precision::Single),
                (Level::II, Precision::Double),
                (Level::III, Precision::Double),
                (Level::IV, Precision::Double),
            ] {
                let s = if prec == Precision::Double {
                    source(&m)
                } else {
                    single(&m)
                };
                let mut a = Adaptation::new(
                    m.clone(),
                    s,
                    level,
                    prec,
                    Options {
                        check_every: 0,
                        single_poisson_limit: 0.5,
                        ..Options::default()
                    },
                )
                .unwrap();
                a.parts().1.set_contacts(&contacts(&m)).unwrap();
                let mut at = 0;
                for count in [1, 10, 100, 1000] {
                    go(&mut a, &nodes, at, count);
                    at = count;
                    let g = gold(a.mesh());
                    let kc = part(g.as_ref(), &contacts(a.mesh()), &contacts(a.mesh()));
                    let (me, re) = a.parts();
                    let res = re.residual(me, &[5, 300]).unwrap();
                    println!(
                        "nu {poisson} {name} {level} {prec} n {count} err {:.1e} resid {res:.1e} state {:?}",
                        error(re.condensed(), kc.as_ref()),
                        re.state()
                    );
                }
            }
        }
    }
}
