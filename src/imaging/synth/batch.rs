//! Batches of independent frames: on the CPU each core renders frames of its own.

use std::collections::VecDeque;
use std::mem;
use std::sync::mpsc::sync_channel;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use super::cpu::CpuExecutor;
use super::local_origin::LocalFrame;
use super::{Backend, Executor, Frame, FrameState, IN_FLIGHT, SynthError, Synthesizer, check_finite};
use insonify_base::memory;
use insonify_base::parallel::{self, Pool};

/// Frames of a thread that wait for the sink.
const AHEAD: usize = 2;

/// Threads of batches. On the CPU each has a synthesizer, the first the owner's; on a GPU they cut the mesh of the
/// frames of a submission.
pub(super) struct Team {
    pool: Pool,
    others: Vec<Synthesizer>,
    /// Number of threads that the frames suffice for; memory may have allowed fewer.
    threads: usize,
}

impl Synthesizer {
    /// Renders frames that do not depend on each other, and passes them with their index to `sink`, in order. Pixels
    /// are those of [`Synthesizer::render`] for one state after another, at any number of threads; afterwards the
    /// synthesizer is as after the last of them. An error, of a frame or of the sink, ends the batch.
    ///
    /// On the CPU each thread renders frames of its own, which saves the waits between passes of a frame that is shared
    /// by all. The threads belong to the synthesizer, as many as the caller's pool has, or fewer where memory does not
    /// suffice; they share its tables but for frames with settings of their own, and last until it is dropped or its
    /// settings change. On a GPU a submission has several frames, whose meshes are cut on such threads, and three
    /// submissions are in flight.
    ///
    /// ```
    /// use insonify_imaging::scene::SceneFile;
    /// use insonify_imaging::synth::{Backend, SynthError};
    ///
    /// let text = "volume = { phantom = \"abdomen\", resolution_mm = 5 }";
    /// let scene = SceneFile::parse(text, "scene.toml")?.resolve(".".as_ref())?;
    /// let mut synth = scene.synthesizer(Backend::Cpu)?;
    /// let states: Vec<_> = scene.states(4).collect::<Result<_, _>>()?;
    /// let mut stack = Vec::new();
    /// synth.render_batch(&states, |index, frame| {
    ///     assert_eq!(stack.len(), index * frame.pixels.len());
    ///     stack.extend_from_slice(&frame.pixels);
    ///     Ok::<_, SynthError>(())
    /// })?;
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// The errors of [`Synthesizer::render`] and of the sink.
    pub fn render_batch<E: From<SynthError>>(
        &mut self,
        states: &[FrameState],
        mut sink: impl FnMut(usize, &Frame) -> Result<(), E>,
    ) -> Result<(), E> {
        self.admit(states)?;
        if self.shares_submissions(states) {
            return self.batch_on_gpu(states, &mut |index, synth, _| sink(index, &synth.frame));
        }
        self.batch(
            states,
            |_, synth, _| Ok(synth.frame().clone()),
            |index, frame| sink(index, &frame),
        )
    }

    /// Like [`Synthesizer::render_batch`], but `take` converts each frame on the thread that rendered it, given its
    /// index, the synthesizer after `render`, and the time of the frame, ms.
    pub fn batch<T: Send, E: From<SynthError>>(
        &mut self,
        states: &[FrameState],
        take: impl Fn(usize, &Self, f64) -> Result<T, SynthError> + Sync,
        mut sink: impl FnMut(usize, T) -> Result<(), E>,
    ) -> Result<(), E> {
        self.admit(states)?;
        if self.shares_submissions(states) {
            return self.batch_on_gpu(states, &mut |index, synth, ms| sink(index, take(index, synth, ms)?));
        }
        let Some(mut team) = self.team(states)? else {
            for index in 0..states.len() {
                let ms = self.timed(states, index, 1)?;
                sink(index, take(index, self, ms)?)?;
            }
            return Ok(());
        };
        let result = team.run(self, states, &take, &mut sink);
        self.team = Some(team);
        result
    }
}

fn has_settings(states: &[FrameState]) -> bool {
    states.iter().any(|state| state.settings.is_some())
}

impl Synthesizer {
    /// Whether submissions have several frames: on a GPU, for states that leave the settings as they are.
    fn shares_submissions(&self, states: &[FrameState]) -> bool {
        matches!(self.executor, Executor::Gpu(_)) && !has_settings(states)
    }

    /// Renders a batch in submissions of several frames, of which several are in flight, and calls `each` with the time
    /// since the frame before, ms.
    fn batch_on_gpu<E: From<SynthError>>(
        &mut self,
        states: &[FrameState],
        each: &mut impl FnMut(usize, &Self, f64) -> Result<(), E>,
    ) -> Result<(), E> {
        self.drop_in_flight();
        let Executor::Gpu(gpu) = &mut self.executor else {
            return Ok(());
        };
        // Enough submissions that one is ready while another is worked on.
        let size = gpu.reserve_frames(&self.plan, &self.tables, states.len().div_ceil(IN_FLIGHT))?;
        let team = self.cutters(size);
        let result = self.submissions(states, size, team.as_ref(), each);
        self.team = team;
        if let (Executor::Gpu(gpu), true) = (&mut self.executor, result.is_err()) {
            (0..IN_FLIGHT).for_each(|slot| gpu.release(slot));
        }
        result
    }

    fn submissions<E: From<SynthError>>(
        &mut self,
        states: &[FrameState],
        size: usize,
        team: Option<&Team>,
        each: &mut impl FnMut(usize, &Self, f64) -> Result<(), E>,
    ) -> Result<(), E> {
        let mut in_flight: VecDeque<(_, Vec<Frame>)> = VecDeque::with_capacity(IN_FLIGHT);
        let mut spare: Vec<Vec<Frame>> = Vec::new();
        let mut locals: Vec<_> = (0..size).map(|_| LocalFrame::new(self.tables.origin)).collect();
        let mut last_taken = Instant::now();
        for turn in 0..states.len().div_ceil(size) + IN_FLIGHT {
            // Taken back some turns after its submission, so that the GPU has work while frames are passed on and
            // states prepared.
            if let Some(done) = turn.checked_sub(IN_FLIGHT)
                && let Some((submission, mut frames)) = in_flight.pop_front()
                && let Executor::Gpu(gpu) = &mut self.executor
            {
                gpu.take((&self.plan, &self.tables), submission, done % IN_FLIGHT, &mut frames)?;
                let ms = last_taken.elapsed().as_secs_f64() * 1e3 / frames.len() as f64;
                last_taken = Instant::now();
                for (number, frame) in frames.iter_mut().enumerate() {
                    mem::swap(&mut self.frame, frame);
                    each(done * size + number, self, ms)?;
                }
                spare.push(frames);
            }
            let Some(chunk) = states.chunks(size).nth(turn) else {
                continue;
            };
            let mut frames = spare.pop().unwrap_or_default();
            frames.resize_with(chunk.len(), Frame::default);
            for ((state, frame), local) in chunk.iter().zip(&mut frames).zip(&mut locals) {
                check_finite(state)?;
                Self::begin(&self.tables, local, state, frame)?;
            }
            let states: Vec<_> = locals
                .iter()
                .zip(chunk)
                .map(|(local, state)| local.localized(state))
                .collect();
            if let Executor::Gpu(gpu) = &mut self.executor {
                let (plan, tables) = (&self.plan, &self.tables);
                match team {
                    Some(team) => team.pool.install(|| gpu.stage(plan, tables, &states))?,
                    None => gpu.stage(plan, tables, &states)?,
                }
                in_flight.push_back((gpu.submit(&self.tables, chunk.len(), turn % IN_FLIGHT)?, frames));
            }
        }
        Ok(())
    }

    /// Threads that cut the meshes of several frames; `None` without a mesh, on one thread, and where the system has no
    /// threads to spare.
    fn cutters(&mut self, frames: usize) -> Option<Team> {
        let threads = parallel::threads().min(frames);
        if threads < 2 || self.tables.mesh.is_none() {
            return None;
        }
        let reusable = self.team.take().filter(|team| team.threads == threads);
        reusable.or_else(|| {
            let pool = Pool::new(threads).ok()?;
            let others = Vec::new();
            Some(Team { pool, others, threads })
        })
    }

    /// Threads for a batch on the CPU; `None` where frames are rendered in turn: on a GPU, on one thread, for so few
    /// frames that most threads would have none, and where memory suffices for one frame at a time.
    fn team(&mut self, states: &[FrameState]) -> Result<Option<Team>, SynthError> {
        let threads = parallel::threads();
        let useful = threads.min(states.len());
        let backend = match &self.executor {
            Executor::Cpu(_) => Backend::Cpu,
            Executor::CpuF64(_) => Backend::CpuF64,
            Executor::Gpu(_) => return Ok(None),
        };
        if useful < 2 || 2 * states.len() < threads {
            return Ok(None);
        }
        // Threads whose frames had settings have tables of their own, which fit only frames with settings again.
        let is_ready = |team: &Team| {
            let is_at = |other: &Self| Arc::ptr_eq(&other.tables, &self.tables);
            (useful..=threads).contains(&team.threads)
                && (states[0].settings.is_some() || team.others.iter().all(is_at))
        };
        if let Some(team) = self.team.take().filter(is_ready) {
            return Ok(Some(team));
        }
        let each = self.bytes_of_another();
        let fits = |others: &usize| memory::check(*others as u64 * each, "frames side by side").is_ok();
        let others = (1..useful).rev().find(fits).unwrap_or(0);
        // A system without threads to spare renders in turn, too.
        let pool = Pool::new(others + 1);
        let (Ok(pool), 1..) = (pool, others) else {
            return Ok(None);
        };
        let others = (0..others).map(|_| Self::from_tables(Arc::clone(&self.tables), backend.clone()));
        let others = others.collect::<Result<Vec<_>, _>>()?;
        Ok(Some(Team {
            pool,
            others,
            threads: useful,
        }))
    }

    /// Memory of another thread, bytes: what passes write, pixels of frames that wait, and elements of the mesh.
    fn bytes_of_another(&self) -> u64 {
        const PER_ELEMENT: u64 = 1024;
        let (scalar, written) = match &self.executor {
            Executor::CpuF64(_) => (2, CpuExecutor::<f64>::bytes_of(&self.plan)),
            _ => (1, CpuExecutor::<f32>::bytes_of(&self.plan)),
        };
        let elements = self.tables.mesh.as_ref().map_or(0, |mesh| mesh.elements().len());
        written + ((AHEAD + 2) * self.frame.pixels.len()) as u64 + scalar * PER_ELEMENT * elements as u64
    }

    /// Renders the state at a place in a batch of which this synthesizer renders each frame that is `stride` after the
    /// last: nodes that the state leaves as they were are those of the frames between. Returns the time, ms.
    fn timed(&mut self, states: &[FrameState], index: usize, stride: usize) -> Result<f64, SynthError> {
        let start = Instant::now();
        let (state, before) = (&states[index], &states[(index + 1).saturating_sub(stride)..index]);
        let nodes = before.iter().rev().find_map(|state| state.nodes.as_ref());
        let reference = before.iter().rev().find_map(|state| state.reference.as_ref());
        let settings = before.iter().rev().find_map(|state| state.settings.as_ref());
        if (state.nodes.is_none() && nodes.is_some())
            || (state.reference.is_none() && reference.is_some())
            || (state.settings.is_none() && settings.is_some())
        {
            let mut whole = state.clone();
            whole.nodes = whole.nodes.or(nodes.cloned());
            whole.reference = whole.reference.or(reference.cloned());
            whole.settings = whole.settings.or(settings.cloned());
            self.render(&whole)?;
        } else {
            self.render(state)?;
        }
        Ok(start.elapsed().as_secs_f64() * 1e3)
    }

    /// Takes over timing and the state of the mesh.
    fn copy_settings_from(&mut self, other: &Self) {
        match (&mut self.executor, &other.executor) {
            (Executor::Cpu(to), Executor::Cpu(from)) => to.copy_settings_from(from),
            (Executor::CpuF64(to), Executor::CpuF64(from)) => to.copy_settings_from(from),
            _ => {}
        }
    }
}

impl Team {
    fn run<T: Send, E: From<SynthError>>(
        &mut self,
        first: &mut Synthesizer,
        states: &[FrameState],
        take: &(impl Fn(usize, &Synthesizer, f64) -> Result<T, SynthError> + Sync),
        sink: &mut impl FnMut(usize, T) -> Result<(), E>,
    ) -> Result<(), E> {
        self.others.iter_mut().for_each(|other| other.copy_settings_from(first));
        let count = self.others.len() + 1;
        let (senders, receivers): (Vec<_>, Vec<_>) = (0..count).map(|_| sync_channel(AHEAD)).unzip();
        let members = [&mut *first].into_iter().chain(&mut self.others).zip(senders);
        let members: Vec<_> = members.map(|member| Mutex::new(Some(member))).collect();
        let work = |thread: usize| {
            let member = members[thread].lock().unwrap_or_else(PoisonError::into_inner).take();
            let Some((synth, sender)) = member else { return };
            for index in (thread..states.len()).step_by(count) {
                let result = synth.timed(states, index, count).and_then(|ms| take(index, synth, ms));
                let failed = result.is_err();
                // Nobody receives after an error.
                if sender.send(result).is_err() || failed {
                    return;
                }
            }
        };
        // A thread runs its own part of a broadcast alone, so none waits for the frames of another.
        let result = self.pool.broadcast(&work, || {
            let receivers = receivers;
            for index in 0..states.len() {
                // Where the other end is gone, its thread has panicked, which the broadcast passes on.
                let Ok(result) = receivers[index % count].recv() else {
                    break;
                };
                sink(index, result?)?;
            }
            Ok(())
        });
        drop(members);
        // The last frame is the owner's.
        if let Some(last) = ((states.len() - 1) % count).checked_sub(1) {
            let last = &mut self.others[last];
            mem::swap(&mut first.tables, &mut last.tables);
            mem::swap(&mut first.plan, &mut last.plan);
            mem::swap(&mut first.executor, &mut last.executor);
            mem::swap(&mut first.local, &mut last.local);
            mem::swap(&mut first.frame, &mut last.frame);
        }
        result
    }
}
