use super::*;
use crate::anatomies;
use crate::effects::buffers::{RAYS, SCAN_MAP};
use insonify_anatomy::phantom::{Phantom, PhantomOptions, make};
use insonify_anatomy::volume::LabelVolume;
use insonify_mesh::{InvalidMesh, TetMesh};

/// The CPU, and the GPU of the tests, if there is one.
fn backends() -> Vec<Backend> {
    let gpu = insonify_testing::gpu::gpu_or_skip().map(|gpu| Backend::Gpu(Box::new(gpu)));
    [Backend::Cpu].into_iter().chain(gpu).collect()
}

/// A synthesizer, and states that differ in pose and noise.
fn scene(backend: Backend) -> (Synthesizer, Vec<FrameState>) {
    let (anatomy, settings, state) = anatomies::two_layers();
    let states = (0..5).map(|frame| {
        let mut state = FrameState { frame, ..state.clone() };
        state.probe_to_world[(0, 3)] += 0.5 * frame as f64;
        state
    });
    (Synthesizer::new(anatomy, settings, backend).unwrap(), states.collect())
}

#[test]
fn frames_in_flight_are_those_rendered_one_by_one() {
    for backend in backends() {
        let (mut synth, states) = scene(backend);
        let expected: Vec<Frame> = states
            .iter()
            .map(|state| synth.render(state).unwrap().clone())
            .collect();
        assert_ne!(expected[0].pixels, expected[1].pixels);
        assert!(synth.try_take().unwrap().is_none(), "nothing is in flight");
        let mut tickets: VecDeque<Ticket> = states[..3].iter().map(|state| synth.submit(state).unwrap()).collect();
        assert!(matches!(synth.submit(&states[3]), Err(SynthError::Busy)));
        for (at, expected) in expected.iter().enumerate() {
            let ticket = tickets.pop_front().unwrap();
            // The first without waiting, however often that has to be tried.
            let found = match at {
                0 => loop {
                    if let Some((oldest, frame)) = synth.try_take().unwrap() {
                        assert_eq!(oldest, ticket);
                        break frame.clone();
                    }
                },
                _ => synth.take(ticket).unwrap().clone(),
            };
            assert_eq!(&found, expected, "frame {at}");
            if let Some(next) = states.get(at + 3) {
                tickets.push_back(synth.submit(next).unwrap());
            }
        }
    }
}

#[test]
fn frames_that_nobody_takes_are_dropped() {
    for backend in backends() {
        let (mut synth, states) = scene(backend);
        let expected: Vec<Frame> = states
            .iter()
            .map(|state| synth.render(state).unwrap().clone())
            .collect();
        let tickets: Vec<Ticket> = states[..3].iter().map(|state| synth.submit(state).unwrap()).collect();
        assert_eq!(synth.take(tickets[1]).unwrap(), &expected[1]);
        assert_eq!(synth.take(tickets[0]).unwrap(), &expected[1], "dropped by then");
        // One is in flight, and dropped by each of these.
        assert_eq!(synth.render(&states[4]).unwrap(), &expected[4]);
        synth.submit(&states[0]).unwrap();
        let mut settings = synth.settings().clone();
        settings.image.width *= 2;
        synth.set(settings).unwrap();
        assert!(synth.try_take().unwrap().is_none());
        let ticket = synth.submit(&states[0]).unwrap();
        assert_eq!(synth.take(ticket).unwrap().width, 2 * expected[0].width);
        let singular = FrameState::at(Matrix4::zeros());
        assert!(matches!(synth.submit(&singular), Err(SynthError::Pose(_))));
    }
}

/// Faults for which files are refused.
#[test]
fn poses_that_are_not_rigid_are_refused() {
    for backend in backends() {
        let (mut synth, states) = scene(backend);
        let good = states[1].clone();
        let before = synth.render(&good).unwrap().clone();
        let mut refused = |change: fn(&mut Matrix4<f64>), reason: &str| {
            let mut state = good.clone();
            change(&mut state.probe_to_world);
            let batch = [good.clone(), state.clone()];
            let batch = synth.render_batch(&batch, |_, _| Ok::<_, SynthError>(()));
            for error in [synth.render(&state).map(drop), synth.submit(&state).map(drop), batch] {
                let text = error.expect_err(reason).to_string();
                assert!(text.starts_with("the probe's pose") && text.contains(reason), "{text}");
            }
        };
        refused(|pose| pose.fixed_view_mut::<3, 3>(0, 0).scale_mut(1.5), "scale");
        refused(|pose| pose.fixed_view_mut::<3, 4>(0, 0).scale_mut(0.1), "scale");
        refused(|pose| pose.column_mut(0).neg_mut(), "left-handed");
        refused(|pose| pose[(0, 1)] += 0.02, "off a rotation");
        refused(|pose| pose[(1, 3)] = f64::NAN, "row 1, column 3 is NaN");
        let transposed = |pose: &mut Matrix4<f64>| {
            pose[(0, 3)] += 5.0;
            *pose = pose.transpose();
        };
        refused(transposed, "row-major?");
        // The noise of a tracker is not, and is taken out.
        let mut noisy = good.clone();
        noisy.probe_to_world[(0, 1)] += 2e-3;
        let rigid = insonify_tracking::pose::Pose::from_matrix(&noisy.probe_to_world).unwrap();
        let expected = synth.render(&FrameState {
            probe_to_world: *rigid.probe_to_world(),
            ..good.clone()
        });
        let expected = expected.unwrap().clone();
        assert_eq!(synth.render(&noisy).unwrap(), &expected);
        assert!(expected.image_to_world != before.image_to_world);
        assert_eq!(synth.render(&good).unwrap(), &before);
    }
}

#[test]
fn scan_map_and_rays_are_derived_anew_with_the_grid_alone() {
    let (mut synth, _) = scene(Backend::Cpu);
    let mut changed = |change: fn(&mut Settings)| {
        let mut settings = synth.settings().clone();
        change(&mut settings);
        let changed = synth.set(settings).unwrap();
        [&SCAN_MAP, &RAYS].map(|buffer| changed.contains(&buffer))
    };
    assert_eq!(changed(|settings| settings.probe.frequency_mhz *= 1.2), [false; 2]);
    assert_eq!(changed(|settings| settings.image.margin = 0.1), [true, false]);
    assert_eq!(changed(|settings| settings.probe.depth_mm *= 1.2), [true; 2]);
}

/// A scene without a needle, states of which those from `first` on have one in the plane, and the frames of a scene
/// made for needles.
fn needles(backend: Backend, first: usize) -> (Synthesizer, Vec<FrameState>, Vec<Frame>) {
    let (anatomy, mut settings, state) = anatomies::two_layers();
    settings.effects.needle = Some(Default::default());
    settings.has_needle = true;
    // What differs from frame to frame.
    (settings.effects.receiver, settings.effects.noise) = (None, None);
    let states: Vec<FrameState> = (0..6)
        .map(|frame| {
            let mut state = FrameState { frame, ..state.clone() };
            let [tip, hub] = [[2.0, 15.0, 0.0], [-8.0, 3.0, 0.0]].map(Point3::from);
            let shaft = [hub, tip].map(|node| state.probe_to_world.transform_point(&node));
            state.needle = (frame as usize >= first).then(|| NeedleShaft {
                nodes: shaft.to_vec(),
                diameter_mm: 1.2,
            });
            state
        })
        .collect();
    let mut announced = Synthesizer::new(anatomy.clone(), settings.clone(), backend.clone()).unwrap();
    let frames = states.iter().map(|state| announced.render(state).unwrap().clone());
    let frames = frames.collect();
    settings.has_needle = false;
    (Synthesizer::new(anatomy, settings, backend).unwrap(), states, frames)
}

#[test]
fn a_needle_is_drawn_from_the_first_frame_that_has_one() {
    for backend in backends() {
        let (mut synth, states, expected) = needles(backend.clone(), 2);
        assert_ne!(expected[1].pixels, expected[2].pixels);
        let bytes = synth.memory_bytes();
        for (index, (state, expected)) in states.iter().zip(&expected).enumerate() {
            assert_eq!(synth.render(state).unwrap(), expected, "frame {index}");
            assert_eq!(synth.plan().has("needle"), index >= 2);
            assert_eq!(synth.memory_bytes() > bytes, index >= 2);
            let view = (index >= 2).then_some(NeedleView::Inside);
            assert_eq!(synth.frame().needle, view);
        }
        // In a batch, and seeds alone.
        let (mut synth, mut states, expected) = needles(backend, 4);
        let mut frames = Vec::new();
        let sink = |_: usize, frame: &Frame| {
            frames.push(frame.clone());
            Ok::<_, SynthError>(())
        };
        synth.render_batch(&states, sink).unwrap();
        assert!(frames == expected);
        states[5].seeds = states[5].needle.take().into_iter().collect();
        let mut settings = synth.settings().clone();
        settings.has_needle = false;
        synth.set(settings).unwrap();
        assert!(!synth.plan().has("needle"));
        let with_seeds = synth.render(&states[5]).unwrap().clone();
        assert_ne!(with_seeds.pixels, expected[0].pixels);
        assert!(synth.plan().has("needle") && with_seeds.needle.is_none());
    }
}

#[test]
fn frames_in_flight_outlast_the_first_needle() {
    for backend in backends() {
        let (mut synth, states, expected) = needles(backend, 2);
        let tickets: Vec<Ticket> = states[..3].iter().map(|state| synth.submit(state).unwrap()).collect();
        assert!(matches!(synth.submit(&states[3]), Err(SynthError::Busy)));
        let (first, frame) = synth
            .try_take()
            .unwrap()
            .expect("finished before the needle's pass was made");
        assert_eq!((first, frame), (tickets[0], &expected[0]));
        for index in [1, 2] {
            assert_eq!(synth.take(tickets[index]).unwrap(), &expected[index], "frame {index}");
        }
        let ticket = synth.submit(&states[3]).unwrap();
        assert_eq!(synth.take(ticket).unwrap(), &expected[3]);
    }
}

#[test]
fn the_pass_of_a_needle_is_made_once() {
    for backend in backends() {
        let (mut synth, states, _) = needles(backend, 1);
        let mut plans = Vec::new();
        for index in [0, 1, 0, 2, 3] {
            synth.render(&states[index]).unwrap();
            plans.push(synth.plan().passes.as_ptr());
        }
        assert_ne!(plans[0], plans[1], "with the first needle");
        assert!(plans[1..].iter().all(|plan| *plan == plans[1]), "{plans:?}");
    }
}

#[test]
fn frames_tell_what_is_seen_of_the_needle() {
    let (mut synth, mut states, expected) = needles(Backend::Cpu, 1);
    let to_world = states[1].probe_to_world;
    let depth = synth.settings().probe.depth_mm;
    let view = |synth: &mut Synthesizer, state: &mut FrameState, nodes: [[f64; 3]; 2]| {
        let shaft = nodes.map(|node| to_world.transform_point(&Point3::from(node)));
        state.needle.as_mut().unwrap().nodes = shaft.to_vec();
        synth.render(state).unwrap().needle
    };
    let cases = [
        // In the plane, through it, and within its thickness.
        ([[-8.0, 3.0, 0.0], [2.0, 15.0, 0.0]], None),
        ([[0.0, 10.0, -70.0], [0.0, 11.0, 100.0]], None),
        ([[0.0, 5.0, 0.5], [0.0, 11.0, 0.5]], None),
        // Beside it, below the image, and through the plane aside of the image.
        ([[0.0, 5.0, 8.0], [0.0, 11.0, 8.0]], Some(8.0)),
        ([[0.0, 5.0, -3.0], [0.0, 11.0, -60.0]], Some(3.0)),
        ([[0.0, depth + 30.0, 0.0], [1.0, depth + 7.0, 0.0]], Some(7.0)),
        ([[200.0, 10.0, -10.0], [200.0, 10.0, 10.0]], Some(f64::NAN)),
    ];
    for (nodes, outside) in cases {
        match (view(&mut synth, &mut states[1], nodes), outside) {
            (Some(NeedleView::Inside), None) => {}
            (Some(NeedleView::Outside { distance_mm }), Some(mm)) if mm.is_nan() => {
                assert!((150.0..200.0).contains(&distance_mm), "{distance_mm}")
            }
            (Some(NeedleView::Outside { distance_mm }), Some(mm)) => {
                assert!((distance_mm - mm).abs() < 0.51, "{nodes:?}: {distance_mm}")
            }
            (found, _) => panic!("{nodes:?}: {found:?}"),
        }
        // What is outside changes no pixel.
        assert_eq!(
            synth.frame().pixels == expected[0].pixels,
            outside.is_some(),
            "{nodes:?}"
        );
    }
    // A scene that excludes needles says so, and does not draw them.
    let mut settings = synth.settings().clone();
    (settings.effects.needle, settings.has_needle) = (None, false);
    synth.set(settings).unwrap();
    let excluded = synth.render(&states[2]).unwrap();
    assert_eq!(
        (excluded.needle, &excluded.pixels),
        (Some(NeedleView::Excluded), &expected[0].pixels)
    );
    assert!(!synth.plan().has("needle"));
}

#[test]
fn a_frame_in_an_encoder_of_the_host_is_the_one_rendered() {
    let Some(gpu) = insonify_testing::gpu::gpu_or_skip() else {
        return;
    };
    let (mut synth, states) = scene(Backend::Gpu(Box::new(gpu.clone())));
    let expected = synth.render(&states[1]).unwrap().clone();
    let mut encoder = gpu.device().create_command_encoder(&Default::default());
    synth.encode(&mut encoder, &states[1]).unwrap();
    let texture = synth.texture().expect("a texture");
    let (width, height) = (texture.width(), texture.height());
    let stride = insonify_gpu::row_stride(width);
    let buffer = gpu.device().create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: stride * u64::from(height),
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let layout = wgpu::TexelCopyBufferLayout {
        offset: 0,
        bytes_per_row: Some(stride as u32),
        rows_per_image: None,
    };
    let into = wgpu::TexelCopyBufferInfo {
        buffer: &buffer,
        layout,
    };
    encoder.copy_texture_to_buffer(texture.as_image_copy(), into, texture.size());
    gpu.queue().submit([encoder.finish()]);
    buffer.map_async(wgpu::MapMode::Read, .., |mapped| mapped.unwrap());
    gpu.wait("the host's frame").unwrap();
    let bytes = buffer.get_mapped_range(..).unwrap();
    let rows = bytes.chunks(stride as usize).flat_map(|row| &row[..width as usize]);
    assert!(rows.eq(&expected.pixels));
}

#[test]
fn after_a_frame_that_fails_the_mesh_is_sent_again() {
    type Attempt = fn(&mut Synthesizer, &FrameState, &Gpu) -> Result<(), SynthError>;
    let attempts: [Attempt; 4] = [
        |synth, state, _| synth.render(state).map(drop),
        |synth, state, _| synth.render_to_texture(state),
        |synth, state, gpu| synth.encode(&mut gpu.device().create_command_encoder(&Default::default()), state),
        |synth, state, _| synth.render_until("slice", state).map(drop),
    ];
    let Some((gpu, mut synth, state)) = meshed() else {
        return;
    };
    let frame = |synth: &mut Synthesizer| {
        let before = gpu.traffic();
        let pixels = synth.render(&state).unwrap().pixels.clone();
        (pixels, (gpu.traffic() - before).bytes_up)
    };
    let whole = frame(&mut synth);
    assert!(frame(&mut synth).1 < whole.1, "nothing moves");
    for (number, attempt) in attempts.into_iter().enumerate() {
        no_memory(&gpu);
        assert!(attempt(&mut synth, &state, &gpu).is_err(), "attempt {number}");
        assert_eq!(frame(&mut synth), whole, "attempt {number}");
    }
}

/// A scene with a mesh on a GPU.
fn meshed() -> Option<(Gpu, Synthesizer, FrameState)> {
    let gpu = insonify_testing::gpu::gpu_or_skip()?;
    let (mut anatomy, settings, state) = anatomies::two_layers();
    let around = |by: f64| std::array::from_fn(|axis| state.probe_to_world[(axis, 3)] + by);
    anatomy.mesh = TetMesh::over_box(around(-70.0), around(70.0), 500).ok().map(Arc::new);
    let synth = Synthesizer::new(anatomy, settings, Backend::Gpu(Box::new(gpu.clone()))).unwrap();
    Some((gpu, synth, state))
}

/// Has the next work on the device fail.
fn no_memory(gpu: &Gpu) {
    gpu.faults().report(wgpu::Error::OutOfMemory {
        source: "no memory".into(),
    });
}

fn batch(synth: &mut Synthesizer, states: &[FrameState]) -> Result<Vec<Vec<u8>>, SynthError> {
    let mut pixels = Vec::new();
    synth.render_batch(states, |_, frame| {
        pixels.push(frame.pixels.clone());
        Ok::<_, SynthError>(())
    })?;
    Ok(pixels)
}

#[test]
fn a_batch_without_memory_for_several_frames_submits_them_one_by_one() {
    let Some((gpu, mut synth, state)) = meshed() else {
        return;
    };
    let expected = synth.render(&state).unwrap().pixels.clone();
    let states = vec![state; 6];
    let mut submissions = |fails: bool| {
        if fails {
            no_memory(&gpu);
        }
        let before = gpu.traffic();
        let pixels = batch(&mut synth, &states).unwrap();
        assert!(pixels.iter().all(|pixels| *pixels == expected), "fails: {fails}");
        (gpu.traffic() - before).submissions
    };
    assert_eq!([true, false, false].map(&mut submissions), [6, 3, 3]);
}

#[test]
fn settings_without_memory_leave_the_synthesizer_as_it_was() {
    let Some((gpu, mut synth, state)) = meshed() else {
        return;
    };
    let expected = synth.render(&state).unwrap().clone();
    let mut settings = synth.settings().clone();
    settings.image.width *= 2;
    settings.probe.lines *= 2;
    no_memory(&gpu);
    let failed = synth.set(settings.clone());
    assert!(
        matches!(failed, Err(SynthError::Gpu(GpuError::OutOfMemory { .. }))),
        "{failed:?}"
    );
    assert_eq!(synth.render(&state).unwrap(), &expected);
    synth.set(settings).unwrap();
    assert_eq!(synth.render(&state).unwrap().width, 2 * expected.width);
}

#[test]
fn after_a_batch_with_an_invalid_state_the_mesh_is_sent_again() {
    let Some((_, mut synth, state)) = meshed() else { return };
    let deformed = FrameState {
        nodes: Some(displaced(&synth)),
        ..state.clone()
    };
    let at_rest = synth.render(&state).unwrap().pixels.clone();
    let expected = synth.render(&deformed).unwrap().pixels.clone();
    assert!(expected != at_rest);
    // Two frames a submission, of which the second is invalid.
    let mut states = vec![deformed; 6];
    states[1] = FrameState::at(Matrix4::zeros());
    assert!(matches!(batch(&mut synth, &states), Err(SynthError::Pose(_))));
    // Without nodes the mesh stays where it is.
    assert!(synth.render(&state).unwrap().pixels == expected);
}

/// Nodes of the mesh, displaced by up to 3 mm.
fn displaced(synth: &Synthesizer) -> Vec<[f64; 3]> {
    let mesh = synth.tables().mesh.as_ref().expect("a mesh");
    let nodes = mesh.nodes().iter();
    nodes.map(|&[x, y, z]| [x, y + 3.0 * (0.1 * x).sin(), z]).collect()
}

#[test]
fn synthesizers_on_one_device_share_the_volume() {
    let Some(gpu) = insonify_testing::gpu::gpu_or_skip() else {
        return;
    };
    let (mut anatomy, settings, state) = anatomies::two_layers();
    let fine = PhantomOptions {
        resolution_mm: Some(1.0),
        seed: 1,
    };
    anatomy.volume = Arc::new(make(Phantom::TwoLayer, &fine).unwrap());
    let volume_bytes = anatomy.volume.voxels().len() as u64;
    let mut other = settings.clone();
    other.probe.lines *= 2;
    let synthesizer = |settings: &Settings| {
        let before = gpu.traffic();
        let backend = Backend::Gpu(Box::new(gpu.clone()));
        let synth = Synthesizer::new(anatomy.clone(), settings.clone(), backend).unwrap();
        (synth, (gpu.traffic() - before).bytes_up)
    };
    let (mut first, sent) = synthesizer(&settings);
    assert!(sent >= volume_bytes, "{sent}");
    let expected = first.render(&state).unwrap().clone();
    let (mut second, sent) = synthesizer(&other);
    assert!(sent < volume_bytes / 2, "{sent}");
    assert!(second.render(&state).unwrap().pixels != expected.pixels);
    assert!(*first.render(&state).unwrap() == expected);
    // Nothing is kept of what nobody uses.
    drop((first, second));
    let (mut again, sent) = synthesizer(&settings);
    assert!(sent >= volume_bytes, "{sent}");
    assert!(*again.render(&state).unwrap() == expected);
}

/// Frames with settings of their own leave no trace in the threads of a batch: frames after them have those of the
/// last, and so have batches.
#[test]
fn batches_with_and_without_settings_are_frames_one_by_one() {
    let (anatomy, settings, state) = anatomies::two_layers();
    let own = |gain_db: f64| {
        let mut settings = settings.clone();
        settings.effects.tone.get_or_insert_default().gain_db += gain_db;
        Some(Arc::new(FrameSettings {
            settings,
            tissues: Arc::clone(&anatomy.tissues),
            warnings: Vec::new(),
        }))
    };
    let plain = |frame| FrameState { frame, ..state.clone() };
    let with = |frame, gain_db| FrameState {
        settings: own(gain_db),
        ..plain(frame)
    };
    let rounds = [
        vec![plain(0), plain(1), plain(2), plain(3)],
        vec![with(4, 6.0), with(5, -6.0), with(6, 3.0), with(7, 9.0), with(8, -3.0)],
        vec![plain(9), plain(10), plain(11), plain(12)],
        vec![with(13, -9.0), plain(14), plain(15), with(16, 6.0)],
        vec![with(17, 1.0), with(18, 2.0), with(19, 3.0), with(20, 4.0)],
    ];
    let new = || Synthesizer::new(anatomy.clone(), settings.clone(), Backend::Cpu).unwrap();
    let mut single = new();
    let expected: Vec<_> = rounds
        .iter()
        .flatten()
        .map(|state| single.render(state).unwrap().pixels.clone())
        .collect();
    for threads in [1, 2, 3] {
        let pool = insonify_base::parallel::Pool::new(threads).unwrap();
        let frames: Vec<_> = pool.install(|| {
            let mut synth = new();
            let all = rounds.iter().map(|states| batch(&mut synth, states).unwrap());
            all.flatten().collect()
        });
        let differ = frames
            .iter()
            .zip(&expected)
            .position(|(frame, expected)| frame != expected);
        assert_eq!((differ, frames.len()), (None, expected.len()), "{threads} threads");
    }
}

/// Tables and states of a host are checked as files are: no panic, and no frame that looks right.
#[test]
fn wrong_tables_and_states_of_a_host_are_refused() {
    let (mut anatomy, settings, state) = anatomies::two_layers();
    let refused = |change: &dyn Fn(&mut TissueTable), words: &str| {
        let mut tissues = (*anatomy.tissues).clone();
        change(&mut tissues);
        let anatomy = Anatomy {
            tissues: Arc::new(tissues),
            ..anatomy.clone()
        };
        let error = Synthesizer::new(anatomy, settings.clone(), Backend::Cpu).err();
        let error = error.expect(words).to_string();
        assert!(error.contains(words), "{error}");
    };
    let labels = anatomy.volume.labels().to_vec();
    let volume = |matrix| LabelVolume::new([1; 3], vec![0], labels.clone(), matrix);
    let transposed = Matrix4::new_translation(&Vector3::new(10.0, 20.0, 30.0)).transpose();
    let error = volume(transposed)
        .err()
        .map(|error| error.to_string())
        .unwrap_or_default();
    assert!(error.contains("is the matrix transposed"), "{error}");
    assert!(volume(Matrix4::new_scaling(0.5)).is_ok() && volume(Matrix4::identity() * 2.0).is_err());
    refused(&|table| table.tissues.clear(), "no tissues");
    refused(&|table| table.of_label[1] = 77, "label index 1 has tissue 77");
    refused(&|table| table.of_label.truncate(1), "tissues of 1 label indices");
    refused(
        &|table| table.tissues[1].attenuation_db_cm_mhz = f64::NAN,
        "attenuation_db_cm_mhz = NaN",
    );
    refused(&|table| table.tissues[1].impedance_mrayl = -1.0, "impedance_mrayl = -1");
    refused(
        &|table| table.tissues[1].texture = Some("marble".into()),
        "no texture is called \"marble\"",
    );

    let mut synth = Synthesizer::new(anatomy.clone(), settings.clone(), Backend::Cpu).unwrap();
    let nodes = [Point3::origin(), Point3::new(0.0, 0.0, 20.0)];
    let shaft = |nodes: &[Point3<f64>], diameter_mm| NeedleShaft {
        nodes: nodes.to_vec(),
        diameter_mm,
    };
    for (wrong, words) in [
        (shaft(&nodes, -1.0), "a diameter of -1 mm"),
        (shaft(&nodes, f64::NAN), "a diameter of NaN mm"),
        (shaft(&nodes[..1], 1.0), "one node"),
        (
            shaft(&[nodes[0], Point3::new(0.0, f64::NAN, 9.0)], 1.0),
            "a node at [0.0, NaN, 9.0] mm",
        ),
        (NeedleShaft::seed(nodes[0], &Vector3::zeros()), "a node at [NaN"),
    ] {
        for is_seed in [false, true] {
            let mut state = state.clone();
            state.needle = (!is_seed).then(|| wrong.clone());
            state.seeds = Vec::from_iter(is_seed.then(|| wrong.clone()));
            match synth.render(&state) {
                Err(error @ SynthError::Needle(_)) => assert!(error.to_string().contains(words), "{error}"),
                other => panic!("{words}: {other:?}"),
            }
        }
    }
    // Nodes without a mesh to move, and nodes that are nowhere.
    let moved = |nodes: Vec<[f64; 3]>| FrameState {
        nodes: Some(nodes),
        ..state.clone()
    };
    let mesh = TetMesh::over_box([-30.0; 3], [30.0; 3], 100).unwrap();
    let mut nodes = mesh.nodes().to_vec();
    assert!(matches!(synth.render(&moved(nodes.clone())), Err(SynthError::Nodes(_))));
    anatomy.mesh = Some(Arc::new(mesh));
    let mut synth = Synthesizer::new(anatomy, settings, Backend::Cpu).unwrap();
    assert!(synth.render(&moved(nodes.clone())).is_ok());
    for lost in [f64::NAN, f64::INFINITY] {
        nodes[7][1] = lost;
        let refused = synth.render(&moved(nodes.clone()));
        assert!(matches!(
            refused,
            Err(SynthError::Nodes(InvalidMesh::Coordinate { node: 7, .. }))
        ));
    }
}
