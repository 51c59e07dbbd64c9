//! Pong's monitor: snapshots of CPU time and answers at the edges of every window.
//!
//! It runs on ping's CPU, above everything there, so that it neither disturbs the measured CPU
//! nor is late. How late it was is part of what it reports.

use super::pong::{Config, Pong, Topic};
use super::protocol::{Event, PongWindow, WorkerWindow};
use super::supervised::{self, SharedGrid};
use crate::load::grid::Grid;
use crate::load::spec::MONITOR_PRIORITY;
use crate::load::{MS, Nanos};
use replenish::Report;
use replenish_cli::outcome::Failure;
use replenish_cli::signals::Stop;
use replenish_os::{ThreadSpec, clock, spawn, steal_time};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// After the end of a window the workers need this long to drop what they had begun.
const SETTLE: Nanos = 20 * MS;

/// The last stretch before a snapshot is slept through without looking at the stop flag.
const EXACT: Nanos = 3 * MS;

/// Runs pong with a monitor until `stop`; windows are reported if there is a grid.
pub(crate) fn watch(
    pong: Pong,
    config: &Config,
    grid: &SharedGrid,
    stop: &Stop,
) -> Result<Report, Failure> {
    let pong = observe(pong, (config.monitor_cpu, config.cpu), grid, stop)?;
    Ok(pong.running.stop())
}

/// Watches `pong` until `stop` and hands it back; on `cpu`, while pong works on `measured`.
fn observe(
    pong: Pong,
    (cpu, measured): (Option<usize>, Option<usize>),
    grid: &SharedGrid,
    stop: &Stop,
) -> Result<Pong, Failure> {
    let spec = ThreadSpec::new("monitor")
        .policy(replenish_cli::machine::fifo_or_other(MONITOR_PRIORITY))
        .cpu(cpu);
    let (grid, stop) = (Arc::clone(grid), stop.clone());
    let body = move || {
        report_windows(&pong, measured, &grid, &stop);
        pong
    };
    let failed = |e: &dyn std::fmt::Display| Failure::refused(format!("monitor thread: {e}"));
    spawn(spec, body)
        .map_err(|e| failed(&e))?
        .join()
        .map_err(|_| failed(&"it panicked"))
}

fn report_windows(pong: &Pong, cpu: Option<usize>, grid: &SharedGrid, stop: &Stop) {
    let grid = loop {
        match grid.get() {
            Some(grid) => break *grid,
            None if stop.wait(Duration::from_millis(10)) => return,
            None => {}
        }
    };
    let mut index = clock::monotonic()
        .saturating_sub(grid.epoch)
        .div_ceil(grid.cycle());
    if !until(grid.start(index), stop) {
        return;
    }
    let mut from = Snapshot::take(pong, cpu, grid.start(index));
    loop {
        if !until(grid.end(index), stop) {
            return;
        }
        let to = Snapshot::take(pong, cpu, grid.end(index));
        let next = if grid.is_continuous() {
            to
        } else {
            pong.running.discard_waiting();
            clock::sleep_until(grid.end(index) + SETTLE);
            to
        };
        supervised::emit(&Event::PongWindow(account(pong, &grid, index, &from, &to)));
        index += 1;
        if grid.is_continuous() {
            from = next;
        } else {
            if !until(grid.start(index), stop) {
                return;
            }
            from = Snapshot::take(pong, cpu, grid.start(index));
        }
    }
}

/// Sleeps until `t`; `false` as soon as the end was asked for.
pub(crate) fn until(t: Nanos, stop: &Stop) -> bool {
    let coarse = t.saturating_sub(clock::monotonic()).saturating_sub(EXACT);
    if stop.wait(Duration::from_nanos(coarse)) {
        return false;
    }
    clock::sleep_until(t);
    true
}

/// The state of pong at one moment.
#[derive(Debug, Clone, Copy, Default)]
struct Snapshot {
    high: WorkerWindow,
    low: WorkerWindow,
    support: Nanos,
    enforcers: Nanos,
    late: Nanos,
    stolen: Nanos,
    idle: Nanos,
}

/// The time for which `cpu` had nothing to do, in ns since boot: the fourth column of `/proc/stat`.
fn idle_time(cpu: usize) -> Option<Nanos> {
    let stat = std::fs::read_to_string("/proc/stat").ok()?;
    let name = format!("cpu{cpu} ");
    let line = stat.lines().find_map(|line| line.strip_prefix(&name))?;
    let ticks: Nanos = line.split_ascii_whitespace().nth(3)?.parse().ok()?;
    Some(ticks.saturating_mul(10 * MS))
}

impl Snapshot {
    fn take(pong: &Pong, cpu: Option<usize>, due: Nanos) -> Self {
        let late = clock::monotonic().saturating_sub(due);
        let worker = |name: &str, topic: &Topic| {
            let usage = pong.running.usage(name).unwrap_or_default();
            WorkerWindow {
                cpu_high: usage.cpu_high,
                cpu_low: usage.cpu_low,
                answered: topic.answered.load(Ordering::Relaxed),
                exhaustions: usage.exhaustions,
            }
        };
        let high = worker("high", &pong.high);
        let low = worker("low", &pong.low);
        let dispatcher = pong.running.usage("dispatcher").unwrap_or_default();
        let enforcers: Nanos = pong.running.report().enforcers.iter().map(|e| e.cpu).sum();
        // Judged twice: the machine may stand still between the readings as well.
        let late = late.max(clock::monotonic().saturating_sub(due));
        Self {
            high,
            low,
            support: dispatcher.cpu_high + dispatcher.cpu_low + enforcers,
            enforcers,
            late,
            stolen: cpu.and_then(steal_time).unwrap_or(0),
            idle: cpu.and_then(idle_time).unwrap_or(0),
        }
    }
}

fn account(pong: &Pong, grid: &Grid, index: u64, from: &Snapshot, to: &Snapshot) -> PongWindow {
    let worker = |from: &WorkerWindow, to: &WorkerWindow| WorkerWindow {
        cpu_high: to.cpu_high.saturating_sub(from.cpu_high),
        cpu_low: to.cpu_low.saturating_sub(from.cpu_low),
        answered: to.answered.saturating_sub(from.answered),
        exhaustions: to.exhaustions.saturating_sub(from.exhaustions),
    };
    let start = grid.start(index);
    PongWindow {
        index,
        high: worker(&from.high, &to.high),
        low: worker(&from.low, &to.low),
        support_cpu: to.support.saturating_sub(from.support),
        enforcer_cpu: to.enforcers.saturating_sub(from.enforcers),
        idle: to.idle.saturating_sub(from.idle),
        late: from.late.max(to.late),
        stolen: to.stolen.saturating_sub(from.stolen),
        high_slices: pong.high.cpu_trace.lock().take(start),
        low_slices: pong.low.cpu_trace.lock().take(start),
    }
}
