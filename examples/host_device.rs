//! How does a program that draws with wgpu get frames without copies? It lends its own device and queue, and the frame
//! stays on the GPU as a texture. Here the host has no window: it reads the texture back and saves it.
//!
//! `cargo run --release --example host_device -- host.png`

use std::error::Error;
use std::path::PathBuf;

use insonify::{Backend, FrameState, SceneFile, row_stride, write_png};
use nalgebra::Matrix4;

const SCENE: &str = r#"
volume = { phantom = "abdomen", resolution_mm = 2.0 }
"#;

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args_os().nth(1).map_or("host.png".into(), PathBuf::from);
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle_from_env());
    let Ok(adapter) = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default())) else {
        println!("no GPU adapter: nothing to show");
        return Ok(());
    };
    // A host with modest limits of its own asks what a scene needs: see `Gpu::from_host`, which checks it.
    let descriptor = wgpu::DeviceDescriptor {
        label: Some("host"),
        required_limits: adapter.limits(),
        ..Default::default()
    };
    let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))?;

    let scene = SceneFile::parse(SCENE, "host_device")?.resolve(".".as_ref())?;
    let mut state = FrameState::at(Matrix4::identity());
    scene.state(0, 1, &mut state)?;
    let mut synth = scene.synthesizer(Backend::Host(Box::new((device.clone(), queue.clone()))))?;
    synth.render_to_texture(&state)?;

    let texture = synth.texture().ok_or("the GPU backend leaves a texture")?;
    let (width, height) = (texture.width(), texture.height());
    let pixels = read_back(&device, &queue, texture)?;
    write_png(&path, width as usize, height as usize, &pixels)?;
    println!(
        "{}: {:?} on {}",
        path.display(),
        texture.format(),
        adapter.get_info().name
    );
    Ok(())
}

/// Read-back of a texture, as any host does it.
fn read_back(device: &wgpu::Device, queue: &wgpu::Queue, texture: &wgpu::Texture) -> Result<Vec<u8>, Box<dyn Error>> {
    let stride = row_stride(texture.width());
    let buffer = device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("read back"),
        size: stride * u64::from(texture.height()),
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let layout = wgpu::TexelCopyBufferLayout {
        offset: 0,
        bytes_per_row: Some(stride as u32),
        rows_per_image: None,
    };
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let into = wgpu::TexelCopyBufferInfo {
        buffer: &buffer,
        layout,
    };
    encoder.copy_texture_to_buffer(texture.as_image_copy(), into, texture.size());
    queue.submit([encoder.finish()]);

    let (send, receive) = std::sync::mpsc::channel();
    buffer
        .slice(..)
        .map_async(wgpu::MapMode::Read, move |mapped| drop(send.send(mapped)));
    device.poll(wgpu::PollType::wait_indefinitely())?;
    receive.recv()??;
    let rows = buffer.slice(..).get_mapped_range()?;
    Ok(rows
        .chunks_exact(stride as usize)
        .flat_map(|row| &row[..texture.width() as usize])
        .copied()
        .collect())
}
