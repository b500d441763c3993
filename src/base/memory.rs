//! Available memory, and requests refused before any of it is allocated.

use std::fs;
use std::io;
use std::path::Path;

/// A request for more memory than is available.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{what} needs {} of memory, and {} are available", size(*needed), size(*available))]
pub struct TooLarge {
    /// What the memory is for.
    pub what: String,
    /// Bytes requested.
    pub needed: u64,
    /// Bytes available.
    pub available: u64,
}

impl From<TooLarge> for io::Error {
    fn from(error: TooLarge) -> Self {
        io::Error::new(io::ErrorKind::OutOfMemory, error)
    }
}

/// Upper bound of the reserve for other allocations, bytes: the allocator's arenas take 64 MiB of address space each.
const MAX_RESERVE: u64 = 128 << 20;

/// Returns an error if fewer than `needed` bytes are available for `what`. Where the system does not report
/// available memory, nothing is refused.
///
/// # Errors
/// [`TooLarge`], a failure of the machine (exit status 1).
pub fn check(needed: u64, what: &str) -> Result<(), TooLarge> {
    let available = available().map(|bytes| bytes as u64 - (bytes as u64 / 8).min(MAX_RESERVE));
    match available {
        Some(available) if needed > available => Err(TooLarge {
            what: what.to_owned(),
            needed,
            available,
        }),
        _ => Ok(()),
    }
}

/// Bytes available without swapping: the minimum of what the system, the control groups of this process (versions 1
/// and 2) and its limits of address space and data leave. `None` where none of them reports a value; Linux does.
pub fn available() -> Option<usize> {
    let read = |path| fs::read_to_string(path).unwrap_or_default();
    let process = read("/proc/self/status");
    let limits = read("/proc/self/limits");
    let left = [
        kib(&read("/proc/meminfo"), "MemAvailable:"),
        limit_left(&limits, "Max address space", &process, "VmSize:"),
        limit_left(&limits, "Max data size", &process, "VmData:"),
        groups_left(Path::new("/sys/fs/cgroup"), &read("/proc/self/cgroup")),
    ];
    left.into_iter().flatten().min().map(|bytes| bytes as usize)
}

/// Formats a number of bytes with a suitable unit.
fn size(bytes: u64) -> String {
    let units = [(1 << 30, "GiB"), (1 << 20, "MiB"), (1 << 10, "KiB")];
    match units.into_iter().find(|(unit, _)| bytes >= *unit) {
        Some((unit, name)) => format!("{:.1} {name} ({bytes} bytes)", bytes as f64 / unit as f64),
        None => format!("{bytes} bytes"),
    }
}

/// Parses an entry in kB into bytes.
fn kib(text: &str, key: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix(key))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    kib.checked_mul(1024)
}

/// Bytes left under a limit of the process after what counts towards it.
fn limit_left(limits: &str, limit: &str, process: &str, used: &str) -> Option<u64> {
    let line = limits.lines().find_map(|line| line.strip_prefix(limit))?;
    let limit_bytes: u64 = line.split_whitespace().next()?.parse().ok()?;
    Some(limit_bytes.saturating_sub(kib(process, used)?))
}

/// File names of a control group's limit, its usage, and the page cache within that usage, which is reclaimed under
/// memory pressure.
type GroupFiles = [&'static str; 4];
const VERSION_1: GroupFiles = [
    "memory.limit_in_bytes",
    "memory.usage_in_bytes",
    "total_inactive_file ",
    "total_active_file ",
];
const VERSION_2: GroupFiles = ["memory.max", "memory.current", "inactive_file ", "active_file "];

/// Bytes left under the tightest control group among those of the process and their ancestors, in the hierarchy of each
/// version.
fn groups_left(root: &Path, memberships: &str) -> Option<u64> {
    let hierarchies = memberships.lines().filter_map(|line| {
        let (controllers, path) = line.split_once(':')?.1.split_once(':')?;
        let (top, files) = match controllers {
            "" => (root.to_owned(), VERSION_2),
            _ if controllers.split(',').any(|name| name == "memory") => (root.join("memory"), VERSION_1),
            _ => return None,
        };
        let groups = Path::new(path.trim_start_matches('/')).ancestors();
        groups.filter_map(|group| group_left(&top.join(group), files)).min()
    });
    hierarchies.min()
}

fn group_left(group: &Path, [limit, used, inactive, active]: GroupFiles) -> Option<u64> {
    let read = |name: &str| fs::read_to_string(group.join(name)).ok();
    let number = |text: &str| text.trim().parse::<u64>().ok();
    let (limit, used) = (number(&read(limit)?)?, number(&read(used)?)?);
    let stat = read("memory.stat").unwrap_or_default();
    let cached = |key| {
        stat.lines()
            .find_map(|line| number(line.strip_prefix(key)?))
            .unwrap_or(0)
    };
    Some(limit.saturating_sub(used.saturating_sub(cached(inactive) + cached(active))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn available_memory_and_limits_are_read_where_they_are_given() {
        let text = "MemTotal:       24603332 kB\nMemFree:          100 kB\nMemAvailable:   23810216 kB\n";
        assert_eq!(kib(text, "MemAvailable:"), Some(23_810_216 * 1024));
        assert_eq!(kib("MemTotal: 24603332 kB\n", "MemAvailable:"), None);
        assert_eq!(kib("MemAvailable: many kB\n", "MemAvailable:"), None);
        assert_eq!(kib("MemAvailable: 12\n", "MemAvailable:"), None);

        let limits = "Limit                     Soft Limit           Hard Limit           Units     \n\
                      Max data size             unlimited            unlimited            bytes     \n\
                      Max address space         4294967296           unlimited            bytes     \n";
        let process = "VmPeak:\t  300000 kB\nVmSize:\t  262144 kB\nVmData:\t   10000 kB\n";
        let left = |limit, used| limit_left(limits, limit, process, used);
        assert_eq!(left("Max address space", "VmSize:"), Some((4096 - 256) << 20));
        assert_eq!(left("Max data size", "VmData:"), None);
    }

    #[test]
    fn the_tightest_group_counts_and_its_page_cache_does_not() {
        let root = tempfile::tempdir().unwrap();
        let put = |folder: &str, files: &[(&str, &str)]| {
            let folder = root.path().join(folder);
            fs::create_dir_all(&folder).unwrap();
            for (name, text) in files {
                fs::write(folder.join(name), text).unwrap();
            }
        };
        let left = |memberships| groups_left(root.path(), memberships);
        assert_eq!(left("0::/user/run\n"), None, "no files");

        // Version 2: unlimited by itself, limited through its parent.
        put("user/run", &[("memory.max", "max\n"), ("memory.current", "10\n")]);
        put(
            "user",
            &[
                ("memory.max", "1000\n"),
                ("memory.current", "600\n"),
                ("memory.stat", "anon 200\ninactive_file 250\nactive_file 50\n"),
            ],
        );
        assert_eq!(left("0::/user/run\n"), Some(700));

        // Version 1, whose path inside a container differs from the one mounted there.
        put(
            "memory",
            &[
                ("memory.limit_in_bytes", "500\n"),
                ("memory.usage_in_bytes", "200\n"),
                (
                    "memory.stat",
                    "inactive_file 150\ntotal_inactive_file 100\ntotal_active_file 0\n",
                ),
            ],
        );
        let both = "4:cpu,memory:/docker/abc\n1:pids:/user\n0::/user/run\n";
        assert_eq!(left(both), Some(400));
        assert_eq!(left("4:cpu:/docker/abc\n"), None);
    }

    #[test]
    fn what_exceeds_the_memory_is_refused_with_its_bytes() {
        assert_eq!(check(0, "nothing"), Ok(()));
        if available().is_some() {
            let error = check(u64::MAX, "a frame").unwrap_err();
            let cause = io::Error::from(error.clone());
            assert_eq!(cause.kind(), io::ErrorKind::OutOfMemory);
            assert_eq!(cause.to_string(), error.to_string());
            assert!(
                error
                    .to_string()
                    .starts_with("a frame needs 17179869184.0 GiB (18446744073709551615 bytes) of"),
                "{error}"
            );
        }
        assert_eq!(size(1023), "1023 bytes");
        assert_eq!(size(3 << 19), "1.5 MiB (1572864 bytes)");
    }
}
