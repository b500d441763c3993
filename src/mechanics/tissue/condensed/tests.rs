use nalgebra::DMatrix;

use super::*;
use crate::mechanics::tissue::columns::Columns;
use crate::mechanics::tissue::inverse::invert;
use crate::mechanics::tissue::symmetric::Symmetric;
use crate::mechanics::tissue::testing::{Block, value};

fn contact(node: u32) -> Contact {
    let direction = std::array::from_fn(|axis| value(node as usize, axis, 5));
    Contact {
        node,
        frame: Frame::along(direction).expect("a direction"),
    }
}

fn contacts(block: &Block, count: usize) -> Vec<Contact> {
    block.free_nodes(count).into_iter().map(contact).collect()
}

fn condensed(block: &Block, inverse: &mut Symmetric<f64>, contacts: &[Contact]) -> Condensed {
    let mut condensed = Condensed::new();
    condensed.add(inverse, &block.dofs, contacts).expect("contacts");
    condensed
}

fn setup() -> (Block, Symmetric<f64>) {
    let block = Block::new(200, 0.45);
    let inverse = invert(&block.factor, |_, _| ()).expect("an inverse");
    (block, inverse)
}

fn assert_same(a: &Condensed, b: &Condensed) {
    assert_eq!(a.contacts(), b.contacts());
    assert_eq!(a.matrix(), b.matrix());
    assert_eq!(a.world, b.world);
}

#[test]
fn it_is_the_rotated_block_of_the_inverse_and_symmetric() {
    let (block, mut inverse) = setup();
    let contacts = contacts(&block, 6);
    let condensed = condensed(&block, &mut inverse, &contacts);
    let size = 18;
    assert_eq!(condensed.size(), size);
    let dofs: Vec<usize> = contacts
        .iter()
        .flat_map(|c| block.dofs.of(c.node))
        .map(|dof| dof as usize)
        .collect();
    let world = DMatrix::from_fn(size, size, |i, j| inverse.get(dofs[i], dofs[j]));
    // R is block diagonal, its columns the axes.
    let mut rotation = DMatrix::zeros(size, size);
    for (at, contact) in contacts.iter().enumerate() {
        for (axis, vector) in contact.frame.axes().iter().enumerate() {
            for k in 0..3 {
                rotation[(3 * at + k, 3 * at + axis)] = vector[k];
            }
        }
    }
    let expected = rotation.transpose() * &world * &rotation;
    let magnitude = rotation.abs().transpose() * world.abs() * rotation.abs();
    for i in 0..size {
        for j in 0..size {
            assert_eq!(condensed.matrix()[(i, j)], condensed.matrix()[(j, i)]);
            let error = (condensed.matrix()[(i, j)] - expected[(i, j)]).abs();
            // Two products of three terms on each side.
            let bound = 12.0 * f64::EPSILON * magnitude[(i, j)];
            assert!(error <= bound, "({i}, {j}): {error:e} > {bound:e}");
        }
    }
}

#[test]
fn it_gives_the_displacements_of_a_solution_for_the_whole_mesh() {
    let (block, mut inverse) = setup();
    let contacts = contacts(&block, 5);
    let condensed = condensed(&block, &mut inverse, &contacts);
    let forces: Vec<f64> = (0..15).map(|i| value(i, 0, 3)).collect();
    let mut whole = vec![0.0; block.dofs.free()];
    spread(&condensed, &forces, &mut whole);
    block.factor.solve_in_place(&mut whole);
    let mut energy = 0.0;
    for (at, contact) in contacts.iter().enumerate() {
        let world = block.dofs.of(contact.node).map(|dof| whole[dof as usize]);
        let expected = contact.frame.to_frame(world);
        for axis in 0..3 {
            let row = 3 * at + axis;
            let terms = (0..15).map(|j| condensed.matrix()[(row, j)] * forces[j]);
            let (found, magnitude) = terms.fold((0.0, 0.0), |(sum, size), t| (sum + t, size + t.abs()));
            energy += found * forces[row];
            // One solve against another: the condition of K, about 1e5 here, times eps, with room.
            assert!(
                (found - expected[axis]).abs() <= 1e-10 * magnitude,
                "{found} {}",
                expected[axis]
            );
        }
    }
    assert!(energy > 0.0);
}

#[test]
fn contacts_are_added_without_touching_the_rest() {
    let (block, mut inverse) = setup();
    let all = contacts(&block, 6);
    let whole = condensed(&block, &mut inverse, &all);
    let mut grown = condensed(&block, &mut inverse, &all[..2]);
    grown.add(&mut inverse, &block.dofs, &all[2..3]).expect("a contact");
    grown.add(&mut inverse, &block.dofs, &[]).expect("none");
    grown.add(&mut inverse, &block.dofs, &all[3..]).expect("contacts");
    assert_same(&grown, &whole);
}

#[test]
fn adding_reads_only_the_new_columns() {
    let (block, _) = setup();
    let all = contacts(&block, 6);
    let mut columns = Columns::new(block.factor.clone(), 100);
    let mut condensed = Condensed::new();
    condensed.add(&mut columns, &block.dofs, &all[..5]).expect("contacts");
    assert_eq!(columns.solved(), 15);
    columns.replace(block.factor.clone());
    condensed.add(&mut columns, &block.dofs, &all[5..]).expect("a contact");
    assert_eq!(columns.solved(), 15 + 3);
}

#[test]
fn an_axis_that_is_fixed_does_not_yield() {
    let (block, _) = setup();
    let node = block.free_nodes(3)[1];
    let dofs = Dofs::new(block.mesh.nodes().len(), block.dofs.prescribed().chain([(node, 1)]));
    let mut compliance = Symmetric::from_fn(dofs.free(), |i, j| if i == j { 2.0 } else { 0.1 });
    let mut condensed = Condensed::new();
    let contact = Contact {
        node,
        frame: Frame::WORLD,
    };
    condensed.add(&mut compliance, &dofs, &[contact]).expect("a contact");
    let expected = Mat::from_fn(3, 3, |i, j| match (i == 1 || j == 1, i == j) {
        (true, _) => 0.0,
        (_, true) => 2.0,
        (_, false) => 0.1,
    });
    assert_eq!(condensed.matrix(), expected.as_ref());
    let mut forces = vec![f64::NAN; dofs.free()];
    spread(&condensed, &[1.0, 2.0, 3.0], &mut forces);
    assert_eq!(forces.iter().sum::<f64>(), 4.0);
}

#[test]
fn contacts_that_cannot_be_are_refused_and_change_nothing() {
    let (block, mut inverse) = setup();
    let all = contacts(&block, 3);
    let mut some = condensed(&block, &mut inverse, &all);
    let before = some.clone();
    let nodes = block.dofs.nodes();
    let (fixed, _) = block.dofs.prescribed().next().expect("a floor");
    let fresh = block.free_nodes(7)[3];
    for (bad, expected) in [
        (fixed, CondensedError::Fixed { node: fixed }),
        (all[1].node, CondensedError::Repeated { node: all[1].node }),
        (fresh, CondensedError::Repeated { node: fresh }),
        (
            nodes as u32,
            CondensedError::OutOfRange {
                node: nodes as u32,
                nodes,
            },
        ),
    ] {
        let refused = some.add(&mut inverse, &block.dofs, &[contact(fresh), contact(bad)]);
        assert_eq!(refused, Err(expected));
        assert_same(&some, &before);
    }
    let mut other = Symmetric::<f64>::zeros(3);
    let (found, expected) = (3, block.dofs.free());
    let refused = some.add(&mut other, &block.dofs, &[contact(fresh)]);
    assert_eq!(refused, Err(CondensedError::Size { found, expected }));
    assert_same(&some, &before);
}

/// Forces of the contacts at the degrees of freedom of the mesh.
fn spread(condensed: &Condensed, forces: &[f64], out: &mut [f64]) {
    out.fill(0.0);
    for ((contact, dofs), force) in condensed.contacts.iter().zip(&condensed.dofs).zip(forces.as_chunks().0) {
        for (&dof, value) in dofs.iter().zip(contact.frame.to_world(*force)) {
            if dof != NONE {
                out[dof as usize] = value;
            }
        }
    }
}
