//! Scenes without end: an error, never a panic.

use std::path::Path;

use insonify_imaging::scene::SceneFile;

/// Parses and, if that succeeds, resolves; the error has a text, and a place within its lines.
fn refuse(text: &str) {
    let scene = SceneFile::parse(text, "broken.toml").and_then(|file| file.resolve(Path::new("/nowhere")));
    let error = scene.expect_err("a broken scene");
    assert!(!error.to_string().is_empty());
    if let Some(excerpt) = error.excerpt() {
        assert!(excerpt.text.get(excerpt.span.clone()).is_some(), "{excerpt:?}");
    }
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
