//! Echoes of point scatterers on a GPU: the pass of `shaders/echoes.wgsl`.

use bytemuck::{Pod, Zeroable};
use insonify_base::parallel;

use super::echoes::{Pulse, REACH, Scatterer};
use insonify_gpu::{Access, Dispatch, Gpu, GpuError, Loops, Parameters, PassSource, Pipeline, Readback, StorageBuffer};

/// WGSL source of the pass.
pub const SHADER: &str = include_str!("../../../shaders/echoes.wgsl");
/// Storage buffers of the pass at bindings 1, 2, ...: scatterers, ranges, pulse, echoes.
pub const STORAGE: [Access; 4] = [Access::Read, Access::Read, Access::Read, Access::Write];
/// Samples of a bin; must equal the shader's constant.
pub const BIN: usize = 64;
/// Invocations of a workgroup.
pub const INVOCATIONS: usize = 64;
/// Samples that an invocation adds up; must equal the shader's constant and divide [`BIN`].
pub const OWN: usize = 8;
/// Every loop of these shaders counts towards a bound that does not change within it, or narrows an interval of
/// integers.
#[allow(unsafe_code, reason = "says that loops end")]
// SAFETY: as above.
const LOOPS: Loops = unsafe { Loops::ending() };

/// Most scatterers that a dispatch adds to a sample: software Vulkan ends loops after 65,535 rounds, and each scatterer
/// takes one for itself and one for each sample.
const ROUNDS: usize = 7000;

/// Parameters of a dispatch.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub struct EchoParams {
    /// Number of lines.
    pub lines: u32,
    /// Number of samples of a line.
    pub samples: u32,
    /// Number of samples of a pulse.
    pub length: u32,
    /// Number of rows of the table of pulses.
    pub rows: u32,
    /// Samples of the bins before sample 0.
    pub ahead: u32,
    /// First scatterer of a sample that is added.
    pub first: u32,
    /// Number of scatterers added.
    pub count: u32,
}

/// Scatterer as the shader reads it.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct Packed {
    start: i32,
    /// Row of the table of pulses, between two rows.
    row: f32,
    line: f32,
    amplitude: f32,
    sigma: f32,
    /// First line that the beam reaches, and the last in the upper half.
    reach: u32,
}

/// Scatterers in bins of depth, and for each bin and line the range of those that may reach it.
struct Binned {
    scatterers: Vec<Packed>,
    ranges: Vec<[u32; 2]>,
    /// Largest number of scatterers in the ranges of a sample.
    most: usize,
}

/// The pass with its buffers.
pub struct Device {
    gpu: Gpu,
    pipeline: Pipeline,
    params: EchoParams,
    pulse: StorageBuffer,
    ranges: StorageBuffer,
    echoes: StorageBuffer,
    readback: Readback,
    scatterers: StorageBuffer,
    parameters: Parameters,
    bindings: wgpu::BindGroup,
}

impl Device {
    /// Compiles the pass and allocates buffers for `lines` scanlines of `samples`.
    ///
    /// # Errors
    /// [`GpuError`] where the device fails or a buffer exceeds its limits.
    pub fn new(gpu: &Gpu, pulse: &Pulse, lines: usize, samples: usize) -> Result<Self, GpuError> {
        let length = pulse.length();
        let params = EchoParams {
            lines: lines as u32,
            samples: samples as u32,
            length: length as u32,
            rows: pulse.rows() as u32,
            // Echoes that begin before sample 0 reach into the image; in whole bins, so that sample 0 begins
            // one.
            ahead: length.next_multiple_of(BIN) as u32,
            ..EchoParams::default()
        };
        let pipeline = Pipeline::new(
            gpu,
            &PassSource {
                label: "echoes",
                source: SHADER,
                entry: "echoes",
                storage: &STORAGE,
                loops: LOOPS,
            },
        )?;
        let bins = params.bins();
        let echoes = StorageBuffer::zeroed(gpu, "echoes", (lines * samples * size_of::<f32>()) as u64)?;
        let ranges = StorageBuffer::zeroed(
            gpu,
            "ranges of scatterers",
            (bins * lines * size_of::<[u32; 2]>()) as u64,
        )?;
        let pulse = StorageBuffer::upload(gpu, "pulse", pulse.table())?;
        // An empty buffer cannot be bound; frames enlarge this one.
        let scatterers = StorageBuffer::zeroed(gpu, "scatterers", size_of::<Packed>() as u64)?;
        let parameters = Parameters::new(gpu, "echoes", 1)?;
        Ok(Self {
            readback: Readback::new(gpu, "echoes", echoes.bytes())?,
            bindings: pipeline.bind(gpu, &parameters, &[&scatterers, &ranges, &pulse, &echoes])?,
            gpu: gpu.clone(),
            pipeline,
            params,
            pulse,
            ranges,
            echoes,
            scatterers,
            parameters,
        })
    }

    /// Echoes of scatterers, line by line.
    ///
    /// # Errors
    /// [`GpuError`] where the device fails or the scatterers exceed its limits.
    pub fn echoes(&mut self, scatterers: &[Scatterer]) -> Result<Vec<f32>, GpuError> {
        let binned = Binned::new(scatterers, &self.params);
        // Software Vulkan ends long loops (see `ROUNDS`): samples of more scatterers take further dispatches.
        let dispatches = binned.most.div_ceil(ROUNDS).max(1) as u32;
        self.make_room((binned.scatterers.len() * size_of::<Packed>()) as u64, dispatches)?;
        self.scatterers.write(&self.gpu, 0, &binned.scatterers)?;
        self.ranges.write(&self.gpu, 0, &binned.ranges)?;
        for slot in 0..dispatches {
            let params = EchoParams {
                first: slot * ROUNDS as u32,
                count: ROUNDS as u32,
                ..self.params
            };
            self.parameters.set(slot, &params)?;
        }
        self.parameters.write(&self.gpu)?;
        let groups = self.params.samples.div_ceil((INVOCATIONS * OWN) as u32);
        self.gpu.submit("echoes", |recorder| {
            let dispatch = |slot| Dispatch {
                pipeline: &self.pipeline,
                bindings: &self.bindings,
                slot,
                workgroups: [groups, self.params.lines, 1],
            };
            recorder.run("echoes", (0..dispatches).map(dispatch))?;
            recorder.read_back(&self.echoes, &self.readback)
        })?;
        let mut out = vec![0.0_f32; (self.params.lines * self.params.samples) as usize];
        self.readback.read(&self.gpu, &mut out)?;
        Ok(out)
    }

    /// Enlarges the buffers that a frame outgrows, and binds them.
    fn make_room(&mut self, bytes: u64, slots: u32) -> Result<(), GpuError> {
        if bytes <= self.scatterers.bytes() && slots <= self.parameters.slots() {
            return Ok(());
        }
        if bytes > self.scatterers.bytes() {
            self.scatterers = StorageBuffer::zeroed(&self.gpu, "scatterers", bytes)?;
        }
        if slots > self.parameters.slots() {
            self.parameters = Parameters::new(&self.gpu, "echoes", slots)?;
        }
        let storage = [&self.scatterers, &self.ranges, &self.pulse, &self.echoes];
        self.bindings = self.pipeline.bind(&self.gpu, &self.parameters, &storage)?;
        Ok(())
    }
}

impl EchoParams {
    /// Number of bins: those before sample 0, and those of the samples.
    fn bins(&self) -> usize {
        (self.ahead + self.samples).div_ceil(BIN as u32) as usize
    }

    /// A scatterer whose pulse and beam reach the image.
    fn packed(&self, scatterer: &Scatterer) -> Option<Packed> {
        let (start, [low, high]) = (scatterer.sample.floor(), scatterer.lines(self.lines as usize)?);
        let first = start - (self.length / 2 - 1) as f64;
        (first < f64::from(self.samples) && first > -f64::from(self.length)).then_some(Packed {
            start: first as i32,
            row: scatterer.row(self.rows as usize),
            line: scatterer.line,
            amplitude: scatterer.amplitude,
            sigma: scatterer.sigma,
            reach: low as u32 | (high as u32) << 16,
        })
    }

    fn bin(&self, scatterer: &Packed) -> usize {
        (scatterer.start + self.ahead as i32) as usize / BIN
    }
}

impl Binned {
    fn new(scatterers: &[Scatterer], params: &EchoParams) -> Self {
        let mut scatterers: Vec<Packed> = parallel::filter_map(scatterers, &|scatterer| params.packed(scatterer));
        parallel::sort_by(&mut scatterers, |a, b| {
            params.bin(a).cmp(&params.bin(b)).then(a.line.total_cmp(&b.line))
        });
        let lines = params.lines as usize;
        let ranges = parallel::map(0..params.bins(), &|bin| {
            let from = scatterers.partition_point(|scatterer| params.bin(scatterer) < bin);
            let of_bin = &scatterers[from..];
            let of_bin = &of_bin[..of_bin.partition_point(|scatterer| params.bin(scatterer) == bin)];
            // Rounding of the reach is far below a line.
            let widest = of_bin.iter().map(|scatterer| scatterer.sigma).fold(0.0, f32::max) * REACH as f32 + 1.0;
            let range = |line: usize| {
                let low = of_bin.partition_point(|scatterer| scatterer.line < line as f32 - widest);
                let high = of_bin.partition_point(|scatterer| scatterer.line <= line as f32 + widest);
                [(from + low) as u32, (from + high) as u32]
            };
            (0..lines).map(range).collect::<Vec<_>>()
        });
        let ranges: Vec<[u32; 2]> = ranges.concat();
        let near = params.ahead as usize / BIN + 1;
        let largest = (0..lines).flat_map(|line| {
            let counts: Vec<u32> = ranges
                .iter()
                .skip(line)
                .step_by(lines)
                .map(|[from, to]| to - from)
                .collect();
            counts.windows(near).map(|counts| counts.iter().sum::<u32>()).max()
        });
        Self {
            most: largest.max().unwrap_or(0) as usize,
            scatterers,
            ranges,
        }
    }
}
