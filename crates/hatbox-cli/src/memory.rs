//! How much memory there is.

use sysinfo::System;

/// The bytes that are free, within the limits that the system sets this process; `None` where it does not tell.
pub(crate) fn available() -> Option<u64> {
    let mut system = System::new();
    system.refresh_memory();
    let free = system.available_memory();
    // A container may have less than the machine. What it holds for files is given back when it is needed.
    let allowed = system.cgroup_limits().map_or(u64::MAX, |limits| limits.total_memory.saturating_sub(limits.rss));
    Some(free.min(allowed)).filter(|&bytes| bytes > 0)
}
