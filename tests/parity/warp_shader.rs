//! `shaders/warp.wgsl` alone against the CPU locator, sample by sample and frame after frame, on meshes that fold and break.

use insonify::gpu::Gpu;
use insonify::mechanics::mesh::map::{BACKGROUND, FOLDED, MAPPED, OUTSIDE, States, map_lines};
use insonify::mechanics::mesh::pack::{self, Piece, WarpBuffer, WarpCapacities, WarpParams};
use insonify::mechanics::mesh::{Displacement, Locator, NONE, TetMesh};
use wgpu::util::DeviceExt;

use crate::support::gpu::gpu_or_skip;

/// Positions are below 128 mm, where f32 holds them to 8e-6 mm; a fused multiply-add or another order of sums moves the result
/// by a few of these times the stretch of the field, which is below 4 outside folds.
const POSITION_TOLERANCE_MM: f32 = 1e-4;
/// Where the two disagree on the element, the sample lies at a face to within rounding: 1e-5 mm over heights above 1 mm.
const FACE_TOLERANCE: f32 = 5e-5;

const LINES: usize = 64;
const SAMPLES: usize = 128;

type Sample = [f32; 4];

/// The contents of the shader's buffers, as the pieces of a mesh make them up: frames, neighbours, starts, lists.
struct Buffers {
    params: WarpParams,
    bytes: [Vec<u8>; 4],
}

impl Buffers {
    fn new(mesh: &TetMesh, states: &States<f32>) -> Buffers {
        let own = WarpCapacities::of(mesh);
        let bytes =
            [16 * own.frames, 16 * own.neighbours, 4 * own.starts, 4 * own.lists].map(|bytes| vec![0xaa; bytes]);
        let mut buffers = Buffers {
            params: pack::params(states),
            bytes,
        };
        buffers.write(&[pack::topology(states)]);
        buffers.write(&pack::reference(states));
        buffers.follow(states);
        buffers
    }

    /// What a frame writes that moves the current nodes.
    fn follow(&mut self, states: &States<f32>) {
        self.params = WarpParams {
            lines: LINES as u32,
            samples: SAMPLES as u32,
            ..pack::params(states)
        };
        self.write(&pack::deformed(states));
    }

    fn write(&mut self, pieces: &[Piece]) {
        for piece in pieces {
            let buffer = match piece.buffer {
                WarpBuffer::Frames => 0,
                WarpBuffer::Neighbours => 1,
                WarpBuffer::Starts => 2,
                WarpBuffer::Lists => 3,
            };
            self.bytes[buffer][piece.at as usize..][..piece.bytes.len()].copy_from_slice(piece.bytes);
        }
    }
}

struct Shader {
    gpu: Gpu,
    pipeline: wgpu::ComputePipeline,
}

impl Shader {
    fn new(gpu: Gpu) -> Shader {
        let source = wgpu::ShaderSource::Wgsl(include_str!("../../shaders/warp.wgsl").into());
        let module = gpu.device().create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("warp"),
            source,
        });
        let pipeline = gpu.device().create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("warp"),
            layout: None,
            module: &module,
            entry_point: Some("main"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            cache: None,
        });
        Shader { gpu, pipeline }
    }

    fn run(&self, buffers: &Buffers, positions: &mut Vec<Sample>, elements: &mut Vec<u32>) {
        use wgpu::BufferUsages as Usage;
        let make = |label, contents: &[u8], usage| {
            let label = Some(label);
            self.gpu
                .device()
                .create_buffer_init(&wgpu::util::BufferInitDescriptor { label, contents, usage })
        };
        let both = Usage::STORAGE | Usage::COPY_SRC;
        let bound = [
            make("params", bytemuck::bytes_of(&buffers.params), Usage::STORAGE),
            make("positions", bytemuck::cast_slice(positions), both),
            make("elements", bytemuck::cast_slice(elements), both),
            make("frames", &buffers.bytes[0], Usage::STORAGE),
            make("neighbours", &buffers.bytes[1], Usage::STORAGE),
            make("starts", &buffers.bytes[2], Usage::STORAGE),
            make("lists", &buffers.bytes[3], Usage::STORAGE),
        ];
        let entries: Vec<wgpu::BindGroupEntry> = bound
            .iter()
            .enumerate()
            .map(|(binding, buffer)| wgpu::BindGroupEntry {
                binding: binding as u32,
                resource: buffer.as_entire_binding(),
            })
            .collect();
        let group = self.gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("warp"),
            layout: &self.pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        let mut encoder = self
            .gpu
            .device()
            .create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, &group, &[]);
            pass.dispatch_workgroups((positions.len() as u32).div_ceil(64), 1, 1);
        }
        let reads: Vec<wgpu::Buffer> = bound[1..3]
            .iter()
            .map(|source| {
                let read = self.gpu.device().create_buffer(&wgpu::BufferDescriptor {
                    label: Some("read"),
                    size: source.size(),
                    usage: Usage::MAP_READ | Usage::COPY_DST,
                    mapped_at_creation: false,
                });
                encoder.copy_buffer_to_buffer(source, 0, &read, 0, source.size());
                read
            })
            .collect();
        self.gpu.queue().submit([encoder.finish()]);
        for read in &reads {
            read.map_async(wgpu::MapMode::Read, .., |result| result.expect("mapped"));
        }
        self.gpu
            .device()
            .poll(wgpu::PollType::Wait {
                submission_index: None,
                timeout: None,
            })
            .expect("polled");
        *positions = bytemuck::cast_slice(&reads[0].get_mapped_range(..).expect("positions")).to_vec();
        *elements = bytemuck::cast_slice(&reads[1].get_mapped_range(..).expect("elements")).to_vec();
    }
}

fn fan() -> Vec<Sample> {
    (0..LINES * SAMPLES)
        .map(|n| {
            let (line, sample) = (n / SAMPLES, n % SAMPLES);
            let angle = 1.3 * (line as f32 / LINES as f32 - 0.5);
            let depth = 85.0 * sample as f32 / SAMPLES as f32 - 3.0;
            [depth * angle.sin(), depth * angle.cos(), 3.0 + 0.1 * depth, 0.0]
        })
        .collect()
}

/// Reference nodes with every seventh moved, those of the surface too.
fn remeshed(mesh: &TetMesh, by_mm: f64) -> Vec<[f64; 3]> {
    let nodes = mesh.nodes().iter().enumerate();
    nodes
        .map(|(index, node)| match index % 7 {
            0 => [node[0] + by_mm, node[1] - 0.5 * by_mm, node[2] + 0.3 * by_mm],
            _ => *node,
        })
        .collect()
}

#[test]
fn broken_meshes_give_the_same_samples() {
    let Some(shader) = gpu_or_skip("the warp shader on broken meshes").map(Shader::new) else {
        return;
    };
    let mesh = TetMesh::over_box([-40.0, 0.0, -20.0], [40.0, 70.0, 20.0], 1500).unwrap();
    let mut states = States::<f32>::new(&mesh);
    let mut buffers = Buffers::new(&mesh, &states);
    let (mut last_cpu, mut last_gpu) = (vec![NONE; LINES * SAMPLES], vec![NONE; LINES * SAMPLES]);
    let mut seen = [0usize; 4];
    let mut nodes = Vec::new();
    let frames = [
        (6.0, false, 0.0),
        (9.0, false, 0.0),
        (40.0, false, 0.0),
        (9.0, true, 0.0),
        (9.0, false, 0.0),
        (9.0, false, 2.5),
        (6.0, true, 2.5),
        (6.0, false, -3.0),
    ];
    for (depth_mm, broken, remeshed_mm) in frames {
        let press = Displacement::Indentation {
            centre_mm: [0.0; 3],
            direction: [0.1, 1.0, 0.0],
            depth_mm,
            radius_mm: 15.0,
        };
        press.displace(mesh.nodes(), &mut nodes);
        if broken {
            nodes[mesh.nodes().len() / 2] = [f64::NAN; 3];
        }
        let moved = states
            .update(Some(&nodes), Some(&remeshed(&mesh, remeshed_mm)))
            .unwrap();
        if moved.reference {
            buffers.write(&pack::reference(&states));
        }
        buffers.follow(&states);
        let (deformed, reference) = (states.deformed(), states.reference());
        let mut cpu = fan();
        cpu[77] = [1.0, f32::NAN, 2.0, 0.0];
        cpu[78] = [1.0, 2.0, f32::INFINITY, 0.0];
        let world = cpu.clone();
        let mut gpu = cpu.clone();
        map_lines(deformed, reference, SAMPLES, &mut cpu, &mut last_cpu);
        shader.run(&buffers, &mut gpu, &mut last_gpu);
        let mut differing = 0;
        for index in 0..cpu.len() {
            let (a, b) = (cpu[index], gpu[index]);
            seen[a[3] as usize] += 1;
            if index == 77 || index == 78 {
                assert_eq!((b[3], last_gpu[index]), (OUTSIDE as f32, NONE));
                continue;
            }
            if last_cpu[index] == last_gpu[index] && a[3] == b[3] {
                let near = (0..3).all(|k| (a[k] - b[k]).abs() < POSITION_TOLERANCE_MM);
                assert!(near, "sample {index}: {a:?}, {b:?}");
                continue;
            }
            differing += 1;
            let p = [world[index][0], world[index][1], world[index][2]];
            let least = |locator: &Locator<f32>, start| {
                let hit = locator.locate(p, start);
                match hit.element {
                    NONE => f32::INFINITY,
                    _ => hit.bary.into_iter().fold(f32::INFINITY, f32::min).abs(),
                }
            };
            let at_face = [
                least(deformed, last_cpu[index]),
                least(deformed, last_gpu[index]),
                least(reference, NONE),
            ];
            let near = at_face.iter().any(|least| *least < FACE_TOLERANCE);
            assert!(near, "sample {index} at {p:?}: {a:?}, {b:?}: {at_face:?}");
        }
        println!(
            "{depth_mm} mm, remeshed by {remeshed_mm} mm: {differing} of {} differ, at faces; {:?}",
            cpu.len(),
            deformed.report()
        );
    }
    for flag in [MAPPED, BACKGROUND, FOLDED, OUTSIDE] {
        assert!(seen[flag as usize] > 50, "flags {seen:?}");
    }
}
