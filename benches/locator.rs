//! Point location in a deforming mesh: the search of single points, and the elements in the slab of a frame.

use std::hint::black_box;
use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use insonify::{DEFAULT_SCENE, FrameState, SceneFile};
use insonify_imaging::synth::slab::Slab;
use insonify_imaging::synth::tables::Tables;
use insonify_mesh::{Displacement, Locator, TetMesh};

/// Nodes of the meshes, about.
const NODES: [usize; 2] = [5_000, 50_000];

/// A mesh over a box of 200 mm about a point and a press on it.
fn mesh(middle: [f64; 3], nodes: usize) -> (TetMesh, Vec<[f64; 3]>) {
    let [low, high] = [-100.0, 100.0].map(|by| middle.map(|x| x + by));
    let mesh = TetMesh::over_box(low, high, nodes).expect("a box");
    let press = Displacement::Indentation {
        centre_mm: [middle[0], low[1], middle[2]],
        direction: [0.0, 1.0, 0.0],
        depth_mm: 15.0,
        radius_mm: 40.0,
    };
    let mut current = Vec::new();
    press.displace(mesh.nodes(), &mut current);
    (mesh, current)
}

fn locator(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("locator/update");
    for nodes in NODES {
        let (mesh, current) = mesh([100.0; 3], nodes);
        let mut locator = Locator::<f32>::new(&mesh);
        group.bench_function(format!("{nodes} nodes"), |bencher| {
            bencher.iter(|| locator.update(black_box(&current)).expect("as many nodes"));
        });
    }
    group.finish();
}

fn slab(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("slab/update");
    let scene = SceneFile::parse(DEFAULT_SCENE, "default scene").expect("a scene");
    let scene = scene.resolve(".".as_ref()).expect("a scene");
    let pose = *scene.probe_pose(0, 1).probe_to_world();
    let middle = scene.anatomy.volume.centre_mm();
    for nodes in NODES {
        let (mesh, current) = mesh(middle.into(), nodes);
        let mut anatomy = scene.anatomy.clone();
        anatomy.mesh = Some(std::sync::Arc::new(mesh));
        let tables = Tables::new(anatomy, scene.settings.clone()).expect("tables");
        let mut slab = Slab::<f32>::new(tables.mesh.as_ref().expect("a mesh"));
        let mut state = FrameState::at(pose);
        state.nodes = Some(current);
        slab.update(&tables, &state).expect("as many nodes");
        let elements = slab.deformed.elements.len();
        group.bench_function(format!("{nodes} nodes, {elements} elements in the slab"), |bencher| {
            bencher.iter(|| slab.update(&tables, black_box(&state)).expect("as many nodes"));
        });
    }
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_secs(2));
    targets = locator, slab
}
criterion_main!(benches);
