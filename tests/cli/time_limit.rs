//! `--time-limit-s`: work that would take long ends when its time is over, and leaves nothing.

use std::time::Instant;

use super::support::Bench;

/// Beyond the limit, s: the time in which a loaded machine starts a process and removes its files.
const LATE_S: f64 = 10.0;

#[test]
fn long_work_ends_with_its_time_and_leaves_nothing() {
    let bench = Bench::new();
    let pushes: String = (1..40)
        .map(|n| format!("{},{}\n", 0.25 * n as f64, 0.01 * (n * n) as f64))
        .collect();
    bench.write("force.csv", &format!("travel_mm,force_n\n{pushes}"));
    let case = bench.run("beam --example").text().to_owned();
    bench.write("case.toml", &case);
    let tips: Vec<String> = (0..5000)
        .map(|n| format!("{:.4}", -2.0 + 0.0008 * f64::from(n)))
        .collect();
    let long = bench
        .text("scene.toml")
        .replace("samples = 64", "samples = 4096")
        .replace("lines = 32", "lines = 2048");
    bench.write("long.toml", &long);
    let before = bench.files(".");
    for arguments in [
        "insert liver-biopsy -o out",
        "path liver-puncture --target vessel -o out",
        "puncture --step-mm 0.001 -o out",
        "puncture --fit force.csv --step-mm 0.001 -o out",
        &format!("beam map case.toml --tip-mm {}", tips.join(",")),
        "tradeoff beam -o out",
        "rf long.toml --frames 10000 -o out.igs.mha",
        "render long.toml --frames 10000 -o out.igs.mha",
        // These have a limit of their own.
        "--time-limit-s 0.4 bench long.toml",
        "--time-limit-s 0.4 tradeoff image -o out",
    ] {
        let start = Instant::now();
        let limit = if arguments.starts_with("--") {
            ""
        } else {
            "--time-limit-s 0.4"
        };
        let run = bench.run(&format!("{arguments} {limit}"));
        run.fails(124, &["the time limit of 0.4 s is over", "--time-limit-s"]);
        assert!(start.elapsed().as_secs_f64() < 0.4 + LATE_S, "{run:?}");
        assert_eq!(bench.files("."), before, "{arguments}");
    }
    // Work that is done in time is as without the limit.
    let [limited, free] = ["beam case.toml --time-limit-s 600", "beam case.toml"].map(|arguments| bench.run(arguments));
    assert_eq!(limited.text(), free.text());
    for bad in ["0", "inf", "nan", "-1", "soon"] {
        bench
            .run(&format!("beam case.toml --time-limit-s={bad}"))
            .fails(2, &["expected 0.001 to 1e9 seconds"]);
    }
}
