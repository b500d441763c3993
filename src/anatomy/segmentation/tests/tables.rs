//! Tables of label names.

use super::*;

#[test]
fn tables_beside_a_file_or_given_name_its_labels() {
    let folder = Folder::new();
    let file = folder.row("scan.nrrd", [40, 41, 0, 42], 1.0);
    folder.write("scan.csv", "label,name,voxels\n40,liver,3\n41,\"left kidney\",1\n");
    let beside = opened(&file);
    assert_eq!(names(&beside), [(40, "liver"), (41, "left kidney"), (42, "-")]);
    assert!(beside.notes[0].contains("scan.csv"), "{:?}", beside.notes);
    assert!(
        beside.warnings[0].contains("names no label 42"),
        "{:?}",
        beside.warnings
    );

    let other = folder.write("other.ctbl", "# colours\n0 Background 0 0 0 0\n40 spleen 1 2 3 255\n");
    let naming = |path: &Path| Naming {
        names: Some(Names::read(path).unwrap()),
        ..Naming::default()
    };
    assert_eq!(names(&open(&file, &naming(&other)).unwrap())[0], (40, "spleen"));
    let snap = folder.write("snap.txt", "# ITK-SNAP\n  40  255 0 0  1 1 1  \"right lung\"\n");
    assert_eq!(names(&open(&file, &naming(&snap)).unwrap())[0], (40, "right lung"));
    let slicer = folder.write("slicer.csv", "LabelValue;Name;Color_R\n41;aorta;9\n");
    assert_eq!(names(&open(&file, &naming(&slicer)).unwrap())[1], (41, "aorta"));
    for text in [
        "# mine\n40,liver\n 42 , right kidney\n",
        "40;liver;1\n42;right kidney;2\n",
    ] {
        let headless = open(&file, &naming(&folder.write("headless.csv", text))).unwrap();
        assert_eq!(
            names(&headless),
            [(40, "liver"), (41, "-"), (42, "right kidney")],
            "{text}"
        );
    }

    // Colour tables whose names have blanks and numbers.
    for text in [
        "40 Right Kidney 255 0 0 255\n41 Rib 5 1 2 3 255\n42 Aorta 0 0 0 0\n",
        "40\tRight Kidney\t255 0 0\n41 Rib 5 1 2 3\n42 Aorta 0.5 0 0\n",
        "40 Right Kidney\n41 Rib 5\n42 Aorta\n",
    ] {
        let colours = open(&file, &naming(&folder.write("colours.ctbl", text))).unwrap();
        assert_eq!(
            names(&colours),
            [(40, "Right Kidney"), (41, "Rib 5"), (42, "Aorta")],
            "{text}"
        );
    }

    folder.write("scan.csv", "time,force\n1,2\n");
    let unused = opened(&file);
    assert!(unused.notes[0].contains("not used as label names") && unused.notes[0].contains("time, force"));
}

#[test]
fn data_sets_of_nnunet_name_labels() {
    let folder = Folder::new();
    fs::create_dir(folder.path("labelsTr")).unwrap();
    fs::create_dir(folder.path("other")).unwrap();
    let file = folder.row("labelsTr/case.nii.gz", [1, 2, 0, 3], 1.0);
    let of = |text: &str| {
        let names = Names::read(&folder.write("dataset.json", text));
        [1, 2, 3].map(|value| names.as_ref().unwrap().of(value).unwrap_or("-").to_owned())
    };
    let by_name =
        r#"{"labels": {"background": 0, "liver": 1, "left kidney": 2, "spleen": 3}, "file_ending": ".nii.gz"}"#;
    assert_eq!(of(by_name), ["liver", "left kidney", "spleen"]);
    let by_value = r#"{"labels": {"0": "background", "1": "liver", "2": "left kidney"}}"#;
    assert_eq!(of(by_value), ["liver", "left kidney", "-"]);
    let bare = r#"{"1": "liver", "3": "spleen"}"#;
    assert_eq!(of(bare), ["liver", "-", "spleen"]);
    assert_eq!(of(r#"{"liver": 1, "spleen": 2}"#), ["liver", "spleen", "-"]);
    let regions = r#"{"labels": {"background": 0, "core": [2, 3], "enhancing": 3, "whole": [1, 2, 3]}}"#;
    assert_eq!(of(regions), ["whole", "core", "enhancing"]);

    of(by_name);
    let found = opened(&file);
    assert_eq!(names(&found), [(1, "liver"), (2, "left kidney"), (3, "spleen")]);
    assert!(
        found.notes[0].contains("named by") && found.notes[0].contains("dataset.json"),
        "{:?}",
        found.notes
    );
    // Near misses: another folder, and a data set of other values.
    let apart = opened(&folder.row("other/case.nii.gz", [1, 2, 0, 3], 1.0));
    assert!(
        !apart.notes.iter().any(|note| note.contains("dataset.json")),
        "{:?}",
        apart.notes
    );
    of(r#"{"labels": {"liver": 7}}"#);
    assert!(!opened(&file).notes.iter().any(|note| note.contains("dataset.json")));

    for (text, words) in [
        (
            "{\"labels\": {\n \"liver\": 1,\n \"spleen\": 1}}",
            ["line 3", "\"spleen\""],
        ),
        ("{\"labels\": {\n \"liver\": 1.5}}", ["line 2", "\"liver\": 1.5"]),
        ("{\"labels\": {\n \"liver\": 1", ["line 2", "EOF"]),
        ("{\"names\": {}}", ["line 1", "no table `labels`"]),
        ("[1, 2]", ["line 1", "dataset.json"]),
    ] {
        let message = Names::read(&folder.write("wrong.json", text)).unwrap_err().to_string();
        assert!(
            message.contains("wrong.json") && words.iter().all(|word| message.contains(word)),
            "{text:?}: {message}"
        );
    }
}

#[test]
fn tables_that_are_wrong_are_refused_with_their_line() {
    let folder = Folder::new();
    for (text, words) in [
        ("label,name\n1,liver\nx,spleen\n", ["line 3", "\"x\""]),
        ("label,name\n1,liver\n1,spleen\n", ["line 3", "\"spleen\""]),
        ("label,name\n1,\n", ["line 2", "no name"]),
        ("label,name\n1\n", ["line 2", "CSV"]),
        ("label\n1\n", ["line 1", "columns"]),
        ("", ["line 1", "columns"]),
        ("1 liver\n2.5 spleen\n", ["line 2", "2.5"]),
        ("1\n", ["line 1", "no name"]),
        ("1,liver\n2,\n", ["line 2", "no name"]),
        ("1,liver\nvalue,name\n", ["line 2", "\"value\""]),
    ] {
        let message = Names::read(&folder.write("names.csv", text)).unwrap_err().to_string();
        assert!(
            message.contains("names.csv") && words.iter().all(|word| message.contains(word)),
            "{text:?}: {message}"
        );
    }
}
