//! The dispatcher's work for the participant beside samples: discovery, acknowledgements, changes
//! of the host's addresses, and whatever is due.
//!
//! ```text
//!   a datagram of discovery, an acknowledgement ──► receive_within ──┐
//!   an address has come or gone ──► follow_network ─────────────────►├─► CPU time, of the part's
//!   a round ──► housekeep ──► send_due(Discovery), (Repairs) ────────┘   allowance
//!                        └──► send_due(Samples)
//! ```

use super::adapter::{Rtps, listened};
use super::inlets::{BATCH, Inlets};
use super::state::{PARTS, Round};
use crate::Nanos;
use crate::middleware::{Interest, Room};
use crate::sync::Ordering;
use replenish_os::clock;
use replenish_rtps::participant::Part;
use replenish_rtps::udp::Interfaces;
use std::net::UdpSocket;

/// Datagrams that one round of housekeeping sends; more wait for the next one.
const DATAGRAMS: usize = 1024;

impl Rtps {
    /// As [`receive_shared`](Self::receive_shared), while there is CPU time left for the part.
    pub(super) fn receive_within(
        &self,
        part: Part,
        inlets: &mut Inlets,
        socket: &UdpSocket,
        round: &mut Round<'_, '_>,
    ) {
        let (mut before, mut most) = (clock::thread_cpu(), BATCH);
        for taken in 0..BATCH {
            let now = clock::monotonic();
            if taken >= most || self.state.lock().resumes_at(part, now).is_some() {
                return;
            }
            let Some(datagram) = inlets.receive_from(socket) else {
                return;
            };
            self.take_in(datagram, round, now);
            before = self.spend_since(part, before, now);
            if taken == 0 {
                most = inlets.batch(now);
            }
        }
    }

    /// A part has had the thread's CPU time since `before`, until now, which it returns.
    fn spend_since(&self, part: Part, before: Nanos, now: Nanos) -> Nanos {
        let after = clock::thread_cpu();
        let spent = after.saturating_sub(before);
        self.state.lock().spend(part, spent, now);
        after
    }

    /// Sends what is due, and keeps events for the executor.
    pub(super) fn housekeep(&self, rung: bool) {
        let now = clock::monotonic();
        let mut state = self.state.lock();
        if rung {
            state.rung(now, &self.alarm);
        }
        let news = state.notice(now);
        if state.segments.has_changed && state.segments.is_used {
            drop(state);
            self.look_after_segments();
            state = self.state.lock();
        }
        for part in PARTS {
            if state.next_of(part, now) <= now {
                drop(state);
                self.send_due(part, now);
                state = self.state.lock();
            }
        }
        state.arm_next(now, &self.alarm);
        self.backlog.store(state.nudge_owners(), Ordering::Release);
        let watched = !state.watches.is_empty();
        drop(state);
        if news {
            self.news.fetch_add(1, Ordering::Release);
        }
        if watched {
            self.tell_watches();
        }
    }

    /// Sends what is due of one part; discovery and repairs, where a dispatcher has begun, while
    /// there is CPU time left for them.
    fn send_due(&self, part: Part, now: Nanos) {
        let bounded = part != Part::Samples && self.dispatched.load(Ordering::Acquire);
        let mut before = if bounded { clock::thread_cpu() } else { 0 };
        for _ in 0..DATAGRAMS {
            // A thread that publishes has its turn after each datagram.
            let sent = self.state.lock().send_next(part, now, &self.sockets);
            if bounded {
                before = self.spend_since(part, before, now);
            }
            let is_over = bounded && self.state.lock().resumes_at(part, now).is_some();
            if !sent || is_over {
                return;
            }
        }
    }

    /// An interface may have come or gone, or have another address: peers are told, while there is
    /// CPU time left for discovery.
    pub(super) fn follow_network(&self) {
        let (mut before, now) = (clock::thread_cpu(), clock::monotonic());
        let Some(network) = &self.network else {
            return;
        };
        if self.state.lock().resumes_at(Part::Discovery, now).is_some() || !network.changes.take() {
            return;
        }
        // Addresses that cannot be read now are read after the next change.
        if let Ok(found) = network.addresses() {
            self.move_to(&found, now);
        }
        before = self.spend_since(Part::Discovery, before, now);
        while self.state.lock().participant.announce_moved(now) {
            before = self.spend_since(Part::Discovery, before, now);
        }
    }

    fn move_to(&self, found: &Interfaces, now: Nanos) {
        let used = self.state.lock().interfaces;
        if used == *found {
            return;
        }
        // An interface that is gone again is left out after the next change.
        self.sockets.follow(&used, found).unwrap_or_default();
        let mut state = self.state.lock();
        state.interfaces = *found;
        state.participant.move_to(&found.at(0), now);
    }

    /// Before a dispatcher has begun: discovery, for a thread that waits for a peer.
    pub(super) fn look_after_discovery(&self) {
        if self.dispatched.load(Ordering::Acquire) {
            return;
        }
        let mut nobody = Interest::empty();
        let mut round = Round {
            interest: &mut nobody,
            sink: &mut |_, _, _| Room::Left,
            taken: 0,
        };
        if let Some(mut inlets) = self.inlets.try_lock() {
            for socket in listened(&self.sockets, self.alone).into_iter().flatten() {
                self.receive_shared(&mut inlets, socket, &mut round);
            }
        }
        self.housekeep(true);
    }
}
