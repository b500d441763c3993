//! Warp: the reference position of every sample. A twin may choose another element only if the sample provably lies
//! within rounding of it, and another side of the mesh's surface only within rounding of that surface.

use insonify_imaging::effects::warp::{BACKGROUND, MAPPED};
use insonify_mesh::Displacement;
use insonify_tracking::probe::{Linear, ProbeShape};
use nalgebra::{Point3, Vector3};

use crate::parity_tests::case::{Case, check_all};
use crate::parity_tests::scenes;
use crate::support::scene::{self, SHAPES};

#[test]
fn pressed_tissue_under_every_probe_shape() {
    let (anatomy, state) = scenes::pressed();
    let cases: Vec<Case> = SHAPES
        .iter()
        .map(|&(name, shape)| {
            let settings = scene::settings(scene::probe(shape, 40.0, 24, 96), scene::bare());
            Case::new(name, anatomy.clone(), settings, state.clone())
        })
        .collect();
    check_all(&cases);
}

#[test]
fn samples_on_faces_edges_and_nodes_of_the_mesh() {
    // A lattice of whole millimetres under an axis-aligned probe: samples lie on shared faces, edges, nodes and the
    // surface.
    let settings = {
        let shape = ProbeShape::Linear(Linear { width_mm: 24.0 });
        scene::settings(scene::probe(shape, 40.0, 25, 80), scene::bare())
    };
    let mut state = scene::straight();
    let anatomy = scenes::on_a_lattice();
    let stretch = Displacement::Affine {
        matrix: [
            [1.25, 0.0, 0.0, 0.0],
            [0.0, 0.5, 0.0, 8.0],
            [0.0, 0.0, 1.0, 0.0],
            [0.0, 0.0, 0.0, 1.0],
        ],
    };
    let mut nodes = Vec::new();
    stretch.displace(anatomy.mesh.as_ref().expect("a mesh").nodes(), &mut nodes);
    state.nodes = Some(nodes);
    check_all(&[Case::new("lattice", anatomy, settings, state)]);
}

#[test]
fn an_affine_displacement_is_undone_and_what_it_leaves_is_background() {
    let (anatomy, mut state) = scenes::pressed();
    let mesh = anatomy.mesh.clone().expect("a mesh");
    let shear = Displacement::Shear {
        fixed_mm: [0.0, 20.0, 0.0],
        direction: [1.0, 0.0, 0.2],
        normal: [0.0, 1.0, 0.3],
        amount: 0.25,
    };
    let mut nodes = Vec::new();
    shear.displace(mesh.nodes(), &mut nodes);
    state.nodes = Some(nodes);
    let case = Case::new(
        "sheared",
        anatomy,
        scene::settings(scene::small_probe(), scene::bare()),
        state,
    );
    let mut exact = case.exact().expect("the reference");
    let world = exact.render_until("geometry", &case.state).expect("positions");
    let warped = exact.render_until("warp", &case.state).expect("positions");
    let (mut mapped, mut background) = (0, 0);
    let [low, high] = mesh.bounds();
    let inside = |p: [f64; 4], by: f64| (0..3).all(|axis| p[axis] > low[axis] + by && p[axis] < high[axis] - by);
    for (before, after) in world.position.iter().zip(&warped.position) {
        if after[3] == f64::from(MAPPED) {
            let moved =
                Point3::new(after[0], after[1], after[2]) + Vector3::from(shear.apply([after[0], after[1], after[2]]));
            assert!(
                (moved.coords - Vector3::new(before[0], before[1], before[2])).norm() < 1e-11,
                "{before:?} came from {after:?}"
            );
            assert!(
                inside(*after, -1e-9),
                "a mapped sample comes from inside the mesh: {after:?}"
            );
            mapped += 1;
        } else {
            assert_eq!(&before[..3], &after[..3], "what is not mapped stays where it is");
            // Background where the reference mesh held the point, outside where neither does.
            let expected = after[3] == f64::from(BACKGROUND);
            assert!(
                if expected {
                    inside(*before, -1e-9)
                } else {
                    !inside(*before, 1e-9)
                },
                "{before:?} {after:?}"
            );
            background += usize::from(expected);
        }
    }
    assert!(
        mapped > 500 && background > 20,
        "{mapped} mapped, {background} background"
    );
    check_all(&[case]);
}
