use super::*;
use insonify_imaging::anatomies;
use insonify_mesh::TetMesh;

#[test]
fn a_measured_choice_is_kept_and_followed() {
    let Some(gpu) = insonify_testing::gpu::gpu_or_skip() else {
        return;
    };
    // Software stands for hardware: which it is has been decided before.
    let adapter = gpu.report();
    let folder = tempfile::tempdir().unwrap();
    let cache = Cache::at(folder.path(), "here");
    let (mut anatomy, settings, state) = anatomies::two_layers();
    let around = |offset_mm: f64| std::array::from_fn(|axis| state.probe_to_world[(axis, 3)] + offset_mm);
    anatomy.mesh = TetMesh::over_box(around(-70.0), around(70.0), 500).ok().map(Arc::new);
    let tables = Arc::new(Tables::new(anatomy.clone(), settings.clone()).unwrap());
    let choose = |several| faster(&tables, adapter, several, &cache).unwrap();

    let single = choose(None);
    assert_eq!(single.synth.backend(), "gpu");
    assert!(single.reason.starts_with(BEST) && single.reason.ends_with("a single frame"));
    assert!(Kept::of(adapter, &cache).times.is_empty());

    let mut now = choose(Some(&state));
    let mut kept = Kept::of(adapter, &cache);
    let [times] = &kept.times[..] else {
        panic!("{} times", kept.times.len())
    };
    let mut times = times.clone();
    assert!(times.gpu_ms > 0.0 && times.cpu_ms > 0.0);
    assert_eq!(now.synth.backend(), if times.is_gpu() { "gpu" } else { "cpu" });
    assert_eq!(now.reason, format!("{}, measured now", times.text(&adapter.name)));
    // Timed frames leave no trace.
    let mut fresh = Chosen::of(&tables, Backend::Cpu, "").unwrap().synth;
    if times.is_gpu() {
        fresh = Chosen::of(&tables, Backend::Gpu(Box::new(gpu.clone())), "")
            .unwrap()
            .synth;
    }
    assert_eq!(now.synth.render(&state).unwrap(), fresh.render(&state).unwrap());

    for (gpu_ms, backend) in [(1.0, "gpu"), (9.0, "cpu")] {
        (times.gpu_ms, times.cpu_ms) = (gpu_ms, 3.0);
        kept.put(times.clone()).unwrap();
        for several in [None, Some(&state)] {
            let before = choose(several);
            assert_eq!(before.synth.backend(), backend);
            let text = times.text(&adapter.name);
            assert_eq!(before.reason, format!("{text}, measured before and kept"));
        }
    }

    let mut larger = settings.clone();
    larger.image.width *= 2;
    let mut simpler = settings;
    simpler.effects.blur = None;
    for changed in [larger, simpler] {
        let tables = Tables::new(anatomy.clone(), changed).unwrap();
        assert!(kept.find(&tables).is_none(), "another scene");
    }
    assert!(kept.find(&tables).is_some());
}
