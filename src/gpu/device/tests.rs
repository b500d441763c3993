use std::sync::Mutex;

use super::*;
use crate::{Loops, PassSource, Pipeline, Readback, StorageBuffer, testing};

#[test]
fn limits_beyond_the_useful_ones_are_raised_only_where_needed() {
    let default = wgpu::Limits::default();
    let card = wgpu::Limits {
        max_storage_buffer_binding_size: 1 << 30,
        max_buffer_size: 1 << 31,
        ..default.clone()
    };
    let small = Needs {
        storage_binding_bytes: 1 << 20,
        ..Needs::default()
    };
    let useful = wgpu::Limits {
        max_storage_buffer_binding_size: USEFUL_BINDING_BYTES,
        max_buffer_size: USEFUL_BINDING_BYTES,
        ..default.clone()
    };
    assert_eq!(small.limits("x", &card), Ok(useful));
    assert_eq!(small.limits("x", &default), Ok(default.clone()), "no more than it has");
    let large = Needs {
        storage_binding_bytes: 1 << 30,
        ..Needs::default()
    };
    let raised = large.limits("x", &card).unwrap();
    assert_eq!(raised.max_storage_buffer_binding_size, 1 << 30);
    assert_eq!(
        raised.max_buffer_size,
        1 << 30,
        "a binding needs a buffer that holds it"
    );
    assert_eq!(
        raised.max_storage_buffers_per_shader_stage,
        default.max_storage_buffers_per_shader_stage
    );
}

#[test]
fn a_limit_exceeded_is_named_with_both_values() {
    let card = wgpu::Limits::default();
    let cases = [
        (
            Needs {
                storage_binding_bytes: (1 << 27) + 1,
                ..Needs::default()
            },
            "max_storage_buffer_binding_size",
        ),
        (
            Needs {
                buffer_bytes: (1 << 28) + 1,
                ..Needs::default()
            },
            "max_buffer_size",
        ),
        (
            Needs {
                storage_buffers_per_stage: 9,
                ..Needs::default()
            },
            "max_storage_buffers_per_shader_stage",
        ),
    ];
    for (needs, name) in cases {
        let (limit, needed, available) = testing::exceeded("the work", needs.limits("the work", &card));
        assert_eq!((limit, needed), (name, available + 1));
    }
}

#[test]
fn a_device_beyond_its_adapter_is_refused_by_name() {
    let Some(gpu) = testing::open() else { return };
    let available = gpu.report().limits.max_storage_buffer_binding_size;
    let needs = Needs {
        storage_binding_bytes: available + 4,
        ..Needs::default()
    };
    let error = Gpu::open(&AdapterChoice::from_flag(None), &needs).unwrap_err();
    let message = error.to_string();
    assert!(message.contains("max_storage_buffer_binding_size"), "{message}");
    assert!(
        message.contains(&available.to_string()) && message.contains(&(available + 4).to_string()),
        "{message}"
    );
}

#[test]
fn a_lost_device_is_an_error_everywhere_and_a_new_one_can_be_opened() {
    let Some(gpu) = testing::open() else { return };
    let values = StorageBuffer::upload(&gpu, "values", &[1_u32, 2, 3, 4]).unwrap();
    let mut readback = Readback::new(&gpu, "values", values.bytes()).unwrap();
    gpu.simulate_loss().unwrap();

    let lost = |result: Result<(), GpuError>| assert!(matches!(result, Err(GpuError::Lost { .. })), "{result:?}");
    lost(gpu.check());
    lost(gpu.check());
    lost(
        gpu.submit("after loss", |recorder| recorder.read_back(&values, &readback))
            .map(drop),
    );
    lost(readback.read(&gpu, &mut [0_u32; 4]));
    lost(values.write(&gpu, 0, &[5_u32]));
    lost(StorageBuffer::zeroed(&gpu, "after loss", 16).map(drop));
    lost(gpu.wait("nothing"));

    let fresh = testing::open().unwrap();
    assert_eq!(fresh.check(), Ok(()));
    StorageBuffer::zeroed(&fresh, "fresh", 16).unwrap();
}

#[test]
fn a_device_can_be_shared_by_threads() {
    fn shared<T: Send + Sync>() {}
    shared::<Gpu>();
    shared::<GpuError>();
}

#[test]
fn an_uncaptured_error_is_kept_until_asked_for_and_then_gone() {
    let Some(gpu) = testing::open() else { return };
    let nonsense = wgpu::BufferDescriptor {
        label: Some("nonsense"),
        size: 4,
        usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::STORAGE,
        mapped_at_creation: false,
    };
    let _ = gpu.device().create_buffer(&nonsense);
    assert!(matches!(gpu.check(), Err(GpuError::Validation { .. })));
    assert_eq!(gpu.check(), Ok(()));
}

#[test]
fn a_host_keeps_its_handlers_and_its_loss_shows_at_the_read_back() {
    if testing::open().is_none() {
        return;
    }
    let adapter = adapter::pick(&AdapterChoice::from_flag(None)).unwrap();
    let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor::default())).unwrap();
    let host_saw = Arc::new(Mutex::new(Vec::new()));
    device.on_uncaptured_error({
        let host_saw = Arc::clone(&host_saw);
        Arc::new(move |error: wgpu::Error| host_saw.lock().unwrap().push(error.to_string()))
    });

    let too_much = Needs {
        storage_buffers_per_stage: 9,
        ..Needs::default()
    };
    let refused = Gpu::from_host(device.clone(), queue.clone(), &too_much);
    assert_eq!(
        testing::exceeded("work on the host's device", refused),
        ("max_storage_buffers_per_shader_stage", 9, 8)
    );

    let gpu = Gpu::from_host(device.clone(), queue, &Needs::default()).unwrap();
    let broken = PassSource {
        label: "broken",
        source: "fn",
        entry: "broken",
        storage: &[],
        loops: Loops::COUNTED,
    };
    assert!(matches!(Pipeline::new(&gpu, &broken), Err(GpuError::Shader { .. })));
    let misaligned = StorageBuffer::zeroed(&gpu, "misaligned", 8)
        .unwrap()
        .write(&gpu, 2, &[0_u32]);
    assert!(matches!(misaligned, Err(GpuError::Validation { .. })));
    assert!(!gpu.has_timestamps(), "the host asked for no feature");
    let values = StorageBuffer::upload(&gpu, "values", &[7_u32]).unwrap();
    let mut readback = Readback::new(&gpu, "values", 4).unwrap();
    let mut out = [0_u32];
    gpu.submit("copy", |recorder| recorder.read_back(&values, &readback))
        .unwrap();
    readback.read(&gpu, &mut out).unwrap();
    assert_eq!(out, [7]);

    device.destroy();
    let after = gpu
        .submit("copy", |recorder| recorder.read_back(&values, &readback))
        .and_then(|_| readback.read(&gpu, &mut out));
    assert!(matches!(after, Err(GpuError::Lost { .. })), "{after:?}");
    assert!(
        host_saw.lock().unwrap().is_empty(),
        "our errors are not the host's: {host_saw:?}"
    );
}

#[test]
fn an_exceeded_limit_says_what_to_do() {
    let message = |limit: &'static str| {
        let error = GpuError::Limit {
            what: "a device".into(),
            limit,
            needed: 560 * 560 * 560,
            available: 1 << 27,
        };
        error.to_string()
    };
    let bytes = message("max_storage_buffer_binding_size");
    assert!(
        bytes.contains("at least 175616000, this device has 134217728: compute on the CPU (`--backend cpu`)")
            && bytes.ends_with("resample it to voxels 1.1 times as long"),
        "{bytes}"
    );
    assert!(message("max_storage_buffers_per_shader_stage").ends_with("134217728"));
}
