//! Point location in a deforming mesh: preparing the moved elements, and mapping the samples of a frame back.

use std::hint::black_box;
use std::time::Duration;

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use insonify::mechanics::mesh::map::map_lines;
use insonify::mechanics::mesh::{Displacement, Locator, NONE, TetMesh};

/// Scanlines and samples of a usual frame.
const FRAME: [usize; 2] = [256, 512];

/// Nodes of the meshes, about.
const NODES: [usize; 2] = [5_000, 50_000];

/// A mesh over a box of 200 mm and a press on it.
fn mesh(nodes: usize) -> (TetMesh, Vec<[f64; 3]>) {
    let mesh = TetMesh::over_box([0.0; 3], [200.0; 3], nodes).expect("a box");
    let press = Displacement::Indentation {
        centre_mm: [100.0, 0.0, 100.0],
        direction: [0.0, 1.0, 0.0],
        depth_mm: 15.0,
        radius_mm: 40.0,
    };
    let mut current = Vec::new();
    press.displace(mesh.nodes(), &mut current);
    (mesh, current)
}

/// The samples of a plane through the middle of the box, scanline by scanline.
fn plane() -> Vec<[f32; 4]> {
    let [lines, samples] = FRAME;
    let at = |i: usize, n: usize| 20.0 + 160.0 * i as f32 / n as f32;
    (0..lines * samples)
        .map(|i| [at(i / samples, lines), at(i % samples, samples), 101.0, 0.0])
        .collect()
}

fn update(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("locator/update");
    for nodes in NODES {
        let (mesh, current) = mesh(nodes);
        let mut locator = Locator::<f32>::new(&mesh);
        group.bench_function(format!("{nodes} nodes"), |bencher| {
            bencher.iter(|| locator.update(black_box(&current)).expect("as many nodes"));
        });
    }
    group.finish();
}

fn map(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("locator/map");
    let positions = plane();
    for nodes in NODES {
        let (mesh, current) = mesh(nodes);
        let reference = Locator::<f32>::new(&mesh);
        let mut deformed = reference.clone();
        deformed.update(&current).expect("as many nodes");

        let unknown = vec![NONE; positions.len()];
        let mut known = unknown.clone();
        map_lines(&deformed, &reference, FRAME[1], &mut positions.clone(), &mut known);
        for (start, elements) in [("first frame", unknown), ("next frame", known)] {
            group.bench_function(format!("{nodes} nodes, {start}"), |bencher| {
                bencher.iter_batched_ref(
                    || (positions.clone(), elements.clone()),
                    |(positions, elements)| map_lines(&deformed, &reference, FRAME[1], positions, elements),
                    BatchSize::LargeInput,
                );
            });
        }
    }
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_secs(2));
    targets = update, map
}
criterion_main!(benches);
