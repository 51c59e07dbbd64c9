//! Changes of the reader's state: threads that get the CPU, want it, and leave it; and signs of a
//! standstill.

use super::super::trace_text::{is_interrupt, is_of_a_case, number, on_cpu, rank, time};
use super::pieces::{ENFORCER, Piece};
use super::reader::{Current, Reader};
use crate::load::Nanos;

/// An interrupt of a timer may be so late, and a switch of threads take so long.
pub(crate) const PUNCTUAL: Nanos = 20_000;

/// A thread whose clock another CPU has read ran at most this many pieces ago.
const RECENT: usize = 20_000;

impl Reader {
    /// A thread that is interrupted while it gives an inherited priority back goes on with that
    /// afterwards.
    pub(super) fn note_interrupt(&mut self, line: &str) {
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
    pub(super) fn note_untraced_switch(&mut self, at: Nanos, thread: i64, cpu: Nanos) {
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
    pub(super) fn note_switch(&mut self, at: Nanos, thread: i64, cpu: Nanos) {
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
    pub(super) fn handles(&mut self, soft: bool, begins: bool, at: Nanos) {
        let [hard_one, soft_one] = &mut self.handlers;
        let since = if soft { soft_one } else { hard_one };
        let began = since.take();
        *since = begins.then_some(at);
        if let Some(began) = began.filter(|_| !begins) {
            self.stood_still(at.saturating_sub(began), at);
        }
    }

    /// The machine stood still for so long, up to that time.
    pub(super) fn stood_still(&mut self, length: Nanos, until: Nanos) {
        if length > PUNCTUAL {
            let from = until.saturating_sub(length - PUNCTUAL);
            self.timeline.still.push((from, until));
        }
    }

    /// Whether the thread of this charge may hold the enforcer's lock: a worker that inherits the
    /// enforcer's priority does, and the watchdog, on another CPU, may.
    pub(super) fn has_enforcers_lock(&self, charge: &str, thread: i64) -> bool {
        let inherits = |now: &Current| {
            i64::from(now.thread) == thread && now.rank == ENFORCER && charge.starts_with("comm=w")
        };
        let here = self.now.as_ref().is_some_and(inherits);
        here || charge.starts_with("comm=watchdog ")
    }

    /// The thread gets another priority; if it runs, the watchdog on another CPU gives it.
    pub(super) fn changed(&mut self, at: Nanos, thread: i32) {
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
    pub(super) fn note_rank(&mut self, rank: u8) {
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
    pub(super) fn waited_for_a_lock(&mut self, thread: i32) -> Option<Nanos> {
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

    pub(super) fn ran(&mut self, at: Nanos, thread: i64, cpu: Nanos) {
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
    pub(super) fn last_piece(&mut self, at: Nanos, thread: i64) -> Option<&mut Piece> {
        let pieces = &mut self.timeline.pieces;
        let after = pieces.partition_point(|p| p.from <= at);
        let mut recent = pieces.get_mut(..after)?.iter_mut().rev().take(RECENT);
        recent.find(|p| i64::from(p.thread) == thread)
    }

    pub(super) fn switch(&mut self, at: Nanos, text: &str) {
        let (before, after) = text.split_once(" ==> ").unwrap_or((text, ""));
        let (Some(old), Some(rank_then), Some(thread), Some(next)) = (
            number(before, " prev_pid="),
            number(before, " prev_prio=").map(rank),
            number(after, " next_pid="),
            number(after, " next_prio=").map(rank),
        ) else {
            return;
        };
        let state = before.rsplit_once(" prev_state=").map_or("", |(_, s)| s);
        let runnable = state.starts_with('R');
        let stopped = state.starts_with('T');
        self.note_rank(rank_then);
        if let Some(now) = self.now.take().filter(|n| i64::from(n.thread) == old) {
            self.push(now, at, 0, !runnable && !stopped);
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
    pub(super) fn chosen(&mut self, at: Nanos, thread: i64, rank: u8, of_a_case: bool) {
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
    pub(super) fn wants(&mut self, thread: i64, rank: u8, since: Nanos) {
        if let Ok(thread) = i32::try_from(thread)
            && rank > 0
        {
            self.ready.insert(thread, (rank, since));
        }
    }

    pub(super) fn push(&mut self, of: Current, to: Nanos, cpu: Nanos, waits: bool) {
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
