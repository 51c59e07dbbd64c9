//! The kernel's scheduler trace as pieces of CPU time, each of one thread.
//!
//! `sched_switch` says who runs, at which effective priority (inheritance included), and whether
//! the thread before wanted to go on; `sched_stat_runtime` is each advance of a thread's CPU clock.

use super::trace_text::{
    handler, hexadecimal, is_interrupt, is_of, is_of_a_case, number, on_cpu, rank, time, timer,
};
use crate::load::Nanos;
use std::collections::{BTreeMap, BTreeSet};

/// A stretch of one thread on the traced CPU.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Piece {
    /// The kernel's id; 0 is the idle thread.
    pub thread: i32,
    /// Its effective real-time priority; 0 without one.
    pub rank: u8,
    pub from: Nanos,
    pub to: Nanos,
    /// The advance of its CPU clock, which may have begun some µs before `from`.
    pub cpu: Nanos,
    /// The thread waits afterwards.
    pub waits: bool,
    /// A more urgent thread of the case wanted the CPU, and the kernel did not let it (throttle,
    /// fair server).
    pub withheld: bool,
}

impl Piece {
    pub(super) fn wall(&self) -> Nanos {
        self.to.saturating_sub(self.from)
    }
}

/// The pieces of one CPU, in order.
#[derive(Debug, Default)]
pub(super) struct Timeline {
    pub pieces: Vec<Piece>,
    /// From when to when the machine stood still, by the sign of a timer's interrupt that came late
    /// or of a thread that was charged for more than the time it had. In order, apart.
    pub still: Vec<(Nanos, Nanos)>,
    /// The kernel had no room for some records: nothing can be said.
    pub lost: bool,
}

impl Timeline {
    /// Time that the machine stood still in a stretch of time.
    pub(super) fn stood_still(&self, from: Nanos, to: Nanos) -> Nanos {
        let overlap = |(began, ended): (Nanos, Nanos)| ended.min(to) - began.max(from);
        self.still_in(from, to).map(overlap).sum()
    }

    /// The times at which the machine stood still, if only for a part of this stretch.
    pub(super) fn still_in(&self, from: Nanos, to: Nanos) -> impl Iterator<Item = (Nanos, Nanos)> {
        let first = self.still.partition_point(|&(_, ended)| ended <= from);
        let after = self.still.get(first..).unwrap_or_default().iter().copied();
        after.take_while(move |&(began, _)| began < to)
    }
}

/// An interrupt of a timer may be so late, and a switch of threads take so long.
pub(super) const PUNCTUAL: Nanos = 20_000;

/// A thread that may hold the enforcer's lock is charged for no more than this at once, nor is a
/// worker on its way from a wait to its clock. A larger charge says that its CPU stood still.
const LOOK: Nanos = 100_000;

/// The enforcer's priority: no worker and no stranger has it of its own.
const ENFORCER: u8 = 99;

/// A thread that wakes workers whose priority it has not changed only as it hands a lock over.
const HANDS_OVER: &str = "watchdog-";

/// Called by the timer of a file descriptor: an enforcer's.
const ENFORCERS: &str = "timerfd_tmrproc";
/// Called by the timer of a thread that sleeps. A worker's is set where it expires: it is pinned.
const SLEEPERS: &str = "hrtimer_wakeup";
/// Called by the timer that rings again and again on the CPU under test (`tracefs.rs`).
const TICKS: &str = "perf_swevent_hrtimer";

/// A thread whose clock another CPU has read ran at most this many pieces ago.
const RECENT: usize = 20_000;

/// Reads the kernel's text line by line.
#[derive(Debug)]
pub(super) struct Reader {
    cpu: usize,
    timeline: Timeline,
    now: Option<Current>,
    /// The case's threads that want the CPU: priority, and since when.
    ready: BTreeMap<i32, (u8, Nanos)>,
    /// The enforcer, woken since then.
    woken: Option<(i64, Nanos)>,
    /// The last line of this CPU was the beginning of a timer's interrupt, then.
    expired: Option<Nanos>,
    /// Timers that are set: address and time.
    timers: BTreeMap<String, Nanos>,
    /// Charges of threads whose piece has not been read: when, who, how much.
    early: Vec<(Nanos, i64, Nanos)>,
    /// Workers that read their CPU clock as soon as they have left a wait.
    prompt: Vec<String>,
    /// Of them, those that have been woken, and have not been charged since.
    fresh: BTreeSet<i64>,
    /// Threads that were given another priority off the CPU, and have not been woken since: when,
    /// and the number of pieces before that.
    given: BTreeMap<i32, (Nanos, usize)>,
    /// Since when the CPU is in the handler of an interrupt, or of a soft interrupt.
    handlers: [Option<Nanos>; 2],
}

/// The thread that runs, and where its current piece began.
#[derive(Debug, Clone, Copy)]
struct Current {
    thread: i32,
    rank: u8,
    of_a_case: bool,
    from: Nanos,
    /// When it got the CPU.
    switched: Nanos,
    /// When it gave an inherited priority back.
    lowered: Option<Nanos>,
    /// Nothing was charged since it got the CPU.
    fresh: bool,
    /// It was given another priority while it ran, before this piece.
    changed: Option<usize>,
}

impl Reader {
    pub(super) fn new(cpu: usize) -> Self {
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
    /// ([`Case::prompt`](super::case::Case::prompt)): a longer first charge says that their CPU
    /// stood still.
    pub(super) fn with_prompt(mut self, names: Vec<String>) -> Self {
        self.prompt = names;
        self
    }

    /// Takes one line: `comm-123  [001] d..2. 12.345678: sched_switch: prev_comm=…`.
    pub(super) fn line(&mut self, line: &str) {
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
    pub(super) fn finish(mut self) -> Timeline {
        for (at, thread, cpu) in std::mem::take(&mut self.early) {
            if let Some(piece) = self.last_piece(at, thread) {
                piece.cpu += cpu;
            }
        }
        let mut still = std::mem::take(&mut self.timeline.still);
        still.sort_unstable();
        for (from, to) in still {
            match self.timeline.still.last_mut() {
                Some(last) if from <= last.1 => last.1 = last.1.max(to),
                _ => self.timeline.still.push((from, to)),
            }
        }
        self.timeline
    }

    /// A thread that is interrupted while it gives an inherited priority back goes on with that
    /// afterwards.
    fn note_interrupt(&mut self, line: &str) {
        let Some(now) = self.now.as_mut().filter(|n| n.lowered.is_some()) else {
            return;
        };
        let head = line.split_once(": ").map_or("", |(head, _)| head);
        if let Some(at) = time(head)
            && is_interrupt(head)
            && on_cpu(head) == Some(self.cpu)
            // It comes in time, and its record may be as late.
            && now.lowered.is_some_and(|lowered| at <= lowered + 2 * PUNCTUAL)
        {
            now.lowered = Some(at);
        }
    }

    /// Some machines do not trace each switch from the idle thread, or from a thread of their own:
    /// the first charge tells when it was, and the wake-up, or the next switch, at which priority.
    fn note_untraced_switch(&mut self, at: Nanos, thread: i64, cpu: Nanos) {
        let Some(before) = self.now.filter(|now| i64::from(now.thread) != thread) else {
            return;
        };
        // Its own charge is missing, too.
        self.timeline.lost |= before.of_a_case;
        let from = at.saturating_sub(cpu).max(before.from);
        self.push(before, from, 0, false);
        let first = self.timeline.pieces.len();
        let known = i32::try_from(thread).ok().and_then(|t| self.ready.get(&t));
        let known = known.map(|&(rank, _)| rank);
        self.chosen(from, thread, known.unwrap_or(0), known.is_some());
        if let Some(now) = self.now.as_mut() {
            now.changed = known.is_none().then_some(first);
        }
    }

    /// The kernel charges a thread from the moment at which it was chosen, and traces the switch a
    /// little later. If it is not a little, the machine stood still in between.
    fn note_switch(&mut self, at: Nanos, thread: i64, cpu: Nanos) {
        if let Some(now) = self.now
            && now.fresh
            && i64::from(now.thread) == thread
        {
            let had = at.saturating_sub(now.from);
            self.stood_still(cpu.saturating_sub(had), now.from);
        }
    }

    /// The handler of an interrupt begins or ends. The kernel charges its time to the thread that
    /// it interrupts, and lets no other thread run meanwhile.
    fn handles(&mut self, soft: bool, begins: bool, at: Nanos) {
        let [hard_one, soft_one] = &mut self.handlers;
        let since = if soft { soft_one } else { hard_one };
        let began = since.take();
        *since = begins.then_some(at);
        if let Some(began) = began.filter(|_| !begins) {
            self.stood_still(at.saturating_sub(began), at);
        }
    }

    /// The machine stood still for so long, up to that time.
    fn stood_still(&mut self, length: Nanos, until: Nanos) {
        if length > PUNCTUAL {
            let from = until.saturating_sub(length - PUNCTUAL);
            self.timeline.still.push((from, until));
        }
    }

    /// Whether the thread of this charge may hold the enforcer's lock: a worker that inherits the
    /// enforcer's priority does, and the watchdog, on another CPU, may.
    fn has_enforcers_lock(&self, charge: &str, thread: i64) -> bool {
        let inherits = |now: &Current| {
            i64::from(now.thread) == thread && now.rank == ENFORCER && charge.starts_with("comm=w")
        };
        let here = self.now.as_ref().is_some_and(inherits);
        here || charge.starts_with("comm=watchdog ")
    }

    /// The thread gets another priority; if it runs, the watchdog on another CPU gives it.
    fn changed(&mut self, at: Nanos, thread: i32) {
        if let Some(now) = self.now.as_mut()
            && now.thread == thread
            && now.from <= at
        {
            let before = *now;
            now.from = at;
            self.push(before, at, 0, false);
            let first = self.timeline.pieces.len();
            self.now = self.now.map(|now| Current {
                changed: Some(first),
                ..now
            });
        }
    }

    /// The switch tells which priority that was: the thread has had it since then.
    fn note_rank(&mut self, rank: u8) {
        if let Some(now) = self.now.as_mut()
            && let Some(first) = now.changed
        {
            now.rank = rank;
            let thread = now.thread;
            let since = self.timeline.pieces.get_mut(first..).unwrap_or_default();
            let its = since.iter_mut().filter(|p| p.thread == thread);
            its.for_each(|p| p.rank = rank);
        }
    }

    /// Since its last piece the thread has wanted the CPU, but for a lock that another had. Returns
    /// when that was.
    fn waited_for_a_lock(&mut self, thread: i32) -> Option<Nanos> {
        let pieces = &mut self.timeline.pieces;
        let mut recent = pieces.iter().rev().take(RECENT);
        let after = recent.position(|p| p.thread == thread)?;
        let then = pieces.len().saturating_sub(after);
        let (since, meanwhile) = pieces.split_at_mut_checked(then)?;
        let last = since.last()?;
        let less = meanwhile.iter_mut().filter(|p| p.rank < last.rank);
        less.for_each(|p| p.withheld = true);
        Some(last.to)
    }

    fn ran(&mut self, at: Nanos, thread: i64, cpu: Nanos) {
        if let Some(now) = self.now.as_mut()
            && i64::from(now.thread) == thread
            && now.from <= at
        {
            let before = *now;
            now.from = at;
            now.fresh = false;
            self.push(before, at, cpu, false);
        } else {
            // The other CPU's line may come after the switch that ends the piece, by as much as the
            // pipe holds back; or before the switch that begins it, which the pipe then holds back.
            match self.last_piece(at, thread).filter(|p| at <= p.to) {
                Some(then) => then.cpu += cpu,
                None => self.early.push((at, thread, cpu)),
            }
        }
    }

    /// The thread's last piece that had begun by then.
    fn last_piece(&mut self, at: Nanos, thread: i64) -> Option<&mut Piece> {
        let pieces = &mut self.timeline.pieces;
        let after = pieces.partition_point(|p| p.from <= at);
        let mut recent = pieces.get_mut(..after)?.iter_mut().rev().take(RECENT);
        recent.find(|p| i64::from(p.thread) == thread)
    }

    fn switch(&mut self, at: Nanos, text: &str) {
        let (before, after) = text.split_once(" ==> ").unwrap_or((text, ""));
        let (Some(old), Some(rank_then), Some(thread), Some(next)) = (
            number(before, " prev_pid="),
            number(before, " prev_prio=").map(rank),
            number(after, " next_pid="),
            number(after, " next_prio=").map(rank),
        ) else {
            return;
        };
        let runnable = before
            .rsplit_once(" prev_state=")
            .is_some_and(|(_, state)| state.starts_with('R'));
        self.note_rank(rank_then);
        if let Some(now) = self.now.take().filter(|n| i64::from(n.thread) == old) {
            self.push(now, at, 0, !runnable);
        }
        self.handlers = [None; 2]; // handlers do not switch threads: a record of an end is missing
        let comm = before.rsplit_once("prev_comm=").map_or("", |(_, c)| c);
        if let Ok(old) = i32::try_from(old) {
            self.ready.remove(&old);
        }
        if runnable && is_of_a_case(comm) {
            // It would run if it might: no switch takes its time.
            self.wants(old, rank_then, 0);
        }
        let comm = after.strip_prefix("next_comm=").unwrap_or(after);
        self.chosen(at, thread, next, is_of_a_case(comm));
    }

    /// The thread gets the CPU.
    fn chosen(&mut self, at: Nanos, thread: i64, rank: u8, of_a_case: bool) {
        if let Some((_, woken)) = self.woken.take_if(|(enforcer, _)| *enforcer == thread) {
            self.stood_still(at.saturating_sub(woken), at);
        }
        let thread = i32::try_from(thread).unwrap_or(0);
        self.ready.remove(&thread);
        if let Some((since, before)) = self.given.remove(&thread) {
            // No thread had to wake it: it has wanted the CPU since it got this priority.
            let meanwhile = self.timeline.pieces.get_mut(before..).unwrap_or_default();
            let less = meanwhile.iter_mut().filter(|p| p.rank < rank);
            let kept_out = less.filter(|p| since + PUNCTUAL <= p.to);
            kept_out.for_each(|p| p.withheld = true);
        }
        self.now = Some(Current {
            thread,
            rank,
            of_a_case,
            from: at,
            switched: at,
            lowered: None,
            fresh: true,
            changed: None,
        });
    }

    /// A thread of this priority wants the CPU.
    fn wants(&mut self, thread: i64, rank: u8, since: Nanos) {
        if let Ok(thread) = i32::try_from(thread)
            && rank > 0
        {
            self.ready.insert(thread, (rank, since));
        }
    }

    fn push(&mut self, of: Current, to: Nanos, cpu: Nanos, waits: bool) {
        let keeps_out = |(thread, (rank, since)): (&i32, &(u8, Nanos))| {
            *thread != of.thread && *rank > of.rank && *since + PUNCTUAL <= to
        };
        // A thread that gives a lock back runs on until the kernel looks who is next.
        let leaves = of.lowered.is_some_and(|at| to <= at + PUNCTUAL);
        self.timeline.pieces.push(Piece {
            thread: of.thread,
            rank: of.rank,
            from: of.from,
            to,
            cpu,
            waits,
            withheld: self.ready.iter().any(keeps_out) || leaves,
        });
    }
}

#[cfg(test)]
#[path = "timeline_tests.rs"]
mod tests;
