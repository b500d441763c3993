//! Files that users write, resolved into scenes, insertions, static problems and tests of materials.

#[cfg(feature = "cli")]
pub mod beam_case;
#[cfg(feature = "cli")]
pub mod identification;
#[cfg(feature = "cli")]
pub mod material_case;
pub mod scenario;
pub mod scene;
pub mod statics;

/// Name and text of the built-in file that a path names, unless there is such a file.
fn bundled(files: &[(&'static str, &'static str)], path: &std::path::Path) -> Option<(&'static str, &'static str)> {
    let named = |(name, _): &&(&str, &str)| path.as_os_str() == *name && !path.is_file();
    files.iter().find(named).copied()
}
