//! The metrics: their names, and where each value stands in a recording.

use super::chains::of_chains;
use super::follow::{BUCKETS, Counts, Follower};
use super::text::{Labels, Text, seconds};
use crate::live::{Found, Program};
use replenish_recorder::{Role, ThreadView};
use std::collections::BTreeMap;

/// The events that handles count.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Span {
    /// The events that a recording holds at one look: fewer at the next look, perhaps, so gauges.
    Recording,
    /// All that were followed from look to look: counters.
    Followed,
}

/// A metric of workers: name, kind, unit, help, value; `None` leaves the worker out.
type OfWorker = (
    &'static str,
    &'static str,
    &'static str,
    &'static str,
    fn(&ThreadView) -> Option<String>,
);

const WORKERS: [OfWorker; 8] = [
    (
        "cpu_seconds",
        "counter",
        "seconds",
        "CPU time of the worker, at both levels.",
        |t| Some(seconds(t.totals.high.saturating_add(t.totals.low))),
    ),
    (
        "background_cpu_seconds",
        "counter",
        "seconds",
        "The part of its CPU time at background priority.",
        |t| Some(seconds(t.totals.low)),
    ),
    (
        "budget_seconds",
        "gauge",
        "seconds",
        "CPU time that the worker may use in each period.",
        |t| t.budget.map(|(budget, _)| seconds(budget)),
    ),
    (
        "period_seconds",
        "gauge",
        "seconds",
        "Period of the worker's budget.",
        |t| t.budget.map(|(_, period)| seconds(period)),
    ),
    (
        "available_seconds",
        "gauge",
        "seconds",
        "Budget that is left.",
        |t| t.budget.map(|_| seconds(t.totals.available)),
    ),
    (
        "background",
        "gauge",
        "",
        "1 while the worker's budget is used up and it has background priority.",
        |t| t.budget.map(|_| u8::from(t.totals.is_low).to_string()),
    ),
    (
        "exhaustions",
        "counter",
        "",
        "How often the budget ran out.",
        |t| t.budget.map(|_| t.totals.exhaustions.to_string()),
    ),
    (
        "replenishments",
        "counter",
        "",
        "How often budget came back.",
        |t| t.budget.map(|_| t.totals.replenishments.to_string()),
    ),
];

/// A count of handles: name, help, value.
type OfHandle = (&'static str, &'static str, fn(&Counts) -> u64);

const HANDLES: [OfHandle; 4] = [
    ("executions", "Callbacks that have ended.", |c| c.executions),
    (
        "misses",
        "Callbacks that ended after their deadline.",
        |c| c.misses,
    ),
    ("drops", "Samples that found no room.", |c| c.drops),
    ("panics", "Callbacks that panicked.", |c| c.panics),
];

/// A program with the labels of its series.
struct Labelled<'a> {
    program: &'a Program,
    pid: String,
    /// Of each handle, by worker and name.
    handles: BTreeMap<(String, String), Counts>,
}

impl<'a> Labelled<'a> {
    fn of(program: &'a Program, follower: &Follower) -> Self {
        Self {
            program,
            pid: program.view.pid.to_string(),
            handles: handles(program, follower),
        }
    }

    fn name(&self) -> &str {
        &self.program.view.program
    }

    fn labels(&self) -> [(&str, &str); 2] {
        [("program", self.name()), ("pid", &self.pid)]
    }

    fn workers(&self) -> impl Iterator<Item = &ThreadView> {
        let threads = self.program.view.threads.iter();
        threads.filter(|t| t.role == Role::Worker)
    }
}

/// Counts of handles by worker and name. The dispatcher records drops: they go to the worker that
/// ran the handle, otherwise to the one whose name the handle's id begins with.
fn handles(program: &Program, follower: &Follower) -> BTreeMap<(String, String), Counts> {
    let Some(counted) = follower.counted(program) else {
        return BTreeMap::new();
    };
    let names = program.view.names(&program.source);
    let thread = |n: usize| program.view.threads.get(n);
    let is_worker = |n: usize| thread(n).is_some_and(|t| t.role == Role::Worker);
    let by_id = |id: &str| {
        let worker = id.split_once('/')?.0;
        let mut threads = program.view.threads.iter();
        threads.position(|t| t.role == Role::Worker && t.name == worker)
    };
    let mut owners = BTreeMap::new();
    for key in counted.handles.keys().filter(|key| is_worker(key.thread)) {
        owners.insert(key.name, key.thread);
    }
    let mut all: BTreeMap<(String, String), Counts> = BTreeMap::new();
    for (key, counts) in &counted.handles {
        let name = usize::try_from(key.name).ok();
        let name = name.and_then(|n| names.get(n)?.clone());
        let Some((_, name)) = name else { continue };
        let owner = if is_worker(key.thread) {
            Some(key.thread)
        } else {
            owners.get(&key.name).copied().or_else(|| by_id(&name))
        };
        let worker = owner.and_then(thread).map(|t| t.name.clone());
        let sum = all.entry((worker.unwrap_or_default(), name)).or_default();
        sum.executions += counts.executions;
        sum.misses += counts.misses;
        sum.drops += counts.drops;
        sum.panics += counts.panics;
        sum.sum = sum.sum.saturating_add(counts.sum);
        for (to, from) in sum.responses.iter_mut().zip(counts.responses) {
            *to += from;
        }
    }
    all
}

/// The text of all metrics.
pub(super) fn all(found: &Found, follower: &Follower, span: Span) -> String {
    let programs: Vec<Labelled<'_>> = found
        .programs
        .iter()
        .map(|program| Labelled::of(program, follower))
        .collect();
    let mut text = Text::default();
    let help = "Recordings of this host that could not be read.";
    text.family("replenish_recordings_left_out", "gauge", "", help);
    text.sample("", &[], &found.warnings.len().to_string());
    of_programs(&programs, follower, span, &mut text);
    of_workers(&programs, &mut text);
    of_handles(&programs, span, &mut text);
    let chains = programs
        .iter()
        .map(|p| (p.labels(), &*p.program.view.chains));
    of_chains(&chains.collect::<Vec<_>>(), &mut text);
    text.end()
}

fn of_programs(programs: &[Labelled<'_>], follower: &Follower, span: Span, text: &mut Text) {
    let mut family = |name, kind, unit, help, value: &dyn Fn(&Program) -> String| {
        text.family(name, kind, unit, help);
        for program in programs {
            if text.is_new(&program.labels()) {
                let suffix = if kind == "counter" { "_total" } else { "" };
                text.sample(suffix, &program.labels(), &value(program.program));
            }
        }
    };
    let help = "1 while the program runs.";
    let up = |p: &Program| u8::from(p.alive).to_string();
    family("replenish_program_up", "gauge", "", help, &up);
    let (name, help) = (
        "replenish_program_start_time_seconds",
        "When the program's executor started, since 1970.",
    );
    let start = |p: &Program| seconds(p.view.clocks.realtime);
    family(name, "gauge", "seconds", help, &start);
    let help = "Dumps that the program has written.";
    let dumps = |p: &Program| p.view.dumps.to_string();
    family("replenish_program_dumps", "counter", "", help, &dumps);
    let (name, help) = (
        "replenish_program_dumps_suppressed",
        "Triggers of dumps that got none.",
    );
    let suppressed = |p: &Program| p.view.dumps_suppressed.to_string();
    family(name, "counter", "", help, &suppressed);
    if span == Span::Followed {
        let (name, help) = (
            "replenish_program_missed_events",
            "Events that were overwritten before they were counted: handles did more than is said.",
        );
        let missed = |p: &Program| follower.counted(p).map_or(0, |c| c.missed).to_string();
        family(name, "counter", "", help, &missed);
    }
}

fn of_workers(programs: &[Labelled<'_>], text: &mut Text) {
    let help = "The worker's CPU, empty if it is not pinned, and its policy as granted.";
    text.family("replenish_worker", "info", "", help);
    for program in programs {
        for worker in program.workers() {
            let [name, pid] = program.labels();
            let labels = [name, pid, ("worker", &worker.name)];
            let cpu = worker.cpu.map_or(String::new(), |cpu| cpu.to_string());
            let more = [("cpu", cpu.as_str()), ("policy", &worker.policy)];
            if text.is_new(&labels) {
                text.sample("_info", &[&labels[..], &more].concat(), "1");
            }
        }
    }
    for (name, kind, unit, help, value) in WORKERS {
        text.family(&format!("replenish_worker_{name}"), kind, unit, help);
        let suffix = if kind == "counter" { "_total" } else { "" };
        for program in programs {
            for worker in program.workers() {
                let [name, pid] = program.labels();
                let labels = [name, pid, ("worker", &worker.name)];
                // The first worker of a name counts, in each family.
                let value = value(worker);
                if text.is_new(&labels)
                    && let Some(value) = value
                {
                    text.sample(suffix, &labels, &value);
                }
            }
        }
    }
}

fn of_handles(programs: &[Labelled<'_>], span: Span, text: &mut Text) {
    let (prefix, kind, suffix) = match span {
        Span::Recording => ("replenish_handle_recorded", "gauge", ""),
        Span::Followed => ("replenish_handle", "counter", "_total"),
    };
    for (name, help, value) in HANDLES {
        text.family(&format!("{prefix}_{name}"), kind, "", help);
        each(programs, text, |labels, counts, text| {
            text.sample(suffix, labels, &value(counts).to_string());
        });
    }
    let (kind, count, sum) = match span {
        Span::Recording => ("gaugehistogram", "_gcount", "_gsum"),
        Span::Followed => ("histogram", "_count", "_sum"),
    };
    let help = "From release to the end of the callback.";
    text.family(&format!("{prefix}_response_seconds"), kind, "seconds", help);
    each(programs, text, |labels, counts, text| {
        let mut below = 0;
        for (own, (_, bound)) in counts.responses.iter().zip(BUCKETS) {
            below += own;
            let labels = [labels, &[("le", bound)]].concat();
            text.sample("_bucket", &labels, &below.to_string());
        }
        text.sample(count, labels, &below.to_string());
        text.sample(sum, labels, &seconds(counts.sum));
    });
}

/// Each handle once, with its labels.
fn each(
    programs: &[Labelled<'_>],
    text: &mut Text,
    mut write: impl FnMut(&Labels<'_>, &Counts, &mut Text),
) {
    for program in programs {
        for ((worker, handle), counts) in &program.handles {
            let [name, pid] = program.labels();
            let labels = [name, pid, ("worker", worker), ("handle", handle)];
            if text.is_new(&labels) {
                write(&labels, counts, text);
            }
        }
    }
}
