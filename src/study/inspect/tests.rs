use std::sync::Arc;

use super::*;
use insonify_imaging::anatomies::two_layers as scene;
use insonify_mesh::TetMesh;

fn sample_of(anatomy: &Anatomy, settings: &Settings, state: &FrameState) -> (u8, SampleReport) {
    let report = inspect(anatomy, settings, state, [16, 14]).unwrap().unwrap();
    (report.grey_level, report.sample.unwrap())
}

#[test]
fn the_parts_of_a_pixel_add_up_to_it() {
    let (anatomy, mut settings, state) = scene();
    settings.effects.noise = None;
    let (grey_level, report) = sample_of(&anatomy, &settings, &state);
    let value = |pass: &str| report.stages.iter().find(|stage| stage.pass == pass).unwrap().value;

    let weights: f64 = report.interpolation.iter().map(|corner| corner.weight).sum();
    let grey: f64 = report
        .interpolation
        .iter()
        .map(|corner| corner.weight * corner.grey_level)
        .sum();
    assert!((weights - 1.0).abs() < 1e-6);
    assert!(
        (grey - f64::from(grey_level)).abs() <= 0.5 + 1e-9,
        "{grey} {grey_level}"
    );

    let echo = 10f64.powf(report.label.echogenicity_db / 20.0);
    assert!(
        (value("slice") / echo - 1.0).abs() < 1e-6,
        "the table of echoes is in single precision"
    );
    let texture = report.texture.as_ref().unwrap().value;
    assert!((value("texture") / (value("slice") * texture) - 1.0).abs() < 1e-9);
    assert!((value("speckle_lateral") / value("texture") / report.speckle.unwrap() - 1.0).abs() < 1e-9);

    let shadow = report.shadow.as_ref().unwrap();
    let loss: f64 = shadow.taken_by.iter().map(|loss| loss.db).sum();
    assert!(
        shadow.loss_db > 1.0 && (loss - shadow.loss_db).abs() < 1e-3,
        "{shadow:?}"
    );
    let above = value("speckle_lateral") * 10f64.powf(-shadow.loss_db / 20.0);
    assert!((value("shadow") / above - 1.0).abs() < 1e-6);

    assert!(report.blur.len() > 1);
    let mixed: f64 = report
        .blur
        .iter()
        .map(|neighbour| neighbour.weight * neighbour.amplitude)
        .sum();
    assert!(
        (mixed / value("blur") - 1.0).abs() < 1e-2,
        "{mixed}, not {}",
        value("blur")
    );
    let same_line = report
        .blur
        .iter()
        .find(|neighbour| neighbour.line == report.line)
        .unwrap();
    assert!((same_line.amplitude - value("refraction")).abs() < 1e-12);
}

#[test]
fn a_moved_mesh_is_seen_through() {
    let (mut anatomy, settings, mut state) = scene();
    let corner = |x: f64, y: f64, z: f64| [500.0 * x, 500.0 * y, 500.0 * z];
    let nodes = vec![
        corner(-1.0, -1.0, -1.0),
        corner(3.0, -1.0, -1.0),
        corner(-1.0, 3.0, -1.0),
        corner(-1.0, -1.0, 3.0),
    ];
    let mesh = TetMesh::new(nodes.clone(), vec![[0, 1, 2, 3]], vec![0]).unwrap();
    anatomy.mesh = Some(Arc::new(mesh));
    state.nodes = Some(
        nodes
            .iter()
            .map(|node| [node[0] + 2.0, node[1], node[2] - 1.0])
            .collect(),
    );
    let (_, report) = sample_of(&anatomy, &settings, &state);
    let mesh = report.mesh.unwrap();
    assert_eq!((mesh.place, mesh.element), ("in the mesh", Some(0)));
    let weights = mesh.barycentric.unwrap();
    assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
    for axis in 0..3 {
        let corners = mesh
            .nodes
            .unwrap()
            .map(|node| state.nodes.as_ref().unwrap()[node as usize][axis]);
        let interpolated: f64 = weights
            .iter()
            .zip(corners)
            .map(|(weight, corner)| weight * corner)
            .sum();
        assert!((interpolated - report.world_mm[axis]).abs() < 1e-9);
        let displacement = [2.0, 0.0, -1.0][axis];
        assert!((report.world_mm[axis] - report.reference_mm[axis] - displacement).abs() < 1e-9);
    }
    assert!((report.displacement_mm - 5f64.sqrt()).abs() < 1e-9);
}

#[test]
fn pixels_without_a_sample_say_so() {
    let (anatomy, mut settings, state) = scene();
    settings.image.width = 200;
    settings.image.fill = 7;
    settings.effects.noise = None;
    let report = inspect(&anatomy, &settings, &state, [0, 3]).unwrap().unwrap();
    assert_eq!((report.grey_level, &report.sample), (7, &None));
    assert!(report.to_string().contains("outside the sector"));
    assert_eq!(inspect(&anatomy, &settings, &state, [200, 3]).unwrap(), None);
    assert_eq!(inspect(&anatomy, &settings, &state, [0, 24]).unwrap(), None);
}

#[test]
fn text_and_json_say_the_same() {
    let (anatomy, settings, state) = scene();
    let report = inspect(&anatomy, &settings, &state, [16, 14]).unwrap().unwrap();
    let json = serde_json::to_value(&report).unwrap();
    let text = report.to_string();
    let sample = report.sample.unwrap();
    assert_eq!(json["sample"]["label"]["tissue"], *sample.label.tissue);
    for word in [
        &*sample.label.tissue,
        "transmittance",
        "scanline",
        "grey level",
        "speckle",
    ] {
        assert!(text.contains(word), "{word}: {text}");
    }
}
