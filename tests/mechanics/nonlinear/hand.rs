//! Solutions by hand, and those of the linear solver.

use insonify_mechanics::tissue::material::{Material, Materials};
use insonify_mechanics::tissue::nonlinear::{Contact, NonlinearBody, Scheme, Sheet, Stiffening, Target};
use insonify_mechanics::tissue::problem::{Fix, Load, StaticProblem};
use std::sync::Arc;

use super::case::{Held, at, block_mesh, difference, held, largest, law, options, pulled, target};

const SCHEMES: [Scheme; 2] = [Scheme::Newton, Scheme::MODIFIED];

/// Strain of a bar under a stress (kPa), by bisection of E(e_r) e = stress with e_r = (1 + nu) e.
fn bar(law: &Stiffening, stress: f64) -> f64 {
    let (young, poisson) = (law.material().young_kpa(), law.material().poisson());
    let (mut low, mut high) = (0.0, stress / young);
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        let found = young * law.secant((1.0 + poisson) * middle) * middle;
        if found < stress { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

#[test]
fn a_bar_stretches_as_by_hand() {
    for poisson in [0.0, 0.3, 0.499] {
        for cells in [1, 3] {
            for scheme in SCHEMES {
                let law = law(poisson);
                let (body, rollers, unit) = pulled(cells, 6.0, law);
                let (mut solver, prescribed) = held(&body, &rollers, options(scheme));
                for stress in [0.5, 1.5, 3.0, 5.0] {
                    let loads: Vec<f64> = unit.iter().map(|f| f * stress).collect();
                    solver.step(&target(&loads, &prescribed)).unwrap();
                    let strain = bar(&law, stress);
                    for (node, p) in body.nodes().iter().enumerate() {
                        let found = &solver.displacement()[3 * node..3 * node + 3];
                        let expected = [strain * p[0], -poisson * strain * p[1], -poisson * strain * p[2]];
                        // Balance to 1e-12 times a condition of 1e4 / (1 - 2 nu).
                        let off = difference(found, &expected) / (6.0 * strain);
                        assert!(
                            off < 1e-8 / (1.0 - 2.0 * poisson),
                            "{off:e} at {stress} kPa, {poisson}, {scheme:?}"
                        );
                    }
                }
                assert!(
                    solver.body().relative_strains(solver.displacement())[0] > 0.2,
                    "not above the knee"
                );
            }
        }
    }
}

/// In simple shear e_r = sqrt(3)/2 gamma, and the traction is G(e_r) gamma. Two triangles, 3 mm thick.
#[test]
fn two_triangles_shear_as_by_hand() {
    let law = law(0.4);
    let nodes = vec![[0.0, 0.0], [5.0, 0.0], [5.0, 5.0], [0.0, 5.0]];
    let body = Arc::new(Sheet::plane_strain(nodes, vec![[0, 1, 2], [0, 2, 3]], &[law; 2], 3.0).unwrap());
    for gamma in [0.05f64, 0.2, 0.35] {
        // The upper corners are free along x, pulled by half of the traction each.
        let rollers: Held = vec![
            (0, 0, 0.0),
            (0, 1, 0.0),
            (1, 0, 0.0),
            (1, 1, 0.0),
            (2, 1, 0.0),
            (3, 1, 0.0),
        ];
        let (mut solver, prescribed) = held(&body, &rollers, options(Scheme::Newton));
        let relative = 0.75f64.sqrt() * gamma;
        let shear_kpa = 10.0 / 2.8 * (1.0 + 20.0 * (relative - 0.1).max(0.0).powi(2));
        let force = 1e-3 * shear_kpa * gamma * 5.0 * 3.0;
        let loads = [0.0, 0.0, 0.0, 0.0, force / 2.0, 0.0, force / 2.0, 0.0];
        solver.step(&target(&loads, &prescribed)).unwrap();
        let found = [solver.displacement()[4], solver.displacement()[6]];
        assert!(
            difference(&found, &[5.0 * gamma; 2]) < 1e-10,
            "{found:?} instead of {}",
            5.0 * gamma
        );
    }
}

#[test]
fn below_the_knee_it_is_the_linear_body() {
    for poisson in [0.3, 0.499] {
        let mesh = block_mesh([4, 3, 3], 2.0, 0.2);
        let body = Arc::new(NonlinearBody::tetrahedra(&mesh, &vec![law(poisson); mesh.elements().len()]).unwrap());
        let mut fixed: Held = Vec::new();
        for node in at(&body, 2, 0.0) {
            fixed.extend((0..3).map(|axis| (node, axis, 0.0)));
        }
        let driven = at(&body, 2, 6.0)[3];
        fixed.push((driven, 2, -0.05));
        let pushed = at(&body, 2, 6.0)[0];
        let force = [2e-4, 1e-4, -1e-4];
        let linear = StaticProblem {
            mesh: &mesh,
            materials: Materials::uniform(Material::new(10.0, poisson).unwrap()),
            fixes: fixed
                .iter()
                .map(|&(node, axis, displacement_mm)| Fix {
                    node,
                    axis,
                    displacement_mm,
                })
                .collect(),
            loads: vec![Load {
                node: pushed,
                force_n: force,
            }],
        };
        let linear = linear.solve().unwrap();
        let expected: Vec<f64> = linear.displacement_mm.iter().flatten().copied().collect();
        for scheme in SCHEMES {
            let (mut solver, prescribed) = held(&body, &fixed, options(scheme));
            let mut loads = vec![0.0; expected.len()];
            loads[3 * pushed as usize..][..3].copy_from_slice(&force);
            solver.step(&target(&loads, &prescribed)).unwrap();
            let strain = largest(&body.relative_strains(solver.displacement()));
            assert!(strain < 0.1, "{strain} is above the knee");
            let off = difference(solver.displacement(), &expected) / largest(&expected);
            assert!(off < 1e-8 / (1.0 - 2.0 * poisson), "{off:e}");
            for reaction in &linear.reactions {
                let found = solver.forces()[3 * reaction.node as usize + reaction.axis as usize];
                assert!((found - reaction.force_n).abs() < 1e-9, "{reaction:?}, found {found}");
            }
        }
    }
}

/// A contact on a node is that node driven, its force the reaction; between nodes it holds the point between.
#[test]
fn a_contact_is_a_driven_point() {
    let law = law(0.45);
    for scheme in SCHEMES {
        let body = super::case::sheet([6, 4], 1.0, 0.2, 2.0, law);
        let mut fixed: Held = Vec::new();
        for node in at(&body, 1, 0.0) {
            fixed.extend((0..2).map(|axis| (node, axis, 0.0)));
        }
        let top = at(&body, 1, 4.0)[3];
        let contact = |weights: Vec<(u32, f64)>| Contact {
            weights,
            place_mm: -1.0,
        };
        let (mut by_contact, none) = held(&body, &fixed, options(scheme));
        let loads = vec![0.0; 2 * body.nodes().len()];
        let on_node = contact(vec![(2 * top + 1, 1.0)]);
        let step = |contact| Target {
            loads: &loads,
            prescribed: &none,
            contact: Some(contact),
            offset: None,
        };
        by_contact.step(&step(&on_node)).unwrap();
        let mut driven = fixed.clone();
        driven.push((top, 1, -1.0));
        let (mut by_node, prescribed) = held(&body, &driven, options(scheme));
        by_node.step(&target(&loads, &prescribed)).unwrap();
        assert!(difference(by_contact.displacement(), by_node.displacement()) < 1e-9);
        let reaction = by_node.forces()[2 * top as usize + 1];
        assert!((by_contact.contact_force() / reaction - 1.0).abs() < 1e-9 && reaction < 0.0);
        let between = contact(vec![(2 * top + 1, 0.25), (2 * top + 3, 0.75)]);
        by_contact.step(&step(&between)).unwrap();
        assert!((between.along(by_contact.displacement()) + 1.0).abs() < 1e-11);
        by_contact.step(&target(&loads, &none)).unwrap();
        assert!(largest(by_contact.displacement()) < 1e-10 && by_contact.contact_force() == 0.0);
    }
}
