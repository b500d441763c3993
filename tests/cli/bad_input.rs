//! Wrong arguments, files and scenes end with status 2; what the machine cannot do, with 1. Nothing panics, and nothing
//! is left half written.

use std::process::{Command, Stdio};

use crate::support::{Bench, Run, SCENE};

#[test]
fn wrong_arguments_are_status_2() {
    let bench = Bench::new();
    bench.run("").fails(2, &["Usage"]);
    bench.run("frobnicate").fails(2, &["frobnicate"]);
    bench.run("render --sise 4x4").fails(2, &["--sise", "--size"]);
    bench.run("render --size 0x5").fails(2, &["0x5", "640x480"]);
    bench.run("render --size 99999x1").fails(2, &["16384"]);
    bench.run("render --frames 0").fails(2, &["--frames"]);
    bench.run("render --backend tpu").fails(2, &["tpu", "cpu-f64"]);
    bench
        .run("render --layers labels,colours")
        .fails(2, &["colours", "loss"]);
    bench
        .run("render scene.toml --backend cpu --adapter any")
        .fails(2, &["--adapter"]);
    bench
        .run("render scene.toml --backend cpu -o a.jpg")
        .fails(2, &["a.jpg", ".png"]);
    bench
        .run("render scene.toml --backend cpu --frames 2 -o a.png")
        .fails(2, &["a.png", "2 frames"]);
    bench.run("inspect scene.toml --at 1").fails(2, &["320,240"]);
    bench.run("phantom spleen -o a.nrrd").fails(2, &["abdomen"]);
    bench
        .run("phantom abdomen -o a.nrrd --resolution-mm nan")
        .fails(2, &["NaN", "0.3"]);
    bench
        .run("phantom two-layer -o a.xyz --resolution-mm 4")
        .fails(2, &["a.xyz", ".nrrd"]);
    bench.run("bench scene.toml -o report").fails(2, &["--compare"]);
    bench
        .run("bench scene.toml --frames 2 -o report")
        .fails(2, &["--compare"]);
    bench.run("bench --compare --frames 3").fails(2, &["--frames"]);
    bench
        .run("bench --compare --backend cpu-f64")
        .fails(2, &["single precision"]);
    bench
        .run("tradeoff image --backend cpu-f64")
        .fails(2, &["double precision"]);
    assert_eq!(bench.files("."), ["scene.toml"]);
}

#[test]
fn wrong_files_are_status_2_and_named() {
    let bench = Bench::new();
    bench.run("render none.toml").fails(2, &["none.toml"]);
    bench.run("info none.nii.gz").fails(2, &["none.nii.gz"]);
    bench.run("render --labels none.nii.gz").fails(2, &["none.nii.gz"]);
    bench.write("text.nii", "this is no image");
    bench.run("info text.nii").fails(2, &["text.nii", "expected"]);
    bench
        .run("render ct.nii.gz")
        .fails(2, &["ct.nii.gz is an image file", "--labels ct.nii.gz"]);
    bench.write("a.igs.mha", "ObjectType = Image\nNDims = 3\nDimSize = 1 1 1\nElementType = MET_UCHAR\nSeq_Frame0000_Timestamp = 0\nElementDataFile = LOCAL\n0");
    bench
        .run("render a.igs.mha")
        .fails(2, &["a.igs.mha is a recording", "under [motion.sequence]"]);
    bench.run("inspect scene.toml --at -1,3").fails(2, &["-1,3", "320,240"]);
    bench.write("binary.toml", "version = 1\n");
    std::fs::write(bench.path("binary.toml"), b"version = 1\n\xff\xfe").unwrap();
    bench.run("plan binary.toml").fails(2, &["binary.toml", "line 2"]);
    bench.write(
        "plus.xml",
        "<PlusConfiguration version=\"2.9\">\n</PlusConfiguration>\n",
    );
    bench
        .run("plan plus.xml")
        .fails(2, &["plus.xml", "found a configuration of PLUS; expected a TOML file"]);
    bench.write("scene.json", "{\"version\": 2}\n");
    bench
        .run("plan scene.json")
        .fails(2, &["found a JSON file; expected a TOML file"]);
}

/// Whatever a file is given as, it is told what it is, and none of its bytes are shown.
#[test]
fn binary_files_are_named_and_not_shown() {
    let bench = Bench::new();
    bench.run("phantom two-layer -o labels.nrrd --resolution-mm 5").text();
    let files: [(&str, &[u8], &str); 4] = [
        ("picture", b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\xff\xfe", "picture (PNG)"),
        ("archive", b"PK\x03\x04\x14\0\0\0\x08\0\xe9", "zip archive"),
        ("zeros", &[0; 600], ""),
        ("noise", b"\x01\xfe\x02\xff\x03\x80\x1b[2Jx,y\n\xc3\x28", ""),
    ];
    for (file, bytes, kind) in files {
        for (command, ending) in [
            ("info FILE", ""),
            ("info FILE", ".nii.gz"),
            ("info FILE", ".nrrd"),
            ("info FILE", ".ply"),
            ("info labels.nrrd --names FILE", ".csv"),
            ("info labels.nrrd --names FILE", ".json"),
            ("mesh info FILE", ".msh"),
            ("mesh info FILE", ".vtu"),
            ("register labels.nrrd --fit f.toml --surface FILE", ".csv"),
            ("register labels.nrrd --fit f.toml --surface FILE", ".fcsv"),
            ("register labels.nrrd --fit f.toml --surface FILE", ".mrk.json"),
            ("register labels.nrrd --fit f.toml --surface FILE", ".obj"),
            ("plan FILE", ".toml"),
            ("solve FILE", ".toml"),
            ("calibrate pivot FILE", ".csv"),
            ("score --groups FILE", ".csv"),
        ] {
            let name = format!("{file}{ending}");
            std::fs::write(bench.path(&name), bytes).unwrap();
            let run = bench.run(&command.replace("FILE", &name));
            run.fails(2, &[&name]);
            let shown = [
                "\\0",
                "\\x",
                "\\u{",
                "\u{fffd}",
                "utf-8 sequence",
                "valid UTF-8",
                "ParseError",
            ];
            assert!(!shown.iter().any(|bytes| run.stderr.contains(bytes)), "{run:?}");
            // Formats with an ending of their own may say what they miss.
            let is_text = [".csv", ".json", ".fcsv", ".toml"]
                .iter()
                .any(|text| ending.ends_with(text));
            assert!(!is_text || run.stderr.contains(kind), "{run:?}");
        }
    }
}

/// Two megabytes that unpack to the two gigabytes that their header calls for.
#[cfg(target_os = "linux")]
#[test]
fn data_beyond_the_memory_are_status_1_before_any_is_taken() {
    use std::io::Write;
    let bench = Bench::new();
    let mut packer = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::best());
    packer.write_all(&vec![0; 64 << 20]).unwrap();
    let header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 1024 1024 2048\nspacings: 1 1 1\nencoding: gzip\n\n";
    let data = packer.finish().unwrap().repeat(32);
    std::fs::write(bench.path("bomb.nrrd"), [header.as_bytes(), &data].concat()).unwrap();
    let run = |command: &str| {
        let limited = format!("ulimit -v 2000000; exec {} {command}", env!("CARGO_BIN_EXE_insonify"));
        let out = Command::new("sh")
            .args(["-c", &limited])
            .current_dir(bench.path("."))
            .output()
            .unwrap();
        (out.status.code(), String::from_utf8(out.stderr).unwrap())
    };
    for command in ["info bomb.nrrd", "render --labels bomb.nrrd --backend cpu"] {
        let (status, words) = run(command);
        let says = ["bomb.nrrd", "2.0 GiB (2147483648 bytes)"];
        assert!(
            status == Some(1) && says.iter().all(|says| words.contains(says)),
            "{status:?}: {words}"
        );
    }
}

#[test]
fn a_broken_gzip_is_an_error_of_that_file() {
    let bench = Bench::new();
    bench.run("phantom two-layer -o a.nii.gz --resolution-mm 3").text();
    let whole = std::fs::read(bench.path("a.nii.gz")).unwrap();
    std::fs::write(bench.path("cut.nii.gz"), &whole[..whole.len() / 2]).unwrap();
    bench.run("info cut.nii.gz").fails(2, &["cut.nii.gz"]);
    let mut flipped = whole.clone();
    flipped[whole.len() / 2] ^= 0x10;
    std::fs::write(bench.path("flipped.nii.gz"), flipped).unwrap();
    bench
        .run("render --labels flipped.nii.gz --backend cpu")
        .fails(2, &["flipped.nii.gz"]);
    assert!(!bench.path("frame.png").exists());
}

#[test]
fn no_adapter_is_status_1_only_if_one_was_asked_for() {
    let bench = Bench::new();
    bench
        .run_without_gpu("render scene.toml --backend gpu")
        .fails(1, &["no GPU adapter", "mesa-vulkan-drivers"]);
    bench
        .run_without_gpu("bench scene.toml --backend gpu --frames 1")
        .fails(1, &["no GPU adapter"]);
    assert!(!bench.path("frame.png").exists());
    bench.run_without_gpu("render scene.toml").text();
    let status = bench
        .run("render scene.toml --backend gpu --adapter no-such-card")
        .status;
    assert!(
        status == Some(2) || status == Some(1),
        "2 beside other adapters, 1 without any: {status:?}"
    );
}

#[test]
fn outputs_without_a_folder_are_status_2() {
    let bench = Bench::new();
    bench
        .run("render scene.toml --backend cpu -o none/a.png")
        .fails(2, &["none/a.png"]);
    bench
        .run("render scene.toml --backend cpu -o none/a.mha")
        .fails(2, &["none/a.mha"]);
    bench
        .run("render scene.toml --backend cpu --frames 2 -o scene.toml/out")
        .fails(2, &["scene.toml/out", "must be a folder"]);
    bench
        .run("render scene.toml --backend cpu --frames 2 -o scene.toml")
        .fails(2, &["scene.toml", "must be a folder"]);
    bench
        .run("phantom two-layer -o none/a.nrrd --resolution-mm 3")
        .fails(2, &["none/a.nrrd"]);
    assert_eq!(bench.files("."), ["scene.toml"]);
}

#[cfg(target_os = "linux")]
#[test]
fn full_outputs_are_status_1() {
    let bench = Bench::new();
    bench
        .run("render scene.toml --backend cpu -o /dev/full")
        .fails(2, &["/dev/full", "regular file"]);
    for arguments in ["scene", "schema", "doctor --json", "completions bash"] {
        let mut command = bench.command(arguments);
        let full = std::fs::File::options().write(true).open("/dev/full").unwrap();
        command.stdout(full);
        Run::of(command, arguments).fails(1, &["standard output"]);
    }
}

/// A limit on the size of files stands in for a full disk: the write fails half-way.
#[cfg(target_os = "linux")]
#[test]
fn a_disk_that_fills_up_leaves_no_half_file() {
    let bench = Bench::new();
    let limited = |arguments: &str| {
        let mut shell = Command::new("sh");
        let script = format!("ulimit -f 8; exec {} {arguments}", env!("CARGO_BIN_EXE_insonify"));
        shell.arg("-c").arg(script).current_dir(bench.path("."));
        Run::of(shell, arguments)
    };
    limited("render scene.toml --backend cpu --size 400x300 -o big.png").fails(1, &["big.png"]);
    limited("render scene.toml --backend cpu --size 400x300 --frames 4 -o big.mha").fails(1, &["big.mha"]);
    limited("phantom abdomen --resolution-mm 3 -o big.nrrd").fails(1, &["big.nrrd"]);
    assert_eq!(bench.files("."), ["scene.toml"]);
    std::fs::write(bench.path("kept.png"), b"\x89PNG of before").unwrap();
    limited("render scene.toml --backend cpu --size 400x300 -o kept.png").fails(1, &["kept.png"]);
    assert_eq!(std::fs::read(bench.path("kept.png")).unwrap(), b"\x89PNG of before");
}

#[cfg(target_os = "linux")]
#[test]
fn what_the_limits_of_the_process_do_not_hold_is_refused_with_its_bytes() {
    let bench = Bench::new();
    let limited = |arguments: &str| {
        let mut shell = Command::new("sh");
        let script = format!("ulimit -v 800000; exec {} {arguments}", env!("CARGO_BIN_EXE_insonify"));
        shell.arg("-c").arg(script).current_dir(bench.path("."));
        shell.env("RAYON_NUM_THREADS", "2");
        Run::of(shell, arguments)
    };
    limited("render scene.toml --backend cpu --size 48x40 -o small.png").text();
    limited("render scene.toml --backend cpu --size 8192x8192").fails(
        1,
        &["8192 x 8192 pixels", "896.2 MiB (939706368 bytes)", "are available"],
    );
    let header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 1024 1024 1024\nencoding: raw\ndata file: large.raw\n\n";
    bench.write("large.nhdr", header);
    std::fs::File::create(bench.path("large.raw"))
        .unwrap()
        .set_len(1 << 30)
        .unwrap();
    limited("info large.nhdr").fails(1, &["large.raw", "1024 x 1024 x 1024", "1.0 GiB (1073741824 bytes)"]);
}

#[test]
fn a_reader_that_has_enough_is_no_failure() {
    let bench = Bench::new();
    for arguments in ["schema", "completions zsh", "--help"] {
        let mut child = bench
            .command(arguments)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        drop(child.stdout.take());
        let output = child.wait_with_output().unwrap();
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert!(
            output.status.success() && !stderr.contains("panicked"),
            "{arguments}: {:?} {stderr}",
            output.status
        );
    }
}

#[test]
fn scenes_that_are_too_small_to_see_anything_still_render() {
    let bench = Bench::new();
    for (from, to) in [
        ("depth_mm = 60", "depth_mm = 0.1"),
        ("width_mm = 38", "width_mm = 0.1"),
        ("samples = 64", "samples = 1"),
    ] {
        bench.write("tiny.toml", &SCENE.replace(from, to));
        let run = bench.run("render tiny.toml --backend cpu -o tiny.png --layers label-value,depth,loss");
        assert!(run.status == Some(0) || run.status == Some(2), "{run:?}");
    }
}
