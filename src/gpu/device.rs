//! GPU device whose errors are returned as values, never as panics.

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use super::adapter::{self, AdapterChoice, AdapterReport};
use super::buffer::Shared;
use super::faults::check_limit;
use super::traffic::{Counter, Traffic};
use super::{Faults, GpuError, Recorder};

/// Default time limit for waiting on the GPU: Windows resets a GPU after 2 s, software Vulkan on a busy machine
/// needs more.
const WAIT_TIMEOUT: Duration = Duration::from_secs(60);

/// Number of storage buffers per stage that a device is opened with where its adapter has them: fused passes bind many.
const USEFUL_STORAGE_BUFFERS: u32 = 33;

/// Size of storage bindings that a device is opened with where its adapter has it, bytes: the frames of a batch share
/// buffers.
const USEFUL_BINDING_BYTES: u64 = 512 << 20;

/// Device requirements beyond wgpu's default limits; zero means the default.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Needs {
    /// Largest storage buffer that a pass binds, bytes (default limit 128 MiB, or up to 512 MiB where the adapter has
    /// it).
    pub storage_binding_bytes: u64,
    /// Largest buffer, bytes (default limit 256 MiB).
    pub buffer_bytes: u64,
    /// Number of storage buffers that one pass binds (default limit 8).
    pub storage_buffers_per_stage: u32,
}

impl Needs {
    /// Returns wgpu's default limits, raised where needed, or the first limit that `available` cannot meet.
    fn limits(&self, what: &str, available: &wgpu::Limits) -> Result<wgpu::Limits, GpuError> {
        let mut limits = wgpu::Limits::default();
        let useful = USEFUL_BINDING_BYTES
            .min(available.max_storage_buffer_binding_size)
            .min(available.max_buffer_size);
        limits.max_storage_buffer_binding_size = limits
            .max_storage_buffer_binding_size
            .max(self.storage_binding_bytes)
            .max(useful);
        limits.max_buffer_size = limits
            .max_buffer_size
            .max(self.buffer_bytes)
            .max(limits.max_storage_buffer_binding_size.min(available.max_buffer_size));
        limits.max_storage_buffers_per_shader_stage = limits
            .max_storage_buffers_per_shader_stage
            .max(self.storage_buffers_per_stage)
            .max(
                available
                    .max_storage_buffers_per_shader_stage
                    .min(USEFUL_STORAGE_BUFFERS),
            );
        let mut exceeded = None;
        limits.check_limits_with_fail_fn(available, true, |limit, needed, available| {
            exceeded = Some(GpuError::Limit {
                what: what.to_owned(),
                limit,
                needed,
                available,
            });
        });
        exceeded.map_or(Ok(limits), Err)
    }
}

thread_local! {
    /// Device in whose error scope this thread is ([`Faults::id`]), or 0.
    static SCOPED: Cell<usize> = const { Cell::new(0) };
}

/// A wgpu device, opened here or lent by a host, with its queue, its limits and its pending errors. Clones share the
/// device.
///
/// ```
/// use insonify_gpu::{AdapterChoice, Gpu, Needs};
///
/// let needs = Needs { storage_binding_bytes: 64 << 20, ..Needs::default() };
/// // That of the variable `INSONIFY_ADAPTER`, else the best; `AdapterChoice::named` asks for one by its name.
/// match Gpu::open(&AdapterChoice::from_flag(None), &needs) {
///     Ok(gpu) => assert!(gpu.limits().max_storage_buffer_binding_size >= 64 << 20),
///     // Without a GPU the CPU makes the frames.
///     Err(error) => println!("{error}"),
/// }
/// assert!(Gpu::open(&AdapterChoice::named("abacus".into()), &needs).is_err());
/// ```
#[derive(Debug, Clone)]
pub struct Gpu {
    report: Arc<AdapterReport>,
    limits: wgpu::Limits,
    device: wgpu::Device,
    queue: wgpu::Queue,
    faults: Faults,
    counter: Arc<Counter>,
    shared: Arc<Mutex<Shared>>,
    wait_timeout: Duration,
}

impl Gpu {
    /// Opens a device on the chosen adapter, with wgpu's default limits raised only where `needs` exceeds them.
    pub fn open(choice: &AdapterChoice, needs: &Needs) -> Result<Self, GpuError> {
        let adapter = adapter::pick(choice)?;
        let report = AdapterReport::new(&adapter.get_info(), &adapter.limits(), adapter.features());
        let limits = needs.limits(&format!("a device on '{}'", report.name), &adapter.limits())?;
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("insonify"),
            required_features: adapter.features() & (wgpu::Features::TIMESTAMP_QUERY | wgpu::Features::SHADER_F64),
            required_limits: limits.clone(),
            ..Default::default()
        };
        let (device, queue) =
            pollster::block_on(adapter.request_device(&descriptor)).map_err(|error| GpuError::Open {
                adapter: report.name.clone(),
                message: error.to_string(),
            })?;
        // wgpu panics at an error that nobody catches: with these it is an error of the next call.
        let faults = Faults::default();
        device.on_uncaptured_error({
            let faults = faults.clone();
            Arc::new(move |error| faults.report(error))
        });
        device.set_device_lost_callback({
            let faults = faults.clone();
            move |reason, message| faults.report_lost(&format!("{reason:?}"), &message)
        });
        Ok(Self {
            report: report.into(),
            limits,
            device,
            queue,
            faults,
            counter: Arc::default(),
            shared: Arc::default(),
            wait_timeout: WAIT_TIMEOUT,
        })
    }

    /// Wraps a host's own device and queue, checked against `needs`.
    ///
    /// The host keeps its error handler and its device-lost callback: errors of calls made here are caught by error
    /// scopes, and a loss is detected at the next read-back. To report a loss at once, a host forwards it from its
    /// callback through [`Gpu::faults`].
    pub fn from_host(device: wgpu::Device, queue: wgpu::Queue, needs: &Needs) -> Result<Self, GpuError> {
        let limits = device.limits();
        needs.limits("work on the host's device", &limits)?;
        let report = AdapterReport::new(&device.adapter_info(), &limits, device.features());
        Ok(Self {
            report: report.into(),
            limits,
            device,
            queue,
            faults: Faults::default(),
            counter: Arc::default(),
            shared: Arc::default(),
            wait_timeout: WAIT_TIMEOUT,
        })
    }

    /// Report of the adapter; for a host's device, with the limits and features that the host requested.
    pub fn report(&self) -> &AdapterReport {
        &self.report
    }

    /// Limits of the opened device.
    pub fn limits(&self) -> &wgpu::Limits {
        &self.limits
    }

    /// Underlying wgpu device.
    pub fn device(&self) -> &wgpu::Device {
        &self.device
    }

    /// Underlying wgpu queue.
    pub fn queue(&self) -> &wgpu::Queue {
        &self.queue
    }

    /// Store of the errors that reach a handler or callback.
    pub fn faults(&self) -> &Faults {
        &self.faults
    }

    /// Submissions, waits and transfers since the device was opened, those of all clones together.
    pub fn traffic(&self) -> Traffic {
        self.counter.total()
    }

    pub(super) fn shared(&self) -> &Mutex<Shared> {
        &self.shared
    }

    pub(super) fn counter(&self) -> &Counter {
        &self.counter
    }

    /// Whether shaders of the device can compute in f64.
    pub fn has_f64(&self) -> bool {
        self.device.features().contains(wgpu::Features::SHADER_F64)
    }

    /// Whether the device can time passes.
    pub fn has_timestamps(&self) -> bool {
        self.device.features().contains(wgpu::Features::TIMESTAMP_QUERY)
    }

    /// Returns the first asynchronous error since the last check. A lost device stays lost: every check returns the
    /// loss.
    pub fn check(&self) -> Result<(), GpuError> {
        self.faults.take()
    }

    /// Runs `work` and returns the errors that wgpu raised in it; `what` names the work in these errors. Within another
    /// scope of the same device it only runs `work`: a frame has one scope.
    pub fn scoped<T, E: From<GpuError>>(&self, what: &str, work: impl FnOnce() -> Result<T, E>) -> Result<T, E> {
        let outer = SCOPED.replace(self.faults.id());
        if outer == self.faults.id() {
            return work();
        }
        let validation = self.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let internal = self.device.push_error_scope(wgpu::ErrorFilter::Internal);
        let memory = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let result = work();
        let caught = [memory, internal, validation].map(|scope| pollster::block_on(scope.pop()));
        SCOPED.set(outer);
        self.check()?;
        match caught.into_iter().flatten().next() {
            Some(error) => Err(GpuError::from_wgpu(what, error).into()),
            None => result,
        }
    }

    /// Records and submits commands. `label` names them in errors and in graphics debuggers.
    pub fn submit(
        &self,
        label: &str,
        record: impl FnOnce(&mut Recorder<'_>) -> Result<(), GpuError>,
    ) -> Result<wgpu::SubmissionIndex, GpuError> {
        self.scoped(label, || {
            let descriptor = wgpu::CommandEncoderDescriptor { label: Some(label) };
            let mut encoder = self.device.create_command_encoder(&descriptor);
            record(&mut Recorder::new(self, &mut encoder))?;
            self.counter.submitted();
            Ok(self.queue.submit([encoder.finish()]))
        })
    }

    /// Sets the time limit for waiting on the GPU before a [`GpuError::Timeout`]; 60 s by default.
    #[cfg(test)]
    pub fn set_wait_timeout(&mut self, wait_timeout: Duration) {
        self.wait_timeout = wait_timeout;
    }

    /// Waits until all submitted work is complete; `what` names it in errors.
    pub fn wait(&self, what: &str) -> Result<(), GpuError> {
        self.wait_for(what, None)
    }

    /// Waits until a submission and all before it are complete (`None`: the last one); `what` names the work in errors.
    pub fn wait_for(&self, what: &str, submission_index: Option<wgpu::SubmissionIndex>) -> Result<(), GpuError> {
        let timeout = Some(self.wait_timeout);
        self.counter.waited();
        self.poll(
            what,
            wgpu::PollType::Wait {
                submission_index,
                timeout,
            },
        )
    }

    /// Runs the callbacks of complete work, without waiting.
    pub fn poll_once(&self) -> Result<(), GpuError> {
        self.poll("finished work", wgpu::PollType::Poll)
    }

    fn poll(&self, what: &str, how: wgpu::PollType) -> Result<(), GpuError> {
        // wgpu 30 panics inside `Device::poll`, with its locks released, when the driver reports the device lost there.
        let polled = catch_unwind(AssertUnwindSafe(|| self.device.poll(how)));
        self.check()?;
        match polled {
            Ok(Ok(_)) => Ok(()),
            Ok(Err(wgpu::PollError::Timeout)) => Err(GpuError::Timeout {
                what: what.to_owned(),
                seconds: self.wait_timeout.as_secs_f64(),
            }),
            Ok(Err(error)) => Err(GpuError::Internal {
                what: what.to_owned(),
                message: error.to_string(),
            }),
            Err(_) => Err(GpuError::Lost {
                reason: format!("while waiting for {what}"),
            }),
        }
    }

    /// Destroys the device and all its clones, as a driver reset would: for tests of error handling.
    pub fn simulate_loss(&self) -> Result<(), GpuError> {
        self.device.destroy();
        match self.wait("the destruction of the device") {
            Err(GpuError::Lost { .. }) => Ok(()),
            other => other,
        }
    }

    /// Returns an error if `bytes` exceed the storage buffer limit of this device.
    pub fn check_storage(&self, what: &str, bytes: u64) -> Result<(), GpuError> {
        let binding = self.limits.max_storage_buffer_binding_size;
        check_limit(|| what.to_owned(), "max_storage_buffer_binding_size", bytes, binding)?;
        check_limit(
            || what.to_owned(),
            "max_buffer_size",
            bytes,
            self.limits.max_buffer_size,
        )
    }
}

#[cfg(test)]
mod tests;
