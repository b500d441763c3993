//! Commit of the sources: from `INSONIFY_COMMIT` or, for release builds, from the repository around them if there is
//! one.

use std::path::{Path, PathBuf};
use std::{env, fs};

fn main() {
    println!("cargo::rerun-if-env-changed=INSONIFY_COMMIT");
    // A debug build would have to be linked again after every commit.
    let is_release = env::var("PROFILE").is_ok_and(|profile| profile == "release");
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let stated = env::var("INSONIFY_COMMIT").ok();
    let commit = stated.or_else(|| is_release.then(|| of_repository(&root)).flatten());
    if let Some(commit) = commit {
        println!("cargo::rustc-env=INSONIFY_COMMIT={commit}");
    }
}

/// Commit that is checked out in a repository.
fn of_repository(root: &Path) -> Option<String> {
    let git = root.join(".git");
    // A work tree of a repository elsewhere has a file that names its folder.
    let git = match fs::read_to_string(&git) {
        Ok(link) => root.join(link.strip_prefix("gitdir:")?.trim()),
        Err(_) => git,
    };
    let read = |path: PathBuf| {
        let text = fs::read_to_string(&path).ok()?;
        println!("cargo::rerun-if-changed={}", path.display());
        Some(text)
    };
    let head = read(git.join("HEAD"))?;
    let Some(name) = head.trim().strip_prefix("ref: ") else {
        return Some(head.trim().to_owned());
    };
    let common = fs::read_to_string(git.join("commondir")).ok();
    let common = common.map_or(git.clone(), |common| git.join(common.trim()));
    let loose = read(common.join(name)).map(|commit| commit.trim().to_owned());
    loose.or_else(|| {
        let packed = read(common.join("packed-refs"))?;
        let line = packed.lines().find(|line| line.ends_with(&format!(" {name}")))?;
        line.split(' ').next().map(str::to_owned)
    })
}
