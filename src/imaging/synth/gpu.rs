//! GPU execution of a plan: its buffers, pipelines by pass, persistent bind groups, one submission per
//! frame.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::ops::Range;

use super::layers::{Beam, numbered};
use super::slab::{Slab, maps_at};
use super::tables::Tables;
use super::{FrameState, PassTime, SynthError};
use crate::base::memory;
use crate::gpu::{
    Dispatch, Gpu, GpuError, Needs, Parameters, PassSource, Pipeline, Readback, Recorder, StorageBuffer, TextureOut,
    Timer,
};
use crate::imaging::effects::buffers::{
    AMPLITUDE, AMPLITUDE_NEXT, Buffer, ELEMENT, ELEMENT_MAPS, HITS, LABEL, LOSS, NEEDLE_MASK, PIXELS, POSITION,
    SCAN_MAP,
};
use crate::imaging::effects::pass::{Access, Band, Pass, View};
use crate::imaging::plan::Plan;

/// Device requirements of a plan beyond the default limits.
pub fn needs(plan: &Plan) -> Needs {
    let largest = plan
        .resources
        .iter()
        .filter(|planned| !planned.resource.is_per_pixel)
        .map(|planned| planned.bytes)
        .max();
    let most = plan.passes.iter().map(|planned| planned.pass.bindings.len()).max();
    Needs {
        storage_binding_bytes: largest.unwrap_or(0),
        buffer_bytes: largest.unwrap_or(0),
        // One more for the parameters.
        storage_buffers_per_stage: most.map_or(0, |most| most as u32 + 1),
    }
}

/// A submission of a frame.
pub type Submission = wgpu::SubmissionIndex;

/// A dispatch of a frame.
struct Step {
    pass: &'static Pass,
    pipeline: Pipeline,
    bindings: wgpu::BindGroup,
    band: Band,
    workgroups: [u32; 3],
}

/// The GPU backend.
pub struct GpuExecutor {
    gpu: Gpu,
    pipelines: BTreeMap<(&'static str, &'static str), Pipeline>,
    buffers: BTreeMap<(&'static Buffer, usize), StorageBuffer>,
    bands: Vec<Band>,
    steps: Vec<Step>,
    parameters: Parameters,
    /// Read-backs of the frames in flight, one set a place; a place gets its set when it is first used.
    ring: Vec<Vec<Readback>>,
    texture: Option<TextureOut>,
    slab: Option<Slab<f32>>,

    /// Numbers of a buffer in a frame.
    numbers: Vec<f32>,
    timer: Option<Timer>,
    times: Vec<PassTime>,
    frame_ms: Option<f64>,
}

impl GpuExecutor {
    /// Compiles the passes of a plan and allocates the buffers of its resources.
    pub fn new(gpu: Gpu, plan: &Plan, tables: &Tables) -> Result<Self, SynthError> {
        let parameters = Parameters::new(&gpu, "parameters", 1)?;
        let mut executor = Self {
            gpu,
            pipelines: BTreeMap::new(),
            buffers: BTreeMap::new(),
            bands: Vec::new(),
            steps: Vec::new(),
            parameters,
            ring: Vec::new(),
            texture: None,
            slab: None,
            numbers: Vec::new(),
            timer: None,
            times: Vec::new(),
            frame_ms: None,
        };
        executor.fit(plan, tables, &[])?;
        Ok(executor)
    }

    /// Adapts to a changed plan: creates new objects, drops unused ones, and uploads changed data.
    pub fn fit(&mut self, plan: &Plan, tables: &Tables, changed: &[&'static Buffer]) -> Result<(), SynthError> {
        if self.gpu.report().software {
            memory::check(plan.bytes().saturating_sub(self.bytes()), "a frame on software Vulkan")?;
        }
        self.bands = plan.bands(tables, self.gpu.limits().max_storage_buffer_binding_size);
        let parts = |buffer: &Buffer, bands: &[Band]| if buffer.is_per_pixel { bands.len() } else { 1 };
        self.buffers
            .retain(|&(buffer, part), _| plan.uses(buffer) && part < parts(buffer, &self.bands));
        let per_frame = plan
            .resources
            .iter()
            .filter(|planned| planned.resource.per_frame.is_some());
        // Twice their size, as some compute them in two steps.
        let most = per_frame.map(|planned| planned.bytes as usize / 2).max().unwrap_or(0);
        self.numbers.clear();
        self.numbers.reserve(most);
        match &tables.mesh {
            Some(mesh) if plan.uses(&ELEMENT_MAPS) => self.slab.get_or_insert_with(|| Slab::new(mesh)).forget(),
            _ => self.slab = None,
        }
        for planned in &plan.resources {
            for part in 0..parts(planned.resource, &self.bands) {
                let changed = changed.contains(&planned.resource);
                self.fit_buffer(planned.resource, planned.bytes, part, tables, changed)?;
            }
        }
        self.fit_steps(plan, tables)?;
        self.fit_outputs(tables)?;
        if self.timer.is_some() {
            self.time_passes(true, plan)?;
        }
        Ok(())
    }

    /// Keeps read-backs and the host's texture as long as the image size does not change.
    fn fit_outputs(&mut self, tables: &Tables) -> Result<(), GpuError> {
        let row_bytes = tables.words_per_row() as u64 * 4;
        let sizes = self.bands.iter().map(|band| u64::from(band.rows) * row_bytes);
        let kept = self
            .ring
            .first()
            .is_some_and(|first| sizes.eq(first.iter().map(Readback::bytes)));
        if !kept {
            self.ring.clear();
            self.reserve_place(tables, 0)?;
        }
        let size = (tables.width() as u32, tables.height() as u32);
        self.texture
            .take_if(|kept| (kept.texture().width(), kept.texture().height()) != size);
        Ok(())
    }

    /// Makes read-backs for the places of the ring up to one.
    fn reserve_place(&mut self, tables: &Tables, place: usize) -> Result<(), GpuError> {
        let row_bytes = tables.words_per_row() as u64 * 4;
        while self.ring.len() <= place {
            let bands = self.bands.iter();
            let readbacks = bands.map(|band| Readback::new(&self.gpu, "pixels", u64::from(band.rows) * row_bytes));
            self.ring.push(readbacks.collect::<Result<_, _>>()?);
        }
        Ok(())
    }

    fn fit_buffer(
        &mut self,
        buffer: &'static Buffer,
        bytes: u64,
        part: usize,
        tables: &Tables,
        changed: bool,
    ) -> Result<(), GpuError> {
        let bytes = if buffer.is_per_pixel {
            bytes / tables.height() as u64 * u64::from(self.bands[part].rows)
        } else {
            bytes
        };
        let key = (buffer, part);
        let fits = self
            .buffers
            .get(&key)
            .is_some_and(|made| made.bytes() == bytes.next_multiple_of(4).max(4));
        if !fits {
            let made = StorageBuffer::zeroed(&self.gpu, buffer.name, bytes)?;
            self.buffers.insert(key, made);
        }
        match buffer.contents {
            Some(contents) if !fits || changed => {
                self.buffers[&key].write(&self.gpu, 0, &contents(tables, self.bands[part]))
            }
            _ => Ok(()),
        }
    }

    fn fit_steps(&mut self, plan: &Plan, tables: &Tables) -> Result<(), GpuError> {
        self.steps.clear();
        let dispatches = plan.passes.iter().map(|planned| {
            if is_per_pixel(planned.pass) {
                self.bands.len()
            } else {
                1
            }
        });
        self.parameters = Parameters::new(&self.gpu, "parameters", dispatches.sum::<usize>() as u32)?;
        let whole = Band {
            first_row: 0,
            rows: tables.height() as u32,
        };
        let mut flipped = false;
        for planned in &plan.passes {
            let pass = planned.pass;
            let pipeline = self.pipeline(pass)?;
            let bands: Cow<[Band]> = if is_per_pixel(pass) {
                self.bands.clone().into()
            } else {
                vec![whole].into()
            };
            for (part, &band) in bands.iter().enumerate() {
                let bound: Vec<&StorageBuffer> = pass
                    .bindings
                    .iter()
                    .map(|&(buffer, _)| {
                        &self.buffers[&(actual(buffer, flipped), if buffer.is_per_pixel { part } else { 0 })]
                    })
                    .collect();
                let bindings = pipeline.bind(&self.gpu, &self.parameters, &bound)?;
                let workgroups = (pass.workgroups)(tables, band);
                self.steps.push(Step {
                    pass,
                    pipeline: pipeline.clone(),
                    bindings,
                    band,
                    workgroups,
                });
            }
            flipped ^= pass.flips;
        }
        let used: Vec<_> = self
            .steps
            .iter()
            .map(|step| (step.pass.name, step.pass.entry))
            .collect();
        self.pipelines.retain(|key, _| used.contains(key));
        Ok(())
    }

    fn pipeline(&mut self, pass: &'static Pass) -> Result<Pipeline, GpuError> {
        if let Some(pipeline) = self.pipelines.get(&(pass.name, pass.entry)) {
            return Ok(pipeline.clone());
        }
        let storage: Vec<Access> = pass.bindings.iter().map(|&(_, access)| access).collect();
        let source = PassSource {
            label: pass.name,
            source: pass.shader,
            entry: pass.entry,
            storage: &storage,
            constants: &[],
        };
        let pipeline = Pipeline::new(&self.gpu, &source)?;
        self.pipelines.insert((pass.name, pass.entry), pipeline.clone());
        Ok(pipeline)
    }

    /// Submits a frame, whose pixels are asked for at a place of the ring.
    pub fn submit(&mut self, tables: &Tables, state: &FrameState, place: usize) -> Result<Submission, SynthError> {
        let gpu = self.gpu.clone();
        gpu.scoped("frame", || {
            self.reserve_place(tables, place)?;
            self.upload(tables, state)?;
            let submission = gpu.submit("frame", |recorder| {
                self.run_all(recorder)?;
                for (part, readback) in self.ring[place].iter().enumerate() {
                    recorder.read_back(&self.buffers[&(&PIXELS, part)], readback)?;
                }
                Ok(())
            })?;
            self.ring[place].iter().for_each(Readback::request);
            Ok(submission)
        })
    }

    /// Whether the pixels of a place have come; never waits.
    pub fn is_ready(&self, place: usize) -> Result<bool, SynthError> {
        self.gpu.poll_once()?;
        Ok(self.ring[place].iter().all(Readback::is_ready))
    }

    /// Waits for a submission, and copies the pixels of its place.
    pub fn take(
        &mut self,
        (plan, tables): (&Plan, &Tables),
        submission: Submission,
        place: usize,
        pixels: &mut [u8],
    ) -> Result<(), SynthError> {
        let gpu = self.gpu.clone();
        gpu.scoped("pixels", || {
            let waited = gpu.wait_for("a frame", Some(submission));
            let (width, stride) = (tables.width(), tables.words_per_row() * 4);
            let copied = waited.and_then(|()| {
                self.bands
                    .iter()
                    .zip(&self.ring[place])
                    .try_for_each(|(band, readback)| {
                        let rows = &mut pixels[band.first_row as usize * width..][..band.rows as usize * width];
                        readback.copy_rows(rows, width, stride)
                    })
            });
            self.release(place);
            copied?;
            self.read_times(plan)
        })
    }

    /// Gives up the pixels of a place.
    pub fn release(&self, place: usize) {
        for readback in self.ring.get(place).into_iter().flatten() {
            readback.release(&self.gpu);
        }
    }

    /// Renders a frame into the texture.
    pub fn render_to_texture(&mut self, plan: &Plan, tables: &Tables, state: &FrameState) -> Result<(), SynthError> {
        let gpu = self.gpu.clone();
        gpu.scoped("frame", || {
            self.prepare_texture(tables, state)?;
            gpu.submit("frame", |recorder| self.run_into_texture(recorder))?;
            self.read_times(plan)
        })
    }

    /// Records a frame into a host's encoder, up to its copy into the texture.
    pub fn encode(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        tables: &Tables,
        state: &FrameState,
    ) -> Result<(), SynthError> {
        let gpu = self.gpu.clone();
        gpu.scoped("frame", || {
            self.prepare_texture(tables, state)?;
            Ok(self.run_into_texture(&mut Recorder::new(&gpu, encoder))?)
        })
    }

    fn prepare_texture(&mut self, tables: &Tables, state: &FrameState) -> Result<(), SynthError> {
        if self.texture.is_none() {
            self.texture = Some(self.make_texture(tables)?);
        }
        self.upload(tables, state)
    }

    fn run_into_texture(&self, recorder: &mut Recorder) -> Result<(), GpuError> {
        self.run_all(recorder)?;
        match &self.texture {
            Some(texture) => recorder.copy_to_texture(&self.buffers[&(&PIXELS, 0)], texture),
            None => Ok(()),
        }
    }

    fn run_all(&self, recorder: &mut Recorder) -> Result<(), GpuError> {
        self.clear_hits(recorder);
        let dispatches = dispatches(&self.steps, 0..self.steps.len());
        match &self.timer {
            Some(timer) => recorder.run_timed(timer, dispatches),
            None => recorder.run("frame", dispatches),
        }
    }

    /// Runs the steps up to and including a pass; all of them if there is none of that name.
    pub fn run_until(&mut self, pass: &str, tables: &Tables, state: &FrameState) -> Result<(), SynthError> {
        self.upload(tables, state)?;
        self.gpu.submit("clear", |recorder| {
            self.clear_hits(recorder);
            Ok(())
        })?;
        self.run_steps(0, self.end_of(pass))
    }

    /// Forgets the samples that the warp found in the last frame.
    fn clear_hits(&self, recorder: &mut Recorder) {
        if let Some(hits) = self.buffers.get(&(&HITS, 0)) {
            recorder.clear(hits);
        }
    }

    /// Goes on with the frame that [`Self::run_until`] began: from behind a pass up to and including another.
    pub fn run_on(&mut self, behind: &str, pass: &str) -> Result<(), SynthError> {
        let start = self.end_of(behind);
        self.run_steps(start, self.end_of(pass).max(start))
    }

    fn end_of(&self, pass: &str) -> usize {
        let last = self.steps.iter().rposition(|step| step.pass.name == pass);
        last.map_or(self.steps.len(), |at| at + 1)
    }

    fn run_steps(&mut self, start: usize, end: usize) -> Result<(), SynthError> {
        self.gpu.submit("part of a frame", |recorder| {
            recorder.run("part of a frame", dispatches(&self.steps, start..end))
        })?;
        Ok(())
    }

    fn upload(&mut self, tables: &Tables, state: &FrameState) -> Result<(), SynthError> {
        if let Some(slab) = &mut self.slab {
            let moved = slab.update(tables, state)?;
            let maps = &self.buffers[&(&ELEMENT_MAPS, 0)];
            let [frames_at, carries_at] = maps_at(tables).map(|at| 16 * u64::from(at));
            if moved.reference {
                maps.write(&self.gpu, 0, slab.reference.frames.as_flattened())?;
            }
            if moved.deformed {
                maps.write(&self.gpu, frames_at, slab.deformed.frames.as_flattened())?;
                maps.write(&self.gpu, carries_at, slab.deformed.carries.as_flattened())?;
            }
        }
        let view = View {
            tables,
            state,
            slab: self.slab.as_ref(),
        };
        for (&(buffer, _), made) in &self.buffers {
            if let Some(numbers) = buffer.per_frame {
                numbers(tables, state, &mut self.numbers);
                made.write(&self.gpu, 0, &self.numbers)?;
            }
        }
        for (slot, step) in self.steps.iter().enumerate() {
            self.parameters
                .set(slot as u32, (step.pass.params)(&view, step.band).slot())?;
        }
        Ok(self.parameters.write(&self.gpu)?)
    }

    fn make_texture(&self, tables: &Tables) -> Result<TextureOut, GpuError> {
        if self.bands.len() > 1 {
            return Err(GpuError::Limit {
                what: "a frame left on the GPU in one piece".into(),
                limit: "max_storage_buffer_binding_size",
                needed: SCAN_MAP.bytes(tables),
                available: self.gpu.limits().max_storage_buffer_binding_size,
            });
        }
        TextureOut::new(&self.gpu, tables.width() as u32, tables.height() as u32)
    }

    /// Enables or disables timing of passes.
    pub fn time_passes(&mut self, on: bool, plan: &Plan) -> Result<(), SynthError> {
        let names: Vec<&str> = self.steps.iter().map(|step| step.pass.name).collect();
        self.timer = if on { Timer::new(&self.gpu, &names)? } else { None };
        self.times.clear();
        self.frame_ms = None;
        self.times.reserve_exact(plan.passes.len());
        Ok(())
    }

    fn read_times(&mut self, plan: &Plan) -> Result<(), SynthError> {
        self.times.clear();
        self.frame_ms = None;
        let Some(timer) = &mut self.timer else { return Ok(()) };
        let timings = timer.read(&self.gpu)?;
        self.frame_ms = Some(timings.frame_ms);
        for planned in &plan.passes {
            let name = planned.pass.name;
            let ms = timings
                .passes
                .iter()
                .filter(|pass| pass.name == name)
                .map(|pass| pass.ms)
                .sum();
            self.times.push(PassTime { name, ms });
        }
        Ok(())
    }

    /// Reads the beam-space results of the last frame, relative to the local origin, as they were after the last executed pass.
    pub fn beam(&self, flipped: bool, tables: &Tables) -> Result<Beam, SynthError> {
        let count = tables.lines() * tables.samples();
        let words = |buffer: &'static Buffer, per_sample: usize| -> Result<Vec<u32>, GpuError> {
            let Some(buffer) = self.buffers.get(&(buffer, 0)) else {
                return Ok(Vec::new());
            };
            let mut readback = Readback::new(&self.gpu, "beam", (count * per_sample * 4) as u64)?;
            let mut words = vec![0u32; count * per_sample];
            self.gpu
                .submit("beam", |recorder| recorder.read_back(buffer, &readback))?;
            readback.read(&self.gpu, &mut words)?;
            Ok(words)
        };
        let numbers =
            |words: Vec<u32>| -> Vec<f64> { words.into_iter().map(|word| f64::from(f32::from_bits(word))).collect() };
        let mask = numbers(words(&NEEDLE_MASK, 2)?);
        let elements = self.slab.as_ref().map_or(&[][..], |slab| &slab.deformed.elements);
        Ok(Beam {
            lines: tables.lines(),
            samples: tables.samples(),
            position: numbers(words(&POSITION, 4)?)
                .chunks_exact(4)
                .map(|p| [p[0], p[1], p[2], p[3]])
                .collect(),
            element: numbered(elements, words(&ELEMENT, 1)?),
            label: words(&LABEL, 1)?.into_iter().map(|word| word as u8).collect(),
            amplitude: numbers(words(actual(&AMPLITUDE, flipped), 1)?),
            needle: mask.iter().step_by(2).copied().collect(),
            shade: mask.iter().skip(1).step_by(2).copied().collect(),
            loss: words(&LOSS, 1)?,
        })
    }

    /// GPU device of this executor.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// Texture of the last frame rendered into it.
    pub fn texture(&self) -> Option<&wgpu::Texture> {
        self.texture.as_ref().map(TextureOut::texture)
    }

    /// Durations of the passes of the last frame.
    pub fn times(&self) -> &[PassTime] {
        &self.times
    }

    /// GPU time of the last frame, from its first timestamp to its last, ms.
    pub fn frame_ms(&self) -> Option<f64> {
        self.frame_ms
    }

    /// Names of the compiled passes.
    pub fn pipelines(&self) -> impl Iterator<Item = &'static str> + '_ {
        self.pipelines.keys().map(|(name, _)| *name)
    }

    /// Size of all buffers, bytes.
    pub fn bytes(&self) -> u64 {
        self.buffers.values().map(StorageBuffer::bytes).sum()
    }
}

/// Dispatches of a range of steps. The slot of a step's parameters is its place among all steps.
fn dispatches(steps: &[Step], range: Range<usize>) -> impl Iterator<Item = Dispatch<'_>> {
    range.map(|slot| Dispatch {
        pipeline: &steps[slot].pipeline,
        bindings: &steps[slot].bindings,
        slot: slot as u32,
        workgroups: steps[slot].workgroups,
    })
}

fn is_per_pixel(pass: &Pass) -> bool {
    pass.bindings.iter().any(|(buffer, _)| buffer.is_per_pixel)
}

/// Buffer that is bound in place of one, given whether the number of flips is odd.
fn actual(buffer: &'static Buffer, flipped: bool) -> &'static Buffer {
    match flipped {
        true if *buffer == AMPLITUDE => &AMPLITUDE_NEXT,
        true if *buffer == AMPLITUDE_NEXT => &AMPLITUDE,
        _ => buffer,
    }
}
