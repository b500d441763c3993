//! Test of the random hash on a GPU.

use crate::base::random::{hash3, seed_words};
use crate::gpu::{Access, Dispatch, Gpu, GpuError, Parameters, PassSource, Pipeline, Readback, StorageBuffer};

/// Hash of each point, where `points` holds each point followed by its seed.
const SHADER: &str = concat!(
    include_str!("../../../../shaders/common/hash.wgsl"),
    "
@group(0) @binding(1) var<storage, read> points: array<vec4<i32>>;
@group(0) @binding(2) var<storage, read_write> words: array<vec4<u32>>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < arrayLength(&words) {
        let seed = bitcast<vec2<u32>>(points[2u * id.x + 1u].xy);
        words[id.x] = vec4<u32>(hash3(points[2u * id.x].xyz, seed), 0u);
    }
}
"
);

/// Returns lattice points at the ends of the integer range, and a spread of others.
fn points(count: usize) -> Vec<[i32; 3]> {
    let ends = [0, 1, -1, i32::MIN, i32::MAX];
    let corners = (0..125).map(|at| [at % 5, at / 5 % 5, at / 25].map(|place| ends[place as usize]));
    let spread = (0..).map(|at: i32| hash3([at, 0, 0], [3, 5]).map(|word| word as i32));
    corners.chain(spread).take(count).collect()
}

/// Returns how many hashes differ from those of the CPU, and how many were compared.
///
/// # Errors
/// [`GpuError`] if the device cannot run the hash.
pub fn apart(gpu: &Gpu, seeds: &[u64], count: usize) -> Result<[usize; 2], GpuError> {
    let points = points(count);
    let pairs = || {
        seeds
            .iter()
            .flat_map(|&seed| points.iter().map(move |&point| (point, seed_words(seed))))
    };
    let input: Vec<[i32; 4]> = pairs()
        .flat_map(|([x, y, z], seed)| [[x, y, z, 0], [seed[0] as i32, seed[1] as i32, 0, 0]])
        .collect();
    let expected: Vec<[u32; 3]> = pairs().map(|(point, seed)| hash3(point, seed)).collect();
    let points = StorageBuffer::upload(gpu, "points", &input)?;
    let bytes = (expected.len() * 16) as u64;
    let words = StorageBuffer::zeroed(gpu, "words", bytes)?;
    let pipeline = Pipeline::new(
        gpu,
        &PassSource {
            label: "hash",
            source: SHADER,
            entry: "main",
            storage: &[Access::Read, Access::Write],
            constants: &[],
        },
    )?;
    let parameters = Parameters::new(gpu, "none", 1)?;
    let bindings = pipeline.bind(gpu, &parameters, &[&points, &words])?;
    let mut readback = Readback::new(gpu, "words", bytes)?;
    gpu.submit("hashes", |recorder| {
        recorder.run(
            "hashes",
            [Dispatch {
                pipeline: &pipeline,
                bindings: &bindings,
                slot: 0,
                workgroups: [expected.len().div_ceil(64) as u32, 1, 1],
            }],
        )?;
        recorder.read_back(&words, &readback)
    })?;
    let mut found = vec![[0u32; 4]; expected.len()];
    readback.read(gpu, &mut found)?;
    let apart = expected.iter().zip(&found).filter(|(a, b)| a[..] != b[..3]).count();
    Ok([apart, expected.len()])
}
