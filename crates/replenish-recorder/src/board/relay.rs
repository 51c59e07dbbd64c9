//! [`Relay`]: the threads, the names and the events of one board, on the host's clock.
//!
//! The board's clock is related to the host's by the protocol's time exchange, whose result every
//! piece of events carries. Without one, or with one that cannot be, it is related by arrivals: the
//! shortest way that a piece has taken counts as none.

use super::compact::{CompactEvent, is_instant};
use super::piece::{BoardThread, MAX_BOARD_NAMES, Piece};
use crate::event::Event;
use crate::layout::{Clocks, NameKind, Role, RunningTotals};
use crate::text;
use alloc::string::String;
use alloc::vec::Vec;

/// A piece is this old at most when it arrives, ns; an exchange that says otherwise is not used.
const OLDEST: i64 = 10_000_000_000;
/// It arrives this much before it was sent at most: the exchange is right to half a round trip.
const EARLIEST: i64 = 1_000_000_000;

/// A thread of the board as it was last described.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Known {
    pub(super) task: u8,
    pub(super) role: Role,
    pub(super) budget: Option<(u64, u64)>,
    pub(super) totals: RunningTotals,
    pub(super) name: String,
    pub(super) policy: String,
}

/// An event on the host's clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HostEvent {
    /// The place of its thread.
    pub thread: usize,
    /// Whether it is of the thread's budget.
    pub of_budget: bool,
    /// Its times are `CLOCK_MONOTONIC` of the host.
    pub event: Event,
}

/// The recording of a board as far as it has come. Bounded, whatever comes.
#[derive(Debug, Clone, Default)]
pub struct Relay {
    pub(super) board: String,
    pub(super) threads: Vec<Option<Known>>,
    pub(super) names: Vec<Option<(NameKind, String)>>,
    /// Host's clock less the board's, by the last exchange.
    exchanged: Option<i64>,
    /// The same by the fastest arrival.
    arrived: Option<i64>,
    /// The board's clock of the last piece.
    now: u64,
    /// The number of the next event.
    next: u64,
    events: u64,
    missed: u64,
    starts: u64,
}

impl Relay {
    /// Nothing has come yet.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes a piece that arrived at `arrival`; events go to `sink`. Events of tasks that were not
    /// described yet are left out, and counted as missed. A board that has started again, which its
    /// clock shows, begins afresh.
    pub fn take(&mut self, piece: &Piece<'_>, arrival: Clocks, mut sink: impl FnMut(HostEvent)) {
        match piece {
            Piece::Thread(thread) => self.thread(thread),
            Piece::Name { id, kind, text } => self.name(usize::from(*id), *kind, text),
            Piece::Events {
                first,
                now,
                ahead,
                events,
            } => {
                if *now < self.now || *first < self.next.saturating_sub(1 << 20) {
                    let starts = self.starts + 1;
                    *self = Self {
                        starts,
                        ..Self::default()
                    };
                }
                self.now = *now;
                let shift = self.shift(*now, *ahead, arrival);
                // The numbers are a stranger's: none of these sums may overflow.
                self.missed = self.missed.saturating_add(first.saturating_sub(self.next));
                for (i, bytes) in (0..).zip(events.as_chunks().0) {
                    let n = first.saturating_add(i);
                    if n < self.next {
                        continue; // it came twice
                    }
                    self.next = n.saturating_add(1);
                    match self.event(*bytes, *now, shift) {
                        Some(event) => {
                            self.events += 1;
                            sink(event);
                        }
                        None => self.missed = self.missed.saturating_add(1),
                    }
                }
            }
        }
    }

    fn event(&self, bytes: [u8; CompactEvent::BYTES], now: u64, shift: i64) -> Option<HostEvent> {
        let (task, of_budget, mut event) = CompactEvent::from_bytes(&bytes).expand(now)?;
        let is = |known: &Option<Known>| known.as_ref().is_some_and(|known| known.task == task);
        let thread = self.threads.iter().position(is)?;
        event.time = event.time.saturating_add_signed(shift);
        if is_instant(event.kind) {
            event.a = event.a.saturating_add_signed(shift);
        }
        Some(HostEvent {
            thread,
            of_budget,
            event,
        })
    }

    fn thread(&mut self, thread: &BoardThread<'_>) {
        if self.threads.len() != thread.threads {
            self.threads.clear();
            self.threads.resize(thread.threads, None);
        }
        if let Some(place) = self.threads.get_mut(thread.index) {
            *place = Some(Known {
                task: thread.task,
                role: thread.role,
                budget: thread.budget,
                totals: thread.totals,
                name: text::load(thread.name.as_bytes()),
                policy: text::load(thread.policy.as_bytes()),
            });
        }
    }

    fn name(&mut self, id: usize, kind: NameKind, name: &str) {
        let name = text::load(name.as_bytes());
        if id == 0 {
            self.board = name;
            return;
        }
        if self.names.is_empty() {
            self.names.resize(MAX_BOARD_NAMES, None);
        }
        if let Some(place) = self.names.get_mut(id - 1) {
            *place = Some((kind, name));
        }
    }

    /// Host's clock less the board's.
    fn shift(&mut self, now: u64, ahead: Option<i64>, arrival: Clocks) -> i64 {
        let less = |a: u64, b: u64| a.wrapping_sub(b).cast_signed();
        let here = less(arrival.monotonic, now);
        let fastest = self.arrived.map_or(here, |before| before.min(here));
        self.arrived = Some(fastest);
        if let Some(ahead) = ahead {
            let shift = ahead.saturating_sub(less(arrival.realtime, arrival.monotonic));
            let age = here.saturating_sub(shift);
            if (-EARLIEST..OLDEST).contains(&age) {
                self.exchanged = Some(shift);
                return shift;
            }
        }
        self.exchanged = None;
        fastest
    }

    /// Whether everything is known that a file needs: the board's name, and all its threads.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        !self.board.is_empty()
            && !self.threads.is_empty()
            && self.threads.iter().all(Option::is_some)
    }

    /// The board's name; empty before it came. No control characters.
    #[must_use]
    pub fn board(&self) -> &str {
        &self.board
    }

    /// Times that the board has started again.
    #[must_use]
    pub const fn starts(&self) -> u64 {
        self.starts
    }

    /// Events that came since the board's start, and those that were lost on the way, overwritten
    /// before they were sent, or of unknown tasks.
    #[must_use]
    pub const fn counts(&self) -> (u64, u64) {
        (self.events, self.missed)
    }

    /// Host's clock less the board's, ns, by the time exchange; `None` if it is known by arrivals
    /// alone.
    #[must_use]
    pub const fn exchanged(&self) -> Option<i64> {
        self.exchanged
    }
}
