//! The last events of a board's tasks: one ring of 4 kB for all of them, and the pieces in which it
//! goes to the host. Feature `recorder`; without it `recorder_disabled.rs` stands here.
//!
//! ```text
//!   executor: lay, install │ event, begin, end ─┐
//!   enforcer: supervised_board ── budget_event ─┴► State: tasks, ring ─► Feed::next ─► a piece
//!                                  name ─────────► Names ─────────────┘
//! ```
//!
//! An event is written with interrupts masked, like every other word that tasks share here: it
//! neither waits nor allocates. Tasks that the executor did not start record nothing.

use crate::rtos::critical_section::Guarded;
use crate::{Nanos, Usage, clock, current_tid};
use core::sync::atomic::{AtomicU8, Ordering};
use replenish_recorder::board::{
    BoardThread, CompactEvent, CompactRing, EVENTS_PER_PIECE, MAX_BOARD_NAMES, MAX_BOARD_TEXT,
    MAX_BOARD_THREADS, MAX_PIECE, Piece,
};
use replenish_recorder::{Event, Role, RunningTotals};
pub use replenish_recorder::{Kind, NameKind};

/// Whether anything is recorded in this build.
pub const ON: bool = true;
/// The topic on which pieces are sent.
pub const TOPIC: &str = replenish_recorder::board::TOPIC;
/// Bytes of the longest piece.
pub const PIECE: usize = MAX_PIECE;
/// Events in 4 kB.
const EVENTS: usize = 4096 / CompactEvent::BYTES;

/// A text of bounded length.
#[derive(Debug, Clone, Copy)]
struct Short {
    bytes: [u8; MAX_BOARD_TEXT],
    len: usize,
}

impl Short {
    const EMPTY: Self = Self {
        bytes: [0; MAX_BOARD_TEXT],
        len: 0,
    };

    fn of(text: &str) -> Self {
        let mut end = text.len().min(MAX_BOARD_TEXT);
        while !text.is_char_boundary(end) {
            end -= 1;
        }
        let mut short = Self::EMPTY;
        let from = text.as_bytes().iter().take(end);
        for (to, from) in short.bytes.iter_mut().zip(from) {
            *to = *from;
            short.len += 1;
        }
        short
    }

    fn as_str(&self) -> &str {
        let bytes = self.bytes.get(..self.len).unwrap_or_default();
        core::str::from_utf8(bytes).unwrap_or_default()
    }
}

/// A task of the executor.
#[derive(Debug, Clone, Copy)]
struct Task {
    /// Its number; 0 before it has begun.
    tid: u8,
    dispatches: bool,
    budget: Option<(u64, u64)>,
    name: Short,
    policy: Short,
    /// The handle whose callback has begun.
    open: Option<(Name, Nanos)>,
}

impl Task {
    const NONE: Self = Self {
        tid: 0,
        dispatches: false,
        budget: None,
        name: Short::EMPTY,
        policy: Short::EMPTY,
        open: None,
    };
}

struct State {
    ring: CompactRing<EVENTS>,
    tasks: [Task; MAX_BOARD_THREADS],
    laid: usize,
}

static STATE: Guarded<State> = Guarded::new(State {
    ring: CompactRing::new(),
    tasks: [Task::NONE; MAX_BOARD_THREADS],
    laid: 0,
});

struct Names {
    all: [(NameKind, Short); MAX_BOARD_NAMES],
    used: usize,
}

static NAMES: Guarded<Names> = Guarded::new(Names {
    all: [(NameKind::Handle, Short::EMPTY); MAX_BOARD_NAMES],
    used: 0,
});

/// The id of a name in events; 0 for those beyond the 32 that there is room for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Name(u16);

impl Name {
    /// No name.
    pub const NONE: Self = Self(0);

    /// The id of this name, of which the first 40 bytes are kept. Set-up only: it compares with all
    /// names that are there.
    #[must_use]
    pub fn of(kind: NameKind, text: &str) -> Self {
        let short = Short::of(text);
        NAMES.with(|names| {
            let mut used = names.all.iter().take(names.used);
            let is = |(k, known): &(NameKind, Short)| {
                *k == kind && known.len == short.len && known.bytes == short.bytes
            };
            let at = used.position(is).unwrap_or(names.used);
            if let Some(place) = names.all.get_mut(at) {
                *place = (kind, short);
                names.used = names.used.max(at + 1);
                return Self(u16::try_from(at + 1).unwrap_or(0));
            }
            Self::NONE
        })
    }
}

/// A thread's place in the recording.
#[derive(Debug, Default)]
pub struct Slot(AtomicU8);

/// An executor starts: the threads of the one before are forgotten.
pub fn restart() {
    STATE.with(|state| state.laid = 0);
}

/// A thread that is to start; beyond 16 it is not recorded.
pub fn lay(slot: &Slot, name: &str, dispatches: bool, budget: Option<(u64, u64)>) {
    let task = Task {
        dispatches,
        budget,
        name: Short::of(name),
        ..Task::NONE
    };
    STATE.with(|state| {
        if let Some(place) = state.tasks.get_mut(state.laid) {
            *place = task;
            state.laid += 1;
            let number = u8::try_from(state.laid).unwrap_or(0);
            slot.0.store(number, Ordering::Relaxed);
        }
    });
}

/// The calling thread, which has this policy, records from now on. Returns its number for
/// [`Account::record_as`](crate::Account::record_as); 0: it is not recorded.
pub fn install(slot: &Slot, granted: &str) -> u8 {
    let Ok(tid) = u8::try_from(current_tid().get()) else {
        return 0;
    };
    let Some(at) = usize::from(slot.0.load(Ordering::Relaxed)).checked_sub(1) else {
        return 0;
    };
    let policy = Short::of(granted);
    STATE.with(|state| {
        if let Some(task) = state.tasks.get_mut(at) {
            (task.tid, task.policy) = (tid, policy);
        }
    });
    tid
}

/// A step on the calling task's state, if the executor started it.
fn with_own(step: impl FnOnce(&mut Task, &mut CompactRing<EVENTS>)) {
    let Ok(tid) = u8::try_from(current_tid().get()) else {
        return;
    };
    STATE.with(|state| {
        let mut tasks = state.tasks.iter_mut().take(state.laid);
        if let Some(task) = tasks.find(|task| task.tid == tid) {
            step(task, &mut state.ring);
        }
    });
}

fn compact(
    tid: u8,
    of_budget: bool,
    kind: Kind,
    name: Name,
    time: Nanos,
    [a, b]: [u64; 2],
) -> CompactEvent {
    let event = Event {
        time,
        kind,
        name: name.0.into(),
        a,
        b,
    };
    CompactEvent::new(tid, of_budget, &event)
}

/// An event of the calling task; see [`Kind`] for its values.
pub fn event(kind: Kind, name: Name, time: Nanos, values: [u64; 2]) {
    with_own(|task, ring| ring.push(compact(task.tid, false, kind, name, time, values)));
}

/// As [`event`], at this moment.
pub fn event_now(kind: Kind, name: Name, values: [u64; 2]) {
    event(kind, name, clock::monotonic(), values);
}

/// A callback of a handle starts.
pub fn begin(name: Name, time: Nanos, due: Nanos) {
    with_own(|task, ring| {
        task.open = Some((name, due));
        ring.push(compact(task.tid, false, Kind::Begin, name, time, [due, 0]));
    });
}

/// The callback that has begun has ended.
pub fn end(time: Nanos) {
    with_own(|task, ring| {
        if let Some((name, due)) = task.open.take() {
            ring.push(compact(task.tid, false, Kind::End, name, time, [due, 0]));
        }
    });
}

/// An event of the budget of task `tid`.
pub(crate) fn budget_event(tid: u8, kind: Kind, time: Nanos, values: [u64; 2]) {
    let event = compact(tid, true, kind, Name::NONE, time, values);
    STATE.with(|state| state.ring.push(event));
}

/// The progress of sending: all descriptions come in turn, so that a host that listens later, or
/// missed one, learns them.
#[derive(Debug)]
pub struct Feed {
    board: Short,
    /// The number of the next event.
    next: u64,
    /// The next description: the board's name, then threads, then names.
    turn: usize,
    /// All descriptions were sent once.
    described: bool,
    /// The three once the last piece that was written is sent.
    after: (u64, usize, bool),
}

impl Feed {
    /// A recorder for the board of this name, of which it keeps the first 40 bytes.
    #[must_use]
    pub fn new(board: &str) -> Self {
        Self {
            board: Short::of(board),
            next: 0,
            turn: 0,
            described: false,
            after: (0, 0, false),
        }
    }

    /// The last piece that was written is sent; without this call it is written again.
    pub fn sent(&mut self) {
        (self.next, self.turn, self.described) = self.after;
    }

    /// Writes the next description; how many bytes. `usage` gives the account of the thread with
    /// this name.
    pub fn description(&mut self, usage: impl Fn(&str) -> Usage, room: &mut [u8; PIECE]) -> usize {
        let laid = STATE.with(|state| state.laid);
        let used = NAMES.with(|names| names.used);
        let turn = self.turn;
        let is_last = turn >= laid + used;
        let next_turn = if is_last { 0 } else { turn + 1 };
        self.after = (self.next, next_turn, self.described || is_last);
        let Some(index) = turn.checked_sub(1) else {
            let (id, kind, text) = (0, NameKind::Mark, self.board.as_str());
            return Piece::Name { id, kind, text }.write(room);
        };
        if let Some(at) = index.checked_sub(laid) {
            let (kind, text) = NAMES
                .with(|names| names.all.get(at).copied())
                .unwrap_or((NameKind::Handle, Short::EMPTY));
            let (id, text) = (u16::try_from(at + 1).unwrap_or(0), text.as_str());
            return Piece::Name { id, kind, text }.write(room);
        }
        let task = STATE.with(|state| state.tasks.get(index).copied());
        let task = task.unwrap_or(Task::NONE);
        let usage = usage(task.name.as_str());
        let thread = BoardThread {
            index,
            threads: laid,
            task: task.tid,
            role: if task.dispatches {
                Role::Dispatcher
            } else {
                Role::Worker
            },
            budget: task.budget,
            totals: RunningTotals {
                high: usage.cpu_high,
                low: usage.cpu_low,
                exhaustions: usage.exhaustions,
                replenishments: usage.replenishments,
                available: usage.available,
                is_low: usage.low,
            },
            name: task.name.as_str(),
            policy: task.policy.as_str(),
        };
        Piece::Thread(thread).write(room)
    }

    /// Writes a piece with the next events; how many bytes, 0 if there are none, or not everything
    /// was described yet. `ahead`: Unix time less the board's clock, ns.
    pub fn events(&mut self, ahead: Option<i64>, room: &mut [u8; PIECE]) -> usize {
        if !self.described {
            return 0;
        }
        let mut copy = [CompactEvent::default(); EVENTS_PER_PIECE];
        let (first, count) = STATE.with(|state| state.ring.copy(self.next, &mut copy));
        if count == 0 {
            return 0;
        }
        let mut bytes = [0; EVENTS_PER_PIECE * CompactEvent::BYTES];
        let (places, _) = bytes.as_chunks_mut();
        for (to, from) in places.iter_mut().zip(copy.iter().take(count)) {
            *to = from.to_bytes();
        }
        self.after = (first + count as u64, self.turn, self.described);
        let events = bytes.get(..count * CompactEvent::BYTES).unwrap_or_default();
        let now = clock::monotonic();
        Piece::Events {
            first,
            now,
            ahead,
            events,
        }
        .write(room)
    }

    /// Whether all descriptions were sent once.
    #[must_use]
    pub const fn is_described(&self) -> bool {
        self.described
    }
}
