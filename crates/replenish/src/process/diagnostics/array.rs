//! A status of each thread and chain, for `/diagnostics`.

use super::chain_status::WatchedChain;
use super::texts::{ERROR, MESSAGE, Ms, OK, WARN, join, put, roomy, value, with_room};
use crate::executor::{HandleState, Live, ThreadPlan};
use crate::middleware::Middleware;
use crate::process::Chains;
use crate::stats::HandleStats;
use replenish_interfaces::diagnostic_msgs::msg::{DiagnosticArray, DiagnosticStatus};
use replenish_interfaces::std_msgs::msg::Header;
use replenish_msg::builtin_interfaces::Time;
use replenish_os::{Meter, Policy};
use std::format;
use std::string::String;
use std::sync::Arc;
use std::vec::Vec;

/// Bytes of an encoded status, at most: twelve pairs of 112 bytes besides the texts.
const STATUS: usize = 2048;

/// Counters of a thread and its handles since the start.
#[derive(Debug, Clone, Copy, Default)]
struct Totals {
    cpu: u64,
    exhaustions: u64,
    stalls: u64,
    late: u64,
    dropped: u64,
    errors: u64,
    panics: u64,
}

/// The largest of the handles' figures.
#[derive(Default)]
struct Worst {
    latency: u64,
    lateness: u64,
}

/// A thread and its totals at the last look.
struct Watched {
    plan: Arc<ThreadPlan>,
    meter: Option<Meter>,
    /// Its guarantee was admitted.
    promised: bool,
    seen: Totals,
}

/// The message, and where its figures come from.
pub(super) struct Array {
    threads: Vec<Watched>,
    chains: Vec<WatchedChain>,
    message: DiagnosticArray,
}

const KEYS: [&str; 12] = [
    "policy",
    "CPU",
    "budget (ms)",
    "period (ms)",
    "CPU time in the last second (ms)",
    "level",
    "budget used up",
    "enforcer held up",
    "late callbacks",
    "dropped samples",
    "worst latency (ms)",
    "worst lateness (ms)",
];

impl Array {
    pub(super) fn new(
        program: &str,
        hardware: &str,
        plans: &[Arc<ThreadPlan>],
        live: &Live,
        chains: &Chains,
    ) -> Self {
        let chains: Vec<_> = chains.0.iter().map(WatchedChain::new).collect();
        let promised = |name: &str| {
            let mut posts = live.posts.iter();
            posts.any(|post| *post.name == *name && post.is_promised())
        };
        let threads = plans.iter().map(|plan| Watched {
            plan: Arc::clone(plan),
            meter: None,
            promised: promised(&plan.name),
            seen: Totals::default(),
        });
        let status = plans.iter().map(|plan| {
            let name = format_args!("{program}: {}", plan.name);
            roomy(name, hardware, &KEYS)
        });
        let message = DiagnosticArray {
            header: Header::default(),
            status: status
                .chain(chains.iter().map(|c| c.status(program, hardware)))
                .collect(),
        };
        Self {
            threads: threads.collect(),
            chains,
            message,
        }
    }

    /// Bytes of the message, at most.
    pub(super) const fn most(statuses: usize) -> usize {
        128 + statuses * STATUS
    }

    /// The state now, and what has happened since the last call. Does not allocate.
    pub(super) fn at(
        &mut self,
        now: Time,
        handles: &[(Arc<str>, Arc<HandleState>)],
        middleware: &dyn Middleware,
    ) -> &DiagnosticArray {
        self.message.header.stamp = now;
        for (thread, status) in self.threads.iter_mut().zip(&mut self.message.status) {
            thread.say(status, handles, middleware);
        }
        let behind = self.message.status.iter_mut().skip(self.threads.len());
        for (chain, status) in self.chains.iter_mut().zip(behind) {
            chain.say(status);
        }
        &self.message
    }
}

impl Watched {
    fn say(
        &mut self,
        status: &mut DiagnosticStatus,
        handles: &[(Arc<str>, Arc<HandleState>)],
        middleware: &dyn Middleware,
    ) {
        if self.meter.is_none() {
            self.meter = self.plan.meter();
        }
        let usage = self.meter.as_ref().map(Meter::usage).unwrap_or_default();
        let mut totals = Totals {
            cpu: usage.cpu_high.saturating_add(usage.cpu_low),
            exhaustions: usage.exhaustions,
            stalls: self.meter.as_ref().map_or(0, Meter::stalls),
            ..Totals::default()
        };
        let mut worst = Worst::default();
        let own = handles
            .iter()
            .filter(|(worker, _)| **worker == *self.plan.name);
        own.for_each(|(_, handle)| totals.add(&handle.stats(middleware), &mut worst));
        let new = totals.since(&self.seen);
        self.seen = totals;
        self.judge(&new, status);
        let Some([policy, cpu, budget, period, used, level, rest @ ..]) = status.values.get_mut(..)
        else {
            return;
        };
        match &*self.plan.ready.lock() {
            Some(Ok(ready)) => value(policy, format_args!("{}", ready.granted)),
            _ => value(policy, format_args!("-")),
        }
        match self.plan.cpu {
            Some(number) => value(cpu, format_args!("{number}")),
            None => value(cpu, format_args!("any")),
        }
        if let Policy::Sporadic(params) = &self.plan.policy {
            value(budget, format_args!("{}", Ms(params.budget())));
            value(period, format_args!("{}", Ms(params.period())));
            let name = if usage.low { "background" } else { "high" };
            value(level, format_args!("{name}"));
        } else {
            for none in [budget, period, level] {
                value(none, format_args!("-"));
            }
        }
        value(used, format_args!("{}", Ms(new.cpu)));
        let counts = [
            totals.exhaustions,
            totals.stalls,
            totals.late,
            totals.dropped,
        ];
        for (pair, count) in rest.iter_mut().zip(counts) {
            value(pair, format_args!("{count}"));
        }
        let worst = [worst.latency, worst.lateness];
        for (pair, time) in rest.iter_mut().skip(counts.len()).zip(worst) {
            value(pair, format_args!("{}", Ms(time)));
        }
    }

    /// Level and message.
    fn judge(&self, new: &Totals, status: &mut DiagnosticStatus) {
        let late = if self.promised { ERROR } else { WARN };
        let of_what = if self.promised {
            " under a guarantee"
        } else {
            ""
        };
        let findings = [
            (ERROR, new.panics, "handles stopped by a panic", ""),
            (late, new.late, "callbacks late", of_what),
            (ERROR, new.stalls, "times the enforcer was held up", ""),
            (WARN, new.exhaustions, "times the budget was used up", ""),
            (WARN, new.dropped, "samples dropped", ""),
            (WARN, new.errors, "callbacks failed", ""),
        ];
        status.level = OK;
        status.message.clear();
        for (level, count, text, more) in findings.iter().filter(|(_, count, ..)| *count > 0) {
            status.level = status.level.max(*level);
            join(
                &mut status.message,
                MESSAGE,
                format_args!("{count} {text}{more}"),
            );
        }
        if status.level == OK {
            status.message.push_str("ok");
        }
    }
}

impl Totals {
    fn add(&mut self, stats: &HandleStats, worst: &mut Worst) {
        self.late += stats.deadline_misses;
        self.dropped += stats.dropped.saturating_add(stats.lost);
        self.errors += stats.errors;
        self.panics += u64::from(stats.panicked);
        worst.latency = worst.latency.max(stats.worst_latency);
        worst.lateness = worst.lateness.max(stats.worst_lateness);
    }

    /// A handle that was removed takes its counts with it.
    fn since(&self, seen: &Self) -> Self {
        Self {
            cpu: self.cpu.saturating_sub(seen.cpu),
            exhaustions: self.exhaustions.saturating_sub(seen.exhaustions),
            stalls: self.stalls.saturating_sub(seen.stalls),
            late: self.late.saturating_sub(seen.late),
            dropped: self.dropped.saturating_sub(seen.dropped),
            errors: self.errors.saturating_sub(seen.errors),
            panics: self.panics.saturating_sub(seen.panics),
        }
    }
}

/// The program's name and the host's, cut where they are long.
pub(super) fn names() -> (String, String) {
    let program = std::env::args_os().next().map(std::path::PathBuf::from);
    let program = program.as_deref().and_then(|p| p.file_name());
    let program = program.map_or_else(String::new, |p| p.to_string_lossy().into_owned());
    let host = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let cut = |text: &str| {
        let mut short = with_room(64);
        put(&mut short, 64, format_args!("{}", text.trim()));
        short
    };
    (cut(&program), cut(&host))
}

/// The quiet name of a thing that could not be made.
pub(super) fn refusal(topic: &str, why: &dyn core::fmt::Display) -> String {
    format!("{topic} is not published: {why}")
}
