//! Adapters, devices, pipelines, read-back and timing: all that knows wgpu, and nothing that knows ultrasound.
