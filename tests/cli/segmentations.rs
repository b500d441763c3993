//! Segmentations as people have them: folders of masks, single masks, tables of names.

use insonify_anatomy::volume::{Label, LabelVolume, load, save};
use serde_json::json;

use crate::support::{Bench, grey};

/// Saves each label of a volume as a mask named after it in a folder.
fn split(volume: &LabelVolume, names: &[(i64, String)], bench: &Bench, folder: &str) {
    std::fs::create_dir(bench.path(folder)).unwrap();
    for (value, name) in names {
        let Some(index) = volume.labels().iter().position(|label| label.value == *value) else {
            continue;
        };
        let voxels = volume
            .voxels()
            .iter()
            .map(|voxel| u8::from(usize::from(*voxel) == index))
            .collect();
        let label = |value, voxels| Label {
            value,
            name: None,
            voxels,
        };
        let labels = vec![label(0, 0), label(1, volume.labels()[index].voxels)];
        let mask = LabelVolume::new(volume.size(), voxels, labels, *volume.index_to_world()).unwrap();
        save(&mask, &bench.path(&format!("{folder}/{name}.nii.gz"))).unwrap();
    }
}

#[test]
fn a_folder_of_masks_is_imaged_as_the_label_file_of_them_all() {
    let Some(path) = insonify_testing::shared("volumes/ts_example_seg_full.nii.gz") else {
        return;
    };
    let loaded = load(&path).expect("a volume");
    let named = |label: &Label| Some((label.value, label.name.clone()?));
    let names: Vec<_> = loaded.volume.labels().iter().skip(1).filter_map(named).collect();
    let bench = Bench::new();
    split(&loaded.volume, &names, &bench, "masks");
    let render = |labels: &str, out: &str| {
        let run = bench.run(&format!(
            "render --labels {labels} --target kidney --size 120x90 --backend cpu --save-labels {out}.nrrd -o {out}.png"
        ));
        run.text();
        assert!(run.stderr.contains("largest of kidney_"), "{run:?}");
        (
            grey(&bench.path(&format!("{out}.png"))),
            load(&bench.path(&format!("{out}.nrrd"))).unwrap().volume,
        )
    };
    let (one, one_labels) = render(&path.display().to_string(), "one");
    let (many, many_labels) = render("masks", "many");
    assert!(one == many, "frames differ");
    assert_eq!(
        (one_labels.voxels(), one_labels.labels()),
        (many_labels.voxels(), many_labels.labels())
    );
    assert!(
        one_labels
            .labels()
            .iter()
            .any(|label| label.name.as_deref() == Some("skin"))
    );

    let kidney = bench.run("info masks/kidney_right.nii.gz --json").json();
    let label = &kidney["labels"][1];
    assert_eq!(
        [&label["name"], &label["tissue"], &label["from"], &label["sure"]],
        [
            &json!("kidney_right"),
            &json!("kidney_cortex"),
            &json!("class name"),
            &json!(true)
        ]
    );
    bench
        .run("render masks --backend cpu")
        .fails(2, &["masks is a folder", "--labels masks"]);
    bench
        .run("render --labels masks --target kidni --backend cpu")
        .fails(2, &["did you mean \"kidney", "insonify info"]);
}

#[test]
fn names_come_from_a_table_and_are_shown() {
    let bench = Bench::new();
    bench.run("phantom two-layer -o named.nrrd --resolution-mm 4").text();
    let named = load(&bench.path("named.nrrd")).unwrap().volume;
    let nameless = named.labels().iter().map(|label| Label {
        name: None,
        ..label.clone()
    });
    let (size, voxels) = (named.size(), named.voxels().to_vec());
    let volume = LabelVolume::new(size, voxels, nameless.collect(), *named.index_to_world()).unwrap();
    save(&volume, &bench.path("a.nrrd")).unwrap();
    bench.write("names.csv", "value,name\n1,thing\n2,a cyst\n");
    let info = bench.run("info a.nrrd --names names.csv").text().to_owned();
    for line in [
        "thing ",
        "cyst ?",
        "soft_tissue ?",
        "fallback",
        "warning: no tissue known for label 1 (\"thing\"); taken as soft_tissue",
        "note: labels are named by names.csv",
    ] {
        assert!(info.contains(line), "no {line:?} in {info}");
    }
    let scene = "version = 1\n[volume]\nfile = \"a.nrrd\"\nnames = \"names.csv\"\n";
    bench.write("named.toml", scene);
    let note = bench.run("plan named.toml --json");
    assert!(!note.stderr.contains("read by the numbers"), "{note:?}");
    let over = |target: &str| {
        bench.run(&format!(
            "render --labels a.nrrd --target {target} --size 32x32 --backend cpu"
        ))
    };
    bench.write("a.csv", "value,name\n9,none\n");
    let words = ["such as 1, 2", "or its value", "no tissue known for labels 1, 2"];
    over("kidney").fails(2, &words);
    let run = over("2");
    assert!(run.stderr.contains("label 2 (soft_tissue)"), "{run:?}");
    std::fs::remove_file(bench.path("a.csv")).unwrap();
    bench.write("names.csv", "value,name\none,liver\n");
    let words = ["names.csv, line 2", "\"one\""];
    bench.run("info a.nrrd --names names.csv").fails(2, &words);
    bench
        .run("plan named.toml")
        .fails(2, &["volume.names", "line 4", words[0], words[1]]);
    bench
        .run("plan scene.toml --names names.csv")
        .fails(2, &["`names` with a phantom"]);
    bench
        .run("mesh make a.nrrd --nodes 100 --names names.csv -o a.vtu")
        .fails(2, &words);
}

/// A segmentation of 3D Slicer in two layers of 8 x 8 x 8 voxels of 10 mm: a liver in the first, and a segment of this
/// name and extent along the first axis over it.
fn overlapping(name: &str, over: std::ops::Range<usize>) -> String {
    let segment = |number: usize, name: &str| {
        format!("Segment{number}_Name:={name}\nSegment{number}_LabelValue:=1\nSegment{number}_Layer:={number}\n")
    };
    let mut text = format!(
        "NRRD0004\ntype: unsigned char\ndimension: 4\nspace: left-posterior-superior\nsizes: 2 8 8 8\n\
         space directions: none (10,0,0) (0,10,0) (0,0,10)\nkinds: list domain domain domain\nencoding: ascii\n{}{}\n",
        segment(0, "liver"),
        segment(1, name)
    );
    for voxel in 0..512 {
        let index = [voxel % 8, voxel / 8 % 8, voxel / 64];
        let inner = index[1..].iter().all(|n| (2..6).contains(n));
        let [liver, other] = [2..6, over.clone()].map(|range| u8::from(inner && range.contains(&index[0])));
        text.push_str(&format!("{liver} {other} "));
    }
    text
}

#[test]
fn overlapping_segments_are_told_and_a_covered_target_is_not_proposed() {
    let bench = Bench::new();
    bench.write("body.seg.nrrd", &overlapping("Body", 1..7));
    bench.write("lesion.seg.nrrd", &overlapping("lesion", 2..6));
    bench.write("halves.seg.nrrd", &overlapping("left lobe", 4..6));
    let render = |file: &str| {
        bench.run(&format!(
            "render --labels {file}.seg.nrrd --target liver --size 32x32 --backend cpu -o a.png"
        ))
    };
    let body = render("body");
    body.text();
    assert!(
        body.stderr.contains("Body: 67 % covered by liver") && body.stderr.contains("placed over liver"),
        "{body:?}"
    );
    render("halves").text();
    // Of two segments of the same size the higher layer is on top, and nothing of the liver is left.
    let run = render("lesion");
    run.fails(
        2,
        &[
            "liver: 100 % covered by lesion",
            "the label \"liver\" has no voxels; expected a label such as lesion",
        ],
    );
    assert!(!run.stderr.contains("did you mean"), "{run:?}");
}
