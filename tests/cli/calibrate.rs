//! `insonify calibrate`: figures, pages and bad input.

use std::fmt::Write;

use crate::support::Bench;

/// Poses of a stylus of 150 mm whose tip rests at (1, 2, 3), as CSV.
fn resting() -> String {
    let names: Vec<String> = (0..16).map(|at| format!("m{}{}", at / 4, at % 4)).collect();
    let mut text = format!("time_s,{}\n", names.join(","));
    for at in 0..24 {
        let (around, lean) = (0.6 * f64::from(at), 0.1 + 0.01 * f64::from(at));
        // Tilted by `lean` about an axis in the plane.
        let (kx, ky) = (around.cos(), around.sin());
        let (c, s) = (lean.cos(), lean.sin());
        let rows = [
            [c + kx * kx * (1.0 - c), kx * ky * (1.0 - c), ky * s],
            [kx * ky * (1.0 - c), c + ky * ky * (1.0 - c), -kx * s],
            [-ky * s, kx * s, c],
        ];
        let _ = write!(text, "{at}");
        for (row, rest) in rows.iter().zip([1.0, 2.0, 3.0]) {
            let _ = write!(text, ",{},{},{},{}", row[0], row[1], row[2], rest - 150.0 * row[2]);
        }
        text += ",0,0,0,1\n";
    }
    text
}

#[test]
fn a_pivot_is_told_as_figures_lines_and_page() {
    let bench = Bench::new();
    bench.write("tip.csv", &resting());
    let run = bench.run("calibrate pivot tip.csv -o tip.html");
    assert!(
        run.text()
            .contains("tip_to_marker = \"1 0 0 0  0 1 0 0  0 0 1 150  0 0 0 1\""),
        "{run:?}"
    );
    assert!(
        run.text().contains("<Transform From=\"MarkerTip\" To=\"Marker\""),
        "{run:?}"
    );
    let page = bench.text("tip.html");
    assert!(page.contains("Residuals by frame") && page.contains("tip_to_marker"));
    let json = bench.run("calibrate pivot tip.csv --json").json();
    for (key, expected) in [("point_mm", [0.0, 0.0, 150.0]), ("pivot_mm", [1.0, 2.0, 3.0])] {
        for (axis, expected) in expected.into_iter().enumerate() {
            assert!((json[key][axis].as_f64().unwrap() - expected).abs() < 1e-6, "{json}");
        }
    }
    assert!(
        json["rms_mm"].as_f64().unwrap() < 1e-9 && json["std_mm"][2].as_f64().unwrap() < 1e-9,
        "{json}"
    );
    assert_eq!(
        (&json["used"], &json["skipped"], &json["trimmed"]),
        (&24.into(), &0.into(), &0.into())
    );
    assert!(json["max_mm"].is_number());
}

#[test]
fn directions_are_given_in_several_forms() {
    let bench = Bench::new();
    bench.write("tip.csv", &resting());
    // The first pose leans by 0.1 rad about x.
    bench.write("along.csv", "frame,dx,dy,dz\n0,0,-0.0998334166468,0.995004165278\n");
    let json = bench
        .run("calibrate direction tip.csv --directions along.csv --json")
        .json();
    assert!(
        json["direction"][2].as_f64().unwrap() > 0.999999 && json["used"] == 1,
        "{json}"
    );
    let json = bench.run("calibrate direction tip.csv --along 0,0,1 --json").json();
    assert!(
        json["direction"][2].as_f64().unwrap() > 0.99 && json["rms_deg"].as_f64().unwrap() > 10.0,
        "{json}"
    );
    bench
        .run("calibrate direction tip.csv")
        .fails(2, &["no direction is known", "--along, --directions or --hub"]);
    bench
        .run("calibrate direction tip.csv --along 0,0,0")
        .fails(2, &["0,0,0", "vector with a length"]);
    bench
        .run("calibrate direction tip.csv --hub tip.csv")
        .fails(2, &["too close for a direction"]);
    bench
        .run("calibrate direction tip.csv --along 0,0")
        .fails(2, &["expected 3 finite numbers"]);
}

#[test]
fn bad_input_is_told() {
    let bench = Bench::new();
    bench.write("tip.csv", &resting());
    bench.write("few.csv", &resting().lines().take(3).collect::<Vec<_>>().join("\n"));
    bench
        .run("calibrate pivot few.csv")
        .fails(2, &["found 2 valid poses; expected at least 4"]);
    bench.run("calibrate pivot none.csv").fails(2, &["none.csv"]);
    bench
        .run("calibrate pivot tip.csv --transform Stylus")
        .fails(2, &["transform `Stylus`", "such as StylusToTracker"]);
    bench
        .run("calibrate pivot tip.csv -o tip.txt")
        .fails(2, &["pages are written as .html"]);
    bench
        .run("calibrate spin tip.csv")
        .fails(2, &["about its axis; expected at least 10"]);
    bench
        .run("calibrate points tip.csv")
        .fails(2, &["no pixels are given", "give --pixels"]);
    bench.write("px.csv", "frame,u_px,v_px,wire\n0,1,2,E3\n");
    bench
        .run("calibrate points tip.csv --pixels px.csv")
        .fails(2, &["line 2", "`E3`", "a wire of --plus-config"]);
    bench.write("px.csv", "frame,u_px,v_px,x_mm,y_mm\n0,1,2,3,4\n");
    bench
        .run("calibrate points tip.csv --pixels px.csv")
        .fails(2, &["line 2", "column `z_mm`", "finite number"]);
    bench.write("px.csv", "frame,u_px,v_px,x_mm,y_mm,z_mm\n0,1,2,3,4,5\n");
    bench
        .run("calibrate points tip.csv --pixels px.csv")
        .fails(2, &["found 1 usable pixels"]);
}
