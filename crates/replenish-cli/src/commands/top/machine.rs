//! The host's CPUs and other programs, as the kernel counts them.

use crate::time::Nanos;
use std::collections::HashMap;

/// Nanoseconds of a tick of `/proc`: `USER_HZ` is 100 on every architecture of Linux.
const TICK: Nanos = 10_000_000;

/// Last reading of `/proc/stat`.
#[derive(Default)]
pub(super) struct Machine(HashMap<u64, (u64, u64)>);

impl Machine {
    /// Each CPU's busy share since the last call, in the order of their numbers.
    pub(super) fn busy(&mut self) -> Vec<(u64, f64)> {
        let text = std::fs::read_to_string("/proc/stat").unwrap_or_default();
        self.read(&text)
    }

    fn read(&mut self, text: &str) -> Vec<(u64, f64)> {
        let mut shares = Vec::new();
        for line in text.lines().take(8192) {
            let Some((number, busy, all)) = cpu_line(line) else {
                continue;
            };
            let before = self.0.insert(number, (busy, all)).unwrap_or((busy, all));
            let (busy, all) = (busy.saturating_sub(before.0), all.saturating_sub(before.1));
            let share = if all == 0 {
                0.0
            } else {
                busy as f64 / all as f64
            };
            shares.push((number, share.min(1.0)));
        }
        shares
    }
}

/// `cpu3 user nice system idle iowait …`: number, busy ticks, all ticks.
fn cpu_line(line: &str) -> Option<(u64, u64, u64)> {
    let mut words = line.strip_prefix("cpu")?.split_ascii_whitespace();
    let number = words.next().filter(|_| !line.starts_with("cpu "))?;
    let number = number.parse().ok()?;
    let ticks: Vec<u64> = words.take(8).map_while(|w| w.parse().ok()).collect();
    let all = ticks.iter().sum();
    let idle: u64 = ticks.iter().skip(3).take(2).sum();
    Some((number, u64::saturating_sub(all, idle), all))
}

/// The CPU time of all threads of a process; 0 if it cannot be read, as in another pid namespace.
pub(super) fn program_cpu(pid: u32) -> Nanos {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    stat_cpu(&stat)
}

/// Fields 14 and 15, behind the name in parentheses.
fn stat_cpu(stat: &str) -> Nanos {
    let Some((_, rest)) = stat.rsplit_once(')') else {
        return 0;
    };
    let ticks = rest.split_ascii_whitespace().skip(11).take(2);
    let ticks: u64 = ticks.filter_map(|w| w.parse::<u64>().ok()).sum();
    ticks.saturating_mul(TICK)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_are_those_since_the_last_look() {
        let mut machine = Machine::default();
        let first = "cpu  9 9 9 9 9\ncpu0 100 0 50 800 50 0 0 0 0 0\ncpu1 1 1 1 1 1\nintr 5\n";
        assert_eq!(machine.read(first), [(0, 0.0), (1, 0.0)]);
        let second = "cpu0 125 0 50 850 75 0 0 0 0 0\ncpu1 1 1 1 1 1\n";
        assert_eq!(machine.read(second), [(0, 0.25), (1, 0.0)]);
        assert_eq!(machine.read("cpu0 1 2\ncpux 1\ncpu"), [(0, 0.0)]);
    }

    #[test]
    fn the_time_of_a_program_stands_behind_its_name() {
        let stat = "77 (a) b) S 1 1 1 0 -1 4194304 100 0 0 0 12 30 0 0 20 0 1 0 5 0 0";
        assert_eq!(stat_cpu(stat), 42 * TICK);
        assert_eq!(stat_cpu("77 (a"), 0);
    }
}
