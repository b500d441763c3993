//! CPU execution of a plan: passes in sequence, each parallel over all cores.

use std::time::Instant;

use super::slab::States;
use super::store::Store;
use super::tables::Tables;
use super::{Frame, FrameState, PassTime, SynthError};
use crate::effects::pass::{Pass, View};
use crate::effects::truth;
use crate::plan::{Plan, PlannedPass};
use insonify_base::memory;
use insonify_base::real::Real;
#[cfg(test)]
use insonify_testing::lossy::Lossy;

/// Scalar type of a CPU reference.
pub(crate) trait PassScalar: Real {
    /// Returns the reference of a pass in this scalar.
    fn reference(pass: &Pass) -> fn(&View, &mut Store<Self>);
}

impl PassScalar for f32 {
    fn reference(pass: &Pass) -> fn(&View, &mut Store<Self>) {
        pass.cpu.single
    }
}

impl PassScalar for f64 {
    fn reference(pass: &Pass) -> fn(&View, &mut Store<Self>) {
        pass.cpu.double
    }
}

#[cfg(test)]
impl PassScalar for Lossy {
    fn reference(pass: &Pass) -> fn(&View, &mut Store<Self>) {
        pass.cpu.lossy
    }
}

/// The CPU backend.
pub(crate) struct CpuExecutor<T: PassScalar> {
    /// Working memory of the backend.
    pub store: Store<T>,
    /// Whether passes are timed.
    pub timed: bool,
    /// Durations of the passes.
    pub times: Vec<PassTime>,
}

impl<T: PassScalar> CpuExecutor<T> {
    /// Allocates memory for a plan; an error if too little is available.
    pub(crate) fn new(plan: &Plan, tables: &Tables) -> Result<Self, SynthError> {
        let mut executor = Self {
            store: Store::default(),
            timed: false,
            times: Vec::new(),
        };
        executor.fit(plan, tables)?;
        Ok(executor)
    }

    /// Adapts the memory to a changed plan; an error if too little is available.
    pub(crate) fn fit(&mut self, plan: &Plan, tables: &Tables) -> Result<(), SynthError> {
        memory::check(
            Self::bytes_of(plan).saturating_sub(self.store.bytes() as u64),
            "a frame",
        )?;
        self.store.fit(plan, tables);
        self.times.reserve_exact(plan.passes.len());
        Ok(())
    }

    /// Bytes that the passes of a plan write.
    pub(crate) fn bytes_of(plan: &Plan) -> u64 {
        let written = |buffer| {
            let mut bindings = plan.passes.iter().flat_map(|planned| planned.pass.bindings);
            bindings.any(|&(bound, how)| bound == buffer && how.writes())
        };
        let resources = plan.resources.iter().filter(|planned| written(planned.resource));
        // The plan counts numbers of 4 bytes.
        resources.map(|planned| planned.bytes).sum::<u64>() * (size_of::<T>() / size_of::<f32>()) as u64
    }

    /// Takes over whether passes are timed, and the state of the mesh.
    pub(crate) fn copy_settings_from(&mut self, other: &Self) {
        self.timed = other.timed;
        if let (Some(slab), Some(other)) = (&mut self.store.slab, &other.store.slab) {
            slab.copy_states_from(other, States::BOTH);
        }
    }

    /// Runs the passes and copies the pixels out.
    pub(crate) fn render(
        &mut self,
        plan: &Plan,
        tables: &Tables,
        state: &FrameState,
        frame: &mut Frame,
    ) -> Result<(), SynthError> {
        self.run(&plan.passes, tables, state)?;
        frame.pixels.copy_from_slice(&self.store.pixels);
        truth::images(
            tables,
            &self.store.effects.truth.layers,
            |value| value,
            &mut frame.layers,
        );
        Ok(())
    }

    /// Runs a sequence of passes of a plan, from a thread of the pool: one outside it would be woken after every pass.
    pub(crate) fn run(
        &mut self,
        passes: &[PlannedPass],
        tables: &Tables,
        state: &FrameState,
    ) -> Result<(), SynthError> {
        insonify_base::parallel::enter(|| self.run_in_pool(passes, tables, state))
    }

    fn run_in_pool(&mut self, passes: &[PlannedPass], tables: &Tables, state: &FrameState) -> Result<(), SynthError> {
        if let Some(slab) = &mut self.store.slab {
            slab.update(tables, state)?;
        }
        let view = View {
            tables,
            state,
            slab: None,
        };
        self.times.clear();
        for planned in passes {
            let start = Instant::now();
            T::reference(planned.pass)(&view, &mut self.store);
            if planned.pass.flips {
                self.store.flip();
            }
            if self.timed {
                self.times.push(PassTime {
                    name: planned.pass.name,
                    ms: start.elapsed().as_secs_f64() * 1e3,
                });
            }
        }
        Ok(())
    }
}
