//! `insonify manipulator`: tables both ways, motion, workspace, and errors that name the axis.

use crate::support::Bench;

const GUIDED: &str = "\
version = 1
[scene.volume]
phantom = \"liver-vein\"
resolution_mm = 3
[scene.image]
width = 160
height = 120
[needle]
[manipulator]
[[manipulator.keyframes]]
time_s = 0
position_mm = 0
posture_deg = 0
insertion_mm = 0
[[manipulator.keyframes]]
time_s = 4
position_mm = 6
posture_deg = -9
insertion_mm = 20
";

#[test]
fn slides_and_needles_are_tables_both_ways() {
    let bench = Bench::new();
    bench.write(
        "slides.csv",
        "slide_1_mm,slide_2_mm,slide_3_mm\n0,0,0\n-12.5,-9,33\n20,12,60\n",
    );
    let forward = bench.run("manipulator forward slides.csv --json").json();
    for (key, exact) in [("posture_deg", 0.0), ("angle_deg", -30.0)] {
        assert!((forward[0][key].as_f64().unwrap() - exact).abs() < 1e-9, "{forward}");
    }
    let mut poses = String::from("tip_x_mm,tip_y_mm,angle_deg\n");
    for place in forward.as_array().unwrap() {
        poses += &format!("{},{},{}\n", place["tip_mm"][0], place["tip_mm"][1], place["angle_deg"]);
    }
    bench.write("poses.csv", &poses);
    let inverse = bench.run("manipulator inverse poses.csv --json").json();
    for (row, slides) in [[0.0, 0.0, 0.0], [-12.5, -9.0, 33.0], [20.0, 12.0, 60.0]]
        .iter()
        .enumerate()
    {
        for (axis, slide) in slides.iter().enumerate() {
            let computed = inverse[row]["slides_mm"][axis].as_f64().unwrap();
            assert!((computed - slide).abs() < 1e-9, "{row} {axis}: {computed}");
        }
    }
    assert!(
        bench
            .run("manipulator inverse poses.csv")
            .text()
            .contains("deg per mm of II")
    );
    bench.write("poses.csv", "tip_x_mm,tip_y_mm,angle_deg\n30,20,-30\n30,120,-30\n");
    bench
        .run("manipulator inverse poses.csv")
        .fails(2, &["poses.csv: line 3", "horizontal positioning (A) of 66.788 mm"]);
    bench.write("slides.csv", "slide_1_mm,slide_2_mm,slide_3_mm\n0,11,0\n");
    bench
        .run("manipulator forward slides.csv")
        .fails(2, &["slides.csv: line 2", "posture (B)", "expected -30 to 30"]);
    bench.run("manipulator forward poses.csv").fails(2, &["slide_1_mm"]);
}

#[test]
fn a_scenario_is_followed_and_drawn() {
    let bench = Bench::new();
    bench.write("g.toml", GUIDED);
    let slides = bench.run("manipulator inverse g.toml --json --quiet").json();
    assert_eq!((&slides[0]["time_s"], &slides[1]["time_s"]), (&0.0.into(), &4.0.into()));
    assert_eq!(slides[1]["slides_mm"][0], 6.0);
    let motion = bench.run("manipulator follow g.toml -o motion --json").json();
    assert!(motion["largest_tip_error_mm"].as_f64().unwrap() < 0.3);
    assert!(motion["motion"].as_array().unwrap().len() > 500);
    assert!(bench.text("motion/motion.csv").lines().count() == 4002);
    let open = bench
        .run("manipulator follow g.toml -o open --control open-loop --json")
        .json();
    let lost = open["lost_mm"][0].as_f64().unwrap();
    assert!(open["final_tip_error_mm"].as_f64().unwrap() > 0.5 * lost, "{open}");
    bench
        .run("manipulator workspace g.toml -o reach.png --backend cpu")
        .text();
    assert!(bench.files(".").contains(&"reach.png".to_owned()));
    // A motion that is beyond the guide is no reason not to show what it reaches.
    let (scene, _) = GUIDED.split_once("[[").unwrap();
    let tips = [0, 4].map(|time| {
        format!("[[needle.motion.keyframes]]\ntime_s = {time}\ntip_mm = [0, {time}, 9]\ndirection = [0, 1, 0]\n")
    });
    bench.write("beyond.toml", &(scene.to_owned() + &tips.concat()));
    let beyond = bench.run("manipulator workspace beyond.toml -o beyond.png --backend cpu");
    assert_eq!(beyond.text(), "");
    assert!(beyond.stderr.contains("the needle's motion is not drawn"), "{beyond:?}");
    assert!(bench.files(".").contains(&"beyond.png".to_owned()));
    bench
        .run("manipulator follow beyond.toml -o beyond")
        .fails(2, &["at 0.000 s"]);
    bench.write(
        "none.toml",
        &GUIDED
            .replace("[manipulator]\n", "")
            .replace("manipulator.keyframes", "needle.motion.keyframes"),
    );
    bench
        .run("manipulator follow none.toml -o none")
        .fails(2, &["none.toml"]);
}
