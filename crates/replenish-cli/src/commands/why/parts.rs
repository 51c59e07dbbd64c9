//! A late callback's response taken apart: every nanosecond of it belongs to one cause.
//!
//! ```text
//!   release                                                                          end
//!      │ worker waits │ runnable, no CPU │ other callbacks │ its callback │ off CPU … │
//!      │ released_late│ preempted,       │ waited_behind   │ own_execution│ preempted,│
//!      │              │ no_budget        │                 │              │ no_budget, blocked
//! ```
//!
//! For a worker with a budget the enforcer has the kernel's switch records. For others the CPU
//! clock says how long a callback was off the CPU, and the recordings of the other workers of that
//! CPU say whose time that was.

use crate::live::timeline::{Late, Stretch, Timeline, within};
use std::collections::BTreeMap;

/// A cause of lateness.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Cause {
    /// The release had come, and nobody had told the worker yet.
    ReleasedLate,
    /// Another callback of the worker, or of the group, had its turn.
    WaitedBehind,
    /// The callback itself, on the CPU.
    OwnExecution,
    /// The worker's budget was used up, and others had the CPU.
    NoBudget,
    /// The worker wanted the CPU, and another thread had it.
    Preempted,
    /// The callback waited for something.
    Blocked,
    /// The thread had the CPU, and its CPU clock stood still.
    Stolen,
    /// The worker's own way between callbacks.
    Executor,
}

impl Cause {
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::ReleasedLate => "released_late",
            Self::WaitedBehind => "waited_behind",
            Self::OwnExecution => "own_execution",
            Self::NoBudget => "no_budget",
            Self::Preempted => "preempted",
            Self::Blocked => "blocked",
            Self::Stolen => "stolen",
            Self::Executor => "executor",
        }
    }
}

/// The party that had the time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum By {
    /// No other thread.
    Nobody,
    /// A handle of the late callback's program.
    Handle(u32),
    /// A thread, and the handle whose callback it ran; 0 for none.
    Thread(usize, u32),
    /// A thread that nobody records.
    Unrecorded,
    /// Unknown whether the callback waited, or an unrecorded thread ran.
    Unknown,
    /// An unknown party, after this publication or mark of the late callback.
    After(u32),
}

/// Time by cause and party.
pub(super) type Parts = BTreeMap<(Cause, By), u64>;

/// CPU time that is missing from a clock reading counts from here on, in ns: switch records and
/// clock readings are taken some microseconds apart.
const NOTICED: u64 = 50_000;

/// Takes apart the response of a late callback of thread `of`.
pub(super) fn take_apart(threads: &[Timeline], of: usize, late: &Late) -> Parts {
    let mut parts = Parts::new();
    let Some(own) = threads.get(of) else {
        return parts;
    };
    let whole = late.response;
    let others: Vec<(usize, &Timeline)> = threads
        .iter()
        .enumerate()
        .filter(|(n, t)| *n != of && t.facts.cpu.is_some() && t.facts.cpu == own.facts.cpu)
        .collect();
    let mut cuts = vec![whole.from, whole.to];
    changes(own, whole, &mut cuts);
    others
        .iter()
        .for_each(|(_, t)| changes(t, whole, &mut cuts));
    cuts.sort_unstable();
    cuts.dedup();
    for (from, to) in cuts.iter().zip(cuts.iter().skip(1)) {
        let part = classify(own, &others, late, *from);
        *parts.entry(part).or_default() += to - from;
    }
    if own.exact {
        stolen(own, whole, &mut parts);
    } else {
        off_by_clock(own, &others, late, &mut parts);
    }
    parts
}

/// Every moment in `whole` at which something changes.
fn changes(thread: &Timeline, whole: Stretch, cuts: &mut Vec<u64>) {
    let mut add = |time: u64| {
        if whole.covers(time) {
            cuts.push(time);
        }
    };
    let mut both = |stretch: Stretch| {
        add(stretch.from);
        add(stretch.to);
    };
    let slices = within(&thread.slices, whole).map(|s| s.time);
    let offs = within(&thread.offs, whole).map(|o| o.time);
    let queues = within(&thread.queues, whole).map(|q| q.time);
    let low = within(&thread.low, whole).copied();
    let all = slices.chain(offs).chain(queues).chain(low);
    all.for_each(&mut both);
    let first = thread.waits.partition_point(|w| w.awake <= whole.from);
    let waits = thread.waits.iter().skip(first);
    for wait in waits.take_while(|w| w.time.from < whole.to) {
        both(wait.time);
        both(Stretch {
            from: wait.awake,
            to: wait.awake,
        });
    }
}

fn classify(own: &Timeline, others: &[(usize, &Timeline)], late: &Late, time: u64) -> (Cause, By) {
    let wait = own.wait_at(time);
    if wait.is_some_and(|wait| wait.time.covers(time)) {
        return (Cause::ReleasedLate, By::Nobody);
    }
    let slice = own.slice_at(time);
    let runnable = wait.is_some_and(|wait| time < wait.awake);
    let wants_cpu = || match own.low_at(time) {
        Some(_) => (Cause::NoBudget, By::Nobody),
        None => (Cause::Preempted, runner(own, others, time)),
    };
    if let Some(off) = own.off_at(time) {
        if !off.blocked || runnable {
            return wants_cpu();
        }
        let suspended = own.low_at(time).is_some_and(|low| off.time.from >= low);
        if let Some(queue) = own.queue_at(time) {
            return (Cause::WaitedBehind, handle(queue.holder));
        }
        return match slice {
            _ if suspended => (Cause::NoBudget, By::Nobody),
            Some(slice) if is_late(slice.handle, slice.time, late) => {
                (Cause::Blocked, before(own, slice.time.from, time))
            }
            Some(slice) => (Cause::WaitedBehind, handle(slice.handle)),
            None => (Cause::Blocked, By::Nobody),
        };
    }
    if runnable && !own.exact {
        return wants_cpu();
    }
    if let Some(queue) = own.queue_at(time) {
        return (Cause::WaitedBehind, handle(queue.holder));
    }
    match slice {
        Some(slice) if is_late(slice.handle, slice.time, late) => (Cause::OwnExecution, By::Nobody),
        Some(slice) => (Cause::WaitedBehind, handle(slice.handle)),
        None => (Cause::Executor, By::Nobody),
    }
}

fn is_late(handle: u32, slice: Stretch, late: &Late) -> bool {
    handle == late.handle && slice.to == late.response.to
}

fn handle(id: u32) -> By {
    match id {
        0 => By::Nobody,
        id => By::Handle(id),
    }
}

/// The last publication or mark of the callback before this moment.
fn before(own: &Timeline, from: u64, time: u64) -> By {
    let points = own.points.iter().rev();
    let mut points = points.skip_while(|(at, ..)| *at > time);
    match points.next() {
        Some((at, _, name)) if *at >= from => By::After(*name),
        _ => By::Nobody,
    }
}

/// The thread that has this CPU: one with switch records before one that is only awake, the
/// highest priority first.
fn runner(own: &Timeline, others: &[(usize, &Timeline)], time: u64) -> By {
    let may = |t: &Timeline| t.exact || t.facts.priority > own.facts.priority;
    let running = others.iter().filter(|(_, t)| may(t) && t.runs_at(time));
    let first = running.max_by_key(|(_, t)| (t.exact, t.facts.priority));
    match first {
        Some((n, t)) => By::Thread(*n, t.slice_at(time).map_or(0, |s| s.handle)),
        None => By::Unrecorded,
    }
}

/// Moves time in which the thread had the CPU and its clock stood still.
fn stolen(own: &Timeline, whole: Stretch, parts: &mut Parts) {
    let mut stolen = 0;
    let readings = own.used.partition_point(|(time, _)| *time <= whole.from);
    let readings = own.used.iter().skip(readings.saturating_sub(1));
    for (first, second) in readings.clone().zip(readings.skip(1)) {
        if first.0 >= whole.to {
            break;
        }
        let between = Stretch {
            from: first.0,
            to: second.0,
        };
        let ours = Stretch {
            from: between.from.max(whole.from),
            to: between.to.min(whole.to),
        };
        if ours.from >= ours.to {
            continue;
        }
        let missing = own
            .on_cpu(between)
            .saturating_sub(second.1.saturating_sub(first.1));
        if missing >= NOTICED {
            stolen = missing.min(own.on_cpu(ours)).saturating_add(stolen);
        }
    }
    let on_cpu = |cause: Cause| {
        matches!(
            cause,
            Cause::OwnExecution | Cause::WaitedBehind | Cause::Executor
        )
    };
    move_to(parts, (Cause::Stolen, By::Nobody), stolen, on_cpu);
}

/// Moves up to so much from the largest of some parts to another one.
fn move_to(parts: &mut Parts, to: (Cause, By), mut amount: u64, from: impl Fn(Cause) -> bool) {
    while amount > 0 {
        let largest = parts.iter_mut().filter(|((cause, _), _)| from(*cause));
        let Some((_, largest)) = largest.max_by_key(|(_, time)| **time) else {
            return;
        };
        let some = amount.min(*largest);
        if some == 0 {
            return;
        }
        *largest -= some;
        amount -= some;
        *parts.entry(to).or_default() += some;
    }
}

/// Without switch records: the part of the callback in which its CPU clock stood still was the time
/// of the others that wanted the CPU more, or of nobody knows whom.
fn off_by_clock(own: &Timeline, others: &[(usize, &Timeline)], late: &Late, parts: &mut Parts) {
    let mut slices = within(&own.slices, late.response);
    let Some(slice) = slices.find(|s| is_late(s.handle, s.time, late)) else {
        return;
    };
    let Stretch { from, to } = slice.time;
    let n = own.used.partition_point(|(time, _)| *time < to);
    let before = own
        .used
        .iter()
        .take(n)
        .rev()
        .find(|(time, _)| *time <= from);
    let (Some((begun, first)), Some((ended, second))) = (before, own.used.get(n)) else {
        return;
    };
    let between = Stretch {
        from: *begun,
        to: *ended,
    };
    let rest = within(&own.slices, between).filter(|s| s.time != slice.time);
    let rest = rest
        .map(|s| s.time.common(between))
        .fold(0, u64::saturating_add);
    let used = second.saturating_sub(*first).saturating_sub(rest);
    let mut off = to.saturating_sub(from).saturating_sub(used);
    if off < NOTICED {
        return;
    }
    let own_time = |cause: Cause| cause == Cause::OwnExecution;
    let mut above: Vec<_> = others.to_vec();
    above.retain(|(_, t)| t.exact || t.facts.priority > own.facts.priority);
    above.sort_by_key(|(_, t)| std::cmp::Reverse(t.facts.priority));
    for (n, thread) in above {
        for theirs in within(&thread.slices, slice.time) {
            let had = match theirs.time.common(slice.time) {
                0 => continue,
                _ if thread.exact => thread.on_cpu(Stretch {
                    from: theirs.time.from.max(from),
                    to: theirs.time.to.min(to),
                }),
                common => common,
            };
            let some = had.min(off);
            off -= some;
            move_to(
                parts,
                (Cause::Preempted, By::Thread(n, theirs.handle)),
                some,
                own_time,
            );
        }
    }
    move_to(parts, (Cause::Blocked, By::Unknown), off, own_time);
}

/// The causes to name: the fewest without which the deadline would have been met, the largest
/// first. Its own execution is one only if it is longer than the deadline.
pub(super) fn named(parts: &BTreeMap<Cause, u64>, deadline: u64) -> Vec<Cause> {
    let response: u64 = parts.values().sum();
    let lateness = response.saturating_sub(deadline);
    let own = parts.get(&Cause::OwnExecution).copied().unwrap_or(0);
    let excess = own.saturating_sub(deadline);
    let mut named = Vec::new();
    if excess > 0 {
        named.push((own, Cause::OwnExecution));
    }
    let rest = parts
        .iter()
        .filter(|(cause, _)| **cause != Cause::OwnExecution);
    let mut rest: Vec<(u64, Cause)> = rest.map(|(cause, time)| (*time, *cause)).collect();
    rest.sort_unstable_by(|a, b| b.cmp(a));
    let mut left = lateness.saturating_sub(excess);
    for (time, cause) in rest {
        if left <= lateness / 10 {
            break;
        }
        left = left.saturating_sub(time);
        named.push((time, cause));
    }
    named.sort_unstable_by(|a, b| b.cmp(a));
    named.into_iter().map(|(_, cause)| cause).collect()
}
