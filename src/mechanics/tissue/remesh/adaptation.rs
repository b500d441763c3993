//! Mesh and remesher combined: a move is applied to both or to neither.

use super::adapted::{AdaptedMesh, Change, Record};
use super::make::{Maker, Source, make};
use super::{Level, Precision, RemeshError, RemeshReport, Remesher, RemesherOptions};

/// Mesh with its remesher, and the base compliance that another remesher can be made from.
pub struct Adaptation {
    mesh: AdaptedMesh,
    remesher: Box<dyn Remesher>,
    source: Source,
    options: RemesherOptions,
    /// Constructor of remeshers, if other than [`make`].
    maker: Option<Maker>,
    /// Why a device was given up, until reported.
    failure: Option<String>,
    /// Buffer for the degrees of freedom of an expected change.
    expected: Vec<u32>,
}

impl Adaptation {
    /// Combines `mesh` with a remesher; the other arguments are those of [`make`].
    ///
    /// # Errors
    /// The errors of [`make`].
    pub fn new(
        mesh: AdaptedMesh,
        source: Source,
        level: Level,
        precision: Precision,
        options: RemesherOptions,
    ) -> Result<Adaptation, RemeshError> {
        Adaptation::with_maker(mesh, source, level, precision, options, None)
    }

    /// Combines `mesh` with a remesher from `maker`, if given, else from [`make`]. If a device of the former fails,
    /// remeshers of [`make`] take over.
    ///
    /// # Errors
    /// The errors of `maker` or [`make`].
    pub fn with_maker(
        mesh: AdaptedMesh,
        source: Source,
        level: Level,
        precision: Precision,
        options: RemesherOptions,
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

    /// Mesh in its current state.
    pub fn mesh(&self) -> &AdaptedMesh {
        &self.mesh
    }

    /// Remesher that follows the mesh.
    pub fn remesher(&self) -> &dyn Remesher {
        &*self.remesher
    }

    /// Mesh and remesher, to set contacts and to read compliances and displacements.
    pub fn parts(&mut self) -> (&AdaptedMesh, &mut dyn Remesher) {
        (&self.mesh, &mut *self.remesher)
    }

    /// Applies a request to the remesher. If its device fails and there is a [`Maker`], the request is repeated with a
    /// remesher of [`make`].
    ///
    /// # Errors
    /// The errors of the request, and of [`make`] if a device failed.
    pub(crate) fn with_fallback<T>(
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

    /// Takes the reason why a device was given up since the last call, if one was.
    pub(crate) fn take_failure(&mut self) -> Option<String> {
        self.failure.take()
    }

    /// Moves a node to `to` (mm, reference state).
    ///
    /// # Errors
    /// [`RemeshError`] where the mesh or the remesher refuses.
    pub fn move_node(&mut self, node: u32, to: [f64; 3]) -> Result<RemeshReport, RemeshError> {
        let change = self.mesh.begin_move(node, to)?;
        self.hand_over(change, Record::Moved)
    }

    /// Moves a node back to its original position.
    ///
    /// # Errors
    /// [`RemeshError`] where the mesh or the remesher refuses.
    pub fn restore(&mut self, node: u32) -> Result<RemeshReport, RemeshError> {
        let change = self.mesh.begin_restore(node)?;
        self.hand_over(change, Record::Restored)
    }

    /// Undoes the last move; `None` if there is none.
    ///
    /// # Errors
    /// [`RemeshError`] where the mesh or the remesher refuses.
    pub fn undo(&mut self) -> Result<Option<RemeshReport>, RemeshError> {
        let change = self.mesh.begin_undo()?;
        change.map(|change| self.hand_over(change, Record::Undone)).transpose()
    }

    /// Announces `node` as the next to move: see [`Remesher::expect`].
    ///
    /// # Panics
    /// If the node does not exist.
    pub fn expect(&mut self, node: u32) {
        self.expected.clear();
        self.expected.extend(self.mesh.support_of(node));
        self.remesher.expect(&self.expected);
    }

    /// Performs deferred work: see [`Remesher::run_deferred`].
    pub(crate) fn run_deferred(&mut self) -> Option<RemeshReport> {
        self.remesher.run_deferred(&self.mesh)
    }

    /// Changes level and precision at run time. Contacts and moves are kept.
    ///
    /// # Errors
    /// [`RemeshError`]; the remesher is then unchanged.
    pub fn switch(&mut self, level: Level, precision: Precision) -> Result<Option<RemeshReport>, RemeshError> {
        let same_kind = (level == Level::Exact) == (self.remesher.level() == Level::Exact);
        if same_kind && precision == self.remesher.precision() {
            return self.remesher.set_level(&self.mesh, level);
        }
        self.switch_source(level, precision, self.source.clone())?;
        Ok(None)
    }

    /// Replaces the remesher by one from another compliance of the same base. Contacts and moves are kept.
    ///
    /// # Errors
    /// [`RemeshError`]; the remesher and the base compliance are then unchanged.
    pub(crate) fn switch_source(
        &mut self,
        level: Level,
        precision: Precision,
        source: Source,
    ) -> Result<(), RemeshError> {
        let maker = self.maker.as_deref().unwrap_or(&make);
        let next = maker(level, precision, &source, &self.mesh, self.options)?;
        self.replace(next)?;
        self.source = source;
        Ok(())
    }

    /// Replaces the remesher by `next`, which must follow the current mesh. Contacts and moves are kept.
    ///
    /// # Errors
    /// [`RemeshError`]; the remesher is then unchanged.
    pub fn replace(&mut self, mut next: Box<dyn Remesher>) -> Result<(), RemeshError> {
        next.set_contacts(self.remesher.contacts())?;
        self.remesher = next;
        Ok(())
    }

    /// Passes a change to the remesher, and records or reverts it in the mesh.
    fn hand_over(&mut self, change: Change, record: Record) -> Result<RemeshReport, RemeshError> {
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
        result
    }

    /// Replaces a remesher whose device has failed by one of [`make`] in the current state of the mesh.
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
