//! Insertions into a body that breathes.

use insonify_mesh::file::{ReadOptions, read_mesh};

use crate::support::{Bench, grey};

/// A breath of 1 s, whose deepest moment is the end of the run.
const BREATH: &str = "[scene.motion.breathing]\nrate_per_min = 60\ntravel_mm = { liver = 6 }\n";

/// The abdomen, and a needle beside it that hardly moves; `TABLES` more, `KEYS` of the tissue.
fn scenario(tables: &str, tissue: &str) -> String {
    format!(
        "run = {{ dt_ms = 10, frame_rate_hz = 20 }}\n{}{tables}[tissue]\n{tissue}\n\
         [[tissue.fix]]\nbox_mm = [[-inf, 60, -inf], [inf, inf, inf]]\n[needle]\nlength_mm = 100\n[[needle.motion.keyframes]]\ntime_s = 0\n\
         tip_mm = [-140, -140, 0]\ndirection = [0, 1, 0]\n[[needle.motion.keyframes]]\ntime_s = 0.5\n\
         tip_mm = [-140, -139, 0]\ndirection = [0, 1, 0]\n",
        scene("scene.")
    )
}

/// The imaged scene, with this prefix of its tables.
fn scene(prefix: &str) -> String {
    format!(
        "[{prefix}volume]\nphantom = \"abdomen\"\nresolution_mm = 4\n[{prefix}probe]\nkind = \"curvilinear\"\nradius_mm = 60\n\
         angle_deg = 60\ndepth_mm = 120\nlines = 64\nsamples = 200\n[{prefix}image]\nwidth = 80\nheight = 60\n\
         [{prefix}pose]\ntarget = \"liver\"\nplane = \"sagittal\"\n"
    )
}

/// Displacement of each node along z in a written mesh, mm.
fn along_z(bench: &Bench, name: &str) -> Vec<f64> {
    let mesh = read_mesh(&bench.path(name), &ReadOptions::default()).expect("a mesh");
    mesh.displacements
        .expect("displacements")
        .iter()
        .map(|by| by[2])
        .collect()
}

#[test]
fn a_written_mesh_shows_the_breath_that_the_frames_show() {
    let bench = Bench::new();
    bench.write("breath.toml", &scenario(BREATH, "nodes = 1500"));
    bench
        .run("insert breath.toml -o out --images --vtu 500 --backend cpu -q")
        .text();
    let deepest = along_z(&bench, "out/mesh/mesh_0001.vtu");
    let farthest = deepest.iter().copied().fold(0.0, f64::min);
    assert!(
        (farthest + 6.0).abs() < 0.1 && deepest.iter().all(|z| *z < 0.1),
        "{farthest} mm"
    );
    assert!(along_z(&bench, "out/mesh/mesh_0000.vtu").iter().all(|z| z.abs() < 0.05));
    let of = |name: &str| grey(&bench.path(name)).1;
    let difference = |a: &[u8], b: &[u8]| {
        let sum: f64 = a.iter().zip(b).map(|(a, b)| f64::from(a.abs_diff(*b))).sum();
        sum / a.len() as f64
    };
    // The noise of a frame depends on its number.
    let [rest, inspired] = ["0000", "0010"].map(|number| of(&format!("out/frames/frame_{number}.png")));
    assert!(difference(&rest, &inspired) > 3.0, "{}", difference(&rest, &inspired));
    let deform = "[deform]\nmesh = \"out/mesh/mesh_0001.vtu\"\n[motion]\nframes = 11\n";
    bench.write("written.toml", &format!("{}{deform}", scene("")));
    bench.run("render written.toml -o written --backend cpu -q").text();
    let written = of("written/frame_0010.png");
    let missed = difference(&written, &inspired);
    assert!(missed < 0.1, "{missed} grey levels");
}

#[test]
fn a_held_breath_lasts_and_other_models_refuse_one() {
    let bench = Bench::new();
    // Held from before the start, at the deepest.
    bench.write(
        "held.toml",
        &scenario(&format!("{BREATH}hold_s = [-0.5, 9]\n"), "nodes = 1500"),
    );
    bench.run("insert held.toml -o out --vtu 500 -q").text();
    let [start, end] = ["0000", "0001"].map(|number| along_z(&bench, &format!("out/mesh/mesh_{number}.vtu")));
    assert!((start.iter().copied().fold(0.0, f64::min) + 6.0).abs() < 0.1);
    assert!(start.iter().zip(&end).all(|(start, end)| (start - end).abs() < 1e-9));
    let springs = scenario(BREATH, "model = \"mass-spring\"")
        .replace("[[tissue.fix]]\nbox_mm = [[-inf, 60, -inf], [inf, inf, inf]]\n", "");
    bench.write("springs.toml", &springs);
    bench
        .run("insert springs.toml -o other")
        .fails(2, &["springs.toml", "motion.breathing", "finite-element"]);
}
