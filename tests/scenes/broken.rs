//! Scenes without end: an error, never a panic.

use std::path::Path;

use insonify::input::scene::SceneFile;

/// Parses and, if that succeeds, resolves; shows the error both ways.
fn refuse(text: &str) {
    let scene = SceneFile::parse(text, "broken.toml").and_then(|file| file.resolve(Path::new("/nowhere")));
    let error = scene.expect_err("a broken scene");
    assert!(!error.to_string().is_empty());
    let _ = format!("{:?}", miette::Report::new(error));
}

#[test]
fn long_strings_and_deep_nesting() {
    refuse(&format!("{} = 1", "a".repeat(100_000)));
    refuse(&format!("version = 1\n[volume]\nfile = \"{}\"", "a".repeat(100_000)));
    refuse(&format!("x = {}", "[".repeat(5000)));
    refuse(&format!(
        "version = 1\n[volume]\nphantom = \"spine\"\nresolution_mm = 5\n[pose]\ntarget = \"{}\"",
        "liver ".repeat(20_000)
    ));
}
