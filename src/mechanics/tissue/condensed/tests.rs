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
    condensed.spread(&forces, &mut whole);
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
fn contacts_come_and_go_without_touching_the_rest() {
    let (block, mut inverse) = setup();
    let all = contacts(&block, 6);
    let whole = condensed(&block, &mut inverse, &all);
    let mut grown = condensed(&block, &mut inverse, &all[..2]);
    grown.add(&mut inverse, &block.dofs, &all[2..3]).expect("a contact");
    grown.add(&mut inverse, &block.dofs, &[]).expect("none");
    grown.add(&mut inverse, &block.dofs, &all[3..]).expect("contacts");
    assert_same(&grown, &whole);
    grown.remove(all[1].node).expect("a contact");
    grown.remove(all[5].node).expect("a contact");
    let rest = [all[0], all[2], all[3], all[4]];
    assert_same(&grown, &condensed(&block, &mut inverse, &rest));
    for contact in rest {
        grown.remove(contact.node).expect("a contact");
    }
    assert_eq!((grown.size(), grown.matrix().nrows()), (0, 0));
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
fn turning_is_as_if_the_frame_had_been_so_from_the_start() {
    let (block, mut inverse) = setup();
    let mut all = contacts(&block, 4);
    let mut turned = condensed(&block, &mut inverse, &all);
    for step in 0..100 {
        let frame = Frame::along([value(step, 0, 9), value(step, 1, 9), 2.0]).expect("a direction");
        turned.turn(all[2].node, frame).expect("a contact");
        all[2].frame = frame;
    }
    assert_same(&turned, &condensed(&block, &mut inverse, &all));
}

#[test]
fn a_changed_inverse_is_read_again() {
    let (block, mut inverse) = setup();
    let all = contacts(&block, 4);
    let mut refreshed = condensed(&block, &mut inverse, &all);
    let y = Mat::from_fn(inverse.size(), 3, |i, k| value(i, k, 4));
    inverse
        .rank_update(y.as_ref(), Mat::identity(3, 3).as_ref())
        .expect("an update");
    refreshed.refresh(&mut inverse).expect("entries");
    assert_same(&refreshed, &condensed(&block, &mut inverse, &all));
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
    condensed.spread(&[1.0, 2.0, 3.0], &mut forces);
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
    assert_eq!(some.remove(fresh), Err(CondensedError::Unknown { node: fresh }));
    assert_eq!(
        some.turn(fresh, Frame::WORLD),
        Err(CondensedError::Unknown { node: fresh })
    );
    let mut other = Symmetric::<f64>::zeros(3);
    let (found, expected) = (3, block.dofs.free());
    let refused = some.add(&mut other, &block.dofs, &[contact(fresh)]);
    assert_eq!(refused, Err(CondensedError::Size { found, expected }));
    assert!(matches!(some.refresh(&mut other), Err(CondensedError::Compliance(_))));
    assert_same(&some, &before);
}
