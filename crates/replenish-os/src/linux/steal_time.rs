//! CPU time that a hypervisor took: the column `steal` of `/proc/stat` (`proc_stat(5)`).
//!
//! A virtual CPU that its host does not run stands still: no thread's CPU clock counts that time,
//! so it is missing from the sum of all of them. The test kit includes this file, too.

use std::fs;

/// The kernel tells `/proc/stat` in hundredths of a second (`USER_HZ`), on every architecture that
/// Rust's standard library has Linux for.
const TICK: u64 = 10_000_000;

/// The time for which CPU `cpu` was wanted and its hypervisor ran something else, in ns since boot,
/// in steps of 10 ms. `None` if the kernel does not say; 0 on real hardware.
///
/// Reads a file: some 50 µs, not for hot paths. Callable from any thread.
#[must_use]
pub fn steal_time(cpu: usize) -> Option<u64> {
    of(&fs::read_to_string("/proc/stat").ok()?, cpu)
}

/// The same from the text of `/proc/stat`. The columns: user, nice, system, idle, iowait, irq,
/// softirq, steal.
fn of(stat: &str, cpu: usize) -> Option<u64> {
    let name = format!("cpu{cpu}");
    let mut words = stat.lines().map(str::split_ascii_whitespace);
    let mut columns = words.find_map(|mut line| (line.next() == Some(&name)).then_some(line))?;
    let ticks: u64 = columns.nth(7)?.parse().ok()?;
    Some(ticks.saturating_mul(TICK))
}

#[cfg(test)]
mod tests {
    use super::*;

    const STAT: &str = "cpu  30 2 12 9 0 0 5 33 0 0\ncpu0 10 1 6 4 0 0 2 3 0 0\n\
        cpu1 20 1 6 5 0 0 3 30 0 0\ncpu11 1 1 1 1 1 1 1\nintr 7 1\n";

    #[test]
    fn steal_is_the_eighth_column_of_the_cpus_own_line() {
        assert_eq!(of(STAT, 0), Some(30_000_000));
        assert_eq!(of(STAT, 1), Some(300_000_000));
    }

    #[test]
    fn what_the_kernel_does_not_say_is_not_made_up() {
        assert_eq!(of(STAT, 2), None, "no such CPU");
        assert_eq!(of(STAT, 11), None, "a kernel without the column");
        assert_eq!(of("", 0), None);
    }

    #[test]
    fn it_never_goes_back() {
        let before = steal_time(0);
        assert!(steal_time(0) >= before);
    }
}
