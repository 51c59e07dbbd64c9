//! The machine's properties that matter to real-time work. For `replenish doctor`.

use super::affinity::{CpuSet, affinity};
use super::privilege::probes::read_number;
use super::tid::current_tid;
use std::fmt;
use std::fs;

/// Facts about the kernel and the CPUs; what cannot be read is `None` or empty.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct MachineInfo {
    /// The kernel's release, as `uname -r` prints it.
    pub kernel: String,
    /// Preemption model of the kernel.
    pub preemption: Preemption,
    /// Scheduler ticks per second (`CONFIG_HZ`).
    pub hz: Option<u32>,
    /// `kernel.sched_rt_runtime_us`: how much of every period real-time threads may use of a CPU,
    /// in microseconds; -1 is all of it.
    pub rt_runtime_us: Option<i64>,
    /// `kernel.sched_rt_period_us`, in microseconds.
    pub rt_period_us: Option<i64>,
    /// The CPUs that are online.
    pub online: CpuSet,
    /// CPUs kept free of ordinary threads (`isolcpus=`).
    pub isolated: CpuSet,
    /// CPUs that the calling thread may use.
    pub allowed: CpuSet,
    /// The counter behind `CLOCK_MONOTONIC` (`tsc`, `arch_sys_counter`, ...).
    pub clock_source: Option<String>,
}

/// Preemption model: when code inside the kernel gives way to a real-time thread.
#[derive(Clone, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub enum Preemption {
    /// `PREEMPT_RT`: almost everywhere.
    RealTime,
    /// `PREEMPT`: except in critical sections.
    Full,
    /// `PREEMPT_DYNAMIC`: chosen at boot or at run time; the mode where it can be read (`none`,
    /// `voluntary`, `full`, `lazy`).
    Dynamic(Option<String>),
    /// Neither: only where the kernel offers it, so that long system calls of others delay.
    NoneOrVoluntary,
}

impl fmt::Display for Preemption {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::RealTime => f.write_str("PREEMPT_RT"),
            Self::Full => f.write_str("full"),
            Self::Dynamic(Some(mode)) => write!(f, "dynamic, now {mode}"),
            Self::Dynamic(None) => f.write_str("dynamic, mode not readable"),
            Self::NoneOrVoluntary => f.write_str("none or voluntary"),
        }
    }
}

impl MachineInfo {
    /// The share of a CPU that real-time threads may use, 0 to 1; `None` if unknown.
    #[must_use]
    pub fn real_time_share(&self) -> Option<f64> {
        match (self.rt_runtime_us?, self.rt_period_us?) {
            (runtime, _) if runtime < 0 => Some(1.0),
            (runtime, period) if period > 0 => Some((runtime as f64 / period as f64).min(1.0)),
            _ => None,
        }
    }
}

/// Reads the facts.
#[must_use]
pub fn machine_info() -> MachineInfo {
    let kernel = line("/proc/sys/kernel/osrelease").unwrap_or_default();
    let cpus = |file| {
        let list = line(format!("/sys/devices/system/cpu/{file}")).unwrap_or_default();
        CpuSet::parse(&list).unwrap_or_default()
    };
    let real_time = read_number("/sys/kernel/realtime") == Some(1);
    let version = line("/proc/sys/kernel/version").unwrap_or_default();
    MachineInfo {
        preemption: preemption(real_time, &version, line("/sys/kernel/debug/sched/preempt")),
        hz: fs::read_to_string(format!("/boot/config-{kernel}"))
            .ok()
            .and_then(|c| hz(&c)),
        rt_runtime_us: read_number("/proc/sys/kernel/sched_rt_runtime_us"),
        rt_period_us: read_number("/proc/sys/kernel/sched_rt_period_us"),
        online: cpus("online"),
        isolated: cpus("isolated"),
        allowed: affinity(current_tid()).unwrap_or_default(),
        clock_source: line("/sys/devices/system/clocksource/clocksource0/current_clocksource"),
        kernel,
    }
}

fn line(path: impl AsRef<std::path::Path>) -> Option<String> {
    fs::read_to_string(path)
        .ok()
        .map(|text| text.trim().to_owned())
}

/// `mode` is the kernel's list of modes with the current one in parentheses.
fn preemption(real_time: bool, version: &str, mode: Option<String>) -> Preemption {
    let has = |word| version.split(' ').any(|w| w == word);
    if real_time || has("PREEMPT_RT") {
        Preemption::RealTime
    } else if has("PREEMPT_DYNAMIC") {
        let current =
            mode.and_then(|modes| Some(modes.split_once('(')?.1.split_once(')')?.0.to_owned()));
        Preemption::Dynamic(current)
    } else if has("PREEMPT") {
        Preemption::Full
    } else {
        Preemption::NoneOrVoluntary
    }
}

fn hz(config: &str) -> Option<u32> {
    config
        .lines()
        .find_map(|line| line.strip_prefix("CONFIG_HZ=")?.parse().ok())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn preemption_is_read_from_the_version_line() {
        let of = |version| preemption(false, version, None);
        assert_eq!(of("#1 SMP PREEMPT_RT Debian 6.1"), Preemption::RealTime);
        assert_eq!(of("#1 SMP PREEMPT Tue"), Preemption::Full);
        assert_eq!(of("#1 SMP Tue"), Preemption::NoneOrVoluntary);
        assert_eq!(of("#1 SMP PREEMPT_DYNAMIC @0"), Preemption::Dynamic(None));
        assert_eq!(preemption(true, "", None), Preemption::RealTime);
        let mode = preemption(
            false,
            "PREEMPT_DYNAMIC",
            Some("none (voluntary) full".into()),
        );
        assert_eq!(mode.to_string(), "dynamic, now voluntary");
    }

    #[test]
    fn the_share_of_real_time_threads_follows_the_throttle() {
        let mut here = machine_info();
        assert!(!here.kernel.is_empty() && !here.online.is_empty() && !here.allowed.is_empty());
        (here.rt_runtime_us, here.rt_period_us) = (Some(950_000), Some(1_000_000));
        assert_eq!(here.real_time_share(), Some(0.95));
        here.rt_runtime_us = Some(-1);
        assert_eq!(here.real_time_share(), Some(1.0));
        here.rt_runtime_us = None;
        assert_eq!(here.real_time_share(), None);
    }

    #[test]
    fn ticks_are_read_from_the_kernel_configuration() {
        assert_eq!(
            hz("# CONFIG_HZ_100 is not set\nCONFIG_HZ_250=y\nCONFIG_HZ=250\n"),
            Some(250)
        );
        assert_eq!(hz("CONFIG_HZ_250=y\n"), None);
    }
}
