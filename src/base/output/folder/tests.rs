use super::*;
use crate::blame::Blame;

/// Simulates a command that writes these files with `mark` as contents.
fn run(target: &Path, mark: &str, files: &[&str], force: bool) -> Result<(), OutputError> {
    let folder = Folder::open(target, "render", &["frame_", "plots/a.svg"], &[], force)?;
    for name in files {
        let path = folder.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, mark).unwrap();
    }
    folder.install()
}

fn there(target: &Path) -> Vec<String> {
    let files = files_in(target).unwrap().into_iter();
    files.filter(|name| name != MANIFEST).collect()
}

#[test]
fn a_run_replaces_the_run_before_and_nothing_else() {
    let root = tempfile::tempdir().unwrap();
    let target = root.path().join("out");
    run(
        &target,
        "1",
        &["frame_0000.png", "frame_0001.png", "plots/a.svg"],
        false,
    )
    .unwrap();
    fs::create_dir_all(target.join("plots/thesis")).unwrap();
    for mine in ["plots/thesis/fig1.svg", "notes.txt", "plots/b.svg"] {
        fs::write(target.join(mine), "mine").unwrap();
    }
    run(&target, "2", &["frame_0000.png"], false).unwrap();
    let expected = ["frame_0000.png", "notes.txt", "plots/b.svg", "plots/thesis/fig1.svg"];
    assert_eq!(there(&target), expected);
    assert_eq!(fs::read(target.join("frame_0000.png")).unwrap(), b"2");

    fs::write(target.join("frame_0009.png"), "mine").unwrap();
    let refused = run(&target, "3", &["frame_0000.png"], false).unwrap_err();
    assert!(
        matches!(&refused, OutputError::Taken { path } if path.ends_with("frame_0009.png")) && !refused.is_machine(),
        "{refused}"
    );
    run(&target, "3", &["frame_0009.png"], true).unwrap();
    assert_eq!(fs::read(target.join("frame_0009.png")).unwrap(), b"3");
    assert!(!target.join("frame_0000.png").exists());
}

#[test]
fn folders_that_a_run_leaves_empty_go() {
    let root = tempfile::tempdir().unwrap();
    let target = root.path().join("out");
    run(&target, "1", &["plots/deep/x", "a"], false).unwrap();
    run(&target, "2", &["a"], false).unwrap();
    assert!(!target.join("plots").exists());
    let dropped = Folder::open(&root.path().join("none"), "render", &[], &[], false).unwrap();
    fs::write(dropped.path().join("a"), "x").unwrap();
    drop(dropped);
    assert!(
        !root.path().join("none").exists(),
        "a folder that was made for nothing goes"
    );
}

#[test]
fn a_run_that_cannot_be_installed_is_kept() {
    let root = tempfile::tempdir().unwrap();
    let folder = Folder::open(root.path(), "render", &[], &[], false).unwrap();
    for name in ["a", "b"] {
        fs::write(folder.path().join(name), "done").unwrap();
    }
    // Created by someone else during the run.
    fs::write(root.path().join("b"), "mine").unwrap();
    let error = folder.install().unwrap_err();
    let OutputError::Kept { path, moved: 0, .. } = &error else {
        panic!("{error}")
    };
    assert!(
        error.is_machine() && error.to_string().contains(path.to_str().unwrap()),
        "{error}"
    );
    assert_eq!(there(path), ["a", "b"]);
    assert_eq!(fs::read(root.path().join("b")).unwrap(), b"mine");
}

#[test]
fn lists_that_are_not_ours_and_names_that_lead_out_are_not_followed() {
    let root = tempfile::tempdir().unwrap();
    let target = root.path().join("out");
    fs::create_dir(&target).unwrap();
    fs::write(root.path().join("precious"), "mine").unwrap();
    for text in ["my own", "{\"files\": []}", "\u{0}"] {
        fs::write(target.join(MANIFEST), text).unwrap();
        let refused = run(&target, "1", &["a"], false);
        assert!(matches!(refused, Err(OutputError::Taken { .. })), "{refused:?}");
    }
    let absolute = root.path().join("precious");
    #[cfg(unix)]
    std::os::unix::fs::symlink(root.path(), target.join("link")).unwrap();
    let manifest = Manifest {
        program: "insonify".into(),
        version: String::new(),
        command: String::new(),
        run: None,
        files: ["../precious", absolute.to_str().unwrap(), "link/precious"]
            .map(str::to_owned)
            .into(),
    };
    fs::write(target.join(MANIFEST), serde_json::to_string(&manifest).unwrap()).unwrap();
    run(&target, "1", &["a"], false).unwrap();
    assert_eq!(fs::read(&absolute).unwrap(), b"mine");
}

#[test]
fn inputs_of_a_run_are_not_replaced() {
    let root = tempfile::tempdir().unwrap();
    run(root.path(), "1", &["mesh_0.vtu", "other.vtu"], false).unwrap();
    let open = |names: &[&str], input: &str, force| {
        Folder::open(root.path(), "render", names, &[root.path().join(input)], force).map(drop)
    };
    assert!(matches!(open(&[], "mesh_0.vtu", false), Err(OutputError::Input { .. })));
    open(&[], "mesh_0.vtu", true).unwrap();
    fs::write(root.path().join("mine.vtu"), "mine").unwrap();
    open(&["other.vtu"], "mine.vtu", false).unwrap();
}
