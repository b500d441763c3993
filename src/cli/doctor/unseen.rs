//! Reasons why a graphics card of a Linux machine is not among the Vulkan adapters.

use std::fs;
use std::path::Path;

/// Folders of libraries in which the Vulkan loader and drivers are installed.
const LIBRARIES: [&str; 8] = [
    "usr/lib",
    "usr/lib64",
    "usr/local/lib",
    "usr/lib/x86_64-linux-gnu",
    "usr/lib/aarch64-linux-gnu",
    "lib/x86_64-linux-gnu",
    "lib/aarch64-linux-gnu",
    "run/opengl-driver/lib",
];

/// Folders of the files by which the loader finds drivers.
const DRIVERS: [&str; 4] = [
    "usr/share/vulkan/icd.d",
    "usr/local/share/vulkan/icd.d",
    "etc/vulkan/icd.d",
    "run/opengl-driver/share/vulkan/icd.d",
];

/// Reasons found in the files under `root` and in environment variables; none where no card is plugged in or passed
/// through.
pub(super) fn reasons(root: &Path, variable: impl Fn(&str) -> Option<String>) -> Vec<String> {
    let has = |folder: &str, is: &dyn Fn(&str) -> bool| {
        let entries = fs::read_dir(root.join(folder)).into_iter().flatten().flatten();
        entries
            .map(|entry| entry.file_name())
            .any(|name| is(&name.to_string_lossy()))
    };
    let numbered = |name: &str, start: &str| {
        name.strip_prefix(start)
            .is_some_and(|digits| digits.parse::<u32>().is_ok())
    };
    let nvidia = has("dev", &|name| numbered(name, "nvidia"));
    if !nvidia && !has("dev/dri", &|name| name.starts_with("renderD")) {
        return Vec::new();
    }
    let mut reasons = Vec::new();
    let library = |start: &str| {
        LIBRARIES
            .iter()
            .any(|folder| has(folder, &|name| name.starts_with(start)))
    };
    // With LD_LIBRARY_PATH the loader may lie in any folder: its absence from the usual ones means little.
    if !library("libvulkan.so.1") && variable("LD_LIBRARY_PATH").is_none() {
        reasons.push(
            "there is a graphics device, but no Vulkan loader (libvulkan.so.1): install libvulkan1 or vulkan-loader"
                .to_owned(),
        );
    }
    let named = ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"]
        .iter()
        .find(|name| variable(name).is_some());
    if let Some(name) = named {
        reasons.push(format!("{name} is set: the loader sees only the drivers that it names"));
    }
    let driver = |is: &dyn Fn(&str) -> bool| DRIVERS.iter().any(|folder| has(folder, is));
    if nvidia {
        let capabilities = variable("NVIDIA_DRIVER_CAPABILITIES");
        let graphics = |names: &String| names.split(',').any(|name| matches!(name.trim(), "graphics" | "all"));
        if let Some(names) = capabilities.filter(|names| !graphics(names)) {
            reasons.push(format!(
                "this container has the driver capabilities \"{names}\": Vulkan needs `graphics` \
                 (NVIDIA_DRIVER_CAPABILITIES=graphics,compute,utility)"
            ));
        } else if named.is_none() && !driver(&|name| name.contains("nvidia")) {
            reasons.push(
                "there is an NVIDIA card, but no driver file nvidia_icd.json: install the driver with its Vulkan part"
                    .to_owned(),
            );
        } else if !library("libGLX_nvidia.so.0") && !library("libEGL_nvidia.so.0") {
            reasons.push(
                "there is an NVIDIA card, but neither libGLX_nvidia.so.0 nor libEGL_nvidia.so.0, which hold \
                its Vulkan driver"
                    .to_owned(),
            );
        }
        let gpus = fs::read_dir(root.join("proc/driver/nvidia/capabilities"))
            .into_iter()
            .flatten()
            .flatten();
        if gpus.into_iter().any(|gpu| has_instance(&gpu.path().join("mig"))) {
            reasons.push("an NVIDIA card is partitioned (MIG): Vulkan does not run on its instances".to_owned());
        }
    } else if named.is_none() && !driver(&|name| name.ends_with(".json")) {
        reasons.push(
            "there is a graphics device, but no Vulkan driver file (icd.d/*.json): install \
            mesa-vulkan-drivers or the maker's driver"
                .to_owned(),
        );
    }
    reasons
}

/// Whether a folder lists GPU instances (`gi0`, `gi1` ...).
fn has_instance(folder: &Path) -> bool {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries
        .into_iter()
        .any(|entry| entry.file_name().to_string_lossy().starts_with("gi"))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reasons on a machine with these files and variables.
    fn on(files: &[&str], variables: &[(&str, &str)]) -> Vec<String> {
        let root = tempfile::tempdir().expect("a folder");
        for file in files {
            let path = root.path().join(file);
            fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
            fs::write(path, "").expect("a file");
        }
        let variable = |name: &str| {
            variables
                .iter()
                .find(|(known, _)| *known == name)
                .map(|(_, value)| (*value).to_owned())
        };
        reasons(root.path(), variable)
    }

    #[test]
    fn each_missing_part_is_named() {
        const LOADER: &str = "usr/lib/x86_64-linux-gnu/libvulkan.so.1";
        const LIBRARY: &str = "usr/lib/x86_64-linux-gnu/libGLX_nvidia.so.0";
        const DRIVER: &str = "etc/vulkan/icd.d/nvidia_icd.json";
        let assert_one = |reasons: Vec<String>, part: &str| {
            assert!(reasons.len() == 1 && reasons[0].contains(part), "{part}: {reasons:?}")
        };
        assert!(on(&["dev/null", "dev/nvidiactl"], &[]).is_empty(), "no card");
        assert!(
            on(&["dev/nvidia0", LOADER, DRIVER, LIBRARY], &[]).is_empty(),
            "nothing is missing"
        );
        assert_one(on(&["dev/nvidia0", DRIVER, LIBRARY], &[]), "libvulkan.so.1");
        assert_one(on(&["dev/nvidia0", LOADER, LIBRARY], &[]), "nvidia_icd.json");
        assert_one(on(&["dev/nvidia0", LOADER, DRIVER], &[]), "libGLX_nvidia");
        let compute = [("NVIDIA_DRIVER_CAPABILITIES", "compute,utility")];
        assert_one(on(&["dev/nvidia0", LOADER], &compute), "graphics");
        let all_capabilities = [("NVIDIA_DRIVER_CAPABILITIES", "all")];
        assert!(on(&["dev/nvidia0", LOADER, DRIVER, LIBRARY], &all_capabilities).is_empty());
        let part = "proc/driver/nvidia/capabilities/gpu0/mig/gi1/access";
        assert_one(on(&["dev/nvidia0", LOADER, DRIVER, LIBRARY, part], &[]), "MIG");
        assert_one(on(&["dev/dri/renderD128", LOADER], &[]), "mesa-vulkan-drivers");
        assert_one(
            on(
                &["dev/dri/renderD128", LOADER, "usr/share/vulkan/icd.d/radeon.json"],
                &[("VK_DRIVER_FILES", "/none")],
            ),
            "VK_DRIVER_FILES",
        );
    }
}
