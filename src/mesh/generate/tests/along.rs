//! Meshes with finer elements along a path.

use super::*;

/// Layers of 3 and 4 mm on a block with a ball in it, the path of a needle into it, and back.
fn layered() -> Volume {
    Volume::new([60; 3], [1.0; 3], |at| {
        let ball = (Vector3::from(at) - Vector3::new(30.0, 30.0, 35.0)).norm() < 12.0;
        match at[2] {
            z if z < 3.0 => 1,
            z if z < 7.0 => 2,
            _ => 3 + u8::from(ball),
        }
    })
}

const PATH: [[[f64; 3]; 2]; 2] = [
    [[30.0, 32.0, -15.0], [30.0, 32.0, 45.0]],
    [[30.0, 32.0, 45.0], [30.0, 32.0, -15.0]],
];

fn along(volume: &Volume, path: &[[[f64; 3]; 2]], along_path: bool, nodes: usize) -> Generated {
    let options = GenerateOptions {
        path,
        along_path,
        ..GenerateOptions::default()
    };
    let generated = generate(&volume.grid(), nodes, &options, |_| {}).expect("a mesh");
    volume.check(&generated, nodes, options.min_dihedral_deg);
    generated
}

/// Mean edge of the elements whose centroid lies within a range of distances from the path, mm: that of a cell six
/// times as large.
fn edge(generated: &Generated, from: f64, to: f64) -> f64 {
    let mesh = &generated.mesh;
    let within = |corners: &[u32; 4]| {
        let middle = corners
            .iter()
            .map(|node| Vector3::from(mesh.nodes()[*node as usize]))
            .sum::<Vector3<f64>>()
            / 4.0;
        let nearest = Vector3::new(30.0, 32.0, middle.z.min(45.0));
        (from..to).contains(&(middle - nearest).norm())
    };
    let pairs = mesh.elements().iter().zip(mesh.volumes(mesh.nodes()));
    let volumes: Vec<f64> = pairs
        .filter(|(corners, _)| within(corners))
        .map(|(_, volume)| volume)
        .collect();
    (6.0 * volumes.iter().sum::<f64>() / volumes.len() as f64).cbrt()
}

#[test]
fn elements_are_finer_along_the_path() {
    let volume = layered();
    for nodes in [800, 2500] {
        let [even, finer] = [false, true].map(|along_path| along(&volume, &PATH, along_path, nodes));
        let edges = [(0.0, 5.0), (10.0, 15.0), (22.0, 60.0)].map(|(from, to)| edge(&finer, from, to));
        assert!(edges[0] < edges[1] && edges[1] < edges[2], "{edges:?} mm");
        assert!(
            edges[0] < 0.7 * edges[2] && edges[0] < 0.9 * edge(&even, 0.0, 5.0),
            "{edges:?} mm"
        );
        let [even, finer] = [even, finer].map(|generated| generated.report);
        assert!(finer.nodes as f64 >= 0.85 * nodes as f64, "{finer:?}");
        let near = [&even, &finer].map(|report| report.near_mislabelled_percent.expect("the path lies in tissue"));
        // With many nodes a uniform mesh follows such thick layers as well.
        let most = if nodes < 1000 { 0.9 * near[0] } else { near[0] };
        assert!(near[1] < most, "{near:?} %");
        assert!(
            finer.regions.iter().all(|region| region.error_percent.abs() <= 1.0),
            "{finer:?}"
        );
    }
}

/// Nodes beyond those needed for [`PATH_EDGE_MM`] are spent where elements are longer.
#[test]
fn elements_on_the_path_are_no_finer_than_they_should_be() {
    let volume = Volume::new([60; 3], [2.0; 3], |_| 1);
    let path = [[[60.0, 61.0, 0.0], [60.0, 61.0, 100.0]]];
    let shortest = [3000, 6000].map(|nodes| {
        let mesh = along(&volume, &path, true, nodes).mesh;
        let volumes = mesh.volumes(mesh.nodes()).fold(f64::INFINITY, f64::min);
        (6.0 * volumes).cbrt()
    });
    // An edge is halved in three steps, from above the target length to above half of it; cells of edge a have
    // diagonals of 1.7 a.
    assert!(
        shortest.iter().all(|edge| *edge > PATH_EDGE_MM / 4.0),
        "{shortest:?} mm"
    );
}

#[test]
fn the_same_path_gives_the_same_mesh_whatever_its_direction() {
    let volume = layered();
    let there_and_back = along(&volume, &PATH, true, 800);
    for path in [&PATH[..], &PATH[..1], &PATH[1..]] {
        let again = along(&volume, path, true, 800);
        assert_eq!(again.mesh, there_and_back.mesh);
        assert_eq!(again.report, there_and_back.report);
    }
}

#[test]
fn without_a_path_in_tissue_the_mesh_is_as_without_one() {
    let volume = layered();
    let none = along(&volume, &[], false, 800);
    assert_eq!(none.report.near_mislabelled_percent, None);
    let beside = [[[-9.0, -9.0, -9.0], [-9.0, 70.0, -9.0]], [[-5.0; 3]; 2]];
    for (path, along_path) in [(&[][..], true), (&beside[..], true), (&PATH[..], false)] {
        assert_eq!(along(&volume, path, along_path, 800).mesh, none.mesh);
    }
}

#[test]
fn paths_that_are_not_finite_are_refused() {
    for bad in [f64::NAN, f64::INFINITY] {
        let options = GenerateOptions {
            path: &[[[0.0; 3], [1.0, bad, 1.0]]],
            along_path: true,
            ..GenerateOptions::default()
        };
        let words = generate(&layered().grid(), 100, &options, |_| {})
            .expect_err("refused")
            .to_string();
        assert!(words.contains("path") && words.contains("finite"), "{words}");
    }
}
