//! The ring of the calling thread, and the events that the executor records in it.
//!
//! A thread that records nothing pays a look at a thread local. No event allocates, waits or makes
//! a system call; [`publish`] and [`mark`] read the clock, the others get times that were read
//! anyway, or take the thread's last one.

use super::names::{Mark, NameId};
use super::trigger::{Armed, Cause, Fired};
use crate::Nanos;
use core::cell::RefCell;
use replenish_os::live::SharedSlice;
use replenish_os::{Usage, clock};
use replenish_recorder::{Event, Kind, RunningTotals, Writer, write_totals};
use std::sync::Arc;

/// The recording of one thread, in its own hands.
#[repr(C)] // the words that every event needs come first, in one cache line
pub(super) struct Local {
    pub(super) ring: SharedSlice,
    pub(super) writer: Writer,
    /// The time of the last event that had one.
    pub(super) last: Nanos,
    /// As many records may be written before a dump has to be copied.
    pub(super) limit: u64,
    /// The handle whose callback has begun, its release, and its begin.
    pub(super) open: Option<(NameId, Nanos, Nanos)>,
    /// A callback that takes longer, in ns, fires a dump; `Nanos::MAX`: none does.
    pub(super) bound: Nanos,
    pub(super) entry: SharedSlice,
    /// The trigger of a dump, which the thread fires.
    pub(super) armed: Option<Arc<Armed>>,
    /// The dump that this thread asked for last.
    pub(super) fired: Option<Fired>,
    /// Events that were left out meanwhile.
    pub(super) left_out: u64,
}

/// Begins with a cache line.
#[repr(align(64))]
struct Aligned(RefCell<Option<Local>>);

/// The flag of the `RefCell` and the words that every event needs.
const HOT: usize = size_of::<RefCell<()>>() + core::mem::offset_of!(Local, open);
const _: () = assert!(HOT <= 64 && size_of::<Option<Local>>() == size_of::<Local>());

thread_local! {
    static LOCAL: Aligned = const { Aligned(RefCell::new(None)) };
}

/// The calling thread records from now on.
pub(super) fn install(local: Local) {
    LOCAL.with(|slot| slot.0.replace(Some(local)));
}

/// Runs `step` on the thread's recording, but not at the end of the thread, and not in a signal
/// handler that interrupted a recording.
#[inline]
fn with(step: impl FnOnce(&mut Local)) {
    let step = |slot: &Aligned| {
        if let Ok(mut slot) = slot.0.try_borrow_mut()
            && let Some(local) = &mut *slot
        {
            step(local);
        }
    };
    LOCAL.try_with(step).ok();
}

impl Local {
    #[inline]
    fn write(&mut self, time: Nanos, kind: Kind, name: NameId, a: u64, b: u64) {
        self.last = self.last.max(time);
        if self.writer.written() >= self.limit && self.holds() {
            return;
        }
        self.put(time, kind, name, a, b);
    }

    #[inline]
    fn put(&mut self, time: Nanos, kind: Kind, name: NameId, a: u64, b: u64) {
        let event = Event {
            time,
            kind,
            name: name.0,
            a,
            b,
        };
        self.writer.write(&self.ring, &event);
    }

    fn end(&mut self, time: Nanos) {
        if let Some((name, due, begun)) = self.open.take() {
            self.write(time, Kind::End, name, due, 0);
            if time.saturating_sub(begun) > self.bound {
                self.trigger(Cause::Overrun);
            }
        }
    }

    #[cold]
    fn trigger(&mut self, cause: Cause) {
        let fired = self.armed.as_ref().and_then(|armed| armed.fire(cause));
        if fired.is_some() {
            self.fired = fired;
            self.limit = self.writer.written() + self.writer.slots() / 2;
        }
    }

    /// Half of the ring came after the trigger, and the other half before it: whether the dump of
    /// that is still to be copied. Does not wait.
    #[cold]
    fn holds(&mut self) -> bool {
        if let Some((armed, fired)) = self.armed.as_ref().zip(self.fired)
            && !armed.is_copied(fired)
        {
            if self.left_out == 0 {
                armed.fill(fired);
            }
            self.left_out += 1;
            return true;
        }
        self.limit = u64::MAX;
        self.fired = None;
        match std::mem::take(&mut self.left_out) {
            0 => {}
            count => self.put(self.last, Kind::Gap, NONE, count, 0),
        }
        false
    }
}

const NONE: NameId = NameId(0);

/// The dispatcher has taken a sample for this handle.
#[inline]
pub(crate) fn take(handle: NameId, arrival: Nanos, bytes: usize) {
    with(|l| l.write(arrival, Kind::Take, handle, bytes as u64, 0));
}

/// The handle's inbox was full.
#[inline]
pub(crate) fn dropped(handle: NameId, arrival: Nanos, bytes: usize) {
    with(|l| l.write(arrival, Kind::Drop, handle, bytes as u64, 0));
}

/// The worker became runnable at `since`, and its wait returned at `awake`.
#[inline]
pub(crate) fn wake(since: Nanos, awake: Nanos) {
    with(|l| {
        l.write(since, Kind::Wake, NONE, awake, l.last);
        l.last = l.last.max(awake);
    });
}

/// The worker is about to wait. Nothing is recorded: its wake-up says when the wait began.
#[inline]
pub(crate) const fn block() {}

/// A callback starts.
#[inline]
pub(crate) fn begin(handle: NameId, started: Nanos, due: Nanos) {
    with(|l| {
        l.write(started, Kind::Begin, handle, due, 0);
        l.open = Some((handle, due, started));
    });
}

/// The callback that has begun has ended.
#[inline]
pub(crate) fn end(time: Nanos) {
    with(|l| l.end(time));
}

/// The callback that has begun did not run: its input was unusable.
#[cold]
pub(crate) fn spoiled() {
    with(|l| l.end(l.last));
}

/// The callback that has begun panicked; or another part of the handle did.
#[cold]
pub(crate) fn panicked(handle: NameId) {
    with(|l| {
        let now = clock::monotonic();
        l.write(now, Kind::Panic, handle, 0, 0);
        l.end(now);
        l.trigger(Cause::Panic);
    });
}

/// A callback ended after its deadline.
#[cold]
pub(crate) fn miss(handle: NameId, time: Nanos, lateness: Nanos, deadline: Nanos) {
    with(|l| {
        l.write(time, Kind::Miss, handle, lateness, deadline);
        l.trigger(Cause::Miss);
    });
}

/// Releases or samples are left out.
#[cold]
pub(crate) fn skip(handle: NameId, count: u64) {
    with(|l| l.write(l.last, Kind::Skip, handle, count, 0));
}

/// The callback whose turn it is waits for its group since `since`; `holder` runs.
#[cold]
pub(crate) fn queue(handle: NameId, since: Nanos, holder: Option<NameId>) {
    let holder = holder.map_or(0, |name| u64::from(name.0));
    with(|l| l.write(since, Kind::Queue, handle, holder, 0));
}

/// A message was handed to the middleware.
#[inline]
pub(crate) fn publish(topic: NameId, bytes: usize, refused: bool) {
    with(|l| {
        let now = clock::monotonic();
        l.write(now, Kind::Publish, topic, bytes as u64, u64::from(refused));
    });
}

/// The callback that has begun is this stage of a chain's instance, which began at `origin`.
pub(crate) fn chain_stage(chain: NameId, started: Nanos, origin: Nanos, stage: usize) {
    with(|l| l.write(started, Kind::ChainStage, chain, origin, stage as u64));
}

/// The last stage of an instance has ended.
pub(crate) fn chain_end(chain: NameId, end: Nanos, origin: Nanos, latency: Nanos) {
    with(|l| l.write(end, Kind::ChainEnd, chain, origin, latency));
}

/// The program's mark.
#[inline]
pub(crate) fn mark(mark: Mark, value: u64) {
    with(|l| l.write(clock::monotonic(), Kind::Mark, mark.0, value, 0));
}

/// The CPU time of a thread without a budget, which was read anyway.
#[inline]
pub(crate) fn used(usage: &Usage) {
    with(|l| {
        let totals = RunningTotals {
            high: usage.cpu_high,
            ..RunningTotals::default()
        };
        write_totals(&l.entry, &totals);
        l.write(l.last, Kind::Used, NONE, 0, usage.cpu_high);
    });
}
