//! Matrices on the degrees of freedom around moved nodes.

use crate::tissue::error::LinearError;
use faer::prelude::{Reborrow, ReborrowMut};

use crate::tissue::compliance::Compliance;
use crate::tissue::remesh::adapted::AdaptedMesh;
use crate::tissue::remesh::growable::{Growable, symmetrise};

/// Initial room for members of S, contacts and members of one change (degrees of freedom): those of a needle some 100
/// mm deep in elements of 5 mm, beside a probe. Beyond, memory grows on demand, which takes some milliseconds once.
pub(super) const HELD_ROOM: usize = 768;
pub(super) const CONTACTS_ROOM: usize = 192;
pub(super) const CHANGE_ROOM: usize = 96;

/// In place of the place of a degree of freedom that is not in S.
const ABSENT: u32 = u32::MAX;

/// Set S with its matrices, in the order in which members were added; the last takes the place of a removed one.
#[derive(Debug)]
pub(super) struct Support {
    dofs: Vec<usize>,
    /// Place in `dofs` of each degree of freedom of the mesh, or [`ABSENT`].
    places: Vec<u32>,
    /// G = K0^-1[S, S].
    pub g: Growable,
    /// C = (I + dK G)^-1 dK.
    pub c: Growable,
    /// B = K0^-1[S, c] for the contacts c.
    pub b: Growable,
    block: Growable,
}

impl Support {
    pub(super) fn new(size: usize) -> Support {
        let room = size.min(HELD_ROOM);
        Support {
            dofs: Vec::new(),
            places: vec![ABSENT; size],
            g: Growable::with_room(room, room),
            c: Growable::with_room(room, room),
            b: Growable::with_room(room, CONTACTS_ROOM),
            block: Growable::with_room(CONTACTS_ROOM, CHANGE_ROOM),
        }
    }

    pub(super) fn dofs(&self) -> &[usize] {
        &self.dofs
    }

    pub(super) fn len(&self) -> usize {
        self.dofs.len()
    }

    pub(super) fn is_empty(&self) -> bool {
        self.dofs.is_empty()
    }

    /// Place of a member.
    pub(super) fn place(&self, dof: u32) -> usize {
        self.places[dof as usize] as usize
    }

    /// Adds the members of `support` missing from S: their rows and columns of C are zero, those of G and B are read
    /// from the base. On failure nothing changes.
    pub(super) fn extend(
        &mut self,
        source: &mut dyn Compliance,
        support: &[u32],
        contacts: &[usize],
    ) -> Result<(), LinearError> {
        let old = self.len();
        let missing = support.iter().filter(|dof| self.places[**dof as usize] == ABSENT);
        self.dofs.extend(missing.map(|dof| *dof as usize));
        let len = self.len();
        if len == old {
            self.b.shape(len, contacts.len());
            return Ok(());
        }
        let result = self.read(source, old, contacts);
        if result.is_err() {
            self.dofs.truncate(old);
            self.g.shape(old, old);
            self.b.shape(old, contacts.len());
            return result;
        }
        self.c.extend(len, len);
        for index in old..len {
            self.places[self.dofs[index]] = index as u32;
        }
        Ok(())
    }

    fn read(&mut self, source: &mut dyn Compliance, old: usize, contacts: &[usize]) -> Result<(), LinearError> {
        let len = self.len();
        let new = &self.dofs[old..];
        let mut g = self.g.shape(len, len);
        source.entries_into(&self.dofs, new, g.rb_mut().get_mut(.., old..))?;
        // Columns obtained by solving are symmetric only up to rounding.
        symmetrise(g.rb_mut().get_mut(old.., old..));
        let (left, right) = g.split_at_col_mut(old);
        left.get_mut(old.., ..).copy_from(right.get(..old, ..).transpose());
        let mut block = self.block.shape(contacts.len(), new.len());
        source.entries_into(contacts, new, block.rb_mut())?;
        let b = self.b.shape(len, contacts.len());
        b.get_mut(old.., ..).copy_from(block.rb().transpose());
        Ok(())
    }

    /// Removes the members after the first `len`.
    pub(super) fn truncate(&mut self, len: usize) {
        for &dof in &self.dofs[len..] {
            self.places[dof] = ABSENT;
        }
        self.dofs.truncate(len);
        let contacts = self.b.get().ncols();
        self.g.shape(len, len);
        self.c.shape(len, len);
        self.b.shape(len, contacts);
    }

    /// Whether the stiffness at any of `support` is again that of the base.
    pub(crate) fn releases(&self, mesh: &AdaptedMesh, support: &[u32]) -> bool {
        support.iter().any(|dof| !mesh.is_touched(mesh.dofs().node_of(*dof).0))
    }

    /// Removes the members of `support` whose stiffness is again that of the base: their rows of dK, and hence of C,
    /// are zero.
    pub(super) fn release(&mut self, mesh: &AdaptedMesh, support: &[u32]) {
        for &dof in support {
            if !mesh.is_touched(mesh.dofs().node_of(dof).0) {
                self.take(dof as usize);
            }
        }
    }

    fn take(&mut self, dof: usize) {
        let index = self.places[dof] as usize;
        for matrix in [&mut self.g, &mut self.c] {
            matrix.take_row(index);
            matrix.take_column(index);
        }
        self.b.take_row(index);
        self.places[dof] = ABSENT;
        self.dofs.swap_remove(index);
        if let Some(&moved) = self.dofs.get(index) {
            self.places[moved] = index as u32;
        }
    }

    pub(super) fn bytes(&self) -> usize {
        let matrices = [&self.g, &self.c, &self.b, &self.block];
        let lists = self.places.len() * size_of::<u32>() + self.dofs.capacity() * size_of::<usize>();
        matrices.iter().map(|matrix| matrix.bytes()).sum::<usize>() + lists
    }
}
