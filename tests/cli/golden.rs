//! Golden record: frames, plans, insertions, solved cases and error texts, as they were (`golden/record.txt`).
//!
//! `INSONIFY_GOLDEN=write cargo test --test cli golden` rewrites the record. `INSONIFY_GOLDEN=exact` also compares the
//! hashes of frames, which depend on the instruction set; without it frames are compared by the mean grey level of 4 x
//! 4 blocks. Numbers may differ by a part in a thousand.

use std::collections::BTreeMap;
use std::fmt::Write;

use insonify::{Backend, Frame, SceneFile};
use insonify_imaging::plan::Plan;
use insonify_imaging::synth::tables::Tables;
use serde_json::Value;

use crate::support::Bench;

const RECORD: &str = include_str!("golden/record.txt");

/// Entries of the record by key.
#[derive(Default)]
struct Record(BTreeMap<String, String>);

impl Record {
    fn put(&mut self, key: impl ToString, value: impl ToString) {
        let before = self.0.insert(key.to_string(), value.to_string().replace('\n', "\\n"));
        assert_eq!(before, None, "{} twice", key.to_string());
    }

    fn parse(text: &str) -> Self {
        let entries = text.lines().filter_map(|line| line.split_once(" = "));
        Self(entries.map(|(key, value)| (key.to_owned(), value.to_owned())).collect())
    }

    /// Numbers and texts of a JSON value, three elements of long arrays, neither times nor the machine.
    fn put_json(&mut self, key: &str, value: &Value) {
        match value {
            Value::Object(fields) => {
                for (name, value) in fields {
                    if !name.ends_with("_ms") && name != "seconds" && name != "machine" {
                        self.put_json(&format!("{key}.{name}"), value);
                    }
                }
            }
            Value::Array(items) => {
                self.put(format!("{key}.len"), items.len());
                let few = items.len() <= 4;
                for (at, item) in items.iter().enumerate() {
                    if few || [0, items.len() / 2, items.len() - 1].contains(&at) {
                        self.put_json(&format!("{key}.{at}"), item);
                    }
                }
            }
            Value::Number(number) => self.put(key, format!("{:.4e}", number.as_f64().expect("a number"))),
            other => self.put(key, other),
        }
    }

    fn put_frame(&mut self, key: &str, frame: &Frame) {
        let (width, height) = (frame.width, frame.height);
        let mut blocks = [[0u64; 2]; 16];
        for (at, &pixel) in frame.pixels.iter().enumerate() {
            let (x, y) = (at % width, at / width);
            let block = &mut blocks[4 * x / width + 4 * (4 * y / height)];
            *block = [block[0] + u64::from(pixel), block[1] + 1];
        }
        for (at, [sum, count]) in blocks.iter().enumerate() {
            self.put(
                format!("{key}.block_{at:02}"),
                format!("{:.4e}", *sum as f64 / *count as f64),
            );
        }
        self.put(format!("{key}.hash"), blake3::hash(&frame.pixels).to_hex());
    }

    /// Compares with the record, writes it, or both, by `INSONIFY_GOLDEN`.
    fn check(&self, group: &str) {
        let mode = std::env::var("INSONIFY_GOLDEN").unwrap_or_default();
        let group = format!("{group} ");
        if mode == "write" {
            let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/cli/golden/record.txt");
            let old = Record::parse(&std::fs::read_to_string(path).expect("the record"));
            let kept = old.0.iter().filter(|(key, _)| !key.starts_with(&group));
            let all: BTreeMap<_, _> = kept.chain(&self.0).collect();
            let text = all.iter().fold(String::new(), |mut text, (key, value)| {
                writeln!(text, "{key} = {value}").expect("text");
                text
            });
            std::fs::write(path, text).expect("the record is written");
            return;
        }
        let expected = Record::parse(RECORD).0;
        let mut wrong = Vec::new();
        for (key, value) in expected.iter().filter(|(key, _)| key.starts_with(&group)) {
            match self.0.get(key) {
                Some(current) if current == value => {}
                Some(_) if key.ends_with(".hash") && key.starts_with("frame") && mode != "exact" => {}
                Some(current) if near(current, value) => {}
                current => wrong.push(format!("{key}: {current:?}, was {value:?}")),
            }
        }
        let new = self.0.keys().filter(|key| !expected.contains_key(*key));
        wrong.extend(new.map(|key| format!("{key} is new")));
        assert!(wrong.is_empty(), "{} differ:\n{}", wrong.len(), wrong.join("\n"));
    }
}

fn near(value: &str, expected: &str) -> bool {
    let [Ok(value), Ok(expected)] = [value, expected].map(str::parse::<f64>) else {
        return false;
    };
    (value - expected).abs() <= 1e-3 * expected.abs() + 1e-9
}

const SCENES: [&str; 5] = ["default", "liver-needle", "prostate-trus", "spine-linear", "sweep"];
const PHANTOMS: [&str; 5] = ["abdomen", "prostate", "spine", "two-layer", "liver-vein"];
const SCENARIOS: [&str; 7] = [
    "liver-biopsy",
    "liver-puncture",
    "prostate-brachytherapy",
    "spine-injection",
    "segmentation-biopsy",
    "liver-training",
    "two-layer-insertion",
];

#[test]
fn frames_and_plans_of_scenes_and_phantoms_are_as_they_were() {
    let (bench, mut record) = (Bench::new(), Record::default());
    let of_scene = |name: &str| {
        (
            name.to_owned(),
            bench.run(&format!("scene {name}")).text().to_owned(),
            true,
        )
    };
    let of_phantom = |name: &str| {
        let text = format!("version = 1\nseed = 5\n[volume]\nphantom = \"{name}\"\nresolution_mm = 4\n");
        (name.to_owned(), text, false)
    };
    for (name, text, planned) in SCENES.map(of_scene).into_iter().chain(PHANTOMS.map(of_phantom)) {
        let scene = SceneFile::parse(&text, &name).expect("a scene").resolve(".".as_ref());
        let scene = scene.expect("a scene");
        let state = scene.states(1).next().expect("a first frame").expect("a state");
        if planned {
            let tables = Tables::new(scene.anatomy.clone(), scene.settings.clone()).expect("tables");
            let mut plan = Plan::new(&tables).report(&scene.origins);
            plan.warnings.splice(0..0, scene.warnings.clone());
            let plan = serde_json::to_value(&plan).expect("a plan");
            record.put_json(&format!("plan {name}"), &plan);
        }
        for (word, backend) in [("cpu", Backend::Cpu), ("cpu-f64", Backend::CpuF64)] {
            let mut synthesizer = scene.synthesizer(backend).expect("a synthesizer");
            record.put_frame(
                &format!("frame {name} {word}"),
                synthesizer.render(&state).expect("a frame"),
            );
        }
    }
    record.check("frame");
    record.check("plan");
}

#[test]
fn insertions_are_as_they_were() {
    let (bench, mut record) = (Bench::new(), Record::default());
    bench.run("phantom -q abdomen -o ct.nrrd --resolution-mm 2.5").text();
    for scenario in SCENARIOS {
        let text = bench.run(&format!("insert --example {scenario}")).text().to_owned();
        let mut table: toml::Table = toml::from_str(&text).expect("an example");
        if let Some(nodes) = table["tissue"].get_mut("nodes") {
            *nodes = 250.into();
        }
        if scenario == "segmentation-biopsy" {
            table["scene"]["volume"]["file"] = "ct.nrrd".into();
        }
        bench.write("scenario.toml", &toml::to_string(&table).expect("a scenario"));
        let run = bench.run(&format!("insert -q scenario.toml -o {scenario} --json"));
        record.put_json(&format!("insert {scenario}"), &run.json());
    }
    record.check("insert");
}

#[test]
fn solved_cases_are_as_they_were() {
    let (bench, mut record) = (Bench::new(), Record::default());
    for (name, nodes, example) in [("solve", 3000, "--example"), ("creep", 1000, "--example=viscoelastic")] {
        let make = format!("mesh make -q --phantom two-layer --nodes {nodes} -o block.vtu --force");
        bench.run(&make).text();
        record.put_json(
            &format!("case {name} mesh"),
            &bench.run("mesh info -q block.vtu --json").json(),
        );
        bench.write("case.toml", bench.run(&format!("solve {example}")).text());
        record.put_json(&format!("case {name}"), &bench.run("solve -q case.toml --json").json());
    }
    for (name, example, run) in [
        ("beam", "beam --example", "beam -q case.toml --json"),
        (
            "beam inverse",
            "beam --example",
            "beam inverse -q case.toml --com-mm 40 --json",
        ),
        ("material", "material --example", "material -q case.toml --json"),
    ] {
        bench.write("case.toml", bench.run(example).text());
        record.put_json(&format!("case {name}"), &bench.run(run).json());
    }
    record.put_json("case beam table", &bench.run("beam table -q --json").json());
    record.put_json("case puncture", &bench.run("puncture -q --json").json());
    record.check("case");
}

/// Commands that are refused, with what they read.
const REFUSED: &[(&str, &str)] = &[
    ("", "render none.toml"),
    ("version = 3", "render a.toml"),
    ("version = 1\n[volume]\nphantom = \"spleen\"", "render a.toml"),
    ("version = 1\n[volume\nphantom = 1", "render a.toml"),
    ("version = 1\nsead = 3", "render a.toml"),
    ("version = 1\n[effects.speckle]\naxial = 0.4", "render a.toml"),
    (
        "version = 1\nvolume.phantom = \"spine\"\n[effects.speckle]\naxial_mm = -1",
        "render a.toml",
    ),
    ("version = 1\n[effects.blur]\nwidth_mm = \"wide\"", "render a.toml"),
    (
        "version = 1\nvolume.phantom = \"spine\"\n[effects.shadow]\nreverberation = 1.5",
        "render a.toml",
    ),
    (
        "version = 1\nvolume.phantom = \"spine\"\n[effects.receiver]\nclutter_db = 21",
        "render a.toml",
    ),
    ("version = 1\n[volume]\nfile = \"none.nrrd\"", "render a.toml"),
    ("version = 1\n[volume]\nfile = \"a.toml\"", "render a.toml"),
    (
        "version = 1\nvolume.phantom = \"spine\"\n[probe]\nkind = \"linear\"\ndepth_mm = 60\nwidth_mm = -3",
        "render a.toml",
    ),
    ("version = 1\n[probe]\nkind = \"sideways\"", "render a.toml"),
    (
        "version = 1\nvolume.phantom = \"spine\"\n[image]\nwidth = 0",
        "render a.toml",
    ),
    (
        "version = 1\nvolume.phantom = \"spine\"\n[[tissue]]\nname = \"liver\"\nechogenicity_db = nan",
        "render a.toml",
    ),
    ("", "render --size 0x5"),
    ("", "render --layers colours"),
    ("", "render --backend tpu"),
    ("", "render --sise 4x4"),
    ("", "inspect --at 1"),
    ("version = 1\n[run]\ndt_ms = 0", "insert a.toml -o out"),
    ("version = 1\n[needle]\nmodel = \"rope\"", "insert a.toml -o out"),
    ("version = 1\n[needle]\n[tissue]\nnodes = 3", "insert a.toml -o out"),
    ("version = 1", "insert a.toml -o out"),
    ("version = 1\nmesh = \"none.msh\"", "solve a.toml"),
    ("version = 1\nmesh = \"none.msh\"\nmash = 1", "solve a.toml"),
    ("version = 1\nyoung = 2", "beam a.toml"),
    ("version = 1\nlaw = \"honey\"", "material a.toml"),
    ("", "puncture --order 3"),
    ("", "mesh info none.vtu"),
    ("", "mesh make --phantom abdomen --nodes 500 -o a.msh"),
    ("", "phantom abdomen -o a.nrrd --resolution-mm nan"),
    ("value,name\n", "info a.toml"),
];

#[test]
fn errors_are_as_they_were() {
    let mut record = Record::default();
    for (at, (text, arguments)) in REFUSED.iter().enumerate() {
        let bench = Bench::new();
        bench.write("a.toml", text);
        let run = bench.run(arguments);
        assert_eq!(run.status, Some(2), "{run:?}");
        record.put(format!("error {at:02} {arguments}"), run.stderr);
    }
    record.check("error");
}

/// Notes, warnings and refusals of the real files, so that no change adds to them unseen.
#[test]
fn notes_of_real_files_are_as_they_were() {
    let (bench, mut record) = (Bench::new(), Record::default());
    for (folder, command) in [
        ("volumes", "info"),
        ("formats", "info"),
        ("formats/pynrrd", "info"),
        ("tracked", "info"),
        ("textures", "info"),
        ("rf", "info"),
        ("config", "info"),
        ("meshes", "mesh info"),
    ] {
        let Some(path) = insonify_testing::shared(folder) else {
            return;
        };
        let entries = std::fs::read_dir(&path)
            .expect("a folder")
            .map(|entry| entry.expect("an entry").path());
        for file in entries.filter(|path| path.is_file()) {
            let run = bench.run(&format!("{command} {}", file.display()));
            let told = [run.stdout, run.stderr]
                .concat()
                .replace(&format!("{}/", path.display()), "");
            let kinds = ["note: ", "warning: ", "  × "];
            let lines = told
                .lines()
                .filter(|line| kinds.iter().any(|kind| line.starts_with(kind)));
            let name = file.file_name().expect("a name").to_string_lossy();
            record.put(format!("notes {folder}/{name}"), lines.collect::<Vec<_>>().join("\n"));
        }
    }
    record.check("notes");
}
