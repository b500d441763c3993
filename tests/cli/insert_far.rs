//! `insonify insert` far from the origin of the world: steps and frames are those of the same scenario near it.

use insonify_anatomy::phantom::{Phantom, PhantomOptions, make};
use insonify_anatomy::volume::save;
use insonify_mesh::TetMesh;
use insonify_mesh::file::write_vtu;
use nalgebra::Vector3;

use crate::support::{Bench, grey};

/// Whole metres.
const FAR: [f64; 3] = [-57_000.0, 1e5, 3_000.0];
const AXES: [&str; 3] = ["x", "y", "z"];
/// Half the distance of doubles between 2^16 and 2^17 mm: what a place of 1e5 mm is off for having been rounded once.
const ROUNDING_MM: f64 = 1.0 / (1u64 << 37) as f64;
/// How often a place is rounded, at most, in an iteration of a step or a part of it, and what tissue and needle resist
/// with at most, N/mm: as the stability report has it for insertions moved far away.
const ROUNDINGS: f64 = 32.0;
const STIFFEST_N_PER_MM: f64 = 100.0;

/// A model whose own sides are held, so that it has no `[[tissue.fix]]`.
const MASSES: &str = "model = \"mass-spring\"";

/// A block of labels and, over the same place, a mesh, both moved.
fn write(bench: &Bench, name: &str, by: [f64; 3], [tissue, needle]: [&str; 2]) {
    let coarse = PhantomOptions {
        resolution_mm: Some(5.0),
        seed: 1,
    };
    let volume = make(Phantom::TwoLayer, &coarse).expect("a phantom");
    let moved = volume.moved(Vector3::from(by)).expect("a place");
    save(&moved, &bench.path(&format!("{name}.nrrd"))).expect("written");
    let block = TetMesh::over_box([-40.0, -40.0, -45.0], [40.0, 40.0, 45.0], 400).expect("a mesh");
    let regions = vec![1; block.elements().len()];
    let block = TetMesh::new(block.nodes().to_vec(), block.elements().to_vec(), regions).expect("a mesh");
    write_vtu(&bench.path(&format!("{name}.vtu")), &block.moved(by), None).expect("written");
    let at = |x: f64, y: f64, z: f64| format!("[{}, {}, {}]", x + by[0], y + by[1], z + by[2]);
    let fixed = if tissue == MASSES {
        String::new()
    } else {
        format!(
            "\n[[tissue.fix]]\nbox_mm = [[-inf, -inf, {}], [inf, inf, inf]]",
            37.3 + by[2]
        )
    };
    let scenario = format!(
        r#"version = 1
[run]
dt_ms = 10
frame_rate_hz = 10
[scene]
seed = 3
volume = {{ file = "{name}.nrrd" }}
image = {{ width = 48, height = 40 }}
probe = {{ kind = "linear", width_mm = 38, depth_mm = 60, lines = 64, samples = 256 }}
pose = {{ position_mm = {}, direction = [0, 1, 0], lateral = [0, 0, 1] }}
[tissue]
{}
[needle]
length_mm = 100
{needle}
[[needle.motion.keyframes]]
time_s = 0
tip_mm = {}
direction = [0.1, 0.05, 1]
[[needle.motion.keyframes]]
time_s = 0.5
tip_mm = {}
direction = [0.1, 0.05, 1]
"#,
        at(0.0, -40.0, -25.0),
        tissue.replace("NAME", name) + &fixed,
        at(3.3, 2.1, -47.2),
        at(6.0, 3.45, -20.2),
    );
    bench.write(&format!("{name}.toml"), &scenario);
}

/// Steps of a run, column by column.
struct Steps {
    names: Vec<String>,
    rows: Vec<Vec<f64>>,
}

/// A number; not one where there is no such point.
fn number(cell: &str) -> f64 {
    if cell.is_empty() {
        f64::NAN
    } else {
        cell.parse().expect("a number")
    }
}

impl Steps {
    fn read(bench: &Bench, folder: &str) -> Steps {
        let text = bench.text(&format!("{folder}/steps.csv"));
        let mut lines = text.lines().map(|line| line.split(','));
        let names = lines.next().expect("a head").map(str::to_owned).collect();
        let row = |line: std::str::Split<'_, char>| line.map(number).collect();
        Steps {
            names,
            rows: lines.map(row).collect(),
        }
    }

    fn of(&self, name: &str) -> Vec<f64> {
        let at = self.names.iter().position(|column| column == name).expect(name);
        self.rows.iter().map(|row| row[at]).collect()
    }
}

/// A column of two runs is the same but for a shift, to a limit in every step.
fn agrees(near: &Steps, far: &Steps, name: &str, shift: f64, limit: f64) {
    for (step, (near, far)) in near.of(name).into_iter().zip(far.of(name)).enumerate() {
        let off = (far - near - shift).abs();
        assert!(off <= limit, "{name}, step {step}: off by {off}, at most {limit}");
    }
}

fn compare(parts: [&str; 2]) {
    let bench = Bench::new();
    write(&bench, "near", [0.0; 3], parts);
    write(&bench, "far", FAR, parts);
    for name in ["near", "far"] {
        bench
            .run(&format!("insert {name}.toml -o {name} --frames --backend cpu -q"))
            .text();
    }
    let [near, far] = ["near", "far"].map(|name| Steps::read(&bench, name));
    assert_eq!((near.rows.len(), &near.names), (far.rows.len(), &far.names));
    for same in ["contacts", "stuck", "remeshes", "substeps", "iterations", "converged"] {
        assert_eq!(near.of(same), far.of(same), "{same}");
    }
    let pushed = near.of("base_force_z_n").into_iter().fold(0.0, f64::min);
    assert!(pushed < -0.3, "tissue pushes the hand back: {pushed} N");
    // Errors of a step are handed on to the next.
    let rounds = |at: usize| near.of("iterations")[at].max(near.of("substeps")[at]);
    let rounds: f64 = (0..near.rows.len()).map(rounds).sum();
    let limit_mm = ROUNDINGS * ROUNDING_MM * rounds;
    for (axis, by) in AXES.iter().zip(FAR) {
        for name in ["base", "tip"] {
            agrees(&near, &far, &format!("{name}_{axis}_mm"), by, limit_mm);
        }
        for name in ["base", "world"] {
            let limit_n = limit_mm * STIFFEST_N_PER_MM;
            agrees(&near, &far, &format!("{name}_force_{axis}_n"), 0.0, limit_n);
        }
    }
    let frames = bench.files("near/frames");
    assert!(frames.len() == 6 && frames == bench.files("far/frames"), "{frames:?}");
    for frame in &frames {
        let [near, far] = ["near", "far"].map(|name| grey(&bench.path(&format!("{name}/frames/{frame}"))));
        assert!(near == far, "{frame}");
        assert!(near.1.iter().any(|&grey| grey > 60), "a picture, not a black square");
    }
}

#[test]
fn an_insertion_into_labels_moved_far_away_takes_the_same_steps_to_the_same_frames() {
    compare(["nodes = 400", ""]);
}

#[test]
fn an_insertion_into_a_mesh_moved_far_away_takes_the_same_steps_to_the_same_frames() {
    compare(["mesh = \"NAME.vtu\"", "model = \"springs\""]);
}

#[test]
fn masses_and_springs_moved_far_away_take_the_same_steps_to_the_same_frames() {
    compare([MASSES, ""]);
}

#[test]
fn tissue_that_stiffens_moved_far_away_takes_the_same_steps_to_the_same_frames() {
    compare(["model = \"nonlinear\"\nmesh = \"NAME.vtu\"", ""]);
}
