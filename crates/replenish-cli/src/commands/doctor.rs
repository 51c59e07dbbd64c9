//! `replenish doctor`: what this machine grants to real-time threads and to ROS 2, with advice.

use super::finding::{Finding, Verdict};
use super::latency::{self, Latency};
use super::network;
use super::overheads;
use crate::lock;
use crate::machine;
use crate::machine::cpus::{self, Cpus};
use crate::machine::facts::{self, Preemption};
use crate::options::JsonOption;
use crate::outcome::Outcome;
use crate::report::files;
use crate::time::SEC;
use replenish_os::Policy;
use replenish_os::privilege::{CgroupRt, Privilege};

/// Length of the measurement of wake-ups, in ns.
const MEASURE: u64 = 2 * SEC;

/// Options of `doctor`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Measure what enforcing costs here and keep it in this host's ledger: plans count with it
    /// from then on.
    #[arg(long)]
    save: bool,

    #[command(flatten)]
    json: JsonOption,
}

/// Looks and tells.
pub(crate) fn run(args: &Args) -> Outcome {
    files::check_writable(args.json.json.as_deref())?;
    let cpu = Cpus::choose().measured;
    let privilege = machine::privilege();
    let mut findings = vec![
        fifo(privilege),
        sporadic(),
        deadline(privilege),
        throttle(privilege),
    ];
    findings.extend([
        cgroup(privilege),
        preemption(),
        timers(),
        memory_locking(privilege),
    ]);
    findings.extend([perf(), cpus(), virtual_machine()]);
    findings.extend(network::findings());

    let _alone = lock::acquire()?;
    remark!("measuring wake-ups for {} s …", MEASURE / SEC);
    let fifo = Policy::fifo(99)
        .ok()
        .and_then(|p| latency::measure(cpu, p, MEASURE).ok());
    let latency = match fifo {
        Some(latency) => latency,
        None => latency::measure(cpu, Policy::Other, MEASURE)?,
    };
    print(&findings, &latency);
    let saved = if args.save {
        Some(overheads::save(cpu, &latency, privilege.real_time())?)
    } else {
        None
    };
    let json = serde_json::json!({
        "findings": findings, "latency_us": latency, "overheads_ns": saved,
    });
    files::write_json(args.json.json.as_deref(), "doctor", &json)
}

fn print(findings: &[Finding], latency: &Latency) {
    for f in findings {
        let mark = match f.verdict {
            Verdict::Good => "ok     ",
            Verdict::Limited => "limited",
            Verdict::Missing => "MISSING",
        };
        println!("  {mark}  {:<16} {}", f.topic, f.value);
        for (n, line) in f.advice.iter().flat_map(|a| a.lines()).enumerate() {
            println!(
                "           {:<16} {} {line}",
                "",
                if n == 0 { "->" } else { "  " }
            );
        }
    }
    println!(
        "\n  Wake-up latency of an absolute sleep ({}, {} samples):\n    \
         median {:.1} us, p99 {:.1} us, max {:.1} us",
        latency.granted, latency.samples, latency.median, latency.p99, latency.max
    );
    print!("{}", latency.to_text());
}

fn fifo(privilege: &Privilege) -> Finding {
    if privilege.real_time() {
        Finding::good(
            "real-time FIFO",
            "granted: budgets are enforced in the middle of a callback",
        )
    } else {
        let value = "refused: budgets are held at callback boundaries only";
        Finding::missing("real-time FIFO", value, privilege.to_string())
    }
}

fn sporadic() -> Finding {
    let value = "Linux has none; replenish enforces budgets itself where FIFO is granted";
    Finding::good("sporadic server", value)
}

fn deadline(privilege: &Privilege) -> Finding {
    match &privilege.deadline {
        Ok(()) => Finding::good(
            "SCHED_DEADLINE",
            "granted, as a hard reservation without background",
        ),
        Err(e) => Finding::limited(
            "SCHED_DEADLINE",
            format!("refused ({e})"),
            "needed for Policy::Deadline only; the same privilege as FIFO",
        ),
    }
}

fn throttle(privilege: &Privilege) -> Finding {
    let period = facts::number("/proc/sys/kernel/sched_rt_period_us").filter(|p| *p > 0);
    match (privilege.rt_runtime_us, period) {
        (Some(-1), _) => Finding::limited(
            "RT throttle",
            "off: a real-time thread that loops takes its CPU for good",
            "keep one CPU free of real-time threads",
        ),
        (Some(runtime), Some(period)) => Finding::limited(
            "RT throttle",
            format!(
                "{:.0} %: the real-time threads of a CPU get {runtime} us of every {period} us together",
                runtime as f64 * 100.0 / period as f64
            ),
            "budgets that sum up to less never meet it; `sysctl kernel.sched_rt_runtime_us=-1` removes it",
        ),
        _ => Finding::limited(
            "RT throttle",
            "unknown",
            "/proc/sys/kernel/sched_rt_runtime_us cannot be read",
        ),
    }
}

fn cgroup(privilege: &Privilege) -> Finding {
    match &privilege.cgroup {
        CgroupRt::V1 {
            file,
            rt_runtime_us: 0,
        } => Finding::missing(
            "cgroup",
            format!(
                "{} is 0: no real-time thread, not even of root",
                file.display()
            ),
            format!(
                "echo 100000 | sudo tee {}   (its parents first)",
                file.display()
            ),
        ),
        CgroupRt::V1 {
            file,
            rt_runtime_us,
        } => Finding::good(
            "cgroup",
            format!("{} is {rt_runtime_us} us", file.display()),
        ),
        CgroupRt::V2 { path } => Finding::good("cgroup", format!("{path} (version 2)")),
        _ => Finding::good("cgroup", "no real-time limit of its own"),
    }
}

fn preemption() -> Finding {
    let version = facts::read("/proc/version").unwrap_or_default();
    let release = version
        .split_whitespace()
        .nth(2)
        .unwrap_or("unknown")
        .to_string();
    match facts::preemption(&version) {
        Preemption::RealTime => Finding::good("kernel", format!("{release}, PREEMPT_RT")),
        Preemption::Full => Finding::good("kernel", format!("{release}, PREEMPT")),
        Preemption::Dynamic => Finding::limited(
            "kernel",
            format!("{release}, PREEMPT_DYNAMIC: the model was chosen at boot"),
            "boot with preempt=full; without it a long system call of another thread delays wake-ups by milliseconds",
        ),
        Preemption::None => Finding::limited(
            "kernel",
            format!("{release}, without preemption inside the kernel"),
            "a PREEMPT or PREEMPT_RT kernel bounds wake-up latencies",
        ),
    }
}

fn timers() -> Finding {
    let source = facts::read("/sys/devices/system/clocksource/clocksource0/current_clocksource");
    match source.as_deref() {
        None => Finding::limited(
            "timers",
            "clock source unknown",
            "the histogram below tells how exact they are",
        ),
        Some("tsc" | "arch_sys_counter") => Finding::good(
            "timers",
            format!("clock source {}", source.unwrap_or_default()),
        ),
        Some(slow) => Finding::limited(
            "timers",
            format!("clock source {slow}: reading the clock is a slow operation"),
            "boot with tsc=reliable if the hardware allows it",
        ),
    }
}

fn memory_locking(privilege: &Privilege) -> Finding {
    let advice =
        "raise it: `ulimit -l unlimited`, LimitMEMLOCK=infinity in a systemd unit, or CAP_IPC_LOCK";
    match &privilege.memory_lock {
        // The kernel moves locked pages too, unless it is built with PREEMPT_RT.
        Ok(()) if facts::number("/proc/sys/vm/compact_unevictable_allowed") == Some(1) => {
            Finding::limited(
                "memory locking",
                "granted; but the kernel may move locked pages, and a thread that needs one waits",
                "`sysctl vm.compact_unevictable_allowed=0`",
            )
        }
        Ok(()) => Finding::good(
            "memory locking",
            "granted: no page fault can delay a worker",
        ),
        Err(e) => Finding::limited("memory locking", format!("refused: {e}"), advice),
    }
}

fn perf() -> Finding {
    let paranoid = facts::number("/proc/sys/kernel/perf_event_paranoid");
    match replenish_os::ContextSwitchLog::open(replenish_os::current_tid()) {
        Ok(_) => Finding::good(
            "context switches",
            "recorded: blocking inside a callback is accounted exactly",
        ),
        Err(e) => Finding::limited(
            "context switches",
            format!(
                "not recorded ({e}; perf_event_paranoid {}): blocking inside a callback is accounted on the safe side",
                paranoid.map_or_else(|| "unknown".into(), |p| p.to_string())
            ),
            "CAP_PERFMON, or `sysctl kernel.perf_event_paranoid=1`",
        ),
    }
}

fn cpus() -> Finding {
    let allowed = cpus::allowed();
    let isolated = facts::read("/sys/devices/system/cpu/isolated").filter(|s| !s.is_empty());
    let list: Vec<String> = allowed.iter().map(ToString::to_string).collect();
    let value = format!("{} usable ({})", allowed.len(), list.join(", "));
    match isolated {
        Some(isolated) => Finding::good("CPUs", format!("{value}; isolated: {isolated}")),
        None if allowed.len() > 1 => Finding::good("CPUs", value),
        None => Finding::limited(
            "CPUs",
            value,
            "with one CPU a real-time thread delays everything else",
        ),
    }
}

fn virtual_machine() -> Finding {
    if facts::is_virtual(&facts::read("/proc/cpuinfo").unwrap_or_default()) {
        Finding::limited(
            "machine",
            "virtual: it may stand still for milliseconds",
            "measure on the real machine; figures here list such stalls apart",
        )
    } else {
        Finding::good("machine", "no hypervisor is visible")
    }
}
