use super::*;
use crate::mechanics::mesh::{Displacement, TetMesh};

/// A block pressed from 10 to 6 mm in z, its floor fixed.
fn pressed() -> (Locator<f64>, Locator<f64>) {
    let mesh = TetMesh::over_box([0.0; 3], [10.0; 3], 400).unwrap();
    let reference = Locator::new(&mesh);
    let mut deformed = reference.clone();
    let field = Displacement::Compression {
        fixed_mm: [0.0; 3],
        direction: [0.0, 0.0, 1.0],
        strain: 0.4,
        poisson: 0.0,
    };
    let mut nodes = Vec::new();
    field.displace(mesh.nodes(), &mut nodes);
    deformed.update(&nodes).unwrap();
    (deformed, reference)
}

#[test]
fn samples_are_mapped_background_or_outside() {
    let (deformed, reference) = pressed();
    let mut positions = [
        [5.0, 5.0, 3.0, 9.0],
        [5.0, 5.0, 8.0, 9.0],
        [5.0, 5.0, 12.0, 9.0],
        [f64::NAN, 5.0, 3.0, 9.0],
    ];
    let mut elements = [NONE; 4];
    map_line(&deformed, &reference, &mut positions, &mut elements);
    let [mapped, background, outside, nan] = positions;
    assert!(
        (mapped[2] - 5.0).abs() < 1e-12 && (mapped[0] - 5.0).abs() < 1e-12,
        "{mapped:?}"
    );
    assert_eq!(mapped[3], f64::from(MAPPED));
    assert_eq!(background, [5.0, 5.0, 8.0, f64::from(BACKGROUND)]);
    assert_eq!(outside, [5.0, 5.0, 12.0, f64::from(OUTSIDE)]);
    assert!(nan[0].is_nan() && nan[1..] == [5.0, 3.0, f64::from(OUTSIDE)]);
    assert_ne!(elements[0], NONE);
    assert_eq!(elements[1..], [NONE; 3]);
}

#[test]
fn a_fold_is_flagged() {
    let mesh = TetMesh::over_box([0.0; 3], [4.0; 3], 125).unwrap();
    let reference = Locator::<f32>::new(&mesh);
    let mut deformed = reference.clone();
    let mirror = [
        [-1.0, 0.0, 0.0, 4.0],
        [0.0, 1.0, 0.0, 0.0],
        [0.0, 0.0, 1.0, 0.0],
        [0.0, 0.0, 0.0, 1.0],
    ];
    let mut nodes = Vec::new();
    Displacement::Affine { matrix: mirror }.displace(mesh.nodes(), &mut nodes);
    deformed.update(&nodes).unwrap();
    let mut positions = [[1.25f32, 2.5, 3.3, 0.0]];
    map_line(&deformed, &reference, &mut positions, &mut [0]);
    let [x, y, z, flag] = positions[0];
    assert_eq!(flag, FOLDED as f32);
    assert!(
        (x - 2.75).abs() < 1e-5 && (y - 2.5).abs() < 1e-5 && (z - 3.3).abs() < 1e-5,
        "{:?}",
        positions[0]
    );
}

#[test]
fn a_frame_depends_neither_on_the_last_one_nor_on_the_threads() {
    let (deformed, reference) = pressed();
    let (lines, samples) = (31, 40);
    let start: Vec<[f64; 4]> = (0..lines * samples)
        .map(|n| {
            [
                11.0 * (n / samples) as f64 / lines as f64 - 0.5,
                4.7,
                11.0 * (n % samples) as f64 / samples as f64,
                0.0,
            ]
        })
        .collect();
    let run = |threads, mut elements: Vec<u32>| {
        let mut positions = start.clone();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| map_lines(&deformed, &reference, samples, &mut positions, &mut elements));
        (positions, elements)
    };
    let first = run(1, vec![NONE; start.len()]);
    assert_eq!(run(3, first.1.clone()), first);
    assert_eq!(run(2, (0..start.len() as u32).collect()), first);
}
