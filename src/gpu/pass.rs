//! Compute pass: its pipeline and its explicit bind group layout.

use super::buffer::SLOT_BYTES;
use super::faults::check_limit;
use super::{Access, Gpu, GpuError, Parameters, StorageBuffer};

/// Source and layout of a pass.
///
/// In its WGSL, `@group(0) @binding(0)` is the parameter block (`var<storage, read>`) of at most [`SLOT_BYTES`] bytes
/// unless [`Pipeline::with_block`] states another size (omitted in a pass without parameters), and bindings 1, 2, ...
/// are the storage buffers in the order of `storage`.
#[derive(Debug, Clone, Copy)]
pub struct PassSource<'a> {
    /// Name of the pass in errors, timings and graphics debuggers.
    pub label: &'a str,
    /// WGSL source.
    pub source: &'a str,
    /// Name of the entry point.
    pub entry: &'a str,
    /// Access of the storage buffers at bindings 1, 2, ...
    pub storage: &'a [Access],
    /// What is known of its loops.
    pub loops: Loops,
}

/// What is known of the loops of a shader.
#[derive(Debug, Clone, Copy)]
pub struct Loops {
    end: bool,
}

impl Loops {
    /// Nothing: wgpu counts the turns of each loop and ends it after 2^64.
    pub const COUNTED: Self = Self { end: false };

    /// Each ends by itself, so that none is counted. The counter keeps drivers from unrolling loops: without it some
    /// passes take half the time on a card.
    ///
    /// # Safety
    /// Every loop of the shader ends, whatever the buffers hold: drivers may take an endless loop for unreachable code.
    #[allow(unsafe_code, reason = "an endless loop is undefined behaviour")]
    pub const unsafe fn ending() -> Self {
        Self { end: true }
    }
}

/// A compiled pass. Clones share the pipeline.
#[derive(Debug, Clone)]
pub struct Pipeline {
    label: String,
    storage: usize,
    layout: wgpu::BindGroupLayout,
    pipeline: wgpu::ComputePipeline,
}

impl Pipeline {
    /// Compiles a pass. A [`GpuError::Shader`] names the pass and, if known, the line of its WGSL.
    pub fn new(gpu: &Gpu, pass: &PassSource<'_>) -> Result<Self, GpuError> {
        Self::with_block(gpu, pass, SLOT_BYTES)
    }

    /// Compiles a pass as [`Pipeline::new`] does, with a parameter block of `block_bytes` bytes.
    pub fn with_block(gpu: &Gpu, pass: &PassSource<'_>, block_bytes: u64) -> Result<Self, GpuError> {
        check_limit(
            || format!("pass '{}'", pass.label),
            "max_storage_buffers_per_shader_stage",
            pass.storage.len() as u64 + 1,
            u64::from(gpu.limits().max_storage_buffers_per_shader_stage),
        )?;
        let shader_error = |error, line| match error {
            GpuError::Validation { message, .. } => GpuError::Shader {
                pass: pass.label.to_owned(),
                line,
                message,
            },
            other => other,
        };
        // Compilation and the pipeline each in a scope of their own: only the former knows the line of an error.
        let mut line = None;
        let module = gpu.scoped(pass.label, || {
            let module = compile(gpu.device(), pass);
            let compilation = pollster::block_on(module.get_compilation_info());
            line = compilation
                .messages
                .iter()
                .find_map(|message| message.location)
                .map(|location| location.line_number);
            Ok(module)
        });
        let module = module.map_err(|error| shader_error(error, line))?;
        let (layout, pipeline) = gpu
            .scoped(pass.label, || Ok(build(gpu.device(), pass, &module, block_bytes)))
            .map_err(|error| shader_error(error, None))?;
        Ok(Self {
            label: pass.label.to_owned(),
            storage: pass.storage.len(),
            layout,
            pipeline,
        })
    }

    /// The name of the pass.
    pub fn label(&self) -> &str {
        &self.label
    }

    /// Binds the buffers of [`PassSource::storage`], in that order. The bind group can be reused as long as the
    /// buffers stay the same.
    pub fn bind(
        &self,
        gpu: &Gpu,
        parameters: &Parameters,
        storage: &[&StorageBuffer],
    ) -> Result<wgpu::BindGroup, GpuError> {
        let storage: Vec<_> = storage.iter().map(|buffer| buffer.entire()).collect();
        self.bind_parts(gpu, parameters.slot(), &storage)
    }

    /// Binds parts of buffers as [`Pipeline::bind`] does buffers, with any number of parameter blocks.
    pub fn bind_parts(
        &self,
        gpu: &Gpu,
        parameters: wgpu::BufferBinding<'_>,
        storage: &[wgpu::BufferBinding<'_>],
    ) -> Result<wgpu::BindGroup, GpuError> {
        if storage.len() != self.storage {
            return Err(GpuError::Mismatch {
                what: format!("storage buffers of pass '{}'", self.label),
                expected: self.storage as u64,
                found: storage.len() as u64,
            });
        }
        let resources = std::iter::once(parameters).chain(storage.iter().cloned());
        let entries: Vec<wgpu::BindGroupEntry<'_>> = (0..)
            .zip(resources)
            .map(|(binding, part)| wgpu::BindGroupEntry {
                binding,
                resource: wgpu::BindingResource::Buffer(part),
            })
            .collect();
        let descriptor = wgpu::BindGroupDescriptor {
            label: Some(&self.label),
            layout: &self.layout,
            entries: &entries,
        };
        gpu.scoped(&format!("binding the buffers of pass '{}'", self.label), || {
            Ok(gpu.device().create_bind_group(&descriptor))
        })
    }

    pub(super) fn raw(&self) -> &wgpu::ComputePipeline {
        &self.pipeline
    }
}

#[allow(unsafe_code, reason = "wgpu has no safe call that leaves out this check alone")]
fn compile(device: &wgpu::Device, pass: &PassSource<'_>) -> wgpu::ShaderModule {
    let descriptor = wgpu::ShaderModuleDescriptor {
        label: Some(pass.label),
        source: wgpu::ShaderSource::Wgsl(pass.source.into()),
    };
    let checks = wgpu::ShaderRuntimeChecks {
        force_loop_bounding: !pass.loops.end,
        ..wgpu::ShaderRuntimeChecks::checked()
    };
    // SAFETY: loops that are not counted end, as who made `loops` promised. All other checks are on.
    unsafe { device.create_shader_module_trusted(descriptor, checks) }
}

fn build(
    device: &wgpu::Device,
    pass: &PassSource<'_>,
    module: &wgpu::ShaderModule,
    block_bytes: u64,
) -> (wgpu::BindGroupLayout, wgpu::ComputePipeline) {
    let block = wgpu::BindingType::Buffer {
        ty: wgpu::BufferBindingType::Storage { read_only: true },
        has_dynamic_offset: true,
        min_binding_size: wgpu::BufferSize::new(block_bytes),
    };
    let storage = pass.storage.iter().map(|access| wgpu::BindingType::Buffer {
        ty: wgpu::BufferBindingType::Storage {
            read_only: *access == Access::Read,
        },
        has_dynamic_offset: false,
        min_binding_size: None,
    });
    let entries: Vec<wgpu::BindGroupLayoutEntry> = (0..)
        .zip(std::iter::once(block).chain(storage))
        .map(|(binding, ty)| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty,
            count: None,
        })
        .collect();
    let label = Some(pass.label);
    let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label,
        entries: &entries,
    });
    let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label,
        bind_group_layouts: &[Some(&layout)],
        immediate_size: 0,
    });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label,
        layout: Some(&pipeline_layout),
        module,
        entry_point: Some(pass.entry),
        compilation_options: wgpu::PipelineCompilationOptions {
            // Shaders write their workgroup memory before they read it.
            zero_initialize_workgroup_memory: false,
            ..Default::default()
        },
        cache: None,
    });
    (layout, pipeline)
}

#[cfg(test)]
mod tests;
