//! The change that would help, with a value that `plan` accepts.

use super::parts::{By, Cause, Parts};
use super::recorded::Recorded;
use crate::live::timeline::{Late, Stretch, Timeline, within};
use crate::outcome::Failure;
use crate::time::Nanos;
use replenish_os::{affinity, current_tid};
use replenish_plan::span::Exact;
use replenish_plan::{Deployment, Guarantee, Machine, Request, Requirement, Worker, plan};
use std::collections::BTreeMap;
use std::path::Path;
use std::time::Duration;

/// Budgets are proposed in steps of this.
const STEP: Nanos = 100_000;
/// Above what was seen, in percent.
const MARGIN: u64 = 10;

/// Most threads of recordings that are planned: the effort grows with their square.
const PLANNED: usize = 64;

/// Asks `plan`.
pub(super) struct Planner {
    file: Option<Request>,
    /// The answers so far: one plan for all late callbacks of a worker.
    known: BTreeMap<String, String>,
}

/// Of the worker's budget before it ran out: time by handle, the largest first.
pub(super) fn consumers(recorded: &Recorded, n: usize, late: &Late) -> Vec<(String, Nanos)> {
    let Some(thread) = recorded.threads.get(n) else {
        return Vec::new();
    };
    let Some((_, period)) = thread.facts.budget else {
        return Vec::new();
    };
    let low = within(&thread.low, late.response).next();
    let Some(empty) = low.map(|low| low.from) else {
        return Vec::new();
    };
    let window = Stretch {
        from: empty.saturating_sub(period),
        to: empty,
    };
    let mut used: BTreeMap<u32, Nanos> = BTreeMap::new();
    for slice in within(&thread.slices, window) {
        let part = Stretch {
            from: slice.time.from.max(window.from),
            to: slice.time.to.min(window.to),
        };
        let used = used.entry(slice.handle).or_default();
        *used = used.saturating_add(thread.on_cpu(part));
    }
    let mut used: Vec<(u32, Nanos)> = used.into_iter().collect();
    used.sort_by_key(|(_, time)| std::cmp::Reverse(*time));
    used.into_iter()
        .map(|(id, time)| (recorded.name(n, id), time))
        .collect()
}

/// The most CPU time that callbacks of the worker took in any period, by their releases.
fn need(thread: &Timeline, period: Nanos) -> Nanos {
    let closed = thread.slices.iter().filter(|s| s.time.to != u64::MAX);
    let mut jobs: Vec<(u64, Nanos)> = closed.map(|s| (s.release, thread.on_cpu(s.time))).collect();
    jobs.sort_unstable();
    let (mut first, mut sum, mut most) = (0, 0_u64, 0);
    for (release, time) in &jobs {
        sum = sum.saturating_add(*time);
        while let Some((oldest, time)) = jobs.get(first)
            && release.saturating_sub(*oldest) >= period
        {
            sum = sum.saturating_sub(*time);
            first += 1;
        }
        most = most.max(sum);
    }
    most
}

fn with_margin(time: Nanos) -> Nanos {
    (time.saturating_mul(100 + MARGIN) / 100)
        .div_ceil(STEP)
        .max(1)
        * STEP
}

fn guaranteed(budget: Nanos, period: Nanos) -> Requirement {
    let [budget, period] = [budget, period].map(Duration::from_nanos);
    Requirement::Guarantee(Guarantee::of(budget).every(period))
}

impl Planner {
    /// With the workers of a deployment file, or with those of the recording.
    pub(super) fn new(file: Option<&Path>) -> Result<Self, Failure> {
        let file = match file {
            Some(path) => Some(Deployment::read(path).map_err(Failure::refused)?.request()),
            None => None,
        };
        Ok(Self {
            file,
            known: BTreeMap::new(),
        })
    }

    /// The proposed change as a sentence; lines of the deployment file stand in back quotes.
    pub(super) fn change(
        &mut self,
        recorded: &Recorded,
        n: usize,
        late: &Late,
        causes: &[Cause],
        parts: &Parts,
    ) -> String {
        let (Some(thread), Some(first)) = (recorded.threads.get(n), causes.first()) else {
            return String::new();
        };
        let most = parts.iter().filter(|((cause, _), _)| cause == first);
        let most = most.max_by_key(|(_, time)| **time).map(|((_, by), _)| *by);
        let key = format!("{n} {} {first:?} {most:?}", late.handle);
        if let Some(known) = self.known.get(&key) {
            return known.clone();
        }
        let change = match (first, most) {
            (Cause::NoBudget, _) => self.budget(recorded, thread),
            (Cause::WaitedBehind, Some(By::Handle(other))) => {
                let name = recorded.name(n, other);
                let own = recorded.name(n, late.handle);
                self.apart(recorded, thread, late.handle, &own, &name)
            }
            (Cause::Preempted, Some(By::Thread(other, _))) => {
                let other = recorded.threads.get(other).map_or("", |t| &*t.facts.name);
                self.elsewhere(recorded, thread, other)
            }
            (Cause::OwnExecution, _) => format!(
                "The callback alone takes longer than its deadline: make it shorter, or allow it a \
                 deadline of {} or more.",
                Exact(with_margin(longest(thread, late.handle)))
            ),
            (Cause::Blocked, _) => "The callback waits for something: move the wait out of it; no \
                                    line of the deployment file helps."
                .into(),
            (Cause::ReleasedLate, _) => "The dispatcher was late: `[executor] policy = { kind = \
                                         \"fifo\", priority = … }` above the threads of its CPU, or \
                                         another `cpu` for it."
                .into(),
            (Cause::Stolen, _) => "The hypervisor, or the machine's firmware, took the time: no \
                                   line of the deployment file helps."
                .into(),
            (Cause::Preempted, _) => "A thread outside of replenish had the CPU: `replenish doctor` \
                                      says how to keep a CPU free, a trace of the kernel which it was."
                .into(),
            _ => "No change of the deployment file helps.".into(),
        };
        self.known.insert(key, change.clone());
        change
    }

    /// Everything that is to be planned.
    fn request(&self, recorded: &Recorded) -> Request {
        if let Some(file) = &self.file {
            return file.clone();
        }
        let cpus = affinity(current_tid()).map(|set| set.iter().collect());
        let mut request = Request::new(Machine::on_cpus(cpus.unwrap_or_else(|_| vec![0])));
        for thread in recorded.threads.iter().take(PLANNED) {
            if let Some((budget, period)) = thread.facts.budget {
                let mut worker = Worker::guaranteed(
                    thread.facts.name.clone(),
                    Guarantee::of(Duration::from_nanos(budget)).every(Duration::from_nanos(period)),
                );
                worker.cpu = thread.facts.cpu.and_then(|cpu| usize::try_from(cpu).ok());
                request.workers.push(worker);
            }
        }
        request
    }

    /// More budget: as much as was needed, or the most that is accepted.
    fn budget(&self, recorded: &Recorded, thread: &Timeline) -> String {
        let Some((budget, period)) = thread.facts.budget else {
            return String::new();
        };
        let name = &thread.facts.name;
        let mut request = self.request(recorded);
        let Some(at) = request.workers.iter().position(|w| w.name == *name) else {
            return format!("The deployment file has no worker {name:?}.");
        };
        let mut accepts = |budget: Nanos| {
            if let Some(worker) = request.workers.get_mut(at) {
                worker.scheduling = guaranteed(budget, period);
            }
            plan(&request).is_ok()
        };
        let wanted = with_margin(need(thread, period)).max(budget.saturating_add(STEP));
        let line = |budget: Nanos| {
            format!(
                "`guarantee = {{ budget = \"{}\", period = \"{}\" }}` at worker {name}",
                Exact(budget),
                Exact(period)
            )
        };
        if wanted <= period && accepts(wanted) {
            return format!("{}: `plan` accepts it.", line(wanted));
        }
        // The most that is accepted; `plan` refuses everything above.
        let (mut low, mut high) = (budget / STEP, wanted.min(period) / STEP);
        while low < high {
            let middle = low + (high - low).div_ceil(2);
            if accepts(middle * STEP) {
                low = middle;
            } else {
                high = middle - 1;
            }
        }
        let wanted = Exact(wanted);
        if low * STEP > budget {
            format!(
                "{}: `plan` accepts no more; its callbacks took {wanted} of every {} with a margin.",
                line(low * STEP),
                Exact(period)
            )
        } else {
            format!(
                "Its callbacks need {wanted} in every {}, and `plan` accepts no more than it has: \
                 take work away from it, or a reservation from another worker.",
                Exact(period)
            )
        }
    }

    /// A worker of its own.
    fn apart(
        &self,
        recorded: &Recorded,
        thread: &Timeline,
        handle: u32,
        own: &str,
        other: &str,
    ) -> String {
        let mut releases: Vec<u64> = thread
            .slices
            .iter()
            .filter(|s| s.handle == handle)
            .map(|s| s.release)
            .collect();
        releases.sort_unstable();
        releases.dedup();
        let gaps = releases
            .iter()
            .zip(releases.iter().skip(1))
            .map(|(a, b)| b - a);
        let advice = format!("A worker of its own for {own}, which waited behind {other}");
        let Some(period) = gaps
            .min()
            .map(|gap| gap / STEP * STEP)
            .filter(|gap| *gap > 0)
        else {
            return format!("{advice}.");
        };
        let budget = with_margin(longest(thread, handle)).min(period);
        let mut request = self.request(recorded);
        let name = format!("{}-own", thread.facts.name);
        let mut worker = Worker::guaranteed(
            name.clone(),
            Guarantee::of(Duration::from_nanos(budget)).every(Duration::from_nanos(period)),
        );
        worker.cpu = thread.facts.cpu.and_then(|cpu| usize::try_from(cpu).ok());
        request.workers.push(worker);
        let accepted = |request: &Request| plan(request).is_ok();
        let mut place = worker_line(&name, own, budget, period);
        if !accepted(&request) {
            if let Some(last) = request.workers.last_mut() {
                last.cpu = None;
            }
            if !accepted(&request) {
                return format!(
                    "{advice}; `plan` has no room for {} every {}.",
                    Exact(budget),
                    Exact(period)
                );
            }
        } else if let Some(cpu) = thread.facts.cpu {
            place = format!("{place}, `cpu = {cpu}`");
        }
        format!("{advice}: {place}; `plan` accepts it.")
    }

    /// Another CPU.
    fn elsewhere(&self, recorded: &Recorded, thread: &Timeline, other: &str) -> String {
        let name = &thread.facts.name;
        let request = self.request(recorded);
        let at = request.workers.iter().position(|w| w.name == *name);
        let here = thread.facts.cpu.and_then(|cpu| usize::try_from(cpu).ok());
        for cpu in request
            .machine
            .cpus
            .iter()
            .filter(|cpu| Some(**cpu) != here)
        {
            let mut request = request.clone();
            if let Some(worker) = at.and_then(|at| request.workers.get_mut(at)) {
                worker.cpu = Some(*cpu);
            }
            if plan(&request).is_ok() {
                return format!(
                    "`cpu = {cpu}` at worker {name}, away from {other}: `plan` accepts it."
                );
            }
        }
        format!(
            "Less budget, or a longer deadline, for {other}: `plan` has no other CPU for {name}."
        )
    }
}

fn worker_line(name: &str, handle: &str, budget: Nanos, period: Nanos) -> String {
    format!(
        "`[[worker]]`, `name = \"{name}\"`, `handles = [\"{handle}\"]`, `guarantee = {{ budget = \
         \"{}\", period = \"{}\" }}`",
        Exact(budget),
        Exact(period)
    )
}

/// The longest execution of a handle.
fn longest(thread: &Timeline, handle: u32) -> Nanos {
    let own = thread
        .slices
        .iter()
        .filter(|s| s.handle == handle && s.time.to != u64::MAX);
    own.map(|s| thread.on_cpu(s.time)).max().unwrap_or(0)
}
