//! [`ReaderSource`]: a worker receives from its reader's socket, on its own budget.
//!
//! ```text
//!   worker: wait: epoll on its bell, its readers' sockets, nudges
//!           pull: receive ─ lock ─ handle ─ unlock, …     the kernel drops what does not fit
//!                 lock ─ wake the dispatcher, if anything is for others ─ unlock
//! ```
//!
//! Readers of which nobody expects an answer in time are given away like this: best effort, without
//! deadline and lease. The dispatcher, which is never late, answers for the others.

use super::adapter::Rtps;
use super::nudge::{BUFFER, Nudge};
use super::state::{Round, State};
use crate::Nanos;
use crate::middleware::{Interest, ReaderId, Room, SampleInfo, Source, SourceSet};
use crate::platform::wall_clock;
use crate::sync::{Arc, AtomicBool, Ordering};
use alloc::boxed::Box;
use alloc::vec;
use replenish_os::{Counted, PiMutex, WakeFd, clock, receive_counted, stamp_arrivals};
use replenish_rtps::participant as rtps;
use std::net::UdpSocket;

/// Datagrams that one pull takes.
const BATCH: usize = 64;
struct ReaderSource {
    state: Arc<PiMutex<State>>,
    waker: Arc<WakeFd>,
    backlog: Arc<AtomicBool>,
    reader: ReaderId,
    id: rtps::ReaderId,
    socket: UdpSocket,
    nudge: Arc<Nudge>,
    buf: Box<[u8]>,
    /// Samples that were lost before the last pull.
    lost: u64,
}

impl Rtps {
    /// Gives a reader's socket away, if the reader owes nobody an answer.
    pub(super) fn give_away(
        &self,
        reader: ReaderId,
        set: &SourceSet,
        key: u32,
    ) -> Option<Box<dyn Source>> {
        let mut inlets = self.inlets.lock();
        let mut state = self.state.lock();
        let id = state.owes_nothing(reader)?;
        let nudge = Arc::new(Nudge::new().ok()?);
        set.add(&nudge.fd, key).ok()?;
        let socket = inlets.socket(reader)?;
        stamp_arrivals(socket).ok()?;
        set.add(socket, key).ok()?;
        let socket = inlets.give_away(&self.set, reader)?;
        state.give_away(reader, &nudge);
        Some(Box::new(ReaderSource {
            state: Arc::clone(&self.state),
            waker: Arc::clone(&self.waker),
            backlog: Arc::clone(&self.backlog),
            reader,
            id,
            socket,
            nudge,
            buf: vec![0; BUFFER].into_boxed_slice(),
            lost: 0,
        }))
    }
}

impl Source for ReaderSource {
    fn begin(&mut self, set: &SourceSet, key: u32) {
        // They were added: it cannot fail.
        set.listen(&self.socket, key).ok();
        set.listen(&self.nudge.fd, key).ok();
    }

    fn pull(&mut self, sink: &mut dyn FnMut(&SampleInfo, &[u8])) -> bool {
        self.nudge.clear();
        let mut to = |_: ReaderId, info: &SampleInfo, bytes: &[u8]| {
            sink(info, bytes);
            Room::Left
        };
        let mut interest = Interest::empty();
        interest.insert(self.reader);
        let mut round = Round {
            interest: &mut interest,
            sink: &mut to,
            taken: 0,
        };
        for _ in 0..BATCH {
            let Ok(datagram) = receive_counted(&self.socket, &mut self.buf) else {
                self.look_around(&mut round);
                return false;
            };
            let now = clock::monotonic();
            let bytes = self.buf.get(..datagram.len).unwrap_or_default();
            let mut state = self.state.lock();
            state.count_drops((self.reader, self.id), datagram.drops);
            state.receive(bytes, now);
            let state = State::fetch_all(&self.state, state, Some(self.id));
            let times = (now, arrival(&datagram, now));
            let name = (self.reader, self.id);
            drop(State::hand_over_all_of(
                &self.state,
                state,
                name,
                &mut round,
                times,
            ));
        }
        self.look_around(&mut round);
        true
    }
}

impl ReaderSource {
    /// Takes what another thread has received for this reader, and wakes the dispatcher if anything
    /// is to be done for others.
    fn look_around(&mut self, round: &mut Round<'_, '_>) {
        let now = clock::monotonic();
        let state = self.state.lock();
        let name = (self.reader, self.id);
        let state = State::hand_over_all_of(&self.state, state, name, round, (now, now));
        let others = state.nudge_owners();
        let lost = if state.watches.is_empty() {
            self.lost
        } else {
            state.lost(self.reader)
        };
        let is_due = state.is_due(now) || state.participant.has_event() || lost != self.lost;
        drop(state);
        self.lost = lost;
        if others {
            self.backlog.store(true, Ordering::Release);
        }
        if others || is_due {
            self.waker.wake();
        }
    }
}

/// The time at which the kernel took a datagram, on the clock of `now`. It is not in the future,
/// and if the wall clock was set meanwhile, it is `now`.
fn arrival(datagram: &Counted, now: Nanos) -> Nanos {
    let wall = wall_clock().and_then(|now| Nanos::try_from(now.as_nanos()).ok());
    let waited = datagram
        .at
        .zip(wall)
        .and_then(|(at, wall)| wall.checked_sub(at));
    now.saturating_sub(waited.unwrap_or(0))
}
