//! Scenes far from the origin of the world: their frames are those of the same scene at the origin, and all that is
//! told of them is in the world.

use insonify_anatomy::phantom::{Phantom, PhantomOptions, make};
use insonify_anatomy::volume::save;
use insonify_imaging::sidecar::Sidecar;
use insonify_tracking::sequence::Sequence;
use nalgebra::Vector3;
use serde_json::Value;

use crate::support::{Bench, grey, grey16};

/// Whole metres.
const FAR: [f64; 3] = [-57_000.0, 1e5, 3_000.0];
const LAYERS: [&str; 5] = ["label-value", "displacement", "depth", "needle", "loss"];

/// A phantom, pressed by the probe and with a needle in it, all of it moved.
fn write(bench: &Bench, name: &str, by: [f64; 3]) {
    let coarse = PhantomOptions {
        resolution_mm: Some(3.0),
        seed: 1,
    };
    let volume = make(Phantom::TwoLayer, &coarse).expect("a phantom");
    let moved = volume.moved(Vector3::from(by)).expect("a place");
    save(&moved, &bench.path(&format!("{name}.nrrd"))).expect("written");
    let at = |x: f64, y: f64, z: f64| format!("[{}, {}, {}]", x + by[0], y + by[1], z + by[2]);
    let scene = format!(
        r#"
version = 1
seed = 3
volume = {{ file = "{name}.nrrd" }}
image = {{ width = 48, height = 40 }}
[probe]
kind = "linear"
width_mm = 38
depth_mm = 60
lines = 64
samples = 1024
[motion]
frames = 2
keyframes = [
  {{ time_s = 0, position_mm = {}, direction = [0, 1, 0], lateral = [1, 0, 0] }},
  {{ time_s = 1, position_mm = {}, direction = [0, 1, 0], lateral = [1, 0, 0] }},
]
[deform]
nodes = 400
field = {{ kind = "indentation", centre_mm = {}, direction = [0, 1, 0], depth_mm = 4, radius_mm = 20 }}
[needle]
tip_mm = {}
direction = [0, 1, 1]
"#,
        at(0.0, -40.0, 0.0),
        at(2.0, -40.0, 0.0),
        at(0.0, -40.0, 0.0),
        at(5.0, -10.0, 0.0),
    );
    bench.write(&format!("{name}.toml"), &scene);
}

fn numbers(value: &Value) -> Vec<f64> {
    let numbers = value.as_array().expect("numbers").iter();
    numbers.map(|x| x.as_f64().expect("a number")).collect()
}

/// Double precision holds places of 1e5 mm to 2^-37 mm; a few sums of them stay well within this.
fn moved(near: &[f64], far: &[f64], what: &str) {
    let off = (0..3).map(|axis| (far[axis] - near[axis] - FAR[axis]).abs());
    assert!(off.fold(0.0, f64::max) < 1e-9, "{what}: {near:?} and {far:?}");
}

#[test]
fn a_scene_moved_far_away_gives_the_same_frames_and_places_in_the_world() {
    let bench = Bench::new();
    write(&bench, "near", [0.0; 3]);
    write(&bench, "far", FAR);
    for name in ["near", "far"] {
        let layers = LAYERS.join(",");
        bench
            .run(&format!(
                "render {name}.toml --backend cpu -o {name} --layers {layers} --sidecar"
            ))
            .text();
        bench
            .run(&format!("render {name}.toml --backend cpu -o {name}.mha"))
            .text();
    }
    let read = |name: &str, file: &str| bench.path(&format!("{name}/{file}"));
    let files = bench.files("near");
    assert_eq!(files, bench.files("far"));
    for file in files.iter().filter(|file| file.ends_with(".png")) {
        if LAYERS.iter().any(|layer| file.contains(layer)) {
            assert!(grey16(&read("near", file)) == grey16(&read("far", file)), "{file}");
        } else {
            let [near, far] = ["near", "far"].map(|name| grey(&read(name, file)));
            assert!(near == far, "{file}");
            assert!(near.1.iter().any(|&grey| grey > 60), "a picture, not a black square");
        }
    }

    let names: Vec<&String> = files
        .iter()
        .filter(|file| file.ends_with(".json") && *file != "parameters.json")
        .collect();
    assert_eq!(names.len(), 2, "{files:?}");
    for file in names {
        let [near, far] = ["near", "far"].map(|name| bench.read::<Sidecar>(&format!("{name}/{file}")));
        let place = |rows: &insonify_base::matrix::Rows| [0, 1, 2].map(|row| rows.0[(row, 3)]);
        moved(
            &place(&near.probe_to_world),
            &place(&far.probe_to_world),
            "probe_to_world",
        );
        let images = [near.image.image_to_world, far.image.image_to_world];
        moved(&place(&images[0]), &place(&images[1]), "image_to_world");
        let (near, far) = (near.needle.expect("a needle"), far.needle.expect("a needle"));
        moved(&near.tip_mm, &far.tip_mm, "tip_mm");
        moved(&near.shaft_mm[0], &far.shaft_mm[0], "shaft_mm");
    }
    let [near, far] = ["near.mha", "far.mha"].map(|name| Sequence::read(&bench.path(name)).expect("a sequence"));
    for frame in 0..2 {
        assert!(near.image(frame) == far.image(frame));
        let place = |sequence: &Sequence| {
            let pose = sequence.transform(frame, "Image", "World").expect("a transform");
            [0, 1, 2].map(|row| pose[(row, 3)])
        };
        moved(&place(&near), &place(&far), "ImageToWorld");
    }
}

#[test]
fn a_pixel_far_away_is_explained_in_the_world() {
    let bench = Bench::new();
    write(&bench, "near", [0.0; 3]);
    write(&bench, "far", FAR);
    let [near, far] = ["near", "far"].map(|name| bench.run(&format!("inspect {name}.toml --at 24,20 --json")).json());
    moved(&numbers(&near["world_mm"]), &numbers(&far["world_mm"]), "world_mm");
    let (near_sample, far_sample) = (&near["sample"], &far["sample"]);
    for key in ["world_mm", "reference_mm"] {
        moved(&numbers(&near_sample[key]), &numbers(&far_sample[key]), key);
    }
    assert_eq!(near["grey_level"], far["grey_level"]);
    for key in ["label", "line", "sample"] {
        assert_eq!(near_sample[key], far_sample[key], "{key}");
    }
    for key in ["element", "nodes", "place"] {
        assert_eq!(near_sample["mesh"][key], far_sample["mesh"][key], "{key}");
    }
    // The texture is looked up at the place in single precision rows of the atlas: 1e-9 mm more or less change it by as
    // much.
    let texture = [near_sample, far_sample].map(|sample| sample["texture"]["value"].as_f64().expect("a texture"));
    assert!((texture[0] - texture[1]).abs() < 1e-6, "{texture:?}");
    assert!(
        near_sample["displacement_mm"].as_f64() > Some(0.1),
        "the tissue there has moved: {near_sample}"
    );
}
