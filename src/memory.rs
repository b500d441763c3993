//! How much memory the machine has to spare.

/// Bytes of memory that can be had without swapping, where the system says so (`MemAvailable` of Linux).
pub fn available() -> Option<usize> {
    mem_available(&std::fs::read_to_string("/proc/meminfo").ok()?)
}

fn mem_available(meminfo: &str) -> Option<usize> {
    let line = meminfo.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    let kib: usize = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    kib.checked_mul(1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_available_memory_is_read_where_it_is_given() {
        let text = "MemTotal:       24603332 kB\nMemFree:          100 kB\nMemAvailable:   23810216 kB\n";
        assert_eq!(mem_available(text), Some(23_810_216 * 1024));
        assert_eq!(mem_available("MemTotal: 24603332 kB\n"), None);
        assert_eq!(mem_available("MemAvailable: many kB\n"), None);
        assert_eq!(mem_available("MemAvailable: 12\n"), None);
    }
}
