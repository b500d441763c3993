use super::*;
use crate::{Dispatch, Readback, testing};

const SCALE: &str = "
    struct Parameters { factor: u32 }
    const bias = 0u;
    @group(0) @binding(0) var<storage, read> parameters: Parameters;
    @group(0) @binding(1) var<storage, read> source: array<u32>;
    @group(0) @binding(2) var<storage, read_write> result: array<u32>;
    @compute @workgroup_size(64)
    fn scale(@builtin(global_invocation_id) id: vec3u) {
        if id.x < arrayLength(&result) { result[id.x] = source[id.x] * parameters.factor + bias; }
    }";

fn scale(source: &str) -> PassSource<'_> {
    PassSource {
        label: "scale",
        source,
        entry: "scale",
        storage: &[Access::Read, Access::Write],
        loops: Loops::COUNTED,
    }
}

#[test]
fn a_chain_of_passes_takes_each_its_own_slot() {
    let Some(gpu) = testing::open() else { return };
    let input: Vec<u32> = (0..1000).collect();
    let first = StorageBuffer::upload(&gpu, "first", &input).unwrap();
    let second = StorageBuffer::zeroed(&gpu, "second", first.bytes()).unwrap();
    let mut parameters = Parameters::new(&gpu, "parameters", 2).unwrap();
    let plain = Pipeline::new(&gpu, &scale(SCALE)).unwrap();
    let biased = Pipeline::new(&gpu, &scale(&SCALE.replace("bias = 0u", "bias = 5u"))).unwrap();
    let there = plain.bind(&gpu, &parameters, &[&first, &second]).unwrap();
    let back = biased.bind(&gpu, &parameters, &[&second, &first]).unwrap();
    let mut readback = Readback::new(&gpu, "first", first.bytes()).unwrap();
    let workgroups = [1000_u32.div_ceil(64), 1, 1];

    let mut expected = input;
    for factor in [2_u32, 3] {
        parameters.set(0, &factor).unwrap();
        parameters.set(1, &10_u32).unwrap();
        parameters.write(&gpu).unwrap();
        gpu.submit("frame", |recorder| {
            recorder.run(
                "frame",
                [
                    Dispatch {
                        pipeline: &plain,
                        bindings: &there,
                        slot: 0,
                        workgroups,
                    },
                    Dispatch {
                        pipeline: &biased,
                        bindings: &back,
                        slot: 1,
                        workgroups,
                    },
                ],
            )?;
            recorder.read_back(&first, &readback)
        })
        .unwrap();
        let mut result = vec![0_u32; 1000];
        readback.read(&gpu, &mut result).unwrap();
        expected.iter_mut().for_each(|value| *value = *value * factor * 10 + 5);
        assert_eq!(result, expected);
    }
}

#[test]
fn wgsl_that_does_not_parse_names_the_pass_and_the_line() {
    let Some(gpu) = testing::open() else { return };
    let broken = SCALE.replace("source[id.x] *", "source[id.x] * nonsense *");
    match Pipeline::new(&gpu, &scale(&broken)).unwrap_err() {
        GpuError::Shader { pass, line, message } => {
            assert_eq!((pass.as_str(), line), ("scale", Some(9)));
            assert!(message.contains("nonsense"), "{message}");
        }
        other => panic!("{other}"),
    }
    assert_eq!(gpu.check(), Ok(()));
}

#[test]
fn a_pass_that_does_not_fit_its_declaration_is_an_error() {
    let Some(gpu) = testing::open() else { return };
    let large = SCALE.replace("factor: u32", "factor: u32, more: array<vec4u, 16>");
    let cases = [
        (
            "an unknown entry point",
            PassSource {
                entry: "missing",
                ..scale(SCALE)
            },
        ),
        (
            "a buffer less than the WGSL binds",
            PassSource {
                storage: &[Access::Read],
                ..scale(SCALE)
            },
        ),
        (
            "an access against the WGSL's",
            PassSource {
                storage: &[Access::Read; 2],
                ..scale(SCALE)
            },
        ),
        ("a block larger than its slot", scale(&large)),
    ];
    for (what, source) in cases {
        let error = Pipeline::new(&gpu, &source).err();
        assert!(
            matches!(&error, Some(GpuError::Shader { pass, .. }) if pass == "scale"),
            "{what}: {error:?}"
        );
    }
}

#[test]
fn more_storage_buffers_than_the_device_has_is_a_limit() {
    let Some(gpu) = testing::open() else { return };
    let available = u64::from(gpu.limits().max_storage_buffers_per_shader_stage);
    let storage = vec![Access::Read; available as usize];
    let source = PassSource {
        storage: &storage,
        ..scale(SCALE)
    };
    assert_eq!(
        testing::exceeded("scale", Pipeline::new(&gpu, &source)),
        ("max_storage_buffers_per_shader_stage", available + 1, available)
    );
}

#[test]
fn bindings_and_slots_are_counted() {
    let Some(gpu) = testing::open() else { return };
    let pipeline = Pipeline::new(&gpu, &scale(SCALE)).unwrap();
    let buffer = StorageBuffer::zeroed(&gpu, "buffer", 4).unwrap();
    let mut parameters = Parameters::new(&gpu, "parameters", 1).unwrap();
    let short = pipeline.bind(&gpu, &parameters, &[&buffer]);
    assert!(
        matches!(
            short,
            Err(GpuError::Mismatch {
                expected: 2,
                found: 1,
                ..
            })
        ),
        "{short:?}"
    );
    assert!(matches!(
        parameters.set(1, &0_u32),
        Err(GpuError::Mismatch { found: 1, .. })
    ));
    assert!(matches!(
        parameters.set(0, &[0_u32; 65]),
        Err(GpuError::Mismatch { found: 260, .. })
    ));
    assert_eq!(parameters.set(0, &[0_u32; 64]), Ok(()));
}
