//! A mesh and the remesher that follows it, kept together: a move happens to both or to neither.

use super::adapted::{AdaptedMesh, Change, Record, RefusedMove};
use super::make::{Maker, Source, make};
use super::rebase::{Rebase, RebaseError, adopt};
use super::{Level, Options, Precision, RemeshError, RemeshReport, Remesher};

/// A mesh with its remesher, and the base that another remesher can be made from.
pub struct Adaptation {
    mesh: AdaptedMesh,
    remesher: Box<dyn Remesher>,
    source: Source,
    options: Options,
    /// What makes remeshers, where that is not [`make`].
    maker: Option<Maker>,
    /// Why a device was given up, until that is told.
    failure: Option<String>,
    /// Memory for the degrees of freedom of an expected change.
    expected: Vec<u32>,
}

/// Why a move is refused. Mesh and remesher are then as they were.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum AdaptError {
    /// By the mesh.
    #[error(transparent)]
    Move(#[from] RefusedMove),
    /// By the remesher.
    #[error(transparent)]
    Remesh(#[from] RemeshError),
}

impl Adaptation {
    /// Follows `mesh`; the other arguments as for [`make`].
    ///
    /// # Errors
    /// As [`make`].
    pub fn new(
        mesh: AdaptedMesh,
        source: Source,
        level: Level,
        precision: Precision,
        options: Options,
    ) -> Result<Adaptation, RemeshError> {
        Adaptation::with_maker(mesh, source, level, precision, options, None)
    }

    /// As [`Adaptation::new`], with remeshers from `maker`, if there is one. Where a device of theirs fails, those of [`make`] go on.
    ///
    /// # Errors
    /// As `maker` or [`make`].
    pub fn with_maker(
        mesh: AdaptedMesh,
        source: Source,
        level: Level,
        precision: Precision,
        options: Options,
        maker: Option<Maker>,
    ) -> Result<Adaptation, RemeshError> {
        let remesher = maker.as_deref().unwrap_or(&make)(level, precision, &source, &mesh, options)?;
        Ok(Adaptation {
            mesh,
            remesher,
            source,
            options,
            maker,
            failure: None,
            expected: Vec::new(),
        })
    }

    /// The mesh.
    pub fn mesh(&self) -> &AdaptedMesh {
        &self.mesh
    }

    /// The remesher.
    pub fn remesher(&self) -> &dyn Remesher {
        &*self.remesher
    }

    /// The remesher, to name contacts and to read compliances and displacements, with the mesh that it follows.
    pub fn parts(&mut self) -> (&AdaptedMesh, &mut dyn Remesher) {
        (&self.mesh, &mut *self.remesher)
    }

    /// Asks something of the remesher. Where its device fails, one of [`make`] takes its place first, if this has a [`Maker`].
    ///
    /// # Errors
    /// Those of the request.
    pub fn ask<T>(
        &mut self,
        mut request: impl FnMut(&AdaptedMesh, &mut dyn Remesher) -> Result<T, RemeshError>,
    ) -> Result<T, RemeshError> {
        match request(&self.mesh, &mut *self.remesher) {
            Err(failed @ RemeshError::Device(_)) => {
                self.give_up_device(failed)?;
                request(&self.mesh, &mut *self.remesher)
            }
            answer => answer,
        }
    }

    /// Why a device was given up since this was last asked, if one was.
    pub fn take_failure(&mut self) -> Option<String> {
        self.failure.take()
    }

    /// Moves a node to `to` (mm, reference state).
    ///
    /// # Errors
    /// [`AdaptError`].
    pub fn move_node(&mut self, node: u32, to: [f64; 3]) -> Result<RemeshReport, AdaptError> {
        let change = self.mesh.begin_move(node, to)?;
        self.hand_over(change, Record::Moved)
    }

    /// Moves a node back to its original position.
    ///
    /// # Errors
    /// [`AdaptError`].
    pub fn restore(&mut self, node: u32) -> Result<RemeshReport, AdaptError> {
        let change = self.mesh.begin_restore(node)?;
        self.hand_over(change, Record::Restored)
    }

    /// Takes back the last move; `None` when there is none.
    ///
    /// # Errors
    /// [`AdaptError`].
    pub fn undo(&mut self) -> Result<Option<RemeshReport>, AdaptError> {
        let change = self.mesh.begin_undo()?;
        change.map(|change| self.hand_over(change, Record::Undone)).transpose()
    }

    /// Expects that `node` is what moves next: see [`Remesher::expect`].
    ///
    /// # Panics
    /// If there is no such node.
    pub fn expect(&mut self, node: u32) {
        self.expected.clear();
        self.expected.extend(self.mesh.support_of(node));
        self.remesher.expect(&self.expected);
    }

    /// Does what changes have left to do: see [`Remesher::tend`].
    pub fn tend(&mut self) -> Option<RemeshReport> {
        self.remesher.tend(&self.mesh)
    }

    /// Changes level and precision while running. Contacts and moves stay.
    ///
    /// # Errors
    /// [`RemeshError`]; the remesher is then what it was.
    pub fn switch(&mut self, level: Level, precision: Precision) -> Result<Option<RemeshReport>, RemeshError> {
        let same_kind = (level == Level::Exact) == (self.remesher.level() == Level::Exact);
        if same_kind && precision == self.remesher.precision() {
            return self.remesher.set_level(&self.mesh, level);
        }
        self.switch_source(level, precision, self.source.clone())?;
        Ok(None)
    }

    /// Makes the remesher anew, from another compliance of the same base. Contacts and moves stay.
    ///
    /// # Errors
    /// [`RemeshError`]; remesher and compliance of the base are then what they were.
    pub fn switch_source(&mut self, level: Level, precision: Precision, source: Source) -> Result<(), RemeshError> {
        let maker = self.maker.as_deref().unwrap_or(&make);
        let next = maker(level, precision, &source, &self.mesh, self.options)?;
        self.replace(next)?;
        self.source = source;
        Ok(())
    }

    /// Puts another remesher, which follows the mesh as it is now, in place of the one at hand. Contacts and moves stay.
    ///
    /// # Errors
    /// [`RemeshError`]; the remesher is then what it was.
    pub fn replace(&mut self, mut next: Box<dyn Remesher>) -> Result<(), RemeshError> {
        next.set_contacts(self.remesher.contacts())?;
        self.remesher = next;
        Ok(())
    }

    /// Makes a prepared base that of the mesh: see [`rebase`](super::rebase).
    ///
    /// # Errors
    /// [`RebaseError`]; everything then stays as it is.
    pub fn adopt(&mut self, rebase: Rebase) -> Result<(), RebaseError> {
        self.source = adopt(rebase, &mut self.mesh, &mut *self.remesher)?;
        Ok(())
    }

    /// Gives a change to the remesher, or takes it back.
    fn hand_over(&mut self, change: Change, record: Record) -> Result<RemeshReport, AdaptError> {
        let mut result = self.remesher.remesh(&self.mesh, &change);
        if let Err(failed @ RemeshError::Device(_)) = result {
            let next = self.give_up_device(failed);
            result = next.and_then(|()| self.remesher.refresh(&self.mesh));
        }
        match result {
            Ok(_) => self.mesh.record(record, &change),
            Err(_) => self.mesh.take_back(&change),
        }
        self.mesh.reclaim(change);
        result.map_err(AdaptError::from)
    }

    /// Puts a remesher of [`make`] in place of one whose device has failed. It follows the mesh as it is now.
    fn give_up_device(&mut self, failed: RemeshError) -> Result<(), RemeshError> {
        if self.maker.is_none() {
            return Err(failed);
        }
        let (level, precision) = (self.remesher.level(), self.remesher.precision());
        let next = make(level, precision, &self.source, &self.mesh, self.options)?;
        self.replace(next)?;
        self.maker = None;
        self.failure = Some(failed.to_string());
        Ok(())
    }
}

#[cfg(test)]
mod tests;
