//! The kernel's text: each line becomes one change of the state (`changes`).

use super::super::trace_text::{
    handler, hexadecimal, is_of, is_of_a_case, number, on_cpu, rank, time, timer,
};
use super::pieces::Timeline;
use crate::load::Nanos;
use std::collections::{BTreeMap, BTreeSet};

/// A thread that may hold the enforcer's lock is charged for no more than this at once, nor is a
/// worker on its way from a wait to its clock. A larger charge says that its CPU stood still.
const LOOK: Nanos = 100_000;

/// A thread that wakes workers whose priority it has not changed only as it hands a lock over.
const HANDS_OVER: &str = "watchdog-";

/// Called by the timer of a file descriptor: an enforcer's.
const ENFORCERS: &str = "timerfd_tmrproc";
/// Called by the timer of a thread that sleeps. A worker's is set where it expires: it is pinned.
const SLEEPERS: &str = "hrtimer_wakeup";
/// Called by the timer that rings again and again on the CPU under test (`tracefs.rs`).
const TICKS: &str = "perf_swevent_hrtimer";

/// Reads the kernel's text line by line.
#[derive(Debug)]
pub(crate) struct Reader {
    pub(super) cpu: usize,
    pub(super) timeline: Timeline,
    pub(super) now: Option<Current>,
    /// The case's threads that want the CPU: priority, and since when.
    pub(super) ready: BTreeMap<i32, (u8, Nanos)>,
    /// The enforcer, woken since then.
    pub(super) woken: Option<(i64, Nanos)>,
    /// The last line of this CPU was the beginning of a timer's interrupt, then.
    pub(super) expired: Option<Nanos>,
    /// Timers that are set: address and time.
    pub(super) timers: BTreeMap<String, Nanos>,
    /// Charges of threads whose piece has not been read: when, who, how much.
    pub(super) early: Vec<(Nanos, i64, Nanos)>,
    /// Workers that read their CPU clock as soon as they have left a wait.
    pub(super) prompt: Vec<String>,
    /// Of them, those that have been woken, and have not been charged since.
    pub(super) fresh: BTreeSet<i64>,
    /// Threads that were given another priority off the CPU, and have not been woken since: when,
    /// and the number of pieces before that.
    pub(super) given: BTreeMap<i32, (Nanos, usize)>,
    /// Since when the CPU is in the handler of an interrupt, or of a soft interrupt.
    pub(super) handlers: [Option<Nanos>; 2],
}

/// The thread that runs, and where its current piece began.
#[derive(Debug, Clone, Copy)]
pub(super) struct Current {
    pub(super) thread: i32,
    pub(super) rank: u8,
    pub(super) of_a_case: bool,
    pub(super) from: Nanos,
    /// When it got the CPU.
    pub(super) switched: Nanos,
    /// When it gave an inherited priority back.
    pub(super) lowered: Option<Nanos>,
    /// Nothing was charged since it got the CPU.
    pub(super) fresh: bool,
    /// It was given another priority while it ran, before this piece.
    pub(super) changed: Option<usize>,
}

impl Reader {
    pub(crate) fn new(cpu: usize) -> Self {
        Self {
            cpu,
            timeline: Timeline::default(),
            now: None,
            ready: BTreeMap::new(),
            woken: None,
            expired: None,
            timers: BTreeMap::new(),
            early: Vec::new(),
            prompt: Vec::new(),
            fresh: BTreeSet::new(),
            given: BTreeMap::new(),
            handlers: [None; 2],
        }
    }

    /// Workers of these names read their CPU clock as soon as they have left a wait
    /// ([`Case::prompt`](super::super::case::Case::prompt)): a longer first charge says that their
    /// CPU stood still.
    pub(crate) fn with_prompt(mut self, names: Vec<String>) -> Self {
        self.prompt = names;
        self
    }

    /// Takes one line: `comm-123  [001] d..2. 12.345678: sched_switch: prev_comm=…`.
    pub(crate) fn line(&mut self, line: &str) {
        self.note_interrupt(line);
        let head = line.split_once(": ").map_or("", |(head, _)| head);
        let expired = self.expired.take_if(|_| on_cpu(head) == Some(self.cpu));
        if line.contains("[LOST ") {
            self.timeline.lost = true;
        } else if let Some((head, rest)) = line.split_once(": sched_switch: ") {
            if on_cpu(head) == Some(self.cpu)
                && let Some(at) = time(head)
            {
                self.switch(at, rest);
            }
        } else if let Some((head, rest)) = line.split_once(": sched_stat_runtime: ") {
            // Another CPU may have asked for the clock: whose record it is, the thread says.
            if let (Some(at), Some(thread), Some(cpu)) =
                (time(head), number(rest, " pid="), number(rest, " runtime="))
            {
                let cpu = cpu.unsigned_abs();
                if on_cpu(head) == Some(self.cpu) {
                    if is_of(head, thread) {
                        self.note_untraced_switch(at, thread, cpu);
                    }
                    self.note_switch(at, thread, cpu);
                }
                let first = on_cpu(head) == Some(self.cpu) && self.fresh.remove(&thread);
                if cpu > LOOK && (first || self.has_enforcers_lock(rest, thread)) {
                    let since = at.saturating_sub(cpu - LOOK);
                    self.timeline.still.push((since, at));
                }
                self.ran(at, thread, cpu);
            }
        } else if let Some((head, rest)) = line.split_once(": sched_wakeup: ") {
            // It slept, and wants the CPU from now on only.
            let woken = number(rest, " pid=").and_then(|thread| i32::try_from(thread).ok());
            let given = woken.and_then(|thread| self.given.remove(&thread));
            let hands_over = given.is_none() && head.trim_start().starts_with(HANDS_OVER);
            let since = woken.filter(|_| hands_over);
            let since = since.and_then(|thread| self.waited_for_a_lock(thread));
            if let (Some(at), Some(thread), Some(priority), Some(cpu)) = (
                time(head),
                number(rest, " pid="),
                number(rest, " prio="),
                number(rest, " target_cpu="),
            ) && usize::try_from(cpu) == Ok(self.cpu)
                && is_of_a_case(rest.strip_prefix("comm=").unwrap_or(rest))
                // The other CPU's line may come when the thread has run already.
                && self.now.is_none_or(|now| now.switched <= at)
            {
                self.wants(thread, rank(priority), since.unwrap_or(at));
                let comm = rest.strip_prefix("comm=").unwrap_or(rest);
                let comm = comm.split_once(' ').map_or(comm, |(comm, _)| comm);
                // One that is let go on after a suspension is in the middle of a callback.
                let goes_on = ["enforcer", "watchdog"];
                let goes_on = goes_on.iter().any(|by| head.trim_start().starts_with(by));
                if !goes_on && self.prompt.iter().any(|name| name == comm) {
                    self.fresh.insert(thread);
                }
                if rest.starts_with("comm=enforcer") {
                    // By that interrupt, which does nothing else before.
                    self.stood_still(at.saturating_sub(expired.unwrap_or(at)), at);
                    self.woken = Some((thread, at));
                }
            }
        } else if let Some((head, rest)) = line.split_once(": sys_sched_set") {
            // The enforcer gives a thread another priority: `scheduler(pid: 1f, …` or `param(…`.
            let thread = rest.split_once("(pid: ").and_then(|(_, r)| hexadecimal(r));
            if let (Some(at), Some(thread)) = (time(head), thread) {
                self.ready.remove(&thread);
                self.changed(at, thread);
                if self.now.is_none_or(|now| now.thread != thread) {
                    let before = self.timeline.pieces.len();
                    self.given.insert(thread, (at, before));
                }
            }
        } else if let Some((head, rest)) = line.split_once(": hrtimer_start: ") {
            if let (Some((timer, kind)), Some(expires)) = (timer(rest), number(rest, " expires="))
                && (kind == ENFORCERS
                    || kind == TICKS
                    || kind == SLEEPERS && is_of_a_case(head.trim_start()))
            {
                self.timers.insert(timer, expires.unsigned_abs());
            }
        } else if let Some((head, rest)) = line.split_once(": hrtimer_expire_entry: ") {
            if let (Some(at), Some((timer, kind)), Some(now)) =
                (time(head), timer(rest), number(rest, " now="))
                && let Some(expires) = self.timers.remove(&timer)
            {
                // It may stand still between the kernel's look at the time and this record.
                let late = now.unsigned_abs().max(at).saturating_sub(expires);
                self.stood_still(late, at);
                self.expired = (kind == ENFORCERS).then_some(at);
            }
        } else if let Some((soft, begins, head)) = handler(line) {
            if let Some(at) = time(head)
                && on_cpu(head) == Some(self.cpu)
            {
                self.handles(soft, begins, at);
            }
        } else if let Some((head, rest)) = line.split_once(": sched_pi_setprio: ")
            && let (Some(at), Some(thread), Some(priority)) =
                (time(head), number(rest, " pid="), number(rest, " newprio="))
            && let Some(now) = self.now.as_mut().filter(|n| i64::from(n.thread) == thread)
        {
            let before = *now;
            now.rank = rank(priority);
            now.from = at;
            now.lowered = (now.rank < before.rank).then_some(at);
            self.push(before, at, 0, false);
        }
    }

    /// The timeline, with early readings added to their pieces and standstills merged.
    pub(crate) fn finish(mut self) -> Timeline {
        for (at, thread, cpu) in std::mem::take(&mut self.early) {
            if let Some(piece) = self.last_piece(at, thread) {
                piece.cpu += cpu;
            }
        }
        let mut still = std::mem::take(&mut self.timeline.still);
        for (_, to) in &mut still {
            *to = self.timeline.judged_until(*to);
        }
        still.sort_unstable();
        for (from, to) in still {
            match self.timeline.still.last_mut() {
                Some(last) if from <= last.1 => last.1 = last.1.max(to),
                _ => self.timeline.still.push((from, to)),
            }
        }
        self.timeline
    }
}
