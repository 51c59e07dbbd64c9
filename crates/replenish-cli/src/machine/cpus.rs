//! Roles of the CPUs: the measured one is the last that this process may use.

use crate::outcome::Failure;

/// The CPUs of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Cpus {
    /// The CPU on which budgets are enforced: pong's workers, dispatcher and enforcer.
    pub measured: usize,
    /// The CPU of ping, the agent and the monitor; the same one if there is only one.
    pub support: usize,
}

impl Cpus {
    /// The last CPU that this process may use, and the first one for everything else.
    pub fn choose() -> Self {
        let allowed = allowed();
        let first = allowed.first().copied().unwrap_or(0);
        Self {
            measured: allowed.last().copied().unwrap_or(0),
            support: first,
        }
    }

    /// Whether everything shares one CPU.
    pub fn is_single(&self) -> bool {
        self.measured == self.support
    }
}

/// The CPUs that this process may use, in order; CPU 0 if the kernel does not say.
pub fn allowed() -> Vec<usize> {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let list = status
        .lines()
        .find_map(|l| l.strip_prefix("Cpus_allowed_list:"))
        .unwrap_or("0");
    let cpus = parse_list(list);
    if cpus.is_empty() { vec![0] } else { cpus }
}

/// Checks an option that names a CPU.
///
/// # Errors
/// The process may not use that CPU.
pub fn check(option: &str, cpu: Option<usize>) -> Result<(), Failure> {
    let allowed = allowed();
    match cpu {
        Some(cpu) if !allowed.contains(&cpu) => {
            let list: Vec<String> = allowed.iter().map(ToString::to_string).collect();
            Err(Failure::range(
                option,
                cpu,
                format!("one of the CPUs {}", list.join(", ")),
            ))
        }
        _ => Ok(()),
    }
}

/// Reads a kernel CPU list: `0-3,5`. A part that cannot be read is left out.
fn parse_list(list: &str) -> Vec<usize> {
    let mut cpus = Vec::new();
    for part in list.trim().split(',') {
        let (from, to) = part.split_once('-').unwrap_or((part, part));
        if let (Ok(from), Ok(to)) = (from.trim().parse(), to.trim().parse::<usize>()) {
            cpus.extend((from..=to).take(4096));
        }
    }
    cpus
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cpu_lists() {
        assert_eq!(parse_list("\t0-3,5"), [0, 1, 2, 3, 5]);
        assert_eq!(parse_list("7"), [7]);
        assert_eq!(parse_list(""), [] as [usize; 0]);
    }

    #[test]
    fn a_cpu_that_is_not_there_is_refused_with_the_ones_that_are() {
        let e = check("--cpu", Some(100_000)).unwrap_err().to_string();
        assert!(
            e.contains("--cpu") && e.contains("100000") && e.contains("one of the CPUs"),
            "{e}"
        );
        assert_eq!(check("--cpu", None), Ok(()));
    }
}
