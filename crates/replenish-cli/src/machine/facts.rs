//! Facts about the machine that any account may read in `/proc` and `/sys`, parsed by pure
//! functions.

use std::path::Path;

/// A file's text without the final newline; `None` if it cannot be read.
pub fn read(path: impl AsRef<Path>) -> Option<String> {
    std::fs::read_to_string(path)
        .ok()
        .map(|s| s.trim().to_string())
}

/// A file that holds one number.
pub fn number(path: impl AsRef<Path>) -> Option<i64> {
    read(path)?.parse().ok()
}

/// Preemption model of the kernel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Preemption {
    /// `PREEMPT_RT`: almost everywhere.
    RealTime,
    /// `PREEMPT` or `PREEMPT_LAZY`: outside critical sections.
    Full,
    /// `PREEMPT_DYNAMIC`: decided at boot or in debugfs, which is often not readable.
    Dynamic,
    /// Voluntary or none: a long system call of another thread delays a real-time thread.
    None,
}

/// Reads it from the version line, the text of `/proc/version`.
pub fn preemption(version: &str) -> Preemption {
    if version.contains("PREEMPT_RT") {
        Preemption::RealTime
    } else if version.contains("PREEMPT_DYNAMIC") {
        Preemption::Dynamic
    } else if version.contains("PREEMPT") {
        Preemption::Full
    } else {
        Preemption::None
    }
}

/// Whether the CPU reports a hypervisor: then the machine can stand still for milliseconds.
pub fn is_virtual(cpuinfo: &str) -> bool {
    cpuinfo
        .lines()
        .filter(|l| l.starts_with("flags"))
        .any(|l| l.split_whitespace().any(|f| f == "hypervisor"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn preemption_models() {
        assert_eq!(preemption("#1 SMP PREEMPT_RT Tue"), Preemption::RealTime);
        assert_eq!(preemption("#1 SMP PREEMPT_DYNAMIC @0"), Preemption::Dynamic);
        assert_eq!(preemption("#1 SMP PREEMPT Tue"), Preemption::Full);
        assert_eq!(preemption("#1 SMP Tue"), Preemption::None);
    }

    #[test]
    fn virtual_machines() {
        assert!(is_virtual("flags\t\t: fpu sse hypervisor lm\n"));
        assert!(!is_virtual(
            "flags\t\t: fpu sse lm\nmodel name: hypervisor\n"
        ));
    }
}
